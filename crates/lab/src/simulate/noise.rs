//! Seeded lattice noise for procedural surfaces: a pure function of position and seed.

/// Returns a well-mixed 32-bit hash of a lattice point.
fn hash(x: i32, y: i32, seed: u32) -> u32 {
    let mut h = seed ^ (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
    h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
    h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    h ^ (h >> 16)
}

/// Returns a uniform value in [-1, 1] at a lattice point.
fn lattice(x: i32, y: i32, seed: u32) -> f32 {
    hash(x, y, seed) as f32 / (u32::MAX as f32 / 2.0) - 1.0
}

/// Returns smooth value noise in [-1, 1] with a lattice spacing of 1 (quintic interpolation, so that its gradient is continuous).
pub fn value(x: f32, y: f32, seed: u32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (ix, iy) = (fx as i32, fy as i32);
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(x - fx), fade(y - fy));
    let row = |j: i32| {
        let (a, b) = (lattice(ix, iy + j, seed), lattice(ix + 1, iy + j, seed));
        a + (b - a) * u
    };
    let (top, bottom) = (row(0), row(1));
    top + (bottom - top) * v
}

/// Cosine and sine of the angle between the lattices of two octaves.
const TURN: (f32, f32) = (0.8, 0.6);

/// Returns the sum of `octaves` value noises, each twice as fine and half as strong as the previous one, normalized to [-1, 1]. Each
/// lattice is rotated against the previous one, so that no grid is visible.
pub fn fractal(x: f32, y: f32, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut total, mut amplitude) = (0.0, 0.0, 1.0);
    let (mut x, mut y) = (x * TURN.0 - y * TURN.1, x * TURN.1 + y * TURN.0);
    for octave in 0..octaves {
        sum += amplitude * value(x, y, seed.wrapping_add(octave.wrapping_mul(0x68BC_21EB)));
        total += amplitude;
        amplitude *= 0.5;
        (x, y) = (2.0 * (x * TURN.0 - y * TURN.1), 2.0 * (x * TURN.1 + y * TURN.0));
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_bounded_continuous_and_seeded() {
        for k in 0..2000_i16 {
            let (x, y) = (f32::from(k) * 0.137 - 90.0, f32::from(k) * 0.071 - 40.0);
            let here = fractal(x, y, 4, 7);
            assert!(here.abs() <= 1.0);
            // The steepest slope of quintic value noise is 2 * 1.875 per unit; four octaves of it add up to at most 8.
            assert!((fractal(x + 1e-3, y, 4, 7) - here).abs() < 8.0 * 1e-3 + 1e-4);
        }
        // At a lattice point the noise equals the lattice value, which depends on the seed.
        assert_eq!(value(3.0, 4.0, 1).to_bits(), lattice(3, 4, 1).to_bits());
        assert!((value(3.0, 4.0, 1) - value(3.0, 4.0, 2)).abs() > 1e-6);
    }
}
