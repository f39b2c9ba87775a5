//! Image pyramids: every level half the size of the one below it, smoothed by 1 4 6 4 1 in both directions, with a
//! border of mirrored pixels so that windows may reach beyond the image.

/// Pixels of the border beyond the largest window.
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

/// Coordinate of the pixel that stands at a coordinate outside: mirrored at the outermost pixels, which do not repeat.
fn mirrored(at: i32, size: i32) -> i32 {
    if size <= 1 {
        return 0;
    }
    let period = 2 * (size - 1);
    let at = at.rem_euclid(period);
    if at < size { at } else { period - at }
}

impl Level {
    /// Makes the level one of a size, keeping its memory; pixels are undefined until filled.
    fn reshape(&mut self, width: i32, height: i32, border: i32) {
        (self.width, self.height, self.border) = (width, height, border);
        self.stride = (width + 2 * border) as usize;
        self.pixels.resize(self.stride * (height + 2 * border) as usize, 0);
    }

    fn offset(&self, x: i32, y: i32) -> usize {
        (y + self.border) as usize * self.stride + (x + self.border) as usize
    }

    /// Pixels of a row from `x` on, `count` of them; both may reach into the border.
    pub fn row(&self, x: i32, y: i32, count: usize) -> &[u8] {
        let at = self.offset(x, y);
        &self.pixels[at..at + count]
    }

    /// Fills the border from the image.
    fn mirror(&mut self) {
        let (width, height, border) = (self.width, self.height, self.border);
        for y in 0..height {
            let at = self.offset(0, y);
            for k in 1..=border {
                let (left, right) = (mirrored(-k, width) as usize, mirrored(width - 1 + k, width) as usize);
                self.pixels[at - k as usize] = self.pixels[at + left];
                self.pixels[at + (width - 1 + k) as usize] = self.pixels[at + right];
            }
        }
        for y in (-border..0).chain(height..height + border) {
            let (from, to) = (self.offset(-border, mirrored(y, height)), self.offset(-border, y));
            self.pixels.copy_within(from..from + self.stride, to);
        }
    }

    /// The bottom level.
    fn fill_from(&mut self, pixels: &[u8], width: i32, height: i32, border: i32) {
        self.reshape(width, height, border);
        for (y, row) in (0..height).zip(pixels.chunks_exact(width.max(1) as usize)) {
            let at = self.offset(0, y);
            self.pixels[at..at + row.len()].copy_from_slice(row);
        }
        self.mirror();
    }

    /// The level above another one.
    fn halve(&mut self, below: &Self, column: &mut Vec<u16>) {
        let (width, height) = ((below.width + 1) / 2, (below.height + 1) / 2);
        self.reshape(width, height, below.border);
        // Two columns more than the width below on either side.
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

    /// Pixels of a row from `x` on as numbers, as many as `out` has: a multiple of four.
    #[inline]
    pub fn read_row(&self, x: i32, y: i32, out: &mut [f32]) {
        let row = self.row(x, y, out.len());
        for (out, from) in out.as_chunks_mut::<4>().0.iter_mut().zip(row.as_chunks::<4>().0) {
            for k in 0..4 {
                out[k] = f32::from(from[k]);
            }
        }
    }

    /// Scharr derivatives on a part of the image from (`x`, `y`) on, row by row, 32 a grey level per px; zero outside the image. There are
    /// `columns` of them in a row, a multiple of four. `room` takes what is read of the image.
    pub fn derivatives(&self, (x, y): (i32, i32), columns: usize, dx: &mut [f32], dy: &mut [f32], room: &mut Vec<f32>) {
        // Two pixels more in a row, and a row more above and below; a multiple of four.
        let wide = columns + 4;
        let count = dx.len() / columns.max(1);
        room.resize((count + 4) * wide, 0.0);
        let (rows, sums) = room.split_at_mut((count + 2) * wide);
        let (smooth, slope) = sums.split_at_mut(wide);
        for (k, row) in (0..).zip(rows.chunks_exact_mut(wide)) {
            self.read_row(x - 1, y - 1 + k, row);
        }
        let out = dx.chunks_exact_mut(columns).zip(dy.chunks_exact_mut(columns));
        for (k, (dx, dy)) in out.enumerate() {
            let near = [k, k + 1, k + 2].map(|k| rows[k * wide..][..wide].as_chunks::<4>().0.iter());
            let [above, here, below] = near;
            let sums = smooth.as_chunks_mut::<4>().0.iter_mut().zip(slope.as_chunks_mut::<4>().0);
            for ((smooth, slope), ((a, b), c)) in sums.zip(above.zip(here).zip(below)) {
                for k in 0..4 {
                    smooth[k] = (a[k] + c[k]) * 3.0 + b[k] * 10.0;
                    slope[k] = c[k] - a[k];
                }
            }
            let smooth = [0, 2].map(|k| smooth[k..][..columns].as_chunks::<4>().0.iter());
            let slope = [0, 1, 2].map(|k| slope[k..][..columns].as_chunks::<4>().0.iter());
            let [left, right] = smooth;
            for (out, (a, c)) in dx.as_chunks_mut::<4>().0.iter_mut().zip(left.zip(right)) {
                for k in 0..4 {
                    out[k] = c[k] - a[k];
                }
            }
            let [left, middle, right] = slope;
            for (out, ((a, b), c)) in dy.as_chunks_mut::<4>().0.iter_mut().zip(left.zip(middle).zip(right)) {
                for k in 0..4 {
                    out[k] = (a[k] + c[k]) * 3.0 + b[k] * 10.0;
                }
            }
            let y = y + k as i32;
            if y < 0 || y >= self.height {
                dx.fill(0.0);
                dy.fill(0.0);
            } else if x < 0 || x + columns as i32 > self.width {
                for (column, (dx, dy)) in (x..).zip(dx.iter_mut().zip(dy.iter_mut())) {
                    if column < 0 || column >= self.width {
                        (*dx, *dy) = (0.0, 0.0);
                    }
                }
            }
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
    /// Fills the pyramid, in the memory it has. A level is as large as a window of `max_window` px at least, the frame aside.
    pub fn build(&mut self, pixels: &[u8], (width, height): (u32, u32), levels: usize, max_window: i32) {
        let (mut width, mut height) = (width as i32, height as i32);
        self.levels.resize_with(levels.max(1), Level::default);
        // Windows begin up to their side outside, their rows are read up to a multiple of four, and derivatives look further.
        self.levels[0].fill_from(pixels, width, height, max_window + SLACK);
        for k in 1..levels {
            (width, height) = ((width + 1) / 2, (height + 1) / 2);
            if width <= max_window || height <= max_window {
                self.levels.truncate(k);
                break;
            }
            let (below, above) = self.levels.split_at_mut(k);
            above[0].halve(&below[k - 1], &mut self.column);
        }
    }

    /// The levels, none before the first frame.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }
}
