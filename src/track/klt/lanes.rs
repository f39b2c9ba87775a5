//! Lists of numbers, eight at a time.

/// Number of lanes of sums, so that they vectorize and give the same result on every machine. Windows are padded to a multiple of it.
pub const LANES: usize = 8;

/// Values on a part of an image, row by row without a gap, so that one loop covers all of it. Offset by one, an index gives the right
/// neighbour; offset by one row, the neighbour below.
pub type Values = Vec<f32>;

/// Splits a list into chunks of [`LANES`], without the remainder.
#[inline(always)]
pub fn lanes(list: &[f32]) -> &[[f32; LANES]] {
    list.as_chunks().0
}

/// As [`lanes`], to write.
#[inline(always)]
pub fn lanes_mut(list: &mut [f32]) -> &mut [[f32; LANES]] {
    list.as_chunks_mut().0
}

/// The sum of [`LANES`] sums.
#[inline(always)]
pub fn total([a, b, c, d, e, f, g, h]: [f32; LANES]) -> f32 {
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

/// The sum of products of two lists.
#[inline(always)]
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; LANES];
    for (a, b) in lanes(a).iter().zip(lanes(b)) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    total(sums)
}
