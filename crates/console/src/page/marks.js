// Marks in the view of the volume: the present slice, and missed regions, crossed out if there
// are few of them.

import { place } from "./fit.js";

const SVG = "http://www.w3.org/2000/svg";
// More crosses hide the picture behind them.
const CROSSED = 12;

export class Marks {
  #drawing;
  #legend;

  constructor(drawing, legend) {
    this.#drawing = drawing;
    this.#legend = legend;
  }

  /// Places the marks over the picture's present rectangle.
  place(at) {
    place(this.#drawing, at);
  }

  /// Corners are pixels of a picture of that size.
  show({ size: [width, height], present, holes }) {
    this.#drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const crossed = holes.length <= CROSSED;
    const paths = holes.map((corners) => ["hole", outline(corners) + (crossed ? cross(corners) : "")]);
    if (present) paths.push(["present", outline(present)]);
    while (this.#drawing.children.length > paths.length) this.#drawing.lastElementChild.remove();
    while (this.#drawing.children.length < paths.length) this.#drawing.append(document.createElementNS(SVG, "path"));
    paths.forEach(([kind, d], n) => {
      this.#drawing.children[n].setAttribute("class", kind);
      this.#drawing.children[n].setAttribute("d", d);
    });
    this.#legend.hidden = holes.length === 0;
  }

  /// Removes all marks.
  clear() {
    this.#drawing.replaceChildren();
    this.#legend.hidden = true;
  }
}

const outline = (corners) => `M${corners.map((corner) => corner.join(" ")).join("L")}Z`;

function cross([a, b, c, d]) {
  return `M${a.join(" ")}L${c.join(" ")}M${b.join(" ")}L${d.join(" ")}`;
}
