#!/bin/sh
# Measures insertion in live sessions of a virtual EA1 arm: the same session takes the planar path
# by itself, and the general path because it is told to, in ROUNDS alternating rounds of
# SECONDS_EACH. Every session is replayed, and its volume must be the same, bit by bit. Figures for
# the documents are in out/arm-session/figures.json.
set -eu
cd "$(dirname "$0")/.."

rounds=${ROUNDS:-5}
seconds=${SECONDS_EACH:-15}
folder=out/arm-session
rm -rf "$folder"
mkdir -p "$folder"
cargo build --release --locked
sonoweave() { "${CARGO_TARGET_DIR:-target}/release/sonoweave" "$@"; }

# Frames are painted beforehand, as a scanner paints its own.
sonoweave live --example virtual-arm | sed 's/^frames = 300/frames = 300\npainted = true/' >"$folder/planar.toml"
grep -q '^painted = true' "$folder/planar.toml"
sed 's/^\[volume\]/[volume]\npath = "general"/' "$folder/planar.toml" >"$folder/general.toml"

for round in $(seq "$rounds"); do
    for path in planar general; do
        name=$folder/$path-$round
        sonoweave live --config "$folder/$path.toml" --headless --duration "$seconds" --record "$name" -o "$name.mha" --json="$name.json" --quiet >/dev/null
        sonoweave replay "$name"/*.mcap -o "$name-again.mha" --quiet >/dev/null
        cmp "$name.mha" "$name-again.mha"
        rm "$name.mha" "$name-again.mha"
    done
done

python3 - "$folder" "$rounds" "$seconds" <<'PYTHON'
import json, statistics, sys
folder, rounds, seconds = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
figures = {}
for path in ("planar", "general"):
    runs = [json.load(open(f"{folder}/{path}-{round}.json")) for round in range(1, rounds + 1)]
    for run in runs:
        if run["path"] != path:
            sys.exit(f"arm-session: the session took the path {run['path']} instead of {path}: {run['path_reason']}")
    medians = [run["pose_to_volume"]["median_ms"] for run in runs]
    figures[f"{path}/pose to volume"] = {
        "median": statistics.median(medians), "p99": statistics.median(run["pose_to_volume"]["p99_ms"] for run in runs), "rounds": rounds}
    figures[f"{path}/medians"] = {"least": min(medians), "most": max(medians)}
    figures[f"{path}/volume, MB"] = statistics.median(run["memory"]["volume_bytes"] for run in runs) / 1e6
    figures[f"{path}/slices"] = sum(run["volume"]["slices"] for run in runs)
    print(path, figures[f"{path}/pose to volume"], figures[f"{path}/medians"], f"{figures[f'{path}/volume, MB']:.1f} MB, {figures[f'{path}/slices']} slices")
json.dump({"quick": rounds < 5 or seconds < 15, "figures": figures}, open(f"{folder}/figures.json", "w"), indent=2)
PYTHON
