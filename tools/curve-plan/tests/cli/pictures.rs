//! `plot`: pictures are well-formed, complete in themselves, and show the route.

use crate::Files;

#[test]
fn pictures_are_well_formed_and_fetch_nothing() {
    let files = Files::new();
    for (name, elements) in [("a.svg", 50), ("a.html", 50)] {
        files.done(&["plot", "route.toml", "-o", name]);
        let text = files.get(name);
        assert!(text.contains("bend &amp; climb") && text.contains("altitude, m"));
        assert!(!text.contains("src=") && !text.contains("href=") && !text.contains("url("));
        let start = text.find("<svg").unwrap();
        let end = text.find("</svg>").unwrap() + 6;
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
