//! A route as the text of a route file.

use std::fmt::Write as _;

use stanag_msgs::enums::AltitudeType;

use super::form::{
    ALTITUDE_TYPES, DIRECTIONS, LIMITS, LOITERS, Names, ROUTE_TYPES, SPEED_TYPES, TURNS,
};
use super::model::{Curve, CurveForm, Loiter, LoiterSpan, Place, Route, Waypoint};

impl Route {
    /// The text of a route file that reads as this route. Angles carry 8 decimals, a millimetre; values that the file
    /// has no word for are left out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        string(&mut out, "mission_id", self.mission_id.as_deref());
        string(&mut out, "id", self.id.as_deref());
        word(&mut out, "type", self.route_type, &ROUTE_TYPES);
        number(
            &mut out,
            "initial",
            self.initial.filter(|number| *number != 0),
        );
        for further in &self.further {
            out.push_str("\n[[route]]\n");
            string(&mut out, "id", further.id.as_deref());
            word(&mut out, "type", further.route_type, &ROUTE_TYPES);
            number(&mut out, "initial", Some(further.initial));
        }
        for point in &self.waypoints {
            waypoint(&mut out, point);
        }
        for leg in &self.curves {
            curve(&mut out, leg);
        }
        out
    }
}

fn waypoint(out: &mut String, point: &Waypoint) {
    out.push_str("\n[[waypoint]]\n");
    number(out, "number", Some(point.number));
    angle(out, "latitude", point.latitude_deg);
    angle(out, "longitude", point.longitude_deg);
    metres(out, "altitude", Some(point.altitude_m));
    word(out, "altitude_type", point.altitude_type, &ALTITUDE_TYPES);
    metres(out, "speed", point.speed_m_s);
    word(out, "speed_type", point.speed_type, &SPEED_TYPES);
    number(out, "next", Some(point.next));
    word(out, "turn", point.turn, &TURNS);
    if let Some(repeat) = point.repeat {
        let kind = LIMITS.word(repeat.limit_type).unwrap_or("none");
        line(
            out,
            format_args!("loop = {{ limit = {}, type = \"{kind}\" }}", repeat.limit),
        );
    }
    if let Some(there) = &point.loiter {
        loiter(out, there);
    }
}

fn loiter(out: &mut String, loiter: &Loiter) {
    out.push_str("[waypoint.loiter]\n");
    word(out, "type", loiter.pattern, &LOITERS);
    metres(out, "radius", loiter.radius_m);
    metres(out, "length", loiter.length_m);
    metres(
        out,
        "bearing",
        loiter.bearing_deg.map(|degrees| degrees.rem_euclid(360.0)),
    );
    word(out, "direction", loiter.direction, &DIRECTIONS);
    metres(out, "speed", loiter.speed_m_s);
    match loiter.span {
        Some(LoiterSpan::Seconds(seconds)) => number(out, "seconds", Some(seconds)),
        Some(LoiterSpan::Turns(turns)) => number(out, "turns", Some(turns)),
        None => {}
    }
}

fn curve(out: &mut String, curve: &Curve) {
    out.push_str("\n[[curve]]\n");
    number(out, "from", Some(curve.from));
    number(out, "to", Some(curve.to));
    line(out, format_args!("p2 = {}", place(&curve.p2)));
    line(out, format_args!("p3 = {}", place(&curve.p3)));
    word::<AltitudeType>(out, "altitude_type", curve.altitude_type, &ALTITUDE_TYPES);
    if curve.form == CurveForm::Paper {
        number(out, "message", Some(50001));
    }
}

fn place(place: &Place) -> String {
    let altitude = place
        .altitude_m
        .map_or_else(String::new, |m| format!(", {}", hundredths(m)));
    format!(
        "[{:.8}, {:.8}{altitude}]",
        place.latitude_deg, place.longitude_deg
    )
}

fn string(out: &mut String, key: &str, value: Option<&str>) {
    if let Some(value) = value {
        line(out, format_args!("{key} = {}", toml::Value::from(value)));
    }
}

fn word<T: Copy + PartialEq>(out: &mut String, key: &str, value: Option<T>, names: &Names<T>) {
    if let Some(word) = value.and_then(|value| names.word(value)) {
        line(out, format_args!("{key} = \"{word}\""));
    }
}

fn number(out: &mut String, key: &str, value: Option<u16>) {
    if let Some(value) = value {
        line(out, format_args!("{key} = {value}"));
    }
}

fn angle(out: &mut String, key: &str, degrees: f64) {
    line(out, format_args!("{key} = {degrees:.8}"));
}

fn metres(out: &mut String, key: &str, value: Option<f64>) {
    if let Some(value) = value {
        line(out, format_args!("{key} = {}", hundredths(value)));
    }
}

/// As a TOML number, to a hundredth: every field is coarser.
fn hundredths(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{text}");
}
