//! Quantities that stand on the wire as an integer times a fixed step.

use std::fmt;
use std::marker::PhantomData;

use super::{Field, I24, Integer, U24};
use crate::codec::{Fault, Reader, Writer};
use crate::table::Wire;

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

    /// The quantity nearest to a value in the unit of `S`, the nearest limit where it is beyond
    /// them. A value that is no number gives 0, or the lowest that there is.
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
    /// The least that the quantity expresses.
    pub low: f64,
    /// The greatest that the quantity expresses.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_step_is_taken() {
        assert_eq!(Altitude::from_si(100.011).unwrap().raw().get(), 5001);
        assert_eq!(Altitude::from_raw(I24::new(5001).unwrap()).si(), 100.02);
        assert_eq!(Velocity::from_si(-1.0).unwrap().raw(), -20);
        assert_eq!(format!("{:?}", Speed::from_raw(21)), "10.5 m/s");
    }

    #[test]
    fn values_beyond_the_wire_are_refused() {
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
}
