#!/bin/sh
# A synthetic sweep whose truth is known, reconstructed and drawn: what the program does, without any hardware.
set -eu
cd "$(dirname "$0")/.."

folder=${1:-out/demo}
mkdir -p "$folder"
cargo build --release --locked
# Through cargo, which knows where it built to.
sonoweave() { cargo run --release --locked --quiet -- "$@"; }

echo
echo "== a sweep by hand over a phantom of 60 blobs and a sphere: 120 pictures of a convex probe, 512×480 pixels"
sonoweave phantom -o "$folder/sweep.igs.mha" --truth "$folder/truth.mha" \
    --scene blobs --trajectory freehand --fan --spacing 0.5 --noise 6 --seed 3
echo
echo "== the volume, woven slice by slice"
sonoweave reconstruct "$folder/sweep.igs.mha" -o "$folder/volume.mha" --spacing 0.5 --sigma auto \
    --weights "$folder/weights.mha" --planes "$folder/volume.png" --stats "$folder/statistics.json"
echo
echo "== its picture"
sonoweave render "$folder/volume.mha" --weights "$folder/weights.mha" -o "$folder/picture.png"
echo
echo "== how near it is to the truth"
sonoweave inspect "$folder/volume.mha" --against "$folder/truth.mha" --weights "$folder/weights.mha"
echo
echo "sweep    $folder/sweep.igs.mha"
echo "volume   $folder/volume.mha"
echo "planes   $folder/volume.png (its three middle ones)"
echo "picture  $folder/picture.png"
