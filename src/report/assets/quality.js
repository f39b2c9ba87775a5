// Quality control with one card per sequence; collapsing of sections; the player.

const QUALITY_STEP = 24, QUALITY_CHART = [150, 34];
const worseFirst = (a, b) => Number(b[9]) - Number(a[9]) || (b[8] ?? 0) / (b[3] || 1) - (a[8] ?? 0) / (a[3] || 1) || a[0] - b[0];
const qualityOrders = {
  worst: worseFirst,
  name: (a, b) => a[0] - b[0],
  emotion: (a, b) => a[1] - b[1] || worseFirst(a, b),
  lost: (a, b) => (a[4] ?? 0) - (b[4] ?? 0) || worseFirst(a, b),
};

/** Expected error as a line, lost nodes as bars, over the frames. */
function courseChart(lost, errors, most) {
  const [w, h] = QUALITY_CHART, n = Math.max(lost.length, 1);
  const known = errors.some((e) => e !== null);
  const top = (list) => list.reduce((m, v) => Math.max(m, v ?? 0), 0);
  const label = `Lost nodes up to ${fixed(top(lost), 0)} percent of a frame${known ? `; expected error up to ${fixed(top(errors), 2)} pixels` : ""}`;
  const svg = vector("svg", { viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": label, class: "course", preserveAspectRatio: "none" });
  lost.forEach((share, k) => {
    const height = (Math.min(share, 100) / 100) * h;
    if (height > 0) svg.append(vector("rect", { x: r1((k * w) / n), y: r1(h - height), width: r1(Math.max(w / n - 0.6, 0.6)), height: r1(height), class: "lost" }));
  });
  const points = errors.flatMap((e, k) => (e === null ? [] : [`${r1(((k + 0.5) * w) / n)} ${r1(h - (e / most) * (h - 2) - 1)}`]));
  if (points.length > 1) svg.append(vector("path", { d: `M${points.join("L")}`, class: "error" }));
  return svg;
}
/** The verdict, and what a person found when looking at the sequence. */
function verdictText({ 10: why, 16: look }) {
  const verdict = why.length ? "Look again" : "Good";
  return { right: `${verdict} · looked at: right`, leave_out: `${verdict} · looked at: left out`, outdated: `${verdict} · changed since the look` }[look] ?? verdict;
}
function qualityCard(row, mostError) {
  const [id, emotion, frames, eye, share, , , , expected, again, why, lost, errors, pictures, stem, placed, look] = row;
  const share_of_eyes = (px) => (eye ? ` (${fixed((100 * px) / eye, 1)} % of the eye distance)` : "");
  const card = element("article", { class: again ? "qc again" : "qc" });
  const head = element("h3", {}, idText(id), element("span", {}, capital(emotions[emotion])));
  const verdict = element("p", { class: "verdict" }, verdictText(row));
  card.append(head, verdict);
  if (pictures) {
    const box = element("div", { class: "qc-pictures" });
    ["neutral", "apex"].forEach((what, k) => box.append(element("img", {
      src: `data:image/jpeg;base64,${pictures[k]}`, alt: `Wireframe on the ${what} frame of ${idText(id)}`, loading: "lazy", height: 150,
    })));
    card.append(box);
  }
  if (lost.length) card.append(courseChart(lost, errors, mostError));
  const facts = [`${frames} frames`, `${fixed(share, 1)} % tracked`];
  if (expected !== null) facts.push(`expected error of the motion ${fixed(expected, 2)} px${share_of_eyes(expected)}`);
  if (placed !== null) facts.push(`expected error of the placement ${fixed(placed, 2)} px${share_of_eyes(placed)}`);
  card.append(element("p", { class: "qc-facts" }, facts.join(" · ")));
  if (why.length) card.append(element("p", { class: "qc-why" }, why.join("; ")));
  if (stem !== null) {
    const name = encodeURIComponent(stem);
    const link = (href, text) => element("a", { href }, text);
    card.append(element("p", { class: "qc-files" }, link(`tracks/${name}.csv`, "track"), " ", link(`tracks/${name}.json`, "details"), " ", link(`models/${name}.csv`, "normalized model")));
  }
  return card;
}
const qualityBox = $("#quality-cards");
const quality = { shown: QUALITY_STEP, rows: [] };
const largestError = tracks.reduce((most, row) => row[12].reduce((m, v) => Math.max(m, v ?? 0), most), 1e-6);
function listQuality() {
  const words = $("#quality-filter").value.toLowerCase().split(/\s+/).filter(Boolean);
  const again = $("#quality-again").checked;
  const text = (row) => [...ids[row[0]], emotions[row[1]], verdictText(row), ...row[10]].join(" ").toLowerCase();
  quality.rows = tracks.filter((row) => (!again || row[9]) && words.every((word) => text(row).includes(word)));
  quality.rows.sort(qualityOrders[$("#quality-order").value]);
  quality.shown = QUALITY_STEP;
  showQuality();
}
function showQuality() {
  const { rows, shown } = quality;
  qualityBox.replaceChildren(...rows.slice(0, shown).map((row) => qualityCard(row, largestError)));
  if (!rows.length) qualityBox.append(tracks.length ? "No sequence matches." : "No sequence was tracked.");
  const again = tracks.filter((row) => row[9]).length;
  $("#quality-count").textContent = `${Math.min(shown, rows.length)} of ${rows.length} shown, ${again} to look at again`;
  $("#quality-more").hidden = shown >= rows.length;
}
for (const [name, event] of [["filter", "input"], ["order", "change"], ["again", "change"]]) $(`#quality-${name}`).addEventListener(event, listQuality);
$("#quality-more").addEventListener("click", () => {
  quality.shown += 4 * QUALITY_STEP;
  showQuality();
});
listQuality();

// ---- Collapsing of sections ----
const folds = $$("main > section, main article.card").map((part) => {
  const heading = $("h2, h3", part);
  const button = element("button", { type: "button", class: "fold", "aria-expanded": "true", "aria-label": `Show or hide ${heading.textContent.trim().replace(/\s+/g, " ")}` });
  heading.append(button);
  const set = (open) => {
    part.classList.toggle("folded", !open);
    button.setAttribute("aria-expanded", String(open));
  };
  button.addEventListener("click", () => {
    set(part.classList.contains("folded"));
    repaintAll();
  });
  return { part, set };
});
// If there are many classes, only the first is open: the overview above shows all.
const MOST_OPEN_CARDS = 6;
const classFolds = folds.filter(({ part }) => part.matches(".card"));
if (classFolds.length > MOST_OPEN_CARDS) classFolds.slice(1).forEach(({ set }) => set(false));
function repaintAll() {
  dispatchEvent(new Event("resize"));
}
const foldAll = $("#fold-all");
foldAll.addEventListener("click", () => {
  const open = foldAll.textContent === "Expand all";
  for (const { set } of folds) set(open);
  foldAll.textContent = open ? "Collapse all" : "Expand all";
  repaintAll();
});
/** Opens the section that a link leads to. */
function unfoldTarget() {
  let name = location.hash.slice(1);
  try {
    name = decodeURIComponent(name);
  } catch { /* A percent sign of its own. */ }
  const target = name && document.getElementById(name);
  if (!target) return;
  for (const { part, set } of folds) if (part.contains(target)) set(true);
  repaintAll();
  target.scrollIntoView();
}
addEventListener("hashchange", unfoldTarget);
// The browser sends no event for a link to the current position.
addEventListener("click", (event) => {
  const link = event.target.closest?.('a[href^="#"]');
  if (link && link.hash === location.hash) unfoldTarget();
});
unfoldTarget();

// ---- The player ----
const playerRoot = $("#player");
if (playerRoot && data.player) {
  new GrimacePlayer.Shelf(data.player).ready().then((shelf) => {
    const player = new GrimacePlayer.FacePlayer(playerRoot, shelf);
    playerRoot.player = player;
    playerRoot.removeAttribute("aria-busy");
    const width = Math.round(180 * Math.min(devicePixelRatio || 1, 2));
    shelf.motions.forEach((motion, k) => {
      const still = element("button", { type: "button", class: "still", "aria-label": `Play ${motion.label}` }, shelf.still(motion, shelf.rigs[0], width), element("span", { class: "cap" }, motion.label));
      still.addEventListener("click", () => {
        player.pause();
        player.choose(k);
        player.setShare(0);
        player.play();
        playerRoot.scrollIntoView({ block: "nearest" });
      });
      $("#stills").append(still);
    });
  }, (error) => { playerRoot.textContent = `The player could not be drawn: ${error.message}`; });
}
