//! Paints brows, lids and lashes, nostrils, and lips.

use super::{
    super::{noise, subject::Colour},
    Hair, P, Painter, Sex, V, between, lit_skin, mirrored, scaled,
    sheet::smooth,
};

/// Nodes of the outer lip outline, from the left corner along the upper lip and back.
const OUTER_LIP: [usize; 10] = [31, 79, 33, 7, 66, 80, 64, 86, 8, 85];
/// Nodes of the lip line, from the left corner to the right.
const LIP_LINE: [usize; 5] = [88, 81, 87, 82, 89];

impl Painter<'_> {
    /// Paints all features on the skin.
    pub(super) fn features(&mut self) {
        self.nostrils();
        self.lips();
        self.folds();
        for side in 0..2 {
            self.lid(side);
            self.brow(side);
        }
    }

    fn nostrils(&mut self) {
        let (base, ala) = (self.p(6), self.p(26));
        for side in [1.0, -1.0] {
            let centre = P::new(side * ala.x * 0.42, base.y + 0.004);
            let outline: Vec<P> = (0..16)
                .map(|k| {
                    let (sin, cos) = (k as f32 / 16.0 * std::f32::consts::TAU).sin_cos();
                    let (u, v) = (0.030 * cos, 0.0125 * sin + 0.010 * cos.abs() * -0.6);
                    centre + V::new(u, v + u * side * 0.22)
                })
                .collect();
            let mask = self.sheet.fill(&outline, 0.006);
            let dark = lit_skin(self.look.skin, 0.20);
            self.blend(&mask, 0.88, |_| dark);
            // The lower edge of the wing of the nose.
            let wing = [
                P::new(side * ala.x * 0.98, ala.y + 0.035),
                P::new(side * ala.x * 1.02, ala.y + 0.0),
                P::new(side * ala.x * 0.86, ala.y - 0.026),
                P::new(side * ala.x * 0.55, base.y - 0.006),
            ];
            let edge = self.sheet.line(&smooth(&wing, false, 8), 0.009, 0.007);
            self.tint(&edge, [0.72, 0.60, 0.58]);
        }
    }

    fn lips(&mut self) {
        let outline = smooth(&self.points(OUTER_LIP), true, 10);
        let mask = self.sheet.fill(&outline, 0.007);
        let [r, g, b] = self.look.skin;
        let strength = self.look.lip;
        let rose: Colour = [r * (0.93 - 0.06 * strength), g * (0.80 - 0.26 * strength), b * (0.83 - 0.20 * strength)];
        let line = smooth(&self.points(LIP_LINE), false, 12);
        let line_y = |x: f32| {
            // The line runs from the left corner (large x) to the right.
            line.windows(2)
                .find(|w| (w[1].x..=w[0].x).contains(&x))
                .map_or(line[0].y, |w| w[0].y + (w[1].y - w[0].y) * (x - w[0].x) / (w[1].x - w[0].x))
        };
        let (upper, lower, half_width) = (self.p(7).y, self.p(8).y, self.p(31).x);
        let seed = self.look.noise;
        let gloss = if self.sex == Sex::Female { 0.22 } else { 0.10 };
        self.blend(&mask, 0.92, |p| {
            let seam = line_y(p.x);
            let taper = (1.0 - (p.x / half_width).powi(2)).max(0.05).sqrt();
            // -1 at the lower edge, 0 at the lip line, 1 at the upper edge.
            let v = if p.y > seam { (p.y - seam) / ((upper - seam) * taper) } else { (p.y - seam) / ((seam - lower) * taper) };
            let form = if v > 0.0 { 0.80 + 0.14 * v } else { 0.84 + 0.30 * (-(v + 0.45).powi(2) * 9.0).exp() };
            let bend = 1.0 + 0.5 * (p.y - seam).abs();
            let wrinkle = noise::fractal(p.x * bend * 62.0, p.y * 9.0, 3, seed ^ 0x51) * 0.11;
            let grain = noise::fractal(p.x * 45.0, p.y * 45.0, 2, seed ^ 0x52) * 0.07;
            let shine = gloss * (-(v + 0.42).powi(2) * 40.0).exp() * (-(p.x + 0.04).powi(2) * 90.0).exp();
            let shade = (form + wrinkle + grain) * (1.0 - 0.12 * v.abs().powi(4));
            rose.map(|c| (c * shade) + shine * (1.0 - c))
        });
        let seam = self.sheet.line(&line, 0.009, 0.0055);
        self.tint(&seam, [0.42, 0.30, 0.30]);
        let soft = self.sheet.line(&line, 0.02, 0.014);
        self.tint(&soft, [0.82, 0.74, 0.74]);
        let corners = self.points([31, 64]);
        for corner in corners {
            let inner = P::new(corner.x * 0.82, line[0].y);
            let crease = self.sheet.line(&[inner, corner], 0.009, 0.008);
            self.tint(&crease, [0.50, 0.40, 0.40]);
        }
    }

    /// Paints the fold from the wing of the nose past the corner of the mouth, faint in a neutral face.
    fn folds(&mut self) {
        let (ala, corner) = (self.p(26), self.p(31));
        for side in [1.0, -1.0] {
            let on = |x: f32, y: f32| P::new(side * x, y);
            let fold = smooth(
                &[on(ala.x + 0.02, ala.y + 0.02), on(ala.x + 0.07, ala.y - 0.07), on(corner.x + 0.045, corner.y + 0.05)],
                false,
                10,
            );
            let mask = self.sheet.line(&fold, 0.014, 0.013);
            self.tint(&mask, [0.93, 0.88, 0.87]);
        }
    }

    fn lid(&mut self, side: usize) {
        let margins = grimace::internal::wireframe::LID_MARGINS[side].map(|chain| chain.map(|n| self.p(usize::from(n))));
        let crease_nodes = if side == 0 { [20, 95, 19, 103, 23] } else { [53, 96, 52, 104, 56] };
        let crease = self.points(crease_nodes);
        let [upper, lower] = margins.map(|points| smooth(&points, false, 10));
        let outward = if side == 0 { 1.0 } else { -1.0 };
        // The crease runs above the margin. Candide-3's crease nodes lie close to it; a real fold is slightly higher.
        let fold: Vec<P> =
            crease.iter().enumerate().map(|(k, &p)| p + V::new(0.0, [0.003, 0.013, 0.015, 0.013, 0.005][k])).collect();
        let fold = smooth(&fold, false, 10);
        let mask = self.sheet.line(&fold, 0.008, 0.007);
        self.tint(&mask, [0.55, 0.45, 0.43]);
        // The lid between fold and margin catches light; lashes line its edge.
        let mut plate = fold.clone();
        plate.extend(upper.iter().rev());
        let mask = self.sheet.fill(&plate, 0.008);
        self.tint(&mask, [0.96, 0.91, 0.90]);
        let lined = if self.sex == Sex::Female { 0.013 } else { 0.010 };
        let lash_line: Vec<P> = upper.iter().map(|&p| p + V::new(0.0, 0.004)).collect();
        let mask = self.sheet.line(&lash_line, lined, 0.004);
        self.tint(&mask, [0.22, 0.17, 0.16]);
        let rim: Vec<P> = lower.iter().map(|&p| p - V::new(0.0, 0.006)).collect();
        let mask = self.sheet.line(&rim, 0.010, 0.005);
        self.tint(&mask, [0.80, 0.66, 0.64]);
        let bag: Vec<P> = lower.iter().map(|&p| p - V::new(outward * 0.01, 0.050)).collect();
        let mask = self.sheet.line(&bag[8..bag.len() - 4], 0.010, 0.012);
        self.tint(&mask, [0.90, 0.85, 0.85]);
        self.lashes(&upper, outward, 1.0);
        self.lashes(&lower, outward, -0.45);
    }

    fn lashes(&mut self, margin: &[P], outward: f32, size: f32) {
        let mut strokes = Vec::new();
        let longest = if self.sex == Sex::Female { 0.036 } else { 0.022 };
        let count = if size > 0.0 { 46 } else { 26 };
        for k in 0..count {
            // 0 at the outer corner, 1 at the inner one.
            let t = (k as f32 + self.uniform(0.0, 1.0)) / count as f32 * 0.94;
            let place = t * (margin.len() - 1) as f32;
            let (index, part) = (place as usize, place.fract());
            let root = between(margin[index], margin[(index + 1).min(margin.len() - 1)], part);
            let lean = outward * (0.9 - 1.35 * t);
            let length = longest * size * (1.0 - 0.55 * t) * self.uniform(0.7, 1.1);
            let tip = root + V::new(lean * length.abs(), length * 0.85);
            let bow = root + V::new(lean * length.abs() * 0.35, length * 0.6);
            strokes.push(Hair {
                line: smooth(&[root, bow, tip], false, 3),
                width: 0.0038,
                colour: scaled(self.look.hair, 0.35),
                opacity: if size > 0.0 { 0.62 } else { 0.28 },
            });
        }
        self.hairs(&strokes, None);
    }

    fn brow(&mut self, side: usize) {
        let nodes = self.points([17, 16, 15, 18]);
        let [inner, top, outer, bottom] = if side == 0 { nodes } else { self.points([50, 49, 48, 51]) };
        let outward = if side == 0 { 1.0 } else { -1.0 };
        let thick = self.look.brow;
        let upper = [
            inner + V::new(-0.018 * outward, 0.040 * thick),
            between(inner, top, 0.5) + V::new(0.0, 0.030 * thick),
            top,
            outer + V::new(0.008 * outward, 0.004),
        ];
        let lower = [
            inner + V::new(-0.014 * outward, -0.010 * thick),
            between(inner, bottom, 0.5) + V::new(0.0, -0.014 * thick),
            bottom + V::new(0.0, -0.004 * thick),
            outer + V::new(0.0, -0.012),
        ];
        let (upper, lower) = (smooth(&upper, false, 12), smooth(&lower, false, 12));
        let mut outline = upper.clone();
        outline.extend(lower.iter().rev());
        let mask = self.sheet.fill(&outline, 0.018);
        let hair = self.look.hair;
        let under = 0.36 + 0.25 * (thick - 1.0);
        self.blend(&mask, under, |_| scaled(hair, 0.9));
        let count = (270.0 * thick) as usize;
        let mut strokes = Vec::with_capacity(count);
        for _ in 0..count {
            let (t, v) = (self.uniform(0.0, 0.97), self.uniform(0.02, 1.0));
            let place = t * (upper.len() - 1) as f32;
            let index = place as usize;
            let root = between(lower[index], upper[index], v);
            let ahead = between(lower[(index + 3).min(lower.len() - 1)], upper[(index + 3).min(upper.len() - 1)], 0.5)
                - between(lower[index], upper[index], 0.5);
            let along = if ahead.norm() > 1e-6 { ahead.normalize() } else { V::new(outward, 0.0) };
            // Inner hairs stand up; outer ones lie along the brow, the upper hairs pointing down and the lower ones up.
            let lift = 0.85 * (1.0 - t * 2.4).max(0.0) + 0.60 * (0.5 - v);
            let direction = (along + V::new(0.0, lift)).normalize();
            let length = self.uniform(0.030, 0.054) * (0.75 + 0.25 * thick) * (1.0 - 0.35 * t);
            let tip = root + direction * length;
            let bow = root + direction * (length * 0.5) + V::new(0.0, 0.004);
            let shade = self.uniform(0.45, 1.0);
            strokes.push(Hair {
                line: smooth(&[root, bow, tip], false, 3),
                width: self.uniform(0.0035, 0.0060),
                colour: scaled(hair, shade),
                opacity: 0.55,
            });
        }
        self.hairs(&strokes, None);
        if side == 1 {
            // A trace of shadow between the brows, at the position of the frown.
            let glabella = P::new(0.0, inner.y);
            let line = [glabella + V::new(0.035, 0.05), glabella + V::new(0.03, -0.03)];
            for mirror in [false, true] {
                let line = if mirror { line.map(mirrored) } else { line };
                let mask = self.sheet.line(&line, 0.008, 0.014);
                self.tint(&mask, [0.95, 0.92, 0.91]);
            }
        }
    }
}
