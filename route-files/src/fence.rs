//! Geofences: areas that the vehicle stays inside or outside, their file (TOML), and their messages 50016.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::IgnoredAny;
use stanag_msgs::enums::AreaType;
use stanag_msgs::messages::AreaVertex;
use stanag_msgs::{Bam32, Message};

/// Why a fence file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FenceFileError {
    /// It is not TOML of this form.
    #[error("{}:{line}: {message}", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// An area that is neither a polygon nor a circle.
    #[error("{}: area {area}: expected vertices, or centre and radius", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// Which one, from 1.
        area: usize,
    },
    /// A number that the field of the message cannot have.
    #[error("{}: area {area}: {field} {found}, expected {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Which one, from 1.
        area: usize,
        /// The field, such as `vertex 2: latitude`.
        field: String,
        /// The number found.
        found: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// More than the message's counter can hold.
    #[error("{}: {count} {what}, at most {most}", path.display())]
    Many {
        /// The file.
        path: PathBuf,
        /// How many.
        count: usize,
        /// Of what.
        what: &'static str,
        /// The most.
        most: usize,
    },
}

/// An area of a geofence.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// On which side of its border the vehicle stays.
    pub keep: Keep,
    /// Its border.
    pub shape: Shape,
}

/// On which side of a border the vehicle stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Keep {
    /// Inside.
    In,
    /// Outside.
    Out,
}

impl Keep {
    /// Inside, or outside.
    #[must_use]
    pub const fn inside(is: bool) -> Self {
        if is { Self::In } else { Self::Out }
    }

    /// The word of a fence file.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::In => "in",
            Self::Out => "out",
        }
    }
}

/// The border of an area. Places are degrees north and east.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Its vertices.
    Polygon(Vec<[f64; 2]>),
    /// A circle.
    Circle {
        /// Its centre.
        centre: [f64; 2],
        /// Its radius, m.
        radius_m: f64,
    },
}

/// A fence file; a route file may hold a fence too, and its other keys are not looked at here.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(
    dead_code,
    reason = "the other keys of a file that holds both are only allowed here"
)]
struct File {
    #[serde(default)]
    area: Vec<FileArea>,
    mission_id: Option<IgnoredAny>,
    id: Option<IgnoredAny>,
    r#type: Option<IgnoredAny>,
    initial: Option<IgnoredAny>,
    defaults: Option<IgnoredAny>,
    waypoint: Option<IgnoredAny>,
    curve: Option<IgnoredAny>,
    route: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileArea {
    keep: Keep,
    #[serde(default)]
    vertices: Vec<[f64; 2]>,
    centre: Option<[f64; 2]>,
    radius: Option<f64>,
}

/// Reads the areas of the text of a fence file; `path` is only for messages.
///
/// # Errors
/// It is not of this form.
pub fn parse(path: &Path, text: &str) -> Result<Vec<Area>, FenceFileError> {
    let file: File = toml::from_str(text).map_err(|fault| FenceFileError::Form {
        path: path.to_owned(),
        line: fault.span().map_or(1, |span| {
            1 + text[..span.start.min(text.len())].matches('\n').count()
        }),
        message: fault.message().to_owned(),
    })?;
    let areas = (1..).zip(file.area).map(|(number, area)| {
        let shape = match (area.vertices.len(), area.centre, area.radius) {
            (0, Some(centre), Some(radius_m)) => Shape::Circle { centre, radius_m },
            (1.., None, None) => Shape::Polygon(area.vertices),
            _ => {
                return Err(FenceFileError::Shape {
                    path: path.to_owned(),
                    area: number,
                });
            }
        };
        Ok(Area {
            keep: area.keep,
            shape,
        })
    });
    let areas = areas.collect::<Result<Vec<_>, _>>()?;
    check(path, &areas)?;
    Ok(areas)
}

/// Checks the numbers of areas read from `path`: in a message an angle beyond its range would name another place, and one that
/// is not a number 0 degrees.
///
/// # Errors
/// The first that a message cannot carry.
pub fn check(path: &Path, areas: &[Area]) -> Result<(), FenceFileError> {
    for (area, Area { shape, .. }) in (1..).zip(areas) {
        let within = |field: String, found: f64, most: f64, expected: &'static str| {
            if found.abs() <= most {
                return Ok(());
            }
            let path = path.to_owned();
            Err(FenceFileError::Value {
                path,
                area,
                field,
                found,
                expected,
            })
        };
        let place = |of: &str, [north, east]: &[f64; 2]| {
            within(format!("{of}: latitude"), *north, 90.0, "-90 to 90 degrees")?;
            let expected = "-180 to 180 degrees";
            within(format!("{of}: longitude"), *east, 180.0, expected)
        };
        match shape {
            Shape::Polygon(vertices) => {
                for (number, vertex) in (1..).zip(vertices) {
                    place(&format!("vertex {number}"), vertex)?;
                }
            }
            Shape::Circle { centre, radius_m } => {
                place("centre", centre)?;
                let expected = "a finite number of metres";
                within("radius".to_owned(), *radius_m, f32::MAX.into(), expected)?;
            }
        }
    }
    Ok(())
}

/// The messages 50016 of a fence read from `path`. Whether they make a fence is for the VSM to judge.
///
/// # Errors
/// More areas or vertices than the message can count, or a number that it cannot carry.
pub fn messages(path: &Path, areas: &[Area]) -> Result<Vec<Message>, FenceFileError> {
    let many = |count: usize, what, most: usize| {
        if count > most {
            let path = path.to_owned();
            return Err(FenceFileError::Many {
                path,
                count,
                what,
                most,
            });
        }
        Ok(())
    };
    many(areas.len(), "areas", u16::MAX.into())?;
    check(path, areas)?;
    let mut messages = Vec::new();
    for (id, area) in (1_u16..).zip(areas) {
        let (places, radius_m, kind) = match &area.shape {
            Shape::Circle { centre, radius_m } => (
                std::slice::from_ref(centre),
                Some(*radius_m),
                [AreaType::KeepInCircle, AreaType::KeepOutCircle],
            ),
            Shape::Polygon(vertices) => (
                vertices.as_slice(),
                None,
                [AreaType::KeepInPolygon, AreaType::KeepOutPolygon],
            ),
        };
        many(places.len(), "vertices of an area", u8::MAX.into())?;
        let count = places.len() as u8;
        messages.extend((1_u8..=count).zip(places).map(|(number, [north, east])| {
            Message::AreaVertex(AreaVertex {
                area_id: Some(id),
                area_type: Some(kind[usize::from(area.keep == Keep::Out)]),
                vertex_count: Some(count),
                vertex_number: Some(number),
                latitude: Some(Bam32::from_degrees(*north)),
                longitude: Some(Bam32::from_degrees(*east)),
                radius: radius_m.map(|metres| metres as f32),
                ..AreaVertex::default()
            })
        }));
    }
    Ok(messages)
}

/// The areas of these messages; vertices without a position are left out.
#[must_use]
pub fn areas<'a>(vertices: impl IntoIterator<Item = &'a AreaVertex>) -> Vec<Area> {
    let mut out: Vec<Area> = Vec::new();
    let mut open = None;
    for vertex in vertices {
        let (Some(north), Some(east)) = (vertex.latitude, vertex.longitude) else {
            continue;
        };
        let place = [north.degrees(), east.degrees()];
        let outside = matches!(
            vertex.area_type,
            Some(AreaType::KeepOutPolygon | AreaType::KeepOutCircle)
        );
        let shape = match vertex.radius {
            Some(radius) => Shape::Circle {
                centre: place,
                radius_m: radius.into(),
            },
            None => Shape::Polygon(vec![place]),
        };
        match (
            &mut out.last_mut().map(|area| &mut area.shape),
            vertex.radius,
        ) {
            (Some(Shape::Polygon(border)), None) if open == Some(vertex.area_id) => {
                border.push(place);
            }
            _ => out.push(Area {
                keep: Keep::inside(!outside),
                shape,
            }),
        }
        open = vertex.radius.is_none().then_some(vertex.area_id);
    }
    out
}

/// The text of a fence file of these areas.
#[must_use]
pub fn to_toml(areas: &[Area]) -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    let place = |[north, east]: &[f64; 2]| format!("[{north:.8}, {east:.8}]");
    for area in areas {
        let _ = write!(out, "[[area]]\nkeep = \"{}\"\n", area.keep.word());
        let _ = match &area.shape {
            Shape::Circle { centre, radius_m } => {
                writeln!(out, "centre = {}\nradius = {radius_m:?}", place(centre))
            }
            Shape::Polygon(vertices) => {
                let places: Vec<String> = vertices.iter().map(place).collect();
                writeln!(out, "vertices = [{}]", places.join(", "))
            }
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[[area]]\nkeep = \"in\"\nvertices = [[47.0, 8.0], [47.0, 8.1], [47.1, 8.1]]\n\
                        [[area]]\nkeep = \"out\"\ncentre = [47.05, 8.05]\nradius = 120.5\n";

    #[test]
    fn a_file_becomes_messages_and_they_a_file_that_reads_the_same() {
        let messages = messages(Path::new("f"), &parse(Path::new("f"), TEXT).unwrap()).unwrap();
        assert_eq!(messages.len(), 4);
        let vertices: Vec<AreaVertex> = messages
            .iter()
            .filter_map(|message| match message {
                Message::AreaVertex(vertex) => Some(vertex.clone()),
                _ => None,
            })
            .collect();
        assert_eq!(vertices[3].area_type, Some(AreaType::KeepOutCircle));
        let text = to_toml(&areas(&vertices));
        let again = parse(Path::new("f"), &text).unwrap();
        assert_eq!(
            super::messages(Path::new("f"), &again).unwrap(),
            messages,
            "{text}"
        );
    }

    #[test]
    fn a_route_file_may_hold_areas_beside_all_its_other_keys() {
        let route = "mission_id = \"m\"\nid = \"r\"\ntype = \"flight\"\ninitial = 1\n[defaults]\naltitude = 30.0\n\
                     [[waypoint]]\nnumber = 1\nlatitude = 47.0\nlongitude = 8.0\n\
                     [[waypoint]]\nnumber = 2\nlatitude = 47.0\nlongitude = 8.1\n\
                     [[curve]]\nfrom = 1\nto = 2\np2 = [47.0, 8.0]\np3 = [47.0, 8.1]\n\
                     [[route]]\ninitial = 2\n";
        let both = format!("{route}{TEXT}");
        crate::Route::parse(Path::new("f"), &both).unwrap();
        assert_eq!(parse(Path::new("f"), &both).unwrap().len(), 2);
        assert!(parse(Path::new("f"), "[[aera]]\nkeep = \"in\"\n").is_err());
    }

    #[test]
    fn an_error_names_its_place() {
        let error = |text| parse(Path::new("f.toml"), text).unwrap_err().to_string();
        assert!(error("[[area]]\nkeep = \"up\"\n").starts_with("f.toml:2: "));
        assert_eq!(
            error("[[area]]\nkeep = \"in\"\nradius = 5.0\n"),
            "f.toml: area 1: expected vertices, or centre and radius"
        );
    }

    #[test]
    fn a_number_that_a_message_cannot_carry_is_refused_with_its_area_and_vertex() {
        let path = Path::new("f.toml");
        for (find, replace, expected) in [
            (
                "[47.0, 8.1]",
                "[407.0, 8.1]",
                "area 1: vertex 2: latitude 407, expected -90 to 90 degrees",
            ),
            (
                "[47.0, 8.0]",
                "[nan, 8.0]",
                "area 1: vertex 1: latitude NaN, expected -90 to 90 degrees",
            ),
            (
                "[47.1, 8.1]",
                "[47.1, -188.1]",
                "area 1: vertex 3: longitude -188.1, expected -180 to 180 degrees",
            ),
            (
                "[47.05, 8.05]",
                "[47.05, inf]",
                "area 2: centre: longitude inf, expected -180 to 180 degrees",
            ),
            (
                "120.5",
                "1e39",
                "area 2: radius 1000000000000000000000000000000000000000, expected a finite number of metres",
            ),
        ] {
            let text = TEXT.replacen(find, replace, 1);
            assert_ne!(text, TEXT);
            let fault = parse(path, &text).unwrap_err().to_string();
            assert_eq!(fault, format!("f.toml: {expected}"));
        }
        // The areas of other formats come by another way.
        let nowhere = Area {
            keep: Keep::Out,
            shape: Shape::Polygon(vec![[47.0, 8.0], [47.0, f64::NAN]]),
        };
        let fault = messages(path, &[nowhere]).unwrap_err().to_string();
        assert!(
            fault.starts_with("f.toml: area 1: vertex 2: longitude NaN"),
            "{fault}"
        );
        let edges =
            "[[area]]\nkeep = \"in\"\nvertices = [[90.0, -180.0], [-90.0, 180.0], [0.0, 0.0]]\n";
        assert!(parse(path, edges).is_ok());
    }
}
