//! Altitude types (0802.09, 0043.17 and their like) and the MAVLink frames that they are flown in.
//!
//! | type | flown as |
//! |---|---|
//! | 0 pressure altitude: what an altimeter set to 1013.25 hPa shows | AMSL, by the altimeter setting |
//! | 1 barometric altitude: what an altimeter set to the altimeter setting shows | AMSL |
//! | 2 AGL | above home, or refused: `vehicle.agl` |
//! | 3 WGS-84: above the ellipsoid | AMSL, by the vehicle's geoid separation |

use stanag_msgs::enums::AltitudeType;

/// Frame 5, GLOBAL_INT: metres above mean sea level.
pub const FRAME_AMSL: u8 = 5;
/// Frame 6, GLOBAL_RELATIVE_ALT_INT: metres above home.
pub const FRAME_ABOVE_HOME: u8 = 6;

/// How altitude type 2 (AGL) is flown: `vehicle.agl`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Agl {
    /// As height above home; PX4 refuses the terrain frame.
    #[default]
    AboveHome,
    /// Not at all.
    Refuse,
}

/// An altitude as MAVLink takes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Level {
    /// Metres above mean sea level.
    Amsl(f64),
    /// Metres above home.
    AboveHome(f64),
}

impl Level {
    /// The MAVLink frame and its z.
    #[must_use]
    pub fn frame(self) -> (u8, f64) {
        match self {
            Level::Amsl(m) => (FRAME_AMSL, m),
            Level::AboveHome(m) => (FRAME_ABOVE_HOME, m),
        }
    }

    /// What a MAVLink item with a place is flown at; `None` for a frame in which nothing of ours is.
    #[must_use]
    pub fn of_frame(frame: u8, z: f64) -> Option<Level> {
        match frame {
            FRAME_AMSL | 0 => Some(Level::Amsl(z)),
            FRAME_ABOVE_HOME | 3 => Some(Level::AboveHome(z)),
            _ => None,
        }
    }

    /// Metres above mean sea level, given home's.
    #[must_use]
    pub fn amsl(self, home_amsl_m: f64) -> f64 {
        match self {
            Level::Amsl(m) => m,
            Level::AboveHome(m) => home_amsl_m + m,
        }
    }

    /// Metres above home, given home's altitude.
    #[must_use]
    pub fn above_home(self, home_amsl_m: f64) -> f64 {
        match self {
            Level::Amsl(m) => m - home_amsl_m,
            Level::AboveHome(m) => m,
        }
    }
}

/// An altimeter setting (0043.16): the pressure at mean sea level, reduced by the standard atmosphere (QNH).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Altimeter {
    pascal: f64,
}

impl Default for Altimeter {
    fn default() -> Self {
        Altimeter::STANDARD
    }
}

impl Altimeter {
    /// 1013.25 hPa.
    pub const STANDARD: Altimeter = Altimeter { pascal: 101_325.0 };

    /// A setting in Pa.
    ///
    /// # Errors
    /// It is outside 800 to 1100 hPa: no weather is so.
    pub fn new(pascal: f64) -> Result<Altimeter, AltitudeError> {
        if (80_000.0..=110_000.0).contains(&pascal) {
            Ok(Altimeter { pascal })
        } else {
            Err(AltitudeError::Setting((pascal / 100.0).round() as i32))
        }
    }

    /// The setting, Pa.
    #[must_use]
    pub fn pascal(self) -> f64 {
        self.pascal
    }

    /// Metres above mean sea level of a pressure altitude.
    #[must_use]
    pub fn amsl_of_pressure_altitude(self, pressure_altitude_m: f64) -> f64 {
        SCALE_M - (SCALE_M - pressure_altitude_m) * self.ratio()
    }

    /// The pressure altitude of metres above mean sea level.
    #[must_use]
    pub fn pressure_altitude(self, amsl_m: f64) -> f64 {
        SCALE_M - (SCALE_M - amsl_m) / self.ratio()
    }

    fn ratio(self) -> f64 {
        (Altimeter::STANDARD.pascal / self.pascal).powf(EXPONENT)
    }
}

/// An altitude that cannot be flown as it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AltitudeError {
    /// No altitude type beside the altitude: guessing one could be hundreds of metres off.
    #[error("altitude without its type")]
    NoType,
    /// Type 2 while `vehicle.agl` is "refuse".
    #[error("altitude type 2 (AGL) is refused by configuration")]
    Agl,
    /// Type 3 before the vehicle has reported its geoid separation.
    #[error("altitude type 3 (WGS-84): the vehicle's geoid separation is not known yet")]
    NoGeoid,
    /// A type that no source names.
    #[error("altitude type {0} is not known, expected 0 to 3")]
    Unknown(u8),
    /// An altimeter setting, hPa, that no weather has.
    #[error("altimeter setting {0} hPa, expected 800 to 1100")]
    Setting(i32),
}

/// Turns an altitude of the DLI into a level that MAVLink can carry.
///
/// `geoid_m` is the height of the geoid above the ellipsoid.
///
/// # Errors
/// The type is absent, unknown, refused by `agl`, or needs a geoid separation that is not known.
pub fn level(
    altitude_m: f64,
    altitude_type: Option<AltitudeType>,
    geoid_m: Option<f64>,
    agl: Agl,
    altimeter: Altimeter,
) -> Result<Level, AltitudeError> {
    match altitude_type.ok_or(AltitudeError::NoType)? {
        AltitudeType::Pressure => Ok(Level::Amsl(altimeter.amsl_of_pressure_altitude(altitude_m))),
        AltitudeType::Barometric => Ok(Level::Amsl(altitude_m)),
        AltitudeType::Agl => match agl {
            Agl::AboveHome => Ok(Level::AboveHome(altitude_m)),
            Agl::Refuse => Err(AltitudeError::Agl),
        },
        AltitudeType::Wgs84 => geoid_m
            .map(|geoid| Level::Amsl(altitude_m - geoid))
            .ok_or(AltitudeError::NoGeoid),
        other => Err(AltitudeError::Unknown(other.raw())),
    }
}

/// Standard atmosphere: temperature at sea level over lapse rate, 288.15 K / 0.0065 K/m.
const SCALE_M: f64 = 288.15 / 0.0065;
/// Lapse rate times gas constant over gravity, 0.0065 * 287.053 / 9.80665.
const EXPONENT: f64 = 0.190_263;

#[cfg(test)]
mod tests {
    use super::*;

    const STANDARD: Altimeter = Altimeter::STANDARD;

    #[test]
    fn a_pressure_altitude_is_flown_by_the_altimeter_setting() {
        let flown = |kind, pascal| {
            let altimeter = Altimeter::new(pascal).unwrap();
            match level(1_000.0, Some(kind), None, Agl::Refuse, altimeter) {
                Ok(Level::Amsl(m)) => m,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(flown(AltitudeType::Barometric, 103_000.0), 1_000.0);
        assert!((flown(AltitudeType::Pressure, 101_325.0) - 1_000.0).abs() < 1e-9);
        // A pilot's rule: about 27 to 28 ft, 8.2 to 8.6 m, a hectopascal, higher where the pressure is.
        let high = flown(AltitudeType::Pressure, 103_325.0) - 1_000.0;
        assert!((155.0..175.0).contains(&high), "{high}");
        let low = flown(AltitudeType::Pressure, 99_325.0) - 1_000.0;
        assert!((-175.0..-155.0).contains(&low), "{low}");
        let altimeter = Altimeter::new(99_000.0).unwrap();
        let back = altimeter.pressure_altitude(altimeter.amsl_of_pressure_altitude(431.0));
        assert!((back - 431.0).abs() < 1e-9);
        assert_eq!(Altimeter::new(2_992.0), Err(AltitudeError::Setting(30)));
    }

    #[test]
    fn ellipsoid_height_is_lowered_by_the_geoid() {
        assert_eq!(
            level(
                535.4,
                Some(AltitudeType::Wgs84),
                Some(47.4),
                Agl::AboveHome,
                STANDARD
            ),
            Ok(Level::Amsl(488.0))
        );
        assert_eq!(
            level(
                535.4,
                Some(AltitudeType::Wgs84),
                None,
                Agl::AboveHome,
                STANDARD
            ),
            Err(AltitudeError::NoGeoid)
        );
    }

    #[test]
    fn agl_is_above_home_unless_refused() {
        assert_eq!(
            level(
                30.0,
                Some(AltitudeType::Agl),
                None,
                Agl::AboveHome,
                STANDARD
            ),
            Ok(Level::AboveHome(30.0))
        );
        assert_eq!(
            level(30.0, Some(AltitudeType::Agl), None, Agl::Refuse, STANDARD),
            Err(AltitudeError::Agl)
        );
        assert_eq!(
            level(30.0, None, None, Agl::AboveHome, STANDARD),
            Err(AltitudeError::NoType)
        );
    }
}
