//! The picture: a map above, the deviation and the altitude along the route below.

use std::fmt::Write;

use cucs::formats::escaped;

use super::scene::{Point, Scene};

/// Width of the picture, in its own units.
const WIDTH: f64 = 1000.0;
const MAP_HEIGHTS: (f64, f64) = (300.0, 760.0);
/// Height of one profile's frame.
const PROFILE_HEIGHT: f64 = 130.0;
/// Height of the map taken by its legend, scale and margins.
const FURNITURE: f64 = 120.0;
/// Height of the legend's band at the bottom of the map.
const LEGEND: f64 = 52.0;
/// Space to the left of map and profiles, for the numbers of the axes.
const MARGIN: f64 = 56.0;
/// Height of the title and the line below it.
const TITLE: f64 = 52.0;

/// The greatest radius of each class of curves, m; the first class is straight.
const CLASSES: [f64; 7] = [f64::INFINITY, 800.0, 400.0, 200.0, 100.0, 50.0, 25.0];

/// Colours.
pub(crate) struct Theme {
    /// For the classes of radii, from straight to tight.
    classes: [&'static str; 7],
    pub(super) paper: &'static str,
    panel: &'static str,
    frame: &'static str,
    grid: &'static str,
    pub(super) ink: &'static str,
    faint: &'static str,
    /// Deviation as planned, and its limit.
    planned: &'static str,
    limit: &'static str,
    altitude: &'static str,
    flown: &'static str,
    track: &'static str,
}

pub(crate) const LIGHT: Theme = Theme {
    classes: [
        "#3b528b", "#2c728e", "#21918c", "#3fbc73", "#d9a514", "#e8702a", "#c3243c",
    ],
    paper: "#fff",
    panel: "#f7f7f4",
    frame: "#ccc",
    grid: "#e3e3de",
    ink: "#222",
    faint: "#888",
    planned: "#2c728e",
    limit: "#c3243c",
    altitude: "#5b4b8a",
    flown: "#d100a8",
    track: "#0a6cff",
};

pub(crate) const DARK: Theme = Theme {
    classes: [
        "#7f9bea", "#56b4d3", "#3ecfc4", "#6fe08d", "#f0c648", "#ff9a57", "#ff6b7d",
    ],
    paper: "#14171c",
    panel: "#1c2027",
    frame: "#454b55",
    grid: "#2b313a",
    ink: "#e6e6e6",
    faint: "#9aa0a8",
    planned: "#56b4d3",
    limit: "#ff6b7d",
    altitude: "#b9a5ff",
    flown: "#ff7ae5",
    track: "#8ab8ff",
};

/// Draws a scene.
pub(crate) fn draw(scene: &Scene, theme: &Theme) -> String {
    let climbs = scene
        .curve
        .iter()
        .any(|s| (s.alt_m - scene.curve[0].alt_m).abs() > 0.01);
    let profiles = if climbs { 2.0 } else { 1.0 };
    let view = View::of(scene);
    let height = TITLE + view.height + profiles * (PROFILE_HEIGHT + 44.0) + 10.0;
    let (paper, ink) = (theme.paper, theme.ink);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
         font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"{ink}\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"{paper}\"/>\n\
         <text x=\"{MARGIN}\" y=\"22\" font-size=\"16\" font-weight=\"bold\">{}</text>\n",
        escaped(&scene.title)
    );
    let length_m = scene.curve.last().map_or(0.0, |s| s.along_m);
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"42\">{:.2} km, {} waypoints, {} vertices, tolerance {} m, proven {:.3} m</text>",
        MARGIN,
        length_m / 1000.0,
        scene.joints.len(),
        scene.vertices.len(),
        scene.tolerance_m,
        scene.bound_m
    );
    map(&mut out, scene, &view, theme);
    let mut y = TITLE + view.height + 34.0;
    deviation(&mut out, scene, y, length_m, theme);
    if climbs {
        y += PROFILE_HEIGHT + 44.0;
        let altitude: Vec<Point> = scene.curve.iter().map(|s| [s.along_m, s.alt_m]).collect();
        let metres = || altitude.iter().map(|p| p[1]);
        let low = metres().fold(f64::INFINITY, f64::min);
        let high = metres().fold(f64::NEG_INFINITY, f64::max);
        let axes = Axes::draw(&mut out, y, length_m, [low, high], "altitude, m", theme);
        axes.line(&mut out, &altitude, theme.altitude, 1.6);
    }
    out + "</svg>\n"
}

/// What a page shows of the curve under the pointer, and how many units of the picture a metre has. For each sample:
/// x and y in the picture, latitude, longitude, altitude, length, deviation, radius (0 on a straight), flown
/// deviation (null where nothing was flown near).
pub(crate) fn hover(scene: &Scene) -> (serde_json::Value, f64) {
    let view = View::of(scene);
    let every = scene.curve.len().div_ceil(MAX_HOVERED).max(1);
    let round = |x: f64, digits: i32| (x * 10f64.powi(digits)).round() / 10f64.powi(digits);
    let samples = scene.curve.iter().step_by(every).map(|s| {
        let [x, y] = view.to(s.at);
        let radius = Some(s.radius_m).filter(|r| r.is_finite()).unwrap_or(0.0);
        serde_json::json!([
            round(x, 2),
            round(y, 2),
            round(s.place[0], 7),
            round(s.place[1], 7),
            round(s.alt_m, 1),
            round(s.along_m, 1),
            round(s.deviation_m, 2),
            round(radius, 1),
            flown_beside(scene, s.along_m).map(|flown| round(flown, 2)),
        ])
    });
    (samples.collect(), view.scale)
}

/// The distance, m, from the route of the flight where it was nearest to this length along the route.
fn flown_beside(scene: &Scene, along_m: f64) -> Option<f64> {
    let apart = |flown: &&[f64; 2]| (flown[0] - along_m).abs();
    let flown = scene.flown.deviation.iter();
    let nearest = flown.min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    (apart(&nearest) <= FLOWN_NEAR_M).then_some(nearest[1])
}

/// A position of a flight counts for this length of the route to both sides, m: beyond it nothing was flown, or
/// recorded.
const FLOWN_NEAR_M: f64 = 20.0;

/// Samples in a page at most: a page of any route stays quick to search.
const MAX_HOVERED: usize = 4_000;

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
            TITLE + (self.height - LEGEND) / 2.0 - (p[1] - self.middle[1]) * self.scale,
        ]
    }

    fn line(&self, out: &mut String, points: &[Point], colour: &str, width: f64) {
        line(out, points.iter().map(|p| self.to(*p)), colour, width);
    }
}

fn line(out: &mut String, points: impl Iterator<Item = Point>, colour: &str, width: f64) {
    let d = path(points);
    if d.is_empty() {
        return;
    }
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

fn map(out: &mut String, scene: &Scene, view: &View, theme: &Theme) {
    let (width, height) = (WIDTH - 24.0, view.height);
    let Theme {
        paper, ink, faint, ..
    } = theme;
    // What is outside the map, such as a far home or an approach, is clipped at its frame and above the legend.
    let above = height - LEGEND;
    let _ = writeln!(
        out,
        "<rect x=\"12\" y=\"{TITLE}\" width=\"{width}\" height=\"{height}\" fill=\"{}\" stroke=\"{}\"/>\n\
         <svg x=\"12\" y=\"{TITLE}\" width=\"{width}\" height=\"{above}\" viewBox=\"12 {TITLE} {width} {above}\">\n<g id=\"map\">",
        theme.panel, theme.frame
    );
    for [end, control] in &scene.arms {
        let (a, b) = (view.to(*end), view.to(*control));
        let _ = writeln!(
            out,
            "<path d=\"M{:.2} {:.2}L{:.2} {:.2}\" stroke=\"{faint}\" stroke-width=\"0.8\"/>\
             <rect x=\"{:.2}\" y=\"{:.2}\" width=\"5\" height=\"5\" fill=\"{paper}\" stroke=\"{faint}\" stroke-width=\"0.8\"/>",
            a[0],
            a[1],
            b[0],
            b[1],
            b[0] - 2.5,
            b[1] - 2.5
        );
    }
    curve(out, scene, view, theme);
    view.line(out, &scene.vertices, ink, 0.7);
    view.line(out, &scene.track.points, theme.track, 1.2);
    view.line(out, &scene.flown.points, theme.flown, 1.2);
    for p in &scene.vertices {
        let [x, y] = view.to(*p);
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"2.1\" fill=\"{ink}\" stroke=\"{}\" stroke-width=\"0.6\"/>",
            theme.panel
        );
    }
    // Where there are many waypoints only some are named.
    let every = scene.joints.len().div_ceil(MAX_NAMED).max(1);
    for (k, (p, number)) in scene.joints.iter().enumerate() {
        let [x, y] = view.to(*p);
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"4.2\" fill=\"{paper}\" stroke=\"{ink}\" stroke-width=\"1.4\"/>"
        );
        if k % every == 0 {
            let [dx, dy] = clear_of_legs(scene, k);
            let number = number.to_string();
            // A longer number needs more room beside its mark than above it.
            let aside = 7.5 + 3.5 * number.len() as f64;
            let at = [x + aside * dx, y - 14.0 * dy + 4.0];
            label(out, at, "middle", &number, theme);
        }
    }
    if let Some(home) = scene.home {
        draw_home(out, view, home, theme);
    }
    out.push_str("</g>\n</svg>\n");
    furniture(out, view, scene, theme);
}

/// The direction from a waypoint, east and north, in which none of its legs lies.
fn clear_of_legs(scene: &Scene, k: usize) -> Point {
    let (here, _) = scene.joints[k];
    let towards = |joint: Option<&(Point, usize)>| {
        let [dx, dy] = joint.map_or([0.0; 2], |(to, _)| [to[0] - here[0], to[1] - here[1]]);
        let length = dx.hypot(dy).max(1e-9);
        [dx / length, dy / length]
    };
    let back = towards(k.checked_sub(1).and_then(|before| scene.joints.get(before)));
    let on = towards(scene.joints.get(k + 1));
    let away = [-back[0] - on[0], -back[1] - on[1]];
    let length = away[0].hypot(away[1]);
    if length > 0.3 {
        [away[0] / length, away[1] / length]
    } else {
        // Both legs in one line: to the side.
        [on[1], -on[0]]
    }
}

/// A text with an outline, so that it can be read on top of lines.
fn label(out: &mut String, [x, y]: Point, anchor: &str, text: &str, theme: &Theme) {
    let _ = writeln!(
        out,
        "<text class=\"label\" x=\"{x:.2}\" y=\"{y:.2}\" text-anchor=\"{anchor}\" font-size=\"11\" stroke=\"{}\" stroke-width=\"3\" \
         stroke-linejoin=\"round\" paint-order=\"stroke\">{text}</text>",
        theme.panel
    );
}

/// Draws a house; where home is outside the map, how far it is, at the edge towards it.
fn draw_home(out: &mut String, view: &View, home: Point, theme: &Theme) {
    let [x, y] = view.to(home);
    let at = [
        x.clamp(40.0, WIDTH - 40.0),
        y.clamp(TITLE + 24.0, TITLE + view.height - LEGEND - 12.0),
    ];
    let _ = writeln!(
        out,
        "<path id=\"home\" transform=\"translate({:.2} {:.2})\" d=\"M0 -7L8 0H5.5V7H-5.5V0H-8z\" fill=\"{}\" stroke=\"{}\" stroke-width=\"1.4\"/>",
        at[0], at[1], theme.paper, theme.ink
    );
    let away_m = (x - at[0]).hypot(y - at[1]) / view.scale;
    let text = match away_m {
        m if m < 1.0 => "home".to_owned(),
        m if m < 1000.0 => format!("home, {m:.0} m beyond"),
        m => format!("home, {:.1} km beyond", m / 1000.0),
    };
    let (dx, anchor) = if at[0] > WIDTH / 2.0 {
        (-12.0, "end")
    } else {
        (12.0, "start")
    };
    label(out, [at[0] + dx, at[1] + 4.0], anchor, &text, theme);
}

/// The curve, in runs of one radius class.
fn curve(out: &mut String, scene: &Scene, view: &View, theme: &Theme) {
    let class = |radius_m: f64| {
        CLASSES
            .iter()
            .rposition(|&max| radius_m <= max)
            .unwrap_or(0)
    };
    let mut k = 0;
    while k + 1 < scene.curve.len() {
        // A chord between a curve and a straight belongs to the straighter of its ends.
        let of = |k: usize| class(scene.curve[k].radius_m.max(scene.curve[k + 1].radius_m));
        let here = of(k);
        let mut end = k + 1;
        while end + 1 < scene.curve.len() && of(end) == here {
            end += 1;
        }
        let d = path(scene.curve[k..=end].iter().map(|s| view.to(s.at)));
        let _ = writeln!(
            out,
            "<path d=\"{d}\" fill=\"none\" stroke=\"{}\" stroke-width=\"4.5\" stroke-linecap=\"round\" stroke-linejoin=\"round\"/>",
            theme.classes[here]
        );
        k = end;
    }
}

/// North, scale, and what the colours and marks mean.
fn furniture(out: &mut String, view: &View, scene: &Scene, theme: &Theme) {
    let Theme {
        paper, ink, faint, ..
    } = theme;
    let (x, y) = (WIDTH - 46.0, TITLE + 22.0);
    let _ = writeln!(
        out,
        "<path d=\"M{x} {y}l7 26l-7 -6l-7 6z\" fill=\"{ink}\"/><text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"bold\">N</text>",
        y + 40.0
    );
    let bar_m = nice(150.0 / view.scale);
    let bar = bar_m * view.scale;
    let (x, y) = (WIDTH - 40.0 - bar, TITLE + view.height - 18.0);
    let text = if bar_m >= 1000.0 {
        format!("{} km", bar_m / 1000.0)
    } else {
        format!("{bar_m} m")
    };
    let _ = writeln!(
        out,
        "<path d=\"M{x:.1} {:.1}v6h{bar:.1}v-6\" fill=\"none\" stroke=\"{ink}\" stroke-width=\"1.5\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>",
        y - 6.0,
        x + bar / 2.0,
        y - 8.0
    );
    let (mut x, y) = (28.0, TITLE + view.height - 18.0);
    // Without a curve there are no radii to explain.
    if !scene.arms.is_empty() {
        let _ = writeln!(
            out,
            "<text x=\"{x}\" y=\"{}\">radius of curves, m</text>",
            y - 16.0
        );
        for (k, colour) in theme.classes.iter().enumerate() {
            let text = match CLASSES.get(k + 1) {
                Some(next) => format!("&gt; {next}"),
                None => format!("&lt; {}", CLASSES[k]),
            };
            let _ = writeln!(
                out,
                "<rect x=\"{x}\" y=\"{}\" width=\"46\" height=\"6\" fill=\"{colour}\"/><text x=\"{x}\" y=\"{}\" font-size=\"10\">{text}</text>",
                y - 11.0,
                y + 7.0
            );
            x += 48.0;
        }
        x += 16.0;
    }
    let mut mark = |shape: String, text: &str| {
        let _ = writeln!(
            out,
            "<g transform=\"translate({x} {})\">{shape}</g><text x=\"{}\" y=\"{y}\">{text}</text>",
            y - 4.0,
            x + 12.0
        );
        x += 30.0 + 7.0 * text.len() as f64;
    };
    let line =
        |colour: &str| format!("<path d=\"M-6 0h12\" stroke=\"{colour}\" stroke-width=\"1.5\"/>");
    mark(
        format!("<circle r=\"4.2\" fill=\"{paper}\" stroke=\"{ink}\" stroke-width=\"1.4\"/>"),
        "waypoint",
    );
    if !scene.arms.is_empty() {
        let square = "<rect x=\"-2.5\" y=\"-2.5\" width=\"5\" height=\"5\"";
        mark(
            format!("{square} fill=\"{paper}\" stroke=\"{faint}\"/>"),
            "control",
        );
    }
    mark(format!("<circle r=\"1.9\" fill=\"{ink}\"/>"), "vertex");
    if !scene.track.points.is_empty() {
        mark(line(theme.track), "track");
    }
    if !scene.flown.points.is_empty() {
        mark(line(theme.flown), "flown");
    }
}

fn deviation(out: &mut String, scene: &Scene, y: f64, length_m: f64, theme: &Theme) {
    let planned: Vec<Point> = scene
        .curve
        .iter()
        .map(|s| [s.along_m, s.deviation_m])
        .collect();
    let measured = [
        (&scene.track.deviation, theme.track),
        (&scene.flown.deviation, theme.flown),
    ];
    let worst = measured
        .iter()
        .flat_map(|(deviation, _)| deviation.iter().map(|d| d[1]))
        .fold(scene.tolerance_m * 1.15, f64::max);
    let axes = Axes::draw(out, y, length_m, [0.0, worst], "deviation, m", theme);
    for (deviation, colour) in measured {
        for d in deviation {
            let [x, y] = axes.to(*d);
            let _ = write!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1\" fill=\"{colour}\"/>"
            );
        }
        out.push('\n');
    }
    axes.line(out, &planned, theme.planned, 1.0);
    let limit = format!("{}\" stroke-dasharray=\"6 4", theme.limit);
    axes.line(
        out,
        &[[0.0, scene.tolerance_m], [length_m, scene.tolerance_m]],
        &limit,
        1.2,
    );
}

/// Waypoints that are named at most.
const MAX_NAMED: usize = 60;

/// A profile's frame.
struct Axes {
    y: f64,
    length_m: f64,
    range: [f64; 2],
}

impl Axes {
    fn draw(
        out: &mut String,
        y: f64,
        length_m: f64,
        range: [f64; 2],
        label: &str,
        theme: &Theme,
    ) -> Self {
        let axes = Self {
            y,
            length_m: length_m.max(1e-6),
            range: [range[0], range[1].max(range[0] + 1e-6)],
        };
        let _ = writeln!(
            out,
            "<text x=\"{MARGIN}\" y=\"{}\" font-weight=\"bold\">{label}</text>\n\
             <rect x=\"{MARGIN}\" y=\"{y}\" width=\"{}\" height=\"{PROFILE_HEIGHT}\" fill=\"{}\" stroke=\"{}\"/>",
            y - 6.0,
            WIDTH - 2.0 * MARGIN,
            theme.panel,
            theme.frame
        );
        let step = nice((axes.range[1] - axes.range[0]) / 3.0);
        let mut value = (axes.range[0] / step).ceil() * step;
        while value <= axes.range[1] + 1e-9 {
            let [_, ty] = axes.to([0.0, value]);
            let _ = writeln!(
                out,
                "<path d=\"M{MARGIN} {ty:.1}H{}\" stroke=\"{}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\">{}</text>",
                WIDTH - MARGIN,
                theme.grid,
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
