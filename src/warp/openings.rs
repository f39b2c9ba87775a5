//! What shows between lids and between lips.

use image::RgbImage;
use nalgebra::{Point2, Vector2};
use tiny_skia::{FillRule, Mask, PathBuilder, Transform};

use super::{
    Deformation, MouthInside, Texture, Warp, eye_motion,
    layout::{OPENINGS, Opening, OpeningNodes},
    mesh::OpeningMesh,
    raster, sample,
};
use crate::geometry::Similarity;

/// Draws what is behind an opening over the frame.
pub fn draw(
    warp: &Warp,
    opening: &OpeningMesh,
    texture: &Texture,
    deformation: &Deformation,
    inside: &MouthInside,
    frame: &mut RgbImage,
) {
    let vertices = &deformation.vertices;
    let outline: Vec<Point2<f64>> = opening
        .upper
        .iter()
        .chain(opening.lower[1..opening.lower.len() - 1].iter().rev())
        .map(|&v| vertices[v as usize])
        .collect();
    let all = opening.upper.iter().chain(&opening.lower);
    if all.clone().all(|&v| vertices[v as usize] == warp.source[v as usize]) && behind_is_still(warp, opening, deformation) {
        return;
    }
    let Some(mut layer) = Layer::new(&outline, frame.dimensions()) else { return };
    let gap = gap(warp, opening, vertices);
    extend_edges(warp, opening, texture, deformation, &mut layer);
    layer.spread();
    layer.lay_under(frame);
    match (opening.opening, inside) {
        (Opening::Mouth, MouthInside::Picture { texture, placement }) => {
            for triangle in &opening.triangles {
                let to = triangle.map(|v| vertices[v as usize]);
                let from = triangle.map(|v| placement.0[v as usize]);
                layer.fill(to, from, |at| texture.sample(at));
            }
        }
        (Opening::Mouth, MouthInside::Dark | MouthInside::Teeth) if warp.closed => {
            dark(warp, opening, texture, deformation, gap, &mut layer);
            if matches!(inside, MouthInside::Teeth) {
                teeth(warp, texture, deformation, &mut layer);
            }
        }
        _ => {
            let behind = behind(warp, opening, deformation);
            for (triangle, corners) in opening.triangles.iter().zip(&behind) {
                let from = triangle.map(|v| warp.source[v as usize]);
                layer.fill(*corners, from, |at| texture.sample(at));
            }
        }
    }
    layer.spread();
    layer.lay_on(frame);
}

/// Whether what lies behind an opening has not moved.
fn behind_is_still(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation) -> bool {
    let nodes = nodes_of(opening);
    nodes.iris.iter().all(|&n| deformation.nodes[usize::from(n)] == warp.nodes[usize::from(n)])
}

fn nodes_of(opening: &OpeningMesh) -> &'static OpeningNodes {
    OPENINGS.iter().find(|o| o.opening == opening.opening).unwrap_or(&OPENINGS[0])
}

/// Carries the skin at the edges on into the opening, so that an edge has something to be blended with, and a shut opening shows
/// no slit: each half gets the colours of its edge.
fn extend_edges(warp: &Warp, opening: &OpeningMesh, texture: &Texture, deformation: &Deformation, layer: &mut Layer) {
    let mut place: Vec<(u32, usize, f64)> = opening.eyeball.iter().map(|&(k, share, v)| (v, k, share)).collect();
    place.extend(opening.upper.iter().enumerate().map(|(k, &v)| (v, k, 0.0)));
    let inner = 1..opening.lower.len() - 1;
    place.extend(opening.lower[inner].iter().enumerate().map(|(k, &v)| (v, k + 1, 1.0)));
    place.sort_by_key(|p| p.0);
    for triangle in &opening.triangles {
        let corners = triangle.map(|v| place.binary_search_by_key(&v, |p| p.0).map_or((0, 0.5), |k| (place[k].1, place[k].2)));
        let above = corners.map(|(k, _)| warp.source[opening.upper[k] as usize]);
        let below = corners.map(|(k, _)| warp.source[opening.lower[k] as usize]);
        let to = triangle.map(|v| deformation.vertices[v as usize]);
        let unit = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0), Point2::new(0.0, 1.0)];
        layer.fill(to, unit, |at| {
            let shares = [1.0 - at.x - at.y, at.x, at.y];
            let share: f64 = shares.iter().zip(&corners).map(|(s, c)| s * c.1).sum();
            let edge = if share < 0.5 { above } else { below };
            let sum: Vector2<f64> = shares.iter().zip(&edge).map(|(s, p)| p.coords * *s).sum();
            texture.sample(Point2::from(sum))
        });
    }
}

/// Largest distance of the edges, px.
fn gap(warp: &Warp, opening: &OpeningMesh, vertices: &[Point2<f64>]) -> f64 {
    let height = |v: u32| warp.frame.height(&vertices[v as usize]);
    opening.upper.iter().zip(&opening.lower).map(|(&a, &b)| height(b) - height(a)).fold(0.0, f64::max)
}

/// The triangles behind an opening: what the photograph shows there moves with the head (and the gaze) only. Where the opening is
/// now wider than on the photograph, its edge is stretched to meet the lid or lip.
fn behind(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation) -> Vec<[Point2<f64>; 3]> {
    let nodes = nodes_of(opening);
    let moved = &deformation.vertices;
    let (rigid, gaze) = if nodes.iris.is_empty() {
        // Teeth go with the nose.
        let translation = deformation.nodes[6] - warp.nodes[6];
        (Similarity { translation, ..Similarity::identity() }, Vector2::zeros())
    } else {
        eye_motion(nodes, &warp.nodes, &deformation.nodes, warp.frame.eye_distance)
    };
    let mut place: Vec<(u32, Point2<f64>)> = Vec::new();
    for &(_, _, v) in &opening.eyeball {
        place.push((v, rigid.apply(&warp.source[v as usize]) + gaze));
    }
    for (edge, sign) in [(&opening.upper, -1.0), (&opening.lower, 1.0)] {
        for &v in edge {
            let stays = rigid.apply(&warp.source[v as usize]) + gaze;
            let goes = moved[v as usize];
            let outer = if sign * (warp.frame.height(&goes) - warp.frame.height(&stays)) > 0.0 { goes } else { stays };
            place.push((v, outer));
        }
    }
    place.sort_by_key(|p| p.0);
    let at = |v: u32| place.binary_search_by_key(&v, |p| p.0).map_or(moved[v as usize], |k| place[k].1);
    opening.triangles.iter().map(|t| t.map(at)).collect()
}

/// The inside of a mouth of which no picture is known.
fn dark(warp: &Warp, opening: &OpeningMesh, texture: &Texture, deformation: &Deformation, gap: f64, layer: &mut Layer) {
    // Lip colour under the light of the photograph.
    let lips = [8_usize, 85, 86].map(|n| texture.sample(warp.nodes[n] + (warp.nodes[40] - warp.nodes[8]) * 0.4));
    let lip: [f32; 3] = std::array::from_fn(|c| (lips[0][c] + lips[1][c] + lips[2][c]) / 3.0);
    let last = opening.upper.len() as f64 - 1.0;
    let mut place: Vec<(u32, Point2<f64>)> = Vec::new();
    for (edge, t) in [(&opening.upper, 0.0), (&opening.lower, 1.0)] {
        for (k, &v) in edge.iter().enumerate() {
            place.push((v, Point2::new(k as f64 / last, t)));
        }
    }
    place.sort_by_key(|p| p.0);
    let at = |v: u32| place.binary_search_by_key(&v, |p| p.0).map_or(Point2::origin(), |k| place[k].1);
    let wide = smooth_step(0.10, 0.30, gap / warp.frame.eye_distance);
    for triangle in &opening.triangles {
        let to = triangle.map(|v| deformation.vertices[v as usize]);
        layer.fill(to, triangle.map(at), |at| {
            let side = (std::f64::consts::PI * at.x.clamp(0.0, 1.0)).sin();
            let tongue = wide * smooth_step(0.45, 0.95, at.y) * side;
            let light = 0.12 + 0.10 * side * at.y + 0.26 * tongue;
            let warm = [1.0, 0.72 + 0.1 * tongue, 0.70 + 0.1 * tongue];
            std::array::from_fn(|c| lip[c] * (light * warm[c]) as f32)
        });
    }
}

/// Right edges of the upper teeth from the midline, over the eye distance: incisors, canine, premolars (8.5, 6.5, 7.5, 7 and 7 mm of a
/// mean 63 mm between the pupils, the outer ones foreshortened).
const TOOTH_EDGES: [f64; 5] = [0.130, 0.225, 0.315, 0.385, 0.435];
/// How far the incisors reach below the closed lips, over the eye distance (2 mm).
const TEETH_BELOW_LIPS: f64 = 0.032;

/// Draws the upper teeth over a dark mouth.
fn teeth(warp: &Warp, texture: &Texture, deformation: &Deformation, layer: &mut Layer) {
    let unit = warp.frame.eye_distance;
    let down = warp.frame.down.into_inner();
    let across = Vector2::new(down.y, -down.x);
    // The skull goes with the base of the nose; the teeth end a little below the middle of the closed lips.
    let moved = deformation.nodes[6] - warp.nodes[6];
    let middle = warp.nodes[87] + moved;
    // As bright as the skin of the cheeks allows.
    let skin = [27_usize, 60, 90, 91].map(|n| texture.sample(warp.nodes[n]));
    let light = skin.iter().map(|c| 0.3 * c[0] + 0.59 * c[1] + 0.11 * c[2]).sum::<f32>() / 4.0;
    let enamel = [1.0, 0.965, 0.90].map(|c: f32| c * (light * 0.95 + 55.0).min(228.0));
    let upper_lip = |x: f64| -> f64 {
        let points = [88_usize, 81, 87, 82, 89].map(|n| deformation.nodes[n] - middle);
        let at = points.map(|p| (p.dot(&across), p.dot(&down)));
        at.windows(2)
            .find(|w| (x - w[0].0) * (x - w[1].0) <= 0.0)
            .map_or(0.0, |w| w[0].1 + (w[1].1 - w[0].1) * (x - w[0].0) / (w[1].0 - w[0].0 + 1e-9))
    };
    let (left, top, width) = (layer.left, layer.top, layer.width);
    for (k, (colour, is_set)) in layer.pixels.iter_mut().enumerate() {
        if !*is_set {
            continue;
        }
        let place = Point2::new(f64::from(left + k as u32 % width), f64::from(top + k as u32 / width)) - middle;
        let (x, y) = (place.dot(&across), place.dot(&down));
        let side = x.abs() / unit;
        let Some(tooth) = TOOTH_EDGES.iter().position(|&edge| side < edge) else { continue };
        let from = if tooth == 0 { 0.0 } else { TOOTH_EDGES[tooth - 1] };
        let within = (side - from) / (TOOTH_EDGES[tooth] - from);
        // The row curves up towards the sides, and every tooth is rounded.
        let round = (2.0 * within - 1.0).powi(4) * 0.010;
        let edge = (TEETH_BELOW_LIPS - 0.20 * side * side - round - if tooth == 1 { 0.006 } else { 0.0 }) * unit;
        let cover = ((edge - y) / (0.008 * unit).max(0.7)).clamp(0.0, 1.0);
        let seam = (within.min(1.0 - within) * (TOOTH_EDGES[tooth] - from) / 0.006).clamp(0.0, 1.0);
        // Darker under the lip, between the teeth and towards the corners of the mouth.
        let shade = smooth_step(-0.01, 0.055, (y - upper_lip(x)) / unit);
        let brightness = (0.55 + 0.45 * shade) * (0.80 + 0.20 * seam) * (1.0 - 1.9 * side * side).max(0.25);
        for c in 0..3 {
            colour[c] += (enamel[c] * brightness as f32 - colour[c]) * cover as f32;
        }
    }
}

fn smooth_step(from: f64, to: f64, value: f64) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Pixels that are laid over a frame within an outline.
struct Layer {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
    /// Colour, and whether there is one.
    pixels: Vec<([f32; 3], bool)>,
    coverage: Mask,
}

impl Layer {
    /// A layer over the bounding box of an outline, clipped to the frame; `None` when nothing of it is in the frame.
    fn new(outline: &[Point2<f64>], size: (u32, u32)) -> Option<Self> {
        const MARGIN: f64 = 2.0;
        let (mut low, mut high) = (outline.first().copied()?, outline.first().copied()?);
        for p in outline {
            low = low.inf(p);
            high = high.sup(p);
        }
        let clip = |value: f64, size: u32| value.clamp(0.0, f64::from(size)) as u32;
        let (left, top) = (clip(low.x - MARGIN, size.0), clip(low.y - MARGIN, size.1));
        let (right, bottom) = (clip(high.x + MARGIN + 1.0, size.0), clip(high.y + MARGIN + 1.0, size.1));
        let (width, height) = (right.checked_sub(left)?, bottom.checked_sub(top)?);
        let mut coverage = Mask::new(width, height)?;
        let mut path = PathBuilder::new();
        for (k, p) in outline.iter().enumerate() {
            // Pixel centres are whole numbers in image space and halves here.
            let (x, y) = ((p.x + 0.5 - f64::from(left)) as f32, (p.y + 0.5 - f64::from(top)) as f32);
            if k == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
        }
        path.close();
        coverage.fill_path(&path.finish()?, FillRule::EvenOdd, true, Transform::identity());
        let pixels = vec![([0.0; 3], false); width as usize * height as usize];
        Some(Self { left, top, width, height, pixels, coverage })
    }

    /// Fills a triangle of the layer; values are interpolated between the corners and become colours.
    fn fill(&mut self, to: [Point2<f64>; 3], values: [Point2<f64>; 3], colour: impl Fn(Point2<f64>) -> [f32; 3]) {
        let origin = Vector2::new(f64::from(self.left), f64::from(self.top));
        let (width, pixels) = (self.width, &mut self.pixels);
        raster::fill(to.map(|p| p - origin), values, (width, self.height), |x, y, at| {
            pixels[(y * width + x) as usize] = (colour(at), true);
        });
    }

    /// Gives the pixels that the outline touches, but no triangle has its centre in, the colour of their neighbours.
    fn spread(&mut self) {
        let before = self.pixels.clone();
        let (width, height) = (i64::from(self.width), i64::from(self.height));
        for (k, pixel) in self.pixels.iter_mut().enumerate() {
            if pixel.1 || self.coverage.data()[k] == 0 {
                continue;
            }
            let (x, y) = (k as i64 % width, k as i64 / width);
            let (mut sum, mut count) = ([0.0_f32; 3], 0.0_f32);
            for (dx, dy) in [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
                let (x, y) = (x + dx, y + dy);
                if (0..width).contains(&x) && (0..height).contains(&y) {
                    let (colour, true) = before[(y * width + x) as usize] else { continue };
                    (0..3).for_each(|c| sum[c] += colour[c]);
                    count += 1.0;
                }
            }
            if count > 0.0 {
                *pixel = (sum.map(|s| s / count), true);
            }
        }
    }

    /// Lays the pixels whose centre the triangles have on the frame, all of them, and empties the layer.
    fn lay_under(&mut self, frame: &mut RgbImage) {
        for (k, (colour, is_set)) in self.pixels.iter_mut().enumerate() {
            if std::mem::take(is_set) && self.coverage.data()[k] > 127 {
                let (x, y) = (k as u32 % self.width, k as u32 / self.width);
                frame.put_pixel(self.left + x, self.top + y, image::Rgb(colour.map(sample::byte)));
            }
        }
    }

    /// Lays it on the frame as far as the outline covers each pixel.
    fn lay_on(&self, frame: &mut RgbImage) {
        for y in 0..self.height {
            for x in 0..self.width {
                let k = (y * self.width + x) as usize;
                let (colour, true) = self.pixels[k] else { continue };
                let share = f32::from(self.coverage.data()[k]) / 255.0;
                if share > 0.0 {
                    let pixel = frame.get_pixel_mut(self.left + x, self.top + y);
                    for (channel, over) in pixel.0.iter_mut().zip(colour) {
                        let under = f32::from(*channel);
                        *channel = sample::byte(under + (over - under) * share);
                    }
                }
            }
        }
    }
}
