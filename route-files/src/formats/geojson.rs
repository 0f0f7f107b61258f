//! GeoJSON: lines, rings and rows of points, or else all Points in order. Altitudes are taken as above mean sea level
//! (`"altitude_type": "amsl"`); heights above home are marked by a property of the feature, `"altitude_type": "agl"`.
//! Another word is refused, and so are Points of both kinds: one route has one datum.
//!
//! A property `"points"` carries what is done at the points of a line: `{"3": {"speed_m_s": "6"}}`. A Polygon with a
//! property `"keep"` (`"in"` or `"out"`), or a Point with that and `"radius_m"`, is an area of the geofence; a Point with
//! `"rally"` is a rally point.

use std::path::Path;

use curve_paths::Position;
use serde_json::{Map, Value, json};

use super::draft::{Datum, Draft, NoAltitude, Point, open_ring};
use super::fault::FormatError;
use super::json_line::Document;
use super::lines::Lines;
use super::losses::Losses;
use super::{attributes, lost};
use crate::fence::{Keep, Shape};

/// Reads the lines of a document, or else its Points.
pub(super) fn read(file: &Path, text: &str) -> Result<Lines, FormatError> {
    let document = Document::read(file, text)?;
    let mut found = Found {
        file,
        document: &document,
        lines: Lines::default(),
    };
    found.search(&document.value, "", &Value::Null)?;
    Ok(found.lines)
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
            datum: self.datum(owner, path)?,
            ..Draft::default()
        };
        if closed {
            open_ring(&mut draft.points);
        }
        for (number, done) in owner["points"].as_object().into_iter().flatten() {
            let point = number.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
            let point = point.and_then(|k| draft.points.get_mut(k));
            let (Some(point), Some(done)) = (point, done.as_object()) else {
                draft.losses.add_whole(format!("property points.{number}"));
                continue;
            };
            for (key, value) in done {
                let text = value
                    .as_str()
                    .map_or_else(|| value.to_string(), str::to_owned);
                let field = format!("points.{number}.{key}");
                let taken = attributes::set(&mut point.conduct, key, &text)
                    .map_err(|problem| FormatError::at(self.file, None, &field, problem))?;
                if !taken {
                    draft.losses.add_whole(format!("property {field}"));
                }
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
        let ring = self.positions(&rings[0], &at)?;
        self.lines.push_polygon(keep, ring);
        Ok(())
    }

    fn point(&mut self, coordinates: &Value, path: &str, owner: &Value) -> Result<(), FormatError> {
        let mut point = self.position(coordinates, path)?;
        if let Some(keep) = self.keep(owner)? {
            let radius_m = owner["radius_m"].as_f64().ok_or_else(|| {
                let problem = format!("{}, expected a number of metres", owner["radius_m"]);
                FormatError::at(self.file, point.line, "radius_m", problem)
            })?;
            self.lines.push_circle(keep, point.position, radius_m);
        } else if owner["rally"] == true {
            if !owner[ALTITUDE_TYPE].is_null() && self.datum(owner, path)? != Datum::Home {
                let problem = "expected \"agl\": heights of rally points are above home";
                return Err(FormatError::at(
                    self.file,
                    point.line,
                    ALTITUDE_TYPE,
                    problem,
                ));
            }
            if point.no_altitude.is_some() {
                let problem = format!(
                    "{coordinates}, expected [longitude, latitude, altitude] of a rally point, above home"
                );
                return Err(self.document.fault(path, &problem));
            }
            self.lines.rally.push(point.position);
        } else {
            let datum = self.datum(owner, path)?;
            let all = &mut self.lines.points;
            if point.no_altitude.is_none() {
                let before = all.points.iter().any(|p| p.no_altitude.is_none());
                if before && all.datum != datum {
                    let problem = "another than before, expected the same for all points";
                    return Err(FormatError::at(
                        self.file,
                        point.line,
                        ALTITUDE_TYPE,
                        problem,
                    ));
                }
                all.datum = datum;
            }
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

    /// What the altitudes of a feature are above: its own mark counts, or else that of the whole collection.
    fn datum(&self, owner: &Value, path: &str) -> Result<Datum, FormatError> {
        let whole = &self.document.value["properties"][ALTITUDE_TYPE];
        let mark = Some(&owner[ALTITUDE_TYPE]).filter(|mark| !mark.is_null());
        match mark.unwrap_or(whole) {
            Value::Null => Ok(Datum::SeaLevel),
            word if word == AMSL => Ok(Datum::SeaLevel),
            word if word == AGL => Ok(Datum::Home),
            other => {
                let line = Some(self.document.line_of(path));
                let problem = format!("{other}, expected \"{AGL}\" or \"{AMSL}\"");
                Err(FormatError::at(self.file, line, ALTITUDE_TYPE, problem))
            }
        }
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

/// Writes a LineString, what is done at its points, the geofence and the rally points.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    let points = draft.written();
    let position = |p: Position| json!([p.lon_deg, p.lat_deg, p.alt_m]);
    let coordinates: Vec<Value> = points.iter().map(|p| position(p.position)).collect();
    let mut properties = json!({ "name": draft.name });
    if draft.datum == Datum::Home {
        properties[ALTITUDE_TYPE] = AGL.into();
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

/// The property that names what altitudes are above, and its words: above home, above mean sea level.
const ALTITUDE_TYPE: &str = "altitude_type";
const AGL: &str = "agl";
const AMSL: &str = "amsl";

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(features: &[Value]) -> Result<Lines, String> {
        let document = json!({ "type": "FeatureCollection", "features": features });
        read(Path::new("a.geojson"), &document.to_string()).map_err(|fault| fault.to_string())
    }

    fn feature(geometry: Value, properties: Value) -> Value {
        json!({ "type": "Feature", "properties": properties, "geometry": geometry })
    }

    fn line() -> Value {
        json!({ "type": "LineString", "coordinates": [[8.5, 47.4, 520], [8.51, 47.4, 520]] })
    }

    fn point() -> Value {
        json!({ "type": "Point", "coordinates": [8.5, 47.4, 520] })
    }

    #[test]
    fn the_altitude_type_of_a_feature_is_that_of_no_other() {
        let marked = feature(line(), json!({ "altitude_type": "agl" }));
        let plain = feature(line(), json!({}));
        for (features, datums) in [
            ([&plain, &marked], [Datum::SeaLevel, Datum::Home]),
            ([&marked, &plain], [Datum::Home, Datum::SeaLevel]),
        ] {
            let lines = lines(&features.map(Value::clone)).expect("both are lines");
            let found: Vec<Datum> = lines.lines.iter().map(|line| line.datum).collect();
            assert_eq!(found, datums);
        }
        // A mark of the whole collection counts where a feature has none.
        let sea = feature(line(), json!({ "altitude_type": "amsl" }));
        let document = json!({
            "type": "FeatureCollection",
            "properties": { "altitude_type": "agl" },
            "features": [plain, sea],
        });
        let lines = read(Path::new("a.geojson"), &document.to_string()).expect("both are lines");
        let found: Vec<Datum> = lines.lines.iter().map(|line| line.datum).collect();
        assert_eq!(found, [Datum::Home, Datum::SeaLevel]);
    }

    #[test]
    fn an_altitude_type_that_is_not_known_is_refused() {
        for word in [json!("AGL"), json!("wgs84"), json!("pressure"), json!(2)] {
            for geometry in [line(), point()] {
                let odd = feature(geometry, json!({ "altitude_type": word }));
                let fault = lines(&[odd]).err().expect("it is refused");
                let expected = format!("altitude_type: {word}, expected \"agl\" or \"amsl\"");
                assert!(fault.contains(&expected), "{fault}");
            }
        }
    }

    #[test]
    fn a_ring_keeps_its_last_corner_where_it_is_not_the_first() {
        let corners = [[8.5, 47.4], [8.51, 47.4], [8.51, 47.41]];
        for ring in [corners.to_vec(), [&corners[..], &corners[..1]].concat()] {
            let polygon = |properties| {
                let polygon = json!({ "type": "Polygon", "coordinates": [ring] });
                lines(&[feature(polygon, properties)]).expect("a ring")
            };
            let line = &polygon(json!({})).lines[0];
            assert_eq!((line.closed, line.points.len()), (true, 3), "{ring:?}");
            let Shape::Polygon(vertices) = &polygon(json!({ "keep": "in" })).areas[0].shape else {
                panic!("a polygon");
            };
            assert_eq!(vertices.len(), 3, "{ring:?}");
        }
    }

    #[test]
    fn what_is_said_of_a_point_that_is_not_there_is_lost_by_name() {
        let points = json!({
            "1": { "speed_m_s": "6", "colour": "red" },
            "3": { "speed_m_s": "6" },
            "2": 7,
        });
        let lines = lines(&[feature(line(), json!({ "points": points }))]).expect("a line");
        let line = &lines.lines[0];
        assert_eq!(line.points[0].conduct.speed_m_s, Some(6.0));
        let lost: Vec<&str> = line.losses.lost.iter().map(|loss| &*loss.what).collect();
        assert_eq!(
            lost,
            [
                "property points.1.colour",
                "property points.3",
                "property points.2"
            ]
        );
    }

    #[test]
    fn points_have_one_altitude_type_and_rally_points_are_above_home() {
        let agl = feature(point(), json!({ "altitude_type": "agl" }));
        let none = feature(point(), json!({}));
        let flat = json!({ "type": "Point", "coordinates": [8.5, 47.4] });
        let flat = feature(flat, json!({}));
        let fault = |features: &[Value]| lines(features).err().unwrap_or_default();
        for mixed in [[&agl, &none], [&none, &agl]] {
            let fault = fault(&mixed.map(Value::clone));
            assert!(
                fault.contains("altitude_type: another than before"),
                "{fault}"
            );
        }
        // Without an altitude there is nothing that could be above something else.
        let same = lines(&[flat, agl.clone(), agl]).expect("all are above home");
        assert_eq!(
            (same.points.datum, same.points.points.len()),
            (Datum::Home, 3)
        );
        let rally = |kind: &str| json!({ "rally": true, "altitude_type": kind });
        assert!(lines(&[feature(point(), rally("agl"))]).is_ok());
        let high = fault(&[feature(point(), rally("amsl"))]);
        assert!(high.contains("rally points are above home"), "{high}");
        let flat = json!({ "type": "Point", "coordinates": [8.5, 47.4] });
        let flat = fault(&[feature(flat, rally("agl"))]);
        assert!(flat.contains("altitude] of a rally point"), "{flat}");
    }
}
