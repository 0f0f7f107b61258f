//! KML and GPX: the first line, or else all points in order. altitudeMode of a KML names the datum of its altitudes.

use std::fmt::Write;
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::failure::Failure;
use crate::route::{Datum, NoAltitude, Route, Waypoint};

/// Reads a KML: the first LineString, LinearRing or gx:Track; else all Points.
pub(crate) fn read_kml(file: &Path, text: &str) -> Result<Route, Failure> {
    let mut line = Route::default();
    let mut points = Route::default();
    let mut path: Vec<String> = Vec::new();
    let mut taken = false;
    let mut shape: Option<Shape> = None;
    each_event(file, text, |event, number| {
        match event {
            Event::Start(e) => {
                let name = local_name(&e);
                if shape.is_none() && SHAPES.contains(&name.as_str()) {
                    let whose = if name == "Point" { &points } else { &line };
                    shape = Some(Shape {
                        name: name.clone(),
                        start: whose.waypoints.len(),
                        mode: String::new(),
                    });
                }
                path.push(name);
            }
            Event::End(_) => {
                let Some(name) = path.pop() else {
                    return Ok(());
                };
                if let Some(ended) = shape.take_if(|shape| shape.name == name) {
                    let whose = if name == "Point" {
                        &mut points
                    } else {
                        &mut line
                    };
                    ended.set_datum(file, number, whose)?;
                }
                taken |= ["LineString", "LinearRing", "Track"].contains(&name.as_str());
            }
            Event::Text(t) => {
                let text = t.decode().map_err(|e| Failure::at(file, number, "", e))?;
                let inside = |name: &str| path.iter().any(|p| p == name);
                let in_line = inside("LineString") || inside("LinearRing");
                match path.last().map(String::as_str) {
                    Some("coordinates") if in_line && taken => {}
                    Some("coordinates") if in_line => {
                        line.closed = inside("LinearRing");
                        tuples(file, number, &text, &mut line)?;
                    }
                    Some("coordinates") => tuples(file, number, &text, &mut points)?,
                    Some("altitudeMode") => {
                        if let Some(shape) = &mut shape {
                            shape.mode = text.trim().to_owned();
                        }
                    }
                    Some("coord") if !taken => {
                        let joined = text.split_whitespace().collect::<Vec<_>>().join(",");
                        tuples(file, number, &joined, &mut line)?;
                    }
                    _ => {}
                }
            }
            _ => {}
        }
        Ok(())
    })?;
    if line.closed && line.waypoints.len() > 1 {
        line.waypoints.pop();
    }
    some(
        file,
        [line, points],
        "a LineString, LinearRing, gx:Track or Points",
    )
}

/// A geometry of a KML, whose altitudeMode stands before its coordinates or after them.
struct Shape {
    name: String,
    /// Its first waypoint.
    start: usize,
    /// Its altitudeMode; empty where there is none.
    mode: String,
}

impl Shape {
    /// Applies the mode. Without one a KML lies on the ground (clampToGround), whatever altitudes its tuples give.
    fn set_datum(&self, file: &Path, line: Option<u64>, route: &mut Route) -> Result<(), Failure> {
        let (before, own) = route.waypoints.split_at_mut(self.start);
        if own.is_empty() {
            return Ok(());
        }
        let datum = match self.mode.as_str() {
            ABSOLUTE => Datum::SeaLevel,
            RELATIVE => Datum::Home,
            _ => {
                own.iter_mut()
                    .for_each(|w| w.no_altitude = Some(NoAltitude::Ground));
                return Ok(());
            }
        };
        if !before.is_empty() && route.datum != datum {
            let problem = format!("{}, expected one mode for all points", self.mode);
            return Err(Failure::at(file, line, "altitudeMode", problem));
        }
        route.datum = datum;
        Ok(())
    }
}

/// Reads a GPX: the first route; else the first track's segments; else all waypoints.
pub(crate) fn read_gpx(file: &Path, text: &str) -> Result<Route, Failure> {
    let [mut route, mut track, mut waypoints] =
        [Route::default(), Route::default(), Route::default()];
    let mut ended = [false; 2];
    let mut current: Option<(usize, Waypoint)> = None;
    let mut in_altitude = false;
    each_event(file, text, |event, number| {
        let mut start = |e: &BytesStart<'_>, empty: bool| -> Result<(), Failure> {
            let name = local_name(e);
            let kind = match name.as_str() {
                "rtept" => 0,
                "trkpt" => 1,
                "wpt" => 2,
                "ele" => {
                    in_altitude = !empty;
                    return Ok(());
                }
                _ => return Ok(()),
            };
            let at = |which: &str| attribute(file, number, &name, e, which);
            let point = Waypoint::found(at("lat")?, at("lon")?, Err(NoAltitude::Missing), number);
            current = Some((kind, point));
            Ok(())
        };
        let mut finish = |current: &mut Option<(usize, Waypoint)>| {
            if let Some((kind, point)) = current.take() {
                match kind {
                    0 if !ended[0] => route.waypoints.push(point),
                    1 if !ended[1] => track.waypoints.push(point),
                    2 => waypoints.waypoints.push(point),
                    _ => {}
                }
            }
        };
        match event {
            Event::Start(e) => start(&e, false)?,
            Event::Empty(e) => {
                start(&e, true)?;
                finish(&mut current);
            }
            Event::Text(t) if in_altitude => {
                let text = t
                    .decode()
                    .map_err(|e| Failure::at(file, number, "ele", e))?;
                if let Some((_, point)) = &mut current {
                    let alt = text.trim().parse();
                    point.position.alt_m = alt.map_err(|_| {
                        Failure::at(file, number, "ele", format!("{text:?}, expected a number"))
                    })?;
                    point.no_altitude = None;
                }
            }
            Event::End(e) => match e.local_name().as_ref() {
                b"ele" => in_altitude = false,
                b"rtept" | b"trkpt" | b"wpt" => finish(&mut current),
                b"rte" => ended[0] = true,
                b"trk" => ended[1] = true,
                _ => {}
            },
            _ => {}
        }
        Ok(())
    })?;
    some(
        file,
        [route, track, waypoints],
        "a route, a track or waypoints",
    )
}

/// Calls `take` with every event and the line that it ends on.
fn each_event(
    file: &Path,
    text: &str,
    mut take: impl FnMut(Event<'_>, Option<u64>) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut reader = Reader::from_str(text);
    let (mut counted, mut line) = (0, 1u64);
    loop {
        let event = reader.read_event();
        let position = (reader.buffer_position() as usize).clamp(counted, text.len());
        line += text.as_bytes()[counted..position]
            .iter()
            .filter(|&&b| b == b'\n')
            .count() as u64;
        counted = position;
        match event.map_err(|e| Failure::at(file, Some(line), "", e))? {
            Event::Eof => return Ok(()),
            event => take(event, Some(line))?,
        }
    }
}

fn local_name(e: &BytesStart<'_>) -> String {
    String::from_utf8_lossy(e.local_name().as_ref()).into_owned()
}

fn attribute(
    file: &Path,
    line: Option<u64>,
    element: &str,
    e: &BytesStart<'_>,
    name: &str,
) -> Result<f64, Failure> {
    let field = format!("{element} {name}");
    let found = e
        .try_get_attribute(name)
        .map_err(|e| Failure::at(file, line, field.as_str(), e))?;
    let found = found
        .ok_or_else(|| Failure::at(file, line, field.as_str(), "missing, expected degrees"))?;
    let text = String::from_utf8_lossy(&found.value);
    text.trim()
        .parse()
        .map_err(|_| Failure::at(file, line, field, format!("{text:?}, expected degrees")))
}

/// KML's tuples: longitude,latitude or longitude,latitude,altitude.
fn tuples(file: &Path, line: Option<u64>, text: &str, route: &mut Route) -> Result<(), Failure> {
    for tuple in text.split_whitespace() {
        let parsed: Result<Vec<f64>, _> = tuple.split(',').map(str::parse).collect();
        match parsed.as_deref() {
            Ok([lon, lat, rest @ ..]) if rest.len() < 2 => {
                let alt = rest.first().copied().ok_or(NoAltitude::Missing);
                route.waypoints.push(Waypoint::found(*lat, *lon, alt, line));
            }
            _ => {
                let problem = format!("{tuple:?}, expected longitude,latitude,altitude");
                return Err(Failure::at(file, line, "coordinates", problem));
            }
        }
    }
    Ok(())
}

fn some<const N: usize>(file: &Path, routes: [Route; N], expected: &str) -> Result<Route, Failure> {
    routes
        .into_iter()
        .find(|r| !r.waypoints.is_empty())
        .ok_or_else(|| Failure::file(file, format!("no path, expected {expected}")))
}

/// Writes a KML LineString.
pub(crate) fn write_kml(route: &Route) -> String {
    let mode = if route.datum == Datum::Home {
        RELATIVE
    } else {
        ABSOLUTE
    };
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>\n\
         <Placemark><name>{}</name><LineString><altitudeMode>{mode}</altitudeMode><coordinates>\n",
        escaped(&route.name)
    );
    for p in route.positions() {
        let _ = writeln!(out, "{:.8},{:.8},{:.3}", p.lon_deg, p.lat_deg, p.alt_m);
    }
    out + "</coordinates></LineString></Placemark>\n</Document></kml>\n"
}

/// Writes a GPX route.
pub(crate) fn write_gpx(route: &Route) -> String {
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <gpx version=\"1.1\" creator=\"curve-plan\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n\
         <rte><name>{}</name>\n",
        escaped(&route.name)
    );
    for p in route.positions() {
        let _ = writeln!(
            out,
            "<rtept lat=\"{:.8}\" lon=\"{:.8}\"><ele>{:.3}</ele></rtept>",
            p.lat_deg, p.lon_deg, p.alt_m
        );
    }
    out + "</rte></gpx>\n"
}

/// Text as XML can hold it.
pub(crate) fn escaped(text: &str) -> std::borrow::Cow<'_, str> {
    quick_xml::escape::escape(text)
}

/// KML's word for heights above ground; at home it is home's.
/// altitudeMode above the ground, which is flown as above home; above mean sea level.
const RELATIVE: &str = "relativeToGround";
const ABSOLUTE: &str = "absolute";
const SHAPES: [&str; 5] = ["LineString", "LinearRing", "Polygon", "Track", "Point"];
