//! CSV with a header: a point a row, columns found by their names. `alt_m` is above mean sea level, `height_m` above home;
//! `elevation_m` is the ground's, and no altitude to fly at. Columns of this program's keys carry what is done there.
//!
//! Columns are separated as the header is: by commas, semicolons or tabs. Where not by commas, numbers may have a comma
//! for their point, as spreadsheets of half the world write them: all of a file, or none. The other mark would divide
//! thousands, and 1.520 m be read as 1.52 m.

use std::borrow::Cow;
use std::path::Path;

use super::draft::{Datum, Draft, NoAltitude, Point};
use super::fault::FormatError;
use super::losses::Losses;
use super::{attributes, lost};

/// Reads the rows of one lap, or of all.
pub(super) fn read(file: &Path, text: &str, lap: Option<i64>) -> Result<Draft, FormatError> {
    let head = text.lines().next().unwrap_or_default();
    let delimiter = [b';', b'\t']
        .into_iter()
        .find(|&d| head.contains(d as char));
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .delimiter(delimiter.unwrap_or(b','))
        .from_reader(text.as_bytes());
    let header = reader
        .headers()
        .map_err(|e| FormatError::at(file, Some(1), "", e))?
        .clone();
    let find = |names: &[&str]| {
        header
            .iter()
            .position(|h| names.contains(&h.to_ascii_lowercase().as_str()))
    };
    let need = |names: &[&str]| {
        find(names).ok_or_else(|| {
            let problem = format!("no such column, expected one of {}", names.join(", "));
            FormatError::at(file, Some(1), names[0], problem)
        })
    };
    let in_feet = |h: &&&str| {
        let h = h.to_ascii_lowercase();
        ["alt", "height", "ele"]
            .iter()
            .any(|begin| h.starts_with(begin))
            && ["ft", "feet", "_f"]
                .iter()
                .any(|end| h.trim_end_matches([')', ']']).ends_with(end))
    };
    if let Some(column) = header.iter().collect::<Vec<_>>().iter().find(in_feet) {
        let problem =
            "in feet, expected metres: a column alt_m (above sea level) or height_m (above home)";
        return Err(FormatError::at(file, Some(1), *column, problem));
    }
    let (lat, lon) = (need(LATITUDE)?, need(LONGITUDE)?);
    let height = find(HEIGHT);
    let alt = height.or_else(|| find(ALTITUDE));
    let ground = find(GROUND);
    let lap_column = match lap {
        Some(wanted) => Some((need(&["lap"])?, wanted)),
        None => None,
    };
    let mut draft = Draft {
        datum: Datum::above_home(height.is_some()),
        ..Draft::default()
    };
    let keys: Vec<String> = header.iter().map(str::to_ascii_lowercase).collect();
    let known = [
        Some(lat),
        Some(lon),
        alt,
        ground,
        lap_column.map(|(c, _)| c),
    ];
    for (column, name) in header.iter().enumerate() {
        let own = attributes::KEYS.contains(&keys[column].as_str());
        if !own && !known.contains(&Some(column)) && !LABELS.contains(&keys[column].as_str()) {
            draft.losses.add_whole(format!("column {name}"));
        }
    }
    let mut decimals = Decimals {
        mark: delimiter.is_none().then_some('.'),
    };
    for row in reader.records() {
        let row =
            row.map_err(|e| FormatError::at(file, e.position().map(csv::Position::line), "", &e))?;
        let line = row.position().map(csv::Position::line);
        let at =
            |column: usize, problem: String| FormatError::at(file, line, &header[column], problem);
        let mut number = |column: usize| {
            let text = row.get(column).unwrap_or("");
            let text = decimals.with_points(text);
            text.and_then(|text| attributes::number(&text))
                .map_err(|problem| at(column, problem))
        };
        if let Some((column, wanted)) = lap_column {
            let text = row.get(column).unwrap_or("");
            let here: i64 = text
                .parse()
                .map_err(|_| at(column, format!("{text:?}, expected a whole number")))?;
            if here != wanted {
                continue;
            }
        }
        let alt_m = match alt.filter(|&c| !row.get(c).unwrap_or("").is_empty()) {
            Some(column) => Ok(number(column)?),
            None if ground.is_some() => Err(NoAltitude::Ground),
            None => Err(NoAltitude::Missing),
        };
        let mut point = Point::found(number(lat)?, number(lon)?, alt_m, line);
        for (column, text) in row.iter().enumerate() {
            let key = keys.get(column).map_or("", String::as_str);
            if !attributes::KEYS.contains(&key) {
                continue;
            }
            let text = decimals.with_points(text);
            text.and_then(|text| attributes::set(&mut point.conduct, key, &text))
                .map_err(|problem| at(column, problem))?;
        }
        draft.points.push(point);
    }
    if draft.points.is_empty() {
        let which = lap.map_or_else(String::new, |l| format!(" of lap {l}"));
        return Err(FormatError::file(
            file,
            format!("no fixes{which}, expected some"),
        ));
    }
    Ok(draft)
}

/// The decimal mark of a file's numbers.
struct Decimals {
    /// That of the first number that has one; a point from the beginning where commas separate columns.
    mark: Option<char>,
}

impl Decimals {
    /// The text of a cell with points for decimal marks.
    fn with_points<'a>(&mut self, cell: &'a str) -> Result<Cow<'a, str>, String> {
        let marks = |text: &str| text.matches(MARKS).count();
        if cell.split_whitespace().any(|word| marks(word) > 1) {
            return Err(format!("{cell:?}, expected a number"));
        }
        let Some(found) = cell.chars().find(|c| MARKS.contains(c)) else {
            return Ok(cell.into());
        };
        let mark = *self.mark.get_or_insert(found);
        if cell.chars().any(|c| MARKS.contains(&c) && c != mark) {
            let name = if mark == ',' { "comma" } else { "point" };
            return Err(format!(
                "{cell:?}, expected a number with a decimal {name} as the others of the file, and thousands undivided"
            ));
        }
        Ok(match mark {
            ',' => cell.replace(',', ".").into(),
            _ => cell.into(),
        })
    }
}

const MARKS: [char; 2] = ['.', ','];
const LATITUDE: &[&str] = &["lat_deg", "lat", "latitude"];
const LONGITUDE: &[&str] = &["lon_deg", "lon", "lng", "longitude"];
const HEIGHT: &[&str] = &["height_m"];
const ALTITUDE: &[&str] = &["alt_m", "alt", "altitude", "ele"];
/// The ground's own altitude, which is none to fly at.
const GROUND: &[&str] = &["elevation_m", "elevation"];
/// Columns that are only for people.
const LABELS: &[&str] = &["name", "number", "point", "waypoint", "comment", "lap"];

/// Writes the points, and a column for each thing that is done at any of them.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    let above = if draft.datum == Datum::Home {
        HEIGHT
    } else {
        ALTITUDE
    };
    let points = draft.written();
    let done: Vec<_> = points.iter().map(|p| attributes::of(&p.conduct)).collect();
    let is_used = |key: &&str| done.iter().flatten().any(|(used, _)| used == key);
    let keys: Vec<&str> = attributes::KEYS.into_iter().filter(is_used).collect();
    let mut out = format!("lat_deg,lon_deg,{}", above[0]);
    for key in &keys {
        out += &format!(",{key}");
    }
    out.push('\n');
    for (point, done) in points.iter().zip(&done) {
        let p = point.position;
        out += &format!("{:.8},{:.8},{:.3}", p.lat_deg, p.lon_deg, p.alt_m);
        for key in &keys {
            let text = done.iter().find(|(own, _)| own == key);
            // No word or number of these needs quotes.
            out += &format!(",{}", text.map_or("", |(_, text)| text));
        }
        out.push('\n');
    }
    lost::extras(draft, losses);
    lost::fence(draft, losses);
    lost::rally(draft, losses);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Result<Draft, String> {
        read(Path::new("a.csv"), text, None).map_err(|fault| fault.to_string())
    }

    #[test]
    fn a_file_has_one_decimal_mark_and_no_divided_thousands() {
        for (text, expected) in [
            (
                "lat,lon,height_m\n47.1,8.1,\"1,500\"\n",
                "a.csv:2: height_m: \"1,500\", expected a number with a decimal point",
            ),
            (
                "lat,lon,height_m,speed_m_s\n47,8,20,\"6,5\"\n",
                "a.csv:2: speed_m_s: \"6,5\", expected a number with a decimal point",
            ),
            (
                "lat;lon;height_m\n47,1;8,1;20\n47,2;8,1;1.520\n",
                "a.csv:3: height_m: \"1.520\", expected a number with a decimal comma",
            ),
            (
                "lat\tlon\theight_m\n47.1\t8.1\t20\n47.2\t8.1\t1,520\n",
                "a.csv:3: height_m: \"1,520\", expected a number with a decimal point",
            ),
            // The first number that has a mark decides, in whichever column.
            (
                "lat;lon;height_m\n47,1;8,1;1.520\n",
                "a.csv:2: lat: \"47,1\", expected a number with a decimal point",
            ),
            (
                "lat;lon;height_m\n47,1;8,1;1.520,5\n",
                "a.csv:2: height_m: \"1.520,5\", expected a number",
            ),
        ] {
            let fault = rows(text).expect_err(text);
            assert!(fault.starts_with(expected), "{fault}");
        }
    }

    #[test]
    fn cells_that_are_no_numbers_decide_nothing() {
        let text = "name;lat;lon;height_m;loiter_exit;turn\nNo. 1;47,1;8,1;20,5;0,5 1;fly-over\n";
        let draft = rows(text).expect("decimal commas");
        let point = &draft.points[0];
        assert_eq!(point.position.alt_m, 20.5);
        let exit = point.conduct.exit.expect("how the loiter is left");
        assert_eq!((exit.heading, exit.tangent), (0.5, 1.0));
        let text = "name,lat,lon,height_m\n\"Fields, north\",47.1,8.1,20\n";
        assert_eq!(rows(text).expect("points").points[0].position.lat_deg, 47.1);
    }
}
