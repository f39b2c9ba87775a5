//! Finds wrong marks: exchanged, mirrored, upside down, or far from the position that the other marks predict.
//!
//! The check asks whether any plausible face could have its marks there. A plausible face is the mean of the known priors plus everything
//! that moves a mark without being a mistake, each with a generous standard deviation: shape units and learned modes, the differences of
//! the priors' means, action units (an open mouth, shut eyes), yaw and pitch of the head, the aspect of the picture, and the mark's own
//! error. With the residuals r of the marks from the mean, their covariance C, and the similarities D of the mean,
//! ```text
//! P = C^-1 - C^-1 D (D^T C^-1 D)^-1 D^T C^-1        q = r^T P r
//! ```
//!
//! q measures how far the marks are from all such faces at any position, roll and size. The distance of mark i from the position that the
//! other marks predict is P_ii^-1 (P r)_i, with covariance P_ii^-1; this is leave-one-out without fitting again. Exchanging two marks
//! changes r in two entries only, so every pair is tried. Exchanges that hide each other are tried as a whole (`exchanges.rs`).

use nalgebra::{DMatrix, DVector, Matrix2, Matrix4, Point2, Vector2};

use super::{
    Correspondence, FitError, MEDIAN_OVER_DEVIATION, ShapePrior,
    exchanges::{self, Exchange},
    mirror_nodes,
};
use crate::{
    units::NodeId,
    wireframe::{Wireframe, mark_deviation},
};

/// Standard deviation of the modes of a prior in this check, over that in a fit.
const SHAPE_FACTOR: f64 = 1.2;
/// Standard deviation of a shape unit among people.
const SHAPE_UNIT: f64 = 0.3;
/// Standard deviation of an action unit: faces move, and mouths are open in frames called neutral.
const ACTION_UNIT: f64 = 0.12;
/// Standard deviation of the sine of yaw and pitch; 0.2 is 11 degrees.
const TURN: f64 = 0.2;
/// Standard deviation of a picture's aspect ratio, and of its shear.
const ASPECT: f64 = 0.08;
/// Standard deviation of any mark, model units: 2.4 % of the eye distance.
const MARK: f64 = 0.015;
/// Standard deviation of any mark, px: the limit of a small picture.
const MARK_PX: f64 = 1.5;
/// Standard deviation of a mark over its expected error, and over the tolerance of its feature among people who mark it
/// (`candide/markable_nodes.csv`): brows end where they are plucked, and hair hides ears.
const OWN_ERROR: f64 = 2.0;
/// Tolerance, over the eye distance, of a node that is not normally marked, as on forehead and cheeks.
const UNMARKED: f64 = 0.04;

/// Limits beyond which a mark counts as wrong: standard deviations from the position that the others predict, and distance over the eye
/// distance. Both limits of a pair must be exceeded. Chosen on 280 real faces with marks 2 px of 100 off, turned by up to 15 degrees, with
/// 3 to 52 marks; `tests/method/marks_of_strangers.rs` tests 370 faces and 15 mistakes.
const WRONG: [(f64, f64); 2] = [(3.2, 0.2), (2.3, 0.5)];
/// The same limits for a doubtful mark, which the user should check.
const DOUBTFUL: (f64, f64) = (2.0, 0.15);

/// Largest share of q that a better explanation may leave.
const EXPLAINED: f64 = 0.5;
/// Largest share of q that one of several exchanges may leave.
const STEP: f64 = 0.9;
/// Largest excess of q with which an upright, exchanged explanation is preferred to an upside-down face.
const AS_WELL: f64 = 12.0;
/// Roll beyond which a face is upside down, radians.
const UPSIDE_DOWN: f64 = std::f64::consts::FRAC_PI_2;
/// Distance of two nodes below which they are not used for size and roll, model units.
const LEAST_PAIR: f64 = 0.03;
/// Largest number of exchanged pairs.
const MOST_EXCHANGES: usize = 6;

/// A mark far from the position that the others predict.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stray {
    /// Index among the marks.
    pub index: usize,
    /// Position that the other marks predict, in the space of the marks.
    pub expected: Point2<f64>,
    /// Distance from there, in standard deviations.
    pub deviations: f64,
    /// Distance from there, over the eye distance.
    pub distance: f64,
}

impl Stray {
    pub(super) fn is_wrong(&self) -> bool {
        WRONG.iter().any(|&(deviations, distance)| self.deviations > deviations && self.distance > distance)
    }

    fn is_doubtful(&self) -> bool {
        self.deviations > DOUBTFUL.0 && self.distance > DOUBTFUL.1
    }
}

/// Model of the faces that marks can plausibly be on.
#[derive(Clone, Debug)]
pub(super) struct PlausibleFaces {
    mean: Vec<Point2<f64>>,
    /// Node offsets of each mode at one standard deviation.
    modes: Vec<Vec<Vector2<f64>>>,
    /// Standard deviation of each node in x and in y that no mode explains.
    residuals: Vec<f64>,
    /// Mirror image of every node; empty for a wireframe without one.
    mirror: Vec<usize>,
    /// Distance between the pupils, model units.
    eye_distance: f64,
}

impl PlausibleFaces {
    /// Creates faces around Candide's neutral and the given priors; skips priors with another number of nodes.
    pub(super) fn new(wireframe: &Wireframe, priors: &[ShapePrior], eye_distance: f64) -> Self {
        let count = wireframe.node_count();
        let frontal = wireframe.frontal();
        let priors: Vec<&ShapePrior> = priors.iter().filter(|p| p.mean.len() == count).collect();
        let shapes = priors.len() as f64 + 1.0;
        let sum = |k: usize| frontal[k].coords + priors.iter().map(|p| p.mean[k].coords).sum::<Vector2<f64>>();
        let mean: Vec<Point2<f64>> = (0..count).map(|k| Point2::from(sum(k) / shapes)).collect();
        let mut modes: Vec<Vec<Vector2<f64>>> = Vec::new();
        let mut units = |units: &[crate::wireframe::MotionUnit], deviation: f64| {
            for unit in units {
                let mut mode = vec![Vector2::zeros(); count];
                unit.offsets.iter().for_each(|(node, offset)| mode[node.index()] += offset.xy() * deviation);
                modes.push(mode);
            }
        };
        units(wireframe.shape_units(), SHAPE_UNIT);
        units(wireframe.action_units(), ACTION_UNIT);
        for prior in &priors {
            modes.push((0..count).map(|k| prior.mean[k] - frontal[k]).collect());
            for (mode, deviation) in prior.modes.iter().zip(&prior.deviations) {
                modes.push(mode.iter().map(|v| v * (*deviation * SHAPE_FACTOR)).collect());
            }
        }
        let vertices = wireframe.vertices();
        modes.push(vertices.iter().map(|v| Vector2::new(v.z, 0.0) * TURN).collect());
        modes.push(vertices.iter().map(|v| Vector2::new(0.0, v.z) * TURN).collect());
        modes.push(mean.iter().map(|p| Vector2::new(p.x, -p.y) * ASPECT).collect());
        modes.push(mean.iter().map(|p| Vector2::new(p.y, p.x) * ASPECT).collect());
        modes.retain(|mode| mode.iter().any(|v| *v != Vector2::zeros()));
        let feature = |k: usize| mark_deviation(NodeId(k as u16)).unwrap_or(UNMARKED);
        let residual = |k: usize| {
            let beside_modes = SHAPE_FACTOR * priors.iter().map(|p| p.residuals[k]).fold(0.0, f64::max);
            beside_modes.hypot(OWN_ERROR * feature(k) * eye_distance)
        };
        let residuals = (0..count).map(residual).collect();
        let mirror = mirror_nodes(wireframe).unwrap_or_default();
        Self { mean, modes, residuals, mirror, eye_distance }
    }

    /// Rejects marks that no face has, and returns the doubtful ones. `seen` are the positions of the marks, y up.
    ///
    /// # Errors
    /// [`FitError::Mirrored`], [`FitError::AxesExchanged`], [`FitError::YUpwards`], [`FitError::UpsideDown`], [`FitError::Exchanged`] or
    /// [`FitError::Outlier`].
    pub(super) fn check(&self, marks: &[Correspondence], seen: &[Point2<f64>]) -> Result<Vec<Stray>, FitError> {
        let nodes: Vec<NodeId> = marks.iter().map(|m| m.node).collect();
        let errors: Vec<f64> = marks.iter().map(|m| m.expected_error.unwrap_or(0.0) / MEDIAN_OVER_DEVIATION).collect();
        // The similarity fit rejects marks that do not determine a placement.
        let Some(measure) = Measure::of(self, &nodes, &errors, seen) else { return Ok(Vec::new()) };
        let Some(view) = measure.view(seen) else { return Ok(Vec::new()) };
        let strays = view.strays();
        let wrong = strays.iter().any(Stray::is_wrong);
        if let Some(exchange) = exchanges::find(&measure, &view, &nodes, &self.mirror, seen) {
            // A picture may show people lying on their side, but not mirrored.
            let on_its_side = || measure.view(&exchange.places(seen)).is_some_and(|view| view.lies_on_its_side());
            if exchange.mirrored && exchange.pairs.is_empty() && on_its_side() {
                return Err(FitError::AxesExchanged);
            }
            return Err(self.named(exchange, &nodes));
        }
        if wrong && let Some(pairs) = exchanges_by_steps(&measure, seen, &view) {
            return Err(self.named(Exchange { mirrored: false, below: false, pairs }, &nodes));
        }
        if let Some(roll) = view.upside_down() {
            // Marks on a line, such as corners of the eyes, can be upside down as well as exchanged; pictures are rarely upside down.
            let upright = exchanges::best(&measure, &nodes, &self.mirror, seen);
            if let Some((_, exchange)) = upright.filter(|(misfit, e)| !e.below && *misfit < view.misfit() + AS_WELL) {
                return Err(self.named(exchange, &nodes));
            }
            return Err(FitError::UpsideDown { degrees: roll.to_degrees() });
        }
        if wrong {
            return Err(self.outliers(marks, &errors, seen, &view));
        }
        Ok(strays.into_iter().filter(Stray::is_doubtful).collect())
    }

    fn named(&self, exchange: Exchange, nodes: &[NodeId]) -> FitError {
        let names =
            |pairs: Vec<(usize, usize)>| -> Vec<_> { pairs.into_iter().map(|(i, j)| in_order(nodes[i], nodes[j])).collect() };
        match exchange {
            Exchange { below: true, .. } => FitError::YUpwards,
            Exchange { mirrored: true, pairs, .. } => {
                // After left and right are exchanged, the remaining wrong marks are on the other side.
                let other = |node: NodeId| NodeId(self.mirror.get(node.index()).map_or(node.0, |&k| k as u16));
                let then = names(pairs).into_iter().map(|(a, b)| in_order(other(a), other(b))).collect();
                FitError::Mirrored { pairs: names(exchanges::sides(nodes, &self.mirror)), then }
            }
            Exchange { pairs, .. } => FitError::Exchanged { pairs: names(pairs) },
        }
    }

    /// Lists the marks to remove so that the rest is a plausible face, the worst first.
    fn outliers(&self, marks: &[Correspondence], errors: &[f64], seen: &[Point2<f64>], view: &View) -> FitError {
        let mut kept: Vec<usize> = (0..marks.len()).collect();
        let mut found: Vec<Stray> = Vec::new();
        let mut strays = view.strays();
        while kept.len() > super::MINIMUM_MARKS {
            let worst = strays.iter().filter(|s| s.is_wrong()).max_by(|a, b| a.deviations.total_cmp(&b.deviations));
            let Some(worst) = worst else { break };
            found.push(Stray { index: kept[worst.index], ..*worst });
            kept.remove(worst.index);
            let pick = |k: &usize| seen[*k];
            let nodes: Vec<_> = kept.iter().map(|&k| marks[k].node).collect();
            let own: Vec<_> = kept.iter().map(|&k| errors[k]).collect();
            let places: Vec<_> = kept.iter().map(pick).collect();
            let Some(measure) = Measure::of(self, &nodes, &own, &places) else { break };
            let Some(view) = measure.view(&places) else { break };
            strays = view.strays();
        }
        let Some(worst) = found.first() else { return FitError::TooFewMarks { found: marks.len() } };
        let mark = marks[worst.index];
        FitError::Outlier {
            node: mark.node,
            x: mark.position.x,
            y: mark.position.y,
            expected_x: worst.expected.x,
            expected_y: -worst.expected.y,
            percent: 100.0 * worst.distance,
            others: found.iter().skip(1).map(|s| marks[s.index].node).collect(),
        }
    }
}

/// Measures the distance of positions from all plausible faces, for a set of marks; independent of the assignment of positions to marks.
pub(super) struct Measure {
    /// The marked nodes of the mean face.
    mean: Vec<Point2<f64>>,
    /// P.
    weight: DMatrix<f64>,
    /// (D^T C^-1 D)^-1 D^T C^-1: maps residuals to a similarity.
    similarity: DMatrix<f64>,
    /// Standard deviation of the roll of a face of the mean's size, radians.
    roll_deviation: f64,
    eye_distance: f64,
}

impl Measure {
    /// Returns `None` when the marks do not determine a placement.
    fn of(faces: &PlausibleFaces, nodes: &[NodeId], errors: &[f64], seen: &[Point2<f64>]) -> Option<Self> {
        let mean: Vec<Point2<f64>> = nodes.iter().map(|n| faces.mean[n.index()]).collect();
        let (scale, _) = size_and_roll(&mean, seen)?;
        let rows = 2 * nodes.len();
        let modes = DMatrix::from_fn(rows, faces.modes.len(), |r, c| faces.modes[c][nodes[r / 2].index()][r % 2]);
        let mut covariance = &modes * modes.transpose();
        for (i, node) in nodes.iter().enumerate() {
            let own = OWN_ERROR * errors[i] / scale;
            let noise = MARK.powi(2) + (MARK_PX / scale).powi(2) + own.powi(2) + faces.residuals[node.index()].powi(2);
            covariance[(2 * i, 2 * i)] += noise;
            covariance[(2 * i + 1, 2 * i + 1)] += noise;
        }
        let inverse = covariance.cholesky()?.inverse();
        let about = centre(&mean);
        let design = DMatrix::from_fn(rows, 4, |r, c| {
            let p = mean[r / 2] - about;
            [[p.x, -p.y, 1.0, 0.0], [p.y, p.x, 0.0, 1.0]][r % 2][c]
        });
        let weighted = &inverse * &design;
        let normal = Matrix4::from_iterator((design.transpose() * &weighted).iter().copied());
        let free = normal.cholesky()?.inverse();
        let free = DMatrix::from_iterator(4, 4, free.iter().copied());
        let similarity = &free * weighted.transpose();
        let weight = &inverse - &weighted * &similarity;
        let roll_deviation = free[(1, 1)].max(0.0).sqrt();
        Some(Self { mean, weight, similarity, roll_deviation, eye_distance: faces.eye_distance })
    }

    /// Returns the view of marks at the given positions, y up; `None` when they coincide.
    pub(super) fn view(&self, seen: &[Point2<f64>]) -> Option<View<'_>> {
        let (scale, angle) = size_and_roll(&self.mean, seen)?;
        // Done twice: the roll found by the first view is removed from the second, so that its modes have the correct direction.
        let turned = self.turned(seen, scale, angle).roll.0;
        Some(self.turned(seen, scale, turned))
    }

    fn turned(&self, seen: &[Point2<f64>], scale: f64, angle: f64) -> View<'_> {
        let rotation = nalgebra::Rotation2::new(-angle);
        let (from, to) = (centre(seen), centre(&self.mean));
        let places: Vec<Point2<f64>> = seen.iter().map(|p| Point2::from(rotation * (p.coords - from) / scale + to)).collect();
        let residual = DVector::from_fn(2 * places.len(), |r, _| places[r / 2][r % 2] - self.mean[r / 2][r % 2]);
        let moved = &self.similarity * &residual;
        let size = (1.0 + moved[0]).hypot(moved[1]).max(f64::MIN_POSITIVE);
        let roll = (wrapped(angle + moved[1].atan2(1.0 + moved[0])), self.roll_deviation / size);
        let pull = &self.weight * &residual;
        View { measure: self, places, residual, pull, roll, scale, rotation, seen: seen.to_vec() }
    }
}

fn centre(points: &[Point2<f64>]) -> Vector2<f64> {
    points.iter().map(|p| p.coords).sum::<Vector2<f64>>() / points.len() as f64
}

/// Returns the exchanges after which no mark is wrong, the one that lowers q most first.
fn exchanges_by_steps(measure: &Measure, seen: &[Point2<f64>], view: &View) -> Option<Vec<(usize, usize)>> {
    let mut places = seen.to_vec();
    let mut pairs = Vec::new();
    let mut misfit = view.misfit();
    let mut pair = view.best_exchange();
    while let Some((i, j)) = pair {
        places.swap(i, j);
        let now = measure.view(&places)?;
        if now.misfit() > STEP * misfit || pairs.len() == MOST_EXCHANGES {
            return None;
        }
        pairs.push((i.min(j), i.max(j)));
        if now.misfit() < EXPLAINED * view.misfit() && now.strays().iter().all(|s| !s.is_wrong()) {
            return now.upside_down().is_none().then_some(pairs);
        }
        misfit = now.misfit();
        pair = now.best_exchange();
    }
    None
}

/// Marks at given positions compared with all plausible faces.
pub(super) struct View<'a> {
    measure: &'a Measure,
    /// Approximate positions of the marks in face space.
    places: Vec<Point2<f64>>,
    /// Residuals from the mean, alternating x and y of each mark.
    residual: DVector<f64>,
    /// P r.
    pull: DVector<f64>,
    /// Roll of the face and its standard deviation, radians.
    roll: (f64, f64),
    /// Px per model unit.
    scale: f64,
    rotation: nalgebra::Rotation2<f64>,
    seen: Vec<Point2<f64>>,
}

impl View<'_> {
    /// Returns q, the distance of the marks from every plausible face.
    pub(super) fn misfit(&self) -> f64 {
        self.residual.dot(&self.pull)
    }

    fn block(&self, i: usize, j: usize) -> Matrix2<f64> {
        self.measure.weight.fixed_view::<2, 2>(2 * i, 2 * j).into_owned()
    }

    fn pull_of(&self, i: usize) -> Vector2<f64> {
        Vector2::new(self.pull[2 * i], self.pull[2 * i + 1])
    }

    /// Returns the distance of every mark from the position that the others predict.
    pub(super) fn strays(&self) -> Vec<Stray> {
        let stray = |index: usize| {
            let pull = self.pull_of(index);
            // Three marks leave hardly any degrees of freedom after a similarity: such a mark could be anywhere.
            let inverse = self.block(index, index).try_inverse()?;
            let offset = inverse * pull;
            let deviations = pull.dot(&offset).max(0.0).sqrt();
            let expected = self.seen[index] - self.rotation.inverse() * offset * self.scale;
            let stray = Stray { index, expected, deviations, distance: offset.norm() / self.measure.eye_distance };
            (deviations.is_finite() && stray.distance.is_finite()).then_some(stray)
        };
        (0..self.places.len()).filter_map(stray).collect()
    }

    /// Returns the two marks whose exchange lowers q most; `None` when no exchange lowers it.
    fn best_exchange(&self) -> Option<(usize, usize)> {
        let mut best: Option<(f64, (usize, usize))> = None;
        for i in 0..self.places.len() {
            for j in i + 1..self.places.len() {
                let step = self.places[j] - self.places[i];
                let linear = step.dot(&(self.pull_of(i) - self.pull_of(j)));
                let cross = self.block(i, j);
                let square = step.dot(&((self.block(i, i) + self.block(j, j) - cross - cross.transpose()) * step));
                let change = 2.0 * linear + square;
                if change < best.map_or(0.0, |b| b.0) {
                    best = Some((change, (i, j)));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Whether the roll is nearer to a quarter turn than to none or a half turn.
    fn lies_on_its_side(&self) -> bool {
        self.roll.0.cos().abs() < std::f64::consts::FRAC_1_SQRT_2
    }

    /// Returns the roll, if the face is certainly upside down.
    pub(super) fn upside_down(&self) -> Option<f64> {
        let (roll, deviation) = self.roll;
        (roll.abs() - 2.0 * deviation > UPSIDE_DOWN).then_some(roll)
    }
}

/// Returns size (px per unit of `mean`) and roll of marks from all pairs of them: the median of the ratios of their distances, and the mean
/// rotation. Robust to a few wrong marks. `None` when the marks coincide.
fn size_and_roll(mean: &[Point2<f64>], seen: &[Point2<f64>]) -> Option<(f64, f64)> {
    let mut ratios = Vec::new();
    let (mut along, mut across) = (0.0, 0.0);
    for i in 0..mean.len() {
        for j in i + 1..mean.len() {
            let (from, to) = (mean[j] - mean[i], seen[j] - seen[i]);
            let (length, other) = (from.norm(), to.norm());
            if length > LEAST_PAIR && other > 0.0 {
                ratios.push(other / length);
                along += from.dot(&to) / other;
                across += from.perp(&to) / other;
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    let scale = *ratios.get(ratios.len() / 2)?;
    (scale.is_finite() && scale > 0.0).then(|| (scale, across.atan2(along)))
}

fn in_order(a: NodeId, b: NodeId) -> (NodeId, NodeId) {
    (a.min(b), a.max(b))
}

/// Wraps an angle to (-pi, pi].
fn wrapped(angle: f64) -> f64 {
    angle.sin().atan2(angle.cos())
}
