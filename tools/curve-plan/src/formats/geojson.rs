//! GeoJSON: the first line (or ring, or row of points) of a document. Altitudes are taken as above mean sea level; heights
//! above home are marked by a property of the feature, `"altitude_type": "agl"`.

use std::path::Path;

use serde_json::{Value, json};

use crate::failure::Failure;
use crate::json_line;
use crate::route::{Datum, NoAltitude, Route, Waypoint};

/// Reads the first LineString, Polygon ring or MultiPoint, or else all Points in order.
pub(crate) fn read(file: &Path, text: &str) -> Result<Route, Failure> {
    let document = json_line::document(file, text)?;
    let mut geometries = Vec::new();
    collect(&document, "", &mut geometries);
    let line = geometries
        .iter()
        .find_map(|(path, g)| match g["type"].as_str() {
            Some("LineString" | "MultiPoint") => {
                Some((format!("{path}.coordinates"), &g["coordinates"], false))
            }
            Some("Polygon") => Some((format!("{path}.coordinates[0]"), &g["coordinates"][0], true)),
            _ => None,
        });
    let mut route = Route::default();
    if let Some((path, coordinates, closed)) = line {
        let list = coordinates
            .as_array()
            .ok_or_else(|| json_line::fault(file, text, &path, "expected an array of positions"))?;
        for (k, c) in list.iter().enumerate() {
            route
                .waypoints
                .push(position(file, text, &format!("{path}[{k}]"), c)?);
        }
        // A ring repeats its first position.
        if closed && route.waypoints.len() > 1 {
            route.waypoints.pop();
        }
        route.closed = closed;
    } else {
        for (path, g) in geometries.iter().filter(|(_, g)| g["type"] == "Point") {
            route.waypoints.push(position(
                file,
                text,
                &format!("{path}.coordinates"),
                &g["coordinates"],
            )?);
        }
    }
    if route.waypoints.is_empty() {
        return Err(Failure::file(
            file,
            "no geometry, expected a LineString, Polygon, MultiPoint or Points",
        ));
    }
    if altitude_type(&document) == Some(AGL) {
        route.datum = Datum::Home;
    }
    Ok(route)
}

/// The mark of the first feature that has one.
fn altitude_type(document: &Value) -> Option<&str> {
    let own = document["properties"]["altitude_type"].as_str();
    let features = document["features"].as_array();
    own.or_else(|| features?.iter().find_map(altitude_type))
}

fn collect<'a>(value: &'a Value, path: &str, out: &mut Vec<(String, &'a Value)>) {
    match value["type"].as_str() {
        Some("FeatureCollection") => list(value, "features", path, out),
        Some("GeometryCollection") => list(value, "geometries", path, out),
        Some("Feature") => collect(&value["geometry"], &format!("{path}.geometry"), out),
        Some(_) => out.push((path.to_owned(), value)),
        None => {}
    }
}

fn list<'a>(value: &'a Value, name: &str, path: &str, out: &mut Vec<(String, &'a Value)>) {
    for (k, item) in value[name].as_array().into_iter().flatten().enumerate() {
        collect(item, &format!("{path}.{name}[{k}]"), out);
    }
}

fn position(file: &Path, text: &str, field: &str, c: &Value) -> Result<Waypoint, Failure> {
    let line = json_line::line_of(text, field);
    match (c[1].as_f64(), c[0].as_f64()) {
        (Some(lat), Some(lon)) if c[2].is_null() => {
            Ok(Waypoint::found(lat, lon, Err(NoAltitude::Missing), line))
        }
        (Some(lat), Some(lon)) if c[2].is_number() => {
            let alt_m = c[2].as_f64().ok_or(NoAltitude::Missing);
            Ok(Waypoint::found(lat, lon, alt_m, line))
        }
        _ => {
            let problem = format!("{c}, expected [longitude, latitude, altitude]");
            Err(json_line::fault(file, text, field, problem))
        }
    }
}

/// Writes a LineString.
pub(crate) fn write(route: &Route) -> String {
    let coordinates: Vec<[f64; 3]> = route
        .waypoints
        .iter()
        .map(|w| [w.position.lon_deg, w.position.lat_deg, w.position.alt_m])
        .collect();
    let mut properties = json!({ "name": route.name });
    if route.datum == Datum::Home {
        properties["altitude_type"] = AGL.into();
    }
    let document = json!({
        "type": "FeatureCollection",
        "features": [{
            "type": "Feature",
            "properties": properties,
            "geometry": { "type": "LineString", "coordinates": coordinates },
        }],
    });
    format!("{document:#}\n")
}

const AGL: &str = "agl";
