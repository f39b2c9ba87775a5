// Two groups side by side: their representatives, and where they differ.

function drawPair(figure) {
  const pair = data.pairs[figure.dataset.pair];
  const [a, b] = [representatives[pair.a], representatives[pair.b]];
  const neutral = positions(a, 0, 1);
  const slot = (name) => $(`[data-figure="${name}"]`, figure);

  const both = new Face(commonBox, `Representatives of ${pair.names.join(" and ")} at the apex`, { shaded: false });
  both.svg.classList.add("both");
  slot("both").append(both.svg);
  both.draw(positions(a, a.offsets.length, 1));
  both.edges.setAttribute("d", "");
  const second = vector("path", { class: "contours other" });
  const thin = vector("path", { class: "fine other" });
  both.svg.append(thin, second);
  const other = positions(b, b.offsets.length, 1);
  second.setAttribute("d", contours(other));
  thin.setAttribute("d", chains(other, wireframe.fine));

  const top = Math.max(...pair.energy, 1e-9);
  const box = slot("energy");
  probeNodes(box, $("svg", box), neutral, (k) => `${wireframe.live[k]} ${data.nodes[k]}: ${fixed(pair.energy[k], 2)} face units, p ${pair.p[k] < 0.001 ? Number(pair.p[k].toPrecision(2)) : fixed(pair.p[k], 3)}`);
  colorBar(slot("energybar"), [0, top], "energy distance per node, face units");
}
