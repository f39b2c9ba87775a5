//! Makes a texture of a dense head from a portrait.
//!
//! Where the face is visible, the texture shows the portrait. Elsewhere it shows the head's own colours, adapted to the
//! portrait's tone.

use image::{Rgb, RgbImage};
use nalgebra::{Point2, Vector3};
use rayon::prelude::*;

use super::{
    Bank, FaceScene, FpMotion, SynthesisError,
    head_irises::{colour_irises, iris_colour},
    interpolate,
};
use crate::{
    geometry::{Similarity, polygon::inside_depth},
    interpolation::smooth_step,
    mesh::vertex_normals,
    units::FeaturePoint,
    warp::{Texture, convex_hull},
    wireframe::{Fapu, Tables},
};

/// Side of the texture, px.
const SIDE: u32 = 2048;
/// Fraction of the texture's side from its middle (front of the head) to the border (back), and the exponent that gives the front
/// more of the space. The larger the exponent, the more.
const REACH: f64 = 0.49;
const FRONT: f64 = 2.2;
/// Upward tilt of the axis at which the texture is centred, degrees: the opposite pole is then in the neck.
const TILT_DEGREES: f64 = 25.0;
/// Groups of the feature points that are placed by the portrait: chin and inner lips, eyes, outer lips, nose. Brows are not used:
/// the head has no edge where a brow ends, so its brow points do not match those of a portrait.
const GROUPS: [u8; 4] = [2, 3, 8, 9];
/// Minimum number of shared feature points.
const FEWEST: usize = 8;
/// Range of the normal's component towards the camera over which the portrait's share rises from 0 to 1.
const FACING: (f64, f64) = (0.12, 0.50);
/// Same for the depth inside the face's outline, in distances between the pupils.
const INSIDE: (f64, f64) = (0.05, 0.20);
/// Distances outside the feature points over which the portrait's share falls from 1 to 0, in distances between the pupils. This
/// keeps the portrait's hair off the head.
const BEYOND: (f64, f64) = (0.32, 0.58);
/// Number of passes that spread colours beyond the painted area, so that viewers which sample next to its border show no seam.
const PADDING: usize = 6;
/// Number of rows painted at once.
const BAND: u32 = 64;
/// Brightness relative to that of skin below which a hidden vertex is not skin.
const DARK: f64 = 0.75;
/// Share of the portrait above which a pixel is used to measure the portrait's tone.
const SURE: f32 = 0.9;

/// The texture and the texture coordinates of every vertex of the bank (0 to 1, v downwards).
#[derive(Clone, Debug)]
pub struct HeadTexture {
    /// The texture.
    pub picture: RgbImage,
    /// Texture coordinates.
    pub places: Vec<[f32; 2]>,
    /// Triangles that use the texture.
    pub worn: Vec<[u32; 3]>,
    /// Triangles of the skin that do not use it: the inside of the mouth.
    pub inside: Vec<[u32; 3]>,
    /// Colours of the vertices, sRGB: sampled from the texture, or the bank's own for vertices that do not use it; irises have the
    /// portrait's colour.
    pub colours: Vec<[u8; 3]>,
}

/// A vertex with its positions in texture and portrait.
#[derive(Clone, Copy)]
struct Corner {
    /// Position in the texture, px.
    at: Point2<f64>,
    /// Position in the portrait, px.
    seen: Point2<f64>,
    /// Component of its normal towards the camera.
    facing: f64,
    colour: [f64; 3],
}

impl HeadTexture {
    /// Makes the texture from a portrait in which all nodes of the wireframe are known (px).
    ///
    /// The portrait is aligned at the feature points it shares with the head and interpolated between them. The shape of the head
    /// does not change.
    ///
    /// # Errors
    /// [`SynthesisError::Portrait`] when head and portrait share too few feature points.
    pub fn new(bank: &Bank, portrait: &RgbImage, nodes: &[Point2<f64>], tables: &Tables) -> Result<Self, SynthesisError> {
        Self::with_side(SIDE, bank, portrait, nodes, tables)
    }

    /// Same with a texture of `side` px, a multiple of [`BAND`].
    fn with_side(
        side: u32,
        bank: &Bank,
        portrait: &RgbImage,
        nodes: &[Point2<f64>],
        tables: &Tables,
    ) -> Result<Self, SynthesisError> {
        let mesh = bank.mesh();
        let seen_at = |v: usize| Point2::new(f64::from(mesh.positions()[v][0]), -f64::from(mesh.positions()[v][1]));
        // Positions of the shared feature points: on the head, and in the portrait.
        let shared: Vec<Option<(Point2<f64>, Point2<f64>)>> = bank
            .feature_points()
            .iter()
            .map(|point| {
                let row = tables.feature_points.iter().find(|row| row.fp == point.fp && GROUPS.contains(&row.fp.group))?;
                let node = nodes.get(row.nodes.first()?.index())?;
                Some((seen_at(point.vertex as usize), *node))
            })
            .collect();
        let (from, to): (Vec<_>, Vec<_>) = shared.iter().flatten().copied().unzip();
        let few = SynthesisError::Portrait { found: from.len(), needed: FEWEST };
        if from.len() < FEWEST {
            return Err(few);
        }
        let Ok(portrait_from_head) = Similarity::fit(&from, &to, None) else { return Err(few) };
        let head_from_portrait = portrait_from_head.inverse();
        let offset = |(on_head, there): (Point2<f64>, Point2<f64>)| {
            let residual = head_from_portrait.apply(&there) - on_head;
            Vector3::new(residual.x, -residual.y, 0.0)
        };
        let residuals =
            FpMotion { offsets: shared.iter().map(|pair| pair.map(offset)).collect(), planar: true, ..FpMotion::default() };
        let moved = interpolate(bank, &residuals);
        let scene = FaceScene::new(bank);
        let own = scene.colours().unwrap_or_else(|| vec![FaceScene::SKIN; bank.vertex_count()]);
        let places = places(bank);
        let normals = vertex_normals(mesh.positions(), mesh.triangles());
        let mut corners: Vec<Corner> = (0..bank.vertex_count())
            .map(|v| Corner {
                at: Point2::new(f64::from(places[v][0]), f64::from(places[v][1])) * f64::from(side),
                seen: portrait_from_head
                    .apply(&(seen_at(v) + nalgebra::Vector2::new(f64::from(moved[v][0]), -f64::from(moved[v][1])))),
                facing: f64::from(normals[v][2]),
                colour: own[v].map(f64::from),
            })
            .collect();
        let skin = scene.skin();
        hide(mesh.positions(), &skin, &mut corners);
        let is_inside = inside_of_the_mouth(bank);
        let is_inside = |&v: &u32| {
            let corner = &corners[v as usize];
            corner.facing < 0.0 && is_inside(mesh.positions()[v as usize], corner.colour)
        };
        let (inside, worn): (Vec<_>, Vec<_>) = skin.into_iter().partition(|triangle| triangle.iter().any(is_inside));
        let unit = portrait_from_head.scale * super::fapu_length(bank, Fapu::Es).unwrap_or(0.0);
        let unit = if unit > 0.0 { unit } else { convex_extent(&to) };
        let canvas = Canvas {
            portrait: Texture::new(portrait),
            outline: convex_hull(nodes.to_vec()),
            features: convex_hull(to),
            unit,
            side,
        };
        let picture = canvas.painted(&worn, &corners);
        let mut colours = own;
        worn.iter().flatten().for_each(|&v| colours[v as usize] = sampled(&picture, places[v as usize]));
        if let Some(colour) = iris_colour(portrait, nodes, tables) {
            colour_irises(&mut colours, &scene.eye_triangles(), colour);
        }
        Ok(Self { picture, places, worn, inside, colours })
    }
}

/// Number of cells of the head's depth map along its larger side.
const DEPTH_CELLS: f32 = 400.0;
/// How far a vertex may lie behind the foremost skin and still count as visible, as a fraction of the larger side: skin that
/// curves away is not hidden.
const HIDDEN: f32 = 0.012;

/// Marks vertices behind other skin, such as those inside the mouth, as facing away from the camera.
fn hide(positions: &[[f32; 3]], skin: &[[u32; 3]], corners: &mut [Corner]) {
    let used = || skin.iter().flatten().map(|&v| positions[v as usize]);
    let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
    for p in used() {
        for axis in 0..2 {
            (low[axis], high[axis]) = (low[axis].min(p[axis]), high[axis].max(p[axis]));
        }
    }
    let larger = (high[0] - low[0]).max(high[1] - low[1]).max(f32::MIN_POSITIVE);
    let scale = DEPTH_CELLS / larger;
    let cell = |p: [f32; 3]| [0, 1].map(|axis| (p[axis] - low[axis]) * scale);
    let width = DEPTH_CELLS as usize + 2;
    let mut foremost = vec![f32::MIN; width * width];
    for triangle in skin {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let [p, q, r] = [a, b, c].map(cell);
        let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        if area.abs() < 1e-9 {
            continue;
        }
        let span = |axis: usize| {
            let values = [p[axis], q[axis], r[axis]];
            let least = values.into_iter().fold(f32::MAX, f32::min).ceil();
            (least as usize, values.into_iter().fold(f32::MIN, f32::max).floor())
        };
        let ((left, right), (bottom, top)) = (span(0), span(1));
        for y in bottom..=(top as usize).min(width - 1) {
            for x in left..=(right as usize).min(width - 1) {
                let (dx, dy) = (x as f32 - p[0], y as f32 - p[1]);
                let s = (dx * (r[1] - p[1]) - dy * (r[0] - p[0])) / area;
                let t = ((q[0] - p[0]) * dy - (q[1] - p[1]) * dx) / area;
                if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
                    let depth = a[2] + (b[2] - a[2]) * s + (c[2] - a[2]) * t;
                    let before = &mut foremost[y * width + x];
                    *before = before.max(depth);
                }
            }
        }
    }
    for (position, corner) in positions.iter().zip(corners) {
        let [x, y] = cell(*position);
        if x < 0.0 || y < 0.0 || x as usize >= width || y as usize >= width {
            continue;
        }
        // The nearest cell, at edges the smallest of the cells around it: an edge does not hide itself.
        let around = [(x.floor(), y.floor()), (x.ceil(), y.floor()), (x.floor(), y.ceil()), (x.ceil(), y.ceil())];
        let front = around.iter().map(|(x, y)| foremost[(*y as usize).min(width - 1) * width + (*x as usize).min(width - 1)]);
        if position[2] < front.fold(f32::MAX, f32::min) - HIDDEN * larger {
            corner.facing = -1.0;
        }
    }
}

/// Returns a test of whether a hidden vertex belongs to the inside of the mouth: it lies within two mouth widths of the middle of
/// the mouth, and its colour is darker than skin.
fn inside_of_the_mouth(bank: &Bank) -> impl Fn([f32; 3], [f64; 3]) -> bool + use<> {
    let corner =
        |point: u8| bank.feature_point_position(FeaturePoint { group: 8, point }).map(|p| Vector3::from(p.map(f64::from)));
    let mouth = corner(3).zip(corner(4)).map(|(left, right)| ((left + right) / 2.0, (left - right).norm()));
    let dark = DARK * FaceScene::SKIN.iter().map(|c| f64::from(*c)).sum::<f64>();
    move |place, colour| {
        mouth.is_some_and(|(middle, width)| {
            let far = (Vector3::from(place.map(f64::from)) - middle).norm();
            far < 2.0 * width && colour.iter().sum::<f64>() < dark
        })
    }
}

/// Largest extent of points along the axes.
fn convex_extent(points: &[Point2<f64>]) -> f64 {
    let extent = |axis: usize| {
        let values = points.iter().map(|p| p[axis]);
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    extent(0).max(extent(1)).max(1.0)
}

/// Computes texture coordinates by direction from within the head.
///
/// The front is in the middle. The distance from the middle grows with the angle from the front; the back of the head is on the
/// border.
fn places(bank: &Bank) -> Vec<[f32; 2]> {
    let mesh = bank.mesh();
    let [low, high] = mesh.bounds();
    let points = bank.feature_points().iter().map(|p| mesh.positions()[p.vertex as usize]);
    let count = points.len().max(1) as f64;
    let mean = |axis: usize| points.clone().map(|p| f64::from(p[axis])).sum::<f64>() / count;
    let middle = Vector3::new(mean(0), mean(1), f64::from(f32::midpoint(low[2], high[2])));
    let (sin, cos) = TILT_DEGREES.to_radians().sin_cos();
    let (front, up) = (Vector3::new(0.0, sin, cos), Vector3::new(0.0, cos, -sin));
    let place = |p: &[f32; 3]| {
        let direction = (Vector3::from(p.map(f64::from)) - middle).try_normalize(1e-12).unwrap_or(front);
        let (right, high) = (direction.x, direction.dot(&up));
        let around = right.hypot(high);
        let turned = direction.dot(&front).clamp(-1.0, 1.0).acos() / std::f64::consts::PI;
        let reach = REACH * (1.0 - (1.0 - turned).powf(FRONT));
        let along = if around > 0.0 { reach / around } else { 0.0 };
        [(0.5 + right * along) as f32, (0.5 - high * along) as f32]
    };
    mesh.positions().iter().map(place).collect()
}

/// Colour of a picture at texture coordinates.
fn sampled(picture: &RgbImage, [u, v]: [f32; 2]) -> [u8; 3] {
    let at = |share: f32, size: u32| ((share * size as f32) as u32).min(size.saturating_sub(1));
    picture.get_pixel(at(u, picture.width()), at(v, picture.height())).0
}

/// The texture being painted.
struct Canvas {
    portrait: Texture,
    outline: Vec<Point2<f64>>,
    features: Vec<Point2<f64>>,
    /// Distance between the pupils in the portrait, px.
    unit: f64,
    /// Side of the texture, px.
    side: u32,
}

/// A pixel of the texture.
#[derive(Clone, Copy)]
struct Cell {
    /// Component of the normal towards the camera; -∞ where nothing is painted.
    facing: f32,
    /// Share of the portrait, 0 to 1.
    share: f32,
    /// The portrait's colour; at the end the final colour.
    seen: [f32; 3],
    /// The head's own colour.
    own: [f32; 3],
}

impl Cell {
    const EMPTY: Self = Self { facing: f32::NEG_INFINITY, share: 0.0, seen: [0.0; 3], own: [0.0; 3] };

    fn is_empty(&self) -> bool {
        self.facing == f32::NEG_INFINITY
    }
}

impl Canvas {
    fn painted(&self, skin: &[[u32; 3]], corners: &[Corner]) -> RgbImage {
        let side = self.side;
        let triangles = skin.iter().map(|t| t.map(|v| corners[v as usize]));
        let triangles: Vec<[Corner; 3]> = triangles.filter(|triangle| is_paintable(triangle, side)).collect();
        let mut cells = vec![Cell::EMPTY; (side * side) as usize];
        cells.par_chunks_mut((BAND * side) as usize).enumerate().for_each(|(k, band)| {
            triangles.iter().for_each(|triangle| self.paint(triangle, k as u32 * BAND, band));
        });
        wear(&mut cells);
        pad(&mut cells, side as usize);
        let worn = || cells.iter().filter(|cell| !cell.is_empty());
        let count = worn().count().max(1) as f64;
        let mean: [f32; 3] = std::array::from_fn(|c| (worn().map(|cell| f64::from(cell.seen[c])).sum::<f64>() / count) as f32);
        let colour = |cell: &Cell| if cell.is_empty() { mean } else { cell.seen };
        RgbImage::from_fn(side, side, |x, y| {
            Rgb(colour(&cells[(y * side + x) as usize]).map(|c| c.round().clamp(0.0, 255.0) as u8))
        })
    }

    /// Share of the portrait at a position `seen` in it, for a normal with this component towards the camera.
    fn share(&self, seen: &Point2<f64>, facing: f64) -> f64 {
        let facing = smooth_step(FACING.0, FACING.1, facing);
        if facing <= 0.0 {
            return 0.0;
        }
        let inside = inside_depth(&self.outline, seen) / self.unit;
        let beyond = -inside_depth(&self.features, seen) / self.unit;
        facing * smooth_step(INSIDE.0, INSIDE.1, inside) * (1.0 - smooth_step(BEYOND.0, BEYOND.1, beyond))
    }

    /// Paints the part of a triangle inside a band of rows that starts at row `first`.
    fn paint(&self, triangle: &[Corner; 3], first: u32, band: &mut [Cell]) {
        let ([a, b, c], side) = (triangle, self.side);
        let area = (b.at - a.at).perp(&(c.at - a.at));
        let ((left, right), (top, bottom)) = (span(triangle, 0), span(triangle, 1));
        let whole = |value: f64, low: u32, high: u32| value.clamp(f64::from(low), f64::from(high)) as u32;
        let last = first + band.len() as u32 / side - 1;
        if bottom + 0.5 < f64::from(first) || top - 0.5 > f64::from(last + 1) {
            return;
        }
        for y in whole(top - 0.5, first, last)..=whole(bottom + 0.5, first, last) {
            for x in whole(left - 0.5, 0, side - 1)..=whole(right + 0.5, 0, side - 1) {
                let p = Point2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let (s, t) = ((p - a.at).perp(&(c.at - a.at)) / area, (b.at - a.at).perp(&(p - a.at)) / area);
                let shares = [1.0 - s - t, s, t];
                if shares.iter().any(|share| *share < -1e-6) {
                    continue;
                }
                let mean =
                    |of: &dyn Fn(&Corner) -> f64| triangle.iter().zip(shares).map(|(corner, w)| of(corner) * w).sum::<f64>();
                let facing = mean(&|k| k.facing);
                let cell = &mut band[((y - first) * side + x) as usize];
                // Where several layers of skin overlap, the one that faces the camera most is kept.
                if cell.facing < facing as f32 {
                    let seen = Point2::new(mean(&|k| k.seen.x), mean(&|k| k.seen.y));
                    *cell = Cell {
                        facing: facing as f32,
                        share: self.share(&seen, facing) as f32,
                        seen: self.portrait.sample(seen),
                        own: std::array::from_fn(|k| mean(&|corner| corner.colour[k]) as f32),
                    };
                }
            }
        }
    }
}

/// Extent of a triangle in the texture along an axis.
fn span(triangle: &[Corner; 3], axis: usize) -> (f64, f64) {
    let values = triangle.iter().map(|corner| corner.at[axis]);
    (values.clone().fold(f64::MAX, f64::min), values.fold(f64::MIN, f64::max))
}

/// Whether a triangle can be painted: one that spans the back of the head would cover the face.
fn is_paintable(triangle: &[Corner; 3], side: u32) -> bool {
    let [a, b, c] = triangle;
    let extent = |axis: usize| {
        let (low, high) = span(triangle, axis);
        high - low
    };
    (b.at - a.at).perp(&(c.at - a.at)).abs() >= 1e-9 && extent(0).max(extent(1)) <= f64::from(side) / 4.0
}

/// Mixes the portrait with the head's own colours, which are scaled to the portrait's tone.
fn wear(cells: &mut [Cell]) {
    let tone: [f32; 3] = std::array::from_fn(|c| {
        let sure = cells.iter().filter(|cell| cell.share > SURE);
        let (seen, own) =
            sure.fold((0.0, 0.0), |(seen, own), cell| (seen + f64::from(cell.seen[c]), own + f64::from(cell.own[c])));
        if own > 0.0 { (seen / own) as f32 } else { 1.0 }
    });
    for cell in cells {
        for ((seen, own), tone) in cell.seen.iter_mut().zip(cell.own).zip(tone) {
            let head = (own * tone).min(255.0);
            *seen = head + (*seen - head) * cell.share;
        }
    }
}

/// Fills pixels next to the painted area with the mean of their neighbours' colours, [`PADDING`] times.
fn pad(cells: &mut [Cell], side: usize) {
    let around = |at: usize| [at - 1, at + 1, at - side, at + side];
    let is_inner = |at: usize| (1..side - 1).contains(&(at % side)) && (1..side - 1).contains(&(at / side));
    let mut next: Vec<usize> = (0..cells.len())
        .filter(|&at| is_inner(at) && cells[at].is_empty() && around(at).iter().any(|&k| !cells[k].is_empty()))
        .collect();
    for _ in 0..PADDING {
        let mean = |at: &usize| {
            let known = || around(*at).into_iter().map(|k| &cells[k]).filter(|cell| !cell.is_empty());
            let count = known().count().max(1) as f32;
            std::array::from_fn(|c| known().map(|cell| cell.seen[c]).sum::<f32>() / count)
        };
        let colours: Vec<[f32; 3]> = next.iter().map(mean).collect();
        for (&at, seen) in next.iter().zip(colours) {
            cells[at] = Cell { facing: f32::MIN, seen, ..Cell::EMPTY };
        }
        next = next.iter().flat_map(|&at| around(at)).filter(|&at| is_inner(at) && cells[at].is_empty()).collect();
        next.sort_unstable();
        next.dedup();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        synthesis::{EmbeddedBank, testing},
        units::NodeId,
        wireframe::Wireframe,
    };

    /// A portrait whose colours encode the position (red across, green down), and its nodes.
    fn portrait() -> (RgbImage, Vec<Point2<f64>>) {
        let frontal = Wireframe::candide3().frontal();
        let nodes: Vec<Point2<f64>> = frontal.iter().map(|p| Point2::new(128.0 + 80.0 * p.x, 128.0 - 80.0 * p.y)).collect();
        (RgbImage::from_fn(256, 256, |x, y| Rgb([x as u8, y as u8, 90])), nodes)
    }

    #[test]
    fn feature_points_wear_what_the_portrait_shows_there() {
        let (bank, tables) = (EmbeddedBank::Head.bank().unwrap(), Tables::candide3());
        let (picture, nodes) = portrait();
        let texture = HeadTexture::with_side(512, &bank, &picture, &nodes, &tables).unwrap();
        assert!(texture.places.iter().flatten().all(|c| (0.0..=1.0).contains(c)));
        // The tip of the nose, a corner of the mouth, the middle of the lower lip.
        for (fp, node) in [("9.3", 5), ("8.4", 64), ("8.2", 8)] {
            let vertex = bank.feature_point_index(fp.parse().unwrap()).map(|k| bank.feature_points()[k].vertex as usize).unwrap();
            let row = tables.feature_points.iter().find(|row| row.fp.to_string() == fp).unwrap();
            assert_eq!(row.nodes[0], NodeId(node), "{fp}");
            let (worn, there) = (texture.colours[vertex], nodes[usize::from(node)]);
            let off = (f64::from(worn[0]) - there.x).hypot(f64::from(worn[1]) - there.y);
            assert!(off < 4.0, "{fp} has the texture of {worn:?}, but in the portrait it is at {there:?}");
        }
        // Textured and untextured skin together are all of the skin.
        let skin = FaceScene::new(&bank).skin().len();
        assert_eq!(texture.worn.len() + texture.inside.len(), skin);
        assert!(texture.inside.len() > 20 && texture.inside.len() < skin / 10, "{} of {skin}", texture.inside.len());
        // Behind the head the portrait is not used: one tone.
        let [low, _] = bank.mesh().bounds();
        let back = (0..bank.vertex_count()).filter(|&v| bank.mesh().positions()[v][2] < low[2] + 2.0);
        let tones: std::collections::BTreeSet<u8> = back.map(|v| texture.colours[v][2]).collect();
        assert!(tones.last().unwrap() - tones.first().unwrap() < 40, "{tones:?}");
    }

    #[test]
    fn a_bank_with_few_feature_points_says_so() {
        let (picture, nodes) = portrait();
        let error = HeadTexture::new(&testing::bank(), &picture, &nodes, &Tables::candide3()).unwrap_err();
        assert_eq!(error.to_string(), "the bank has only 3 of the feature points of a portrait; it needs 8 to show a portrait");
    }
}
