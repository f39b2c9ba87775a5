// Motions: neutral offsets of all nodes over time. Positions of faces are pixels, y down; offsets of motions point up.

const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const wholes = (text) => new Uint16Array(bytesOf(text));
const singles = (text) => new Float32Array(bytesOf(text));
const scaled = ({ scale, values }) => Float32Array.from(new Int16Array(bytesOf(values)), (v) => v * scale);
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
/** 0 below `from`, 1 above `to`, smooth in between. */
const smoothStep = (from, to, value) => {
  const t = clamp((value - from) / (to - from), 0, 1);
  return t * t * (3 - 2 * t);
};

/** Slopes that make the cubics between keys monotone (Fritsch and Carlson), as in `interpolation.rs`, of `width` curves at once. */
function slopesOf(keys, width) {
  const slopes = new Float32Array(keys.length), last = keys.length - width;
  for (let n = 0; n < width; n++) {
    const secant = (k) => keys[k + width] - keys[k];
    for (let k = n; k <= last + n && last > 0; k += width) {
      if (k < width) slopes[k] = secant(k);
      else if (k >= last) slopes[k] = secant(k - width);
      else slopes[k] = secant(k - width) * secant(k) <= 0 ? 0 : (secant(k - width) + secant(k)) / 2;
    }
    for (let k = n; k < last; k += width) {
      const delta = secant(k);
      if (delta === 0) slopes[k] = slopes[k + width] = 0;
      else {
        const length = Math.hypot(slopes[k], slopes[k + width]) / Math.abs(delta);
        if (length > 3) {
          slopes[k] *= 3 / length;
          slopes[k + width] *= 3 / length;
        }
      }
    }
  }
  return slopes;
}
/** The cubic between two keys with these slopes. */
function cubic(from, to, m, n, t) {
  const v = 1 - t;
  return from * (1 + 2 * t) * v * v + m * t * v * v + to * t * t * (3 - 2 * t) - n * t * t * v;
}

class Motion {
  constructor(entry) {
    Object.assign(this, { name: entry.name, label: entry.label, kind: entry.kind, seconds: entry.seconds });
    Object.assign(this, { frames: entry.frames, fapus: entry.fapus, lids: entry.lids });
    this.offsets = scaled(entry.offsets);
    this.width = this.offsets.length / this.frames;
    this.folds = entry.folds;
    this.apexOffsets = this.offsets.subarray(entry.apex * this.width, (entry.apex + 1) * this.width);
    this.slopes = slopesOf(this.offsets, this.width);
    this.faps = entry.faps.map(([number, packed]) => {
      const values = scaled(packed);
      return { number, values, slopes: slopesOf(values, 1) };
    });
  }
  get last() {
    return this.frames - 1;
  }
  /** Writes the offsets at a position between frames, 0 to `last`, to `out`. */
  at(place, out) {
    const { offsets, slopes, width, last } = this;
    place = clamp(place, 0, last);
    const i = Math.min(Math.floor(place), Math.max(last - 1, 0)), t = place - i;
    for (let n = 0, a = i * width, b = a + width; n < width; n++, a++, b++) {
      out[n] = t === 0 ? offsets[a] : cubic(offsets[a], offsets[b], slopes[a], slopes[b], t);
    }
    return out;
  }
  /** Value of the curve of a FAP at a position between frames. */
  value({ values, slopes }, place) {
    const i = Math.min(Math.floor(place), Math.max(this.last - 1, 0)), t = place - i;
    return t === 0 ? values[i] : cubic(values[i], values[i + 1], slopes[i], slopes[i + 1], t);
  }
  /** The position in words. */
  placeText(place) {
    if (this.kind === "model") return `${Math.round((100 * place) / Math.max(this.last, 1))} % of the way to the apex`;
    const seconds = (this.seconds * place) / Math.max(this.last, 1);
    return `frame ${Math.round(place) + 1} of ${this.frames}, ${seconds.toFixed(2)} s`;
  }
}

/** Growth of the folds of the first part's motion under all parts: 0 at neutral, 1 as at the apex of that motion. */
function foldGrowth(parts, { unit, most }) {
  const { source } = parts[0];
  const { apexOffsets: apex } = source;
  let along = 0, whole = 0;
  for (let k = 0; k < apex.length; k++) whole += apex[k] * apex[k];
  for (const part of parts) {
    // Both are in eye separations.
    const scale = (part.gain * source.fapus[unit]) / part.source.fapus[unit];
    for (let k = 0; k < apex.length; k++) along += scale * part.offsets[k] * apex[k];
  }
  return whole > 0 ? clamp(along / whole, 0, most) : 0;
}

/** The course of time: from a clock (s) to the share of the motion, 0 to 1, and whether it has ended. */
class Course {
  constructor(seconds, repeat, natural) {
    this.way = Math.max(seconds, 0.04);
    this.repeat = repeat;
    this.natural = natural;
    this.before = natural ? 0.35 : 0;
    this.hold = repeat === "once" ? 0 : natural ? 0.9 : 0.4;
    this.back = repeat === "back" ? this.way * (natural ? 1.4 : 1) : 0;
    this.whole = this.before + this.way + this.hold + this.back;
  }
  ease(t) {
    return this.natural ? t * t * (3 - 2 * t) : t;
  }
  share(clock) {
    if (this.repeat === "once" && clock >= this.before + this.way) return { share: 1, over: true };
    const t = (clock % this.whole) - this.before;
    if (t <= 0) return { share: 0, over: false };
    if (t < this.way) return { share: this.ease(t / this.way), over: false };
    if (t < this.way + this.hold || this.back === 0) return { share: 1, over: false };
    return { share: this.ease(1 - (t - this.way - this.hold) / this.back), over: false };
  }
  /** The clock at which a share is reached on the way forward. */
  clock(share) {
    let low = 0, high = 1;
    for (let k = 0; k < 30; k++) {
      const middle = (low + high) / 2;
      if (this.ease(middle) < share) low = middle;
      else high = middle;
    }
    return share <= 0 ? 0 : this.before + this.way * high;
  }
}
