// Single FAPs on a dense head: the non-negative mixture of its shapes that comes closest to what they ask, as `synthesize` finds it for a
// FAP file that sets only these (`solve/mod.rs`, `target.rs`).

class Mixture {
  constructor({ points, drivable, free, faps }, shapes) {
    Object.assign(this, { drivable, free });
    this.faps = new Map(faps.map((fap) => [fap.number, fap]));
    // Motion of the feature points in every shape: x and y of each.
    const places = new Map();
    wholes(points).forEach((vertex, point) => places.set(vertex, [...(places.get(vertex) ?? []), point]));
    this.basis = shapes.map(({ vertices, offsets }) => {
      const moved = new Float64Array(drivable.length);
      vertices.forEach((vertex, i) => {
        for (const point of places.get(vertex) ?? []) moved.set([offsets[3 * i], offsets[3 * i + 1]], 2 * point);
      });
      return moved;
    });
    this.last = { asked: "", weights: new Float64Array(shapes.length) };
  }
  /** Whether a mixture shows a FAP alone with this value. */
  shows(number, value) {
    return this.faps.get(number)?.shows[value > 0 ? 1 : 0] ?? false;
  }
  /** Weights of the shapes for FAPs with a value, a map from number to value. */
  weights(values) {
    const asked = JSON.stringify([...values].sort((a, b) => a[0] - b[0]));
    if (asked !== this.last.asked) this.last = { asked, weights: this.solve(values, this.last.weights) };
    return this.last.weights;
  }
  /** What is asked: for each axis of a feature point its weight (0 where nothing is known of it) and its target. */
  goal(values) {
    const { drivable, free, faps } = this, axes = drivable.length;
    const target = new Float64Array(axes), set = new Uint8Array(axes), near = new Set();
    const all = new Map(values);
    // Of the contours of the lips, one that is not set follows the other.
    for (const [number, value] of values) {
      const { twin } = faps.get(number);
      if (faps.has(twin) && !values.has(twin)) all.set(twin, value);
    }
    for (const [number, value] of all) {
      const fap = faps.get(number);
      for (const [point, ...offset] of fap.points) {
        offset.forEach((unit, axis) => {
          if (!unit) return;
          target[2 * point + axis] += value * unit;
          set[2 * point + axis] = 1;
        });
      }
      fap.near.forEach((point) => near.add(point));
    }
    const weights = new Float64Array(axes);
    for (let k = 0; k < axes; k++) {
      const point = k >> 1, isFree = drivable[k] && !set[k], isSet = set[2 * point] || set[2 * point + 1];
      if (isFree) weights[k] = near.has(point) ? free.near : free.far;
      else if (isSet) weights[k] = 1;
    }
    return { target, weights, near };
  }
  /** For each shape the squared motion of its points far from those that move, times the share of these in its motion. */
  elsewhere({ weights, near }) {
    return this.basis.map((motion) => {
      let far = 0, all = 0;
      for (let point = 0; point < motion.length / 2; point++) {
        if (!weights[2 * point] && !weights[2 * point + 1]) continue;
        const square = motion[2 * point] ** 2 + motion[2 * point + 1] ** 2;
        all += square;
        if (!near.has(point)) far += square;
      }
      return far ? (far * far) / all : 0;
    });
  }
  solve(values, warm) {
    const { basis, free: { ridge, elsewhere } } = this, n = basis.length, goal = this.goal(values), { target, weights } = goal;
    if (!target.some((v) => v)) return new Float64Array(n);
    const rows = basis.map((motion) => motion.map((v, k) => v * weights[k]));
    const product = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
    const gram = rows.map((a, i) => rows.slice(0, i + 1).map((b) => product(a, b)));
    const at = (i, j) => (j > i ? gram[j][i] : gram[i][j]);
    const right = rows.map((a) => product(a, target));
    const trace = gram.reduce((sum, row, i) => sum + row[i], 0);
    const extra = this.elsewhere(goal).map((square) => ridge * (trace / n) + elsewhere * square);
    // Coordinate descent; the ridge makes the minimum one.
    const z = Float64Array.from(warm), gradient = right.map((f, i) => f - z.reduce((sum, v, j) => sum + v * at(i, j), 0));
    for (let sweep = 0, most = 1; sweep < 1000 && most > 1e-6; sweep++) {
      most = 0;
      for (let i = 0; i < n; i++) {
        const step = Math.max((gradient[i] - extra[i] * z[i]) / (at(i, i) + extra[i]), -z[i]);
        if (!step) continue;
        z[i] += step;
        most = Math.max(most, Math.abs(step) / (1 + z[i]));
        for (let j = 0; j < n; j++) gradient[j] -= step * at(i, j);
      }
    }
    // The ridge shortens the motion.
    const moved = new Float64Array(target.length);
    rows.forEach((row, i) => row.forEach((v, k) => { moved[k] += z[i] * v; }));
    const square = product(moved, moved), along = product(moved, target);
    for (let i = 0; i < n && square > 0; i++) z[i] *= Math.max(along / square, 0);
    return z;
  }
}
