#!/bin/sh
# Measures a session alone on this machine: video of 640×480 at 30 and 60 frames a second, a FASTRAK
# with one sensor at 120 readings a second, 0.5 mm voxels, a 512² picture and a recording. Figures
# for the documents are in out/reach/figures.json.
set -eu
cd "$(dirname "$0")/.."

folder=out/reach
rm -rf "$folder"
mkdir -p "$folder"
cargo build --release --locked
sonoweave() { cargo run --release --locked --quiet -- "$@"; }

# Frames are painted beforehand, as a scanner paints its own. The probe has the same speed and path
# at both rates: beyond the body, all pictures are equal and refused.
for rate in 30 60; do
    gap=$(awk "BEGIN { print 0.545 * 30 / $rate }")
    sonoweave live --example virtual |
        sed -e '/^reference_station/d' -e "s/^rate_hz = 30/rate_hz = $rate/" -e 's/^#painted = true/painted = true/' \
            -e "s/^frames = 300 /frames = $((rate * 10)) /" -e "s/^gap_mm = 0.545 /gap_mm = $gap /" >"$folder/$rate.toml"
done
grep -c '^painted = true' "$folder/30.toml" "$folder/60.toml" >/dev/null
grep -q '^gap_mm = 0.2725 ' "$folder/60.toml"
sonoweave live --example virtual | sed "/^reference_station/d" >"$folder/start.toml"

report() {
    python3 - "$@" <<'PYTHON'
import json, sys
name, path, out = sys.argv[1:4]
numbers = json.load(open(path))
frames = numbers["frames"]
def spread(key):
    of = numbers.get(key)
    return "none" if not of else f"{of['median_ms']:.1f} (p99 {of['p99_ms']:.1f}, most {of['most_ms']:.1f})"
wall, cpu = numbers["wall_s"], numbers["process"]["cpu_s"]
print(f"{name}: {wall:.0f} s, {frames['used']} of {frames['total']} frames used, refused {frames['refused']}, dropped {frames.get('dropped', {})}, lost {frames.get('lost', 0)}; "
      f"recording lost {(numbers.get('recording') or {}).get('lost')}")
print(f"  ms: capture to volume {spread('capture_to_volume')}; pose to volume {spread('pose_to_volume')}; capture to picture {spread('capture_to_picture')}")
print(f"  pictures {numbers['pictures']}, slices between {numbers['pictures_skipped']}; CPU {cpu:.1f} s ({100 * cpu / wall:.0f} % of one core); resident {numbers['process']['resident_bytes'] / 1e6:.0f} MB; "
      f"start to first slice {numbers['start_to_first_slice_s']}")
run = json.load(open(out))
def figure(key, value):
    if value is not None:
        run["figures"][key] = value
def times(key):
    of = numbers.get(key)
    return of and {"median": of["median_ms"], "p99": of["p99_ms"], "most": of["most_ms"]}
if name == "start":
    figure("start to first slice, s", numbers["start_to_first_slice_s"])
else:
    recording = numbers.get("recording") or {}
    counts = {"used": frames["used"], "total": frames["total"], "refused": frames["refused"],
              "dropped": frames.get("dropped", {}), "lost": frames.get("lost", 0), "lost by the recording": recording.get("lost", 0)}
    for key, count in counts.items():
        figure(f"{name} a second/{key}", sum(count.values()) if isinstance(count, dict) else count)
    figure(f"{name} a second/pose to volume", times("pose_to_volume"))
    figure(f"{name} a second/capture to picture", times("capture_to_picture"))
    figure(f"{name} a second/CPU, % of a core", 100 * cpu / wall)
json.dump(run, open(out, "w"), indent=2)
PYTHON
}

# session NAME CONFIGURATION SECONDS
session() {
    sonoweave live --config "$folder/$2.toml" --duration "$3" --record "$folder/sessions-$1" --picture "$folder/$1.png" --json="$folder/$1.json" --quiet >/dev/null
    report "$1" "$folder/$1.json" "$folder/figures.json"
}

# Shorter sessions than the default ones are a smoke test.
quick=false
if [ "${SECONDS_30:-600}" -lt 600 ] || [ "${SECONDS_60:-120}" -lt 120 ]; then quick=true; fi
echo "{\"quick\": $quick, \"figures\": {}}" >"$folder/figures.json"

session start start 5
session 60 60 "${SECONDS_60:-120}"
session 30 30 "${SECONDS_30:-600}"
began=$(date +%s.%N)
sonoweave replay "$folder"/sessions-30/*.mcap --picture "$folder/again.png" --json="$folder/again.json" >/dev/null
ended=$(date +%s.%N)
echo "replay: $(echo "$began $ended ${SECONDS_30:-600}" | awk '{ printf "%.1f s, %.1f times as fast as it was live", $2 - $1, $3 / ($2 - $1) }')"
cmp "$folder/30.png" "$folder/again.png"
python3 - "$folder/figures.json" "$began" "$ended" <<'PYTHON'
import json, sys
run = json.load(open(sys.argv[1]))
run["figures"]["replay, s"] = float(sys.argv[3]) - float(sys.argv[2])
json.dump(run, open(sys.argv[1], "w"), indent=2)
PYTHON
