// The live B-mode image in the tissue's proportions, with a depth scale and the side of the
// probe's marker.

import { fit, place } from "./fit.js";

const SVG = "http://www.w3.org/2000/svg";
// Room for the scale at the right of the picture, CSS pixels.
const GUTTER = 52;
// Smallest distance of the scale's numbers, CSS pixels.
const APART = 44;
// Steps of the scale, mm.
const STEPS = [5, 10, 20, 50, 100, 200];

export class Slice {
  #room;
  #canvas;
  #scale;
  #caption;
  #pixel = null;
  #marker = "";
  #size = null;
  #greys = "";

  constructor({ room, canvas, scale, caption }) {
    this.#room = room;
    this.#canvas = canvas;
    this.#scale = scale;
    this.#caption = caption;
    new ResizeObserver(() => this.#lay()).observe(room);
  }

  /// Receives the description of the session's pictures.
  about({ size, pixel_mm: pixel, marker }) {
    this.#pixel = pixel ?? null;
    this.#marker = marker ?? "";
    this.#size ??= size ?? null;
    this.#lay();
  }

  /// Sets the description of the grey value window; empty if it is neutral.
  toned(words) {
    this.#greys = words;
    this.#lay();
  }

  /// Called after a picture was drawn.
  drawn({ width, height }) {
    if (this.#size && this.#size[0] === width && this.#size[1] === height) return;
    this.#size = [width, height];
    this.#lay();
  }

  #lay() {
    const [width, height] = this.#size ?? [4, 3];
    const [u, v] = this.#pixel ?? [1, 1];
    const at = fit(this.#room, (width * u) / (height * v), GUTTER);
    place(this.#canvas, at);
    this.#scale.replaceChildren();
    this.#scale.setAttribute("viewBox", `0 0 ${this.#room.clientWidth} ${this.#room.clientHeight}`);
    if (!this.#size) return;
    if (this.#pixel) this.#depths(at, height * v);
    if (this.#marker === "left" || this.#marker === "right") this.#mark(at);
    this.#tell(width, height);
  }

  #depths({ left, top, width, height }, depth) {
    const perMm = height / depth;
    const step = STEPS.find((step) => step * perMm >= APART) ?? STEPS.at(-1);
    const x = left + width + 4;
    this.#draw("line", { x1: x, y1: top, x2: x, y2: top + height, class: "rule" });
    for (let mm = 0; mm <= depth; mm += step / 5) {
      const numbered = Math.round(mm / (step / 5)) % 5 === 0;
      const y = top + mm * perMm;
      this.#draw("line", { x1: x, y1: y, x2: x + (numbered ? 12 : 6), y2: y, class: "rule" });
      if (numbered && y < top + height - 8) {
        const text = this.#draw("text", { x: x + 16, y: Math.max(y, top + 8) + 5, class: "depth" });
        text.textContent = mm === 0 ? "cm" : String(mm / 10);
      }
    }
  }

  #mark({ left, top, width }) {
    const x = this.#marker === "left" ? left + 18 : left + width - 18;
    this.#draw("circle", { cx: x, cy: top + 18, r: 9, class: "marker-rim" });
    this.#draw("circle", { cx: x, cy: top + 18, r: 5, class: "marker" });
  }

  #draw(name, attributes) {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    this.#scale.append(element);
    return element;
  }

  #tell(width, height) {
    // The most important part comes first, since the caption may be truncated.
    const parts = this.#greys ? [this.#greys] : [];
    if (this.#pixel) {
      const [u, v] = this.#pixel;
      parts.push(`${(width * u).toFixed(0)} × ${(height * v).toFixed(0)} mm`);
    } else {
      parts.push("no scale: the pixels' size is not known");
    }
    if (this.#marker) parts.push(`marker ${this.#marker}`);
    parts.push(`${width} × ${height} pixels`);
    this.#caption.textContent = parts.join(" · ");
    this.#canvas.setAttribute("aria-label", `The scanner's live picture, ${parts.join(", ")}`);
  }
}
