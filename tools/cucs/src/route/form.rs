//! The form of a route file, each value with its place in the text.

use serde::Deserialize;
use toml::Spanned;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub(super) mission_id: Option<String>,
    pub(super) id: Option<String>,
    #[serde(rename = "type")]
    pub(super) route_type: Option<Spanned<String>>,
    pub(super) initial: Option<Spanned<u16>>,
    #[serde(default)]
    pub(super) defaults: FileDefaults,
    pub(super) waypoint: Vec<FileWaypoint>,
    #[serde(default)]
    pub(super) curve: Vec<FileCurve>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileDefaults {
    pub(super) altitude: Option<Spanned<f64>>,
    pub(super) altitude_type: Option<Spanned<String>>,
    pub(super) speed: Option<Spanned<f64>>,
    pub(super) speed_type: Option<Spanned<String>>,
    pub(super) turn: Option<Spanned<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileWaypoint {
    pub(super) number: Spanned<u16>,
    pub(super) latitude: Spanned<f64>,
    pub(super) longitude: Spanned<f64>,
    pub(super) altitude: Option<Spanned<f64>>,
    pub(super) altitude_type: Option<Spanned<String>>,
    pub(super) speed: Option<Spanned<f64>>,
    pub(super) speed_type: Option<Spanned<String>>,
    pub(super) next: Option<Spanned<u16>>,
    pub(super) turn: Option<Spanned<String>>,
    pub(super) loiter: Option<FileLoiter>,
    #[serde(rename = "loop")]
    pub(super) repeat: Option<FileLoop>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileLoiter {
    #[serde(rename = "type")]
    pub(super) pattern: Option<Spanned<String>>,
    pub(super) radius: Option<Spanned<f64>>,
    pub(super) length: Option<Spanned<f64>>,
    pub(super) bearing: Option<Spanned<f64>>,
    pub(super) direction: Option<Spanned<String>>,
    pub(super) speed: Option<Spanned<f64>>,
    pub(super) seconds: Option<Spanned<u16>>,
    pub(super) turns: Option<Spanned<u16>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileLoop {
    pub(super) limit: Spanned<u16>,
    #[serde(rename = "type")]
    pub(super) limit_type: Option<Spanned<String>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileCurve {
    pub(super) from: Spanned<u16>,
    pub(super) to: Spanned<u16>,
    pub(super) p2: Spanned<Vec<f64>>,
    pub(super) p3: Spanned<Vec<f64>>,
    pub(super) altitude_type: Option<Spanned<String>>,
    pub(super) message: Option<Spanned<u16>>,
}
