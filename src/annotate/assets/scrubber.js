// The frames of a sequence below the image: pictures to choose from, a slider, neutral and apex.

import { framePath } from './server.js';

const MAX_PICTURES = 40;

export class Scrubber {
  /** `choose(number)` is called when the user chooses another frame. */
  constructor(choose) {
    this.choose = choose;
    this.strip = document.getElementById('strip');
    this.range = document.getElementById('frame');
    this.text = document.getElementById('frame-text');
    this.frames = [];
    this.index = 0;
    this.range.addEventListener('input', () => this.choose(this.frames[Number(this.range.value)]));
    document.getElementById('frame-back').addEventListener('click', () => this.step(-1));
    document.getElementById('frame-on').addEventListener('click', () => this.step(1));
  }

  /** The frames of a sequence, in order. */
  open(id, frames) {
    this.frames = frames;
    // A single picture has no frames to choose from.
    document.getElementById('scrubber').hidden = frames.length < 2;
    this.range.max = frames.length - 1;
    const every = Math.ceil(frames.length / MAX_PICTURES);
    this.pictures = new Map();
    this.strip.replaceChildren(
      ...frames.filter((_, k) => k % every === 0).map((number) => {
        const cell = document.createElement('div');
        cell.className = 'cell';
        const image = new Image();
        image.src = framePath(id, number);
        image.loading = 'lazy';
        image.decoding = 'async';
        image.alt = '';
        image.draggable = false;
        cell.append(image, document.createElement('i'));
        this.pictures.set(number, cell);
        return cell;
      }),
    );
  }

  /** No frames. */
  clear() {
    this.frames = [];
    this.index = 0;
    this.range.max = 0;
    this.pictures = new Map();
    this.strip.replaceChildren();
    this.text.textContent = '';
  }

  /** Updates the shown frame, the neutral and the apex frame, and the look of every frame. */
  update(number, { neutral, apex, classes = () => '', fill = () => 0, words = () => '' }) {
    this.index = this.frames.indexOf(number);
    this.range.value = this.index;
    const role = number === neutral ? 'neutral' : number === apex ? 'apex' : '';
    const facts = [role, words(number)].filter(Boolean).join(', ');
    this.text.textContent = `Frame ${number}${facts ? ` · ${facts}` : ''}`;
    this.range.setAttribute('aria-valuetext', this.text.textContent);
    const numbers = [...this.pictures.keys()];
    const shown = numbers.filter((n) => n <= number).pop();
    for (const [n, cell] of this.pictures) {
      const names = ['cell', n === shown && 'shown', n === neutral && 'neutral', n === apex && 'apex', (n < Math.min(neutral, apex) || n > Math.max(neutral, apex)) && 'outside', classes(n)];
      cell.className = names.filter(Boolean).join(' ');
      cell.lastChild.style.height = `${Math.round(100 * fill(n))}%`;
    }
  }

  step(by) {
    const next = this.frames[this.index + by];
    if (next !== undefined) this.choose(next);
  }

  first() {
    this.choose(this.frames[0]);
  }

  last() {
    this.choose(this.frames[this.frames.length - 1]);
  }
}
