// The page's own view of the volume: drawn here from the session's bricks, where the browser can do
// that fast, else drawn by the session. The caption says which, and why.
//
// For tests and debugging, as `window.sonoweave.own`:
//
//  here, why   whether the view is drawn here; else the reason
//  missing     bricks still to come; null before the first message
//  bricks      bricks here
//  dropped     messages dropped because they were wrong
//  work        the work of the caster

import { BrickStore, parseBricks } from "./bricks.js";
import { contextOf, Gpu } from "./gpu.js";
import { Caster } from "./gpu_caster.js";
import { steered } from "./orbit.js";

// A machine whose first frames all take longer, ms, draws too slowly.
const SLOW_MS = 40;
const TRIES = 3;
// If bricks that the page never had take longer, ms, the session draws until they have come.
const LATE_MS = 2000;
const CAMERA = ["turn", "zoom", "centre", "look"];

export class OwnView {
  #handlers;
  #caption;
  #software;
  #canvas = document.createElement("canvas");
  #caster = null;
  #store = new BrickStore();
  #drawing = null;
  // The view that the session has told, the one shown here, and the commands to it so far.
  #told = null;
  #view = null;
  #sent = 0;
  #steers = false;
  // Reasons why the session draws, the first that is not empty counts: for ever, while the
  // context is lost, by the session's settings, and while bricks come late.
  #never = "";
  #lost = "";
  #none = "";
  #late = "";
  #timer = null;
  #tries = 0;
  #seen = false;
  #scheduled = false;
  #answers = [];
  open = { here: false, why: "", missing: null, bricks: 0, dropped: 0, work: null };

  /// `drawn(canvas, camera)` receives each picture with its camera, `answer(header)` each message
  /// that was taken, and `changed()` is called when the session is to draw, or no longer.
  /// `software` accepts a slow browser, for tests.
  constructor(caption, software, handlers) {
    this.#caption = caption;
    this.#software = software;
    this.#handlers = handlers;
    Object.defineProperty(this.open, "view", { value: this });
    this.#canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.#leave(() => (this.#lost = "the browser has taken its graphics away"));
    });
    this.#canvas.addEventListener("webglcontextrestored", () => this.#begin());
    this.#begin();
  }

  /// Returns what this page asks for, if it is `seen`: pictures of the volume, and its bricks.
  asks(seen) {
    const bricks = seen && this.#never === "";
    // The session sends all bricks to a page that asks anew.
    if (this.#seen !== bricks) this.#forget();
    this.#seen = bricks;
    return { view: seen && !this.open.here, bricks };
  }

  /// A new connection: the session knows nothing of this page.
  restart() {
    [this.#sent, this.#told, this.#view, this.#drawing, this.#none] = [0, null, null, null, ""];
    this.#forget();
  }

  /// Sets whether this page has control; without, the view is the session's.
  control(steers) {
    this.#steers = steers === true;
    if (!this.#steers) this.#view = this.#told;
    this.#soon();
  }

  /// Receives the settings of the session's picture.
  settings(drawing) {
    this.#none = drawing.none ?? "";
    this.#drawing = drawing.none ? null : drawing;
    if (this.#drawing) {
      this.#store.keep(this.#box());
      this.#caster?.settings(drawing);
    }
    if (this.#none) this.#leave();
    this.#soon();
  }

  /// Receives the session's view, which contains `steered` of this page's commands.
  told(view) {
    this.#told = view;
    // Commands on their way would be undone.
    if (!this.#steers || view.steered === this.#sent) this.#view = view;
    this.#soon();
  }

  /// Called for each command that this page sends.
  steered(command) {
    if (!CAMERA.includes(command.do)) return;
    this.#sent += 1;
    const view = this.#view && steered(this.#view, command);
    if (!view) return;
    this.#view = view;
    this.#soon();
  }

  /// Receives a message of bricks.
  bricks(header, bytes) {
    this.#answers.push(header);
    try {
      if (!this.#drawing) throw new Error("bricks before the volume was described");
      this.#store.take(parseBricks(bytes, header.width, this.#box()));
      this.open.missing = header.height;
    } catch (error) {
      this.open.dropped += 1;
      console.warn(`sonoweave: bricks dropped: ${error.message}`);
    }
    this.open.bricks = this.#store.bricks.size;
    if (this.open.missing === 0) {
      clearTimeout(this.#timer);
      [this.#timer, this.#late] = [null, ""];
    } else if (this.open.here && this.#timer === null) {
      this.#timer = setTimeout(() => this.#leave(() => (this.#late = "the line is slow")), LATE_MS);
    }
    this.#soon();
  }

  /// Returns the present picture's size and its pixels, red, green, blue and 255 each, by row.
  pixels() {
    const [width, height] = this.#drawing.size;
    this.#caster.update();
    this.#caster.draw(this.#view);
    const to = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    to.drawImage(this.#canvas, 0, 0);
    return { width, height, data: to.getImageData(0, 0, width, height).data };
  }

  /// Returns the time of a picture, with the light of all voxels if `turns`, ms.
  time(turns) {
    const began = performance.now();
    this.#caster.draw({ ...this.#view, azimuth: this.#view.azimuth + (turns ? 0.001 : 0) });
    this.#caster.finish();
    return performance.now() - began;
  }

  /// Returns a brick's voxels on the graphics processor, and takes its context away or gives it
  /// back: for tests.
  read(at) {
    return this.#caster.read(at);
  }

  get context() {
    return this.#canvas.getContext("webgl2");
  }

  #box() {
    const { first, bricks } = this.#drawing;
    const low = first.map((voxel) => voxel / 8);
    return [low, low.map((index, axis) => index + bricks[axis])];
  }

  // Begins with a new context.
  #begin() {
    try {
      this.#caster = new Caster(new Gpu(contextOf(this.#canvas, this.#software)), this.#store);
      this.open.work = this.#caster.work;
      if (this.#drawing) this.#caster.settings(this.#drawing);
      [this.#lost, this.#tries] = ["", 0];
    } catch (error) {
      this.#never = error.message;
    }
    this.#say();
    this.#soon();
  }

  #forget() {
    this.#store.clear();
    this.#caster?.reset();
    clearTimeout(this.#timer);
    [this.#timer, this.#late, this.#tries] = [null, "", 0];
    Object.assign(this.open, { here: false, missing: null, bricks: 0 });
    this.#answers.length = 0;
    this.#say();
  }

  // Leaves the view to the session, for a reason that `note` sets.
  #leave(note = () => {}) {
    note();
    const was = this.open.here || this.#never !== "";
    this.open.here = false;
    this.#say();
    if (was) this.#handlers.changed();
  }

  #say() {
    const { here, missing } = this.open;
    const waits = missing === null || missing > 0 ? "its voxels are on their way" : "";
    this.open.why = here ? "" : this.#never || this.#lost || this.#none || this.#late || waits;
    const words = here ? "drawn here" : `drawn by the session${this.open.why ? `: ${this.open.why}` : ""}`;
    if (this.#caption.textContent !== words) this.#caption.textContent = this.#caption.title = words;
  }

  #soon() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => this.#frame());
  }

  #frame() {
    this.#scheduled = false;
    if (this.#caster && this.#drawing && this.#seen && !this.#lost && !this.#never && !this.context.isContextLost()) {
      try {
        this.#caster.update();
        if (this.#view && (this.open.here || (this.open.missing === 0 && this.#store.bricks.size > 0))) this.#draw();
      } catch (error) {
        this.#leave(() => (this.#never = error.message));
      }
    }
    for (const header of this.#answers.splice(0)) this.#handlers.answer(header);
    this.#say();
  }

  #draw() {
    const began = performance.now();
    const camera = this.#caster.draw(this.#view);
    if (!this.open.here) {
      this.#caster.finish();
      this.#tries += 1;
      if (performance.now() - began > SLOW_MS && !this.#software) {
        if (this.#tries >= TRIES) throw new Error("this machine draws too slowly");
        this.#soon();
        return;
      }
    }
    this.#handlers.drawn(this.#canvas, camera, performance.now() - began);
    if (this.open.here) return;
    [this.open.here, this.#tries] = [true, 0];
    this.#say();
    this.#handlers.changed();
  }
}
