//! Altitudes over time: panels of some flights each, as an SVG in the style of the demo's other picture.

use std::fmt::Write as _;

use super::labels::escaped;
use super::picture::{MAP_WIDTH, MARGIN, WIDTH, polyline, ticks};

/// What is drawn.
pub(super) struct Altitudes<'a> {
    pub(super) title: &'a str,
    pub(super) panels: Vec<Panel>,
}

/// Flights that are compared.
pub(super) struct Panel {
    pub(super) title: String,
    /// When an attack begins, s of flight.
    pub(super) attack_s: Option<f64>,
    pub(super) curves: Vec<Curve>,
}

/// One flight.
pub(super) struct Curve {
    /// What it is, and what was refused: in the colour of the curve.
    pub(super) text: String,
    pub(super) colour: &'static str,
    /// Seconds of flight, metres above home.
    pub(super) points: Vec<(f64, f64)>,
}

impl Altitudes<'_> {
    /// The SVG.
    pub(super) fn svg(&self) -> String {
        let height: f64 = self.panels.iter().map(Panel::height).sum::<f64>() + FIRST_TOP;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" \
             font-family=\"sans-serif\" font-size=\"13\">\n\
             <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n\
             <text x=\"{MARGIN}\" y=\"28\" font-size=\"18\" font-weight=\"bold\">{}</text>\n\
             <text x=\"{MARGIN}\" y=\"48\" fill=\"#555\">altitude above home in m, over the time of flight in s; \
             the attack begins at the dashed line</text>\n",
            escaped(self.title)
        );
        let curves = || self.panels.iter().flat_map(|panel| &panel.curves);
        let points = || curves().flat_map(|curve| &curve.points);
        // One scale for all panels, so that they can be compared.
        let highest = points().map(|point| point.1).fold(2.0, f64::max) * 1.15;
        let seconds = points().map(|point| point.0).fold(1.0, f64::max);
        let mut top = FIRST_TOP;
        for panel in &self.panels {
            panel.draw(&mut svg, top, (seconds, highest));
            top += panel.height();
        }
        svg.push_str("</svg>\n");
        svg
    }
}

impl Panel {
    /// A line for the title and for each curve, the plot, and its scale.
    fn height(&self) -> f64 {
        self.texts() + PLOT_HEIGHT + BELOW
    }

    fn texts(&self) -> f64 {
        LINE * self.curves.iter().map(|_| 1.0).sum::<f64>() + LINE
    }

    fn draw(&self, svg: &mut String, top: f64, (seconds, highest): (f64, f64)) {
        let _ = writeln!(
            svg,
            "<text x=\"{MARGIN}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>",
            top + 4.0,
            escaped(&self.title)
        );
        let mut y = top + 4.0;
        for curve in &self.curves {
            y += LINE;
            let (colour, text) = (curve.colour, escaped(&curve.text));
            let _ = writeln!(
                svg,
                "<text x=\"{MARGIN}\" y=\"{y:.1}\" fill=\"{colour}\">{text}</text>"
            );
        }
        let top = top + self.texts() - 6.0;
        let x = |time_s: f64| MARGIN + time_s / seconds * MAP_WIDTH;
        let y = |up_m: f64| top + PLOT_HEIGHT * (1.0 - up_m.max(0.0) / highest);
        let (right, bottom) = (MARGIN + MAP_WIDTH, top + PLOT_HEIGHT);
        let _ = writeln!(
            svg,
            "<rect x=\"{MARGIN}\" y=\"{top}\" width=\"{MAP_WIDTH}\" height=\"{PLOT_HEIGHT}\" fill=\"#f6f8f6\" \
             stroke=\"#ccc\"/>"
        );
        for step in ticks(highest).filter(|step| step.fract() == 0.0) {
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
        if let Some(attack_s) = self.attack_s {
            let attack = [(x(attack_s), top), (x(attack_s), bottom)];
            let style = "stroke-dasharray=\"7 5\" stroke-width=\"2\"";
            polyline(svg, attack.into_iter(), "#555", style);
        }
        for curve in &self.curves {
            let points = curve.points.iter().map(|point| (x(point.0), y(point.1)));
            polyline(svg, points, curve.colour, "stroke-width=\"2\"");
        }
    }
}

const FIRST_TOP: f64 = 76.0;
const LINE: f64 = 17.0;
const PLOT_HEIGHT: f64 = 130.0;
/// The scale of the time, and the room to the next panel.
const BELOW: f64 = 42.0;
