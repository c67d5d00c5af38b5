// The page: distributes the stream's pictures and messages to the parts that show them, and
// sends the user's commands back.

import { AccountCards } from "./account.js";
import { Banner } from "./banner.js";
import { GuidanceCard } from "./guidance.js";
import { CommandButtons } from "./commands.js";
import { check } from "./gpu_check.js";
import { OwnView } from "./gpu_view.js";
import { BRICKS, JPEG, SLICE, VIEW } from "./header.js";
import { Marks } from "./marks.js";
import { MaskCard } from "./mask.js";
import { Measure } from "./measure.js";
import { Measurements } from "./measurements.js";
import { Picture } from "./picture.js";
import { Planes } from "./planes.js";
import { Replay } from "./replay.js";
import { ViewFigures } from "./view_figures.js";
import { Slice } from "./slice.js";
import { Stream } from "./stream.js";
import { Tone } from "./tone.js";
import { troubles } from "./troubles.js";
import { View } from "./view.js";
import { ViewMovie } from "./view_movie.js";

// Interval of the status check, ms.
const UPDATE_MS = 250;

const of = (id) => document.getElementById(id);
const measured = new Measurements();
window.sonoweave = measured.open;

const cards = new AccountCards(of);
const guidance = new GuidanceCard(of);
const marks = new Marks(of("view-marks"), of("view-legend"));
const viewFigures = new ViewFigures(of("view-figures"));
measured.open.projected = viewFigures.open;
const banner = new Banner(of("banner"), of("announcer"));
const commands = new CommandButtons(of("commands"), of("ask"), (message) => stream.send(message));
const maskCard = new MaskCard(of, (message) => stream.send(message));
measured.open.mask = maskCard.open;
const slice = new Slice({ room: of("slice-room"), canvas: of("slice"), scale: of("slice-scale"), caption: of("slice-caption") });
const view = new View(
  { panel: of("view-panel"), room: of("view-room"), canvas: of("view"), onlooker: of("onlooker"), control: of("control"), refined: of("refined"), marks, figures: viewFigures },
  (message) => stream.send(message) && own.steered(message),
);
const speak = (words) => (of("announcer").textContent = words);
measured.open.movie = new ViewMovie({ canvas: of("view"), button: of("view-record"), time: of("view-recorded") }, speak).open;
const line = { send: (message) => stream.send(message), answer: (header) => stream.answer(header) };
const planes = new Planes(of, line, () => {
  measure.settle(planes.shown);
  show();
});
measured.open.planes = planes.open;
const measure = new Measure(of, {
  at: () => (planes.shown ? planes.at() : null),
  perScreen: () => of("view").width / of("view").clientWidth,
  draw: (figures, slices, open) => {
    planes.mark(figures, slices);
    viewFigures.show(figures, open);
  },
  ask,
  speak,
});
measured.open.measure = measure.open;
planes.clicked = () => measure.mark();
const replay = new Replay(of, { send: (message) => stream.send(message), fetch: () => fetchJson("/v1/settings"), speak });
measured.open.replay = replay.open;
view.clicked = (x, y) => {
  measure.see([x, y]);
  return measure.open.open;
};
const screens = {
  [SLICE]: screen("slice", (header) => slice.drawn(header)),
  [VIEW]: screen("view", (header) => view.drawn(header)),
};

const flags = new URLSearchParams(location.search);
const own = new OwnView(of("view-caption"), flags.get("gpu") === "software", {
  drawn(canvas, { projection }, ms) {
    screens[VIEW].show(canvas);
    viewFigures.project({ projection });
    const header = { ...measured.open.pictures.view, width: canvas.width, height: canvas.height, refining: false, timed: false };
    measured.settled("view", header, true, ms);
    view.drawn(header);
    of("view-reduced").hidden = true;
  },
  answer: (header) => stream.answer(header),
  changed: () => show(),
});
measured.open.own = own.open;
if (flags.has("gpu-check")) check(own.open, of("gpu-check"));

const tone = new Tone(
  of("slice"),
  (table, words) => {
    screens[SLICE].tone(words ? table : null);
    slice.toned(words);
  },
  speak,
);
measured.open.tone = tone.open;

// Times at which live pictures were requested and the last one arrived, ms since the epoch.
let requestedAt = null;
let arrivedAt = null;
let account = null;
let lastEvent = null;
let ever = false;

const address = new URL("/v1/stream", location.href);
address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
const stream = new Stream(address, { picture, message, changed });

function screen(name, drawn) {
  return new Picture(of(name), (header, whether, decode) => {
    measured.settled(name, header, whether, decode);
    if (whether) {
      drawn(header);
      const reduced = of(`${name}-reduced`);
      if (reduced) reduced.hidden = header.encoding !== JPEG;
    }
    stream.answer(header);
  });
}

function picture(header, pixels) {
  if (header.kind === SLICE) arrivedAt = Date.now();
  if (header.kind === BRICKS) own.bricks(header, pixels);
  // A picture on its way is older than the one drawn here.
  else if (header.kind === VIEW && own.open.here) stream.answer(header);
  else if (!planes.offer(header, pixels)) screens[header.kind].offer(header, pixels);
}

function message(key, value) {
  if (key === "about") {
    measured.open.about = value;
    cards.about(value);
    slice.about(value);
    replay.about(value);
  } else if (key === "account") {
    account = value;
    measured.open.account = value;
    const spread = { screen: measured.spread("slice"), view: measured.spread("view"), shown: measured.rate("slice") };
    cards.update(value, spread);
    commands.update(value.desk, value.volume);
    maskCard.update(value.mask, value.desk);
    replay.update(value.desk);
    happened(value.desk.events);
    if (!value.volume && measure.open.results.length + measure.open.points.length > 0) measure.clear();
    guidance.show(value.coach);
    update();
  } else if (key === "marks") {
    marks.show(value);
    planes.outline(value.planes);
  } else if (key === "drawing") {
    own.settings(value);
  } else if (key === "view") {
    own.told(value);
  } else if (key === "sight") {
    if (!own.open.here) viewFigures.project(value);
  } else if (key === "control") {
    measured.open.control = value;
    view.control(value);
    own.control(value);
    commands.control(value);
    maskCard.control(value);
    replay.control(value);
    planes.control(value);
  } else if (key === "plane") {
    planes.describe(value);
  } else if (key === "dress") {
    planes.style(value);
  } else if (key === "refused") {
    banner.say("heed", value);
    replay.refused(value);
    update();
  } else if (key === "done") {
    banner.say("wait", value);
    replay.begun();
    update();
  }
}

// Announces new events since the page was opened, each once.
function happened(events) {
  const newest = events.at(-1);
  if (newest && lastEvent !== null && newest.number > lastEvent) banner.say(newest.how === "failed" ? "bad" : "well", short(newest.says));
  lastEvent = newest?.number ?? 0;
}

function changed() {
  if (stream.open === measured.open.connected) {
    update();
    return;
  }
  measured.open.connected = stream.open;
  if (stream.open) {
    ever = true;
    // Another session may be running there now: the last status is void, and pictures are
    // numbered anew.
    account = null;
    lastEvent = null;
    for (const kind of [SLICE, VIEW]) screens[kind].restart();
    planes.restart();
    viewFigures.restart();
    marks.clear();
    own.restart();
    show();
  } else {
    requestedAt = null;
    view.control(null);
    commands.control(null);
    commands.update(null, null);
    maskCard.control(null);
    maskCard.update(null, null);
    replay.control(null);
    planes.control(null);
    measured.open.control = null;
  }
  update();
}

// Subscribes to the visible pictures; a hidden page subscribes to none.
function show() {
  const seen = document.visibilityState === "visible";
  if (!seen) for (const one of [screens[SLICE], screens[VIEW], planes]) one.forget();
  if (!stream.send({ do: "show", slice: seen, planes: seen && planes.shown, ...own.asks(seen) })) return;
  requestedAt = seen ? Date.now() : null;
}

function update() {
  const now = Date.now();
  const since = (at) => (at === null ? null : (now - at) / 1000);
  const line = { open: stream.open, ever, gone: stream.gone, lost_s: since(stream.lostAt) ?? 0, next_s: stream.nextAt === null ? null : (stream.nextAt - now) / 1000 };
  const blank = requestedAt === null ? null : since(Math.max(requestedAt, arrivedAt ?? 0));
  const all = troubles({ line, account, blank_s: blank });
  banner.show(all);
  of("again").hidden = stream.open || !ever;
  const old = all.some(({ key }) => ["line", "ended", "blank"].includes(key)) && ever;
  const frozen = all.some(({ key }) => key === "frozen" || key === "held");
  const over = stream.open && account?.desk?.phase === "over";
  mark("slice", frozen ? "frozen" : over && !account.desk.replayed ? "stopped" : old && arrivedAt !== null ? `not live · ${new Date(arrivedAt).toLocaleTimeString([], { hourCycle: "h23" })}` : "");
  mark("view", old && !stream.open ? "not live" : "");
  of("cards").classList.toggle("old", !stream.open);
}

// Removes the folder from a file's path: the banner is narrow, and the session's folder is
// known.
const short = (says) => says.replace(/(^|\s)\S*\/(\S+)$/, "$1$2");

// Sends a request that has an answer.
function ask(path, body) {
  return fetchJson(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

async function fetchJson(path, request) {
  try {
    const answer = await fetch(path, request);
    const text = await answer.text();
    return answer.headers.get("Content-Type") === "application/json" ? JSON.parse(text) : { refused: text.trim() };
  } catch {
    return { refused: "The session does not answer." };
  }
}

// Labels and greys a picture that is out of date.
function mark(name, words) {
  const word = of(`${name}-word`);
  if (word.textContent !== words) word.textContent = words;
  word.hidden = words === "";
  of(name).classList.toggle("old", words !== "");
}

of("again").addEventListener("click", () => stream.connect());
const help = of("help");
of("help-open").addEventListener("click", () => help.showModal());
document.addEventListener("keydown", (event) => {
  if (event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey || document.querySelector("dialog[open]") || event.target.localName === "select") return;
  const acts = { "?": () => help.showModal(), p: () => planes.toggle(), m: () => measure.toggle() };
  const act = acts[event.key.toLowerCase()];
  if (!act) return;
  event.preventDefault();
  act();
});
document.addEventListener("visibilitychange", show);
setInterval(update, UPDATE_MS);
// The view's keys work from the start.
of("view").focus();
stream.connect();
