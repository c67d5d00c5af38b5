#!/bin/sh
# Runs the program that cargo has built against the others, in an empty folder.
set -eu
cd "$(dirname "$0")/../.."

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
out/interop/bin/python scripts/interop/both_ways.py "${CARGO_TARGET_DIR:-target}/debug/sonoweave" "$folder"
