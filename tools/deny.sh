#!/usr/bin/env bash
# Checks the crates of all three Cargo workspaces by the rules of deny.toml: duplicates, licenses, sources and known faults.
#
# Known faults (advisories) come from RustSec's database. $ADVISORY_DB names a folder with a Git clone of it, else
# cargo-deny downloads it. Without both, this check is left out and one line says so.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo deny --version >/dev/null 2>&1 || {
    echo "leafcloud: make deny needs cargo-deny: cargo install cargo-deny --locked" >&2
    exit 1
}

if [ -n "${ADVISORY_DB:-}" ]; then
    # cargo-deny reads Git's configuration, which sends it to the folder.
    export GIT_CONFIG_COUNT=1 GIT_CONFIG_VALUE_0=https://github.com/RustSec/advisory-db
    GIT_CONFIG_KEY_0=url.file://$(realpath "$ADVISORY_DB").insteadOf
    export GIT_CONFIG_KEY_0
fi
checks=(bans licenses sources)
left_out=
if cargo deny fetch db 2>/dev/null; then
    checks+=(advisories)
elif [ -n "${ADVISORY_DB:-}" ]; then
    echo "leafcloud: ADVISORY_DB=$ADVISORY_DB is no Git clone of RustSec's database" >&2
    exit 1
else
    left_out="leafcloud: left out the advisories: RustSec's database cannot be had here (ADVISORY_DB=/path/to/clone names a copy)"
fi

echo "leafcloud: Cargo.lock"
cargo deny --locked check "${checks[@]}"
echo "leafcloud: engines/bevy/Cargo.lock"
(cd engines/bevy && cargo deny --locked check "${checks[@]}")
# The fuzz targets have some of the project's crates only, so some rules match nothing.
echo "leafcloud: rust/fuzz/Cargo.lock"
unused=(--allow unmatched-skip --allow license-not-encountered --allow advisory-not-detected)
(cd rust/fuzz && cargo deny --locked --config ../../deny.toml check "${unused[@]}" "${checks[@]}")
if [ -n "$left_out" ]; then echo "$left_out"; fi
