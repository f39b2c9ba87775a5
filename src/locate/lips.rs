//! Detects parted lips: the training data of the other stages has closed mouths, so they put the lower lip's inner edge on the teeth.
//!
//! Grey values are read along five lines across both lips, from above the upper one to below the lower one. One regression gives the
//! distance between the lips. If it exceeds that of nearly all closed mouths, a second regression gives the positions of all edges.

use super::{
    PUPILS,
    cells::{CellMap, Patch},
    linear::dot,
    picture::{Picture, View},
    points,
    shape::{Point, Shape, distance},
    stages::Placed,
};
use crate::units::NodeId;

/// Nodes of the lip edges on each line: upper lip's upper and lower edge, lower lip's upper and lower edge. Lines: the subject's left half,
/// the middle, the right half.
pub const LINES: [[NodeId; EDGES]; 3] = [
    [NodeId(79), NodeId(81), NodeId(83), NodeId(85)],
    [NodeId(7), NodeId(87), NodeId(40), NodeId(8)],
    [NodeId(80), NodeId(82), NodeId(84), NodeId(86)],
];

/// Number of lines that are read: those of [`LINES`], and one between each two.
const READ_LINES: usize = 2 * LINES.len() - 1;
/// Number of samples on a line, from before its start to after its end.
const PLACES: usize = 25;
const RANGE: (f32, f32) = (-0.3, 1.3);
/// Added to grey values before the logarithm: smaller differences of dark pixels are noise.
const DARK: f32 = 12.0;

/// Smallest eye distance, px, at which mouths are examined: on smaller faces a bright lower lip looks like teeth.
pub const LEAST_EYE_DISTANCE: f32 = 45.0;

/// Gradient cells around the middle of each line, and their weight relative to grey values.
const PATCH: Patch = Patch { size: 72.0, cell: 0.055, side: 6, blur: 2 };
const CELL_WEIGHT: f32 = 4.0;

/// Number of values of [`read_mouth`]: grey values, their differences, and cells.
pub const LENGTH: usize = READ_LINES * (2 * PLACES - 1 + PATCH.len());
/// Number of predicted values: the distance between the lips in the middle over the eye distance, then for each of [`LINES`] the positions
/// of its four edges on it, 0 at its start and 1 at its end as located.
pub const PREDICTED: usize = 1 + EDGES * LINES.len();
/// Number of edges on a line.
pub const EDGES: usize = 4;
/// Bounds of the predicted edge positions.
const BEYOND: (f32, f32) = (-0.5, 1.6);

/// Learned weights for lips.
#[derive(Clone, Debug, PartialEq)]
pub struct LipStage {
    /// Means of the values read.
    pub offset: Vec<f32>,
    /// [`PREDICTED`] rows of [`LENGTH`] weights; the first applies to all mouths, the others to open ones.
    pub weights: Vec<f32>,
    /// Means of the predicted values.
    pub base: Vec<f32>,
    /// Predicted distance from which lips are parted, over the eye distance.
    pub parted_from: f32,
    /// Median error of the edges of parted lips, over the eye distance.
    pub expected_error: f32,
}

/// Returns the indices in [`points()`] of the points of [`LINES`].
pub fn line_points() -> [[usize; EDGES]; LINES.len()] {
    LINES.map(|line| line.map(|node| points().iter().position(|p| p.node == Some(node)).unwrap_or_default()))
}

/// Returns start and end of each of [`LINES`].
fn ends(shape: &[Point]) -> [[Point; 2]; LINES.len()] {
    line_points().map(|[upper, _, _, lower]| [shape[upper], shape[lower]])
}

/// Returns the point at a share of the way from one point to another.
pub fn between(p: Point, q: Point, share: f32) -> Point {
    [p[0] + (q[0] - p[0]) * share, p[1] + (q[1] - p[1]) * share]
}

/// Returns the position of a point along the line from `start` to `end`: 0 at the start, 1 at the end.
fn along([start, end]: [Point; 2], p: Point) -> f32 {
    let (way, to) = ([end[0] - start[0], end[1] - start[1]], [p[0] - start[0], p[1] - start[1]]);
    (way[0] * to[0] + way[1] * to[1]) / (way[0] * way[0] + way[1] * way[1]).max(f32::MIN_POSITIVE)
}

/// Returns the values read at the mouth of a shape (pixels of the view). On each line, from the subject's left to the right: logarithms of
/// grey values with mean 0 and standard deviation 1 over all lines, twice their differences along the line, and gradient cells around its
/// middle. `mean` is the mean face.
fn read_mouth(view: View<'_>, mean: &[Point], shape: &[Point]) -> Vec<f32> {
    let ends = ends(shape);
    let line = |k: usize| {
        let (one, two) = (ends[k / 2], ends[k.div_ceil(2)]);
        [between(one[0], two[0], 0.5), between(one[1], two[1], 0.5)]
    };
    let step = (RANGE.1 - RANGE.0) / (PLACES - 1) as f32;
    let mut values = Vec::with_capacity(LENGTH);
    for [start, end] in (0..READ_LINES).map(line) {
        let scale = distance(start, end) * step;
        values.extend((0..PLACES).map(|i| (view.sample(between(start, end, RANGE.0 + step * i as f32), scale) + DARK).ln()));
    }
    let count = values.len() as f32;
    let average = values.iter().sum::<f32>() / count;
    let deviation = (values.iter().map(|v| (v - average).powi(2)).sum::<f32>() / count).sqrt().max(0.02);
    values.iter_mut().for_each(|v| *v = (*v - average) / deviation);
    let differences: Vec<f32> = values.chunks_exact(PLACES).flat_map(|l| l.windows(2).map(|p| 2.0 * (p[1] - p[0]))).collect();
    values.extend(differences);
    let placed = Placed::new(mean, shape);
    let middles: Vec<Point> = (0..READ_LINES).map(|k| placed.placement.invert(between(line(k)[0], line(k)[1], 0.5))).collect();
    let map = CellMap::new(view, placed.placement, &PATCH, &middles);
    let cells = values.len();
    middles.iter().for_each(|&p| map.describe(p, &PATCH, &mut values));
    values[cells..].iter_mut().for_each(|v| *v *= CELL_WEIGHT);
    values
}

/// Returns [`read_mouth`] of a picture and of its mirror image; `shape` is in pixels of the picture.
pub fn read_both(picture: &Picture, mean: &[Point], shape: &[Point]) -> [Vec<f32>; 2] {
    let mirror = picture.view(true);
    [read_mouth(picture.view(false), mean, shape), read_mouth(mirror, mean, &mirror.turn_shape(shape))]
}

/// Returns the target of the regressions for lips with known points: `shape` is located, `truth` is correct (pixels).
pub fn wanted(shape: &[Point], truth: &[Point]) -> [f32; PREDICTED] {
    let unit = distance(truth[PUPILS[0]], truth[PUPILS[1]]).max(f32::MIN_POSITIVE);
    let (ends, lines) = (ends(shape), line_points());
    let mut numbers = [0.0; PREDICTED];
    for (k, line) in lines.into_iter().enumerate() {
        for (edge, point) in line.into_iter().enumerate() {
            numbers[1 + EDGES * k + edge] = along(ends[k], truth[point]);
        }
    }
    let [_, upper, lower, _] = lines[1];
    numbers[0] = gap(truth[upper], truth[lower], ends[1]) / unit;
    numbers
}

/// Returns the signed distance between the inner edges along a line, px.
fn gap(upper: Point, lower: Point, line: [Point; 2]) -> f32 {
    (along(line, lower) - along(line, upper)) * distance(line[0], line[1])
}

impl LipStage {
    /// Returns the [`PREDICTED`] values for the values read.
    pub fn say(&self, read: &[f32]) -> [f32; PREDICTED] {
        let centred: Vec<f32> = read.iter().zip(&self.offset).map(|(v, o)| v - o).collect();
        let mut said = [0.0; PREDICTED];
        for ((number, row), base) in said.iter_mut().zip(self.weights.chunks_exact(LENGTH)).zip(&self.base) {
            *number = dot(row, &centred) + base;
        }
        said
    }

    /// Returns the edges of the lips (index among [`points()`], pixels of the picture) if they are parted. `shape` is in pixels of the
    /// picture, `mean` is the mean face.
    pub fn parted(&self, picture: &Picture, mean: &[Point], shape: &Shape) -> Option<Vec<(usize, Point)>> {
        if distance(shape[PUPILS[0]], shape[PUPILS[1]]) < LEAST_EYE_DISTANCE {
            return None;
        }
        let [plain, mirrored] = read_both(picture, mean, shape).map(|read| self.say(&read));
        if 0.5 * (plain[0] + mirrored[0]) < self.parted_from {
            return None;
        }
        let ends = ends(shape);
        let mut moved = Vec::with_capacity(EDGES * LINES.len());
        for (k, line) in line_points().into_iter().enumerate() {
            let other = LINES.len() - 1 - k;
            let [start, end] = ends[k];
            let mut above = BEYOND.0;
            for (edge, point) in line.into_iter().enumerate() {
                let said = 0.5 * (plain[1 + EDGES * k + edge] + mirrored[1 + EDGES * other + edge]);
                // Edges are kept in order from top to bottom.
                above = said.max(above).min(BEYOND.1);
                let step = above - along(ends[k], shape[point]);
                moved.push((point, [shape[point][0] + step * (end[0] - start[0]), shape[point][1] + step * (end[1] - start[1])]));
            }
        }
        Some(moved)
    }
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma};

    use super::*;
    use crate::modules::locate::picture::Picture;

    /// Lips of 40 px at x 80, 100 and 120, closed at y 60, the pupils 100 px apart.
    fn mouth() -> Shape {
        let mut shape = vec![[100.0, 10.0]; points().len()];
        (shape[PUPILS[0]], shape[PUPILS[1]]) = ([150.0, 0.0], [50.0, 0.0]);
        for ([upper, one, other, lower], x) in line_points().into_iter().zip([120.0, 100.0, 80.0]) {
            (shape[upper], shape[one], shape[other], shape[lower]) = ([x, 40.0], [x, 60.0], [x, 60.0], [x, 80.0]);
        }
        shape
    }

    /// The same with the pupils 1 apart.
    fn mean() -> Shape {
        mouth().iter().map(|p| [(p[0] - 100.0) / 100.0, p[1] / 100.0]).collect()
    }

    #[test]
    fn lines_are_read_alike_in_any_light_and_mirrored() {
        let paint = |factor: f32| {
            // Dark enough that nothing is clipped, and bright enough that the logarithm's constant has little effect.
            GrayImage::from_fn(200, 120, |x, y| Luma([((40.0 + (x / 2) as f32 + (y % 50) as f32) * factor) as u8]))
        };
        let (shape, mean) = (mouth(), mean());
        let [plain, brighter] = [1.0, 1.5].map(|f| read_mouth(Picture::new(&paint(f)).unwrap().view(false), &mean, &shape));
        assert_eq!(plain.len(), LENGTH);
        assert!(plain.iter().zip(&brighter).all(|(a, b)| (a - b).abs() < 0.15), "light goes");
        // The subject's left, the brighter side of the picture, comes first; mirrored, the other side is the left one.
        let [plain, mirrored] = read_both(&Picture::new(&paint(1.0)).unwrap(), &mean, &shape);
        let last = (READ_LINES - 1) * PLACES;
        assert!(plain[0] > plain[last] && mirrored[0] < mirrored[last], "{} {}", plain[0], mirrored[0]);
    }

    #[test]
    fn parted_lips_go_where_the_stage_says_and_closed_ones_stay() {
        let picture = Picture::new(&GrayImage::from_fn(200, 120, |x, y| Luma([(x + y) as u8]))).unwrap();
        let says = |gap: f32| LipStage {
            offset: vec![0.0; LENGTH],
            weights: vec![0.0; PREDICTED * LENGTH],
            // The subject's left half opens further down than the right one: the mean of both readings is between.
            base: vec![gap, 0.0, 0.4, 0.9, 1.1, 0.0, 0.5, 0.75, 1.0, 0.0, 0.4, 0.7, 0.9],
            parted_from: 0.05,
            expected_error: 0.01,
        };
        let shape = mouth();
        assert_eq!(says(0.04).parted(&picture, &mean(), &shape), None);
        let moved = says(0.06).parted(&picture, &mean(), &shape).unwrap();
        let [_, upper, lower, _] = line_points()[1];
        // 0.5 and 0.75 of the way from y 40 to y 80.
        assert!(moved.contains(&(upper, [100.0, 60.0])) && moved.contains(&(lower, [100.0, 70.0])), "{moved:?}");
        let [_, _, left_lower, _] = line_points()[0];
        let left = moved.iter().find(|(k, _)| *k == left_lower).unwrap().1;
        approx::assert_relative_eq!(left[1], 72.0, epsilon = 1e-3);
        assert_eq!(moved.len(), EDGES * LINES.len());
    }

    #[test]
    fn the_learning_target_is_the_position_of_the_truth_on_the_found_lines() {
        let (shape, mut truth) = (mouth(), mouth());
        let [_, upper, lower, _] = line_points()[1];
        (truth[upper], truth[lower]) = ([100.0, 58.0], [100.0, 68.0]);
        // 10 px of 100; 18 and 28 px of 40.
        let numbers = wanted(&shape, &truth);
        let side = [0.0, 0.5, 0.5, 1.0];
        for (number, value) in numbers.into_iter().zip([0.1].into_iter().chain(side).chain([0.0, 0.45, 0.7, 1.0]).chain(side)) {
            approx::assert_relative_eq!(number, value, epsilon = 1e-5);
        }
    }
}
