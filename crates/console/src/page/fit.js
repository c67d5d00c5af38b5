// Fits a picture into its room: as large as possible, undistorted, centred.

/// All in CSS pixels. `aspect` is the displayed width over height; `gutter` is kept free at the
/// right.
export function fit(room, aspect, gutter = 0) {
  const free = { width: Math.max(1, room.clientWidth - gutter), height: Math.max(1, room.clientHeight) };
  const width = Math.min(free.width, free.height * aspect);
  const height = width / aspect;
  return { left: Math.round((free.width - width) / 2), top: Math.round((free.height - height) / 2), width: Math.round(width), height: Math.round(height) };
}

/// Puts an element there.
export function place(element, { left, top, width, height }) {
  Object.assign(element.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
}
