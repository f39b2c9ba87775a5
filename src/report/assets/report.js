"use strict";
// Draws the figures of the report from the JSON in #data. Positions are face units, y up; the screen's y is down.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const { wireframe, representatives, tracks, ids, emotions, reasons } = data;
  const $ = (selector, root = document) => root.querySelector(selector);
  const $$ = (selector, root = document) => [...root.querySelectorAll(selector)];
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const nodePlace = new Map(wireframe.live.map((node, k) => [node, k]));

  const fixed = (v, digits) => (v === null || v === undefined ? "–" : v.toFixed(digits).replace("-", "−"));
  const whole = (v) => String(v).replace("-", "−");
  const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
  const nodeName = (node) => data.nodes[nodePlace.get(node)] ?? "";
  const idText = (id) => ids[id].join(" ");

  function element(tag, attributes = {}, ...children) {
    const e = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
    e.append(...children);
    return e;
  }
  function vector(tag, attributes = {}, ...children) {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
    e.append(...children);
    return e;
  }
  /** Ticks at 1, 2 or 5 times a power of ten, from `low` to `high`, about `count` of them. */
  function ticks(low, high, count) {
    const span = Math.max(high - low, 1e-9);
    const raw = span / Math.max(count, 1);
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = power * ([1, 2, 5, 10].find((f) => f * power >= raw * 0.999) ?? 10);
    const list = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-6; k++) list.push(k * step);
    return { list, step, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  }

  // ---- Tooltip ----
  const tip = $("#tip");
  function showTip(event, text) {
    tip.textContent = text;
    tip.hidden = false;
    const { width, height } = tip.getBoundingClientRect();
    const x = Math.max(4, Math.min(event.clientX + 14, innerWidth - width - 6));
    const y = event.clientY - height - 10 < 4 ? event.clientY + 18 : event.clientY - height - 10;
    tip.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px)`;
  }
  const hideTip = () => { tip.hidden = true; };

  // ---- Geometry ----
  const triangles = [];
  for (let k = 0; k < wireframe.triangles.length; k += 3) triangles.push(wireframe.triangles.slice(k, k + 3));
  const edgeUse = new Map();
  for (const [a, b, c] of triangles) {
    for (const [p, q] of [[a, b], [b, c], [c, a]]) {
      const key = p < q ? `${p} ${q}` : `${q} ${p}`;
      edgeUse.set(key, (edgeUse.get(key) ?? 0) + 1);
    }
  }
  const edges = [...edgeUse.keys()].map((key) => key.split(" ").map(Number));
  const outline = edges.filter((e) => edgeUse.get(e.join(" ")) === 1);

  /** Screen positions (x, -y in turn) at key-frame time t, offsets from neutral times gain. */
  function positions(rep, t, gain) {
    const apex = rep.offsets.length;
    const time = Math.min(Math.max(t, 0), apex);
    const m = Math.min(Math.floor(time), apex - 1);
    const part = time - m;
    const from = m === 0 ? null : rep.offsets[m - 1];
    const to = rep.offsets[m];
    const out = new Array(rep.neutral.length);
    for (let k = 0; k < out.length; k++) {
      const start = from === null ? 0 : from[k];
      const value = rep.neutral[k] + gain * (start + part * (to[k] - start));
      out[k] = k % 2 === 0 ? value : -value;
    }
    return out;
  }
  function bounds(lists) {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const list of lists) {
      for (let k = 0; k < list.length; k += 2) {
        box[0] = Math.min(box[0], list[k]);
        box[1] = Math.min(box[1], list[k + 1]);
        box[2] = Math.max(box[2], list[k]);
        box[3] = Math.max(box[3], list[k + 1]);
      }
    }
    return box;
  }
  function viewBox([left, top, right, bottom]) {
    const margin = 0.02 * Math.max(right - left, bottom - top);
    return [left - margin, top - margin, right - left + 2 * margin, bottom - top + 2 * margin];
  }
  const everyFrame = representatives.flatMap((r) => Array.from({ length: r.offsets.length + 1 }, (_, t) => positions(r, t, 1)));
  const commonBox = everyFrame.length ? bounds(everyFrame) : [0, 0, 1, 1];

  const r1 = (v) => Math.round(v * 10) / 10;
  const segments = (p, list) => list.map(([a, b]) => `M${r1(p[2 * a])} ${r1(p[2 * a + 1])}L${r1(p[2 * b])} ${r1(p[2 * b + 1])}`).join("");
  const chains = (p, list) => list.map((chain) => "M" + chain.map((n) => `${r1(p[2 * n])} ${r1(p[2 * n + 1])}`).join("L")).join("");
  const contours = (p) => chains(p, wireframe.contours) + segments(p, outline);

  /** A wireframe as SVG: shaded triangles, thin edges, stronger contours. */
  class Face {
    constructor(box, label, { shaded = true, ghost = false } = {}) {
      this.svg = vector("svg", { role: "img", "aria-label": label, preserveAspectRatio: "xMidYMid meet" });
      this.setBox(box);
      this.levels = [];
      if (shaded) {
        for (let k = 0; k < wireframe.shadeCount; k++) {
          const path = vector("path", { class: "shade", style: `--k:${k}` });
          this.levels.push({ path, list: triangles.filter((_, i) => wireframe.shades[i] === k) });
          this.svg.append(path);
        }
      }
      if (ghost) this.svg.append((this.ghost = vector("path", { class: "ghosted" })));
      for (const name of ["edges", "fine", "contours"]) this.svg.append((this[name] = vector("path", { class: name })));
    }
    setBox(box) {
      this.svg.setAttribute("viewBox", viewBox(box).map(r1).join(" "));
    }
    draw(p) {
      for (const { path, list } of this.levels) {
        let d = "";
        for (const [a, b, c] of list) {
          const [ax, ay, bx, by, cx, cy] = [p[2 * a], p[2 * a + 1], p[2 * b], p[2 * b + 1], p[2 * c], p[2 * c + 1]];
          // One orientation for all, so that a folded triangle does not cut a hole.
          const turned = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay) < 0;
          const second = turned ? `${r1(cx)} ${r1(cy)}L${r1(bx)} ${r1(by)}` : `${r1(bx)} ${r1(by)}L${r1(cx)} ${r1(cy)}`;
          d += `M${r1(ax)} ${r1(ay)}L${second}Z`;
        }
        path.setAttribute("d", d);
      }
      this.edges.setAttribute("d", segments(p, edges));
      this.fine.setAttribute("d", chains(p, wireframe.fine));
      this.contours.setAttribute("d", contours(p));
    }
  }

  // ---- Players: a key-frame time from 0 (neutral) to the apex ----
  const HOLD_NEUTRAL = 0.4, FORMATION = 1, HOLD_APEX = 0.8; // seconds at speed 1
  class Player {
    constructor(root, apex, show) {
      Object.assign(this, { root, apex, show, playing: false, visible: true, time: apex, gain: 1, speed: 1, clock: 0, ghost: false });
      this.button = $(".play", root);
      this.slider = $(".time", root);
      this.marks = $$(".ticks button", root);
      for (const mark of this.marks) {
        mark.style.left = `${(100 * Number(mark.dataset.frame)) / apex}%`;
        mark.addEventListener("click", () => this.seek(Number(mark.dataset.frame)));
      }
      this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
      this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
      $(".speed", root).addEventListener("change", (e) => { this.speed = Number(e.target.value); });
      $(".gain", root).addEventListener("input", (e) => {
        this.gain = Number(e.target.value);
        $(".gain-text", root).value = `${this.gain.toFixed(1)}×`;
        this.draw();
      });
      $(".ghost", root)?.addEventListener("change", (e) => { this.ghost = e.target.checked; this.draw(); });
      this.draw();
    }
    draw() {
      this.slider.value = this.time;
      this.slider.setAttribute("aria-valuetext", `key frame ${this.time.toFixed(2)} of ${this.apex}`);
      for (const mark of this.marks) {
        if (Math.abs(Number(mark.dataset.frame) - this.time) < 0.026) mark.setAttribute("aria-current", "true");
        else mark.removeAttribute("aria-current");
      }
      this.show(this);
    }
    seek(time) {
      this.pause();
      this.time = time;
      this.draw();
    }
    pause() {
      this.setPlaying(false);
    }
    play() {
      const start = this.time >= this.apex ? 0 : this.time;
      this.clock = start === 0 ? 0 : HOLD_NEUTRAL + (FORMATION * start) / this.apex;
      this.setPlaying(true);
      this.last = performance.now();
      requestAnimationFrame((now) => this.step(now));
    }
    setPlaying(playing) {
      this.playing = playing;
      this.button.setAttribute("aria-pressed", String(playing));
      $(".play-text", this.button).textContent = playing ? "Pause" : "Play";
    }
    step(now) {
      if (!this.playing) return;
      const whole = HOLD_NEUTRAL + FORMATION + HOLD_APEX;
      this.clock += (Math.max(0, now - this.last) / 1000) * this.speed;
      this.last = now;
      // Who asked for less motion gets one pass, not a loop.
      const over = calm.matches && this.clock >= HOLD_NEUTRAL + FORMATION;
      if (!over) this.clock %= whole;
      this.time = Math.min(Math.max((this.clock - HOLD_NEUTRAL) / FORMATION, 0), 1) * this.apex;
      if (this.visible || over) this.draw();
      if (over) this.pause();
      else requestAnimationFrame((next) => this.step(next));
    }
  }
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) entry.target.player.visible = entry.isIntersecting;
  });
  function watch(node, player) {
    node.player = player;
    watcher.observe(node);
  }

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
  function heatMap(box, p, values, view) {
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
        const [u, v, w2] = [values[a], values[b], values[c]].map((x) => (x ?? 0) / heatTop);
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

  function colorBar(root) {
    const gradient = VIRIDIS.map((c, k) => `${c} ${(100 * k) / (VIRIDIS.length - 1)}%`).join(", ");
    const marks = element("div", { class: "marks" });
    const { list, digits } = ticks(0, heatTop, 5);
    for (const v of list) marks.append(element("span", { style: `left:${(100 * v) / heatTop}%` }, v.toFixed(digits)));
    root.append(element("div", { class: "ramp", style: `background:linear-gradient(to right, ${gradient})` }), marks);
    root.append(element("div", { class: "unit" }, "dispersion per node, face units"));
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

  // ---- Strip plots ----
  /** Offsets that keep dots of a radius apart in a strip; above `most` the dots are spread evenly instead. */
  function swarm(xs, radius, most) {
    const order = xs.map((_, k) => k).sort((a, b) => xs[a] - xs[b] || a - b);
    const ys = new Array(xs.length).fill(0);
    if (xs.length > 400) {
      // Van der Corput: even, and the same every time.
      order.forEach((k, place) => {
        let v = 0, f = 0.5;
        for (let n = place + 1; n > 0; n = Math.floor(n / 2), f /= 2) v += f * (n % 2);
        ys[k] = (2 * v - 1) * most;
      });
      return ys;
    }
    const placed = [];
    for (const k of order) {
      const near = placed.filter((j) => xs[k] - xs[j] < 2 * radius);
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
      title.append(`${before} `, vector("tspan", { "font-style": "italic" }, "d"), vector("tspan", { dy: 3, "font-size": "75%" }, subscript), vector("tspan", { dy: -3 }, ` ${after}`));
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
      element("caption", {}, element("b", {}, root.dataset.caption), " What was trimmed: the displacement field, the sequence, and its distance to the others (eq. 6), face units."),
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
    const rows = [...rep.faps].filter(([, v]) => v !== 0).sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]) || a[0] - b[0]).slice(0, 20);
    if (rows.length === 0) {
      root.append(element("p", { class: "facts" }, "Every FAP is zero at the apex."));
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
      bars.append(element("div", { class: "name" }, element("b", {}, String(number)), element("span", {}, data.faps[number])), element("div", { class: "track" }, bar, text));
    }
    const scale = element("div", { class: "scale" });
    for (const v of ticks(from, to, 4).list) scale.append(element("span", { style: `left:${x(v)}%` }, whole(v)));
    scale.append(element("em", {}, "value at the apex, FAP units"));
    bars.append(element("div"), scale);
    root.append(bars);
  }
  function fapTable(details, rep) {
    const build = () => {
      if ($("table", details)) return;
      const rows = rep.faps.map(([number, value]) =>
        element("tr", {}, element("td", { class: "num" }, String(number)), element("td", {}, data.faps[number]), element("td", { class: "num" }, whole(value))));
      details.append(element("table", { class: "data" },
        element("thead", {}, element("tr", {}, element("th", { scope: "col", class: "num" }, "FAP"), element("th", { scope: "col" }, "Name"), element("th", { scope: "col", class: "num" }, "Value, FAP units"))),
        element("tbody", {}, ...rows)));
    };
    details.addEventListener("toggle", build);
    details.build = build;
  }

  // ---- Cards, drawn when they come near the window ----
  const repaint = [];
  function drawCard(card) {
    if (card.done) return;
    card.done = true;
    const rep = representatives[Number(card.dataset.card)];
    const name = [emotions[rep.emotion], rep.group].filter(Boolean).join(", ");
    const slot = (figure) => $(`[data-figure="${figure}"]`, card);
    const neutral = positions(rep, 0, 1);
    const still = new Face(commonBox, "Canonical neutral wireframe");
    still.draw(neutral);
    slot("neutral").append(still.svg);
    probeNodes(slot("neutral"), still.svg, neutral, (k) => `${wireframe.live[k]} ${data.nodes[k]}`);

    const moving = new Face(commonBox, `Representative of ${name}, moving wireframe`, { ghost: true });
    slot("moving").append(moving.svg);
    const apexBox = bounds(Array.from({ length: rep.offsets.length }, (_, t) => positions(rep, t + 1, 4)));
    watch(slot("moving"), new Player($(".player", card), rep.offsets.length, (player) => {
      // Zooms out so that an exaggerated apex stays inside.
      const part = (player.gain - 1) / 3;
      moving.setBox(commonBox.map((v, k) => (k < 2 ? Math.min(v, v + part * (apexBox[k] - v)) : Math.max(v, v + part * (apexBox[k] - v)))));
      moving.draw(positions(rep, player.time, player.gain));
      moving.ghost.setAttribute("d", player.ghost ? contours(neutral) : "");
    }));
    const resizeFields = drawFields(slot("fields"), rep, $('[data-text="arrow-scale"]', card));
    repaint.push(resizeFields);
    if (rep.nodeDispersion) {
      const box = slot("heat");
      const { canvas, paint } = heatMap(box, neutral, rep.nodeDispersion, commonBox);
      const over = new Face(commonBox, `Dispersion per node of ${name}`, { shaded: false });
      over.svg.classList.add("heat");
      over.draw(neutral);
      box.append(canvas, over.svg);
      probeNodes(box, over.svg, neutral, (k) => `${wireframe.live[k]} ${data.nodes[k]}: ${fixed(rep.nodeDispersion[k], 1)} face units`);
      colorBar(slot("colorbar"));
      repaint.push(paint);
      repaint.push(stripPlot(slot("distances"), distanceRows(rep), "distance d to the median, face units"));
      repaint.push(stripPlot(slot("trimming"), trimmingRows(rep), "distance d to the other models, face units", "tf"));
      const trimmed = slot("trimmed");
      if (trimmed) trimmedTable(trimmed, rep);
    }
    const faps = slot("faps");
    if (faps) {
      drawFaps(faps, rep);
      fapTable(slot("fap-table"), rep);
    }
  }
  const cards = $$(".card");
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      near.unobserve(entry.target);
      drawCard(entry.target);
    }
  }, { rootMargin: "1200px" });
  if (cards.length <= 12) cards.forEach(drawCard);
  else cards.forEach((card) => near.observe(card));

  const overview = $("#overview");
  if (overview) {
    const faces = $$("[data-mini]", overview).map((box) => {
      const rep = representatives[Number(box.dataset.mini)];
      const face = new Face(commonBox, `Representative of ${[emotions[rep.emotion], rep.group].filter(Boolean).join(", ")}`);
      box.append(face.svg);
      return { face, rep };
    });
    const apex = representatives[0].offsets.length;
    watch(overview, new Player($(".player", overview), apex, (player) => {
      for (const { face, rep } of faces) face.draw(positions(rep, (player.time / apex) * rep.offsets.length, player.gain));
    }));
  }

  let resizing = 0;
  addEventListener("resize", () => {
    cancelAnimationFrame(resizing);
    resizing = requestAnimationFrame(() => repaint.forEach((paint) => paint()));
  });
  addEventListener("beforeprint", () => {
    cards.forEach(drawCard);
    repaint.forEach((paint) => paint());
    for (const details of $$("details")) details.build?.();
  });

  // ---- Tracking table ----
  const PAGE = 50;
  const recovered = (row) => row[6].reduce((sum, v, k) => sum + (k % 2 ? v : 0), 0);
  const text = (a, b) => (a < b ? -1 : a > b ? 1 : 0);
  const columns = [
    (a, b) => text(ids[a[0]][0], ids[b[0]][0]),
    (a, b) => text(ids[a[0]][1], ids[b[0]][1]),
    (a, b) => text(emotions[a[1]], emotions[b[1]]),
    (a, b) => a[2] - b[2],
    (a, b) => (a[3] ?? -1) - (b[3] ?? -1),
    (a, b) => (a[4] ?? -1) - (b[4] ?? -1),
    (a, b) => (a[5] ?? -1) - (b[5] ?? -1),
    (a, b) => recovered(a) - recovered(b),
  ];
  const haystack = new Map(tracks.map((row) => {
    const nodes = row[7].filter((_, k) => k % 2 === 0).map((n) => `node ${n} ${nodeName(n)}`);
    const why = row[6].filter((_, k) => k % 2 === 0).map((r) => reasons[r]);
    return [row, [...ids[row[0]], emotions[row[1]], ...why, ...nodes].join(" ").toLowerCase()];
  }));
  const table = { sort: 5, ascending: true, page: 0, words: [] };
  const body = $("#tracks tbody");
  function trackRow(row) {
    const [id, emotion, frames, eye, share, residual, why, worst] = row;
    const nodes = element("td", { class: "nodes" });
    for (let k = 0; k < worst.length; k += 2) {
      if (k) nodes.append(", ");
      const name = nodeName(worst[k]);
      // The feature point's number is left to the tooltip.
      nodes.append(element("span", { title: name }, element("b", {}, String(worst[k])), ` ${name.replace(/ \([0-9.]+\)$/, "")} ×${worst[k + 1]}`));
    }
    if (!worst.length) nodes.append("–");
    const list = [];
    for (let k = 0; k < why.length; k += 2) list.push(`${why[k + 1]} ${reasons[why[k]]}`);
    const tracked = element("td", { class: "num" }, element("i", { class: "share", style: `--share:${share ?? 0}%` }), fixed(share, 1));
    return element("tr", {}, element("td", {}, ids[id][0]), element("td", {}, ids[id][1]), element("td", {}, capital(emotions[emotion])),
      element("td", { class: "num" }, String(frames)), element("td", { class: "num" }, fixed(eye, 1)), tracked,
      element("td", { class: "num" }, fixed(residual, 3)), element("td", { class: "why" }, element("b", {}, String(recovered(row))), list.join(", ")), nodes);
  }
  let sorted = [];
  function sortTracks() {
    const compare = columns[table.sort];
    const sign = table.ascending ? 1 : -1;
    // Equal rows keep the order of their ids.
    sorted = [...tracks].sort((a, b) => sign * compare(a, b) || a[0] - b[0]);
  }
  function showTracks() {
    const rows = sorted.filter((row) => table.words.every((word) => haystack.get(row).includes(word)));
    const pages = Math.max(1, Math.ceil(rows.length / PAGE));
    table.page = Math.min(table.page, pages - 1);
    const start = table.page * PAGE;
    body.replaceChildren(...rows.slice(start, start + PAGE).map(trackRow));
    if (rows.length === 0) body.append(element("tr", {}, element("td", { colspan: 9 }, tracks.length ? "No sequence matches." : "No sequence was tracked.")));
    $("#track-count").textContent = rows.length === tracks.length ? `${rows.length} sequences` : `${rows.length} of ${tracks.length} sequences`;
    $("#track-page").textContent = rows.length ? `${start + 1}–${Math.min(start + PAGE, rows.length)}` : "";
    $("#track-previous").disabled = table.page === 0;
    $("#track-next").disabled = table.page === pages - 1;
    $(".pager").hidden = pages === 1;
  }
  const headers = $$("#tracks thead th");
  headers.slice(0, columns.length).forEach((th, k) => {
    $("button", th).addEventListener("click", () => {
      table.ascending = table.sort === k ? !table.ascending : true;
      table.sort = k;
      table.page = 0;
      headers.forEach((h, j) => (j === k ? h.setAttribute("aria-sort", table.ascending ? "ascending" : "descending") : h.removeAttribute("aria-sort")));
      sortTracks();
      showTracks();
    });
  });
  $("#track-filter").addEventListener("input", (event) => {
    table.words = event.target.value.toLowerCase().split(/\s+/).filter(Boolean);
    table.page = 0;
    showTracks();
  });
  $("#track-previous").addEventListener("click", () => { table.page--; showTracks(); });
  $("#track-next").addEventListener("click", () => { table.page++; showTracks(); });
  sortTracks();
  showTracks();
})();
