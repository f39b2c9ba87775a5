//! Wrinkles of expressions: shading on the plane, with a depth that depends on the motion of nearby nodes.

use nalgebra::Vector3;

use super::{P, Painter, sheet::smooth};

/// A fold, and the motion that causes it.
#[derive(Clone, Debug)]
pub struct Wrinkle {
    /// Texels (index in the sheet), each with the share of light that the full fold removes (positive) or adds (negative).
    shading: Vec<(u32, f32)>,
    /// Causes of the fold: (node, weights of x and y of its offset per model unit). The sum of the weighted offsets is the depth.
    causes: Vec<(usize, [f64; 2])>,
}

/// Largest depth of a fold.
const DEEPEST: f64 = 1.25;

impl Wrinkle {
    /// Returns the depth of the fold, 0 to [`DEEPEST`], for offsets of the nodes (model units).
    pub fn depth(&self, offsets: &[Vector3<f64>]) -> f32 {
        let sum: f64 = self.causes.iter().map(|&(n, [x, y])| offsets[n].x * x + offsets[n].y * y).sum();
        sum.clamp(0.0, DEEPEST) as f32
    }

    /// Shades a picture (premultiplied RGBA texels) with the fold at a depth.
    pub fn shade(&self, texels: &mut [[u8; 4]], depth: f32) {
        for &(index, amount) in &self.shading {
            let taken = amount * depth;
            let [r, g, b, alpha] = texels[index as usize];
            // A fold of skin loses less red than blue.
            let dim = |c: u8, share: f32| (f32::from(c) * (1.0 - taken * share)).clamp(0.0, f32::from(alpha)).round() as u8;
            texels[index as usize] = [dim(r, 0.85), dim(g, 1.0), dim(b, 1.05), alpha];
        }
    }
}

/// Parameters to draw a fold.
struct Fold {
    line: Vec<P>,
    width: f32,
    dark: f32,
    /// Position of the bright bulge relative to the line.
    bulge: P,
}

impl Painter<'_> {
    /// Returns all folds of the face.
    pub(super) fn wrinkles(&mut self) -> Vec<Wrinkle> {
        let mut all = Vec::new();
        self.forehead(&mut all);
        self.frown(&mut all);
        for side in [1.0_f32, -1.0] {
            self.cheek(side, &mut all);
        }
        all
    }

    fn fold(&self, folds: &[Fold], causes: Vec<(usize, [f64; 2])>) -> Wrinkle {
        let mut field = vec![0.0_f32; self.rgb.len()];
        for fold in folds {
            for (index, coverage) in self.sheet.line(&fold.line, fold.width, fold.width * 0.75).texels(&self.sheet) {
                field[index] += coverage * fold.dark;
            }
            let beside: Vec<P> = fold.line.iter().map(|p| p + fold.bulge.coords).collect();
            for (index, coverage) in self.sheet.line(&beside, fold.width * 1.6, fold.width * 1.1).texels(&self.sheet) {
                field[index] -= coverage * fold.dark * 0.38;
            }
        }
        let shading = field.iter().enumerate().filter(|(_, a)| a.abs() > 2e-3).map(|(k, &a)| (k as u32, a)).collect();
        Wrinkle { shading, causes }
    }

    /// Adds furrows across the forehead for raised brows.
    fn forehead(&mut self, all: &mut Vec<Wrinkle>) {
        let brow = f32::midpoint(self.p(16).y, self.p(49).y);
        let folds: Vec<Fold> = (0..4_u8)
            .map(|k| {
                let y = brow + 0.095 + 0.078 * f32::from(k);
                let half = 0.34 - 0.035 * f32::from(k);
                let (a, b, c) = (self.uniform(-0.012, 0.012), self.uniform(-0.012, 0.012), self.uniform(-0.012, 0.012));
                let line = [
                    P::new(-half, y - 0.012 + a),
                    P::new(-half * 0.5, y + 0.012 + b),
                    P::new(0.0, y - 0.006 + c),
                    P::new(half * 0.5, y + 0.012 - b),
                    P::new(half, y - 0.012 - a),
                ];
                Fold { line: smooth(&line, false, 8), width: 0.009, dark: 0.34, bulge: P::new(0.0, -0.022) }
            })
            .collect();
        let raise = [16, 49, 17, 50].map(|n| (n, [0.0, 2.2])).to_vec();
        all.push(self.fold(&folds, raise));
    }

    /// Adds vertical folds between the brows, and folds across the bridge of a wrinkled nose.
    fn frown(&mut self, all: &mut Vec<Wrinkle>) {
        let (brow, root) = (self.p(17), self.p(77));
        let mut folds = Vec::new();
        for side in [1.0_f32, -1.0] {
            let on = |x: f32, y: f32| P::new(side * x, y);
            let line = [on(0.060, brow.y + 0.085), on(0.048, brow.y + 0.02), on(0.058, brow.y - 0.045)];
            folds.push(Fold { line: smooth(&line, false, 8), width: 0.010, dark: 0.42, bulge: P::new(side * 0.026, 0.0) });
        }
        all.push(self.fold(&folds, vec![(17, [-5.0, 0.0]), (50, [5.0, 0.0])]));
        let mut folds = Vec::new();
        for (k, drop) in [0.0_f32, 0.045, 0.09].into_iter().enumerate() {
            let y = root.y - 0.03 - drop;
            let half = 0.055 + 0.012 * k as f32;
            let line = [P::new(-half, y - 0.014), P::new(0.0, y + 0.010), P::new(half, y - 0.014)];
            folds.push(Fold { line: smooth(&line, false, 8), width: 0.009, dark: 0.32, bulge: P::new(0.0, -0.020) });
        }
        for side in [1.0_f32, -1.0] {
            for k in 0..2_u8 {
                let x = 0.075 + 0.03 * f32::from(k);
                let line = [P::new(side * x, root.y - 0.09), P::new(side * (x + 0.035), root.y - 0.17)];
                folds.push(Fold { line: line.to_vec(), width: 0.009, dark: 0.26, bulge: P::new(side * 0.022, 0.0) });
            }
        }
        all.push(self.fold(&folds, vec![(2, [0.0, -7.0]), (26, [0.0, 6.0]), (59, [0.0, 6.0])]));
    }

    /// Adds the fold from nose to mouth, laughter lines beside the eye, the upper edge of the cheek, and the line below a corner of the
    /// mouth that is pulled down.
    fn cheek(&mut self, side: f32, all: &mut Vec<Wrinkle>) {
        let left = side > 0.0;
        let pick = |l: usize, r: usize| if left { l } else { r };
        let (ala, corner, outer, lower) =
            (self.p(pick(26, 59)), self.p(pick(31, 64)), self.p(pick(20, 53)), self.p(pick(24, 57)));
        let off = |p: P, x: f32, y: f32| P::new(p.x + side * x, p.y + y);
        let out = f64::from(side);
        let line = [off(ala, 0.012, 0.035), off(ala, 0.055, -0.02), off(corner, 0.045, 0.09), off(corner, 0.065, -0.005)];
        let fold = Fold { line: smooth(&line, false, 8), width: 0.013, dark: 0.40, bulge: P::new(side * 0.034, 0.012) };
        let causes = vec![
            (pick(31, 64), [4.2 * out, 4.5]),
            (pick(27, 60), [0.0, 2.5]),
            (pick(79, 80), [0.0, 5.0]),
            (pick(26, 59), [0.0, 5.0]),
        ];
        all.push(self.fold(&[fold], causes));
        let feet: Vec<Fold> = [(0.035_f32, 0.050_f32), (0.005, 0.008), (-0.022, -0.036)]
            .into_iter()
            .map(|(from, to)| {
                let line = vec![off(outer, 0.022, from * 0.6), off(outer, 0.075, to)];
                Fold { line, width: 0.006, dark: 0.26, bulge: P::new(0.0, -0.014) }
            })
            .collect();
        let lift = vec![(pick(27, 60), [0.0, 10.0])];
        all.push(self.fold(&feet, lift.clone()));
        let line = [off(lower, -0.13, -0.015), off(lower, -0.03, -0.055), off(lower, 0.10, -0.045)];
        let bag = Fold { line: smooth(&line, false, 8), width: 0.010, dark: 0.22, bulge: P::new(0.0, -0.030) };
        all.push(self.fold(&[bag], lift));
        let line = [off(corner, 0.022, -0.01), off(corner, 0.045, -0.07), off(corner, 0.030, -0.14)];
        let mark = Fold { line: smooth(&line, false, 8), width: 0.012, dark: 0.34, bulge: P::new(side * 0.030, 0.0) };
        all.push(self.fold(&[mark], vec![(pick(31, 64), [0.0, -9.0])]));
    }
}
