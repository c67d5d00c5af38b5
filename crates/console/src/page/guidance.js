// The scan guidance card: probe speed against the speed the volume needs, missed regions, and
// advice.

import { rows, SIGNS, write } from "./account.js";
import { guidance } from "./words.js";

// More sentences are too many to follow at once.
const MOST_ADVICE = 3;

export class GuidanceCard {
  #of;

  /// `of(id)` returns the element of that id.
  constructor(of) {
    this.#of = of;
  }

  /// Shows the session's scan guidance; null if the session has none.
  show(status) {
    const { how, says, facts, gauge, advice } = guidance(status);
    const vital = this.#of("guidance-vital");
    vital.dataset.how = how;
    write(vital, `${SIGNS[how]} ${says}`);
    this.#gauge(gauge);
    rows(this.#of("guidance-facts"), facts);
    // Missed regions are already reported above.
    const more = advice.filter(({ key }) => key !== "holes");
    rows(this.#of("guidance-advice"), more.slice(0, MOST_ADVICE).map(({ how, sentence, more }) => ({ how, strong: sentence, says: more })));
  }

  #gauge(gauge) {
    const element = this.#of("guidance-gauge");
    element.hidden = gauge === null;
    if (gauge === null) return;
    const [even, thin, gaps, needle] = element.children;
    [even, thin, gaps].forEach((zone, n) => {
      zone.style.flexGrow = gauge.zones[n];
    });
    needle.hidden = gauge.at === null;
    needle.style.left = `${(100 * (gauge.at ?? 0)).toFixed(1)}%`;
    if (element.getAttribute("aria-label") !== gauge.says) element.setAttribute("aria-label", gauge.says);
  }
}
