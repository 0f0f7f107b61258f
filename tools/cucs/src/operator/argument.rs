//! Arguments that several subcommands have: places and the datum of an altitude.

use stanag_msgs::enums::AltitudeType;
use stanag_msgs::scalar::Speed;

use route_files::route::form::altitude_type_named;

/// An argument with none of the expected values.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {0}")]
pub struct Expected(pub(super) &'static str);

/// The datum of an altitude by name.
pub(super) fn altitude_type(text: &str) -> Result<AltitudeType, Expected> {
    altitude_type_named(text).ok_or(Expected("agl, wgs84, amsl or pressure"))
}

/// A speed that is commanded, m/s. What the message rounds to 0 is refused: a Commanded Speed of 0 commands none (2016), and the
/// vehicle would fly on as fast as before.
pub(super) fn speed(text: &str) -> Result<f64, Expected> {
    let expected =
        Expected("0.25 to 32767.5 m/s, sent in steps of 0.5 m/s: a speed of 0 commands none");
    let speed_m_s: f64 = text.trim().parse().map_err(|_| expected.clone())?;
    match Speed::from_si(speed_m_s) {
        Ok(speed) if speed.raw() > 0 => Ok(speed_m_s),
        _ => Err(expected),
    }
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
