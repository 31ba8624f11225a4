#!/usr/bin/env bash
# Makes a folder with Debian's Blender, for `make test-interface`, and prints the command that runs it.
#
#   tools/debian_blender.sh FOLDER [SUITE]      (SUITE: sid with Blender 5.2, the default; trixie with Blender 4.3)
#
# Needs root, on Debian or Ubuntu. FOLDER becomes a system of its own (2 GB); this project and /tmp are mounted in it under
# their own paths. Run it again after a restart of the machine, to mount them again.
set -euo pipefail

[ $# -ge 1 ] || { echo "usage: tools/debian_blender.sh FOLDER [SUITE]" >&2; exit 1; }
[ "$(id -u)" = 0 ] || { echo "leafcloud: tools/debian_blender.sh mounts folders: run it as root" >&2; exit 1; }
folder=$(realpath -m "$1")
suite=${2:-sid}
project=$(cd "$(dirname "$0")/.." && pwd)

if [ ! -x "$folder/usr/bin/blender" ]; then
    command -v debootstrap >/dev/null || apt-get install -y -qq debootstrap >&2
    debootstrap --variant=minbase "$suite" "$folder" >&2
    # Proxies and mirrors of this machine.
    cp -r /etc/apt/apt.conf.d/. "$folder/etc/apt/apt.conf.d/"
    cp /etc/resolv.conf "$folder/etc/"
fi
mount_once() {
    mkdir -p "$folder$2"
    mountpoint -q "$folder$2" || mount "$1" "$2" "$folder$2"
}
mountpoint -q "$folder/proc" || mount -t proc proc "$folder/proc"
mount_once --bind /dev
mount_once --bind /tmp
mount_once --bind "$(dirname "$project")"
if [ ! -x "$folder/usr/bin/blender" ]; then
    chroot "$folder" apt-get update -qq >&2
    # Without python3-cattr the extensions of Blender 5.2 do not register.
    DEBIAN_FRONTEND=noninteractive chroot "$folder" apt-get install -y -qq --no-install-recommends \
        blender python3-numpy python3-requests python3-cattr libegl1 libgl1-mesa-dri >&2
fi
echo "chroot $folder blender"
