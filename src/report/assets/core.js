// Data, geometry, the wireframe and its player. Positions are face units, y up; the screen's y is down.

const data = JSON.parse(document.getElementById("data").textContent);
const { wireframe, representatives, tracks, ids, reasons } = data;
const emotions = data.emotions.map((name) => name.replaceAll("_", " "));
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

/** Screen positions (x and -y alternating) at key-frame time t, with the offsets from neutral times gain. */
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
        // One orientation for all triangles, so that a folded triangle does not cut a hole.
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
    this.nextStep();
  }
  /** One step a frame, however often play is pressed within it. */
  nextStep() {
    cancelAnimationFrame(this.awaited);
    this.awaited = requestAnimationFrame((now) => this.step(now));
  }
  setPlaying(playing) {
    this.playing = playing;
    if (!playing) cancelAnimationFrame(this.awaited);
    this.button.setAttribute("aria-pressed", String(playing));
    $(".play-text", this.button).textContent = playing ? "Pause" : "Play";
  }
  step(now) {
    if (!this.playing) return;
    const whole = HOLD_NEUTRAL + FORMATION + HOLD_APEX;
    this.clock += (Math.max(0, now - this.last) / 1000) * this.speed;
    this.last = now;
    // With reduced motion the animation runs once instead of in a loop.
    const over = calm.matches && this.clock >= HOLD_NEUTRAL + FORMATION;
    if (!over) this.clock %= whole;
    this.time = Math.min(Math.max((this.clock - HOLD_NEUTRAL) / FORMATION, 0), 1) * this.apex;
    if (this.visible || over) this.draw();
    if (over) this.pause();
    else this.nextStep();
  }
}
const watcher = new IntersectionObserver((entries) => {
  for (const entry of entries) entry.target.player.visible = entry.isIntersecting;
});
function watch(node, player) {
  node.player = player;
  watcher.observe(node);
}
