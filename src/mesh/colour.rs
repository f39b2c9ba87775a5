//! Conversion between sRGB values in files and linear light.

/// Linear light, 0 to 1, of an sRGB byte.
pub fn linear(byte: u8) -> f32 {
    let c = f32::from(byte) / 255.0;
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// sRGB value, 0 to 1, of linear light.
pub fn srgb(linear: f32) -> f32 {
    let c = linear.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_light_and_srgb_are_inverse() {
        assert!((0..=255).all(|byte| (srgb(linear(byte)) * 255.0 - f32::from(byte)).abs() < 1e-2));
        // Half of the code range is 21.4 % of the light.
        assert!((linear(128) - 0.2159).abs() < 1e-3);
    }
}
