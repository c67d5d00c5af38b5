// The view of the volume and its camera, as the session has them: angles in degrees, lengths in
// mm, numbers in double precision.

import { add, cross, dot, minus, times, unit } from "./space.js";

// Range of the zoom, in doublings.
const ZOOMS = [-2, 6];

const radians = (degrees) => (degrees * Math.PI) / 180;
const degrees = (radians) => (radians * 180) / Math.PI;

/// Returns the unit vectors to the right, upwards and into the picture; world axes.
export function axes({ azimuth, elevation, roll }) {
  const [[sa, ca], [se, ce], [sr, cr]] = [azimuth, elevation, roll].map((angle) => [Math.sin(radians(angle)), Math.cos(radians(angle))]);
  const forward = [-sa * ce, ca * ce, -se];
  const right = [ca, sa, 0];
  const up = cross(right, forward);
  return { right: minus(times(right, cr), times(up, sr)), up: add(times(up, cr), times(right, sr)), forward };
}

/// Returns the angles of a view along `forward`, upwards as near to `above` as possible.
function along(forward, above) {
  const elevation = degrees(Math.asin(Math.min(1, Math.max(-1, -forward[2]))));
  const azimuth = degrees(Math.atan2(-forward[0], forward[1]));
  const level = axes({ azimuth, elevation, roll: 0 });
  return { azimuth, elevation, roll: degrees(Math.atan2(dot(above, level.right), dot(above, level.up))) };
}

// Turns a vector about a unit axis.
function turnedAbout(axis, angle, vector) {
  const [s, c] = [Math.sin(radians(angle)), Math.cos(radians(angle))];
  return add(add(times(vector, c), times(cross(axis, vector), s)), times(axis, dot(axis, vector) * (1 - c)));
}

/// Returns the view after a command to the session; null if only the session knows it.
export function steered(view, command) {
  if (command.do === "zoom") return { ...view, zoom: Math.min(ZOOMS[1], Math.max(ZOOMS[0], view.zoom + command.by)) };
  if (command.do !== "turn") return null;
  const { right, up, forward } = axes(view);
  // The volume turns one way, so the camera goes the other.
  const by = (vector) => turnedAbout(up, -command.right, turnedAbout(right, command.up, turnedAbout(forward, -command.clockwise, vector)));
  return { ...view, ...along(unit(by(forward)), by(up)) };
}

/// Maps a point by an affine map of 12 numbers: three columns, then the translation.
export const mapped = (map, point) => add(linear(map, point), map.slice(9, 12));

/// Maps a direction by an affine map.
export function linear(map, [x, y, z]) {
  return [0, 1, 2].map((row) => map[row] * x + map[row + 3] * y + map[row + 6] * z);
}

/// Returns the inverse of an affine map.
export function inverse(map) {
  const columns = [0, 3, 6].map((at) => map.slice(at, at + 3));
  const [x, y, z] = columns;
  const volume = dot(x, cross(y, z));
  const rows = [cross(y, z), cross(z, x), cross(x, y)].map((row) => times(row, 1 / volume));
  const across = [0, 1, 2].flatMap((column) => rows.map((row) => row[column]));
  const at = linear([...across, 0, 0, 0], map.slice(9, 12));
  return [...across, ...times(at, -1)];
}

/// Returns the camera of a view of the session's drawing: sample k of the ray through pixel (i, j)
/// lies at `origin + right i + down j + forward k` (parallel), region coordinates. A perspective
/// ray begins at the eye, `origin`, in the world's direction `axis + right i + down j`, its first
/// sample at `near_mm`.
export function camera({ low, high, first, world_from_region: map, size, step }, view) {
  const { right, up, forward } = axes(view);
  const spacing = [0, 3, 6].map((at) => Math.hypot(...map.slice(at, at + 3)));
  const [least, most] = [low, high].map((at) => minus(at, first));
  const middle = mapped(map, times(add(least, most), 0.5));
  const half = add(times(minus(most, least), 0.5), [1, 1, 1]);
  const diagonals = [[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]].map((sign) => linear(map, half.map((length, a) => length * sign[a])));
  const radius = Math.max(...diagonals.map((diagonal) => Math.hypot(...diagonal)));
  const step_mm = step * Math.min(...spacing);
  const samples = Math.ceil((2 * radius) / step_mm) + 1;
  const aside = view.aim ? minus(view.aim, middle) : [0, 0, 0];
  const centre = add(middle, minus(aside, times(forward, dot(aside, forward))));
  const closer = 2 ** -view.zoom;
  const region_from_world = inverse(map);
  const [width, height] = size;
  const [i0, j0] = [0.5 * (1 - width), 0.5 * (1 - height)];
  const perspective = view.perspective !== null;
  let [origin, pixel, near_mm, ahead] = [];
  if (perspective) {
    const angle = 0.5 * radians(view.perspective);
    const distance = radius / Math.sin(angle);
    pixel = ((2 * Math.tan(angle)) / Math.min(width, height)) * closer;
    [origin, near_mm] = [minus(centre, times(forward, distance)), distance - radius];
    ahead = minus(add(forward, times(right, i0 * pixel)), times(up, j0 * pixel));
  } else {
    const extent = (axis) => (view.turns ? radius : Math.max(...diagonals.map((diagonal) => Math.abs(dot(diagonal, axis)))));
    pixel = Math.max((2 * extent(right)) / width, (2 * extent(up)) / height) * closer;
    origin = minus(add(minus(centre, times(forward, radius)), times(right, i0 * pixel)), times(up, j0 * pixel));
    [near_mm, ahead] = [0, times(forward, step_mm)];
  }
  return {
    perspective,
    samples,
    step_mm,
    near_mm,
    radius,
    middle,
    forward,
    region_from_world,
    origin: mapped(region_from_world, origin),
    right: perspective ? times(right, pixel) : linear(region_from_world, times(right, pixel)),
    down: perspective ? times(up, -pixel) : linear(region_from_world, times(up, -pixel)),
    ahead: perspective ? ahead : linear(region_from_world, ahead),
    projection: projection({ right, up, forward }, origin, pixel, size, perspective),
  };
}

// Returns the projection from the world to the picture, as the session's `sight` has it.
function projection({ right, up, forward }, origin, pixel, size, perspective) {
  const row = (axis) => [...axis, -dot(axis, origin)];
  const [aside, down] = [times(right, 1 / pixel), times(up, -1 / pixel)];
  if (!perspective) return [row(aside), row(down), [0, 0, 0, 1]];
  const [i, j] = size.map((side) => times(forward, 0.5 * (side - 1)));
  return [row(add(aside, i)), row(add(down, j)), row(forward)];
}
