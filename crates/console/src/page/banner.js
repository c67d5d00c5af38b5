// The troubles, visible to everybody and announced to screen readers. A change is announced
// once; its numbers are not.

const SIGNS = { bad: "✕", heed: "!", ended: "■", wait: "…", well: "✓" };
// More than these are too many to read at once.
const SHOWN = 3;
// Display time of the session's answer, ms.
const ANSWERED = 8000;

export class Banner {
  #element;
  #announcer;
  #spoken = "";
  #answer = null;

  constructor(element, announcer) {
    this.#element = element;
    this.#announcer = announcer;
  }

  /// Shows the session's answer to a command: the result, or the reason of a refusal.
  say(how, sentence) {
    this.#answer = { how, sentence, until: Date.now() + ANSWERED };
  }

  show(troubles) {
    const all = [...troubles];
    if (this.#answer && Date.now() > this.#answer.until) this.#answer = null;
    // A status trouble with the same sentence replaces the answer, since it stays longer.
    if (this.#answer && all.some(({ sentence }) => plain(sentence) === plain(this.#answer.sentence))) this.#answer = null;
    if (this.#answer) all.splice(1, 0, { how: this.#answer.how, key: this.#answer.sentence, sentence: this.#answer.sentence, more: "" });
    const shown = all.slice(0, SHOWN);
    this.#element.className = `banner ${shown[0].how}`;
    while (this.#element.children.length > shown.length) this.#element.lastElementChild.remove();
    while (this.#element.children.length < shown.length) this.#element.append(line());
    shown.forEach((trouble, n) => fill(this.#element.children[n], trouble));
    const spoken = shown.map(({ sentence }) => sentence).join(" ");
    const keys = shown.map(({ key }) => key).join("|");
    if (keys !== this.#spoken) {
      this.#spoken = keys;
      this.#announcer.textContent = spoken;
    }
  }
}

// The sentence without its full stop and capitals.
const plain = (sentence) => sentence.replace(/\.$/, "").toLowerCase();

function line() {
  const p = document.createElement("p");
  const sign = document.createElement("span");
  sign.className = "sign";
  sign.setAttribute("aria-hidden", "true");
  p.append(sign, document.createElement("strong"), " ", document.createElement("span"));
  return p;
}

function fill(p, { how, sentence, more }) {
  p.className = how;
  const texts = [SIGNS[how], sentence, more];
  texts.forEach((text, n) => {
    if (p.children[n].textContent !== text) p.children[n].textContent = text;
  });
}
