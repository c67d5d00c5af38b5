// Draws measured figures in the view of the volume, where they turn with it, and the cross-hair
// in the middle that keys mark.
//
// For tests and debugging, as `window.sonoweave.projected`: { projection }, three rows of four
// numbers. They take (x, y, z, 1) in world mm to (i, j, 1) · w in pixels.

import { element, figure } from "./figures.js";
import { place } from "./fit.js";
import { dot } from "./space.js";

// Outer radius of the cross-hair and of its free centre, CSS pixels.
const LONG = 14;
const GAP = 4;

export class ViewFigures {
  #drawing;
  #projection = null;
  #size = null;
  #lain = null;
  #figures = [];
  #aims = false;
  /// The object described above.
  open = { projection: null };

  constructor(drawing) {
    this.#drawing = drawing;
  }

  /// Receives the projection of the next and later pictures.
  project({ projection }) {
    this.#projection = projection;
  }

  /// Called after a picture was drawn.
  drawn({ width, height }) {
    const same = this.open.projection === this.#projection && this.#size?.[0] === width && this.#size?.[1] === height;
    if (same) return;
    this.open.projection = this.#projection;
    this.#size = [width, height];
    this.#draw();
  }

  /// Places the drawing over the picture's present rectangle.
  place(at) {
    place(this.#drawing, at);
    this.#lain = at;
    this.#draw();
  }

  /// Shows these figures, and the cross-hair while the user measures.
  show(figures, aims) {
    this.#figures = figures.filter(({ points }) => points.length > 0);
    this.#aims = aims;
    this.#draw();
  }

  /// Resets the projection, since another session may be running.
  restart() {
    [this.#projection, this.open.projection] = [null, null];
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

  // Returns the screen position, or null behind the camera.
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
