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

/// Grey value, its gradient per px along x and y, and nothing: four numbers that are read at once.
pub type Reading = [f32; 4];

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
        // Rows and columns at the border stay as they are: nothing reads them.
        for (out, ((above, here), below)) in self.texels.chunks_exact_mut(self.width).skip(1).zip(near) {
            let beside = here.iter().zip(&here[1..]).zip(&here[2..]);
            for ((out, ((left, value), right)), (above, below)) in
                out[1..].iter_mut().zip(beside).zip(above[1..].iter().zip(&below[1..]))
            {
                *out = [*value, 0.5 * (right - left), 0.5 * (below - above), 0.0];
            }
        }
    }

    /// Bilinear value and central differences at a position of the frame, px; `None` where the patch does not reach.
    #[inline]
    pub fn read(&self, [x, y]: [f32; 2]) -> Option<Reading> {
        let (x, y) = (x - self.left, y - self.top);
        // One pixel more on every side, for the gradient; NaN is nowhere.
        if !(x >= 1.0 && y >= 1.0 && x < self.width as f32 - 2.0 && y < self.height as f32 - 2.0) {
            return None;
        }
        let (column, row) = (x as u32, y as u32);
        let (u, v) = (x - column as f32, y - row as f32);
        let at = row as usize * self.width + column as usize;
        let (upper, lower) = (self.texels.get(at..at + 2)?, self.texels.get(at + self.width..at + self.width + 2)?);
        let [[a, b], [c, d]] = [[upper[0], upper[1]], [lower[0], lower[1]]];
        let mut out = Reading::default();
        for k in 0..4 {
            let above = a[k] + u * (b[k] - a[k]);
            let below = c[k] + u * (d[k] - c[k]);
            out[k] = above + v * (below - above);
        }
        Some(out)
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
        assert_eq!(texture(&patch).read([12.25, 21.5]), Some([89.0, 2.0, 3.0, 0.0]));
    }

    #[test]
    fn beyond_the_patch_there_is_nothing() {
        let patch = Patch { left: 0, top: 0, width: 6, height: 5, values: vec![1.0; 30] };
        let whole = texture(&patch);
        assert!(whole.read([1.0, 1.0]).is_some());
        for at in [[0.9, 2.0], [2.0, 0.9], [4.0, 2.0], [2.0, 3.0], [f32::NAN, 2.0], [1e9, 2.0]] {
            assert_eq!(whole.read(at), None, "{at:?}");
        }
        // Fewer values than its size says, or none: nothing is read, nothing panics.
        for patch in [Patch { values: vec![1.0; 10], ..patch }, Patch { left: 0, top: 0, width: 0, height: 0, values: vec![] }] {
            assert_eq!(texture(&patch).read([3.0, 2.0]), None);
        }
        let thin = Patch { left: 0, top: 0, width: 2, height: 9, values: vec![1.0; 18] };
        assert_eq!(texture(&thin).read([1.0, 2.0]), None);
    }
}
