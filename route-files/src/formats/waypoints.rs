//! The text file of missions that Mission Planner, MAVProxy and QGroundControl write: `QGC WPL 110`, an item a line.
//!
//! In version 110 row 0 is home where it is a waypoint above sea level: MAVProxy saves the mission of a PX4, which has no
//! home in it, from row 0 on. Version 120 has no home.

use std::fmt::Write;
use std::path::Path;

use curve_paths::Position;

use super::draft::Draft;
use super::fault::FormatError;
use super::items::{MissionItem, NAV_WAYPOINT, Reader, items};
use super::losses::Losses;
use super::lost;
use super::qgc_plan::home;

/// Reads a .waypoints or .txt.
pub(super) fn read(file: &Path, text: &str) -> Result<Draft, FormatError> {
    let mut lines = text.lines().enumerate();
    let head = lines.next().map_or("", |(_, l)| l.trim());
    let with_home = match head {
        "QGC WPL 110" => true,
        "QGC WPL 120" => false,
        _ => {
            let problem = format!("{head:?}, expected \"QGC WPL 110\"");
            return Err(FormatError::at(file, Some(1), "", problem));
        }
    };
    let mut reader = Reader::default();
    let mut found_home = None;
    // MAVProxy writes an item's comment on a line of its own before it.
    let rows = lines.filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
    for (k, line) in rows {
        let number = Some(k as u64 + 1);
        let fields: Vec<&str> = line.split_whitespace().collect();
        if fields.len() != 12 {
            let problem = format!("{} fields, expected 12", fields.len());
            return Err(FormatError::at(file, number, "", problem));
        }
        let value = |n: usize, name: &str| {
            fields[n].parse::<f64>().map_err(|_| {
                let problem = format!("{:?}, expected a number", fields[n]);
                FormatError::at(file, number, name, problem)
            })
        };
        let whole = |n: usize, name: &str, most: u16| match fields[n].parse::<u16>() {
            Ok(value) if value <= most => Ok(value),
            _ => {
                let problem = format!("{:?}, expected a whole number of 0 to {most}", fields[n]);
                Err(FormatError::at(file, number, name, problem))
            }
        };
        let index = whole(0, "index", u16::MAX)?;
        let frame = whole(2, "frame", u8::MAX.into())? as u8;
        let command = whole(3, "command", u16::MAX)?;
        let mut params = [0.0; 7];
        let names = ["param1", "param2", "param3", "param4"];
        let names = names
            .into_iter()
            .chain(["latitude", "longitude", "altitude"]);
        for (n, name) in names.enumerate() {
            params[n] = value(n + 4, name)?;
        }
        // Mission Planner has written home as command 0.
        let is_home = index == 0 && frame == 0 && [0, NAV_WAYPOINT].contains(&command);
        if with_home && is_home {
            found_home = Some(Position::new(params[4], params[5], params[6]));
            continue;
        }
        let taken = reader.take(&MissionItem {
            item: reader.next(),
            id: index.into(),
            command,
            frame,
            params,
            line: number,
        });
        taken.map_err(|problem| FormatError::at(file, number, "frame", problem))?;
    }
    reader.finish(found_home).ok_or_else(|| {
        let problem =
            "no row of home (0), expected one: some items are relative to home and some are not";
        FormatError::file(file, problem)
    })
}

/// Writes version 110; home at the first point where none is known.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    let mut out = String::from("QGC WPL 110\n");
    let home = home(draft).map(|p| MissionItem {
        item: 0,
        id: 0,
        command: NAV_WAYPOINT,
        frame: 0,
        params: [0.0, 0.0, 0.0, 0.0, p.lat_deg, p.lon_deg, p.alt_m],
        line: None,
    });
    for item in home.into_iter().chain(items(draft, losses)) {
        let current = u8::from(item.id == 1);
        let _ = write!(
            out,
            "{}\t{current}\t{}\t{}",
            item.id, item.frame, item.command
        );
        // A text file says 0 for none.
        let some = item.params.map(|p| if p.is_finite() { p } else { 0.0 });
        let [params @ .., lat, lon, alt] = some;
        for param in params {
            let _ = write!(out, "\t{param}");
        }
        let _ = writeln!(out, "\t{lat:.8}\t{lon:.8}\t{alt:.3}\t1");
    }
    lost::planned(draft, losses);
    lost::fence(draft, losses);
    lost::rally(draft, losses);
    out
}
