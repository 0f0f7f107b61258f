//! A file of a route into the datagrams by which its client loads it: those that `cucs send` would send.

use std::path::Path;

use route_files::formats::{self, Import, Loss, Losses};
use stanag_msgs::{Id, TimeStamp};

use crate::session::web::RouteFile;

/// What a file becomes.
pub(super) struct Taken {
    /// In their order; the last loads the route.
    pub(super) datagrams: Vec<Vec<u8>>,
    /// The Time Stamp of the last.
    pub(super) load: u64,
    /// What of the file is not in them.
    pub(super) lost: Vec<String>,
}

/// Reads it.
///
/// # Errors
/// The file is not a route, or cannot be sent unchanged: with what was found, and where.
pub(super) fn datagrams(file: &RouteFile, cucs: Id) -> Result<Taken, String> {
    // Of the name its ending is used, and it stands in errors: it names no file here.
    let name = Path::new(&file.file)
        .file_name()
        .ok_or("route: file is empty, expected a name such as field.kml")?;
    let name = Path::new(name);
    if file.altitude_m.is_some() && file.height_m.is_some() {
        return Err("route: expected either altitude_m or height_m".to_owned());
    }
    let mut import = Import::of(file.line.clone(), file.altitude_m, file.height_m);
    import.most_unpacked = Some(MAX_UNPACKED);
    let (route, losses) = formats::content_to_send(name, file.content.clone(), &import)
        .map_err(|fault| format!("route: {fault}"))?;
    let unix_ms = TimeStamp(file.stamp).unix_ms();
    let datagrams = route
        .datagrams(file.vehicle, cucs, unix_ms)
        .map_err(|fault| format!("route: {fault}"))?;
    let after = datagrams.len().saturating_sub(1) as u64;
    Ok(Taken {
        load: (file.stamp + after) % TimeStamp::PERIOD_MS,
        lost: lost_of(&losses),
        datagrams,
    })
}

/// A frame is bounded: names the first losses, and the number of the others.
fn lost_of(losses: &Losses) -> Vec<String> {
    let named = losses.lost.iter().take(MAX_NAMED);
    let mut named: Vec<String> = named.map(|loss| lost(loss, losses)).collect();
    let more = losses.lost.len().saturating_sub(MAX_NAMED);
    if more > 0 {
        named.push(format!("and {more} more"));
    }
    named
}

/// The text of a route of ten thousand waypoints has less.
const MAX_UNPACKED: u64 = 1 << 20;
const MAX_NAMED: usize = 50;

fn lost(loss: &Loss, of: &Losses) -> String {
    match loss.item {
        Some(item) => format!("{} at {} {item}", loss.what, of.unit),
        None => loss.what.clone(),
    }
}
