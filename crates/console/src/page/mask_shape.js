// Shapes of the mask in the scanner's picture: their outlines, their handles, and their changes by
// a handle. Shapes have the form of the session's status; lengths are pixels of the frame.

// Least side of a rectangle and distance of a fan's arcs, pixels; least angle, degrees.
const LEAST = 8;
const LEAST_ANGLE = 2;
// Points of an arc.
const ARC = 48;

const radians = (degrees) => (degrees * Math.PI) / 180;
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const round = (value) => Math.round(value * 100) / 100;

/// The place at a distance and an angle from a fan's apex; 0° is down, positive to the right.
const polar = ({ origin_px: [u, v] }, radius, angle) => [u + radius * Math.sin(radians(angle)), v + radius * Math.cos(radians(angle))];

/// Returns a rectangle or a fan to begin with in a frame of this size.
export function first(kind, [width, height]) {
  if (kind === "rectangle") return { rectangle: { x: 0, y: 0, width, height } };
  return { fan: { origin_px: [width / 2, -height / 8], radii_px: [height / 4, height], angles_deg: [-35, 35] } };
}

/// Returns "rectangle" or "fan"; null for other shapes.
export function kind(shape) {
  return shape?.rectangle ? "rectangle" : shape?.fan ? "fan" : null;
}

/// Returns the outline as points; none for shapes without one.
export function outline(shape) {
  if (shape?.rectangle) {
    // Pixels have their centres at whole numbers.
    const { x, y, width, height } = shape.rectangle;
    const [left, top, right, bottom] = [x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5];
    return [[left, top], [right, top], [right, bottom], [left, bottom]];
  }
  if (!shape?.fan) return [];
  const { radii_px: [inner, outer], angles_deg: [first, last] } = shape.fan;
  const at = (n) => first + ((last - first) * n) / ARC;
  const arc = [...Array(ARC + 1).keys()];
  return [...arc.map((n) => polar(shape.fan, outer, at(n))), ...arc.reverse().map((n) => polar(shape.fan, inner, at(n)))];
}

/// Returns the handles: a name, a label, a place, and the number that the handle changes.
export function handles(shape) {
  if (shape?.rectangle) {
    const { x, y, width, height } = shape.rectangle;
    return [
      { name: "left", label: "Left side", at: [x - 0.5, y + height / 2], value: x },
      { name: "right", label: "Right side", at: [x + width - 0.5, y + height / 2], value: x + width },
      { name: "top", label: "Top side", at: [x + width / 2, y - 0.5], value: y },
      { name: "bottom", label: "Bottom side", at: [x + width / 2, y + height - 0.5], value: y + height },
    ];
  }
  if (!shape?.fan) return [];
  const { origin_px: origin, radii_px: [inner, outer], angles_deg: [first, last] } = shape.fan;
  const [middle, half] = [(first + last) / 2, (inner + outer) / 2];
  return [
    { name: "apex", label: "Apex", at: origin, value: round(origin[1]) },
    { name: "inner", label: "Near arc", at: polar(shape.fan, inner, middle), value: round(inner) },
    { name: "outer", label: "Far arc", at: polar(shape.fan, outer, middle), value: round(outer) },
    { name: "first", label: "Left edge", at: polar(shape.fan, half, first), value: round(first) },
    { name: "last", label: "Right edge", at: polar(shape.fan, half, last), value: round(last) },
  ];
}

/// Returns the places of handles of this radius at these points of a picture of this size, all in
/// CSS pixels: within the picture, and apart, so that a pointer meets each. Those of points beyond
/// the picture, such as an apex above it, wait at its border, and give way to others.
export function apart(points, size, radius) {
  const places = points.map((point) => point.map((x, axis) => clamp(x, radius, size[axis] - radius)));
  const away = (n) => Math.hypot(...points[n].map((x, axis) => x - places[n][axis]));
  const placed = [];
  for (const n of [...points.keys()].sort((a, b) => away(a) - away(b))) {
    const [x, y] = places[n];
    const beside = [0, 1, -1, 2, -2, 3, -3, 4, -4].map((steps) => [clamp(x + steps * (2 * radius + 4), radius, size[0] - radius), y]);
    const isFree = ([u, v]) => placed.every((m) => Math.hypot(u - places[m][0], v - places[m][1]) > 2 * radius);
    places[n] = beside.find(isFree) ?? [x, y];
    placed.push(n);
  }
  return places;
}

/// Returns the shape with a handle moved by [du, dv] in a frame of this size.
export function moved(shape, name, [du, dv], [width, height]) {
  if (shape.rectangle) {
    const { x, y, width: columns, height: rows } = shape.rectangle;
    let [left, top, right, bottom] = [x, y, x + columns, y + rows];
    if (name === "left") left = clamp(Math.round(left + du), 0, right - LEAST);
    if (name === "right") right = clamp(Math.round(right + du), left + LEAST, width);
    if (name === "top") top = clamp(Math.round(top + dv), 0, bottom - LEAST);
    if (name === "bottom") bottom = clamp(Math.round(bottom + dv), top + LEAST, height);
    return { rectangle: { x: left, y: top, width: right - left, height: bottom - top } };
  }
  const { origin_px: [u, v], radii_px: [inner, outer], angles_deg: [first, last] } = shape.fan;
  const fan = { origin_px: [u, v], radii_px: [inner, outer], angles_deg: [first, last] };
  const middle = radians((first + last) / 2);
  const along = du * Math.sin(middle) + dv * Math.cos(middle);
  if (name === "apex") fan.origin_px = [round(u + du), round(v + dv)];
  if (name === "inner") fan.radii_px[0] = round(clamp(inner + along, 0, outer - LEAST));
  if (name === "outer") fan.radii_px[1] = round(Math.max(outer + along, inner + LEAST));
  const turned = (angle) => {
    const [x, y] = polar(shape.fan, (inner + outer) / 2, angle);
    return (Math.atan2(x + du - u, y + dv - v) * 180) / Math.PI;
  };
  if (name === "first") fan.angles_deg[0] = round(clamp(turned(first), -180, last - LEAST_ANGLE));
  if (name === "last") fan.angles_deg[1] = round(clamp(turned(last), first + LEAST_ANGLE, 180));
  return { fan };
}
