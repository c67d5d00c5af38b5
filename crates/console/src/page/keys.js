// Keys on the view, as described in the help. They act only while the view, or one of its
// buttons, has the focus: elsewhere the browser keeps them.

const TURN = 5;
const ZOOM = 0.25;
const MOVE = 0.1;
const SIDES = { 1: "home", Home: "home", 2: "front", 3: "back", 4: "left", 5: "right", 6: "above", 7: "below" };
const TURNS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
// The content moves in that direction, so the centre moves in the opposite one.
const MOVES = { w: [0, 1], s: [0, -1], a: [1, 0], d: [-1, 0] };
const ZOOMS = { "+": 1, "=": 1, "-": -1, "−": -1, _: -1 };

/// `actions` takes `turn` and `zoom` as in `hand`, `centre(x, y)` and `look(side)`.
export function keys(panel, actions) {
  panel.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest(".measure")) return;
    if (act(event.key, event.shiftKey, actions)) event.preventDefault();
  });
}

function act(key, shift, actions) {
  const turn = TURNS[key];
  const move = MOVES[key.toLowerCase()];
  if (turn && shift && turn[0] !== 0) actions.turn(0, 0, turn[0] * TURN);
  else if (turn && !shift) actions.turn(turn[0] * TURN, turn[1] * TURN, 0);
  else if (move) actions.centre(0.5 + move[0] * MOVE, 0.5 + move[1] * MOVE);
  else if (ZOOMS[key]) actions.zoom(ZOOMS[key] * ZOOM);
  else if (SIDES[key]) actions.look(SIDES[key]);
  else return false;
  return true;
}
