//! Alignment of the whole wireframe with the neutral frame, after the springs of each step. Ours, beyond KP.
//!
//! KLT from frame to frame drifts, and its square windows mix skin that moves differently on the two sides of a brow, a lid or a lip.
//! The skin between the nodes does not: the neutral frame's grey values move with the wireframe (see `surface`). So after the
//! springs every node i is corrected by a vector c such that the current frame, read through the moved wireframe, looks like the neutral one:
//!
//! ```text
//! min over c   sum_t g_t sum_p w_p (I(x_p(c)) - T_p - b_t)^2  +  sum_i c_i' (a F_i) c_i  +  s sum_edges |c_i - c_j|^2
//! ```
//!
//! t: triangles; p: samples of skin around the corners of a triangle; T: neutral grey value, I: current one; b: a triangle's change of
//! brightness, which is eliminated, so that light may change; w: nearness to a node, times Cauchy weights, so that teeth, wrinkles
//! and closing lids, which the neutral frame does not show, count little; g: gain over the triangle's remaining mismatch; F: the
//! force of the step on a tracked node (see `step`), so that a well tracked node stays where it was found unless the skin around it
//! knows better. Gauss-Newton, a few iterations from where the springs left the nodes. The answer is always measured from the
//! neutral frame, so errors do not add up over the frames. Triangles that are folded or turned edge-on are left out; eyeballs, which
//! do not move with the skin, take no part.

mod normal;
mod patch;
mod sampler;
mod surface;

use nalgebra::{Cholesky, DMatrix, DVector, Matrix2, Point2};
use serde::{Deserialize, Serialize};

use self::{
    normal::{Compared, MIN_SAMPLES, NormalEquations, mean_difference},
    patch::Reading,
    sampler::{Sample, Sampler},
    surface::{Quadratic, border, doubled_area, openings, quadratics},
};
use crate::{
    fit::Springs,
    robust::{MAD_TO_SIGMA, median},
    wireframe::Wireframe,
};

pub use patch::Patch;

/// Options of the alignment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlignOptions {
    /// Gain g of the grey values over the stiffness of a spring, counted per KLT window of skin; 0 leaves the alignment out.
    pub gain: f64,
    /// Weight a of the step's own forces.
    pub anchor: f64,
    /// Stiffness s of the springs on the correction.
    pub stiffness: f64,
    /// Standard deviation of the nearness weight around a node, over the eye distance.
    pub reach: f64,
    /// Standard deviation of the smoothing of both frames, px.
    pub smoothing: f64,
}

impl Default for AlignOptions {
    fn default() -> Self {
        Self { gain: 150.0, anchor: 0.15, stiffness: 5.0, reach: 0.07, smoothing: 0.3 }
    }
}

/// Most iterations.
const MAX_ITERATIONS: u32 = 4;

/// First iterations that make the matrix of the normal equations anew; the last, a small step by then, only the right side. With two the robust
/// weights swing.
const REBUILT: u32 = 3;

/// Correction in px that ends them.
const STEP_PX: f64 = 0.005;

/// A triangle whose area falls below this share of the neutral one is folded or turned away.
const MIN_AREA_SHARE: f64 = 0.25;

/// Weight of the step's force on the nodes of lids and lips: their windows hold what opens between them.
const OPENING_ANCHOR: f64 = 0.1;

/// Weight of the step's force on a node that was let go.
const RELEASED_ANCHOR: f64 = 1e3;

/// Scale of the Cauchy weights over the robust standard deviation of the grey differences, and its floor in grey levels.
const CAUCHY_SCALE: f64 = 2.5;
const SCALE_FLOOR: f64 = 1.0;

/// Keeps nodes that nothing holds where they are.
const REST_GAIN: f64 = 1e-6;

#[derive(Clone, Debug)]
struct Face {
    /// Places of the corners among the live nodes.
    corners: [usize; 3],
    /// Twice the signed area in the neutral frame.
    doubled_area: f64,
    motion: Quadratic,
    samples: Vec<Sample>,
}

/// The skin of the neutral frame.
#[derive(Clone, Debug)]
pub struct Template {
    faces: Vec<Face>,
    /// Neutral positions of the live nodes.
    neutral: Vec<Point2<f64>>,
    /// Weight of the step's force on each live node.
    anchors: Vec<f64>,
    /// Area of the tracker's window, squared px: the unit in which skin is counted.
    unit_area: f64,
}

impl Template {
    /// Samples the neutral frame. `nodes`: all N positions there; `loose`: places among the live nodes of those that do not move with the
    /// skin; `window`: side of the tracker's window, px; `eye_distance`: ES0, px.
    pub fn new(
        wireframe: &Wireframe,
        loose: &[usize],
        nodes: &[Point2<f64>],
        patch: &Patch,
        (window, eye_distance): (u32, f64),
        options: &AlignOptions,
    ) -> Self {
        let live = wireframe.live_nodes();
        let neutral: Vec<_> = live.iter().map(|n| nodes[n.index()]).collect();
        let place = |node| live.binary_search(&node).ok().filter(|i| !loose.contains(i));
        let triangles: Vec<[usize; 3]> = wireframe
            .triangles()
            .iter()
            .filter_map(|t| match t.map(place) {
                [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                _ => None,
            })
            .collect();
        let edges = border(&triangles);
        let mut anchors = vec![options.anchor; live.len()];
        openings(&neutral, &edges).into_iter().for_each(|i| anchors[i] *= OPENING_ANCHOR);
        let sampler = Sampler {
            patch,
            reach: options.reach * eye_distance,
            border: edges.iter().map(|&(a, b)| [neutral[a], neutral[b]]).collect(),
        };
        let motions = quadratics(&neutral, &triangles);
        let face = |(corners, motion): ([usize; 3], Quadratic)| {
            let points = corners.map(|i| neutral[i]);
            Face { corners, doubled_area: doubled_area(points), motion, samples: sampler.samples(points) }
        };
        let faces = triangles.into_iter().zip(motions).map(face).filter(|f| f.samples.len() >= MIN_SAMPLES).collect();
        Self { faces, neutral, anchors, unit_area: f64::from(window).powi(2) }
    }

    /// Lets a live node (by place) go from the neutral frame: from now on it stays where the step's force puts it.
    pub fn release(&mut self, place: usize) {
        if let Some(anchor) = self.anchors.get_mut(place) {
            *anchor = RELEASED_ANCHOR;
        }
    }

    /// The positions of the live nodes in the current frame, corrected. `start`: where they are before; `forces`: the step's force on
    /// each, zero where lost.
    pub fn align(
        &self,
        springs: &Springs,
        patch: &Patch,
        start: &[Point2<f64>],
        forces: &[Matrix2<f64>],
        options: &AlignOptions,
    ) -> Vec<Point2<f64>> {
        let mut ties = springs.laplacian() * options.stiffness;
        for (i, (force, anchor)) in forces.iter().zip(&self.anchors).enumerate() {
            let mut block = ties.fixed_view_mut::<2, 2>(2 * i, 2 * i);
            block += force * *anchor + Matrix2::identity() * REST_GAIN;
        }
        let mut correction = DVector::zeros(2 * start.len());
        let moved = |c: &DVector<f64>| -> Vec<_> { (0..start.len()).map(|i| start[i] + c.fixed_rows::<2>(2 * i)).collect() };
        let mut factor = None;
        for iteration in 0..MAX_ITERATIONS {
            let mut pull = -(&ties * &correction);
            let mut system = (iteration < REBUILT).then(|| ties.clone());
            self.add_skin(patch, &moved(&correction), options.gain, &mut pull, system.as_mut());
            factor = system.map_or(factor, Cholesky::new);
            let Some(factor) = &factor else { break };
            factor.solve_mut(&mut pull);
            if !pull.iter().all(|d| d.is_finite()) {
                break;
            }
            correction += &pull;
            if pull.amax() < STEP_PX {
                break;
            }
        }
        moved(&correction)
    }

    /// Adds the grey values' part of the normal equations, with the live nodes at `places`: the right side, and the matrix if asked.
    fn add_skin(
        &self,
        patch: &Patch,
        places: &[Point2<f64>],
        gain: f64,
        pull: &mut DVector<f64>,
        mut system: Option<&mut DMatrix<f64>>,
    ) {
        let compared: Vec<_> = self.faces.iter().map(|face| face.compare(patch, places, &self.neutral)).collect();
        let mut sizes = Vec::new();
        for list in &compared {
            let mean = mean_difference(list);
            sizes.extend(list.iter().map(|c| (c.difference - mean).abs()));
        }
        let scale = (median(&mut sizes).unwrap_or(0.0) * MAD_TO_SIGMA).max(SCALE_FLOOR) * CAUCHY_SCALE;
        for (face, list) in self.faces.iter().zip(&compared) {
            let Some(normal) = NormalEquations::new(list, scale, system.is_some()) else { continue };
            let density = face.doubled_area.abs() / 2.0 / face.samples.len() as f64;
            let gain = gain * density / (self.unit_area * normal.variance);
            normal.add_right(&face.motion, gain, pull);
            if let Some(system) = &mut system {
                normal.add_matrix(&face.motion, gain, system);
            }
        }
    }
}

impl Face {
    /// Reads the current frame at the samples, with the live nodes at `places`; nothing for a folded triangle.
    fn compare(&self, patch: &Patch, places: &[Point2<f64>], neutral: &[Point2<f64>]) -> Vec<Compared<'_>> {
        if doubled_area(self.corners.map(|i| places[i])) / self.doubled_area <= MIN_AREA_SHARE {
            return Vec::new();
        }
        let control = self.motion.values(|node| places[node] - neutral[node]).map(|d| [d.x as f32, d.y as f32]);
        let read = |sample: &'_ Sample| -> Option<Reading> {
            let mut at = sample.at;
            for (weight, displacement) in sample.weights.iter().zip(control) {
                at[0] += weight * displacement[0];
                at[1] += weight * displacement[1];
            }
            patch.read(at)
        };
        let compare = |sample| {
            let Reading { value, gradient } = read(sample)?;
            Some(Compared { difference: f64::from(value - sample.grey), gradient, sample })
        };
        self.samples.iter().filter_map(compare).collect()
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    const SIZE: usize = 260;

    /// A patch whose grey value at every pixel is that of a smooth pattern at the place the pixel came from.
    fn picture(source: impl Fn(Point2<f64>) -> Point2<f64>, change: impl Fn(f64) -> f64) -> Patch {
        let pattern =
            |p: Point2<f64>| 120.0 + 60.0 * (p.x * 0.45).sin() * (p.y * 0.4).cos() + 30.0 * (0.2 * p.x + 0.27 * p.y).sin();
        let value = |k: usize| change(pattern(source(Point2::new((k % SIZE) as f64, (k / SIZE) as f64)))) as f32;
        Patch { left: 0, top: 0, width: SIZE, height: SIZE, values: (0..SIZE * SIZE).map(value).collect() }
    }

    fn face(wireframe: &Wireframe) -> Vec<Point2<f64>> {
        wireframe.frontal().iter().map(|p| Point2::new(130.0 + 75.0 * p.x, 130.0 - 75.0 * p.y)).collect()
    }

    /// Largest distance of the aligned nodes from `truth`, from a start that is off by about a pixel, unevenly.
    fn worst(current: &Patch, truth: impl Fn(Point2<f64>) -> Point2<f64>) -> f64 {
        let wireframe = Wireframe::candide3();
        let (nodes, options) = (face(&wireframe), AlignOptions { stiffness: 0.1, ..AlignOptions::default() });
        let template = Template::new(&wireframe, &[], &nodes, &picture(|p| p, |v| v), (9, 46.0), &options);
        let live = wireframe.live_nodes();
        let truth: Vec<_> = live.iter().map(|n| truth(nodes[n.index()])).collect();
        let off = |(i, p): (usize, &Point2<f64>)| p + nalgebra::Vector2::new((i as f64).sin(), (i as f64 * 0.7).cos()) * 0.8;
        let start: Vec<_> = truth.iter().enumerate().map(off).collect();
        let aligned = template.align(&Springs::new(&wireframe), current, &start, &vec![Matrix2::zeros(); live.len()], &options);
        aligned.iter().zip(&truth).map(|(a, t)| (a - t).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn a_moved_and_stretched_picture_is_found_again() {
        let truth = |p: Point2<f64>| Point2::new(1.02 * p.x + 1.3, 0.98 * p.y + 2.1);
        let current = picture(|p| Point2::new((p.x - 1.3) / 1.02, (p.y - 2.1) / 0.98), |v| v);
        // Nodes at the outline see skin on one side only.
        let off = worst(&current, truth);
        assert!(off < 0.25, "{off} px");
    }

    #[test]
    fn a_change_of_brightness_moves_nothing() {
        let off = worst(&picture(|p| p, |v| v + 25.0), |p| p);
        assert!(off < 0.15, "{off} px");
    }

    #[test]
    fn without_texture_every_node_stays() {
        let wireframe = Wireframe::candide3();
        let (nodes, options) = (face(&wireframe), AlignOptions::default());
        let grey = picture(|p| p, |_| 90.0);
        let template = Template::new(&wireframe, &[], &nodes, &grey, (9, 46.0), &options);
        let start: Vec<_> = wireframe.live_nodes().iter().map(|n| nodes[n.index()]).collect();
        let aligned = template.align(&Springs::new(&wireframe), &grey, &start, &vec![Matrix2::identity(); start.len()], &options);
        for (a, s) in aligned.iter().zip(&start) {
            assert_relative_eq!(a, s, epsilon = 1e-9);
        }
    }

    #[test]
    fn a_face_outside_the_picture_stays() {
        let wireframe = Wireframe::candide3();
        let (nodes, options) = (face(&wireframe), AlignOptions::default());
        let template = Template::new(&wireframe, &[], &nodes, &picture(|p| p, |v| v), (9, 46.0), &options);
        let start: Vec<_> = wireframe.live_nodes().iter().map(|n| nodes[n.index()] + nalgebra::Vector2::new(1e4, 0.0)).collect();
        let small = Patch { left: 0, top: 0, width: 3, height: 3, values: vec![0.0; 9] };
        let aligned = template.align(&Springs::new(&wireframe), &small, &start, &vec![Matrix2::zeros(); start.len()], &options);
        assert_eq!(aligned, start);
    }
}
