//! Grey values of a part of a frame, interpolated between pixels.

/// A part of a frame: smoothed grey values, row by row. A [`PointTracker`](crate::track::PointTracker) that has them lets the tracker align
/// every frame with the neutral one.
///
/// ```
/// use grimace::track::Patch;
///
/// let patch = Patch { left: 10, top: 20, width: 3, height: 2, values: vec![0.0, 80.0, 160.0, 0.0, 90.0, 170.0] };
/// assert_eq!(patch.values[patch.width + 1], 90.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Column of its leftmost pixels in the frame.
    pub left: u32,
    /// Row of its topmost pixels in the frame.
    pub top: u32,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` grey values, 0 to 255.
    pub values: Vec<f32>,
}

/// Number of positions that are read at once.
pub const LANES: usize = 8;

/// One number for each position.
pub type Lanes = [f32; LANES];

/// For each position: grey value, gradient per px along x and y, and 1; all 0 where nothing was read.
pub type Readings = [Lanes; 4];

/// The sum of [`LANES`] numbers.
#[inline(always)]
pub fn total(lanes: &Lanes) -> f32 {
    let mut sums = [0.0; LANES / 2];
    for k in 0..LANES / 2 {
        sums[k] = lanes[k] + lanes[k + LANES / 2];
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3])
}

#[inline(always)]
pub fn times(a: &Lanes, b: &Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for k in 0..LANES {
        out[k] = a[k] * b[k];
    }
    out
}

#[inline(always)]
pub fn add(sum: &mut Lanes, lanes: &Lanes) {
    for k in 0..LANES {
        sum[k] += lanes[k];
    }
}

/// Adding and subtracting it rounds a number below 2^22 to the nearest integer; the low bits of the sum are that integer.
const ROUND: f32 = 8_388_608.0;

impl Patch {
    /// Returns bilinear values and central differences at positions of the frame, px: nothing outside the patch.
    #[inline(always)]
    pub(crate) fn read(&self, [x, y]: &[Lanes; 2]) -> Readings {
        let (left, top, width) = (self.left as f32, self.top as f32, self.width);
        // One more pixel on every side, for the gradient; NaN counts as outside.
        let (right, bottom) = (width as f32 - 2.0, self.height as f32 - 2.0);
        let (mut starts, mut shares) = ([usize::MAX; LANES], [[0.0; LANES]; 2]);
        for k in 0..LANES {
            let (x, y) = (x[k] - left, y[k] - top);
            if x >= 1.0 && y >= 1.0 && x < right && y < bottom {
                // The nearest pixel at or before the position, or the previous one: the interpolated values are the same.
                let (column, row) = ((x - 0.5 + ROUND).max(ROUND + 1.0), (y - 0.5 + ROUND).max(ROUND + 1.0));
                (shares[0][k], shares[1][k]) = (x - (column - ROUND), y - (row - ROUND));
                let whole = |value: f32| (value.to_bits() & 0x7F_FFFF) as usize;
                starts[k] = (whole(row) - 1) * width + whole(column) - 1;
            }
        }
        // Interpolated between rows, in four columns: values, and differences of the two middle ones.
        let (mut values, mut differences, mut out) = ([[0.0; LANES]; 4], [[0.0; LANES]; 2], Readings::default());
        for k in 0..LANES {
            let row = |number: usize| {
                let start = starts[k].checked_add(number * width)?;
                self.values.get(start..).and_then(|rest| rest.first_chunk::<4>())
            };
            let (Some(a), Some(b), Some(c), Some(d)) = (row(0), row(1), row(2), row(3)) else { continue };
            let down = shares[1][k];
            let (mut mixed, mut slopes) = ([0.0; 4], [0.0; 4]);
            for n in 0..4 {
                let (upper, lower) = (c[n] - a[n], d[n] - b[n]);
                mixed[n] = b[n] + down * (c[n] - b[n]);
                slopes[n] = upper + down * (lower - upper);
            }
            for n in 0..4 {
                values[n][k] = mixed[n];
            }
            (differences[0][k], differences[1][k]) = (slopes[1], slopes[2]);
            out[3][k] = 1.0;
        }
        for k in 0..LANES {
            let along = shares[0][k];
            let (first, second) = (values[2][k] - values[0][k], values[3][k] - values[1][k]);
            out[0][k] = values[1][k] + along * (values[2][k] - values[1][k]);
            out[1][k] = 0.5 * (first + along * (second - first));
            out[2][k] = 0.5 * (differences[0][k] + along * (differences[1][k] - differences[0][k]));
        }
        out
    }

    /// Same at one position.
    pub fn read_one(&self, [x, y]: [f32; 2]) -> Option<[f32; 4]> {
        let readings = self.read(&[[x; LANES], [y; LANES]]).map(|lanes| lanes[0]);
        (readings[3] > 0.0).then_some(readings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_read_exactly_between_pixels() {
        // Grey 2 x + 3 y in frame coordinates, seen through a part that starts at (10, 20).
        let value = |k: usize| 2.0 * (10 + k % 6) as f32 + 3.0 * (20 + k / 6) as f32;
        let patch = Patch { left: 10, top: 20, width: 6, height: 5, values: (0..30).map(value).collect() };
        // 2 * 12.25 + 3 * 21.5 = 89.
        assert_eq!(patch.read_one([12.25, 21.5]), Some([89.0, 2.0, 3.0, 1.0]));
    }

    #[test]
    fn beyond_the_patch_there_is_nothing() {
        let patch = Patch { left: 0, top: 0, width: 6, height: 5, values: vec![1.0; 30] };
        assert_eq!(patch.read_one([1.0, 1.0]), Some([1.0, 0.0, 0.0, 1.0]));
        for at in [[0.9, 2.0], [2.0, 0.9], [4.0, 2.0], [2.0, 3.0], [f32::NAN, 2.0], [1e9, 2.0]] {
            assert_eq!(patch.read_one(at), None, "{at:?}");
        }
        // Fewer values than its size requires, or none: nothing is read, and it does not panic.
        for patch in [Patch { values: vec![1.0; 10], ..patch }, Patch { left: 0, top: 0, width: 0, height: 0, values: vec![] }] {
            assert_eq!(patch.read_one([3.0, 2.0]), None);
        }
        let thin = Patch { left: 0, top: 0, width: 2, height: 9, values: vec![1.0; 18] };
        assert_eq!(thin.read_one([1.0, 2.0]), None);
    }
}
