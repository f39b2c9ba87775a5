// The image with its wireframe and marks: zoom, pan, gestures, magnifier. Positions are image pixels, the centre of the top-left pixel is 0, 0.

import { chains, element } from './diagram.js';

const MAX_ZOOM = 40;
const TAP_PX = 4;
const LOUPE = 176;
const LOUPE_GAP = 26;
const LOUPE_TIMES = 2.4;
const WHEEL = 0.0016;
const FACE_SHARE = 0.62;
const BRIEF_MS = 2500;

export class Stage {
  /**
   * Methods of `host`: `hit(point, reach)` returns the thing at a point or null; `tap(point, thing)`, `dragStart(thing)`,
   * `dragMove(thing, point)` and `dragEnd(thing)` are called for gestures; `unreadable()` when a frame cannot be read, and `hideNotice()`
   * when another is shown after it.
   */
  constructor(host) {
    this.host = host;
    this.root = document.getElementById('stage');
    this.world = document.getElementById('world');
    this.photo = document.getElementById('photo');
    this.wire = document.getElementById('wire');
    this.dots = document.getElementById('dots');
    this.markLayer = document.getElementById('marks');
    this.loupe = document.getElementById('loupe');
    this.bitmap = new Image();
    /** Whether the frame shown cannot be read. */
    this.broken = false;
    this.photo.addEventListener('error', () => {
      if (!this.photo.hasAttribute('href')) return;
      this.broken = true;
      // Not the browser's sign for a picture that is not there.
      this.photo.removeAttribute('href');
      host.unreadable();
    });
    this.size = [1, 1];
    this.zoom = 1;
    this.offset = [0, 0];
    this.touched = false;
    this.loupeOn = true;
    this.pointers = new Map();
    this.root.addEventListener('wheel', (e) => this.wheel(e), { passive: false });
    this.root.addEventListener('pointerdown', (e) => this.down(e));
    this.root.addEventListener('pointermove', (e) => this.move(e));
    for (const end of ['pointerup', 'pointercancel']) this.root.addEventListener(end, (e) => this.up(e));
    this.root.addEventListener('pointerleave', () => this.hideLoupe());
    this.root.addEventListener('contextmenu', (e) => e.preventDefault());
    new ResizeObserver(() => this.resized()).observe(this.root);
  }

  /** For another sequence, the view zooms to the face again. */
  forgetView() {
    this.touched = false;
    this.size = [0, 0];
  }

  /** Shows a frame; the view is kept if the size is the same. */
  show(url, width, height) {
    const same = this.size[0] === width && this.size[1] === height;
    this.size = [width, height];
    this.photo.setAttribute('width', width);
    this.photo.setAttribute('height', height);
    if (this.broken) this.host.hideNotice();
    this.broken = false;
    this.photo.setAttribute('href', url);
    this.bitmap = new Image();
    this.bitmap.src = url;
    if (!same) this.fit();
  }

  /** Shows nothing. */
  clear() {
    this.photo.removeAttribute('href');
    this.bitmap = new Image();
    this.root.dataset.frame = '';
    this.size = [1, 1];
    for (const path of this.wire.children) path.setAttribute('d', '');
    this.drawDots([]);
    this.drawMarks([]);
    this.hideLoupe();
  }

  /** The window has changed its size: the middle of the view stays in the middle. */
  resized() {
    if (!this.touched) return this.fit();
    const { middle } = this;
    this.centre(middle);
    // While the layout changes, the window may be too small for a moment.
    this.middle = middle;
  }

  /** Shows the whole image. */
  fit() {
    this.touched = false;
    const [w, h] = this.room();
    this.zoom = Math.min(w / this.size[0], h / this.size[1]);
    this.centre([(this.size[0] - 1) / 2, (this.size[1] - 1) / 2]);
  }

  room() {
    return [this.root.clientWidth || 1, this.root.clientHeight || 1];
  }

  centre([x, y]) {
    const [w, h] = this.room();
    this.offset = [w / 2 - x * this.zoom, h / 2 - y * this.zoom];
    this.apply();
  }

  /** Shows a box of the image, such as the face. */
  frameBox(points) {
    if (!points.length) return;
    const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
    const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    const [w, h] = this.room();
    this.zoom = this.limit(Math.min((w * FACE_SHARE) / Math.max(box[2] - box[0], 4), (h * FACE_SHARE) / Math.max(box[3] - box[1], 4)));
    this.touched = true;
    this.centre([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]);
  }

  limit(zoom) {
    const [w, h] = this.room();
    const least = Math.min(1, w / this.size[0], h / this.size[1]) * 0.7;
    return Math.min(MAX_ZOOM, Math.max(least, zoom));
  }

  /** Zooms by a factor about a position in the window (the middle by default). */
  zoomBy(factor, at = this.room().map((v) => v / 2)) {
    const point = this.toImage(at);
    this.zoom = this.limit(this.zoom * factor);
    this.offset = [at[0] - point[0] * this.zoom, at[1] - point[1] * this.zoom];
    this.touched = true;
    this.apply();
  }

  pan(dx, dy) {
    this.offset = [this.offset[0] + dx, this.offset[1] + dy];
    this.touched = true;
    this.apply();
  }

  apply() {
    // The image never leaves the window.
    const room = this.room();
    this.offset = this.offset.map((o, k) => Math.min(room[k] - 40, Math.max(40 - this.size[k] * this.zoom, o)));
    const [x, y] = this.offset;
    this.middle = this.toImage(room.map((v) => v / 2));
    this.world.setAttribute('transform', `translate(${x.toFixed(2)} ${y.toFixed(2)}) scale(${this.zoom.toFixed(5)})`);
    this.photo.classList.toggle('pixels', this.zoom > 7);
    document.getElementById('zoom-text').textContent = `${Math.round(this.zoom * 100)} %`;
    this.placeMarks();
  }

  toImage([x, y]) {
    return [(x - this.offset[0]) / this.zoom, (y - this.offset[1]) / this.zoom];
  }

  toWindow([x, y]) {
    return [x * this.zoom + this.offset[0], y * this.zoom + this.offset[1]];
  }

  /** Draws the wireframe at `nodes`; null for none. */
  drawWire(setup, nodes, faint = false) {
    const [casing, spring, bold, contour] = this.wire.children;
    const place = (n) => nodes[n];
    const springs = nodes ? chains(setup.edges, place) : '';
    const contours = nodes ? chains([...setup.contours.strong, ...setup.contours.fine], place) : '';
    for (const path of [casing, spring]) path.setAttribute('d', springs);
    for (const path of [bold, contour]) path.setAttribute('d', contours);
    this.wire.classList.toggle('faint', faint);
  }

  /** Draws dots: a list of `{ key, points, colour? }`, one path each, so that hundreds are cheap. */
  drawDots(groups) {
    const draw = (points) => points.map(([x, y]) => `M${x.toFixed(2)} ${y.toFixed(2)}h0`).join('');
    this.dots.replaceChildren(
      ...groups.flatMap(({ key, points, colour }) => {
        const dot = element('path', { class: `dot ${key}`, d: draw(points) });
        if (colour) dot.style.stroke = colour;
        return [element('path', { class: `dot casing ${key}`, d: draw(points) }), dot];
      }),
    );
  }

  /** Draws marks: a list of `{ key, node, kind, point, error, label, selected }`; `kind` is mark, hard, proposal or ghost, `error` the
   * expected error of one that was found, px. */
  drawMarks(marks) {
    this.marks = marks;
    this.markLayer.replaceChildren(
      ...marks.map(({ node, kind, error, label, selected }) => {
        const group = element('g', { class: `pin ${kind}${error ? ' found' : ''}${selected ? ' selected' : ''}`, 'data-node': node });
        if (error) group.append(element('circle', { class: 'doubt' }));
        if (error && !selected) group.append(element('circle', { class: 'casing', r: 2.6 }), element('circle', { class: 'ring', r: 2.6 }));
        else if (kind === 'hard') group.append(element('path', { class: 'casing', d: 'M0-8 8 0 0 8-8 0Z' }), element('path', { class: 'ring', d: 'M0-8 8 0 0 8-8 0Z' }));
        else group.append(element('circle', { class: 'casing', r: 7.5 }), element('circle', { class: 'ring', r: 7.5 }));
        group.append(element('path', { class: 'cross', d: 'M-3 0h6M0-3v6' }));
        if (selected || kind === 'ghost') group.append(element('text', { class: 'casing', x: 13, y: 4 }, label), element('text', { x: 13, y: 4 }, label));
        return group;
      }),
    );
    this.placeMarks();
  }

  placeMarks() {
    const size = (1 / this.zoom).toFixed(5);
    [...this.markLayer.children].forEach((group, k) => {
      const [x, y] = this.marks[k].point;
      group.setAttribute('transform', `translate(${x.toFixed(3)} ${y.toFixed(3)}) scale(${size})`);
      // The size of the disc is that of an error in the picture; the size of the pin fits a finger.
      group.querySelector('.doubt')?.setAttribute('r', (this.marks[k].error * this.zoom).toFixed(2));
    });
  }

  // Gestures.

  at(event) {
    const box = this.root.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  reach(event) {
    return (event.pointerType === 'mouse' ? 1 : 1.9) / this.zoom;
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.zoomBy(Math.exp(-event.deltaY * lines * WHEEL), this.at(event));
  }

  down(event) {
    if (event.target.closest('button, #notice')) return;
    this.root.setPointerCapture(event.pointerId);
    const place = this.at(event);
    this.pointers.set(event.pointerId, place);
    if (this.pointers.size === 2) {
      if (this.gesture?.dragging) this.host.dragEnd(this.gesture.thing);
      this.gesture = { pinch: true };
      this.hideLoupe();
      return;
    }
    const pans = event.button === 1 || event.button === 2;
    const point = this.toImage(place);
    const thing = pans ? null : this.host.hit(point, this.reach(event));
    // A dragged point keeps its distance from the finger, so that it does not jump.
    const grip = thing ? [thing.point[0] - point[0], thing.point[1] - point[1]] : [0, 0];
    this.gesture = { start: place, last: place, thing, grip, pans, moved: false, dragging: false };
  }

  move(event) {
    const place = this.at(event);
    const known = this.pointers.has(event.pointerId);
    if (!known || !this.gesture) {
      if (event.pointerType === 'mouse' && !event.target.closest('button, #notice')) this.hover(place);
      return;
    }
    if (this.gesture.pinch) return this.pinch(event.pointerId, place);
    const g = this.gesture;
    if (!g.moved && Math.hypot(place[0] - g.start[0], place[1] - g.start[1]) < TAP_PX * (event.pointerType === 'mouse' ? 1 : 2)) return;
    g.moved = true;
    if (g.thing) {
      if (!g.dragging) {
        g.dragging = true;
        this.host.dragStart(g.thing);
      }
      const [x, y] = this.toImage(place);
      const point = this.clamp([x + g.grip[0], y + g.grip[1]]);
      this.host.dragMove(g.thing, point);
      this.showLoupe(point);
    } else {
      this.root.classList.add('panning');
      this.hideLoupe();
      this.pan(place[0] - g.last[0], place[1] - g.last[1]);
    }
    g.last = place;
    this.pointers.set(event.pointerId, place);
  }

  pinch(id, place) {
    const other = [...this.pointers.keys()].find((key) => key !== id);
    if (other === undefined) return;
    const [before, fixed] = [this.pointers.get(id), this.pointers.get(other)];
    const spread = (p) => Math.max(10, Math.hypot(p[0] - fixed[0], p[1] - fixed[1]));
    // The point between the fingers follows their middle, and the view scales about it.
    const middle = [(place[0] + fixed[0]) / 2, (place[1] + fixed[1]) / 2];
    this.pan((place[0] - before[0]) / 2, (place[1] - before[1]) / 2);
    this.zoomBy(spread(place) / spread(before), middle);
    this.pointers.set(id, place);
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    this.root.classList.remove('panning');
    const g = this.gesture;
    if (this.pointers.size === 0) this.gesture = null;
    if (!g || g.pinch) return;
    if (g.dragging) {
      this.host.dragEnd(g.thing);
      this.hideLoupe();
    } else if (!g.moved && !g.pans && event.type === 'pointerup') {
      const point = this.toImage(g.start);
      if (this.inside(point)) this.host.tap(this.clamp(point), g.thing);
    }
  }

  inside([x, y]) {
    return x >= -0.5 && y >= -0.5 && x < this.size[0] - 0.5 && y < this.size[1] - 0.5;
  }

  /** A position in the image, in hundredths of a pixel. */
  clamp([x, y]) {
    const limit = (v, size) => Math.round(Math.min(size - 0.51, Math.max(-0.5, v)) * 100) / 100;
    return [limit(x, this.size[0]), limit(y, this.size[1])];
  }

  hover(place) {
    const point = this.toImage(place);
    const thing = this.host.hit(point, 1 / this.zoom);
    this.root.classList.toggle('over', Boolean(thing));
    if (this.inside(point) && this.host.wantsLoupe()) this.showLoupe(point);
    else this.hideLoupe();
  }

  // The magnifier.

  /** Shows the magnifier for a node that was moved by keys; it disappears by itself. */
  showLoupeBriefly(point) {
    this.showLoupe(point);
    this.brief = setTimeout(() => this.hideLoupe(), BRIEF_MS);
  }

  showLoupe(point) {
    clearTimeout(this.brief);
    if (!this.loupeOn || !this.bitmap.complete || !this.bitmap.naturalWidth) return this.hideLoupe();
    const [w, h] = this.room();
    const [x, y] = this.toWindow(point);
    let left = x + LOUPE_GAP;
    let top = y - LOUPE_GAP - LOUPE;
    if (left + LOUPE > w) left = x - LOUPE_GAP - LOUPE;
    if (top < 0) top = Math.min(y + LOUPE_GAP, h - LOUPE);
    this.loupe.style.transform = `translate(${Math.max(0, left)}px, ${Math.max(0, top)}px)`;
    this.loupe.classList.add('shown');
    const times = Math.max(4, this.zoom * LOUPE_TIMES);
    const ctx = this.loupe.getContext('2d');
    ctx.imageSmoothingEnabled = times < 10;
    ctx.fillStyle = '#222';
    ctx.fillRect(0, 0, LOUPE, LOUPE);
    const half = LOUPE / 2;
    const scale = this.bitmap.naturalWidth / this.size[0];
    ctx.setTransform(times, 0, 0, times, half - point[0] * times, half - point[1] * times);
    ctx.drawImage(this.bitmap, 0, 0, this.size[0] * scale, this.size[1] * scale, -0.5, -0.5, this.size[0], this.size[1]);
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    for (const [colour, width] of [['rgba(0,0,0,.55)', 3], ['#fff', 1]]) {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width;
      ctx.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        ctx.moveTo(half + dx * 7, half + dy * 7);
        ctx.lineTo(half + dx * 30, half + dy * 30);
      }
      ctx.stroke();
    }
    ctx.fillStyle = '#ffd84d';
    ctx.fillRect(half - 1, half - 1, 2, 2);
  }

  hideLoupe() {
    clearTimeout(this.brief);
    this.loupe.classList.remove('shown');
  }
}
