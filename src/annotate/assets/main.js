// Starts the page: header, list, dialogs, keys. Marks are made in marking.js, tracks corrected in tracking.js.

import { Diagram } from './diagram.js';
import { Marking, sentence } from './marking.js';
import { Scrubber } from './scrubber.js';
import { Drafts, Refusal, Saver, ask, sequencePath } from './server.js';
import { Stage } from './stage.js';
import { Tracking } from './tracking.js';

const NOTICE_MS = 7000;
const THEMES = ['', 'light', 'dark'];

const KEYS = {
  marks: [
    ['Click or tap', 'mark the next node'],
    ['Space', 'place the next node at its expected position'],
    ['A', 'accept the proposed marks'],
    ['← ↑ → ↓', 'move the selected node by 1 px'],
    ['Shift + arrow', '… by 0.1 px'],
    ['Ctrl + arrow', '… by 10 px'],
    ['Del', 'delete a mark, or release a node set by hand'],
    ['Ctrl + Z', 'undo'],
    ['Ctrl + Shift + Z', 'redo'],
    ['[ and ]', 'previous node, next node'],
    ['/', 'pick any node by name'],
    ['Enter', 'next sequence with too few marks'],
    ['Page up, down', 'previous sequence, next sequence'],
    ['Q', 'all sequences'],
    [', and .', 'previous frame, next frame'],
    ['Home, End', 'neutral frame, apex frame'],
    ['F and L', 'make this the neutral frame, the apex frame'],
    ['+ − 0', 'zoom in, out, whole image'],
    ['Z', 'zoom to the face'],
    ['W and M', 'wireframe on or off, magnifier on or off'],
    ['D', 'light or dark colours'],
    ['Esc', 'clear the selection'],
  ],
  tracks: [
    [', and .', 'previous frame, next frame'],
    ['Home, End', 'neutral frame, apex frame'],
    ['Drag', 'correct a node in this frame'],
    ['[ and ]', 'previous, next lost node'],
    ['← ↑ → ↓', 'move the selected node by 1 px'],
    ['Shift + arrow', '… by 0.1 px'],
    ['Ctrl + arrow', '… by 10 px'],
    ['R', 'track again from this frame'],
    ['Y', 'this sequence looks right'],
    ['X', 'leave this sequence out of the statistics'],
    ['Del', 'release a corrected node'],
    ['Ctrl + Z', 'undo a correction'],
    ['Ctrl + Shift + Z', 'redo'],
    ['/', 'pick any node by name'],
    ['Enter', 'next track to look at'],
    ['Page up, down', 'previous track, next track'],
    ['Q', 'all tracks'],
    ['+ − 0', 'zoom in, out, whole image'],
    ['Z', 'zoom to the face'],
    ['W and M', 'wireframe on or off, magnifier on or off'],
    ['D', 'light or dark colours'],
    ['Esc', 'clear the selection'],
  ],
};

const get = (id) => document.getElementById(id);
const on = (id, event, act) => get(id).addEventListener(event, act);

/** Shows all keys, scrolled to the first. */
function showHelp() {
  get('help').showModal();
  get('help').scrollTop = 0;
}

class Page {
  async start() {
    this.theme(this.storedTheme());
    this.setup = await ask('api/setup');
    const { mode, title } = this.setup;
    document.body.classList.add(mode);
    document.title = `${title} · grimace annotate`;
    if (mode === 'tracks') get('list-title').textContent = 'Corrections';
    const name = (n) => this.setup.nodes[n].name;
    this.drafts = new Drafts(this.setup.key);
    this.saver = new Saver(this.drafts, (state, text) => this.showSaved(state, text), (id, current, marks) => this.conflict(id, current, marks));
    this.stage = new Stage(this);
    this.scrubber = new Scrubber((number) => this.work.showFrame(number));
    this.work = mode === 'tracks' ? new Tracking(this) : new Marking(this);
    this.diagram = new Diagram(get('diagram'), this.setup, (n) => this.work.pick(n), (n) => sentence(name(n)));
    this.fillNodes();
    this.fillKeys(mode);
    this.listen();
    await this.refreshList();
    const wanted = decodeURIComponent(location.hash.slice(1));
    // Marks that did not reach the server come first: opening their sequence offers them.
    const drafts = mode === 'marks' ? this.drafts.ids() : [];
    const listed = (id) => this.sequences.find((s) => s.id === id);
    const first = listed(wanted) ?? drafts.map(listed).find(Boolean) ?? this.sequences.find((s) => this.isLeft(s)) ?? this.sequences[0];
    if (first) await this.open(first.id);
    else this.allDone();
    const others = drafts.filter((id) => id !== first?.id);
    if (others.length) {
      const hidden = others.some((id) => !listed(id)) ? ' Sequences with enough marks are listed by “grimace annotate DATASET --all”.' : '';
      const [have, them] = others.length === 1 ? ['1 sequence has', 'it'] : [`${others.length} sequences have`, 'them'];
      this.notice(`${have} changes that were not saved: ${others.slice(0, 5).join(', ')}. Open ${them} to save them.${hidden}`, true);
    }
  }

  // Calls of the stage, passed to the current work.

  hit(...what) { return this.work.hit(...what); }
  tap(...what) {
    if (!this.isOpen()) return;
    this.hideNotice();
    this.work.tap(...what);
  }
  dragStart(...what) { this.hideNotice(); this.work.dragStart(...what); }
  dragMove(...what) { this.work.dragMove(...what); }
  dragEnd(...what) { this.work.dragEnd(...what); }
  unreadable() { this.notice(`Frame ${this.work.frame} cannot be read: its file is damaged or is no picture.`, true); }
  wantsLoupe() { return this.work.wantsLoupe(); }

  /** The part of a wireframe that the view zooms to: without skull and outline. */
  innerFace(nodes) {
    return this.setup.nodes.filter((n) => n.live && n.region !== 'forehead' && n.region !== 'contour').map((n) => nodes[n.id]);
  }

  /** Whether a sequence or a track is open. If it cannot be opened, the stage is empty. */
  isOpen() {
    return Boolean(this.work.sequence ?? this.work.track);
  }

  // Sequences.

  /** Its emotion, and its confidence if `grimace segment` proposed it. */
  label(sequence) {
    const confidence = sequence?.confidence === undefined ? '' : `confidence ${sequence.confidence.toFixed(2)}`;
    return [sequence?.emotion, confidence].filter(Boolean).join(' · ');
  }

  isLeft(sequence) {
    return this.setup.mode === 'marks' ? sequence.marks < this.setup.enough : sequence.doubtful && !['right', 'leave_out'].includes(sequence.look);
  }

  async refreshList() {
    const list = await ask('api/sequences');
    this.sequences = list.sequences;
    this.failures = list.failures;
    this.total = list.total;
    this.showProgress();
  }

  async open(id) {
    try {
      this.hideNotice();
      this.stage.hideLoupe();
      await this.work.open(id);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.work.close();
      this.notice(`${id}: ${error.message}`, true);
    }
    this.id = id;
    history.replaceState(null, '', `#${encodeURIComponent(id)}`);
    const sequence = this.sequences.find((s) => s.id === id);
    get('sequence').textContent = id;
    get('emotion').textContent = this.label(sequence);
    this.showProgress();
  }

  step(by) {
    const at = this.sequences.findIndex((s) => s.id === this.id);
    const next = this.sequences[at + by];
    if (next) this.open(next.id);
    else this.notice(by > 0 ? `This is the last ${this.setup.mode === 'tracks' ? 'track' : 'sequence'}.` : `This is the first ${this.setup.mode === 'tracks' ? 'track' : 'sequence'}.`);
  }

  /** Opens the next sequence that needs marks, else the next proposed one; in the mode `tracks`, the next track to look at, else the next. */
  goOn() {
    const at = this.sequences.findIndex((s) => s.id === this.id);
    const round = [...this.sequences.slice(at + 1), ...this.sequences.slice(0, at)];
    const left = round.find((s) => this.isLeft(s));
    if (this.setup.mode === 'tracks') return left ? this.open(left.id) : this.step(1);
    const next = left ?? this.sequences.slice(at + 1).find((s) => s.confidence !== undefined);
    if (next) this.open(next.id);
    else if (this.sequences.some((s) => this.isLeft(s))) this.notice(`This sequence is the last one left: it has fewer than ${this.setup.enough} marks.`);
    else this.allDone();
  }

  allDone() {
    const text = this.sequences.length
      ? `All ${this.sequences.length} sequences have ${this.setup.enough} marks or more. Now run in a terminal: grimace run DATASET -o results`
      : `All ${this.total} sequences have enough marks. “grimace annotate DATASET --all” opens them.`;
    this.askUser('Nothing left to mark', text, 'Close', null);
  }

  /** Updates the number of marks of a sequence. */
  counted(id, marks) {
    const sequence = this.sequences.find((s) => s.id === id);
    if (sequence) sequence.marks = marks;
    this.showProgress();
  }

  /** A track was looked at. */
  looked(id, look) {
    const sequence = this.sequences.find((s) => s.id === id);
    if (sequence) sequence.look = look;
    this.showProgress();
  }

  showProgress() {
    const { sequences, setup } = this;
    const at = sequences.findIndex((s) => s.id === this.id) + 1;
    if (setup.mode === 'tracks') {
      const left = sequences.filter((s) => this.isLeft(s)).length;
      get('left').textContent = `${at || '–'} of ${sequences.length} tracks${left ? `, ${left} to look at` : ''}`;
      get('done').hidden = true;
      return;
    }
    const left = sequences.filter((s) => this.isLeft(s)).length;
    const proposed = sequences.some((s) => s.confidence !== undefined);
    get('left').textContent = left || !proposed ? `${left} of ${sequences.length} left` : `${at || '–'} of ${sequences.length} proposals`;
    get('done').max = Math.max(1, sequences.length);
    get('done').value = sequences.length - left;
  }

  showSequences() {
    const draw = () => {
      const words = get('filter').value.toLowerCase().split(/\s+/).filter(Boolean);
      const fits = (s) => words.every((w) => `${s.id} ${s.emotion}`.toLowerCase().includes(w));
      const fitting = this.sequences.filter(fits);
      get('found').textContent = fitting.length ? '' : 'No sequence matches.';
      get('sequence-list').replaceChildren(
        ...fitting.slice(0, 500).map((s) => {
          const item = document.createElement('li');
          const button = document.createElement('button');
          const part = (className, text) => Object.assign(document.createElement('span'), { className, textContent: text });
          const state = this.setup.mode === 'tracks' ? `${(100 * s.trackedShare).toFixed(1)} % tracked${s.corrected ? ` · ${s.corrected} corrected` : ''}${s.look === 'right' ? ' · right' : s.look === 'leave_out' ? ' · left out' : this.isLeft(s) ? ' · to look at' : ''}` : s.marks ? `${s.marks} marks` : 'no marks';
          button.append(part('id', s.id), part('emotion', this.label(s)), part(`state${this.isLeft(s) ? '' : ' done'}`, state));
          if (s.id === this.id) button.setAttribute('aria-current', 'true');
          button.addEventListener('click', () => {
            get('sequences').close();
            this.open(s.id);
          });
          item.append(button);
          return item;
        }),
      );
    };
    get('filter').value = '';
    get('filter').oninput = draw;
    // Enter opens the first that matches; arrows go through the list.
    get('sequences').onkeydown = (event) => {
      const rows = [...get('sequence-list').querySelectorAll('button')];
      const at = rows.indexOf(document.activeElement);
      const to = { ArrowDown: at + 1, ArrowUp: at - 1 }[event.key];
      if (event.key === 'Enter' && document.activeElement === get('filter')) rows[0]?.click();
      else if (to !== undefined && to < 0) get('filter').focus();
      else if (to !== undefined) rows[Math.min(to, rows.length - 1)]?.focus();
      else return;
      event.preventDefault();
    };
    get('failures').textContent = this.failures.length ? `Not shown: ${this.failures.join('; ')}` : '';
    draw();
    get('sequences').showModal();
    get('sequence-list').querySelector('[aria-current]')?.scrollIntoView({ block: 'center' });
  }

  // Two tabs.

  async conflict(id, current, marks) {
    const mine = await this.askUser(
      'Changed elsewhere',
      `Another tab or program has saved ${current.marks.length} marks for ${id} since this page read them. This page has ${marks.length}. Which marks do you want to keep?`,
      'Keep the marks of this page', 'Use the saved marks', true);
    if (mine === null) {
      this.saver.held.add(id);
      this.showSaved('failed', 'Not saved: changed elsewhere. You are asked again at the next change.');
      return;
    }
    this.saver.held.delete(id);
    this.saver.read(id, current.version);
    if (mine) this.saver.save(id, marks);
    else {
      this.drafts.drop(id);
      this.counted(id, current.marks.length);
      this.showSaved('saved', 'Saved marks loaded');
      if (this.work.id === id) {
        this.work.take(current);
        this.work.showFrame(current.neutral);
        // Undo brings back the marks of this page.
        this.work.remember(marks);
      }
    }
  }

  /** When the user returns to this tab: shows what another tab has saved in the meantime. */
  async lookAgain() {
    if (document.hidden || !this.isOpen() || this.setup.mode !== 'marks' || !this.saver.isSaved(this.id)) return;
    try {
      const current = await ask(sequencePath(this.id));
      if (current.id !== this.id || !this.saver.isSaved(this.id) || current.version === this.saver.versions.get(this.id)) return;
      this.work.take(current);
      this.work.showFrame(current.neutral);
      this.counted(this.id, current.marks.length);
      this.notice('Another tab has changed this sequence. Its marks are now shown.');
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
    }
  }

  // Small parts of the page.

  showSaved(state, text) {
    const box = get('saved');
    box.className = state;
    box.textContent = text;
  }

  notice(text, stay = false) {
    const box = get('notice');
    box.textContent = text;
    box.hidden = false;
    box.classList.remove('problem');
    clearTimeout(this.noticeTimer);
    if (!stay) this.noticeTimer = setTimeout(() => this.hideNotice(), NOTICE_MS);
  }

  hideNotice() {
    get('notice').hidden = true;
  }

  /** Shows a problem with the marks until it is solved. */
  showProblem(text) {
    const box = get('notice');
    if (text) {
      // The command line names nodes by number, this page by name.
      const named = (n) => `“${this.setup.nodes[n]?.name ?? n}”`;
      const said = text.replace(/nodes (\d+ and \d+(?:, \d+ and \d+)*)/g, (_, list) => list.replace(/\d+/g, named));
      this.notice(sentence(said), true);
      box.classList.add('problem');
    } else if (box.classList.contains('problem')) {
      this.hideNotice();
      box.classList.remove('problem');
    }
  }

  /**
   * Asks a question with one or two answers, one question at a time. Gives `true` for the first answer, `false` for the second, `null` if
   * the dialog was closed. A `sudden` question may appear while the user works; its buttons have no focus, so that no key answers it.
   */
  askUser(...what) {
    const answer = (this.asked ?? Promise.resolve()).then(() => this.askNow(...what));
    this.asked = answer;
    return answer;
  }

  askNow(title, text, yes, no, sudden = false) {
    const dialog = get('ask');
    get('ask-title').textContent = title;
    get('ask-text').textContent = text;
    get('ask-yes').textContent = yes;
    get('ask-no').textContent = no ?? '';
    get('ask-no').hidden = no === null;
    dialog.showModal();
    get(sudden ? 'ask-title' : 'ask-yes').focus();
    return new Promise((answer) => {
      const finish = (value) => {
        dialog.onclose = null;
        dialog.close();
        answer(value);
      };
      get('ask-yes').onclick = () => finish(true);
      get('ask-no').onclick = () => finish(false);
      dialog.onclose = () => answer(null);
    });
  }

  showList(rows, empty) {
    const list = get('list');
    const focused = list.contains(document.activeElement) ? document.activeElement.dataset : null;
    list.replaceChildren(
      ...rows.map(({ node, kind, selected, detail, action }) => {
        const name = sentence(this.setup.nodes[node].name);
        const item = document.createElement('li');
        item.className = `${kind}${selected ? ' selected' : ''}`;
        const button = Object.assign(document.createElement('button'), { className: 'name' });
        button.dataset.pick = node;
        button.setAttribute('aria-pressed', selected);
        button.append(Object.assign(document.createElement('i'), { className: `symbol ${kind}` }), Object.assign(document.createElement('span'), { textContent: name }), Object.assign(document.createElement('small'), { textContent: detail, title: kind === 'mark' ? 'distance from the mark to the fitted node' : '' }));
        button.addEventListener('click', () => this.work.pick(node));
        const drop = Object.assign(document.createElement('button'), { className: 'drop', textContent: action === 'Release' ? 'Release' : '✕' });
        drop.dataset.drop = node;
        drop.setAttribute('aria-label', `${action} ${name}`);
        drop.addEventListener('click', () => (this.setup.mode === 'tracks' ? this.work.release(node) : this.work.remove(node)));
        item.append(button, drop);
        return item;
      }),
    );
    get('list-empty').textContent = rows.length ? '' : empty;
    if (focused?.pick) list.querySelector(`[data-pick="${focused.pick}"]`)?.focus();
  }

  fillNodes() {
    const select = get('node');
    const groups = new Map();
    const add = (node) => {
      const label = node.markable ? sentence(node.region) : `${sentence(node.region)}, other nodes`;
      if (!groups.has(label)) groups.set(label, Object.assign(document.createElement('optgroup'), { label }));
      const words = `${sentence(node.name)}${node.fp ? ` · ${node.fp}` : ''}${node.markable ? '' : ` · node ${node.id}`}`;
      groups.get(label).append(new Option(words, node.id));
    };
    this.setup.nodes.filter((n) => n.live && n.markable).forEach(add);
    this.setup.nodes.filter((n) => n.live && !n.markable).forEach(add);
    select.append(new Option('Choose by name…', ''), ...groups.values());
    select.addEventListener('change', () => {
      if (select.value !== '') this.work.pick(Number(select.value));
      select.value = '';
      this.stage.root.focus({ preventScroll: true });
    });
  }

  fillKeys(mode) {
    get('keys').replaceChildren(
      ...KEYS[mode].map(([keys, meaning]) => {
        const row = document.createElement('div');
        row.append(Object.assign(document.createElement('kbd'), { textContent: keys }), Object.assign(document.createElement('span'), { textContent: meaning }));
        return row;
      }),
    );
  }

  storedTheme() {
    try {
      return localStorage.getItem('grimace:theme') ?? '';
    } catch {
      return '';
    }
  }

  theme(name) {
    document.documentElement.dataset.theme = name;
    try {
      localStorage.setItem('grimace:theme', name);
    } catch { /* Then the choice is not remembered. */ }
  }

  nextTheme() {
    const name = THEMES[(THEMES.indexOf(document.documentElement.dataset.theme) + 1) % THEMES.length];
    this.theme(name);
    this.notice(name ? `${sentence(name)} colours.` : 'Colours of the system.');
  }

  toggle(button, act) {
    const pressed = get(button).getAttribute('aria-pressed') !== 'true';
    get(button).setAttribute('aria-pressed', pressed);
    act(pressed);
  }

  toggleWire() {
    this.toggle('wire-toggle', (shown) => this.stage.root.classList.toggle('bare', !shown));
  }

  toggleLoupe() {
    this.toggle('loupe-toggle', (shown) => {
      this.stage.loupeOn = shown;
      if (!shown) this.stage.hideLoupe();
    });
  }

  listen() {
    on('previous', 'click', () => this.step(-1));
    on('next', 'click', () => this.goOn());
    on('pick', 'click', () => this.showSequences());
    on('help-open', 'click', showHelp);
    on('theme', 'click', () => this.nextTheme());
    on('zoom-in', 'click', () => this.stage.zoomBy(1.25));
    on('zoom-out', 'click', () => this.stage.zoomBy(0.8));
    on('zoom-fit', 'click', () => this.stage.fit());
    on('zoom-face', 'click', () => this.isOpen() && this.work.showFace());
    on('wire-toggle', 'click', () => this.toggleWire());
    on('loupe-toggle', 'click', () => this.toggleLoupe());
    addEventListener('keydown', (event) => this.key(event));
    document.addEventListener('visibilitychange', () => this.lookAgain());
    addEventListener('focus', () => this.lookAgain());
    addEventListener('beforeunload', (event) => {
      if (this.id && !this.saver.isSaved(this.id)) event.preventDefault();
    });
  }

  key(event) {
    if (document.querySelector('dialog[open]')) return;
    const field = event.target.closest('input:not([type=range]), select, textarea');
    if (field) return;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const command = event.ctrlKey || event.metaKey;
    const onButton = event.target.closest('button, [type=range]');
    // A focused button keeps the keys that press it, a slider the keys that move it.
    if (onButton && (name === 'Enter' || name === ' ')) return;
    if (event.target.matches('[type=range]') && (name.startsWith('Arrow') || name === 'Home' || name === 'End')) return;
    if (command && (name === 'z' || name === 'y')) {
      event.preventDefault();
      if (name === 'y' || event.shiftKey) this.work.redo();
      else this.work.undo();
      return;
    }
    if (command && !name.startsWith('Arrow')) return;
    const keys = {
      '?': showHelp,
      h: showHelp,
      Enter: () => (event.shiftKey ? this.step(-1) : this.goOn()),
      PageDown: () => this.step(1),
      PageUp: () => this.step(-1),
      q: () => this.showSequences(),
      ',': () => this.scrubber.step(-1),
      '.': () => this.scrubber.step(1),
      '+': () => this.stage.zoomBy(1.25),
      '=': () => this.stage.zoomBy(1.25),
      '-': () => this.stage.zoomBy(0.8),
      0: () => this.stage.fit(),
      z: () => this.isOpen() && this.work.showFace(),
      w: () => this.toggleWire(),
      m: () => this.toggleLoupe(),
      d: () => this.nextTheme(),
      '/': () => get('node').focus(),
    };
    if (keys[name]) keys[name]();
    else if (!this.isOpen()) return;
    else if (!this.work.key(event, name)) return;
    event.preventDefault();
  }
}

const page = new Page();
page.start().catch((error) => page.notice(`The page could not start: ${error.message}. Is grimace annotate still running?`, true));
