// The socket to the session: receives pictures and messages, sends commands, and reconnects
// after a failure.

import { parse } from "./header.js";
import { known } from "./known.js";

// Close code of a WebSocket endpoint that goes away (RFC 6455, 7.4.1).
const GOES = 1001;
// Waits between attempts, ms; the last one repeats.
const WAITS = [250, 500, 1000, 2000, 4000, 5000];
// The session sends its status four times a second. After this silence, ms, the connection
// counts as dead, whatever the socket reports.
const SILENCE = 4000;
const WATCH = 1000;

/// `told`: callbacks for received data. `picture(header, pixels)`, `word(key, value)`, and
/// `changed()` when the connection opens, breaks, or is being established.
export class Stream {
  #handlers;
  #address;
  #socket = null;
  #tries = 0;
  #timer = null;
  #receivedAt = 0;
  /// Whether the connection is open.
  open = false;
  /// Whether the session itself has closed the connection because it ended.
  gone = false;
  /// Time at which the connection broke, ms since the epoch; null before the first connection
  /// and while connected.
  lostAt = null;
  /// Time of the next attempt, ms since the epoch; null if none is planned.
  nextAt = null;
  /// The last decoding error.
  unread = "";

  constructor(address, handlers) {
    this.#address = address;
    this.#handlers = handlers;
    setInterval(() => this.#watch(), WATCH);
    document.addEventListener("visibilitychange", () => this.#seen());
  }

  /// Connects at once, unless an attempt is under way.
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
    this.#receivedAt = Date.now();
    this.#handlers.changed();
  }

  /// Sends a command to the session; returns false without a connection.
  send(message) {
    if (!this.open) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  /// Acknowledges a picture, drawn or left out; only then does the session send the next one.
  /// From `had_ms` the session computes the transmission time.
  answer({ kind, sequence, came }) {
    this.send({ do: "shown", kind, sequence, had_ms: Math.max(0, performance.now() - came) });
  }

  #opened(socket) {
    if (socket !== this.#socket) return;
    this.#tries = 0;
    this.#receivedAt = Date.now();
    this.open = true;
    this.lostAt = null;
    this.#handlers.changed();
  }

  #message(socket, data, came) {
    if (socket !== this.#socket) return;
    this.#receivedAt = Date.now();
    // Unreadable messages are skipped and reported: one bad message does not stop the page.
    try {
      if (typeof data !== "string") {
        const { header, pixels } = parse(data);
        this.#handlers.picture({ ...header, came }, pixels);
        return;
      }
      for (const [key, value] of Object.entries(JSON.parse(data))) this.#handlers.message(key, value);
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
    // A hidden page does not reconnect; it reconnects when it becomes visible.
    if (document.visibilityState === "visible") {
      this.nextAt = Date.now() + wait;
      this.#timer = setTimeout(() => this.connect(), wait);
    }
    this.#handlers.changed();
  }

  #watch() {
    if (!this.#socket || document.visibilityState !== "visible" || Date.now() - this.#receivedAt < SILENCE) return;
    const dead = this.#socket;
    dead.close();
    // A dead connection does not answer a close, either.
    this.#closed(dead, false);
  }

  #seen() {
    if (document.visibilityState !== "visible") {
      clearTimeout(this.#timer);
      this.nextAt = null;
    } else {
      this.#receivedAt = Date.now();
      if (!this.#socket) this.connect();
    }
  }
}
