//! Skin without lighting: tone, blotches, pores, freckles and moles.

use super::{
    super::{noise, subject::Colour},
    P, Painter, Sex, V,
};

/// Parameters of the skin's own colour.
pub struct Skin {
    base: Colour,
    darkness: f32,
    seed: u32,
}

impl Skin {
    /// Returns the skin of the painter's subject.
    pub fn of(painter: &Painter) -> Self {
        Self { base: painter.look.skin, darkness: painter.look.darkness, seed: painter.look.noise }
    }

    /// Returns the colour at a position. `blush` adds blood under the skin, `beard` a blue-grey shadow; both range from 0 to about 1.
    pub fn colour(&self, p: P, blush: f32, beard: f32) -> Colour {
        let n = |frequency: f32, octaves: u32, salt: u32| {
            noise::fractal(p.x * frequency + 31.7, p.y * frequency + 17.3, octaves, self.seed.wrapping_add(salt))
        };
        let tone = 1.0 + 0.035 * n(2.3, 3, 1) + 0.035 * n(11.0, 3, 2) + 0.060 * n(34.0, 2, 3) + 0.090 * n(76.0, 2, 4);
        let red = blush * (1.0 - 0.55 * self.darkness) + 0.16 * n(5.0, 3, 5) + 0.14 * n(19.0, 2, 6);
        let [r, g, b] = self.base;
        let warm = [r * (1.0 + 0.035 * red), g * (1.0 - 0.17 * red), b * (1.0 - 0.17 * red)];
        let stubble = beard * (0.80 + 0.40 * n(80.0, 2, 7)).max(0.0);
        let cool = [1.0 - 0.36 * stubble, 1.0 - 0.33 * stubble, 1.0 - 0.30 * stubble];
        std::array::from_fn(|k| warm[k] * tone * cool[k])
    }
}

impl Painter<'_> {
    /// Returns the blush at every texel of the face.
    pub(super) fn blush_field(&mut self) -> Vec<f32> {
        let mut field = vec![0.0; self.rgb.len()];
        let strength = if self.sex == Sex::Female { 1.0 } else { 0.75 };
        for side in [1.0, -1.0] {
            let cheek = P::new(side * 0.36, self.p(27).y - 0.06);
            self.sheet.bump(&mut field, cheek, (0.12, 0.10), 0.4 * side, 0.75 * strength);
            self.sheet.bump(&mut field, P::new(side * 0.11, self.p(26).y), (0.05, 0.05), 0.0, 0.6);
            let eye = P::new(side * self.p(22).x, self.p(22).y - 0.02);
            self.sheet.bump(&mut field, eye, (0.14, 0.05), 0.0, 0.35);
            self.sheet.bump(&mut field, P::new(side * 0.64, 0.02), (0.06, 0.14), 0.0, 0.7);
        }
        self.sheet.bump(&mut field, self.p(5), (0.07, 0.06), 0.0, 0.7);
        self.sheet.bump(&mut field, P::new(0.0, self.p(10).y + 0.1), (0.12, 0.07), 0.0, 0.35);
        self.sheet.bump(&mut field, P::new(0.0, 0.62), (0.3, 0.12), 0.0, -0.3);
        field
    }

    /// Returns the beard shadow at every texel: jaw, chin, upper lip.
    pub(super) fn beard_field(&mut self) -> Vec<f32> {
        let mut field = vec![0.0; self.rgb.len()];
        if self.look.beard > 0.0 {
            let chin = self.p(10);
            let jaw = self.p(30);
            let outline = [
                P::new(0.0, chin.y - 0.06),
                P::new(0.22, chin.y - 0.02),
                P::new(jaw.x + 0.02, jaw.y - 0.03),
                P::new(0.57, -0.2),
                P::new(0.60, 0.08),
                P::new(0.53, 0.06),
                P::new(0.46, -0.24),
                P::new(0.34, -0.40),
                P::new(0.22, self.p(7).y + 0.07),
                P::new(0.05, self.p(7).y + 0.11),
            ];
            let mut closed: Vec<P> = outline.to_vec();
            closed.extend(outline.iter().rev().map(|&p| super::mirrored(p)));
            for (index, coverage) in self.sheet.fill(&closed, 0.035).texels(&self.sheet) {
                field[index] = coverage * self.look.beard;
            }
        }
        field
    }

    /// Paints freckles and moles as small dark dots over the finished skin.
    pub(super) fn spots(&mut self) {
        let count = self.look.freckles;
        let mut field = vec![0.0_f32; self.rgb.len()];
        for k in 0..count {
            // The first few are moles anywhere on the face, the others freckles on nose and cheeks.
            let mole = k < 5;
            let (spread, radius, depth) = if mole {
                (V::new(0.5, 0.75), self.uniform(0.007, 0.013), self.uniform(0.3, 0.55))
            } else {
                (V::new(0.42, 0.24), self.uniform(0.004, 0.008), self.uniform(0.10, 0.26))
            };
            let centre = P::new(self.uniform(-1.0, 1.0) * spread.x, self.uniform(-1.0, 1.0) * spread.y - 0.06);
            self.sheet.bump(&mut field, centre, (radius, radius * 0.9), 0.0, depth);
        }
        for (rgb, spot) in self.rgb.iter_mut().zip(&field).filter(|(_, s)| **s > 1e-3) {
            let factor = [1.0 - 0.55 * spot, 1.0 - 0.85 * spot, 1.0 - 0.95 * spot];
            *rgb = std::array::from_fn(|n| rgb[n] * factor[n].max(0.15));
        }
    }
}
