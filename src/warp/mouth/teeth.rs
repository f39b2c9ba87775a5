//! The mean picture of the upper teeth.

use std::sync::OnceLock;

use image::{Rgba32FImage, RgbaImage};

use crate::geometry::blur::gaussian;

/// The mean picture of the upper teeth.
const TEETH: &[u8] = include_bytes!("../../../candide/teeth.png");
/// Scale of the picture: pixels per eye distance.
pub const TEETH_SCALE: f64 = 220.0;
/// Point of the picture where the midline meets the edge of the incisors, px.
pub const TEETH_ORIGIN: (f64, f64) = (110.17, 44.5);
/// Level in the picture of a tooth as bright as the brightest one of its mouth.
pub const TEETH_WHITE: f32 = 200.0;

/// The mean picture of the upper teeth, in levels; `None` if it cannot be decoded.
pub fn picture() -> Option<&'static Rgba32FImage> {
    static PICTURE: OnceLock<Option<Rgba32FImage>> = OnceLock::new();
    PICTURE
        .get_or_init(|| {
            let picture: RgbaImage = image::load_from_memory_with_format(TEETH, image::ImageFormat::Png).ok()?.to_rgba8();
            let mut levels = Rgba32FImage::new(picture.width(), picture.height());
            for (to, from) in levels.pixels_mut().zip(picture.pixels()) {
                to.0 = from.0.map(f32::from);
            }
            Some(levels)
        })
        .as_ref()
}

/// Colour (levels) and cover (0 to 1) of the upper teeth at a position relative to the midline at the edge of the incisors, in eye distances, y down.
pub fn sampled(picture: &Rgba32FImage, x: f64, y: f64) -> Option<([f32; 3], f32)> {
    let (x, y) = (TEETH_ORIGIN.0 + x * TEETH_SCALE, TEETH_ORIGIN.1 + y * TEETH_SCALE);
    let (left, top) = (x.floor(), y.floor());
    let inside = left >= 0.0 && top >= 0.0 && left + 1.0 < f64::from(picture.width()) && top + 1.0 < f64::from(picture.height());
    if !inside {
        return None;
    }
    let (fx, fy) = ((x - left) as f32, (y - top) as f32);
    let mut sum = [0.0_f32; 4];
    for (dx, dy, share) in [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)] {
        let pixel = picture.get_pixel(left as u32 + dx, top as u32 + dy).0;
        (0..4).for_each(|c| sum[c] += share * pixel[c]);
    }
    Some(([sum[0], sum[1], sum[2]], sum[3] / 255.0))
}

/// Sigma of the Gaussian for one pixel, nearly that of a box of the same width.
const PIXEL: f64 = 0.35;

/// Returns the picture blurred to the resolution of a face with `eye_distance` px, so that sampling does not alias finer detail.
pub fn seen_at(picture: &Rgba32FImage, eye_distance: f64) -> Rgba32FImage {
    let step = TEETH_SCALE / eye_distance.max(1e-6);
    if step <= 1.0 {
        return picture.clone();
    }
    let (sigma, width, height) = (PIXEL * (step * step - 1.0).sqrt(), picture.width() as usize, picture.height() as usize);
    let smooth = |of: &dyn Fn([f32; 4]) -> f32| {
        let values: Vec<f32> = picture.pixels().map(|pixel| of(pixel.0)).collect();
        gaussian(&values, width, height, (sigma, sigma))
    };
    // Colours are weighted by their cover.
    let cover = smooth(&|pixel| pixel[3]);
    let planes = [0, 1, 2].map(|c| smooth(&|pixel| pixel[c] * pixel[3]));
    let mut seen = picture.clone();
    for (k, pixel) in seen.pixels_mut().enumerate() {
        pixel.0[3] = cover[k];
        if cover[k] > 1e-3 {
            (0..3).for_each(|c| pixel.0[c] = planes[c][k] / cover[k]);
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_teeth_are_white_at_the_incisors_and_nothing_below_their_edge() {
        let picture = picture().unwrap();
        let (colour, cover) = sampled(picture, 0.05, -0.06).unwrap();
        assert!(cover > 0.95 && colour.iter().all(|&c| c > 140.0), "{colour:?} {cover}");
        assert!(sampled(picture, 0.05, 0.03).is_none_or(|(_, cover)| cover < 0.05));
        assert!(sampled(picture, 3.0, 0.0).is_none());
    }

    #[test]
    fn the_shipped_teeth_are_the_same_on_both_sides() {
        let picture = picture().unwrap();
        for x in [0.03, 0.1, 0.2, 0.3] {
            let (left, right) = (sampled(picture, -x, -0.07).unwrap(), sampled(picture, x, -0.07).unwrap());
            assert!((left.1 - right.1).abs() < 0.12 && (left.0[1] - right.0[1]).abs() < 12.0, "{x}: {left:?} {right:?}");
        }
    }
}
