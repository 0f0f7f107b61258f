//! The height of the ground, from the bytes of elevation files: SRTM tiles (`.hgt`, 1 or 3 arc seconds), GeoTIFF in degrees
//! (`.tif`, such as the tiles of Copernicus) and ESRI ASCII grids (`.asc`).
//!
//! Heights are metres above mean sea level (SRTM: EGM96, Copernicus: EGM2008, which differ by less than a metre or
//! two). Between samples the ground is interpolated bilinearly. A place that no file covers, or whose samples are
//! void, has no height: an absent height is never a number. Nothing here reads a disk: a planner reads a tile when it
//! is needed, and the bridge reads a whole folder before it flies anything ([`Terrain`]).
//!
//! ```
//! use curve_paths::terrain::Grid;
//!
//! let grid = Grid::read("hill.asc", b"ncols 2 nrows 2 xllcenter 8 yllcenter 47 cellsize 0.1 10 30 10 30".to_vec())?;
//! assert_eq!(grid.height_m(47.05, 8.05).map(f64::round), Ok(20.0));
//! assert!(grid.height_m(46.9, 8.05).is_err());
//! # Ok::<(), curve_paths::terrain::GridError>(())
//! ```

use std::collections::HashMap;
use std::fmt;
use std::path::Path;

use crate::geotiff::{self, Raster};
use crate::wgs84::Position;

/// Samples at equal steps of latitude and of longitude, the northernmost row first.
pub struct Grid {
    /// Longitude and latitude of the westernmost and southernmost samples, degrees.
    west: f64,
    south: f64,
    /// Steps between samples, degrees of longitude and of latitude: tiles of high latitudes have fewer columns than
    /// rows.
    steps: (f64, f64),
    columns: usize,
    rows: usize,
    samples: Samples,
    /// How far the grid counts beyond its outermost samples, in steps. Neighbouring SRTM tiles share a row, those of
    /// GeoTIFF are one step apart; what lies between two of them belongs to the nearer one.
    beyond: f64,
}

enum Samples {
    /// Metres, big-endian 16-bit integers as in the tile: a tile has 26 MB, and numbers would take twice that.
    Tile(Vec<u8>),
    /// Metres; NaN where there is no height.
    Cells(Vec<f32>),
}

/// Why a file is not an elevation grid.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct GridError(String);

/// A place whose height is not in a grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoHeight {
    /// The grid does not cover it.
    #[error(
        "{lat_deg:.6}, {lon_deg:.6} is outside it: it covers {:.4} to {:.4}, {:.4} to {:.4}",
        south_west.0, north_east.0, south_west.1, north_east.1
    )]
    Outside {
        /// Degrees north.
        lat_deg: f64,
        /// Degrees east.
        lon_deg: f64,
        /// The grid's south-western corner, degrees north and east.
        south_west: (f64, f64),
        /// Its north-eastern corner.
        north_east: (f64, f64),
    },
    /// A sample that is needed for the height is void.
    #[error(
        "no height of the ground at {lat_deg:.6}, {lon_deg:.6} (void): expected another file for there"
    )]
    Void {
        /// Degrees north.
        lat_deg: f64,
        /// Degrees east.
        lon_deg: f64,
    },
}

/// A place of a route, and how far it is above the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Metres, negative below ground.
    pub clearance_m: f64,
    /// Where, at its altitude above mean sea level.
    pub at: Position,
}

/// A straight line above the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Profile {
    /// Where it is nearest to the ground; none where the ground is known nowhere below it.
    pub lowest: Option<Clearance>,
    /// Places that were compared with the ground.
    pub looked_at: usize,
    /// How many of these have no height.
    pub unknown: usize,
}

/// Grids that are looked up together, such as the tiles of a folder.
#[derive(Default)]
pub struct Terrain {
    grids: Vec<Grid>,
}

impl fmt::Debug for Terrain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(&self.grids).finish()
    }
}

impl fmt::Debug for Grid {
    /// Shows where it is, and not its millions of samples.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            south,
            west,
            steps: (step, _),
            columns,
            rows,
            ..
        } = self;
        write!(f, "Grid({south}, {west}, {columns} x {rows} by {step})")
    }
}

impl Terrain {
    /// A terrain of these grids; where several cover a place, the first that has a height there counts.
    #[must_use]
    pub fn new(grids: Vec<Grid>) -> Self {
        Self { grids }
    }

    /// How many grids there are.
    #[must_use]
    pub fn grids(&self) -> usize {
        self.grids.len()
    }

    /// The height of the ground, m above mean sea level; none where no grid has one.
    #[must_use]
    pub fn height_m(&self, lat_deg: f64, lon_deg: f64) -> Option<f64> {
        let mut grids = self.grids.iter();
        grids.find_map(|grid| grid.height_m(lat_deg, lon_deg).ok())
    }

    /// Spacing at which a line is compared with the ground, m: a third of the finest step between samples.
    #[must_use]
    pub fn spacing_m(&self) -> f64 {
        let steps = self
            .grids
            .iter()
            .map(|grid| grid.steps.1 * METRES_A_DEGREE / 3.0);
        steps.fold(SPACING_M * 3.0, f64::min).max(MIN_SPACING_M)
    }
}

/// Compares the straight line between two places, at altitudes above mean sea level, with the ground: every
/// `spacing_m` and at both ends. `ground` returns the height at degrees north and east, `None` where it is not known.
/// A crest between two places is missed by at most half of the spacing times its slope.
///
/// # Errors
/// The error of `ground`.
pub fn profile<E>(
    from: Position,
    to: Position,
    spacing_m: f64,
    mut ground: impl FnMut(f64, f64) -> Result<Option<f64>, E>,
) -> Result<Profile, E> {
    let mut profile = Profile::default();
    let length_m = from.ground().distance_m(to.ground());
    let parts = (length_m / spacing_m).ceil().max(1.0) as u32;
    for part in 0..=parts {
        let at = between(from, to, f64::from(part) / f64::from(parts));
        profile.looked_at += 1;
        let Some(ground_m) = ground(at.lat_deg, at.lon_deg)? else {
            profile.unknown += 1;
            continue;
        };
        let clearance_m = at.alt_m - ground_m;
        if profile
            .lowest
            .is_none_or(|lowest| clearance_m < lowest.clearance_m)
        {
            profile.lowest = Some(Clearance { clearance_m, at });
        }
    }
    Ok(profile)
}

impl Grid {
    /// A grid from a file with this name: `.hgt`, named by its south-western corner, `.tif` or `.asc`.
    ///
    /// # Errors
    /// It is not such a file, or not a whole one.
    pub fn read(name: &str, bytes: Vec<u8>) -> Result<Self, GridError> {
        let path = Path::new(name);
        let text = |part: Option<&std::ffi::OsStr>| {
            part.and_then(std::ffi::OsStr::to_str)
                .unwrap_or("")
                .to_owned()
        };
        match text(path.extension()).to_ascii_lowercase().as_str() {
            "hgt" => tile(&text(path.file_stem()), bytes),
            "asc" => ascii_grid(&bytes),
            "tif" | "tiff" => geotiff::read(bytes).map(Grid::from),
            other => Err(format!(
                "unknown ending {other:?}, expected .hgt, .tif, .asc or a folder of .hgt"
            )),
        }
        .map_err(GridError)
    }

    /// The height of the ground, m above mean sea level.
    ///
    /// # Errors
    /// The height is not known there.
    pub fn height_m(&self, lat_deg: f64, lon_deg: f64) -> Result<f64, NoHeight> {
        let (step_x, step_y) = self.steps;
        let (x, y) = (
            (lon_deg - self.west) / step_x,
            (lat_deg - self.south) / step_y,
        );
        let (last_x, last_y) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        // A place on the edge is inside, however the division rounds.
        let edge = self.beyond + EDGE;
        if !(-edge..=last_x + edge).contains(&x) || !(-edge..=last_y + edge).contains(&y) {
            return Err(NoHeight::Outside {
                lat_deg,
                lon_deg,
                south_west: (self.south, self.west),
                north_east: (self.south + last_y * step_y, self.west + last_x * step_x),
            });
        }
        let (x, y) = (x.clamp(0.0, last_x), y.clamp(0.0, last_y));
        let (column, row) = (x.floor(), y.floor());
        let mut height_m = 0.0;
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let weight = (1.0 - (x - column - dx).abs()) * (1.0 - (y - row - dy).abs());
            // A sample with weight 0 may be beyond the last one, or void, and is not read.
            if weight > 0.0 {
                height_m += weight * self.sample((column + dx) as usize, (row + dy) as usize);
            }
        }
        if height_m.is_nan() {
            return Err(NoHeight::Void { lat_deg, lon_deg });
        }
        Ok(height_m)
    }

    /// The memory of its samples, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match &self.samples {
            Samples::Tile(bytes) => bytes.len(),
            Samples::Cells(heights_m) => heights_m.len() * size_of::<f32>(),
        }
    }

    /// The sample in this column from the west and this row from the south.
    fn sample(&self, column: usize, row: usize) -> f64 {
        let from_north = self.rows - 1 - row;
        let at = from_north * self.columns + column;
        match &self.samples {
            Samples::Tile(bytes) => match i16::from_be_bytes([bytes[2 * at], bytes[2 * at + 1]]) {
                VOID => f64::NAN,
                height => f64::from(height),
            },
            Samples::Cells(heights_m) => f64::from(heights_m[at]),
        }
    }
}

impl From<Raster> for Grid {
    fn from(raster: Raster) -> Grid {
        let Raster {
            west,
            south,
            steps,
            columns,
            rows,
            heights_m,
        } = raster;
        Grid {
            west,
            south,
            steps,
            columns,
            rows,
            samples: Samples::Cells(heights_m),
            beyond: 0.5,
        }
    }
}

/// An SRTM tile: a square of a degree, its samples big-endian integers of 16 bits.
fn tile(name: &str, bytes: Vec<u8>) -> Result<Grid, String> {
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
    Ok(Grid {
        west,
        south,
        steps: (1.0 / f64::from(side - 1), 1.0 / f64::from(side - 1)),
        columns: side as usize,
        rows: side as usize,
        samples: Samples::Tile(bytes),
        beyond: 0.0,
    })
}

/// The south-western corner that a tile's name gives.
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

/// The name of the SRTM tile that covers a place, such as N47E008.hgt.
#[must_use]
pub fn tile_name(lat_deg: f64, lon_deg: f64) -> String {
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
    // A height belongs to the middle of its cell.
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
        steps: (step, step),
        columns,
        rows,
        samples: Samples::Cells(heights_m),
        beyond: 0.0,
    })
}

/// The place at this fraction of the way from the first to the second; both are near each other.
#[must_use]
pub fn between(from: Position, to: Position, t: f64) -> Position {
    let mix = |a: f64, b: f64| a + t * (b - a);
    // Across the date line the shorter way.
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
/// Spacing of the places of a leg that are compared with the ground, m: a third of 1 arc second.
pub const SPACING_M: f64 = 10.0;
/// The smallest spacing, m: a smaller one would make too many places on a long line.
const MIN_SPACING_M: f64 = 5.0;
/// Metres for a degree of latitude.
const METRES_A_DEGREE: f64 = 111_000.0;
/// The part of a step that counts as rounding.
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
        let void = grid
            .height_m(47.05, 8.15)
            .expect_err("it is void")
            .to_string();
        assert!(void.contains("47.050000, 8.150000 (void)"), "{void}");
        let outside = grid
            .height_m(47.2, 8.1)
            .expect_err("it is outside")
            .to_string();
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

    #[test]
    fn a_line_is_looked_at_between_its_ends_too() {
        // Half of the spacing, 15 m, up a slope of 300 m in 760: so much of a crest can lie between two places.
        const CREST_M: f64 = 6.0;
        // A ridge of 300 m between two valleys.
        let grid =
            grid("ncols 3\nnrows 2\nxllcenter 8\nyllcenter 47\ncellsize 0.01\n0 300 0\n0 300 0\n");
        let terrain = Terrain::new(vec![grid]);
        let ground = |lat, lon| Ok::<_, ()>(terrain.height_m(lat, lon));
        let (from, to) = (
            Position::new(47.005, 8.0, 100.0),
            Position::new(47.005, 8.02, 100.0),
        );
        let found = profile(from, to, terrain.spacing_m(), ground).expect("no fault");
        let lowest = found.lowest.expect("it is known");
        assert!((lowest.clearance_m + 200.0).abs() < CREST_M, "{lowest:?}");
        assert!((lowest.at.lon_deg - 8.01).abs() < 3e-4, "{lowest:?}");
        assert_eq!(found.unknown, 0);
        // The part outside the grid is counted, and the known part still gives a lowest place.
        let beyond = Position::new(47.005, 8.04, 100.0);
        let found = profile(from, beyond, terrain.spacing_m(), ground).expect("no fault");
        let part = found.unknown as f64 / found.looked_at as f64;
        assert!((part - 0.5).abs() < 0.02, "{found:?}");
        assert!(
            found
                .lowest
                .is_some_and(|at| at.clearance_m < CREST_M - 200.0),
            "{found:?}"
        );
        // A line without length is a place.
        let found = profile(from, from, 10.0, ground).expect("no fault");
        assert!(
            found
                .lowest
                .is_some_and(|at| (at.clearance_m - 100.0).abs() < 0.1),
            "{found:?}"
        );
    }

    #[test]
    fn a_tile_is_read_as_it_is_and_void_where_it_says_so() {
        let mut bytes = vec![0; THREE_ARC_SECONDS];
        // The south-western sample: first of the last row.
        let at = 2 * 1_200 * 1_201;
        bytes[at..at + 2].copy_from_slice(&(-5_i16).to_be_bytes());
        bytes[at + 2..at + 4].copy_from_slice(&VOID.to_be_bytes());
        let tile = Grid::read("n47e008.HGT", bytes).expect("a tile");
        assert_eq!(tile.height_m(47.0, 8.0), Ok(-5.0));
        assert!(matches!(
            tile.height_m(47.0, 8.0005),
            Err(NoHeight::Void { .. })
        ));
        assert!(format!("{tile:?}").len() < 100);
        let fault = Grid::read("N47E008.hgt", vec![0; 7]).map(|_| ());
        assert!(fault.is_err_and(|fault| fault.to_string().starts_with("7 bytes, expected")));
        let fault = Grid::read("N47E008.bil", vec![]).map(|_| ());
        assert!(fault.is_err_and(|fault| fault.to_string().contains("\"bil\", expected .hgt")));
    }
}
