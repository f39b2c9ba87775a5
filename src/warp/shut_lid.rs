//! The shade and the grain of a lid that shuts, where the eye was.
//!
//! What little skin an open eye shows above it is drawn out over all of the eye when it shuts, and has no form and no grain then. A lid lies on a
//! ball: it is brightest a little above its middle, and darker towards its margin and both corners. Its grain is that of the skin below the eye,
//! pixel for pixel, as little drawn out as that. The page of `play` does the same where it has WebGL (`player/assets/gl.js`): who changes one changes
//! the other.

use image::RgbImage;
use nalgebra::{Point2, Vector2};

use super::{Texture, Warp, lashes::BareLid, mouth::luma, raster, sample};
use crate::interpolation::smooth_step;

/// Shares of the way from where the lid's margin was to where it is at which it begins, has wholly begun, begins to end and has ended.
pub const ZONE: [f64; 4] = [-0.3, 0.1, 1.0, 1.1];
/// The same beside both corners, over the width of the eye.
pub const SIDES: f64 = 0.12;
/// Least way, over the eye distance, that counts.
pub const LEAST_WAY: f64 = 0.02;
/// Share of that way at which a lid is brightest, and how much darker it is at its margin, and at its corners.
pub const BRIGHTEST: f64 = 0.35;
pub const DARKER: [f64; 2] = [0.16, 0.10];
/// How far below its grain is taken from, over the eye distance; from how far around the mean, px; how much of it, and the most.
pub const BELOW: f64 = 0.45;
pub const AROUND: f64 = 1.6;
pub const GRAIN: f64 = 0.9;
pub const MOST: f64 = 0.06;

impl BareLid<'_> {
    /// Shades the lid where the eye was.
    pub fn draw_shade(&self, warp: &Warp, texture: &Texture, vertices: &[Point2<f64>], frame: &mut RgbImage) {
        if self.shut <= 0.0 {
            return;
        }
        let size = frame.dimensions();
        let back = self.head.inverse();
        let below = warp.frame.down.into_inner() * (BELOW * warp.frame.eye_distance);
        let columns: Vec<[(Point2<f64>, Point2<f64>); 2]> = self
            .opening
            .upper
            .iter()
            .map(|&v| self.column(&back.apply(&vertices[v as usize]), warp.frame.eye_distance))
            .collect();
        for pair in columns.windows(2) {
            let corners = [pair[0][0], pair[1][0], pair[1][1], pair[0][1]];
            for triangle in [[0, 1, 2], [0, 2, 3]] {
                let (to, values) = (triangle.map(|c: usize| corners[c].0), triangle.map(|c| corners[c].1));
                raster::fill(to, values, size, |x, y, value| {
                    let share = share(value.x, value.y) * self.shut;
                    if share <= 0.0 {
                        return;
                    }
                    let grain = grain(back.apply(&Point2::new(f64::from(x), f64::from(y))) + below, texture);
                    let factor = (1.0 + share * (shade(value.x, value.y) * (1.0 + grain) - 1.0)) as f32;
                    frame.get_pixel_mut(x, y).0.iter_mut().for_each(|level| *level = sample::byte(f32::from(*level) * factor));
                });
            }
        }
    }

    /// The upper and the lower end of the zone at a point of the margin, given where it would be if the head had not moved: where they are, and how far
    /// along the lid and on the margin's way.
    fn column(&self, margin: &Point2<f64>, eye_distance: f64) -> [(Point2<f64>, Point2<f64>); 2] {
        let (along, lower) = self.skin.place(margin);
        let upper = self.skin.edge_at(along);
        let way = (upper - lower).max(LEAST_WAY * eye_distance);
        [ZONE[0], ZONE[3]].map(|t| (self.head.apply(&self.skin.at(along, upper - t * way)), Point2::new(along, t)))
    }
}

/// How far a lid is shaded at a place along it and on its margin's way.
fn share(along: f64, t: f64) -> f64 {
    let ends = smooth_step(0.0, SIDES, along) * (1.0 - smooth_step(1.0 - SIDES, 1.0, along));
    ends * smooth_step(ZONE[0], ZONE[1], t) * (1.0 - smooth_step(ZONE[2], ZONE[3], t))
}

/// How bright it is there.
fn shade(along: f64, t: f64) -> f64 {
    let (down, beside) = ((t - BRIGHTEST) / (1.0 - BRIGHTEST), 2.0 * along - 1.0);
    1.0 - DARKER[0] * down * down - DARKER[1] * beside * beside
}

/// By how much the photograph is brighter at a place than around it, as a share.
fn grain(at: Point2<f64>, texture: &Texture) -> f64 {
    let level = |off: Vector2<f64>| f64::from(luma(texture.sample(at + off)));
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let around = [(1.0, 0.0), (diagonal, diagonal), (0.0, 1.0), (-diagonal, diagonal)];
    let mean =
        around.iter().map(|&(x, y)| level(Vector2::new(x, y) * AROUND) + level(Vector2::new(-x, -y) * AROUND)).sum::<f64>() / 8.0;
    (GRAIN * (level(Vector2::zeros()) - mean) / mean.max(8.0)).clamp(-MOST, MOST)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_lid_is_brightest_above_its_middle_and_shaded_where_the_eye_was_only() {
        assert_eq!(shade(0.5, BRIGHTEST), 1.0);
        assert!((shade(0.5, 1.0) - 0.84).abs() < 1e-12 && (shade(0.0, BRIGHTEST) - 0.9).abs() < 1e-12);
        assert_eq!(
            [share(0.5, 0.5), share(0.0, 0.5), share(1.0, 0.5), share(0.5, -0.3), share(0.5, 1.1)],
            [1.0, 0.0, 0.0, 0.0, 0.0]
        );
    }

    #[test]
    fn even_skin_has_no_grain_and_a_speck_as_much_as_it_is_darker() {
        let mut picture = image::RgbImage::from_pixel(9, 9, Rgb([100; 3]));
        assert!(grain(Point2::new(4.0, 4.0), &Texture::new(&picture)).abs() < 1e-6);
        // 4 of 100 levels darker, by itself; what lies around is read between pixels, beyond it.
        picture.put_pixel(4, 4, Rgb([96; 3]));
        assert!((grain(Point2::new(4.0, 4.0), &Texture::new(&picture)) + 0.04 * GRAIN).abs() < 1e-3);
        picture.put_pixel(4, 4, Rgb([0; 3]));
        assert_eq!(grain(Point2::new(4.0, 4.0), &Texture::new(&picture)), -MOST);
    }
}
