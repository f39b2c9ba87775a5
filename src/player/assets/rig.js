// A face: positions of its nodes and of the vertices of its mesh. The steps are those of `clone` and `warp`, which give the reasons.

const LID_SHARES = [0.45, 1], LID_ABOUT = [0.2, 0.006], LIP_ROUND = 0.97, LIP_FULLNESS = 0.7, PARTED = [0.06, 0.2], STRETCHED = [0.03, 0.1], BROW_THICKNESS = [0.88, 1.12], BROWS = [[16, 18], [49, 51]], CORNERS = [[88, 31], [89, 64]], CORNER_TURN = 0.55, CORNER_LENGTHS = [0.6, 1.15];
const MAX_GAZE = 0.12, SHUT = 1e-4, BESIDE_MIDDLE = 1.35, UNFOLD_ROUNDS = 16, UNFOLD_STEP = 0.2, LEAST_WEIGHT = 0.002, OWN_STRETCH = 0.02;
const CLING = 0.12, CLING_WITHIN = 0.42, CLING_UPPER = 0.4, CLINGING = [0.04, 0.1, 0.22], TURNED_AWAY = [0.6, 0.9];

/** A face that moves. `level(p, k)` is the vertical position in the face of point k of a list. */
class Rig {
  constructor(entry, shared) {
    Object.assign(this, entry);
    for (const name of ["given", "nodes", "vertices", "leastAreas", "onSkin"]) this[name] = singles(entry[name]);
    this.skin = wholes(entry.skin);
    this.weights = scaled(entry.weights);
    this.shared = shared;
    this.count = this.vertices.length / 2;
    this.sparse();
    this.moved = Float32Array.from(this.vertices);
    this.offsets = new Float32Array(2 * entry.drivers.length);
    this.wanted = Float32Array.from(this.nodes);
    this.scales = new Map();
    this.folds = { growth: 0, source: null };
    this.lidSkins = entry.openings.map(({ lid }) => lid && new LidSkin(lid, this));
    this.hollows = entry.openings.map(({ hollow }, k) => hollow && new Hollow(hollow, this.lidSkins[k], this));
  }
  /** Whether a single FAP moves the face: all that the page offers do. */
  moves() {
    return true;
  }
  level(p, k) {
    return p[2 * k] * this.down[0] + p[2 * k + 1] * this.down[1];
  }
  shift(p, k, along) {
    p[2 * k] += this.down[0] * along;
    p[2 * k + 1] += this.down[1] * along;
  }
  /** The relevant weights of each vertex: far from a node its share is smaller than rounding errors. */
  sparse() {
    const n = this.drivers.length, [starts, places, shares] = [[0], [], []];
    for (let v = 0; v < this.count; v++) {
      for (let d = 0; d < n; d++) {
        const w = this.weights[v * n + d];
        if (Math.abs(w) >= LEAST_WEIGHT) {
          places.push(2 * d);
          shares.push(w);
        }
      }
      starts.push(places.length);
    }
    Object.assign(this, { starts: Uint32Array.from(starts), places: Uint16Array.from(places), shares: Float32Array.from(shares) });
  }
  /** Factors on the offsets of all nodes, x and y alternating, from a source with these FAPUs to this face. */
  scaleFrom(source) {
    let scale = this.scales.get(source);
    if (!scale) {
      const { nodeFapus, lidPairs } = this.shared;
      const ratio = (k) => this.fapus[k] / source.fapus[k];
      scale = Float32Array.from(nodeFapus, ratio);
      lidPairs.forEach(([above, below], pair) => {
        for (const node of [above, below]) {
          const own = this.lids[pair], other = source.lids[pair];
          if (own > 0 && other > 0) scale[2 * node + 1] = own / other;
        }
      });
      this.scales.set(source, scale);
    }
    return scale;
  }
  /** Moves the face by the sum of a list of offsets, each with its source and strength. */
  move(parts) {
    const { given, nodes, wanted, roll, shared } = this;
    this.folds = { source: parts[0].source, growth: foldGrowth(parts, shared.folds) };
    const [cos, sin] = [Math.cos(roll), Math.sin(roll)];
    const at = Float32Array.from(given);
    for (const { offsets, source, gain } of parts) {
      const scale = this.scaleFrom(source);
      for (let k = 0; k < at.length; k += 2) {
        const x = offsets[k] * scale[k] * gain, y = offsets[k + 1] * scale[k + 1] * gain;
        at[k] += cos * x - sin * y;
        at[k + 1] -= sin * x + cos * y;
      }
    }
    this.keepCorners(at);
    const parted = smoothStep(...PARTED, (this.level(at, 40) - this.level(at, 87)) / this.unit);
    this.roundLip(at, 40, [83, 84], [88, 89], 1, parted, LIP_ROUND);
    this.roundLip(at, 87, [81, 82], [88, 89], -1, 0, LIP_ROUND);
    this.roundLip(at, 8, [85, 86], [31, 64], 1, 0, null);
    this.stretchUpperLip(at);
    this.archLids(at);
    for (let k = 0; k < at.length; k++) wanted[k] = nodes[k] + (at[k] - given[k]);
    this.keepBrows(wanted);
    this.closeLids(wanted);
    this.separate(wanted);
    this.solve(wanted);
    for (let round = 0; round < UNFOLD_ROUNDS && this.unfold(wanted); round++) {
      this.separate(wanted);
      this.solve(wanted);
    }
    return this.moved;
  }
  /** Moves the ends of the opening with the corners of the mouth. */
  keepCorners(at) {
    const { given } = this;
    for (const [inner, outer] of CORNERS) {
      const way = (points) => [0, 1].map((axis) => points[2 * outer + axis] - points[2 * inner + axis]);
      const [was, is] = [way(given), way(at)];
      const length = Math.hypot(...was);
      if (!(length > 0)) continue;
      const turn = clamp(Math.atan2(was[0] * is[1] - was[1] * is[0], was[0] * is[0] + was[1] * is[1]), -CORNER_TURN, CORNER_TURN);
      const scale = clamp(Math.hypot(...is) / length, ...CORNER_LENGTHS);
      const [cos, sin] = [Math.cos(turn) * scale, Math.sin(turn) * scale];
      at[2 * inner] = at[2 * outer] - (cos * was[0] - sin * was[1]);
      at[2 * inner + 1] = at[2 * outer + 1] - (sin * was[0] + cos * was[1]);
    }
  }
  /**
   * Opens lips to a round shape: `sign` is 1 for the lower lip, -1 for the upper one. `flat` is the removed share of the closed lip's bow.
   * `most` is the largest motion beside the middle, relative to the middle; null sets no limit.
   */
  roundLip(at, centre, sides, [first, last], sign, flat, most) {
    const { given } = this;
    const line = (this.level(given, first) + this.level(given, last)) / 2;
    const moved = (n) => sign * (this.level(at, n) - this.level(given, n) + flat * (this.level(given, n) - line));
    const corners = (moved(first) + moved(last)) / 2;
    const middle = moved(centre) - corners, beside = (moved(sides[0]) + moved(sides[1])) / 2 - corners;
    const apart = (a, b) => Math.hypot(given[2 * a] - given[2 * b], given[2 * a + 1] - given[2 * b + 1]);
    const width = apart(first, last), place = width > 0 ? Math.min(apart(...sides) / width, 1) : 0.5;
    const least = Math.min((1 - place * place) ** LIP_FULLNESS, LIP_ROUND);
    let share;
    if (middle > 0 && beside < least * middle) share = least;
    else if (most !== null && beside > 0 && beside > most * middle) share = most;
    else return;
    const round = (middle + 2 * share * beside) / (1 + 2 * share * share);
    this.shift(at, centre, sign * (round - middle));
    for (const n of sides) this.shift(at, n, sign * (share * round - beside));
  }
  /** Flattens the bow of the upper lip as the lips part. */
  stretchUpperLip(at) {
    const { given } = this;
    const parted = (this.level(at, 40) - this.level(at, 87)) / this.unit;
    const bow = Math.max(0, this.level(given, 87) - (this.level(given, 81) + this.level(given, 82)) / 2);
    const taken = bow * smoothStep(...STRETCHED, parted);
    this.shift(at, 87, (-taken * 2) / 3);
    for (const n of [81, 82]) this.shift(at, n, taken / 3);
  }
  /** Lids open and close as arches: beside its middle a lid moves as far as the eye is open there. */
  archLids(at) {
    const { given } = this;
    const moved = (n) => this.level(at, n) - this.level(given, n);
    for (const { iris, upperNodes, lowerNodes } of this.openings) {
      if (!iris.length) continue;
      const open = [1, 2, 3].map((k) => this.level(given, lowerNodes[k]) - this.level(given, upperNodes[k]));
      if (!(open[1] > 0)) continue;
      const [outer, inner] = [upperNodes[0], upperNodes[4]];
      const chord = [0, 1].map((axis) => given[2 * inner + axis] - given[2 * outer + axis]);
      const length = Math.max(chord[0] ** 2 + chord[1] ** 2, 1e-12);
      const shares = [open[0], open[2]].map((gap) => clamp(gap / open[1], ...LID_SHARES));
      for (const nodes of [upperNodes, lowerNodes]) {
        const beyond = [1, 2, 3].map((k) => {
          const n = nodes[k];
          const dot = chord[0] * (given[2 * n] - given[2 * outer]) + chord[1] * (given[2 * n + 1] - given[2 * outer + 1]);
          const along = clamp(dot / length, 0, 1);
          return moved(n) - moved(outer) * (1 - along) - moved(inner) * along;
        });
        const about = LID_ABOUT[0] * Math.abs(beyond[1]) + LID_ABOUT[1] * this.unit;
        [0, 2].forEach((k, side) => {
          const arch = shares[side] * beyond[1];
          this.shift(at, nodes[k + 1], clamp(beyond[k], arch - about, arch + about) - beyond[k]);
        });
      }
    }
  }
  keepBrows(wanted) {
    for (const [upper, lower] of BROWS) {
      const was = this.level(this.nodes, lower) - this.level(this.nodes, upper);
      const is = this.level(wanted, lower) - this.level(wanted, upper);
      if (was > 0) this.shift(wanted, lower, clamp(is, BROW_THICKNESS[0] * was, BROW_THICKNESS[1] * was) - is);
    }
  }
  /** A closing eye closes from corner to corner. */
  closeLids(wanted) {
    for (const { upperNodes, lowerNodes } of this.openings.slice(1)) {
      const gap = (points, k) => this.level(points, lowerNodes[k]) - this.level(points, upperNodes[k]);
      const middle = gap(this.nodes, 2);
      if (middle <= SHUT * this.unit) continue;
      const most = (BESIDE_MIDDLE * Math.max(gap(wanted, 2), 0)) / middle;
      for (const k of [1, 3]) {
        const whole = gap(this.nodes, k), excess = gap(wanted, k) - most * whole;
        if (most < 1 && whole > 0 && excess > 0) this.shift(wanted, upperNodes[k], excess);
      }
    }
  }
  separate(wanted) {
    for (const { upperNodes, lowerNodes } of this.openings) {
      for (let k = 1; k < 4; k++) {
        const missing = this.level(wanted, upperNodes[k]) - this.level(wanted, lowerNodes[k]);
        if (missing > 0) {
          this.shift(wanted, upperNodes[k], -missing / 2);
          this.shift(wanted, lowerNodes[k], missing / 2);
        }
      }
    }
  }
  solve(wanted) {
    const { drivers, offsets, starts, places, shares, vertices, moved, nodes, count } = this;
    const n = drivers.length;
    for (let d = 0; d < n; d++) {
      const node = drivers[d][0];
      offsets[2 * d] = wanted[2 * node] - nodes[2 * node];
      offsets[2 * d + 1] = wanted[2 * node + 1] - nodes[2 * node + 1];
    }
    for (let v = 0, k = 0; v < count; v++) {
      let x = 0, y = 0;
      for (const end = starts[v + 1]; k < end; k++) {
        x += shares[k] * offsets[places[k]];
        y += shares[k] * offsets[places[k] + 1];
      }
      moved[2 * v] = vertices[2 * v] + x;
      moved[2 * v + 1] = vertices[2 * v + 1] + y;
    }
    // Weights are rounded; the nodes are not.
    for (const [node, v] of drivers) {
      moved[2 * v] = vertices[2 * v] + wanted[2 * node] - nodes[2 * node];
      moved[2 * v + 1] = vertices[2 * v + 1] + wanted[2 * node + 1] - nodes[2 * node + 1];
    }
    const parted = (this.level(wanted, 40) - this.level(wanted, 87)) / this.unit;
    [STRETCHED, PARTED].forEach((limits, lip) => {
      const taken = smoothStep(...limits, parted);
      if (taken > 0) for (const [v, bow] of this.bows[lip]) this.shift(moved, v, -bow * taken);
    });
    this.cling(this.openings[0], wanted, parted);
    for (const opening of this.openings) this.meet(opening, wanted);
  }
  /** Near the corners of a mouth that a dropping lower lip opens slightly, the lips touch. */
  cling({ upper, lower }, wanted, parted) {
    const { moved, vertices, nodes, unit, down } = this;
    const clinging = smoothStep(0, CLINGING[0], parted) * (1 - smoothStep(CLINGING[1], CLINGING[2], parted));
    if (!(this.closed && clinging > 0)) return;
    const fell = (n) => this.level(wanted, n) - this.level(nodes, n);
    const reach = CLING * unit * clinging * smoothStep(...TURNED_AWAY, (fell(40) - fell(6)) / (parted * unit));
    if (!(reach > 0)) return;
    const [from, to] = [upper[0], upper[upper.length - 1]];
    const way = [0, 1].map((axis) => vertices[2 * to + axis] - vertices[2 * from + axis]), length = Math.max(way[0] ** 2 + way[1] ** 2, 1e-12);
    upper.forEach((a, k) => {
      const b = lower[k];
      if (a === b) return;
      const along = ((vertices[2 * a] - vertices[2 * from]) * way[0] + (vertices[2 * a + 1] - vertices[2 * from + 1]) * way[1]) / length;
      const touching = reach * (1 - smoothStep(0, CLING_WITHIN, Math.min(along, 1 - along)));
      const gap = (moved[2 * b] - moved[2 * a]) * down[0] + (moved[2 * b + 1] - moved[2 * a + 1]) * down[1];
      if (!(gap > 0 && touching > 0)) return;
      const closer = gap + touching - Math.hypot(gap, touching);
      this.shift(moved, a, CLING_UPPER * closer);
      this.shift(moved, b, (CLING_UPPER - 1) * closer);
    });
  }
  /** Edges of an opening that would cross each other meet. */
  meet({ upper, lower, eyeball, stops, upperNodes, lowerNodes }, wanted) {
    const { moved } = this;
    const shut = upperNodes.map((a, k) => this.level(wanted, lowerNodes[k]) - this.level(wanted, a) <= SHUT * this.unit);
    upper.forEach((a, k) => {
      const b = lower[k];
      const found = stops.findIndex((stop) => stop >= k), next = found < 0 ? 4 : found;
      const between = shut[next] && (stops[next] === k || shut[Math.max(next - 1, 0)]);
      if (a !== b && (between || this.level(moved, b) < this.level(moved, a))) {
        for (const axis of [0, 1]) {
          const middle = (moved[2 * a + axis] + moved[2 * b + axis]) / 2;
          moved[2 * a + axis] = middle;
          moved[2 * b + axis] = middle;
        }
      }
    });
    for (const [k, share, v] of eyeball) {
      for (const axis of [0, 1]) {
        const from = moved[2 * upper[k] + axis], to = moved[2 * lower[k] + axis];
        moved[2 * v + axis] = from + (to - from) * share;
      }
    }
  }
  /** Draws nodes at folded skin towards their neighbours; returns whether there were any. */
  unfold(wanted) {
    const { skin, leastAreas, moved, weights, drivers, neighbours, partners, offsets } = this;
    const n = drivers.length;
    let atFold = null;
    for (let k = 0, t = 0; k < skin.length; k += 3, t++) {
      const [a, b, c] = [2 * skin[k], 2 * skin[k + 1], 2 * skin[k + 2]];
      const area = (moved[b] - moved[a]) * (moved[c + 1] - moved[a + 1]) - (moved[b + 1] - moved[a + 1]) * (moved[c] - moved[a]);
      if (area >= leastAreas[t]) continue;
      atFold ??= new Uint8Array(n);
      for (let corner = 0; corner < 3; corner++) {
        const row = skin[k + corner] * n;
        for (let d = 0; d < n; d++) if (Math.abs(weights[row + d]) > 0.2) atFold[d] = 1;
      }
    }
    if (!atFold) return false;
    // Both sides of the face are treated alike.
    for (let d = 0; d < n; d++) if (atFold[d]) atFold[partners[d]] = 1;
    for (let d = 0; d < n; d++) {
      if (!atFold[d]) continue;
      for (const axis of [0, 1]) {
        let sum = 0;
        for (const other of neighbours[d]) sum += offsets[2 * other + axis];
        wanted[2 * drivers[d][0] + axis] += (sum / Math.max(neighbours[d].length, 1) - offsets[2 * d + axis]) * UNFOLD_STEP;
      }
    }
    return true;
  }
  /** Largest distance between the edges of an opening at these positions, px. */
  gap({ upper, lower }, positions) {
    return upper.reduce((most, a, k) => Math.max(most, this.level(positions, lower[k]) - this.level(positions, a)), 0);
  }
  /** Positions of the vertices of an eye's opening behind the lids: they move with the corners and the gaze. */
  eyeball(opening) {
    const { nodes, wanted, vertices, moved } = this;
    const { upper, lower, upperNodes, iris } = opening;
    const point = (list, k) => [list[2 * k], list[2 * k + 1]];
    const [p, q, r, s] = [point(nodes, upperNodes[0]), point(nodes, upperNodes[4]), point(wanted, upperNodes[0]), point(wanted, upperNodes[4])];
    const [px, py] = [q[0] - p[0], q[1] - p[1]], [rx, ry] = [s[0] - r[0], s[1] - r[1]];
    const size = px * px + py * py;
    const [re, im] = [(rx * px + ry * py) / size, (ry * px - rx * py) / size];
    const apply = ([x, y]) => [r[0] + re * (x - p[0]) - im * (y - p[1]), r[1] + im * (x - p[0]) + re * (y - p[1])];
    const middle = (list) => iris.reduce((m, k) => [m[0] + list[2 * k] / iris.length, m[1] + list[2 * k + 1] / iris.length], [0, 0]);
    const rest = apply(middle(nodes)), there = middle(wanted);
    let gaze = [there[0] - rest[0], there[1] - rest[1]];
    const far = Math.hypot(...gaze) / (MAX_GAZE * this.unit);
    if (far > 1) gaze = gaze.map((v) => v / far);
    const at = new Map();
    const stays = (v) => apply(point(vertices, v)).map((x, axis) => x + gaze[axis]);
    const high = ([x, y]) => x * this.down[0] + y * this.down[1];
    for (const [, , v] of opening.eyeball) at.set(v, stays(v));
    for (const [edge, sign] of [[upper, -1], [lower, 1]]) {
      for (const v of edge) {
        const still = stays(v), goes = point(moved, v);
        at.set(v, sign * (high(goes) - high(still)) > 0 ? goes : still);
      }
    }
    return at;
  }
  /** Numbers for drawing the inside of the mouth, in eye distances from the line where the closed lips meet on the skull. */
  mouth() {
    const opening = this.openings[0], { nodes, moved, unit, down } = this;
    const vertex = new Map(this.drivers);
    const shifted = (n) => (vertex.has(n) ? [moved[2 * vertex.get(n)] - nodes[2 * n], moved[2 * vertex.get(n) + 1] - nodes[2 * n + 1]] : [0, 0]);
    const skull = shifted(6), chin = shifted(10);
    const origin = [0, 1].map((axis) => (nodes[2 * 87 + axis] + nodes[2 * 40 + axis]) / 2 + skull[axis]);
    const across = [down[1], -down[0]];
    const place = (v) => {
      const [x, y] = [moved[2 * v] - origin[0], moved[2 * v + 1] - origin[1]];
      return [(x * across[0] + y * across[1]) / unit, (x * down[0] + y * down[1]) / unit];
    };
    const upper = opening.upper.map(place), lower = opening.lower.map(place);
    const jaw = Math.max(((chin[0] - skull[0]) * down[0] + (chin[1] - skull[1]) * down[1]) / unit, 0);
    // How far light falls on the inner edges of parting lips: see `lit` in src/warp/seam.rs.
    const along = ([x, y]) => x * down[0] + y * down[1], rest = [0, 1].map((axis) => nodes[2 * 40 + axis] - nodes[2 * 87 + axis]);
    const opened = along(rest) + along(shifted(40)) - along(shifted(87)), dropped = along(shifted(40)) - along(skull);
    const away = opened > 0 ? clamp((dropped / opened - 0.6) / 0.3, 0, 1) : 0, lit = 1 - away * away * (3 - 2 * away);
    const middle = (line) => lineAt([...line].sort((a, b) => a[0] - b[0]), 0);
    const floor = middle(lower), gap = this.gap(opening, moved) / unit;
    // Least visible length of the incisors between lips that a dropped jaw parts: see `SHOWN_DROPPED` in src/warp/mouth/interior.rs.
    const least = middle(upper) + Math.min(0.062, 0.66 * gap), incisors = this.inside[0] + Math.max(least - this.inside[0], 0) * (1 - lit);
    const ends = [upper[0][0], upper[upper.length - 1][0]].sort((a, b) => a - b);
    // Rows of teeth reach the corners of a mouth that is wider than a smile: see `ROW_REACHES` there.
    const wider = Math.max((0.5 * (ends[1] - ends[0])) / (0.48 * this.teethSize), 1);
    return { opening, upper, lower, jaw, lit, floor, ends, wider, skull, incisors, gap };
  }
  /**
   * Positions of the vertices of a mouth that is open in the photograph: they stay with the skull, except below a raised upper lip or a slightly dropped
   * lower lip.
   */
  ownMouth(skull) {
    const { vertices, moved } = this, { upper, lower } = this.openings[0];
    const at = new Map(), below = new Set(lower.slice(1, -1));
    for (const v of [...upper, ...lower]) {
      const stays = [vertices[2 * v] + skull[0], vertices[2 * v + 1] + skull[1]], lip = [moved[2 * v], moved[2 * v + 1]];
      const high = ([x, y]) => x * this.down[0] + y * this.down[1];
      const way = high(lip) - high(stays), share = below.has(v) ? (way > 0 ? Math.min(1, (OWN_STRETCH * this.unit) / way) : 0) : way > 0 ? 0 : 1;
      at.set(v, stays.map((value, axis) => value + (lip[axis] - value) * share));
    }
    return at;
  }
  /** The pose of the head by the line between the eyes: the new position of a position of the picture, and scale and rotation as a complex number. */
  head() {
    const eyes = (p) => this.openings.slice(1).map(({ upperNodes: [a, , , , b] }) => [0, 1].map((axis) => (p[2 * a + axis] + p[2 * b + axis]) / 2));
    const [[was, beside], [is, then]] = [eyes(this.nodes), eyes(this.wanted)];
    const [x, y, u, v] = [beside[0] - was[0], beside[1] - was[1], then[0] - is[0], then[1] - is[1]], square = Math.max(x * x + y * y, 1e-9);
    const [re, im] = [(u * x + v * y) / square, (v * x - u * y) / square];
    const turn = (a, b) => [re * a - im * b, im * a + re * b];
    const at = (a, b) => turn(a - was[0], b - was[1]).map((value, axis) => value + is[axis]);
    const back = (a, b) => [re * (a - is[0]) + im * (b - is[1]), re * (b - is[1]) - im * (a - is[0])].map((value, axis) => value / (re * re + im * im) + was[axis]);
    return { scale: Math.hypot(re, im), turn, at, back };
  }
  /** Factor by which a raised brow lengthens the distance from the lid to itself. */
  drawnOut({ upperNodes: [outer, , node, , inner], brow }) {
    const { nodes, wanted } = this, corners = [outer, inner];
    const middle = (p, [a, b]) => [0, 1].map((axis) => (p[2 * a + axis] + p[2 * b + axis]) / 2);
    const way = (p, pair, to) => Math.hypot(...[0, 1].map((axis) => middle(p, pair)[axis] - middle(p, to)[axis]));
    return 1 + (way(wanted, brow, corners) / Math.max(this.head().scale, 1e-9) - way(nodes, brow, corners)) / Math.max(way(nodes, brow, [node, node]), 1e-9);
  }
  /** The hollows stretched by brows, and the removed share of their shade. */
  drawnOutHollows() {
    const drawn = this.hollows.map((hollow, k) => hollow && { hollow, gone: hollow.gone(this.drawnOut(this.openings[k])) });
    return drawn.filter((entry) => entry?.gone > 0);
  }
  /**
   * The lids whose skin is drawn without lashes: how far because they close, and because lashes are drawn separately below raised brows (0 to 1; the
   * more, the larger `gone`).
   */
  bareLids() {
    const { lidSkins, openings, moved, vertices, shared: { lidSkin } } = this;
    const bare = lidSkins.map((lid, k) => {
      if (!lid) return { gone: 0 };
      const opening = openings[k];
      const shut = smoothStep(...lidSkin.shut, 1 - this.gap(opening, moved) / Math.max(this.gap(opening, vertices), 1e-9));
      const stands = smoothStep(...lidSkin.drawnOut, this.drawnOut(opening)) * (1 - shut);
      return { opening, lid, shut, stands, gone: Math.max(shut, stands) };
    });
    return bare.filter(({ gone }) => gone > 0);
  }
  /** Separate lashes as triangles: corners from strip to strip, each [x, y, from x, from y, opacity]. */
  lashStrips({ opening: { upper }, lid, stands }) {
    const { vertices, moved, down, shared } = this, { beyond } = shared.lidSkin;
    const margin = (p) => {
      const line = upper.map((v) => [p[2 * v], p[2 * v + 1]]), [first, last] = [line[0], line[line.length - 1]];
      const off = [0, 1].map((axis) => beyond * (last[axis] - first[axis]));
      return [[first[0] - off[0], first[1] - off[1]], ...line, [last[0] + off[0], last[1] + off[1]]];
    };
    const [from, to] = [margin(vertices), margin(moved)], corners = [];
    const corner = (k, up) => [to[k], from[k]].flatMap(([x, y]) => [x - up * lid.above * down[0], y - up * lid.above * down[1]]).concat(stands);
    for (let k = 1; k < from.length; k++) corners.push(corner(k - 1, 0), corner(k, 0), corner(k, 1), corner(k - 1, 0), corner(k, 1), corner(k - 1, 1));
    return corners;
  }
  /** A closing lid for drawing: both ends of each column, as [x, y, from x, from y, share along, share of the motion of the margin]; and the degree of closing. */
  shutLid({ opening, lid, shut }) {
    const { moved, down, unit, shared: { shutLid: { zone, leastWay, below } } } = this, head = this.head(), least = leastWay * unit;
    const margin = Array.from(opening.upper, (v) => {
      const [along, is] = lid.place(...head.back(moved[2 * v], moved[2 * v + 1]));
      return { along, is, was: lid.edgeAt(along) };
    });
    // Below the margin of an open eye is the eye, which is already drawn.
    const end = this.gap(opening, moved) > 0.5 ? zone[2] : zone[3];
    const columns = margin.map(({ along, was, is }) => [zone[0], end].map((t) => {
      const height = was - t * Math.max(was - is, least);
      const at = [0, 1].map((axis) => lid.from[axis] + lid.across[axis] * along - down[axis] * height);
      return [...head.at(...at), ...at.map((value, axis) => value + down[axis] * below * unit), along, t];
    }));
    return { columns, share: shut * smoothStep(0, least, Math.max(...margin.map(({ was, is }) => was - is))) };
  }
  /** The skin of both lids over the picture, and their lashes, created when they are first needed. */
  lidPictures() {
    this.lidPixels ??= lidPictures(this);
    return this.lidPixels;
  }
  /**
   * The line of lashes of a shutting eye: both ends of each column, as [x, y, share along, widths below its middle]; degree of
   * closing (0 to 1); its length.
   */
  lashColumns(opening) {
    const { moved, vertices, unit, down, shared: { lashLine: { closing, meeting, width, leastWidth, corners, above, hair } } } = this;
    const open = this.gap(opening, moved) / Math.max(this.gap(opening, vertices), 1e-9);
    const shut = clamp((closing[0] - open) / (closing[0] - closing[1]), 0, 1), lower = 0.5 * clamp(1 - open / meeting, 0, 1);
    const mixed = (a, b) => moved[a] + (moved[b] - moved[a]) * lower;
    const line = Array.from(opening.upper, (a, k) => [0, 1].map((axis) => mixed(2 * a + axis, 2 * opening.lower[k] + axis)));
    const [from, to] = [line[0], line[line.length - 1]];
    const across = [to[0] - from[0], to[1] - from[1]], size = across[0] * down[1] - across[1] * down[0];
    const columns = line.map(([x, y]) => {
      const along = clamp(((x - from[0]) * down[1] - (y - from[1]) * down[0]) / size, 0, 1) || 0;
      const local = Math.max(width * unit, leastWidth) * (corners + (1 - corners) * 4 * along * (1 - along));
      return [-above[1], hair[1]].map((off) => [x + off * local * down[0], y + off * local * down[1], along, off]);
    });
    return { columns, shut, length: Math.hypot(...across) };
  }
}

/** Strips along both edges of an opening, from the edge slightly inwards: triangles as [x, y, from x, from y, opacity]. */
function edgeStrips(rig, { upper, lower }, width) {
  const corners = [], [dx, dy] = rig.down;
  for (const [edge, sign] of [[upper, 1], [lower, -1]]) {
    const side = (k, inner) => {
      const v = 2 * edge[k], by = inner * sign * width;
      return [rig.moved[v] + dx * by, rig.moved[v + 1] + dy * by, rig.vertices[v], rig.vertices[v + 1], 1 - inner];
    };
    for (let k = 1; k < edge.length; k++) {
      corners.push(side(k - 1, 0), side(k, 0), side(k - 1, 1), side(k - 1, 1), side(k, 0), side(k, 1));
    }
  }
  return corners;
}

/** Height of a line of points at x; beyond its ends, that of the end. */
function lineAt(line, x) {
  for (let k = 1; k < line.length; k++) {
    const [a, b] = [line[k - 1], line[k]];
    if (x <= b[0]) return a[1] + ((b[1] - a[1]) * clamp(x - a[0], 0, b[0] - a[0])) / Math.max(b[0] - a[0], 1e-9);
  }
  return line[line.length - 1][1];
}
