// Strip plots, trimmed fields, and FAP bars.

// ---- Strip plots ----
/** Offsets that keep dots of a radius apart in a strip; above `most` the dots are spread evenly instead. */
function swarm(xs, radius, most) {
  const order = xs.map((_, k) => k).sort((a, b) => xs[a] - xs[b] || a - b);
  const ys = new Array(xs.length).fill(0);
  if (xs.length > 400) {
    // Van der Corput sequence: evenly distributed, and the same every time.
    order.forEach((k, place) => {
      let v = 0, f = 0.5;
      for (let n = place + 1; n > 0; n = Math.floor(n / 2), f /= 2) v += f * (n % 2);
      ys[k] = (2 * v - 1) * most;
    });
    return ys;
  }
  const placed = [];
  for (const k of order) {
    const near = [];
    for (let j = placed.length - 1; j >= 0 && xs[k] - xs[placed[j]] < 2 * radius; j--) near.push(placed[j]);
    let best = 0;
    const free = (y) => near.every((j) => Math.hypot(xs[k] - xs[j], y - ys[j]) >= 2 * radius - 0.01);
    for (let step = 0; step < 200; step++) {
      const y = (step % 2 ? 1 : -1) * Math.ceil(step / 2) * radius * 0.5;
      if (free(y)) { best = y; break; }
    }
    ys[k] = Math.max(-most, Math.min(most, best));
    placed.push(k);
  }
  return ys;
}
/** Rows of dots over one axis. A row: label, points [{value, id, state}], line (its median). */
function stripPlot(root, rows, axisLabel, subscript = "") {
  const paint = () => {
    const width = root.clientWidth;
    if (width === 0) return;
    const many = Math.max(...rows.map((r) => r.points.length));
    const radius = many > 400 ? 1.5 : many > 120 ? 2 : many > 40 ? 2.6 : 3.2;
    const rowHeight = rows.length > 2 ? 40 : 74;
    const left = rows.length > 2 ? 46 : 62, right = 12, top = 4;
    const bottom = top + rows.length * rowHeight;
    const values = rows.flatMap((r) => r.points.map((p) => p.value));
    const high = Math.max(...values, 1e-9) * 1.03;
    const { list, digits } = ticks(0, high, Math.max(2, Math.floor(width / 90)));
    const x = (v) => left + ((width - left - right) * v) / high;
    const svg = vector("svg", { viewBox: `0 0 ${width} ${bottom + 38}`, height: bottom + 38, role: "img", "aria-label": axisLabel });
    for (const v of list) {
      svg.append(vector("line", { class: "grid", x1: x(v), x2: x(v), y1: top, y2: bottom }));
      svg.append(vector("text", { x: x(v), y: bottom + 15, "text-anchor": "middle" }, v.toFixed(digits)));
    }
    svg.append(vector("line", { class: "axis", x1: left, x2: width - right, y1: bottom, y2: bottom }));
    const [before, after] = axisLabel.split(" d ");
    const title = vector("text", { x: (left + width - right) / 2, y: bottom + 33, "text-anchor": "middle" });
    title.append(`${before} `, vector("tspan", { "font-style": "italic" }, "d"));
    if (subscript) title.append(vector("tspan", { dy: 3, "font-size": "75%" }, subscript), vector("tspan", { dy: -3 }, ` ${after}`));
    else title.append(` ${after}`);
    svg.append(title);
    const marks = [];
    rows.forEach((row, index) => {
      const middle = top + (index + 0.5) * rowHeight;
      svg.append(vector("text", { class: "row-label", x: 0, y: middle + 4 }, row.label));
      if (row.line !== null && row.line !== undefined) {
        const half = rowHeight * 0.42;
        svg.append(vector("line", { class: "median-line", x1: x(row.line), x2: x(row.line), y1: middle - half, y2: middle + half }));
      }
      const xs = row.points.map((p) => x(p.value));
      const ys = swarm(xs, radius + 0.4, rowHeight / 2 - radius - 3);
      const paths = { kept: "", partly: "", dropped: "" };
      row.points.forEach((point, k) => {
        const [px, py] = [r1(xs[k]), r1(middle + ys[k])];
        const s = r1(radius);
        if (point.state === "kept") paths.kept += `M${px} ${py}h0`;
        else if (point.state === "partly") paths.partly += `M${r1(px - s)} ${py}a${s} ${s} 0 1 0 ${2 * s} 0a${s} ${s} 0 1 0 ${-2 * s} 0`;
        else paths.dropped += `M${r1(px - s)} ${r1(py - s)}l${2 * s} ${2 * s}m0 ${-2 * s}l${-2 * s} ${2 * s}`;
        marks.push({ x: px, y: py, text: `${idText(point.id)}: ${point.value.toFixed(2)} face units${point.note ? `, ${point.note}` : ""}` });
      });
      svg.append(vector("path", { class: many > 120 ? "dots dense" : "dots", d: paths.kept, "stroke-width": 2 * radius }));
      svg.append(vector("path", { class: "rings", d: paths.partly }), vector("path", { class: "crosses", d: paths.dropped }));
    });
    const probe = vector("circle", { class: "probe", r: radius + 2.5, visibility: "hidden" });
    svg.append(probe);
    svg.addEventListener("pointermove", (event) => {
      const box = svg.getBoundingClientRect();
      const [mx, my] = [event.clientX - box.left, event.clientY - box.top];
      let best = null, least = 14;
      for (const mark of marks) {
        const d = Math.hypot(mark.x - mx, mark.y - my);
        if (d < least) [best, least] = [mark, d];
      }
      probe.setAttribute("visibility", best ? "visible" : "hidden");
      if (!best) return hideTip();
      probe.setAttribute("cx", best.x);
      probe.setAttribute("cy", best.y);
      showTip(event, best.text);
    });
    svg.addEventListener("pointerleave", () => { probe.setAttribute("visibility", "hidden"); hideTip(); });
    root.replaceChildren(svg);
  };
  paint();
  return paint;
}
function median(values) {
  const v = values.filter((x) => x !== null).sort((a, b) => a - b);
  return v.length ? (v[(v.length - 1) >> 1] + v[v.length >> 1]) / 2 : null;
}
function distanceRows(rep) {
  const dropCount = rep.sequences.map((_, k) => rep.dropped.filter((d) => d.includes(k)).length);
  const state = (k) => (dropCount[k] === 0 ? "kept" : dropCount[k] === rep.dropped.length ? "dropped" : "partly");
  const note = (k) => (dropCount[k] ? `dropped from ${dropCount[k]} of ${rep.dropped.length} fields` : "");
  const points = (list) =>
    list.map((value, k) => ({ value, id: rep.sequences[k], state: state(k), note: note(k) })).filter((p) => p.value !== null);
  return [
    { label: "before", points: points(rep.distancesUntrimmed), line: rep.dispersionUntrimmed },
    { label: "after", points: points(rep.distances), line: rep.dispersion },
  ];
}
function trimmingRows(rep) {
  return rep.fieldDistances.map((list, m) => ({
    label: `${m} → ${m + 1}`,
    points: list
      .map((value, k) => ({ value, id: rep.sequences[k], state: rep.dropped[m].includes(k) ? "dropped" : "kept" }))
      .filter((p) => p.value !== null)
      .map((p) => ({ ...p, note: p.state === "dropped" ? "dropped" : "" })),
    line: median(list),
  }));
}
function trimmedTable(root, rep) {
  const rows = rep.dropped.flatMap((list, m) => list.map((k) => [m, rep.sequences[k], rep.fieldDistances[m][k]]));
  rows.sort((a, b) => a[0] - b[0] || (b[2] ?? 0) - (a[2] ?? 0) || a[1] - b[1]);
  const body = element("tbody");
  const table = element("table", { class: "data" },
    element("caption", {}, element("b", {}, root.dataset.caption), " Trimmed displacement fields: field, sequence, and mean distance to the other models (eq. 6), face units."),
    element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "Field"), element("th", { scope: "col" }, "Subject"), element("th", { scope: "col" }, "Sequence"), element("th", { scope: "col", class: "num" }, "Distance"))), body);
  root.append(table);
  const show = (limit) => {
    body.replaceChildren(...rows.slice(0, limit).map(([m, id, d]) =>
      element("tr", {}, element("td", {}, `${m} → ${m + 1}`), element("td", {}, ids[id][0]), element("td", {}, ids[id][1]), element("td", { class: "num" }, fixed(d, 2)))));
  };
  const first = 12;
  show(rows.length <= first + 2 ? rows.length : first);
  if (rows.length > first + 2) {
    const button = element("button", { type: "button" }, `Show all ${rows.length}`);
    button.addEventListener("click", () => { show(rows.length); button.remove(); });
    root.append(button);
  }
}

// ---- FAP bars ----
function drawFaps(root, rep) {
  const rows = [...rep.faps].filter(([n, v]) => v !== 0 && !data.faps[n][2]).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]) || a[0] - b[0]).slice(0, 20);
  if (rows.length === 0) {
    root.append(element("p", { class: "facts" }, "All FAPs that are lengths are zero at the apex."));
    return;
  }
  const low = Math.min(0, ...rows.map((r) => r[1])), high = Math.max(0, ...rows.map((r) => r[1]));
  // Room for the numbers beside the bars.
  const span = high - low, from = low - (low < 0 ? 0.16 : 0.02) * span, to = high + (high > 0 ? 0.16 : 0.02) * span;
  const x = (v) => (100 * (v - from)) / (to - from);
  const bars = element("div", { class: "bars", style: `--zero:${x(0)}%` });
  for (const [number, value] of rows) {
    const bar = element("i", { style: `left:${x(Math.min(0, value))}%;width:${Math.abs(x(value) - x(0))}%` });
    const text = element("span", { style: value < 0 ? `right:calc(${100 - x(value)}% + 0.3rem)` : `left:calc(${x(value)}% + 0.3rem)` }, whole(value));
    bars.append(element("div", { class: "name" }, element("b", {}, String(number)), element("span", {}, data.faps[number][0])), element("div", { class: "track" }, bar, text));
  }
  const scale = element("div", { class: "scale" });
  for (const v of ticks(from, to, 4).list) scale.append(element("span", { style: `left:${x(v)}%` }, whole(v)));
  scale.append(element("em", {}, "value at the apex, FAPU/1024"));
  bars.append(element("div"), scale);
  root.append(bars);
}
function fapTable(details, rep) {
  const build = () => {
    if ($("table", details)) return;
    const rows = rep.faps.map(([number, value]) =>
      element("tr", {}, element("td", { class: "num" }, String(number)), element("td", {}, data.faps[number][0]), element("td", { class: "num" }, whole(value)), element("td", {}, data.faps[number][1])));
    details.append(element("table", { class: "data" },
      element("thead", {}, element("tr", {}, element("th", { scope: "col", class: "num" }, "FAP"), element("th", { scope: "col" }, "Name"), element("th", { scope: "col", class: "num" }, "Value"), element("th", { scope: "col" }, "Unit"))),
      element("tbody", {}, ...rows)));
  };
  details.addEventListener("toggle", build);
  details.build = build;
}
