// Mouse, touch and pen input on the view. Dragging turns the volume like the surface of a ball
// that fills the picture.

const DEGREES = 180 / Math.PI;
// A wheel notch is 100 to 120 wheel pixels or 3 lines, and zooms by a quarter of a doubling. A
// pinch on a touchpad arrives as small wheel steps with Ctrl held.
const WHEEL = 1 / 440;
const PINCH = 1 / 100;
const LINE = 36;
// Two taps within this time, ms, and distance, CSS pixels, are a double tap. A tap that moves
// farther than `STILL` is a drag.
const TWICE = 350;
const NEAR = 24;
const STILL = 4;

/// `actions` takes `turn(right, up, clockwise)` in degrees, `zoom(doublings)`, and `tap(x, y,
/// twice)` in fractions of the picture.
export function hand(canvas, actions) {
  const fingers = new Map();
  let went = 0;
  let tapped = { at: -Infinity, x: 0, y: 0 };

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    went = fingers.size === 1 ? 0 : Infinity;
    canvas.classList.add("held");
  });

  canvas.addEventListener("pointermove", (event) => {
    const from = fingers.get(event.pointerId);
    if (!from) return;
    const to = { x: event.clientX, y: event.clientY };
    went += Math.hypot(to.x - from.x, to.y - from.y);
    const still = went <= STILL;
    // A tapping hand trembles: the view does not turn before the pointer has moved enough.
    if (still) return;
    if (fingers.size === 2) {
      const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      twist(from, to, other);
    } else if (event.shiftKey) {
      actions.turn(0, 0, angle(middle(), from, to));
    } else if (fingers.size === 1) {
      const { width, height } = canvas.getBoundingClientRect();
      const perPixel = DEGREES / (Math.min(width, height) / 2);
      actions.turn((to.x - from.x) * perPixel, (from.y - to.y) * perPixel, 0);
    }
    fingers.set(event.pointerId, to);
  });

  const released = (event) => {
    if (!fingers.delete(event.pointerId)) return;
    if (fingers.size === 0) canvas.classList.remove("held");
    if (event.type !== "pointerup" || went > STILL) return;
    const { clientX: x, clientY: y, timeStamp: at } = event;
    const twice = at - tapped.at < TWICE && Math.hypot(x - tapped.x, y - tapped.y) < NEAR;
    const { left, top, width, height } = canvas.getBoundingClientRect();
    actions.tap((x - left) / width, (y - top) / height, twice);
    tapped = twice ? { at: -Infinity, x: 0, y: 0 } : { at, x, y };
  };
  canvas.addEventListener("pointerup", released);
  canvas.addEventListener("pointercancel", released);

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY : event.deltaY * LINE;
      actions.zoom(-pixels * (event.ctrlKey ? PINCH : WHEEL));
    },
    { passive: false },
  );

  function middle() {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    return { x: left + width / 2, y: top + height / 2 };
  }

  // One of two fingers has moved; the other one is still.
  function twist(from, to, other) {
    const before = Math.hypot(from.x - other.x, from.y - other.y);
    const after = Math.hypot(to.x - other.x, to.y - other.y);
    if (before > 1 && after > 1) actions.zoom(Math.log2(after / before));
    actions.turn(0, 0, angle(other, from, to));
  }
}

/// Returns the angle in degrees from one point to another about a third, clockwise (the
/// screen's y points down).
function angle(about, from, to) {
  const turned = Math.atan2(to.y - about.y, to.x - about.x) - Math.atan2(from.y - about.y, from.x - about.x);
  return Math.atan2(Math.sin(turned), Math.cos(turned)) * DEGREES;
}
