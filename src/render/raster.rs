//! Rasterization of triangles with a depth buffer, interpolated normals and per-sample lighting.

use image::{Rgb, RgbImage};

use crate::mesh::{add, colour::srgb, dot, normalized};

/// Samples along each side of a pixel.
const SAMPLES: u32 = 2;

/// A corner of a triangle on the canvas.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// Position in px (x right, y down) and depth (larger is nearer).
    pub at: [f32; 3],
    /// Unit normal in the camera's axes, z towards the viewer.
    pub normal: [f32; 3],
    /// Position in the model, for colours that depend on it; for [`Shade::Painted`] the colour (linear RGB).
    pub model: [f32; 3],
}

/// Appearance of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shade {
    /// Skin.
    Skin,
    /// An eyeball that looks along z: white, iris and pupil around its front.
    Eye {
        /// Centre in the model.
        centre: [f32; 3],
        /// Radius of the iris in the model.
        iris: f32,
    },
    /// The interpolated colour of the corners, dull like skin or wet like eyes and teeth.
    Painted {
        /// Whether it is wet.
        wet: bool,
    },
    /// The dark inside of an opening.
    Cavity,
    /// A mark of one colour without lighting (linear RGB).
    Flat([f32; 3]),
}

/// A picture under construction.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: u32,
    height: u32,
    colours: Vec<[f32; 3]>,
    depths: Vec<f32>,
}

impl Canvas {
    /// Creates an empty canvas of a size in px; the background darkens a little downwards.
    pub fn new(width: u32, height: u32) -> Self {
        let (w, h) = (width * SAMPLES, height * SAMPLES);
        let row = |y: u32| {
            let share = y as f32 / h.max(1) as f32;
            [0.86 - 0.16 * share, 0.88 - 0.16 * share, 0.91 - 0.16 * share]
        };
        let colours = (0..h).flat_map(|y| std::iter::repeat_n(row(y), w as usize)).collect();
        Self { width: w, height: h, colours, depths: vec![f32::NEG_INFINITY; (w * h) as usize] }
    }

    /// Draws a triangle. Both sides are visible, and the back is lit like the front.
    pub fn triangle(&mut self, corners: [Vertex; 3], shade: Shade) {
        let place = corners.map(|c| [c.at[0] * SAMPLES as f32, c.at[1] * SAMPLES as f32, c.at[2]]);
        let [a, b, c] = place;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let span = |k: usize, limit: u32| {
            let (low, high) = place.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), p| (l.min(p[k]), h.max(p[k])));
            ((low - 0.5).ceil().max(0.0) as u32, ((high - 0.5).floor() + 1.0).clamp(0.0, limit as f32) as u32)
        };
        let ((left, right), (top, bottom)) = (span(0, self.width), span(1, self.height));
        let per_area = 1.0 / area;
        for y in top..bottom {
            for x in left..right {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let edge = |p: [f32; 3], q: [f32; 3]| ((q[0] - p[0]) * (py - p[1]) - (q[1] - p[1]) * (px - p[0])) * per_area;
                let shares = [edge(b, c), edge(c, a), edge(a, b)];
                if shares.iter().any(|&s| s < 0.0) {
                    continue;
                }
                let depth = shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2];
                let index = (y * self.width + x) as usize;
                if depth > self.depths[index] {
                    self.depths[index] = depth;
                    let mix = |pick: fn(&Vertex) -> [f32; 3]| {
                        let weighted = corners.iter().zip(shares).map(|(v, s)| pick(v).map(|c| c * s));
                        weighted.fold([0.0; 3], add)
                    };
                    self.colours[index] = colour(shade, mix(|v| v.normal), mix(|v| v.model));
                }
            }
        }
    }

    /// Returns the picture: samples averaged in linear light, then converted to sRGB.
    pub fn picture(&self) -> RgbImage {
        let count = (SAMPLES * SAMPLES) as f32;
        RgbImage::from_fn(self.width / SAMPLES, self.height / SAMPLES, |x, y| {
            let mut sum = [0.0; 3];
            for sample in 0..SAMPLES * SAMPLES {
                let (sx, sy) = (x * SAMPLES + sample % SAMPLES, y * SAMPLES + sample / SAMPLES);
                sum = add(sum, self.colours[(sy * self.width + sx) as usize]);
            }
            Rgb(sum.map(|c| (srgb(c / count) * 255.0).round() as u8))
        })
    }
}

/// Lights: direction towards the light in the camera's axes, and strength.
const KEY: ([f32; 3], f32) = ([-0.48, 0.56, 0.68], 0.84);
const FILL: ([f32; 3], f32) = ([0.75, 0.05, 0.66], 0.22);
/// Ambient light from above and from below.
const SKY: f32 = 0.24;
const GROUND: f32 = 0.10;

fn colour(shade: Shade, normal: [f32; 3], model: [f32; 3]) -> [f32; 3] {
    let normal = normalized(normal).unwrap_or([0.0, 0.0, 1.0]);
    // The back of a surface is lit like its front.
    let normal = if normal[2] < 0.0 { normal.map(|c| -c) } else { normal };
    let (albedo, gloss) = match shade {
        Shade::Flat(colour) => return colour,
        Shade::Skin => ([0.80, 0.55, 0.43], 0.10),
        Shade::Eye { centre, iris } => (eye(centre, iris, model), 0.55),
        // Dark areas lie deep inside, where no light is reflected.
        Shade::Painted { wet: false } => (model, 0.07 * (2.0 * model[0]).min(1.0)),
        Shade::Painted { wet: true } => (model, 0.45),
        Shade::Cavity => ([0.09, 0.025, 0.022], 0.0),
    };
    let lambert = |light: [f32; 3]| normalized(light).map_or(0.0, |l| dot(l, normal));
    // Light scattered in the skin softens the edge of the shadow.
    let wrap = |x: f32| ((x + 0.25) / 1.25).max(0.0);
    let sky = f32::midpoint(normal[1], 1.0);
    let light = KEY.1 * wrap(lambert(KEY.0)) + FILL.1 * wrap(lambert(FILL.0)) + GROUND + (SKY - GROUND) * sky;
    let half = normalized(add(normalized(KEY.0).unwrap_or_default(), [0.0, 0.0, 1.0])).unwrap_or_default();
    let shine = gloss * dot(half, normal).max(0.0).powi(if gloss > 0.3 { 90 } else { 22 });
    albedo.map(|a| a * light + shine)
}

fn eye(centre: [f32; 3], iris: f32, model: [f32; 3]) -> [f32; 3] {
    let distance = (model[0] - centre[0]).hypot(model[1] - centre[1]) / iris;
    if distance < 0.42 {
        [0.012, 0.012, 0.014]
    } else if distance < 0.92 {
        let share = (distance - 0.42) / 0.5;
        [0.10 + 0.06 * share, 0.17 + 0.05 * share, 0.21 - 0.02 * share]
    } else if distance < 1.0 {
        [0.06, 0.07, 0.08]
    } else {
        [0.80, 0.77, 0.74]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vertex(x: f32, y: f32, z: f32) -> Vertex {
        Vertex { at: [x, y, z], normal: [0.0, 0.0, 1.0], model: [0.0; 3] }
    }

    #[test]
    fn the_nearer_triangle_hides_the_farther_one_in_any_order() {
        let red = [vertex(0.0, 0.0, 1.0), vertex(8.0, 0.0, 1.0), vertex(0.0, 8.0, 1.0)];
        let green = [vertex(0.0, 0.0, 2.0), vertex(8.0, 0.0, 2.0), vertex(0.0, 8.0, 2.0)];
        for turned in [false, true] {
            let mut canvas = Canvas::new(8, 8);
            let mut draw = [(red, [1.0, 0.0, 0.0]), (green, [0.0, 1.0, 0.0])];
            if turned {
                draw.reverse();
            }
            draw.iter().for_each(|&(t, c)| canvas.triangle(t, Shade::Flat(c)));
            let picture = canvas.picture();
            assert_eq!(picture.get_pixel(1, 1).0, [0, 255, 0]);
            // Beyond the long side the background stays.
            assert!(picture.get_pixel(7, 7).0.iter().all(|&c| c > 150));
        }
    }

    #[test]
    fn triangles_off_the_canvas_and_without_area_draw_nothing() {
        let mut canvas = Canvas::new(4, 4);
        let before = canvas.picture();
        canvas.triangle([vertex(-9.0, -9.0, 0.0), vertex(-5.0, -9.0, 0.0), vertex(-9.0, -5.0, 0.0)], Shade::Skin);
        canvas.triangle([vertex(0.0, 0.0, 0.0), vertex(2.0, 2.0, 0.0), vertex(4.0, 4.0, 0.0)], Shade::Skin);
        canvas.triangle([vertex(f32::NAN, 0.0, 0.0), vertex(2.0, 2.0, 0.0), vertex(4.0, 0.0, 0.0)], Shade::Skin);
        assert_eq!(canvas.picture(), before);
    }

    #[test]
    fn neighbours_leave_no_gap_between_them() {
        let mut canvas = Canvas::new(16, 16);
        let (a, b, c, d) = (vertex(1.0, 1.0, 0.0), vertex(15.0, 2.0, 0.0), vertex(14.0, 15.0, 0.0), vertex(2.0, 14.0, 0.0));
        canvas.triangle([a, b, c], Shade::Flat([0.0; 3]));
        canvas.triangle([a, c, d], Shade::Flat([0.0; 3]));
        let picture = canvas.picture();
        assert!((3..13).all(|k| picture.get_pixel(k, k).0 == [0, 0, 0]));
    }
}
