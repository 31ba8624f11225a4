#!/usr/bin/env bash
# Whether debug and release builds give the same bytes, on 1, 2 and 16 threads: what the example `digest` prints is compared.
set -euo pipefail
cd "$(dirname "$0")/.."

declare -A digests
for profile in dev release; do
    for threads in 1 2 16; do
        found=$(RAYON_NUM_THREADS=$threads cargo run --quiet --package leafcloud --profile "$profile" --example digest)
        digests["$found"]+=" $profile-on-$threads"
    done
done
if [ ${#digests[@]} != 1 ]; then
    for found in "${!digests[@]}"; do
        echo "leafcloud:${digests[$found]}: $found" >&2
    done
    exit 1
fi
echo "leafcloud: debug and release give the same bytes on 1, 2 and 16 threads: ${!digests[*]}"
