//! Paints neck, clothes and ears.

use super::{super::noise, P, Painter, lit_skin, mirrored, scaled, sheet::smooth, skin::Skin};

impl Painter<'_> {
    pub(super) fn neck(&mut self) {
        let chin = self.p(10);
        let jaw = self.p(30).x;
        let width = (jaw - 0.04).clamp(0.30, 0.42);
        let half = [
            P::new(width + 0.03, -0.45),
            P::new(width, -0.80),
            P::new(width + 0.005, -1.02),
            P::new(width + 0.09, -1.17),
            P::new(width + 0.30, -1.27),
            P::new(width + 0.30, -1.50),
            P::new(0.0, -1.52),
        ];
        let outline = symmetric(&half);
        let mask = self.sheet.fill(&outline, 0.006);
        let skin = Skin::of(self);
        self.blend(&mask, 1.0, |p| {
            // A cylinder in the shadow of the jaw, with two cords down to the pit between the collar bones.
            let x = p.x / (width + 0.04 + 0.5 * (-1.05 - p.y).max(0.0));
            let round = (1.0 - 0.62 * x.abs().powf(2.4)).max(0.25) - 0.06 * x;
            let below = (chin.y - p.y).max(-0.5);
            let jaw_shadow = 0.46 * (-((below - 0.02).max(0.0) / 0.22).powi(2)).exp();
            let cord = (p.x.abs() - (0.10 + 0.22 * (1.30 + p.y).max(0.0))) / 0.045;
            let cords = 0.07 * (-cord * cord).exp();
            let pit = 0.14 * (-((p.x / 0.07).powi(2) + ((p.y + 1.28) / 0.05).powi(2))).exp();
            lit_skin(skin.colour(p, 0.0, 0.0), 0.92 * round * (1.0 - jaw_shadow) + cords - pit)
        });
    }

    pub(super) fn clothes(&mut self) {
        let collar = if self.look.long_hair { -1.42 } else { -1.27 };
        let half = [
            P::new(0.0, collar),
            P::new(0.16, collar + 0.02),
            P::new(0.34, collar + 0.11),
            P::new(0.47, -1.10),
            P::new(0.62, -1.17),
            P::new(0.95, -1.30),
            P::new(1.25, -1.46),
            P::new(1.42, -1.75),
            P::new(1.5, -2.3),
        ];
        let outline = symmetric(&half);
        let edge: Vec<P> = {
            let line = smooth(&half[..5], false, 8);
            line.iter().rev().map(|&p| mirrored(p)).chain(line.iter().copied()).collect()
        };
        let shadow = self.sheet.line(&edge, 0.03, 0.025);
        self.tint(&shadow, [0.70, 0.64, 0.62]);
        let mask = self.sheet.fill(&outline, 0.005);
        let (cloth, seed) = (self.look.cloth, self.look.noise);
        self.blend(&mask, 1.0, |p| {
            let weave = noise::value(p.x * 140.0, p.y * 40.0, seed ^ 0x31) * 0.06
                + noise::value(p.x * 40.0, p.y * 140.0, seed ^ 0x32) * 0.06;
            let drape = noise::fractal(p.x * 3.0 + p.y, p.y * 1.3, 3, seed ^ 0x33) * 0.12;
            let round = 1.0 - 0.38 * (p.x / 1.45).abs().powi(3) - 0.10 * p.x / 1.4;
            scaled(cloth, (round + drape + weave).max(0.1))
        });
        let rib = self.sheet.line(&edge, 0.045, 0.003);
        self.tint(&rib, [0.88, 0.88, 0.89]);
        let stitch: Vec<P> = edge.iter().map(|p| P::new(p.x, p.y - 0.028)).collect();
        let line = self.sheet.line(&stitch, 0.006, 0.004);
        self.tint(&line, [0.7, 0.7, 0.72]);
    }

    pub(super) fn ears(&mut self) {
        if self.look.long_hair {
            return;
        }
        let at = self.p(29).x;
        let skin = Skin::of(self);
        for side in [1.0_f32, -1.0] {
            let on = |x: f32, y: f32| P::new(side * (at + x), y);
            let outline = smooth(
                &[
                    on(-0.05, 0.22),
                    on(0.035, 0.265),
                    on(0.090, 0.20),
                    on(0.085, 0.06),
                    on(0.045, -0.07),
                    on(0.02, -0.17),
                    on(-0.02, -0.19),
                    on(-0.06, -0.10),
                ],
                true,
                8,
            );
            let mask = self.sheet.fill(&outline, 0.006);
            self.blend(&mask, 1.0, |p| {
                let outer = (p.x * side - at) / 0.09;
                let shade = 0.80 + 0.10 * outer - if side > 0.0 { 0.10 } else { 0.0 };
                lit_skin(skin.colour(p, 0.75, 0.0), shade)
            });
            let helix = smooth(&[on(0.0, 0.20), on(0.05, 0.215), on(0.065, 0.13), on(0.055, 0.03), on(0.025, -0.06)], false, 8);
            let mask = self.sheet.line(&helix, 0.012, 0.008);
            self.tint(&mask, [0.66, 0.56, 0.54]);
            let concha = smooth(&[on(0.02, 0.12), on(0.035, 0.05), on(0.012, -0.04)], false, 8);
            let mask = self.sheet.line(&concha, 0.03, 0.014);
            self.tint(&mask, [0.62, 0.50, 0.48]);
        }
    }
}

/// Returns a closed outline from its left half, given from the top outwards.
fn symmetric(half: &[P]) -> Vec<P> {
    let line = smooth(half, false, 8);
    let mut outline: Vec<P> = line.iter().rev().map(|&p| mirrored(p)).collect();
    outline.extend(line);
    outline
}
