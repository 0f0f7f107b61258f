//! `plot`: pictures are well-formed, complete in themselves, and show the route.

use crate::checking::record;
use crate::{Files, ROUTE};

#[test]
fn pictures_are_well_formed_and_fetch_nothing() {
    let files = Files::new();
    for (name, elements) in [("a.svg", 50), ("a.html", 50)] {
        files.done(&["plot", "route.toml", "-o", name]);
        let text = files.get(name);
        assert!(text.contains("bend &amp; climb") && text.contains("altitude, m"));
        assert!(!text.contains("src=") && !text.contains("href=") && !text.contains("url("));
        let start = text.find("<svg").unwrap();
        let end = text.rfind("</svg>").unwrap() + 6;
        let mut reader = quick_xml::Reader::from_str(&text[start..end]);
        let mut found = 0;
        loop {
            match reader.read_event().unwrap() {
                quick_xml::events::Event::Eof => break,
                quick_xml::events::Event::Empty(_) => found += 1,
                _ => {}
            }
        }
        assert!(found > elements, "{found}");
        assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
    }
    assert_eq!(files.refused(&["plot", "route.toml", "-o", "a.bmp"]).0, 2);
}

#[test]
fn a_png_shows_the_curve_and_its_letters() {
    let files = Files::new();
    files.done(&["plot", "route.toml", "-o", "a.png", "--width", "600"]);
    let file = std::fs::File::open(files.path("a.png")).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.width, 600);
    let dark = |rows: std::ops::Range<usize>| {
        let row = info.width as usize * 4;
        pixels[rows.start * row..rows.end * row]
            .chunks(4)
            .filter(|p| p[0] < 120)
            .count()
    };
    // The title's letters, in the first 18 rows at this scale.
    assert!(dark(0..18) > 60, "{}", dark(0..18));
    assert!(dark(60..300) > 500);
}

/// The texts of a picture.
fn texts(svg: &str) -> Vec<&str> {
    let parts = svg.split("<text").skip(1);
    parts
        .filter_map(|part| part.split_once('>')?.1.split_once("</text>"))
        .map(|(text, _)| text)
        .collect()
}

#[test]
fn waypoints_have_their_numbers_and_home_is_marked() {
    let files = Files::new();
    files.done(&["plot", "route.toml", "-o", "a.svg"]);
    let plain = files.get("a.svg");
    for number in ["10", "20", "30"] {
        let label = |text: &&str| *text == number;
        assert_eq!(texts(&plain).into_iter().filter(label).count(), 1);
    }
    assert!(!plain.contains("id=\"home\""));
    // A long number stands further from its mark, to the side of it.
    let last = ROUTE
        .replace("number = 30", "number = 30000")
        .replace("to = 30", "to = 30000");
    files.put("long.toml", &last.replace("next = 30", "next = 30000"));
    files.done(&["plot", "long.toml", "-o", "long.svg"]);
    let long = files.get("long.svg");
    let at = |part: &str| -> f64 {
        let after = part.split("x=\"").nth(1).unwrap();
        after.split('"').next().unwrap().parse().unwrap()
    };
    let (before, _) = long.split_once(">30000</text>").unwrap();
    let label = at(before.rsplit("<text").next().unwrap());
    let mark = at(before.rsplit("<circle").next().unwrap());
    assert!((label - mark).abs() > 14.0, "{label} {mark}");
    let home = ["--home", "47.3970,8.5455"];
    files.done(&[&["plot", "route.toml", "-o", "b.svg"], &home[..]].concat());
    assert!(texts(&files.get("b.svg")).contains(&"home"));
    // A home far away does not reduce the route to a dot.
    let home = ["--home", "47.9,8.5455"];
    files.done(&[&["plot", "route.toml", "-o", "c.svg"], &home[..]].concat());
    let far = files.get("c.svg");
    let beyond = |text: &&str| text.starts_with("home, 5") && text.ends_with(" km beyond");
    assert!(texts(&far).iter().any(beyond), "{:?}", texts(&far));
    let curve = |svg: &str| svg.split("stroke-width=\"4.5\"").next().unwrap().len();
    assert_eq!(curve(&far), curve(&plain));
    // A plan has a home of its own.
    files.done(&["convert", "route.toml", "route.plan"]);
    files.done(&["plot", "route.plan", "-o", "d.svg"]);
    assert!(files.get("d.svg").contains("id=\"home\""));
    let (status, printed) =
        files.refused(&["plot", "route.toml", "-o", "e.svg", "--home", "north"]);
    assert!(
        status == 2 && printed.contains("expected LAT,LON"),
        "{printed}"
    );
}

#[test]
fn a_corner_of_straight_legs_is_no_tight_curve() {
    let files = Files::new();
    let curve = ROUTE.find("[[curve]]").unwrap();
    files.put("straight.toml", &ROUTE[..curve]);
    files.done(&["plot", "straight.toml", "-o", "a.svg"]);
    let text = files.get("a.svg");
    assert!(text.contains("stroke=\"#3b528b\"") && !text.contains("radius"));
    for tight in ["#e8702a", "#c3243c\" stroke-width=\"4.5", "#d9a514"] {
        assert!(!text.contains(tight), "{tight}");
    }
    files.done(&["plot", "route.toml", "-o", "b.svg"]);
    let text = files.get("b.svg");
    assert!(text.contains("radius of curves, m") && text.contains("#d9a514"));
    // Nor is the corner where a curve begins.
    assert!(!text.contains("#c3243c\" stroke-width=\"4.5"));
}

/// Writes the log of a flight of the route.
fn fly(files: &Files, log: &str) {
    let fine = files.json(&["densify", "route.toml", "--tolerance", "0.1", "--json"]);
    let place = |v: &serde_json::Value| [&v["lat_deg"], &v["lon_deg"]].map(|x| x.as_f64().unwrap());
    let vertices: Vec<[f64; 2]> = fine["vertices"]
        .as_array()
        .unwrap()
        .iter()
        .map(place)
        .collect();
    // From 900 m away to the route, along it half a metre to the north of it, and back.
    let (home, first, last) = ([47.3905, 8.5400], vertices[0], vertices[vertices.len() - 1]);
    let way = |a: [f64; 2], b: [f64; 2]| {
        (0..40).map(move |k| {
            let f = f64::from(k) / 40.0;
            [a[0] + (b[0] - a[0]) * f, a[1] + (b[1] - a[1]) * f]
        })
    };
    let on = vertices.windows(2).flat_map(|pair| way(pair[0], pair[1]));
    let on = on.map(|[lat, lon]| [lat + 0.5 / 111_180.0, lon]);
    let flown = way(home, first).chain(on).chain(way(last, home));
    let bytes: Vec<u8> = flown
        .flat_map(|[lat, lon]| record(lat, lon, 500.0))
        .collect();
    std::fs::write(files.path(log), bytes).unwrap();
}

#[test]
fn the_deviation_of_a_flight_is_that_on_the_route() {
    let files = Files::new();
    fly(&files, "flight.tlog");
    files.done(&[
        "plot",
        "route.toml",
        "-o",
        "a.svg",
        "--flown",
        "flight.tlog",
    ]);
    let text = files.get("a.svg");
    assert!(text.contains("\"#d100a8\"") && texts(&text).contains(&"flown"));
    // The axis of the deviation ends at the tolerance, not at the 900 m of the approach; home is the place where the
    // flight started.
    let deviation = text
        .split("deviation, m")
        .nth(1)
        .unwrap()
        .split("altitude, m")
        .next()
        .unwrap();
    // Ticks of the length have no decimals.
    let of_deviation = texts(deviation).into_iter().filter(|t| t.contains('.'));
    let ticks: Vec<f64> = of_deviation.map(|t| t.parse().unwrap()).collect();
    assert!(
        ticks.len() > 2 && ticks.iter().all(|t| *t <= 2.0),
        "{ticks:?}"
    );
    assert!(texts(&text).iter().any(|t| t.starts_with("home, ")));
}

#[test]
fn a_fit_is_drawn_beside_its_track_and_a_page_has_values_and_a_scale() {
    let files = Files::new();
    files.done(&[
        "densify",
        "route.toml",
        "--tolerance",
        "0.2",
        "-o",
        "track.csv",
    ]);
    files.done(&["fit", "track.csv", "--tolerance", "1", "-o", "fit.toml"]);
    files.done(&["plot", "fit.toml", "-o", "a.svg", "--track", "track.csv"]);
    let text = files.get("a.svg");
    assert!(texts(&text).contains(&"track"));
    let fixes = files.get("track.csv").lines().count() - 1;
    let dots = text.matches("r=\"1\" fill=\"#0a6cff\"").count();
    assert_eq!(dots, fixes);
    files.done(&["plot", "route.toml", "-o", "a.html"]);
    let page = files.get("a.html");
    assert!(page.contains("id=\"scale\"") && page.contains("along the route"));
    let samples = page.split("const samples = ").nth(1).unwrap();
    let samples = samples.split(", metre = ").next().unwrap();
    let samples: Vec<[Option<f64>; 9]> = serde_json::from_str(samples).unwrap();
    let first = [47.3977434, 8.5455939, 500.0, 0.0];
    assert_eq!(samples[0][2..6], first.map(Some));
    let curved = |s: &[Option<f64>; 9]| s[7] > Some(20.0) && s[7] < Some(200.0);
    assert!(samples[0][7] == Some(0.0) && samples.iter().any(curved));
    assert!(samples.iter().all(|s| s[8].is_none()), "nothing was flown");
    files.done(&["plot", "route.toml", "-o", "dark.svg", "--dark"]);
    let dark = files.get("dark.svg");
    assert!(dark.contains("fill=\"#14171c\"") && !dark.contains("#fff"));
}

#[test]
fn a_dark_page_shows_how_far_off_the_flight_was() {
    let files = Files::new();
    fly(&files, "flight.tlog");
    let dark = [
        "plot",
        "route.toml",
        "-o",
        "a.html",
        "--flown",
        "flight.tlog",
        "--dark",
    ];
    files.done(&dark);
    let page = files.get("a.html");
    for part in [
        "background:#14171c;color:#e6e6e6",
        "fill=\"#14171c\"",
        "stroke=\"#ff7ae5\"",
        "flown deviation",
    ] {
        assert!(page.contains(part), "{part}");
    }
    // None of the colours for a light ground, except in the box of values, which is dark on both.
    for part in ["#d100a8", "#f7f7f4", "\"#fff\"", "NaN"] {
        assert!(!page.contains(part), "{part}");
    }
    let samples = page.split("const samples = ").nth(1).unwrap();
    let samples = samples.split(", metre = ").next().unwrap();
    let samples: Vec<[Option<f64>; 9]> = serde_json::from_str(samples).unwrap();
    // Half a metre north of a route with many turns.
    let flown: Vec<f64> = samples.iter().filter_map(|s| s[8]).collect();
    assert_eq!(flown.len(), samples.len());
    assert!(
        flown.iter().all(|off| *off < 0.7) && flown.iter().any(|off| *off > 0.4),
        "{flown:?}"
    );
}

#[test]
fn a_picture_without_home_names_the_option_that_marks_it() {
    let files = Files::new();
    let printed = |arguments: &[&str]| {
        let output = files.run(arguments);
        assert!(output.status.success() && output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    let plain = printed(&["plot", "route.toml", "-o", "a.svg"]);
    assert!(
        plain.contains("no home is drawn: --home LAT,LON"),
        "{plain}"
    );
    let home = printed(&[
        "plot",
        "route.toml",
        "-o",
        "a.svg",
        "--home",
        "47.3970,8.5455",
    ]);
    assert!(!home.contains("home"), "{home}");
}
