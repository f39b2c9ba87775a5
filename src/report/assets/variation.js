// How people differ: the mean moved along a component or with a covariate, and curves with bands of the people.

function drawVariation(root, rep) {
  if (!root) return;
  const { mean, components } = rep.variation;
  const select = $(".component", root);
  const boxes = $$(".face-box", root), titles = $$(".panel h4", root);
  const along = (c, d) => ({ neutral: rep.neutral, offsets: mean.map((frame, m) => frame.map((v, k) => v + d * components[c].offsets[m][k])) });
  // Both ends and the mean: two standard deviations of a component, or the low and high value of a covariate.
  const places = (c) => (components[c].ends ? [components[c].ends[0], 0, components[c].ends[1]] : [-2, 0, 2]);
  const names = (c) => {
    const [low, high] = components[c].titles ?? ["−2 standard deviations", "+2 standard deviations"];
    return [low, "Mean", high];
  };
  let models = [];
  const faces = boxes.map((box, k) => {
    const face = new Face(commonBox, "", { ghost: k === 1 });
    box.append(face.svg);
    return face;
  });
  const choose = () => {
    const c = Number(select.value);
    models = places(c).map((d) => along(c, d));
    const box = bounds([commonBox, ...models.flatMap((m) => m.offsets.map((_, t) => positions(m, t + 1, 1)))]);
    names(c).forEach((name, k) => {
      titles[k].textContent = name;
      faces[k].svg.setAttribute("aria-label", k === 1 ? "Mean of all people" : name);
      faces[k].setBox(box);
    });
  };
  choose();
  const player = new Player($(".player", root), mean.length, (p) => {
    faces.forEach((face, k) => face.draw(positions(models[k], p.time, p.gain)));
    faces[1].ghost.setAttribute("d", contours(positions(rep, p.time, p.gain)));
  });
  select.addEventListener("change", () => { choose(); player.draw(); });
  watch(root, player);
}

function drawBands(root, rep) {
  if (!root) return () => {};
  const { bands } = rep.variation;
  const select = $(".curve", root), chart = $(".chart", root);
  bands.forEach((curve, k) => select.append(element("option", { value: k }, curve.label)));
  const paint = () => {
    const width = Math.min(chart.clientWidth, 720);
    if (width === 0) return;
    const { label, unit, values } = bands[Number(select.value)];
    const left = 58, right = 14, top = 8, bottom = 230;
    const low = Math.min(0, ...values.flat()), high = Math.max(0, ...values.flat());
    const { list, digits } = ticks(low, high, 6);
    const x = (m) => left + ((width - left - right) * m) / Math.max(values.length - 1, 1);
    const y = (v) => bottom - ((bottom - top) * (v - low)) / Math.max(high - low, 1e-9);
    const svg = vector("svg", { viewBox: `0 0 ${width} ${bottom + 40}`, height: bottom + 40, role: "img", "aria-label": `${label} over the key frames` });
    for (const v of list) {
      svg.append(vector("line", { class: "grid", x1: left, x2: width - right, y1: y(v), y2: y(v) }));
      svg.append(vector("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, v.toFixed(digits).replace("-", "−")));
    }
    values.forEach((_, m) => svg.append(vector("text", { x: x(m), y: bottom + 16, "text-anchor": "middle" }, String(m))));
    const line = (k) => values.map((v, m) => `${m ? "L" : "M"}${r1(x(m))} ${r1(y(v[k]))}`).join("");
    // Columns: representative, mean, 5, 25, 50, 75 and 95 %.
    const area = (a, b) => `${line(a)}${values.map((v, m) => `L${r1(x(m))} ${r1(y(v[b]))}`).reverse().join("")}Z`;
    svg.append(vector("path", { class: "band", d: area(2, 6) }), vector("path", { class: "band", d: area(3, 5) }));
    svg.append(vector("path", { class: "curve mean", d: line(1) }), vector("path", { class: "curve", d: line(0) }));
    svg.append(vector("text", { x: (left + width - right) / 2, y: bottom + 34, "text-anchor": "middle" }, `key frame; values in ${unit}`));
    chart.replaceChildren(svg);
  };
  select.addEventListener("change", paint);
  paint();
  return paint;
}
