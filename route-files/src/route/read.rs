//! Reading a route file (TOML). Every error names the file, the line and the field.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use stanag_msgs::enums::{AltitudeType, TurnType, WaypointSpeedType};
use stanag_msgs::scalar::{Altitude, Distance, Integer, Scale, Speed};
use stanag_msgs::{Id, OutOfRange, Scaled};
use toml::Spanned;

use super::form::{
    ALTITUDE_TYPES, DIRECTIONS, File, FileCurve, FileDefaults, FileLoiter, FileLoop, FileWaypoint,
    LIMITS, LOITERS, Names, ROUTE_TYPES, SPEED_TYPES, TURNS,
};
use super::model::{
    Curve, CurveForm, FurtherRoute, Loiter, LoiterSpan, Loop, Place, Route, RouteError, Waypoint,
};

/// Why a route file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RouteFileError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// It is not TOML, or not of this form: a field that is missing, unknown or of another kind.
    #[error("{}:{line}: {}{message}", path.display(), key.as_ref().map(|key| format!("{key}: ")).unwrap_or_default())]
    Form {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The key in that line.
        key: Option<String>,
        /// What is wrong.
        message: String,
    },
    /// A value that the field cannot have.
    #[error("{}:{line}: {field}: {found}, expected {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The field, such as `waypoint 3: latitude`.
        field: String,
        /// The value found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The whole cannot be put into messages.
    #[error("{}: {source}", path.display())]
    Route {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: RouteError,
    },
}

impl Route {
    /// Reads a route file.
    ///
    /// # Errors
    /// It cannot be read, or is not a route.
    pub fn load(path: &Path) -> Result<Route, RouteFileError> {
        let text = std::fs::read_to_string(path).map_err(|source| RouteFileError::Read {
            path: path.to_owned(),
            source,
        })?;
        Route::parse(path, &text)
    }

    /// Reads the text of a route file; `path` is only for messages.
    ///
    /// # Errors
    /// It is not a route.
    pub fn parse(path: &Path, text: &str) -> Result<Route, RouteFileError> {
        let at = Source::new(path, text);
        let file: File = toml::from_str(text).map_err(|fault| at.form(&fault))?;
        let route = at.route(&file)?;
        let whole = route
            .mission_id()
            .and_then(|_| route.messages(Id::NULL, Id::NULL));
        match whole {
            Ok(_) => Ok(route),
            Err(source) => Err(RouteFileError::Route {
                path: path.to_owned(),
                source,
            }),
        }
    }
}

/// The file that errors refer to.
struct Source<'a> {
    path: &'a Path,
    text: &'a str,
    lines: Lines,
}

/// Where the lines of a text end, looked up once: to count from the beginning for each waypoint takes minutes for a file of
/// ten thousand.
pub(crate) struct Lines(Vec<usize>);

impl Lines {
    pub(crate) fn of(text: &str) -> Self {
        Self(text.match_indices('\n').map(|(at, _)| at).collect())
    }

    /// The line, from 1, of the byte at an offset.
    pub(crate) fn at(&self, offset: usize) -> usize {
        1 + self.0.partition_point(|end| *end < offset)
    }
}

type Checked<T> = Result<T, RouteFileError>;

impl<'a> Source<'a> {
    fn new(path: &'a Path, text: &'a str) -> Self {
        let lines = Lines::of(text);
        Self { path, text, lines }
    }

    fn route(&self, file: &File) -> Checked<Route> {
        let initial = match &file.initial {
            Some(number) => Some(self.number("initial", number)?),
            None => None,
        };
        let defaults = self.defaults(&file.defaults)?;
        let mut lines: BTreeMap<u16, usize> = BTreeMap::new();
        let mut waypoints = Vec::new();
        for (index, point) in file.waypoint.iter().enumerate() {
            let following = file.waypoint.get(index + 1);
            let next = following.map_or(0, |point| *point.number.get_ref());
            let waypoint = self.waypoint(point, next, &defaults)?;
            let line = self.line(point.number.span().start);
            if let Some(before) = lines.insert(waypoint.number, line) {
                let expected = format!("another number than that of line {before}");
                return Err(self.fault("waypoint: number", &point.number, expected));
            }
            waypoints.push(waypoint);
        }
        let curves: Checked<Vec<Curve>> =
            file.curve.iter().map(|curve| self.curve(curve)).collect();
        let further = file.route.iter().map(|route| {
            Ok(FurtherRoute {
                id: route.id.clone(),
                route_type: self.named("route: type", &route.route_type, &ROUTE_TYPES)?,
                initial: self.number("route: initial", &route.initial)?,
            })
        });
        let further: Checked<Vec<FurtherRoute>> = further.collect();
        Ok(Route {
            mission_id: file.mission_id.clone(),
            id: file.id.clone(),
            route_type: self.named("type", &file.route_type, &ROUTE_TYPES)?,
            initial,
            waypoints,
            curves: curves?,
            further: further?,
        })
    }

    fn defaults(&self, file: &FileDefaults) -> Checked<Defaults> {
        let field = |name| format!("defaults.{name}");
        Ok(Defaults {
            altitude_m: self.maybe(&field("altitude"), &file.altitude, ALTITUDE)?,
            altitude_type: self.named(
                &field("altitude_type"),
                &file.altitude_type,
                &ALTITUDE_TYPES,
            )?,
            speed_m_s: self.maybe(&field("speed"), &file.speed, SPEED)?,
            speed_type: self.named(&field("speed_type"), &file.speed_type, &SPEED_TYPES)?,
            turn: self.named(&field("turn"), &file.turn, &TURNS)?,
        })
    }

    fn waypoint(&self, file: &FileWaypoint, next: u16, defaults: &Defaults) -> Checked<Waypoint> {
        let number = self.number("waypoint: number", &file.number)?;
        let field = |name| format!("waypoint {number}: {name}");
        let altitude = self.maybe(&field("altitude"), &file.altitude, ALTITUDE)?;
        let Some(altitude_m) = altitude.or(defaults.altitude_m) else {
            let expected = "a number, here or in [defaults]".to_owned();
            let at = file.number.span().start;
            return Err(self.value_fault(&field("altitude"), at, "missing".to_owned(), expected));
        };
        let altitude_type = self.named(
            &field("altitude_type"),
            &file.altitude_type,
            &ALTITUDE_TYPES,
        )?;
        let speed_m_s = self.maybe(&field("speed"), &file.speed, SPEED)?;
        let speed_type = self.named(&field("speed_type"), &file.speed_type, &SPEED_TYPES)?;
        let turn = self.named(&field("turn"), &file.turn, &TURNS)?;
        let speed_m_s = speed_m_s.or(defaults.speed_m_s);
        Ok(Waypoint {
            number,
            latitude_deg: self.within(&field("latitude"), &file.latitude, LATITUDE)?,
            longitude_deg: self.within(&field("longitude"), &file.longitude, LONGITUDE)?,
            altitude_m,
            altitude_type: altitude_type.or(defaults.altitude_type),
            speed_m_s,
            speed_type: speed_type
                .or(defaults.speed_type)
                .or(speed_m_s.map(|_| WaypointSpeedType::Ground)),
            next: file.next.as_ref().map_or(next, |number| *number.get_ref()),
            turn: turn.or(defaults.turn),
            loiter: match &file.loiter {
                Some(loiter) => Some(self.loiter(&field("loiter"), loiter)?),
                None => None,
            },
            repeat: match &file.repeat {
                Some(repeat) => Some(self.repeat(&field("loop.type"), repeat)?),
                None => None,
            },
        })
    }

    fn loiter(&self, of: &str, file: &FileLoiter) -> Checked<Loiter> {
        let field = |name| format!("{of}.{name}");
        let span = match (&file.seconds, &file.turns) {
            (Some(_), Some(turns)) => {
                let expected = "either seconds or turns".to_owned();
                return Err(self.fault(&field("turns"), turns, expected));
            }
            (Some(seconds), None) => Some(LoiterSpan::Seconds(*seconds.get_ref())),
            (None, Some(turns)) => Some(LoiterSpan::Turns(*turns.get_ref())),
            (None, None) => None,
        };
        let bearing = file.bearing.as_ref();
        let bearing_deg = bearing.map(|bearing| self.within(&field("bearing"), bearing, BEARING));
        Ok(Loiter {
            pattern: self.named(&field("type"), &file.pattern, &LOITERS)?,
            radius_m: self.maybe(&field("radius"), &file.radius, DISTANCE)?,
            length_m: self.maybe(&field("length"), &file.length, DISTANCE)?,
            bearing_deg: bearing_deg.transpose()?,
            direction: self.named(&field("direction"), &file.direction, &DIRECTIONS)?,
            speed_m_s: self.maybe(&field("speed"), &file.speed, SPEED)?,
            span,
        })
    }

    fn repeat(&self, field: &str, file: &FileLoop) -> Checked<Loop> {
        let limit_type = self.named(field, &file.limit_type, &LIMITS)?;
        Ok(Loop {
            limit_type: limit_type.unwrap_or(stanag_msgs::enums::LimitType::Count),
            limit: *file.limit.get_ref(),
        })
    }

    fn curve(&self, file: &FileCurve) -> Checked<Curve> {
        let from = self.number("curve: from", &file.from)?;
        let field = |name| format!("curve from {from}: {name}");
        let form = match &file.message {
            None => CurveForm::Native,
            Some(number) => match number.get_ref() {
                50002 => CurveForm::Native,
                50001 => CurveForm::Paper,
                _ => {
                    let expected = "50001 or 50002".to_owned();
                    return Err(self.fault(&field("message"), number, expected));
                }
            },
        };
        Ok(Curve {
            from,
            to: self.number(&field("to"), &file.to)?,
            p2: self.place(&field("p2"), &file.p2)?,
            p3: self.place(&field("p3"), &file.p3)?,
            altitude_type: self.named(
                &field("altitude_type"),
                &file.altitude_type,
                &ALTITUDE_TYPES,
            )?,
            form,
        })
    }

    fn place(&self, field: &str, numbers: &Spanned<Vec<f64>>) -> Checked<Place> {
        let (latitude_deg, longitude_deg, altitude_m) = match numbers.get_ref()[..] {
            [latitude, longitude] => (latitude, longitude, None),
            [latitude, longitude, altitude] => (latitude, longitude, Some(altitude)),
            _ => {
                let expected = "[latitude, longitude] or [latitude, longitude, altitude]";
                return Err(self.fault(field, numbers, expected.to_owned()));
            }
        };
        if !LATITUDE.contains(&latitude_deg) || !LONGITUDE.contains(&longitude_deg) {
            let expected = "a latitude of -90 to 90 and a longitude of -180 to 180".to_owned();
            return Err(self.fault(field, numbers, expected));
        }
        if let Some(Err(fault)) = altitude_m.map(ALTITUDE) {
            return Err(self.fault(field, numbers, bounds(&fault)));
        }
        Ok(Place {
            latitude_deg,
            longitude_deg,
            altitude_m,
        })
    }

    fn number(&self, field: &str, number: &Spanned<u16>) -> Checked<u16> {
        match *number.get_ref() {
            0 | u16::MAX => Err(self.fault(field, number, "1 to 65534".to_owned())),
            number => Ok(number),
        }
    }

    fn within(
        &self,
        field: &str,
        value: &Spanned<f64>,
        range: RangeInclusive<f64>,
    ) -> Checked<f64> {
        if range.contains(value.get_ref()) {
            return Ok(*value.get_ref());
        }
        let expected = format!("{} to {} degrees", range.start(), range.end());
        Err(self.fault(field, value, expected))
    }

    fn maybe<R: Integer, S: Scale>(
        &self,
        field: &str,
        value: &Option<Spanned<f64>>,
        fits: fn(f64) -> Result<Scaled<R, S>, OutOfRange>,
    ) -> Checked<Option<f64>> {
        let Some(value) = value else { return Ok(None) };
        match fits(*value.get_ref()) {
            Ok(_) => Ok(Some(*value.get_ref())),
            Err(fault) => Err(self.fault(field, value, bounds(&fault))),
        }
    }

    fn named<T: Copy + PartialEq>(
        &self,
        field: &str,
        word: &Option<Spanned<String>>,
        names: &Names<T>,
    ) -> Checked<Option<T>> {
        let Some(word) = word else { return Ok(None) };
        match names.value(word.get_ref()) {
            Some(value) => Ok(Some(value)),
            None => Err(self.fault(field, word, format!("one of {}", names.expected()))),
        }
    }

    fn fault<T: Debug>(&self, field: &str, found: &Spanned<T>, expected: String) -> RouteFileError {
        let value = format!("{:?}", found.get_ref());
        self.value_fault(field, found.span().start, value, expected)
    }

    fn value_fault(
        &self,
        field: &str,
        at: usize,
        found: String,
        expected: String,
    ) -> RouteFileError {
        RouteFileError::Value {
            path: self.path.to_owned(),
            line: self.line(at),
            field: field.to_owned(),
            found,
            expected,
        }
    }

    fn form(&self, fault: &toml::de::Error) -> RouteFileError {
        let start = fault.span().map_or(0, |span| span.start);
        let line = self.line(start);
        let content = self.text.lines().nth(line - 1).unwrap_or_default();
        RouteFileError::Form {
            path: self.path.to_owned(),
            line,
            key: content
                .split_once('=')
                .map(|(key, _)| key.trim().to_owned()),
            message: in_words(fault.message()),
        }
    }

    fn line(&self, offset: usize) -> usize {
        self.lines.at(offset)
    }
}

/// The parser's message without the names that Rust has for kinds of values.
fn in_words(message: &str) -> String {
    let message = message.trim().replace('\n', ", ");
    if let Some(name) = message.strip_prefix("missing field `") {
        let name = name.trim_end_matches('`');
        return match name {
            "waypoint" => "no waypoints, expected at least one table [[waypoint]]".to_owned(),
            name => format!("{name} is missing"),
        };
    }
    let Some((found, expected)) = message.rsplit_once("expected ") else {
        return message;
    };
    let expected = match expected {
        "u8" | "u16" | "u32" | "u64" | "i64" | "usize" => "a whole number",
        "f64" | "f32" => "a number, without quotes and unit",
        "a sequence" => "a list in brackets",
        table if table.starts_with("struct ") => "a table",
        other => other,
    };
    format!("{found}expected {expected}")
}

/// `[defaults]`, read.
struct Defaults {
    altitude_m: Option<f64>,
    altitude_type: Option<AltitudeType>,
    speed_m_s: Option<f64>,
    speed_type: Option<WaypointSpeedType>,
    turn: Option<TurnType>,
}

fn bounds(fault: &OutOfRange) -> String {
    format!("{} to {} {}", fault.low, fault.high, fault.unit)
}

const LATITUDE: RangeInclusive<f64> = -90.0..=90.0;
const LONGITUDE: RangeInclusive<f64> = -180.0..=180.0;
const BEARING: RangeInclusive<f64> = 0.0..=360.0;
const ALTITUDE: fn(f64) -> Result<Altitude, OutOfRange> = Altitude::from_si;
const SPEED: fn(f64) -> Result<Speed, OutOfRange> = Speed::from_si;
const DISTANCE: fn(f64) -> Result<Distance, OutOfRange> = Distance::from_si;
