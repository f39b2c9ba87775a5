//! What shows between lids and between lips.

use image::RgbImage;
use nalgebra::{Point2, Vector2};
use tiny_skia::{FillRule, Mask, PathBuilder, Transform};

use super::{
    Deformation, MouthInside, Texture, Warp,
    layout::{OPENINGS, Opening},
    mesh::OpeningMesh,
    raster, sample,
};
use crate::geometry::Similarity;

/// An opening lower than this, in px, shows nothing.
const LEAST_GAP_PX: f64 = 0.25;

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
    let all = opening.upper.iter().chain(&opening.lower).chain(&opening.iris);
    if all.clone().all(|&v| vertices[v as usize] == warp.source[v as usize]) {
        return;
    }
    let gap = gap(warp, opening, vertices);
    if gap < LEAST_GAP_PX {
        return;
    }
    let Some(mut layer) = Layer::new(&outline, frame.dimensions()) else { return };
    match (opening.opening, inside) {
        (Opening::Mouth, MouthInside::Picture { texture, placement }) => {
            for triangle in &opening.triangles {
                let to = triangle.map(|v| vertices[v as usize]);
                let from = triangle.map(|v| placement.0[v as usize]);
                layer.fill(to, from, |at| texture.sample(at));
            }
        }
        (Opening::Mouth, MouthInside::Dark) if !is_open(warp, opening) => dark(warp, opening, texture, deformation, gap, &mut layer),
        _ => {
            let behind = behind(warp, opening, deformation);
            for (triangle, corners) in opening.triangles.iter().zip(&behind) {
                let from = triangle.map(|v| warp.source[v as usize]);
                layer.fill(*corners, from, |at| texture.sample(at));
            }
        }
    }
    layer.lay_on(frame);
}

/// Largest distance of the edges, px.
fn gap(warp: &Warp, opening: &OpeningMesh, vertices: &[Point2<f64>]) -> f64 {
    let height = |v: u32| warp.frame.height(&vertices[v as usize]);
    opening.upper.iter().zip(&opening.lower).map(|(&a, &b)| height(b) - height(a)).fold(0.0, f64::max)
}

/// Whether the photograph itself shows the opening open.
fn is_open(warp: &Warp, opening: &OpeningMesh) -> bool {
    gap(warp, opening, &warp.source) > 1e-6
}

/// The triangles behind an opening: what the photograph shows there moves with the head (and the gaze) only. Where the opening is
/// now wider than on the photograph, its edge is stretched to meet the lid or lip.
fn behind(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation) -> Vec<[Point2<f64>; 3]> {
    let nodes = &OPENINGS[warp.mesh.openings.iter().position(|o| o.opening == opening.opening).unwrap_or_default()];
    let moved = &deformation.vertices;
    let rigid = if nodes.iris.is_empty() {
        // Teeth go with the nose.
        let translation = deformation.nodes[6] - warp.nodes[6];
        Similarity { translation, ..Similarity::identity() }
    } else {
        let corners = |points: &[Point2<f64>]| [points[usize::from(nodes.upper[0])], points[usize::from(nodes.upper[4])]];
        Similarity::fit(&corners(&warp.nodes), &corners(&deformation.nodes), None).unwrap_or_else(|_| Similarity::identity())
    };
    let mut place: Vec<(u32, Point2<f64>)> = opening.iris.iter().map(|&v| (v, moved[v as usize])).collect();
    for (edge, sign) in [(&opening.upper, -1.0), (&opening.lower, 1.0)] {
        for &v in edge {
            let stays = rigid.apply(&warp.source[v as usize]);
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

    fn lay_on(&self, frame: &mut RgbImage) {
        for y in 0..self.height {
            for x in 0..self.width {
                let k = (y * self.width + x) as usize;
                let (colour, true) = self.pixels[k] else { continue };
                let share = f32::from(self.coverage.data()[k]) / 255.0;
                if share > 0.0 {
                    let pixel = frame.get_pixel_mut(self.left + x, self.top + y);
                    for c in 0..3 {
                        let under = f32::from(pixel.0[c]);
                        pixel.0[c] = sample::byte(under + (colour[c] - under) * share);
                    }
                }
            }
        }
    }
}
