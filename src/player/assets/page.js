// The page of `grimace play`.

const playerRoot = document.getElementById("player");
const ready = GrimacePlayer.mount(playerRoot, JSON.parse(document.getElementById("player-data").textContent), {
  flat: location.hash === "#canvas",
  keys: document,
});
ready.then((player) => {
  playerRoot.player = player;
  playerRoot.removeAttribute("aria-busy");
}, (error) => {
  playerRoot.textContent = `The player could not be drawn: ${error.message}`;
  playerRoot.removeAttribute("aria-busy");
});
