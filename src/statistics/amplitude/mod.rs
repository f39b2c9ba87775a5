//! Amplitude of an expression: the strength of a sequence relative to the median of all other people.
//!
//! The motion v of a sequence is the displacement of every live node from the neutral to the apex frame. Its amplitude is the signed
//! projection on the median motion m of the emotion, `<v, m> / <m, m>`, over the nodes of a region. It is 1 for a motion as strong as the
//! median, 0 for none, and negative for the opposite motion.
//!
//! The median (the geometric median at every node, one person one weight) is taken over all *other* people, so that no one is compared
//! with themselves. The course in time has no influence: a slow and a quick smile of equal strength have equal amplitudes.

mod compare;
mod normal;

use nalgebra::Vector2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    SequenceModel, Weighting,
    bootstrap::{MAX_EXACT, Place, refined_median},
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
    // Indices of the models of each person.
    let mut order: Vec<usize> = (0..models.len()).collect();
    order.sort_by(|&a, &b| models[a].id.cmp(&models[b].id));
    let mut people: Vec<Vec<usize>> = Vec::new();
    for i in order {
        match people.last_mut().filter(|places| models[places[0]].id.subject == models[i].id.subject) {
            Some(places) => places.push(i),
            None => people.push(vec![i]),
        }
    }
    if people.len() < 2 {
        let why = "amplitudes need other people for comparison, but there is only one person".to_owned();
        let missing = AmplitudeRegion::ALL.map(|region| (region, why.clone())).to_vec();
        return Amplitudes { values: vec![[None; 4]; models.len()], missing };
    }
    let weights = sequence_weights(models.iter().map(|m| &m.id), Weighting::Person);
    let weight = |i: usize| weights.as_ref().map_or(1.0, |weights| weights[i]);
    let motion = |node: NodeId, i: usize| -> Vector2<f64> {
        let frames = models[i].model.frames();
        frames[frames.len() - 1].nodes()[node.index()] - frames[0].nodes()[node.index()]
    };
    let is_in: Vec<[bool; 4]> = live.iter().map(|&n| AmplitudeRegion::ALL.map(|region| region.has(tables.region(n)))).collect();
    // Per node: <v, m> and <m, m> for every model, with the median without the model's person; and the length of the median of all.
    let of_node = |&node: &NodeId| -> (Vec<(f64, f64)>, f64) {
        let points: Vec<(Vector2<f64>, f64)> = (0..models.len()).map(|i| (motion(node, i), weight(i))).collect();
        let middle = points.iter().map(|(v, w)| v * *w).sum::<Vector2<f64>>() / points.iter().map(|p| p.1).sum::<f64>();
        let all = refined_median(&points, middle);
        let place = Place::new(&points, all);
        let mut products = vec![(0.0, 0.0); models.len()];
        for person in &people {
            let median = if models.len() <= MAX_EXACT {
                let others: Vec<_> = (0..points.len()).filter(|i| !person.contains(i)).map(|i| points[i]).collect();
                refined_median(&others, all)
            } else {
                place.without(person.iter().map(|&i| points[i]))
            };
            person.iter().for_each(|&i| products[i] = (points[i].0.dot(&median), median.norm_squared()));
        }
        (products, all.norm())
    };
    let nodes: Vec<(Vec<(f64, f64)>, f64)> = live.par_iter().map(of_node).collect();
    let mut values = vec![[None; 4]; models.len()];
    let mut missing = Vec::new();
    for (r, region) in AmplitudeRegion::ALL.into_iter().enumerate() {
        let members: Vec<&(Vec<(f64, f64)>, f64)> =
            nodes.iter().zip(&is_in).filter(|(_, is_in)| is_in[r]).map(|(n, _)| n).collect();
        let mean = members.iter().map(|node| node.1).sum::<f64>() / members.len().max(1) as f64;
        if !(mean >= LEAST_MOTION) {
            let why = format!(
                "the median motion moves these nodes by {mean:.2} face units on average, less than {LEAST_MOTION}, the least that can be \
                 distinguished from errors"
            );
            missing.push((region, why));
            continue;
        }
        for (i, value) in values.iter_mut().enumerate() {
            let (product, square) = members.iter().fold((0.0, 0.0), |(p, s), node| (p + node.0[i].0, s + node.0[i].1));
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

    #[test]
    fn people_are_not_compared_with_themselves() {
        let models = [("a", 10.0), ("b", 20.0), ("c", 40.0), ("d", -90.0)].map(|(s, x)| moving(s, "1", x));
        // Without a: -90, 20, 40: 20. Without b: -90, 10, 40: 10. Without c: -90, 10, 20: 10. Without d: 10, 20, 40: 20.
        let found = of(&models);
        for (value, expected) in found.values.iter().zip([0.5, 2.0, 4.0, -4.5]) {
            #[allow(clippy::needless_range_loop)]
            for region in 0..4 {
                approx::assert_relative_eq!(value[region].unwrap(), expected, max_relative = 1e-6);
            }
        }
        assert!(found.missing.is_empty());
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
