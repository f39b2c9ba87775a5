//! Deterministic irregular patterns for the inside of a mouth.

use crate::interpolation::smooth_step;

/// Value noise from -1 to 1: a lattice of hashed values, smoothly interpolated, the same on every machine.
pub fn grain(x: f64, y: f64) -> f64 {
    let corner = |i: i64, j: i64| {
        let mut h = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (j as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((h >> 40) as f64) / f64::from(1_u32 << 23) - 1.0
    };
    let (i, j) = (x.floor(), y.floor());
    let (s, t) = (smooth_step(0.0, 1.0, x - i), smooth_step(0.0, 1.0, y - j));
    let (i, j) = (i as i64, j as i64);
    let row = |j: i64| corner(i, j) + (corner(i + 1, j) - corner(i, j)) * s;
    row(j) + (row(j + 1) - row(j)) * t
}

/// The pattern of the light that the wet tongue reflects.
pub fn grain_of_light(x: f64, y: f64) -> f64 {
    0.6 * grain(x / 0.035 + 17.0, y / 0.016) + 0.4 * grain(x / 0.017, y / 0.009 + 31.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_spread_from_minus_one_to_one_and_have_no_steps() {
        let values: Vec<f64> = (0..400).map(|k| grain(0.1 * f64::from(k), 3.0)).collect();
        assert!(values.iter().all(|v| v.abs() <= 1.0) && values.windows(2).all(|w| (w[1] - w[0]).abs() < 0.31));
        let (least, most) = values.iter().fold((f64::MAX, f64::MIN), |(l, m), v| (l.min(*v), m.max(*v)));
        assert!(least < -0.6 && most > 0.6, "{least} {most}");
    }
}
