//! What the feature points are asked to do, and what every member would do instead.

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
#[derive(Clone, Debug, PartialEq)]
pub struct FpMotion {
    /// Offset from neutral of each of the bank's F feature points in its order, the bank's unit; `None` where nothing is known.
    pub offsets: Vec<Option<Vector3<f64>>>,
    /// Whether z is unknown: candidate and target are then compared in the x-y plane.
    pub planar: bool,
}

impl FpMotion {
    /// The motion of all feature points in some surface, V displacements of the bank's mesh.
    pub fn of_surface(bank: &Bank, displacements: &[[f32; 3]]) -> Self {
        let offset = |vertex: u32| Vector3::from(displacements[vertex as usize].map(f64::from));
        Self { offsets: bank.feature_points().iter().map(|p| Some(offset(p.vertex))).collect(), planar: false }
    }

    /// The motion times the emphasis level c [ZL, section 5].
    pub fn emphasized(&self, c: f64) -> Self {
        Self { offsets: self.offsets.iter().map(|o| o.map(|v| v * c)).collect(), planar: self.planar }
    }

    /// Summed length of all motion, the bank's unit.
    pub fn total_length(&self) -> f64 {
        self.offsets.iter().flatten().map(Vector3::norm).sum()
    }
}

/// Motion of the F feature points in each of the M members.
#[derive(Clone, Debug)]
pub struct FpBasis {
    points: usize,
    /// M x F x 3.
    motions: Vec<f64>,
}

impl FpBasis {
    /// Reads the feature points' displacements out of a bank.
    pub fn new(bank: &Bank) -> Self {
        let points = bank.feature_points();
        let mut motions = Vec::with_capacity(3 * points.len() * bank.member_count());
        for member in 0..bank.member_count() {
            let displacements = bank.displacements(member);
            motions.extend(points.iter().flat_map(|p| displacements[p.vertex as usize].map(f64::from)));
        }
        Self { points: points.len(), motions }
    }

    /// Number of members M.
    pub fn member_count(&self) -> usize {
        self.motions.len() / (3 * self.points.max(1))
    }

    /// Motion of one feature point in one member.
    pub fn motion(&self, member: usize, point: usize) -> [f64; 3] {
        let at = 3 * (member * self.points + point);
        [self.motions[at], self.motions[at + 1], self.motions[at + 2]]
    }
}

/// A feature point's motion shorter than this share of the frame's longest counts as none: rounding, not motion.
const STILL_SHARE: f64 = 1e-6;

/// Share of the longest target motion that a point which should stay goes along at most.
pub const REST_REACH: f64 = 0.5;
/// Share that it may go along for nothing.
const REST_FREE: f64 = 0.25;

/// Fitness below which an answer shows nothing of what was asked for: directions are half a degree less than a right angle off on the mean,
/// which is what rounding makes of a motion along x where members move along y.
const LEAST_FITNESS: f64 = 0.01;

/// A feature point and its target motion.
type PointTarget = (usize, [f64; 3]);

/// Moving and staying feature points of `0..points` for which `is_in` holds.
fn split_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> (Vec<PointTarget>, Vec<PointTarget>) {
    let flat = |v: Vector3<f64>| if motion.planar { [v.x, v.y, 0.0] } else { [v.x, v.y, v.z] };
    let longest = motion.offsets.iter().flatten().map(|&v| norm(&flat(v))).fold(0.0, f64::max);
    let known =
        (0..points.min(motion.offsets.len())).filter(|&k| is_in(k)).filter_map(|k| motion.offsets[k].map(|v| (k, flat(v))));
    known.partition(|(_, v)| norm(v) > longest * STILL_SHARE)
}

/// The moving feature points in the order of a goal over those for which `is_in` holds.
pub(super) fn moving_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> Vec<usize> {
    split_points(motion, points, is_in).0.into_iter().map(|p| p.0).collect()
}

/// The feature points that should stay, in the order of such a goal.
pub(super) fn staying_points(motion: &FpMotion, points: usize, is_in: &dyn Fn(usize) -> bool) -> Vec<usize> {
    split_points(motion, points, is_in).1.into_iter().map(|p| p.0).collect()
}

/// One search: the feature points of a region with their target motions, and what the members have there.
///
/// Arrays over feature points are flat, three numbers each; in the plane the third is 0 everywhere.
#[derive(Clone, Debug)]
pub struct Goal {
    members: usize,
    /// Moving feature points first, then those asked to stay.
    moving: usize,
    /// Targets of moving and staying feature points.
    target: Vec<f64>,
    /// Directions of the moving ones, of length 1.
    directions: Vec<f64>,
    /// Summed length of the target motions.
    length: f64,
    /// Members x (moving and staying feature points).
    candidates: Vec<f64>,
}

impl Goal {
    /// The goal of the feature points for which `is_in` holds; `None` when none of them moves.
    pub fn new(basis: &FpBasis, motion: &FpMotion, is_in: impl Fn(usize) -> bool) -> Option<Self> {
        let (moving, staying) = split_points(motion, basis.points, &is_in);
        if moving.is_empty() {
            return None;
        }
        let members = basis.member_count();
        let points: Vec<usize> = moving.iter().chain(&staying).map(|p| p.0).collect();
        let mut candidates = Vec::with_capacity(3 * members * points.len());
        for member in 0..members {
            for &point in &points {
                let [x, y, z] = basis.motion(member, point);
                candidates.extend([x, y, if motion.planar { 0.0 } else { z }]);
            }
        }
        let directions = moving.iter().flat_map(|(_, v)| v.map(|c| c / norm(v))).collect();
        let length = moving.iter().map(|(_, v)| norm(v)).sum();
        let target = moving.iter().map(|p| p.1).chain(staying.iter().map(|_| [0.0; 3])).flatten().collect();
        Some(Self { members, moving: moving.len(), target, directions, length, candidates })
    }

    /// Number of members M.
    pub fn member_count(&self) -> usize {
        self.members
    }

    /// Number of feature points with a motion, M in \[ZL\].
    pub fn moving(&self) -> usize {
        self.moving
    }

    /// Targets of moving and staying feature points.
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

    /// What the feature points do in one member: moving ones, then staying ones.
    pub(super) fn candidate(&self, member: usize) -> &[f64] {
        let size = self.target.len();
        &self.candidates[member * size..(member + 1) * size]
    }

    /// What the moving feature points do in a member.
    pub fn moving_candidate(&self, member: usize) -> &[f64] {
        &self.candidate(member)[..3 * self.moving]
    }

    /// What the moving feature points do in a weighted sum of members.
    pub fn motion(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; 3 * self.moving];
        for (member, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            sum.iter_mut().zip(self.candidate(member)).for_each(|(s, c)| *s += weight * c);
        }
        sum
    }

    /// What the feature points that should stay do in a weighted sum of members.
    fn rest_motion(&self, weights: &[f64]) -> Vec<f64> {
        let from = 3 * self.moving;
        let mut sum = vec![0.0; self.target.len() - from];
        for (member, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            sum.iter_mut().zip(&self.candidate(member)[from..]).for_each(|(s, c)| *s += weight * c);
        }
        sum
    }

    /// The longest target motion, the bank's unit.
    fn longest(&self) -> f64 {
        longest(&self.target)
    }

    /// A fitness, the points that should stay counted: one that goes along farther than [`REST_FREE`] of the longest target motion counts
    /// as one whose direction is wrong, by how much farther it goes. `rest` is their motion, three numbers each.
    pub fn counting_rest(&self, fitness: f64, rest: &[f64]) -> f64 {
        let longest = self.longest();
        let beyond: f64 = rest.as_chunks::<3>().0.iter().map(|v| (norm(v) / longest - REST_FREE).max(0.0)).sum();
        if beyond > 0.0 { fitness * self.moving as f64 / (self.moving as f64 + beyond) } else { fitness }
    }

    /// The same for a weighted sum of members.
    pub fn fitness_of(&self, weights: &[f64]) -> f64 {
        self.counting_rest(fitness(self, &self.motion(weights)), &self.rest_motion(weights))
    }

    /// Puts weights to rest whose fitness is below [`LEAST_FITNESS`]: a face that rests has the fitness 0, and one that answers a motion with
    /// another of the same length is worse than that. Whether it did.
    pub(super) fn rest_where_nothing_is_shown(&self, weights: &mut [f64]) -> bool {
        let rests = self.fitness_of(weights) < LEAST_FITNESS;
        if rests {
            weights.fill(0.0);
        }
        rests
    }

    /// Share of the motion asked for that weights show, as [`Goal::shown_by`] has it.
    pub fn shown(&self, weights: &[f64]) -> f64 {
        self.shown_by(&self.motion(weights))
    }

    /// Share of the motion asked for that points show which move so, three numbers each: how far they go along the directions asked for, summed,
    /// over how far they should; 1 where each goes as far as it should, 0 where they go the other way.
    pub fn shown_by(&self, motion: &[f64]) -> f64 {
        let along: f64 = motion.iter().zip(&self.directions).map(|(v, u)| v * u).sum();
        (along / self.length).max(0.0)
    }

    /// How far points that move go along the motions asked for, summed: `v . d`.
    fn along(&self, motion: &[f64]) -> f64 {
        motion.iter().zip(&self.target).map(|(v, d)| v * d).sum()
    }

    /// Scales weights so that the summed length of their motion is the target's [ZL, section 3]; what does not move stays. Where a point
    /// that should stay would go farther than [`REST_REACH`] of the longest target motion, they are scaled so that all points come closest
    /// to what is asked for, that one to [`REST_REACH`] at most: what a bank cannot move alone it would otherwise move at the cost of the
    /// rest of the face. Whether that was so.
    pub fn fit_length(&self, weights: &mut [f64]) -> bool {
        let motion = self.motion(weights);
        let length = summed_length(&motion);
        let mut is_held = false;
        if length > 0.0 {
            let mut factor = self.length / length;
            let rest = self.rest_motion(weights);
            let (farthest, reach) = (longest(&rest) * factor, REST_REACH * self.longest());
            is_held = farthest > reach;
            if is_held {
                let most = factor * reach / farthest;
                let square: f64 = motion.iter().chain(&rest).map(|v| v * v).sum();
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

/// The length of the longest vector of a flat array.
fn longest(motion: &[f64]) -> f64 {
    motion.as_chunks::<3>().0.iter().map(norm).fold(0.0, f64::max)
}

/// The summed length of the vectors of a flat array.
pub fn summed_length(motion: &[f64]) -> f64 {
    motion.as_chunks::<3>().0.iter().map(norm).sum()
}
