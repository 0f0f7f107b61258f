//! Altitude types (0802.09, 0043.17 and their like) and the MAVLink frames that they are flown in.

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

    /// Metres above mean sea level, given home's.
    #[must_use]
    pub fn amsl(self, home_amsl_m: f64) -> f64 {
        match self {
            Level::Amsl(m) => m,
            Level::AboveHome(m) => home_amsl_m + m,
        }
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
    /// Type 3 before the vehicle has told its geoid separation.
    #[error("altitude type 3 (WGS-84): the vehicle's geoid separation is not known yet")]
    NoGeoid,
    /// A type that no source names.
    #[error("altitude type {0} is not known, expected 0 to 3")]
    Unknown(u8),
}

/// Turns an altitude of the DLI into a level that MAVLink can carry.
///
/// `geoid_m` is the height of the geoid above the ellipsoid. Types 0 and 1 are above mean sea level in the standard
/// atmosphere.
///
/// # Errors
/// The type is absent, unknown, refused by `agl`, or needs a geoid separation that is not known.
pub fn level(
    altitude_m: f64,
    altitude_type: Option<AltitudeType>,
    geoid_m: Option<f64>,
    agl: Agl,
) -> Result<Level, AltitudeError> {
    match altitude_type.ok_or(AltitudeError::NoType)? {
        AltitudeType::Pressure | AltitudeType::Barometric => Ok(Level::Amsl(altitude_m)),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ellipsoid_height_is_lowered_by_the_geoid() {
        assert_eq!(
            level(535.4, Some(AltitudeType::Wgs84), Some(47.4), Agl::AboveHome),
            Ok(Level::Amsl(488.0))
        );
        assert_eq!(
            level(535.4, Some(AltitudeType::Wgs84), None, Agl::AboveHome),
            Err(AltitudeError::NoGeoid)
        );
    }

    #[test]
    fn agl_is_above_home_unless_refused() {
        assert_eq!(
            level(30.0, Some(AltitudeType::Agl), None, Agl::AboveHome),
            Ok(Level::AboveHome(30.0))
        );
        assert_eq!(
            level(30.0, Some(AltitudeType::Agl), None, Agl::Refuse),
            Err(AltitudeError::Agl)
        );
        assert_eq!(
            level(30.0, None, None, Agl::AboveHome),
            Err(AltitudeError::NoType)
        );
    }
}
