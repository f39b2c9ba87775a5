//! Detects folds of a synthesized surface: triangles that are flipped relative to the neutral mesh.

use rayon::prelude::*;

use super::{Bank, FpMotion, FrameAnswer, Synthesizer};
use crate::mesh::TriangleMesh;

/// Factor on the largest number of triangles that a member of the bank itself flips, in lips and lids that roll. A surface folds
/// only if it flips more than that,
const MEMBERS: usize = 2;
/// and more than this fraction of the triangles of the mesh.
const SHARE: f64 = 0.005;

/// Where an animation folds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Folded {
    /// Index of the first frame that folds, from 0.
    pub first: usize,
    /// Index of the frame with the most flipped triangles; the first of several.
    pub worst: usize,
    /// Number of flipped triangles in that frame.
    pub turned: usize,
    /// Number of triangles of the mesh.
    pub of: usize,
}

/// Number of triangles whose normal points away from its neutral direction.
fn turned(mesh: &TriangleMesh, displacements: &[[f32; 3]]) -> usize {
    let moved = |v: u32| -> [f32; 3] {
        let (p, d) = (mesh.positions()[v as usize], displacements[v as usize]);
        std::array::from_fn(|axis| p[axis] + d[axis])
    };
    let normal = |[a, b, c]: [[f32; 3]; 3]| {
        let side = |p: [f32; 3]| -> [f64; 3] { std::array::from_fn(|axis| f64::from(p[axis] - a[axis])) };
        let ([ux, uy, uz], [vx, vy, vz]) = (side(b), side(c));
        [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx]
    };
    let is_turned = |corners: &&[u32; 3]| {
        let (before, after) = (normal(corners.map(|v| mesh.positions()[v as usize])), normal(corners.map(moved)));
        before.iter().zip(after).map(|(b, a)| b * a).sum::<f64>() < 0.0
    };
    mesh.triangles().iter().filter(is_turned).count()
}

/// Largest number of flipped triangles that does not count as a fold.
fn limit(bank: &Bank) -> usize {
    let most = (0..bank.member_count()).into_par_iter().map(|member| turned(bank.mesh(), bank.displacements(member))).max();
    let share = SHARE * bank.mesh().triangles().len() as f64;
    (MEMBERS * most.unwrap_or(0)).max(share as usize)
}

impl Synthesizer<'_> {
    /// Checks whether the surfaces of answers to `motions` (as given, not emphasized) fold, and where.
    pub(crate) fn folded(&self, answers: &[FrameAnswer], motions: &[FpMotion]) -> Option<Folded> {
        let mesh = self.bank().mesh();
        let count = |(answer, motion): (&FrameAnswer, &FpMotion)| turned(mesh, &self.surface(answer, motion));
        let counts: Vec<usize> = answers.par_iter().zip(motions).map(count).collect();
        let limit = limit(self.bank());
        let first = counts.iter().position(|&turned| turned > limit)?;
        let worst = (first..counts.len()).fold(first, |worst, k| if counts[k] > counts[worst] { k } else { worst });
        Some(Folded { first, worst, turned: counts[worst], of: mesh.triangles().len() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::{BankInfo, FeaturePointVertex, Solver, SynthesisOptions, testing};

    #[test]
    fn a_square_that_is_folded_has_one_triangle_turned_over() {
        let bank = testing::bank();
        let turned_by = |corner: [f32; 3]| turned(bank.mesh(), &[[0.0; 3], [0.0; 3], [0.0; 3], corner]);
        // Vertex 3, at (0, 1), of the triangle 0 2 3 crosses the diagonal. Before that the triangle only shrinks; the vertex may
        // also rise by any height.
        assert_eq!(turned_by([1.5, -0.5, 0.0]), 1);
        assert_eq!(turned_by([0.4, -0.4, 0.0]), 0);
        assert_eq!(turned_by([0.0, 0.0, 9.0]), 0);
        // No member flips a triangle, so one of two is more than the limit.
        assert_eq!(limit(&bank), 0);
    }

    #[test]
    fn an_emphasis_that_folds_the_surface_is_reported_with_its_first_frame() {
        let square = testing::bank().mesh().clone();
        // One member, which moves vertex 3, at (0, 1), 0.4 of the way to (1, 0): beyond half of the way a triangle is flipped.
        let member = vec![[0.0; 3], [0.0; 3], [0.0; 3], [0.4, -0.4, 0.0]];
        let points = [("8.3", 3), ("8.4", 1)].map(|(fp, vertex)| FeaturePointVertex { fp: fp.parse().unwrap(), vertex });
        let bank = Bank::new(square, vec!["fold".to_owned()], member.clone(), points.to_vec(), BankInfo::default()).unwrap();
        let motion = |share: f32| FpMotion::of_surface(&bank, &member.iter().map(|d| d.map(|c| share * c)).collect::<Vec<_>>());
        let motions: Vec<FpMotion> = [0.0, 0.5, 1.0, 1.0].map(motion).into();
        let folded = |emphasis: f64| {
            let options =
                SynthesisOptions { solver: Solver::Nnls, emphasis, smoothing_frames: 0.0, ..SynthesisOptions::default() };
            let synthesizer = Synthesizer::new(&bank, options).unwrap();
            synthesizer.folded(&synthesizer.animate(&motions, || {}), &motions)
        };
        assert_eq!(folded(1.0), None);
        // Half of the way is a weight of 1.25.
        assert_eq!(folded(2.0), Some(Folded { first: 2, worst: 2, turned: 1, of: 2 }));
        assert_eq!(folded(8.0), Some(Folded { first: 1, worst: 1, turned: 1, of: 2 }));
    }
}
