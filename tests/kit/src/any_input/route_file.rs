//! Any bytes as a route file, of each kind: the bridge reads what a web client sends.

use std::path::Path;

use route_files::formats::{Import, content_to_send};
use stanag_msgs::Id;

const KINDS: [&str; 8] = [
    "toml",
    "plan",
    "waypoints",
    "geojson",
    "kml",
    "kmz",
    "gpx",
    "csv",
];

/// The first byte chooses the kind, and whether a height is given; the rest is the file.
///
/// # Panics
/// An error has no text.
pub fn run(bytes: &[u8]) {
    let Some((first, content)) = bytes.split_first() else {
        return;
    };
    let kind = KINDS[usize::from(*first) % KINDS.len()];
    let name = format!("any.{kind}");
    let import = Import::of(None, None, (*first >= 128).then_some(50.0));
    match content_to_send(Path::new(&name), content.to_vec(), &import) {
        Ok((route, losses)) => {
            let _ = losses.to_json();
            if let Err(fault) = route.datagrams(Id(1), Id(2), 0) {
                assert!(!fault.to_string().is_empty());
            }
        }
        Err(fault) => assert!(!fault.to_string().is_empty()),
    }
}
