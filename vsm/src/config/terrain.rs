//! `vehicle.terrain`: the elevation files that routes are checked against, read completely before anything is served.
//!
//! They are read at the start, not when a route needs them: a machine does no I/O, a file of 26 MB takes a slow disk a
//! second, and a damaged file must be detected before the flight. On a reload, a folder whose files are unchanged in name,
//! length and modification time is not read again: a second copy in memory would need a second GiB.

use std::collections::BTreeMap;
use std::fmt;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use curve_paths::terrain::{Grid, Terrain};
use serde::Deserialize;

use super::named_file::open_file;

/// A folder of elevation files.
#[derive(Clone, Deserialize)]
#[serde(from = "PathBuf")]
pub struct TerrainFolder {
    /// Where it is.
    pub dir: PathBuf,
    /// What is in it; none before `Config::read_terrain`.
    contents: Option<Contents>,
}

/// The files of a folder, and what they say of the ground.
#[derive(Clone)]
struct Contents {
    files: Vec<Listed>,
    ground: Arc<Terrain>,
}

/// A file, as its folder lists it.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Listed {
    path: PathBuf,
    length: u64,
    changed: Option<SystemTime>,
}

/// Elevation files that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("vehicle.terrain: {path}: {problem}", path = path.display())]
pub struct TerrainFault {
    /// The folder, or a file of it.
    path: PathBuf,
    problem: String,
}

impl TerrainFault {
    /// The folder, or a file of it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl From<PathBuf> for TerrainFolder {
    fn from(dir: PathBuf) -> Self {
        TerrainFolder {
            dir,
            contents: None,
        }
    }
}

impl fmt::Debug for TerrainFolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.dir)
    }
}

impl TerrainFolder {
    /// The ground. Where it has not been read no place is known, which is reported with each route.
    #[must_use]
    pub fn ground(&self) -> Arc<Terrain> {
        let contents = self.contents.as_ref();
        contents.map_or_else(Arc::default, |contents| contents.ground.clone())
    }
}

/// Reads the files of each of these folders, each folder once. What those of `before` have read already is used again.
///
/// # Errors
/// A folder cannot be read, has none or too many, or one of them is damaged.
pub(super) fn read<'a>(
    folders: impl Iterator<Item = &'a mut TerrainFolder>,
    before: impl Iterator<Item = &'a TerrainFolder>,
) -> Result<(), TerrainFault> {
    let known = before.filter_map(|folder| folder.contents.as_ref());
    let mut known: Vec<Contents> = known.cloned().collect();
    let mut read: BTreeMap<PathBuf, Contents> = BTreeMap::new();
    for folder in folders {
        let contents = match read.get(&folder.dir) {
            Some(contents) => contents.clone(),
            None => {
                let files = list(&folder.dir)?;
                match known.iter().position(|contents| contents.files == files) {
                    Some(index) => known.swap_remove(index),
                    None => Contents {
                        ground: Arc::new(read_files(&files)?),
                        files,
                    },
                }
            }
        };
        read.insert(folder.dir.clone(), contents.clone());
        folder.contents = Some(contents);
    }
    Ok(())
}

fn fault(path: &Path, problem: String) -> TerrainFault {
    TerrainFault {
        path: path.to_owned(),
        problem,
    }
}

fn list(dir: &Path) -> Result<Vec<Listed>, TerrainFault> {
    let unreadable = |cause: std::io::Error| fault(dir, format!("{cause}, expected a folder"));
    let mut files = Vec::new();
    let mut all = 0;
    for entry in std::fs::read_dir(dir).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().and_then(|ending| ending.to_str());
        let ending = ending.unwrap_or_default().to_ascii_lowercase();
        if ["hgt", "tif", "tiff", "asc"].contains(&ending.as_str()) {
            // A file whose metadata cannot be read is still listed: reading it fails later, with its name.
            let file = std::fs::metadata(&path).ok();
            let length = file.as_ref().map_or(0, std::fs::Metadata::len);
            all += length;
            files.push(Listed {
                path,
                length,
                changed: file.and_then(|file| file.modified().ok()),
            });
        }
    }
    if files.is_empty() {
        let problem = "no .hgt, .tif or .asc in it, expected elevation files such as N47E008.hgt";
        return Err(fault(dir, problem.to_owned()));
    }
    if all > MAX_BYTES {
        return Err(fault(dir, too_much(all)));
    }
    // If two files cover a place the first one counts; sorted, so that it is the same one on every system.
    files.sort();
    Ok(files)
}

fn read_files(files: &[Listed]) -> Result<Terrain, TerrainFault> {
    let mut grids = Vec::new();
    let mut all = 0;
    for Listed { path, .. } in files {
        let mut bytes = Vec::new();
        let read = open_file(path).and_then(|mut file| file.read_to_end(&mut bytes));
        read.map_err(|cause| fault(path, cause.to_string()))?;
        let name = path.file_name().and_then(|name| name.to_str());
        let read = Grid::read(name.unwrap_or_default(), bytes);
        let grid = read.map_err(|cause| fault(path, cause.to_string()))?;
        // A compressed file is larger in memory than on disk.
        all += grid.bytes() as u64;
        if all > MAX_BYTES {
            return Err(fault(path, too_much(all)));
        }
        grids.push(grid);
    }
    Ok(Terrain::new(grids))
}

fn too_much(bytes: u64) -> String {
    format!(
        "{} MB of elevation files, expected at most {}: keep those of the area that is flown in",
        bytes / 1_000_000,
        MAX_BYTES / 1_000_000
    )
}

/// They stay in memory: forty tiles of an arc second.
const MAX_BYTES: u64 = 1 << 30;
