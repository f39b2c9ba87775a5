//! Paints hair: a shaded mass and thousands of strands.

use super::{
    super::{noise, subject::Colour},
    Hair, P, Painter, V, mirrored, scaled,
    sheet::smooth,
};

impl Painter<'_> {
    /// Paints the hair behind neck and ears.
    pub(super) fn hair_behind(&mut self) {
        if !self.look.long_hair {
            return;
        }
        let side = self.p(29).x;
        let half = [
            P::new(0.0, self.p(0).y + 0.18),
            P::new(0.43, self.p(0).y + 0.06),
            P::new(side + 0.13, 0.55),
            P::new(side + 0.18, 0.0),
            P::new(side + 0.19, -0.6),
            P::new(side + 0.17, -1.1),
            P::new(side + 0.02, -1.32),
            P::new(0.3, -1.25),
            P::new(0.0, -1.2),
        ];
        let outline = mirror_closed(&half);
        let mask = self.sheet.fill(&outline, 0.012);
        let hair = self.look.hair;
        self.blend(&mask, 1.0, |p| scaled(hair, 0.42 + 0.14 * (p.x.abs() - 0.5).max(0.0)));
    }

    /// Paints the hair over skull and forehead; long hair has strands down to the shoulders.
    pub(super) fn hair_in_front(&mut self) {
        let cap = self.cap();
        let mask = self.sheet.fill(&cap, 0.006);
        let clip = mask.spread(&self.sheet);
        // A soft shadow of the hair on the forehead.
        let shadow = self.sheet.line(&self.hairline(), 0.05, 0.035);
        self.tint(&shadow, [0.80, 0.74, 0.72]);
        let (hair, seed, parting) = (self.look.hair, self.look.noise, self.parting_top());
        self.blend(&mask, 1.0, |p| {
            let d = p - parting;
            let angle = d.y.atan2(d.x);
            let lock = noise::fractal(angle * 9.0, d.norm() * 1.2, 3, seed ^ 0x41);
            // A band of light across the crown.
            let sheen = (-((p.y - 0.86 - 0.18 * (1.0 - p.x * p.x)) / 0.10).powi(2)).exp() * (1.0 - 0.4 * (p.x + 0.2));
            scaled(hair, (0.66 + 0.16 * lock + 0.22 * sheen) * (1.0 - 0.25 * p.x.abs().powi(2)))
        });
        let strands = self.strands();
        self.hairs(&strands, Some(&clip));
        // Uneven light along each lock prevents trackers from sliding along the strands.
        for (index, coverage) in mask.texels(&self.sheet) {
            let p = self.sheet.at(index % self.sheet.width, index / self.sheet.width);
            let glint = 0.16 * noise::fractal(p.x * 13.0, p.y * 13.0, 3, seed ^ 0x42)
                + 0.10 * noise::value(p.x * 60.0, p.y * 40.0, seed ^ 0x43);
            let factor = 1.0 + glint * coverage;
            self.rgb[index] = self.rgb[index].map(|c| c * factor);
        }
        self.fringe();
    }

    /// Returns the top of the parting on the skull.
    fn parting_top(&self) -> P {
        P::new(self.look.parting * 0.35, self.p(0).y + 0.04)
    }

    /// Returns the border between forehead and hair, from temple to temple.
    fn hairline(&self) -> Vec<P> {
        let up = self.look.hairline;
        let side = self.p(29).x;
        let dip = self.look.parting * 0.05;
        let temple = if self.look.long_hair { -0.25 } else { 0.16 };
        let peak = 0.03 * (self.look.parting * 9.0).sin();
        let half = |s: f32| {
            [
                P::new(s * (side + 0.005), temple),
                P::new(s * (side - 0.030), 0.36),
                P::new(s * (side - 0.085), 0.52 + up),
                P::new(s * 0.43, 0.67 + up + s * dip),
                P::new(s * 0.30, 0.77 + up + s * dip),
                P::new(s * 0.14, 0.80 + up + s * dip),
            ]
        };
        let mut points: Vec<P> = half(1.0).to_vec();
        points.push(P::new(0.0, 0.795 + up - peak));
        points.extend(half(-1.0).iter().rev());
        smooth(&points, false, 8)
    }

    /// Returns the outline of the hair in front.
    fn cap(&self) -> Vec<P> {
        let side = self.p(29).x;
        let top = self.p(0).y;
        let volume = if self.look.long_hair { 0.06 } else { 0.0 };
        let mut half = vec![
            P::new(0.0, top + 0.20 + volume * 0.5),
            P::new(0.22, top + 0.17 + volume * 0.5),
            P::new(0.43, top + 0.05 + volume * 0.5),
            P::new(0.59 + volume * 0.5, top - 0.19 + volume * 0.5),
            P::new(side + 0.055 + volume, 0.62),
            P::new(side + 0.070 + volume, 0.40),
        ];
        if self.look.long_hair {
            half.extend([
                P::new(side + 0.17, 0.0),
                P::new(side + 0.20, -0.6),
                P::new(side + 0.17, -1.12),
                P::new(side + 0.0, -1.40),
                P::new(side - 0.13, -1.18),
                P::new(side - 0.06, -0.75),
                P::new(side + 0.02, -0.40),
            ]);
        } else {
            half.extend([P::new(side + 0.055, 0.24), P::new(side + 0.02, 0.12)]);
        }
        let outer = smooth(&half, false, 8);
        let mut outline: Vec<P> = outer.iter().rev().map(|&p| mirrored(p)).collect();
        outline.extend(outer);
        outline.extend(self.hairline());
        outline
    }

    fn strand_colour(&mut self, light: f32) -> Colour {
        let shade = self.uniform(0.55, 1.25) * light;
        let warm = self.uniform(-0.05, 0.08);
        let [r, g, b] = self.look.hair;
        [r * shade * (1.0 + warm), g * shade, b * shade * (1.0 - warm)]
    }

    fn strands(&mut self) -> Vec<Hair> {
        let top = self.parting_top();
        let line = self.hairline();
        let side = self.p(29).x;
        let mut strands = Vec::new();
        for _ in 0..1700 {
            // From the parting in an arc over the skull to a point on the border of the cap.
            let t = self.uniform(0.0, 1.0);
            let angle = std::f32::consts::PI * (1.12 * t - 0.06);
            let reach = self.uniform(0.35, 1.05);
            let end = P::new(angle.cos() * (side + 0.12), 0.18 + angle.sin() * (top.y - 0.02));
            let root = top + V::new(self.uniform(-0.05, 0.05), self.uniform(-0.22, 0.10));
            let middle = super::between(root, end, 0.5) + V::new(angle.cos() * 0.10, 0.10 * angle.sin() + 0.05);
            let full = smooth(&[root, middle, end], false, 7);
            let from = self.uniform(0.0, 0.5);
            let cut = |share: f32| ((share * full.len() as f32) as usize).min(full.len());
            let piece = full[cut(from).min(full.len() - 2)..cut(reach.min(1.0)).max(cut(from) + 2).min(full.len())].to_vec();
            let light = 0.85 + 0.45 * (-((piece[piece.len() / 2].y - 1.0) / 0.14).powi(2)).exp();
            strands.push(Hair {
                width: self.uniform(0.004, 0.009),
                colour: self.strand_colour(light),
                opacity: 0.5,
                line: piece,
            });
        }
        // Short hairs soften the hairline; they grow up and outwards.
        for _ in 0..1500 {
            let k = (self.uniform(0.0, 1.0) * (line.len() - 1) as f32) as usize;
            let root = line[k] + V::new(self.uniform(-0.03, 0.03), self.uniform(-0.01, 0.10));
            let out = V::new(root.x * 0.55 - self.look.parting * 0.15, (root.y - 0.15).max(0.08)).normalize();
            let length = self.uniform(0.08, 0.34);
            let tip = root + out * length;
            let bow = super::between(root, tip, 0.5) + V::new(-0.05 * length * out.x, 0.10 * length);
            let light = 0.85 + 0.45 * (-((bow.y - 1.0) / 0.16).powi(2)).exp();
            strands.push(Hair {
                line: smooth(&[root, bow, tip], false, 5),
                width: self.uniform(0.003, 0.007),
                colour: self.strand_colour(light),
                opacity: 0.5,
            });
        }
        if self.look.long_hair {
            for _ in 0..1100 {
                let side_sign = if self.uniform(-1.0, 1.0) > 0.0 { 1.0 } else { -1.0 };
                let x = side + self.uniform(-0.10, 0.20);
                let wave = self.uniform(-0.02, 0.02);
                let start = self.uniform(-0.6, 0.7);
                let end = start - self.uniform(0.3, 0.9);
                let points = [
                    P::new(side_sign * x, start),
                    P::new(side_sign * (x + 0.03 + wave), f32::midpoint(start, end)),
                    P::new(side_sign * (x + wave - 0.02), end),
                ];
                let light = 0.80 + 0.30 * (-((start - 0.1) / 0.3).powi(2)).exp() - 0.15 * side_sign;
                strands.push(Hair {
                    line: smooth(&points, false, 6),
                    width: self.uniform(0.004, 0.010),
                    colour: self.strand_colour(light),
                    opacity: 0.5,
                });
            }
        }
        strands
    }

    /// Paints single hairs over the border of the hair, so that it has no sharp edge.
    fn fringe(&mut self) {
        let line = self.hairline();
        let mut strokes = Vec::new();
        for _ in 0..500 {
            let k = (self.uniform(0.0, 1.0) * (line.len() - 1) as f32) as usize;
            let root = line[k] + V::new(self.uniform(-0.02, 0.02), self.uniform(-0.030, 0.02));
            let out = V::new(root.x * 0.5 - self.look.parting * 0.15, (root.y - 0.1).max(0.03)).normalize();
            let tip = root + out * self.uniform(0.03, 0.09);
            strokes.push(Hair {
                line: vec![root, tip],
                width: self.uniform(0.002, 0.0045),
                colour: scaled(self.look.hair, 0.8),
                opacity: self.random_opacity(),
            });
        }
        self.hairs(&strokes, None);
    }

    fn random_opacity(&mut self) -> f32 {
        self.uniform(0.2, 0.6)
    }
}

/// Returns a closed outline from its left half.
fn mirror_closed(half: &[P]) -> Vec<P> {
    let line = smooth(half, false, 8);
    let mut outline: Vec<P> = line.iter().rev().map(|&p| mirrored(p)).collect();
    outline.extend(line);
    outline
}
