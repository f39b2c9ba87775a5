// Figures on the face: heat map and displacement fields.

// ---- Colours: viridis, even in lightness and safe for colour-blind readers ----
const VIRIDIS = ["#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"];
const stops = VIRIDIS.map((hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)));
function viridis(u) {
  const x = Math.min(Math.max(u, 0), 1) * (stops.length - 1);
  const k = Math.min(Math.floor(x), stops.length - 2);
  return `rgb(${stops[k].map((c, i) => Math.round(c + (x - k) * (stops[k + 1][i] - c))).join(" ")})`;
}
const scattered = representatives.filter((r) => r.nodeDispersion);
const highest = Math.max(...scattered.flatMap((r) => r.nodeDispersion.map((v) => v ?? 0)), 1e-9);
const heatTicks = ticks(0, highest, 5);
const heatTop = heatTicks.step * Math.ceil(highest / heatTicks.step - 1e-9);

/** Fills every triangle with the colours of the values at its corners: linear in between, so a linear gradient is exact. */
function heatMap(box, p, values, view, most = heatTop) {
  const canvas = element("canvas", { "aria-hidden": "true" });
  const paint = () => {
    const { width, height } = box.getBoundingClientRect();
    if (width === 0) return;
    const density = Math.max(2, devicePixelRatio || 1);
    canvas.width = Math.round(width * density);
    canvas.height = Math.round(height * density);
    const [left, top, w, h] = viewBox(view);
    const scale = Math.min(canvas.width / w, canvas.height / h);
    const X = (k) => (p[2 * k] - left - w / 2) * scale + canvas.width / 2;
    const Y = (k) => (p[2 * k + 1] - top - h / 2) * scale + canvas.height / 2;
    const g = canvas.getContext("2d");
    g.lineWidth = 1;
    g.lineJoin = "round";
    for (const corners of triangles) {
      const [a, b, c] = [...corners].sort((i, j) => values[i] - values[j]);
      const [ax, ay, bx, by, cx, cy] = [X(a), Y(a), X(b), Y(b), X(c), Y(c)];
      const [u, v, w2] = [values[a], values[b], values[c]].map((x) => (x ?? 0) / most);
      const area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay);
      let style = viridis((u + v + w2) / 3);
      if (Math.abs(area) > 1e-6 && w2 - u > 1e-6) {
        const gx = ((v - u) * (cy - ay) - (w2 - u) * (by - ay)) / area;
        const gy = ((w2 - u) * (bx - ax) - (v - u) * (cx - ax)) / area;
        const length = (w2 - u) / (gx * gx + gy * gy);
        style = g.createLinearGradient(ax, ay, ax + gx * length, ay + gy * length);
        const count = Math.max(2, Math.ceil((w2 - u) * 24) + 1);
        for (let k = 0; k < count; k++) style.addColorStop(k / (count - 1), viridis(u + ((w2 - u) * k) / (count - 1)));
      }
      g.fillStyle = g.strokeStyle = style;
      g.beginPath();
      g.moveTo(ax, ay);
      g.lineTo(bx, by);
      g.lineTo(cx, cy);
      g.closePath();
      g.fill();
      g.stroke();
    }
  };
  paint();
  return { canvas, paint };
}

function colorBar(root, top = heatTop, unit = "dispersion per node, face units") {
  const gradient = VIRIDIS.map((c, k) => `${c} ${(100 * k) / (VIRIDIS.length - 1)}%`).join(", ");
  const marks = element("div", { class: "marks" });
  const { list, digits } = ticks(0, top, 5);
  for (const v of list) marks.append(element("span", { style: `left:${(100 * v) / top}%` }, v.toFixed(digits)));
  root.append(element("div", { class: "ramp", style: `background:linear-gradient(to right, ${gradient})` }), marks);
  root.append(element("div", { class: "unit" }, unit));
}

/** Names the node nearest to the pointer. */
function probeNodes(box, svg, p, describe) {
  box.addEventListener("pointermove", (event) => {
    const matrix = svg.getScreenCTM();
    if (!matrix) return;
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    let best = -1, least = Infinity;
    for (let k = 0; 2 * k < p.length; k++) {
      const d = Math.hypot(p[2 * k] - at.x, p[2 * k + 1] - at.y);
      if (d < least) [best, least] = [k, d];
    }
    if (best >= 0 && least < 120) showTip(event, describe(best));
    else hideTip();
  });
  box.addEventListener("pointerleave", hideTip);
}

// ---- Displacement fields ----
function drawFields(root, rep, note) {
  const count = rep.offsets.length;
  const panels = $$(".panel", root);
  const vectors = [];
  for (let m = 0; m < count; m++) vectors.push(rep.offsets[m].map((v, k) => v - (m === 0 ? 0 : rep.offsets[m - 1][k])));
  const lengths = vectors.map((field) => Array.from({ length: field.length / 2 }, (_, k) => Math.hypot(field[2 * k], field[2 * k + 1])));
  const longest = Math.max(...lengths.flat(), 1e-9);
  // The longest arrow is drawn at most about 300 face units long, so that arrows do not hide each other.
  const gain = [20, 10, 5, 3, 2, 1, 0.5].find((g) => g * longest <= 300) ?? 0.2;
  const reference = [500, 200, 100, 50, 20, 10, 5, 2, 1].find((v) => v <= longest) ?? 1;
  for (let m = 0; m < count; m++) {
    const p = positions(rep, m, 1);
    const face = new Face(commonBox, `Displacement field from key frame ${m} to ${m + 1}`, { shaded: false });
    face.draw(p);
    let d = "";
    for (let k = 0; 2 * k < p.length; k++) {
      const [dx, dy] = [vectors[m][2 * k] * gain, -vectors[m][2 * k + 1] * gain];
      if (lengths[m][k] * gain >= 15) d += arrow(p[2 * k], p[2 * k + 1], dx, dy);
    }
    face.svg.append(vector("path", { class: "arrows", d }));
    const box = $(".face-box", panels[m]);
    box.append(face.svg);
    const mean = lengths[m].reduce((a, b) => a + b, 0) / lengths[m].length;
    $(".small", panels[m]).textContent = `mean ${mean.toFixed(1)}, longest ${Math.max(...lengths[m]).toFixed(1)} face units`;
    probeNodes(box, face.svg, p, (k) => {
      const [dx, dy] = [vectors[m][2 * k], vectors[m][2 * k + 1]];
      return `${wireframe.live[k]} ${data.nodes[k]}: (${fixed(dx, 1)}, ${fixed(dy, 1)}) face units`;
    });
  }
  const scale = () => {
    const svg = $("svg", root);
    const matrix = svg && svg.getScreenCTM();
    return matrix ? reference * gain * matrix.a : 0;
  };
  note.textContent = "";
  const mark = vector("svg", { class: "scale-arrow", height: 10, "aria-hidden": "true" });
  note.append(`Arrows are drawn ${gain} times their length: this arrow`, mark, `is ${reference} face units long. Motions too short to draw have no arrow.`);
  const resize = () => {
    const length = scale();
    mark.setAttribute("width", String(Math.ceil(length) + 4));
    mark.replaceChildren(vector("path", { class: "arrows", d: arrow(1, 5, length, 0, 5) }));
  };
  resize();
  return resize;
}
function arrow(x, y, dx, dy, limit = 42) {
  const length = Math.hypot(dx, dy);
  const head = Math.min(limit, length * 0.5);
  const [ux, uy] = [dx / length, dy / length];
  const [tx, ty] = [x + dx, y + dy];
  const [bx, by] = [tx - ux * head, ty - uy * head];
  const side = head * 0.38;
  const n = (v) => r1(v);
  return `M${n(x)} ${n(y)}L${n(bx)} ${n(by)}M${n(tx)} ${n(ty)}L${n(bx - uy * side)} ${n(by + ux * side)}L${n(bx + uy * side)} ${n(by - ux * side)}Z`;
}
