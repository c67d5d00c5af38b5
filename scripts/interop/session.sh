#!/bin/sh
# Reads a recorded session of the virtual bedside with an independent reader of MCAP, and with
# Foxglove's own classes. `make interop` installs them first. The session stays in out/mcap.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
place=out/mcap
rm -rf "$place"
mkdir -p "$place"
"$program" demo --duration 5 --headless -o "$place" >"$place/log" 2>&1 || {
    cat "$place/log" >&2
    exit 1
}
out/interop/bin/python scripts/session_by_others.py "$place"/SESSION-*.mcap
