// A dense head: a mixture of its shapes by the weights of a motion and of single FAPs. A FAP that no mixture shows moves its
// feature points, and the skin between is interpolated. A head is drawn like a rig, but with depth.

// Largest weight of a shape for single FAPs.
const MOST_SHAPE = 3;

class Head {
  constructor(entry) {
    Object.assign(this, { label: entry.label, width: entry.width, height: entry.height, kind: "head" });
    this.rest = singles(entry.positions);
    this.moved = Float32Array.from(this.rest);
    this.normals = new Float32Array(this.rest.length);
    this.triangles = wholes(entry.triangles);
    if (entry.colours) this.colours = Float32Array.from(new Uint8Array(bytesOf(entry.colours)), (v) => v / 255);
    this.shapes = entry.shapes.map(({ vertices, offsets }) => ({ vertices: wholes(vertices), offsets: scaled(offsets) }));
    this.motions = entry.motions.map(({ frames, weights }) => ({ frames, weights: scaled(weights) }));
    this.faps = new Map(entry.faps.map(({ number, axis, offsets: { scale, values } }) => [number, { axis, offsets: Float32Array.from(new Int8Array(bytesOf(values)), (v) => v * scale) }]));
    this.mixture = new Mixture(entry.mixture, this.shapes);
    this.openings = entry.openings.map(wholes);
    this.eyes = entry.eyes.map((eye) => this.eye(eye));
  }
  /** An eyeball at rest: its colours and normals are computed once. */
  eye({ positions, triangles, centre: [x, y], iris }) {
    const at = singles(positions), count = at.length / 3, colours = new Float32Array(at.length);
    for (let v = 0; v < count; v++) {
      const far = Math.hypot(at[3 * v] - x, at[3 * v + 1] - y) / Math.max(iris, 1e-6);
      const colour = far < 0.42 ? [0.05, 0.05, 0.06] : far < 1 ? [0.29, 0.4, 0.46] : far < 1.12 ? [0.2, 0.24, 0.27] : [0.9, 0.88, 0.85];
      colours.set(colour, 3 * v);
    }
    const eye = { moved: at, triangles: wholes(triangles), colours, normals: new Float32Array(at.length) };
    normalsOf(eye);
    return eye;
  }
  /** Whether a single FAP moves the head: angles, such as those of the gaze, do not. */
  moves(fap) {
    return this.faps.has(fap.number);
  }
  /** Moves the head by motions with a position in time and a gain, and by FAPs with a value. */
  move(parts) {
    const { rest, moved, shapes, mixture } = this;
    const shares = new Float32Array(shapes.length), mixed = new Map();
    moved.set(rest);
    for (const { fap, source, place, gain } of parts) {
      if (fap) {
        const known = this.faps.get(fap.number);
        if (mixture.shows(fap.number, gain)) mixed.set(fap.number, gain);
        else if (known) for (let v = 0, k = known.axis; k < moved.length; v++, k += 3) moved[k] += gain * known.offsets[v];
        continue;
      }
      const { frames, weights } = this.motions[source.index];
      const at = (clamp(place, 0, source.last) / Math.max(source.last, 1)) * (frames - 1);
      const i = Math.min(Math.floor(at), Math.max(frames - 2, 0)), t = at - i, n = shapes.length;
      for (let m = 0; m < n; m++) {
        const from = weights[i * n + m], to = weights[Math.min(i + 1, frames - 1) * n + m];
        shares[m] += gain * (from + t * (to - from));
      }
    }
    // Far beyond its strength a shape folds the skin.
    const weights = mixture.weights(mixed), held = MOST_SHAPE / Math.max(MOST_SHAPE, ...weights);
    weights.forEach((weight, m) => { shares[m] += held * weight; });
    shapes.forEach(({ vertices, offsets }, m) => {
      const share = shares[m];
      if (Math.abs(share) < 1e-4) return;
      for (let i = 0, k = 0; i < vertices.length; i++) {
        for (let at = 3 * vertices[i], end = at + 3; at < end; at++, k++) moved[at] += share * offsets[k];
      }
    });
    normalsOf(this);
    return moved;
  }
  /** The dark area behind an opening: corners of a fan. */
  *cavities() {
    const { moved } = this;
    for (const walk of this.openings) {
      let [x, y, z, low, high] = [0, 0, 0, Infinity, -Infinity];
      for (const v of walk) {
        x += moved[3 * v] / walk.length;
        y += moved[3 * v + 1] / walk.length;
        z += moved[3 * v + 2] / walk.length;
        low = Math.min(low, moved[3 * v]);
        high = Math.max(high, moved[3 * v]);
      }
      const back = 0.25 * (high - low), corners = [];
      walk.forEach((v, k) => {
        const w = walk[(k + 1) % walk.length];
        for (const n of [v, w]) corners.push([moved[3 * n], moved[3 * n + 1], moved[3 * n + 2] - 0.02 * back]);
        corners.push([x, y, z - back]);
      });
      yield corners;
    }
  }
}

/** Normals of the vertices, from the areas of the triangles around them. */
function normalsOf({ moved: p, normals, triangles }) {
  normals.fill(0);
  for (let k = 0; k < triangles.length; k += 3) {
    const a = 3 * triangles[k], b = 3 * triangles[k + 1], c = 3 * triangles[k + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    // y points down, so the orientation is reversed.
    const x = uz * vy - uy * vz, y = ux * vz - uz * vx, z = uy * vx - ux * vy;
    for (const v of [a, b, c]) {
      normals[v] += x;
      normals[v + 1] += y;
      normals[v + 2] += z;
    }
  }
}

const HEAD_SKIN = [0.78, 0.58, 0.49], HEAD_DARK = [0.16, 0.07, 0.06], HEAD_BACKGROUND = [0.86, 0.87, 0.88];
const HEAD_LIGHT = [-0.42, -0.52, 0.74], HEAD_FILL = [0.74, -0.04, 0.67];
