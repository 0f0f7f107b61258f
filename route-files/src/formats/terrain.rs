//! The ground below a route, from elevation files that are read when they are needed ([`curve_paths::terrain`]).
//!
//! A place that no file covers, or whose samples are void, is refused by name: an absent height is never a number.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use curve_paths::terrain::{self, Grid, SPACING_M, tile_name};
use curve_paths::{Densified, Position};

use super::fault::FormatError;

/// Heights of the ground, read when they are needed.
#[derive(Debug)]
pub struct Terrain {
    path: PathBuf,
    /// Of a folder the tiles that were read, by their names; of a file that one.
    grids: RefCell<HashMap<PathBuf, Rc<Grid>>>,
}

/// How far a route is above the ground where it is nearest to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Metres, negative below ground.
    pub clearance_m: f64,
    /// Where.
    pub at: Position,
    /// The leg that it is on, from 0.
    pub leg: usize,
}

impl Terrain {
    /// Of a file, or of a folder of SRTM tiles named by their south-western corners (N47E008.hgt).
    pub(super) fn open(path: &Path) -> Result<Self, FormatError> {
        let terrain = Self {
            path: path.to_owned(),
            grids: RefCell::default(),
        };
        if !path.is_dir() {
            terrain.grid(path)?;
        }
        Ok(terrain)
    }

    /// The height of the ground, m above mean sea level.
    pub(super) fn height_m(&self, lat_deg: f64, lon_deg: f64) -> Result<f64, FormatError> {
        let path = if self.path.is_dir() {
            let tile = tile_name(lat_deg, lon_deg);
            let path = self.path.join(&tile);
            if !path.exists() {
                let problem =
                    format!("no tile {tile}, expected one for {lat_deg:.6}, {lon_deg:.6}");
                return Err(FormatError::file(&self.path, problem));
            }
            path
        } else {
            self.path.clone()
        };
        let grid = self.grid(&path)?;
        grid.height_m(lat_deg, lon_deg)
            .map_err(|fault| FormatError::file(&path, fault.to_string()))
    }

    /// Where the straight legs between vertices, at altitudes above mean sea level, are nearest to the ground.
    pub(super) fn clearance(&self, flown: &Densified) -> Result<Clearance, FormatError> {
        let mut lowest: Option<Clearance> = None;
        for pair in flown.vertices.windows(2) {
            let ground = |lat, lon| self.height_m(lat, lon).map(Some);
            let (from, to) = (pair[0].position, pair[1].position);
            let found = terrain::profile(from, to, SPACING_M, ground)?.lowest;
            if let Some(terrain::Clearance { clearance_m, at }) = found
                && lowest.is_none_or(|so_far| clearance_m < so_far.clearance_m)
            {
                lowest = Some(Clearance {
                    clearance_m,
                    at,
                    leg: pair[1].leg,
                });
            }
        }
        lowest.ok_or_else(|| FormatError::Answer("the route has no legs".into()))
    }

    fn grid(&self, path: &Path) -> Result<Rc<Grid>, FormatError> {
        if let Some(grid) = self.grids.borrow().get(path) {
            return Ok(Rc::clone(grid));
        }
        let fault = |problem: String| FormatError::file(path, problem);
        let bytes = std::fs::read(path).map_err(|e| fault(e.to_string()))?;
        let name = path.file_name().and_then(|name| name.to_str());
        let grid = Grid::read(name.unwrap_or(""), bytes).map_err(|e| fault(e.to_string()))?;
        let grid = Rc::new(grid);
        self.grids
            .borrow_mut()
            .insert(path.to_owned(), Rc::clone(&grid));
        Ok(grid)
    }
}
