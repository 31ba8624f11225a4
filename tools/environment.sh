#!/usr/bin/env bash
# Makes the virtual environment FOLDER, or brings it up to date, with the packages in the lock REQUIREMENTS.
# pip refuses files whose hashes the lock lacks, and source packages that the lock does not name.
#
#   tools/environment.sh FOLDER REQUIREMENTS
set -euo pipefail
folder=$1 requirements=$2

if [ ! -x "$folder/bin/python" ]; then
    python=$("$(dirname "$0")/prerequisites.sh" --find-python)
    echo "leafcloud: making $folder with $python" >&2
    "$python" -m venv "$folder"
fi
echo "leafcloud: installing $requirements into $folder" >&2
"$folder/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
    --requirement "$requirements"
