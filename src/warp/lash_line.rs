//! The line of lashes of a shutting eye.
//!
//! The lashes of the photograph go as the lid shuts. Those drawn instead stand on the edge of the upper lid, and in the end lie over the lower
//! one, as a line that is sharp towards the lid, with single lashes pointing downwards and fanned out from the middle of the eye. The line
//! also covers white of the eye at the skin's edge, where a fitted lid lies inside the real one.
//! The page of `play` draws the same (`player/assets/rig.js`, `gl.js`, and with single lashes as a shade `flat.js`): change all together.

use std::f64::consts::TAU;

use image::RgbImage;
use nalgebra::Point2;

use super::{
    Texture, Warp,
    mesh::OpeningMesh,
    mouth::{line_at, luma},
    openings::{gap, pixels_around},
    sample,
    tone::Tone,
};
use crate::interpolation::smooth_step;

/// Opening, relative to that on the photograph, below which lashes appear on the upper lid, and at which they are complete.
pub const CLOSING: [f64; 2] = [0.65, 0.3];
/// The same below which the line leaves the upper lid: where the lids meet, it is in the middle between them.
pub const MEETING: f64 = 0.4;
/// Width of the line in the middle of the eye, in eye distances; its minimum, px; and the fraction of it that is left at the corners.
pub const WIDTH: f64 = 0.024;
pub const LEAST_WIDTH: f64 = 0.6;
pub const CORNERS: f64 = 0.35;
/// Distances above and below, over the line's width, between which it fades out.
pub const ABOVE: (f64, f64) = (0.15, 0.75);
pub const BELOW: (f64, f64) = (0.25, 0.85);
/// The same for single lashes; their opacity, their number, and their outward lean per width.
pub const HAIR: (f64, f64) = (0.5, 2.2);
pub const HAIR_SHARE: f64 = 0.5;
pub const HAIRS: f64 = 20.0;
pub const LEAN: f64 = 0.12;
/// Pixels between lashes below which they are drawn as a shade, and from which they are drawn separately.
pub const APART: (f64, f64) = (1.5, 3.0);
/// Red, green and blue of lashes relative to their brightness: brown like hair. The dark colours along a lid include the pupil and reflections.
const BROWN: [f32; 3] = [1.15, 0.96, 0.88];
/// One in this many samples along an upper lid is darker than its lashes.
const DARKER: usize = 6;

/// Draws the line over the frame.
pub fn draw(warp: &Warp, opening: &OpeningMesh, texture: &Texture, vertices: &[Point2<f64>], frame: &mut RgbImage) {
    let open = gap(warp, opening, vertices) / gap(warp, opening, &warp.source).max(1e-9);
    let shut = ((CLOSING[0] - open) / (CLOSING[0] - CLOSING[1])).min(1.0);
    if !(shut > 0.0) {
        return;
    }
    let lower = 0.5 * (1.0 - open / MEETING).clamp(0.0, 1.0);
    let dark = colour(warp, opening, texture);
    let edges = opening.upper.iter().zip(&opening.lower);
    let line: Vec<Point2<f64>> = edges.map(|(&a, &b)| vertices[a as usize].lerp(&vertices[b as usize], lower)).collect();
    let (from, to) = (line[0], line[line.len() - 1]);
    let down = warp.frame.down.into_inner();
    // `across` runs from the outer to the inner corner: to the left on one eye and to the right on the other.
    let across = to - from;
    let heights = warp.frame.line(line.iter().map(|p| p.coords));
    let width = (WIDTH * warp.frame.eye_distance).max(LEAST_WIDTH);
    let single = smooth_step(APART.0, APART.1, across.norm() / HAIRS);
    for (x, y) in pixels_around(&line, HAIR.1 * width, frame.dimensions()) {
        let point = Point2::new(f64::from(x), f64::from(y));
        let along = ((point - from).perp(&down) / across.perp(&down)).clamp(0.0, 1.0);
        let Some(height) = line_at(&heights, point.coords.dot(&warp.frame.across())) else { continue };
        let share = shut * cover(along, (warp.frame.height(&point) - height) / local(width, along), single);
        if share > 0.0 {
            sample::lay(frame.get_pixel_mut(x, y), dark, share as f32);
        }
    }
}

/// Width of the line at a position along it; it narrows towards the corners.
fn local(width: f64, along: f64) -> f64 {
    width * (CORNERS + (1.0 - CORNERS) * 4.0 * along * (1.0 - along))
}

/// Opacity of the lashes at a position along the line and a height in widths below its middle, for separate lashes (`single` 1) or a shade (0).
fn cover(along: f64, below: f64, single: f64) -> f64 {
    let (edge, off) = if below < 0.0 { (ABOVE, -below) } else { (BELOW, below) };
    let core = 1.0 - smooth_step(edge.0, edge.1, off);
    let hair = if below < 0.0 {
        0.0
    } else {
        let wave = (TAU * HAIRS * (along - LEAN * (along - 0.5) * below)).cos();
        HAIR_SHARE * (0.5 + 0.5 * single * wave) * (1.0 - smooth_step(HAIR.0, HAIR.1, below))
    };
    (4.0 * along * (1.0 - along)).sqrt() * core.max(hair)
}

/// Colour of the lashes: brown, about as dark as the darkest samples along the upper lid of the open eye.
pub fn colour(warp: &Warp, opening: &OpeningMesh, texture: &Texture) -> [f32; 3] {
    let unit = warp.frame.eye_distance;
    let down = warp.frame.down.into_inner();
    let along_lid = opening
        .upper
        .iter()
        .flat_map(|&v| [-0.02, 0.0, 0.02].map(|d| luma(texture.sample(warp.source[v as usize] + down * (d * unit)))));
    let mut levels: Vec<f32> = along_lid.collect();
    levels.sort_by(f32::total_cmp);
    Tone::of(texture, &warp.nodes).apply(BROWN.map(|share| share * levels[levels.len() / DARKER]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lashes_stand_downwards_and_the_line_ends_at_the_corners() {
        assert_eq!([cover(0.5, 0.0, 1.0), cover(0.0, 0.0, 1.0), cover(1.0, 0.5, 1.0)], [1.0, 0.0, 0.0]);
        // Nothing one width above its middle; below it half opacity at a lash, and nothing between two lashes.
        assert_eq!(cover(0.5, -1.0, 1.0), 0.0);
        assert!(cover(0.5, 0.9, 1.0) > 0.4 && cover(0.5 + 0.5 / HAIRS, 0.0, 1.0) > 0.99);
        let between = 0.5 + 0.5 / (HAIRS * (1.0 - 0.9 * LEAN));
        assert!(cover(between, 0.9, 1.0) < 0.01, "{}", cover(between, 0.9, 1.0));
        // As a shade they are equally dark everywhere.
        assert_eq!(cover(0.5, 0.9, 0.0), HAIR_SHARE * 0.5 * (1.0 - smooth_step(HAIR.0, HAIR.1, 0.9)));
    }
}
