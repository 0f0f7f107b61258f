//! GPX: routes, tracks, or else waypoints. Altitudes are above mean sea level. What is done at a point stands in its
//! `extensions`, under keys of this program.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use super::draft::{Draft, NoAltitude, Point};
use super::fault::FormatError;
use super::lines::Lines;
use super::losses::Losses;
use super::xml::{self, Node, escaped};
use super::{attributes, losses, lost};

/// Reads a GPX: its routes and tracks, or else its waypoints.
pub(super) fn read(file: &Path, text: &str) -> Result<Lines, FormatError> {
    let document = xml::document(file, text)?;
    let mut lines = Lines::default();
    for gpx in document.all("gpx") {
        for route in gpx.all("rte") {
            lines.push(file, line(file, route, &[route], "rtept")?)?;
        }
        for track in gpx.all("trk") {
            let segments: Vec<&Node> = track.all("trkseg").collect();
            let mut draft = line(file, track, &segments, "trkpt")?;
            if segments.len() > 1 {
                let what = format!("gaps between {} segments (joined)", segments.len());
                draft.losses.add_whole(what);
            }
            lines.push(file, draft)?;
        }
        lines.points = line(file, gpx, &[gpx], "wpt")?;
        lines.points.name.clear();
    }
    Ok(lines)
}

fn line(file: &Path, owner: &Node, parts: &[&Node], name: &str) -> Result<Draft, FormatError> {
    let mut draft = Draft {
        name: owner.text_of("name").unwrap_or_default().to_owned(),
        ..Draft::default()
    };
    let mut others: BTreeMap<&str, usize> = BTreeMap::new();
    for node in parts.iter().flat_map(|part| part.all(name)) {
        let at =
            |field: &str, problem: String| FormatError::at(file, Some(node.line), field, problem);
        let degrees = |which: &str| {
            let field = format!("{name} {which}");
            let text = node.attribute(which);
            let text = text.ok_or_else(|| at(&field, "missing, expected degrees".into()))?;
            let value = text.trim().parse::<f64>();
            value.map_err(|_| at(&field, format!("{text:?}, expected degrees")))
        };
        let alt_m = match node.text_of("ele").filter(|text| !text.is_empty()) {
            None => Err(NoAltitude::Missing),
            Some(text) => Ok(text
                .parse()
                .map_err(|_| at("ele", format!("{text:?}, expected a number")))?),
        };
        let mut point = Point::found(degrees("lat")?, degrees("lon")?, alt_m, Some(node.line));
        for child in &node.children {
            match child.name.as_str() {
                "extensions" => {
                    for own in &child.children {
                        let taken = attributes::set(&mut point.conduct, &own.name, &own.text);
                        if !taken.map_err(|problem| at(&own.name, problem))? {
                            *others.entry(&own.name).or_default() += 1;
                        }
                    }
                }
                known if LABELS.contains(&known) => {}
                other => *others.entry(other).or_default() += 1,
            }
        }
        draft.points.push(point);
    }
    for (what, count) in others {
        draft
            .losses
            .add_whole(format!("{what} of {}", losses::points(count)));
    }
    Ok(draft)
}

/// Elements of a point that are read, or are only for people.
const LABELS: [&str; 9] = [
    "ele", "name", "cmt", "desc", "src", "link", "sym", "type", "number",
];

/// Writes a route.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <gpx version=\"1.1\" creator=\"curve-plan\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n\
         <rte><name>{}</name>\n",
        escaped(&draft.name)
    );
    for point in draft.written() {
        let p = point.position;
        let _ = write!(
            out,
            "<rtept lat=\"{:.8}\" lon=\"{:.8}\"><ele>{:.3}</ele>",
            p.lat_deg, p.lon_deg, p.alt_m
        );
        let done = attributes::of(&point.conduct);
        if !done.is_empty() {
            // Extensions have a namespace of their own, or the file is no GPX.
            let _ = write!(out, "<extensions>");
            for (key, value) in done {
                let value = escaped(&value);
                let _ = write!(out, "<v:{key} xmlns:v=\"{NAMESPACE}\">{value}</v:{key}>");
            }
            let _ = write!(out, "</extensions>");
        }
        out.push_str("</rtept>\n");
    }
    lost::extras(draft, losses);
    lost::fence(draft, losses);
    lost::rally(draft, losses);
    out + "</rte></gpx>\n"
}

const NAMESPACE: &str = "urn:curve-plan:route";
