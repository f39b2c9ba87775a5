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

/// Grey value, its gradient per px along x and y, and 1 (0 where nothing was read): four numbers that are read at once.
pub type Reading = [f32; 4];

/// Places that are read at once.
pub const LANES: usize = 8;

/// One number for each of them.
pub type Lanes = [f32; LANES];

/// Adding and subtracting it rounds a number below 2^22 to the nearest whole one; the last bits of the sum are that number.
const ROUND: f32 = 8_388_608.0;

/// A patch made ready to be read at many places: grey value and central differences of every pixel side by side.
#[derive(Clone, Debug, Default)]
pub struct Texture {
    left: f32,
    top: f32,
    width: usize,
    height: usize,
    texels: Vec<Reading>,
}

impl Texture {
    /// Takes a patch, into the memory that is there.
    #[inline(always)]
    pub fn fill_from(&mut self, patch: &Patch) {
        (self.left, self.top) = (patch.left as f32, patch.top as f32);
        let whole = patch.width.checked_mul(patch.height).is_some_and(|size| size <= patch.values.len());
        (self.width, self.height) = if whole { (patch.width, patch.height) } else { (0, 0) };
        self.texels.resize(self.width * self.height, Reading::default());
        if self.width < 3 {
            return;
        }
        let rows = patch.values.chunks_exact(self.width);
        let near = rows.clone().zip(rows.clone().skip(1)).zip(rows.skip(2));
        // Of the border the first row and column are read with a share of 0, so they must not be what an earlier patch left there.
        self.texels.iter_mut().take(self.width).for_each(|texel| *texel = Reading::default());
        for (out, ((above, here), below)) in self.texels.chunks_exact_mut(self.width).skip(1).zip(near) {
            out[0] = Reading::default();
            let beside = here.iter().zip(&here[1..]).zip(&here[2..]);
            for ((out, ((left, value), right)), (above, below)) in
                out[1..].iter_mut().zip(beside).zip(above[1..].iter().zip(&below[1..]))
            {
                *out = [*value, 0.5 * (right - left), 0.5 * (below - above), 1.0];
            }
        }
    }

    /// Bilinear values and central differences at positions of the frame, px: nothing where the patch does not reach.
    #[inline(always)]
    pub fn read(&self, [x, y]: &[Lanes; 2]) -> [Reading; LANES] {
        let (left, top, width, texels) = (self.left, self.top, self.width, self.texels.as_slice());
        // One pixel more on every side, for the gradient; NaN is nowhere.
        let (right, bottom) = (width as f32 - 2.0, self.height as f32 - 2.0);
        let (mut indices, mut shares) = ([usize::MAX; LANES], [[0.0; 2]; LANES]);
        for k in 0..LANES {
            let (x, y) = (x[k] - left, y[k] - top);
            if x >= 1.0 && y >= 1.0 && x < right && y < bottom {
                // The pixel at or before, or the one before that: between them the values are the same.
                let (column, row) = (x - 0.5 + ROUND, y - 0.5 + ROUND);
                shares[k] = [x - (column - ROUND), y - (row - ROUND)];
                let whole = |value: f32| (value.to_bits() & 0x7F_FFFF) as usize;
                indices[k] = whole(row) * width + whole(column);
            }
        }
        let mut out = [Reading::default(); LANES];
        for ((out, at), [u, v]) in out.iter_mut().zip(indices).zip(shares) {
            let Some(square) = at.checked_add(width + 2).and_then(|end| texels.get(at..end)) else { continue };
            // Down first: both texels of a row are read as one.
            let (Some(upper), Some(lower)) = (square.first_chunk::<2>(), square.last_chunk::<2>()) else { continue };
            let (upper, lower) = (upper.as_flattened(), lower.as_flattened());
            let mut sides = [0.0; 8];
            for k in 0..8 {
                sides[k] = upper[k] + v * (lower[k] - upper[k]);
            }
            for k in 0..4 {
                out[k] = sides[k] + u * (sides[k + 4] - sides[k]);
            }
        }
        out
    }

    /// The same at one position.
    pub fn read_one(&self, [x, y]: [f32; 2]) -> Option<Reading> {
        let [reading, ..] = self.read(&[[x; LANES], [y; LANES]]);
        (reading[3] > 0.0).then_some(reading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(patch: &Patch) -> Texture {
        let mut texture = Texture::default();
        texture.fill_from(patch);
        texture
    }

    #[test]
    fn a_ramp_is_read_exactly_between_pixels() {
        // Grey 2 x + 3 y in frame coordinates, seen through a part that starts at (10, 20).
        let value = |k: usize| 2.0 * (10 + k % 6) as f32 + 3.0 * (20 + k / 6) as f32;
        let patch = Patch { left: 10, top: 20, width: 6, height: 5, values: (0..30).map(value).collect() };
        // 2 * 12.25 + 3 * 21.5 = 89.
        assert_eq!(texture(&patch).read_one([12.25, 21.5]), Some([89.0, 2.0, 3.0, 1.0]));
    }

    #[test]
    fn nothing_is_left_of_an_earlier_patch() {
        let patch = |grey: f32| Patch { left: 0, top: 0, width: 6, height: 5, values: vec![grey; 30] };
        // So large that nothing small is left of a difference with it.
        let mut texture = texture(&Patch { width: 5, height: 6, ..patch(3e7) });
        texture.fill_from(&patch(0.3));
        for at in [[1.0, 1.0], [1.0, 2.5], [3.0, 1.0]] {
            assert_eq!(texture.read_one(at), Some([0.3, 0.0, 0.0, 1.0]), "{at:?}");
        }
    }

    #[test]
    fn beyond_the_patch_there_is_nothing() {
        let patch = Patch { left: 0, top: 0, width: 6, height: 5, values: vec![1.0; 30] };
        let whole = texture(&patch);
        assert!(whole.read_one([1.0, 1.0]).is_some());
        for at in [[0.9, 2.0], [2.0, 0.9], [4.0, 2.0], [2.0, 3.0], [f32::NAN, 2.0], [1e9, 2.0]] {
            assert_eq!(whole.read_one(at), None, "{at:?}");
        }
        // Fewer values than its size says, or none: nothing is read, nothing panics.
        for patch in [Patch { values: vec![1.0; 10], ..patch }, Patch { left: 0, top: 0, width: 0, height: 0, values: vec![] }] {
            assert_eq!(texture(&patch).read_one([3.0, 2.0]), None);
        }
        let thin = Patch { left: 0, top: 0, width: 2, height: 9, values: vec![1.0; 18] };
        assert_eq!(texture(&thin).read_one([1.0, 2.0]), None);
    }
}
