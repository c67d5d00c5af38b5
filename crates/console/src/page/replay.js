// A recorded session: single frames, and the settings with which it can be replayed. A live
// session shows none of this.
//
// For tests and debugging, as `window.sonoweave.replay`: { told, settings }.

import { many } from "./words.js";

// Corrections by their buttons and commands.
const CORRECTIONS = ["smoothing", "calibration", "drift", "jitter", "pressure", "gate"];
const LIVE_COMMANDS = ["record", "scan", "freeze", "clear"];
// Headings of the settings, in the processing order of a slice.
const GROUPS = [
  ["calibration", "Calibration"],
  ["latency", "Latency"],
  ["pairing", "Pairing"],
  ["volume", "Volume and kernel"],
  ["picture", "Picture"],
];
// Settings shown first; the others are behind "More".
const FIRST = ["calibration.file", "calibration.preset", "calibration.clip_px", "volume.spacing_mm", "volume.method", "volume.hwhm_mm", "volume.support", "volume.compound", "pairing.longest_gap_ms", "pairing.smoothing_ms", "pairing.smoothing_ahead_ms", "picture.mode", "picture.transfer", "picture.window"];

export class Replay {
  #of;
  #send;
  #fetch;
  #speak;
  #steers = false;
  #is = false;
  #desk = null;
  #wanted = null;
  #scheduled = false;
  #inputs = new Map();
  #listed = null;
  /// The object described above.
  open = { told: null, settings: null };

  /// `of(id)` returns the element of that id; `send(message)` sends a command to the session;
  /// `fetch()` requests the available settings; `speak(words)` announces words to screen
  /// readers.
  constructor(of, { send, fetch, speak }) {
    this.#of = of;
    this.#send = send;
    this.#fetch = fetch;
    this.#speak = speak;
    of("scrub").addEventListener("input", () => this.#showFrame(Number(of("scrub").value)));
    of("settings-open").addEventListener("click", () => this.#begin());
    of("settings-close").addEventListener("click", () => of("settings").close());
    of("settings-as-recorded").addEventListener("click", () => this.#again({}));
    for (const by of CORRECTIONS) of(`correct-${by}`).addEventListener("click", () => this.#correct({ do: "correct", by: by === "pressure" ? { pressure: { light: of("correct-light").valueAsNumber } } : by }));
    of("settings-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#again(this.#changed());
    });
  }

  /// Receives the session's description.
  about({ kind }) {
    this.#is = kind === "replay";
    this.#of("replay").hidden = !this.#is;
    this.#of("settings-open").hidden = !this.#is;
    for (const command of LIVE_COMMANDS) this.#of("commands").querySelector(`[data-command=${command}]`).classList.toggle("of-live", this.#is);
    this.#of("view-legend-slice").textContent = this.#is ? "this frame" : "slice now";
    this.#of("main").classList.toggle("replayed", this.#is);
  }

  /// Sets whether this page has control.
  control(steers) {
    this.#steers = steers === true;
    this.#show();
  }

  /// Receives the session's status; null while the connection is lost.
  update(desk) {
    this.#desk = desk;
    this.open.told = desk?.replayed ?? null;
    this.#show();
  }

  /// Shows why the last settings were refused, in the settings dialog.
  refused(why) {
    if (this.#of("settings").open) this.#says(why);
  }

  #showFrame(number) {
    this.#wanted = number;
    if (this.#scheduled) return;
    this.#scheduled = true;
    // A dragged slider asks for more frames than the screen can show.
    requestAnimationFrame(() => {
      this.#scheduled = false;
      if (this.#wanted !== null) this.#send({ do: "frame", number: this.#wanted });
      this.#wanted = null;
    });
  }

  #show() {
    const told = this.open.told;
    if (!this.#is || !told) return;
    const over = this.#desk.phase === "over";
    const [scrub, says] = [this.#of("scrub"), this.#of("scrub-says")];
    scrub.max = String(Math.max(1, told.frames));
    scrub.disabled = !this.#steers || !over || told.frames === 0;
    scrub.title = over ? "Looks at the recorded frames one by one (arrow keys)" : "Frames are looked at one by one when the recording has run, or was stopped";
    const seen = over ? told.seen : null;
    if (seen && document.activeElement !== scrub && this.#wanted === null) scrub.value = String(seen.number);
    const words = seen
      ? `frame ${seen.number} of ${told.frames} · ${seen.time_s.toFixed(2)} s · ${seen.posed ? "its place is marked" : "not in the volume"}`
      : over
        ? `${many(told.frames, "frame")}: drag to look at them one by one`
        : `${many(told.frames, "frame")} in the recording`;
    if (says.textContent !== words) says.textContent = words;
    const described = seen ? words : "none";
    if (scrub.getAttribute("aria-valuetext") !== described) scrub.setAttribute("aria-valuetext", described);
    this.#listCorrections(told.corrections, this.#steers && over);
    const tried = Object.keys(told.tried).length;
    const button = this.#of("settings-open");
    button.disabled = !this.#steers;
    button.setAttribute("aria-pressed", String(tried > 0));
    button.title = tried > 0 ? `Run by other settings: ${Object.entries(told.tried).map(([key, value]) => `${key} = ${JSON.stringify(value)}`).join(", ")}` : "Run this recording again by another calibration, latency, kernel or look";
  }

  // Lists the corrections that stand, each with a button to undo it.
  #listCorrections(corrections, may) {
    for (const by of CORRECTIONS) this.#of(`correct-${by}`).disabled = !may || corrections.some(({ kind }) => kind === by);
    const shown = JSON.stringify([corrections, may]);
    if (shown === this.#listed) return;
    this.#listed = shown;
    const items = corrections.map(({ id, kind, is_stale: stale, words }) => {
      const item = document.createElement("li");
      item.classList.toggle("stale", stale);
      const says = document.createElement("span");
      says.textContent = stale ? `${kind}: not applied, as it was computed from other poses; undo it, and compute it again` : `${kind}: ${words}`;
      const undo = document.createElement("button");
      undo.type = "button";
      undo.textContent = "Undo";
      undo.title = `The volume is then as it was before the ${kind}`;
      undo.disabled = !may;
      undo.addEventListener("click", () => this.#correct({ do: "undo", correction: id }));
      item.append(says, undo);
      return item;
    });
    this.#of("corrections-list").replaceChildren(...items);
  }

  #correct(message) {
    this.#says("");
    this.#send(message);
  }

  async #begin() {
    const told = await this.#fetch();
    if (!told.settings) {
      this.#speak(told.refused ?? "The session does not answer.");
      return;
    }
    this.open.settings = told.settings;
    this.#lay(told.settings);
    this.#says("");
    this.#of("settings").showModal();
  }

  #lay(settings) {
    this.#inputs.clear();
    const groups = this.#of("settings-groups");
    groups.replaceChildren();
    const tried = this.open.told?.tried ?? {};
    for (const [group, title] of GROUPS) {
      const own = settings.filter(({ key }) => (group === "latency" ? key.endsWith(".latency_ms") : key.startsWith(`${group}.`)));
      if (own.length === 0) continue;
      const set = document.createElement("fieldset");
      const legend = document.createElement("legend");
      legend.textContent = title;
      set.append(legend);
      const isFirst = ({ key }) => FIRST.includes(key) || group === "latency" || key in tried;
      own.filter(isFirst).sort((a, b) => FIRST.indexOf(a.key) - FIRST.indexOf(b.key)).forEach((one) => set.append(this.#row(one, tried)));
      const rest = own.filter((one) => !isFirst(one));
      if (rest.length > 0) {
        const more = document.createElement("details");
        const summary = document.createElement("summary");
        summary.textContent = `More (${rest.length})`;
        more.append(summary, ...rest.map((one) => this.#row(one, tried)));
        set.append(more);
      }
      groups.append(set);
    }
  }

  #row({ key, takes, about, value, files }, tried) {
    const row = document.createElement("div");
    row.className = "setting";
    const label = document.createElement("label");
    label.textContent = key.endsWith(".latency_ms") ? key : key.slice(key.indexOf(".") + 1);
    label.htmlFor = `setting-${key}`;
    const input = document.createElement("input");
    input.id = `setting-${key}`;
    input.dataset.key = key;
    input.type = "text";
    input.spellcheck = false;
    input.autocomplete = "off";
    const recorded = written(value);
    input.value = key in tried ? written(tried[key]) : recorded;
    input.placeholder = takes;
    const choices = files.length > 0 ? files : words(takes);
    row.append(label, input);
    if (choices.length > 0) {
      const list = document.createElement("datalist");
      list.id = `choices-${key}`;
      list.append(...choices.map((choice) => Object.assign(document.createElement("option"), { value: choice })));
      input.setAttribute("list", list.id);
      row.append(list);
    }
    const note = document.createElement("p");
    note.id = `about-${key}`;
    note.textContent = `${takes}: ${about}`;
    input.setAttribute("aria-describedby", note.id);
    row.append(note);
    const mark = () => row.classList.toggle("changed", input.value.trim() !== recorded);
    input.addEventListener("input", mark);
    mark();
    this.#inputs.set(key, { input, recorded });
    return row;
  }

  // Returns the settings that differ from the recording, by key.
  #changed() {
    const settings = {};
    for (const [key, { input, recorded }] of this.#inputs) {
      const text = input.value.trim();
      if (text !== recorded) settings[key] = text === "" ? null : read(text);
    }
    return settings;
  }

  #again(settings) {
    this.#says("");
    this.#send({ do: "again", settings });
  }

  /// Closes the dialog once the replay has begun.
  begun() {
    if (this.#of("settings").open) this.#of("settings").close();
  }

  #says(why) {
    this.#of("settings-says").textContent = why;
  }
}

// Returns a value as shown in a field; empty if there is none.
function written(value) {
  if (value === null || value === undefined) return "";
  return typeof value === "string" ? value : JSON.stringify(value);
}

// Returns a field's value: numbers, lists and booleans as such, everything else as text.
function read(text) {
  try {
    const value = JSON.parse(text);
    return value === null ? text : value;
  } catch {
    return text;
  }
}

// Returns the allowed words, if a setting takes nothing but words.
function words(takes) {
  const found = takes.split(/, | or /);
  return found.length > 1 && found.every((word) => /^[a-z][a-z0-9-]*$/.test(word)) ? found : [];
}
