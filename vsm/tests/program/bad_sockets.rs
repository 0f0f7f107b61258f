//! Whole flights of `vsm run` between real sockets whose datagrams are lost, doubled, overtaken, late, bent and cut, the
//! process killed in the middle; `docs/guide/reliability.md` holds the table.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test program bad_sockets` writes the table anew;
//! `VSM_LATE_S=2 cargo test -p vsm --test program bad_sockets` has the late one up to 2 s late, and takes six minutes.

use std::fmt::Write as _;

use kit::bridge::Faults;
use kit::bridge::Processes;
use kit::bridge::flight::{Outcome, fly, hold_to_page};

fn flight(name: &str, seed: u64, faults: Faults) -> String {
    let mut outcome = Outcome::default();
    let mut processes = Processes::start(seed, faults, SPEED);
    if faults.delay.1.as_secs() >= 1 {
        processes.longest *= 3;
    }
    let flown = fly(&mut processes, &mut outcome);
    outcome.count(flown);
    assert_eq!((outcome.lost, outcome.twice), (0, 0), "{name}: {outcome:?}");
    // Real time, and a machine that does something else too: at the worst rate an order may need a seventh try.
    let completed = match (faults.loss > 0.3, outcome.completed) {
        (false, 1) => "yes",
        (true, _) => "most of them",
        (false, _) => panic!("{name}: {outcome:?}"),
    };
    format!(
        "| {name} | {completed} | {} | {} |",
        outcome.lost, outcome.twice
    )
}

#[test]
fn the_table_of_outcomes_is_up_to_date() {
    let lossy = [0.0, 0.1, 0.2, 0.3, 0.4].map(|loss| {
        let name = format!("{:.0} % lost", loss * 100.0);
        (name, Faults::lossy(loss))
    });
    let most_s = std::env::var("VSM_LATE_S").ok();
    let most_s = most_s.map_or(0.5, |text| text.parse().expect("seconds"));
    let late = (
        "10 % lost, up to 0.5 s late".to_owned(),
        Faults::late(most_s),
    );
    // Side by side: they mostly wait.
    let flights: Vec<_> = lossy
        .into_iter()
        .chain([late])
        .zip(1..)
        .map(|((name, faults), seed)| std::thread::spawn(move || flight(&name, seed, faults)))
        .collect();
    let mut table = String::from(
        "| sockets, each way | flight completed | accepted and lost | carried out twice |\n|---|---|---|---|\n",
    );
    for flight in flights {
        let row = flight.join().expect("the flight's own account is above");
        writeln!(table, "{row}").expect("a String takes all");
    }
    hold_to_page("sockets", &table);
}

/// How much faster than time the vehicle flies; its time-outs are as much shorter.
const SPEED: f64 = 2.0;
