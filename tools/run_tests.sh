#!/usr/bin/env bash
# Runs pytest in an environment, three test files at a time: a test seldom uses more than one core, and some wait.
#
#   tools/run_tests.sh ENVIRONMENT PYTEST_ARGUMENT…
#
# The core is that in target/core, which has checks (`make target/core/.installed`).
# Files stay in their order, slow ones (tests/bake) first: at the end, short files keep all processes busy.
# The time limit ends a Blender that hangs when it exits; no limit inside pytest can.
set -euo pipefail
environment=$1
shift

PYTHONPATH=$(cd "$(dirname "$0")/.." && pwd)/target/core${PYTHONPATH:+:$PYTHONPATH}
export PYTHONPATH LEAFCLOUD_TIMES=${environment##*/}
blender=$("$environment/bin/python" -c 'from importlib.metadata import version; print(version("bpy"))')
echo "leafcloud: testing in Blender $blender" >&2
exec timeout --kill-after=10 9000 "$environment/bin/python" -m pytest --numprocesses 3 --dist loadfile --no-loadscope-reorder "$@"
