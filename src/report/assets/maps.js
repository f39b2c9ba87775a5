// Tooltips of nodes, and colour bars, for figures on the face that are already drawn.

// ---- Colours: viridis, even in lightness and safe for colour-blind readers ----
const VIRIDIS = ["#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"];
/** Least and largest value of a map. */
function rangeOf(values) {
  const known = values.filter((v) => v !== null);
  const low = Math.min(...known), high = Math.max(...known);
  return known.length ? [low, Math.max(high, low + 1e-9)] : [0, 1];
}

function colorBar(root, [least, most], unit) {
  const gradient = VIRIDIS.map((c, k) => `${c} ${(100 * k) / (VIRIDIS.length - 1)}%`).join(", ");
  const marks = element("div", { class: "marks" });
  if (most - least < 1e-6) {
    // One value everywhere.
    marks.append(element("span", { style: "left:0%" }, least.toFixed(2)));
    root.append(element("div", { class: "ramp", style: `background:${VIRIDIS[0]}` }), marks, element("div", { class: "unit" }, unit));
    return;
  }
  const { list, digits } = ticks(least, most, 5);
  for (const v of list) marks.append(element("span", { style: `left:${(100 * (v - least)) / (most - least)}%` }, v.toFixed(digits)));
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

// ---- Displacement fields: already drawn; tooltips give the motion of a node ----
function probeFields(root, rep) {
  $$(".face-box", root).forEach((box, m) => {
    const vector = (k, c) => rep.offsets[m][2 * k + c] - (m === 0 ? 0 : rep.offsets[m - 1][2 * k + c]);
    probeNodes(box, $("svg", box), positions(rep, m, 1), (k) => `${wireframe.live[k]} ${data.nodes[k]}: (${fixed(vector(k, 0), 1)}, ${fixed(vector(k, 1), 1)}) face units`);
  });
}
