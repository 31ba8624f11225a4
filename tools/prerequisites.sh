#!/usr/bin/env bash
# Checks that this machine has what a step of the set-up needs; says in one line what to do when it has not.
#
#   tools/prerequisites.sh NEED…
#       rust       cargo, rustc, a linker and a C++ compiler
#       python     a Python 3.11 that can make virtual environments
#       lint       rustfmt and clippy
#       blender    the system libraries that the bpy wheels load
#       node       node and npm, for the glTF validator and three.js
#       chromium   the browser in which three.js draws, and shaders are tested
#       window     a virtual screen, and tools that press keys and take pictures on it
#   tools/prerequisites.sh --find-python
#       prints the path of that Python
#
# System packages (blender, node, chromium, Python's venv module) are installed through apt-get where that is possible
# without a question: as root or with a sudo that asks for no password. Compilers and interpreters are the user's to choose.
# $PYTHON names the Python 3.11 to use.
set -euo pipefail

fail() {
    echo "leafcloud: $*" >&2
    exit 1
}

# install REASON PACKAGE…
install() {
    local reason=$1
    shift
    local -a as_root=()
    if [ "$(id -u)" != 0 ]; then
        as_root=(sudo -n)
        if ! sudo -n true 2>/dev/null; then
            fail "$reason: install them with \`sudo apt-get install $*\` (or your system's like), then run make again."
        fi
    fi
    command -v apt-get >/dev/null ||
        fail "$reason: install what Debian calls $* with your system's package manager, then run make again."
    echo "leafcloud: $reason: installing $*" >&2
    "${as_root[@]}" apt-get update -qq >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >&2
}

is_python_3_11() {
    "$1" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null
}

find_python() {
    local candidate
    local -a candidates=(python3.11 python3 python)
    if [ -n "${PYTHON:-}" ]; then
        candidates=("$PYTHON")
    fi
    for candidate in "${candidates[@]}"; do
        # sys.executable looks through the shims of version managers.
        if is_python_3_11 "$candidate"; then
            "$candidate" -c 'import sys; print(sys.executable)'
            return
        fi
    done
    fail "Python 3.11 is missing (none among: ${candidates[*]}): install python3.11, the version that Blender's wheels" \
        "are made for, or name one with \`make PYTHON=/path/to/python3.11 …\`."
}

check_python() {
    local python
    python=$(find_python)
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        install "Python's venv module is missing" python3.11-venv
    fi
}

check_rust() {
    local tool
    for tool in cargo rustc; do
        "$tool" --version >/dev/null 2>&1 ||
            fail "Rust is missing (no working $tool on PATH): install the stable toolchain with rustup (rustup.rs)," \
                "then run make again."
    done
    # Rust links with cc; the codecs of textures and meshes are C++.
    for tool in cc c++; do
        command -v "$tool" >/dev/null ||
            fail "A C++ compiler is missing (no $tool on PATH): install one, on Debian with \`sudo apt-get install g++\`."
    done
}

check_lint() {
    if ! cargo fmt --version >/dev/null 2>&1 || ! cargo clippy --version >/dev/null 2>&1; then
        rustup component add rustfmt clippy >&2 ||
            fail "rustfmt or clippy is missing: install them with \`rustup component add rustfmt clippy\`."
    fi
}

# The shared libraries that the bpy wheels load, and Debian's packages of them.
BLENDER_LIBRARIES=(
    libX11.so.6=libx11-6
    libXrender.so.1=libxrender1
    libXxf86vm.so.1=libxxf86vm1
    libXfixes.so.3=libxfixes3
    libXi.so.6=libxi6
    libxkbcommon.so.0=libxkbcommon0
    libSM.so.6=libsm6
    libICE.so.6=libice6
    libGL.so.1=libgl1
    libEGL.so.1=libegl1
)

check_blender() {
    local known entry
    local -a packages=()
    # ldconfig lies in sbin, which is not on every user's PATH.
    known=$(PATH=$PATH:/usr/sbin:/sbin ldconfig -p)
    for entry in "${BLENDER_LIBRARIES[@]}"; do
        if [[ $known != *"${entry%=*} "* ]]; then
            packages+=("${entry#*=}")
        fi
    done
    if [ ${#packages[@]} -gt 0 ]; then
        install "Blender needs system libraries that are missing" "${packages[@]}"
    fi
}

check_node() {
    if ! command -v node >/dev/null || ! command -v npm >/dev/null; then
        install "The glTF validator and three.js need node and npm" nodejs npm
    fi
}

check_chromium() {
    command -v chromium >/dev/null || install "three.js needs a browser" chromium
}

check_window() {
    local entry
    local -a packages=()
    for entry in Xvfb=xvfb xdotool=xdotool import=imagemagick; do
        command -v "${entry%=*}" >/dev/null || packages+=("${entry#*=}")
    done
    if [ ${#packages[@]} -gt 0 ]; then
        install "The tests of the interface need a virtual screen" "${packages[@]}"
    fi
}

[ $# -gt 0 ] || fail "usage: tools/prerequisites.sh rust|python|lint|blender|node|chromium|window …"
for need in "$@"; do
    case "$need" in
        --find-python) find_python ;;
        rust | python | lint | blender | node | chromium | window) "check_$need" ;;
        *) fail "tools/prerequisites.sh knows rust, python, lint, blender, node, chromium and window, not '$need'." ;;
    esac
done
