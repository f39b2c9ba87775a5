//! Generates the parts of a head that the face model lacks: eyeballs, inside of the mouth, teeth, tongue, brows, and colours.
//!
//! Lengths are in centimetres along the axes of face space; colours are sRGB bytes. Everything is symmetric: the left part of a
//! pair is generated and mirrored.

use nalgebra::Point2;

use super::head_mesh::HeadMesh;
use crate::{
    geometry::polygon::inside_depth,
    mesh::{TriangleMesh, add, cross, normalized, sub},
};

/// Colour of a vertex.
pub type Colour = [u8; 3];

/// What a vertex of a part moves with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Attached {
    /// It does not move relative to the skull.
    Skull,
    /// It rotates with the jaw.
    Jaw,
    /// It moves with three vertices of the skin, with these shares. Their sum is less than 1 for vertices deep in the mouth.
    Skin([(u32, f32); 3]),
}

/// Vertices of all parts; their indices continue those of the skin.
#[derive(Debug)]
pub struct Parts {
    first: u32,
    /// Positions.
    pub positions: Vec<[f32; 3]>,
    /// Colours.
    pub colours: Vec<Colour>,
    /// What each vertex moves with.
    pub attached: Vec<Attached>,
    /// Triangles; their corners can also be skin vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl Parts {
    fn push(&mut self, position: [f32; 3], colour: Colour, attached: Attached) -> u32 {
        self.positions.push(position);
        self.colours.push(colour);
        self.attached.push(attached);
        self.first + self.positions.len() as u32 - 1
    }

    /// Adds triangles between a point and a closed ring around it.
    fn fan(&mut self, pole: u32, row: &[u32]) {
        self.triangles.extend((0..row.len()).map(|k| [pole, row[k], row[(k + 1) % row.len()]]));
    }

    /// Joins a closed ring to the previous ring, or the first ring to a point.
    fn go_on(&mut self, pole: u32, before: &[u32], row: &[u32]) {
        if before.is_empty() { self.fan(pole, row) } else { self.join(before, row, true) }
    }

    /// Adds triangles between two rows with the same number of vertices; if `closed`, the last vertex is joined to the first.
    fn join(&mut self, upper: &[u32], lower: &[u32], closed: bool) {
        let count = upper.len();
        for k in 0..if closed { count } else { count - 1 } {
            let next = (k + 1) % count;
            self.triangles.extend([[upper[k], lower[k], lower[next]], [upper[k], lower[next], upper[next]]]);
        }
    }
}

/// Generates all parts of a head.
pub fn parts(head: &HeadMesh, skin: &TriangleMesh) -> Parts {
    let first = skin.vertex_count() as u32;
    let mut parts = Parts { first, positions: Vec::new(), colours: Vec::new(), attached: Vec::new(), triangles: Vec::new() };
    for side in [1.0, -1.0] {
        eyeball(&mut parts, side);
    }
    mouth(&mut parts, skin);
    teeth(&mut parts, &UPPER);
    teeth(&mut parts, &LOWER);
    tongue(&mut parts);
    brows(&mut parts, head, skin);
    parts
}

/// Centre of the left eyeball, cm: as far forward as possible without the ball passing through a lid in any shape.
pub const EYE_CENTRE: [f32; 3] = [3.15, 3.65, 8.18];
/// Radius of an eyeball, cm; see [`EYE_CENTRE`].
pub const EYE_RADIUS: f32 = 1.3;
/// Offset of the pupil from the middle of the ball, sideways and upwards, as a fraction of the radius.
const GAZE: [f32; 2] = [-0.01, -0.06];
/// Rings of an eyeball: distance from the middle of the pupil along the ball, cm, and colour.
const EYE_RINGS: [(f32, Colour); 15] = [
    (0.10, [10, 10, 12]),
    (0.21, [12, 12, 14]),
    (0.235, [64, 52, 40]),
    (0.32, [98, 92, 78]),
    (0.42, [88, 108, 112]),
    (0.52, [70, 92, 102]),
    (0.58, [46, 58, 66]),
    (0.605, [60, 70, 76]),
    (0.64, [214, 208, 202]),
    (0.80, [236, 231, 226]),
    (1.00, [234, 228, 222]),
    (1.20, [226, 212, 204]),
    (1.40, [212, 186, 178]),
    (1.65, [190, 150, 142]),
    (1.95, [160, 110, 104]),
];
const EYE_SECTORS: u32 = 40;

fn eyeball(parts: &mut Parts, side: f32) {
    let [cx, cy, cz] = EYE_CENTRE;
    let centre = [side * cx, cy, cz];
    // The axes of the ball: towards the pupil, to the left, up.
    let front = normalized([side * GAZE[0], GAZE[1], 1.0]).unwrap_or([0.0, 0.0, 1.0]);
    let right = normalized(cross([0.0, 1.0, 0.0], front)).unwrap_or([1.0, 0.0, 0.0]);
    let up = cross(front, right);
    let at = |forward: f32, across: f32, high: f32| {
        add(centre, std::array::from_fn(|k| EYE_RADIUS * (forward * front[k] + across * right[k] + high * up[k])))
    };
    let pole = parts.push(at(1.0, 0.0, 0.0), EYE_RINGS[0].1, Attached::Skull);
    let mut before: Vec<u32> = Vec::new();
    for (far, colour) in EYE_RINGS {
        let (sin, cos) = (far / EYE_RADIUS).sin_cos();
        let ring: Vec<u32> = (0..EYE_SECTORS)
            .map(|sector| {
                let (high, across) = (sector as f32 / EYE_SECTORS as f32 * std::f32::consts::TAU).sin_cos();
                parts.push(at(cos, sin * across, sin * high), colour, Attached::Skull)
            })
            .collect();
        parts.go_on(pole, &before, &ring);
        before = ring;
    }
}

/// Rings of the inside of the mouth behind the lips: fraction of the way to [`MOUTH_BACK`], width and height relative to the
/// inner border of the lips, share of the lips' motion, colour.
const MOUTH_RINGS: [(f32, f32, f32, f32, Colour); 4] = [
    (0.20, 1.22, 1.75, 0.95, [128, 62, 58]),
    (0.50, 1.30, 2.60, 0.75, [92, 36, 34]),
    (0.80, 1.15, 2.60, 0.55, [54, 18, 18]),
    (1.00, 0.60, 1.40, 0.45, [26, 8, 8]),
];
/// Depth (z) of the back of the mouth, cm.
const MOUTH_BACK: f32 = 5.2;

/// Mean position of a chain of vertices.
fn middle(skin: &TriangleMesh, walk: &[u32]) -> [f32; 3] {
    walk.iter().fold([0.0; 3], |m, &v| add(m, skin.positions()[v as usize].map(|c| c / walk.len() as f32)))
}

/// The border of the skin around the mouth; empty if there is none.
fn mouth_border(skin: &TriangleMesh) -> Vec<u32> {
    let loops = skin.border_loops().into_iter();
    // Of the central borders, the mouth is the foremost; the neck is further back.
    let central = loops.map(|walk| (middle(skin, &walk), walk)).filter(|(m, _)| m[0].abs() < 0.5);
    central.max_by(|a, b| a.0[2].total_cmp(&b.0[2])).map(|(_, walk)| walk).unwrap_or_default()
}

fn mouth(parts: &mut Parts, skin: &TriangleMesh) {
    let border = mouth_border(skin);
    if border.is_empty() {
        return;
    }
    let place = |v: u32| skin.positions()[v as usize];
    let middle = middle(skin, &border);
    let mut before = border.clone();
    for (depth, wide, high, share, colour) in MOUTH_RINGS {
        let ring: Vec<u32> = border
            .iter()
            .map(|&v| {
                let [x, y, z] = place(v);
                let at = [wide * x, middle[1] + high * (y - middle[1]), z + depth * (MOUTH_BACK - z)];
                parts.push(at, colour, Attached::Skin([(v, share), (v, 0.0), (v, 0.0)]))
            })
            .collect();
        parts.join(&before, &ring, true);
        before = ring;
    }
    let (_, _, _, share, colour) = MOUTH_RINGS[MOUTH_RINGS.len() - 1];
    // The back moves with the middles of both lips.
    let nearest = |up: f32| {
        let height = |v: &&u32| place(**v)[0].abs() - 0.01 * up * place(**v)[1];
        border.iter().min_by(|a, b| height(a).total_cmp(&height(b))).copied().unwrap_or_default()
    };
    let ends = [nearest(1.0), nearest(-1.0)].map(|v| (v, share / 2.0));
    let back = parts.push([0.0, middle[1], MOUTH_BACK], colour, Attached::Skin([ends[0], ends[1], (ends[0].0, 0.0)]));
    let next = |k: usize| before[(k + 1) % before.len()];
    parts.triangles.extend((0..before.len()).map(|k| [before[k], back, next(k)]));
}

/// A row of teeth.
struct Row {
    /// Widths of the teeth from the middle to the side, cm.
    widths: [f32; 6],
    /// Height of the biting edge, of the gum line and of the end of the gums, cm.
    heights: [f32; 3],
    /// Depth of the front, half the width, and the length of the arch, cm.
    arch: [f32; 3],
    attached: Attached,
}

const UPPER: Row = Row {
    widths: [0.84, 0.66, 0.76, 0.70, 0.68, 0.98],
    heights: [-3.50, -2.52, -2.05],
    arch: [10.50, 2.62, 4.2],
    attached: Attached::Skull,
};
const LOWER: Row = Row {
    widths: [0.54, 0.60, 0.70, 0.72, 0.74, 1.05],
    heights: [-3.46, -4.28, -4.70],
    arch: [10.26, 2.42, 4.0],
    attached: Attached::Jaw,
};
/// Profile across a tooth from one gap to the next: fraction of its width, how far it stands out from the gap (cm), retreat of
/// its edge (fraction of a round corner), and brightness.
const TOOTH: [(f32, f32, f32, f32); 4] =
    [(0.0, 0.0, 1.0, 0.72), (0.16, 0.034, 0.25, 0.96), (0.5, 0.046, 0.0, 1.0), (0.84, 0.034, 0.25, 0.96)];
/// Depth of a round corner, height of the gum's arch over a tooth, and thickness of the biting edge, cm.
const CORNER: f32 = 0.09;
const SCALLOP: f32 = 0.13;
const EDGE: f32 = 0.16;
/// How much a row curves away from the other towards the sides, cm per square cm along the row.
const BEND: f32 = 0.014;
const ENAMEL: [f32; 3] = [236.0, 228.0, 212.0];
const GUM: Colour = [178, 98, 94];

fn teeth(parts: &mut Parts, row: &Row) {
    let [edge, gum, end] = row.heights;
    let up = (gum - edge).signum();
    let [front, half, length] = row.arch;
    // The arch as a curve parameterized by its length, from the middle to the left.
    let point = |t: f32| [half * t.sin(), front - length * (1.0 - t.cos())];
    let steps: Vec<[f32; 2]> = (0..=400_u16).map(|k| point(f32::from(k) / 400.0 * 1.5)).collect();
    let along = |wanted: f32| {
        let mut run = 0.0;
        for pair in steps.windows(2) {
            let step = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            if run + step >= wanted {
                let share = (wanted - run) / step;
                let [x, z] = [0, 1].map(|k| pair[0][k] + share * (pair[1][k] - pair[0][k]));
                return ([x, z], [(pair[0][1] - pair[1][1]) / step, (pair[1][0] - pair[0][0]) / step]);
            }
            run += step;
        }
        (steps[steps.len() - 1], [1.0, 0.0])
    };
    // Columns from the right end to the left: position along the arch, then the values of `TOOTH`.
    let mut columns: Vec<(f32, f32, f32, f32)> = Vec::new();
    let mut start = 0.0;
    for width in row.widths {
        columns.extend(TOOTH.map(|(share, before, corner, light)| (start + share * width, before, corner, light)));
        start += width;
    }
    columns.push((start, 0.0, 1.0, 0.5));
    let mirrored: Vec<_> = columns[1..].iter().rev().map(|&(s, b, c, l)| (-s, b, c, l)).collect();
    let mut rows: Vec<Vec<u32>> = vec![Vec::new(); 6];
    for (place, before, corner, light) in mirrored.into_iter().chain(columns) {
        let ([x, z], [nx, nz]) = along(place.abs());
        let side = if place < 0.0 { -1.0 } else { 1.0 };
        let dim = light * (1.0 - 0.07 * place.abs());
        let enamel = |warm: f32| ENAMEL.map(|c| c * dim).map(|c| c as u8).map(|c| (f32::from(c) * warm) as u8);
        let bend = up * BEND * place * place;
        let bite = edge + bend + up * CORNER * corner;
        let neck = gum + bend - up * SCALLOP * corner;
        let mid = f32::midpoint(bite, neck);
        let levels = [
            (end + bend, -0.10, GUM),
            (neck, 0.3 * before - 0.02, GUM),
            (neck - up * 0.04, 0.6 * before, enamel(0.93)),
            (mid, before, enamel(1.0)),
            (bite, 0.55 * before - 0.02, enamel(0.98)),
            (bite + up * 0.03, before - EDGE, enamel(0.78)),
        ];
        for (list, (y, out, colour)) in rows.iter_mut().zip(levels) {
            list.push(parts.push([side * (x + out * nx), y, z + out * nz], colour, row.attached));
        }
    }
    for pair in rows.windows(2) {
        // Seen from the front the left side is on the right: an upper row and the lower one below it.
        if up > 0.0 { parts.join(&pair[0], &pair[1], false) } else { parts.join(&pair[1], &pair[0], false) }
    }
}

/// Middle of the tongue at the height of its root; and half its width, height and length, cm.
const TONGUE: ([f32; 3], [f32; 3]) = ([0.0, -4.35, 8.2], [1.65, 0.62, 1.75]);

fn tongue(parts: &mut Parts) {
    const RINGS: u16 = 8;
    const SECTORS: u16 = 20;
    let ([cx, cy, cz], [wide, high, long]) = TONGUE;
    let top = parts.push([cx, cy + high, cz], [176, 92, 90], Attached::Jaw);
    let mut before: Vec<u32> = Vec::new();
    for ring in 1..=RINGS {
        let (sin, cos) = (f32::from(ring) / f32::from(RINGS) * std::f32::consts::FRAC_PI_2).sin_cos();
        let row: Vec<u32> = (0..SECTORS)
            .map(|sector| {
                let (forward, across) = (f32::from(sector) / f32::from(SECTORS) * std::f32::consts::TAU).sin_cos();
                // A groove along the middle.
                let groove = 0.10 * (-(sin * across / 0.16).powi(2)).exp() * cos;
                let at = [cx + wide * sin * across, cy + high * cos - groove, cz - long * sin * forward];
                parts.push(at, [172, 88, 86], Attached::Jaw)
            })
            .collect();
        parts.go_on(top, &before, &row);
        before = row;
    }
}

/// Number of hairs of one brow.
const HAIRS: u16 = 280;
/// Half the height of a brow at its inner end, middle and outer end, cm.
const BROW: [f32; 3] = [0.32, 0.34, 0.09];
/// Distance of a brow below the line of its landmarks, cm.
const BROW_DROP: f32 = 0.30;
const HAIR: Colour = [74, 54, 42];

/// Middle line of the left brow from the inner to the outer end, through the landmarks 22 to 26.
fn brow_line(head: &HeadMesh) -> Vec<[f32; 2]> {
    let place = |k: usize| head.landmarks.get(k).map_or([0.0; 3], |&v| head.positions[v as usize]);
    (22..27).map(place).map(|[x, y, _]| [x.abs(), y - BROW_DROP]).collect()
}

/// Point and direction at a fraction, 0 to 1, of the length of a line.
fn along_line(line: &[[f32; 2]], share: f32) -> ([f32; 2], [f32; 2]) {
    let place = share.clamp(0.0, 1.0) * (line.len() - 1) as f32;
    let k = (place as usize).min(line.len() - 2);
    let (a, b, t) = (line[k], line[k + 1], place - k as f32);
    let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    let length = dx.hypot(dy).max(1e-6);
    ([a[0] + t * dx, a[1] + t * dy], [dx / length, dy / length])
}

/// Half the height of a brow at a fraction of its length.
fn brow_height(share: f32) -> f32 {
    let t = 2.0 * share.clamp(0.0, 1.0);
    let bow = if t < 1.0 { BROW[0] + t * (BROW[1] - BROW[0]) } else { BROW[1] + (t - 1.0) * (BROW[2] - BROW[1]) };
    bow * (share / 0.05).clamp(0.55, 1.0)
}

fn brows(parts: &mut Parts, head: &HeadMesh, skin: &TriangleMesh) {
    let line = brow_line(head);
    let near = |v: &u32| {
        let [x, y, z] = skin.positions()[*v as usize];
        x > -0.2 && x < 8.0 && y > 3.5 && y < 8.0 && z > 4.0
    };
    let front: Vec<[u32; 3]> = skin.triangles().iter().filter(|t| t.iter().all(near)).copied().collect();
    let mirror = |v: u32| super::head_mesh::mirrored(v, head.left, head.middle);
    // A sequence that fills the brow evenly and is the same in every run.
    let spread = |k: u16, step: f32| (f32::from(k) * step).fract();
    for k in 0..HAIRS {
        let share = (f32::from(k) + 0.5) / f32::from(HAIRS);
        let across = 2.0 * spread(k, 0.618_034) - 1.0;
        let wild = spread(k, 0.414_214) - 0.5;
        let ([x, y], [dx, dy]) = along_line(&line, share);
        let height = brow_height(share);
        let root = [x - dy * across * height, y + dx * across * height];
        // Hairs at the inner end stand up; further out they lie along the brow. Those in the upper half point down, those in the
        // lower half up.
        let lift = (68.0 * (1.0 - share / 0.25).clamp(0.0, 1.0) + 12.0 - 26.0 * across * (share / 0.2).clamp(0.0, 1.0)
            + 16.0 * wild)
            .to_radians();
        let (sin, cos) = lift.sin_cos();
        let way = [cos * dx - sin * dy, sin * dx + cos * dy];
        let length = (0.60 - 0.28 * share) * (1.0 + 0.4 * wild);
        let thick = 0.026;
        let corners = [
            ([root[0] + thick * way[1], root[1] - thick * way[0]], 0.012),
            ([root[0] + length * way[0], root[1] + length * way[1]], 0.05),
            ([root[0] - thick * way[1], root[1] + thick * way[0]], 0.012),
        ];
        let placed: Option<Vec<_>> = corners.iter().map(|&(at, high)| on_skin(&front, skin, at, high)).collect();
        let Some(placed) = placed else { continue };
        let tone = 1.0 + 0.35 * wild;
        let colour = HAIR.map(|c| (f32::from(c) * tone) as u8);
        for side in [1.0, -1.0] {
            let corners: Vec<u32> = placed
                .iter()
                .map(|&([x, y, z], shares)| {
                    let shares = if side > 0.0 { shares } else { shares.map(|(v, share)| (mirror(v), share)) };
                    parts.push([side * x, y, z], colour, Attached::Skin(shares))
                })
                .collect();
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            parts.triangles.push(if side > 0.0 { [a, b, c] } else { [a, c, b] });
        }
    }
}

/// A point in front of the skin, and the three vertices around it with their shares.
type OnSkin = ([f32; 3], [(u32, f32); 3]);

/// Returns the point `before` cm in front of the skin at a position seen from the front.
fn on_skin(front: &[[u32; 3]], skin: &TriangleMesh, [x, y]: [f32; 2], before: f32) -> Option<OnSkin> {
    let mut best: Option<OnSkin> = None;
    for &triangle in front {
        let [a, b, c] = triangle.map(|v| skin.positions()[v as usize]);
        let area = |p: [f32; 2], q: [f32; 3], r: [f32; 3]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        let whole = area([a[0], a[1]], b, c);
        let shares = [area([x, y], b, c), area([x, y], c, a), area([x, y], a, b)].map(|s| s / whole);
        if whole <= 0.0 || shares.iter().any(|&s| s < -1e-4) {
            continue;
        }
        let normal = normalized(cross(sub(b, a), sub(c, a))).unwrap_or([0.0, 0.0, 1.0]);
        let depth = shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2];
        if best.is_none_or(|(p, _)| depth > p[2]) {
            let at = add([x, y, depth], normal.map(|n| before * n));
            best = Some((at, [0, 1, 2].map(|k| (triangle[k], shares[k]))));
        }
    }
    best
}

const SKIN: [f32; 3] = [222.0, 178.0, 156.0];
const BLUSH: [f32; 3] = [206.0, 128.0, 112.0];
const LIPS: [f32; 3] = [196.0, 118.0, 109.0];
const SHADOW: [f32; 3] = [96.0, 64.0, 56.0];

/// Colours of the skin: lips, a darker base under the brows, roots of the lashes, and warmer cheeks, nose and ears.
pub fn skin_colours(head: &HeadMesh, skin: &TriangleMesh) -> Vec<Colour> {
    let place = |k: usize| head.landmarks.get(k).map_or([0.0; 3], |&v| head.positions[v as usize]);
    let outline: Vec<Point2<f64>> = (48..60).map(place).map(|[x, y, _]| Point2::new(x, y).cast()).collect();
    let brow = brow_line(head);
    let lashes = lid_margin(skin);
    let blushes: [([f32; 3], f32, f32); 4] = [
        ([4.3, 0.2, 9.0], 2.2, 0.30),
        ([0.0, -0.2, 13.0], 1.2, 0.30),
        ([7.9, 1.5, 0.5], 2.0, 0.35),
        ([0.0, -7.0, 10.6], 1.4, 0.14),
    ];
    let colour = |v: usize| {
        let [x, y, z] = skin.positions()[v];
        let x = x.abs();
        let mut colour = SKIN;
        let mut mix = |to: [f32; 3], share: f32| {
            let share = share.clamp(0.0, 1.0);
            (0..3).for_each(|k| colour[k] += share * (to[k] - colour[k]));
        };
        for ([cx, cy, cz], reach, most) in blushes {
            let far = ((x - cx).powi(2) + (y - cy).powi(2) + (z - cz).powi(2)) / (reach * reach);
            mix(BLUSH, most * (-far).exp());
        }
        if z > 6.0 && y > 3.8 {
            let steps = (0..=40_u16).map(|k| f32::from(k) / 40.0);
            let far = steps.map(|s| {
                let ([bx, by], _) = along_line(&brow, s);
                (x - bx).hypot(y - by) / brow_height(s)
            });
            mix(SHADOW, 0.55 * (1.6 - far.fold(f32::INFINITY, f32::min)));
        }
        if z > 8.0 {
            mix(LIPS, 0.5 + inside_depth(&outline, &Point2::new(x, y).cast()) as f32 / 0.16);
        }
        mix([70.0, 44.0, 38.0], lashes[v]);
        colour.map(|c| c.round() as u8)
    };
    (0..skin.vertex_count()).map(colour).collect()
}

/// Darkness of the skin where lashes grow: rings of vertices around the borders of the eyes, darker at the upper lid.
fn lid_margin(skin: &TriangleMesh) -> Vec<f32> {
    /// Darkness of the rings from the border outwards: upper and lower lid.
    const RINGS: [(f32, f32); 5] = [(0.3, 0.1), (0.75, 0.15), (0.95, 0.3), (0.85, 0.25), (0.3, 0.08)];
    let mut dark = vec![0.0_f32; skin.vertex_count()];
    let mut ring_of = vec![usize::MAX; skin.vertex_count()];
    let is_eye = |walk: &Vec<u32>| {
        walk.iter().all(|&v| skin.positions()[v as usize][0].abs() > 1.0 && skin.positions()[v as usize][1] > 0.0)
    };
    let mut ring: Vec<u32> = skin.border_loops().into_iter().filter(is_eye).flatten().collect();
    for (k, (above, below)) in RINGS.into_iter().enumerate() {
        for &v in &ring {
            let [_, y, _] = skin.positions()[v as usize];
            ring_of[v as usize] = k;
            dark[v as usize] = if y > EYE_CENTRE[1] - 0.2 { above } else { below };
        }
        let touching = skin.triangles().iter().filter(|t| t.iter().any(|&v| ring_of[v as usize] == k));
        let mut next: Vec<u32> = touching.flatten().copied().filter(|&v| ring_of[v as usize] == usize::MAX).collect();
        next.sort_unstable();
        next.dedup();
        ring = next;
    }
    dark
}
