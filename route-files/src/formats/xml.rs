//! XML as a tree whose elements know their lines, for KML and GPX.

use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::fault::FormatError;

/// An element. Names are without their prefixes.
#[derive(Debug, Default)]
pub(super) struct Node {
    pub(super) name: String,
    pub(super) attributes: Vec<(String, String)>,
    /// Its own text, not that of its children.
    pub(super) text: String,
    pub(super) children: Vec<Node>,
    /// The line on which its start tag ends, from 1.
    pub(super) line: u64,
}

impl Node {
    /// The children of a name.
    pub(super) fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Node> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// The text of the first child of a name.
    pub(super) fn text_of(&self, name: &str) -> Option<&str> {
        let mut found = self.children.iter().filter(|child| child.name == name);
        found.next().map(|child| child.text.trim())
    }

    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(key, _)| key == name);
        found.map(|(_, value)| value.as_str())
    }
}

/// The document: a node without a name around its elements.
pub(super) fn document(file: &Path, text: &str) -> Result<Node, FormatError> {
    let mut reader = Reader::from_str(text);
    let (mut counted, mut line) = (0, 1_u64);
    let mut open = vec![Node::default()];
    let mut nodes = 0_usize;
    loop {
        let event = reader.read_event();
        let position = (reader.buffer_position() as usize).clamp(counted, text.len());
        let passed = &text.as_bytes()[counted..position];
        line += passed.iter().filter(|&&b| b == b'\n').count() as u64;
        counted = position;
        let fault =
            |problem: &dyn ToString| FormatError::at(file, Some(line), "", problem.to_string());
        match event.map_err(|e| fault(&e))? {
            Event::Start(_) | Event::Empty(_) if nodes >= MAX_NODES => {
                let problem = format!("over {MAX_NODES} elements, expected fewer");
                return Err(fault(&problem));
            }
            Event::Start(_) if open.len() > MAX_DEPTH => {
                let problem =
                    format!("elements within elements, expected at most {MAX_DEPTH} deep");
                return Err(fault(&problem));
            }
            Event::Start(e) => {
                nodes += 1;
                open.push(node(&e, line).map_err(|e| fault(&e))?);
            }
            Event::Empty(e) => {
                nodes += 1;
                open.push(node(&e, line).map_err(|e| fault(&e))?);
                close(&mut open);
            }
            Event::End(_) => close(&mut open),
            Event::Text(t) => {
                let text = t.decode().map_err(|e| fault(&e))?;
                append(&mut open, &text);
            }
            Event::CData(t) => {
                let text = t.decode().map_err(|e| fault(&e))?;
                append(&mut open, &text);
            }
            Event::GeneralRef(r) => {
                let name = r.decode().map_err(|e| fault(&e))?;
                let escaped = format!("&{name};");
                let text = quick_xml::escape::unescape(&escaped).map_err(|e| fault(&e))?;
                append(&mut open, &text);
            }
            Event::Eof => {
                // The reader itself refuses an end tag of another name; a missing one is found here.
                if let [_, .., last] = open.as_slice() {
                    let problem = format!("<{}> of line {} is not closed", last.name, last.line);
                    return Err(fault(&problem));
                }
                return Ok(open.pop().unwrap_or_default());
            }
            _ => {}
        }
    }
}

fn close(open: &mut Vec<Node>) {
    if open.len() > 1
        && let Some(done) = open.pop()
        && let Some(around) = open.last_mut()
    {
        around.children.push(done);
    }
}

/// Text of the innermost element.
fn append(open: &mut [Node], text: &str) {
    if let Some(inner) = open.last_mut() {
        inner.text.push_str(text);
    }
}

fn node(e: &BytesStart<'_>, line: u64) -> Result<Node, String> {
    let mut attributes = Vec::new();
    for attribute in e.attributes() {
        let attribute = attribute.map_err(|e| e.to_string())?;
        let raw = String::from_utf8_lossy(&attribute.value);
        let value = quick_xml::escape::unescape(&raw).map_err(|e| e.to_string())?;
        let key = String::from_utf8_lossy(attribute.key.local_name().as_ref()).into_owned();
        attributes.push((key, value.into_owned()));
    }
    Ok(Node {
        name: String::from_utf8_lossy(e.local_name().as_ref()).into_owned(),
        attributes,
        line,
        ..Node::default()
    })
}

/// Text as XML can hold it.
#[must_use]
pub fn escaped(text: &str) -> std::borrow::Cow<'_, str> {
    quick_xml::escape::escape(text)
}

/// Files of the world stay under ten; a file of nothing but start tags must not fill the stack when it is dropped.
const MAX_DEPTH: usize = 100;
/// A track of a million places has two of each; a file of more was made to fill the memory.
const MAX_NODES: usize = 4_000_000;
