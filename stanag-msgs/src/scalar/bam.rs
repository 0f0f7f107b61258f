//! Binary angular measure: the whole circle is the whole range of a two's-complement integer.

use std::f64::consts::{PI, TAU};

use super::Field;
use crate::codec::{Fault, Reader, Writer};
use crate::table::Wire;

macro_rules! bams {
    ($($(#[$doc:meta])* $Name:ident($Raw:ident), $bits:literal;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $Name(pub $Raw);

        impl $Name {
            /// One step in radians.
            pub const STEP: f64 = PI / (1u64 << ($bits - 1)) as f64;

            /// The nearest value to an angle in radians; whole turns fall away, so that pi gives
            /// the same as -pi. An angle that is not finite gives 0: check it before.
            pub fn from_radians(angle: f64) -> Self {
                Self::from_turns(angle / TAU)
            }

            /// The nearest value to an angle in degrees; see [`Self::from_radians`].
            pub fn from_degrees(angle: f64) -> Self {
                Self::from_turns(angle / 360.0)
            }

            fn from_turns(turns: f64) -> Self {
                let steps = (turns - turns.round()) * (1u64 << $bits) as f64;
                // Half a turn is one step above the greatest value and wraps to the least.
                Self(steps.round() as i64 as $Raw)
            }

            /// The angle in radians, -pi <= angle < pi.
            pub fn radians(self) -> f64 {
                f64::from(self.0) * Self::STEP
            }

            /// The angle in degrees, -180 <= angle < 180.
            pub fn degrees(self) -> f64 {
                f64::from(self.0) * (180.0 / (1u64 << ($bits - 1)) as f64)
            }
        }

        impl Field for $Name {
            const WIRE: Wire = Wire::$Name;
            const UNIT: Option<&'static str> = Some("rad");

            #[inline]
            fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
                $Raw::read(reader).map(Self)
            }

            #[inline]
            fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
                self.0.write(writer)
            }
        }
    )* };
}

bams! {
    /// An angle in 16 bits, a step of 0.0055 degrees: headings, attitudes.
    Bam16(i16), 16;
    /// An angle in 32 bits, a step of 8.4e-8 degrees (9.3 mm of latitude): positions.
    Bam32(i32), 32;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_turn_is_the_least_value() {
        assert_eq!(Bam16::from_degrees(180.0), Bam16(i16::MIN));
        assert_eq!(Bam16::from_degrees(-180.0), Bam16(i16::MIN));
        assert_eq!(Bam16::from_degrees(179.999), Bam16(i16::MIN));
        assert_eq!(Bam32::from_radians(PI), Bam32(i32::MIN));
        assert_eq!(Bam32(i32::MIN).radians(), -PI);
        assert_eq!(Bam32(i32::MIN).degrees(), -180.0);
    }

    #[test]
    fn turns_fall_away() {
        assert_eq!(Bam16::from_degrees(270.0), Bam16::from_degrees(-90.0));
        assert_eq!(Bam16::from_degrees(-90.0), Bam16(-0x4000));
        assert_eq!(Bam16::from_degrees(720.0 + 45.0), Bam16(0x2000));
        assert_eq!(Bam32::from_radians(5.0 * PI / 2.0).degrees(), 90.0);
        assert_eq!(Bam32::from_radians(f64::NAN), Bam32(0));
        assert_eq!(Bam32::from_radians(f64::INFINITY), Bam32(0));
    }

    #[test]
    fn every_value_comes_back() {
        for raw in i16::MIN..=i16::MAX {
            assert_eq!(Bam16::from_radians(Bam16(raw).radians()), Bam16(raw));
            assert_eq!(Bam16::from_degrees(Bam16(raw).degrees()), Bam16(raw));
        }
        for raw in (i32::MIN..i32::MAX).step_by(9_999_991) {
            assert_eq!(Bam32::from_radians(Bam32(raw).radians()), Bam32(raw));
            assert_eq!(Bam32::from_degrees(Bam32(raw).degrees()), Bam32(raw));
        }
    }
}
