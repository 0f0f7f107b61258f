//! `plot`: a picture of a route, what is flown of it, and how far the one is from the other.

mod html;
mod png;
mod scene;
mod svg;

use std::path::PathBuf;

use clap::Args;
use cucs::formats::ending;

use crate::failure::Failure;
use crate::load::{Densify, Loaded};
use crate::output::{RequiredOutput, save};
use crate::tlog;
use scene::Scene;

/// Arguments of `plot`.
#[derive(Debug, Args)]
#[command(mut_arg("written", |to| to.help("Draw to this file: .svg, .png, or .html for a page that can be moved and zoomed")))]
pub(crate) struct Command {
    /// Read this route.
    file: PathBuf,
    #[command(flatten)]
    output: RequiredOutput,
    #[command(flatten)]
    how: Densify,
    /// Make a .png this wide, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 2_000, value_parser = clap::value_parser!(u32).range(100..=10_000))]
    width: u32,
    /// Draw the flown track of this .tlog too.
    #[arg(long)]
    flown: Option<PathBuf>,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let ending = ending(self.output.path());
        if !["svg", "png", "html"].contains(&ending.as_str()) {
            return Err(Failure::Usage(format!(
                "the output ends in {ending:?}, expected .svg, .png or .html"
            )));
        }
        let loaded = Loaded::read(&self.file, &self.how)?;
        loaded.report_losses(&self.how)?;
        let (densified, tolerance_m) = loaded.densify(&self.how)?;
        let flown = match &self.flown {
            Some(file) => tlog::read(file)?,
            None => Vec::new(),
        };
        let name = &loaded.route.name;
        let drawn = svg::draw(&Scene::new(
            name,
            &loaded.legs,
            &densified,
            tolerance_m,
            &flown,
        ));
        let bytes = match ending.as_str() {
            "html" => html::page(name, &drawn).into_bytes(),
            "png" => png::paint(&drawn, self.width)
                .map_err(|e| Failure::answer(self.output.path(), e))?,
            _ => drawn.into_bytes(),
        };
        save(self.output.path(), &bytes)
    }
}
