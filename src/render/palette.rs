//! Reduction of pictures to the 256 colours of a GIF frame.

use color_quant::NeuQuant;
use image::{RgbImage, Rgba, RgbaImage};

/// Largest number of colours in a frame.
const COLOURS: usize = 256;
/// Bits per channel by which colours are binned.
const BITS: u8 = 5;
/// Samples per bin, in units of the square root of its pixels; a small bin contributes all of them.
const SHARE: u64 = 8;

/// Reduces a picture to at most 256 colours, which an encoder then keeps.
///
/// Each colour is weighted by the square root of its area. Weighted by area alone, skin and background, which fill most of a portrait, take
/// all 256 colours, so that eyes turn grey and lips brown.
pub fn in_few_colours(picture: &RgbImage) -> RgbaImage {
    let bin = |p: &[u8; 3]| p.iter().fold(0, |bin, &level| (bin << BITS) | usize::from(level >> (8 - BITS)));
    let mut counts = vec![0_u64; 1 << (3 * BITS)];
    picture.pixels().for_each(|p| counts[bin(&p.0)] += 1);
    // Takes evenly spaced samples from the pixels of each bin.
    let mut seen = vec![0_u64; counts.len()];
    let mut samples: Vec<u8> = Vec::new();
    for p in picture.pixels() {
        let bin = bin(&p.0);
        let (count, taken) = (counts[bin], (SHARE * counts[bin].isqrt()).min(counts[bin]));
        let before = seen[bin] * taken / count;
        seen[bin] += 1;
        if seen[bin] * taken / count > before {
            samples.extend([p.0[0], p.0[1], p.0[2], u8::MAX]);
        }
    }
    let map = NeuQuant::new(1, COLOURS, &samples);
    let palette = map.color_map_rgb();
    // Similar colours are looked up once.
    let mut known = vec![None; 1 << 18];
    let mut shown = RgbaImage::new(picture.width(), picture.height());
    for (to, from) in shown.pixels_mut().zip(picture.pixels()) {
        let [r, g, b] = from.0;
        let key = (usize::from(r >> 2) << 12) | (usize::from(g >> 2) << 6) | usize::from(b >> 2);
        let index = *known[key].get_or_insert_with(|| map.index_of(&[r, g, b, u8::MAX]));
        let colour = palette.get(3 * index..3 * index + 3).unwrap_or(&from.0);
        *to = Rgba([colour[0], colour[1], colour[2], u8::MAX]);
    }
    shown
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_small_blue_eye_in_a_large_face_stays_blue() {
        // Skin in 60,000 shades of light, and 12 x 12 pixels of iris.
        let picture = RgbImage::from_fn(300, 200, |x, y| {
            let light = 0.5 + (f64::from(x) + f64::from(y)) / 1000.0;
            let skin = [220.0, 170.0, 150.0].map(|v: f64| (v * light) as u8);
            let iris = (100..112).contains(&x) && (80..92).contains(&y);
            image::Rgb(if iris { [90 + (x % 4) as u8, 120, 150] } else { skin })
        });
        let shown = in_few_colours(&picture);
        let colours: BTreeSet<[u8; 4]> = shown.pixels().map(|p| p.0).collect();
        assert!(colours.len() <= COLOURS, "{}", colours.len());
        let [r, g, b, a] = shown.get_pixel(106, 86).0;
        assert!(r.abs_diff(92) < 8 && g.abs_diff(120) < 8 && b.abs_diff(150) < 8 && a == 255, "{r} {g} {b}");
        let off: u32 = shown.pixels().zip(picture.pixels()).map(|(s, p)| u32::from(s.0[1].abs_diff(p.0[1]))).sum();
        assert!(off < 3 * 300 * 200, "{off}");
    }
}
