// The troubles that the operator must notice at once, the worst first; independent of the page.
// A trouble keeps its `key` while only its numbers change.

import { device, duration, many } from "./words.js";

// Longest time without a picture before a report, s.
const PATIENCE = 2;
const WEIGHT = { bad: 0, heed: 1, ended: 2, wait: 3, well: 4 };

/// `line`: `{ open, ever, gone, lost_s, next_s }` of the connection; `account`: the last
/// status, or null; `blank_s`: time without a live picture although one was requested.
export function troubles({ line, account, blank_s: blank }) {
  const all = [];
  const say = (how, key, sentence, more = "") => all.push({ how, key, sentence, more });

  if (!line.open) {
    if (account?.ended || line.gone) {
      say("ended", "ended", "The session has ended.", tries(line));
    } else if (line.ever) {
      say("bad", "line", "Connection lost: what you see is old.", `For ${duration(line.lost_s)}. ${tries(line)} The session may go on without this page.`);
    } else {
      say("wait", "line", "Connecting to the session …", line.next_s === null ? "" : tries(line));
    }
    return all;
  }
  if (!account) {
    say("wait", "account", "Connected; the session has not reported its status yet.");
    return all;
  }
  if (account.ended) {
    say("ended", "ended", "The session has ended.", "What you see is its last picture.");
    return all;
  }
  const { phase, frozen, saving } = account.desk ?? {};
  if (saving !== null && saving !== undefined) say("wait", "saving", `Saving the volume: ${Math.floor(100 * saving)} %.`);
  if (account.desk?.replayed) {
    replayed(account, say);
    return all.sort((a, b) => WEIGHT[a.how] - WEIGHT[b.how]);
  }
  if (phase === "over") {
    const kept = account.recording ? "The recording is complete." : "It was not recorded; it can be saved.";
    say("ended", "over", "Stopped: this volume stays in view.", `${kept} Record or Scan begins a new one.`);
    return all;
  }
  if (phase === "opening" || phase === "ending") {
    say("wait", phase, phase === "opening" ? "Devices are being opened …" : "The last slices are inserted and written …");
    return all;
  }
  if (account.still?.length > 0) say("bad", `still ${account.still}`, `The session stands still: ${account.still.join(", ")}.`, "End it and begin anew if it does not go on.");
  let explained = frozen === true;
  if (frozen) say("heed", "held", "Frozen: no slices are inserted into the volume.", "Freeze again to go on (key F).");
  for (const one of account.devices) {
    const { how, name, says, more } = device(one);
    if (how !== "bad" && how !== "heed") continue;
    const sentence = says === "runs" ? `${name}: ${more}.` : `${name} ${says}.`;
    say(how, `device ${name} ${one.state} ${one.clock}`, sentence, says === "runs" ? "" : one.why);
    explained ||= says !== "runs";
  }
  if (account.frozen_s !== null && account.frozen_s !== undefined) {
    say("bad", "frozen", "The scanner is frozen: unfreeze it to go on.", `One picture for ${duration(account.frozen_s)} while the probe moved.`);
    explained = true;
  }
  // Bad scan guidance means loss of data while it lasts; other guidance is on its card. A
  // frozen scanner is already reported above.
  for (const { how, key, sentence, more } of account.coach?.advice ?? []) {
    if (how === "bad" && key !== "frozen") say("bad", `guidance ${key}`, sentence, more);
  }
  if (account.recording?.trouble) say("bad", `disk ${account.recording.trouble}`, "The recording is in trouble.", account.recording.trouble);
  if (account.recording?.slow_disk) say("heed", "slow disk", "The disk is slow.", "A power cut may take more than the last second of the recording.");
  if (!explained && blank !== null && blank >= PATIENCE) say("bad", "blank", "No picture comes from the scanner.", `For ${duration(blank)}.`);
  const left = account.recording?.minutes_left;
  if (left !== null && left !== undefined && left < 10) {
    say("heed", "room", `The disk has room for ${many(Math.floor(left), "more minute")}.`);
  }
  if (account.bent) say("heed", "bent", "Metal bends the tracker's field here.", "Slices are taken, but lie less surely.");
  if (all.length === 0) {
    const starting = account.devices.filter(({ state }) => state === "starting").map(({ name }) => name);
    if (starting.length > 0) say("wait", "starting", `Starting: ${starting.join(", ")}.`);
    else if (account.slices === 0) say("wait", "first", "Ready: waiting for the first slice.");
    else say("well", "well", account.recording ? "All is well; it is recorded." : "All is well; it is not recorded.");
  }
  return all.sort((a, b) => WEIGHT[a.how] - WEIGHT[b.how]);
}

// Reports a replay's progress and the settings tried.
function replayed({ desk: { phase, replayed: told }, frames, slices }, say) {
  const tried = Object.keys(told.tried).length;
  const by = tried === 0 ? "As it was recorded." : `${many(tried, "setting is", "settings are")} tried: ${Object.entries(told.tried).map(([key, value]) => `${key} = ${JSON.stringify(value)}`).join(", ")}.`;
  if (phase === "over") say("ended", "over", `Replayed: ${many(slices, "slice")} of ${many(told.frames, "frame")}.`, `${by} Drag below the picture to look at the frames.`);
  else if (phase === "running") say("wait", "running", `Replaying: ${Math.floor((100 * frames) / Math.max(1, told.frames))} %.`, by);
  else say("wait", phase, phase === "opening" ? "The recording is being opened …" : "The last slices are inserted …");
}

function tries({ next_s: next }) {
  return next === null ? "Trying again …" : `Trying again in ${duration(Math.max(1, Math.ceil(next)))}.`;
}
