#!/bin/sh
# Exchanges image files with SimpleITK, VTK, pynrrd and nibabel in both directions, and reads movies
# with Pillow and FFmpeg, and meshes with VTK, trimesh and meshio, in empty folders.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/images" "$folder/movies" "$folder/meshes"
out/interop/bin/python scripts/interop/both_ways.py "$program" "$folder/images"
out/interop/bin/python scripts/interop/movies.py "$program" "$folder/movies"
out/interop/bin/python scripts/interop/meshes.py "$program" "$folder/meshes"
