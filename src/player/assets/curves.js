// FAPs over time, with a cursor at the shown time.

const CURVES = 6, CURVE_BOX = [560, 150];

class Curves {
  constructor(root, names, seek) {
    Object.assign(this, { root, names, seek });
    this.svg = vectorNode("svg", { viewBox: `0 0 ${CURVE_BOX.join(" ")}`, role: "img", preserveAspectRatio: "none", class: "gp-plot" });
    this.list = node("ul", { class: "gp-legend" });
    root.append(this.svg, this.list);
    const move = (event) => {
      const box = this.svg.getBoundingClientRect();
      this.seek(clamp((event.clientX - box.left) / box.width, 0, 1));
    };
    this.svg.addEventListener("pointerdown", (event) => {
      this.svg.setPointerCapture(event.pointerId);
      move(event);
    });
    this.svg.addEventListener("pointermove", (event) => event.buttons && move(event));
  }
  /** Draws the strongest FAPs of a motion. */
  show(motion) {
    this.motion = motion;
    const most = (values) => values.reduce((m, v) => Math.max(m, Math.abs(v)), 0);
    const lengths = motion.faps.filter(({ number }) => !this.names.get(number)?.angle);
    const strongest = lengths.map((f) => ({ ...f, most: most(f.values) })).sort((a, b) => b.most - a.most || a.number - b.number);
    this.shown = strongest.slice(0, CURVES);
    const top = Math.max(1, ...this.shown.map((f) => f.most)) * 1.08, [w, h] = CURVE_BOX;
    this.svg.replaceChildren(vectorNode("line", { x1: 0, x2: w, y1: h / 2, y2: h / 2, class: "gp-axis" }));
    this.list.replaceChildren();
    const steps = Math.min(240, Math.max(24, 8 * motion.last));
    this.shown.forEach((fap, k) => {
      const points = Array.from({ length: steps + 1 }, (_, i) => {
        const y = h / 2 - (motion.value(fap, (motion.last * i) / steps) / top) * (h / 2);
        return `${((w * i) / steps).toFixed(1)} ${y.toFixed(1)}`;
      });
      this.svg.append(vectorNode("path", { d: `M${points.join("L")}`, class: `gp-curve gp-c${k}` }));
      fap.output = node("output");
      const { words, unit } = this.names.get(fap.number) ?? { words: `FAP ${fap.number}`, unit: "" };
      this.list.append(node("li", {}, node("i", { class: `gp-key gp-c${k}` }), node("span", { title: `FAP ${fap.number}, in ${unit}` }, words), fap.output));
    });
    this.cursor = vectorNode("line", { y1: 0, y2: h, class: "gp-cursor" });
    this.svg.append(this.cursor);
    const peaks = this.shown.map((f) => `${this.names.get(f.number)?.words ?? f.number}: up to ${Math.round(f.most)}`);
    this.svg.setAttribute("aria-label", `FAPs of ${motion.label} over time, in FAP units. ${peaks.join("; ")}`);
    if (!this.shown.length) this.list.append(node("li", {}, "This motion has no FAPs."));
  }
  at(share, gain) {
    const x = share * CURVE_BOX[0];
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    for (const fap of this.shown) {
      const value = Math.round(gain * this.motion.value(fap, share * this.motion.last));
      fap.output.textContent = String(value).replace("-", "−");
    }
  }
}
