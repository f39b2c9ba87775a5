//! Rejects extreme displacements: their nodes count as lost.
//!
//! KP ask for "a uniform distribution" of displacements and treat nodes "with extreme displacement as lost", without a rule. Here a node's
//! displacement is compared with the component-wise median over its neighbours (nodes one or two springs away), and with the two of them
//! that move most like it: the outer end of a brow that rises fast has more neighbours on the still temple than on the brow. It is extreme
//! when both differences exceed `extreme` robust standard deviations (1.4826 MAD) of all nodes' differences from the median. A minimum
//! relative to the face size keeps sub-pixel noise from rejecting nodes of a still face.

use nalgebra::Vector2;

use super::LossReason;
use crate::{
    robust::{MAD_TO_SIGMA, median},
    units::NodeId,
    wireframe::Wireframe,
};

/// Smallest standard deviation assumed, over the eye distance.
const SIGMA_FLOOR: f64 = 0.004;
/// Number of neighbours that move like a node whose displacement is not extreme.
const COMPANIONS: usize = 2;

/// Result of a step for one live node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeStep {
    /// The node.
    pub node: NodeId,
    /// Displacement found, px; when lost the predicted one, or zero.
    pub displacement: Vector2<f64>,
    /// Whether a lost node has a predicted displacement.
    pub predicted: bool,
    /// Forward-backward distance, px, if measured.
    pub residual: Option<f64>,
    /// Mean absolute grey difference of the matched windows, 0 to 255.
    pub difference: f64,
    /// Reason for the loss, if the node was lost.
    pub loss: Option<LossReason>,
}

/// For every live node (by index), the indices of the live nodes one or two springs away.
#[derive(Clone, Debug)]
pub struct Neighbours(Vec<Vec<usize>>);

impl Neighbours {
    pub fn new(wireframe: &Wireframe) -> Self {
        let live = wireframe.live_nodes();
        let mut place = vec![usize::MAX; wireframe.node_count()];
        live.iter().enumerate().for_each(|(i, n)| place[n.index()] = i);
        let mut near = vec![Vec::new(); live.len()];
        for &(a, b) in wireframe.edges() {
            let (i, j) = (place[a.index()], place[b.index()]);
            near[i].push(j);
            near[j].push(i);
        }
        let within_two = (0..live.len()).map(|i| {
            let mut set: Vec<usize> = near[i].iter().flat_map(|&j| near[j].iter().copied().chain([j])).collect();
            set.sort_unstable();
            set.dedup();
            set.retain(|&j| j != i);
            set
        });
        Self(within_two.collect())
    }
}

/// Marks extreme displacements as lost. `steps` are in the order of the live nodes.
pub fn reject_extremes(neighbours: &Neighbours, steps: &mut [NodeStep], extreme: f64, eye_distance: f64) {
    let differences: Vec<Option<f64>> = (0..steps.len())
        .map(|i| {
            steps[i].loss.is_none().then_some(())?;
            let near = neighbours.0[i].iter().filter(|&&j| steps[j].loss.is_none());
            let (mut x, mut y): (Vec<f64>, Vec<f64>) = near.map(|&j| (steps[j].displacement.x, steps[j].displacement.y)).unzip();
            let expected = Vector2::new(median(&mut x)?, median(&mut y)?);
            Some((steps[i].displacement - expected).norm())
        })
        .collect();
    let mut sizes: Vec<f64> = differences.iter().copied().flatten().collect();
    let Some(spread) = median(&mut sizes) else { return };
    let limit = extreme * (spread * MAD_TO_SIGMA).max(SIGMA_FLOOR * eye_distance);
    let extreme: Vec<usize> = (0..steps.len())
        .filter(|&i| differences[i].is_some_and(|d| d > limit))
        .filter(|&i| {
            let is_like =
                |j: &&usize| differences[**j].is_some() && (steps[i].displacement - steps[**j].displacement).norm() <= limit;
            neighbours.0[i].iter().filter(is_like).count() < COMPANIONS
        })
        .collect();
    for i in extreme {
        let step = &mut steps[i];
        step.loss = Some(LossReason::Extreme);
        step.displacement = Vector2::zeros();
        step.predicted = false;
    }
}

/// Gives nodes that move as one (by index) the component-wise median displacement of those that were not lost.
pub fn move_as_one(steps: &mut [NodeStep], group: &[usize]) {
    let kept: Vec<usize> = group.iter().copied().filter(|&i| steps[i].loss.is_none()).collect();
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = kept.iter().map(|&i| (steps[i].displacement.x, steps[i].displacement.y)).unzip();
    if let (Some(x), Some(y)) = (median(&mut x), median(&mut y)) {
        kept.iter().for_each(|&i| steps[i].displacement = Vector2::new(x, y));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_node_running_away_is_lost_and_the_others_are_not() {
        let wireframe = Wireframe::candide3();
        let neighbours = Neighbours::new(&wireframe);
        let step = |node: &NodeId| NodeStep {
            node: *node,
            displacement: Vector2::new(1.0, 0.5),
            predicted: false,
            residual: None,
            difference: 1.0,
            loss: None,
        };
        let mut steps: Vec<_> = wireframe.live_nodes().iter().map(step).collect();
        steps[20].displacement = Vector2::new(9.0, 0.5);
        reject_extremes(&neighbours, &mut steps, 6.0, 100.0);
        let lost: Vec<usize> = (0..steps.len()).filter(|&i| steps[i].loss.is_some()).collect();
        assert_eq!(lost, [20]);
        assert_eq!(steps[20].loss, Some(LossReason::Extreme));
    }

    #[test]
    fn a_brow_that_rises_alone_is_not_extreme_and_two_nodes_of_it_are() {
        let wireframe = Wireframe::candide3();
        let neighbours = Neighbours::new(&wireframe);
        let lost_of = |brow: &[u16]| {
            let step = |node: &NodeId| NodeStep {
                node: *node,
                displacement: if brow.contains(&node.0) { Vector2::new(0.0, -8.0) } else { Vector2::zeros() },
                predicted: false,
                residual: None,
                difference: 1.0,
                loss: None,
            };
            let mut steps: Vec<_> = wireframe.live_nodes().iter().map(step).collect();
            reject_extremes(&neighbours, &mut steps, 6.0, 100.0);
            steps.iter().filter(|s| s.loss.is_some()).map(|s| s.node.0).collect::<Vec<_>>()
        };
        assert!(lost_of(&[15, 16, 17, 18]).is_empty());
        assert_eq!(lost_of(&[15, 16]), [15, 16]);
    }

    #[test]
    fn nodes_of_a_group_take_its_median_displacement() {
        let step = |k: u16, x: f64, loss| NodeStep {
            node: NodeId(k),
            displacement: Vector2::new(x, -x),
            predicted: false,
            residual: None,
            difference: 0.0,
            loss,
        };
        let mut steps = [step(0, 1.0, None), step(1, 5.0, None), step(2, 2.0, None), step(3, 9.0, Some(LossReason::Klt))];
        move_as_one(&mut steps, &[0, 1, 2, 3]);
        assert_eq!(steps.map(|s| s.displacement.x), [2.0, 2.0, 2.0, 9.0]);
    }

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!(median(&mut []), None);
    }
}
