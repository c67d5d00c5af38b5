// What lies where in the view of the volume: what was measured is drawn there and turns with it, and a cross-hair in the middle, where keys point to.
//
// For tests and for whoever debugs, as `window.sonoweave.sight`: { projection }, three rows of four numbers, which take (x, y, z, 1) in the world's mm to (i, j, 1) · w in pixels.

import { element, figure } from "./figures.js";
import { place } from "./fit.js";
import { dot } from "./space.js";

// The cross-hair: how far it goes, and what it leaves free in the middle, CSS pixels.
const LONG = 14;
const GAP = 4;

export class Sight {
  #drawing;
  #told = null;
  #size = null;
  #lain = null;
  #figures = [];
  #aims = false;
  /// As described above.
  open = { projection: null };

  constructor(drawing) {
    this.#drawing = drawing;
  }

  /// What holds from the next picture on.
  told({ projection }) {
    this.#told = projection;
  }

  /// A picture was drawn.
  drawn({ width, height }) {
    const same = this.open.projection === this.#told && this.#size?.[0] === width && this.#size?.[1] === height;
    if (same) return;
    this.open.projection = this.#told;
    this.#size = [width, height];
    this.#draw();
  }

  /// Over the picture, wherever that lies now.
  place(at) {
    place(this.#drawing, at);
    this.#lain = at;
    this.#draw();
  }

  /// These figures, and the cross-hair if somebody measures.
  show(figures, aims) {
    this.#figures = figures.filter(({ points }) => points.length > 0);
    this.#aims = aims;
    this.#draw();
  }

  /// Another session may be there.
  restart() {
    [this.#told, this.open.projection] = [null, null];
    this.#draw();
  }

  #draw() {
    if (!this.#lain) return;
    const { width, height } = this.#lain;
    this.#drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const seen = this.open.projection ? this.#figures.filter(({ points }) => points.every((point) => this.#screen(point))) : [];
    const all = seen.map((one) => figure(one, (point) => this.#screen(point)));
    if (this.#aims) all.push(...hair(width / 2, height / 2));
    this.#drawing.replaceChildren(...all);
  }

  // Null behind the eye.
  #screen(point) {
    const [i, j, w] = this.open.projection.map((row) => dot([...point, 1], row));
    if (!(w > 0)) return null;
    return [i, j].map((at, n) => ((at / w + 0.5) / this.#size[n]) * [this.#lain.width, this.#lain.height][n]);
  }
}

function hair(x, y) {
  const ends = [[1, 0], [-1, 0], [0, 1], [0, -1]];
  return ["figure-ground", "figure"].flatMap((name) =>
    ends.map(([i, j]) => element("line", { class: name, x1: x + GAP * i, y1: y + GAP * j, x2: x + LONG * i, y2: y + LONG * j, "data-hair": "" })),
  );
}
