//! A synthetic face for the tests of this module.

use std::sync::LazyLock;

use image::{Rgb, RgbImage};
use nalgebra::Point2;

use super::{Warp, layout::OPENINGS};
use crate::{geometry::polygon::distance_to_line, wireframe::Wireframe};

/// Distance of its eyes, px.
pub const EYES: f64 = 110.0;

/// Candide-3 on a picture of 300 x 380 px.
pub fn nodes() -> Vec<Point2<f64>> {
    let scale = EYES / 0.6;
    Wireframe::candide3().vertices().iter().map(|v| Point2::new(150.0 + scale * v.x, 190.0 - scale * v.y)).collect()
}

/// Its warp, made once for all tests.
pub fn warp() -> Warp {
    static WARP: LazyLock<Warp> = LazyLock::new(|| Warp::new(&nodes()).unwrap());
    WARP.clone()
}

/// Draws skin, dark circles in white around the irises' centres, and dark lashes that stand up to `reach` px over the upper lids.
pub fn lashed(nodes: &[Point2<f64>], reach: f64) -> RgbImage {
    let lids: Vec<Vec<Point2<f64>>> = OPENINGS[1..].iter().map(|eye| eye.upper.map(|n| nodes[usize::from(n)]).to_vec()).collect();
    let eyes = OPENINGS[1..]
        .iter()
        .map(|eye| nodes[usize::from(eye.upper[0])].coords.lerp(&nodes[usize::from(eye.upper[4])].coords, 0.5).into());
    let eyes: Vec<Point2<f64>> = eyes.collect();
    RgbImage::from_fn(300, 380, |x, y| {
        let at = Point2::new(f64::from(x), f64::from(y));
        let lash = lids.iter().any(|lid| distance_to_line(lid, &at) < reach && at.y < lid[2].y + 3.0);
        let apart = eyes.iter().map(|eye| (at - eye).norm()).fold(f64::INFINITY, f64::min);
        match (lash, apart) {
            (true, _) => Rgb([40, 30, 30]),
            (_, a) if a < 6.0 => Rgb([60, 40, 20]),
            (_, a) if a < 11.0 => Rgb([230, 228, 226]),
            _ => Rgb([205, 160, 140]),
        }
    })
}
