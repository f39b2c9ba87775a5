//! Adapts colours to the light of a photograph: what is drawn on a photograph in one tone (grey or sepia) gets that tone, and
//! what is taken from another photograph loses the colour cast of its light.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Texture, mouth::luma};
use crate::interpolation::smooth_step;

/// Root mean square distance of a face's colours from a line over their brightness, relative to the brightness: up to the first value the photograph
/// is in one tone, from the second on in colour. Grey ones have 0, sepia ones 0.015, ten colour photographs 0.042 to 0.062.
const OFF_TONE: (f64, f64) = (0.018, 0.028);

/// Tolerated difference between two people's skin in the same light: root of the sum of squares of the logarithms of red, green
/// and blue relative to brightness. Pairs of the 90 people of `scripts/people_dataset`: 0.08 on the median, 95 % up to 0.22.
const SKINS: f32 = 0.20;

/// Factors for red, green and blue from the light of one photograph to that of another, estimated from the skin of both at the same points of the
/// face. Brightness, and colour differences up to those between people, are not changed.
pub fn cast(from: &[[f32; 3]], to: &[[f32; 3]]) -> [f32; 3] {
    let median = |colours: &[[f32; 3]], c: usize| {
        let mut levels: Vec<f32> = colours.iter().map(|colour| colour[c]).collect();
        levels.sort_by(f32::total_cmp);
        levels.get(levels.len() / 2).map_or(1.0, |level| level.max(1.0))
    };
    let logs: [f32; 3] = std::array::from_fn(|c| (median(to, c) / median(from, c)).ln());
    let bright = luma(logs);
    let apart = logs.map(|log| log - bright);
    let distance = apart.iter().map(|log| log * log).sum::<f32>().sqrt();
    let share = (1.0 - SKINS / distance.max(SKINS)).max(0.0);
    apart.map(|log| (share * log).exp())
}

/// The colours of a photograph as linear functions of their brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Level at brightness 0 and slope, for red, green and blue.
    pub lines: [[f32; 2]; 3],
    /// 1 for a photograph in one tone, 0 for one in colour.
    pub share: f32,
}

/// Degree to which a photograph is in one tone, from points of a face: 0 (colour) to 1.
pub fn one_tone(texture: &Texture, places: &[Point2<f64>]) -> f32 {
    Tone::of(texture, places).share
}

impl Tone {
    /// Estimates the tone of a photograph from points of a face.
    pub fn of(texture: &Texture, places: &[Point2<f64>]) -> Self {
        let colours: Vec<[f32; 3]> = places.iter().map(|at| texture.sample(*at)).collect();
        let (mut normal, mut right) = (Matrix2::identity() * 1e-6, [Vector2::zeros(); 3]);
        for colour in &colours {
            let row = Vector2::new(1.0, f64::from(luma(*colour)));
            normal += row * row.transpose();
            (0..3).for_each(|c| right[c] += row * f64::from(colour[c]));
        }
        let inverse = normal.try_inverse().unwrap_or_else(Matrix2::zeros);
        let lines = right.map(|sum| (inverse * sum).map(|v| v as f32).into());
        let tone = Self { lines, share: 1.0 };
        let off = colours.iter().map(|&c| {
            let toned = tone.apply(c);
            (0..3).map(|k| f64::from(toned[k] - c[k]).powi(2)).sum::<f64>()
        });
        let count = colours.len().max(1) as f64;
        let bright = colours.iter().map(|&c| f64::from(luma(c))).sum::<f64>() / count;
        let off = (off.sum::<f64>() / (3.0 * count)).sqrt() / bright.max(1.0);
        Self { share: 1.0 - smooth_step(OFF_TONE.0, OFF_TONE.1, off) as f32, ..tone }
    }

    /// Converts a colour to the photograph's tone, by `share`.
    pub fn apply(&self, colour: [f32; 3]) -> [f32; 3] {
        let level = luma(colour);
        std::array::from_fn(|c| {
            let [from, rise] = self.lines[c];
            colour[c] + (from + rise * level - colour[c]) * self.share
        })
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    fn of(colour: impl Fn(u32, u32) -> [u8; 3]) -> Tone {
        let texture = Texture::new(&RgbImage::from_fn(20, 20, |x, y| Rgb(colour(x, y))));
        let places: Vec<Point2<f64>> = (0..400).map(|k| Point2::new(f64::from(k % 20), f64::from(k / 20))).collect();
        Tone::of(&texture, &places)
    }

    #[test]
    fn the_cast_of_a_light_goes_and_what_skins_differ_by_stays() {
        let skin = [[200.0, 150.0, 130.0], [180.0, 135.0, 117.0], [220.0, 165.0, 143.0]];
        // Half as bright, in the same light.
        let dark = skin.map(|colour| colour.map(|level| level / 2.0));
        assert!(cast(&skin, &dark).iter().all(|factor| (factor - 1.0).abs() < 1e-6));
        // A tenth redder: different skin.
        let redder = skin.map(|[r, g, b]| [1.1 * r, g, b]);
        assert_eq!(cast(&redder, &skin), [1.0; 3]);
        // Light without three quarters of its blue.
        let orange = skin.map(|[r, g, b]| [r, g, b / 4.0]);
        let [r, g, b] = cast(&orange, &skin);
        // Logarithms of -0.152 twice and 1.234 (their mean by brightness is 0), a length of 1.253, of which 0.20 is left.
        let expected = [-0.1525, -0.1525, 1.2338].map(|log: f32| (log * (1.0 - 0.20 / 1.2525)).exp());
        assert!(
            (r - expected[0]).abs() < 2e-3 && (g - expected[1]).abs() < 2e-3 && (b - expected[2]).abs() < 5e-3,
            "{r} {g} {b}"
        );
        assert_eq!(cast(&[], &[]), [1.0; 3]);
    }

    #[test]
    fn a_grey_photograph_makes_everything_grey() {
        let tone = of(|x, y| [(40 + 8 * x + 2 * y) as u8; 3]);
        assert!(tone.share > 0.999);
        let [r, g, b] = tone.apply([150.0, 60.0, 50.0]);
        assert!((r - g).abs() < 0.1 && (g - b).abs() < 0.1 && (r - luma([150.0, 60.0, 50.0])).abs() < 0.1, "{r} {g} {b}");
    }

    #[test]
    fn a_toned_one_keeps_its_tone_and_a_coloured_one_its_colours() {
        let sepia = of(|x, y| [1.0, 0.8, 0.6].map(|share| (share * f64::from(40 + 8 * x + 2 * y)) as u8));
        let [r, g, b] = sepia.apply([150.0, 60.0, 50.0]);
        assert!(sepia.share > 0.99 && (g / r - 0.8).abs() < 0.02 && (b / r - 0.6).abs() < 0.02, "{r} {g} {b}");
        let colour = of(|x, y| [200, (90 + 5 * x) as u8, (60 + 6 * y) as u8]);
        assert_eq!((colour.share, colour.apply([150.0, 60.0, 50.0])), (0.0, [150.0, 60.0, 50.0]));
    }
}
