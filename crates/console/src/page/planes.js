// The planes through the volume: visibility, crossing point, commands, and received
// descriptions.
//
// For tests and debugging, as `window.sonoweave.planes`: { shown, cross, window, told,
// pictures: { 3: { drawn, left_out, whole }, … } }. `told` came last with each kind's picture.
// `whole` says whether the drawn picture is lossless.

import { JPEG } from "./header.js";
import { Levels } from "./levels.js";
import { LOOKS, Plane } from "./plane.js";
import { add, within } from "./space.js";
import { readout } from "./words.js";

// The page keeps its own cross position until the session confirms it, or for at most this
// long, ms: earlier messages may be outdated.
const OWN = 5000;
// Tolerance for recognising the confirmed position, mm.
const SAME = 1e-6;

// Overlays of the planes: the buttons' ids, and the names in commands and descriptions.
const OVERLAYS = { "planes-errors": "errors", "planes-weak": "weakly_seen" };

export const KINDS = Object.keys(LOOKS).map(Number);

export class Planes {
  #of;
  #send;
  #planes = {};
  #levels;
  #changed;
  #steers = false;
  #cross = null;
  // The voxel there, as the session read it: { value, error, slices, halved_by, cross }.
  #voxel = null;
  // The plane that a hand used last.
  #used = null;
  #turn = -1;
  #wished = -Infinity;
  #tilt = null;
  #moved = false;
  #scheduled = false;
  #volume = null;
  #figures = { figures: [], slices: [] };
  #outlines = new Map();
  /// Called when a user with control has clicked on a plane; the cross is then there.
  clicked = () => {};
  /// Whether the planes are visible.
  shown = false;
  /// The object described above.
  open = { shown: false, cross: null, window: null, told: {}, pictures: {} };

  /// `of(id)` returns the element of that id; `send(message)` sends a command to the session;
  /// `answer(header)` acknowledges a picture; `changed()` is called when the planes are shown
  /// or hidden.
  constructor(of, { send, answer }, changed) {
    this.#of = of;
    this.#send = send;
    this.#changed = changed;
    const actions = {
      cross: (point) => this.#to(point),
      move: (by) => this.#cross && this.#to(add(this.#cross, by)),
      tilt: (right, up, clockwise) => this.#lean(right, up, clockwise),
      home: () => this.#home(),
      clicked: () => this.clicked(),
    };
    const settled = (kind, header, whether) => {
      this.open.pictures[kind][whether ? "drawn" : "left_out"] += 1;
      if (whether) this.open.pictures[kind].whole = header.encoding !== JPEG;
      answer(header);
    };
    for (const kind of KINDS) {
      this.open.pictures[kind] = { drawn: 0, left_out: 0, whole: true };
      this.#planes[kind] = new Plane(kind, actions, settled, (plane, lies) => this.#drawn(plane, lies));
      const { element } = this.#planes[kind];
      for (const event of ["pointerdown", "wheel", "keydown"]) {
        element.addEventListener(event, () => (this.#used = this.#planes[kind]), { capture: true, passive: true });
      }
      of("planes-grid").append(element);
    }
    this.#levels = new Levels({ room: of("levels-room"), preset: of("levels-preset"), says: of("levels-says"), greys: of("levels-greys"), looks: of("levels-looks") }, send);
    of("planes-open").addEventListener("click", () => this.toggle());
    of("planes-home").addEventListener("click", () => this.#home());
    for (const [id, what] of Object.entries(OVERLAYS)) {
      of(id).addEventListener("click", () => this.#send({ do: what, on: of(id).getAttribute("aria-pressed") !== "true" }));
    }
    this.control(null);
  }

  /// Shows or hides the planes.
  toggle() {
    this.shown = !this.shown;
    this.open.shown = this.shown;
    this.#of("planes-open").setAttribute("aria-pressed", String(this.shown));
    this.#of("planes-panel").hidden = !this.shown;
    document.querySelector("main").classList.toggle("with-planes", this.shown);
    if (!this.shown) this.forget();
    this.#changed();
    this.#draw();
  }

  /// Sets whether this page has control: true, false, or null while unknown.
  control(steers) {
    this.#steers = steers === true;
    for (const name of ["planes-home", ...Object.keys(OVERLAYS)]) this.#of(name).disabled = !this.#steers;
    for (const plane of Object.values(this.#planes)) plane.control(this.#steers);
    this.#levels.control(this.#steers);
  }

  /// Returns the crossing point and the width of a screen pixel there, on the plane that the hand
  /// used last or else on the coarsest; null before there is one.
  at() {
    const used = this.#used?.pixelMm();
    const widths = used ? [used] : Object.values(this.#planes).flatMap((plane) => plane.pixelMm() ?? []);
    return this.#cross && widths.length > 0 ? { point: this.#cross, pixel_mm: Math.max(...widths) } : null;
  }

  /// Receives the intersections with missed regions and with the present slice.
  outline(told) {
    this.#outlines = new Map((told ?? []).map((one) => [one.kind, one]));
    this.#draw();
  }

  /// Draws figures over the planes, and slices by their corners.
  mark(figures, slices) {
    this.#figures = { figures, slices };
    this.#draw();
  }

  /// Receives the style of the volume's picture.
  style(style) {
    this.#levels.style(style);
  }

  /// Receives the description that precedes a plane's picture.
  describe(lies) {
    this.open.told[lies.kind] = lies;
    this.#planes[lies.kind]?.describe(lies);
  }

  /// Takes a picture if it is a plane's.
  offer(header, pixels) {
    const plane = this.#planes[header.kind];
    plane?.offer(header, pixels);
    return plane !== undefined;
  }

  /// Discards waiting pictures: the page is not being viewed.
  forget() {
    for (const plane of Object.values(this.#planes)) plane.forget();
  }

  /// Resets the state, since another session may be running.
  restart() {
    [this.#turn, this.#wished] = [-1, -Infinity];
    this.#outlines = new Map();
    for (const plane of Object.values(this.#planes)) plane.restart();
  }

  #drawn(plane, lies) {
    if (!lies.none) {
      this.#volume = lies.volume;
      if (lies.turn >= this.#turn && (!this.#steers || performance.now() - this.#wished > OWN || lies.cross.every((x, n) => Math.abs(x - this.#cross[n]) < SAME))) {
        this.#turn = lies.turn;
        this.#wished = -Infinity;
        this.#hold(lies.cross);
      }
      this.#read(lies);
      this.open.window = lies.window;
      this.#levels.counts(lies);
    }
    this.#draw();
  }

  #hold(cross) {
    this.#cross = cross;
    this.open.cross = cross;
    this.#caption();
  }

  // Takes the voxel at the crossing point, and which overlays there are and are shown.
  #read({ cross, voxel, ...lies }) {
    this.#voxel = voxel && { ...voxel, cross };
    for (const [id, what] of Object.entries(OVERLAYS)) {
      const button = this.#of(id);
      button.hidden = lies[what] === null;
      button.setAttribute("aria-pressed", String(lies[what] === true));
    }
    if (this.#cross) this.#caption();
  }

  // Writes the crossing point, and the grey value there once it has been read.
  #caption() {
    const at = `at ${this.#cross.map((mm) => mm.toFixed(1)).join(", ")} mm`;
    const here = this.#voxel?.cross.every((mm, n) => Math.abs(mm - this.#cross[n]) < SAME);
    const text = here ? `${at}: ${readout(this.#voxel)}` : at;
    if (this.#of("planes-caption").textContent !== text) this.#of("planes-caption").textContent = text;
  }

  #draw() {
    if (!this.shown || !this.#cross) return;
    const all = Object.values(this.#planes);
    for (const plane of all) plane.draw(all, this.#cross, { ...this.#figures, outline: this.#outlines.get(plane.kind) });
  }

  #to(point) {
    if (!this.#steers || !this.#volume) return;
    this.#wished = performance.now();
    this.#moved = true;
    this.#hold(within(this.#volume, point));
    this.#soon();
  }

  #lean(right, up, clockwise) {
    if (!this.#steers) return;
    const before = this.#tilt ?? { right: 0, up: 0, clockwise: 0 };
    this.#tilt = { right: before.right + right, up: before.up + up, clockwise: before.clockwise + clockwise };
    this.#soon();
  }

  #home() {
    if (!this.#steers) return;
    [this.#tilt, this.#moved, this.#wished] = [null, false, -Infinity];
    this.#send({ do: "reset", of: "planes" });
  }

  // Sends and draws at most once per frame of the screen.
  #soon() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => {
      this.#scheduled = false;
      if (this.#moved) this.#send({ do: "cross", at: this.#cross });
      if (this.#tilt) this.#send({ do: "tilt", ...this.#tilt });
      [this.#moved, this.#tilt] = [false, null];
      this.#draw();
    });
  }
}
