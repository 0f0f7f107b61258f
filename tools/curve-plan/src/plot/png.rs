//! The picture as a PNG. The program has its own font, so that the picture is the same where no fonts are installed.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb::Database};
use thiserror::Error;

/// Why there is no picture.
#[derive(Debug, Error)]
pub(crate) enum PaintError {
    /// The drawing cannot be parsed.
    #[error("drawing: {0}")]
    Drawing(#[from] resvg::usvg::Error),
    /// The size is 0, or too large for the memory.
    #[error("{width} x {height} pixels, expected some that fit into memory")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// The PNG cannot be encoded.
    #[error("packing: {0}")]
    Packing(String),
}

/// The bytes of a PNG of this width in pixels.
pub(crate) fn paint(svg: &str, width: u32) -> Result<Vec<u8>, PaintError> {
    let mut letters = Database::new();
    letters.load_font_data(LETTERS.to_vec());
    let options = Options {
        font_family: FAMILY.to_owned(),
        fontdb: Arc::new(letters),
        ..Options::default()
    };
    let tree = Tree::from_str(svg, &options)?;
    let scale = width as f32 / tree.size().width();
    let height = (tree.size().height() * scale).round() as u32;
    let mut pixels = Pixmap::new(width, height).ok_or(PaintError::Size { width, height })?;
    resvg::render(
        &tree,
        Transform::from_scale(scale, scale),
        &mut pixels.as_mut(),
    );
    pixels
        .encode_png()
        .map_err(|e| PaintError::Packing(e.to_string()))
}

/// DejaVu Sans, Latin letters; its licence is beside it.
const LETTERS: &[u8] = include_bytes!("../../font/DejaVuSans-Latin.ttf");
const FAMILY: &str = "DejaVu Sans";
