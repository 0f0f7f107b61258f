//! Numbers in JSON, which has no notation for NaN and the infinities.

use serde_json::Value;

// The NaN that is written as "NaN"; any other one is written with its bits, so that no bit is lost.
const QUIET_32: u32 = 0x7FC0_0000;
const QUIET_64: u64 = 0x7FF8_0000_0000_0000;

/// The exact value, or a text for NaN and infinities.
pub(super) fn f32_value(number: f32) -> Value {
    if number.is_nan() && number.to_bits() != QUIET_32 {
        return Value::from(format!("NaN:{:08x}", number.to_bits()));
    }
    f64_value(f64::from(number))
}

/// The exact value, or a text for NaN and infinities.
pub(super) fn f64_value(number: f64) -> Value {
    match number {
        _ if number.is_finite() => Value::from(number),
        _ if number == f64::INFINITY => Value::from("Infinity"),
        _ if number == f64::NEG_INFINITY => Value::from("-Infinity"),
        _ if number.to_bits() == QUIET_64 => Value::from("NaN"),
        _ => Value::from(format!("NaN:{:016x}", number.to_bits())),
    }
}

/// The reverse of [`f32_value`]; a number is rounded to the nearest. `None` if it is too large or
/// no such value.
pub(super) fn f32_of(value: &Value) -> Option<f32> {
    if let Some(number) = value.as_f64() {
        let narrow = number as f32;
        return narrow.is_finite().then_some(narrow);
    }
    match value.as_str()? {
        "NaN" => Some(f32::from_bits(QUIET_32)),
        "Infinity" => Some(f32::INFINITY),
        "-Infinity" => Some(f32::NEG_INFINITY),
        text => {
            let bits = u32::from_str_radix(text.strip_prefix("NaN:")?, 16).ok()?;
            Some(f32::from_bits(bits)).filter(|number| number.is_nan())
        }
    }
}

/// The reverse of [`f64_value`].
pub(super) fn f64_of(value: &Value) -> Option<f64> {
    if let Some(number) = value.as_f64() {
        return Some(number);
    }
    match value.as_str()? {
        "NaN" => Some(f64::from_bits(QUIET_64)),
        "Infinity" => Some(f64::INFINITY),
        "-Infinity" => Some(f64::NEG_INFINITY),
        text => {
            let bits = u64::from_str_radix(text.strip_prefix("NaN:")?, 16).ok()?;
            Some(f64::from_bits(bits)).filter(|number| number.is_nan())
        }
    }
}

/// An integer, also where it is written `5.0`.
pub(super) fn integer_of(value: &Value) -> Option<i64> {
    // Above 2^53 a double no longer identifies one integer; no field is that wide.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    value.as_i64().or_else(|| {
        let number = value.as_f64()?;
        (number.fract() == 0.0 && number.abs() <= EXACT).then_some(number as i64)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_float_comes_back_with_its_bits() {
        for bits in [
            0,
            1,
            0x8000_0000,
            0x3DCC_CCCD,
            0x7F80_0000,
            0xFF80_0000,
            QUIET_32,
            0x7F80_0001,
            0xFFC0_0000,
        ] {
            let value = f32_value(f32::from_bits(bits));
            assert_eq!(f32_of(&value).unwrap().to_bits(), bits, "{value}");
        }
        for bits in [
            0,
            1,
            1 << 63,
            0x3FB9_9999_9999_999A,
            0x7FF0_0000_0000_0000,
            QUIET_64,
            QUIET_64 | 1,
            u64::MAX,
        ] {
            let value = f64_value(f64::from_bits(bits));
            assert_eq!(f64_of(&value).unwrap().to_bits(), bits, "{value}");
        }
        assert_eq!(f32_value(0.1).to_string(), "0.10000000149011612");
    }

    #[test]
    fn values_that_are_not_such_a_number_are_refused() {
        assert_eq!(f32_of(&Value::from(1e39)), None);
        assert_eq!(f32_of(&Value::from("NaN:3f800000")), None);
        assert_eq!(f64_of(&Value::from("nan")), None);
        assert_eq!(f64_of(&Value::Null), None);
        assert_eq!(integer_of(&Value::from(5.0)), Some(5));
        assert_eq!(integer_of(&Value::from(5.5)), None);
        assert_eq!(integer_of(&Value::from(1e300)), None);
    }
}
