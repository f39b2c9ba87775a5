// Explains terms at their first occurrence in a section, on hover and on focus.

function explain() {
  const meanings = new Map(data.glossary.map(([word, meaning]) => [word.toLowerCase(), meaning]));
  if (!meanings.size) return;
  const words = [...meanings.keys()].sort((a, b) => b.length - a.length).map((w) => w.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
  const pattern = new RegExp(`(?<![\\p{L}\\p{N}-])(${words.join("|")})(?=(?:s|es)?(?![\\p{L}\\p{N}-]))`, "giu");
  // Only once per section: a page full of marked words is hard to read.
  const met = new Map();
  for (const block of $$(".conclusions p, .conclusions li, .caption, figcaption, caption, #method > p")) {
    const section = block.closest("section");
    if (!met.has(section)) met.set(section, new Set());
    const known = met.get(section);
    const walker = document.createTreeWalker(block, NodeFilter.SHOW_TEXT);
    const texts = [];
    while (walker.nextNode()) texts.push(walker.currentNode);
    for (const node of texts) {
      const parts = [];
      let from = 0;
      for (const match of node.data.matchAll(pattern)) {
        const word = match[1].toLowerCase();
        if (known.has(word)) continue;
        known.add(word);
        const term = element("span", { class: "term", tabindex: "0", role: "note", "aria-label": `${match[1]}: ${meanings.get(word)}` }, match[1]);
        const show = (event) => {
          const box = term.getBoundingClientRect();
          showTip({ clientX: event.clientX ?? box.left, clientY: event.clientY ?? box.top }, meanings.get(word));
        };
        term.addEventListener("pointerenter", show);
        term.addEventListener("focus", show);
        term.addEventListener("pointerleave", hideTip);
        term.addEventListener("blur", hideTip);
        parts.push(node.data.slice(from, match.index), term);
        from = match.index + match[1].length;
      }
      if (parts.length) node.replaceWith(...parts, node.data.slice(from));
    }
  }
}
explain();
