#!/bin/sh
# Shows the program without any hardware: a session on a virtual bedside, and the same session again
# from its recording.
set -eu
cd "$(dirname "$0")/.."

folder=${1:-out/demo}
rm -rf "$folder"
program=$(scripts/build.sh)
sonoweave() { "$program" "$@"; }

echo
echo "== 12 s at a virtual bedside: a hand sweeps a probe to and fro over a doll in a water tank;"
echo "   tracker and video come late and unevenly"
sonoweave demo --duration 12 -o "$folder"
session=$(echo "$folder"/SESSION-*.mcap)
echo
echo "== the same session from its recording: every decision is made again and compared"
sonoweave replay "$session" -o "$folder/again.mha" --picture "$folder/again.png"
cmp "$folder/volume.mha" "$folder/again.mha"
cmp "$folder/picture.png" "$folder/again.png"
rm "$folder/again.mha" "$folder/again.png"
echo
echo "== its planes"
sonoweave render "$folder/volume.mha" --weights "$folder/weights.mha" --mode slice -o "$folder/planes.png"
echo
echo "== 8 s of a virtual arm, by the planar path"
sonoweave demo --arm --headless --duration 8 -o "$folder/arm"
echo
echo "session        $session"
echo "configuration  $folder/bedside.toml"
echo "volume         $folder/volume.mha"
echo "picture        $folder/picture.png"
echo "planes         $folder/planes.png (the volume's three middle ones)"
echo "numbers        $folder/statistics.json"
