//! The lines of a file that has several, and which of them is the route.

use std::path::Path;

use clap::Args;
use curve_paths::Position;

use super::draft::{Draft, Point, open_ring};
use super::fault::FormatError;
use super::losses::points;
use crate::fence::{Area, Keep, Shape};

/// Which line of a file that has several.
#[derive(Clone, Debug, Default, Args)]
pub(super) struct Line {
    /// Use this line of a file with several, by its name or its number from 1 (KML, KMZ, GPX, GeoJSON).
    #[arg(long, value_name = "NAME|N")]
    pub(super) line: Option<String>,
}

/// The lines of a file, or else its points; and what belongs to all of them.
#[derive(Default)]
pub(super) struct Lines {
    pub(super) lines: Vec<Draft>,
    pub(super) points: Draft,
    pub(super) areas: Vec<Area>,
    pub(super) rally: Vec<Position>,
}

impl Lines {
    /// One more. A file of thousands of empty lines was made to fill the memory of who names them all.
    pub(super) fn push(&mut self, file: &Path, mut line: Draft) -> Result<(), FormatError> {
        if self.lines.len() >= MAX_LINES {
            let problem = format!("over {MAX_LINES} lines, expected one that is flown");
            return Err(FormatError::file(file, problem));
        }
        if let Some((end, _)) = line.name.char_indices().nth(MAX_NAME) {
            line.name.truncate(end);
        }
        self.lines.push(line);
        Ok(())
    }

    /// An area of the geofence within a ring.
    pub(super) fn push_polygon(&mut self, keep: Keep, mut ring: Vec<Point>) {
        open_ring(&mut ring);
        let positions = ring.iter().map(|point| point.position);
        let vertices = positions.map(|at| [at.lat_deg, at.lon_deg]);
        let shape = Shape::Polygon(vertices.collect());
        self.areas.push(Area { keep, shape });
    }

    /// One around a place.
    pub(super) fn push_circle(&mut self, keep: Keep, centre: Position, radius_m: f64) {
        let centre = [centre.lat_deg, centre.lon_deg];
        let shape = Shape::Circle { centre, radius_m };
        self.areas.push(Area { keep, shape });
    }

    /// The requested line, or the first; the others, and the points beside it, are named as lost.
    pub(super) fn choose(self, file: &Path, line: &Line) -> Result<Draft, FormatError> {
        let names = self.lines.iter().enumerate().map(|(k, draft)| {
            let name = Some(&draft.name).filter(|name| !name.is_empty());
            let named = name.map_or_else(String::new, |name| format!(" {name:?}"));
            format!("line {}{named} ({})", k + 1, points(draft.points.len()))
        });
        let names: Vec<String> = names.collect();
        let wanted = match &line.line {
            None => 0,
            Some(wanted) => {
                let by_name = self.lines.iter().position(|draft| draft.name == *wanted);
                let number = wanted.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
                let by_number = number.filter(|k| *k < self.lines.len());
                by_name.or(by_number).ok_or_else(|| {
                    let mut known = names
                        .iter()
                        .take(NAMED)
                        .cloned()
                        .collect::<Vec<_>>()
                        .join(", ");
                    if names.len() > NAMED {
                        known += &format!(" and {} more", names.len() - NAMED);
                    }
                    FormatError::Option(format!(
                        "{}: --line {wanted}: no such line, expected one of {known}",
                        file.display()
                    ))
                })?
            }
        };
        let aside = self.points.points.len();
        let mut lines = self.lines.into_iter();
        let mut draft = match lines.nth(wanted) {
            None => self.points,
            Some(mut draft) => {
                for (k, name) in names.into_iter().enumerate() {
                    if k != wanted {
                        draft.losses.add_whole(name);
                    }
                }
                if aside > 0 {
                    let what = format!("{} beside the line", points(aside));
                    draft.losses.add_whole(what);
                }
                draft
            }
        };
        draft.areas = self.areas;
        draft.rally = self.rally;
        Ok(draft.numbered())
    }
}

/// More than a survey of a whole day has.
const MAX_LINES: usize = 1_000;
/// Characters of a name that are kept: a route's has 20 on its way to a vehicle.
const MAX_NAME: usize = 200;
/// Lines that an error names.
const NAMED: usize = 20;
