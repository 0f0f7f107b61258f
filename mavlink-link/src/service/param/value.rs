//! Names and values of parameters, and how the wire carries them.

use mavlink::dialects::development::{MavParamType, PARAM_VALUE_DATA};
use mavlink::types::CharArray;

/// A parameter's value, by PX4's two types.
#[derive(Clone, Copy, Debug)]
pub enum Value {
    /// MAV_PARAM_TYPE_INT32 (and, from others, the narrower integers).
    Int(i32),
    /// MAV_PARAM_TYPE_REAL32
    Real(f32),
}

impl Value {
    /// From the fields of PARAM_VALUE or PARAM_SET; `None` for 64-bit types, which a float's
    /// four bytes cannot carry.
    pub fn from_wire(value: f32, kind: MavParamType) -> Option<Self> {
        use MavParamType as T;
        let bits = value.to_bits();
        let [low, second, ..] = bits.to_le_bytes();
        Some(match kind {
            T::MAV_PARAM_TYPE_REAL32 => Self::Real(value),
            T::MAV_PARAM_TYPE_INT32 | T::MAV_PARAM_TYPE_UINT32 => Self::Int(bits.cast_signed()),
            T::MAV_PARAM_TYPE_UINT8 => Self::Int(low.into()),
            T::MAV_PARAM_TYPE_INT8 => Self::Int(low.cast_signed().into()),
            T::MAV_PARAM_TYPE_UINT16 => Self::Int(u16::from_le_bytes([low, second]).into()),
            T::MAV_PARAM_TYPE_INT16 => Self::Int(i16::from_le_bytes([low, second]).into()),
            T::MAV_PARAM_TYPE_UINT64 | T::MAV_PARAM_TYPE_INT64 | T::MAV_PARAM_TYPE_REAL64 => {
                return None;
            }
        })
    }

    /// PARAM_SET.param_value or PARAM_VALUE.param_value
    pub fn to_wire(self) -> f32 {
        match self {
            // PX4 reads the bits of the float as the integer (byte union) and does not convert the number.
            Self::Int(value) => f32::from_bits(value.cast_unsigned()),
            Self::Real(value) => value,
        }
    }

    /// PARAM_SET.param_type or PARAM_VALUE.param_type
    pub fn kind(self) -> MavParamType {
        match self {
            Self::Int(_) => MavParamType::MAV_PARAM_TYPE_INT32,
            Self::Real(_) => MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }
}

/// The parameter in a PARAM_VALUE; `None` where it has 64 bits or no valid name.
pub fn named_value(data: &PARAM_VALUE_DATA) -> Option<(Name, Value)> {
    let value = Value::from_wire(data.param_value, data.param_type)?;
    Some((Name::from_wire(&data.param_id)?, value))
}

/// Same type and same bits; every NaN is the same.
impl PartialEq for Value {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Int(a), Self::Int(b)) => a == b,
            (Self::Real(a), Self::Real(b)) => {
                a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
            }
            _ => false,
        }
    }
}

/// The name of a parameter: 1 to 16 printable ASCII characters.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name([u8; 16]);

/// A text that cannot be the name of a parameter.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("parameter name {0:?}: 1 to 16 printable ASCII characters expected")]
pub struct NameError(String);

impl Name {
    /// A name.
    ///
    /// # Errors
    /// It is empty, longer than 16 characters, or not printable ASCII.
    pub fn new(name: &str) -> Result<Self, NameError> {
        Self::from_bytes(name.as_bytes()).ok_or_else(|| NameError(name.to_owned()))
    }

    /// The name without its padding.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&o| o == 0).unwrap_or(16);
        // The constructors admit only ASCII.
        std::str::from_utf8(&self.0[..end]).unwrap_or_default()
    }

    /// The name in PARAM_VALUE.param_id and similar fields; `None` where it is not a valid name.
    pub fn from_wire(id: &CharArray<16>) -> Option<Self> {
        let end = id.iter().position(|&o| o == 0).unwrap_or(16);
        Self::from_bytes(&id[..end])
    }

    /// As PARAM_VALUE.param_id and similar fields.
    pub fn to_wire(self) -> CharArray<16> {
        CharArray::new(self.0)
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        if bytes.is_empty() || !bytes.iter().all(u8::is_ascii_graphic) {
            return None;
        }
        let mut name = [0; 16];
        name.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Self(name))
    }
}

impl std::fmt::Debug for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// The pseudo-parameter whose value is a CRC over all; its index is 65535.
pub const HASH_CHECK: &str = "_HASH_CHECK";
/// PARAM_VALUE.param_index of a value that has no place in the list.
pub const NO_INDEX: u16 = u16::MAX;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integer_travels_as_its_bytes() {
        let wire = Value::Int(-2).to_wire();
        assert_eq!(wire.to_bits(), 0xffff_fffe);
        let back = Value::from_wire(wire, MavParamType::MAV_PARAM_TYPE_INT32);
        assert_eq!(back, Some(Value::Int(-2)));
        assert_ne!(back, Some(Value::Real(wire)));
    }

    #[test]
    fn narrow_integers_keep_their_sign() {
        let wire = f32::from_bits(0x0000_80ff);
        let read = |kind| Value::from_wire(wire, kind);
        assert_eq!(
            read(MavParamType::MAV_PARAM_TYPE_INT8),
            Some(Value::Int(-1))
        );
        assert_eq!(
            read(MavParamType::MAV_PARAM_TYPE_UINT8),
            Some(Value::Int(255))
        );
        assert_eq!(
            read(MavParamType::MAV_PARAM_TYPE_INT16),
            Some(Value::Int(-32_513))
        );
        assert_eq!(read(MavParamType::MAV_PARAM_TYPE_REAL64), None);
    }

    #[test]
    fn names_are_checked() {
        assert_eq!(
            Name::new("MIS_TAKEOFF_ALT").unwrap().as_str(),
            "MIS_TAKEOFF_ALT"
        );
        assert_eq!(Name::new("SIXTEEN_LETTERS_").unwrap().as_str().len(), 16);
        assert!(Name::new("").is_err());
        assert!(Name::new("SEVENTEEN_LETTERS").is_err());
        assert!(Name::new("A B").is_err());
    }
}
