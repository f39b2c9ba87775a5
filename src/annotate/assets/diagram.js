// The small wireframe: shows the next node and the marked ones, and picks any other.

const SVG = 'http://www.w3.org/2000/svg';
const WIDTH = 300;
const MARGIN = 14;
const LIFT = 0.12;

export function element(name, attributes = {}, text = undefined) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

/** A path through pairs or chains of nodes. */
export function chains(lists, place) {
  return lists.map((nodes) => `M${nodes.map((n) => place(n).map((v) => v.toFixed(2)).join(' ')).join('L')}`).join('');
}

export class Diagram {
  /** Draws the frontal wireframe of `setup` into `svg`; `pick(node)` is called for a chosen node, `name(node)` gives its name. */
  constructor(svg, setup, pick, name) {
    this.svg = svg;
    const live = setup.nodes.filter((n) => n.live);
    const [xs, ys] = [live.map((n) => n.x), live.map((n) => n.y)];
    const left = Math.min(...xs);
    // Nodes above the brows are rarely marked: the skull is cut off to leave room for the face.
    const brows = setup.nodes.filter((n) => n.region === 'brow').map((n) => n.y);
    const top = Math.max(Math.min(...ys), Math.min(...brows) - LIFT * 3);
    const scale = (WIDTH - 2 * MARGIN) / (Math.max(...xs) - left);
    const height = (Math.max(...ys) - top) * scale + 2 * MARGIN;
    svg.setAttribute('viewBox', `0 0 ${WIDTH} ${height.toFixed(1)}`);
    this.place = (n) => [(setup.nodes[n].x - left) * scale + MARGIN, (setup.nodes[n].y - top) * scale + MARGIN];
    svg.append(
      element('path', { class: 'spring', d: chains(setup.edges, this.place) }),
      element('path', { class: 'contour fine', d: chains(setup.contours.fine, this.place) }),
      element('path', { class: 'contour', d: chains(setup.contours.strong, this.place) }),
    );
    this.nodes = new Map();
    const suggested = new Set(setup.suggested);
    // The nodes that are picked most often are on top.
    const rank = (n) => (suggested.has(n.id) ? 2 : n.markable ? 1 : 0);
    for (const node of [...live].sort((a, b) => rank(a) - rank(b))) {
      const [x, y] = this.place(node.id);
      if (y < 4) continue;
      const group = element('g', { class: 'pickable', transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`, role: 'button' });
      group.setAttribute('tabindex', '-1');
      group.setAttribute('aria-label', name(node.id));
      group.append(element('title', {}, name(node.id)), element('circle', { class: 'reach', r: rank(node) ? 9 : 5 }), element('circle', { class: 'halo', r: 9 }),
        element('circle', { class: 'dot', r: rank(node) ? 3.4 : 1.7 }));
      group.addEventListener('click', () => pick(node.id));
      svg.append(group);
      this.nodes.set(node.id, group);
      group.dataset.rank = rank(node);
      group.dataset.node = node.id;
    }
  }

  /** Shows the state of every node: `classes(node)` gives the class names. */
  update(classes, next) {
    for (const [node, group] of this.nodes) {
      group.setAttribute('class', `pickable ${classes(node)}${node === next ? ' next' : ''}`);
      if (node === next) group.setAttribute('aria-current', 'true');
      else group.removeAttribute('aria-current');
    }
  }
}
