// Draws the figures of the cards, and runs the table of tracking quality.

// ---- Cards, drawn when they come near the window ----
const repaint = [];
function drawCard(card) {
  if (card.done) return;
  card.done = true;
  const rep = representatives[Number(card.dataset.card)];
  const name = [emotions[rep.emotion], rep.group].filter(Boolean).join(", ");
  const slot = (figure) => $(`[data-figure="${figure}"]`, card);
  const neutral = positions(rep, 0, 1);
  const still = new Face(commonBox, "Canonical neutral wireframe");
  still.draw(neutral);
  slot("neutral").append(still.svg);
  probeNodes(slot("neutral"), still.svg, neutral, (k) => `${wireframe.live[k]} ${data.nodes[k]}`);

  const moving = new Face(commonBox, `Representative of ${name}, moving wireframe`, { ghost: true });
  slot("moving").append(moving.svg);
  const apexBox = bounds(Array.from({ length: rep.offsets.length }, (_, t) => positions(rep, t + 1, 4)));
  watch(slot("moving"), new Player($(".player", card), rep.offsets.length, (player) => {
    // Zooms out so that an exaggerated apex stays inside.
    const part = (player.gain - 1) / 3;
    moving.setBox(commonBox.map((v, k) => (k < 2 ? Math.min(v, v + part * (apexBox[k] - v)) : Math.max(v, v + part * (apexBox[k] - v)))));
    moving.draw(positions(rep, player.time, player.gain));
    moving.ghost.setAttribute("d", player.ghost ? contours(neutral) : "");
  }));
  probeFields(slot("fields"), rep);
  if (rep.nodeDispersion) {
    const box = slot("heat");
    probeNodes(box, $("svg", box), neutral, (k) => `${wireframe.live[k]} ${data.nodes[k]}: ${fixed(rep.nodeDispersion[k], 1)} face units`);
    colorBar(slot("colorbar"), rangeOf(rep.nodeDispersion), "dispersion per node, face units");
    repaint.push(stripPlot(slot("distances"), distanceRows(rep), "distance d to the median, face units"));
    repaint.push(stripPlot(slot("trimming"), trimmingRows(rep), "distance d to the other models, face units", "tf"));
    const trimmed = slot("trimmed");
    if (trimmed) trimmedTable(trimmed, rep);
  }
  if (rep.variation) {
    drawVariation(slot("variation"), rep);
    repaint.push(drawBands(slot("bands"), rep));
  }
  const faps = slot("faps");
  if (faps) {
    drawFaps(faps, rep);
    fapTable(slot("fap-table"), rep);
  }
}
const cards = $$(".card");
const near = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    near.unobserve(entry.target);
    drawCard(entry.target);
  }
}, { rootMargin: "1200px" });
if (cards.length <= 12) cards.forEach(drawCard);
else cards.forEach((card) => near.observe(card));

$$("[data-pair]").forEach(drawPair);

const overview = $("#overview");
if (overview) {
  const faces = $$("[data-mini]", overview).map((box) => {
    const rep = representatives[Number(box.dataset.mini)];
    const face = new Face(commonBox, `Representative of ${[emotions[rep.emotion], rep.group].filter(Boolean).join(", ")}`);
    box.append(face.svg);
    return { face, rep };
  });
  const apex = representatives[0].offsets.length;
  watch(overview, new Player($(".player", overview), apex, (player) => {
    for (const { face, rep } of faces) face.draw(positions(rep, (player.time / apex) * rep.offsets.length, player.gain));
  }));
}

// Headings that a link jumps to stay clear of the contents, which are one to three lines high.
const contents = $(".contents");
if (contents) new ResizeObserver(() => (document.documentElement.style.scrollPaddingTop = `${contents.offsetHeight + 12}px`)).observe(contents);

let resizing = 0;
addEventListener("resize", () => {
  cancelAnimationFrame(resizing);
  resizing = requestAnimationFrame(() => repaint.forEach((paint) => paint()));
});
addEventListener("beforeprint", () => {
  cards.forEach(drawCard);
  repaint.forEach((paint) => paint());
  for (const details of $$("details")) details.build?.();
});

// ---- Tracking table ----
const PAGE = 50;
const recovered = (row) => row[6].reduce((sum, v, k) => sum + (k % 2 ? v : 0), 0);
const text = (a, b) => (a < b ? -1 : a > b ? 1 : 0);
const columns = [
  (a, b) => text(ids[a[0]][0], ids[b[0]][0]),
  (a, b) => text(ids[a[0]][1], ids[b[0]][1]),
  (a, b) => text(emotions[a[1]], emotions[b[1]]),
  (a, b) => a[2] - b[2],
  (a, b) => (a[3] ?? -1) - (b[3] ?? -1),
  (a, b) => (a[4] ?? -1) - (b[4] ?? -1),
  (a, b) => (a[5] ?? -1) - (b[5] ?? -1),
  (a, b) => (a[8] ?? -1) - (b[8] ?? -1),
  (a, b) => recovered(a) - recovered(b),
];
const haystack = new Map(tracks.map((row) => {
  const nodes = row[7].filter((_, k) => k % 2 === 0).map((n) => `node ${n} ${nodeName(n)}`);
  const why = row[6].filter((_, k) => k % 2 === 0).map((r) => reasons[r]);
  return [row, [...ids[row[0]], emotions[row[1]], ...why, ...nodes].join(" ").toLowerCase()];
}));
const table = { sort: 5, ascending: true, page: 0, words: [] };
const body = $("#tracks tbody");
function trackRow(row) {
  const [id, emotion, frames, eye, share, residual, why, worst, expected] = row;
  const nodes = element("td", { class: "nodes" });
  for (let k = 0; k < worst.length; k += 2) {
    if (k) nodes.append(", ");
    const name = nodeName(worst[k]);
    // Only the tooltip has the number of the feature point.
    nodes.append(element("span", { title: name }, element("b", {}, String(worst[k])), ` ${name.replace(/ \([0-9.]+\)$/, "")} ×${worst[k + 1]}`));
  }
  if (!worst.length) nodes.append("–");
  const list = element("td", { class: "why" });
  for (let k = 0; k < why.length; k += 2) list.append(element("span", {}, `${why[k + 1]} ${reasons[why[k]]}`));
  return element("tr", {}, element("td", {}, ids[id][0]), element("td", {}, ids[id][1]), element("td", {}, capital(emotions[emotion])),
    element("td", { class: "num" }, String(frames)), element("td", { class: "num" }, fixed(eye, 1)), element("td", { class: "num" }, fixed(share, 1)),
    element("td", { class: "num" }, fixed(residual, 3)), element("td", { class: "num" }, fixed(expected, 2)), element("td", { class: "num" }, String(recovered(row))), list, nodes);
}
let sorted = [];
function sortTracks() {
  const compare = columns[table.sort];
  const sign = table.ascending ? 1 : -1;
  // Equal rows keep the order of their ids.
  sorted = [...tracks].sort((a, b) => sign * compare(a, b) || a[0] - b[0]);
}
function showTracks() {
  const rows = sorted.filter((row) => table.words.every((word) => haystack.get(row).includes(word)));
  const pages = Math.max(1, Math.ceil(rows.length / PAGE));
  table.page = Math.min(table.page, pages - 1);
  const start = table.page * PAGE;
  body.replaceChildren(...rows.slice(start, start + PAGE).map(trackRow));
  if (rows.length === 0) body.append(element("tr", {}, element("td", { colspan: 11 }, tracks.length ? "No sequence matches." : "No sequence was tracked.")));
  const all = `${tracks.length} ${tracks.length === 1 ? "sequence" : "sequences"}`;
  $("#track-count").textContent = rows.length === tracks.length ? all : `${rows.length} of ${all}`;
  $("#track-page").textContent = rows.length ? `${start + 1}–${Math.min(start + PAGE, rows.length)}` : "";
  $("#track-note").textContent = `Printed: rows ${$("#track-page").textContent} of ${tracks.length}, as sorted and filtered on the screen.`;
  $("#track-previous").disabled = table.page === 0;
  $("#track-next").disabled = table.page === pages - 1;
  $(".pager").hidden = pages === 1;
}
const headers = $$("#tracks thead th");
headers.slice(0, columns.length).forEach((th, k) => {
  $("button", th).addEventListener("click", () => {
    table.ascending = table.sort === k ? !table.ascending : true;
    table.sort = k;
    table.page = 0;
    headers.forEach((h, j) => (j === k ? h.setAttribute("aria-sort", table.ascending ? "ascending" : "descending") : h.removeAttribute("aria-sort")));
    sortTracks();
    showTracks();
  });
});
$("#track-filter").addEventListener("input", (event) => {
  table.words = event.target.value.toLowerCase().split(/\s+/).filter(Boolean);
  table.page = 0;
  showTracks();
});
$("#track-previous").addEventListener("click", () => { table.page--; showTracks(); });
$("#track-next").addEventListener("click", () => { table.page++; showTracks(); });
sortTracks();
showTracks();
