// Keys on the view. Each does what the help says, and only while the view, or a button of it, has the focus: elsewhere keys are the browser's.

const TURN = 5;
const ZOOM = 0.25;
const MOVE = 0.1;
const SIDES = { 1: "home", Home: "home", 2: "front", 3: "back", 4: "left", 5: "right", 6: "above", 7: "below" };
const TURNS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
// What is seen goes there; so the middle comes from the other side.
const MOVES = { w: [0, 1], s: [0, -1], a: [1, 0], d: [-1, 0] };
const ZOOMS = { "+": 1, "=": 1, "-": -1, "−": -1, _: -1 };

/// `wish` takes `turn` and `zoom` as for the hand, `centre(x, y)` and `look(side)`.
export function keys(panel, wish) {
  panel.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest(".measure")) return;
    if (act(event.key, event.shiftKey, wish)) event.preventDefault();
  });
}

function act(key, shift, wish) {
  const turn = TURNS[key];
  const move = MOVES[key.toLowerCase()];
  if (turn && shift && turn[0] !== 0) wish.turn(0, 0, turn[0] * TURN);
  else if (turn && !shift) wish.turn(turn[0] * TURN, turn[1] * TURN, 0);
  else if (move) wish.centre(0.5 + move[0] * MOVE, 0.5 + move[1] * MOVE);
  else if (ZOOMS[key]) wish.zoom(ZOOMS[key] * ZOOM);
  else if (SIDES[key]) wish.look(SIDES[key]);
  else return false;
  return true;
}
