//! Packs numbers as Base64 of little-endian bytes, which the page turns into typed arrays.

use base64::{Engine, prelude::BASE64_STANDARD};
use serde_json::{Value, json};

/// Integers up to 65535, in 16 bits; larger ones become 65535.
pub fn whole(values: impl IntoIterator<Item = u32>) -> Value {
    let bytes: Vec<u8> = values.into_iter().flat_map(|v| (v.min(u32::from(u16::MAX)) as u16).to_le_bytes()).collect();
    json!(BASE64_STANDARD.encode(bytes))
}

/// Bytes.
pub fn bytes(values: &[u8]) -> Value {
    json!(BASE64_STANDARD.encode(values))
}

/// Numbers in 16 bits as `{scale, values}`: a value is its integer times the scale.
pub fn scaled(values: &[f64]) -> Value {
    let most = values.iter().fold(0.0_f64, |most, v| if v.is_finite() { most.max(v.abs()) } else { most });
    let scale = if most > 0.0 { most / f64::from(i16::MAX) } else { 1.0 };
    // NaN becomes 0 by the conversion; infinities become the largest integer of their sign.
    let bytes: Vec<u8> = values.iter().flat_map(|v| ((v / scale).round() as i16).to_le_bytes()).collect();
    json!({ "scale": scale, "values": BASE64_STANDARD.encode(bytes) })
}

/// Numbers in 8 bits, as [`scaled`], for values that are small next to other motion.
pub fn small(values: &[f64]) -> Value {
    let most = values.iter().fold(0.0_f64, |most, v| if v.is_finite() { most.max(v.abs()) } else { most });
    let scale = if most > 0.0 { most / f64::from(i8::MAX) } else { 1.0 };
    let bytes: Vec<u8> = values.iter().flat_map(|v| ((v / scale).round() as i8).to_le_bytes()).collect();
    json!({ "scale": scale, "values": BASE64_STANDARD.encode(bytes) })
}

/// Numbers in single precision (32 bits).
pub fn single(values: impl IntoIterator<Item = f64>) -> Value {
    let bytes: Vec<u8> = values.into_iter().flat_map(|v| (v as f32).to_le_bytes()).collect();
    json!(BASE64_STANDARD.encode(bytes))
}

/// A file as a data URL.
pub fn data_url(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", BASE64_STANDARD.encode(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_largest_exactly() {
        let packed = scaled(&[32.767, -16.0, 0.0]);
        // The scale is 32.767 / 32767 = 0.001: 32767 = ff 7f, -16000 = 80 c1, 0.
        assert!((packed["scale"].as_f64().unwrap() - 0.001).abs() < 1e-12);
        assert_eq!(BASE64_STANDARD.decode(packed["values"].as_str().unwrap()).unwrap(), [0xff, 0x7f, 0x80, 0xc1, 0, 0]);
        assert_eq!(scaled(&[])["scale"], 1.0);
    }
}
