// The socket to the session: pictures and words come in, wishes go out, and when it breaks it is tried again.

import { parse } from "./header.js";
import { known } from "./known.js";

// The code by which an end of a WebSocket says that it goes away (RFC 6455, 7.4.1).
const GOES = 1001;
// Waits between tries, ms; the last one holds from then on.
const WAITS = [250, 500, 1000, 2000, 4000, 5000];
// The session tells four times a second how it is. Nothing for this long, ms: the line is dead, whatever the socket says.
const SILENCE = 4000;
const WATCH = 1000;

/// `told`: what to call with what comes: `picture(header, pixels)`, `word(key, value)`, `changed()` when the line opens, breaks, or is waited for.
export class Stream {
  #told;
  #address;
  #socket = null;
  #tries = 0;
  #timer = null;
  #heard = 0;
  /// Whether the session is heard.
  open = false;
  /// Whether the session itself has closed the line because it goes.
  gone = false;
  /// When the line broke, ms since the epoch; null before it was ever open and while it is.
  lostAt = null;
  /// When the next try comes, ms since the epoch; null while there is none to come.
  nextAt = null;
  /// What could not be read, the last one.
  unread = "";

  constructor(address, told) {
    this.#address = address;
    this.#told = told;
    setInterval(() => this.#watch(), WATCH);
    document.addEventListener("visibilitychange", () => this.#seen());
  }

  /// Tries at once, unless a try is under way.
  connect() {
    clearTimeout(this.#timer);
    this.nextAt = null;
    if (this.#socket) return;
    const socket = new WebSocket(this.#address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.#opened(socket);
    socket.onmessage = ({ data, timeStamp }) => this.#message(socket, data, timeStamp);
    socket.onclose = ({ code }) => this.#closed(socket, code === GOES);
    this.#socket = socket;
    this.#heard = Date.now();
    this.#told.changed();
  }

  /// Says so to the session; false when nobody listens.
  send(wish) {
    if (!this.open) return false;
    this.#socket.send(JSON.stringify(wish));
    return true;
  }

  /// Answers a picture, drawn or left out: the session sends the next one only then. How long it was here tells the session how long it was on the line.
  answer({ kind, sequence, came }) {
    this.send({ do: "shown", kind, sequence, had_ms: Math.max(0, performance.now() - came) });
  }

  #opened(socket) {
    if (socket !== this.#socket) return;
    this.#tries = 0;
    this.#heard = Date.now();
    this.open = true;
    this.lostAt = null;
    this.#told.changed();
  }

  #message(socket, data, came) {
    if (socket !== this.#socket) return;
    this.#heard = Date.now();
    // What cannot be read is left out and told: one bad message is no reason to see nothing more.
    try {
      if (typeof data !== "string") {
        const { header, pixels } = parse(data);
        this.#told.picture({ ...header, came }, pixels);
        return;
      }
      for (const [key, value] of Object.entries(JSON.parse(data))) this.#told.word(key, value);
    } catch (error) {
      this.unread = error.message;
      console.warn(`sonoweave: not understood: ${error.message}`);
    }
  }

  #closed(socket, gone) {
    if (socket !== this.#socket) return;
    this.#socket = null;
    if (this.open) {
      this.lostAt = Date.now();
      this.gone = gone;
    } else {
      known();
    }
    this.open = false;
    const wait = WAITS[Math.min(this.#tries, WAITS.length - 1)];
    this.#tries += 1;
    // Nobody looks: then nobody asks. It is tried when somebody does.
    if (document.visibilityState === "visible") {
      this.nextAt = Date.now() + wait;
      this.#timer = setTimeout(() => this.connect(), wait);
    }
    this.#told.changed();
  }

  #watch() {
    if (!this.#socket || document.visibilityState !== "visible" || Date.now() - this.#heard < SILENCE) return;
    const dead = this.#socket;
    dead.close();
    // A dead line does not answer to being closed, either.
    this.#closed(dead, false);
  }

  #seen() {
    if (document.visibilityState !== "visible") {
      clearTimeout(this.#timer);
      this.nextAt = null;
    } else {
      this.#heard = Date.now();
      if (!this.#socket) this.connect();
    }
  }
}
