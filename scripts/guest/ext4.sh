#!/usr/bin/env bash
# Makes a disk with an ext4 file system for the guest.
#
#   scripts/guest/ext4.sh FILE MEGABYTES
set -euo pipefail
tree=$(dirname "$0")/../../out/guest/tree

# Tools of the system are not in everyone's path.
export PATH=$PATH:/usr/sbin:/sbin
make=(mkfs.ext4)
if ! command -v mkfs.ext4 >/dev/null; then
    export LD_LIBRARY_PATH=$tree/usr/lib/x86_64-linux-gnu:$tree/lib/x86_64-linux-gnu
    make=("$tree/sbin/mkfs.ext4")
fi
# Everything is made now, so that the kernel writes nothing of its own later.
truncate --size "$2M" "$1"
"${make[@]}" -q -F -E lazy_itable_init=0,lazy_journal_init=0 "$1"
