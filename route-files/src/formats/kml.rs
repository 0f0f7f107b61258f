//! KML, and KMZ, which is a zip of it. `altitudeMode` names what altitudes are above; without it a KML lies on the
//! ground, whatever altitudes it gives.
//!
//! A LineString, a LinearRing, a gx:Track or the outer ring of a Polygon is a line; a file may have several. Where it has
//! none, its Points are the path. ExtendedData carries what is done at a point (`point 3 speed_m_s`), and makes a Polygon,
//! or a Point with a radius, an area of the geofence (`keep`: `in` or `out`) or a Point a rally point (`rally`).

use std::fmt::Write as _;
use std::io::{Cursor, Read as _, Write as _};
use std::path::Path;

use curve_paths::Position;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use super::draft::{Datum, Draft, NoAltitude, Point, open_ring};
use super::fault::FormatError;
use super::lines::Lines;
use super::losses::Losses;
use super::xml::{self, Node, escaped};
use super::{attributes, lost};
use crate::fence::{Keep, Shape};

/// The KML within a KMZ: `doc.kml`, or else the first one.
/// `most`: bytes that it may unpack to.
pub(super) fn unpack(file: &Path, bytes: &[u8], most: Option<u64>) -> Result<Vec<u8>, FormatError> {
    let fault =
        |problem: &dyn std::fmt::Display| FormatError::file(file, format!("zip: {problem}"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| fault(&e))?;
    let is_kml = |name: &&str| name.to_ascii_lowercase().ends_with(".kml");
    let names = archive.file_names().filter_map(Result::ok);
    let names: Vec<String> = names.map(|name| name.into_owned()).collect();
    let mut kml = names.iter().map(String::as_str).filter(is_kml);
    let name = names
        .iter()
        .map(String::as_str)
        .find(|name| *name == DOC)
        .or_else(|| kml.next());
    let name = name.ok_or_else(|| FormatError::file(file, "no .kml in it, expected doc.kml"))?;
    let within = archive.by_name(name).map_err(|e| fault(&e))?;
    let mut text = Vec::new();
    // Places do not pack a hundred times smaller: what does is made to fill the memory of who unpacks it.
    let likely = (bytes.len() as u64 * 100).clamp(1 << 20, MAX_UNPACKED);
    let most = most.map_or(likely, |most| most.min(likely));
    within
        .take(most + 1)
        .read_to_end(&mut text)
        .map_err(|e| fault(&e))?;
    if text.len() as u64 > most {
        let problem = format!("{name} is over {most} bytes, expected fewer");
        return Err(FormatError::file(file, problem));
    }
    Ok(text)
}

/// The KMZ around a KML.
pub(super) fn pack(file: &Path, kml: &str) -> Result<Vec<u8>, FormatError> {
    let fault =
        |problem: &dyn std::fmt::Display| FormatError::file(file, format!("zip: {problem}"));
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    archive
        .start_file(DOC, SimpleFileOptions::default())
        .map_err(|e| fault(&e))?;
    archive.write_all(kml.as_bytes()).map_err(|e| fault(&e))?;
    let packed = archive.finish().map_err(|e| fault(&e))?;
    Ok(packed.into_inner())
}

/// Reads a KML: its lines, or else its points.
pub(super) fn read(file: &Path, text: &str) -> Result<Lines, FormatError> {
    let document = xml::document(file, text)?;
    let mut found = Found {
        file,
        lines: Lines::default(),
    };
    found.search(&document, &Owner::default())?;
    Ok(found.lines)
}

/// The placemark around a geometry.
#[derive(Clone, Default)]
struct Owner {
    name: String,
    data: Vec<(String, String)>,
}

impl Owner {
    fn get(&self, key: &str) -> Option<&str> {
        let found = self.data.iter().find(|(name, _)| name == key);
        found.map(|(_, value)| value.as_str())
    }
}

struct Found<'a> {
    file: &'a Path,
    lines: Lines,
}

impl Found<'_> {
    /// Gathers the geometries below a node, in their order.
    fn search(&mut self, node: &Node, owner: &Owner) -> Result<(), FormatError> {
        for child in &node.children {
            match child.name.as_str() {
                "Placemark" => {
                    let owner = Owner {
                        name: child.text_of("name").unwrap_or_default().to_owned(),
                        data: extended(child),
                    };
                    self.search(child, &owner)?;
                }
                "LineString" => self.line(child, child, false, owner)?,
                "LinearRing" => self.line(child, child, true, owner)?,
                "Track" => self.track(child, owner)?,
                "Polygon" => self.polygon(child, owner)?,
                "Point" => self.point(child, owner)?,
                _ => self.search(child, owner)?,
            }
        }
        Ok(())
    }

    fn line(
        &mut self,
        shape: &Node,
        ring: &Node,
        closed: bool,
        owner: &Owner,
    ) -> Result<(), FormatError> {
        let mut draft = Draft {
            name: owner.name.clone(),
            closed,
            ..Draft::default()
        };
        for coordinates in ring.all("coordinates") {
            self.tuples(coordinates, &mut draft.points)?;
        }
        if closed {
            open_ring(&mut draft.points);
        }
        self.finish(shape, draft, owner)
    }

    fn track(&mut self, track: &Node, owner: &Owner) -> Result<(), FormatError> {
        let mut draft = Draft {
            name: owner.name.clone(),
            ..Draft::default()
        };
        for coord in track.all("coord") {
            let joined: Vec<&str> = coord.text.split_whitespace().collect();
            draft
                .points
                .push(self.tuple(&joined.join(","), coord.line)?);
        }
        if track.all("when").next().is_some() {
            draft.losses.add_whole("times of the track");
        }
        self.finish(track, draft, owner)
    }

    fn finish(&mut self, shape: &Node, mut draft: Draft, owner: &Owner) -> Result<(), FormatError> {
        draft.datum = datum(shape, &mut draft.points);
        draft.over_ground = draft.datum == Datum::Home;
        for (key, value) in &owner.data {
            // "point 3 speed_m_s", as this program writes it.
            let mut words = key.split(' ');
            let (Some("point"), Some(number), Some(key)) =
                (words.next(), words.next(), words.next())
            else {
                continue;
            };
            // Others may write what begins alike, such as "point of interest".
            let Ok(at) = number.parse::<usize>() else {
                continue;
            };
            let field = format!("point {number} {key}");
            let point = at.checked_sub(1).and_then(|k| draft.points.get_mut(k));
            let taken = match point {
                Some(point) => attributes::set(&mut point.conduct, key, value)
                    .map_err(|e| FormatError::at(self.file, Some(shape.line), &field, e))?,
                None => false,
            };
            if !taken {
                draft.losses.add_whole(format!("data \"{field}\""));
            }
        }
        self.lines.push(self.file, draft)
    }

    fn polygon(&mut self, polygon: &Node, owner: &Owner) -> Result<(), FormatError> {
        let ring = polygon
            .all("outerBoundaryIs")
            .find_map(|outer| outer.all("LinearRing").next());
        let Some(ring) = ring else { return Ok(()) };
        let Some(keep) = self.keep(polygon, owner)? else {
            self.line(polygon, ring, true, owner)?;
            if polygon.all("innerBoundaryIs").next().is_some()
                && let Some(line) = self.lines.lines.last_mut()
            {
                line.losses.add_whole("holes of the polygon");
            }
            return Ok(());
        };
        let mut points = Vec::new();
        for coordinates in ring.all("coordinates") {
            self.tuples(coordinates, &mut points)?;
        }
        self.lines.push_polygon(keep, points);
        Ok(())
    }

    fn point(&mut self, shape: &Node, owner: &Owner) -> Result<(), FormatError> {
        let mut points = Vec::new();
        for coordinates in shape.all("coordinates") {
            self.tuples(coordinates, &mut points)?;
        }
        let Some(first) = points.first() else {
            return Ok(());
        };
        let position = first.position;
        if let Some(keep) = self.keep(shape, owner)? {
            let radius = owner.get("radius_m").unwrap_or_default();
            let radius_m = attributes::number(radius)
                .map_err(|e| FormatError::at(self.file, Some(shape.line), "radius_m", e))?;
            self.lines.push_circle(keep, position, radius_m);
            return Ok(());
        }
        if owner.get("rally").is_some() {
            let mode = shape.text_of("altitudeMode");
            let (field, problem) = match mode {
                Some(RELATIVE) if first.no_altitude.is_none() => {
                    self.lines.rally.push(position);
                    return Ok(());
                }
                Some(RELATIVE) => (
                    "coordinates",
                    "no altitude, expected longitude,latitude,altitude of a rally point, above home".to_owned(),
                ),
                // Drawn on the ground where there is none: whatever its tuple gives is no height to return at.
                _ => (
                    "altitudeMode",
                    format!(
                        "{}, expected {RELATIVE}: heights of rally points are above home",
                        mode.unwrap_or("none")
                    ),
                ),
            };
            return Err(FormatError::at(self.file, Some(shape.line), field, problem));
        }
        let datum = datum(shape, &mut points);
        let all = &mut self.lines.points;
        if points.iter().all(|p| p.no_altitude.is_none()) {
            let before = all.points.iter().any(|p| p.no_altitude.is_none());
            if before && all.datum != datum {
                let problem = "another than before, expected one mode for all points";
                return Err(FormatError::at(
                    self.file,
                    Some(shape.line),
                    "altitudeMode",
                    problem,
                ));
            }
            all.datum = datum;
            all.over_ground = datum == Datum::Home;
        }
        all.points.append(&mut points);
        Ok(())
    }

    /// Whether it is an area of a geofence.
    fn keep(&self, shape: &Node, owner: &Owner) -> Result<Option<Keep>, FormatError> {
        match owner.get("keep") {
            None => Ok(None),
            Some("in") => Ok(Some(Keep::In)),
            Some("out") => Ok(Some(Keep::Out)),
            Some(other) => {
                let problem = format!("{other:?}, expected in or out");
                Err(FormatError::at(
                    self.file,
                    Some(shape.line),
                    "keep",
                    problem,
                ))
            }
        }
    }

    /// KML's tuples: longitude,latitude or longitude,latitude,altitude.
    fn tuples(&self, coordinates: &Node, points: &mut Vec<Point>) -> Result<(), FormatError> {
        for (line, text) in (coordinates.line..).zip(coordinates.text.split('\n')) {
            for tuple in text.split_whitespace() {
                points.push(self.tuple(tuple, line)?);
            }
        }
        Ok(())
    }

    fn tuple(&self, tuple: &str, line: u64) -> Result<Point, FormatError> {
        let parsed: Result<Vec<f64>, _> = tuple.split(',').map(str::parse).collect();
        match parsed.as_deref() {
            Ok([lon, lat, rest @ ..]) if rest.len() < 2 => {
                let alt = rest.first().copied().ok_or(NoAltitude::Missing);
                Ok(Point::found(*lat, *lon, alt, Some(line)))
            }
            _ => {
                let problem = format!("{tuple:?}, expected longitude,latitude,altitude");
                Err(FormatError::at(
                    self.file,
                    Some(line),
                    "coordinates",
                    problem,
                ))
            }
        }
    }
}

/// What altitudeMode says. Without one a KML lies on the ground (clampToGround), whatever altitudes its tuples give.
fn datum(shape: &Node, points: &mut [Point]) -> Datum {
    match shape.text_of("altitudeMode") {
        Some(ABSOLUTE) => Datum::SeaLevel,
        Some(RELATIVE) => Datum::Home,
        _ => {
            let ground = Some(NoAltitude::Ground);
            points.iter_mut().for_each(|p| p.no_altitude = ground);
            Datum::default()
        }
    }
}

fn extended(placemark: &Node) -> Vec<(String, String)> {
    let data = placemark
        .all("ExtendedData")
        .flat_map(|data| &data.children);
    let pairs = data.filter(|data| data.name == "Data").filter_map(|data| {
        let value = data.text_of("value")?;
        Some((data.attribute("name")?.to_owned(), value.to_owned()))
    });
    pairs.collect()
}

/// Writes a LineString, what is done at its points, the geofence and the rally points.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    let mode = if draft.datum == Datum::Home {
        RELATIVE
    } else {
        ABSOLUTE
    };
    let mut out = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>\n",
    );
    let points = draft.written();
    let done = points.iter().enumerate().flat_map(|(k, point)| {
        let pairs = attributes::of(&point.conduct).into_iter();
        pairs.map(move |(key, value)| (format!("point {} {key}", k + 1), value))
    });
    placemark(&mut out, &draft.name, &done.collect::<Vec<_>>());
    let _ = writeln!(
        out,
        "<LineString><altitudeMode>{mode}</altitudeMode><coordinates>"
    );
    for p in points.iter().map(|point| point.position) {
        let _ = writeln!(out, "{}", tuple(p));
    }
    out.push_str("</coordinates></LineString></Placemark>\n");
    let flat = |[north, east]: &[f64; 2]| format!("{east:.8},{north:.8}");
    for area in &draft.areas {
        let keep = ("keep".to_owned(), area.keep.word().to_owned());
        match &area.shape {
            Shape::Polygon(vertices) => {
                placemark(&mut out, "Geofence", &[keep]);
                let ring = vertices.iter().chain(vertices.first()).map(flat);
                let _ = writeln!(
                    out,
                    "<Polygon><outerBoundaryIs><LinearRing><coordinates>{}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>",
                    ring.collect::<Vec<_>>().join(" ")
                );
            }
            Shape::Circle { centre, radius_m } => {
                let radius = ("radius_m".to_owned(), radius_m.to_string());
                placemark(&mut out, "Geofence", &[keep, radius]);
                let centre = flat(centre);
                let _ = writeln!(
                    out,
                    "<Point><coordinates>{centre}</coordinates></Point></Placemark>"
                );
            }
        }
    }
    for p in &draft.rally {
        placemark(
            &mut out,
            "Rally point",
            &[("rally".to_owned(), "yes".to_owned())],
        );
        let _ = writeln!(
            out,
            "<Point><altitudeMode>{RELATIVE}</altitudeMode><coordinates>{}</coordinates></Point></Placemark>",
            tuple(*p)
        );
    }
    lost::extras(draft, losses);
    out + "</Document></kml>\n"
}

fn placemark(out: &mut String, name: &str, data: &[(String, String)]) {
    let _ = write!(out, "<Placemark><name>{}</name>", escaped(name));
    if !data.is_empty() {
        out.push_str("<ExtendedData>\n");
        for (key, value) in data {
            let (key, value) = (escaped(key), escaped(value));
            let _ = writeln!(out, "<Data name=\"{key}\"><value>{value}</value></Data>");
        }
        out.push_str("</ExtendedData>");
    }
}

fn tuple(p: Position) -> String {
    format!("{:.8},{:.8},{:.3}", p.lon_deg, p.lat_deg, p.alt_m)
}

/// altitudeMode above the ground, which is flown as above home; above mean sea level.
const RELATIVE: &str = "relativeToGround";
const ABSOLUTE: &str = "absolute";
/// The document of a KMZ.
const DOC: &str = "doc.kml";
/// A KML of a million points has 30 MB; a zip that unpacks to more was made to fill the memory.
const MAX_UNPACKED: u64 = 256 << 20;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_of_a_point_that_is_not_there_is_lost_by_name() {
        let data = [
            "point 1 speed_m_s",
            "point 9 speed_m_s",
            "point 2 colour",
            "point of view",
        ]
        .map(|name| format!("<Data name=\"{name}\"><value>6</value></Data>"))
        .concat();
        let text = format!(
            "<kml><Placemark><ExtendedData>{data}</ExtendedData><LineString><altitudeMode>absolute</altitudeMode>\
             <coordinates>8.5,47.4,520 8.51,47.4,520</coordinates></LineString></Placemark></kml>"
        );
        let lines = read(Path::new("a.kml"), &text).expect("a line");
        let line = &lines.lines[0];
        assert_eq!(line.points[0].conduct.speed_m_s, Some(6.0));
        let lost: Vec<&str> = line.losses.lost.iter().map(|loss| &*loss.what).collect();
        assert_eq!(
            lost,
            ["data \"point 9 speed_m_s\"", "data \"point 2 colour\""]
        );
    }

    #[test]
    fn a_ring_keeps_its_last_corner_where_it_is_not_the_first() {
        let ring = |last: &str, data: &str| {
            let text = format!(
                "<kml><Placemark>{data}<Polygon><altitudeMode>absolute</altitudeMode><outerBoundaryIs><LinearRing>\
                 <coordinates>8.5,47.4,520 8.51,47.4,520 8.51,47.41,520{last}</coordinates></LinearRing>\
                 </outerBoundaryIs></Polygon></Placemark></kml>"
            );
            read(Path::new("a.kml"), &text).expect("a ring")
        };
        // The altitude of the repeated corner does not count: the leg back leads to the first.
        for last in ["", " 8.5,47.4,520", " 8.5,47.4"] {
            let line = &ring(last, "").lines[0];
            assert_eq!((line.closed, line.points.len()), (true, 3), "{last:?}");
            let keep = "<ExtendedData><Data name=\"keep\"><value>in</value></Data></ExtendedData>";
            let Shape::Polygon(vertices) = &ring(last, keep).areas[0].shape else {
                panic!("a polygon");
            };
            assert_eq!(vertices.len(), 3, "{last:?}");
        }
    }

    #[test]
    fn a_rally_point_above_sea_level_is_refused() {
        let rally = |mode: &str| {
            let text = format!(
                "<kml><Placemark><ExtendedData><Data name=\"rally\"><value>yes</value></Data></ExtendedData>\
                 <Point><altitudeMode>{mode}</altitudeMode><coordinates>8.5,47.4,30</coordinates></Point></Placemark></kml>"
            );
            read(Path::new("a.kml"), &text)
        };
        let lines = rally(RELATIVE).expect("it is above home");
        assert_eq!(lines.rally, [Position::new(47.4, 8.5, 30.0)]);
        for mode in [ABSOLUTE, "clampToGround", ""] {
            let fault = rally(mode).err().expect("it is refused").to_string();
            assert!(fault.contains("rally points are above home"), "{fault}");
        }
        let flat = "<kml><Placemark><ExtendedData><Data name=\"rally\"><value>yes</value></Data></ExtendedData><Point>\
                    <altitudeMode>relativeToGround</altitudeMode><coordinates>8.5,47.4</coordinates></Point></Placemark></kml>";
        let fault = read(Path::new("a.kml"), flat).err().expect("it is refused");
        let fault = fault.to_string();
        assert!(fault.contains("coordinates: no altitude"), "{fault}");
    }
}
