// The skin of upper lids without lashes, for closing eyes and for raised brows, and the lashes separately. The steps are those of `warp/lid_skin.rs` and
// `warp/lashes.rs`, which give the reasons. What they replace depends only on the position in the picture, so both are separate pictures that are drawn
// over it.

const luma = (r, g, b) => 0.3 * r + 0.59 * g + 0.11 * b;

/** Triangles of the skin that overlap a box. `place` maps their corners to two coordinates, each with a range. */
function trianglesIn({ skin, vertices }, place, ...ranges) {
  const found = [];
  for (let k = 0; k < skin.length; k += 3) {
    const three = [skin[k], skin[k + 1], skin[k + 2]], at = three.map((v) => place([vertices[2 * v], vertices[2 * v + 1]]));
    if (ranges.every(([least, most], axis) => at.some((p) => p[axis] > least) && at.some((p) => p[axis] < most))) found.push(...three);
  }
  return Uint16Array.from(found);
}

class LidSkin {
  constructor({ from, across, edge, band, fade, skin, shut }, rig) {
    Object.assign(this, { from, across, fade, shut, down: rig.down, unit: rig.unit, look: rig.shared.lidSkin });
    Object.assign(this, { edge: singles(edge), band: singles(band), skin: singles(skin) });
    this.places = this.edge.length;
    this.strips = this.look.strips.map((off) => (off * this.unit) / Math.hypot(...across));
    // Bilinear sampling reads a pixel beyond the edge.
    this.below = Math.max(0.5 * this.look.leastBand * this.unit, 1);
    this.above = Math.max(...this.band) + fade;
    this.reach(rig);
  }
  /** Share of the way from the outer to the inner corner, and height above the line between them, px. */
  place(x, y) {
    const { from, across, down } = this;
    const [ox, oy] = [x - from[0], y - from[1]], size = across[0] * down[1] - across[1] * down[0];
    return [(ox * down[1] - oy * down[0]) / size, (across[1] * ox - across[0] * oy) / size];
  }
  /** Height of the lid at a position along it, px; beyond its ends, the height there. */
  edgeAt(along) {
    const { edge, places } = this, place = clamp(along * places - 0.5, 0, places - 1), k = Math.min(Math.floor(place), places - 2);
    return edge[k] + (edge[k + 1] - edge[k]) * (place - k);
  }
  /** The part of the picture that it covers, and the triangles of the skin that overlap this part. */
  reach({ skin, vertices, width, height }) {
    const { from, across, down, places, edge, band, fade, below } = this;
    const ends = [-0.5 / places, 1 + 0.5 / places];
    const low = Math.min(...edge) - below, high = Math.max(...edge.map((v, k) => v + band[k])) + fade;
    const corners = ends.flatMap((along) => [low, high].map((up) => [0, 1].map((axis) => from[axis] + across[axis] * along - down[axis] * up)));
    const bounds = (axis, size) => {
      const list = corners.map((p) => p[axis]);
      const first = clamp(Math.floor(Math.min(...list)) - 2, 0, size);
      return [first, clamp(Math.ceil(Math.max(...list)) + 3, first, size) - first];
    };
    const [[x, w], [y, h]] = [bounds(0, width), bounds(1, height)];
    this.box = [x, y, w, h];
    this.triangles = trianglesIn({ skin, vertices }, (p) => this.place(...p), ends, [low, high]);
  }
  /** Red, green and blue levels at a position of the picture, and their opacity over a closed lid. */
  colour(x, y, sample) {
    const { band: bands, fade, skin, places, down, look } = this;
    const [along, height] = this.place(x, y);
    const place = along * places - 0.5, k = clamp(Math.floor(place), 0, places - 2), t = clamp(place - k, 0, 1);
    const between = (list, step = 1, c = 0) => list[step * k + c] + (list[step * (k + 1) + c] - list[step * k + c]) * t;
    const above = height - this.edgeAt(along), band = between(bands);
    const inside = smoothStep(...look.ends[0], along) * (1 - smoothStep(...look.ends[1], along));
    const isOut = place < -1 || place > places || above < -this.below;
    const share = isOut ? 0 : inside * (1 - smoothStep(band, band + fade, above));
    const guess = [0, 1, 2].map((c) => between(skin, 3, c));
    const missing = Math.max(band - above, 0), rise = look.folded * missing + missing + 0.5 * fade;
    const strips = this.strips.map((off) => sample(x - down[0] * rise + this.across[0] * off, y - down[1] * rise + this.across[1] * off));
    const beyond = [0, 1, 2].map((c) => strips.reduce((sum, colour) => sum + colour[c], 0) / strips.length);
    const grain = look.grain * smoothStep(...look.clear, luma(...beyond) / Math.max(luma(...guess), 1));
    return [...guess.map((v, c) => v + (beyond[c] - v) * grain), 255 * share];
  }
}

/** The skin of the lids of a face as a picture to be drawn over its own, and the lashes as a picture by which the skin is multiplied. */
function lidPictures(rig) {
  const { width, height } = rig, { darkest, floor } = rig.shared.lidSkin;
  const context = node("canvas", { width, height }).getContext("2d", { willReadFrequently: true });
  context.drawImage(rig.image, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  const sample = (x, y) => {
    const [px, py] = [clamp(x, 0, width - 1), clamp(y, 0, height - 1)];
    const [left, top] = [Math.floor(px), Math.floor(py)], [fx, fy] = [px - left, py - top];
    const a = 4 * (top * width + left), right = left + 1 < width ? 4 : 0, under = top + 1 < height ? 4 * width : 0;
    const row = (k) => data[k] + (data[k + right] - data[k]) * fx;
    return [0, 1, 2].map((c) => row(a + c) + (row(a + under + c) - row(a + c)) * fy);
  };
  const skin = new ImageData(width, height), lashes = new ImageData(width, height);
  lashes.data.fill(255);
  for (const lid of rig.lidSkins) {
    if (!lid) continue;
    const [left, top, w, h] = lid.box;
    for (let y = top; y < top + h; y++) {
      for (let x = left; x < left + w; x++) {
        const at = 4 * (y * width + x);
        // Transparent pixels need a colour, too, because neighbours are blended with them; the colour of the other lid is kept.
        if (skin.data[at + 3]) continue;
        const colour = lid.colour(x, y, sample);
        skin.data.set(colour, at);
        for (let c = 0; c < 3; c++) {
          const own = data[at + c], bare = own + ((colour[c] - own) * colour[3]) / 255;
          lashes.data[at + c] = 255 * clamp((own + floor) / (bare + floor), darkest, 1);
        }
      }
    }
  }
  return { skin, lashes };
}
