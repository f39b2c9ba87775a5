//! Intensities of action units, by a small generative model.
//!
//! The neutral offsets of the nodes are modelled as a non-negative sum of expression shapes, each named after its action unit, plus noise
//! whose standard deviation at every node is the node's expected error. Shapes are learned from a face model; left and right are separate
//! unknowns, and so have their own intensities. Candide's own action unit vectors are further unknowns, for faces animated with Candide. The
//! intensity of an action unit is the mean of its sides plus the contribution of its vector. The mean smile of photographed people is one
//! more unknown of AU 12: real smiles draw the corners of the mouth wider apart than the face model's. Errors of the eye corners, by which
//! frames are aligned, move all nodes; these four motions (turn, size, place) are integrated out. Shapes outside the list (sideways jaw,
//! puffed cheeks) explain their part and are not reported.

use std::sync::LazyLock;

use nalgebra::{DMatrix, DVector, Point2, SMatrix, SVector, Vector2, Vector3};

use super::{
    FeaturesError,
    alignment::{ALIGNMENTS, AlignmentErrors, MEDIAN},
    check_nodes,
    facs::{ACTION_UNITS, ActionUnit},
    presence,
    strengths::{System, non_negative, non_negative_from, together},
};
use crate::{
    least_squares::{Rows, add_mixture},
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::{EyeCorners, Normalizer},
    pose::HeadModel,
    units::NodeId,
    wireframe::{UnitKind, embedded_rows},
};

/// Action units and the Candide-3 action unit vectors that also represent them, both sides at once.
const CANDIDE: [(u8, u16); 11] =
    [(2, 5), (4, 3), (5, 10), (7, 7), (9, 8), (10, 0), (15, 14), (20, 2), (23, 9), (26, 11), (45, 6)];
/// The action unit of smiles.
const SMILE: u8 = 12;
/// Mean posed smile of photographed people at full strength, face units.
const SMILE_SHAPE: &str = include_str!("../../candide/smile_shape.csv");
/// Shapes outside the list of action units that explain their part of a motion.
const OTHERS: [&str; 7] = ["jawLeft", "jawRight", "jawForward", "mouthLeft", "mouthRight", "cheekPuff", "mouthShrugUpper"];

/// Intensity of a shape at full strength, on the scale of 0 to 5.
pub const FULL: f64 = 5.0;
/// Rate of the exponential prior `exp(-RARITY x)` of a shape's strength x. It favours few strong shapes, where a normal prior would spread
/// a motion over all similar shapes.
const RARITY: f64 = 1.0;
/// The same for Candide's own vectors, which were not measured on faces: they are used only where they explain much more.
const CANDIDE_RARITY: f64 = 8.0;
/// Standard deviation of an additional normal factor of the prior, which excludes strengths far beyond 1.
const STRENGTH: f64 = 1.0;
/// Variance of the change of a strength within a second: half of full strength within 0.3 s is one standard deviation.
const RATE: f64 = 0.8;
/// The same for blinks, which close the eye within a tenth of a second.
const BLINK_RATE: f64 = 10.0;
/// The action unit of blinks.
const BLINK: u8 = 45;
/// Frames of a film that are explained together, and further ones on either side, whose strengths are only used for those between.
const TOGETHER: (usize, usize) = (128, 16);
/// Median difference of a person's shapes from those of the head model, face units, as for nodes slightly beside their position. Without
/// it, small accurate offsets are explained by shapes that cancel each other: of 45 sequences of photographs and videos, eight showed
/// raised lids and a blink at once, and one broad smile had no lip corner puller.
const SHAPE_ERROR: f64 = 6.0;
/// Intensity, 0 to 5, from which an action unit counts as present, if there is also [`EVIDENCE`] of it.
pub(super) const PRESENT: f64 = 1.0;
/// Least evidence of a present action unit.
pub(super) const EVIDENCE: f64 = 2.0;

/// Smallest difference of log likelihoods of a motion and its opposite that gives an order. Chosen so that speech and faces that hardly
/// move, which are equally likely either way, have no order against their motion: played forwards, the reverse is the likelier one by 9.5 at
/// most among 90 smiles tracked in two photographs, and never among 50 sequences of photographs and videos.
const SURE: f64 = 12.0;

/// The intensity of one action unit in one frame.
///
/// ```
/// use grimace::features::Intensity;
///
/// let smile = Intensity { number: 12, value: 3.5, sides: Some([3.0, 4.0]), expected_error: 0.2, evidence: 9.0 };
/// assert!(smile.is_present() && !Intensity { value: 0.5, ..smile }.is_present());
/// // The other action units explain the face as well.
/// assert!(!Intensity { evidence: 0.3, ..smile }.is_present());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intensity {
    /// Number in FACS.
    pub number: u8,
    /// Intensity, 0 to 5: the mean of both sides.
    pub value: f64,
    /// Intensity of the subject's left and right side, 0 to 5; `None` for an action unit without sides.
    pub sides: Option<[f64; 2]>,
    /// Expected error of the value: half of such values are closer, half further away.
    pub expected_error: f64,
    /// How much better the face is explained with the action unit than by all others alone: difference of the log posteriors of the best
    /// mixtures. 0 for intensities below 1, where it is not determined, for AU 5 without an eye that is open wider than in the neutral
    /// frame, and for AU 45 without one that is at least a tenth narrower. AU 25 has 2 at twice its expected error, and grows with the
    /// square. In films, frames in a row with an intensity of at least 1 share one value, which a third of them reach.
    pub evidence: f64,
}

impl Intensity {
    /// Whether the action unit is present: its intensity is at least 1, and the other units do not explain the face nearly as well.
    pub fn is_present(&self) -> bool {
        self.value >= PRESENT && self.evidence >= EVIDENCE
    }
}

/// Returns the mean smile at full strength over the first `count` nodes, face units; nodes that Candide-3 does not have do not move.
fn smile_shape(count: usize) -> Vec<Vector2<f64>> {
    static ROWS: LazyLock<Vec<(usize, f64, f64)>> = LazyLock::new(|| embedded_rows("smile_shape.csv", SMILE_SHAPE).collect());
    let mut shape = vec![Vector2::zeros(); count];
    for &(node, x, y) in ROWS.iter() {
        if let Some(offset) = shape.get_mut(node) {
            *offset = Vector2::new(x, y);
        }
    }
    shape
}

/// Expression shapes over the nodes of the canonical face.
///
/// In the example a face that does not move shows no action unit.
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// use grimace::{features::ActionUnits, normalize::Normalizer, pose::HeadModel};
/// use nalgebra::Vector2;
///
/// let normalizer = Normalizer::new(&wireframe, &tables, Default::default())?;
/// let units = ActionUnits::new(&HeadModel::shipped(&wireframe, &tables), &normalizer)?;
/// let nodes: Vec<_> = wireframe.live_nodes().iter().map(|node| (*node, 5.0)).collect();
/// let found = units.intensities(&vec![Vector2::zeros(); 113], &nodes);
/// assert!(found.iter().all(|unit| unit.value == 0.0 && !unit.is_present()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ActionUnits {
    /// Offsets of every node, face units: along x of each unknown, then along y.
    shapes: Vec<f64>,
    /// Rate of the exponential prior of each unknown.
    rarities: Vec<f64>,
    /// Variance of the change of each unknown within a second.
    rates: Vec<f64>,
    /// Unknowns of each action unit and their weights in its strength: one half for each of two sides.
    members: Vec<Vec<(usize, f64)>>,
    /// Side of each unknown, 0 left and 1 right; `None` for both.
    sides: Vec<Option<usize>>,
    alignment: AlignmentErrors,
}

impl ActionUnits {
    /// Creates the shapes of a head model, normalized as tracks are.
    ///
    /// # Errors
    /// [`FeaturesError`] when the head does not normalize, or has another number of nodes than the normalizer's wireframe.
    pub fn new(head: &HeadModel, normalizer: &Normalizer<'_>) -> Result<Self, FeaturesError> {
        const PX: f64 = 100.0;
        let (wireframe, tables) = normalizer.face();
        check_nodes("head model", head.node_count(), wireframe.node_count())?;
        let canonical = |offset: &dyn Fn(usize) -> Vector3<f64>| -> Result<Vec<Vector2<f64>>, FeaturesError> {
            let frame = |share: f64| {
                let place = |k: usize| {
                    let at = head.mean[k] + offset(k) * share;
                    Point2::new(at.x * PX, -at.y * PX)
                };
                FrameExpressionModel::new((0..wireframe.node_count()).map(place).collect())
            };
            let model = normalizer.normalize_every_frame(&DynamicExpressionModel::new(vec![frame(0.0), frame(1.0)])?)?;
            Ok(model.neutral_offsets(1))
        };
        let (mut shapes, mut rarities, mut rates, mut members) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut sides = Vec::new();
        let listed = ACTION_UNITS.iter().map(|u| (u.number, u.shapes)).chain(OTHERS.iter().map(|s| (0, std::slice::from_ref(s))));
        for (number, stems) in listed {
            let first = shapes.len();
            for shape in &head.shapes {
                let stem = shape.name.strip_suffix("_L").or_else(|| shape.name.strip_suffix("_R")).unwrap_or(&shape.name);
                if stems.contains(&stem) {
                    shapes.push(canonical(&|k| shape.offsets[k])?);
                    sides.push(["_L", "_R"].iter().position(|side| shape.name.ends_with(side)));
                }
            }
            rarities.resize(shapes.len(), RARITY);
            let share = 1.0 / (shapes.len() - first).max(1) as f64;
            let mut unknowns: Vec<(usize, f64)> = (first..shapes.len()).map(|i| (i, share)).collect();
            for (_, vector) in CANDIDE.iter().filter(|(unit, _)| *unit == number) {
                let kind = UnitKind::Action { number: *vector };
                if let Some(unit) = wireframe.action_units().iter().find(|unit| unit.kind == kind) {
                    let offset = |k: usize| unit.offsets.iter().filter(|(n, _)| n.index() == k).map(|(_, o)| *o).sum();
                    unknowns.push((shapes.len(), 1.0));
                    shapes.push(canonical(&offset)?);
                }
            }
            rarities.resize(shapes.len(), CANDIDE_RARITY);
            if number == SMILE {
                unknowns.push((shapes.len(), 1.0));
                shapes.push(smile_shape(wireframe.node_count()));
                rarities.push(RARITY);
            }
            sides.resize(shapes.len(), None);
            rates.resize(shapes.len(), if number == BLINK { BLINK_RATE } else { RATE });
            members.push(unknowns);
        }
        members.truncate(ACTION_UNITS.len());
        let axes = (0..wireframe.node_count()).flat_map(|k| [(k, 0), (k, 1)]);
        let shapes = axes.flat_map(|(k, axis)| shapes.iter().map(move |shape: &Vec<Vector2<f64>>| shape[k][axis])).collect();
        let corners = EyeCorners::new(tables, wireframe.node_count());
        let alignment = AlignmentErrors::new(normalizer.canonical().neutral.nodes(), &corners);
        Ok(Self { shapes, rarities, rates, members, sides, alignment })
    }

    /// Number of nodes of the wireframe.
    pub(super) fn node_count(&self) -> usize {
        self.alignment.motions.len()
    }

    /// Returns the offsets of a node along x and along y, for each unknown.
    fn along(&self, node: usize) -> [&[f64]; 2] {
        let count = self.rarities.len();
        [0, 1].map(|axis| &self.shapes[(2 * node + axis) * count..(2 * node + axis + 1) * count])
    }

    /// Returns the gap, face units, that a half-dropped jaw makes between two nodes one above the other; 0 if the wireframe lacks
    /// one.
    pub fn gap_of_jaw(&self, [above, below]: [usize; 2]) -> f64 {
        if above.max(below) >= self.node_count() {
            return 0.0;
        }
        let jaw = ACTION_UNITS.iter().zip(&self.members).filter(|(unit, _)| unit.shapes.contains(&"jawOpen"));
        let gap = |&(i, _): &(usize, f64)| self.along(above)[1][i] - self.along(below)[1][i];
        0.5 * jaw.filter_map(|(_, members)| members.first()).map(gap).sum::<f64>()
    }

    /// Returns the linear system for neutral offsets (face units) of nodes with these expected errors (face units): `N` and `A' W d` of the
    /// minimum of `x' N x / 2 - (A' W d - rarities)' x`.
    fn system(&self, offsets: &[Vector2<f64>], nodes: &[(NodeId, f64)]) -> (DMatrix<f64>, DVector<f64>) {
        let count = self.rarities.len();
        let mut normal = DMatrix::<f64>::identity(count, count) / (STRENGTH * STRENGTH);
        let mut seen = DVector::<f64>::zeros(count);
        let mut rows = Rows::new(count);
        // What is unknown or no number says nothing.
        let is_seen = |(node, expected): &(NodeId, f64)| {
            let offset = offsets.get(node.index()).filter(|_| node.index() < self.node_count());
            offset.is_some_and(|offset| offset.iter().all(|c| c.is_finite())) && !expected.is_nan()
        };
        let nodes: Vec<(NodeId, f64)> = nodes.iter().copied().filter(is_seen).collect();
        let deviation = self.alignment.deviation(&nodes);
        // With the motions `B` of a misaligned face: `I + B' W B`, `A' W B` and `B' W d`.
        let mut between = SMatrix::<f64, ALIGNMENTS, ALIGNMENTS>::identity();
        let mut shared = DMatrix::<f64>::zeros(count, ALIGNMENTS);
        let mut misaligned = SVector::<f64, ALIGNMENTS>::zeros();
        for (node, expected) in nodes {
            let k = node.index();
            let inverse = MEDIAN / expected.hypot(SHAPE_ERROR);
            let weight = inverse * inverse;
            for (axis, along) in self.along(k).into_iter().enumerate() {
                rows.add_mixture([inverse], [along]);
                add_mixture(seen.as_mut_slice(), [weight * offsets[k][axis]], [along]);
                let motions = SVector::from(self.alignment.motions[k].map(|motion| deviation * motion[axis]));
                between += motions * motions.transpose() * weight;
                misaligned += motions * (weight * offsets[k][axis]);
                for (motion, mut column) in motions.iter().zip(shared.column_iter_mut()) {
                    add_mixture(column.as_mut_slice(), [weight * motion], [along]);
                }
            }
        }
        rows.add_squares(&mut normal);
        normal.fill_upper_triangle_with_lower_triangle();
        // The weights of nodes that also move together: `W - W B (I + B' W B)^-1 B' W`.
        if let Some(factor) = between.cholesky() {
            normal -= &shared * factor.inverse() * shared.transpose();
            seen -= &shared * factor.solve(&misaligned);
        }
        (normal, seen)
    }

    /// Returns the order of a motion, -1 to 1: how much better its neutral offsets (face units) are explained than their opposite, for
    /// nodes with these expected errors (face units). 1: only the motion itself is an expression. -1: only its opposite is, as of a face
    /// that goes back from an expression. 0: nothing moved.
    ///
    /// Muscles only pull: an expression is a non-negative sum of action units, and no such sum explains its opposite well. The best
    /// strengths `x` of either explain the log likelihood `x' N x / 2`; the order is the difference of the two over their sum. Differences
    /// of less than 12 give 0.
    ///
    /// ```
    /// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
    /// # use grimace::{features::ActionUnits, normalize::Normalizer, pose::HeadModel};
    /// # use nalgebra::Vector2;
    /// # let normalizer = Normalizer::new(&wireframe, &tables, Default::default())?;
    /// # let units = ActionUnits::new(&HeadModel::shipped(&wireframe, &tables), &normalizer)?;
    /// let nodes: Vec<_> = wireframe.live_nodes().iter().map(|node| (*node, 5.0)).collect();
    /// assert_eq!(units.order(&vec![Vector2::zeros(); 113], &nodes), 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn order(&self, offsets: &[Vector2<f64>], nodes: &[(NodeId, f64)]) -> f64 {
        let (normal, seen) = self.system(offsets, nodes);
        let rarities = DVector::from_column_slice(&self.rarities);
        let explained = |seen: DVector<f64>| {
            let strengths = non_negative(&normal, &(seen - &rarities));
            0.5 * (&normal * &strengths).dot(&strengths)
        };
        let [there, back] = [explained(seen.clone()), explained(-seen)];
        if (there - back).abs() < SURE { 0.0 } else { (there - back) / (there + back) }
    }

    /// Returns the intensities that explain neutral offsets (face units) of nodes with these expected errors (face units). Nodes
    /// that the wireframe or `offsets` lack, and values that are no numbers, do not count.
    pub fn intensities(&self, offsets: &[Vector2<f64>], nodes: &[(NodeId, f64)]) -> Vec<Intensity> {
        let system =
            self.of_frame(&SeenFrame { offsets: offsets.to_vec(), nodes: nodes.to_vec(), seconds: None, is_neutral: false });
        let alone = system.alone();
        self.read(&system, &alone, &alone)
    }

    /// Returns the intensities of the frames of a film, in order of time, as [`ActionUnits::intensities`], but explained together: strengths
    /// change within a second by a variance of [`RATE`]. `frame` returns a frame by its index.
    pub(super) fn over_time(&self, count: usize, frame: impl Fn(usize) -> SeenFrame) -> Vec<Vec<Intensity>> {
        let (block, margin) = TOGETHER;
        let mut out = Vec::with_capacity(count);
        let mut seconds = Vec::with_capacity(count);
        for start in (0..count).step_by(block) {
            let (end, from) = ((start + block).min(count), start.saturating_sub(margin));
            let systems: Vec<System> = (from..(end + margin).min(count)).map(|k| self.of_frame(&frame(k))).collect();
            let alone: Vec<DVector<f64>> = systems.iter().map(System::alone).collect();
            let strengths = together(&systems, &alone, &self.rates);
            let kept = systems.iter().zip(alone.iter().zip(&strengths)).skip(start - from).take(end - start);
            for (system, (alone, strengths)) in kept {
                out.push(self.read(system, alone, strengths));
                seconds.push(system.seconds);
            }
        }
        presence::share(&mut out, &seconds);
        out
    }

    fn of_frame(&self, seen: &SeenFrame) -> System {
        let (normal, right) = self.system(&seen.offsets, &seen.nodes);
        let right = right - DVector::from_column_slice(&self.rarities);
        System { normal, right, seconds: seen.seconds, is_neutral: seen.is_neutral }
    }

    /// Returns the intensities of these strengths. What a unit adds to the explanation of a frame is determined from that frame alone.
    fn read(&self, system: &System, alone: &DVector<f64>, strengths: &DVector<f64>) -> Vec<Intensity> {
        let System { normal, right, .. } = system;
        let covariance = normal.clone().cholesky().map(|factor| factor.inverse());
        let best = system.log_posterior(alone);
        let evidence = |members: &[(usize, f64)]| {
            let others = non_negative_from(alone, normal, right, |i| members.iter().all(|(member, _)| *member != i));
            (best - system.log_posterior(&others)).max(0.0)
        };
        let one = |(unit, members): (&ActionUnit, &Vec<(usize, f64)>)| {
            let value = (FULL * members.iter().map(|&(i, share)| share * strengths[i]).sum::<f64>()).min(FULL);
            // What has a side counts on this side alone, twice as much as in the mean.
            let factor = |i: usize, side: usize| self.sides[i].map_or(1.0, |own| if own == side { 2.0 } else { 0.0 });
            let on = |side| FULL * members.iter().map(|&(i, share)| share * factor(i, side) * strengths[i]).sum::<f64>();
            let has_sides = members.iter().any(|(i, _)| self.sides[*i].is_some());
            // The intensity of a unit is unknown if none of its shapes is visible.
            let covariance = covariance.as_ref().filter(|_| !members.is_empty());
            let variance = covariance.map_or(f64::INFINITY, |c| {
                members.iter().flat_map(|&(i, a)| members.iter().map(move |&(j, b)| a * b * c[(i, j)])).sum::<f64>()
            });
            Intensity {
                number: unit.number,
                value,
                sides: has_sides.then(|| [0, 1].map(|side| on(side).min(FULL))),
                expected_error: (FULL * MEDIAN * variance.max(0.0).sqrt()).min(FULL),
                evidence: if value < PRESENT { 0.0 } else { evidence(members) },
            }
        };
        ACTION_UNITS.iter().zip(&self.members).map(one).collect()
    }
}

/// What is seen of a frame.
#[derive(Clone, Debug)]
pub(super) struct SeenFrame {
    /// Neutral offsets of all nodes, face units.
    pub offsets: Vec<Vector2<f64>>,
    /// Observed nodes and their expected errors, face units.
    pub nodes: Vec<(NodeId, f64)>,
    /// The frame's time, if known.
    pub seconds: Option<f64>,
    /// Whether it is the neutral frame.
    pub is_neutral: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        normalize::NormalizeOptions,
        wireframe::{Tables, Wireframe},
    };

    /// Returns the shipped action units and the live nodes, all with one expected error.
    fn shipped(expected: f64) -> (ActionUnits, Vec<(NodeId, f64)>) {
        let (w, tables) = (Wireframe::candide3(), Tables::candide3());
        let normalizer = Normalizer::new(&w, &tables, NormalizeOptions::default()).unwrap();
        let units = ActionUnits::new(&HeadModel::shipped(&w, &tables), &normalizer).unwrap();
        let nodes = w.live_nodes().iter().map(|&n| (n, expected)).collect();
        (units, nodes)
    }

    #[test]
    fn nodes_that_are_not_there_and_values_that_are_no_numbers_say_nothing() {
        let (units, mut nodes) = shipped(5.0);
        let mut smile: Vec<Vector2<f64>> = smile_shape(113).into_iter().map(|offset| offset * 0.5).collect();
        let known = units.intensities(&smile, &nodes[..50]);
        nodes.truncate(50);
        nodes.extend([(NodeId(113), 5.0), (NodeId(60), f64::NAN), (NodeId(112), 5.0), (NodeId(61), 5.0)]);
        smile[61].x = f64::NAN;
        smile.truncate(112);
        assert_eq!(units.intensities(&smile, &nodes), known);
        assert_eq!((units.gap_of_jaw([87, 113]), units.gap_of_jaw([usize::MAX, 40])), (0.0, 0.0));
    }

    #[test]
    fn a_smile_of_the_left_side_is_one_and_the_mean_counts_half_of_it() {
        let (units, nodes) = shipped(5.0);
        let (w, whole) = (Wireframe::candide3(), smile_shape(113));
        // In face space x is to the subject's left.
        let left: Vec<Vector2<f64>> =
            whole.iter().zip(w.frontal()).map(|(offset, at)| offset * if at.x > 0.0 { 0.5 } else { 0.0 }).collect();
        let smile =
            |offsets: &[Vector2<f64>]| units.intensities(offsets, &nodes).into_iter().find(|unit| unit.number == SMILE).unwrap();
        let Intensity { value, sides: Some([on_left, on_right]), .. } = smile(&left) else { panic!("no sides") };
        assert!(on_left > 1.2 && on_right < 0.4 * on_left, "{on_left} {on_right}");
        assert!((value - 0.5 * (on_left + on_right)).abs() < 1e-9, "{value}");
        let both: Vec<Vector2<f64>> = whole.iter().map(|offset| offset * 0.5).collect();
        let Intensity { sides: Some([on_left, on_right]), .. } = smile(&both) else { panic!("no sides") };
        assert!((on_left - on_right).abs() < 0.2, "{on_left} {on_right}");
        // Lips part in the middle.
        assert!(
            units
                .intensities(&both, &nodes)
                .iter()
                .all(|unit| unit.sides.is_none() == [17, 18, 22, 24, 25, 26].contains(&unit.number))
        );
    }

    #[test]
    fn the_mean_smile_is_symmetric_and_opens_the_lips() {
        let shape = smile_shape(113);
        for (left, right) in [(31, 64), (79, 80), (81, 82), (83, 84), (85, 86), (88, 89), (33, 66), (20, 53), (15, 48)] {
            let mirrored = Vector2::new(-shape[right].x, shape[right].y);
            assert!((shape[left] - mirrored).norm() < 0.15, "{left} {right}");
        }
        for middle in [5, 6, 7, 8, 10, 40, 87] {
            assert!(shape[middle].x.abs() < 0.15, "{middle}");
        }
        assert!(shape[87].y > 40.0 && shape[40].y < 0.0, "{} {}", shape[87].y, shape[40].y);
    }

    #[test]
    fn the_mean_smile_is_a_smile_of_half_strength_and_nothing_else() {
        let (units, nodes) = shipped(5.0);
        let smile: Vec<Vector2<f64>> = smile_shape(113).into_iter().map(|offset| offset * 0.5).collect();
        let found = units.intensities(&smile, &nodes);
        let present: Vec<u8> = found.iter().filter(|unit| unit.is_present()).map(|unit| unit.number).collect();
        assert_eq!(present, [SMILE]);
        let value = found.iter().find(|unit| unit.number == SMILE).unwrap().value;
        assert!((value - 2.5).abs() < 0.4, "{value}");
    }

    #[test]
    fn a_turn_and_a_size_that_the_eye_corners_leave_open_are_no_expression() {
        let (units, nodes) = shipped(10.0);
        // One and a half standard deviations each of what corners that are 10 / 0.6745 off do to the whole face.
        let moved = |m: &[Vector2<f64>; ALIGNMENTS]| (m[2] + m[3]) * 1.5 * 10.0 / MEDIAN;
        let offsets: Vec<Vector2<f64>> = units.alignment.motions.iter().map(moved).collect();
        assert!(offsets[10].norm() > 25.0, "the chin moves: {}", offsets[10].norm());
        for unit in units.intensities(&offsets, &nodes) {
            assert!(unit.value < 0.5 && !unit.is_present(), "AU {}: {}", unit.number, unit.value);
        }
        // If the corners were exact, the same motion would have to be an expression.
        let mut exact = units.clone();
        exact.alignment.corners.clear();
        assert!(exact.intensities(&offsets, &nodes).iter().any(|unit| unit.value > 0.5));
    }

    #[test]
    fn a_mixture_of_shapes_is_taken_apart() {
        let (units, nodes) = shipped(2.0);
        let strength = |number: u8| match number {
            12 => 0.6,
            1 => 0.4,
            26 => 0.3,
            _ => 0.0,
        };
        let mut offsets = vec![Vector2::zeros(); 113];
        for (unit, members) in ACTION_UNITS.iter().zip(&units.members) {
            // Both sides of the learned shapes, without Candide's.
            for &(i, _) in members.iter().filter(|(i, share)| *share < 1.0 || *i == members[0].0) {
                for (k, offset) in offsets.iter_mut().enumerate() {
                    *offset += Vector2::from(units.along(k).map(|along| along[i])) * strength(unit.number);
                }
            }
        }
        let back: Vec<Vector2<f64>> = offsets.iter().map(|offset| -offset).collect();
        let [order, reversed] = [&offsets, &back].map(|offsets| units.order(offsets, &nodes));
        assert!(order > 0.02 && (order + reversed).abs() < 1e-9, "{order} {reversed}");
        for found in units.intensities(&offsets, &nodes) {
            let expected = FULL * strength(found.number);
            assert!((found.value - expected).abs() < 0.4, "AU {}: {} for {expected}", found.number, found.value);
            assert!(found.expected_error > 0.0);
        }
    }

    #[test]
    fn frames_of_a_film_are_known_better_together_than_alone() {
        let (units, nodes) = shipped(10.0);
        let smile = smile_shape(113);
        let strength = |m: usize| 0.5 * (1.0 - (m as f64 / 6.0).cos());
        // The nodes are off by up to 20 face units, in another direction in every frame.
        let off = |m: usize, k: usize| {
            let turn = ((m * 113 + k) as f64 * 12.9898).sin() * 43758.5453;
            let size = ((m * 113 + k) as f64 * 78.233).sin();
            Vector2::new(turn.cos(), turn.sin()) * size * 20.0
        };
        let frame = |m: usize, seconds: Option<f64>| SeenFrame {
            offsets: (0..113).map(|k| smile[k] * strength(m) + if m == 0 { Vector2::zeros() } else { off(m, k) }).collect(),
            nodes: nodes.clone(),
            seconds,
            is_neutral: m == 0,
        };
        let error = |found: &[Vec<Intensity>]| {
            let truth = |unit: &Intensity, m: usize| if unit.number == SMILE { FULL * strength(m) } else { 0.0 };
            let square =
                |(m, units): (usize, &Vec<Intensity>)| units.iter().map(|u| (u.value - truth(u, m)).powi(2)).sum::<f64>();
            (found.iter().enumerate().map(square).sum::<f64>() / found.len() as f64).sqrt()
        };
        let film = units.over_time(160, |m| frame(m, Some(m as f64 / 25.0)));
        let alone = units.over_time(50, |m| frame(m, None));
        let [together, apart] = [error(&film[..50]), error(&alone)];
        assert!(together < 0.6 * apart, "{together} {apart}");
        assert!(film[0].iter().all(|unit| unit.value == 0.0));
        assert_eq!(alone[5], units.intensities(&frame(5, None).offsets, &nodes));
        // Two blocks meet at frame 128: a film that begins later says nearly the same of it.
        let later = units.over_time(60, |m| frame(m + 100, Some(m as f64 / 25.0)));
        for (a, b) in film[128].iter().zip(&later[28]) {
            assert!((a.value - b.value).abs() < 0.02, "AU {}: {} {}", a.number, a.value, b.value);
        }
    }
}
