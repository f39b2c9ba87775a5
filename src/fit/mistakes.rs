//! Marks that are wrong: exchanged, mirrored, upside down, or far from where the other marks expect them.
//!
//! The check asks whether any face could have its marks there. A face of this check is the mean of the known priors, moved by everything
//! that moves a mark without being a mistake, each with a generous deviation: shape units and learned modes, how
//! the priors' means differ, action units (a mouth open, eyes shut), a head turned by yaw and pitch, a picture of another aspect, and the
//! mark's own error. With the residuals r of the marks from the mean, their covariance C, and the similarities D of the mean,
//!
//! ```text
//! P = C^-1 - C^-1 D (D^T C^-1 D)^-1 D^T C^-1        q = r^T P r
//! ```
//!
//! q measures how far the marks are from all such faces at any place, roll and size. The other marks expect mark i at a distance of
//! P_ii^-1 (P r)_i, with the covariance P_ii^-1: that is the mark left out, without fitting again. Exchanging two marks changes r in two
//! places only, so that every pair is tried. Exchanges that hide each other are tried as wholes (`exchanges.rs`).

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

/// Standard deviation of the modes of a prior here, over that of a fit.
const SHAPE_FACTOR: f64 = 1.2;
/// Standard deviation of a shape unit among people.
const SHAPE_UNIT: f64 = 0.3;
/// Standard deviation of an action unit: people do not hold still, and mouths are open in frames called neutral.
const ACTION_UNIT: f64 = 0.12;
/// Standard deviation of the sine of yaw and pitch: 11 degrees.
const TURN: f64 = 0.2;
/// Standard deviation of the aspect of a picture, and of its shear.
const ASPECT: f64 = 0.08;
/// Standard deviation of any mark, model units: 2.4 % of the eye distance.
const MARK: f64 = 0.015;
/// Standard deviation of any mark, px: what a small picture allows.
const MARK_PX: f64 = 1.5;
/// Times its own expected error that a mark may be off, and times what its feature leaves open among people who mark it
/// (`candide/markable_nodes.csv`): brows end where somebody plucked them, and ears are behind hair.
const OWN_ERROR: f64 = 2.0;
/// What the feature leaves open at a node that nobody marks, as on forehead and cheeks, over the eye distance.
const UNMARKED: f64 = 0.04;

/// A mark is wrong that lies more standard deviations from where the others expect it than the first number, and further than the second,
/// over the eye distance. Chosen on 280 real faces with marks 2 px of 100 off, turned by up to 15 degrees, of every number from 3 to 52;
/// `tests/method/marks_of_strangers.rs` holds 370 faces and 15 mistakes to it.
const WRONG: [(f64, f64); 2] = [(3.2, 0.2), (2.3, 0.5)];
/// The same for a mark that should be looked at.
const DOUBTFUL: (f64, f64) = (2.0, 0.15);

/// Share of the marks' distance q that a better explanation may leave.
const EXPLAINED: f64 = 0.5;
/// Share that one of several exchanges may leave.
const STEP: f64 = 0.9;
/// How much greater q may be of marks that are upside down as they are named, and mirrored stand upright.
const AS_WELL: f64 = 12.0;
/// Roll at which a face stands upside down, radians.
const UPSIDE_DOWN: f64 = std::f64::consts::FRAC_PI_2;
/// Distance of two nodes under which they say nothing about size and roll, model units.
const LEAST_PAIR: f64 = 0.03;
/// Exchanged pairs that are looked for.
const MOST_EXCHANGES: usize = 6;

/// A mark far from where the others expect it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stray {
    /// Place among the marks.
    pub index: usize,
    /// Where the other marks expect it, in the space of the marks.
    pub expected: Point2<f64>,
    /// Distance from there in standard deviations.
    pub deviations: f64,
    /// The same over the eye distance.
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

/// What faces the marks could be on.
#[derive(Clone, Debug)]
pub(super) struct PlausibleFaces {
    mean: Vec<Point2<f64>>,
    /// Node offsets at one standard deviation.
    modes: Vec<Vec<Vector2<f64>>>,
    /// Standard deviation of each node in x and in y that no mode holds.
    residuals: Vec<f64>,
    /// The mirror image of every node; empty for a wireframe that has none.
    mirror: Vec<usize>,
    /// Distance of the pupils, model units.
    eye_distance: f64,
}

impl PlausibleFaces {
    /// Faces around Candide's neutral and the given priors; those over another number of nodes are passed over.
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

    /// Refuses marks that no face has, and gives those that should be looked at. `seen` are the marks' places, y up.
    ///
    /// # Errors
    /// [`FitError::Mirrored`], [`FitError::AxesExchanged`], [`FitError::YUpwards`], [`FitError::UpsideDown`], [`FitError::Exchanged`] or [`FitError::Outlier`].
    pub(super) fn check(&self, marks: &[Correspondence], seen: &[Point2<f64>]) -> Result<Vec<Stray>, FitError> {
        let nodes: Vec<NodeId> = marks.iter().map(|m| m.node).collect();
        let errors: Vec<f64> = marks.iter().map(|m| m.expected_error.unwrap_or(0.0) / MEDIAN_OVER_DEVIATION).collect();
        // Marks that place nothing are the similarity's to refuse.
        let Some(measure) = Measure::of(self, &nodes, &errors, seen) else { return Ok(Vec::new()) };
        let Some(view) = measure.view(seen) else { return Ok(Vec::new()) };
        let strays = view.strays();
        let wrong = strays.iter().any(Stray::is_wrong);
        if let Some(exchange) = exchanges::find(&measure, &view, &nodes, &self.mirror, seen) {
            // People lie on their side as they are, and not in the mirror.
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
            // Marks on a line, as corners of the eyes, are as well upside down as exchanged; pictures are seldom upside down.
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
                // Once left and right are exchanged, what is wrong beside that is wrong on the other side.
                let other = |node: NodeId| NodeId(self.mirror.get(node.index()).map_or(node.0, |&k| k as u16));
                let then = names(pairs).into_iter().map(|(a, b)| in_order(other(a), other(b))).collect();
                FitError::Mirrored { pairs: names(exchanges::sides(nodes, &self.mirror)), then }
            }
            Exchange { pairs, .. } => FitError::Exchanged { pairs: names(pairs) },
        }
    }

    /// The marks without which the others are those of a face, the worst first; the worst alone where there are no such.
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

/// How far places of the same marks are from all plausible faces: what does not depend on which mark lies where.
pub(super) struct Measure {
    /// The marked nodes of the mean face.
    mean: Vec<Point2<f64>>,
    /// P.
    weight: DMatrix<f64>,
    /// (D^T C^-1 D)^-1 D^T C^-1: what similarity residuals ask for.
    similarity: DMatrix<f64>,
    /// Standard deviation of the roll of a face of the mean's size, radians.
    roll_deviation: f64,
    eye_distance: f64,
}

impl Measure {
    /// `None` when the marks place nothing.
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

    /// The marks at such places, y up; `None` when they coincide.
    pub(super) fn view(&self, seen: &[Point2<f64>]) -> Option<View<'_>> {
        let (scale, angle) = size_and_roll(&self.mean, seen)?;
        // Twice: the roll that the first view finds is taken out of the second, whose modes then lie as they should.
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

/// The exchanges after which no mark is wrong, the most telling first.
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

/// Marks at their places against all plausible faces.
pub(super) struct View<'a> {
    measure: &'a Measure,
    /// Places of the marks in face space, roughly.
    places: Vec<Point2<f64>>,
    /// Residuals from the mean, x and y of each mark in turn.
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
    /// q: how far the marks are from every plausible face.
    pub(super) fn misfit(&self) -> f64 {
        self.residual.dot(&self.pull)
    }

    fn block(&self, i: usize, j: usize) -> Matrix2<f64> {
        self.measure.weight.fixed_view::<2, 2>(2 * i, 2 * j).into_owned()
    }

    fn pull_of(&self, i: usize) -> Vector2<f64> {
        Vector2::new(self.pull[2 * i], self.pull[2 * i + 1])
    }

    /// How far every mark is from where the others expect it.
    pub(super) fn strays(&self) -> Vec<Stray> {
        let stray = |index: usize| {
            let pull = self.pull_of(index);
            // Three marks and a similarity leave hardly anything over: such a mark could be anywhere.
            let inverse = self.block(index, index).try_inverse()?;
            let offset = inverse * pull;
            let deviations = pull.dot(&offset).max(0.0).sqrt();
            let expected = self.seen[index] - self.rotation.inverse() * offset * self.scale;
            let stray = Stray { index, expected, deviations, distance: offset.norm() / self.measure.eye_distance };
            (deviations.is_finite() && stray.distance.is_finite()).then_some(stray)
        };
        (0..self.places.len()).filter_map(stray).collect()
    }

    /// The two marks whose exchange lowers the misfit most; `None` when no exchange lowers it.
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

    /// Whether its roll is nearer to a quarter of a turn than to none or half of one.
    fn lies_on_its_side(&self) -> bool {
        self.roll.0.cos().abs() < std::f64::consts::FRAC_1_SQRT_2
    }

    /// The roll of a face that surely stands upside down.
    pub(super) fn upside_down(&self) -> Option<f64> {
        let (roll, deviation) = self.roll;
        (roll.abs() - 2.0 * deviation > UPSIDE_DOWN).then_some(roll)
    }
}

/// Size (px per unit of `mean`) and roll of marks, from all pairs of them: the median of the ratios of their distances, and the mean
/// turn. A few wrong marks change neither much. `None` when the marks coincide.
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

/// An angle in (-pi, pi].
fn wrapped(angle: f64) -> f64 {
    angle.sin().atan2(angle.cos())
}
