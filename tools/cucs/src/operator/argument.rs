//! Arguments that several subcommands have: places and the datum of an altitude.

use stanag_msgs::enums::AltitudeType;

use route_files::route::form::altitude_type_named;

/// An argument with none of the expected values.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {0}")]
pub struct Expected(pub(super) &'static str);

/// The datum of an altitude by name.
pub(super) fn altitude_type(text: &str) -> Result<AltitudeType, Expected> {
    altitude_type_named(text).ok_or(Expected("agl, wgs84, amsl or pressure"))
}

/// `LAT,LON` in degrees.
pub(super) fn degrees(text: &str) -> Result<(f64, f64), Expected> {
    let expected = Expected("LAT,LON: -90 to 90 and -180 to 180 degrees");
    let Some((latitude, longitude)) = text.split_once(',') else {
        return Err(expected);
    };
    match (latitude.trim().parse(), longitude.trim().parse()) {
        (Ok(latitude), Ok(longitude))
            if (-90.0..=90.0).contains(&latitude) && (-180.0..=180.0).contains(&longitude) =>
        {
            Ok((latitude, longitude))
        }
        _ => Err(expected),
    }
}
