// Overlays of the pictures. On a plane: missed regions, the present slice, measured figures,
// and the intersections with slices.

import { across, dot, minus, pixel } from "./space.js";

const SVG = "http://www.w3.org/2000/svg";
const OPEN = ["distance", "angle"];

/// Returns a group of the plane's lines. `lies`: the plane's position; `lain`: its picture's
/// rectangle on the screen; `over`: `{ figures, slices, outline }`.
export function marked(lies, lain, { figures, slices, outline }) {
  const scale = lain.width / lies.size[0];
  const screen = (point) => pixel(lies, point).map((x, n) => (n === 0 ? lain.left : lain.top) + (x + 0.5) * scale);
  const normal = across(lies);
  const height = (point) => dot(minus(point, lies.origin), normal);
  const all = element("g", {});
  const at = ([i, j]) => [lain.left + (i + 0.5) * scale, lain.top + (j + 0.5) * scale];
  for (const [name, segments] of [["hole", outline?.holes ?? []], ["present", outline?.present ? [outline.present] : []]]) {
    for (const segment of segments) {
      const [[x1, y1], [x2, y2]] = segment.map(at);
      all.append(element("line", { class: name, x1, y1, x2, y2 }));
    }
  }
  for (const corners of slices) {
    const ends = meets(corners, height);
    if (ends) {
      const [[x1, y1], [x2, y2]] = ends.map(screen);
      all.append(element("line", { class: "slice-line", x1, y1, x2, y2 }));
    }
  }
  for (const one of figures) {
    // A figure that lies outside this plane is drawn through it, in another style.
    const off = one.points.some((point) => Math.abs(height(point)) > lies.voxel_mm);
    const group = figure(one, screen);
    if (off) group.setAttribute("class", "figure-off");
    all.append(group);
  }
  return all;
}

/// Returns a group for a figure that is finished or being marked. `screen(point)` gives the
/// screen position of a world point.
export function figure({ points, kind, done }, screen) {
  const group = element("g", { "data-figure": kind });
  for (const line of lines(points, kind, done)) {
    const path = line.map((point) => screen(point).map((x) => x.toFixed(1)).join(",")).join(" ");
    for (const name of ["figure-ground", "figure"]) group.append(element("polyline", { class: name, points: path }));
  }
  for (const point of points) {
    const [cx, cy] = screen(point);
    group.append(element("circle", { class: "figure-point", cx, cy, r: 4 }));
  }
  return group;
}

// Returns a figure's lines: diameters in pairs, areas closed, the others from point to point.
function lines(points, kind, done) {
  if (points.length < 2) return [];
  if (kind === "ellipsoid") return Array.from({ length: Math.floor(points.length / 2) }, (_, n) => points.slice(2 * n, 2 * n + 2));
  return [OPEN.includes(kind) || !done ? points : [...points, points[0]]];
}

// Returns the two points in which a slice's edges meet a plane, or null.
function meets(corners, height) {
  const ends = [];
  corners.forEach((from, n) => {
    const to = corners[(n + 1) % corners.length];
    const [a, b] = [height(from), height(to)];
    if (a * b < 0) ends.push(from.map((x, axis) => x + ((to[axis] - x) * a) / (a - b)));
  });
  return ends.length === 2 ? ends : null;
}

/// Creates an SVG element.
export function element(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}
