//! Paints a shut lid where the eye was.
//!
//! Stretching the little skin that an open eye shows above it over the whole eye gives no form and no grain, enlarges stripes and wedges, and
//! keeps the shade of the brow or a shining hue. A shut lid comes forward into the light. So it is painted: in one colour
//! between its own and the cheek's; shaded as a ball, brightest a little above its middle and darker towards its margin and both corners; and
//! with the grain of the skin below the eye, copied pixel by pixel so that it is not stretched. The page of `play` does the same
//! (`player/assets/rig.js`, `gl.js`, and without grain `flat.js`): change all together.

use image::RgbImage;
use nalgebra::{Point2, Vector2};

use super::{Texture, Warp, lashes::BareLid, lid_skin::mean, mouth::luma, raster, sample};
use crate::interpolation::smooth_step;

/// Fade of the painted zone, as fractions of the margin's way from its old to its new position: begins, full, begins to end, ended.
pub const ZONE: [f64; 4] = [-1.0, 0.5, 1.0, 1.1];
/// Width of the fade beside both corners, over the width of the eye.
pub const SIDES: f64 = 0.12;
/// Shortest way of the margin, in eye distances, with full effect: a shorter way is painted less, and none not at all.
pub const LEAST_WAY: f64 = 0.02;
/// Fraction of that way at which a lid is brightest, and (`DARKER`) its darkening at its margin and at its corners.
pub const BRIGHTEST: f64 = 0.35;
pub const DARKER: [f64; 2] = [0.16, 0.10];
/// Source of the grain: distance below, in eye distances; radius of the surrounding mean, px (`AROUND`); strength and limit.
pub const BELOW: f64 = 0.45;
pub const AROUND: f64 = 1.6;
pub const GRAIN: f64 = 0.9;
pub const MOST: f64 = 0.06;

/// Lower limit of the mean level that grain is divided by, for dark areas.
pub const DARK: f64 = 8.0;

/// Samples of the cheek: below the lower lid, and to either side, in eye distances.
const CHEEK: [f64; 3] = [0.30, 0.36, 0.42];
const CHEEK_ASIDE: [f64; 3] = [-0.08, 0.0, 0.08];
/// Fraction of the cheek's hue that a lid gets, its target brightness relative to the cheek, and the fraction of the way a darker lid is
/// lifted to it.
const CHEEK_HUE: f32 = 0.65;
const AS_BRIGHT: f32 = 0.92;
const LIFTED: f32 = 0.7;

/// Colour of the cheek below the middle of a lower lid, levels; `None` if nothing was sampled.
pub(super) fn cheek(warp: &Warp, lower: &Point2<f64>, texture: &Texture) -> Option<[f32; 3]> {
    let (unit, down, across) = (warp.frame.eye_distance, warp.frame.down.into_inner(), warp.frame.across());
    mean(&CHEEK.map(|below| CHEEK_ASIDE.map(|aside| texture.sample(lower + (down * below + across * aside) * unit))).concat())
}

/// Colour of a shut lid, levels, from its skin on the open eye and the cheek.
pub(super) fn shut_colour(skin: [f32; 3], cheek: [f32; 3]) -> [f32; 3] {
    let hue = |colour: [f32; 3]| colour.map(|channel| channel / luma(colour).max(1.0));
    let (own, other) = (hue(skin), hue(cheek));
    let level = luma(skin) + LIFTED * (AS_BRIGHT * luma(cheek) - luma(skin)).max(0.0);
    std::array::from_fn(|c| (level * (own[c] + CHEEK_HUE * (other[c] - own[c]))).min(255.0))
}

impl BareLid<'_> {
    /// Paints the lid where the eye was.
    pub fn draw_shut(&self, warp: &Warp, texture: &Texture, vertices: &[Point2<f64>], frame: &mut RgbImage) {
        if self.shut <= 0.0 {
            return;
        }
        let size = frame.dimensions();
        let back = self.head.inverse();
        let below = warp.frame.down.into_inner() * (BELOW * warp.frame.eye_distance);
        let least = LEAST_WAY * warp.frame.eye_distance;
        let margin: Vec<Margin> =
            self.opening.upper.iter().map(|&v| self.margin_at(&back.apply(&vertices[v as usize]))).collect();
        let farthest = margin.iter().map(|margin| margin.was - margin.is).fold(0.0, f64::max);
        let shut = self.shut * smooth_step(0.0, least, farthest);
        let columns: Vec<[(Point2<f64>, Point2<f64>); 2]> = margin.iter().map(|margin| self.column(margin, least)).collect();
        for pair in columns.windows(2) {
            let corners = [pair[0][0], pair[1][0], pair[1][1], pair[0][1]];
            raster::fill_quadrangle(corners.map(|c| c.0), corners.map(|c| c.1), size, |x, y, value| {
                let share = share(value.x, value.y) * shut;
                if share <= 0.0 {
                    return;
                }
                let grain = grain(back.apply(&Point2::new(f64::from(x), f64::from(y))) + below, texture);
                let form = (shade(value.x, value.y) * (1.0 + grain)) as f32;
                sample::lay(frame.get_pixel_mut(x, y), self.skin.shut.map(|level| form * level), share as f32);
            });
        }
    }

    /// The old and the new position of a point of the margin, which is given without the head's motion.
    fn margin_at(&self, at: &Point2<f64>) -> Margin {
        let (along, is) = self.skin.place(at);
        Margin { along, was: self.skin.edge_at(along), is }
    }

    /// Upper and lower end of the painted zone at a point of the margin: their positions in the frame, and their coordinates (along the lid, along
    /// the margin's way). The way is taken as `least` px or more.
    fn column(&self, &Margin { along, was, is }: &Margin, least: f64) -> [(Point2<f64>, Point2<f64>); 2] {
        let way = (was - is).max(least);
        [ZONE[0], ZONE[3]].map(|t| (self.head.apply(&self.skin.at(along, was - t * way)), Point2::new(along, t)))
    }
}

/// A point of a lid's margin: its position along the lid, and its old and new height above the line between the corners, px.
struct Margin {
    along: f64,
    was: f64,
    is: f64,
}

/// Opacity of the paint at a position along the lid and on its margin's way.
fn share(along: f64, t: f64) -> f64 {
    let ends = smooth_step(0.0, SIDES, along) * (1.0 - smooth_step(1.0 - SIDES, 1.0, along));
    ends * smooth_step(ZONE[0], ZONE[1], t) * (1.0 - smooth_step(ZONE[2], ZONE[3], t))
}

/// Brightness of the paint there.
fn shade(along: f64, t: f64) -> f64 {
    let (down, beside) = ((t - BRIGHTEST) / (1.0 - BRIGHTEST), 2.0 * along - 1.0);
    1.0 - DARKER[0] * down * down - DARKER[1] * beside * beside
}

/// Relative difference of the photograph's brightness at a point from that around it.
fn grain(at: Point2<f64>, texture: &Texture) -> f64 {
    let level = |off: Vector2<f64>| f64::from(luma(texture.sample(at + off)));
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let around = [(1.0, 0.0), (diagonal, diagonal), (0.0, 1.0), (-diagonal, diagonal)];
    let mean =
        around.iter().map(|&(x, y)| level(Vector2::new(x, y) * AROUND) + level(Vector2::new(-x, -y) * AROUND)).sum::<f64>() / 8.0;
    (GRAIN * (level(Vector2::zeros()) - mean) / mean.max(DARK)).clamp(-MOST, MOST)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_lid_is_brightest_above_its_middle_and_painted_where_the_eye_was_only() {
        assert_eq!(shade(0.5, BRIGHTEST), 1.0);
        assert!((shade(0.5, 1.0) - 0.84).abs() < 1e-12 && (shade(0.0, BRIGHTEST) - 0.9).abs() < 1e-12);
        assert_eq!(
            [share(0.5, 0.5), share(0.0, 0.5), share(1.0, 0.5), share(0.5, -1.0), share(0.5, 1.1)],
            [1.0, 0.0, 0.0, 0.0, 0.0]
        );
    }

    #[test]
    fn a_lid_in_the_shade_comes_into_the_light_of_the_cheek_and_one_that_shines_takes_its_hue() {
        // With equal hues: 0.7 of the way from 100 to 0.92 of 200 levels.
        shut_colour([100.0; 3], [200.0; 3]).iter().for_each(|level| assert!((level - 158.8).abs() < 1e-2, "{level}"));
        // With equal brightness (0.3 x 120 + 0.59 x 95 + 0.11 x 72.3 levels are 100): two thirds of the way to its hue.
        let [red, green, blue] = shut_colour([100.0; 3], [120.0, 95.0, 72.3]);
        assert!((red - 113.0).abs() < 0.1 && (green - 96.8).abs() < 0.1 && (blue - 82.0).abs() < 0.1, "{red} {green} {blue}");
        assert!(shut_colour([0.0; 3], [255.0; 3]).iter().all(|level| (0.0..=255.0).contains(level)));
    }

    #[test]
    fn even_skin_has_no_grain_and_a_speck_as_much_as_it_is_darker() {
        let mut picture = image::RgbImage::from_pixel(9, 9, Rgb([100; 3]));
        assert!(grain(Point2::new(4.0, 4.0), &Texture::new(&picture)).abs() < 1e-6);
        // 4 of 100 levels darker on its own; the surroundings are sampled between pixels, beyond it.
        picture.put_pixel(4, 4, Rgb([96; 3]));
        assert!((grain(Point2::new(4.0, 4.0), &Texture::new(&picture)) + 0.04 * GRAIN).abs() < 1e-3);
        picture.put_pixel(4, 4, Rgb([0; 3]));
        assert_eq!(grain(Point2::new(4.0, 4.0), &Texture::new(&picture)), -MOST);
    }
}
