//! Synthesis of dense expressions from sparse motion \[ZL\].
//!
//! A bank holds expression meshes. A search finds the mixture of them whose MPEG-4 feature points move like the target.
//!
//! ```text
//! meshes -> Bank -> FpBasis -> Goal (of a region) -> Solver -> weights -> dense surface
//! representative, track, .fap, CSV -> FpMotion ----^
//! ```
//!
//! Letters: V vertices, M members of the bank, F feature points; in formulas of \[ZL\], M is the number of moving feature points.
//! Lengths are in the bank's own unit, axes are those of face space.

mod animate;
mod answer;
pub mod arkit;
mod bank;
mod build;
mod candide;
mod crossover;
mod dense;
mod embedded;
mod error;
mod export;
mod feature_points;
mod file;
mod fitness;
mod folds;
mod head;
mod head_irises;
mod head_learn;
mod head_mesh;
mod head_parts;
mod head_texture;
mod mix;
mod motion;
mod old_file;
mod performance;
mod random;
mod regions;
mod relief;
mod scene;
mod search;
mod shown;
mod solve;
mod source;
mod surface;
mod target;

pub use animate::{BOUND_STARTS, SMOOTHING_FRAMES, SynthesisOptions, Synthesizer, jump};
pub use answer::FrameAnswer;
pub use bank::{Bank, BankHead, BankInfo, Composition, FeaturePointVertex};
pub use build::{BuildOptions, MAX_SUBDIVIDE, build_bank};
pub use candide::{candide_bank, candide_expressions, candide_study};
pub use crossover::Crossover;
pub use dense::read_dense_faces;
pub use embedded::EmbeddedBank;
pub use error::{BankError, SynthesisError};
pub use export::{Animation, compare_with_truth, write_bank_picture, write_gltf};
pub use feature_points::{read_feature_points, write_feature_points};
pub use file::BANK_VERSION;
pub use fitness::fitness;
pub use head::head_bank;
pub use head_learn::learn_head_mesh;
pub use head_mesh::HeadMeshOrigin;
pub use head_texture::HeadTexture;
pub use mix::{mix, mix_bank, read_recipes, recipe_motions, write_recipes};
pub(crate) use motion::head_pivot;
pub use motion::{Motion, MotionKind, fapu_length, read_motion};
pub(crate) use motion::{SingleFap, SingleFaps};
pub use performance::{PerformanceOptions, Recipe, choose_members, choose_targets, perform};
pub use regions::{OVERLAP, RegionScheme, Regions};
pub(crate) use relief::Relief;
pub use scene::{DrawnEye, FaceScene, View};
pub use search::{BLX_ALPHA, GENERATIONS, GaOptions, Generation, Run, TOURNAMENT_SIZE, evolve};
pub(crate) use shown::{HeldBack, Unshown};
pub use solve::{Signs, Solution, Solver, interpolate};
pub use source::source_files;
pub use surface::surface_error;
pub(crate) use target::{ELSEWHERE, FREE_FAR, FREE_NEAR, PLANAR_RIDGE};
pub use target::{FpBasis, FpMotion, Goal};

#[cfg(test)]
pub(crate) mod testing {
    //! A bank small enough to work out by hand.

    use super::*;
    use crate::mesh::TriangleMesh;

    /// Four vertices, two triangles, three feature points (vertices 0, 1, 2) and the members
    /// `right` (all along x), `up` (all along y) and `out` (vertex 0 along x, 1 along y, 2 and 3 along z).
    pub fn bank() -> Bank {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = TriangleMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let displacements = vec![x, x, x, x, y, y, y, y, x, y, z, z];
        let names = ["right", "up", "out"].map(str::to_owned).to_vec();
        let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
        let points = points.map(|(fp, vertex)| FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
        Bank::new(mesh, names, displacements, points, BankInfo::default()).unwrap()
    }

    /// Checks that the dominant expressions, a bank's first members, make their typical movements by at least these amounts: lip
    /// corners up (`smile`) and `down`, inner brows `up` and down, chin.
    pub fn check_dominant_expressions(bank: &Bank, [smile, down, up, chin]: [f64; 4]) {
        let basis = FpBasis::new(bank);
        let y = |member: usize, fp: &str| basis.motion(member, bank.feature_point_index(fp.parse().unwrap()).unwrap())[1];
        let [anger, _, fear, happiness, sadness, surprise] = [0, 1, 2, 3, 4, 5];
        assert!(y(happiness, "8.3") > smile && y(happiness, "8.4") > smile);
        assert!(y(sadness, "8.3") < -down && y(sadness, "4.1") > up);
        assert!(y(surprise, "2.1") < -chin && y(surprise, "4.3") > up);
        assert!(y(anger, "4.1") < -up && y(fear, "4.1") > up);
    }
}
