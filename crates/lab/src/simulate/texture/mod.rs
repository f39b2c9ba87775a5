//! The texture of a subject: skin, features, hair, neck and clothes, painted once on the neutral frontal plane.
//!
//! The texture is attached to the surface and moves with the nodes. Eyeballs and the inside of the mouth are drawn separately in every
//! frame, through the openings between lids and lips.

mod face;
mod features;
mod hair;
mod sheet;
mod skin;
mod torso;
mod wrinkles;

use nalgebra::{Point2, Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub use face::brightness;
use sheet::{Mask, P, Sheet};

use wrinkles::Wrinkle;

use super::subject::{Appearance, Colour, Sex};

/// Painted region of the plane (model units): left, right, bottom, top.
const REGION: (f32, f32, f32, f32) = (-1.75, 1.75, -2.0, 1.6);

/// A painted plane in premultiplied RGBA; background is transparent.
#[derive(Clone, Debug)]
pub struct Texture {
    sheet: Sheet,
    texels: Vec<[u8; 4]>,
    wrinkles: Vec<Wrinkle>,
}

impl Texture {
    /// Returns the texture with the folds caused by a motion of the nodes (offsets from neutral, model units).
    pub fn folded(&self, offsets: &[Vector3<f64>]) -> Self {
        let mut texels = self.texels.clone();
        for wrinkle in &self.wrinkles {
            let depth = wrinkle.depth(offsets);
            if depth > 0.0 {
                wrinkle.shade(&mut texels, depth);
            }
        }
        Self { sheet: self.sheet, texels, wrinkles: Vec::new() }
    }

    /// Returns the colour at a plane point: bilinear, premultiplied, components 0 to 255. Outside the painted region the border is
    /// repeated.
    pub fn sample(&self, x: f32, y: f32) -> [f32; 4] {
        let Sheet { width, height, scale, left, top } = self.sheet;
        let (fx, fy) = ((x - left) * scale - 0.5, (top - y) * scale - 0.5);
        let fx = fx.clamp(0.0, (width - 1) as f32 - 1e-3);
        let fy = fy.clamp(0.0, (height - 1) as f32 - 1e-3);
        let (i, j) = (fx as usize, fy as usize);
        let (u, v) = (fx - i as f32, fy - j as f32);
        let k = j * width + i;
        let (a, b, c, d) = (self.texels[k], self.texels[k + 1], self.texels[k + width], self.texels[k + width + 1]);
        // The values are listed one by one, because array functions are slow in development builds.
        let channel = |n: usize| {
            let upper = f32::from(a[n]) + (f32::from(b[n]) - f32::from(a[n])) * u;
            let lower = f32::from(c[n]) + (f32::from(d[n]) - f32::from(c[n])) * u;
            upper + (lower - upper) * v
        };
        [channel(0), channel(1), channel(2), channel(3)]
    }

    /// Returns an opaque texture whose colour is a function of the position on the plane.
    #[cfg(test)]
    pub fn repainted(&self, colour: impl Fn(f32, f32) -> [u8; 3]) -> Self {
        let sheet = self.sheet;
        let texels = (0..sheet.width * sheet.height)
            .map(|k| {
                let p = sheet.at(k % sheet.width, k / sheet.width);
                let [r, g, b] = colour(p.x, p.y);
                [r, g, b, 255]
            })
            .collect();
        Self { sheet, texels, wrinkles: Vec::new() }
    }
}

/// Paints the texture of a subject from the neutral frontal nodes (model units, y up).
pub fn paint(nodes: &[Point2<f64>], sex: Sex, look: &Appearance, texels_per_unit: f32) -> Texture {
    let (left, right, bottom, top) = REGION;
    let size = |length: f32| ((length * texels_per_unit).ceil() as usize).max(2);
    let sheet = Sheet { width: size(right - left), height: size(top - bottom), scale: texels_per_unit, left, top };
    let mut painter = Painter {
        sheet,
        nodes,
        sex,
        look,
        rgb: vec![[0.0; 3]; sheet.width * sheet.height],
        alpha: vec![0.0; sheet.width * sheet.height],
        random: rand::SeedableRng::seed_from_u64(look.noise.into()),
    };
    painter.hair_behind();
    painter.neck();
    painter.clothes();
    painter.ears();
    painter.face();
    painter.features();
    painter.hair_in_front();
    let wrinkles = painter.wrinkles();
    painter.finish(wrinkles)
}

/// The picture during painting.
struct Painter<'a> {
    sheet: Sheet,
    nodes: &'a [Point2<f64>],
    sex: Sex,
    look: &'a Appearance,
    rgb: Vec<Colour>,
    alpha: Vec<f32>,
    random: ChaCha8Rng,
}

impl Painter<'_> {
    /// Returns a node of the subject on the plane.
    fn p(&self, node: usize) -> P {
        let p = self.nodes[node];
        P::new(p.x as f32, p.y as f32)
    }

    /// Returns nodes on the plane.
    fn points<const K: usize>(&self, nodes: [usize; K]) -> [P; K] {
        nodes.map(|n| self.p(n))
    }

    fn uniform(&mut self, low: f32, high: f32) -> f32 {
        self.random.random_range(low..high)
    }

    /// Blends a colour over the picture through a mask.
    fn blend(&mut self, mask: &Mask, opacity: f32, mut colour: impl FnMut(P) -> Colour) {
        for (index, coverage) in mask.texels(&self.sheet) {
            let place = self.sheet.at(index % self.sheet.width, index / self.sheet.width);
            self.lay(index, coverage * opacity, colour(place));
        }
    }

    fn lay(&mut self, index: usize, coverage: f32, colour: Colour) {
        let (under, alpha) = (self.rgb[index], self.alpha[index]);
        let total = coverage + alpha * (1.0 - coverage);
        if total > 0.0 {
            let share = coverage / total;
            self.rgb[index] = std::array::from_fn(|n| under[n] + (colour[n] - under[n]) * share);
            self.alpha[index] = total;
        }
    }

    /// Multiplies the picture by `factor` at full coverage of the mask, and by less at partial coverage.
    fn tint(&mut self, mask: &Mask, factor: Colour) {
        for (index, coverage) in mask.texels(&self.sheet) {
            let under = self.rgb[index];
            self.rgb[index] = std::array::from_fn(|n| under[n] * (1.0 + (factor[n] - 1.0) * coverage));
        }
    }

    /// Draws strokes with tiny-skia, blended over the picture where `clip` covers it.
    fn hairs(&mut self, strokes: &[Hair], clip: Option<&[f32]>) {
        let Some(mut layer) = tiny_skia::Pixmap::new(self.sheet.width as u32, self.sheet.height as u32) else { return };
        for hair in strokes {
            let Some(path) = sheet::path(&self.sheet, &hair.line, false) else { continue };
            let mut paint = tiny_skia::Paint { anti_alias: true, ..Default::default() };
            let [r, g, b] = hair.colour.map(|c| c.clamp(0.0, 1.0));
            if let Some(colour) = tiny_skia::Color::from_rgba(r, g, b, hair.opacity.clamp(0.0, 1.0)) {
                paint.set_color(colour);
            }
            let width = hair.width * self.sheet.scale;
            let stroke = tiny_skia::Stroke { width, line_cap: tiny_skia::LineCap::Round, ..Default::default() };
            layer.stroke_path(&path, &paint, &stroke, tiny_skia::Transform::identity(), None);
        }
        for (index, pixel) in layer.pixels().iter().enumerate().filter(|(_, p)| p.alpha() > 0) {
            let straight = pixel.demultiply();
            let colour = [straight.red(), straight.green(), straight.blue()].map(|c| f32::from(c) / 255.0);
            let clip = clip.map_or(1.0, |c| c[index]);
            self.lay(index, f32::from(pixel.alpha()) / 255.0 * clip, colour);
        }
    }

    fn finish(self, wrinkles: Vec<Wrinkle>) -> Texture {
        let texels = self.rgb.iter().zip(&self.alpha).map(|(rgb, &alpha)| {
            let byte = |c: f32| (c.clamp(0.0, 1.0) * alpha * 255.0).round() as u8;
            [byte(rgb[0]), byte(rgb[1]), byte(rgb[2]), (alpha * 255.0).round() as u8]
        });
        Texture { sheet: self.sheet, texels: texels.collect(), wrinkles }
    }
}

/// A hair to draw.
struct Hair {
    line: Vec<P>,
    width: f32,
    colour: Colour,
    opacity: f32,
}

/// Multiplies a colour by a number.
fn scaled(colour: Colour, factor: f32) -> Colour {
    colour.map(|c| c * factor)
}

/// Returns a skin colour under light of strength `shade` (1 for a surface that faces the viewer); shadows are warm.
fn lit_skin(colour: Colour, shade: f32) -> Colour {
    let shade = shade.max(0.02);
    [colour[0] * shade.powf(0.89), colour[1] * shade, colour[2] * shade.powf(1.06)]
}

/// Returns the mirror image of a point on the other side of the face.
fn mirrored(p: P) -> P {
    P::new(-p.x, p.y)
}

/// Returns the point at share `t` between two points.
fn between(a: P, b: P, t: f32) -> P {
    a + (b - a) * t
}

/// A vector of the plane.
type V = Vector2<f32>;

#[cfg(test)]
mod tests {
    use super::super::{Emotion, SimulateOptions, SimulatedSequence, Subject};

    #[test]
    fn folds_come_with_the_expression_and_keep_the_outline() {
        let options = SimulateOptions { width: 160, height: 120, frames: 2, ..SimulateOptions::default() };
        let subject = Subject::new(&options, 0).unwrap();
        let plain = &subject.texture;
        for emotion in Emotion::ALL {
            let sequence = SimulatedSequence::new(&subject, emotion, &options).unwrap();
            assert!(plain.folded(&sequence.offsets(0.0)).texels == plain.texels, "{emotion}: a neutral face has no folds");
            let folded = plain.folded(&sequence.offsets(1.0)).texels;
            assert!(folded != plain.texels, "{emotion} leaves no fold");
            assert!(folded.iter().zip(&plain.texels).all(|(a, b)| a[3] == b[3] && a[..3].iter().all(|&c| c <= a[3])));
        }
    }

    #[test]
    fn a_texture_is_opaque_on_the_face_and_clear_beside_the_head() {
        let options = SimulateOptions { width: 160, height: 120, ..SimulateOptions::default() };
        for index in 0..4 {
            let subject = Subject::new(&options, index).unwrap();
            for node in subject.neutral() {
                // A node of the contour lies on the outline itself, where coverage is one half.
                let alpha_at = |share: f64| subject.texture.sample((node.x * share) as f32, (node.y * share) as f32)[3];
                assert!(alpha_at(1.0) > 100.0, "{node}: {}", alpha_at(1.0));
                assert!(alpha_at(0.96) > 254.0, "inside {node}: {}", alpha_at(0.96));
            }
            assert!(subject.texture.sample(1.4, 1.0)[3] < 1.0);
        }
    }
}
