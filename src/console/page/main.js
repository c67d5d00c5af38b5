// The page, from the socket to what is seen: pictures and words come by the stream, go to those who show them, and what is wished for goes back.

import { AccountCards } from "./account.js";
import { Banner } from "./banner.js";
import { JPEG, SLICE, VIEW } from "./header.js";
import { Measurements } from "./measurements.js";
import { Picture } from "./picture.js";
import { Slice } from "./slice.js";
import { Stream } from "./stream.js";
import { troubles } from "./troubles.js";
import { View } from "./view.js";

// How often it is looked whether something must be said, ms.
const LOOK = 250;

const of = (id) => document.getElementById(id);
const measured = new Measurements();
window.sonoweave = measured.open;

const cards = new AccountCards(of);
const banner = new Banner(of("banner"), of("announcer"));
const slice = new Slice({ room: of("slice-room"), canvas: of("slice"), scale: of("slice-scale"), caption: of("slice-caption") });
const view = new View(
  { panel: of("view-panel"), room: of("view-room"), canvas: of("view"), onlooker: of("onlooker"), control: of("control"), refined: of("refined") },
  (wish) => stream.send(wish),
);
const screens = {
  [SLICE]: screen("slice", SLICE, (header) => slice.drawn(header)),
  [VIEW]: screen("view", VIEW, (header) => view.drawn(header)),
};

// When live pictures were asked for, and when the last one came, ms since the epoch.
let asked = null;
let came = null;
let account = null;
let ever = false;

const address = new URL("/v1/stream", location.href);
address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
const stream = new Stream(address, { picture, word, changed });

function screen(name, kind, drawn) {
  return new Picture(of(name), (header, whether, decode) => {
    measured.settled(name, header, whether, decode);
    if (whether) {
      drawn(header);
      const reduced = of(`${name}-reduced`);
      if (reduced) reduced.hidden = header.encoding !== JPEG;
    }
    // Left out or drawn, it is answered: the session sends the next one only then.
    stream.send({ do: "shown", kind, sequence: header.sequence });
  });
}

function picture(header, pixels) {
  if (header.kind === SLICE) came = Date.now();
  screens[header.kind].offer(header, pixels);
}

function word(key, value) {
  if (key === "about") {
    measured.open.about = value;
    cards.about(value);
    slice.about(value);
  } else if (key === "account") {
    account = value;
    measured.open.account = value;
    const spread = { screen: measured.spread("slice"), view: measured.spread("view"), shown: measured.rate("slice") };
    cards.tell(value, spread);
    look();
  } else if (key === "control") {
    measured.open.control = value;
    view.control(value);
  } else if (key === "refused") {
    banner.refuse(value);
    look();
  }
}

function changed() {
  if (stream.open === measured.open.connected) {
    look();
    return;
  }
  measured.open.connected = stream.open;
  if (stream.open) {
    ever = true;
    // Another session may be there now: what the last one told does not hold, and its pictures were numbered anew.
    account = null;
    for (const kind of [SLICE, VIEW]) screens[kind].restart();
    show();
  } else {
    asked = null;
    view.control(null);
    measured.open.control = null;
  }
  look();
}

// What is looked at; a hidden page looks at nothing.
function show() {
  const seen = document.visibilityState === "visible";
  if (!seen) for (const kind of [SLICE, VIEW]) screens[kind].forget();
  if (!stream.send({ do: "show", slice: seen, view: seen })) return;
  asked = seen ? Date.now() : null;
}

function look() {
  const now = Date.now();
  const since = (at) => (at === null ? null : (now - at) / 1000);
  const line = { open: stream.open, ever, gone: stream.gone, lost_s: since(stream.lostAt) ?? 0, next_s: stream.nextAt === null ? null : (stream.nextAt - now) / 1000 };
  const blank = asked === null ? null : since(Math.max(asked, came ?? 0));
  const all = troubles({ line, account, blank_s: blank });
  banner.show(all);
  of("again").hidden = stream.open || !ever;
  const old = all.some(({ key }) => ["line", "ended", "blank"].includes(key)) && ever;
  const frozen = all.some(({ key }) => key === "frozen");
  mark("slice", frozen ? "frozen" : old && came !== null ? `not live · ${new Date(came).toLocaleTimeString([], { hourCycle: "h23" })}` : "");
  mark("view", old && !stream.open ? "not live" : "");
  of("cards").classList.toggle("old", !stream.open);
}

// Over a picture that is not of now; it is greyed, too.
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
  if (event.key === "?" && !help.open && !event.ctrlKey && !event.altKey && !event.metaKey) {
    event.preventDefault();
    help.showModal();
  }
});
document.addEventListener("visibilitychange", show);
setInterval(look, LOOK);
// The keys of the view act at once.
of("view").focus();
stream.connect();
