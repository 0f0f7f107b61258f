//! Whole flights over links that lose up to 40 % of their packets both ways, or deliver them up to 2 s late;
//! `docs/guide/reliability.md` holds the table.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test flight lossy_links` writes the table again. `VSM_ALL_CASES=1` flies each of its flights, CI
//! every second one.

use std::fmt::Write as _;

use kit::bridge::flight::{Outcome, fly, hold_to_page};
use kit::bridge::{Faults, Rig, Setup};

fn flights(faults: Faults) -> Outcome {
    let mut outcome = Outcome::default();
    for seed in seeds() {
        let mut rig = Rig::new(Setup {
            seed: seed.into(),
            dli: faults,
            mav: faults,
            ..Setup::default()
        });
        let flown = fly(&mut rig, &mut outcome);
        outcome.count(flown);
    }
    outcome
}

/// A flight each.
fn seeds() -> impl Iterator<Item = u32> {
    (1..=FLIGHTS).step_by(kit::every(2))
}

#[test]
fn the_table_of_outcomes_is_up_to_date() {
    let mut table = String::from(
        "| links, each way | flights completed | accepted and lost | carried out twice | longest upload of 4 waypoints |\n\
         |---|---|---|---|---|\n",
    );
    let lossy = [0.0, 0.1, 0.2, 0.3, 0.4].map(|loss| {
        let name = format!("{:.0} % lost", loss * 100.0);
        (name, Faults::lossy(loss))
    });
    let late = [0.5, 1.0, 2.0].map(|max_s| {
        let name = format!("10 % lost, up to {max_s} s late");
        (name, Faults::late(max_s))
    });
    for (name, faults) in lossy.into_iter().chain(late) {
        let outcome = flights(faults);
        assert_eq!((outcome.lost, outcome.twice), (0, 0), "{name}: {outcome:?}");
        // At the worst rate an order may now and then need giving more than six times.
        let (may_fail, completed) = if faults.loss > 0.3 {
            (2, format!("{} or more of {FLIGHTS}", FLIGHTS - 2))
        } else {
            (0, format!("{FLIGHTS} of {FLIGHTS}"))
        };
        let flown = seeds().count();
        assert!(
            outcome.completed as usize + may_fail >= flown,
            "{name}: {outcome:?} of {flown}"
        );
        writeln!(
            table,
            "| {name} | {completed} | {} | {} | {} |",
            outcome.lost,
            outcome.twice,
            outcome.upload()
        )
        .expect("a String takes all");
    }
    hold_to_page("loss", &table);
}

const FLIGHTS: u32 = 10;
