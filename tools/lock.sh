#!/usr/bin/env bash
# Writes the lock NAME.txt of each NAME.in in tools/requirements: all packages, their versions and the hashes of their files.
#
#   tools/lock.sh UV ARGUMENT…      UV: the command of uv; ARGUMENT: for `uv pip compile`, such as --upgrade
#
# Versions in the locks stay unless NAME.in or --upgrade asks for others. All locks together have one version of each
# package, because make installs several of them into one environment. Only bpy and numpy belong to a Blender each.
set -euo pipefail
cd "$(dirname "$0")/requirements"
uv=$1
shift

# compile OUTPUT INPUT ARGUMENT…
compile() {
    local output=$1 input=$2
    shift 2
    "$uv" pip compile --quiet --universal --python-version 3.11 --no-config --no-annotate \
        --custom-compile-command "make locks" --output-file "$output" "$input" "$@"
}

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
blenders=(blender-*.in)
others=()
for input in *.in; do
    [[ $input == blender-* ]] || others+=("$input")
done

# uv keeps the versions that it finds in its output.
grep -hoE '^[A-Za-z0-9._-]+==[^ ]+' blender-4.5.txt "${others[@]/%.in/.txt}" | sort -u >"$folder/together.txt" || true
cat blender-4.5.in "${others[@]}" >"$folder/together.in"
compile "$folder/together.txt" "$folder/together.in" --only-binary :all: "$@"
grep -vE '^(bpy|numpy)==' "$folder/together.txt" >"$folder/apart.txt"
locked=(--generate-hashes --emit-build-options)

for input in "${blenders[@]}"; do
    compile "${input/%.in/.txt}" "$input" "${locked[@]}" --constraint "$folder/apart.txt"
done
for input in "${others[@]}"; do
    compile "${input/%.in/.txt}" "$input" "${locked[@]}" --constraint "$folder/together.txt"
done
