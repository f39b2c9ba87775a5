// The player: at most two stages, with the same time in both.

function node(tag, attributes = {}, ...children) {
  const e = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
  e.append(...children);
  return e;
}
function fapTitle(fap) {
  return `FAP ${fap.number}, ${fap.name}, in ${fap.unit}`;
}

function vectorNode(tag, attributes = {}) {
  const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
  return e;
}
const capitalized = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const loaded = (source) => new Promise((resolve, reject) => {
  const image = new Image();
  image.onload = () => resolve(image);
  image.onerror = () => reject(new Error("a picture in this page cannot be decoded"));
  image.src = source;
});

/** Data that all players of a page share: motions, faces, FAPs. */
class Shelf {
  constructor(data) {
    this.data = data;
    this.motions = data.motions.map((entry, index) => Object.assign(new Motion(entry), { index }));
    this.rigs = data.faces.map((entry, index) => Object.assign(entry.kind === "head" ? new Head(entry) : new Rig(entry, data), { index }));
    this.faps = data.faps.map((entry) => ({ ...entry, angle: entry.unit.includes("rad"), offsets: scaled(entry.offsets) }));
    this.names = new Map(this.faps.map((entry) => [entry.number, entry]));
  }
  /** Decodes the pictures. */
  async ready() {
    this.teeth = this.data.teeth;
    for (const { folds } of this.motions) folds.image = await loaded(folds.picture);
    for (const rig of this.rigs) {
      if (rig.picture) rig.image = await loaded(rig.picture);
      if (rig.teeth) rig.teethImage = await loaded(rig.teeth);
      if (rig.furrows) rig.furrows = new Furrows({ ...rig.furrows, image: await loaded(rig.furrows.picture) }, rig);
    }
    return this;
  }
  /** A stage on a canvas: WebGL, or a plain canvas if there is no WebGL. */
  stage(canvas, flat = false) {
    if (!flat) {
      try {
        return new GlStage(canvas, this.teeth);
      } catch {
        // A canvas on which WebGL was requested has no other context.
        const fresh = canvas.cloneNode();
        canvas.replaceWith(fresh);
        return new FlatStage(fresh, this.teeth);
      }
    }
    return new FlatStage(canvas, this.teeth);
  }
  /** A picture of the end of a motion, on a separate canvas. */
  still(motion, rig, width) {
    this.spare ??= this.stage(node("canvas"));
    rig.move([{ offsets: motion.at(motion.last, new Float32Array(motion.width)), source: motion, place: motion.last, gain: 1 }]);
    this.spare.draw(rig);
    const picture = node("canvas", { width, height: Math.round((width * rig.height) / rig.width) });
    const context = picture.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(this.spare.canvas, 0, 0, picture.width, picture.height);
    return picture;
  }
}

const SPEEDS = [0.1, 0.25, 0.5, 1, 2];
const REPEATS = [["back", "Forward and back"], ["loop", "From the start"], ["once", "Off"]];

class FacePlayer {
  /** Builds a player into `root`. `flat` draws without WebGL. */
  constructor(root, shelf, { flat = false, motion = 0, keys = root } = {}) {
    Object.assign(this, { root, shelf, flat, share: 1, clock: 0, playing: false, speed: 1, gain: 1, frames: 0, drawn: 0 });
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    this.repeat = shelf.motions[motion]?.kind === "fap" ? "loop" : "back";
    this.extra = new Map();
    root.classList.add("gp");
    root.setAttribute("role", "group");
    if (!root.hasAttribute("aria-label")) root.setAttribute("aria-label", "Player of facial expressions");
    this.stages = node("div", { class: "gp-stages" });
    this.views = [this.view(0, motion), this.view(1, Math.min(motion + 1, shelf.motions.length - 1))];
    if (shelf.rigs.length > 1 && shelf.motions.length === 1) this.views[1].rig = shelf.rigs[1];
    this.views[1].figure.hidden = true;
    this.build();
    this.sync();
    this.setShare(1);
    keys.addEventListener("keydown", (event) => this.key(event));
    new IntersectionObserver((entries) => { this.visible = entries.some((e) => e.isIntersecting); }).observe(this.stages);
    this.visible = true;
  }
  get seen() {
    return this.views.filter((view) => !view.figure.hidden);
  }
  view(side, motion) {
    const { shelf } = this;
    const canvas = node("canvas", { role: "img", width: 4, height: 5 });
    const choose = (list, label, pick) => {
      const select = node("select", { "aria-label": `${label}, ${side ? "right" : "left"}` }, ...list.map((item, k) => node("option", { value: k }, capitalized(item.label))));
      select.addEventListener("change", () => pick(Number(select.value)));
      return select;
    };
    const view = { side, motion: shelf.motions[motion], rig: shelf.rigs[0] };
    view.motions = choose(shelf.motions, "Motion", (k) => { view.motion = shelf.motions[k]; this.changed(); });
    view.faces = choose(shelf.rigs, "Face", (k) => { view.rig = shelf.rigs[k]; this.changed(); });
    view.faces.hidden = shelf.rigs.length < 2;
    view.frame = node("div", { class: "gp-frame" }, canvas);
    view.figure = node("figure", { class: "gp-stage" }, view.frame, node("figcaption", {}, view.motions, view.faces));
    this.stages.append(view.figure);
    view.stage = shelf.stage(canvas, this.flat);
    view.stage.onrestored = () => this.draw();
    view.buffer = new Float32Array(shelf.motions[0].width);
    this.scrubOn(view.frame);
    return view;
  }
  /** Dragging over a face scrubs, by mouse and by finger. */
  scrubOn(frame) {
    let start = null;
    frame.addEventListener("pointerdown", (event) => { start = event.button === 0 ? { x: event.clientX, share: this.share, moved: false } : null; });
    frame.addEventListener("pointermove", (event) => {
      if (!start || !event.buttons) return;
      const by = (event.clientX - start.x) / frame.clientWidth;
      start.moved ||= Math.abs(by) > 0.02;
      if (start.moved) this.seek(clamp(start.share + by, 0, 1));
    });
    frame.addEventListener("pointerup", () => {
      if (start && !start.moved) this.toggle();
      start = null;
    });
    frame.addEventListener("pointercancel", () => { start = null; });
  }
  build() {
    const field = (label, ...children) => node("label", { class: "gp-field" }, node("span", {}, label), ...children);
    const button = (text, act, attributes = {}) => {
      const b = node("button", { type: "button", ...attributes }, text);
      b.addEventListener("click", act);
      return b;
    };
    const select = (list, chosen, pick) => {
      const s = node("select", {}, ...list.map(([value, text]) => node("option", { value, ...(value === chosen ? { selected: "" } : {}) }, text)));
      s.addEventListener("change", () => pick(s.value));
      return s;
    };
    this.button = button("Play", () => this.toggle(), { class: "gp-play", "aria-pressed": "false" });
    this.slider = node("input", { type: "range", class: "gp-time", min: 0, max: 1, step: 0.001, "aria-label": "Time, neutral to apex" });
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.place = node("output", { class: "gp-place" });
    this.said = node("p", { class: "gp-hidden", "aria-live": "polite" });
    this.gainText = node("output", {}, "1.0×");
    this.gainSlider = node("input", { type: "range", class: "gp-gain", min: 0, max: 3, step: 0.05, value: 1 });
    this.gainSlider.addEventListener("input", () => this.setGain(Number(this.gainSlider.value)));
    this.speedSelect = select(SPEEDS.map((s) => [String(s), `${s}×`]), "1", (v) => { this.speed = Number(v); });
    this.repeatSelect = select(REPEATS, this.repeat, (v) => { this.repeat = v; this.restart(); });
    this.compare = node("input", { type: "checkbox", class: "gp-compare" });
    this.compare.addEventListener("change", () => this.setCompare(this.compare.checked));
    this.plot = node("div", { class: "gp-curves" });
    this.curves = new Curves(this.plot, this.shelf.names, (share) => this.seek(share));
    this.root.replaceChildren(
      node("div", { class: "gp-main" }, this.stages,
        node("div", { class: "gp-bar" }, this.button, this.slider, this.place),
        node("div", { class: "gp-options" },
          field("Strength", this.gainSlider, this.gainText), field("Speed", this.speedSelect), field("Repeat", this.repeatSelect),
          node("label", { class: "gp-field" }, this.compare, node("span", {}, "Two side by side")),
          button("Save picture", () => this.save(), { class: "gp-save" }))),
      node("div", { class: "gp-side" },
        node("section", { class: "gp-part" }, node("h3", {}, "FAPs over time"), this.plot),
        this.sliders(button)),
      this.said);
  }
  sliders(button) {
    const rows = new Map();
    this.fapInputs = [];
    for (const fap of this.shelf.faps) {
      if (!rows.has(fap.part)) rows.set(fap.part, []);
      const input = node("input", { type: "range", min: fap.range[0], max: fap.range[1], step: fap.step, value: 0, "data-fap": fap.number, "aria-label": fap.words });
      const output = node("output", {}, "0");
      const set = (value) => {
        if (value) this.extra.set(fap, value);
        else this.extra.delete(fap);
        output.textContent = String(value).replace("-", "−");
        this.reset.disabled = !this.extra.size;
        this.draw();
      };
      input.addEventListener("input", () => set(Number(input.value)));
      input.addEventListener("dblclick", () => { input.value = 0; set(0); });
      this.fapInputs.push({ fap, input, clear: () => { input.value = 0; output.textContent = "0"; } });
      rows.get(fap.part).push(node("label", { class: "gp-fap", title: fapTitle(fap) }, node("span", {}, fap.words), input, output));
    }
    this.reset = button("Reset all to 0", () => {
      this.extra.clear();
      for (const { clear } of this.fapInputs) clear();
      this.reset.disabled = true;
      this.draw();
    }, { class: "gp-reset", disabled: "" });
    const parts = [...rows].map(([part, list]) => node("details", {}, node("summary", {}, part), ...list));
    const section = node("section", { class: "gp-part gp-faps" }, node("h3", {}, "Single FAPs"), node("p", { class: "gp-note" }, "These are added to the motion, in the units of each face. Set the strength to 0 to see them alone."), ...parts, this.reset);
    return section;
  }
  /** Disables the sliders of FAPs that move none of the faces shown: a dense head has no gaze. */
  syncSliders() {
    for (const { fap, input } of this.fapInputs) {
      const moves = this.seen.some((view) => view.rig.moves(fap));
      input.disabled = !moves;
      input.closest("label").title = moves ? fapTitle(fap) : `${fapTitle(fap)}: this face does not move with it`;
    }
  }
  /** Sets the menus to what is shown. */
  sync() {
    this.syncSliders();
    for (const view of this.views) {
      view.motions.value = this.shelf.motions.indexOf(view.motion);
      view.faces.value = this.shelf.rigs.indexOf(view.rig);
    }
    this.curves.show(this.views[0].motion);
  }
  choose(motion) {
    this.views[0].motion = this.shelf.motions[motion];
    this.changed();
  }
  changed() {
    this.sync();
    this.restart();
    this.draw();
    this.say();
  }
  setCompare(on) {
    this.compare.checked = on;
    this.views[1].figure.hidden = !on;
    this.stages.classList.toggle("gp-two", on);
    this.syncSliders();
    this.draw();
  }
  setGain(gain) {
    this.gain = gain;
    this.gainSlider.value = gain;
    this.gainText.textContent = `${gain.toFixed(2).replace(/0$/, "")}×`;
    this.draw();
  }
  course() {
    const natural = this.seen.every((view) => view.motion.kind === "model");
    return new Course(Math.max(...this.seen.map((view) => view.motion.seconds)), this.repeat, natural);
  }
  restart() {
    if (this.playing) this.clock = this.course().clock(this.share);
  }
  setShare(share) {
    this.share = share;
    this.draw();
  }
  seek(share) {
    this.pause();
    this.setShare(share);
  }
  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }
  play() {
    if (this.playing) return;
    this.playing = true;
    const course = this.course();
    // Continues from where it was paused, also on the way back.
    const paused = this.clock === undefined ? { over: true } : course.share(this.clock);
    const continues = !paused.over && this.share > 0 && this.share < 1 && Math.abs(paused.share - this.share) < 1e-9;
    if (!continues) this.clock = this.share >= 1 ? 0 : course.clock(this.share);
    this.before = performance.now();
    this.buttonSays();
    this.nextStep();
  }
  pause() {
    if (!this.playing) return;
    this.playing = false;
    cancelAnimationFrame(this.awaited);
    this.buttonSays();
    this.say();
  }
  /** One step a frame, however often play is pressed within it. */
  nextStep() {
    cancelAnimationFrame(this.awaited);
    this.awaited = requestAnimationFrame((now) => this.step(now));
  }
  buttonSays() {
    this.button.textContent = this.playing ? "Pause" : "Play";
    this.button.setAttribute("aria-pressed", String(this.playing));
  }
  say() {
    const { motion, rig } = this.views[0];
    this.said.textContent = `${capitalized(motion.label)} on ${rig.label}, ${motion.placeText(this.share * motion.last)}`;
  }
  step(now) {
    if (!this.playing) return;
    this.clock += (Math.max(now - this.before, 0) / 1000) * this.speed;
    this.before = now;
    const course = this.course();
    let { share, over } = course.share(this.clock);
    // With reduced motion the animation runs once.
    if (this.calm.matches && this.clock >= course.before + course.way) [share, over] = [1, true];
    this.share = share;
    if (this.visible || over) this.draw();
    if (over) this.pause();
    else this.nextStep();
  }
  parts(view) {
    const { motion, buffer } = view;
    const place = this.share * motion.last;
    const parts = [{ offsets: motion.at(place, buffer), source: motion, place, gain: this.gain }];
    for (const [fap, value] of this.extra) parts.push({ offsets: fap.offsets, source: this.shelf.data.canonical, fap, gain: value });
    return parts;
  }
  draw() {
    for (const view of this.seen) {
      view.rig.move(this.parts(view));
      view.stage.draw(view.rig);
      view.frame.style.aspectRatio = `${view.rig.width} / ${view.rig.height}`;
      const place = view.motion.placeText(this.share * view.motion.last);
      if (!this.playing) view.stage.canvas.setAttribute("aria-label", `${capitalized(view.motion.label)} on ${view.rig.label}, ${place}`);
    }
    const { motion } = this.views[0];
    this.slider.value = this.share;
    const text = motion.placeText(this.share * motion.last);
    this.slider.setAttribute("aria-valuetext", text);
    this.place.textContent = text;
    this.curves.at(this.share, this.gain);
    this.drawn++;
  }
  /** Saves all shown faces side by side as one PNG. */
  save() {
    if (this.seen.some((view) => view.stage.gl?.isContextLost())) {
      this.said.textContent = this.place.textContent = "Not saved: the browser discarded the picture. Try again in a moment";
      return null;
    }
    this.draw();
    const canvases = this.seen.map((view) => view.stage.canvas);
    // All with the same width, as on the page: a head is drawn larger than a photograph.
    const width = Math.max(...canvases.map((c) => c.width));
    const height = Math.max(...canvases.map((c) => Math.round((c.height * width) / c.width)));
    const all = node("canvas", { width: canvases.length * width, height });
    const paper = all.getContext("2d");
    paper.fillStyle = "#fff";
    paper.fillRect(0, 0, all.width, all.height);
    canvases.forEach((c, k) => paper.drawImage(c, k * width, 0, width, Math.round((c.height * width) / c.width)));
    const names = this.seen.map((view) => `${view.motion.label} ${view.rig.label}`).join(" ");
    const name = `${names} ${Math.round(100 * this.share)}`.replace(/[^\p{L}\p{N}]+/gu, "_");
    const link = node("a", { href: all.toDataURL("image/png"), download: `${name}.png` });
    link.click();
    return link;
  }
  key(event) {
    // A focused control keeps the keys that it uses: a slider those that move it, a checkbox the one that toggles it, a menu all.
    const field = event.target.closest?.("input, select, textarea, summary, a");
    const own = { range: ["ArrowLeft", "ArrowRight", "Home", "End"], checkbox: [" "] }[field?.type];
    // The slider of time moves by its thousandth parts under a pointer; its keys step as elsewhere in the player.
    const inField = field && field !== this.slider && !(own && !own.includes(event.key));
    const act = {
      " ": () => this.toggle(),
      k: () => this.toggle(),
      ArrowLeft: () => this.seek(clamp(this.share - 1 / Math.max(this.views[0].motion.last, 20), 0, 1)),
      ArrowRight: () => this.seek(clamp(this.share + 1 / Math.max(this.views[0].motion.last, 20), 0, 1)),
      Home: () => this.seek(0),
      End: () => this.seek(1),
      s: () => this.save(),
      c: () => this.setCompare(!this.compare.checked),
    }[event.key];
    const taken = inField || (event.key === " " && event.target.closest?.("button"));
    if (!act || taken || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  }
}

/** Puts a player into an element. */
async function mountPlayer(root, data, options) {
  const shelf = await new Shelf(data).ready();
  return new FacePlayer(root, shelf, options);
}
