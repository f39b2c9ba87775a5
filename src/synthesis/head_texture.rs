//! What the skin of a dense head wears: a portrait where the face is seen, its own colours in the portrait's tone elsewhere.

use image::{Rgb, RgbImage};
use nalgebra::{Point2, Vector3};
use rayon::prelude::*;

use super::{Bank, FaceScene, FpMotion, SynthesisError, interpolate};
use crate::{
    geometry::{Similarity, polygon::inside_depth},
    interpolation::smooth_step,
    mesh::vertex_normals,
    units::FeaturePoint,
    warp::{Texture, convex_hull},
    wireframe::{Fapu, Tables},
};

/// Side of the picture, px.
const SIDE: u32 = 2048;
/// Share of it between the front and the back of the head, from the middle to the border, and the power that gives the front more of it.
const REACH: f64 = 0.49;
const FRONT: f64 = 2.2;
/// How far up the axis looks on which the picture is centred, degrees: the back of it lies in the neck.
const TILT_DEGREES: f64 = 25.0;
/// Groups of feature points whose places the portrait gives: chin and inner lips, eyes, outer lips, nose. A head has no edge where a brow
/// ends, so that its points are not on those of a portrait.
const GROUPS: [u8; 4] = [2, 3, 8, 9];
/// Fewest of them.
const FEWEST: usize = 8;
/// How much a place faces the camera, from where the portrait begins to be seen to where it alone is.
const FACING: (f64, f64) = (0.12, 0.50);
/// The same for the depth inside the face's outline, over the distance of the pupils.
const INSIDE: (f64, f64) = (0.05, 0.20);
/// How far from the feature points the portrait begins to end, and ends, over the distance of the pupils: hair is not the head's.
const BEYOND: (f64, f64) = (0.32, 0.58);
/// Passes that carry colours over the borders of what is painted, so that none is seen where a viewer samples beside it.
const PADDING: usize = 6;
/// Rows that are painted at once.
const BAND: u32 = 64;
/// Brightness over that of skin below which a hidden place is no skin.
const DARK: f64 = 0.75;
/// Share of a painted place above which it counts as the portrait's.
const SURE: f32 = 0.9;

/// The picture, and where in it every vertex of the bank lies (0 to 1, v downwards).
#[derive(Clone, Debug)]
pub struct HeadTexture {
    /// The picture.
    pub picture: RgbImage,
    /// Texture coordinates.
    pub places: Vec<[f32; 2]>,
    /// Triangles that wear it.
    pub worn: Vec<[u32; 3]>,
    /// Triangles of the skin that do not: the inside of the mouth.
    pub inside: Vec<[u32; 3]>,
    /// Colours of the vertices in it, and the bank's own where it is not worn, sRGB.
    pub colours: Vec<[u8; 3]>,
}

/// A vertex on its way into the picture.
#[derive(Clone, Copy)]
struct Corner {
    /// In the texture, px.
    at: Point2<f64>,
    /// In the portrait, px.
    seen: Point2<f64>,
    /// How much it faces the camera.
    facing: f64,
    colour: [f64; 3],
}

impl HeadTexture {
    /// Puts a portrait, of which all nodes of the wireframe are known (px), on the skin of a head. The head's feature points meet those of the
    /// portrait, and what lies between them goes along; the head keeps its shape.
    ///
    /// # Errors
    /// [`SynthesisError::Portrait`] when head and portrait share too few feature points.
    pub fn new(bank: &Bank, portrait: &RgbImage, nodes: &[Point2<f64>], tables: &Tables) -> Result<Self, SynthesisError> {
        Self::with_side(SIDE, bank, portrait, nodes, tables)
    }

    /// The same with a texture of `side` px, a multiple of [`BAND`].
    fn with_side(
        side: u32,
        bank: &Bank,
        portrait: &RgbImage,
        nodes: &[Point2<f64>],
        tables: &Tables,
    ) -> Result<Self, SynthesisError> {
        let mesh = bank.mesh();
        let seen_at = |v: usize| Point2::new(f64::from(mesh.positions()[v][0]), -f64::from(mesh.positions()[v][1]));
        // Feature points that both have: on the head, and on the portrait.
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
        let residuals = FpMotion { offsets: shared.iter().map(|pair| pair.map(offset)).collect(), planar: true };
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
        Ok(Self { picture, places, worn, inside, colours })
    }
}

/// Cells of the depth map of a head, along its larger side.
const DEPTH_CELLS: f32 = 400.0;
/// How far behind the foremost skin a vertex is still seen, over the larger side: what curves away is not hidden.
const HIDDEN: f32 = 0.012;

/// Vertices behind other skin, as those of the inside of the mouth, face away from the camera.
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
        // The nearest cell, beside edges the least of those around: an edge is not behind itself.
        let around = [(x.floor(), y.floor()), (x.ceil(), y.floor()), (x.floor(), y.ceil()), (x.ceil(), y.ceil())];
        let front = around.iter().map(|(x, y)| foremost[(*y as usize).min(width - 1) * width + (*x as usize).min(width - 1)]);
        if position[2] < front.fold(f32::MAX, f32::min) - HIDDEN * larger {
            corner.facing = -1.0;
        }
    }
}

/// Whether a place that is hidden is of the inside of the mouth: it lies within two widths of the mouth from its middle, and is painted darker
/// than skin.
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

/// Texture coordinates: directions from within the head, those to the front in the middle, all around it as far from it as they turn away.
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

/// The colour of a picture at a place.
fn sampled(picture: &RgbImage, [u, v]: [f32; 2]) -> [u8; 3] {
    let at = |share: f32, size: u32| ((share * size as f32) as u32).min(size.saturating_sub(1));
    picture.get_pixel(at(u, picture.width()), at(v, picture.height())).0
}

/// The texture being painted.
struct Canvas {
    portrait: Texture,
    outline: Vec<Point2<f64>>,
    features: Vec<Point2<f64>>,
    /// Distance of the pupils in the portrait, px.
    unit: f64,
    /// Side of the texture, px.
    side: u32,
}

/// A place of the texture.
#[derive(Clone, Copy)]
struct Cell {
    /// How much what is there faces the camera; -∞ where nothing is.
    facing: f32,
    /// Share of the portrait.
    share: f32,
    /// The portrait's colour, in the end the one that is worn.
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

    /// Share of the portrait at a place that faces the camera so much.
    fn share(&self, seen: &Point2<f64>, facing: f64) -> f64 {
        let facing = smooth_step(FACING.0, FACING.1, facing);
        if facing <= 0.0 {
            return 0.0;
        }
        let inside = inside_depth(&self.outline, seen) / self.unit;
        let beyond = -inside_depth(&self.features, seen) / self.unit;
        facing * smooth_step(INSIDE.0, INSIDE.1, inside) * (1.0 - smooth_step(BEYOND.0, BEYOND.1, beyond))
    }

    /// Paints what of a triangle lies in a band of rows from `first` on.
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
                // Where the skin lies over itself, what is seen from the front is kept.
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

/// Whether a triangle is one in the texture: one that spans the back of the head would cover the face.
fn is_paintable(triangle: &[Corner; 3], side: u32) -> bool {
    let [a, b, c] = triangle;
    let extent = |axis: usize| {
        let (low, high) = span(triangle, axis);
        high - low
    };
    (b.at - a.at).perp(&(c.at - a.at)).abs() >= 1e-9 && extent(0).max(extent(1)) <= f64::from(side) / 4.0
}

/// Mixes the portrait with the head's own colours in the portrait's tone.
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

/// Gives places beside what is painted the mean of their neighbours' colours, [`PADDING`] times.
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

    /// A portrait whose colours say where they are: red across, green down; and its nodes.
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
            assert!(off < 4.0, "{fp} wears {worn:?}, the portrait has its point at {there:?}");
        }
        // Skin that is worn and what is not are all of the skin.
        let skin = FaceScene::new(&bank).skin().len();
        assert_eq!(texture.worn.len() + texture.inside.len(), skin);
        assert!(texture.inside.len() > 20 && texture.inside.len() < skin / 10, "{} of {skin}", texture.inside.len());
        // Behind the head no portrait is seen: one tone.
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
