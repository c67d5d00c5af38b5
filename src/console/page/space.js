// Points and directions in the world: three numbers each.

export const add = (a, b) => a.map((x, n) => x + b[n]);
export const minus = (a, b) => a.map((x, n) => x - b[n]);
export const times = (a, by) => a.map((x) => x * by);
export const dot = (a, b) => a.reduce((sum, x, n) => sum + x * b[n], 0);
export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
export const unit = (a) => times(a, 1 / Math.sqrt(dot(a, a)));

/// Where in a plane a point of the world lies: pixels to the right and down of the centre of its first one.
export function pixel({ origin, right, down }, point) {
  const from = minus(point, origin);
  return [dot(from, right) / dot(right, right), dot(from, down) / dot(down, down)];
}

/// The point of the world at such a place.
export const point = ({ origin, right, down }, [i, j]) => add(origin, add(times(right, i), times(down, j)));

/// The direction across a plane, away from who looks.
export const across = ({ right, down }) => unit(cross(right, down));

/// The nearest point in a volume: a corner, and the three edges that meet there, at right angles.
export function within({ corner, edges }, place) {
  const from = minus(place, corner);
  const shares = edges.map((edge) => Math.min(1, Math.max(0, dot(from, edge) / dot(edge, edge))));
  // What lies inside stays as it is, to the last bit.
  const inside = edges.every((edge) => dot(from, edge) >= 0 && dot(from, edge) <= dot(edge, edge));
  return inside ? place : edges.reduce((sum, edge, n) => add(sum, times(edge, shares[n])), corner);
}

/// Two ends of the line in which another plane crosses this one through a point of both, as pixels that lie as far from it as asked; null where both are the same.
export function crossing(plane, other, through, far) {
  const along = cross(across(plane), across(other));
  const long = Math.sqrt(dot(along, along));
  if (long < 1e-6) return null;
  const [i, j] = [dot(along, unit(plane.right)) / long, dot(along, unit(plane.down)) / long];
  const [x, y] = pixel(plane, through);
  return [[x - far * i, y - far * j], [x + far * i, y + far * j]];
}
