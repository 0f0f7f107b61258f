//! GeoTIFF elevation tiles in degrees: those of Copernicus (GLO-30, GLO-90), and SRTM as GeoTIFF.
//!
//! The samples are read by the `tiff` library: packed by deflate or LZW, or not packed. Their places are given by
//! three tags of the GeoTIFF standard: the scale of a pixel, one tie point, and whether that is the corner of a pixel
//! or its middle. A file in a projection other than degrees, or rotated, is refused: a height at the wrong place is
//! worse than none. So are heights in units other than metres, or above an ellipsoid; where the keys name neither,
//! heights are metres above mean sea level.

use std::io::Cursor;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// The heights of a file, the northernmost row first.
pub(crate) struct Raster {
    /// Longitude and latitude of the westernmost and southernmost samples, degrees.
    pub(crate) west: f64,
    pub(crate) south: f64,
    /// Between samples, degrees of longitude and of latitude.
    pub(crate) steps: (f64, f64),
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Metres; NaN where there is none.
    pub(crate) heights_m: Vec<f32>,
}

/// The heights of a file.
///
/// # Errors
/// It is not such a file, is incomplete, too large, or not in degrees.
pub(crate) fn read(bytes: Vec<u8>) -> Result<Raster, String> {
    let broken = |cause: tiff::TiffError| format!("{cause}, expected a GeoTIFF of heights");
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_SAMPLES * 8;
    let decoder = Decoder::new(Cursor::new(bytes)).map_err(broken)?;
    let mut decoder = decoder.with_limits(limits);
    let (columns, rows) = decoder.dimensions().map_err(broken)?;
    let (columns, rows) = (columns as usize, rows as usize);
    if columns < 2 || rows < 2 || columns.saturating_mul(rows) > MAX_SAMPLES {
        return Err(format!(
            "{columns} x {rows} samples, expected 2 x 2 up to {MAX_SAMPLES} in all"
        ));
    }
    let scale = numbers(&mut decoder, Tag::ModelPixelScaleTag)?;
    let tie = numbers(&mut decoder, Tag::ModelTiepointTag)?;
    let (&[step_x, step_y, ..], &[column, row, _, east, north, ..]) =
        (scale.as_slice(), tie.as_slice())
    else {
        return Err(
            "no place: expected the tags ModelPixelScale and ModelTiepoint of a GeoTIFF".to_owned(),
        );
    };
    let in_degrees = |step: f64| step > 0.0 && step <= 1.0;
    if !in_degrees(step_x) || !in_degrees(step_y) || north.abs() > 91.0 || east.abs() > 361.0 {
        return Err(format!(
            "pixels of {step_x} x {step_y} at {north}, {east}: expected degrees (EPSG:4326)"
        ));
    }
    // The tie point of a pixel that is an area is its north-western corner.
    let half = if is_point(&mut decoder)? { 0.0 } else { 0.5 };
    let north = north + (row - half) * step_y;
    let samples = samples(&mut decoder)?;
    if samples.len() != columns * rows {
        return Err(format!(
            "{} samples, expected {columns} times {rows}: one height a pixel",
            samples.len()
        ));
    }
    Ok(Raster {
        west: east + (half - column) * step_x,
        south: north - (rows - 1) as f64 * step_y,
        steps: (step_x, step_y),
        columns,
        rows,
        heights_m: samples,
    })
}

/// The heights, m; NaN where there is none.
fn samples(decoder: &mut Decoder<Cursor<Vec<u8>>>) -> Result<Vec<f32>, String> {
    let void = decoder.get_tag_ascii_string(Tag::GdalNodata).ok();
    let void = void.and_then(|text| text.trim_matches(['\0', ' ']).parse::<f64>().ok());
    let height = |height: f64| {
        let known = height.is_finite() && Some(height) != void && height != f64::from(VOID);
        if known { height as f32 } else { f32::NAN }
    };
    let read = decoder.read_image();
    match read.map_err(|cause| format!("{cause}, expected heights"))? {
        DecodingResult::F32(heights) => Ok(heights.into_iter().map(|h| height(h.into())).collect()),
        DecodingResult::F64(heights) => Ok(heights.into_iter().map(height).collect()),
        DecodingResult::I16(heights) => Ok(heights.into_iter().map(|h| height(h.into())).collect()),
        DecodingResult::U16(heights) => Ok(heights.into_iter().map(|h| height(h.into())).collect()),
        DecodingResult::I32(heights) => Ok(heights.into_iter().map(|h| height(h.into())).collect()),
        _ => {
            Err("samples of another kind, expected integers of 16 or 32 bits, or floats".to_owned())
        }
    }
}

/// The values of a tag; none where it is absent.
fn numbers(decoder: &mut Decoder<Cursor<Vec<u8>>>, tag: Tag) -> Result<Vec<f64>, String> {
    match decoder.find_tag(tag) {
        Ok(Some(value)) => value
            .into_f64_vec()
            .map_err(|cause| format!("{tag:?}: {cause}")),
        Ok(None) => Ok(Vec::new()),
        Err(cause) => Err(format!("{tag:?}: {cause}")),
    }
}

/// Whether a sample is the height of a point, and not of its pixel.
///
/// # Errors
/// The keys name a unit other than degrees, or heights that are not metres above mean sea level.
fn is_point(decoder: &mut Decoder<Cursor<Vec<u8>>>) -> Result<bool, String> {
    let keys = match decoder.find_tag(Tag::GeoKeyDirectoryTag) {
        Ok(Some(value)) => value.into_u16_vec().map_err(|cause| cause.to_string())?,
        _ => Vec::new(),
    };
    // Four numbers each: the key, where its value is (0: here), the count, the value.
    let key = |wanted: u16| {
        let mut entries = keys.chunks_exact(4).skip(1);
        let found = entries.find(|entry| entry[0] == wanted && entry[1] == 0);
        found.map(|entry| entry[3])
    };
    if let Some(other) = key(VERTICAL_UNITS).filter(|unit| *unit != METRE) {
        return Err(format!(
            "VerticalUnits {other}, expected {METRE}: heights in metres"
        ));
    }
    if let Some(other) = key(VERTICAL_TYPE).filter(|kind| !SEA_LEVEL.contains(kind)) {
        return Err(format!(
            "VerticalCSType {other}, expected heights above mean sea level, as 3855 (EGM2008) or 5773 (EGM96): heights above an \
             ellipsoid are up to 110 m off"
        ));
    }
    match key(MODEL_TYPE) {
        None | Some(GEOGRAPHIC) => Ok(key(RASTER_TYPE) == Some(POINT)),
        Some(other) => Err(format!(
            "GTModelType {other}, expected {GEOGRAPHIC}: degrees (EPSG:4326), no projection"
        )),
    }
}

/// A sample that SRTM has no height for.
const VOID: i16 = -32_768;
/// GTModelTypeGeoKey, and its value for latitude and longitude.
const MODEL_TYPE: u16 = 1024;
const GEOGRAPHIC: u16 = 2;
/// GTRasterTypeGeoKey, and its value for samples that are points.
const RASTER_TYPE: u16 = 1025;
const POINT: u16 = 2;
/// VerticalUnitsGeoKey, and its value for metres.
const VERTICAL_UNITS: u16 = 4099;
const METRE: u16 = 9001;
/// VerticalCSTypeGeoKey, and its values for heights in metres above mean sea level: EGM2008, EGM96, EGM84, mean sea
/// level, then those of national elevation models (NAVD88, AHD, NGF-IGN69, LN02, LHN95, EVRF2000, EVRF2007, DHHN92,
/// DHHN2016, ODN). They differ by less than 2 m.
const VERTICAL_TYPE: u16 = 4096;
const SEA_LEVEL: [u16; 14] = [
    3855, 5773, 5798, 5714, 5703, 5711, 5720, 5728, 5729, 5730, 5621, 5783, 7837, 5701,
];
/// Samples of a file at most; a tile of 1 arc second has 13 million.
const MAX_SAMPLES: usize = 64_000_000;

#[cfg(test)]
mod tests {
    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype};

    use super::*;

    /// What a test changes in a tile.
    struct Made {
        point: bool,
        model: u16,
        /// Further keys, about heights.
        vertical: &'static [(u16, u16)],
        scale: [f64; 3],
        packed: Compression,
    }

    const TILE: Made = Made {
        point: true,
        model: GEOGRAPHIC,
        vertical: &[],
        scale: [0.1, 0.05, 0.0],
        packed: Compression::Deflate(DeflateLevel::Balanced),
    };

    /// Three columns and two rows; the north-western sample at 47.05, 8.0 where samples are points.
    fn made(made: &Made) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        let encoder = TiffEncoder::new(&mut file).expect("a file");
        let mut encoder = encoder.with_compression(made.packed);
        let mut image = encoder
            .new_image::<colortype::Gray32Float>(3, 2)
            .expect("an image");
        let tags = image.encoder();
        let raster = if made.point { POINT } else { 1 };
        let mut all = vec![(MODEL_TYPE, made.model), (RASTER_TYPE, raster)];
        all.extend(made.vertical);
        let mut keys = vec![1, 1, 0, all.len() as u16];
        keys.extend(all.iter().flat_map(|(key, value)| [*key, 0, 1, *value]));
        let tie = [0.0, 0.0, 0.0, 8.0, 47.05, 0.0];
        tags.write_tag(Tag::ModelPixelScaleTag, &made.scale[..])
            .expect("a tag");
        tags.write_tag(Tag::ModelTiepointTag, &tie[..])
            .expect("a tag");
        tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..])
            .expect("a tag");
        tags.write_tag(Tag::GdalNodata, "-9999").expect("a tag");
        image
            .write_data(&[100.0, 200.0, -9999.0, 0.0, 50.0, 60.0])
            .expect("data");
        file.into_inner()
    }

    fn height_m(tile: &Made, lat: f64, lon: f64) -> Option<f64> {
        let grid = crate::terrain::Grid::read("tile.tif", made(tile)).expect("a tile");
        grid.height_m(lat, lon).ok().map(f64::round)
    }

    #[test]
    fn a_tile_is_where_its_tags_say_whatever_it_is_packed_by() {
        for packed in [
            Compression::Uncompressed,
            Compression::Lzw,
            Compression::Deflate(DeflateLevel::Fast),
        ] {
            let tile = Made { packed, ..TILE };
            assert_eq!(height_m(&tile, 47.05, 8.0), Some(100.0));
            assert_eq!(height_m(&tile, 47.0, 8.1), Some(50.0));
            assert_eq!(height_m(&tile, 47.0, 8.05), Some(25.0));
            // Void, and outside.
            assert_eq!(height_m(&tile, 47.05, 8.2), None);
            assert_eq!(height_m(&tile, 47.2, 8.1), None);
        }
        // The corner of a pixel is half a pixel off its middle.
        let area = Made {
            point: false,
            ..TILE
        };
        assert_eq!(height_m(&area, 47.025, 8.05), Some(100.0));
    }

    #[test]
    fn between_neighbouring_tiles_there_is_no_gap() {
        // Half a step beyond the outermost samples is where the next tile takes over.
        assert_eq!(height_m(&TILE, 46.976, 8.1), Some(50.0));
        assert_eq!(height_m(&TILE, 47.0, 7.951), Some(0.0));
        assert_eq!(height_m(&TILE, 46.974, 8.1), None);
        assert_eq!(height_m(&TILE, 47.0, 7.949), None);
    }

    #[test]
    fn heights_in_feet_or_above_an_ellipsoid_are_refused() {
        let with = |vertical| made(&Made { vertical, ..TILE });
        for known in [3855, 5773, 5703] {
            let vertical: &[_] = vec![(VERTICAL_TYPE, known), (VERTICAL_UNITS, METRE)].leak();
            assert!(read(with(vertical)).is_ok(), "{known}");
        }
        let fault = |vertical| read(with(vertical)).map(|_| ()).expect_err("refused");
        assert!(fault(&[(VERTICAL_UNITS, 9002)]).contains("VerticalUnits 9002, expected 9001"));
        for other in [4979, 5030, 32_767] {
            let vertical: &[_] = vec![(VERTICAL_TYPE, other)].leak();
            assert!(fault(vertical).contains(&format!("VerticalCSType {other}")));
        }
    }

    #[test]
    fn what_is_not_in_degrees_or_no_tile_is_refused() {
        let fault = |bytes| read(bytes).map(|_| ()).expect_err("it is refused");
        let projected = Made { model: 1, ..TILE };
        assert!(fault(made(&projected)).contains("GTModelType 1, expected 2"));
        let metres = Made {
            scale: [30.0, 30.0, 0.0],
            ..TILE
        };
        assert!(fault(made(&metres)).contains("expected degrees"));
        assert!(fault(vec![]).contains("expected a GeoTIFF"));
        let whole = made(&TILE);
        assert!(read(whole[..whole.len() - 40].to_vec()).is_err());
    }
}
