//! GeoJSON: lines, rings and rows of points, or else all Points in order. Altitudes are taken as above mean sea level;
//! heights above home are marked by a property of the feature, `"altitude_type": "agl"`.
//!
//! A property `"points"` carries what is done at the points of a line: `{"3": {"speed_m_s": "6"}}`. A Polygon with a
//! property `"keep"` (`"in"` or `"out"`), or a Point with that and `"radius_m"`, is an area of the geofence; a Point with
//! `"rally"` is a rally point.

use std::path::Path;

use curve_paths::Position;
use serde_json::{Map, Value, json};

use super::draft::{Datum, Draft, NoAltitude, Point};
use super::fault::FormatError;
use super::json_line::Document;
use super::lines::Lines;
use super::losses::Losses;
use super::{attributes, lost};
use crate::fence::{Area, Keep, Shape};

/// Reads the lines of a document, or else its Points.
pub(super) fn read(file: &Path, text: &str) -> Result<Lines, FormatError> {
    let document = Document::read(file, text)?;
    let mut found = Found {
        file,
        document: &document,
        lines: Lines::default(),
    };
    let datum = if altitude_type(&document.value) == Some(AGL) {
        Datum::Home
    } else {
        Datum::SeaLevel
    };
    found.search(&document.value, "", &Value::Null)?;
    let mut lines = found.lines;
    for draft in lines.lines.iter_mut().chain([&mut lines.points]) {
        draft.datum = datum;
    }
    Ok(lines)
}

struct Found<'a> {
    file: &'a Path,
    document: &'a Document<'a>,
    lines: Lines,
}

impl Found<'_> {
    /// Gathers geometries in their order, each with the properties of its feature.
    fn search(&mut self, value: &Value, path: &str, owner: &Value) -> Result<(), FormatError> {
        let at = format!("{path}.coordinates");
        let coordinates = &value["coordinates"];
        match value["type"].as_str() {
            Some("FeatureCollection") => self.list(value, "features", path, owner),
            Some("GeometryCollection") => self.list(value, "geometries", path, owner),
            Some("Feature") => self.search(
                &value["geometry"],
                &format!("{path}.geometry"),
                &value["properties"],
            ),
            Some("LineString" | "MultiPoint") => self.line(coordinates, &at, false, owner),
            Some("MultiLineString") => self.each(coordinates, &at, |all, line, at| {
                all.line(line, at, false, owner)
            }),
            Some("Polygon") => self.polygon(coordinates, &at, owner),
            Some("MultiPolygon") => self.each(coordinates, &at, |all, polygon, at| {
                all.polygon(polygon, at, owner)
            }),
            Some("Point") => self.point(coordinates, &at, owner),
            _ => Ok(()),
        }
    }

    fn list(
        &mut self,
        value: &Value,
        name: &str,
        path: &str,
        owner: &Value,
    ) -> Result<(), FormatError> {
        for (k, item) in value[name].as_array().into_iter().flatten().enumerate() {
            self.search(item, &format!("{path}.{name}[{k}]"), owner)?;
        }
        Ok(())
    }

    fn each(
        &mut self,
        list: &Value,
        path: &str,
        take: impl Fn(&mut Self, &Value, &str) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        for (k, item) in list.as_array().into_iter().flatten().enumerate() {
            take(self, item, &format!("{path}[{k}]"))?;
        }
        Ok(())
    }

    fn line(
        &mut self,
        coordinates: &Value,
        path: &str,
        closed: bool,
        owner: &Value,
    ) -> Result<(), FormatError> {
        let mut draft = Draft {
            name: owner["name"].as_str().unwrap_or_default().to_owned(),
            closed,
            points: self.positions(coordinates, path)?,
            ..Draft::default()
        };
        // A ring repeats its first position.
        if closed && draft.points.len() > 1 {
            draft.points.pop();
        }
        for (number, done) in owner["points"].as_object().into_iter().flatten() {
            let point = number.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
            let Some(point) = point.and_then(|k| draft.points.get_mut(k)) else {
                continue;
            };
            for (key, value) in done.as_object().into_iter().flatten() {
                let text = value
                    .as_str()
                    .map_or_else(|| value.to_string(), str::to_owned);
                attributes::set(&mut point.conduct, key, &text).map_err(|problem| {
                    FormatError::at(self.file, None, format!("points.{number}.{key}"), problem)
                })?;
            }
        }
        self.lines.push(self.file, draft)
    }

    fn polygon(&mut self, rings: &Value, path: &str, owner: &Value) -> Result<(), FormatError> {
        let at = format!("{path}[0]");
        let Some(keep) = self.keep(owner)? else {
            self.line(&rings[0], &at, true, owner)?;
            if !rings[1].is_null()
                && let Some(line) = self.lines.lines.last_mut()
            {
                line.losses.add_whole("holes of the polygon");
            }
            return Ok(());
        };
        let mut vertices: Vec<[f64; 2]> = self
            .positions(&rings[0], &at)?
            .iter()
            .map(|p| [p.position.lat_deg, p.position.lon_deg])
            .collect();
        if vertices.len() > 1 && vertices.first() == vertices.last() {
            vertices.pop();
        }
        self.lines.areas.push(Area {
            keep,
            shape: Shape::Polygon(vertices),
        });
        Ok(())
    }

    fn point(&mut self, coordinates: &Value, path: &str, owner: &Value) -> Result<(), FormatError> {
        let mut point = self.position(coordinates, path)?;
        if let Some(keep) = self.keep(owner)? {
            let radius_m = owner["radius_m"].as_f64().ok_or_else(|| {
                let problem = format!("{}, expected a number of metres", owner["radius_m"]);
                FormatError::at(self.file, point.line, "radius_m", problem)
            })?;
            self.lines.areas.push(Area {
                keep,
                shape: Shape::Circle {
                    centre: [point.position.lat_deg, point.position.lon_deg],
                    radius_m,
                },
            });
        } else if owner["rally"] == true {
            self.lines.rally.push(point.position);
        } else {
            for (key, value) in owner.as_object().into_iter().flatten() {
                let text = value
                    .as_str()
                    .map_or_else(|| value.to_string(), str::to_owned);
                attributes::set(&mut point.conduct, key, &text)
                    .map_err(|problem| FormatError::at(self.file, point.line, key, problem))?;
            }
            self.lines.points.points.push(point);
        }
        Ok(())
    }

    fn keep(&self, owner: &Value) -> Result<Option<Keep>, FormatError> {
        match &owner["keep"] {
            Value::Null => Ok(None),
            word if word == Keep::In.word() => Ok(Some(Keep::In)),
            word if word == Keep::Out.word() => Ok(Some(Keep::Out)),
            other => {
                let problem = format!("{other}, expected \"in\" or \"out\"");
                Err(FormatError::at(self.file, None, "keep", problem))
            }
        }
    }

    fn positions(&self, list: &Value, path: &str) -> Result<Vec<Point>, FormatError> {
        let fault = || (self.document).fault(path, "expected an array of positions");
        let list = list.as_array().ok_or_else(fault)?.iter().enumerate();
        list.map(|(k, c)| self.position(c, &format!("{path}[{k}]")))
            .collect()
    }

    fn position(&self, c: &Value, path: &str) -> Result<Point, FormatError> {
        let line = Some(self.document.line_of(path));
        let alt_m = match &c[2] {
            Value::Null => Some(Err(NoAltitude::Missing)),
            number => number.as_f64().map(Ok),
        };
        match (c[1].as_f64(), c[0].as_f64(), alt_m) {
            (Some(lat), Some(lon), Some(alt_m)) => Ok(Point::found(lat, lon, alt_m, line)),
            _ => {
                let problem = format!("{c}, expected [longitude, latitude, altitude]");
                Err(self.document.fault(path, problem))
            }
        }
    }
}

/// The mark of the first feature that has one.
fn altitude_type(document: &Value) -> Option<&str> {
    let own = document["properties"]["altitude_type"].as_str();
    let features = document["features"].as_array();
    own.or_else(|| features?.iter().find_map(altitude_type))
}

/// Writes a LineString, what is done at its points, the geofence and the rally points.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    let points = draft.written();
    let position = |p: Position| json!([p.lon_deg, p.lat_deg, p.alt_m]);
    let coordinates: Vec<Value> = points.iter().map(|p| position(p.position)).collect();
    let mut properties = json!({ "name": draft.name });
    if draft.datum == Datum::Home {
        properties["altitude_type"] = AGL.into();
    }
    let done = points.iter().enumerate().filter_map(|(k, point)| {
        let pairs = attributes::of(&point.conduct).into_iter();
        let pairs: Map<String, Value> =
            pairs.map(|(key, text)| (key.into(), text.into())).collect();
        (!pairs.is_empty()).then(|| ((k + 1).to_string(), Value::from(pairs)))
    });
    let done: Map<String, Value> = done.collect();
    if !done.is_empty() {
        properties["points"] = done.into();
    }
    let feature = |kind: &str, coordinates: Value, properties: Value| {
        json!({
            "type": "Feature",
            "properties": properties,
            "geometry": { "type": kind, "coordinates": coordinates },
        })
    };
    let mut features = vec![feature("LineString", coordinates.into(), properties)];
    let flat = |[north, east]: &[f64; 2]| json!([east, north]);
    features.extend(draft.areas.iter().map(|area| match &area.shape {
        Shape::Polygon(vertices) => {
            let ring: Vec<Value> = vertices.iter().chain(vertices.first()).map(flat).collect();
            feature(
                "Polygon",
                json!([ring]),
                json!({ "keep": area.keep.word() }),
            )
        }
        Shape::Circle { centre, radius_m } => {
            let properties = json!({ "keep": area.keep.word(), "radius_m": radius_m });
            feature("Point", flat(centre), properties)
        }
    }));
    let rally = draft.rally.iter();
    features.extend(rally.map(|p| feature("Point", position(*p), json!({ "rally": true }))));
    lost::extras(draft, losses);
    let document = json!({ "type": "FeatureCollection", "features": features });
    format!("{document:#}\n")
}

const AGL: &str = "agl";
