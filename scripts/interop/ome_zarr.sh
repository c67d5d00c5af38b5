#!/bin/sh
# Makes OME-Zarr volumes that other programs read (`make interop` installs them first), and one in
# regions whose processes have a quarter of its memory as address space: same bytes as in one piece.
set -eu
cd "$(dirname "$0")/../.."

program=$(cd "$(dirname "$(scripts/build.sh)")" && pwd)/sonoweave
python=$PWD/out/interop/bin/python
readers=$PWD/scripts/interop/zarr_readers.py
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
cd "$place"

# Runs the program, whose messages are shown if it fails.
does() {
    "$program" "$@" >log 2>&1 || {
        cat log >&2
        exit 1
    }
}
does phantom -o s.mha --frames 40 --image-size 48x40 --pixel 0.5 --gap 0.5 --trajectory freehand
for scalar in u8 u16 f32; do
    does reconstruct s.mha -o "$scalar.ome.zarr" --spacing 0.2 --clip none --type "$scalar" --seen-label
    does convert "$scalar.ome.zarr" -o "$scalar.nrrd"
    "$python" "$readers" "$scalar.ome.zarr" "$scalar.nrrd"
done

# kB
limit=170000
volume="s.mha --spacing 0.05 --sigma 0.3,0.3,0.3 --clip none"
# shellcheck disable=SC2086 # flags are words
does reconstruct $volume -o whole.ome.zarr --json=whole.json
bytes=$("$python" -c 'import json; print(json.load(open("whole.json"))["bytes"])')
[ "$bytes" -ge $((4 * 1024 * limit)) ] || {
    echo "ome_zarr: the volume has $bytes bytes of bricks, less than four times $limit kB" >&2
    exit 1
}
# shellcheck disable=SC2086
does regions plan $volume -o limb.ome.zarr --max-memory 0.024
(
    ulimit -v "$limit"
    export MALLOC_ARENA_MAX=1
    # shellcheck disable=SC2086
    ! "$program" reconstruct $volume -o failed.mha --threads 1 >log 2>&1 || {
        echo "ome_zarr: the whole volume fits into $limit kB" >&2
        exit 1
    }
    does regions run limb.ome.zarr --threads 1 --part 1/2
    does regions run limb.ome.zarr --threads 1 --part 2/2
    does regions finish limb.ome.zarr --threads 1
)
diff -r whole.ome.zarr limb.ome.zarr
echo "limb.ome.zarr: $bytes bytes of bricks, by processes of $limit kB, has the bytes of one piece"
