//! Furrows of the forehead that deepen as brows rise.
//!
//! A rising brow compresses the skin of the forehead, which folds along that person's lines. Most adults show these lines faintly on a calm
//! face. They are detected on the photograph as areas that are, along the brows, darker or lighter than right above and below, and are
//! deepened in proportion to the rise of the brow below them. A forehead without lines gets none. The page of `play` does the same with WebGL
//! (`player/assets/brows.js` and `gl.js`): change both together.

use image::{GrayImage, Luma};
use nalgebra::{Point2, Vector2};

use super::{
    Deformation, Texture, Warp,
    lashes::FLOOR,
    layout::{BROWS, Frame},
    mouth::{luma, on_line},
    openings,
    sample::Bounds,
};
use crate::{geometry::blur::gaussian, interpolation::smooth_step};

/// Extent of the detection grid (from the subject's right to the left, and from below upwards) around the middle between the inner ends of the
/// brows, and its step, in eye distances.
const ACROSS: f64 = 0.95;
const UP: (f64, f64) = (-0.10, 0.74);
const STEP: f64 = 1.0 / 160.0;
/// Width of the fade at the border of the grid, in eye distances.
const BORDER: f64 = 0.05;
/// Largest number of samples averaged per cell, each way; the number follows the pixels per cell.
const GRAINS: usize = 4;
/// Smoothing of lines along the brows, and limits of their width across, in eye distances: finer or wider details are not lines.
const ALONG: f64 = 0.070;
const FINE: f64 = 0.010;
const WIDE: f64 = 0.045;
/// Darkest and lightest value of a line on a calm face, as logarithms of a ratio.
const DEEPEST: f32 = -0.08;
const LIGHTEST: f32 = 0.035;
/// Fade-in of the furrows above the brows and inside their ends, and fade-out by the height above the brows, in eye distances.
const ABOVE_BROWS: (f64, f64) = (0.06, 0.16);
const BESIDE: (f64, f64) = (0.0, 0.12);
const HIGHEST: (f64, f64) = (0.42, 0.56);
/// Criteria for skin, from certainly not to certainly (or the reverse): brightness relative to the forehead (`DARK`, logarithm), difference of
/// brightness between two smoothing widths (`EDGE`), and fine detail (`HAIR`). Hair is darker, and has edges and detail.
const DARK: (f32, f32) = (-0.45, -0.25);
const EDGE: (f64, f64) = (0.05, 0.14);
const EDGE_WIDTHS: (f64, f64) = (0.03, 0.10);
const HAIR: (f64, f64) = (0.045, 0.080);
const STRAND: f64 = 0.015;
/// Quantile of the brightness of the possible forehead that serves as its reference.
const FOREHEAD: f64 = 0.60;
/// Deepening of the furrows per eye distance of the brow's rise, and its maximum.
pub const DEEPEN: f64 = 20.0;
pub const MOST: f64 = 4.0;
/// Nodes that measure the rise of the brows, from the subject's right to the left: the middles of both edges, and the inner ends.
pub const PARTS: [&[u16]; 4] = [&[BROWS[1][1], BROWS[1][2]], &[BROWS[1][0]], &[BROWS[0][0]], &[BROWS[0][1], BROWS[0][2]]];
/// Logarithm of a ratio that level 255 of the picture means; 128 is no change.
pub const LIMIT: f32 = 0.1;

/// The furrows of one forehead.
#[derive(Clone, Debug)]
pub struct Furrows {
    /// Position of the grid's first cell, and the steps across and up, px.
    pub from: Point2<f64>,
    pub across: Vector2<f64>,
    pub up: Vector2<f64>,
    /// Levels of the logarithm of the ratio to the surrounding skin.
    pub picture: GrayImage,
}

impl Furrows {
    /// Detects the furrows on a photograph; `None` if it shows no forehead.
    pub fn find(warp: &Warp, texture: &Texture) -> Option<Self> {
        let Frame { eye_distance: unit, down } = warp.frame;
        let (right, up) = (warp.frame.across(), -down.into_inner());
        let brows = Brows::of(&warp.nodes, &warp.frame);
        let (width, height) = ((2.0 * ACROSS / STEP) as usize + 1, ((UP.1 - UP.0) / STEP) as usize + 1);
        let from = brows.middle + (up * UP.0 - right * ACROSS) * unit;
        let (across, up) = (right * STEP * unit, up * STEP * unit);
        let place = |k: usize| (-ACROSS + (k % width) as f64 * STEP, UP.0 + (k / width) as f64 * STEP);
        let at = |k: usize| from + across * (k % width) as f64 + up * (k / width) as f64;
        let grains = (across.norm().ceil() as usize).clamp(1, GRAINS);
        let offs: Vec<f64> = (0..grains).map(|g| (g as f64 + 0.5) / grains as f64 - 0.5).collect();
        let log = |k: usize| {
            let places = offs.iter().flat_map(|u| offs.iter().map(move |v| across * *u + up * *v));
            let sum: f32 = places.map(|off| luma(texture.sample(at(k) + off))).sum();
            (sum.max(0.0) / (grains * grains) as f32 + FLOOR).ln()
        };
        let logs: Vec<f32> = (0..width * height).map(log).collect();

        let smooth = |values: &[f32], across: f64, down: f64| gaussian(values, width, height, (across / STEP, down / STEP));
        let round = |values: &[f32], width: f64| smooth(values, width, width);
        let (line, around) = (smooth(&logs, ALONG, FINE), smooth(&logs, ALONG, WIDE));
        let (near, far) = (round(&logs, EDGE_WIDTHS.0), round(&logs, EDGE_WIDTHS.1));
        let strands: Vec<f32> = logs.iter().zip(round(&logs, STRAND)).map(|(log, mean)| (log - mean).powi(2)).collect();
        let strands = round(&strands, EDGE_WIDTHS.0);
        let forehead: Vec<f32> = (0..logs.len()).map(|k| brows.forehead(place(k)) as f32).collect();
        let mut bright: Vec<f32> = near.iter().zip(&forehead).filter(|(_, share)| **share > 0.9).map(|(log, _)| *log).collect();
        bright.sort_by(f32::total_cmp);
        let bright = *bright.get((FOREHEAD * bright.len() as f64) as usize)?;

        let share = |k: usize| {
            let dark = ((near[k] - bright - DARK.0) / (DARK.1 - DARK.0)).clamp(0.0, 1.0);
            let edge = smooth_step(EDGE.0, EDGE.1, f64::from((near[k] - far[k]).abs()));
            let hair = smooth_step(HAIR.0, HAIR.1, f64::from(strands[k].max(0.0).sqrt()));
            forehead[k] * dark * (1.0 - edge) as f32 * (1.0 - hair) as f32
        };
        let share = round(&(0..logs.len()).map(share).collect::<Vec<f32>>(), 0.5 * EDGE_WIDTHS.0);
        let level = |x: u32, y: u32| {
            let k = y as usize * width + x as usize;
            let log = (line[k] - around[k]).clamp(DEEPEST, LIGHTEST) * share[k];
            Luma([(128.0 + (log / LIMIT * 127.0).round()).clamp(1.0, 255.0) as u8])
        };
        let whole = GrayImage::from_fn(width as u32, height as u32, level);
        // Cropped to the part that has furrows.
        let (mut low, mut high) = ((width as u32, height as u32), (0, 0));
        for (x, y, _) in whole.enumerate_pixels().filter(|(_, _, level)| level.0[0] != 128) {
            (low, high) = ((low.0.min(x), low.1.min(y)), (high.0.max(x), high.1.max(y)));
        }
        // One neutral cell is kept around it.
        let (low, high) = ((low.0.saturating_sub(1), low.1.saturating_sub(1)), (high.0 + 2, high.1 + 2));
        let size = (high.0.min(width as u32).checked_sub(low.0)?, high.1.min(height as u32).checked_sub(low.1)?);
        let picture = image::imageops::crop_imm(&whole, low.0, low.1, size.0, size.1).to_image();
        Some(Self { from: from + across * f64::from(low.0) + up * f64::from(low.1), across, up, picture })
    }

    /// Logarithm at a point of the photograph, and its distance from the subject's right end of the picture, in cells.
    fn log(&self, at: Point2<f64>) -> Option<(f32, f64)> {
        let off = at - self.from;
        let (x, y) = (off.dot(&self.across) / self.across.norm_squared(), off.dot(&self.up) / self.up.norm_squared());
        let (width, height) = self.picture.dimensions();
        if !(x >= 0.0 && y >= 0.0 && x < f64::from(width - 1) && y < f64::from(height - 1)) {
            return None;
        }
        let (column, row) = (x as u32, y as u32);
        let (t, u) = ((x - f64::from(column)) as f32, (y - f64::from(row)) as f32);
        let level = |column: u32, row: u32| f32::from(self.picture.get_pixel(column, row).0[0]) - 128.0;
        let beside = |row: u32| level(column, row) + (level(column + 1, row) - level(column, row)) * t;
        Some(((beside(row) + (beside(row + 1) - beside(row)) * u) / 127.0 * LIMIT, x))
    }

    fn bounds(&self) -> Option<Bounds> {
        let (width, height) = self.picture.dimensions();
        let corner = |x: u32, y: u32| self.from + self.across * f64::from(x) + self.up * f64::from(y);
        Bounds::around([corner(0, 0), corner(width, 0), corner(0, height), corner(width, height)])
    }
}

/// The brows of a face, in eye distances from the middle between their inner ends.
struct Brows {
    middle: Point2<f64>,
    /// Upper edge from the subject's right to the left.
    edge: Vec<(f64, f64)>,
}

impl Brows {
    fn of(nodes: &[Point2<f64>], frame: &Frame) -> Self {
        let [left, right] = BROWS.map(|brow| brow.map(|n| nodes[usize::from(n)]));
        let middle = nalgebra::center(&left[0], &right[0]);
        // The inner node lies on the lower edge; the upper edge is raised by the thickness in the middle.
        let upper = |[inner, above, below, outer]: [Point2<f64>; 4]| [outer, above, inner + (above - below)];
        let ([a, b, c], [d, e, f]) = (upper(right), upper(left));
        let place = |p: Point2<f64>| {
            let off = (p - middle) / frame.eye_distance;
            (off.dot(&frame.across()), -off.dot(&frame.down))
        };
        Self { middle, edge: [a, b, c, f, e, d].map(place).to_vec() }
    }

    /// Weight of a point as forehead above the brows, from its position alone.
    fn forehead(&self, (x, y): (f64, f64)) -> f64 {
        let (Some(first), Some(last)) = (self.edge.first(), self.edge.last()) else { return 0.0 };
        let edge = on_line(&self.edge, x);
        let highest = self.edge.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
        let inside = (x - first.0).min(last.0 - x);
        let border = (ACROSS - x.abs()).min(UP.1 - y);
        smooth_step(0.0, BORDER, border)
            * smooth_step(ABOVE_BROWS.0, ABOVE_BROWS.1, y - edge)
            * smooth_step(BESIDE.0, BESIDE.1, inside)
            * (1.0 - smooth_step(HIGHEST.0, HIGHEST.1, y - highest))
    }
}

/// Furrows as deepened in a frame.
pub struct Deepened<'a> {
    furrows: &'a Furrows,
    /// Pairs of distance from the subject's right end of the picture (cells) and deepening there.
    depths: Vec<(f64, f64)>,
}

/// The furrows that a frame deepens; `None` if no brow rises.
pub fn deepened<'a>(warp: &'a Warp, deformation: &Deformation) -> Option<Deepened<'a>> {
    let furrows = warp.furrows.as_ref()?;
    let depths = depths(warp, deformation, furrows);
    depths.iter().any(|depth| depth.1 > 0.0).then_some(Deepened { furrows, depths })
}

/// Deepening of the furrows above the outer half and the inner end of each brow.
fn depths(warp: &Warp, deformation: &Deformation, furrows: &Furrows) -> Vec<(f64, f64)> {
    let head = openings::head(warp, deformation);
    let up = -warp.frame.down.into_inner();
    let rise = |nodes: &[u16]| {
        let each = nodes.iter().map(|&n| {
            let n = usize::from(n);
            let off = deformation.nodes[n] - head.apply(&warp.nodes[n]);
            off.dot(&head.apply_vector(&up)) / head.scale.powi(2).max(1e-9)
        });
        each.sum::<f64>() / nodes.len() as f64 / warp.frame.eye_distance
    };
    let place = |nodes: &[u16]| {
        let off =
            nalgebra::center(&warp.nodes[usize::from(nodes[0])], &warp.nodes[usize::from(nodes[nodes.len() - 1])]) - furrows.from;
        off.dot(&furrows.across) / furrows.across.norm_squared()
    };
    PARTS.iter().map(|nodes| (place(nodes), (DEEPEN * rise(nodes)).clamp(0.0, MOST))).collect()
}

impl Deepened<'_> {
    /// The box outside of which nothing changes.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        self.furrows.bounds()
    }

    /// Colour of the skin at a point of the photograph.
    pub fn colour(&self, at: Point2<f64>, colour: [f32; 3]) -> [f32; 3] {
        let Some((log, x)) = self.furrows.log(at).filter(|(log, _)| *log != 0.0) else { return colour };
        let factor = (log * on_line(&self.depths, x) as f32).exp();
        colour.map(|level| level * factor)
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::warp::{
        MouthInside,
        test_face::{EYES, lashed, nodes, warp},
    };

    /// Distance of the lines from each other, px.
    const APART: f64 = 0.12 * EYES;

    /// Rows of the forehead above the middle of the left brow, where the lines are.
    fn rows() -> std::ops::Range<u32> {
        let brow = nodes()[16].y;
        (brow - 0.38 * EYES) as u32..(brow - 0.20 * EYES) as u32
    }

    /// A face with lines across its forehead that are darker by `depth` (a logarithm).
    fn lined(depth: f64) -> RgbImage {
        let mut picture = lashed(&nodes(), 2.0);
        for (_, y, pixel) in picture.enumerate_pixels_mut().filter(|(_, y, _)| f64::from(*y) < nodes()[16].y - 0.05 * EYES) {
            let off = (f64::from(y) / APART).fract() - 0.5;
            let light = (-depth * (-(off * APART / 2.0).powi(2)).exp()).exp();
            *pixel = Rgb(pixel.0.map(|level| (f64::from(level) * light).round() as u8));
        }
        picture
    }

    /// Darkest and lightest level of red along a column.
    fn levels(picture: &RgbImage, x: u32, rows: std::ops::Range<u32>) -> (f64, f64) {
        let levels = rows.map(|y| f64::from(picture.get_pixel(x, y).0[0]));
        levels.fold((f64::INFINITY, 0.0), |(low, high), level| (low.min(level), high.max(level)))
    }

    /// Depth of the lines above each brow, with the left one raised by `by` eye distances.
    fn depths(picture: &RgbImage, by: f64) -> [f64; 2] {
        let texture = Texture::new(picture);
        let warp = warp().with_eyes(&texture);
        let mut raised = nodes();
        BROWS[0].iter().for_each(|&n| raised[usize::from(n)].y -= by * EYES);
        let frame = warp.render(&texture, &warp.deform(&raised).unwrap(), &MouthInside::Dark);
        BROWS.map(|brow| {
            let [inner, above] = [brow[0], brow[1]].map(|n| nodes()[usize::from(n)].x);
            let x = f64::midpoint(inner, above);
            let rows = rows();
            let up = if brow == BROWS[0] { (by * EYES / 2.0) as u32 } else { 0 };
            let (low, high) = levels(&frame, x.round() as u32, rows.start - up..rows.end - up);
            (high / low).ln()
        })
    }

    #[test]
    fn lines_of_a_forehead_deepen_above_the_brow_that_rises_only() {
        let picture = lined(0.04);
        let calm = depths(&picture, 0.0);
        assert!(calm.iter().all(|depth| (depth - 0.04).abs() < 0.01), "{calm:?}");
        let [left, right] = depths(&picture, 0.10);
        // DEEPEN times 0.10 is 2: what the filter detects as a line becomes three times as deep.
        assert!((2.0..3.2).contains(&(left / calm[0])), "{left} of {calm:?}");
        assert!((right / calm[1] - 1.0).abs() < 0.3, "{right} of {calm:?}");
    }

    #[test]
    fn even_skin_has_no_furrows_and_hair_none_that_deepen() {
        let even = lashed(&nodes(), 2.0);
        assert!(depths(&even, 0.15).iter().all(|depth| *depth < 0.01));
        // Strands of hair: every third row dark, in alternating places.
        let mut hair = even.clone();
        for (x, y, pixel) in hair.enumerate_pixels_mut() {
            if f64::from(y) < nodes()[16].y - 0.05 * EYES && (y + x / 7 % 3) % 3 == 0 {
                *pixel = Rgb([120, 90, 80]);
            }
        }
        let texture = Texture::new(&hair);
        let furrows = warp().with_eyes(&texture).furrows.unwrap();
        let most = furrows.picture.pixels().map(|p| p.0[0].abs_diff(128)).max();
        // Five times as deep, this is 4 % at most.
        assert!(most.is_some_and(|most| most <= 10), "{most:?}");
    }
}
