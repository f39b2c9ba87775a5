// Folds of a motion on a face, as soft as its photograph. `clone/cloned_skin.rs` has the same steps: change both together.

/** A picture of levels, softened by a Gaussian of `sigma` pixels; beyond its border the levels of the border continue. */
function softened(image, sigma) {
  if (!(sigma > 0)) return image;
  const { width, height } = image, canvas = node("canvas", { width, height }), context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const pixels = context.getImageData(0, 0, width, height);
  const reach = Math.ceil(3 * sigma), kernel = [];
  for (let d = -reach; d <= reach; d++) kernel.push(Math.exp((-d * d) / (2 * sigma * sigma)));
  const sum = kernel.reduce((a, b) => a + b);
  const pass = (from, [stepX, stepY]) =>
    from.map((_, k) => {
      const x = k % width, y = Math.floor(k / width);
      let total = 0;
      for (let d = -reach; d <= reach; d++) {
        total += kernel[d + reach] * from[clamp(y + d * stepY, 0, height - 1) * width + clamp(x + d * stepX, 0, width - 1)];
      }
      return total / sum;
    });
  const levels = pass(pass(Float32Array.from({ length: width * height }, (_, k) => pixels.data[4 * k]), [1, 0]), [0, 1]);
  levels.forEach((level, k) => pixels.data.fill(Math.round(level), 4 * k, 4 * k + 3));
  context.putImageData(pixels, 0, 0);
  return canvas;
}
