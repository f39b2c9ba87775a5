//! Proposes faces: a linear template over gradient cells, applied to the picture at many sizes.

use super::{
    cells::{Cell, DIRECTIONS, gradients},
    linear::product,
    picture::View,
    shape::{Placement, Point, distance},
};
use crate::simd::widest;

/// Eye distance, px, at which the template is applied.
pub const EYE_DISTANCE: f32 = 20.0;

/// Side of a cell, px.
pub const CELL: usize = 4;

/// Cells across.
pub const COLUMNS: usize = 10;
/// Cells down.
pub const ROWS: usize = 12;

/// Upper left corner of the template, canonical.
pub const CORNER: Point = [-1.0, -0.8];

/// Number of weights of a template.
pub const LENGTH: usize = COLUMNS * ROWS * DIRECTIONS;

/// Ratio of successive sizes.
const STEP: f32 = 1.15;

/// Two candidates closer than this share of the eye distance, and of sizes within [`SAME_SIZE`], count as one.
const SAME_PLACE: f32 = 0.3;
const SAME_SIZE: f32 = 1.35;

/// A linear template with high scores at probable faces.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// Row by row of cells, [`DIRECTIONS`] numbers each.
    pub weights: Vec<f32>,
    /// Constant added to the score.
    pub bias: f32,
}

/// A probable face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Maps canonical coordinates to pixels of the view.
    pub placement: Placement,
    /// The template's score.
    pub score: f32,
}

/// Cells of a picture, normalized by their neighbours.
#[derive(Debug)]
pub struct Grid {
    /// Cells across.
    pub columns: usize,
    /// Cells down.
    pub rows: usize,
    /// Row by row.
    pub cells: Vec<f32>,
}

impl Grid {
    /// Computes the cells of grey values, row by row, without incomplete cells at the right and lower border.
    pub fn new(values: &[f32], width: usize, height: usize) -> Self {
        widest(
            #[inline(always)]
            || Self::read(values, width, height),
        )
    }

    #[inline(always)]
    fn read(values: &[f32], width: usize, height: usize) -> Self {
        let pixels = gradients(values, width, height);
        let (columns, rows) = (width / CELL, height / CELL);
        let mut sums = vec![[0.0_f32; DIRECTIONS]; columns * rows];
        for y in 0..rows * CELL {
            let row = &pixels[y * width..][..columns * CELL];
            for (cell, block) in sums[y / CELL * columns..][..columns].iter_mut().zip(row.chunks_exact(CELL)) {
                for pixel in block {
                    for d in 0..DIRECTIONS {
                        cell[d] += pixel[d];
                    }
                }
            }
        }
        let energy: Vec<f32> = sums.iter().map(|c| c.iter().map(|v| v * v).sum()).collect();
        let around = |x: usize, y: usize| -> f32 {
            let (left, right) = (x.saturating_sub(1), (x + 1).min(columns - 1));
            (y.saturating_sub(1)..=(y + 1).min(rows - 1))
                .map(|r| energy[r * columns + left..=r * columns + right].iter().sum::<f32>())
                .sum()
        };
        let mut cells = Vec::with_capacity(sums.len() * DIRECTIONS);
        for y in 0..rows {
            for x in 0..columns {
                let share = 1.0 / (around(x, y) + 0.05).sqrt();
                let cell: &Cell = &sums[y * columns + x];
                cells.extend(cell.map(|v| (v * share).min(0.5).sqrt()));
            }
        }
        Self { columns, rows, cells }
    }

    /// Returns the cells under a template at a column and row.
    pub fn window(&self, column: usize, row: usize) -> Vec<f32> {
        let rows = (row..row + ROWS).map(|r| &self.cells[(r * self.columns + column) * DIRECTIONS..][..COLUMNS * DIRECTIONS]);
        rows.flatten().copied().collect()
    }

    /// Returns the columns and rows at which a template fits into the grid.
    pub fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (columns, rows) = ((self.columns + 1).saturating_sub(COLUMNS), (self.rows + 1).saturating_sub(ROWS));
        (0..rows).flat_map(move |r| (0..columns).map(move |c| (c, r)))
    }

    #[inline(always)]
    fn score(&self, column: usize, row: usize, template: &Template) -> f32 {
        let mut score = 0.0;
        for (k, weights) in template.weights.chunks_exact(COLUMNS * DIRECTIONS).enumerate() {
            score += product(weights, &self.cells[((row + k) * self.columns + column) * DIRECTIONS..][..weights.len()]);
        }
        score + template.bias
    }
}

/// Returns the placement of a face for a template at a column and row of a grid. `to_view` maps the grid's pixels to the view.
pub fn placement_of(column: usize, row: usize, to_view: Placement) -> Placement {
    let middle = |cells: usize, corner: f32| (cells * CELL) as f32 - 0.5 - corner * EYE_DISTANCE;
    let at = to_view.apply([middle(column, CORNER[0]), middle(row, CORNER[1])]);
    Placement { a: to_view.a * EYE_DISTANCE, b: to_view.b * EYE_DISTANCE, x: at[0], y: at[1] }
}

/// Range of faces to search for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Smallest and largest eye distance, px.
    pub eye_distance: (f32, f32),
    /// Rotation of the head, radians.
    pub angle: f32,
    /// Largest number of candidates.
    pub most: usize,
}

/// Applies a template to a view of `width` x `height` pixels at all sizes of a search; returns the positions with the highest scores, best
/// first.
pub fn candidates(view: View<'_>, size: (usize, usize), template: &Template, search: &Search) -> Vec<Candidate> {
    best(&scored(view, size, template, search), search.most)
}

/// Returns the scores of a template at all positions of a search, best first.
pub fn scored(view: View<'_>, (width, height): (usize, usize), template: &Template, search: &Search) -> Vec<Candidate> {
    let (w, h) = (width as f32, height as f32);
    let (cos, sin) = (search.angle.cos(), search.angle.sin());
    // Size of the rotated grid that covers the picture.
    let (wide, high) = (w * cos.abs() + h * sin.abs(), w * sin.abs() + h * cos.abs());
    let mut found = Vec::new();
    let mut size = search.eye_distance.0;
    while size <= search.eye_distance.1 {
        let f = size / EYE_DISTANCE;
        // Faces may extend beyond the border by half an eye distance.
        let margin = 0.5 * EYE_DISTANCE;
        let (columns, rows) = ((wide / f + 2.0 * margin) as usize, (high / f + 2.0 * margin) as usize);
        let (a, b) = (f * cos, f * sin);
        let middle = [columns as f32 * 0.5, rows as f32 * 0.5];
        let to_view =
            Placement { a, b, x: w * 0.5 - (a * middle[0] - b * middle[1]), y: h * 0.5 - (b * middle[0] + a * middle[1]) };
        widest(
            #[inline(always)]
            || {
                let grid = Grid::read(&view.warp(to_view, columns, rows), columns, rows);
                for (c, r) in grid.places() {
                    found.push(Candidate { placement: placement_of(c, r, to_view), score: grid.score(c, r, template) });
                }
            },
        );
        size *= STEP;
    }
    best_first(found)
}

/// Sorts candidates by score, the highest first.
pub fn best_first(mut found: Vec<Candidate>) -> Vec<Candidate> {
    found.sort_by(|p, q| q.score.total_cmp(&p.score));
    found
}

/// Returns the first candidates, at most `most`, without duplicates.
pub fn best(found: &[Candidate], most: usize) -> Vec<Candidate> {
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in found {
        if kept.len() >= most {
            break;
        }
        if !kept.iter().any(|k| alike(k.placement, candidate.placement)) {
            kept.push(*candidate);
        }
    }
    kept
}

/// Whether two placements belong to the same face.
pub fn alike(p: Placement, q: Placement) -> bool {
    let (s, t) = (p.scale(), q.scale());
    distance([p.x, p.y], [q.x, q.y]) < SAME_PLACE * s.max(t) && s.max(t) < SAME_SIZE * s.min(t)
}
