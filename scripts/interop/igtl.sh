#!/usr/bin/env bash
# Tests that other programs accept our OpenIGTLink, and we theirs. The reference library (C++,
# versions 1 and 2) and pyigtl (version 3) view a virtual session, save its volume and end it;
# slices and volume are then compared with the file. Both also send a sweep that a session of ours
# inserts, which is compared with the same sweep reconstructed.
#
# `make interop` installs the other programs first. Nothing is left running; the files stay in
# out/igtl.
set -euo pipefail
cd "$(dirname "$0")/../.."

say() { echo "igtl: $*"; }
fail() {
    say "$*" >&2
    exit 1
}

python=$PWD/out/interop/bin/python
program=$(scripts/build.sh)
place=out/igtl
rm -rf "$place"
mkdir -p "$place/library" "$place/pyigtl" "$place/sent"
place=$(cd "$place" && pwd)
running=()
stop() {
    for process in "${running[@]}"; do kill "$process" 2>/dev/null || true; done
    wait
}
trap stop EXIT
trap 'exit 1' INT TERM
ports() { "$python" -c 'import socket
all = [socket.socket() for _ in range(4)]
[s.bind(("127.0.0.1", 0)) for s in all]
print(*[s.getsockname()[1] for s in all])'; }
read -r first second third fourth <<<"$(ports)"

say "== the reference library is built against"
c++ -std=c++17 -O1 -Wall -Werror -I/usr/include/openigtlink scripts/interop/igtl/peer.cc -o "$place/peer" -lOpenIGTLink -lpthread

# session FOLDER PORT OPTION…: a session that can be viewed at that port.
"$program" live --example virtual | sed '/^clip_px/d; s/^size = .*/size = "320x240"/; s/^spacing_mm = .*/spacing_mm = 1.0/' >"$place/bedside.toml"
session() {
    local folder=$1 port=$2
    shift 2
    "$program" live --config "$place/bedside.toml" --headless --duration 100 "--igtl=127.0.0.1:$port" --igtl-save "$folder/saved" "$@" >"$folder/session.log" 2>&1 &
    running+=($!)
}

say "== looking on: the library"
session "$place/library" "$first"
"$place/peer" watch "$first" "$place/library" || fail "the library's client was not content; see $place/library/session.log"
wait "${running[-1]}" || fail "the session did not end well; see $place/library/session.log"
say "== looking on: pyigtl"
session "$place/pyigtl" "$second" --igtl-wait
"$python" scripts/interop/igtl/watch.py "$second" "$place/pyigtl" || fail "pyigtl was not content; see $place/pyigtl/session.log"
wait "${running[-1]}" || fail "the session did not end well; see $place/pyigtl/session.log"
"$python" scripts/interop/igtl/check.py "$place/library" "$place/pyigtl"

say "== being sent: a sweep by the library, and by pyigtl"
hz=30
"$program" phantom -o "$place/sent/sweep.mha" --image-size 160x120 --pixel 0.3 --frames 150 --gap 0.4 --trajectory freehand --seed 5 --calibration "$place/sent/probe.toml" >"$place/sent/log"
"$python" scripts/interop/igtl/frames.py "$place/sent/sweep.mha" "$place/sent" "$hz"
"$program" reconstruct "$place/sent/sweep.mha" --config "$place/sent/probe.toml" -o "$place/sent/volume.mha" --spacing 0.5 --path general >>"$place/sent/log"

# weave FOLDER POSES PICTURES: a session that receives poses and frames from these ports.
weave() {
    local folder=$1 poses=$2 pictures=$3
    mkdir -p "$folder"
    cat >"$folder/bedside.toml" <<TOML
format = "sonoweave-bedside"
version = 1
[calibration]
file = "$place/sent/probe.toml"
[remote]
address = "127.0.0.1:$poses"
reference = "ReferenceToTracker"
[grabber]
device = "openigtlink:127.0.0.1:$pictures"
[volume]
spacing_mm = 0.5
path = "general"
TOML
    "$program" live --config "$folder/bedside.toml" --duration 14 --headless -o "$folder/volume.mha" --json="$folder/statistics.json" >"$folder/session.log" 2>&1 ||
        fail "no volume of what was sent; see $folder/session.log"
    "$program" compare "$folder/volume.mha" "$place/sent/volume.mha" --limit 0.4 >"$folder/compared.txt" 2>&1 ||
        fail "not the volume of what was sent; see $folder/compared.txt"
    say "$(basename "$folder"): $(grep -m 1 'frames used' "$folder/session.log"); $(sed -n 's/^  \(RMSE\|correlation\)  */\1 /p' "$folder/compared.txt" | paste -sd ' ')"
}
"$place/peer" serve "$third" "$place/sent" >"$place/sent/library.log" 2>&1 &
running+=($!)
weave "$place/sent/library" "$third" "$third"
wait "${running[-1]}" || fail "the library's server was not content: $(tail -1 "$place/sent/library.log")"
read -r third fourth _ <<<"$(ports)"
"$python" scripts/interop/igtl/serve.py "$third" "$fourth" "$place/sent" >"$place/sent/pyigtl.log" 2>&1 &
running+=($!)
weave "$place/sent/pyigtl" "$third" "$fourth"
wait "${running[-1]}" || fail "pyigtl's server was not content: $(tail -1 "$place/sent/pyigtl.log")"
say "all well"
