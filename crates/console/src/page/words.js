// The session's status in words, independent of the page: sentences and their severity (`well`,
// `heed`, `bad`, `plain`).

/// Formats a count with thin spaces between thousands, which every language reads.
export function count(n) {
  return String(Math.round(n)).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

/// `1 frame`, `2 frames`.
export function many(n, one, more = `${one}s`) {
  return `${count(n)} ${n === 1 ? one : more}`;
}

/// `12 s`, `3 min 20 s`, `2 h 5 min`.
export function duration(seconds) {
  const s = Math.max(0, seconds);
    const whole = Math.round(s);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

/// `812 kB`, `1.2 GB`.
export function bytes(n) {
  const units = ["bytes", "kB", "MB", "GB", "TB"];
  let power = 0;
  let value = n;
  while (value >= 1000 && power < units.length - 1) {
    value /= 1000;
    power += 1;
  }
  return `${power === 0 || value >= 100 ? Math.round(value) : value.toFixed(1)} ${units[power]}`;
}

/// `19.6`; a dash without a measurement.
export function milliseconds(ms) {
  if (ms === null || ms === undefined || !Number.isFinite(ms)) return "–";
  return ms < 100 ? ms.toFixed(1) : ms.toFixed(0);
}

const KINDS = { live: "Live", demo: "Demo: a virtual bedside", replay: "Replay" };

/// Describes the kind of session.
export function kind({ kind, name }) {
  return [KINDS[kind] ?? kind, name].filter(Boolean).join(" · ");
}

const CLOCKS = {
  acquiring: ["wait", "its clock is being found"],
  locked: ["well", "clock locked"],
  holdover: ["heed", "clock goes on by its last rate"],
  lost: ["bad", "clock lost"],
};
const STATES = {
  stopped: ["heed", "is stopped"],
  absent: ["bad", "is not there"],
  starting: ["wait", "is being set up"],
  running: ["well", "runs"],
  silent: ["bad", "is silent"],
  ended: ["plain", "has ended"],
};

/// Returns a device's severity and its line.
export function device({ name, state, why, clock }) {
  const [how, says] = STATES[state] ?? ["heed", state];
  const running = state === "running";
  const [clockHow, clockSays] = (running && clock && (CLOCKS[clock] ?? ["plain", `clock ${clock}`])) || ["plain", ""];
  const worse = how === "well" && clockSays ? clockHow : how;
  return { how: worse, name, says, more: [why, clockSays].filter(Boolean).join("; ") };
}

/// Summarises all devices in a few words.
export function devices(all) {
  if (all.length === 0) return { how: "plain", says: "none" };
  const lines = all.map(device);
  const bad = lines.filter(({ how }) => how === "bad" || how === "heed");
  if (bad.length > 0) {
    const how = bad.some(({ how }) => how === "bad") ? "bad" : "heed";
    return { how, says: bad.length === 1 ? "one needs you" : `${bad.length} need you` };
  }
  if (lines.some(({ how }) => how === "wait")) return { how: "wait", says: "starting" };
  if (lines.some(({ says }) => says === STATES.ended[1])) return { how: "plain", says: "ended" };
  return { how: "well", says: ["", "runs", "both run"][all.length] ?? `all ${all.length} run` };
}

// Reasons for refusing frames, by the session's names.
const REASONS = {
  "image status": "no valid picture came from the scanner",
  "image missing": "the picture was not whole",
  "image orientation": "how the picture lies is not known",
  "image type": "not a brightness picture",
  colour: "a coloured picture without a grey one in it",
  "pixel not finite": "pixels that are no numbers",
  "time invalid": "no valid time",
  "pose missing": "no pose for the moment",
  "pose invalid": "the tracker did not see the probe",
  "pose not finite": "a pose that is no numbers",
  "pose mirrored": "a mirrored pose",
  "pose not rigid": "a pose that stretches",
  "pose singular": "a pose that flattens",
  "no path": "the way from probe to world was not known yet",
  "size changed": "a picture of another size",
  repeated: "the same picture and pose again",
  "out of range": "too far away",
  "out of time": "too far off in time",
  "out of plane": "outside the plane of the scan",
  "pixel size": "pixels too small or too large",
  "same picture": "the same picture at another pose",
  frozen: "the session was frozen",
  "volume full": "the volume has all the memory it may take",
  gated: "left out by a gate, as the body was displaced",
  "not corrected": "a correction has no pose for the frame",
};

/// Returns the reason in words; an unknown name is returned as it is.
export function reason(name) {
  return REASONS[name] ?? name;
}

// Fraction of dropped or lost frames above which they are bad, fewer being a warning; and the
// same for refused frames.
const MANY_GONE = 0.01;
const MANY_REFUSED = 0.05;

/// Describes the frame ledger. The outcomes add up to all frames received or lost.
export function frames({ slices, frames, refused, dropped, lost }) {
  const reasons = Object.entries(refused ?? {}).sort((a, b) => b[1] - a[1] || a[0].localeCompare(b[0]));
  const refusals = reasons.reduce((sum, [, n]) => sum + n, 0);
  const waiting = Math.max(0, frames - slices - refusals - dropped);
  const lines = [{ how: "well", key: "used", n: slices, says: "in the volume" }];
  for (const [name, n] of reasons) lines.push({ how: "heed", key: "refused", n, says: `refused: ${reason(name)}` });
  if (dropped > 0) lines.push({ how: "bad", key: "dropped", n: dropped, says: "dropped: there was no time for them" });
  if (lost > 0) lines.push({ how: "bad", key: "lost", n: lost, says: "lost before they came" });
  if (waiting > 0) lines.push({ how: "wait", key: "waiting", n: waiting, says: "under way" });
  const parts = [["used", slices], ["refused", refusals], ["dropped", dropped], ["lost", lost]];
  const decided = slices + refusals + dropped + lost;
  const gone = dropped + lost;
  return {
    how: gone > MANY_GONE * decided ? "bad" : gone > 0 || refusals > MANY_REFUSED * decided ? "heed" : "well",
    says: decided === 0 ? "none yet" : `${share(slices, decided)} used`,
    lines,
    parts: parts.map(([key, n]) => ({ key, share: n / Math.max(1, decided) })),
  };
}

// Returns the percentage, rounded down: 100 % means all.
function share(n, of) {
  const percent = (100 * n) / of;
  return percent === 100 ? "100 %" : `${(Math.floor(percent * 10) / 10).toFixed(1)} %`;
}

// Minutes of recording; less room is a warning.
const SHORT = 10;

// Rounds down, so as not to promise room that is not there.
function minutes(left) {
  const whole = Math.max(0, Math.floor(left));
  return whole < 60 ? `${whole} min` : `${count(Math.floor(whole / 60))} h ${whole % 60} min`;
}

/// Describes the recording: its size on the disk and the remaining room. `over`: nothing more
/// will be recorded.
export function recording(told, over = false) {
  if (!told) return { how: "plain", says: "not recorded", lines: [{ how: "plain", says: "nothing of this session is kept" }] };
  const { path, bytes: size, minutes_left: left, lost, trouble, slow_disk: slow } = told;
  const short = left !== null && left !== undefined && left < SHORT;
  const room = left === null || left === undefined ? "" : `, the disk has room for ${minutes(left)}`;
  const lines = [{ how: "plain", says: path.split("/").at(-1), title: path }, { how: short ? "heed" : "plain", says: `${bytes(size)} written${room}` }];
  if (lost > 0) lines.push({ how: "bad", says: `${count(lost)} of what came are not in it` });
  if (trouble) lines.push({ how: "bad", says: trouble });
  if (slow) lines.push({ how: "heed", says: "the disk is slow: a power cut may take more than the last second" });
  if (over && !trouble && lost === 0) return { how: "well", says: "complete", lines: [lines[0], { how: "plain", says: `${bytes(size)} written` }], short: false };
  const how = trouble || lost > 0 ? "bad" : short || slow ? "heed" : "rec";
  const says = trouble ? "in trouble" : lost > 0 ? "incomplete" : left === null || left === undefined ? "on" : `on · ${minutes(left)}`;
  return { how, says, lines, short };
}

/// Returns the volume's extent; empty if the session does not report it.
export function volume(told) {
  if (told === undefined) return "";
  if (told === null) return "no volume yet";
  return `${told.mm.map((mm) => count(mm)).join(" × ")} mm, ${told.voxels.map(count).join(" × ")} voxels`;
}

const VERDICTS = {
  still: ["plain", "still"],
  sideways: ["plain", "sideways"],
  good: ["well", "good"],
  fast: ["heed", "fast"],
  "too-fast": ["bad", "too fast"],
};
// The gauge ends at this multiple of the highest speed without gaps.
const FULL = 1.25;

/// Describes the scan guidance: speed, its zone, counts and advice.
export function guidance(told) {
  if (!told) return { how: "plain", says: "–", facts: [], gauge: null, advice: [] };
  const { speed, holes, spacing, contact, advice } = told;
  const [how, word] = speed ? (VERDICTS[speed.verdict] ?? ["plain", speed.verdict]) : ["wait", "no slices"];
  const moves = speed && speed.verdict !== "still";
  const mm = moves ? Math.round(speed.verdict === "sideways" ? speed.mm_per_s : speed.edge_mm_per_s) : null;
  const facts = [];
  if (speed) facts.push(density(speed, spacing));
  facts.push(left(holes));
  if (contact === "lost") facts.push({ how: "bad", strong: "no contact", says: "nothing comes back from the depth" });
  return { how, says: mm === null ? word : `${word} · ${mm} mm/s`, facts, gauge: speed ? gauge(speed) : null, advice };
}

// Returns slices per centimetre, and the required minimum.
function density({ verdict, images_per_cm: per }, { gapless_mm: gapless }) {
  const least = 10 / gapless;
  const how = { fast: "heed", "too-fast": "bad" }[verdict] ?? "plain";
  const strong = per === null || per === undefined ? "–" : per < 10 ? per.toFixed(1) : count(per);
  return { how, strong, says: `images/cm; at least ${least.toFixed(1)}` };
}

function left({ open, closed, beyond, nearest }) {
  const more = beyond > 0 ? `, and ${many(beyond, "gap")} beyond` : "";
  if (open > 0) return { how: "heed", strong: many(open, "part"), says: `left out${more}${nearest ? `: ${nearest}` : ""}` };
  if (closed > 0) return { how: "well", strong: "nothing", says: `left out any more; ${many(closed, "part")} found again` };
  return { how: "plain", strong: "nothing", says: "left out" };
}

function gauge({ verdict, says, edge_mm_per_s: edge, even_mm_per_s: even, gapless_mm_per_s: gapless }) {
  const full = FULL * gapless;
  return {
    zones: [even / full, (gapless - even) / full, (full - gapless) / full],
    at: verdict === "sideways" ? 0 : Math.min(1, edge / full),
    says: `Speed across the picture: ${says}; even up to ${Math.round(even)} mm/s, without gaps up to ${Math.round(gapless)} mm/s`,
  };
}

/// Returns a voxel's grey value, with its 95 % interval if that is known, and whether another sweep
/// would halve it.
export function readout({ value, error, slices, halved_by: further }) {
  if (error === null) return `grey ${value.toFixed(0)}`;
  const known = `grey ${value.toFixed(1)} ± ${error.toFixed(1)}, ${slices.toFixed(1)} slices`;
  return further === null ? known : `${known}; sweep here again: ${Math.ceil(further)} more halve the error`;
}
