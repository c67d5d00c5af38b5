// A movie of the view, recorded by the browser as it is shown here, by the machine's own encoder.
// It is saved as a download; nothing is sent.

// Kinds of file, the most widely played first.
const KINDS = ["video/mp4;codecs=avc1.42E01F", "video/mp4", "video/webm;codecs=vp9", "video/webm"];
// Pictures a second at most, and bits a second.
const RATE = 30;
const BITS = 8_000_000;
// The file is in the browser's memory until it is saved: a recording ends by itself, ms.
const LONGEST_MS = 10 * 60 * 1000;

export class ViewMovie {
  #canvas;
  #button;
  #time;
  #speak;
  #kind;
  #recorder = null;
  #clock;
  open = { kind: null, movies: 0 };

  /// `speak(words)` announces words.
  constructor({ canvas, button, time }, speak) {
    this.#canvas = canvas;
    this.#button = button;
    this.#time = time;
    this.#speak = speak;
    const can = typeof MediaRecorder === "function" && typeof canvas.captureStream === "function";
    this.#kind = can ? KINDS.find((kind) => MediaRecorder.isTypeSupported(kind)) : undefined;
    this.open.kind = this.#kind ?? null;
    // Without an encoder, a button would promise too much.
    button.hidden = this.#kind === undefined;
    button.addEventListener("click", () => (this.#recorder ? stop(this.#recorder) : this.#begin()));
  }

  #begin() {
    const stream = this.#canvas.captureStream(RATE);
    const parts = [];
    let recorder;
    try {
      recorder = new MediaRecorder(stream, { mimeType: this.#kind, videoBitsPerSecond: BITS });
      recorder.addEventListener("dataavailable", ({ data }) => data.size > 0 && parts.push(data));
      recorder.addEventListener("stop", () => this.#end(stream, parts));
      recorder.addEventListener("error", ({ error }) => this.#speak(`The movie broke off: ${error?.message ?? "no reason given"}`));
      recorder.start(1000);
    } catch (error) {
      stream.getTracks().forEach((track) => track.stop());
      this.#speak(`This browser cannot record the view: ${error.message}`);
      return;
    }
    this.#recorder = recorder;
    const began = performance.now();
    const show = () => {
      const seconds = Math.floor((performance.now() - began) / 1000);
      this.#time.textContent = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
      if (seconds * 1000 >= LONGEST_MS) stop(recorder);
    };
    show();
    this.#clock = setInterval(show, 500);
    this.#button.setAttribute("aria-pressed", "true");
    this.#speak("The view is recorded as a movie");
  }

  #end(stream, parts) {
    stream.getTracks().forEach((track) => track.stop());
    clearInterval(this.#clock);
    this.#recorder = null;
    this.#time.textContent = "";
    this.#button.setAttribute("aria-pressed", "false");
    const movie = new Blob(parts, { type: this.#kind });
    if (movie.size === 0) {
      this.#speak("No movie: the view did not change");
      return;
    }
    const name = `sonoweave-view-${stamp(new Date())}.${this.#kind.startsWith("video/mp4") ? "mp4" : "webm"}`;
    const href = URL.createObjectURL(movie);
    Object.assign(document.createElement("a"), { href, download: name }).click();
    // The browser has read it by then.
    setTimeout(() => URL.revokeObjectURL(href), 60_000);
    this.open.movies += 1;
    this.#speak(`The movie is saved as ${name}`);
  }
}

// Ends a recording, unless it is ending already: a second click or the clock may come before that.
function stop(recorder) {
  if (recorder.state !== "inactive") recorder.stop();
}

// Returns local date and time for a file name.
function stamp(date) {
  const two = (number) => String(number).padStart(2, "0");
  const day = [date.getFullYear(), date.getMonth() + 1, date.getDate()].map(two).join("");
  return `${day}-${[date.getHours(), date.getMinutes(), date.getSeconds()].map(two).join("")}`;
}
