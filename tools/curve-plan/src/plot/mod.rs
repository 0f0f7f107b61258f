//! `plot`: a picture of a route, the legs by which it is flown, and the distance between the two.

mod html;
mod png;
mod scene;
mod svg;

use std::path::PathBuf;

use clap::Args;
use cucs::formats::{self, Selection, ending};
use curve_paths::Position;

use crate::failure::Failure;
use crate::load::{Densify, Loaded};
use crate::output::{RequiredOutput, note, save};
use crate::tlog;
use scene::{Beside, Scene};

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
    /// Draw the flown track of this .tlog too; its deviation is measured from the route's start to its end.
    #[arg(long, value_name = "FILE")]
    flown: Option<PathBuf>,
    /// Draw this track too, which the route was fitted to, and how far its fixes are from the route.
    #[arg(long, value_name = "FILE")]
    track: Option<PathBuf>,
    /// Of --track use only the rows of this lap (a table with a column lap).
    #[arg(long, requires = "track")]
    lap: Option<i64>,
    /// Mark home here: degrees north and east, such as 47.3977,8.5456 (default: the file's, or the start of --flown).
    #[arg(long, value_name = "LAT,LON", value_parser = home, allow_hyphen_values = true)]
    home: Option<Position>,
    /// Draw light lines on a dark ground.
    #[arg(long)]
    dark: bool,
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
        let track = match &self.track {
            Some(file) => {
                let mut selection = Selection::default();
                selection.lap = self.lap;
                formats::read_track(file, &selection)?.positions()
            }
            None => Vec::new(),
        };
        let beside = Beside {
            home: self.home,
            track,
            flown: match &self.flown {
                Some(file) => tlog::read(file)?,
                None => Vec::new(),
            },
        };
        let scene = Scene::new(
            &loaded.route,
            &loaded.legs,
            &densified,
            tolerance_m,
            &beside,
        );
        if scene.home.is_none() {
            note("no home is drawn: --home LAT,LON marks it, and so does --flown by its start");
        }
        let theme = if self.dark { &svg::DARK } else { &svg::LIGHT };
        let bytes = match ending.as_str() {
            "html" => html::page(&scene, theme).into_bytes(),
            "png" => png::paint(&svg::draw(&scene, theme), self.width)
                .map_err(|e| Failure::answer(self.output.path(), e))?,
            _ => svg::draw(&scene, theme).into_bytes(),
        };
        save(self.output.path(), &bytes)
    }
}

/// A place of the command line.
fn home(text: &str) -> Result<Position, String> {
    let fault = || format!("{text:?}, expected LAT,LON in degrees, such as 47.3977,8.5456");
    let (lat, lon) = text.split_once(',').ok_or_else(fault)?;
    // An altitude may follow; it is ignored, since a map has none.
    let lon = lon.split(',').next().unwrap_or(lon);
    let degrees = |text: &str| text.trim().parse::<f64>().map_err(|_| fault());
    let place = Position::new(degrees(lat)?, degrees(lon)?, 0.0);
    place.checked().map_err(|e| e.to_string())?;
    Ok(place)
}
