#!/usr/bin/env bash
# Shows the program without any hardware: a session at a virtual bedside, in the browser where there
# is a display, until Ctrl-C. With a duration it opens no browser and ends by itself; then it
# replays the session from its recording and compares the results, and shows a virtual arm.
#
#   scripts/demo.sh [SECONDS [FOLDER]]     until Ctrl-C, in out/demo
set -euo pipefail
cd "$(dirname "$0")/.."

duration=${1:-}
folder=${2:-out/demo}
if [ -e "${CARGO_TARGET_DIR:-target}/release/sonoweave" ]; then
    echo "== builds what has changed of the program"
else
    echo "== builds the program: about four minutes on two cores, and seconds the next time"
fi
began=$SECONDS
program=$(scripts/build.sh)
echo "== built in $((SECONDS - began)) s"
rm -rf "$folder"
sonoweave() { "$program" "$@"; }

echo
if [ -z "$duration" ]; then
    echo "== a virtual bedside until Ctrl-C: a hand sweeps a probe over a doll in a water tank, to and fro,"
    echo "   10 s each way; the volume grows here and in the browser"
    # On a terminal, Ctrl-C is for the session only: this script and make go on to their ends.
    [ ! -t 0 ] || set -m
    sonoweave demo --open -o "$folder"
    set +m
else
    echo "== $duration s at a virtual bedside: a hand sweeps a probe to and fro over a doll in a water tank;"
    echo "   tracker and video come late and unevenly"
    sonoweave demo --duration "$duration" -o "$folder"
fi
session=$(echo "$folder"/SESSION-*.mcap)
if [ -n "$duration" ]; then
    echo
    echo "== the same session from its recording: every decision is made again and compared"
    again=$folder/again
    sonoweave replay "$session" -o "$again.mha" --weights "$again-weights.mha" --picture "$again.png"
    cmp "$folder/volume.mha" "$again.mha"
    cmp "$folder/picture.png" "$again.png"
    echo
    echo "== its planes"
    sonoweave render "$folder/volume.mha" --weights "$again-weights.mha" --mode slice -o "$folder/planes.png"
    rm "$again.mha" "$again-weights.mha" "$again.png"
    echo
    echo "== 8 s of a virtual arm, by the planar path"
    sonoweave demo --arm --headless --duration 8 -o "$folder/arm"
fi
echo
echo "session        $session"
echo "configuration  $folder/bedside.toml"
echo "volume         $folder/volume.mha"
echo "picture        $folder/picture.png"
[ ! -e "$folder/planes.png" ] || echo "planes         $folder/planes.png (the volume's three middle ones)"
echo "numbers        $folder/statistics.json"
echo "again          $program replay $session --picture again.png"
