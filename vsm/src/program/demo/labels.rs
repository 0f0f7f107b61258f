//! Places the names of a picture: beside what they name, on no other name or symbol, and on as little of the lines as
//! possible. A flight begins and ends at one place, so half of its marks are there.

use std::fmt::Write as _;

/// A point of the picture, in pixels: right, down.
pub(super) type Pixel = (f64, f64);

/// What a picture has already, and the names that wait for a place in it.
pub(super) struct Labels {
    frame: Area,
    symbols: Vec<Area>,
    /// Points of the lines, close enough that a line passes under no name unseen.
    lines: Vec<Pixel>,
    names: Vec<Name>,
}

/// A rectangle: left, top, right, bottom.
#[derive(Debug, Clone, Copy)]
struct Area {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

struct Name {
    of: Pixel,
    text: String,
    colour: &'static str,
    bold: bool,
}

impl Labels {
    /// Of a picture, or a part of it, that begins at `left`, `top`.
    pub(super) fn new((left, top): Pixel, width: f64, height: f64) -> Labels {
        let (right, bottom) = (left + width, top + height);
        let frame = Area {
            left,
            top,
            right,
            bottom,
        };
        Labels {
            frame,
            symbols: Vec::new(),
            lines: Vec::new(),
            names: Vec::new(),
        }
    }

    /// No name stands on this symbol.
    pub(super) fn symbol(&mut self, (x, y): Pixel, radius: f64) {
        self.symbols.push(Area {
            left: x - radius,
            top: y - radius,
            right: x + radius,
            bottom: y + radius,
        });
    }

    /// Names keep off this line where they can.
    pub(super) fn line(&mut self, points: impl Iterator<Item = Pixel>) {
        let mut last: Option<Pixel> = None;
        for (x, y) in points {
            if let Some((from_x, from_y)) = last {
                let parts = ((x - from_x).hypot(y - from_y) / SAMPLE).ceil().max(1.0);
                for n in 1..=parts as u32 {
                    let t = f64::from(n) / parts;
                    self.lines
                        .push((from_x + t * (x - from_x), from_y + t * (y - from_y)));
                }
            }
            last = Some((x, y));
        }
    }

    /// A name for what is at a place, once everything is drawn.
    pub(super) fn name(&mut self, of: Pixel, text: impl Into<String>, colour: &'static str) {
        self.add(of, text.into(), colour, false);
    }

    /// As [`Labels::name`], in bold.
    pub(super) fn letter(&mut self, of: Pixel, letter: char, colour: &'static str) {
        self.add(of, letter.to_string(), colour, true);
    }

    fn add(&mut self, of: Pixel, text: String, colour: &'static str, bold: bool) {
        self.names.push(Name {
            of,
            text,
            colour,
            bold,
        });
    }

    /// Writes the names, each where it stands best once those before it have their places.
    pub(super) fn write(mut self, svg: &mut String) {
        for name in std::mem::take(&mut self.names) {
            let place = self.place(&name);
            self.symbols.push(place);
            let weight = if name.bold {
                " font-weight=\"bold\""
            } else {
                ""
            };
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{}\"{weight}>{}</text>",
                place.left,
                place.bottom - DESCENT,
                name.colour,
                escaped(&name.text)
            );
        }
    }

    fn place(&self, name: &Name) -> Area {
        let (x, y) = name.of;
        let wide = if name.bold { BOLD_WIDTH } else { WIDTH };
        let half_width = wide * name.text.chars().count() as f64 / 2.0;
        let half_height = HEIGHT / 2.0;
        let candidates = (0..RINGS * DIRECTIONS).map(|n| {
            let (ring, direction) = (n / DIRECTIONS, n % DIRECTIONS);
            // Right and above is tried first, as on maps.
            let angle = (f64::from(direction) / f64::from(DIRECTIONS)).mul_add(-360.0, 45.0);
            let (up, right) = angle.to_radians().sin_cos();
            let away = f64::from(ring).mul_add(RING, NEAREST);
            let centre_x = x + right * (away + half_width);
            let centre_y = y - up * (away + half_height);
            let place = Area {
                left: centre_x - half_width,
                top: centre_y - half_height,
                right: centre_x + half_width,
                bottom: centre_y + half_height,
            };
            (self.cost(&place) + f64::from(n) * 0.1, place)
        });
        let best = candidates.min_by(|(a, _), (b, _)| a.total_cmp(b));
        best.map_or(self.frame, |(_, place)| place)
    }

    fn cost(&self, place: &Area) -> f64 {
        let symbols: f64 = self.symbols.iter().map(|one| one.common(place)).sum();
        let lines = self.lines.iter().filter(|(x, y)| {
            (place.left..place.right).contains(x) && (place.top..place.bottom).contains(y)
        });
        let area = (place.right - place.left) * (place.bottom - place.top);
        let outside = area - self.frame.common(place);
        100.0 * symbols + 100.0 * outside + 2.0 * lines.count() as f64
    }
}

impl Area {
    /// The area that both have.
    fn common(&self, other: &Area) -> f64 {
        let width = self.right.min(other.right) - self.left.max(other.left);
        let height = self.bottom.min(other.bottom) - self.top.max(other.top);
        width.max(0.0) * height.max(0.0)
    }
}

/// A text as it stands in an SVG.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// What a character of 13 pixels takes on average, and how far it reaches under its line.
const WIDTH: f64 = 8.0;
const BOLD_WIDTH: f64 = 10.0;
const HEIGHT: f64 = 13.0;
const DESCENT: f64 = 2.0;
/// How far from the middle of a symbol the nearest names begin, and each ring of places further.
const NEAREST: f64 = 5.0;
const RING: f64 = 7.0;
const RINGS: u32 = 8;
const DIRECTIONS: u32 = 16;
const SAMPLE: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(labels: &Labels, names: &[Name]) -> Vec<Area> {
        let mut copy = Labels::new((0.0, 0.0), 400.0, 300.0);
        copy.symbols = labels.symbols.clone();
        copy.lines = labels.lines.clone();
        let mut places = Vec::new();
        for name in names {
            let place = copy.place(name);
            copy.symbols.push(place);
            places.push(place);
        }
        places
    }

    #[test]
    fn names_of_one_place_stand_beside_each_other_off_its_symbol_and_within_the_picture() {
        for at in [(200.0, 150.0), (0.0, 0.0), (398.0, 290.0)] {
            let mut labels = Labels::new((0.0, 0.0), 400.0, 300.0);
            labels.symbol(at, 6.0);
            labels.line([(0.0, 150.0), (400.0, 150.0)].into_iter());
            for (n, text) in ["home", "1", "A", "B", "E", "F"].into_iter().enumerate() {
                labels.add(at, text.to_owned(), "#000", n > 1);
            }
            let names = std::mem::take(&mut labels.names);
            let places = placed(&labels, &names);
            for (n, place) in places.iter().enumerate() {
                assert!(place.left >= 0.0 && place.right <= 400.0, "{place:?}");
                assert!(place.top >= 0.0 && place.bottom <= 300.0, "{place:?}");
                assert_eq!(labels.symbols[0].common(place), 0.0, "{place:?}");
                for other in &places[..n] {
                    assert_eq!(place.common(other), 0.0, "{place:?} {other:?}");
                }
            }
        }
    }

    #[test]
    fn a_name_keeps_off_a_line_that_it_can_avoid() {
        let mut labels = Labels::new((0.0, 0.0), 400.0, 300.0);
        labels.symbol((200.0, 150.0), 5.0);
        labels.line([(200.0, 150.0), (300.0, 50.0)].into_iter());
        labels.name((200.0, 150.0), "10", "#000");
        let names = std::mem::take(&mut labels.names);
        let place = placed(&labels, &names)[0];
        let under = labels.lines.iter().filter(|(x, y)| {
            (place.left..place.right).contains(x) && (place.top..place.bottom).contains(y)
        });
        assert_eq!(under.count(), 0, "{place:?}");
    }
}
