//! Amplitude of an expression: the strength of a sequence relative to the median of all people.
//!
//! The motion v of a sequence is the displacement of every live node from the neutral to the apex frame. Its amplitude is the signed
//! projection on the median motion m of the emotion, `<v, m> / <m, m>`, over the nodes of a region. It is 1 for a motion as strong as the
//! median, 0 for none, and negative for the opposite motion.
//!
//! The median (the geometric median at every node, one person one weight) is taken over *all* people, so that one ruler measures everybody.
//! A median without the person measured would be a ruler for each: of two groups that differ, it lies with the group that the person is not
//! in, and the difference of the groups grows (eight smiles of 1 and eight of 1.5: from 0.39 to 0.75). The course in time has no influence: a
//! slow and a quick smile of equal strength have equal amplitudes.

mod compare;
mod normal;

use std::collections::BTreeSet;

use nalgebra::Vector2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    SequenceModel, Weighting,
    median::{ExactOptions, PointSet, geometric_median},
    weights::sequence_weights,
};
use crate::{
    units::NodeId,
    wireframe::{Region, Tables, Wireframe},
};

pub use compare::{
    AmplitudeComparison, AmplitudeOptions, AmplitudeTest, Permutations, PersonValue, adjust_amplitudes, compare_amplitudes,
    in_one_only,
};
pub(crate) use normal::{t_above, t_quantile};

/// Mean length of the median motion, in face units, below which a region has no amplitude. Such motion is within the error of landmarks.
pub const LEAST_MOTION: f64 = 1.0;

/// Regions of nodes for which amplitudes are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AmplitudeRegion {
    /// All live nodes.
    Face,
    /// Eyebrows.
    Brows,
    /// Lids, corners and irises.
    Eyes,
    /// Lips.
    Mouth,
}

impl AmplitudeRegion {
    /// All regions, the whole face first.
    pub const ALL: [Self; 4] = [Self::Face, Self::Brows, Self::Eyes, Self::Mouth];

    /// Returns the name used in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Face => "face",
            Self::Brows => "brows",
            Self::Eyes => "eyes",
            Self::Mouth => "mouth",
        }
    }

    fn has(self, region: Region) -> bool {
        match self {
            Self::Face => true,
            Self::Brows => region == Region::Brow,
            Self::Eyes => region == Region::Eye,
            Self::Mouth => region == Region::Mouth,
        }
    }
}

/// Amplitudes of the models of one emotion.
#[derive(Clone, Debug, PartialEq)]
pub struct Amplitudes {
    /// Amplitudes by model in the given order, and by region in the order of [`AmplitudeRegion::ALL`]; `None` where undefined.
    pub values: Vec<[Option<f64>; 4]>,
    /// Regions without amplitudes, with the reason.
    pub missing: Vec<(AmplitudeRegion, String)>,
}

/// Computes the amplitudes of the models of one emotion, in any order. All must have one shape, as [`super::representative`] checks.
pub fn amplitudes(models: &[&SequenceModel], wireframe: &Wireframe, tables: &Tables) -> Amplitudes {
    let live = wireframe.live_nodes();
    let people: BTreeSet<&str> = models.iter().map(|m| m.id.subject.as_str()).collect();
    if people.len() < 2 {
        let why = "amplitudes need other people for comparison, but there is only one person".to_owned();
        let missing = AmplitudeRegion::ALL.map(|region| (region, why.clone())).to_vec();
        return Amplitudes { values: vec![[None; 4]; models.len()], missing };
    }
    let weights = sequence_weights(models.iter().map(|m| &m.id), Weighting::Person);
    let motion = |node: NodeId, i: usize| -> Vector2<f64> {
        let frames = models[i].model.frames();
        frames[frames.len() - 1].nodes()[node.index()] - frames[0].nodes()[node.index()]
    };
    let is_in: Vec<[bool; 4]> = live.iter().map(|&n| AmplitudeRegion::ALL.map(|region| region.has(tables.region(n)))).collect();
    // Per node: the motions of all models, and their median.
    let of_node = |&node: &NodeId| {
        let motions: Vec<Vector2<f64>> = (0..models.len()).map(|i| motion(node, i)).collect();
        let median = geometric_median(&PointSet::known(&motions, weights.as_deref()), &ExactOptions::default()).point;
        (motions, median)
    };
    let nodes: Vec<(Vec<Vector2<f64>>, Vector2<f64>)> = live.par_iter().map(of_node).collect();
    let mut values = vec![[None; 4]; models.len()];
    let mut missing = Vec::new();
    for (r, region) in AmplitudeRegion::ALL.into_iter().enumerate() {
        let members: Vec<_> = nodes.iter().zip(&is_in).filter(|(_, is_in)| is_in[r]).map(|(n, _)| n).collect();
        let mean = members.iter().map(|(_, median)| median.norm()).sum::<f64>() / members.len().max(1) as f64;
        if !(mean >= LEAST_MOTION) {
            let why = format!(
                "the median motion moves these nodes by {mean:.2} face units on average, less than {LEAST_MOTION}, the least that can be \
                 distinguished from errors"
            );
            missing.push((region, why));
            continue;
        }
        let square: f64 = members.iter().map(|(_, median)| median.norm_squared()).sum();
        for (i, value) in values.iter_mut().enumerate() {
            let product: f64 = members.iter().map(|(motions, median)| motions[i].dot(median)).sum();
            value[r] = Some(product / square).filter(|a| a.is_finite());
        }
    }
    Amplitudes { values, missing }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        model::{DynamicExpressionModel, FrameExpressionModel},
        units::SequenceId,
    };

    /// Somebody whose nodes all move by (x, 0).
    fn moving(subject: &str, sequence: &str, x: f64) -> SequenceModel {
        let neutral = Wireframe::candide3().frontal();
        let frame =
            |share: f64| FrameExpressionModel::new(neutral.iter().map(|p| p + Vector2::new(x * share, 0.0)).collect::<Vec<_>>());
        let id = SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() };
        SequenceModel { id, model: DynamicExpressionModel::new(vec![frame(0.0), frame(0.3), frame(1.0)]).unwrap() }
    }

    fn of(models: &[SequenceModel]) -> Amplitudes {
        amplitudes(&models.iter().collect::<Vec<_>>(), &Wireframe::candide3(), &Tables::candide3())
    }

    /// The amplitudes of the whole face, and whether those of the regions are equal.
    fn of_face(models: &[SequenceModel]) -> Vec<f64> {
        let found = of(models);
        assert!(found.missing.is_empty());
        let value = |values: &[Option<f64>; 4]| {
            values.iter().for_each(|v| approx::assert_relative_eq!(v.unwrap(), values[0].unwrap(), max_relative = 1e-9));
            values[0].unwrap()
        };
        found.values.iter().map(value).collect()
    }

    #[test]
    fn everybody_is_measured_with_the_median_of_all() {
        // The median of 10, 20, 40, -90, 25 is 20.
        let models = [("a", 10.0), ("b", 20.0), ("c", 40.0), ("d", -90.0), ("e", 25.0)].map(|(s, x)| moving(s, "1", x));
        for (found, expected) in of_face(&models).iter().zip([0.5, 1.0, 2.0, -4.5, 1.25]) {
            approx::assert_relative_eq!(*found, expected, max_relative = 1e-9);
        }
        // Somebody with two sequences counts once: the median of 10, 20, 30, and of 30 with half a weight each, is 20.
        let models = [("a", "1", 10.0), ("b", "1", 20.0), ("c", "1", 30.0), ("c", "2", 30.0)].map(|(s, n, x)| moving(s, n, x));
        for (found, expected) in of_face(&models).iter().zip([0.5, 1.0, 1.5, 1.5]) {
            approx::assert_relative_eq!(*found, expected, max_relative = 1e-6);
        }
    }

    #[test]
    fn ratios_of_two_groups_that_differ_are_those_of_their_motions() {
        // Two groups of eight: 10.0 to 10.7, and 15.0 to 15.7.
        let models: Vec<_> =
            (0..16).map(|k| moving(&format!("p{k:02}"), "1", if k < 8 { 10.0 } else { 15.0 } + 0.1 * f64::from(k % 8))).collect();
        let found = of_face(&models);
        approx::assert_relative_eq!(found[8] / found[0], 1.5, max_relative = 1e-9);
        // Half way between the groups, 12.85, where the median of an even number lies.
        approx::assert_relative_eq!(found[15], 15.7 / 12.85, max_relative = 1e-9);
    }

    #[test]
    fn no_motion_and_one_person_have_no_amplitude_and_say_why() {
        let still = ["a", "b", "c"].map(|s| moving(s, "1", 0.1));
        let found = of(&still);
        assert!(found.values.iter().flatten().all(Option::is_none));
        assert!(found.missing[0].1.contains("0.10 face units"), "{:?}", found.missing);
        let alone = of(&[moving("a", "1", 5.0), moving("a", "2", 6.0)]);
        assert!(alone.values.iter().flatten().all(Option::is_none) && alone.missing[3].1.contains("only one person"));
    }
}
