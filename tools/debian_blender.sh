#!/usr/bin/env bash
# Makes a folder with Debian's Blender, for `make test-interface`, and prints the command that runs it.
#
#   tools/debian_blender.sh FOLDER [SUITE]      (SUITE: sid with Blender 5.2, the default; trixie with Blender 4.3)
#   tools/debian_blender.sh --unmount FOLDER    before FOLDER is deleted
#
# Needs root, on Debian or Ubuntu. FOLDER becomes a system of its own (2 GB). /proc, /dev, /tmp and the folder above this
# project are mounted in it under their own paths: unmount them before you delete FOLDER, or they are deleted, too. Run the
# script again after a restart of the machine, to mount them again.
set -euo pipefail

fail() {
    echo "leafcloud: $*" >&2
    exit 1
}

project=$(cd "$(dirname "$0")/.." && pwd)
shared=(/dev /tmp "$(dirname "$project")")
[ "$(id -u)" = 0 ] || fail "tools/debian_blender.sh mounts folders: run it as root"

if [ "${1:-}" = --unmount ]; then
    folder=$(realpath "${2:?the folder}")
    for path in "${shared[@]}" /proc; do
        if mountpoint -q "$folder$path"; then umount "$folder$path"; fi
    done
    exit
fi

[ $# -ge 1 ] || fail "usage: tools/debian_blender.sh [--unmount] FOLDER [SUITE]"
folder=$(realpath -m "$1")
made=$folder/.leafcloud
if [ ! -e "$made" ]; then
    [ ! -e "$folder" ] || fail "$folder exists, but is unfinished or another's: choose a new folder, or --unmount and delete it"
    command -v debootstrap >/dev/null || apt-get install -y -qq debootstrap >&2
    debootstrap --variant=minbase "${2:-sid}" "$folder" >&2
    # Proxies and mirrors of this machine.
    cp -r /etc/apt/apt.conf.d/. "$folder/etc/apt/apt.conf.d/"
    cp /etc/resolv.conf "$folder/etc/"
    touch "$made"
fi
mountpoint -q "$folder/proc" || mount -t proc proc "$folder/proc"
for path in "${shared[@]}"; do
    mkdir -p "$folder$path"
    mountpoint -q "$folder$path" || mount --bind "$path" "$folder$path"
done
if [ ! -x "$folder/usr/bin/blender" ]; then
    chroot "$folder" apt-get update -qq >&2
    # Without python3-cattr the extensions of Blender 5.2 do not register.
    DEBIAN_FRONTEND=noninteractive chroot "$folder" apt-get install -y -qq --no-install-recommends \
        blender python3-numpy python3-requests python3-cattr libegl1 libgl1 libgl1-mesa-dri >&2
fi
echo "chroot $folder blender"
