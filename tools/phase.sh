#!/usr/bin/env bash
# Runs a command and records how long it took, for `make test-times`.
#
#   tools/phase.sh NAME COMMAND…
#
# A record is a line in target/times/phases.tsv: name, seconds, exit status.
set -uo pipefail
name=$1
shift
folder=$(dirname "$0")/../target/times
mkdir -p "$folder"
begin=$(date +%s.%N)
"$@"
status=$?
# A phase that runs again replaces its record.
if [ -f "$folder/phases.tsv" ]; then
    awk -F '\t' -v name="$name" '$1 != name' "$folder/phases.tsv" >"$folder/phases.tmp" && mv "$folder/phases.tmp" "$folder/phases.tsv"
fi
printf '%s\t%s\t%s\n' "$name" "$(echo "$(date +%s.%N) $begin" | awk '{printf "%.1f", $1 - $2}')" "$status" >>"$folder/phases.tsv"
exit $status
