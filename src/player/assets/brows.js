// Effect of raised brows on the skin around them: the hollow below them is stretched and loses its shade; the furrows of the forehead deepen. The steps
// are those of `warp/hollow.rs` and `warp/furrows.rs`, which give the reasons.

/** The box around points, slightly enlarged. */
const boxOf = (points, more = 2) => [0, 1].map((axis) => Math.min(...points.map((p) => p[axis])) - more).concat([0, 1].map((axis) => Math.max(...points.map((p) => p[axis])) + more));

/** Triangles of the skin that overlap a box of the picture. */
const trianglesInBox = (rig, [left, top, right, bottom]) => trianglesIn(rig, (p) => p, [left, right], [top, bottom]);

/** The shade between a brow and an upper lid, in the coordinates of the lid's skin. */
class Hollow {
  constructor({ brow, logs }, lid, rig) {
    Object.assign(this, { brow: singles(brow), logs: singles(logs), lid, look: rig.shared.hollow });
    const { along: [first, last], columns } = this.look, { from, across, down } = lid;
    const at = (along, height) => [0, 1].map((axis) => from[axis] + across[axis] * along - down[axis] * height);
    const points = Array.from(this.brow, (brow, k) => first + ((last - first) * k) / (columns - 1)).flatMap((along, k) => [at(along, lid.edgeAt(along)), at(along, this.brow[k])]);
    this.box = boxOf(points);
    this.triangles = trianglesInBox(rig, this.box);
  }
  /** Darkness of a position of the picture compared with bright skin: three logarithms, at most 0. */
  log(x, y) {
    const { brow, logs, lid, look: { along: [first, last], columns, rows } } = this;
    const [along, height] = lid.place(x, y), column = ((along - first) / (last - first)) * (columns - 1);
    if (!(column >= 0 && column <= columns - 1)) return [0, 0, 0];
    const cell = (place, count) => [clamp(Math.floor(place), 0, count - 2), place - clamp(Math.floor(place), 0, count - 2)];
    const [k, t] = cell(column, columns), edge = lid.edgeAt(along);
    const row = ((height - edge) / Math.max(brow[k] + (brow[k + 1] - brow[k]) * t - edge, 1e-6)) * (rows - 1);
    if (!(row >= 0 && row <= rows - 1)) return [0, 0, 0];
    const [m, u] = cell(row, rows), at = (row, column, c) => logs[3 * (row * columns + column) + c];
    const beside = (row, c) => at(row, k, c) + (at(row, k + 1, c) - at(row, k, c)) * t;
    return [0, 1, 2].map((c) => beside(m, c) + (beside(m + 1, c) - beside(m, c)) * u);
  }
  /** Share of the shade that is removed when the distance from lid to brow has grown by this factor. */
  gone(drawnOut) {
    return Math.min(this.look.lighter * (1 - 1 / Math.max(drawnOut, 1)), this.look.most);
  }
}

/** The shade of a hollow as a picture; 255 is darkest. */
function shadePicture(hollow, { width, height, shared }) {
  const shade = new ImageData(width, height);
  for (let k = 3; k < shade.data.length; k += 4) shade.data[k] = 255;
  const [left, top, right, bottom] = hollow.box.map((v, k) => clamp(Math.round(v), 0, k % 2 ? height : width));
  for (let y = top; y < bottom; y++) {
    for (let x = left; x < right; x++) {
      hollow.log(x, y).forEach((log, c) => (shade.data[4 * (y * width + x) + c] = (255 * log) / shared.hollow.darkest));
    }
  }
  return shade;
}

/** The furrows of a forehead: a separate picture on a grid whose first cell is at `from`. */
class Furrows {
  constructor({ from, across, up, image }, rig) {
    Object.assign(this, { from, across, up, image, rig });
    this.size = [image.naturalWidth, image.naturalHeight];
    const [w, h] = this.size, corner = (x, y) => [0, 1].map((axis) => from[axis] + across[axis] * x + up[axis] * y);
    this.triangles = trianglesInBox(rig, boxOf([corner(0, 0), corner(w, 0), corner(0, h), corner(w, h)], 0));
  }
  /** The cell of a position. */
  cell(x, y) {
    const off = [x - this.from[0], y - this.from[1]];
    return [this.across, this.up].map((step) => (off[0] * step[0] + off[1] * step[1]) / (step[0] * step[0] + step[1] * step[1]));
  }
  /** Deepening of the furrows for each part of the brows: [cell across, depth]. */
  depths() {
    const { nodes, wanted, down, unit, shared: { furrows: { parts, deepen, most } } } = this.rig;
    const { scale, turn, at } = this.rig.head(), up = turn(-down[0], -down[1]);
    const mean = (list) => list.reduce((sum, v) => sum + v, 0) / list.length;
    return parts.map((part) => {
      const rises = part.map((n) => at(nodes[2 * n], nodes[2 * n + 1]).map((stays, axis) => (wanted[2 * n + axis] - stays) * up[axis]));
      const rise = mean(rises.map(([x, y]) => x + y)) / Math.max(scale * scale, 1e-9) / unit;
      return [this.cell(...[0, 1].map((axis) => mean(part.map((n) => nodes[2 * n + axis]))))[0], clamp(deepen * rise, 0, most)];
    });
  }
}
