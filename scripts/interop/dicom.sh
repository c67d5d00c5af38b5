#!/usr/bin/env bash
# Tests that other programs accept our DICOM. dciodvfy (dicom3tools) finds no error in a volume, a
# sweep and a region. pydicom reads the same voxels in the same places. We read volume and sweep
# back to the bit, and a volume that pydicom has written without our private elements. An Orthanc
# server on loopback stores all and returns the same bytes.
#
# `make interop` installs the other programs first. Nothing is left running; the files stay in
# out/dicom.
set -euo pipefail
cd "$(dirname "$0")/../.."

say() { echo "dicom: $*"; }
fail() {
    say "$*" >&2
    exit 1
}

python=$PWD/out/interop/bin/python
program=$(scripts/build.sh)

place=out/dicom
rm -rf "$place"
mkdir -p "$place"
place=$(cd "$place" && pwd)

say "== a sweep and volumes of it, of 8 and 16 bits, along the world and turned"
who=(--patient-name "Müller^Jörg" --patient-id 4711 --study-description "Phantom study")
(
    cd "$place"
    "$program" phantom -o sweep.mha --image-size 96x80 --pixel 0.3 --frames 31 --gap 0.6 --trajectory fan --seed 3
    "$program" phantom -o other.mha --image-size 96x80 --pixel 0.3 --frames 31 --gap 0.6 --trajectory parallel
    for name in volume:sweep:general:u8 turned:other:planar:u16; do
        IFS=: read -r volume sweep path type <<<"$name"
        weave=(reconstruct "$sweep.mha" --path "$path" --type "$type" --sigma auto --fill nearest --fill-radius 1)
        "$program" "${weave[@]}" -o "$volume.mha"
        "$program" "${weave[@]}" -o "$volume.dcm" "${who[@]}"
    done
    "$program" dicom volume.mha -o again.dcm "${who[@]}"
    "$program" dicom sweep.mha -o sweep.dcm "${who[@]}"
    "$program" dicom sweep.mha -o nobody.dcm
    seed=$("$python" ../../scripts/interop/dicom_check.py --brightest turned.mha)
    region=(region turned.mha "--seed=$seed" --smooth 0 --range 1,65535 --limit 10000)
    "$program" "${region[@]}" -o region.dcm "${who[@]}"
    "$program" "${region[@]}" -o packed.mha
    "$program" convert packed.mha -o region.mha
    for name in volume turned sweep; do
        "$program" convert "$name.dcm" -o "$name-back.mha"
    done
) >"$place/made.log"
cmp "$place/volume.dcm" "$place/again.dcm" || fail "the volume's file and the volume itself gave different images"

say "== dciodvfy"
for file in "$place"/*.dcm; do
    dciodvfy "$file" >"$file.txt" 2>&1 || true
    if grep -q '^Error\|- Error' "$file.txt"; then
        grep '^Error\|- Error' "$file.txt" >&2
        fail "dciodvfy finds errors in $file"
    fi
    grep -q '^EnhancedUltrasoundVolume$\|^USMultiFrameImage$\|^Segmentation$' "$file.txt" || fail "dciodvfy does not know what $file is"
    say "$(basename "$file"): $(grep '^[A-Z][A-Za-z]*$' "$file.txt"), no error"
done

say "== pydicom"
"$python" scripts/interop/dicom_check.py "$place"

say "== files that pydicom has written"
mkdir "$place/others"
"$python" scripts/interop/dicom_others.py "$place" "$place/others"
(
    cd "$place/others"
    for name in volume turned; do
        "$program" inspect "$name.dcm" --against "../$name.mha" >"$name.txt"
        grep -q 'RMSE  *0\.000$' "$name.txt" || fail "$name: other voxels, or at other places"
    done
    "$program" convert sweep.dcm -o sweep.mha >/dev/null
    ! "$program" reconstruct sweep.dcm -o none.mha 2>refused.txt || fail "pictures without poses became a volume"
    grep -q 'a sequence without transforms' refused.txt || fail "$(cat refused.txt)"
    ! "$program" inspect packed.dcm 2>refused.txt || fail "compressed pixels were read"
    grep -q 'RLE Lossless.*store the file uncompressed' refused.txt || fail "$(cat refused.txt)"
)
say "volumes and pictures of other programs are read, compressed ones refused"

say "== Orthanc"
store=$(mktemp -d)
server=""
stop() {
    [ -z "$server" ] || kill "$server" 2>/dev/null || true
    [ -z "$server" ] || wait "$server" 2>/dev/null || true
    rm -rf "$store"
}
trap stop EXIT
trap 'exit 1' INT TERM
port=$("$python" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
cat >"$store/orthanc.json" <<JSON
{ "StorageDirectory": "$store/files", "IndexDirectory": "$store/files", "HttpPort": $port,
  "HttpBindAddresses": ["127.0.0.1"], "RemoteAccessAllowed": false, "AuthenticationEnabled": false,
  "DicomServerEnabled": false, "Plugins": [] }
JSON
Orthanc "$store/orthanc.json" >"$place/orthanc.log" 2>&1 &
server=$!
"$python" scripts/interop/dicom_archive.py "http://127.0.0.1:$port" "$place" || {
    tail -5 "$place/orthanc.log" >&2
    fail "Orthanc did not store and return the images"
}
say "all well"
