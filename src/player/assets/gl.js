// Draws with WebGL, from back to front: the photograph, the parts behind lids and lips, the skin, the skin of lids without lashes, the light in hollows
// and the furrows made by brows, lashes below raised brows, closing lids, the edges of lids and lips, the lashes of closing lids.

const SKIN_VERTEX = `
attribute vec2 at; attribute vec2 from; attribute float cover; uniform vec2 size; varying vec2 uv; varying float c;
void main() { c = cover; uv = (from + 0.5) / size; vec2 p = (at + 0.5) / size * 2.0 - 1.0; gl_Position = vec4(p.x, -p.y, 0.0, 1.0); }`;
const SKIN_FRAGMENT = `
precision mediump float; varying highp vec2 uv; varying float c; uniform sampler2D picture;
void main() { vec4 t = texture2D(picture, uv); gl_FragColor = vec4(t.rgb, c * t.a); }`;
// A factor over a picture, weighted by the opacity of the picture.
const FACTOR_FRAGMENT = `
precision mediump float; varying highp vec2 uv; varying float c; uniform sampler2D picture;
void main() { vec3 left = texture2D(picture, uv).rgb; gl_FragColor = vec4(left / mix(left, vec3(1.0), c), 1.0); }`;
// Half of a factor on the picture: removed shade, and deeper furrows above the parts of brows at `places`.
const SHADE_FRAGMENT = `
precision mediump float; varying highp vec2 uv; varying float c; uniform sampler2D picture; uniform float darkest;
void main() { gl_FragColor = vec4(0.5 * exp(-darkest * c * texture2D(picture, uv).rgb), 1.0); }`;
const FURROW_VERTEX = `
attribute vec2 at; attribute vec2 from; uniform vec2 size; uniform vec2 first; uniform vec2 across; uniform vec2 up; varying vec2 cell;
void main() {
  vec2 off = from - first; cell = vec2(dot(off, across) / dot(across, across), dot(off, up) / dot(up, up));
  vec2 p = (at + 0.5) / size * 2.0 - 1.0; gl_Position = vec4(p.x, -p.y, 0.0, 1.0);
}`;
const FURROW_FRAGMENT = `
precision highp float; varying vec2 cell; uniform sampler2D picture; uniform vec2 cells; uniform vec4 places; uniform vec4 depths; uniform float limit;
void main() {
  float x = cell.x, log = (texture2D(picture, (cell + 0.5) / cells).r * 255.0 - 128.0) / 127.0 * limit;
  vec3 shares = clamp((x - places.xyz) / max(places.yzw - places.xyz, 1e-6), 0.0, 1.0);
  float depth = depths.x + dot(depths.yzw - depths.xyz, shares);
  vec2 inside = step(vec2(0.0), cell) * step(cell, cells - 1.0);
  gl_FragColor = vec4(vec3(0.5 * exp(log * depth * inside.x * inside.y)), 1.0);
}`;
// The skin of a face while folds grow on it: `fold` is the position of a vertex in the picture of their levels.
const FOLD_VERTEX = `
attribute vec2 at; attribute vec2 from; attribute vec2 fold; uniform vec2 size; varying vec2 uv; varying vec2 f;
void main() { uv = (from + 0.5) / size; f = fold; vec2 p = (at + 0.5) / size * 2.0 - 1.0; gl_Position = vec4(p.x, -p.y, 0.0, 1.0); }`;
const FOLD_FRAGMENT = `
precision highp float; varying vec2 uv; varying vec2 f; uniform sampler2D picture; uniform sampler2D folds;
uniform vec3 powers; uniform float growth; uniform float lighter; uniform float none; uniform float limit;
void main() {
  float log = (texture2D(folds, f).r * 255.0 - none) / 127.0 * limit;
  log *= growth * (log > 0.0 ? lighter : 1.0);
  gl_FragColor = vec4(texture2D(picture, uv).rgb * exp(powers * log), 1.0);
}`;
// `place` is in eye distances from where the closed lips meet; `lips` are the heights of both lips there.
const MOUTH_VERTEX = `
attribute vec2 at; attribute vec2 place; attribute vec2 lips; attribute vec2 above; attribute vec2 below; uniform vec2 size;
varying vec2 p; varying vec2 l; varying vec2 ua; varying vec2 ub;
void main() {
  p = place; l = lips; ua = (above + 0.5) / size; ub = (below + 0.5) / size;
  vec2 q = (at + 0.5) / size * 2.0 - 1.0; gl_Position = vec4(q.x, -q.y, 0.0, 1.0);
}`;
const MOUTH_FRAGMENT = `
precision highp float;
varying vec2 p; varying vec2 l; varying vec2 ua; varying vec2 ub;
uniform sampler2D picture; uniform sampler2D teeth; uniform vec3 lip; uniform vec3 enamel; uniform vec3 flesh; uniform vec2 ends; uniform vec2 teethSize;
uniform vec2 teethOrigin; uniform float teethScale; uniform float white; uniform float gap; uniform float jaw; uniform float floorY;
uniform float shown; uniform float lit; uniform float scale; uniform float wider; uniform float incisors; uniform float tongue; uniform vec3 toneFrom; uniform vec3 toneRise; uniform float toneShare;
vec3 tinted(vec3 warm, float light) {
  vec3 grey = vec3(0.3, 0.59, 0.11);
  float luma = max(dot(lip, grey), min(60.0 / 255.0, 0.5 * dot(enamel, grey)));
  return (0.4 * lip + 0.6 * flesh * luma) * warm * light;
}
vec3 row(vec2 d, float brightness, vec3 tint, float side, float fromCorner, vec3 under) {
  vec2 at = (teethOrigin + d * teethScale + 0.5) / teethSize;
  if (at.x < 0.0 || at.y < 0.0 || at.x > 1.0 || at.y > 1.0) return under;
  vec4 tooth = texture2D(teeth, at);
  float cover = tooth.a * smoothstep(0.0, 0.035, fromCorner);
  float edge = 1.0 - 0.16 * smoothstep(-0.024, 0.0, d.y);
  return mix(under, tooth.rgb * 255.0 / white * enamel * tint * brightness * side * edge, cover);
}
void main() {
  float x = p.x, y = p.y, upper = l.x, lower = l.y;
  float belowUpper = y - upper, aboveLower = lower - y;
  float fromCorner = min(x - ends.x, ends.y - x);
  float open = smoothstep(0.02, 0.40, gap), side = smoothstep(0.0, 0.20, fromCorner);
  float depth = clamp(belowUpper / max(lower - upper, 1e-6), 0.0, 1.0);
  float throat = (depth - 0.40) / 0.34, dropped = 1.0 - lit, gapes = dropped * smoothstep(0.10, 0.24, gap);
  float light0 = 0.27 + (0.20 * depth - 0.12) * open * side - 0.16 * exp(-throat * throat) * side * sqrt(open) + 0.13 * (1.0 - side) * open;
  // A dropped jaw opens the mouth so far that light falls in, less into the corners.
  light0 = mix(light0 + 0.08 * dropped * (1.0 - open), 0.45 * (1.0 - 0.42 * (1.0 - side)), gapes);
  vec3 colour = tinted(vec3(1.0, vec2(0.60, 0.57) + 0.14 * (1.0 - side) * (1.0 - gapes)) - vec3(0.10, 0.0, 0.02) * gapes, light0);
  float across = x / max(mix(0.38, 0.50, gapes) * (ends.y - ends.x), 1e-6), within = 1.0 - across * across;
  if (within > 0.0) {
    float height = (tongue + 0.19 * gapes) * gap * pow(within, mix(0.5, 0.7, gapes)), top = floorY - height;
    float cover = smoothstep(-0.015 - 0.10 * gap * gapes, 0.05 + 0.20 * gap * gapes, y - top) * max(sqrt(open), gapes) * smoothstep(0.0, 0.25, within);
    float tip = clamp((y - top) / max(height, 1e-6), 0.0, 1.0), groove = 1.0 - mix(0.20, 0.17, gapes) * exp(-(x / 0.026) * (x / 0.026)) * (0.3 + 0.7 * tip);
    float band = within * smoothstep(0.25, 0.60, tip) * (1.0 - smoothstep(0.70, 1.05, tip));
    float wide = 0.27 + 0.50 * smoothstep(0.0, 0.70, tip) - 0.14 * smoothstep(0.75, 1.0, tip);
    float light = mix((0.40 + 0.72 * tip) * (0.66 + 0.34 * open) * (0.42 + 0.58 * within), wide * (0.34 + 0.66 * within), gapes) * groove;
    vec3 meat = tinted(vec3(1.0, 0.95, 0.96) + vec3(-0.03, 0.0, 0.03) * gapes, light + 0.08 * open * band);
    colour = mix(colour, meat + enamel * 0.055 * gapes * band, cover);
  }
  if (shown > 0.5) {
    x /= wider;
    float turned = (0.25 + 0.75 * smoothstep(0.0, mix(0.14, 0.10, lit), fromCorner)) * (1.0 - mix(0.40, 0.10, lit) * smoothstep(0.10, 0.30, abs(x) / scale));
    float gaping = smoothstep(0.14, 0.34, gap);
    float lowerY = y - max(0.012 + 0.88 * jaw, floorY + 0.007 - 0.061 * smoothstep(0.05, 0.12, floorY - jaw)) + 1.5 * gaping * x * x;
    float part = smoothstep(0.02, 0.08, jaw);
    if (part > 0.0) {
      float light = (0.69 - 0.18 * smoothstep(0.0, 0.30, gap)) * (0.7 + 0.3 * smoothstep(0.0, 0.02, aboveLower));
      colour = mix(colour, row(vec2(x / 0.70, -lowerY / 0.75), light, vec3(1.0, 0.94, 0.84), turned, fromCorner, colour), part);
    }
    float upperY = y - incisors - (mix(0.12, 0.22, lit) + 0.38 * gaping + 0.25 * (1.0 - lit) * (1.0 - gaping)) * x * x;
    float gum = smoothstep(0.133, 0.163, -upperY - 0.20 * x * x) * (1.0 - smoothstep(0.26, 0.36, abs(x)));
    colour = mix(colour, tinted(vec3(1.0, 0.80, 0.80), 0.62 * turned), gum);
    float light = mix(mix(0.56, 0.80, lit), 1.0, smoothstep(0.0, 0.05, belowUpper)) * (1.0 - 0.08 * dropped * gaping);
    // Crowns as far as a raised lip shows them, and the gaps between them.
    float edge = -0.60 * x * x / scale, crown = max(0.122 - 0.35 * (x / scale) * (x / scale), 0.05);
    float above = (edge - upperY) / clamp(((edge - upperY + belowUpper) / scale + 0.01) / crown, 1.0, 0.165 / crown);
    float between = (1.0 - smoothstep(0.38, 0.44, abs(x) / scale)) * smoothstep(0.0, 0.035, fromCorner);
    between *= 0.85 * smoothstep(0.010, 0.024, above) * (1.0 - smoothstep(0.095, 0.125, above));
    colour = mix(colour, enamel * vec3(0.92, 0.86, 0.80) * 0.55 * light * turned, between);
    colour = mix(colour, row(vec2(x, edge - above), light, vec3(1.0), turned, fromCorner, colour), smoothstep(0.0, 0.03, belowUpper + aboveLower));
  }
  float shadow = mix(mix(0.58, 0.85, lit), 1.0, smoothstep(0.0, 0.06, belowUpper)) * mix(0.75 + 0.10 * gapes, 1.0, smoothstep(0.0, 0.03, aboveLower));
  // For the upper and the lower lip.
  vec2 most = mix(vec2(0.024), vec2(0.020, 0.022), lit), part = mix(vec2(0.28), vec2(0.34, 0.26), lit) + 0.18 * dropped * (1.0 - smoothstep(0.03, 0.08, lower - upper));
  vec2 width = max(min(most, part * max(lower - upper, 0.0)), 1e-6);
  // A gap as narrow as a line is drawn as lip, not as cavity.
  vec2 round = max(1.0 - smoothstep(vec2(0.0), width, vec2(belowUpper, aboveLower)), 1.0 - smoothstep(0.004, 0.03, lower - upper));
  vec3 near = texture2D(picture, depth < 0.5 ? ua : ub).rgb;
  float sealed = 1.0 - smoothstep(0.0, 0.16 * (1.0 - 0.7 * open), fromCorner);
  // Lips that touch have a crease between them instead of a slit.
  sealed = max(sealed, dropped * (1.0 - smoothstep(0.004, 0.03, lower - upper)));
  // The edge of a lip is darker than the lip; below a dropped jaw, a part of this shade is removed.
  vec3 crease = near * (0.52 + 0.10 * dropped) + 0.30 * dropped * max(lip - near, 0.0), missing = dropped * max(0.85 * lip - near, 0.0);
  vec3 inside = mix(colour * shadow, crease, 0.9 * sealed);
  vec3 dark = vec3(0.74, 0.60, 0.60);
  vec3 seen = mix(inside, (near + 0.60 * missing) * mix(dark, vec3(0.90, 0.76, 0.76), max(lit, 0.8 * gapes)), 0.85 * round.y);
  seen = mix(seen, (near + 0.35 * missing) * mix(dark, vec3(0.83, 0.76, 0.76), lit), 0.85 * round.x);
  gl_FragColor = vec4(mix(seen, toneFrom + toneRise * dot(seen, vec3(0.3, 0.59, 0.11)), toneShare), 1.0);
}`;
// Width of the soft edge of an opening relative to the softness of the photograph: a ramp as long as a Gaussian from end to end.
const EDGE = 2.5;
// The line of lashes: position along it, and number of widths below its middle.
const LASH_VERTEX = `
attribute vec2 at; attribute vec2 place; uniform vec2 size; varying highp vec2 p;
void main() { p = place; vec2 q = (at + 0.5) / size * 2.0 - 1.0; gl_Position = vec4(q.x, -q.y, 0.0, 1.0); }`;
const LASH_FRAGMENT = `
precision highp float; varying highp vec2 p; uniform vec3 colour; uniform float shut; uniform vec4 edges; uniform vec2 hair; uniform vec4 hairs;
void main() { float a = clamp(p.x, 0.0, 1.0);
  float core = 1.0 - (p.y < 0.0 ? smoothstep(edges.x, edges.y, -p.y) : smoothstep(edges.z, edges.w, p.y));
  float wave = cos(6.2831853 * hairs.x * (p.x - hairs.y * (p.x - 0.5) * p.y));
  float single = p.y < 0.0 ? 0.0 : hairs.z * (0.5 + 0.5 * hairs.w * wave) * (1.0 - smoothstep(hair.x, hair.y, p.y));
  gl_FragColor = vec4(colour, shut * sqrt(4.0 * a * (1.0 - a)) * max(core, single)); }`;
// A closing lid in place of the eye: its colour, its form and, from the skin below, its grain.
const LID_VERTEX = `
attribute vec2 at; attribute vec2 from; attribute vec2 place; uniform vec2 size; varying highp vec2 uv; varying highp vec2 p;
void main() { p = place; uv = (from + 0.5) / size; vec2 q = (at + 0.5) / size * 2.0 - 1.0; gl_Position = vec4(q.x, -q.y, 0.0, 1.0); }`;
const LID_FRAGMENT = `
precision highp float; varying highp vec2 uv; varying highp vec2 p; uniform sampler2D picture; uniform vec2 size;
uniform vec4 zone; uniform vec4 form; uniform vec4 grain; uniform vec3 colour; uniform float shut;
float level(vec2 off) { return dot(texture2D(picture, uv + off / size).rgb, vec3(0.3, 0.59, 0.11)); }
void main() {
  float share = shut * smoothstep(0.0, form.w, p.x) * (1.0 - smoothstep(1.0 - form.w, 1.0, p.x));
  share *= smoothstep(zone.x, zone.y, p.y) * (1.0 - smoothstep(zone.z, zone.w, p.y));
  float down = (p.y - form.x) / (1.0 - form.x), beside = 2.0 * p.x - 1.0, d = 0.70710678, mean = 0.0;
  for (int k = 0; k < 4; k++) {
    vec2 off = grain.x * (k == 0 ? vec2(1.0, 0.0) : k == 1 ? vec2(d, d) : k == 2 ? vec2(0.0, 1.0) : vec2(-d, d));
    mean += (level(off) + level(-off)) / 8.0;
  }
  float speck = clamp(grain.y * (level(vec2(0.0)) - mean) / max(mean, grain.w), -grain.z, grain.z);
  float shade = 1.0 - form.y * down * down - form.z * beside * beside;
  gl_FragColor = vec4(colour * shade * (1.0 + speck), share);
}`;

// A head: z points to the viewer; colours are linear light.
const HEAD_VERTEX = `
attribute vec3 at; attribute vec3 normal; attribute vec3 colour; uniform vec2 size; varying vec3 n; varying vec3 c;
void main() { n = normal; c = colour; vec2 p = at.xy / size * 2.0 - 1.0; gl_Position = vec4(p.x, -p.y, -at.z / (4.0 * size.y), 1.0); }`;
const HEAD_FRAGMENT = `
precision mediump float; varying highp vec3 n; varying vec3 c; uniform vec3 light; uniform vec3 other; uniform float lit;
void main() {
  highp vec3 m = normalize(n); float key = max(dot(m, light), 0.0), fill = max(dot(m, other), 0.0), rim = 1.0 - abs(m.z);
  vec3 shade = c * (0.34 + 0.70 * key + 0.20 * fill) + 0.05 * pow(max(reflect(-light, m).z, 0.0), 18.0) - 0.10 * c * rim * rim;
  gl_FragColor = vec4(mix(c, shade, lit), 1.0);
}`;

class GlStage {
  /** Throws if WebGL is not available. */
  constructor(canvas, teeth) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl", { alpha: false, antialias: false, depth: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("WebGL is not available");
    this.teeth = teeth;
    this.setUp();
    canvas.addEventListener("webglcontextlost", (e) => e.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.setUp();
      this.onrestored?.();
    });
  }
  setUp() {
    const { gl } = this;
    this.skin = this.program(SKIN_VERTEX, SKIN_FRAGMENT);
    this.factor = this.program(SKIN_VERTEX, FACTOR_FRAGMENT);
    this.shade = this.program(SKIN_VERTEX, SHADE_FRAGMENT);
    this.furrowed = this.program(FURROW_VERTEX, FURROW_FRAGMENT);
    this.folded = this.program(FOLD_VERTEX, FOLD_FRAGMENT);
    this.mouth = this.program(MOUTH_VERTEX, MOUTH_FRAGMENT);
    this.lash = this.program(LASH_VERTEX, LASH_FRAGMENT);
    this.lid = this.program(LID_VERTEX, LID_FRAGMENT);
    this.head = this.program(HEAD_VERTEX, HEAD_FRAGMENT);
    this.pictures = new Map();
    this.lidPictures = new Map();
    this.foldPictures = new Map();
    this.shadePictures = new Map();
    this.furrowPictures = new Map();
    this.around = null;
    this.buffers = new Map();
    this.teethPictures = new Map();
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program) ?? "the shaders cannot be linked");
    const places = new Map();
    return { program, at: (name) => {
      if (!places.has(name)) places.set(name, [gl.getAttribLocation(program, name), gl.getUniformLocation(program, name)]);
      return places.get(name);
    } };
  }
  texture(image) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
    return texture;
  }
  /** Fills a named buffer; `fixed` buffers are filled only once. */
  buffer(name, make, target = this.gl.ARRAY_BUFFER, fixed = false) {
    const { gl, buffers } = this;
    const known = buffers.get(name);
    const buffer = known ?? gl.createBuffer();
    buffers.set(name, buffer);
    gl.bindBuffer(target, buffer);
    if (!known || !fixed) gl.bufferData(target, make(), fixed ? gl.STATIC_DRAW : gl.DYNAMIC_DRAW);
  }
  attribute(program, name, width = 2) {
    const { gl } = this;
    const [place] = program.at(name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, width, gl.FLOAT, false, 0, 0);
  }
  uniform(program, name, ...values) {
    this.gl[`uniform${values.length}f`](program.at(name)[1], ...values);
  }
  use(program, rig) {
    const { gl } = this;
    for (let k = 0; k < 5; k++) gl.disableVertexAttribArray(k);
    gl.useProgram(program.program);
    this.uniform(program, "size", rig.width, rig.height);
    if (program === this.skin) gl.vertexAttrib1f(program.at("cover")[0], 1);
  }
  /** Textured triangles, corner by corner: `corners` is a list of [x, y, from x, from y], with `cover` [..., opacity]. */
  loose(rig, corners, cover = false, program = this.skin) {
    const { gl } = this;
    this.use(program, rig);
    if (cover) {
      this.buffer("loose cover", () => Float32Array.from(corners, (c) => c[4]));
      this.attribute(program, "cover", 1);
    }
    this.buffer("loose at", () => Float32Array.from(corners.flatMap((c) => [c[0], c[1]])));
    this.attribute(program, "at");
    this.buffer("loose from", () => Float32Array.from(corners.flatMap((c) => [c[2], c[3]])));
    this.attribute(program, "from");
    gl.drawArrays(gl.TRIANGLES, 0, corners.length);
  }
  draw(rig) {
    const { gl, canvas } = this;
    if (gl.isContextLost()) return;
    // A head has fine edges and hair: it is drawn at double size, and the page reduces it.
    const scale = rig.kind === "head" ? 2 : 1;
    if (canvas.width !== scale * rig.width || canvas.height !== scale * rig.height) {
      canvas.width = scale * rig.width;
      canvas.height = scale * rig.height;
      this.around = null;
    }
    gl.viewport(0, 0, canvas.width, canvas.height);
    if (rig.kind === "head") return this.drawHead(rig);
    if (!this.pictures.has(rig)) this.pictures.set(rig, this.texture(rig.image));
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.pictures.get(rig));
    // The skin covers everything that moves; its surroundings stay the same from frame to frame.
    if (this.around !== rig) {
      const [w, h] = [rig.width - 0.5, rig.height - 0.5], corner = (x, y) => [x, y, x, y];
      this.loose(rig, [corner(-0.5, -0.5), corner(w, -0.5), corner(-0.5, h), corner(-0.5, h), corner(w, -0.5), corner(w, h)]);
      this.around = rig;
    }
    const source = (v) => [rig.vertices[2 * v], rig.vertices[2 * v + 1]];
    for (const opening of rig.openings.slice(1)) {
      const at = rig.eyeball(opening);
      this.loose(rig, opening.triangles.map((v) => [...at.get(v), ...source(v)]));
    }
    this.drawMouth(rig, source);
    const folds = rig.folds.growth > 0;
    const skin = folds ? this.folded : this.skin;
    this.skinBy(skin, rig);
    if (folds) this.setFolds(rig);
    this.buffer(`skin ${rig.index}`, () => rig.skin, gl.ELEMENT_ARRAY_BUFFER, true);
    gl.drawElements(gl.TRIANGLES, rig.skin.length, gl.UNSIGNED_SHORT, 0);
    gl.enable(gl.BLEND);
    const bare = rig.bareLids();
    this.drawLids(rig, bare);
    this.drawBrows(rig);
    this.drawStandingLashes(rig, bare.filter(({ stands }) => stands > 0));
    this.drawShutLids(rig, bare.filter(({ shut }) => shut > 0));
    // The edges of lids and lips fade out softly; those of closing lids fade with their skin.
    for (const opening of rig.openings) {
      if (!(rig.gap(opening, rig.moved) > 0.5)) continue;
      const strips = edgeStrips(rig, opening, Math.max(1.2, EDGE * rig.softness));
      this.loose(rig, strips, true);
      const { shut } = bare.find((entry) => entry.opening === opening) ?? { shut: 0 };
      if (shut > 0) this.byLidPicture(rig, () => this.loose(rig, strips.map((c) => [...c.slice(0, 4), c[4] * shut]), true));
    }
    for (const opening of rig.openings.slice(1)) this.drawLashes(rig, opening);
    gl.disable(gl.BLEND);
  }
  /** Selects a program, with the current and the original positions of the skin's vertices. */
  skinBy(program, rig) {
    this.use(program, rig);
    this.buffer("skin at", () => rig.moved);
    this.attribute(program, "at");
    this.buffer(`skin from ${rig.index}`, () => rig.vertices, this.gl.ARRAY_BUFFER, true);
    this.attribute(program, "from");
  }
  /** Sets the uniforms of the program for folds. */
  setFolds(rig) {
    const { gl, folded, foldPictures } = this;
    const { folds: { growth, source }, shared } = rig;
    this.buffer(`folds ${rig.index}`, () => rig.onSkin, gl.ARRAY_BUFFER, true);
    this.attribute(folded, "fold");
    this.uniform(folded, "powers", ...rig.foldPowers);
    for (const [name, value] of [["growth", growth], ["lighter", source.folds.lighter], ["none", shared.folds.none], ["limit", shared.folds.limit]]) this.uniform(folded, name, value);
    gl.activeTexture(gl.TEXTURE1);
    if (!foldPictures.has(rig)) foldPictures.set(rig, new Map());
    const known = foldPictures.get(rig);
    if (!known.has(source)) known.set(source, this.texture(softened(source.folds.image, rig.foldSoftening)));
    gl.bindTexture(gl.TEXTURE_2D, known.get(source));
    gl.uniform1i(folded.at("folds")[1], 1);
    gl.uniform1i(folded.at("picture")[1], 0);
    gl.activeTexture(gl.TEXTURE0);
  }
  /** Draws the skin of lids without lashes over the skin that was just drawn, with the same buffers. */
  drawLids(rig, bare) {
    const { gl } = this;
    if (bare.length) this.skinBy(this.skin, rig);
    for (const { opening, lid, gone } of bare) {
      this.byLidPicture(rig, () => {
        gl.vertexAttrib1f(this.skin.at("cover")[0], gone);
        this.buffer(`lid ${rig.index} ${opening.kind}`, () => lid.triangles, gl.ELEMENT_ARRAY_BUFFER, true);
        gl.drawElements(gl.TRIANGLES, lid.triangles.length, gl.UNSIGNED_SHORT, 0);
      });
    }
  }
  /** Draws the effect of raised brows on the skin: the light in hollows, and furrows. */
  drawBrows(rig) {
    const { gl, shade, furrowed, shadePictures, furrowPictures, pictures } = this, { furrows, shared } = rig;
    const hollows = rig.drawnOutHollows(), depths = furrows ? furrows.depths() : [];
    const over = (name, made, make, part) => {
      if (!made.has(part)) made.set(part, this.texture(make()));
      gl.bindTexture(gl.TEXTURE_2D, made.get(part));
      this.buffer(`${name} ${rig.index}`, () => part.triangles, gl.ELEMENT_ARRAY_BUFFER, true);
      gl.drawElements(gl.TRIANGLES, part.triangles.length, gl.UNSIGNED_SHORT, 0);
    };
    gl.blendFunc(gl.DST_COLOR, gl.SRC_COLOR);
    if (hollows.length) this.skinBy(shade, rig);
    hollows.forEach(({ hollow, gone }) => {
      gl.vertexAttrib1f(shade.at("cover")[0], gone);
      this.uniform(shade, "darkest", shared.hollow.darkest);
      over(`hollow ${rig.hollows.indexOf(hollow)}`, shadePictures, () => shadePicture(hollow, rig), hollow);
    });
    if (depths.some(([, depth]) => depth > 0)) {
      this.skinBy(furrowed, rig);
      for (const [name, values] of [["first", furrows.from], ["across", furrows.across], ["up", furrows.up], ["cells", furrows.size], ["places", depths.map((d) => d[0])], ["depths", depths.map((d) => d[1])], ["limit", [shared.furrows.limit]]]) this.uniform(furrowed, name, ...values);
      over("furrows", furrowPictures, () => furrows.image, furrows);
    }
    gl.bindTexture(gl.TEXTURE_2D, pictures.get(rig));
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  /** Draws lashes below raised brows, over the skin without them. */
  drawStandingLashes(rig, standing) {
    const { gl } = this;
    if (!standing.length) return;
    gl.blendFunc(gl.DST_COLOR, gl.ZERO);
    this.byLidPicture(rig, () => standing.forEach((entry) => this.loose(rig, rig.lashStrips(entry), true, this.factor)), "lashes");
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  /** Draws closing lids over the eyes. */
  drawShutLids(rig, shutting) {
    const { gl, lid: program } = this, { zone, form, grain } = rig.shared.shutLid;
    for (const entry of shutting) {
      const { columns, share } = rig.shutLid(entry);
      const corners = columns.slice(1).flatMap(([b, c], k) => [columns[k][0], b, c, columns[k][0], c, columns[k][1]]);
      const part = (name, first) => {
        this.buffer(`shut lid ${name}`, () => Float32Array.from(corners.flatMap((c) => c.slice(first, first + 2))));
        this.attribute(program, name);
      };
      this.use(program, rig);
      ["at", "from", "place"].forEach((name, k) => part(name, 2 * k));
      this.uniform(program, "zone", ...zone);
      this.uniform(program, "form", ...form);
      this.uniform(program, "grain", ...grain);
      this.uniform(program, "colour", ...entry.lid.shut.map((c) => c / 255));
      this.uniform(program, "shut", share);
      gl.drawArrays(gl.TRIANGLES, 0, corners.length);
    }
  }
  /** Draws with the skin of lids, or with their lashes, instead of the picture. */
  byLidPicture(rig, draw, part = "skin") {
    const { gl, pictures, lidPictures } = this;
    if (!lidPictures.has(rig)) {
      const { skin, lashes } = rig.lidPictures();
      lidPictures.set(rig, { skin: this.texture(skin), lashes: this.texture(lashes) });
    }
    gl.bindTexture(gl.TEXTURE_2D, lidPictures.get(rig)[part]);
    draw();
    gl.bindTexture(gl.TEXTURE_2D, pictures.get(rig));
  }
  drawHead(rig) {
    const { gl, head } = this;
    this.around = null;
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(...HEAD_BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.use(head, rig);
    this.uniform(head, "light", ...HEAD_LIGHT);
    this.uniform(head, "other", ...HEAD_FILL);
    const solid = (name, { moved, normals, triangles, colours }, fixed) => {
      this.uniform(head, "lit", 1);
      this.buffer(`${name} at`, () => moved, gl.ARRAY_BUFFER, fixed);
      this.attribute(head, "at", 3);
      this.buffer(`${name} normal`, () => normals, gl.ARRAY_BUFFER, fixed);
      this.attribute(head, "normal", 3);
      if (colours) {
        this.buffer(`${name} colour ${rig.index}`, () => colours, gl.ARRAY_BUFFER, true);
        this.attribute(head, "colour", 3);
      } else this.plain(head, HEAD_SKIN);
      this.buffer(`${name} ${rig.index}`, () => triangles, gl.ELEMENT_ARRAY_BUFFER, true);
      gl.drawElements(gl.TRIANGLES, triangles.length, gl.UNSIGNED_SHORT, 0);
    };
    solid("head", rig, false);
    rig.eyes.forEach((eye, k) => solid(`eye ${rig.index} ${k}`, eye, true));
    this.uniform(head, "lit", 0);
    for (const corners of rig.cavities()) {
      this.plain(head, HEAD_DARK);
      gl.disableVertexAttribArray(head.at("normal")[0]);
      gl.vertexAttrib3f(head.at("normal")[0], 0, 0, 1);
      this.buffer("cavity", () => Float32Array.from(corners.flat()));
      this.attribute(head, "at", 3);
      gl.drawArrays(gl.TRIANGLES, 0, corners.length);
    }
    gl.disable(gl.DEPTH_TEST);
  }
  /** The same colour for all corners. */
  plain(program, colour) {
    const place = program.at("colour")[0];
    this.gl.disableVertexAttribArray(place);
    this.gl.vertexAttrib3f(place, ...colour);
  }
  drawMouth(rig, source) {
    const { gl, mouth } = this;
    const m = rig.mouth();
    if (!(m.gap > 1e-4)) return;
    const { upper, lower, triangles } = m.opening;
    const column = new Map();
    upper.forEach((v, k) => column.set(v, [k, 0]));
    lower.slice(1, -1).forEach((v, k) => column.set(v, [k + 1, 1]));
    const rows = triangles.map((v) => ({ v, column: column.get(v) }));
    this.use(mouth, rig);
    const fill = (name, value) => {
      this.buffer(`mouth ${name}`, () => Float32Array.from(rows.flatMap(value)));
      this.attribute(mouth, name);
    };
    fill("at", ({ v }) => [rig.moved[2 * v], rig.moved[2 * v + 1]]);
    fill("place", ({ column: [k, below] }) => (below ? m.lower[k] : m.upper[k]));
    fill("lips", ({ column: [k] }) => [m.upper[k][1], m.lower[k][1]]);
    fill("above", ({ column: [k] }) => source(upper[k]));
    fill("below", ({ column: [k] }) => source(lower[k]));
    const level = (colour) => colour.map((c) => c / 255);
    this.uniform(mouth, "lip", ...level(rig.lip));
    this.uniform(mouth, "enamel", ...level(rig.enamel));
    this.uniform(mouth, "flesh", ...rig.flesh);
    this.uniform(mouth, "toneFrom", ...rig.tone.lines.map(([from]) => from / 255));
    this.uniform(mouth, "toneRise", ...rig.tone.lines.map(([, rise]) => rise));
    this.uniform(mouth, "ends", ...m.ends);
    this.uniform(mouth, "teethSize", rig.teethImage.naturalWidth, rig.teethImage.naturalHeight);
    this.uniform(mouth, "teethOrigin", ...this.teeth.origin);
    for (const [name, value] of [["teethScale", this.teeth.scale / rig.teethSize], ["white", this.teeth.white], ["gap", m.gap], ["jaw", m.jaw], ["lit", m.lit], ["floorY", m.floor], ["toneShare", rig.tone.share], ["shown", rig.closed ? 1 : 0], ["scale", rig.teethSize], ["wider", m.wider], ["incisors", m.incisors], ["tongue", rig.inside[1]]]) this.uniform(mouth, name, value);
    gl.activeTexture(gl.TEXTURE1);
    if (!this.teethPictures.has(rig)) this.teethPictures.set(rig, this.texture(rig.teethImage));
    gl.bindTexture(gl.TEXTURE_2D, this.teethPictures.get(rig));
    gl.uniform1i(mouth.at("teeth")[1], 1);
    gl.uniform1i(mouth.at("picture")[1], 0);
    gl.drawArrays(gl.TRIANGLES, 0, rows.length);
    gl.activeTexture(gl.TEXTURE0);
    if (!rig.closed) {
      const at = rig.ownMouth(m.skull);
      this.loose(rig, triangles.map((v) => [...at.get(v), ...source(v)]));
    }
  }
  drawLashes(rig, opening) {
    const { gl, lash } = this;
    const { columns, shut, length } = rig.lashColumns(opening);
    if (!(shut > 0)) return;
    const { above, below, hair, share, hairs, lean, apart } = rig.shared.lashLine, ends = columns.flat();
    this.use(lash, rig);
    this.buffer("lash at", () => Float32Array.from(ends.flatMap((end) => end.slice(0, 2))));
    this.attribute(lash, "at");
    this.buffer("lash place", () => Float32Array.from(ends.flatMap((end) => end.slice(2))));
    this.attribute(lash, "place");
    this.uniform(lash, "colour", ...opening.lashes.map((c) => c / 255));
    this.uniform(lash, "shut", shut);
    this.uniform(lash, "edges", ...above, ...below);
    this.uniform(lash, "hair", ...hair);
    this.uniform(lash, "hairs", hairs, lean, share, smoothStep(...apart, length / hairs));
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, ends.length);
  }
}
