// Draws on a canvas, triangle by triangle, without WebGL: the same order, a simpler mouth, lids without grain, and lashes as a shade.

// Number of cells from the upper to the lower end of a closing lid, and of its line of lashes.
const LID_ROWS = 14, LASH_ROWS = 10;

class FlatStage {
  constructor(canvas, teeth) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.teeth = teeth;
    this.lids = new Map();
  }
  /** Draws the part of the picture in one triangle into another. */
  triangle(image, [a, b, c], [p, q, r]) {
    const { context } = this;
    const area = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]);
    if (Math.abs(area) < 1e-3) return;
    const solve = (axis) => {
      const [u, v] = [b[axis] - a[axis], c[axis] - a[axis]];
      const x = (u * (r[1] - p[1]) - v * (q[1] - p[1])) / area, y = (v * (q[0] - p[0]) - u * (r[0] - p[0])) / area;
      return [x, y, a[axis] - x * p[0] - y * p[1]];
    };
    const [[m11, m12, dx], [m21, m22, dy]] = [solve(0), solve(1)];
    // Slightly enlarged, so that no seam shows between neighbours.
    const middle = [(a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3];
    const grown = [a, b, c].map(([x, y]) => {
      const far = Math.max(Math.hypot(x - middle[0], y - middle[1]), 1e-6);
      return [x + (0.7 * (x - middle[0])) / far + 0.5, y + (0.7 * (y - middle[1])) / far + 0.5];
    });
    context.save();
    context.beginPath();
    grown.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
    context.clip();
    context.transform(m11, m21, m12, m22, dx, dy);
    context.drawImage(image, 0, 0);
    context.restore();
  }
  outline(points) {
    this.context.beginPath();
    points.forEach(([x, y], k) => (k ? this.context.lineTo(x + 0.5, y + 0.5) : this.context.moveTo(x + 0.5, y + 0.5)));
    this.context.closePath();
  }
  draw(rig) {
    const { canvas, context } = this;
    if (canvas.width !== rig.width || canvas.height !== rig.height) {
      canvas.width = rig.width;
      canvas.height = rig.height;
    }
    if (rig.kind === "head") return this.head(rig);
    const picture = this.withLids(rig);
    context.drawImage(picture, 0, 0);
    const { vertices, moved, skin } = rig;
    const point = (list, v) => [list[2 * v], list[2 * v + 1]];
    const loose = (triangles, at) => {
      for (let k = 0; k < triangles.length; k += 3) {
        const corners = triangles.slice(k, k + 3);
        this.triangle(rig.image, corners.map((v) => at.get(v)), corners.map((v) => point(vertices, v)));
      }
    };
    for (const opening of rig.openings.slice(1)) loose(opening.triangles, rig.eyeball(opening));
    this.mouth(rig, loose);
    for (let k = 0; k < skin.length; k += 3) {
      const corners = [skin[k], skin[k + 1], skin[k + 2]];
      if (corners.some((v) => Math.abs(moved[2 * v] - vertices[2 * v]) + Math.abs(moved[2 * v + 1] - vertices[2 * v + 1]) > 0.03)) {
        this.triangle(picture, corners.map((v) => point(moved, v)), corners.map((v) => point(vertices, v)));
      }
    }
    this.shutLids(rig);
    for (const opening of rig.openings.slice(1)) this.lashes(rig, opening);
  }
  /** Draws the line of lashes cell by cell; single lashes are a shade. */
  lashes(rig, opening) {
    const { columns, shut } = rig.lashColumns(opening), { above, below, hair, share } = rig.shared.lashLine;
    if (!(shut > 0)) return;
    this.cells(columns, LASH_ROWS, (along, off) => {
      const core = 1 - (off < 0 ? smoothStep(...above, -off) : smoothStep(...below, off));
      const single = off < 0 ? 0 : 0.5 * share * (1 - smoothStep(...hair, off));
      return [opening.lashes, shut * Math.sqrt(Math.max(4 * along * (1 - along), 0)) * Math.max(core, single)];
    });
  }
  /** Draws closing lids over the eyes, cell by cell. */
  shutLids(rig) {
    const { zone, form: [brightest, lower, beside, sides] } = rig.shared.shutLid;
    for (const entry of rig.bareLids().filter(({ shut }) => shut > 0)) {
      const { columns, share: shut } = rig.shutLid(entry);
      this.cells(columns, LID_ROWS, (along, t) => {
        const ends = smoothStep(0, sides, along) * (1 - smoothStep(1 - sides, 1, along));
        const light = 1 - lower * ((t - brightest) / (1 - brightest)) ** 2 - beside * (2 * along - 1) ** 2;
        const share = shut * ends * smoothStep(zone[0], zone[1], t) * (1 - smoothStep(zone[2], zone[3], t));
        return [entry.lid.shut.map((level) => level * light), share];
      });
    }
  }
  /** Fills the rows of cells between columns. Each column is given by its two ends: [x, y, ..., along, down]. `paint` gives the levels of a cell and its opacity. */
  cells(columns, rows, paint) {
    const { context } = this;
    const at = ([top, bottom], share) => top.map((value, k) => value + (bottom[k] - value) * share);
    for (let k = 1; k < columns.length; k++) {
      for (let row = 0; row < rows; row++) {
        const corners = [columns[k - 1], columns[k]].flatMap((column) => [at(column, row / rows), at(column, (row + 1) / rows)]);
        const [along, down] = [-2, -1].map((place) => corners.reduce((sum, corner) => sum + corner[corner.length + place] / 4, 0));
        const [levels, cover] = paint(along, down);
        context.fillStyle = `rgb(${levels.map(Math.round).join(" ")} / ${clamp(cover, 0, 1)})`;
        this.outline([0, 2, 3, 1].map((corner) => corners[corner]));
        context.fill();
      }
    }
  }
  /** The picture with the skin of closing lids over it. */
  withLids(rig) {
    const shutting = rig.bareLids().filter(({ shut }) => shut > 0), { width, height } = rig;
    if (!shutting.length) return rig.image;
    if (!this.lids.has(rig)) {
      const skin = node("canvas", { width, height });
      skin.getContext("2d").putImageData(rig.lidPictures().skin, 0, 0);
      this.lids.set(rig, { skin, mixed: node("canvas", { width, height }) });
    }
    const { skin, mixed } = this.lids.get(rig), context = mixed.getContext("2d");
    context.globalAlpha = 1;
    context.drawImage(rig.image, 0, 0);
    for (const { lid: { box: [x, y, w, h] }, shut } of shutting) {
      context.globalAlpha = shut;
      context.drawImage(skin, x, y, w, h, x, y, w, h);
    }
    return mixed;
  }
  /** Draws a head from back to front, each triangle in one shade. */
  head(rig) {
    const { canvas, context } = this;
    const style = (colour, light) => `rgb(${colour.map((c) => Math.round(255 * clamp(c * light, 0, 1))).join()})`;
    context.fillStyle = style(HEAD_BACKGROUND, 1);
    context.fillRect(0, 0, canvas.width, canvas.height);
    const list = [];
    const add = ({ moved: p, triangles, colours }, colour) => {
      for (let k = 0; k < triangles.length; k += 3) {
        const [a, b, c] = [3 * triangles[k], 3 * triangles[k + 1], 3 * triangles[k + 2]];
        const u = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]], v = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
        const n = [u[2] * v[1] - u[1] * v[2], u[0] * v[2] - u[2] * v[0], u[1] * v[0] - u[0] * v[1]];
        if (n[2] <= 0) continue;
        const towards = ([x, y, z]) => Math.max((n[0] * x + n[1] * y + n[2] * z) / (Math.hypot(...n) || 1), 0);
        const mean = colours && [0, 1, 2].map((axis) => (colours[a + axis] + colours[b + axis] + colours[c + axis]) / 3);
        list.push({ z: p[a + 2] + p[b + 2] + p[c + 2], at: [p[a], p[a + 1], p[b], p[b + 1], p[c], p[c + 1]], style: style(mean ?? colour, 0.34 + 0.7 * towards(HEAD_LIGHT) + 0.2 * towards(HEAD_FILL)) });
      }
    };
    add(rig, HEAD_SKIN);
    for (const eye of rig.eyes) add(eye);
    for (const corners of rig.cavities()) {
      for (let k = 0; k < corners.length; k += 3) {
        const [a, b, c] = corners.slice(k, k + 3);
        list.push({ z: a[2] + b[2] + c[2], at: [a[0], a[1], b[0], b[1], c[0], c[1]], style: style(HEAD_DARK, 1) });
      }
    }
    list.sort((a, b) => a.z - b.z);
    for (const { at: [ax, ay, bx, by, cx, cy], style: fill } of list) {
      context.fillStyle = context.strokeStyle = fill;
      context.beginPath();
      context.moveTo(ax, ay);
      context.lineTo(bx, by);
      context.lineTo(cx, cy);
      context.closePath();
      context.fill();
      context.stroke();
    }
  }
  mouth(rig, loose) {
    const { context, teeth } = this;
    const m = rig.mouth();
    if (!(m.gap > 1e-4)) return;
    const { upper, lower, triangles } = m.opening;
    const at = (v) => [rig.moved[2 * v], rig.moved[2 * v + 1]];
    context.save();
    this.outline([...upper.map(at), ...lower.slice(1, -1).reverse().map(at)]);
    const dark = rig.lip.map((c) => Math.round(c * 0.22));
    context.fillStyle = `rgb(${dark.join()})`;
    context.fill();
    if (rig.closed) {
      context.clip();
      const origin = [0, 1].map((axis) => (rig.nodes[2 * 87 + axis] + rig.nodes[2 * 40 + axis]) / 2 + m.skull[axis]);
      const size = (rig.unit / teeth.scale) * rig.teethSize, [dx, dy] = rig.down;
      // The axes of the mouth: horizontal, then vertical.
      context.transform(dy * size * m.wider, -dx * size * m.wider, dx * size, dy * size, origin[0] + m.incisors * rig.unit * dx, origin[1] + m.incisors * rig.unit * dy);
      context.filter = `brightness(${((rig.enamel[1] / teeth.white) * 0.86).toFixed(2)}) grayscale(${rig.tone.share.toFixed(2)})`;
      context.drawImage(rig.teethImage, -teeth.origin[0], -teeth.origin[1]);
    }
    context.restore();
    if (!rig.closed) loose(triangles, rig.ownMouth(m.skull));
  }
}
