//! Whole flights of `vsm run` between real sockets whose datagrams are lost, duplicated, reordered, late and damaged, the
//! process killed in the middle; `docs/guide/reliability.md` holds the table.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test program bad_sockets` writes the table;
//! `VSM_LATE_S=2 cargo test -p vsm --test program bad_sockets` has the late one up to 2 s late, and takes six minutes.
//!
//! The bounds come from the same flights in virtual time (`flight::lossy_links`), where thirty of thirty are completed
//! at each rate and none gives more than two orders again, nor uploads for longer than 25 s (11 s below 40 %). Here time is
//! real, and the machine does something else, too: two to three times that is allowed, and at the worst rate one flight of
//! three may fail.

use std::fmt::Write as _;
use std::thread;

use kit::bridge::flight::{Outcome, fly, hold_to_page};
use kit::bridge::{Faults, Processes};

/// A row of the table, and what its flights must not fall short of.
struct Row {
    name: &'static str,
    faults: Faults,
    flights: u64,
    min_completed: u32,
    /// Orders that were refused and given again, in all flights of the row.
    max_again: u32,
    max_upload_s: f64,
}

impl Row {
    fn lossy(name: &'static str, faults: Faults, max_again: u32) -> Row {
        Row {
            name,
            faults,
            flights: 1,
            min_completed: 1,
            max_again,
            max_upload_s: 30.0,
        }
    }
}

/// Flies side by side: the flights mostly wait.
fn flown(row: &Row) -> Outcome {
    let (faults, flights) = (row.faults, 1..=row.flights);
    let flights: Vec<_> = flights
        .map(|seed| {
            thread::spawn(move || {
                let mut outcome = Outcome::default();
                let mut processes = Processes::start(seed, faults, SPEED);
                if faults.delay.1.as_secs() >= 1 {
                    processes.longest *= 3;
                }
                let flown = fly(&mut processes, &mut outcome);
                outcome.count(flown);
                outcome
            })
        })
        .collect();
    let mut all = Outcome::default();
    for flight in flights {
        all.add(flight.join().expect("its own panic is above"));
    }
    all
}

fn judged(row: &Row, outcome: &Outcome) -> String {
    let name = row.name;
    assert_eq!((outcome.lost, outcome.twice), (0, 0), "{name}: {outcome:?}");
    assert!(
        outcome.completed >= row.min_completed,
        "{name}: {outcome:?}"
    );
    assert!(outcome.again <= row.max_again, "{name}: {outcome:?}");
    assert!(outcome.load_s <= row.max_upload_s, "{name}: {outcome:?}");
    let completed = if row.min_completed < outcome.flights {
        "most of them"
    } else {
        "yes"
    };
    let Outcome { lost, twice, .. } = outcome;
    format!("| {name} | {completed} | {lost} | {twice} |")
}

#[test]
fn the_table_of_outcomes_is_up_to_date() {
    let late_s = std::env::var("VSM_LATE_S").ok();
    let late_s: f64 = late_s.map_or(0.5, |text| text.parse().expect("seconds"));
    let rows = [
        Row::lossy("0 % lost", Faults::lossy(0.0), 1),
        Row::lossy("10 % lost", Faults::lossy(0.1), 1),
        Row::lossy("20 % lost", Faults::lossy(0.2), 2),
        Row::lossy("30 % lost", Faults::lossy(0.3), 4),
        Row {
            flights: 3,
            min_completed: 2,
            max_upload_s: 90.0,
            ..Row::lossy("40 % lost", Faults::lossy(0.4), 12)
        },
        Row {
            max_upload_s: 60.0 * late_s.max(1.0),
            ..Row::lossy("10 % lost, up to 0.5 s late", Faults::late(late_s), 4)
        },
    ];
    let outcomes = thread::scope(|scope| {
        let flights = rows.each_ref().map(|row| scope.spawn(|| flown(row)));
        flights.map(|flight| flight.join().expect("its own panic is above"))
    });
    let mut table = String::from(
        "| sockets, each way | flight completed | accepted and lost | carried out twice |\n|---|---|---|---|\n",
    );
    for (row, outcome) in rows.iter().zip(&outcomes) {
        writeln!(table, "{}", judged(row, outcome)).expect("a String takes all");
    }
    hold_to_page("sockets", &table);
}

/// How much faster than real time the vehicle flies; its timeouts are as much shorter.
const SPEED: f64 = 2.0;
