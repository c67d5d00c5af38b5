// The page's own performance figures: shown among the delays, and available to tests and for
// debugging as `window.sonoweave`:
//
//  latencies.slice, .view   ms from a picture's due time until its pixels were handed to the
//                           screen, the newest last, at most 2000. The screen itself adds up to
//                           one of its periods. Empty if the picture's clock is unknown.
//  decodes.slice, .view     ms of work per picture on this page, likewise.
//  pictures.slice, .view    { drawn, left_out, sequence, frame, width, height, refining } of the
//                           received pictures
//  connected, control       whether the connection is open; whether this page controls the view
//                           (null before it is known)
//  about, account           the session's last description and status; null before the first

const KEPT = 2000;
// Period of the displayed figures, ms.
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

  /// Returns the values of the last seconds.
  recent(now) {
    return this.values.slice(this.#from(now));
  }

  /// Returns the number per second, over the last seconds.
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

/// Returns the nearest-rank quantile, as the session does; null if there are no values.
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

  /// The object described above.
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

  /// Records that a picture was drawn into its canvas, or left out.
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
    // The picture was drawn at the beginning of the browser's frame; a message arrives after
    // that frame.
    this.#painted.push([name, header.captured]);
    this.#paint.port2.postMessage(null);
  }

  #after() {
    const now = Date.now();
    for (const [name, captured] of this.#painted) this.#latencies[name].add(now - captured, now);
    this.#painted.length = 0;
  }

  /// Returns median and 99th percentile of the last seconds; null if there are none.
  spread(name) {
    const values = this.#latencies[name].recent(Date.now());
    return values.length === 0 ? null : { median: quantile(values, 0.5), p99: quantile(values, 0.99) };
  }

  /// Returns the pictures drawn here per second, over the last seconds.
  rate(name) {
    return this.#decodes[name].rate(Date.now());
  }
}
