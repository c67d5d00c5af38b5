#!/usr/bin/env bash
# Measures the cost of the console to a session. The same session at the virtual bedside, with its
# frames painted beforehand, runs alone, with a good page, and with that page and an attack
# (scripts/console-attack.py). The last two alternate in ROUNDS rounds, 5 by default. Another one
# runs with no page and with three hidden ones, and their share of a core is printed.
#
# Each takes SECONDS_EACH, 60 by default. Nothing else should run meanwhile. SONOWEAVE names another
# program than the one that cargo builds. The script fails if attacked sessions lose or drop more
# than the others. It fails, too, if the median of their p99 of capture to volume is higher by more
# than P99_GROWTH_PERCENT, 10 by default.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${SECONDS_EACH:-60}
rounds=${ROUNDS:-5}
folder=out/console-cost
rm -rf "$folder"
mkdir -p "$folder"
if [ -z "${SONOWEAVE:-}" ]; then
    cargo build --release --locked
    SONOWEAVE=$(cd "${CARGO_TARGET_DIR:-target}/release" && pwd)/sonoweave
fi
"$SONOWEAVE" live --example virtual | sed -e '/^reference_station/d' -e 's/^#painted = true/painted = true/' >"$folder/bedside.toml"
grep -q '^painted = true' "$folder/bedside.toml"
# Sessions with real devices have real-time priority wherever it is permitted, as in the package's
# service. Virtual ones have it only if it is required.
if chrt --fifo 6 true 2>/dev/null; then
    printf '[process]\nrealtime = "required"\n' >>"$folder/bedside.toml"
else
    echo "console-cost: real-time priority is not permitted; attackers and session compete for the processors"
fi
trap 'kill "${session:-}" 2>/dev/null || true' EXIT

# begin NAME: starts a session, and waits until it runs at $address.
begin() {
    "$SONOWEAVE" live --config "$folder/bedside.toml" --console 127.0.0.1:0 --headless --json="$folder/$1.json" >/dev/null 2>"$folder/$1.log" &
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
# Attackers are other machines in practice. Here they take their share of the processors, too, at
# the session's own priority.
for round in $(seq "$rounds"); do
    begin "calm-$round"
    python3 scripts/console-attack.py "$address" "$seconds" "$session" --calm >"$folder/calm-$round-page.json"
    end
    begin "attacked-$round"
    python3 scripts/console-attack.py "$address" "$seconds" "$session" >"$folder/attacked-$round-page.json"
    [ "$round" -gt 1 ] || curl --silent --fail --max-time 20 "http://$address/metrics" | grep '^sonoweave_console' || true
    end
done
begin idle
python3 scripts/console-idle.py "$address" "$session" "$((seconds / 2))"
end

python3 - "$folder" "${P99_GROWTH_PERCENT:-10}" "$seconds" "$rounds" <<'PYTHON'
import json, statistics, sys
folder, limit, seconds, rounds = sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
lost, p99, figures, realtime = {}, {}, {}, True
for name in ("alone", "calm", "attacked"):
    runs = ["alone"] if name == "alone" else [f"{name}-{round}" for round in range(1, rounds + 1)]
    spreads, dropped, missing = [], 0, 0
    for run in runs:
        told = json.load(open(f"{folder}/{run}.json"))
        frames, devices = told["frames"], told["devices"]
        realtime = realtime and told["scheduling"]["realtime"]
        drops = sum(frames.get("dropped", {}).values()) + sum(of["dropped"] for of in told["readings"])
        losses = frames.get("lost", 0) + sum(of["lost"] for of in devices)
        spread = told["capture_to_volume"]
        spreads.append(spread)
        dropped, missing = dropped + drops, missing + losses
        print(f"{run}: {frames['used']} of {frames['total']} frames used, refused {frames['refused']}, dropped {drops}, lost {losses}; "
              f"capture to volume {spread['median_ms']:.1f} ms, p99 {spread['p99_ms']:.1f}, most {spread['most_ms']:.1f}; CPU {100 * told['process']['cpu_s'] / told['wall_s']:.0f} % of one core")
        if name != "alone":
            page = json.load(open(f"{folder}/{run}-page.json"))
            print(f"{run}, the good page: {page['pictures_a_second']:.1f} pictures a second, longest wait {page['longest_wait_ms']:.0f} ms; the process: {page['resident_mb']} MB, {page['threads']} threads; {page['attacks']}")
    middle = lambda key: statistics.median(spread[key] for spread in spreads)
    lost[name], p99[name] = dropped + missing, middle("p99_ms")
    figures[f"{name}/capture to volume"] = {"median": middle("median_ms"), "p99": middle("p99_ms"), "most": middle("most_ms"), "rounds": len(spreads)}
    figures[f"{name}/p99 of rounds"] = {"least": min(spread["p99_ms"] for spread in spreads), "most": max(spread["p99_ms"] for spread in spreads)}
    figures[f"{name}/lost"], figures[f"{name}/dropped"] = missing, dropped
# The documents say that the sessions have real-time priority: without it, and with shorter or
# fewer sessions, the figures are those of a smoke test.
json.dump({"quick": seconds < 40 or rounds < 5 or not realtime, "figures": figures}, open(f"{folder}/figures.json", "w"), indent=2)
growth = 100 * (p99["attacked"] / p99["calm"] - 1)
print(f"medians of {rounds} rounds: p99 {p99['calm']:.1f} ms with a page, {p99['attacked']:.1f} ms attacked, {growth:+.0f} %; {limit:.0f} % are permitted")
if lost["attacked"] > lost["calm"]:
    sys.exit(f"console-cost: the attacks lost {lost['attacked'] - lost['calm']} frames or readings")
if growth > limit:
    sys.exit("console-cost: the attacks delayed the sessions")
PYTHON
