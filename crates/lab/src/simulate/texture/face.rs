//! Relief and lighting of the face.

use nalgebra::Vector3;

use super::{P, Painter, Sex, lit_skin, sheet::smooth, skin::Skin};

/// Direction towards the light in face axes: from above, and from the left of the picture.
pub const LIGHT: [f32; 3] = [-0.38, 0.46, 0.80];
/// Share of ambient light.
const AMBIENT: f32 = 0.36;

/// Returns the brightness of a surface with the given normal; 1 for one that faces the viewer.
pub fn brightness(normal: Vector3<f32>) -> f32 {
    let light = Vector3::from(LIGHT).normalize();
    let half_lambert = |cosine: f32| (0.30 + 0.70 * cosine).max(0.0);
    let flat = AMBIENT + (1.0 - AMBIENT) * half_lambert(light.z);
    (AMBIENT * (0.72 + 0.28 * normal.z) + (1.0 - AMBIENT) * half_lambert(normal.dot(&light))) / flat
}

impl Painter<'_> {
    /// Returns the outline of the face: the outer border of the wireframe, smoothed.
    pub(super) fn face_outline(&self) -> Vec<P> {
        let border = self.points([10, 32, 30, 28, 29, 14, 12, 11, 0, 44, 45, 47, 62, 61, 63, 65]);
        smooth(&border, true, 10)
    }

    /// Paints lit skin within the outline of the face.
    pub(super) fn face(&mut self) {
        let mask = self.sheet.fill(&self.face_outline(), 0.006);
        let relief = self.relief();
        let shadow = self.shadow_field();
        let blush = self.blush_field();
        let beard = self.beard_field();
        let skin = Skin::of(self);
        let (width, scale) = (self.sheet.width, self.sheet.scale);
        let gloss = 0.10 + 0.05 * self.look.darkness;
        let light = Vector3::from(LIGHT).normalize();
        let halfway = (light + Vector3::z()).normalize();
        for (index, coverage) in mask.texels(&self.sheet) {
            let p = self.sheet.at(index % width, index / width);
            let slope = |step: usize| {
                let (ahead, behind) = (relief.get(index + step), index.checked_sub(step).map(|k| relief[k]));
                match (ahead, behind) {
                    (Some(a), Some(b)) => (a - b) * scale / 2.0,
                    _ => 0.0,
                }
            };
            // Rows are numbered downwards, and the plane's y points up.
            let normal = Vector3::new(-slope(1), slope(width), 1.0).normalize();
            let shade = brightness(normal) * (1.0 - shadow[index]).max(0.1);
            let shine = normal.dot(&halfway).max(0.0).powi(28) * gloss * (1.0 - shadow[index]).clamp(0.0, 1.0);
            let colour = lit_skin(skin.colour(p, blush[index], beard[index]), shade);
            self.lay(index, coverage, colour.map(|c| c + shine * (1.0 - c)));
        }
        self.spots();
    }

    /// Returns the height of the face over the plane, model units: an ellipsoid with the facial forms on it.
    fn relief(&self) -> Vec<f32> {
        let (half_width, chin) = (self.p(29).x, self.p(10));
        let mut z = vec![0.0; self.rgb.len()];
        for (k, height) in z.iter_mut().enumerate() {
            let p = self.sheet.at(k % self.sheet.width, k / self.sheet.width);
            // The jaw narrows towards the chin.
            let narrow = ((p.y + 0.25) / (chin.y + 0.25)).clamp(0.0, 1.0);
            let x = p.x.abs() / (half_width * (1.05 - 0.32 * narrow * narrow));
            let up = ((p.y - 0.15) / 1.15).clamp(-1.0, 1.0);
            let y = if up > 0.0 { up } else { up * 0.75 };
            let inside = (1.0 - 0.80 * x.powf(2.7) - 0.75 * y.abs().powf(2.6)).max(0.0);
            *height = 0.62 * (inside + 0.02).sqrt();
        }
        self.nose_relief(&mut z);
        let s = self.sheet;
        let mut bump = |p: P, sigma: (f32, f32), angle: f32, amount: f32| s.bump(&mut z, p, sigma, angle, amount);
        let male = if self.sex == Sex::Male { 1.0 } else { 0.55 };
        for side in [1.0_f32, -1.0] {
            let on = |node: usize| P::new(side * self.p(node).x, self.p(node).y);
            let eye = P::new(side * self.p(21).x, f32::midpoint(self.p(21).y, self.p(22).y));
            bump(P::new(side * 0.14, eye.y + 0.02), (0.06, 0.06), 0.0, -0.032);
            bump(P::new(eye.x, eye.y + 0.01), (0.15, 0.075), 0.0, -0.050);
            bump(eye, (0.105, 0.062), 0.0, 0.045);
            bump(P::new(eye.x, eye.y - 0.105), (0.11, 0.02), -0.15 * side, -0.006);
            bump(P::new(on(16).x * 0.8, on(16).y - 0.015), (0.17, 0.05), 0.12 * side, 0.035 * male);
            bump(P::new(side * 0.37, self.p(27).y + 0.0), (0.12, 0.085), 0.5 * side, 0.060);
            bump(P::new(side * 0.42, -0.36), (0.09, 0.14), 0.0, -0.022);
            // The side of the muzzle and the corner of the mouth.
            bump(P::new(on(31).x + side * 0.03, on(31).y), (0.03, 0.05), 0.0, -0.016);
            // The frontal eminence.
            bump(P::new(side * 0.2, 0.56), (0.16, 0.12), 0.0, 0.02);
        }
        let mouth = self.p(87);
        bump(P::new(0.0, mouth.y), (0.19, 0.15), 0.0, 0.060);
        bump(P::new(0.0, f32::midpoint(self.p(7).y, mouth.y)), (0.13, 0.020), 0.0, 0.020);
        bump(P::new(0.0, f32::midpoint(self.p(8).y, mouth.y)), (0.12, 0.024), 0.0, 0.030);
        bump(mouth, (0.16, 0.010), 0.0, -0.016);
        bump(P::new(0.0, self.p(8).y - 0.045), (0.11, 0.028), 0.0, -0.030);
        bump(P::new(0.0, chin.y + 0.12), (0.11, 0.075), 0.0, 0.065);
        // The philtrum: a groove between two ridges.
        let lip_to_nose = f32::midpoint(self.p(6).y, self.p(7).y);
        bump(P::new(0.0, lip_to_nose), (0.017, 0.055), 0.0, -0.010);
        for x in [-0.037, 0.037] {
            bump(P::new(x, lip_to_nose), (0.013, 0.05), 0.0, 0.005);
        }
        z
    }

    fn nose_relief(&self, z: &mut [f32]) {
        let s = self.sheet;
        let (root, tip) = (self.p(77).y, self.p(5).y);
        let ala = self.p(26);
        for j in 0..s.height {
            let y = s.at(0, j).y;
            if y > root + 0.22 || y < tip - 0.16 {
                continue;
            }
            // 0 at the root, 1 at the tip; the ridge rises and ends in the ball of the tip.
            let t = ((root - y) / (root - tip)).clamp(0.0, 1.0);
            let fade = if y > root { (-0.5 * ((y - root) / 0.08).powi(2)).exp() } else { 1.0 };
            let end = tip + 0.030;
            let under = if y < end { (-0.5 * ((end - y) / 0.055).powi(2)).exp() } else { 1.0 };
            let height = (0.036 + 0.090 * t.powf(1.3)) * fade * under;
            let sigma = 0.046 + 0.022 * t * t;
            for i in 0..s.width {
                let x = s.at(i, j).x;
                if x.abs() < 4.0 * sigma {
                    z[j * s.width + i] += height * (-0.5 * (x / sigma).powi(2)).exp();
                }
            }
        }
        s.bump(z, P::new(0.0, tip + 0.012), (0.052, 0.044), 0.0, 0.050);
        for side in [1.0, -1.0] {
            s.bump(z, P::new(side * ala.x * 0.66, ala.y + 0.022), (0.038, 0.036), 0.0, 0.048);
        }
    }

    /// Returns the shadows in eye sockets, under nose, lips and chin, and beside the jaw; 0 for none.
    fn shadow_field(&self) -> Vec<f32> {
        let mut field = vec![0.0; self.rgb.len()];
        let s = self.sheet;
        let mut dab = |p: P, sigma: (f32, f32), angle: f32, amount: f32| s.bump(&mut field, p, sigma, angle, amount);
        let (base, ala) = (self.p(6), self.p(26));
        for side in [1.0_f32, -1.0] {
            let on = |node: usize| P::new(side * self.p(node).x, self.p(node).y);
            let (inner, outer, upper) = (on(23), on(20), on(19));
            dab(P::new(inner.x - side * 0.02, inner.y + 0.03), (0.04, 0.045), 0.0, 0.13);
            dab(P::new(upper.x, upper.y + 0.012), (0.13, 0.022), -0.05 * side, 0.16);
            dab(P::new(outer.x + side * 0.005, outer.y), (0.035, 0.03), 0.0, 0.10);
            dab(P::new(on(24).x - side * 0.04, on(24).y - 0.03), (0.09, 0.026), -0.12 * side, 0.10);
            dab(P::new(side * ala.x * 1.03, ala.y + 0.015), (0.013, 0.034), 0.0, 0.22);
            dab(P::new(side * ala.x * 0.62, base.y - 0.008), (0.045, 0.012), 0.2 * side, 0.20);
            dab(P::new(on(31).x + side * 0.012, on(31).y), (0.020, 0.022), 0.0, 0.28);
            dab(P::new(on(30).x + side * 0.05, on(30).y), (0.09, 0.16), 0.5 * side, 0.20);
            dab(P::new(side * 0.60, 0.35), (0.06, 0.22), 0.0, 0.16);
        }
        dab(P::new(0.0, base.y - 0.010), (0.055, 0.016), 0.0, 0.20);
        dab(P::new(0.03, base.y - 0.05), (0.07, 0.04), 0.0, 0.10);

        dab(P::new(0.0, self.p(8).y - 0.028), (0.10, 0.018), 0.0, 0.24);
        dab(P::new(0.0, self.p(10).y - 0.01), (0.22, 0.03), 0.0, 0.18);
        field
    }
}
