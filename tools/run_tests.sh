#!/usr/bin/env bash
# Runs pytest in each of the given environments, in all of them even when one fails, and ends with their summaries.
#
#   tools/run_tests.sh ENVIRONMENT… [-- PYTEST_ARGUMENT…]
#
# The exit status is 0 when every run passed. The time limit is for Blenders that hang when they exit, which no limit
# inside pytest can end.
set -uo pipefail

environments=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do
    environments+=("$1")
    shift
done
shift || true # the --

logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
status=0
summaries=
for environment in "${environments[@]}"; do
    blender=$("$environment/bin/python" -c 'from importlib.metadata import version; print(version("bpy"))')
    echo "leafcloud: testing in Blender $blender"
    timeout --kill-after=10 1200 "$environment/bin/python" -m pytest "$@" 2>&1 | tee "$logs/$environment"
    code=${PIPESTATUS[0]}
    summary=$(grep -E '^=+ .* in [0-9.]+s.* =+$' "$logs/$environment" | tail -n 1)
    summaries+=$'\n'"Blender $blender, exit status $code:"$'\n'"${summary:-pytest ended without a summary}"
    [ "$code" = 0 ] || status=1
done
echo "$summaries"
exit $status
