//! What a demo leaves behind: its picture, its last words, and where everything is.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use cucs::Station;

use super::picture::Picture;
use super::story::Story;
use super::table;
use super::world::Remains;

/// Writes the picture, and tells the table and where everything is.
pub(super) fn leave(
    out: &Path,
    picture: &Picture<'_>,
    station: &Station,
    remains: &Remains,
    story: &Story,
    report: &str,
) -> anyhow::Result<()> {
    draw(out, picture)?;
    let points = &picture.flown.points;
    let summary = table::Summary {
        traffic: station.session().traffic(),
        status: &remains.status,
        simulator: &remains.counters,
        flight_s: points.last().map_or(0.0, |last| last.time_s)
            - points.first().map_or(0.0, |first| first.time_s),
        took: story.started.elapsed(),
        speed: story.speed,
    };
    let recorded = remains
        .recording
        .as_deref()
        .map_or_else(String::new, |file| {
            format!(", {file} is the MAVLink recording")
        });
    conclude(
        out,
        &format!(
            "{}{report}{}\nflight.svg shows it{recorded}",
            summary.text(),
            summary.times()
        ),
    )
}

/// Prints the last words, and where everything is.
pub(super) fn conclude(out: &Path, text: &str) -> anyhow::Result<()> {
    let out = std::path::absolute(out).unwrap_or_else(|_| PathBuf::from(out));
    let text = format!("{text}\n{}\n", out.display());
    io::stdout()
        .write_all(text.as_bytes())
        .context("standard output")
}

/// Writes the picture.
pub(super) fn draw(out: &Path, picture: &Picture<'_>) -> anyhow::Result<()> {
    let svg = out.join("flight.svg");
    std::fs::write(&svg, picture.svg())
        .with_context(|| format!("{} cannot be written", svg.display()))
}
