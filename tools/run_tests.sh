#!/usr/bin/env bash
# Runs pytest in the given environments, two at a time (a test seldom uses more than one core), in all of them even when
# one fails, and ends with their summaries. Of an odd number of environments the last is tested in two halves at once
# (tests/conftest.py), so that no core waits.
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

# test_in ENVIRONMENT HALF PYTEST_ARGUMENT…: HALF is empty for all tests, else --half=1 or --half=2.
test_in() {
    local environment=$1 half=$2 log=$logs/$1$2 blender code
    shift 2
    blender=$("$environment/bin/python" -c 'from importlib.metadata import version; print(version("bpy"))')
    timeout --kill-after=10 2400 "$environment/bin/python" -m pytest ${half:+"$half"} "$@" >"$log" 2>&1
    code=$?
    # All that was asked for may be in the other half: pytest's status 5.
    [ -n "$half" ] && [ "$code" = 5 ] && touch "$logs/nothing$half" && code=0
    echo "leafcloud: tested in Blender $blender${half:+ ($half)}"
    cat "$log"
    [ "$code" = 0 ] || touch "$logs/failed"
    {
        echo
        echo "Blender $blender${half:+ ($half)}, exit status $code:"
        grep -E '^=+ .* in [0-9.]+s.* =+$' "$log" | tail -n 1 || echo "pytest ended without a summary"
    } >>"$logs/summaries"
}

start() {
    [ "$(jobs -rp | wc -l)" -lt 2 ] || wait -n
    test_in "$@" &
}

last=
if [ $((${#environments[@]} % 2)) = 1 ]; then
    last=${environments[-1]}
    unset 'environments[-1]'
fi
for environment in "${environments[@]}"; do
    start "$environment" "" "$@"
done
for half in ${last:+--half=1 --half=2}; do
    start "$last" "$half" "$@"
done
wait
cat "$logs/summaries"
[ ! -e "$logs/failed" ] && [ "$(find "$logs" -name 'nothing*' | wc -l)" -lt 2 ]
