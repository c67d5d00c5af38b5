// What this page measures of itself: shown among the delays, and open to tests and to whoever debugs as `window.sonoweave`:
//
//   latencies.slice, .view   ms from when a picture was due to its pixels' being handed to the screen, the newest last, at most 2000.
//                            The screen itself adds up to one of its own periods. Empty where the picture's clock is not known.
//   decodes.slice, .view     ms of work that a picture takes here, likewise
//   pictures.slice, .view    { drawn, left_out, sequence, frame, width, height, refining } of the pictures that came
//   connected, control       whether the session is heard; whether this page steers the view (null before it was told)
//   about, account           what the session told last of itself and of how it goes; null before it did

const KEPT = 2000;
// What is shown is of this long, ms.
const WINDOW = 10_000;

class Series {
  #at = [];
  values = [];

  add(value, now) {
    this.#at.push(now);
    this.values.push(value);
    if (this.values.length > KEPT) {
      this.#at.shift();
      this.values.shift();
    }
  }

  /// Those of the last seconds.
  recent(now) {
    return this.values.slice(this.#from(now));
  }

  /// How many a second, over the last seconds.
  rate(now) {
    const from = this.#from(now);
    const first = this.#at[from];
    return this.#at.length - from < 2 ? 0 : (this.#at.length - from - 1) / Math.max(0.001, (now - first) / 1000);
  }

  #from(now) {
    let from = this.#at.length;
    while (from > 0 && now - this.#at[from - 1] <= WINDOW) from -= 1;
    return from;
  }
}

/// Of the nearest rank, like all of the session's; null of none.
export function quantile(values, share) {
  if (values.length === 0) return null;
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)];
}

export class Measurements {
  #latencies = { slice: new Series(), view: new Series() };
  #decodes = { slice: new Series(), view: new Series() };
  #paint = new MessageChannel();
  #painted = [];

  /// Named as above.
  open;

  constructor() {
    const pictures = () => ({ drawn: 0, left_out: 0, sequence: 0, frame: 0, width: 0, height: 0, refining: false });
    this.open = {
      latencies: { slice: this.#latencies.slice.values, view: this.#latencies.view.values },
      decodes: { slice: this.#decodes.slice.values, view: this.#decodes.view.values },
      pictures: { slice: pictures(), view: pictures() },
      connected: false,
      control: null,
      about: null,
      account: null,
    };
    this.#paint.port1.onmessage = () => this.#after();
  }

  /// A picture was drawn into its canvas, or left out.
  settled(name, header, drawn, decode) {
    const of = this.open.pictures[name];
    if (!drawn) {
      of.left_out += 1;
      return;
    }
    of.drawn += 1;
    const { sequence, frame, width, height, refining } = header;
    Object.assign(of, { sequence, frame, width, height, refining });
    this.#decodes[name].add(decode, Date.now());
    if (!header.timed) return;
    // It was drawn at the beginning of the browser's frame; a message comes through when that frame is done.
    this.#painted.push([name, header.captured]);
    this.#paint.port2.postMessage(null);
  }

  #after() {
    const now = Date.now();
    for (const [name, captured] of this.#painted) this.#latencies[name].add(now - captured, now);
    this.#painted.length = 0;
  }

  /// Median and 99 % of the last seconds; null without any.
  spread(name) {
    const values = this.#latencies[name].recent(Date.now());
    return values.length === 0 ? null : { median: quantile(values, 0.5), p99: quantile(values, 0.99) };
  }

  /// Pictures a second that were drawn here, over the last seconds.
  rate(name) {
    return this.#decodes[name].rate(Date.now());
  }
}
