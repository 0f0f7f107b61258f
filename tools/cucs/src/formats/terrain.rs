//! The height of the ground, from files: SRTM tiles (`.hgt`, 1 or 3 arc seconds) and ESRI ASCII grids (`.asc`).
//!
//! Heights are metres above mean sea level (SRTM: EGM96). Between samples the ground is interpolated bilinearly. A place that
//! no file covers, or whose samples are void, has no height, and is refused by name: an absent height is never a number.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use curve_paths::{Densified, Position};

use super::fault::FormatError;

/// Heights of the ground, read when they are needed.
#[derive(Debug)]
pub struct Terrain {
    path: PathBuf,
    /// Of a folder the tiles that were read, by their names; of a file that one.
    grids: RefCell<HashMap<PathBuf, Rc<Grid>>>,
}

/// Samples at equal steps of latitude and longitude, the northernmost row first.
#[derive(Debug)]
struct Grid {
    /// Of the westernmost and the southernmost samples, degrees.
    west: f64,
    south: f64,
    /// Between samples, degrees.
    step: f64,
    columns: usize,
    rows: usize,
    /// Metres; NaN where there is none.
    heights_m: Vec<f32>,
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
            .map_err(|problem| FormatError::file(&path, problem))
    }

    /// Where the straight legs between vertices, at altitudes above mean sea level, are nearest to the ground.
    pub(super) fn clearance(&self, flown: &Densified) -> Result<Clearance, FormatError> {
        let mut lowest: Option<Clearance> = None;
        let mut look = |at: Position, leg: usize| -> Result<(), FormatError> {
            let clearance_m = at.alt_m - self.height_m(at.lat_deg, at.lon_deg)?;
            if lowest.is_none_or(|so_far| clearance_m < so_far.clearance_m) {
                lowest = Some(Clearance {
                    clearance_m,
                    at,
                    leg,
                });
            }
            Ok(())
        };
        for pair in flown.vertices.windows(2) {
            let (from, to) = (pair[0].position, pair[1].position);
            let length_m = from.ground().distance_m(to.ground());
            // Finer than any samples: the ground between two vertices counts too.
            let parts = (length_m / SPACING_M).ceil().max(1.0) as u32;
            for part in 0..=parts {
                let t = f64::from(part) / f64::from(parts);
                look(between(from, to, t), pair[1].leg)?;
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
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        let grid = match ending.to_ascii_lowercase().as_str() {
            "hgt" => tile(path, &bytes),
            "asc" => ascii_grid(&bytes),
            other => Err(format!(
                "unknown ending {other:?}, expected .hgt, .asc or a folder of .hgt"
            )),
        };
        let grid = Rc::new(grid.map_err(fault)?);
        self.grids
            .borrow_mut()
            .insert(path.to_owned(), Rc::clone(&grid));
        Ok(grid)
    }
}

impl Grid {
    fn height_m(&self, lat_deg: f64, lon_deg: f64) -> Result<f64, String> {
        let (x, y) = (
            (lon_deg - self.west) / self.step,
            (lat_deg - self.south) / self.step,
        );
        let (last_x, last_y) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        // A place on the edge is inside, whatever the division has rounded.
        if !(-EDGE..=last_x + EDGE).contains(&x) || !(-EDGE..=last_y + EDGE).contains(&y) {
            return Err(format!(
                "{lat_deg:.6}, {lon_deg:.6} is outside it: it covers {:.4} to {:.4}, {:.4} to {:.4}",
                self.south,
                self.south + last_y * self.step,
                self.west,
                self.west + last_x * self.step
            ));
        }
        let (x, y) = (x.clamp(0.0, last_x), y.clamp(0.0, last_y));
        let (column, row) = (x.floor(), y.floor());
        let mut height_m = 0.0;
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let weight = (1.0 - (x - column - dx).abs()) * (1.0 - (y - row - dy).abs());
            // A sample that does not count may be beyond the last one, or void.
            if weight > 0.0 {
                height_m += weight * self.sample((column + dx) as usize, (row + dy) as usize);
            }
        }
        if height_m.is_nan() {
            return Err(format!(
                "no height of the ground at {lat_deg:.6}, {lon_deg:.6} (void): expected another file for there"
            ));
        }
        Ok(height_m)
    }

    /// Of this column from the west and this row from the south.
    fn sample(&self, column: usize, row: usize) -> f64 {
        let from_north = self.rows - 1 - row;
        f64::from(self.heights_m[from_north * self.columns + column])
    }
}

/// An SRTM tile: a square of a degree, its samples big-endian integers of 16 bits.
fn tile(path: &Path, bytes: &[u8]) -> Result<Grid, String> {
    let name = path
        .file_stem()
        .and_then(|stem| stem.to_str())
        .unwrap_or("");
    let (south, west) = corner(name)
        .ok_or_else(|| format!("{name:?}, expected the name of a tile, such as N47E008"))?;
    let side = match bytes.len() {
        ONE_ARC_SECOND => 3_601,
        THREE_ARC_SECONDS => 1_201,
        other => {
            return Err(format!(
                "{other} bytes, expected {ONE_ARC_SECOND} (1 arc second) or {THREE_ARC_SECONDS} (3)"
            ));
        }
    };
    let height = |sample: &[u8]| match i16::from_be_bytes([sample[0], sample[1]]) {
        VOID => f32::NAN,
        height => f32::from(height),
    };
    Ok(Grid {
        west,
        south,
        step: 1.0 / f64::from(side - 1),
        columns: side as usize,
        rows: side as usize,
        heights_m: bytes.chunks_exact(2).map(height).collect(),
    })
}

/// The south-western corner in a tile's name.
fn corner(name: &str) -> Option<(f64, f64)> {
    let name = name.to_ascii_uppercase();
    let side = |text: &str, positive: char, negative: char, most: f64| {
        let number = text.get(1..)?.parse::<u16>().ok().map(f64::from)?;
        let number = match text.chars().next()? {
            c if c == positive => number,
            c if c == negative => -number,
            _ => return None,
        };
        (number.abs() <= most).then_some(number)
    };
    let (south, west) = (name.get(..3)?, name.get(3..7)?);
    Some((side(south, 'N', 'S', 90.0)?, side(west, 'E', 'W', 180.0)?))
}

fn tile_name(lat_deg: f64, lon_deg: f64) -> String {
    let (south, west) = (lat_deg.floor(), lon_deg.floor());
    format!(
        "{}{:02}{}{:03}.hgt",
        if south < 0.0 { 'S' } else { 'N' },
        south.abs(),
        if west < 0.0 { 'W' } else { 'E' },
        west.abs()
    )
}

/// An ESRI ASCII grid in degrees.
fn ascii_grid(bytes: &[u8]) -> Result<Grid, String> {
    let text = std::str::from_utf8(bytes).map_err(|e| e.to_string())?;
    let mut words = text.split_whitespace().peekable();
    let mut header: HashMap<String, f64> = HashMap::new();
    while let Some(word) = words.next_if(|word| word.starts_with(|c: char| c.is_alphabetic())) {
        let key = word.to_ascii_lowercase();
        let value = words.next().unwrap_or("");
        let value = value
            .parse()
            .map_err(|_| format!("{word}: {value:?}, expected a number"))?;
        header.insert(key, value);
    }
    let need = |key: &str| {
        let value = header.get(key).copied();
        value.ok_or_else(|| format!("{key}: missing, expected a number"))
    };
    let count = |key: &str| {
        let value = need(key)?;
        if value.fract() == 0.0 && (2.0..=20_000.0).contains(&value) {
            Ok(value as usize)
        } else {
            Err(format!("{key}: {value}, expected 2 to 20000"))
        }
    };
    let (columns, rows, step) = (count("ncols")?, count("nrows")?, need("cellsize")?);
    if !(step > 0.0 && step <= 1.0) {
        return Err(format!(
            "cellsize: {step}, expected degrees, above 0 and at most 1"
        ));
    }
    // A height is that of the middle of its cell.
    let first = |centre: &str, corner: &str| match header.get(centre) {
        Some(value) => Ok(*value),
        None => need(corner).map(|value| value + 0.5 * step),
    };
    let (west, south) = (
        first("xllcenter", "xllcorner")?,
        first("yllcenter", "yllcorner")?,
    );
    let void = header.get("nodata_value").copied();
    let heights_m: Vec<f32> = words
        .map(|word| match word.parse::<f64>() {
            Ok(height) if Some(height) == void => Ok(f32::NAN),
            Ok(height) => Ok(height as f32),
            Err(_) => Err(format!("{word:?}, expected a height")),
        })
        .collect::<Result<_, _>>()?;
    if heights_m.len() != columns * rows {
        return Err(format!(
            "{} heights, expected {columns} times {rows}",
            heights_m.len()
        ));
    }
    Ok(Grid {
        west,
        south,
        step,
        columns,
        rows,
        heights_m,
    })
}

/// A place between two, which are near each other.
fn between(from: Position, to: Position, t: f64) -> Position {
    let mix = |a: f64, b: f64| a + t * (b - a);
    // Over the date line the shorter way.
    let east = (to.lon_deg - from.lon_deg + 540.0).rem_euclid(360.0) - 180.0;
    let lon_deg = (from.lon_deg + t * east + 540.0).rem_euclid(360.0) - 180.0;
    Position::new(
        mix(from.lat_deg, to.lat_deg),
        lon_deg,
        mix(from.alt_m, to.alt_m),
    )
}

/// Bytes of a tile of 3601 and of one of 1201 samples a side.
const ONE_ARC_SECOND: usize = 3_601 * 3_601 * 2;
const THREE_ARC_SECONDS: usize = 1_201 * 1_201 * 2;
/// A sample that SRTM has no height for.
const VOID: i16 = -32_768;
/// Between the places of a leg that are compared with the ground, m: a third of 1 arc second.
const SPACING_M: f64 = 10.0;
/// Part of a step that is rounding.
const EDGE: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(text: &str) -> Grid {
        ascii_grid(text.as_bytes()).expect("a grid")
    }

    #[test]
    fn the_ground_is_interpolated_between_samples_and_void_where_one_of_them_is() {
        let grid = grid(
            "ncols 3\nnrows 2\nxllcenter 8\nyllcenter 47\ncellsize 0.1\nNODATA_value -9999\n100 200 -9999\n0 50 60\n",
        );
        for (lat, lon, height_m) in [
            (47.1, 8.0, 100.0),
            (47.0, 8.1, 50.0),
            (47.05, 8.05, 87.5),
            (47.1, 8.1, 200.0),
        ] {
            let found = grid.height_m(lat, lon).expect("it is known");
            assert!((found - height_m).abs() < 1e-6, "{lat} {lon}: {found}");
        }
        let void = grid.height_m(47.05, 8.15).expect_err("it is void");
        assert!(void.contains("47.050000, 8.150000 (void)"), "{void}");
        let outside = grid.height_m(47.2, 8.1).expect_err("it is outside");
        assert!(outside.contains("covers 47.0000 to 47.1000"), "{outside}");
    }

    #[test]
    fn corners_and_middles_of_cells_are_distinguished() {
        let corner = grid("ncols 2\nnrows 2\nxllcorner 8\nyllcorner 47\ncellsize 0.2\n1 2\n3 4\n");
        let found = corner.height_m(47.1, 8.1).expect("it is known");
        assert!((found - 3.0).abs() < 1e-4, "{found}");
        for (text, expected) in [
            (
                "ncols 2\nnrows 2\ncellsize 0.2\n1 2 3 4",
                "xllcorner: missing",
            ),
            (
                "ncols 2\nnrows 2\nxllcorner 8\nyllcorner 47\ncellsize 30\n1 2 3 4",
                "expected degrees",
            ),
            (
                "ncols 2\nnrows 2\nxllcorner 8\nyllcorner 47\ncellsize 0.2\n1 2 3",
                "3 heights, expected 2 times 2",
            ),
        ] {
            let fault = ascii_grid(text.as_bytes()).expect_err("it is refused");
            assert!(fault.contains(expected), "{fault}");
        }
    }

    #[test]
    fn tiles_are_named_by_their_south_western_corner() {
        for (lat, lon, name) in [
            (47.4, 8.5, "N47E008.hgt"),
            (-0.5, -0.5, "S01W001.hgt"),
            (-33.9, 151.2, "S34E151.hgt"),
        ] {
            assert_eq!(tile_name(lat, lon), name);
            let stem = name.trim_end_matches(".hgt");
            assert_eq!(corner(stem), Some((lat.floor(), lon.floor())));
        }
        for wrong in ["", "N47", "X47E008", "N47E999", "readme"] {
            assert_eq!(corner(wrong), None, "{wrong}");
        }
    }
}
