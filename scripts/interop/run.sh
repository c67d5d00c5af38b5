#!/bin/sh
# Exchanges image files with SimpleITK, VTK, pynrrd and nibabel in both directions, in empty
# folders. Movies are read with Pillow and FFmpeg, meshes with VTK, trimesh and meshio, and label
# volumes with SimpleITK, pynrrd and nibabel.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/images" "$folder/movies" "$folder/meshes" "$folder/labels"
out/interop/bin/python scripts/interop/both_ways.py "$program" "$folder/images"
out/interop/bin/python scripts/interop/movies.py "$program" "$folder/movies"
out/interop/bin/python scripts/interop/meshes.py "$program" "$folder/meshes"
out/interop/bin/python scripts/interop/labels.py "$program" "$folder/labels"
