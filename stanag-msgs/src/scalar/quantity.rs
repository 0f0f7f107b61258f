//! Quantities with a unit: binary angles, integers times a fixed step, time stamps.
//!
//! ```
//! use stanag_msgs::{Bam32, scalar::Altitude};
//!
//! let altitude = Altitude::from_si(120.0)?; // metres, in steps of 0.02 m
//! assert_eq!((altitude.raw().get(), altitude.si()), (6000, 120.0));
//! assert_eq!(Bam32::from_degrees(180.0).radians(), -std::f64::consts::PI);
//! # Ok::<(), stanag_msgs::OutOfRange>(())
//! ```

use std::f64::consts::TAU;
use std::fmt;
use std::marker::PhantomData;

use super::integer::{I24, Integer, U24, U40};
use crate::bytes::{Fault, Reader, Writer};
use crate::field::{Field, Wire};

macro_rules! bams {
    ($($(#[$doc:meta])* $Name:ident($Raw:ident), $bits:literal;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $Name(pub $Raw);

        impl $Name {
            /// One step in radians.
            pub const STEP: f64 = Wire::$Name.step();

            /// The nearest value to an angle in radians, modulo whole turns: pi gives the same as -pi. An angle that
            /// is not finite gives 0, so the caller has to check it before.
            pub fn from_radians(angle: f64) -> Self {
                Self::from_turns(angle / TAU)
            }

            /// The nearest value to an angle in degrees; see [`Self::from_radians`].
            pub fn from_degrees(angle: f64) -> Self {
                Self::from_turns(angle / 360.0)
            }

            fn from_turns(turns: f64) -> Self {
                let steps = (turns - turns.round()) * (1u64 << $bits) as f64;
                // Half a turn is one step above the largest value and wraps to the smallest.
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

/// What one step of a quantity is worth.
pub trait Scale: Copy {
    /// The step, in [`Scale::UNIT`].
    const STEP: f64;
    /// The unit of the value.
    const UNIT: &'static str;
}

/// A quantity: the integer `R` on the wire, times the step of `S`.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Scaled<R, S>(R, PhantomData<S>);

impl<R: Integer, S: Scale> Scaled<R, S> {
    /// The quantity of this integer on the wire.
    pub const fn from_raw(raw: R) -> Self {
        Self(raw, PhantomData)
    }

    /// The integer on the wire.
    pub const fn raw(self) -> R {
        self.0
    }

    /// The value in the unit of `S`.
    pub fn si(self) -> f64 {
        self.0.to_i64() as f64 * S::STEP
    }

    /// The quantity nearest to a value in the unit of `S`.
    ///
    /// # Errors
    /// The value is not a number, or outside the range of the wire integer.
    pub fn from_si(value: f64) -> Result<Self, OutOfRange> {
        let steps = (value / S::STEP).round();
        if steps >= R::LOW as f64 && steps <= R::HIGH as f64 {
            Ok(Self::from_raw(R::clamped(steps as i64)))
        } else {
            Err(OutOfRange {
                value,
                low: Self::low(),
                high: Self::high(),
                unit: S::UNIT,
            })
        }
    }

    /// The quantity nearest to a value in the unit of `S`, or the nearest limit if the value is outside the range.
    /// Not a number gives 0.
    pub fn saturating_from_si(value: f64) -> Self {
        Self::from_raw(R::clamped((value / S::STEP).round() as i64))
    }

    fn low() -> f64 {
        R::LOW as f64 * S::STEP
    }

    fn high() -> f64 {
        R::HIGH as f64 * S::STEP
    }
}

impl<R: Integer, S: Scale> fmt::Debug for Scaled<R, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.si(), S::UNIT)
    }
}

impl<R: Integer, S: Scale> Field for Scaled<R, S> {
    const WIRE: Wire = R::WIRE;
    const SCALE: Option<f64> = Some(S::STEP);
    const UNIT: Option<&'static str> = Some(S::UNIT);

    #[inline]
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
        R::read(reader).map(Self::from_raw)
    }

    #[inline]
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
        self.0.write(writer)
    }
}

/// A value that a quantity cannot express.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{value} {unit} is outside {low} to {high} {unit}")]
pub struct OutOfRange {
    /// The value.
    pub value: f64,
    /// The smallest value of the quantity.
    pub low: f64,
    /// The largest value of the quantity.
    pub high: f64,
    /// The unit of all three.
    pub unit: &'static str,
}

macro_rules! quantities {
    ($($(#[$doc:meta])* $Name:ident = $Raw:ident * $step:literal $unit:literal;)*) => {
        /// The steps of the quantities, one type each.
        pub mod scale {
            use super::Scale;
            $(
                #[doc = concat!("A step of ", stringify!($step), " ", $unit, ".")]
                #[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
                pub struct $Name;

                impl Scale for $Name {
                    const STEP: f64 = $step;
                    const UNIT: &'static str = $unit;
                }
            )*
        }
        $(
            $(#[$doc])*
            #[doc = concat!("\n\nWire: `", stringify!($Raw), "`, step ", stringify!($step), " ", $unit, ".")]
            pub type $Name = Scaled<$Raw, scale::$Name>;
        )*
    };
}

quantities! {
    /// An altitude, above the datum that the message's Altitude Type names.
    Altitude = I24 * 0.02 "m";
    /// A commanded or waypoint speed.
    Speed = u16 * 0.5 "m/s";
    /// An air speed.
    Airspeed = u16 * 0.05 "m/s";
    /// A component of a velocity, or a vertical speed.
    Velocity = i16 * 0.05 "m/s";
    /// A component of an acceleration.
    Acceleration = i16 * 0.005 "m/s^2";
    /// A rate of an Euler angle.
    AngularRate = i16 * 0.005 "rad/s";
    /// A commanded turn rate, or a body rate; see [`crate::disputed`] for the turn rate.
    FineAngularRate = i16 * 0.0001 "rad/s";
    /// A deflection in one byte.
    SmallAngle = i8 * 0.02 "rad";
    /// A loiter radius or length.
    Distance = u16 * 1.5 "m";
    /// A pressure.
    Pressure = u16 * 10.0 "Pa";
    /// A temperature.
    Temperature = u16 * 0.5 "K";
    /// An engine speed.
    EngineSpeed = u16 * 0.5 "rad/s";
    /// An engine's power setting.
    PowerSetting = u16 * 0.0017 "%";
    /// The energy left for propulsion.
    EnergyLevel = u16 * 0.0016 "%";
    /// The energy at the start (2000), on a step of its own.
    InitialEnergy = u16 * 0.002 "%";
    /// How fast energy is used.
    EnergyRate = u16 * 0.0002 "%/s";
    /// An engine's energy flow (3007).
    EnergyFlow = U24 * 0.0017 "%/s";
}

/// Milliseconds since 2000-01-01 00:00 UTC in five bytes; rolls over on 2034-11-03.
///
/// The stamp is when the data was valid. Leap seconds are not counted, as in Unix time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TimeStamp(pub u64);

impl TimeStamp {
    /// 2000-01-01 00:00 UTC in milliseconds of Unix time.
    pub const EPOCH_UNIX_MS: u64 = 946_684_800_000;
    /// The milliseconds until the counter rolls over: 2^40.
    pub const PERIOD_MS: u64 = 1 << 40;
    /// The unit, as the message table names it.
    pub const UNIT: &'static str = "ms since 2000-01-01T00:00:00Z";

    /// The stamp of a Unix time in milliseconds. A time before 2000 gives 0; for a time after the rollover the 40-bit
    /// counter has started again.
    pub const fn from_unix_ms(unix_ms: u64) -> Self {
        Self(unix_ms.saturating_sub(Self::EPOCH_UNIX_MS) % Self::PERIOD_MS)
    }

    /// The Unix time in milliseconds, of the first period.
    pub const fn unix_ms(self) -> u64 {
        self.0.saturating_add(Self::EPOCH_UNIX_MS)
    }

    /// The Unix time in milliseconds, of the period that puts it nearest to `near_ms`: the five bytes do not show
    /// their period.
    pub const fn unix_ms_near(self, near_ms: u64) -> u64 {
        let first = self.unix_ms();
        let beyond = near_ms
            .saturating_add(Self::PERIOD_MS / 2)
            .saturating_sub(first);
        first.saturating_add(beyond / Self::PERIOD_MS * Self::PERIOD_MS)
    }
}

/// Only the low 40 bits are written.
impl Field for TimeStamp {
    const WIRE: Wire = Wire::U40;
    const UNIT: Option<&'static str> = Some(TimeStamp::UNIT);

    #[inline]
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
        U40::read(reader).map(|raw| Self(raw.get()))
    }

    #[inline]
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
        let [_, _, _, a, b, c, d, e] = self.0.to_be_bytes();
        writer.put([a, b, c, d, e])
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn half_a_turn_is_the_smallest_value() {
        assert_eq!(Bam16::from_degrees(180.0), Bam16(i16::MIN));
        assert_eq!(Bam16::from_degrees(-180.0), Bam16(i16::MIN));
        assert_eq!(Bam16::from_degrees(179.999), Bam16(i16::MIN));
        assert_eq!(Bam32::from_radians(PI), Bam32(i32::MIN));
        assert_eq!(Bam32(i32::MIN).radians(), -PI);
        assert_eq!(Bam32(i32::MIN).degrees(), -180.0);
    }

    #[test]
    fn whole_turns_are_dropped() {
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

    #[test]
    fn the_nearest_step_is_taken() {
        assert_eq!(Altitude::from_si(100.011).unwrap().raw().get(), 5001);
        assert_eq!(Altitude::from_raw(I24::new(5001).unwrap()).si(), 100.02);
        assert_eq!(Velocity::from_si(-1.0).unwrap().raw(), -20);
        assert_eq!(format!("{:?}", Speed::from_raw(21)), "10.5 m/s");
    }

    #[test]
    fn values_outside_the_wire_range_are_refused() {
        let error = Speed::from_si(-1.0).unwrap_err();
        assert_eq!(error.to_string(), "-1 m/s is outside 0 to 32767.5 m/s");
        assert!(Speed::from_si(f64::NAN).is_err());
        assert!(Altitude::from_si(f64::INFINITY).is_err());
        assert!(Velocity::from_si(1638.35).is_ok());
        assert!(Velocity::from_si(1638.4).is_err());
        assert_eq!(Velocity::saturating_from_si(1e9).raw(), i16::MAX);
        assert_eq!(Speed::saturating_from_si(-4.0).raw(), 0);
    }

    #[test]
    fn every_raw_value_comes_back() {
        for raw in i16::MIN..=i16::MAX {
            let rate = FineAngularRate::from_raw(raw);
            assert_eq!(FineAngularRate::from_si(rate.si()), Ok(rate));
        }
    }

    #[test]
    fn the_epoch_is_zero() {
        assert_eq!(
            TimeStamp::from_unix_ms(TimeStamp::EPOCH_UNIX_MS),
            TimeStamp(0)
        );
        assert_eq!(TimeStamp::from_unix_ms(0), TimeStamp(0));
        assert_eq!(
            TimeStamp::from_unix_ms(1_700_000_000_123).unix_ms(),
            1_700_000_000_123
        );
    }

    #[test]
    fn leap_seconds_are_not_counted() {
        // 2016-12-31T23:59:59Z, a leap second, 2017-01-01T00:00:00Z.
        let before = TimeStamp::from_unix_ms(1_483_228_799_000);
        let after = TimeStamp::from_unix_ms(1_483_228_800_000);
        assert_eq!(after.0 - before.0, 1_000);
        let days = 17 * 365 + 5;
        assert_eq!(after, TimeStamp(days * 86_400_000));
    }

    #[test]
    fn the_count_rolls_over_in_2034() {
        let last = TimeStamp(TimeStamp::PERIOD_MS - 1);
        assert_eq!(last.unix_ms(), 2_046_196_427_775);
        assert_eq!(TimeStamp::from_unix_ms(last.unix_ms() + 1), TimeStamp(0));
        for unix_ms in [last.unix_ms(), last.unix_ms() + 1, 4_000_000_000_000] {
            for apart in [-86_400_000, 0, 86_400_000] {
                let near = unix_ms.saturating_add_signed(apart);
                let stamp = TimeStamp::from_unix_ms(unix_ms);
                assert_eq!(stamp.unix_ms_near(near), unix_ms, "{apart}");
            }
        }
    }
}
