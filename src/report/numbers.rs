//! Formats numbers for the report.

use serde_json::Value;

/// Text for a missing number.
pub(super) const MISSING: &str = "\u{2013}";

/// A number for the embedded data, rounded to `digits` decimals; whole numbers without a point, non-finite numbers as null.
pub(super) fn rounded(value: f64, digits: u8) -> Value {
    let factor = 10_f64.powi(i32::from(digits));
    let scaled = (value * factor).round();
    if !scaled.is_finite() {
        return Value::Null;
    }
    let value = scaled / factor;
    // 2^53: up to here every whole number is exact.
    if value.fract() == 0.0 && value.abs() < 9_007_199_254_740_992.0 { Value::from(value as i64) } else { Value::from(value) }
}

/// A length to 0.01 face units for the embedded data.
pub(super) fn length(value: f64) -> Value {
    rounded(value, 2)
}

/// A number with a fixed count of decimals and a true minus sign.
pub(super) fn fixed(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return MISSING.to_owned();
    }
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| b == b'0' || b == b'.') => rest.to_owned(),
        Some(rest) => format!("\u{2212}{rest}"),
        None => text,
    }
}

/// As [`fixed`], or a dash without a value.
pub(super) fn fixed_or_dash(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| MISSING.to_owned(), |v| fixed(v, digits))
}

/// A small ratio with two significant digits: `0`, `0.012`, or `3.4 × 10⁻¹⁰` below a thousandth.
pub(super) fn ratio(value: f64) -> String {
    const SUPERSCRIPTS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    if !value.is_finite() {
        return MISSING.to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let text = format!("{value:.1e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if exponent >= -3 {
        return fixed(value, usize::try_from(1 - exponent).unwrap_or(0));
    }
    let digits: String = exponent.unsigned_abs().to_string().bytes().map(|b| SUPERSCRIPTS[usize::from(b - b'0')]).collect();
    format!("{} × 10⁻{digits}", mantissa.replace('-', "\u{2212}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn embedded_numbers_are_short() {
        assert_eq!(length(12.3456).to_string(), "12.35");
        assert_eq!(length(-0.001).to_string(), "0");
        assert_eq!(length(40.0).to_string(), "40");
        assert_eq!(length(f64::NAN), Value::Null);
        assert_eq!(length(f64::INFINITY), Value::Null);
    }

    #[test]
    fn printed_numbers_have_sensible_digits() {
        assert_eq!(fixed(11.126, 2), "11.13");
        assert_eq!(fixed(-3.25, 1), "\u{2212}3.2");
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(fixed(f64::NAN, 2), MISSING);
        assert_eq!(fixed_or_dash(None, 2), MISSING);
    }

    #[test]
    fn ratios_have_two_significant_digits() {
        assert_eq!(ratio(0.0), "0");
        // 0.0123 = 1.2e-2: 3 decimals.
        assert_eq!(ratio(0.0123), "0.012");
        assert_eq!(ratio(1.26), "1.3");
        assert_eq!(ratio(123.0), "123");
        assert_eq!(ratio(3.44e-10), "3.4 × 10⁻¹⁰");
        assert_eq!(ratio(-3.44e-10), "\u{2212}3.4 × 10⁻¹⁰");
        assert_eq!(ratio(f64::INFINITY), MISSING);
    }
}
