//! What the benches' figures are held against.

use std::collections::BTreeMap;

/// The figures of a run, by their name: median, least, greatest.
#[derive(Debug, Default)]
pub(super) struct Figures(BTreeMap<String, [f64; 3]>);

impl Figures {
    /// Takes `figure NAME MEDIAN MIN MAX`, as `kit::measure::Spread::figure` writes it; other lines are no figures.
    pub(super) fn add(&mut self, line: &str) {
        let words: Vec<&str> = line.split(' ').collect();
        if let ["figure", name, median, min, max] = words[..]
            && let (Ok(median), Ok(min), Ok(max)) = (median.parse(), min.parse(), max.parse())
        {
            self.0.insert(name.to_owned(), [median, min, max]);
        }
    }
}

struct Goal {
    what: &'static str,
    figure: &'static str,
    /// At most this is the goal.
    bound: f64,
    unit: &'static str,
    digits: usize,
}

const fn goal(what: &'static str, figure: &'static str, bound: f64, unit: &'static str) -> Goal {
    Goal {
        what,
        figure,
        bound,
        unit,
        digits: if bound < 5.0 {
            2
        } else if bound < 1_000.0 {
            1
        } else {
            0
        },
    }
}

const GOALS: [Goal; 16] = [
    goal(
        "CPU a message at 1,000/s, of mavlink-router's",
        "cpu-of-router-1000",
        0.7,
        "",
    ),
    goal(
        "CPU a message at 20,000/s, of mavlink-router's",
        "cpu-of-router-20000",
        0.5,
        "",
    ),
    goal(
        "receive 40 bytes, of the C library by -O2",
        "receive-40-of-c",
        0.25,
        "",
    ),
    goal(
        "receive 40 bytes, of the C library by -O3 -march=native",
        "receive-40-of-c-native",
        0.25,
        "",
    ),
    goal(
        "receive 266 bytes, of the C library by -O2",
        "receive-266-of-c",
        0.12,
        "",
    ),
    goal(
        "receive 266 bytes, of the C library by -O3 -march=native",
        "receive-266-of-c-native",
        0.12,
        "",
    ),
    goal("wake-ups while idle", "idle-wakeups", 5.0, "/s"),
    goal(
        "added to a bare echo at 1,000/s, p99",
        "added-p99-us",
        150.0,
        " us",
    ),
    goal(
        "1,000 vehicles: of a core",
        "fleet-1000-core-percent",
        60.0,
        " %",
    ),
    goal(
        "1,000 vehicles: mode change to 3001, p99",
        "fleet-1000-mode-p99-us",
        2_000.0,
        " us",
    ),
    goal(
        "1,000 vehicles, `pack`: of a core",
        "fleet-1000-packed-core-percent",
        60.0,
        " %",
    ),
    goal(
        "1,000 vehicles, `pack`: mode change to 3001, p99",
        "fleet-1000-packed-mode-p99-us",
        2_000.0,
        " us",
    ),
    goal(
        "1,000 vehicles: memory",
        "fleet-1000-memory-mb",
        100.0,
        " MB",
    ),
    goal(
        "500 waypoints, of pymavlink's upload and read-back",
        "waypoints-of-pymavlink",
        1.3,
        "",
    ),
    goal(
        "of which upload and read-back by the bridge",
        "waypoints-transfer-of-pymavlink",
        1.3,
        "",
    ),
    goal("sticks at 50 Hz, p99", "sticks-p99-us", 2_000.0, " us"),
];

/// Goals, figures and verdicts in Markdown.
pub(super) fn table(figures: &Figures) -> String {
    let mut out = "| what | measured | goal | verdict |\n|---|---|---|---|\n".to_owned();
    for goal in &GOALS {
        let Goal {
            what,
            bound,
            unit,
            digits,
            ..
        } = goal;
        let found = figures.0.get(goal.figure);
        let measured = found.map_or("-".to_owned(), |[median, min, max]| {
            format!("{median:.digits$} ({min:.digits$} to {max:.digits$}){unit}")
        });
        let verdict = found.map_or("not measured", |figure| verdict(*figure, *bound));
        out += &format!("| {what} | {measured} | at most {bound}{unit} | {verdict} |\n");
    }
    out
}

/// The median decides; where turns disagree with it, that is said.
fn verdict([median, min, max]: [f64; 3], bound: f64) -> &'static str {
    match (median <= bound, min <= bound, max <= bound) {
        (true, _, true) => "met",
        (true, _, false) => "met, not in every turn",
        (false, true, _) => "missed, met in some turns",
        (false, false, _) => "missed",
    }
}

/// Each figure that was measured, as a part of its goal: what, and median, least, greatest.
pub(super) fn shares(figures: &Figures) -> Vec<(&'static str, [f64; 3])> {
    let share = |goal: &Goal| {
        let figure = figures.0.get(goal.figure)?;
        Some((goal.what, figure.map(|value| value / goal.bound)))
    };
    GOALS.iter().filter_map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_judged_by_its_median_and_its_spread_is_shown() {
        let mut figures = Figures::default();
        for line in [
            "figure cpu-of-router-1000 0.6000 0.5000 0.6500",
            "figure cpu-of-router-20000 0.4000 0.3000 0.6000",
            "figure receive-40-of-c 0.2600 0.2400 0.3000",
            "figure sticks-p99-us 2500.0 2100.0 4000.0",
            "figure unknown 1 1 1",
            "no figure at all",
        ] {
            figures.add(line);
        }
        let table = table(&figures);
        for row in [
            "mavlink-router's | 0.60 (0.50 to 0.65) | at most 0.7 | met |",
            "mavlink-router's | 0.40 (0.30 to 0.60) | at most 0.5 | met, not in every turn |",
            "by -O2 | 0.26 (0.24 to 0.30) | at most 0.25 | missed, met in some turns |",
            "p99 | 2500 (2100 to 4000) us | at most 2000 us | missed |",
            "memory | - | at most 100 MB | not measured |",
        ] {
            assert!(table.contains(row), "{row}\n{table}");
        }
        let shares = shares(&figures);
        assert_eq!(shares.len(), 4, "{shares:?}");
        assert!((shares[3].1[0] - 1.25).abs() < 1e-9, "{shares:?}");
    }
}
