//! The program's own format, TOML: waypoints, and the control points of the curved legs between them.
//!
//! ```toml
//! name = "bend"
//! closed = false
//!
//! [[waypoint]]
//! lat_deg = 47.4
//! lon_deg = 8.5
//! alt_m = 500.0
//! p2 = { lat_deg = 47.4002, lon_deg = 8.5005 }             # of the leg from here to the next waypoint
//! p3 = { lat_deg = 47.4004, lon_deg = 8.5010 }             # alt_m in both or in neither
//!
//! [[waypoint]]
//! lat_deg = 47.4
//! lon_deg = 8.502
//! alt_m = 500.0
//! ```

use std::fmt::Write;
use std::path::Path;

use curve_paths::{Control, Position};
use serde::Deserialize;

use crate::failure::Failure;
use crate::route::{Route, Waypoint};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    name: String,
    #[serde(default)]
    closed: bool,
    waypoint: Vec<toml::Spanned<Entry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    lat_deg: f64,
    lon_deg: f64,
    #[serde(default)]
    alt_m: f64,
    p2: Option<Point>,
    p3: Option<Point>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Point {
    lat_deg: f64,
    lon_deg: f64,
    alt_m: Option<f64>,
}

impl From<Point> for Control {
    fn from(p: Point) -> Self {
        Self {
            lat_deg: p.lat_deg,
            lon_deg: p.lon_deg,
            alt_m: p.alt_m,
        }
    }
}

/// Reads a route.
pub(crate) fn read(file: &Path, text: &str) -> Result<Route, Failure> {
    let line_of =
        |offset: usize| Some(1 + text[..offset.min(text.len())].matches('\n').count() as u64);
    let parsed: File = toml::from_str(text).map_err(|e| {
        Failure::at(
            file,
            e.span().and_then(|s| line_of(s.start)),
            "",
            e.message(),
        )
    })?;
    let mut waypoints = Vec::with_capacity(parsed.waypoint.len());
    for (k, entry) in parsed.waypoint.into_iter().enumerate() {
        let line = line_of(entry.span().start);
        let entry = entry.into_inner();
        let curve = match (entry.p2, entry.p3) {
            (Some(p2), Some(p3)) => Some([p2.into(), p3.into()]),
            (None, None) => None,
            (p2, _) => {
                let missing = if p2.is_some() { "p3" } else { "p2" };
                let field = format!("waypoint {}: {missing}", k + 1);
                return Err(Failure::at(
                    file,
                    line,
                    field,
                    "missing, expected p2 and p3 or neither",
                ));
            }
        };
        waypoints.push(Waypoint {
            position: Position::new(entry.lat_deg, entry.lon_deg, entry.alt_m),
            line,
            curve,
        });
    }
    Ok(Route {
        name: parsed.name,
        closed: parsed.closed,
        waypoints,
        skipped: 0,
    })
}

/// Writes a route, curves and all.
pub(crate) fn write(route: &Route) -> String {
    let mut out = format!("name = {:?}\nclosed = {}\n", route.name, route.closed);
    for w in &route.waypoints {
        let p = w.position;
        let _ = write!(
            out,
            "\n[[waypoint]]\nlat_deg = {}\nlon_deg = {}\nalt_m = {}\n",
            number(p.lat_deg),
            number(p.lon_deg),
            number(p.alt_m)
        );
        for (name, c) in ["p2", "p3"].into_iter().zip(w.curve.iter().flatten()) {
            let alt = c
                .alt_m
                .map_or_else(String::new, |a| format!(", alt_m = {}", number(a)));
            let _ = writeln!(
                out,
                "{name} = {{ lat_deg = {}, lon_deg = {}{alt} }}",
                number(c.lat_deg),
                number(c.lon_deg)
            );
        }
    }
    out
}

/// A float as TOML wants it: never without its point.
fn number(x: f64) -> String {
    format!("{x:?}")
}
