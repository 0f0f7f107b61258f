//! Altitudes over time, one panel a flight, as an SVG in the style of the demo's other picture.

use std::fmt::Write as _;

use super::labels::escaped;
use super::picture::{FLOWN, MAP_WIDTH, MARGIN, PLANNED, WIDTH, polyline, ticks};
use super::track::Track;

/// What is drawn.
pub(super) struct Altitudes<'a> {
    pub(super) title: &'a str,
    /// When the attack begins, s of flight.
    pub(super) attack_s: f64,
    pub(super) panels: [Panel<'a>; 2],
}

/// One flight.
pub(super) struct Panel<'a> {
    pub(super) title: &'a str,
    /// What was refused and what was taken.
    pub(super) note: &'a [String; 2],
    pub(super) track: &'a Track,
}

impl Altitudes<'_> {
    /// The SVG.
    pub(super) fn svg(&self) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             font-family=\"sans-serif\" font-size=\"13\">\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n\
             <text x=\"{MARGIN}\" y=\"28\" font-size=\"18\" font-weight=\"bold\">{}</text>\n\
             <text x=\"{MARGIN}\" y=\"48\" fill=\"#555\">altitude above home in m, over the time of flight in s; \
             the attack begins at the dashed line</text>\n",
            escaped(self.title)
        );
        let points = || self.panels.iter().flat_map(|panel| &panel.track.points);
        // One scale for both, or they could not be compared.
        let highest = points().map(|point| point.up_m).fold(5.0, f64::max) * 1.15;
        let seconds = self
            .panels
            .iter()
            .map(|panel| panel.seconds())
            .fold(1.0, f64::max);
        for (nth, panel) in (0_u8..).zip(&self.panels) {
            let top = FIRST_TOP + f64::from(nth) * PANEL_PITCH;
            panel.draw(&mut svg, top, (seconds, highest), self.attack_s);
        }
        svg.push_str("</svg>\n");
        svg
    }
}

impl Panel<'_> {
    fn seconds(&self) -> f64 {
        let points = &self.track.points;
        let (first, last) = (points.first(), points.last());
        first
            .zip(last)
            .map_or(0.0, |(first, last)| last.time_s - first.time_s)
    }

    fn draw(&self, svg: &mut String, top: f64, (seconds, highest): (f64, f64), attack_s: f64) {
        let begun = self.track.points.first().map_or(0.0, |first| first.time_s);
        let x = |time_s: f64| MARGIN + time_s / seconds * MAP_WIDTH;
        let y = |up_m: f64| top + PANEL_HEIGHT * (1.0 - up_m.max(0.0) / highest);
        let [first, second] = self.note;
        let (right, bottom) = (MARGIN + MAP_WIDTH, top + PANEL_HEIGHT);
        let _ = writeln!(
            svg,
            "<text x=\"{MARGIN}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>\
             <text x=\"{MARGIN}\" y=\"{:.1}\" fill=\"#555\">{}</text>\
             <text x=\"{MARGIN}\" y=\"{:.1}\" fill=\"#555\">{}</text>\
             <rect x=\"{MARGIN}\" y=\"{top}\" width=\"{MAP_WIDTH}\" height=\"{PANEL_HEIGHT}\" fill=\"#f6f8f6\" \
             stroke=\"#ccc\"/>",
            top - 44.0,
            escaped(self.title),
            top - 26.0,
            escaped(first),
            top - 9.0,
            escaped(second)
        );
        for step in ticks(highest) {
            let y = y(step);
            let _ = writeln!(
                svg,
                "<line x1=\"{MARGIN}\" x2=\"{right:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555\">{step:.0}</text>",
                MARGIN - 5.0,
                y + 4.0
            );
        }
        for step in ticks(seconds) {
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555\">{step:.0}</text>",
                x(step),
                bottom + 16.0
            );
        }
        let attack = [(x(attack_s), top), (x(attack_s), bottom)];
        polyline(
            svg,
            attack.into_iter(),
            PLANNED,
            "stroke-dasharray=\"7 5\" stroke-width=\"2\"",
        );
        let flown = &self.track.points;
        polyline(
            svg,
            flown
                .iter()
                .map(|point| (x(point.time_s - begun), y(point.up_m))),
            FLOWN,
            "stroke-width=\"2\"",
        );
    }
}

const HEIGHT: f64 = 690.0;
const FIRST_TOP: f64 = 124.0;
const PANEL_HEIGHT: f64 = 210.0;
const PANEL_PITCH: f64 = 306.0;
