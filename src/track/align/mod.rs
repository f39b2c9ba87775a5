//! Aligns the whole wireframe with the neutral frame, after the springs of each step. This is not part of KP.
//!
//! KLT from frame to frame drifts, and its square windows mix skin that moves differently on the two sides of a brow, a lid or a lip. Here
//! the neutral frame's grey values move with the wireframe (see `surface`). After the springs, every node i is corrected by a vector c such
//! that the current frame, read through the moved wireframe, looks like the neutral one:
//!
//! ```text
//! min over c   sum_t g_t sum_p w_p (I(x_p(c)) - T_p - b_t)^2  +  sum_i c_i' (a F_i) c_i  +  s sum_edges |c_i - c_j|^2
//!              +  q sum_corners |(x_i + c_i) - (x_o + c_o) - S (X_i - X_o)|^2
//! ```
//!
//! t: triangles; p: samples of skin around the corners of a triangle; T: neutral grey value, I: current one; b: change of brightness of a
//! triangle, which is eliminated, so that light may change; w: nearness to a node, times Cauchy weights, so that teeth, wrinkles and
//! closing lids, which the neutral frame does not show, have little weight; g: gain over the triangle's remaining mismatch; F: the force of
//! the step on a tracked node (see `step`), which keeps a well-tracked node in its position unless the skin around it contradicts. The
//! minimum is found by a few Gauss-Newton iterations from the positions after the springs. Displacements are always measured from the
//! neutral frame, so errors do not add up over the frames. Folded triangles and those turned edge-on are left out, and so are eyeballs,
//! which do not move with the skin.
//!
//! i and o: inner and outer node of a corner of the mouth, X in the neutral frame, x after the springs; S: scale and roll of the face since
//! the neutral frame. Where lips part, no texture marks the inner corner; on real faces it moves with the outer one to within 2 % of the
//! eye distance. Candide's mouth opens differently (its corner 89 moves by itself), so simulated mouths are tracked slightly worse with
//! this term: q is a compromise.

mod normal;
mod patch;
mod sampler;
mod surface;

use std::{collections::BTreeSet, sync::Arc};

use nalgebra::{Matrix2, Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::SkinMatch;

use self::{
    normal::{Compared, MIN_SAMPLES, Mean, NormalEquations, Sums, places},
    patch::{LANES, add, times, total},
    sampler::{Group, Sampler},
    surface::{Quadratic, Shares, border, doubled_area, openings, quadratics},
};
use crate::{
    fit::{BlockPlaces, Layout, Skyline, Springs},
    geometry::Similarity,
    robust::{MAD_TO_SIGMA, median},
    simd::widest,
    units::NodeId,
    wireframe::Wireframe,
};

pub use patch::Patch;

/// Options of the alignment.
///
/// ```
/// use grimace::track::{AlignOptions, TrackOptions};
///
/// let without = AlignOptions { gain: 0.0, ..AlignOptions::default() };
/// let options = TrackOptions { align: without, ..TrackOptions::default() };
/// assert_eq!((options.align.gain, options.align.reach), (0.0, 0.07));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AlignOptions {
    /// Gain g of the grey values over the stiffness of a spring, per KLT window of skin; 0 disables the alignment.
    pub gain: f64,
    /// Weight a of the step's own forces.
    pub anchor: f64,
    /// Stiffness s of the springs on the correction.
    pub stiffness: f64,
    /// Standard deviation of the nearness weight around a node, over the eye distance.
    pub reach: f64,
    /// Standard deviation of the smoothing of both frames, px.
    pub smoothing: f64,
    /// Stiffness q of the springs that hold each inner corner of the mouth to the outer one; 0 disables them.
    pub corners: f64,
}

impl Default for AlignOptions {
    fn default() -> Self {
        Self { gain: 150.0, anchor: 0.15, stiffness: 5.0, reach: 0.07, smoothing: 0.3, corners: 25.0 }
    }
}

/// Largest number of iterations.
const MAX_ITERATIONS: u32 = 4;

/// Number of first iterations that use every other sample only; later ones correct the difference.
const COARSE: u32 = 2;

/// Number of first iterations that rebuild the matrix of the normal equations. The next iteration rebuilds it only after a step of more
/// than this many px; the last one computes the right side only.
const REBUILT: u32 = 2;
const FAR_PX: f64 = 0.5;

/// Iterations end when the next step is expected to be below this, px, from the ratio of the last two steps.
const STEP_PX: f64 = 0.01;

/// A triangle whose area falls below this share of its neutral area counts as folded or turned away.
const MIN_AREA_SHARE: f64 = 0.25;

/// Weight of the step's force on the nodes of lids and lips, whose windows include the opening between them.
const OPENING_ANCHOR: f64 = 0.1;

/// Weight of the step's force on a released node.
const RELEASED_ANCHOR: f64 = 1e3;

/// Scale of the Cauchy weights over the robust standard deviation of the grey differences, and its floor in grey levels.
const CAUCHY_SCALE: f64 = 2.5;
const SCALE_FLOOR: f64 = 1.0;

/// Indices in a group of the grey differences used for the scale: their median needs no more.
const SCALED: [usize; 2] = [0, 4];

/// Sum of the weights of samples from which the skin around a node says something about it.
const MIN_SKIN: f64 = 0.5;

/// Small gain that fixes nodes that nothing else holds.
const REST_GAIN: f64 = 1e-6;

/// Springs of a wireframe in the layout of the alignment's system: skin couples the nodes of a triangle and their neighbours.
#[derive(Clone, Debug)]
pub struct Ties {
    springs: Skyline,
    /// Indices of the mouth's corners among the live nodes, each outer before inner.
    corners: Vec<[usize; 2]>,
}

impl Ties {
    /// Creates the ties of a wireframe with its springs. `corners`: outer and inner corners of the mouth.
    pub fn new(wireframe: &Wireframe, springs: &Springs, corners: &[[NodeId; 2]]) -> Self {
        let live = wireframe.live_nodes();
        let place = |node| live.binary_search(&node).ok();
        let triangles = wireframe.triangles().iter().filter_map(|t| Some([place(t[0])?, place(t[1])?, place(t[2])?]));
        let triangles: Vec<[usize; 3]> = triangles.collect();
        let mut rings = vec![BTreeSet::new(); live.len()];
        triangles.iter().for_each(|t| t.iter().for_each(|node| rings[*node].extend(t)));
        let edges = wireframe.edges().iter().filter_map(|&(a, b)| Some(vec![place(a)?, place(b)?]));
        let coupled = triangles.iter().map(|t| t.iter().flat_map(|node| rings[*node].iter().copied()).collect());
        let corners: Vec<_> = corners.iter().filter_map(|&[outer, inner]| Some([place(outer)?, place(inner)?])).collect();
        let held = corners.iter().map(|pair| pair.to_vec());
        Self { springs: springs.laplacian(&Arc::new(Layout::new(live.len(), coupled.chain(edges).chain(held)))), corners }
    }
}

#[derive(Clone, Debug)]
struct Face {
    /// Indices of the corners among the live nodes.
    corners: [usize; 3],
    /// Twice the signed area in the neutral frame.
    doubled_area: f64,
    motion: Quadratic,
    /// Weights of its nodes, in groups of four.
    shares: Vec<Shares>,
    /// Positions of its nodes' blocks in the system.
    places: Vec<BlockPlaces>,
    /// Samples in groups, and their number.
    groups: Vec<Group>,
    count: usize,
    /// Number of groups and samples of the coarse subset.
    coarse: (usize, usize),
}

/// Skin of the neutral frame.
#[derive(Clone, Debug)]
pub struct Template {
    faces: Vec<Face>,
    /// Neutral positions of the live nodes.
    neutral: Vec<Point2<f64>>,
    /// Weight of the step's force on each live node.
    anchors: Vec<f64>,
    /// Area of the tracker's window, squared px: the unit of skin area.
    unit_area: f64,
    ties: Ties,
    room: Room,
}

/// Buffers that are reused from one alignment to the next.
#[derive(Clone, Debug)]
struct Room {
    /// Matrix without the grey values, and with them.
    ties: Skyline,
    system: Skyline,
    pull: Vec<Vector2<f64>>,
    /// Compared samples, group by group, and the means over each triangle.
    compared: Vec<Compared>,
    means: Vec<Mean>,
    sizes: Vec<f64>,
    sums: Sums,
    levels: Vec<[[f64; 4]; 2]>,
}

impl Template {
    /// Samples the neutral frame. `ties`: those of the wireframe; `nodes`: all N positions there; `loose`: indices, among the live nodes,
    /// of those that do not move with the skin; `window`: side of the tracker's window, px; `eye_distance`: ES0, px.
    pub fn new(
        wireframe: &Wireframe,
        ties: &Ties,
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
            let places = places(&motion, ties.springs.layout());
            let (samples, first) = sampler.samples(points);
            // Padded to whole groups.
            let (groups, count): (Vec<_>, _) = (samples.chunks(LANES).map(Group::new).collect(), samples.len());
            let first = first.div_ceil(LANES);
            let coarse = (first, count.min(first * LANES));
            let shares = motion.shares();
            Face { corners, doubled_area: doubled_area(points), motion, shares, places, groups, count, coarse }
        };
        let faces: Vec<Face> = triangles.into_iter().zip(motions).map(face).filter(|f| f.count >= MIN_SAMPLES).collect();
        let room = Room {
            ties: ties.springs.clone(),
            system: ties.springs.clone(),
            pull: vec![Vector2::zeros(); live.len()],
            compared: vec![Compared::default(); faces.iter().map(|face| face.groups.len()).sum()],
            means: Vec::new(),
            sizes: Vec::new(),
            sums: Sums::default(),
            levels: Vec::new(),
        };
        Self { faces, neutral, anchors, unit_area: f64::from(window).powi(2), ties: ties.clone(), room }
    }

    /// Releases a live node (by index) from the neutral frame: from now on it stays where the step's force puts it.
    pub fn release(&mut self, place: usize) {
        if let Some(anchor) = self.anchors.get_mut(place) {
            *anchor = RELEASED_ANCHOR;
        }
    }

    /// Returns corrected positions of the live nodes in the current frame, and how the skin around each looks there beside the neutral
    /// frame; `None` for nodes without skin. `start`: uncorrected positions; `forces`: the step's force on each node, zero if lost.
    pub fn align(
        &mut self,
        patch: &Patch,
        start: &[Point2<f64>],
        forces: &[Matrix2<f64>],
        options: &AlignOptions,
    ) -> Vec<(Point2<f64>, Option<SkinMatch>)> {
        widest(
            #[inline(always)]
            || self.aligned(patch, start, forces, options),
        )
    }

    #[inline(always)]
    fn aligned(
        &mut self,
        patch: &Patch,
        start: &[Point2<f64>],
        forces: &[Matrix2<f64>],
        options: &AlignOptions,
    ) -> Vec<(Point2<f64>, Option<SkinMatch>)> {
        self.room.ties.scaled_from(&self.ties.springs, options.stiffness);
        for (i, (force, anchor)) in forces.iter().zip(&self.anchors).enumerate() {
            self.room.ties.add_diagonal(i, &(force * *anchor + Matrix2::identity() * REST_GAIN));
        }
        let mut correction = vec![Vector2::zeros(); start.len()];
        let held = self.hold_corners(start, options.corners);
        let mut places = start.to_vec();
        let mut last = 0.0;
        let mut coarse = true;
        for iteration in 0..MAX_ITERATIONS {
            let with_matrix = iteration < REBUILT || (iteration == REBUILT && last > FAR_PX);
            coarse = iteration < COARSE;
            self.room.ties.times(&correction, &mut self.room.pull);
            self.room.pull.iter_mut().for_each(|pull| *pull = -*pull);
            held.iter().for_each(|(place, force)| self.room.pull[*place] += force);
            if with_matrix {
                self.room.system.copy_from(&self.room.ties);
            }
            self.add_skin(patch, &places, options.gain, (with_matrix, coarse));
            let Room { system, pull, .. } = &mut self.room;
            if with_matrix && !system.factor() {
                break;
            }
            system.solve(pull);
            if !pull.iter().all(|d| d.x.is_finite() && d.y.is_finite()) {
                break;
            }
            correction.iter_mut().zip(&*pull).for_each(|(correction, step)| *correction += step);
            places.iter_mut().zip(start.iter().zip(&correction)).for_each(|(place, (start, c))| *place = start + c);
            let step = pull.iter().map(Vector2::amax).fold(0.0, f64::max);
            if !coarse && (step < STEP_PX || step * step < STEP_PX * last) {
                break;
            }
            last = step;
        }
        places.into_iter().zip(self.skin(coarse)).collect()
    }

    /// Returns how the skin around each live node looked in the last comparison with the neutral frame, which was over all samples or the
    /// coarse subset. A sample counts for the corners of its triangle by their weights in its motion.
    #[inline(always)]
    fn skin(&self, coarse: bool) -> Vec<Option<SkinMatch>> {
        // Nearness, and grey difference and gradient weighed by it.
        let mut sums = vec![[0.0_f64; 3]; self.neutral.len()];
        let mut rest = self.room.compared.as_slice();
        for (face, mean) in self.faces.iter().zip(&self.room.means) {
            let (groups, _) = face.looked_at(coarse);
            let (list, behind) = rest.split_at(groups.len());
            rest = behind;
            if mean.count < MIN_SAMPLES {
                continue;
            }
            let level = mean.difference as f32;
            let mut of_corners = [[[0.0; LANES]; 3]; 3];
            for (group, [differences, gx, gy, inside]) in groups.iter().zip(list) {
                let mut values = [[0.0; LANES]; 3];
                for k in 0..LANES {
                    values[0][k] = group.nearness[k] * inside[k];
                    values[1][k] = values[0][k] * (differences[k] - level).abs();
                    values[2][k] = values[0][k] * (gx[k] * gx[k] + gy[k] * gy[k]).sqrt();
                }
                for (weights, sums) in group.weights.iter().zip(&mut of_corners) {
                    values.iter().zip(sums).for_each(|(values, sum)| add(sum, &times(weights, values)));
                }
            }
            for (corner, of_corner) in face.corners.into_iter().zip(&of_corners) {
                sums[corner].iter_mut().zip(of_corner).for_each(|(sum, lanes)| *sum += f64::from(total(lanes)));
            }
        }
        let of = |[weight, difference, gradient]: [f64; 3]| {
            (weight > MIN_SKIN).then(|| SkinMatch { difference: difference / weight, gradient: gradient / weight })
        };
        sums.into_iter().map(of).collect()
    }

    /// Adds the springs of the mouth's corners to the system and returns their forces with the nodes they act on. `start`: positions of the
    /// live nodes.
    fn hold_corners(&mut self, start: &[Point2<f64>], stiffness: f64) -> Vec<(usize, Vector2<f64>)> {
        let Ok(face) = Similarity::fit(&self.neutral, start, None) else { return Vec::new() };
        let mut forces = Vec::new();
        for &[outer, inner] in &self.ties.corners {
            self.room.ties.add_spring([outer, inner], stiffness);
            let offset = face.apply_vector(&(self.neutral[inner] - self.neutral[outer]));
            let force = (offset - (start[inner] - start[outer])) * stiffness;
            forces.extend([(outer, -force), (inner, force)]);
        }
        forces
    }

    /// Adds the grey values' part of the normal equations for live nodes at `places`: the right side, and optionally the matrix, over all
    /// samples or the coarse subset.
    #[inline(always)]
    fn add_skin(&mut self, patch: &Patch, places: &[Point2<f64>], gain: f64, (with_matrix, coarse): (bool, bool)) {
        let Room { system, pull, compared, means, sizes, sums, levels, .. } = &mut self.room;
        means.clear();
        sizes.clear();
        let mut rest = compared.as_mut_slice();
        for face in &self.faces {
            let (groups, _) = face.looked_at(coarse);
            let (list, behind) = rest.split_at_mut(groups.len());
            rest = behind;
            let mean = face.compare(patch, groups, places, &self.neutral, list);
            if mean.count > 0 {
                for [differences, .., inside] in &*list {
                    let counted = SCALED.into_iter().filter(|k| inside[*k] > 0.0);
                    sizes.extend(counted.map(|k| (f64::from(differences[k]) - mean.difference).abs()));
                }
            }
            means.push(mean);
        }
        let scale = (median(sizes).unwrap_or(0.0) * MAD_TO_SIGMA).max(SCALE_FLOOR) * CAUCHY_SCALE;
        let mut rest = compared.as_slice();
        for (face, mean) in self.faces.iter().zip(&*means) {
            let (groups, count) = face.looked_at(coarse);
            let (list, behind) = rest.split_at(groups.len());
            rest = behind;
            let Some(normal) = NormalEquations::new(groups, (list, mean), scale, with_matrix, sums) else { continue };
            let density = face.doubled_area.abs() / 2.0 / count as f64;
            let gain = gain * density / (self.unit_area * normal.variance);
            normal.add_right(&face.motion, gain, pull);
            normal.add_matrix(&face.motion, &face.shares, &face.places, gain, levels, system);
        }
    }
}

impl Face {
    /// Returns the coarse subset of the samples, or all of them, and their number.
    #[inline(always)]
    fn looked_at(&self, coarse: bool) -> (&[Group], usize) {
        if coarse { (&self.groups[..self.coarse.0], self.coarse.1) } else { (&self.groups, self.count) }
    }

    /// Reads the current frame at the samples, with the live nodes at `places`; nothing for a folded triangle.
    #[inline(always)]
    fn compare(
        &self,
        patch: &Patch,
        groups: &[Group],
        places: &[Point2<f64>],
        neutral: &[Point2<f64>],
        out: &mut [Compared],
    ) -> Mean {
        if doubled_area(self.corners.map(|i| places[i])) / self.doubled_area <= MIN_AREA_SHARE {
            return Mean::default();
        }
        let control = self.motion.values(|node| places[node] - neutral[node]).map(|d| [d.x as f32, d.y as f32]);
        let (mut sums, mut counts) = ([0.0; LANES], [0.0; LANES]);
        for (group, out) in groups.iter().zip(out) {
            *out = patch.read(&group.moved(&control));
            for k in 0..LANES {
                out[0][k] -= group.grey[k] * out[3][k];
                sums[k] += out[0][k];
                counts[k] += out[3][k];
            }
        }
        let count = total(&counts);
        Mean { difference: f64::from(total(&sums) / count.max(1.0)), count: count as usize }
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    const SIZE: usize = 260;

    /// A patch whose grey value at every pixel is that of a smooth pattern at the pixel's original position.
    fn picture(source: impl Fn(Point2<f64>) -> Point2<f64>, change: impl Fn(f64) -> f64) -> Patch {
        let pattern =
            |p: Point2<f64>| 120.0 + 60.0 * (p.x * 0.45).sin() * (p.y * 0.4).cos() + 30.0 * (0.2 * p.x + 0.27 * p.y).sin();
        let value = |k: usize| change(pattern(source(Point2::new((k % SIZE) as f64, (k / SIZE) as f64)))) as f32;
        Patch { left: 0, top: 0, width: SIZE, height: SIZE, values: (0..SIZE * SIZE).map(value).collect() }
    }

    fn face(wireframe: &Wireframe) -> Vec<Point2<f64>> {
        wireframe.frontal().iter().map(|p| Point2::new(130.0 + 75.0 * p.x, 130.0 - 75.0 * p.y)).collect()
    }

    fn template(wireframe: &Wireframe, nodes: &[Point2<f64>], patch: &Patch, options: &AlignOptions) -> Template {
        Template::new(wireframe, &Ties::new(wireframe, &Springs::new(wireframe), &[]), &[], nodes, patch, (9, 46.0), options)
    }

    /// Largest distance of the aligned nodes from `truth`, from a start that is off by about a pixel, unevenly.
    fn worst(current: &Patch, truth: impl Fn(Point2<f64>) -> Point2<f64>) -> f64 {
        let wireframe = Wireframe::candide3();
        let (nodes, options) = (face(&wireframe), AlignOptions { stiffness: 0.1, ..AlignOptions::default() });
        let mut template = template(&wireframe, &nodes, &picture(|p| p, |v| v), &options);
        let live = wireframe.live_nodes();
        let truth: Vec<_> = live.iter().map(|n| truth(nodes[n.index()])).collect();
        let off = |(i, p): (usize, &Point2<f64>)| p + nalgebra::Vector2::new((i as f64).sin(), (i as f64 * 0.7).cos()) * 0.8;
        let start: Vec<_> = truth.iter().enumerate().map(off).collect();
        let aligned = template.align(current, &start, &vec![Matrix2::zeros(); live.len()], &options);
        aligned.iter().zip(&truth).map(|((a, _), t)| (a - t).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn a_moved_and_stretched_picture_is_found_again() {
        let truth = |p: Point2<f64>| Point2::new(1.02 * p.x + 1.3, 0.98 * p.y + 2.1);
        let current = picture(|p| Point2::new((p.x - 1.3) / 1.02, (p.y - 2.1) / 0.98), |v| v);
        // Nodes at the outline have skin on one side only.
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
        let mut template = template(&wireframe, &nodes, &grey, &options);
        let start: Vec<_> = wireframe.live_nodes().iter().map(|n| nodes[n.index()]).collect();
        let aligned = template.align(&grey, &start, &vec![Matrix2::identity(); start.len()], &options);
        for ((a, _), s) in aligned.iter().zip(&start) {
            assert_relative_eq!(a, s, epsilon = 1e-9);
        }
    }

    #[test]
    fn a_face_outside_the_picture_stays() {
        let wireframe = Wireframe::candide3();
        let (nodes, options) = (face(&wireframe), AlignOptions::default());
        let mut template = template(&wireframe, &nodes, &picture(|p| p, |v| v), &options);
        let start: Vec<_> = wireframe.live_nodes().iter().map(|n| nodes[n.index()] + nalgebra::Vector2::new(1e4, 0.0)).collect();
        let small = Patch { left: 0, top: 0, width: 3, height: 3, values: vec![0.0; 9] };
        let aligned = template.align(&small, &start, &vec![Matrix2::zeros(); start.len()], &options);
        assert_eq!(aligned, start.into_iter().map(|place| (place, None)).collect::<Vec<_>>());
    }

    #[test]
    fn skin_that_was_left_behind_looks_unlike_the_neutral_frame() {
        let wireframe = Wireframe::candide3();
        let (nodes, options) = (face(&wireframe), AlignOptions::default());
        let mut template = template(&wireframe, &nodes, &picture(|p| p, |v| v), &options);
        let start: Vec<_> = wireframe.live_nodes().iter().map(|n| nodes[n.index()]).collect();
        // So strong a force holds every node in its place.
        let held = vec![Matrix2::identity() * 1e9; start.len()];
        let mut skin = |current: &Patch| -> Vec<SkinMatch> {
            template.align(current, &start, &held, &options).into_iter().filter_map(|(_, skin)| skin).collect()
        };
        let seen = skin(&picture(|p| p, |v| v + 12.0));
        assert!(seen.len() > 80 && seen.iter().all(|skin| skin.difference < 1e-3 && skin.gradient > 5.0), "{}", seen.len());
        let left = skin(&picture(|p| p - Vector2::new(0.0, 1.0), |v| v));
        let mut offsets: Vec<f64> = left.iter().map(SkinMatch::offset_px).collect();
        let middle = median(&mut offsets).unwrap();
        assert!((0.3..1.1).contains(&middle), "{middle} px for one px");
    }

    #[test]
    fn inner_corners_of_the_mouth_go_with_the_outer_ones() {
        let wireframe = Wireframe::candide3();
        let nodes = face(&wireframe);
        let [outer, inner] = [64, 89].map(NodeId);
        let ties = Ties::new(&wireframe, &Springs::new(&wireframe), &[[outer, inner]]);
        let place = |node| wireframe.live_nodes().binary_search(&node).unwrap();
        let flat = picture(|p| p, |_| 100.0);
        // The face is a tenth larger, and the corner 5 px off: in flat skin only the corner springs correct that.
        let start = |n: &NodeId| nodes[n.index()] * 1.1 + if *n == inner { Vector2::new(5.0, 0.0) } else { Vector2::zeros() };
        let start: Vec<_> = wireframe.live_nodes().iter().map(start).collect();
        let off = |corners| {
            let options = AlignOptions { corners, ..AlignOptions::default() };
            let mut template = Template::new(&wireframe, &ties, &[], &nodes, &flat, (9, 46.0), &options);
            let aligned = template.align(&flat, &start, &vec![Matrix2::zeros(); start.len()], &options);
            let aligned: Vec<_> = aligned.into_iter().map(|(place, _)| place).collect();
            let offset = (nodes[inner.index()] - nodes[outer.index()]) * 1.1;
            (aligned[place(inner)] - aligned[place(outer)] - offset).x
        };
        assert_relative_eq!(off(0.0), 5.0, epsilon = 1e-6);
        assert!(off(1e6).abs() < 0.02, "{}", off(1e6));
        assert!((0.5..4.0).contains(&off(25.0)), "{}", off(25.0));
    }
}
