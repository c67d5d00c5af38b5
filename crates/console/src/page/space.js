// Points and directions in the world: three numbers each.

export const add = (a, b) => a.map((x, n) => x + b[n]);
export const minus = (a, b) => a.map((x, n) => x - b[n]);
export const times = (a, by) => a.map((x) => x * by);
export const dot = (a, b) => a.reduce((sum, x, n) => sum + x * b[n], 0);
export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
export const unit = (a) => times(a, 1 / Math.sqrt(dot(a, a)));

/// Returns the plane coordinates of a world point: pixels to the right and down from the first
/// pixel's centre.
export function pixel({ origin, right, down }, point) {
  const from = minus(point, origin);
  return [dot(from, right) / dot(right, right), dot(from, down) / dot(down, down)];
}

/// Returns the world point at such plane coordinates.
export const point = ({ origin, right, down }, [i, j]) => add(origin, add(times(right, i), times(down, j)));

/// Returns the normal of a plane, away from the viewer.
export const across = ({ right, down }) => unit(cross(right, down));

/// Returns the nearest point in a volume, given by a corner and its three edges at right
/// angles.
export function within({ corner, edges }, place) {
  const from = minus(place, corner);
  const shares = edges.map((edge) => Math.min(1, Math.max(0, dot(from, edge) / dot(edge, edge))));
  // A point inside stays the same to the last bit.
  const inside = edges.every((edge) => dot(from, edge) >= 0 && dot(from, edge) <= dot(edge, edge));
  return inside ? place : edges.reduce((sum, edge, n) => add(sum, times(edge, shares[n])), corner);
}

/// Returns two ends, in pixels, of the line in which another plane crosses this one. `through`
/// is a point of both planes; the ends lie at distance `far` from it. Returns null for parallel
/// planes.
export function crossing(plane, other, through, far) {
  const along = cross(across(plane), across(other));
  const long = Math.sqrt(dot(along, along));
  if (long < 1e-6) return null;
  const [i, j] = [dot(along, unit(plane.right)) / long, dot(along, unit(plane.down)) / long];
  const [x, y] = pixel(plane, through);
  return [[x - far * i, y - far * j], [x + far * i, y + far * j]];
}
