//! The files that routes and tracks are kept in, told apart by their ending.

mod table;

use std::path::Path;

use crate::failure::Failure;
use crate::route::Route;

/// Which rows of a table of several laps to read.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Selection {
    /// The lap, where the table has a column of that name; none, all of them.
    pub(crate) lap: Option<i64>,
    /// Keep each n-th fix, from the first; 1 keeps all.
    pub(crate) every: usize,
}

/// Reads a route or track.
pub(crate) fn read(file: &Path, selection: Selection) -> Result<Route, Failure> {
    let text = std::fs::read_to_string(file).map_err(|e| Failure::file(file, e))?;
    let ending = file
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or("")
        .to_ascii_lowercase();
    let mut route = match ending.as_str() {
        "csv" => table::read(file, &text, selection.lap)?,
        _ => {
            return Err(Failure::file(
                file,
                format!("unknown ending {ending:?}, expected one of {ENDINGS}"),
            ));
        }
    };
    if selection.lap.is_some() && ending != "csv" {
        return Err(Failure::Usage(
            "--lap needs a table with a column lap (.csv)".into(),
        ));
    }
    let every = selection.every.max(1);
    if every > 1 {
        route.waypoints = route.waypoints.into_iter().step_by(every).collect();
    }
    Ok(route)
}

/// The endings that are known.
const ENDINGS: &str = "csv";
