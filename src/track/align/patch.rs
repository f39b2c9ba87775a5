//! Grey values of a part of a frame, read between pixels.

/// A part of a frame: smoothed grey values, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Column of its left-most pixels in the frame.
    pub left: u32,
    /// Row of its top pixels in the frame.
    pub top: u32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` grey values, 0 to 255.
    pub values: Vec<f32>,
}

/// Grey value and its gradient per px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    pub value: f32,
    pub gradient: [f32; 2],
}

impl Patch {
    /// Bilinear value and central difference at a position of the frame, px; `None` where the patch does not reach.
    pub fn read(&self, [x, y]: [f32; 2]) -> Option<Reading> {
        let (x, y) = (x - self.left as f32, y - self.top as f32);
        // One pixel more on every side, for the gradient; NaN is nowhere.
        if !(x >= 1.0 && y >= 1.0 && x < self.width as f32 - 2.0 && y < self.height as f32 - 2.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f32, y - row as f32);
        let line = |r: usize| {
            let start = r * self.width + column - 1;
            <[f32; 4]>::try_from(self.values.get(start..start + 4)?).ok()
        };
        let [above, upper, lower, below] = [line(row - 1)?, line(row)?, line(row + 1)?, line(row + 2)?];
        let along = |l: &[f32; 4]| l[1] + u * (l[2] - l[1]);
        let slope = |l: &[f32; 4]| 0.5 * ((l[2] - l[0]) + u * (l[3] - l[1] - l[2] + l[0]));
        let mix = |a: f32, b: f32| a + v * (b - a);
        let values = [along(&above), along(&upper), along(&lower), along(&below)];
        Some(Reading {
            value: mix(values[1], values[2]),
            gradient: [mix(slope(&upper), slope(&lower)), 0.5 * mix(values[2] - values[0], values[3] - values[1])],
        })
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
        let reading = patch.read([12.25, 21.5]).unwrap();
        // 2 * 12.25 + 3 * 21.5 = 89.
        assert_eq!(reading, Reading { value: 89.0, gradient: [2.0, 3.0] });
    }

    #[test]
    fn beyond_the_patch_there_is_nothing() {
        let patch = Patch { left: 0, top: 0, width: 6, height: 5, values: vec![1.0; 30] };
        assert!(patch.read([1.0, 1.0]).is_some());
        for at in [[0.9, 2.0], [2.0, 0.9], [4.0, 2.0], [2.0, 3.0], [f32::NAN, 2.0], [1e9, 2.0]] {
            assert_eq!(patch.read(at), None, "{at:?}");
        }
        // Fewer values than its size says: nothing is read, nothing panics.
        let short = Patch { values: vec![1.0; 10], ..patch };
        assert_eq!(short.read([3.0, 2.0]), None);
    }
}
