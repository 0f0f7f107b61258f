//! The form of a route file: its keys, each value with its place in the text, and its words for enumerations.

use serde::Deserialize;
use serde::de::IgnoredAny;
use stanag_msgs::enums::{
    AltitudeType, LimitType, LoiterDirection, LoiterType, RouteType, TurnType, WaypointSpeedType,
};
use toml::Spanned;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    pub(crate) mission_id: Option<String>,
    pub(crate) id: Option<String>,
    #[serde(rename = "type")]
    pub(crate) route_type: Option<Spanned<String>>,
    pub(crate) initial: Option<Spanned<u16>>,
    #[serde(default)]
    pub(crate) route: Vec<FileRoute>,
    #[serde(default)]
    pub(crate) defaults: FileDefaults,
    pub(crate) waypoint: Vec<FileWaypoint>,
    #[serde(default)]
    pub(crate) curve: Vec<FileCurve>,
    /// A geofence, which `fence::parse` reads.
    #[serde(rename = "area")]
    pub(crate) _area: Option<IgnoredAny>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileRoute {
    pub(crate) id: Option<String>,
    #[serde(rename = "type")]
    pub(crate) route_type: Option<Spanned<String>>,
    pub(crate) initial: Spanned<u16>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileDefaults {
    pub(crate) altitude: Option<Spanned<f64>>,
    pub(crate) altitude_type: Option<Spanned<String>>,
    pub(crate) speed: Option<Spanned<f64>>,
    pub(crate) speed_type: Option<Spanned<String>>,
    pub(crate) turn: Option<Spanned<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileWaypoint {
    pub(crate) number: Spanned<u16>,
    pub(crate) latitude: Spanned<f64>,
    pub(crate) longitude: Spanned<f64>,
    pub(crate) altitude: Option<Spanned<f64>>,
    pub(crate) altitude_type: Option<Spanned<String>>,
    pub(crate) speed: Option<Spanned<f64>>,
    pub(crate) speed_type: Option<Spanned<String>>,
    pub(crate) next: Option<Spanned<u16>>,
    pub(crate) turn: Option<Spanned<String>>,
    pub(crate) loiter: Option<FileLoiter>,
    #[serde(rename = "loop")]
    pub(crate) repeat: Option<FileLoop>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileLoiter {
    #[serde(rename = "type")]
    pub(crate) pattern: Option<Spanned<String>>,
    pub(crate) radius: Option<Spanned<f64>>,
    pub(crate) length: Option<Spanned<f64>>,
    pub(crate) bearing: Option<Spanned<f64>>,
    pub(crate) direction: Option<Spanned<String>>,
    pub(crate) speed: Option<Spanned<f64>>,
    pub(crate) seconds: Option<Spanned<u16>>,
    pub(crate) turns: Option<Spanned<u16>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileLoop {
    pub(crate) limit: Spanned<u16>,
    #[serde(rename = "type")]
    pub(crate) limit_type: Option<Spanned<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FileCurve {
    pub(crate) from: Spanned<u16>,
    pub(crate) to: Spanned<u16>,
    pub(crate) p2: Spanned<Vec<f64>>,
    pub(crate) p3: Spanned<Vec<f64>>,
    pub(crate) altitude_type: Option<Spanned<String>>,
    pub(crate) message: Option<Spanned<u16>>,
}

/// Words and values of one field, the first word of a value being the one that is written.
pub(crate) struct Names<T: 'static>(&'static [(&'static str, T)]);

impl<T: Copy + PartialEq> Names<T> {
    pub(crate) fn value(&self, word: &str) -> Option<T> {
        let found = self.0.iter().find(|(name, _)| *name == word);
        found.map(|(_, value)| *value)
    }

    pub(crate) fn word(&self, value: T) -> Option<&'static str> {
        let found = self.0.iter().find(|(_, known)| *known == value);
        found.map(|(name, _)| *name)
    }

    /// `agl, wgs84, ...`, for a message.
    pub(crate) fn expected(&self) -> String {
        let words: Vec<&str> = self.0.iter().map(|(name, _)| *name).collect();
        words.join(", ")
    }
}

pub(crate) const ROUTE_TYPES: Names<RouteType> = Names(&[
    ("launch", RouteType::Launch),
    ("approach", RouteType::Approach),
    ("flight", RouteType::Flight),
    ("contingency-a", RouteType::ContingencyA),
    ("contingency-b", RouteType::ContingencyB),
]);

pub(crate) const ALTITUDE_TYPES: Names<AltitudeType> = Names(&[
    ("agl", AltitudeType::Agl),
    ("wgs84", AltitudeType::Wgs84),
    ("amsl", AltitudeType::Barometric),
    ("pressure", AltitudeType::Pressure),
]);

pub(crate) const SPEED_TYPES: Names<WaypointSpeedType> = Names(&[
    ("ground", WaypointSpeedType::Ground),
    ("indicated", WaypointSpeedType::Indicated),
    ("true", WaypointSpeedType::True),
]);

pub(crate) const TURNS: Names<TurnType> = Names(&[
    ("short", TurnType::ShortTurn),
    ("fly-over", TurnType::FlyOver),
]);

pub(crate) const LOITERS: Names<LoiterType> = Names(&[
    ("circular", LoiterType::Circular),
    ("racetrack", LoiterType::Racetrack),
    ("figure-8", LoiterType::Figure8),
    ("hover", LoiterType::Hover),
]);

pub(crate) const DIRECTIONS: Names<LoiterDirection> = Names(&[
    ("clockwise", LoiterDirection::Clockwise),
    ("counter-clockwise", LoiterDirection::CounterClockwise),
    ("vehicle", LoiterDirection::VehicleDependent),
    ("into-wind", LoiterDirection::IntoWind),
]);

pub(crate) const LIMITS: Names<LimitType> = Names(&[
    ("none", LimitType::None),
    ("count", LimitType::Count),
    ("time", LimitType::Time),
]);

/// The altitude type that `agl`, `wgs84`, `amsl` or `pressure` means.
#[must_use]
pub fn altitude_type_named(word: &str) -> Option<AltitudeType> {
    ALTITUDE_TYPES.value(word)
}

/// The word for an altitude type; its number where there is none.
#[must_use]
pub fn altitude_type_name(value: AltitudeType) -> String {
    let word = ALTITUDE_TYPES.word(value).map(str::to_owned);
    word.unwrap_or_else(|| format!("type {}", value.raw()))
}
