//! Altitude types (0802.09, 0043.17 and their like) and the MAVLink frames that they are flown in.
//!
//! | type | flown as |
//! |---|---|
//! | 0 pressure altitude: what an altimeter set to 1013.25 hPa shows | AMSL, by the altimeter setting |
//! | 1 barometric altitude: what an altimeter set to the altimeter setting shows | AMSL |
//! | 2 AGL | above home, or AMSL by the ground of elevation files, or refused: `vehicle.agl` |
//! | 3 WGS-84: above the ellipsoid | AMSL, by the vehicle's geoid separation |

use curve_paths::terrain::{Terrain, tile_name};
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
    /// As height above the ground of `vehicle.terrain`; refused where that has no data.
    Terrain,
    /// Refused.
    Refuse,
}

/// An altitude in a form that MAVLink can carry.
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

    /// The level of a MAVLink item with a position; `None` for a frame that we never use.
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
    /// It is outside 800 to 1100 hPa, which no weather reaches.
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
        // The barometric formula of the troposphere, with the ratio of the two pressures at sea level.
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

/// An altitude that cannot be flown as commanded.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AltitudeError {
    /// No altitude type beside the altitude: guessing one could be hundreds of metres off.
    #[error("altitude without its type")]
    NoType,
    /// Type 2 while `vehicle.agl` is "refuse".
    #[error("altitude type 2 (AGL) is refused by configuration")]
    Agl,
    /// Type 2 while `vehicle.agl` is "terrain", at a place that no elevation file covers: a guess could be below the ground.
    #[error(
        "altitude type 2 (AGL): the height of the ground at {latitude:.6}, {longitude:.6} is not known; add {} to \
         vehicle.terrain, or command an altitude above mean sea level",
        tile_name(*latitude, *longitude)
    )]
    NoGround {
        /// Degrees north.
        latitude: f64,
        /// Degrees east.
        longitude: f64,
    },
    /// Type 3 before the vehicle has reported its geoid separation.
    #[error("altitude type 3 (WGS-84): the vehicle's geoid separation is not known yet")]
    NoGeoid,
    /// A type that no source defines.
    #[error("altitude type {0} is not known, expected 0 to 3")]
    Unknown(u8),
    /// An altimeter setting, hPa, that no weather reaches.
    #[error("altimeter setting {0} hPa, expected 800 to 1100")]
    Setting(i32),
}

/// The references by which altitudes of the DLI are converted.
#[derive(Debug, Clone, Copy)]
pub struct Datum<'a> {
    /// Height of the geoid above the ellipsoid, m, once the vehicle has reported it.
    pub geoid_m: Option<f64>,
    /// How AGL is flown.
    pub agl: Agl,
    /// The reference of pressure altitudes.
    pub altimeter: Altimeter,
    /// The ground, where elevation files are configured.
    pub terrain: Option<&'a Terrain>,
}

impl Datum<'_> {
    /// Converts an altitude of the DLI to a level that MAVLink can carry. `over`: the places, degrees north and east, that
    /// are flown over at this altitude; AGL by elevation files is above the highest of them.
    ///
    /// # Errors
    /// The type is absent, unknown, refused by `agl`, or needs a geoid separation or a ground height that is unknown.
    pub fn level(
        &self,
        altitude_m: f64,
        altitude_type: Option<AltitudeType>,
        over: impl IntoIterator<Item = (f64, f64)>,
    ) -> Result<Level, AltitudeError> {
        match altitude_type.ok_or(AltitudeError::NoType)? {
            AltitudeType::Pressure => {
                let amsl_m = self.altimeter.amsl_of_pressure_altitude(altitude_m);
                Ok(Level::Amsl(amsl_m))
            }
            AltitudeType::Barometric => Ok(Level::Amsl(altitude_m)),
            AltitudeType::Agl => match self.agl {
                Agl::AboveHome => Ok(Level::AboveHome(altitude_m)),
                Agl::Terrain => Ok(Level::Amsl(self.highest_m(over)? + altitude_m)),
                Agl::Refuse => Err(AltitudeError::Agl),
            },
            AltitudeType::Wgs84 => self
                .geoid_m
                .map(|geoid| Level::Amsl(altitude_m - geoid))
                .ok_or(AltitudeError::NoGeoid),
            other => Err(AltitudeError::Unknown(other.raw())),
        }
    }

    /// Whether an altitude of this type is a height above the ground of elevation files.
    #[must_use]
    pub fn is_above_ground(&self, altitude_type: Option<AltitudeType>) -> bool {
        self.agl == Agl::Terrain && altitude_type == Some(AltitudeType::Agl)
    }

    /// The height of the ground, m above mean sea level.
    ///
    /// # Errors
    /// It is unknown there.
    pub fn ground_m(&self, (latitude, longitude): (f64, f64)) -> Result<f64, AltitudeError> {
        let ground = self
            .terrain
            .and_then(|terrain| terrain.height_m(latitude, longitude));
        ground.ok_or(AltitudeError::NoGround {
            latitude,
            longitude,
        })
    }

    fn highest_m(&self, over: impl IntoIterator<Item = (f64, f64)>) -> Result<f64, AltitudeError> {
        let mut highest_m = f64::NEG_INFINITY;
        for place in over {
            highest_m = highest_m.max(self.ground_m(place)?);
        }
        Ok(highest_m)
    }
}

/// Standard atmosphere: temperature at sea level over lapse rate, 288.15 K / 0.0065 K/m.
const SCALE_M: f64 = 288.15 / 0.0065;
/// Lapse rate times gas constant over gravity, 0.0065 * 287.053 / 9.80665.
const EXPONENT: f64 = 0.190_263;

#[cfg(test)]
mod tests {
    use curve_paths::terrain::Grid;

    use super::*;

    const DATUM: Datum<'static> = Datum {
        geoid_m: None,
        agl: Agl::AboveHome,
        altimeter: Altimeter::STANDARD,
        terrain: None,
    };
    const HERE: [(f64, f64); 1] = [(47.0, 8.0)];

    #[test]
    fn a_pressure_altitude_is_flown_by_the_altimeter_setting() {
        let flown = |kind, pascal| {
            let datum = Datum {
                altimeter: Altimeter::new(pascal).unwrap(),
                agl: Agl::Refuse,
                ..DATUM
            };
            match datum.level(1_000.0, Some(kind), HERE) {
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
        let known = Datum {
            geoid_m: Some(47.4),
            ..DATUM
        };
        let of = |datum: Datum<'_>| datum.level(535.4, Some(AltitudeType::Wgs84), HERE);
        assert_eq!(of(known), Ok(Level::Amsl(488.0)));
        assert_eq!(of(DATUM), Err(AltitudeError::NoGeoid));
    }

    #[test]
    fn agl_is_above_home_unless_refused() {
        let of = |agl, kind| Datum { agl, ..DATUM }.level(30.0, kind, HERE);
        let agl = Some(AltitudeType::Agl);
        assert_eq!(of(Agl::AboveHome, agl), Ok(Level::AboveHome(30.0)));
        assert_eq!(of(Agl::Refuse, agl), Err(AltitudeError::Agl));
        assert_eq!(of(Agl::AboveHome, None), Err(AltitudeError::NoType));
    }

    #[test]
    fn agl_by_elevation_files_is_above_the_highest_place_and_never_guessed() {
        let text = "ncols 2 nrows 2 xllcenter 8 yllcenter 47 cellsize 0.1 100 300 100 300";
        let terrain = Terrain::new(vec![Grid::read("slope.asc", text.into()).unwrap()]);
        let datum = Datum {
            agl: Agl::Terrain,
            terrain: Some(&terrain),
            ..DATUM
        };
        let over = |places: &[(f64, f64)]| {
            datum.level(30.0, Some(AltitudeType::Agl), places.iter().copied())
        };
        assert_eq!(over(&[(47.0, 8.0)]), Ok(Level::Amsl(130.0)));
        let Ok(Level::Amsl(both)) = over(&[(47.0, 8.0), (47.05, 8.05)]) else {
            panic!("it is known");
        };
        assert!((both - 230.0).abs() < 1e-6, "{both}");
        let why = over(&[(47.0, 8.0), (47.0, 8.2)]).expect_err("no file covers it");
        let why = why.to_string();
        assert!(
            why.contains("47.000000, 8.200000 is not known; add N47E008.hgt"),
            "{why}"
        );
        let amsl = datum.level(30.0, Some(AltitudeType::Barometric), [(47.0, 8.2)]);
        assert_eq!(amsl, Ok(Level::Amsl(30.0)));
    }
}
