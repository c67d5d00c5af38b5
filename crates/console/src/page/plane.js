// One plane through the volume: its picture, the lines of the other planes, a scale, and
// pointer and keyboard input.

import { fit, place } from "./fit.js";
import { marked } from "./figures.js";
import { Picture } from "./picture.js";
import { across, add, crossing, pixel, point, times } from "./space.js";

const SVG = "http://www.w3.org/2000/svg";
const DEGREES = 180 / Math.PI;
// A wheel notch, and one line of it, CSS pixels.
const NOTCH = 110;
const LINE = 36;
// Rotation of the free plane per key press, degrees.
const TILT = 5;
// Radius around the crossing point in which no line covers the tissue, CSS pixels.
const GAP = 9;
// A pointer that moves no farther clicks, CSS pixels.
const STILL = 4;
// Lengths of the scale, mm. The longest that fits in this fraction of the picture is shown.
const SCALES = [100, 50, 20, 10, 5, 2, 1];
const SHARE = 0.4;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/// Colour and dashes that identify each plane everywhere.
export const LOOKS = {
  3: { name: "z", title: "Across z", colour: "#f0e442", dash: "" },
  4: { name: "y", title: "Across y", colour: "#6cc3f2", dash: "9 5" },
  5: { name: "x", title: "Across x", colour: "#ff9d5c", dash: "2 4" },
  6: { name: "free", title: "Free", colour: "#f0a8d0", dash: "12 4 2 4" },
};

export class Plane {
  kind;
  element;
  /// The plane's position: `{ origin, right, down, size, … }` as received with the displayed
  /// picture; null before the first.
  lies = null;
  #room;
  #canvas;
  #lines;
  #name;
  #where;
  #nothing;
  #picture;
  #handle = null;
  #described = new Map();
  #actions;
  #steers = false;
  #at = null;

  /// `actions` takes `cross(point)`, `tilt(right, up, clockwise)`, `home()`. `settled(kind,
  /// header)` is called once for every picture, `drawn(plane)` for each displayed one.
  constructor(kind, actions, settled, drawn) {
    this.kind = kind;
    this.#actions = actions;
    const { title, colour, dash } = LOOKS[kind];
    this.element = element("section", "plane", { "aria-label": `Plane: ${title}` });
    const head = element("p", "plane-head");
    const key = svg("svg", { class: "plane-key", viewBox: "0 0 34 10", "aria-hidden": "true", focusable: "false" });
    key.append(svg("line", { x1: 0, y1: 5, x2: 34, y2: 5, stroke: colour, "stroke-width": 3, "stroke-dasharray": dash }));
    this.#name = element("strong", "");
    this.#name.textContent = title;
    this.#where = element("span", "");
    head.append(key, this.#name, this.#where);
    this.#room = element("div", "room");
    this.#canvas = element("canvas", "empty", { tabindex: "0", role: "application", "aria-roledescription": "plane through the volume", width: "64", height: "64" });
    this.#canvas.title = kind === 6 ? "Click or drag to move the cross, wheel to go through, Shift and drag to turn (key ? for all)" : "Click or drag to move the cross, wheel to go through (key ? for all)";
    this.#canvas.id = `plane-${LOOKS[kind].name}`;
    this.#lines = svg("svg", { class: "plane-lines", "aria-hidden": "true", focusable: "false" });
    this.#nothing = element("p", "plane-nothing");
    this.#nothing.textContent = "no volume yet";
    this.#room.append(this.#canvas, this.#lines, this.#nothing);
    if (kind === 6) this.#room.append(this.#turner());
    this.element.append(head, this.#room);
    this.#picture = new Picture(this.#canvas, (header, whether) => {
      settled(kind, header, whether);
      const lies = this.#described.get(header.sequence);
      for (const sequence of this.#described.keys()) if (sequence <= header.sequence) this.#described.delete(sequence);
      if (!whether || !lies) return;
      this.lies = lies.none ? null : lies;
      this.#nothing.textContent = lies.none ?? "";
      drawn(this, lies);
    });
    new ResizeObserver(() => this.draw()).observe(this.#room);
    this.#listen();
    this.#tell();
  }

  /// Receives the description that precedes a picture.
  describe(lies) {
    this.#described.set(lies.sequence, lies);
  }

  offer(header, pixels) {
    this.#picture.offer(header, pixels);
  }

  forget() {
    this.#picture.forget();
  }

  restart() {
    this.#described.clear();
    this.#picture.restart();
  }

  /// Returns the width of a screen pixel (CSS) on the plane, mm; null before there is a picture.
  pixelMm() {
    const { clientWidth } = this.#canvas;
    return this.lies && clientWidth > 0 ? (this.lies.mm_per_px * this.lies.size[0]) / clientWidth : null;
  }

  control(steers) {
    this.#steers = steers;
    this.#canvas.classList.toggle("steered", steers);
    if (this.#handle) this.#handle.disabled = !steers;
  }

  /// Lays out the picture, and draws the lines of the other planes and their crossing point.
  draw(others = [], at = null, over = null) {
    if (others.length > 0) this.#at = { others, at, over };
    const lies = this.lies;
    const { width, height } = lies ? { width: lies.size[0], height: lies.size[1] } : { width: 1, height: 1 };
    const lain = fit(this.#room, width / height);
    place(this.#canvas, lain);
    this.#lines.replaceChildren();
    this.#lines.setAttribute("viewBox", `0 0 ${this.#room.clientWidth} ${this.#room.clientHeight}`);
    if (!lies || !this.#at) return;
    this.#cross(lies, lain);
    if (this.#at.over) this.#lines.append(marked(lies, lain, this.#at.over));
    this.#scale(lies, lain);
    this.#tell();
  }

  #cross(lies, lain) {
    const scale = lain.width / lies.size[0];
    const screen = ([i, j]) => [lain.left + (i + 0.5) * scale, lain.top + (j + 0.5) * scale];
    const [x, y] = screen(pixel(lies, this.#at.at));
    const far = lies.size[0] + lies.size[1];
    // Clips lines at the picture's edge.
    const clip = svg("clipPath", { id: `clip-${this.#canvas.id}` });
    clip.append(svg("rect", { x: lain.left, y: lain.top, width: lain.width, height: lain.height }));
    const all = svg("g", { "clip-path": `url(#clip-${this.#canvas.id})` });
    for (const other of this.#at.others) {
      if (other === this || !other.lies) continue;
      const ends = crossing(lies, other.lies, this.#at.at, far);
      if (!ends) continue;
      const { colour, dash } = LOOKS[other.kind];
      for (const end of ends.map(screen)) {
        const long = Math.hypot(end[0] - x, end[1] - y);
        const from = [x + ((end[0] - x) / long) * GAP, y + ((end[1] - y) / long) * GAP];
        // A dark line below the coloured one keeps it visible on white tissue.
        for (const [stroke, wide, dashes] of [["#000a", 4, ""], [colour, 2, dash]]) {
          all.append(svg("line", { x1: from[0], y1: from[1], x2: end[0], y2: end[1], stroke, "stroke-width": wide, "stroke-dasharray": dashes, "data-of": LOOKS[other.kind].name }));
        }
      }
    }
    all.append(svg("circle", { cx: x, cy: y, r: GAP - 2, class: "plane-point" }));
    this.#lines.append(clip, all);
  }

  #scale(lies, { left, top, width, height }) {
    const perMm = width / lies.size[0] / lies.mm_per_px;
    const mm = SCALES.find((mm) => mm * perMm <= SHARE * width) ?? SCALES.at(-1);
    const [x, y] = [left + 10, top + height - 10];
    for (const [stroke, wide] of [["#000c", 6], ["#eaf0f5", 3]]) this.#lines.append(svg("line", { x1: x, y1: y, x2: x + mm * perMm, y2: y, stroke, "stroke-width": wide }));
    const text = svg("text", { x, y: y - 7, class: "plane-text" });
    text.textContent = `${mm} mm`;
    this.#lines.append(text);
  }

  #tell() {
    const { title } = LOOKS[this.kind];
    const off = this.lies && this.#at ? offset(this.lies, this.kind, this.#at.at) : "";
    if (this.#where.textContent !== off) this.#where.textContent = off;
    const label = `${title}${off ? `, ${off}` : ""}. Arrows move the cross, page up and down go through the volume${this.kind === 6 ? ", Shift and arrows turn the plane" : ""}, Home leads back.`;
    if (this.#canvas.getAttribute("aria-label") !== label) this.#canvas.setAttribute("aria-label", label);
  }

  // A knob that turns the plane, for devices without a Shift key.
  #turner() {
    const knob = element("button", "plane-turner", { type: "button", "aria-label": "Turn the free plane", title: "Drag to turn the free plane; or arrows, and Shift with ← → to roll" });
    knob.textContent = "⟲";
    knob.disabled = true;
    let from = null;
    knob.addEventListener("pointerdown", (event) => {
      knob.setPointerCapture(event.pointerId);
      from = [event.clientX, event.clientY];
    });
    knob.addEventListener("pointermove", (event) => {
      if (!from) return;
      this.#turn(from, [event.clientX, event.clientY]);
      from = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) knob.addEventListener(end, () => (from = null));
    knob.addEventListener("keydown", (event) => {
      const arrow = ARROWS[event.key];
      if (!arrow || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      this.#key(arrow, event.shiftKey);
    });
    this.#handle = knob;
    return knob;
  }

  // Turns the plane like the surface of a ball that fills the picture.
  #turn(from, to) {
    const { width, height } = this.#canvas.getBoundingClientRect();
    const perPixel = DEGREES / (Math.max(80, Math.min(width, height)) / 2);
    this.#actions.tilt((to[0] - from[0]) * perPixel, (from[1] - to[1]) * perPixel, 0);
  }

  #key([right, down], rolls) {
    if (rolls && right !== 0) this.#actions.tilt(0, 0, right * TILT);
    else if (!rolls) this.#actions.tilt(right * TILT, -down * TILT, 0);
  }

  #listen() {
    const canvas = this.#canvas;
    let from = null;
    let begun = null;
    let turns = false;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !this.#steers) return;
      canvas.setPointerCapture(event.pointerId);
      from = [event.clientX, event.clientY];
      begun = from;
      turns = event.shiftKey && this.kind === 6;
      if (!turns) this.#to(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      if (turns) this.#turn(from, [event.clientX, event.clientY]);
      else this.#to(event);
      from = [event.clientX, event.clientY];
    });
    canvas.addEventListener("pointerup", (event) => {
      const still = from && Math.hypot(event.clientX - begun[0], event.clientY - begun[1]) <= STILL;
      from = null;
      if (still && !turns && this.lies) this.#actions.clicked();
    });
    canvas.addEventListener("pointercancel", () => (from = null));
    canvas.addEventListener(
      "wheel",
      (event) => {
        if (!this.#steers || event.ctrlKey) return;
        event.preventDefault();
        const pixels = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY : event.deltaY * LINE;
        this.#through((pixels / NOTCH) * 2);
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || !this.lies) return;
      const arrow = ARROWS[event.key];
      if (arrow && event.shiftKey && this.kind === 6) {
        this.#key(arrow, false);
      } else if (arrow && !event.shiftKey) {
        this.#actions.move(add(times(this.lies.right, (arrow[0] * this.lies.voxel_mm) / this.lies.mm_per_px), times(this.lies.down, (arrow[1] * this.lies.voxel_mm) / this.lies.mm_per_px)));
      } else if (event.key === "PageUp" || event.key === "PageDown") {
        this.#through(event.key === "PageUp" ? -2 : 2);
      } else if (event.key === "Home") {
        this.#actions.home();
      } else {
        return;
      }
      event.preventDefault();
    });
  }

  // Moves the cross by this many voxels along the viewing direction, away from the viewer.
  #through(voxels) {
    if (this.lies) this.#actions.move(times(across(this.lies), voxels * this.lies.voxel_mm));
  }

  // Moves the cross to the pointer.
  #to(event) {
    if (!this.lies) return;
    const { left, top, width, height } = this.#canvas.getBoundingClientRect();
    const [w, h] = this.lies.size;
    const inside = (share, pixels) => Math.min(pixels - 1, Math.max(0, share * pixels - 0.5));
    this.#actions.cross(point(this.lies, [inside((event.clientX - left) / width, w), inside((event.clientY - top) / height, h)]));
  }
}

// Describes the plane's position: along its axis, or the free plane's viewing direction.
function offset(lies, kind, at) {
  if (kind === 6) {
    const way = across(lies).map((x) => (Math.abs(x) < 0.005 ? 0 : x).toFixed(2));
    return `along ${way.join(", ")}`;
  }
  const { name } = LOOKS[kind];
  const axis = lies.volume.edges[["x", "y", "z"].indexOf(name)];
  const along = axis.reduce((sum, x, n) => sum + x * at[n], 0) / Math.hypot(...axis);
  return `${name} ${along.toFixed(1)} mm`;
}

function element(name, kind, attributes = {}) {
  const made = document.createElement(name);
  if (kind) made.className = kind;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function svg(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}
