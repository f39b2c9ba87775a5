//! The target motion of the feature points, and their motion in every member of a bank.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::{Bank, fitness::fitness};

/// Motion of the bank's feature points in one frame.
///
/// ```
/// # let mesh = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// # let mesh = grimace::mesh::TriangleMesh::new(mesh, vec![[0, 1, 2], [0, 2, 3]])?;
/// # let names = ["right", "up"].map(str::to_owned).to_vec();
/// # let moves = [[[1.0, 0.0, 0.0]; 4], [[0.0, 1.0, 0.0]; 4]].concat();
/// # let points = [("8.4", 0), ("8.3", 1), ("3.11", 2)];
/// # let points = points.map(|(fp, vertex)| grimace::synthesis::FeaturePointVertex { fp: fp.parse().unwrap(), vertex }).to_vec();
/// # let bank = grimace::synthesis::Bank::new(mesh, names, moves, points, Default::default())?;
/// use grimace::synthesis::FpMotion;
///
/// // The two members of `bank` move all vertices by 1: to the right, and up.
/// // In the first one, each of the three feature points goes 1.
/// let motion = FpMotion::of_surface(&bank, bank.displacements(0));
/// assert_eq!((motion.total_length(), motion.emphasized(1.5).total_length()), (3.0, 4.5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FpMotion {
    /// Offset from neutral of each of the bank's F feature points, in the bank's order and unit; `None` if unknown.
    pub offsets: Vec<Option<Vector3<f64>>>,
    /// Whether z is unknown: candidate and target are then compared in the x-y plane.
    pub planar: bool,
    /// For each feature point whether its x and its y are free: unknown, and drawn to rest weakly. So are those that a FAP file could
    /// set and does not, such as the x of a corner of the mouth that it only raises. Empty if nothing is free.
    pub free_axes: Vec<[bool; 2]>,
    /// Rotation of the head, radians: pitch downwards, yaw to the subject's left, roll towards the right shoulder (FAPs 48 to 50).
    pub turn: Vector3<f64>,
}

impl FpMotion {
    /// Returns the motion of all feature points in a surface given by V displacements of the bank's mesh; that of a vertex
    /// without a displacement is unknown.
    pub fn of_surface(bank: &Bank, displacements: &[[f32; 3]]) -> Self {
        let offset = |vertex: u32| displacements.get(vertex as usize).map(|d| Vector3::from(d.map(f64::from)));
        Self { offsets: bank.feature_points().iter().map(|p| offset(p.vertex)).collect(), ..Self::default() }
    }

    /// Returns the motion times the emphasis level c [ZL, section 5].
    pub fn emphasized(&self, c: f64) -> Self {
        Self { offsets: self.offsets.iter().map(|o| o.map(|v| v * c)).collect(), ..self.clone() }
    }

    /// Whether x, y and z of a feature point are known.
    pub(super) fn known_axes(&self, point: usize) -> [bool; 3] {
        let [x, y] = self.free_axes.get(point).copied().unwrap_or_default();
        let is_known = self.offsets.get(point).is_some_and(Option::is_some);
        [is_known && !x, is_known && !y, is_known && !self.planar]
    }

    /// The free components of a vector at a feature point.
    pub(super) fn free(&self, point: usize, [x, y, _]: [f64; 3]) -> [f64; 3] {
        let free = self.free_axes.get(point).copied().unwrap_or_default();
        [if free[0] { x } else { 0.0 }, if free[1] { y } else { 0.0 }, 0.0]
    }

    /// A vector at a feature point without the components that are unknown there.
    pub(super) fn seen(&self, point: usize, vector: [f64; 3]) -> [f64; 3] {
        let known = self.known_axes(point);
        std::array::from_fn(|axis| if known[axis] { vector[axis] } else { 0.0 })
    }

    /// Summed length of all motion, the bank's unit.
    pub fn total_length(&self) -> f64 {
        self.offsets.iter().flatten().map(Vector3::norm).sum()
    }
}

/// Motion of the F feature points in each of the M members of a bank.
#[derive(Clone, Debug)]
pub struct FpBasis {
    points: usize,
    /// Flat array, M x F x 3.
    motions: Vec<f64>,
    /// Group of every feature point.
    groups: Vec<u8>,
}

impl FpBasis {
    /// Reads the displacements of the feature points from a bank.
    pub fn new(bank: &Bank) -> Self {
        let points = bank.feature_points();
        let mut motions = Vec::with_capacity(3 * points.len() * bank.member_count());
        for member in 0..bank.member_count() {
            let displacements = bank.displacements(member);
            motions.extend(points.iter().flat_map(|p| displacements[p.vertex as usize].map(f64::from)));
        }
        Self { points: points.len(), motions, groups: points.iter().map(|p| p.fp.group).collect() }
    }

    /// Number of members M.
    pub fn member_count(&self) -> usize {
        self.motions.len() / (3 * self.points.max(1))
    }

    /// Whether a feature point is near one of those that move.
    fn is_near(&self, point: usize, moving: &[usize]) -> bool {
        moving.iter().any(|&moving| takes_along(self.groups[moving], self.groups[point]))
    }

    /// The feature points near some that move.
    pub(super) fn near_points(&self, moving: &[usize]) -> Vec<usize> {
        (0..self.points).filter(|&point| self.is_near(point, moving)).collect()
    }

    /// Largest motion of a free point, as a fraction of the longest target motion.
    pub(super) fn free_reach(&self, point: usize, moving: &[usize]) -> f64 {
        if self.is_near(point, moving) { FREE_REACH } else { REST_REACH }
    }

    /// Motion of one feature point in one member.
    pub fn motion(&self, member: usize, point: usize) -> [f64; 3] {
        let at = 3 * (member * self.points + point);
        [self.motions[at], self.motions[at + 1], self.motions[at + 2]]
    }
}

/// A motion shorter than this fraction of the frame's longest counts as none, because it is rounding.
const STILL_SHARE: f64 = 1e-6;

/// Largest motion of a point that should rest, as a fraction of the longest target motion.
pub const REST_REACH: f64 = 0.5;
/// Motion of such a point, in the same fraction, below which the fitness is not reduced.
const REST_FREE: f64 = 0.25;

/// Largest motion of a free point near what moves, in the same fraction: nothing goes farther than what should go farthest. A point of
/// the other side may go as far, with some room for the asymmetry of a bank. Elsewhere free points may go as far as those that rest.
const FREE_REACH: f64 = 1.05;
/// Weights of free points, relative to those that should rest: near what moves, and elsewhere. They are drawn to rest where lengths
/// count (least squares, the pull of the refinement); fitness and share do not count them. A stretching mouth may take the chin along,
/// but a brow does not open the mouth.
pub(crate) const FREE_NEAR: f64 = 0.05;
pub(crate) const FREE_FAR: f64 = 2.0;
/// Ridge on the weights of members for motion in the plane, which is measured on faces or set by FAPs, as a fraction of the members' mean
/// squared motion: of mixtures that come about as close, the one of few members is taken, not one whose members cancel. Without it the head
/// showed anger and sadness with three shapes of the lids, 1.3 to 3.7 strong, and eyes wide open that should narrow.
pub(crate) const PLANAR_RIDGE: f64 = 0.02;

/// Ridge on the weight of a member, as a fraction of the squared motion of its feature points far from all that moves, times the share that
/// these have of its motion. Members that move the mouth to and fro leave its feature points where they are and change its shape
/// nevertheless: brows that rose alone pressed the lips together with six shapes. So each such member counts by itself. One that hardly moves
/// anything elsewhere, as a smile the lids, is no such member.
pub(crate) const ELSEWHERE: f64 = 20.0;

/// Whether feature points of a group may take those of another group along: chin and lips are one part, and move cheeks and nose.
fn takes_along(group: u8, other: u8) -> bool {
    let is_mouth = |group: u8| matches!(group, 2 | 8);
    group == other || is_mouth(group) && (is_mouth(other) || matches!(other, 5 | 9))
}

/// Fitness below which an answer shows nothing of the target. Its directions are then on average less than half a degree from a
/// right angle to the target, which rounding produces for a motion along x when members move along y.
const LEAST_FITNESS: f64 = 0.01;

/// A feature point and its target motion.
type PointTarget = (usize, [f64; 3]);

/// Splits the feature points of `0..points` for which `is_in` holds into moving and resting ones.
fn split_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> (Vec<PointTarget>, Vec<PointTarget>) {
    let flat = |k: usize| motion.offsets[k].map(|v| (k, motion.seen(k, v.into())));
    let longest = (0..motion.offsets.len()).filter_map(flat).map(|(_, v)| norm(&v)).fold(0.0, f64::max);
    let known = (0..points.min(motion.offsets.len())).filter(|&k| is_in(k)).filter_map(flat);
    known.partition(|(_, v)| norm(v) > longest * STILL_SHARE)
}

/// Indices of the moving feature points, in the order of a goal over those for which `is_in` holds.
pub(super) fn moving_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> Vec<usize> {
    split_points(motion, points, is_in).0.into_iter().map(|p| p.0).collect()
}

/// Indices of the feature points that are free along an axis.
pub(super) fn free_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> Vec<usize> {
    (0..points).filter(|&k| is_in(k) && motion.free_axes.get(k).is_some_and(|free| free.contains(&true))).collect()
}

/// Indices of the feature points that should rest, in the order of such a goal.
pub(super) fn staying_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> Vec<usize> {
    split_points(motion, points, is_in).1.into_iter().map(|p| p.0).collect()
}

/// The goal of one search: target motions of the feature points of a region, and their motions in the members.
///
/// Arrays over feature points are flat with three numbers each. If the motion is planar, the third is always 0.
#[derive(Clone, Debug)]
pub struct Goal {
    members: usize,
    /// Number of moving feature points, which come first; those that should rest follow.
    moving: usize,
    /// Targets of moving and resting feature points.
    target: Vec<f64>,
    /// Whether the motion is planar.
    is_planar: bool,
    /// Unit directions of the targets of the moving points.
    directions: Vec<f64>,
    /// Summed length of the target motions.
    length: f64,
    /// Members x (moving and staying feature points).
    candidates: Vec<f64>,
    /// Members x free feature points, times their weights.
    free: Vec<f64>,
    /// Largest motions of the free feature points, as a fraction of the longest target motion, times their weights.
    free_limits: Vec<f64>,
    /// For each member the squared motion of the feature points far from those that move, times its share of the member's.
    elsewhere: Vec<f64>,
}

impl Goal {
    /// Creates the goal of the feature points for which `is_in` holds; `None` when none of them moves.
    pub fn new(basis: &FpBasis, motion: &FpMotion, is_in: impl Fn(usize) -> bool) -> Option<Self> {
        let (moving, staying) = split_points(motion, basis.points, &is_in);
        if moving.is_empty() {
            return None;
        }
        let members = basis.member_count();
        let points: Vec<usize> = moving.iter().chain(&staying).map(|p| p.0).collect();
        let motions = |points: &[usize], part: &dyn Fn(usize, [f64; 3]) -> [f64; 3]| -> Vec<f64> {
            let of = |member: usize| points.iter().flat_map(move |&point| part(point, basis.motion(member, point)));
            (0..members).flat_map(of).collect()
        };
        let candidates = motions(&points, &|point, v| motion.seen(point, v));
        let free_points = free_points(motion, basis.points, &is_in);
        let moving_points: Vec<usize> = moving.iter().map(|p| p.0).collect();
        let weight = |point: usize| if basis.is_near(point, &moving_points) { FREE_NEAR } else { FREE_FAR };
        let limit = |&point: &usize| weight(point) * basis.free_reach(point, &moving_points);
        let free_limits = free_points.iter().map(limit).collect();
        let free = motions(&free_points, &|point, v| motion.free(point, v).map(|c| c * weight(point)));
        let known: BTreeSet<usize> = points.iter().chain(&free_points).copied().collect();
        let (near, far): (Vec<usize>, Vec<usize>) = known.into_iter().partition(|&point| basis.is_near(point, &moving_points));
        let square_at = |member: usize, &point: &usize| {
            let [x, y, _] = basis.motion(member, point);
            x * x + y * y
        };
        let square_elsewhere = |member: usize| {
            let [near, far] = [&near, &far].map(|points| points.iter().map(|point| square_at(member, point)).sum::<f64>());
            if far > 0.0 { far * far / (near + far) } else { 0.0 }
        };
        let elsewhere = (0..members).map(square_elsewhere).collect();
        let directions = moving.iter().flat_map(|(_, v)| v.map(|c| c / norm(v))).collect();
        let length = moving.iter().map(|(_, v)| norm(v)).sum();
        let target = moving.iter().map(|p| p.1).chain(staying.iter().map(|_| [0.0; 3])).flatten().collect();
        let is_planar = motion.planar;
        Some(Self {
            members,
            moving: moving.len(),
            target,
            is_planar,
            directions,
            length,
            candidates,
            free,
            free_limits,
            elsewhere,
        })
    }

    /// Number of members M.
    pub fn member_count(&self) -> usize {
        self.members
    }

    /// Number of feature points with a target motion, M in \[ZL\].
    pub fn moving(&self) -> usize {
        self.moving
    }

    /// Targets of moving and resting feature points.
    pub(super) fn target(&self) -> &[f64] {
        &self.target
    }

    pub(super) fn directions(&self) -> &[f64] {
        &self.directions
    }

    /// Summed length of the target motions, the bank's unit.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Motion of the feature points in one member: first the moving ones, then the resting ones.
    pub(super) fn candidate(&self, member: usize) -> &[f64] {
        let size = self.target.len();
        &self.candidates[member * size..(member + 1) * size]
    }

    /// Motion of the free feature points in one member, weighted for least squares.
    pub(super) fn free_candidate(&self, member: usize) -> &[f64] {
        let size = self.free.len() / self.members.max(1);
        &self.free[member * size..(member + 1) * size]
    }

    /// Ridge on the weight of a member for what it moves elsewhere on the face, see [`ELSEWHERE`]. The unit of squared motion.
    pub(super) fn ridge_elsewhere(&self, member: usize) -> f64 {
        if self.is_planar { ELSEWHERE * self.elsewhere[member] } else { 0.0 }
    }

    /// Ridge on the weights, as a fraction of the members' mean squared motion.
    pub(super) fn ridge(&self) -> f64 {
        if self.is_planar { PLANAR_RIDGE } else { 0.0 }
    }

    /// Scales weights so that all points come closest to their targets, free ones with their weights.
    pub(super) fn fit_closest(&self, weights: &mut [f64]) {
        let (motion, rest) = (self.motion(weights), self.rest_motion(weights));
        let square: f64 = motion.iter().chain(&rest).chain(&self.free_motion(weights)).map(|v| v * v).sum();
        if square > 0.0 {
            let factor = (self.along(&motion) / square).max(0.0);
            weights.iter_mut().for_each(|w| *w *= factor);
        }
    }

    /// Motion of the moving feature points in a member.
    pub fn moving_candidate(&self, member: usize) -> &[f64] {
        &self.candidate(member)[..3 * self.moving]
    }

    /// Motion of the moving feature points in a weighted sum of members.
    pub fn motion(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; 3 * self.moving];
        for (member, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            sum.iter_mut().zip(self.candidate(member)).for_each(|(s, c)| *s += weight * c);
        }
        sum
    }

    /// Motion, in a weighted sum of members, of the feature points that should rest.
    fn rest_motion(&self, weights: &[f64]) -> Vec<f64> {
        let from = 3 * self.moving;
        let mut sum = vec![0.0; self.target.len() - from];
        for (member, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            sum.iter_mut().zip(&self.candidate(member)[from..]).for_each(|(s, c)| *s += weight * c);
        }
        sum
    }

    /// The motion of a free feature point in a weighted sum of members, over its largest one as a fraction of the longest target motion;
    /// that of the point for which this is largest. The bank's unit.
    fn farthest_free(&self, weights: &[f64]) -> f64 {
        let motion = self.free_motion(weights);
        let lengths = motion.as_chunks::<3>().0.iter().zip(&self.free_limits).map(|(v, limit)| norm(v) / limit);
        lengths.fold(0.0, f64::max)
    }

    /// Motion of the free feature points in a weighted sum of members, times their weights.
    fn free_motion(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.free.len() / self.members.max(1)];
        for (member, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            sum.iter_mut().zip(self.free_candidate(member)).for_each(|(s, c)| *s += weight * c);
        }
        sum
    }

    /// The longest target motion, the bank's unit.
    fn longest(&self) -> f64 {
        longest(&self.target)
    }

    /// Reduces a fitness for points that should rest but move. `rest` is their motion, three numbers each.
    ///
    /// A point that moves by more than [`REST_FREE`] of the longest target motion counts like a point with a wrong direction,
    /// weighted by the excess.
    pub fn counting_rest(&self, fitness: f64, rest: &[f64]) -> f64 {
        let longest = self.longest();
        let beyond: f64 = rest.as_chunks::<3>().0.iter().map(|v| (norm(v) / longest - REST_FREE).max(0.0)).sum();
        if beyond > 0.0 { fitness * self.moving as f64 / (self.moving as f64 + beyond) } else { fitness }
    }

    /// Fitness of a weighted sum of members, reduced for points that should rest but move.
    pub fn fitness_of(&self, weights: &[f64]) -> f64 {
        self.counting_rest(fitness(self, &self.motion(weights)), &self.rest_motion(weights))
    }

    /// Sets weights to 0 if their fitness is below [`LEAST_FITNESS`]; returns whether it did. A face at rest has fitness 0; a
    /// wrong motion of the target's length would be worse.
    pub(super) fn rest_where_nothing_is_shown(&self, weights: &mut [f64]) -> bool {
        let rests = self.fitness_of(weights) < LEAST_FITNESS;
        if rests {
            weights.fill(0.0);
        }
        rests
    }

    /// Share of the target motion that weights show; see [`Goal::shown_by`].
    pub fn shown(&self, weights: &[f64]) -> f64 {
        self.shown_by(&self.motion(weights))
    }

    /// Share of the target motion that a motion of the moving points (three numbers each) shows.
    ///
    /// It is the summed motion along the target directions, divided by the summed target length: 1 when each point moves as far
    /// as its target, 0 when they move the opposite way.
    pub fn shown_by(&self, motion: &[f64]) -> f64 {
        let along: f64 = motion.iter().zip(&self.directions).map(|(v, u)| v * u).sum();
        (along / self.length).max(0.0)
    }

    /// Sum of the scalar products of motions and target motions, `v . d`.
    fn along(&self, motion: &[f64]) -> f64 {
        motion.iter().zip(&self.target).map(|(v, d)| v * d).sum()
    }

    /// Scales weights so that the summed length of their motion is the target's [ZL, section 3]; weights without motion are
    /// unchanged.
    ///
    /// If a point that should rest would then move by more than [`REST_REACH`] of the longest target motion, or a free point
    /// by more than [`FREE_REACH`] of it, the scale is the one at which all points come closest to their targets, with that
    /// point limited so. Otherwise the face would be distorted by motion that the bank cannot show in isolation. Returns whether
    /// this limit applied.
    pub fn fit_length(&self, weights: &mut [f64]) -> bool {
        let motion = self.motion(weights);
        let length = summed_length(&motion);
        let mut is_held = false;
        if length > 0.0 {
            let mut factor = self.length / length;
            let rest = self.rest_motion(weights);
            // How many times farther than allowed a point would go.
            let excess = (longest(&rest) / REST_REACH).max(self.farthest_free(weights)) * factor / self.longest();
            is_held = excess > 1.0;
            if is_held {
                let most = factor / excess;
                let square: f64 = motion.iter().chain(&rest).chain(&self.free_motion(weights)).map(|v| v * v).sum();
                let closest = self.along(&motion) / square;
                factor = if closest > 0.0 { closest.min(most) } else { most };
            }
            weights.iter_mut().for_each(|w| *w *= factor);
        }
        is_held
    }
}

pub(super) fn norm(v: &[f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// Length of the longest vector in a flat array.
fn longest(motion: &[f64]) -> f64 {
    motion.as_chunks::<3>().0.iter().map(norm).fold(0.0, f64::max)
}

/// Summed length of the vectors in a flat array.
pub fn summed_length(motion: &[f64]) -> f64 {
    motion.as_chunks::<3>().0.iter().map(norm).sum()
}
