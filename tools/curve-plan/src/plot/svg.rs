//! The picture: a map above, the deviation and the altitude along the route below.

use std::fmt::Write;

use cucs::formats::escaped;

use super::scene::{Point, Scene};

const WIDTH: f64 = 1000.0;
const MAP_HEIGHTS: (f64, f64) = (300.0, 760.0);
const PROFILE_HEIGHT: f64 = 130.0;
/// Height of the map taken by its legend, scale and margins.
const FURNITURE: f64 = 110.0;
const MARGIN: f64 = 56.0;
const TITLE: f64 = 52.0;

/// Colours of the radius classes, from straight to tight, and the greatest radius of each but the first, m.
const CLASSES: [(&str, f64); 7] = [
    ("#3b528b", f64::INFINITY),
    ("#2c728e", 800.0),
    ("#21918c", 400.0),
    ("#3fbc73", 200.0),
    ("#d9a514", 100.0),
    ("#e8702a", 50.0),
    ("#c3243c", 25.0),
];

/// Draws a scene.
pub(crate) fn draw(scene: &Scene) -> String {
    let climbs = scene
        .curve
        .iter()
        .any(|s| (s.alt_m - scene.curve[0].alt_m).abs() > 0.01);
    let profiles = if climbs { 2.0 } else { 1.0 };
    let view = View::of(scene);
    let height = TITLE + view.height + profiles * (PROFILE_HEIGHT + 44.0) + 10.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
         font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"#222\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <text x=\"{MARGIN}\" y=\"22\" font-size=\"16\" font-weight=\"bold\">{}</text>\n",
        escaped(&scene.title)
    );
    let length_m = scene.curve.last().map_or(0.0, |s| s.along_m);
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"42\">{:.2} km, {} legs, {} vertices, tolerance {} m, proven {:.3} m</text>",
        MARGIN,
        length_m / 1000.0,
        scene.joints.len().saturating_sub(1),
        scene.vertices.len(),
        scene.tolerance_m,
        scene.bound_m
    );
    map(&mut out, scene, &view);
    let mut y = TITLE + view.height + 34.0;
    deviation(&mut out, scene, y, length_m);
    if climbs {
        y += PROFILE_HEIGHT + 44.0;
        let altitude: Vec<Point> = scene.curve.iter().map(|s| [s.along_m, s.alt_m]).collect();
        let metres = || altitude.iter().map(|p| p[1]);
        let low = metres().fold(f64::INFINITY, f64::min);
        let high = metres().fold(f64::NEG_INFINITY, f64::max);
        let axes = Axes::draw(&mut out, y, length_m, [low, high], "altitude, m");
        axes.line(&mut out, &altitude, "#5b4b8a", 1.6);
    }
    out + "</svg>\n"
}

/// From metres to the picture.
struct View {
    /// Height of the map.
    height: f64,
    scale: f64,
    middle: Point,
}

impl View {
    fn of(scene: &Scene) -> Self {
        let [low, high] = scene.extent();
        let size = [(high[0] - low[0]).max(1.0), (high[1] - low[1]).max(1.0)];
        let width = WIDTH - 2.0 * MARGIN;
        let height = (width * size[1] / size[0] + FURNITURE).clamp(MAP_HEIGHTS.0, MAP_HEIGHTS.1);
        let scale = (width / size[0]).min((height - FURNITURE) / size[1]);
        Self {
            height,
            scale,
            middle: [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])],
        }
    }

    fn to(&self, p: Point) -> Point {
        [
            WIDTH / 2.0 + (p[0] - self.middle[0]) * self.scale,
            TITLE + (self.height - 40.0) / 2.0 - (p[1] - self.middle[1]) * self.scale,
        ]
    }

    fn line(&self, out: &mut String, points: &[Point], colour: &str, width: f64) {
        line(out, points.iter().map(|p| self.to(*p)), colour, width);
    }
}

fn line(out: &mut String, points: impl Iterator<Item = Point>, colour: &str, width: f64) {
    let d = path(points);
    let _ = writeln!(
        out,
        "<path d=\"{d}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"/>"
    );
}

fn path(points: impl Iterator<Item = Point>) -> String {
    let mut d = String::new();
    for (k, [x, y]) in points.enumerate() {
        let _ = write!(d, "{}{x:.2} {y:.2}", if k == 0 { "M" } else { "L" });
    }
    d
}

fn map(out: &mut String, scene: &Scene, view: &View) {
    let _ = writeln!(
        out,
        "<rect x=\"12\" y=\"{TITLE}\" width=\"{}\" height=\"{}\" fill=\"#f7f7f4\" stroke=\"#ccc\"/>\n<g id=\"map\">",
        WIDTH - 24.0,
        view.height
    );
    for [end, control] in &scene.arms {
        let (a, b) = (view.to(*end), view.to(*control));
        let _ = writeln!(
            out,
            "<path d=\"M{:.2} {:.2}L{:.2} {:.2}\" stroke=\"#999\" stroke-width=\"0.8\"/>\
             <rect x=\"{:.2}\" y=\"{:.2}\" width=\"5\" height=\"5\" fill=\"#fff\" stroke=\"#777\" stroke-width=\"0.8\"/>",
            a[0],
            a[1],
            b[0],
            b[1],
            b[0] - 2.5,
            b[1] - 2.5
        );
    }
    curve(out, scene, view);
    view.line(out, &scene.vertices, "#111", 0.7);
    if !scene.flown.is_empty() {
        view.line(out, &scene.flown, "#d100a8", 1.2);
    }
    for p in &scene.vertices {
        let [x, y] = view.to(*p);
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"1.9\" fill=\"#111\"/>"
        );
    }
    for p in &scene.joints {
        let [x, y] = view.to(*p);
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"4.2\" fill=\"#fff\" stroke=\"#111\" stroke-width=\"1.4\"/>"
        );
    }
    out.push_str("</g>\n");
    furniture(out, view, !scene.flown.is_empty());
}

/// The curve, in runs of one radius class.
fn curve(out: &mut String, scene: &Scene, view: &View) {
    let class = |radius_m: f64| {
        CLASSES
            .iter()
            .rposition(|&(_, max)| radius_m <= max)
            .unwrap_or(0)
    };
    let mut k = 0;
    while k + 1 < scene.curve.len() {
        let here = class(scene.curve[k + 1].radius_m);
        let mut end = k + 1;
        while end + 1 < scene.curve.len() && class(scene.curve[end + 1].radius_m) == here {
            end += 1;
        }
        let d = path(scene.curve[k..=end].iter().map(|s| view.to(s.at)));
        let _ = writeln!(
            out,
            "<path d=\"{d}\" fill=\"none\" stroke=\"{}\" stroke-width=\"4.5\" stroke-linecap=\"round\" stroke-linejoin=\"round\"/>",
            CLASSES[here].0
        );
        k = end;
    }
}

/// North, scale, and what the colours and marks mean.
fn furniture(out: &mut String, view: &View, flown: bool) {
    let (x, y) = (WIDTH - 46.0, TITLE + 22.0);
    let _ = writeln!(
        out,
        "<path d=\"M{x} {y}l7 26l-7 -6l-7 6z\" fill=\"#333\"/><text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"bold\">N</text>",
        y + 40.0
    );
    let bar_m = nice(150.0 / view.scale);
    let bar = bar_m * view.scale;
    let (x, y) = (WIDTH - 40.0 - bar, TITLE + view.height - 18.0);
    let label = if bar_m >= 1000.0 {
        format!("{} km", bar_m / 1000.0)
    } else {
        format!("{bar_m} m")
    };
    let _ = writeln!(
        out,
        "<path d=\"M{x:.1} {:.1}v6h{bar:.1}v-6\" fill=\"none\" stroke=\"#333\" stroke-width=\"1.5\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
        y - 6.0,
        x + bar / 2.0,
        y - 8.0
    );
    let (mut x, y) = (28.0, TITLE + view.height - 18.0);
    let _ = writeln!(out, "<text x=\"{x}\" y=\"{}\">radius, m</text>", y - 16.0);
    for (k, (colour, _)) in CLASSES.iter().enumerate() {
        let label = match CLASSES.get(k + 1) {
            Some((_, next)) => format!("&gt; {next}"),
            None => format!("&lt; {}", CLASSES[k].1),
        };
        let _ = writeln!(
            out,
            "<rect x=\"{x}\" y=\"{}\" width=\"46\" height=\"6\" fill=\"{colour}\"/><text x=\"{x}\" y=\"{}\" font-size=\"10\">{label}</text>",
            y - 11.0,
            y + 7.0
        );
        x += 48.0;
    }
    let mut x = x + 16.0;
    let mut mark = |shape: &str, label: &str| {
        let _ = writeln!(
            out,
            "<g transform=\"translate({x} {})\">{shape}</g><text x=\"{}\" y=\"{y}\">{label}</text>",
            y - 4.0,
            x + 12.0
        );
        x += 34.0 + 7.0 * label.len() as f64;
    };
    mark(
        "<circle r=\"4.2\" fill=\"#fff\" stroke=\"#111\" stroke-width=\"1.4\"/>",
        "waypoint",
    );
    mark(
        "<rect x=\"-2.5\" y=\"-2.5\" width=\"5\" height=\"5\" fill=\"#fff\" stroke=\"#777\"/>",
        "control",
    );
    mark("<circle r=\"1.9\" fill=\"#111\"/>", "vertex");
    if flown {
        mark(
            "<path d=\"M-6 0h12\" stroke=\"#d100a8\" stroke-width=\"1.5\"/>",
            "flown",
        );
    }
}

fn deviation(out: &mut String, scene: &Scene, y: f64, length_m: f64) {
    let planned: Vec<Point> = scene
        .curve
        .iter()
        .map(|s| [s.along_m, s.deviation_m])
        .collect();
    let worst = scene
        .flown_deviation
        .iter()
        .map(|d| d[1])
        .fold(scene.tolerance_m * 1.15, f64::max);
    let axes = Axes::draw(out, y, length_m, [0.0, worst], "deviation, m");
    if !scene.flown_deviation.is_empty() {
        for d in &scene.flown_deviation {
            let [x, y] = axes.to(*d);
            let _ = write!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1\" fill=\"#d100a8\"/>"
            );
        }
        out.push('\n');
    }
    axes.line(out, &planned, "#2c728e", 1.0);
    axes.line(
        out,
        &[[0.0, scene.tolerance_m], [length_m, scene.tolerance_m]],
        "#c3243c\" stroke-dasharray=\"6 4",
        1.2,
    );
}

/// A profile's frame.
struct Axes {
    y: f64,
    length_m: f64,
    range: [f64; 2],
}

impl Axes {
    fn draw(out: &mut String, y: f64, length_m: f64, range: [f64; 2], label: &str) -> Self {
        let axes = Self {
            y,
            length_m: length_m.max(1e-6),
            range: [range[0], range[1].max(range[0] + 1e-6)],
        };
        let _ = writeln!(
            out,
            "<text x=\"{MARGIN}\" y=\"{}\" font-weight=\"bold\">{label}</text>\n\
             <rect x=\"{MARGIN}\" y=\"{y}\" width=\"{}\" height=\"{PROFILE_HEIGHT}\" fill=\"#fbfbf9\" stroke=\"#ccc\"/>",
            y - 6.0,
            WIDTH - 2.0 * MARGIN
        );
        let step = nice((axes.range[1] - axes.range[0]) / 3.0);
        let mut value = (axes.range[0] / step).ceil() * step;
        while value <= axes.range[1] + 1e-9 {
            let [_, ty] = axes.to([0.0, value]);
            let _ = writeln!(
                out,
                "<path d=\"M{MARGIN} {ty:.1}H{}\" stroke=\"#e3e3de\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\">{}</text>",
                WIDTH - MARGIN,
                MARGIN - 5.0,
                ty + 3.5,
                short(value, step)
            );
            value += step;
        }
        let step = nice(axes.length_m / 6.0);
        let mut along = 0.0;
        while along <= axes.length_m * (1.0 + 1e-9) {
            let [tx, _] = axes.to([along, axes.range[0]]);
            let _ = writeln!(
                out,
                "<text x=\"{tx:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"10\">{}</text>",
                y + PROFILE_HEIGHT + 13.0,
                if along == 0.0 {
                    "0 m".to_owned()
                } else {
                    short(along, step)
                }
            );
            along += step;
        }
        axes
    }

    fn to(&self, [along, value]: Point) -> Point {
        let f = (value - self.range[0]) / (self.range[1] - self.range[0]);
        [
            MARGIN + along / self.length_m * (WIDTH - 2.0 * MARGIN),
            self.y + PROFILE_HEIGHT * (1.0 - f.clamp(0.0, 1.0)),
        ]
    }

    fn line(&self, out: &mut String, points: &[Point], colour: &str, width: f64) {
        line(out, points.iter().map(|p| self.to(*p)), colour, width);
    }
}

/// The nearest 1, 2 or 5 times a power of ten, not over `x`.
fn nice(x: f64) -> f64 {
    let power = 10f64.powf(x.max(1e-9).log10().floor());
    [5.0, 2.0, 1.0]
        .into_iter()
        .find(|k| k * power <= x)
        .unwrap_or(1.0)
        * power
}

/// A number with the decimals that its step needs.
fn short(value: f64, step: f64) -> String {
    format!(
        "{value:.*}",
        (-step.log10().floor()).clamp(0.0, 6.0) as usize
    )
}
