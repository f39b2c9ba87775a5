//! Gradients in eight directions, blurred into cells, and descriptors of the cells around a point.

use super::{
    picture::View,
    shape::{Placement, Point},
};
use crate::simd::widest;

/// Directions of gradients, 45 degrees apart.
pub const DIRECTIONS: usize = 8;

/// Gradient strength for each direction.
pub type Cell = [f32; DIRECTIONS];

/// Added to grey values before the logarithm: smaller differences of dark pixels are noise.
const DARK: f32 = 12.0;

const DIAGONAL: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Cosine and sine of the first four directions; the other four are opposite to them.
const TURNS: [[f32; 2]; 4] = [[1.0, 0.0], [DIAGONAL, DIAGONAL], [0.0, 1.0], [-DIAGONAL, DIAGONAL]];

/// Geometry of a descriptor around a point: `side` x `side` cells, `cell` eye distances apart, at `size` px between the pupils, blurred
/// twice by a box of 2 `blur` + 1 px.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Patch {
    /// Scale of the picture: px between the pupils.
    pub size: f32,
    /// Distance between cells, over the eye distance.
    pub cell: f32,
    /// Number of cells across and down.
    pub side: usize,
    /// Half width of the blur, px.
    pub blur: usize,
}

impl Patch {
    /// Returns the number of values per point.
    pub const fn len(&self) -> usize {
        self.side * self.side * DIRECTIONS
    }
}

/// Returns gradients of grey values by direction: the strength times the cube of the cosine to each direction, none below 0.
#[inline(always)]
pub fn gradients(values: &[f32], width: usize, height: usize) -> Vec<Cell> {
    let logs: Vec<f32> = values.iter().map(|v| (v + DARK).ln()).collect();
    let mut cells = vec![[0.0; DIRECTIONS]; width * height];
    if width < 3 || height < 3 {
        return cells;
    }
    for y in 1..height - 1 {
        let (above, row, below) =
            (&logs[(y - 1) * width..][..width], &logs[y * width..][..width], &logs[(y + 1) * width..][..width]);
        let out = &mut cells[y * width..][..width];
        for x in 1..width - 1 {
            let (gx, gy) = (row[x + 1] - row[x - 1], below[x] - above[x]);
            let square = gx * gx + gy * gy + 1e-12;
            let cell = &mut out[x];
            for (k, [c, s]) in TURNS.into_iter().enumerate() {
                let along = gx * c + gy * s;
                let strength = along * along * along / square;
                cell[k] = strength.max(0.0);
                cell[k + 4] = (-strength).max(0.0);
            }
        }
    }
    cells
}

/// Replaces cells by means over 2 `radius` + 1 cells along lines: `count` lines of `length` cells, `step` apart within a line, `next`
/// between lines.
#[inline(always)]
fn blur_lines(cells: &mut [Cell], buffer: &mut Vec<Cell>, lines: (usize, usize), line: (usize, usize), radius: usize) {
    let ((count, next), (length, step)) = (lines, line);
    let share = 1.0 / (2 * radius + 1) as f32;
    for k in 0..count {
        buffer.clear();
        buffer.extend((0..length).map(|i| cells[k * next + i * step]));
        let mut sum = [0.0_f32; DIRECTIONS];
        for cell in buffer.iter().take(radius.min(length)) {
            for d in 0..DIRECTIONS {
                sum[d] += cell[d];
            }
        }
        for i in 0..length {
            if let Some(cell) = buffer.get(i + radius) {
                for d in 0..DIRECTIONS {
                    sum[d] += cell[d];
                }
            }
            let out = &mut cells[k * next + i * step];
            for d in 0..DIRECTIONS {
                out[d] = sum[d] * share;
            }
            if i >= radius {
                let cell = &buffer[i - radius];
                for d in 0..DIRECTIONS {
                    sum[d] -= cell[d];
                }
            }
        }
    }
}

/// Gradient cells of a face in the canonical frame.
#[derive(Debug)]
pub struct CellMap {
    width: usize,
    height: usize,
    size: f32,
    corner: Point,
    cells: Vec<Cell>,
}

impl CellMap {
    /// Reads the part of a view that contains `points` (canonical) and their patches. `placement` maps the canonical frame to pixels of the
    /// view.
    pub fn new(view: View<'_>, placement: Placement, patch: &Patch, points: &[Point]) -> Self {
        widest(
            #[inline(always)]
            || Self::read(view, placement, patch, points),
        )
    }

    #[inline(always)]
    fn read(view: View<'_>, placement: Placement, patch: &Patch, points: &[Point]) -> Self {
        let margin = patch.cell * patch.side as f32 * 0.5 + (2 * patch.blur + 2) as f32 / patch.size;
        // Bounds the picture when points diverge.
        let bound = |low: f32, high: f32| (low.clamp(-1.7, 1.7) - margin, high.clamp(-1.7, 2.6) + margin);
        let range = |axis: usize| {
            let (low, high) = points.iter().fold((f32::MAX, f32::MIN), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
            if low <= high { bound(low, high) } else { bound(0.0, 0.0) }
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        let (width, height) =
            (((right - left) * patch.size).ceil() as usize + 1, ((bottom - top) * patch.size).ceil() as usize + 1);
        let corner = placement.apply([left, top]);
        let step = Placement { a: placement.a / patch.size, b: placement.b / patch.size, x: corner[0], y: corner[1] };
        let mut cells = gradients(&view.warp(step, width, height), width, height);
        let (mut buffer, mut blurred) = (Vec::new(), vec![[0.0; DIRECTIONS]; cells.len()]);
        for _ in 0..2 {
            blur_lines(&mut cells, &mut buffer, (height, width), (width, 1), patch.blur);
            blur_columns(&cells, &mut blurred, width, height, patch.blur);
            std::mem::swap(&mut cells, &mut blurred);
        }
        Self { width, height, size: patch.size, corner: [left, top], cells }
    }

    /// Appends the descriptor of a canonical point: the cells around it, normalized, clipped, normalized again, square roots.
    pub fn describe(&self, at: Point, patch: &Patch, out: &mut Vec<f32>) {
        widest(
            #[inline(always)]
            || self.append(at, patch, out),
        );
    }

    #[inline(always)]
    fn append(&self, at: Point, patch: &Patch, out: &mut Vec<f32>) {
        let start = out.len();
        let half = (patch.side as f32 - 1.0) * 0.5;
        for row in 0..patch.side {
            for column in 0..patch.side {
                let x = (at[0] + (column as f32 - half) * patch.cell - self.corner[0]) * self.size;
                let y = (at[1] + (row as f32 - half) * patch.cell - self.corner[1]) * self.size;
                out.extend(self.sample(x, y));
            }
        }
        normalize(&mut out[start..]);
    }

    #[inline(always)]
    fn sample(&self, x: f32, y: f32) -> Cell {
        let (x, y) = (x.clamp(0.0, (self.width - 1) as f32 - 0.01), y.clamp(0.0, (self.height - 1) as f32 - 0.01));
        let (left, top) = (x as usize, y as usize);
        let (fx, fy) = (x - left as f32, y - top as f32);
        let at = top * self.width + left;
        let (p, q, r, s) = (&self.cells[at], &self.cells[at + 1], &self.cells[at + self.width], &self.cells[at + self.width + 1]);
        std::array::from_fn(|d| (p[d] * (1.0 - fx) + q[d] * fx) * (1.0 - fy) + (r[d] * (1.0 - fx) + s[d] * fx) * fy)
    }
}

/// Adds a row of cells to sums, times `sign`.
#[inline(always)]
fn add(sums: &mut [Cell], row: &[Cell], sign: f32) {
    for (sum, cell) in sums.iter_mut().zip(row) {
        for d in 0..DIRECTIONS {
            sum[d] += sign * cell[d];
        }
    }
}

/// Same as [`blur_lines`] down the columns, one row at a time.
#[inline(always)]
fn blur_columns(source: &[Cell], out: &mut [Cell], width: usize, height: usize, radius: usize) {
    let share = 1.0 / (2 * radius + 1) as f32;
    let mut sums = vec![[0.0_f32; DIRECTIONS]; width];
    let row = |y: usize| &source[y * width..][..width];
    for y in 0..radius.min(height) {
        add(&mut sums, row(y), 1.0);
    }
    for y in 0..height {
        if y + radius < height {
            add(&mut sums, row(y + radius), 1.0);
        }
        for (cell, sum) in out[y * width..][..width].iter_mut().zip(&sums) {
            for d in 0..DIRECTIONS {
                cell[d] = sum[d] * share;
            }
        }
        if y >= radius {
            add(&mut sums, row(y - radius), -1.0);
        }
    }
}

/// Normalizes to length 1, clips at a quarter, normalizes again approximately, and takes square roots: removes light and contrast.
#[inline(always)]
pub fn normalize(values: &mut [f32]) {
    let length = |values: &[f32]| values.iter().map(|v| v * v).sum::<f32>().sqrt();
    let floor = 2e-3 * (values.len() as f32).sqrt();
    let first = 1.0 / (length(values) + floor);
    values.iter_mut().for_each(|v| *v = (*v * first).clamp(0.0, 0.25));
    let second = 1.0 / (length(values) + 0.1);
    values.iter_mut().for_each(|v| *v = (*v * second).sqrt());
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::{super::picture::Picture, *};

    #[test]
    fn an_edge_has_one_direction() {
        // Dark left, bright right: the gradient points along x, direction 0; neighbours at 45 degrees get the cube of their cosine.
        let values: Vec<f32> = (0..25).map(|k| if k % 5 < 2 { 20.0 } else { 200.0 }).collect();
        let cells = gradients(&values, 5, 5);
        let cell = cells[2 * 5 + 2];
        let strength = (212.0_f32 / 32.0).ln();
        approx::assert_relative_eq!(cell[0], strength, epsilon = 1e-4);
        approx::assert_relative_eq!(cell[1], strength * DIAGONAL.powi(3), epsilon = 1e-4);
        approx::assert_relative_eq!(cell[7], strength * DIAGONAL.powi(3), epsilon = 1e-4);
        approx::assert_relative_eq!(cell[4], 0.0, epsilon = 1e-4);
    }

    #[test]
    fn blurs_keep_sums_and_are_alike_along_and_down() {
        let mut along = vec![[0.0; DIRECTIONS]; 49];
        along[24] = [9.0; DIRECTIONS];
        let mut down = along.clone();
        blur_lines(&mut along, &mut Vec::new(), (7, 7), (7, 1), 1);
        blur_columns(&down.clone(), &mut down, 7, 7, 1);
        assert_eq!([along[22][0], along[23][0], along[24][0], along[25][0]], [0.0, 3.0, 3.0, 3.0]);
        assert_eq!([down[10][3], down[17][3], down[24][3], down[31][3]], [0.0, 3.0, 3.0, 3.0]);
    }

    #[test]
    fn the_strength_of_the_light_does_not_matter() {
        let image = |low: u8, high: u8| {
            Picture::new(&GrayImage::from_fn(64, 64, |x, y| image::Luma([if (x / 9 + y / 7) % 2 == 0 { low } else { high }])))
                .unwrap()
        };
        let patch = Patch { size: 24.0, cell: 0.2, side: 4, blur: 1 };
        let read = |picture: &Picture| {
            let map = CellMap::new(picture.view(false), Placement::new([32.0, 32.0], 24.0, 0.0), &patch, &[[0.0, 0.0]]);
            let mut values = Vec::new();
            map.describe([0.0, 0.0], &patch, &mut values);
            values
        };
        // Grey values plus DARK are 42 and 212, and half of that: logarithms differ by a constant, gradients not at all.
        let (strong, weak) = (read(&image(30, 200)), read(&image(9, 94)));
        assert_eq!(strong.len(), patch.len());
        strong.iter().zip(&weak).for_each(|(s, w)| approx::assert_relative_eq!(s, w, epsilon = 1e-3));
    }
}
