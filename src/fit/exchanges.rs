//! Finds exchanged marks: left and right, or neighbours of one feature.
//!
//! A wrong mark is found by leaving it out and predicting it from the others, which only works while the others are correct. Two exchanges
//! at once hide each other. Therefore every common exchange is tried as a whole: the misfit q is computed with the names of the marks
//! exchanged, which only permutes positions (`mistakes.rs`).

use nalgebra::Point2;

use super::mistakes::{Measure, View};
use crate::units::NodeId;

/// Nodes of the subject's left that are exchanged together with those of the right: eye, brow, mouth, nose, outline.
const SIDES: [&[u16]; 5] =
    [&[20, 21, 22, 23], &[15, 16, 17], &[31, 33, 40, 79, 81, 83, 85, 89], &[26, 75, 111], &[27, 28, 29, 30, 32]];

/// Neighbours within a feature, on the subject's left or in the middle; those of the other side are their mirror images.
const NEIGHBOURS: [(u16, u16); 4] = [(20, 23), (15, 17), (21, 22), (7, 8)];

/// Least decrease of q by an exchange that is reported, and largest share of q that may remain.
///
/// Correct marks of 304 faces (11,000 sets of 3 to 64 marks on heads turned by up to 12 and rolled by up to 11 degrees) have a decrease of
/// at most 1.7; turned by up to 20 and rolled by up to 34 degrees, 5.3. Most real exchanges have far more.
const SURE: (f64, f64) = (8.0, 0.5);

/// Difference of q below which two explanations count as equal.
const ALIKE: f64 = 1e-6;

/// An exchange of names of marks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Exchange {
    /// Whether all of left and right is exchanged.
    pub mirrored: bool,
    /// Whether the mirrored face is upside down: y was counted from below.
    pub below: bool,
    /// Further exchanged pairs, as indices of marks.
    pub pairs: Vec<(usize, usize)>,
}

impl Exchange {
    /// Returns the positions of the marks with their names exchanged, mirrored if `mirrored`.
    pub(super) fn places(&self, seen: &[Point2<f64>]) -> Vec<Point2<f64>> {
        let mut places: Vec<_> = seen.iter().map(|p| Point2::new(if self.mirrored { -p.x } else { p.x }, p.y)).collect();
        self.pairs.iter().for_each(|&(i, j)| places.swap(i, j));
        places
    }
}

/// Returns the exchange that explains the marks far better than their present names do; `None` if there is none.
///
/// `mirror` lists every node's mirror image.
pub(super) fn find(measure: &Measure, view: &View, nodes: &[NodeId], mirror: &[usize], seen: &[Point2<f64>]) -> Option<Exchange> {
    let most = view.misfit() - SURE.0;
    if most <= 0.0 {
        return None;
    }
    let (misfit, exchange) = best(measure, nodes, mirror, seen)?;
    let explains = || measure.view(&exchange.places(seen)).is_some_and(|view| view.strays().iter().all(|s| !s.is_wrong()));
    (misfit < most && (misfit < SURE.1 * view.misfit() || explains())).then_some(exchange)
}

/// Returns the exchange with the smallest q, and that q.
pub(super) fn best(measure: &Measure, nodes: &[NodeId], mirror: &[usize], seen: &[Point2<f64>]) -> Option<(f64, Exchange)> {
    let mut best: Option<(f64, Exchange)> = None;
    let sides = sides(nodes, mirror);
    // Exchanging all pairs of sides equals mirroring the face, unless marks are set on one side alone.
    let in_pairs = nodes.iter().filter(|n| mirror.get(n.index()) != Some(&n.index())).count() == 2 * sides.len();
    let neighbours: Vec<_> = std::iter::once(Vec::new()).chain(pairs_that_are_exchanged(nodes, mirror)).collect();
    // Of two exchanges that give the same positions, the first and shorter one is reported.
    for mirrored in [false, true] {
        for pairs in &neighbours {
            if !mirrored
                && (pairs.is_empty() || in_pairs && pairs.len() == sides.len() && pairs.iter().all(|p| sides.contains(p)))
            {
                continue;
            }
            let mut exchange = Exchange { mirrored, below: false, pairs: pairs.clone() };
            let Some(exchanged) = measure.view(&exchange.places(seen)) else { continue };
            let stands = exchanged.upside_down().is_none();
            // Exchanged names do not turn a face upside down; y counted from below does.
            if !(stands || mirrored && pairs.is_empty()) {
                continue;
            }
            let misfit = exchanged.misfit();
            if misfit < best.as_ref().map_or(f64::INFINITY, |b| b.0 - ALIKE) {
                exchange.below = !stands;
                best = Some((misfit, exchange));
            }
        }
    }
    best
}

/// Returns the pairs of marks on both sides of the face.
pub(super) fn sides(nodes: &[NodeId], mirror: &[usize]) -> Vec<(usize, usize)> {
    (0..nodes.len()).filter_map(|i| partner(nodes, mirror, i).filter(|&j| i < j).map(|j| (i, j))).collect()
}

fn partner(nodes: &[NodeId], mirror: &[usize], i: usize) -> Option<usize> {
    let other = *mirror.get(nodes[i].index())?;
    nodes.iter().position(|n| n.index() == other).filter(|&j| j != i)
}

/// Returns sets of pairs of marks that are commonly exchanged together.
fn pairs_that_are_exchanged(nodes: &[NodeId], mirror: &[usize]) -> Vec<Vec<(usize, usize)>> {
    let at = |node: usize| nodes.iter().position(|n| n.index() == node);
    let pair = |a: usize, b: usize| Some((at(a)?, at(b)?)).filter(|(i, j)| i != j);
    let both = sides(nodes, mirror);
    let mut all: Vec<Vec<(usize, usize)>> = both.iter().map(|&p| vec![p]).collect();
    for side in SIDES {
        let mirrored = |n: &usize| mirror.get(*n).copied();
        let of_side = side.iter().map(|&n| usize::from(n));
        all.push(of_side.filter_map(|n| pair(n, mirrored(&n)?)).map(|(i, j)| (i.min(j), i.max(j))).collect());
    }
    for (a, b) in NEIGHBOURS {
        let (a, b) = (usize::from(a), usize::from(b));
        let here = pair(a, b);
        let there = mirror.get(a).zip(mirror.get(b)).filter(|(c, _)| **c != a).and_then(|(&c, &d)| pair(c, d));
        all.push(here.into_iter().collect());
        all.push(there.into_iter().collect());
        all.push(here.into_iter().chain(there).collect());
    }
    all.retain(|pairs| !pairs.is_empty());
    all.sort();
    all.dedup();
    // Fewest pairs first: of two equal explanations, the shorter one is reported.
    all.sort_by_key(Vec::len);
    all
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::super::{Correspondence, FitError, Fitter};
    use crate::{units::NodeId, wireframe::Wireframe};

    type Pairs = Vec<(u16, u16)>;
    type Exchanged = &'static [(u16, u16)];

    /// Applies exchanges of names to Candide's own face, one pair after the other, and returns the message.
    fn said(nodes: &[u16], exchanged: &[(u16, u16)]) -> Result<(), FitError> {
        let wireframe = Wireframe::candide3();
        let frontal = wireframe.frontal();
        let named = |node: u16| {
            exchanged.iter().fold(node, |node, &(a, b)| match node {
                node if node == a => b,
                node if node == b => a,
                node => node,
            })
        };
        let mark = |&node: &u16| {
            let p = frontal[usize::from(node)];
            Correspondence::mark(NodeId(named(node)), Point2::new(320.0 + 160.0 * p.x, 240.0 - 160.0 * p.y))
        };
        let marks: Vec<_> = nodes.iter().map(mark).collect();
        Fitter::new(&wireframe, super::super::FitOptions::default()).fit(&wireframe, &marks).map(drop)
    }

    fn pairs(found: &[(NodeId, NodeId)]) -> Pairs {
        let mut pairs: Pairs = found.iter().map(|(a, b)| (a.0.min(b.0), a.0.max(b.0))).collect();
        pairs.sort_unstable();
        pairs
    }

    const EYES: [u16; 4] = [20, 23, 53, 56];
    const SIX: [u16; 6] = [20, 23, 53, 56, 31, 64];
    const SEVEN: [u16; 7] = [20, 23, 53, 56, 31, 64, 10];
    const BROWS: [u16; 11] = [20, 23, 53, 56, 31, 64, 10, 15, 17, 48, 50];
    const SIDES: [(u16, u16); 5] = [(20, 53), (23, 56), (31, 64), (15, 48), (17, 50)];

    #[test]
    fn swapped_left_and_right_is_reported_with_the_pairs_of_both_sides() {
        for nodes in [&EYES[..], &[20, 23, 53, 56, 10], &SIX, &SEVEN, &BROWS, &[20, 53, 10], &[20, 53, 31, 64]] {
            let right: Pairs = SIDES.into_iter().filter(|(a, _)| nodes.contains(a)).collect();
            let Err(FitError::Mirrored { pairs: found, then }) = said(nodes, &SIDES) else { panic!("{nodes:?}") };
            let mut right = right;
            right.sort_unstable();
            assert_eq!((pairs(&found), then.len()), (right, 0), "{nodes:?}");
            assert!(said(nodes, &[]).is_ok(), "{nodes:?}");
        }
    }

    #[test]
    fn exchanged_columns_are_reported_and_not_confused_with_left_and_right() {
        let wireframe = Wireframe::candide3();
        let fit = |marks: &[Correspondence]| Fitter::new(&wireframe, super::super::FitOptions::default()).fit(&wireframe, marks);
        for nodes in [&SEVEN[..], &BROWS] {
            for roll in [0.0_f64, 0.3, -0.3] {
                let place = |node: u16, swap: bool| {
                    let p = nalgebra::Rotation2::new(roll) * wireframe.frontal()[usize::from(node)];
                    let (x, y) = (320.0 + 160.0 * p.x, 240.0 - 160.0 * p.y);
                    Correspondence::mark(NodeId(node), if swap { Point2::new(y, x) } else { Point2::new(x, y) })
                };
                let marks = |swap: bool| nodes.iter().map(|&node| place(node, swap)).collect::<Vec<_>>();
                let error = fit(&marks(true)).map(drop).unwrap_err();
                assert!(matches!(error, FitError::AxesExchanged), "{roll}: {error}");
                assert!(fit(&marks(false)).is_ok(), "{roll}");
            }
        }
    }

    #[test]
    fn other_exchanges_beside_left_and_right_are_reported_too() {
        // The name after left and right are corrected: the subject's right eye.
        let exchanged = [SIDES[0], SIDES[1], SIDES[2], (53, 56)];
        let error = said(&SEVEN, &exchanged).unwrap_err();
        let FitError::Mirrored { then, .. } = &error else { panic!("{error}") };
        let once_mirrored = [SIDES[0], SIDES[1], SIDES[2]];
        // After the suggested exchange the marks are correct.
        let advice: Pairs = once_mirrored.into_iter().chain(then.iter().map(|(a, b)| (a.0, b.0))).collect();
        let all: Pairs = exchanged.into_iter().chain(advice).collect();
        assert!(said(&SEVEN, &all).is_ok(), "{error}");
        assert!(error.to_string().contains("then also swap"), "{error}");
    }

    #[test]
    fn exchanged_neighbours_are_reported_in_pairs_on_one_side_and_on_both() {
        let exchanges: [(&[u16], Exchanged); 9] = [
            (&SEVEN, &[(20, 23)]),
            (&EYES, &[(20, 23), (53, 56)]),
            (&SIX, &[(20, 23), (53, 56)]),
            (&SEVEN, &[(20, 23), (53, 56)]),
            (&BROWS, &[(20, 23), (53, 56)]),
            (&BROWS, &[(15, 17), (48, 50)]),
            (&BROWS, &[(15, 48), (17, 50)]),
            (&SEVEN, &[(20, 53), (23, 56)]),
            (&SEVEN, &[(31, 64)]),
        ];
        for (nodes, exchanged) in exchanges {
            let error = said(nodes, exchanged).unwrap_err();
            let FitError::Exchanged { pairs: found } = &error else { panic!("{exchanged:?}: {error}") };
            assert_eq!(pairs(found), exchanged, "{error}");
        }
    }
}
