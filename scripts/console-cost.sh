#!/usr/bin/env bash
# Measures the cost of the console to a session. The same session at the virtual bedside, with its
# frames painted beforehand, runs alone, with a good page, and with that page and an attack
# (scripts/console-attack.py). Another one runs with no page and with three hidden ones, and their
# share of a core is printed.
#
# Each takes SECONDS_EACH, 60 by default. Nothing else should run meanwhile. SONOWEAVE names another
# program than the one that cargo builds. The script fails if the attacked session loses or drops
# anything that the other does not. It fails, too, if the p99 of capture to volume grows by more
# than P99_GROWTH_MS (20 by default, the project's target for the whole way).
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${SECONDS_EACH:-60}
folder=out/console-cost
rm -rf "$folder"
mkdir -p "$folder"
if [ -z "${SONOWEAVE:-}" ]; then
    cargo build --release --locked
    SONOWEAVE=$(cd "${CARGO_TARGET_DIR:-target}/release" && pwd)/sonoweave
fi
"$SONOWEAVE" live --example virtual | sed -e '/^reference_station/d' -e 's/^#painted = true/painted = true/' >"$folder/bedside.toml"
grep -q '^painted = true' "$folder/bedside.toml"
trap 'kill "${session:-}" 2>/dev/null || true' EXIT

# begin NAME: starts a session, and waits until it runs at $address.
begin() {
    "$SONOWEAVE" live --config "$folder/bedside.toml" --console 127.0.0.1:0 --headless --stats "$folder/$1.json" >/dev/null 2>"$folder/$1.log" &
    session=$!
    address=
    for _ in $(seq 600); do
        address=$(sed -n 's#.*console: http://\(.*\)/$#\1#p' "$folder/$1.log")
        [ -n "$address" ] && curl --silent --fail "http://$address/status" | grep -q '"used": [1-9][0-9]' && return
        sleep 0.2
    done
    echo "console-cost: the session did not begin; it said:" >&2
    cat "$folder/$1.log" >&2
    exit 1
}

end() {
    kill -INT "$session"
    wait "$session"
}

begin alone
sleep "$seconds"
end
begin calm
python3 scripts/console-attack.py "$address" "$seconds" "$session" --calm >"$folder/calm-page.json"
end
# Attackers are other machines in practice. Here they take their share of the processors, too, at
# the session's own priority.
begin attacked
python3 scripts/console-attack.py "$address" "$seconds" "$session" >"$folder/attacked-page.json"
curl --silent --fail --max-time 20 "http://$address/metrics" | grep '^sonoweave_console' || true
end
begin idle
python3 scripts/console-idle.py "$address" "$session" "$((seconds / 2))"
end

python3 - "$folder" "${P99_GROWTH_MS:-20}" "$seconds" <<'PYTHON'
import json, sys
folder = sys.argv[1]
lost, p99, figures = {}, {}, {}
for name in ("alone", "calm", "attacked"):
    told = json.load(open(f"{folder}/{name}.json"))
    frames, devices = told["frames"], told["devices"]
    dropped = sum(frames.get("dropped", {}).values()) + sum(of["dropped"] for of in told["readings"])
    lost[name] = dropped + frames.get("lost", 0) + sum(of["lost"] for of in devices)
    spread = told["capture_to_volume"]
    p99[name] = spread["p99_ms"]
    figures[f"{name}/capture to volume"] = {"median": spread["median_ms"], "p99": spread["p99_ms"], "most": spread["most_ms"]}
    figures[f"{name}/lost"], figures[f"{name}/dropped"] = lost[name] - dropped, dropped
    print(f"{name}: {frames['used']} of {frames['total']} frames used, refused {frames['refused']}, dropped {dropped}, lost {lost[name] - dropped}; "
          f"capture to volume {spread['median_ms']:.1f} ms, p99 {spread['p99_ms']:.1f}, most {spread['most_ms']:.1f}; CPU {100 * told['process']['cpu_s'] / told['wall_s']:.0f} % of one core")
for name in ("calm", "attacked"):
    page = json.load(open(f"{folder}/{name}-page.json"))
    print(f"{name}, the good page: {page['pictures_a_second']:.1f} pictures a second, longest wait {page['longest_wait_ms']:.0f} ms; the process: {page['resident_mb']} MB, {page['threads']} threads; {page['attacks']}")
# Figures for the documents; shorter sessions are a smoke test.
json.dump({"quick": float(sys.argv[3]) < 40, "figures": figures}, open(f"{folder}/figures.json", "w"), indent=2)
growth, limit = p99["attacked"] - p99["calm"], float(sys.argv[2])
print(f"the attack made the p99 {growth:+.1f} ms longer; {limit:.0f} ms are permitted")
if lost["attacked"] > lost["calm"]:
    sys.exit(f"console-cost: the attack lost {lost['attacked'] - lost['calm']} frames or readings")
if growth > limit:
    sys.exit("console-cost: the attack delayed the session")
PYTHON
