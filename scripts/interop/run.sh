#!/bin/sh
# Exchanges image files with SimpleITK, VTK, pynrrd and nibabel in both directions, in an empty
# folder.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
out/interop/bin/python scripts/interop/both_ways.py "$program" "$folder"
