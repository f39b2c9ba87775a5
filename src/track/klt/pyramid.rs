//! Image pyramids. Every level is half the size of the previous one, smoothed by 1 4 6 4 1 in both directions, with a border of mirrored
//! pixels so that windows may reach beyond the image.

use crate::simd::widest;

/// Width of the border beyond the largest window, px.
const SLACK: i32 = 12;

/// One level.
#[derive(Clone, Debug, Default)]
pub struct Level {
    pub width: i32,
    pub height: i32,
    border: i32,
    stride: usize,
    pixels: Vec<u8>,
}

/// Maps a coordinate outside the image to the mirrored one inside; the outermost pixels do not repeat.
fn mirrored(at: i32, size: i32) -> i32 {
    if size <= 1 {
        return 0;
    }
    let period = 2 * (size - 1);
    let at = at.rem_euclid(period);
    if at < size { at } else { period - at }
}

impl Level {
    /// Resizes the level, keeping its memory; pixels are undefined until filled.
    fn reshape(&mut self, width: i32, height: i32, border: i32) {
        (self.width, self.height, self.border) = (width, height, border);
        self.stride = (width + 2 * border) as usize;
        self.pixels.resize(self.stride * (height + 2 * border) as usize, 0);
    }

    fn offset(&self, x: i32, y: i32) -> usize {
        (y + self.border) as usize * self.stride + (x + self.border) as usize
    }

    /// Returns `count` pixels of a row from `x` on; both may reach into the border.
    pub fn row(&self, x: i32, y: i32, count: usize) -> &[u8] {
        let at = self.offset(x, y);
        &self.pixels[at..at + count]
    }

    /// Fills the border from the image.
    fn mirror(&mut self) {
        let (width, height, border) = (self.width, self.height, self.border);
        // The same in every row: source pixels of the left and the right border.
        let sources = |from: i32| (from..from + border).map(|x| (mirrored(x, width) + border) as usize).collect::<Vec<_>>();
        let (left, right) = (sources(-border), sources(width));
        let begin = self.offset(-border, 0);
        for row in self.pixels[begin..].chunks_exact_mut(self.stride.max(1)).take(height as usize) {
            left.iter().enumerate().for_each(|(k, from)| row[k] = row[*from]);
            right.iter().enumerate().for_each(|(k, from)| row[(border + width) as usize + k] = row[*from]);
        }
        for y in (-border..0).chain(height..height + border) {
            let (from, to) = (self.offset(-border, mirrored(y, height)), self.offset(-border, y));
            self.pixels.copy_within(from..from + self.stride, to);
        }
    }

    /// Fills the bottom level.
    fn fill_from(&mut self, pixels: &[u8], width: i32, height: i32, border: i32) {
        self.reshape(width, height, border);
        for (y, row) in (0..height).zip(pixels.chunks_exact(width.max(1) as usize)) {
            let at = self.offset(0, y);
            self.pixels[at..at + row.len()].copy_from_slice(row);
        }
        self.mirror();
    }

    /// Fills the level from the next larger one.
    #[inline(always)]
    fn halve(&mut self, below: &Self, column: &mut Vec<u16>) {
        let (width, height) = ((below.width + 1) / 2, (below.height + 1) / 2);
        self.reshape(width, height, below.border);
        // Two more columns than the width of the larger level on either side.
        let count = 2 * width as usize + 3;
        column.resize(count, 0);
        for y in 0..height {
            let rows: [&[u8]; 5] = std::array::from_fn(|k| below.row(-2, 2 * y - 2 + k as i32, count));
            let [a, b, c, d, e] = rows;
            for ((((sum, a), b), (c, d)), e) in column.iter_mut().zip(a).zip(b).zip(c.iter().zip(d)).zip(e) {
                *sum = u16::from(*a) + u16::from(*e) + 4 * (u16::from(*b) + u16::from(*d)) + 6 * u16::from(*c);
            }
            let at = self.offset(0, y);
            let out = &mut self.pixels[at..at + width as usize];
            let near = column.chunks_exact(2).zip(column[2..].chunks_exact(2)).zip(column[4..].iter().step_by(2));
            for (pixel, ((first, second), last)) in out.iter_mut().zip(near) {
                let ends = u32::from(first[0]) + u32::from(*last);
                let sum = ends + 4 * (u32::from(first[1]) + u32::from(second[1])) + 6 * u32::from(second[0]);
                *pixel = ((sum + 128) >> 8) as u8;
            }
        }
        self.mirror();
    }

    /// Writes pixels from (`x`, `y`) on into `out` as numbers, `row` of them per row, `count` in all. The border must extend as far, and 7
    /// pixels further to the right.
    #[inline(always)]
    pub fn read(&self, x: i32, y: i32, row: usize, count: usize, out: &mut Vec<f32>) {
        // Eight pixels at a time: the next row overwrites the surplus of a row.
        let parts = row.div_ceil(8);
        let rows = count.div_ceil(row.max(1));
        let room = rows * row + 8;
        if out.len() < room {
            out.resize(room, 0.0);
        }
        let mut from = self.offset(x, y);
        for k in 0..rows {
            let pixels = &self.pixels[from..from + 8 * parts];
            let out = &mut out[k * row..];
            for (out, pixels) in out.as_chunks_mut::<8>().0.iter_mut().zip(pixels.as_chunks::<8>().0) {
                for k in 0..8 {
                    out[k] = f32::from(pixels[k]);
                }
            }
            from += self.stride;
        }
    }
}

/// A frame's levels, the frame itself first.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    levels: Vec<Level>,
    column: Vec<u16>,
}

impl Pyramid {
    /// Fills the pyramid in its existing memory. Every level except the first is at least as large as a window of `max_window` px.
    pub fn build(&mut self, pixels: &[u8], (width, height): (u32, u32), levels: usize, max_window: i32) {
        let (mut width, mut height) = (width as i32, height as i32);
        self.levels.resize_with(levels.max(1), Level::default);
        // Windows start up to their side outside the image, rows are read in multiples of four, and derivatives reach further.
        self.levels[0].fill_from(pixels, width, height, max_window + SLACK);
        for k in 1..levels {
            (width, height) = ((width + 1) / 2, (height + 1) / 2);
            if width <= max_window || height <= max_window {
                self.levels.truncate(k);
                break;
            }
            let (below, above) = self.levels.split_at_mut(k);
            let (below, column) = (&below[k - 1], &mut self.column);
            widest(
                #[inline(always)]
                || above[0].halve(below, column),
            );
        }
    }

    /// Returns the levels, none before the first frame.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }
}
