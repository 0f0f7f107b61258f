//! Fence files (TOML): areas that the vehicle stays inside or outside, as messages 50016.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use stanag_msgs::enums::AreaType;
use stanag_msgs::messages::AreaVertex;
use stanag_msgs::{Bam32, Message};

/// Why a fence file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FenceFileError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    area: Vec<FileArea>,
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

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Keep {
    In,
    Out,
}

/// Reads a fence file into its messages. Whether they make a fence is for the VSM to judge.
///
/// # Errors
/// It cannot be read, or is not of this form.
pub fn load(path: &Path) -> Result<Vec<Message>, FenceFileError> {
    let text = std::fs::read_to_string(path).map_err(|source| FenceFileError::Read {
        path: path.to_owned(),
        source,
    })?;
    parse(path, &text)
}

fn parse(path: &Path, text: &str) -> Result<Vec<Message>, FenceFileError> {
    let file: File = toml::from_str(text).map_err(|fault| FenceFileError::Form {
        path: path.to_owned(),
        line: fault.span().map_or(1, |span| {
            1 + text[..span.start.min(text.len())].matches('\n').count()
        }),
        message: fault.message().to_owned(),
    })?;
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
    many(file.area.len(), "areas", u16::MAX.into())?;
    let mut messages = Vec::new();
    for (id, area) in (1_u16..).zip(file.area) {
        let (places, kind) = match (area.vertices.len(), area.centre, area.radius) {
            (0, Some(centre), Some(_)) => (
                vec![centre],
                [AreaType::KeepInCircle, AreaType::KeepOutCircle],
            ),
            (1.., None, None) => (
                area.vertices,
                [AreaType::KeepInPolygon, AreaType::KeepOutPolygon],
            ),
            _ => {
                return Err(FenceFileError::Shape {
                    path: path.to_owned(),
                    area: id.into(),
                });
            }
        };
        many(places.len(), "vertices of an area", u8::MAX.into())?;
        let count = places.len() as u8;
        messages.extend((1_u8..=count).zip(places).map(|(number, [north, east])| {
            Message::AreaVertex(AreaVertex {
                area_id: Some(id),
                area_type: Some(kind[usize::from(area.keep == Keep::Out)]),
                vertex_count: Some(count),
                vertex_number: Some(number),
                latitude: Some(Bam32::from_degrees(north)),
                longitude: Some(Bam32::from_degrees(east)),
                radius: area.radius.map(|metres| metres as f32),
                ..AreaVertex::default()
            })
        }));
    }
    Ok(messages)
}

/// The text of a fence file of these messages; vertices without a position are left out.
#[must_use]
pub fn to_toml<'a>(vertices: impl IntoIterator<Item = &'a AreaVertex>) -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    let mut open = None;
    for vertex in vertices {
        let (Some(north), Some(east)) = (vertex.latitude, vertex.longitude) else {
            continue;
        };
        let place = format!("[{:.8}, {:.8}]", north.degrees(), east.degrees());
        if open != vertex.area_id {
            if open.is_some() {
                out.push_str("]\n");
            }
            let keep = match vertex.area_type {
                Some(AreaType::KeepOutPolygon | AreaType::KeepOutCircle) => "out",
                _ => "in",
            };
            let _ = write!(out, "[[area]]\nkeep = \"{keep}\"\n");
            if let Some(radius) = vertex.radius {
                let _ = write!(out, "centre = {place}\nradius = {radius}\n");
                open = None;
                continue;
            }
            out.push_str("vertices = [");
            open = vertex.area_id;
        }
        let _ = write!(out, "{place}, ");
    }
    if open.is_some() {
        out.push_str("]\n");
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
        let messages = parse(Path::new("f"), TEXT).unwrap();
        assert_eq!(messages.len(), 4);
        let vertices: Vec<AreaVertex> = messages
            .iter()
            .filter_map(|message| match message {
                Message::AreaVertex(vertex) => Some(vertex.clone()),
                _ => None,
            })
            .collect();
        assert_eq!(vertices[3].area_type, Some(AreaType::KeepOutCircle));
        let text = to_toml(&vertices);
        assert_eq!(parse(Path::new("f"), &text).unwrap(), messages, "{text}");
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
}
