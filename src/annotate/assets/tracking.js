// Stepping through a tracked sequence, correcting nodes, tracking again.

import { Newest, Refusal, ask, framePath, sequencePath } from './server.js';
import { sentence } from './marking.js';

const NODE_REACH = 12;

export const WORDS = {
  marked: 'marked',
  fitted: 'placed by the fit',
  corrected: 'corrected by hand',
  tracked: 'tracked',
  recovered_klt: 'lost: no match found',
  recovered_forward_backward: 'lost: failed the forward-backward check',
  recovered_extreme: 'lost: moved unlike its neighbours',
  recovered_jump: 'lost in a large step: placed by the face found in both pictures',
  recovered_outside: 'lost: outside the image',
};
/** Names of points of the neutral frame that were not marked by hand, by their source. */
const NOT_MARKED = { found: 'found', landmarks: 'from landmarks' };

export class Tracking {
  constructor(page) {
    this.page = page;
    this.setup = page.setup;
    this.live = this.setup.nodes.filter((n) => n.live).map((n) => n.id);
    this.colours = new Map(this.setup.states.map((s) => [s.name, s.colour]));
    this.previewer = new Newest((...what) => this.askPreview(...what));
    const on = (id, act) => document.getElementById(id).addEventListener('click', () => this.track && act());
    on('retrack', () => this.retrack());
    on('undo', () => this.undo());
    on('redo', () => this.redo());
    on('remove', () => this.release());
    on('look-right', () => this.look('right'));
    on('look-out', () => this.look('leave_out'));
  }

  async open(id) {
    const track = await ask(sequencePath(id));
    this.id = id;
    this.take(track);
    this.stale = null;
    this.selected = null;
    this.done = [];
    this.undone = [];
    this.page.scrubber.open(id, track.frames.map((f) => f.number));
    this.page.stage.forgetView();
    this.showFrame(track.frames[0].number);
    this.showFace();
  }

  /** No track, nothing to correct. */
  close() {
    this.id = null;
    this.track = null;
    this.preview = null;
    this.selected = null;
    this.done = [];
    this.undone = [];
    this.previewer.forget();
    this.page.stage.clear();
    this.page.scrubber.clear();
    this.page.showList([], '');
    for (const id of ['undo', 'redo', 'remove', 'retrack', 'look-right', 'look-out']) document.getElementById(id).disabled = true;
    for (const id of ['track-step', 'track-title', 'track-reasons']) document.getElementById(id).textContent = '';
    document.getElementById('track-hint').textContent = 'This track cannot be opened. Press › for the next one.';
    document.getElementById('legend').replaceChildren();
  }

  showFace() {
    this.page.stage.frameBox(this.page.innerFace(this.current().nodes));
  }

  take(track) {
    this.track = track;
    this.page.looked(track.id, track.look);
    this.frames = new Map(track.frames.map((f) => [f.number, f]));
  }

  current() {
    return this.preview ?? this.frames.get(this.frame);
  }

  lost(frame) {
    return this.live.filter((n) => frame.states[n].startsWith('recovered')).length;
  }

  corrections(frame = this.frames.get(this.frame)) {
    if (frame.number === this.track.frames[0].number) return [];
    return this.live.filter((n) => frame.states[n] === 'corrected').map((node) => ({ node, x: frame.nodes[node][0], y: frame.nodes[node][1] }));
  }

  isNeutral() {
    return this.frame === this.track.frames[0].number;
  }

  // Changes.

  async correct(frame, corrections, remember = true) {
    const before = { frame, corrections: this.corrections(this.frames.get(frame)) };
    this.page.showSaved('saving', 'Saving…');
    try {
      const answer = await ask(sequencePath(this.id, '/corrections'), 'PUT', { version: this.track.version, frame, corrections });
      this.track.version = answer.version;
      this.forgetLook();
      this.frames.set(frame, answer.frame);
      this.stale = Math.min(this.stale ?? frame, frame);
      if (remember) {
        this.done.push(before);
        this.undone = [];
      }
      this.page.showSaved('saved', 'Saved');
    } catch (error) {
      await this.failed(error);
    }
    this.preview = null;
    this.previewer.forget();
    this.render();
    return before;
  }

  async undo(from = this.done, to = this.undone) {
    const step = from.pop();
    if (!step) return;
    this.showFrame(step.frame);
    to.push(await this.correct(step.frame, step.corrections, false));
    this.render();
  }

  redo() {
    return this.undo(this.undone, this.done);
  }

  release(node = this.selected) {
    const kept = this.corrections().filter((c) => c.node !== node);
    if (kept.length < this.corrections().length) this.correct(this.frame, kept);
  }

  async retrack() {
    const frame = this.frame;
    if (frame === this.track.frames.at(-1).number) return;
    this.page.showSaved('saving', 'Tracking…');
    document.getElementById('retrack').disabled = true;
    try {
      this.take(await ask(sequencePath(this.id, '/retrack'), 'POST', { version: this.track.version, frame }));
      this.stale = this.stale !== null && this.stale < frame ? this.stale : null;
      this.page.showSaved('saved', 'Tracked again and saved');
    } catch (error) {
      await this.failed(error);
    }
    this.render();
  }

  /** Saves what the user found; the same again takes it back. */
  async look(found) {
    const { id } = this;
    const look = this.track.look === found ? null : found;
    this.page.showSaved('saving', 'Saving…');
    try {
      await ask(sequencePath(id, '/look'), 'PUT', { version: this.track.version, look });
      this.page.looked(id, look);
      if (this.id === id) this.track.look = look;
      this.page.showSaved('saved', look === null ? 'Taken back' : look === 'right' ? 'Saved: looks right' : 'Saved: left out');
    } catch (error) {
      await this.failed(error);
    }
    this.render();
  }

  /** A changed track is another one than was looked at. */
  forgetLook() {
    if (this.track.look) this.track.look = 'outdated';
    this.page.looked(this.id, this.track.look);
  }

  async failed(error) {
    if (!(error instanceof Refusal)) throw error;
    if (error.status === 409) {
      this.take(error.body.current);
      this.page.showSaved('failed', 'Changed elsewhere');
      this.page.notice('This track was changed elsewhere. The changed track is now shown; your last change was not saved.');
    } else {
      this.page.showSaved('failed', 'Not saved');
      this.page.notice(sentence(error.message));
    }
  }

  async askPreview(frame, corrections) {
    try {
      const answer = await ask(sequencePath(this.id, '/preview'), 'POST', { frame, corrections });
      if (this.dragging && frame === this.frame) this.preview = answer;
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.page.notice(sentence(error.message));
    }
    this.render();
  }

  // Calls of the stage.

  hit([x, y], scale) {
    if (!this.track || this.isNeutral()) return null;
    let best = null;
    for (const node of this.live) {
      const point = this.current().nodes[node];
      const far = Math.hypot(point[0] - x, point[1] - y);
      if (far < NODE_REACH * scale && (!best || far < best.far)) best = { node, point, far };
    }
    return best;
  }

  wantsLoupe() {
    return false;
  }

  tap(point, thing) {
    if (this.isNeutral()) this.page.notice('The neutral frame is fitted, not tracked. Use “grimace annotate DATASET” to correct its marks.');
    this.selected = thing ? thing.node : null;
    this.render();
  }

  dragStart(thing) {
    this.dragging = true;
    this.selected = thing.node;
  }

  dragMove(thing, [x, y]) {
    this.dragged = [...this.corrections().filter((c) => c.node !== thing.node), { node: thing.node, x, y }];
    this.previewer.ask(this.frame, this.dragged);
  }

  dragEnd() {
    this.dragging = false;
    if (this.dragged) this.correct(this.frame, this.dragged);
    this.dragged = null;
  }

  pick(node) {
    if (!this.track) return;
    this.selected = node;
    this.render();
    this.page.stage.showLoupeBriefly(this.current().nodes[node]);
  }

  // Drawing.

  showFrame(number) {
    this.frame = number;
    this.preview = null;
    this.page.stage.show(framePath(this.id, number), this.track.width, this.track.height);
    this.render();
  }

  render() {
    if (!this.track) return;
    const { page, setup } = this;
    const frame = this.current();
    const { stage } = page;
    stage.root.dataset.frame = this.frame;
    stage.drawWire(setup, frame.nodes);
    const states = [...new Set(this.live.map((n) => frame.states[n]))];
    const of = (state) => this.live.filter((n) => frame.states[n] === state);
    stage.drawDots(states.filter((s) => s !== 'corrected').map((state) => ({ key: state, colour: this.colours.get(state), points: of(state).map((n) => frame.nodes[n]) })));
    const name = (n) => setup.nodes[n].name;
    const corrected = of('corrected').map((n) => ({ node: n, kind: 'hard', point: frame.nodes[n], label: name(n), selected: n === this.selected }));
    const pointed = this.selected !== null && frame.states[this.selected] !== 'corrected' ? [{ node: this.selected, kind: 'pointed', point: frame.nodes[this.selected], label: `${name(this.selected)}: ${this.word(frame.states[this.selected])}`, selected: true }] : [];
    stage.drawMarks([...pointed, ...corrected]);
    page.diagram.update((n) => [frame.states[n].startsWith('recovered') && 'lost', frame.states[n] === 'corrected' && 'marked hard', n === this.selected && 'selected'].filter(Boolean).join(' '), null);

    const lost = this.lost(frame);
    const place = this.track.frames.findIndex((f) => f.number === this.frame);
    const text = (id, words) => (document.getElementById(id).textContent = words);
    text('track-step', `Frame ${place + 1} of ${this.track.frames.length}`);
    text('track-title', this.isNeutral() ? 'Neutral frame' : lost ? `${lost} of ${this.live.length} nodes lost` : 'All nodes tracked');
    text('track-hint', this.hint(lost));
    document.getElementById('retrack').disabled = this.frame === this.track.frames.at(-1).number;
    const list = this.corrections(frame).map((c) => ({ node: c.node, kind: 'hard', selected: c.node === this.selected, detail: 'set by hand', action: 'Release' }));
    page.showList(list, this.isNeutral() ? 'The neutral frame has marks, not corrections.' : 'No corrections in this frame. Drag a node to correct it.');
    document.getElementById('undo').disabled = !this.done.length;
    document.getElementById('redo').disabled = !this.undone.length;
    document.getElementById('remove').disabled = !list.some((c) => c.selected);
    this.legend(frame);
    const { look, reasons } = this.track;
    text('track-reasons', [reasons.length && look !== 'right' && look !== 'leave_out' && `To look at: ${reasons.join('; ')}.`, look === 'outdated' && 'It has changed since somebody looked at it.'].filter(Boolean).join(' '));
    for (const [id, found] of [['look-right', 'right'], ['look-out', 'leave_out']]) {
      document.getElementById(id).disabled = false;
      document.getElementById(id).setAttribute('aria-pressed', look === found);
    }
    const numbers = this.track.frames.map((f) => f.number);
    page.scrubber.update(this.frame, {
      neutral: numbers[0],
      apex: numbers.at(-1),
      classes: (n) => [this.stale !== null && n > this.stale && 'stale', this.corrections(this.frames.get(n)).length && 'corrected'].filter(Boolean).join(' '),
      fill: (n) => (n === numbers[0] ? 0 : this.lost(this.frames.get(n)) / this.live.length),
      words: (n) => (n === numbers[0] ? '' : `${this.lost(this.frames.get(n))} lost`),
    });
    page.showProblem(null);
  }

  hint(lost) {
    if (this.stale !== null && this.frame >= this.stale && this.frame !== this.track.frames.at(-1).number) return 'Corrected. The later frames have not changed yet. Press R to track them again.';
    if (this.isNeutral()) return 'Press the full stop (.) or use the slider for the next frame. Bars below the frames show how many nodes were lost.';
    return lost ? 'The springs, or the face found again, placed the lost nodes. If a node is in the wrong place, drag it.' : 'If a node is in the wrong place, drag it.';
  }

  /** A node's state in words. */
  word(state) {
    return (state === 'marked' && NOT_MARKED[this.track.marksFrom]) || (WORDS[state] ?? state);
  }

  legend(frame) {
    const rows = this.setup.states
      .map(({ name, colour }) => [name, colour, this.live.filter((n) => frame.states[n] === name).length])
      .filter(([, , count]) => count);
    document.getElementById('legend').replaceChildren(
      ...rows.flatMap(([name, colour, count]) => {
        const term = document.createElement('dt');
        const swatch = document.createElement('i');
        swatch.style.background = colour;
        term.append(swatch, this.word(name));
        const value = document.createElement('dd');
        value.textContent = count;
        return [term, value];
      }),
    );
  }

  key(event, name) {
    const step = event.shiftKey ? 0.1 : event.ctrlKey || event.altKey || event.metaKey ? 10 : 1;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (arrows[name]) {
      const [dx, dy] = arrows[name].map((v) => v * step);
      if (this.selected === null || this.isNeutral()) this.page.stage.pan(-arrows[name][0] * 40, -arrows[name][1] * 40);
      else this.nudge(dx, dy);
      return true;
    }
    const keys = {
      r: () => this.retrack(),
      y: () => this.look('right'),
      x: () => this.look('leave_out'),
      Delete: () => this.release(),
      Backspace: () => this.release(),
      Escape: () => ((this.selected = null), this.render(), this.page.stage.hideLoupe()),
      Home: () => this.page.scrubber.first(),
      End: () => this.page.scrubber.last(),
      '[': () => this.cycle(-1),
      ']': () => this.cycle(1),
    };
    if (!keys[name]) return false;
    keys[name]();
    return true;
  }

  async nudge(dx, dy) {
    const [x, y] = this.current().nodes[this.selected];
    const [nx, ny] = this.page.stage.clamp([x + dx, y + dy]);
    const node = this.selected;
    if (this.saving) return;
    this.saving = true;
    await this.correct(this.frame, [...this.corrections().filter((c) => c.node !== node), { node, x: nx, y: ny }]);
    this.saving = false;
    this.page.stage.showLoupeBriefly([nx, ny]);
  }

  /** Selects the next lost node of the frame, or the next suggested node if none is lost. */
  cycle(by) {
    const frame = this.current();
    const lost = this.live.filter((n) => frame.states[n].startsWith('recovered'));
    const nodes = lost.length ? lost : this.setup.suggested;
    this.pick(nodes[(nodes.indexOf(this.selected) + by + nodes.length) % nodes.length]);
  }
}
