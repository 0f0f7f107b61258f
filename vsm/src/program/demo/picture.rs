//! The planned and the flown track as an SVG: map with scale and north, altitude profile.

use std::fmt::Write as _;

use px4_sim::Truth;

use super::labels::{Labels, escaped};
use super::track::{Look, Point, Track};

/// A planned route as it is drawn.
#[derive(Debug, Default)]
pub(crate) struct Planned {
    /// Numbered waypoints, in flying order.
    pub(crate) waypoints: Vec<(u16, Point)>,
    /// The line through them.
    pub(crate) line: Vec<Point>,
    /// Control arms of curves: from the curve's end to the control point.
    pub(crate) arms: Vec<[Point; 2]>,
    /// Vertices of the chords that curves are flown by.
    pub(crate) vertices: Vec<Point>,
    /// The landing pattern of wings.
    pub(crate) landing: Vec<Point>,
}

/// Something that happened in the flight, such as a transition.
#[derive(Debug)]
pub(crate) struct Mark {
    pub(crate) point: Point,
    pub(crate) text: &'static str,
}

impl Mark {
    pub(crate) fn at(truth: &Truth, text: &'static str) -> Mark {
        Mark {
            point: Point::of(truth),
            text,
        }
    }
}

/// What is drawn.
pub(crate) struct Picture<'a> {
    pub(crate) title: &'a str,
    pub(crate) planned: &'a Planned,
    pub(crate) flown: &'a Track,
    /// The tracks of the rest of a fleet, in the same frame.
    pub(super) others: &'a [Track],
    pub(crate) note: &'a str,
    /// In the order of the flight: lettered in the map, named in the profile.
    pub(crate) marks: &'a [Mark],
    /// Where a payload looked, in the order of the flight.
    pub(super) looks: &'a [Look],
}

impl Picture<'_> {
    /// The SVG.
    pub(crate) fn svg(&self) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             font-family=\"sans-serif\" font-size=\"13\">\n\
             <style>text {{ paint-order: stroke; stroke: #fff; stroke-width: 3px }}</style>\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n\
             <text x=\"{MARGIN}\" y=\"28\" font-size=\"18\" font-weight=\"bold\">{}</text>\n\
             <text x=\"{MARGIN}\" y=\"48\" fill=\"#555\">{}</text>\n",
            escaped(self.title),
            escaped(self.note)
        );
        self.map(&mut svg);
        self.profile(&mut svg);
        self.legend(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn map(&self, svg: &mut String) {
        let planned = self.planned.line.iter().chain(&self.planned.landing);
        let others = self.others.iter().flat_map(|track| &track.points);
        let places = planned.chain(&self.flown.points).chain(others);
        let (mut west, mut east, mut south, mut north) = (f64::MAX, f64::MIN, f64::MAX, f64::MIN);
        for point in places {
            (west, east) = (west.min(point.east_m), east.max(point.east_m));
            (south, north) = (south.min(point.north_m), north.max(point.north_m));
        }
        for Look { to, .. } in self.looks {
            (west, east) = (west.min(to.1), east.max(to.1));
            (south, north) = (south.min(to.0), north.max(to.0));
        }
        if west > east {
            return;
        }
        let room = 0.08 * (east - west).max(north - south).max(10.0);
        (west, east, south, north) = (west - room, east + room, south - room, north + room);
        let scale = (MAP_WIDTH / (east - west)).min(MAP_HEIGHT / (north - south));
        let left = MARGIN + (MAP_WIDTH - scale * (east - west)) / 2.0;
        let top = MAP_TOP + (MAP_HEIGHT - scale * (north - south)) / 2.0;
        let x = |point: &Point| left + scale * (point.east_m - west);
        let y = |point: &Point| top + scale * (north - point.north_m);
        let _ = writeln!(
            svg,
            "<rect x=\"{MARGIN}\" y=\"{MAP_TOP}\" width=\"{MAP_WIDTH}\" height=\"{MAP_HEIGHT}\" \
             fill=\"#f6f8f6\" stroke=\"#ccc\"/>"
        );
        let pixel = |(north_m, east_m): (f64, f64)| {
            (
                left + scale * (east_m - west),
                top + scale * (north - north_m),
            )
        };
        sights(svg, self.looks, scale, pixel);
        let mut labels = Labels::new((MARGIN, MAP_TOP), MAP_WIDTH, MAP_HEIGHT);
        let pixels = |points: &[Point]| -> Vec<_> {
            points.iter().map(|point| (x(point), y(point))).collect()
        };
        for line in [
            &self.planned.line,
            &self.planned.landing,
            &self.flown.points,
        ] {
            labels.line(pixels(line).into_iter());
        }
        for [end, control] in &self.planned.arms {
            let _ = writeln!(
                svg,
                "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{ARM}\"/><circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2\" fill=\"{ARM}\"/>",
                x(end),
                y(end),
                x(control),
                y(control),
                x(control),
                y(control)
            );
        }
        let planned = self.planned.line.iter().map(|point| (x(point), y(point)));
        polyline(
            svg,
            planned,
            PLANNED,
            "stroke-dasharray=\"7 5\" stroke-width=\"2\"",
        );
        if let Some(entry) = self.planned.landing.first() {
            let landing = self.planned.landing.iter();
            polyline(
                svg,
                landing.map(|point| (x(point), y(point))),
                LANDING,
                "stroke-dasharray=\"7 5\" stroke-width=\"2\"",
            );
            labels.name((x(entry), y(entry)), "landing pattern", LANDING);
        }
        for other in self.others {
            let track = other.points.iter().map(|point| (x(point), y(point)));
            polyline(svg, track, OTHER, OTHER_STYLE);
        }
        let flown = self.flown.points.iter().map(|point| (x(point), y(point)));
        polyline(svg, flown, FLOWN, "stroke-width=\"2\"");
        for vertex in &self.planned.vertices {
            let (x, y) = (x(vertex), y(vertex));
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2\" fill=\"{PLANNED}\"/>"
            );
        }
        for (number, point) in &self.planned.waypoints {
            let (x, y) = (x(point), y(point));
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#fff\" stroke=\"{PLANNED}\" stroke-width=\"2\"/>"
            );
            labels.symbol((x, y), 6.0);
            labels.name((x, y), number.to_string(), PLANNED);
        }
        if let Some(start) = self.flown.points.first() {
            let (x, y) = (x(start), y(start));
            let _ = writeln!(
                svg,
                "<path d=\"M{:.1} {:.1} l7 12 h-14 z\" fill=\"{FLOWN}\"/>",
                x,
                y - 7.0,
            );
            labels.symbol((x, y), 7.0);
            labels.name((x, y), "home", "#000");
        }
        for (mark, letter) in self.marks.iter().zip('A'..) {
            diamond(svg, &mut labels, (x(&mark.point), y(&mark.point)), letter);
        }
        scale_bar(svg, scale);
        let (x, y) = (MARGIN + MAP_WIDTH - 26.0, MAP_TOP + 14.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{x} {y} l8 26 l-8 -6 l-8 6 z\" fill=\"#333\"/>\
             <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">N</text>",
            y + 44.0
        );
        labels.symbol((x, y + 22.0), 24.0);
        labels.write(svg);
    }

    fn profile(&self, svg: &mut String) {
        let points = &self.flown.points;
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return;
        };
        let planned_top = self
            .planned
            .line
            .iter()
            .map(|point| point.up_m)
            .fold(10.0, f64::max);
        // Each vehicle's time begins with its own arming.
        let span = |track: &Track| match &track.points[..] {
            [begun, .., ended] => ended.time_s - begun.time_s,
            _ => 0.0,
        };
        let others = self.others.iter().flat_map(|track| &track.points);
        let highest = points
            .iter()
            .chain(others)
            .map(|point| point.up_m)
            .fold(planned_top, f64::max)
            * 1.15;
        let longest = self.others.iter().map(span).fold(1.0, f64::max);
        let seconds = (last.time_s - first.time_s).max(longest);
        let x = |time_s: f64| MARGIN + (time_s - first.time_s) / seconds * MAP_WIDTH;
        let y = |up_m: f64| PROFILE_TOP + PROFILE_HEIGHT * (1.0 - up_m.max(0.0) / highest);
        let _ = writeln!(
            svg,
            "<rect x=\"{MARGIN}\" y=\"{PROFILE_TOP}\" width=\"{MAP_WIDTH}\" height=\"{PROFILE_HEIGHT}\" \
             fill=\"#f6f8f6\" stroke=\"#ccc\"/>"
        );
        for step in ticks(highest) {
            let y = y(step);
            let _ = writeln!(
                svg,
                "<line x1=\"{MARGIN}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555\">{step:.0}</text>",
                MARGIN + MAP_WIDTH,
                MARGIN - 5.0,
                y + 4.0
            );
        }
        for step in ticks(seconds) {
            let x = x(first.time_s + step);
            let _ = writeln!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555\">{step:.0}</text>",
                PROFILE_TOP + PROFILE_HEIGHT + 16.0
            );
        }
        for other in self.others {
            let begun_s = other.points.first().map_or(0.0, |point| point.time_s);
            let track = other.points.iter();
            let track =
                track.map(|point| (x(first.time_s + point.time_s - begun_s), y(point.up_m)));
            polyline(svg, track, OTHER, OTHER_STYLE);
        }
        polyline(
            svg,
            points.iter().map(|point| (x(point.time_s), y(point.up_m))),
            FLOWN,
            "stroke-width=\"2\"",
        );
        let mut labels = Labels::new((MARGIN, PROFILE_TOP), MAP_WIDTH, PROFILE_HEIGHT);
        labels.line(points.iter().map(|point| (x(point.time_s), y(point.up_m))));
        for (mark, letter) in self.marks.iter().zip('A'..) {
            let at = (x(mark.point.time_s), y(mark.point.up_m));
            diamond(svg, &mut labels, at, letter);
        }
        for (number, waypoint) in &self.planned.waypoints {
            let Some(nearest) = self.flown.nearest(waypoint) else {
                continue;
            };
            let (x, y) = (x(nearest.time_s), y(waypoint.up_m));
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"none\" stroke=\"{PLANNED}\" stroke-width=\"2\"/>"
            );
            labels.symbol((x, y), 5.0);
            labels.name((x, y), number.to_string(), PLANNED);
        }
        labels.write(svg);
        let _ = writeln!(
            svg,
            "<text x=\"{MARGIN}\" y=\"{:.1}\" fill=\"#555\">altitude above home in m, over the vehicle's time in s</text>",
            PROFILE_TOP - 6.0
        );
    }

    fn legend(&self, svg: &mut String) {
        let y = HEIGHT - 34.0;
        let mut x = MARGIN;
        let mut lines = vec![
            (PLANNED, " stroke-dasharray=\"7 5\"", "planned"),
            (FLOWN, "", "flown"),
        ];
        if !self.others.is_empty() {
            lines.push((OTHER, "", "the others of the fleet"));
        }
        if !self.planned.landing.is_empty() {
            lines.push((LANDING, " stroke-dasharray=\"7 5\"", "landing pattern"));
        }
        if !self.looks.is_empty() {
            lines.push((SIGHT, "", "line of sight"));
            lines.push((
                SEEN,
                " stroke-dasharray=\"1 6\" stroke-linecap=\"round\"",
                "image centre, width of view",
            ));
        }
        for (colour, dashes, text) in lines {
            let _ = writeln!(
                svg,
                "<line x1=\"{x:.0}\" x2=\"{:.0}\" y1=\"{:.0}\" y2=\"{:.0}\" stroke=\"{colour}\" stroke-width=\"2\"{dashes}/>\
                 <text x=\"{:.0}\" y=\"{y}\">{text}</text>",
                x + 40.0,
                y - 4.0,
                y - 4.0,
                x + 48.0,
            );
            x += 200.0;
        }
        let named = self.marks.iter().zip('A'..);
        let named: Vec<String> = named
            .map(|(mark, letter)| format!("{letter} {}", mark.text))
            .collect();
        let _ = writeln!(
            svg,
            "<text x=\"{MARGIN}\" y=\"{:.0}\" fill=\"{MARKED}\" font-size=\"12\">{}</text>",
            y + 20.0,
            escaped(&named.join("\u{a0}\u{a0}\u{a0} "))
        );
    }
}

/// Where a payload looked: every image centre, and of some the line of sight and the width of the view across it.
fn sights(
    svg: &mut String,
    looks: &[Look],
    pixels_a_metre: f64,
    pixel: impl Fn((f64, f64)) -> (f64, f64),
) {
    let every = looks.len().div_ceil(MAX_SIGHTS).max(1);
    for (nth, look) in looks.iter().enumerate() {
        let ((from_x, from_y), (x, y)) = (pixel(look.from), pixel(look.to));
        if nth % every == 0 {
            let _ = writeln!(
                svg,
                "<path class=\"sight\" d=\"M{from_x:.1} {from_y:.1}L{x:.1} {y:.1}\" stroke=\"{SIGHT}\"/>"
            );
            let (along_x, along_y) = (x - from_x, y - from_y);
            let length = along_x.hypot(along_y);
            if let Some(half_m) = look.half_width_m.filter(|_| length > 1.0) {
                let half = half_m * pixels_a_metre / length;
                let (across_x, across_y) = (-along_y * half, along_x * half);
                let _ = writeln!(
                    svg,
                    "<path class=\"width\" d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{SEEN}\"/>",
                    x - across_x,
                    y - across_y,
                    x + across_x,
                    y + across_y
                );
            }
        }
        let _ = writeln!(
            svg,
            "<circle class=\"seen\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.5\" fill=\"{SEEN}\"/>"
        );
    }
}

/// A mark; its letter stands where there is room for it.
fn diamond(svg: &mut String, labels: &mut Labels, (x, y): (f64, f64), letter: char) {
    let _ = writeln!(
        svg,
        "<path d=\"M{x:.1} {:.1} l6 6 l-6 6 l-6 -6 z\" fill=\"{MARKED}\"/>",
        y - 6.0
    );
    labels.symbol((x, y), 6.0);
    labels.letter((x, y), letter, MARKED);
}

fn scale_bar(svg: &mut String, pixels_a_metre: f64) {
    let metres = [1.0, 2.0, 5.0]
        .iter()
        .flat_map(|digit| (0..6).map(move |power| digit * 10_f64.powi(power)))
        .filter(|metres| metres * pixels_a_metre <= 200.0)
        .fold(1.0, f64::max);
    let (x, y) = (MARGIN + 14.0, MAP_TOP + MAP_HEIGHT - 16.0);
    let _ = writeln!(
        svg,
        "<path d=\"M{x} {:.1} v6 h{:.1} v-6\" fill=\"none\" stroke=\"#333\" stroke-width=\"2\"/>\
         <text x=\"{x}\" y=\"{:.1}\">{metres:.0} m</text>",
        y - 6.0,
        metres * pixels_a_metre,
        y - 12.0
    );
}

pub(super) fn polyline(
    svg: &mut String,
    points: impl Iterator<Item = (f64, f64)>,
    colour: &str,
    style: &str,
) {
    svg.push_str("<polyline fill=\"none\" stroke-linejoin=\"round\" stroke=\"");
    let _ = write!(svg, "{colour}\" {style} points=\"");
    for (x, y) in points {
        let _ = write!(svg, "{x:.1},{y:.1} ");
    }
    svg.push_str("\"/>\n");
}

/// Round steps from 0 to a value, at most eight.
pub(super) fn ticks(to: f64) -> impl Iterator<Item = f64> {
    let rough = to / 8.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|digit| digit * power)
        .find(|step| *step >= rough)
        .unwrap_or(to);
    (0..)
        .map(move |n| f64::from(n) * step)
        .take_while(move |value| *value <= to)
}

/// What flies, for the note of a picture.
pub(super) const CHAIN: &str = "CUCS over DLI, bridge, signed MAVLink 2, simulated PX4";
pub(super) const WIDTH: f64 = 920.0;
const HEIGHT: f64 = 860.0;
pub(super) const MARGIN: f64 = 46.0;
const MAP_TOP: f64 = 62.0;
pub(super) const MAP_WIDTH: f64 = 828.0;
const MAP_HEIGHT: f64 = 480.0;
const PROFILE_TOP: f64 = 576.0;
const PROFILE_HEIGHT: f64 = 200.0;
/// Lines of sight that are drawn.
const MAX_SIGHTS: usize = 48;
const SIGHT: &str = "#9ccfc4";
const SEEN: &str = "#0d7a66";
const ARM: &str = "#b9a3c9";
const LANDING: &str = "#2a7d3c";
/// Tracks that are drawn under the first one, which is drawn over all of them.
const OTHER: &str = "#e0a38c";
const OTHER_STYLE: &str = "class=\"other\" stroke-width=\"1\"";
const MARKED: &str = "#6a1fa8";
pub(super) const PLANNED: &str = "#1f5fa8";
pub(super) const FLOWN: &str = "#c8401a";
