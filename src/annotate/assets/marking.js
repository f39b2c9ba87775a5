// Marking the neutral frame of a sequence.

import { Newest, Refusal, ask, framePath, sequencePath } from './server.js';

const MARK_REACH = 13;
const NODE_REACH = 9;
const NUDGE_PAUSE_MS = 700;

export const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

export class Marking {
  constructor(page) {
    this.page = page;
    this.setup = page.setup;
    this.fitter = new Newest((...what) => this.askFit(...what));
    this.live = this.setup.nodes.filter((n) => n.live).map((n) => n.id);
    const on = (id, act) => document.getElementById(id).addEventListener('click', () => this.sequence && act());
    on('accept', () => this.accept());
    on('dismiss', () => this.dismiss());
    on('undo', () => this.undo());
    on('redo', () => this.redo());
    on('remove', () => this.remove());
    on('set-neutral', () => this.setRange(this.frame, this.sequence.apex));
    on('set-apex', () => this.setRange(this.sequence.neutral, this.frame));
  }

  async open(id) {
    const sequence = await ask(sequencePath(id));
    this.id = id;
    this.frame = sequence.neutral;
    this.page.stage.forgetView();
    this.page.scrubber.open(id, sequence.frames);
    this.take(sequence);
    this.showFrame(this.frame);
    this.propose();
    const draft = this.page.drafts.of(id);
    if (draft && this.page.saver.isSaved(id)) this.offerDraft(draft);
  }

  /** No sequence, nothing to mark. */
  close() {
    this.id = null;
    this.sequence = null;
    this.startWith([]);
    this.fitter.forget();
    this.page.stage.clear();
    this.page.scrubber.clear();
    this.page.showList([], '');
    document.getElementById('proposal-bar').hidden = true;
    delete document.getElementById('proposal-bar').dataset.answered;
    for (const id of ['undo', 'redo', 'remove', 'set-neutral', 'set-apex']) document.getElementById(id).disabled = true;
    for (const id of ['step', 'target']) document.getElementById(id).textContent = '';
    document.getElementById('hint').textContent = 'This sequence cannot be opened. Press › for the next one.';
  }

  /** Remembers earlier marks as one step to undo. */
  remember(marks) {
    this.done.push([...marks].sort((a, b) => a.node - b.node));
    this.render();
  }

  /** Starts with these marks, with nothing to undo, chosen, proposed or fitted. */
  startWith(marks) {
    this.marks = new Map(marks.map((m) => [m.node, m]));
    this.proposals = [];
    this.offered = [];
    this.undone = [];
    this.done = [];
    this.selected = null;
    this.chosen = null;
    this.fit = null;
  }

  /** Shows a sequence as saved on the server. */
  take(sequence) {
    this.sequence = sequence;
    this.page.saver.read(this.id, sequence.version);
    this.startWith(sequence.marks);
    this.problem = sequence.problem;
    // The view zooms to the face once, before anything is marked here: it must not move while the user marks.
    this.fresh = sequence.marks.length >= this.setup.minimum;
    this.refit();
    this.render();
  }

  async offerDraft(draft) {
    const same = JSON.stringify([...draft].sort((a, b) => a.node - b.node)) === JSON.stringify(this.sequence.marks);
    const restore = !same && (await this.page.askUser('Marks that were not saved', 'The last changes to this sequence did not reach the server. Do you want to restore them?', 'Restore', 'Discard', true));
    if (restore === null || this.sequence === null) return;
    if (restore) this.change(() => (this.marks = new Map(draft.map((m) => [m.node, m]))));
    else this.page.drafts.drop(this.id);
  }

  // Current state.

  list() {
    return [...this.marks.values()].sort((a, b) => a.node - b.node);
  }

  onNeutral() {
    return this.frame === this.sequence.neutral;
  }

  /** The node that a tap marks. */
  next() {
    if (this.chosen !== null && !this.marks.has(this.chosen)) return this.chosen;
    if (this.marks.size >= this.setup.askedFor) return null;
    return this.setup.suggested.find((n) => !this.marks.has(n)) ?? null;
  }

  point(node) {
    const mark = this.marks.get(node);
    if (mark) return [mark.x, mark.y];
    return this.fit?.nodes[node] ?? null;
  }

  // Changes. Each is one step to undo, and is saved at once.

  change(act) {
    const before = this.list();
    act();
    this.commit(before);
  }

  commit(before) {
    this.done.push(before);
    this.undone = [];
    this.changed();
  }

  changed() {
    this.fresh = false;
    // Undoing a mark that was proposed brings the proposal back.
    if (this.marks.size < this.setup.enough) this.proposals = this.offered;
    this.proposals = this.proposals.filter((p) => !this.marks.has(p.node));
    if (this.chosen !== null && this.marks.has(this.chosen)) this.chosen = null;
    this.refit();
    this.render();
    if (this.problem) return this.page.notice(this.problem);
    this.page.saver.save(this.id, this.list());
    this.page.counted(this.id, this.marks.size);
  }

  undo() {
    this.swap(this.done, this.undone);
  }

  redo() {
    this.swap(this.undone, this.done);
  }

  swap(from, to) {
    const marks = from.pop();
    if (!marks) return;
    to.push(this.list());
    this.marks = new Map(marks.map((m) => [m.node, m]));
    if (!this.marks.has(this.selected)) this.selected = null;
    this.nudged = null;
    this.changed();
  }

  place(node, [x, y], kind = 'mark') {
    this.put({ node, x, y, kind });
  }

  put(mark) {
    this.change(() => this.marks.set(mark.node, mark));
    this.selected = mark.node;
    this.render();
  }

  /** Accepts a proposal unchanged, with its expected error. */
  adopt(proposal) {
    this.put({ ...proposal, kind: 'mark' });
  }

  remove(node = this.selected) {
    if (!this.marks.has(node)) return;
    this.change(() => this.marks.delete(node));
    this.selected = null;
    this.render();
  }

  accept() {
    if (!this.proposals.length) {
      this.waiting = document.getElementById('proposal-bar').dataset.answered !== this.id;
      if (this.waiting) this.render();
      return;
    }
    this.change(() => {
      for (const p of this.proposals) this.marks.set(p.node, { ...p, kind: 'mark' });
      this.proposals = [];
    });
  }

  dismiss() {
    this.proposals = [];
    this.offered = [];
    this.refit();
    this.render();
  }

  /** Picks a node: a marked node is selected, any other is marked by the next tap. */
  pick(node) {
    if (!this.sequence) return;
    this.selected = this.marks.has(node) || this.fit ? node : null;
    this.chosen = this.marks.has(node) ? null : node;
    this.render();
    const point = this.point(node);
    if (point && this.onNeutral()) this.page.stage.showLoupeBriefly(point);
  }

  /** Places the next node at its expected position, from where the arrow keys move it: marking without a pointer. */
  placeExpected() {
    const node = this.next() ?? this.selected;
    if (node === null || this.marks.has(node) || !this.needsNeutral()) return;
    const proposal = this.proposals.find((p) => p.node === node);
    if (proposal) {
      this.adopt(proposal);
      this.page.stage.showLoupeBriefly(this.point(node));
      return;
    }
    const [w, h] = this.page.stage.size;
    const { x, y } = this.setup.nodes[node];
    // Candide's face is about 2 units high; here it fills half of the image.
    const scale = Math.min(w, h) / 4;
    const guess = [w / 2 + x * scale, h / 2 + y * scale];
    this.place(node, this.page.stage.clamp(this.fit?.nodes[node] ?? guess));
    this.page.stage.showLoupeBriefly(this.point(node));
  }

  nudge(dx, dy) {
    const point = this.selected === null ? null : this.point(this.selected);
    if (!point || !this.needsNeutral()) return;
    const [x, y] = this.page.stage.clamp([point[0] + dx, point[1] + dy]);
    const now = performance.now();
    const continues = this.nudged && this.nudged.node === this.selected && now - this.nudged.time < NUDGE_PAUSE_MS;
    const before = this.list();
    const kind = this.marks.get(this.selected)?.kind ?? 'hard';
    this.marks.set(this.selected, { node: this.selected, x, y, kind });
    // Presses in quick succession are one step to undo.
    if (continues) this.changed();
    else this.commit(before);
    this.nudged = { node: this.selected, time: now };
    this.page.stage.showLoupeBriefly([x, y]);
  }

  // The fit.

  refit() {
    const marks = this.list();
    const previewed = marks.length < this.setup.minimum ? [...marks, ...this.proposals] : marks;
    if (previewed.length < this.setup.minimum) {
      this.fit = null;
      this.fitter.forget();
      this.fitProblem = null;
      return;
    }
    this.fitter.ask(this.id, previewed, previewed !== marks);
  }

  async askFit(id, marks, preview) {
    const { width, height, neutral } = this.sequence;
    try {
      const start = performance.now();
      const answer = await ask('api/fit', 'POST', { marks, width, height, frame: { sequence: id, number: neutral } });
      if (id !== this.id) return;
      this.page.stage.root.dataset.fitMs = (performance.now() - start).toFixed(1);
      const needed = this.marks.size + this.proposals.length >= this.setup.minimum;
      if (answer.nodes && needed) this.fit = { ...answer, preview, residuals: new Map(marks.map((m, k) => [m.node, answer.residuals[k]])) };
      else if (this.fit) this.fit = { ...this.fit, preview: true };
      this.fitProblem = answer.problem && !preview ? answer.problem : null;
      if (this.fresh && this.fit && !this.page.stage.touched) this.showFace();
      this.fresh = false;
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.fitProblem = error.status ? error.message : null;
    }
    this.render();
  }

  async propose() {
    const id = this.id;
    this.proposalNote = '';
    this.waiting = false;
    delete document.getElementById('proposal-bar').dataset.answered;
    try {
      const answer = await ask(sequencePath(id, '/proposals'));
      if (id !== this.id) return;
      this.source = answer.source;
      this.proposalNote = answer.note || '';
      this.offered = answer.marks;
      if (this.marks.size < this.setup.enough) this.proposals = answer.marks.filter((p) => !this.marks.has(p.node));
      this.fresh ||= this.proposals.length > 0 && !this.marks.size;
      this.refit();
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      if (id !== this.id) return;
      this.proposalNote = error.message;
    }
    this.waiting = false;
    this.render();
    document.getElementById('proposal-bar').dataset.answered = id;
  }

  showFace() {
    if (this.fit) return this.page.stage.frameBox(this.page.innerFace(this.fit.nodes));
    const marked = [...this.marks.values(), ...this.proposals].map((m) => [m.x, m.y]);
    if (marked.length >= this.setup.minimum) this.page.stage.frameBox(marked);
  }

  // Frames.

  showFrame(number) {
    this.frame = number;
    const { width, height } = this.sequence;
    this.page.stage.show(framePath(this.id, number), width, height);
    this.render();
  }

  needsNeutral() {
    if (this.onNeutral()) return true;
    this.page.notice(`Marks belong to the neutral frame, ${this.sequence.neutral}. Press Home to go there, or F to make this frame the neutral one.`);
    return false;
  }

  async setRange(neutral, apex, createManifest = false) {
    if (this.page.stage.broken) return this.page.unreadable();
    const id = this.id;
    await this.page.saver.settled(id);
    try {
      const version = this.page.saver.versions.get(id);
      const sequence = await ask(sequencePath(id, '/range'), 'PUT', { version, neutral, apex, createManifest });
      if (id !== this.id) return;
      const moved = sequence.neutral !== this.sequence.neutral;
      // A long video now has other frames.
      if (String(sequence.frames) !== String(this.sequence.frames)) this.page.scrubber.open(id, sequence.frames);
      this.sequence = sequence;
      this.problem = sequence.problem;
      this.page.saver.read(id, sequence.version);
      this.page.showSaved('saved', 'Saved');
      if (moved && this.marks.size) this.page.notice(`Frame ${neutral} is now the neutral frame. The marks did not move: check whether they still fit.`);
      if (moved) this.refit();
      if (moved) this.propose();
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      if (error.status === 409) return this.page.conflict(id, error.body.current, this.list());
      if (error.status === 428) {
        if (await this.page.askUser('Write manifest.csv?', `${sentence(error.message)}.`, 'Write it', 'Cancel')) return this.setRange(neutral, apex, true);
        return;
      }
      this.page.notice(sentence(error.message));
    }
    this.render();
  }

  // Calls of the stage.

  hit([x, y], scale) {
    if (!this.sequence || !this.onNeutral()) return null;
    const nearest = (things, reach) => {
      let best = null;
      for (const thing of things) {
        const far = Math.hypot(thing.point[0] - x, thing.point[1] - y);
        if (far < reach * scale && (!best || far < best.far)) best = { ...thing, far };
      }
      return best;
    };
    const own = [...this.list().map((m) => ({ type: 'mark', node: m.node, point: [m.x, m.y] })), ...this.proposals.map((p) => ({ type: 'proposal', node: p.node, point: [p.x, p.y] }))];
    const found = nearest(own, MARK_REACH);
    if (found || !this.fit || this.fit.preview) return found;
    return nearest(this.live.filter((n) => !this.marks.has(n)).map((node) => ({ type: 'node', node, point: this.fit.nodes[node] })), NODE_REACH);
  }

  wantsLoupe() {
    return Boolean(this.sequence) && this.onNeutral() && this.next() !== null;
  }

  tap(point, thing) {
    if (!this.needsNeutral()) return;
    if (thing?.type === 'mark') {
      this.selected = thing.node;
    } else if (thing?.type === 'proposal') {
      return this.adopt(this.proposals.find((p) => p.node === thing.node));
    } else if (this.next() !== null) {
      return this.place(this.next(), point);
    } else {
      this.selected = thing ? thing.node : null;
    }
    this.render();
  }

  dragStart(thing) {
    this.before = this.list();
    this.selected = thing.node;
  }

  dragMove(thing, [x, y]) {
    const kind = this.marks.get(thing.node)?.kind ?? (thing.type === 'node' ? 'hard' : 'mark');
    this.marks.set(thing.node, { node: thing.node, x, y, kind });
    this.proposals = this.proposals.filter((p) => p.node !== thing.node);
    this.refit();
    this.drawSoon();
  }

  dragEnd() {
    this.commit(this.before);
  }

  /** Draws at most once a frame of the screen. */
  drawSoon() {
    if (this.drawing) return;
    this.drawing = requestAnimationFrame(() => {
      this.drawing = null;
      this.draw();
    });
  }

  // Drawing.

  render() {
    if (!this.sequence) return;
    this.draw();
    const next = this.next();
    const { page, setup } = this;
    page.diagram.update((n) => {
      const kind = this.marks.get(n)?.kind;
      const proposed = this.proposals.some((p) => p.node === n);
      return [kind && `marked ${kind}`, proposed && 'proposed', n === this.selected && 'selected'].filter(Boolean).join(' ');
    }, next);
    this.renderGuide(next);
    const order = (m) => (setup.suggested.indexOf(m.node) + 1 || 99) * 1000 + m.node;
    page.showList(
      [...this.marks.values()].sort((a, b) => order(a) - order(b)).map((m) => ({
        node: m.node,
        kind: m.kind,
        selected: m.node === this.selected,
        detail: m.kind === 'hard' ? 'set by hand' : m.expected_error ? `found, ± ${m.expected_error.toFixed(1)} px` : `${(this.fit?.residuals.get(m.node) ?? 0).toFixed(1)} px`,
        action: m.kind === 'hard' ? 'Release' : 'Delete',
      })),
      'No marks yet.',
    );
    document.getElementById('undo').disabled = !this.done.length;
    document.getElementById('redo').disabled = !this.undone.length;
    document.getElementById('remove').disabled = !this.marks.has(this.selected);
    const { neutral, apex, frames } = this.sequence;
    // If the manifest names a frame that does not exist, any frame can be chosen, also the one shown.
    document.getElementById('set-neutral').disabled = (this.frame === neutral && !this.problem) || this.frame === apex;
    document.getElementById('set-apex').disabled = (this.frame === apex && !this.problem) || this.frame === neutral || frames.length < 2;
    page.scrubber.update(this.frame, { neutral, apex });
    page.showProblem(this.problem || this.fitProblem);
  }

  renderGuide(next) {
    const { setup } = this;
    const text = (id, words) => (document.getElementById(id).textContent = words);
    const count = this.marks.size;
    const hard = this.list().filter((m) => m.kind === 'hard').length;
    text('step', next === null ? `${count} marks${hard ? `, ${hard} by hand` : ''}` : count < setup.askedFor ? `Mark ${count + 1} of ${setup.askedFor}` : `Mark ${count + 1}`);
    text('target', next === null ? 'All marked' : sentence(setup.nodes[next].name));
    const name = next === null ? '' : setup.nodes[next].name;
    const side = name.startsWith('left') ? 'On the right of the image. ' : name.startsWith('right') ? 'On the left of the image. ' : '';
    let hint = `${side}Click it in the image, or press Space.`;
    if (!this.onNeutral()) hint = `Marks belong to the neutral frame, ${this.sequence.neutral}: press Home.`;
    else if (next === null) hint = 'If a node is in the wrong place, drag it. Press Enter or › for the next sequence.';
    text('hint', hint);
    const bar = document.getElementById('proposal-bar');
    bar.hidden = !this.proposals.length && !(this.proposalNote && !count) && !this.waiting;
    document.getElementById('accept').parentElement.hidden = !this.proposals.length;
    const from = { landmarks: 'proposed from the dataset’s landmarks', found: 'found in the picture', cascades: 'proposed from OpenCV’s face cascades' }[this.source];
    const doubt = this.proposalNote ? ` ${sentence(this.proposalNote)}.` : '';
    const how = this.source === 'found' ? ' The size of a disc is the expected error. Drag points that are in the wrong place.' : '';
    text('proposal-text', this.proposals.length ? `${this.proposals.length} points ${from}.${how}${doubt} They become marks when you accept them.` : this.waiting ? 'Still searching for points. Press A again when they are shown.' : `No proposals: ${this.proposalNote}.`);
  }

  draw() {
    const { stage } = this.page;
    const shown = this.onNeutral();
    stage.root.dataset.frame = this.frame;
    stage.drawWire(this.setup, shown && this.fit ? this.fit.nodes : null, this.fit?.preview);
    const free = shown && this.fit ? this.live.filter((n) => !this.marks.has(n)).map((n) => this.fit.nodes[n]) : [];
    stage.drawDots([{ key: this.fit?.preview ? 'fitted faint' : 'fitted', points: free }]);
    if (!shown) return stage.drawMarks([]);
    const name = (n) => this.setup.nodes[n].name;
    const next = this.next();
    const marks = this.list().map((m) => ({ node: m.node, kind: m.kind, point: [m.x, m.y], error: m.expected_error, label: name(m.node), selected: m.node === this.selected }));
    const proposed = this.proposals.map((p) => ({ node: p.node, kind: 'proposal', point: [p.x, p.y], error: p.expected_error, label: name(p.node) }));
    const ghost = next !== null && this.fit && !proposed.some((p) => p.node === next) ? [{ node: next, kind: 'ghost', point: this.fit.nodes[next], label: name(next) }] : [];
    const pointed = this.selected !== null && !this.marks.has(this.selected) && this.fit ? [{ node: this.selected, kind: 'pointed', point: this.fit.nodes[this.selected], label: name(this.selected), selected: true }] : [];
    stage.drawMarks([...ghost, ...proposed, ...pointed, ...marks]);
  }

  /** Handles a key; returns whether it has a meaning here. */
  key(event, name) {
    const step = event.shiftKey ? 0.1 : event.ctrlKey || event.altKey || event.metaKey ? 10 : 1;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (arrows[name]) {
      const [dx, dy] = arrows[name];
      if (this.selected !== null && this.point(this.selected)) this.nudge(dx * step, dy * step);
      else this.page.stage.pan(-dx * 40, -dy * 40);
      return true;
    }
    const keys = {
      ' ': () => this.placeExpected(),
      a: () => this.accept(),
      Delete: () => this.remove(),
      Backspace: () => this.remove(),
      Escape: () => ((this.selected = null), (this.chosen = null), this.render(), this.page.stage.hideLoupe()),
      f: () => document.getElementById('set-neutral').click(),
      l: () => document.getElementById('set-apex').click(),
      Home: () => this.page.scrubber.choose(this.sequence.neutral),
      End: () => this.page.scrubber.choose(this.sequence.apex),
      '[': () => this.cycle(-1),
      ']': () => this.cycle(1),
    };
    if (!keys[name]) return false;
    keys[name]();
    return true;
  }

  /** Selects the previous or the next node among the suggested and the marked ones. */
  cycle(by) {
    const nodes = [...new Set([...this.setup.suggested, ...this.marks.keys()])];
    const at = nodes.indexOf(this.selected ?? this.next());
    this.pick(nodes[(at + by + nodes.length) % nodes.length]);
  }
}
