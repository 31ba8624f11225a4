#!/usr/bin/env bash
# Runs pytest in the given environments, two at a time (a test seldom uses more than one core), in all of them even when
# one fails, and ends with their summaries.
#
#   tools/run_tests.sh ENVIRONMENT… [-- PYTEST_ARGUMENT…]
#
# What an environment says is shown when it is done. The exit status is 0 when every run passed. The time limit is for
# Blenders that hang when they exit, which no limit inside pytest can end.
set -uo pipefail

environments=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do
    environments+=("$1")
    shift
done
shift || true # the --

logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT

test_in() {
    local environment=$1 log=$logs/$1 blender code
    shift
    blender=$("$environment/bin/python" -c 'from importlib.metadata import version; print(version("bpy"))')
    timeout --kill-after=10 2400 "$environment/bin/python" -m pytest "$@" >"$log" 2>&1
    code=$?
    echo "leafcloud: tested in Blender $blender"
    cat "$log"
    [ "$code" = 0 ] || touch "$logs/failed"
    {
        echo
        echo "Blender $blender, exit status $code:"
        grep -E '^=+ .* in [0-9.]+s.* =+$' "$log" | tail -n 1 || echo "pytest ended without a summary"
    } >>"$logs/summaries"
}

for environment in "${environments[@]}"; do
    [ "$(jobs -rp | wc -l)" -lt 2 ] || wait -n
    test_in "$environment" "$@" &
done
wait
cat "$logs/summaries"
[ ! -e "$logs/failed" ]
