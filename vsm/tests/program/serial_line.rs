//! `vsm run` with its vehicle on a serial line, a pseudo terminal: a whole flight, the process killed in the middle, over
//! a line that is good and one that loses, bends and cuts bytes.

use kit::bridge::Faults;
use kit::bridge::Processes;
use kit::bridge::flight::{Outcome, fly};

fn flight(faults: Faults) {
    let mut outcome = Outcome::default();
    let mut processes = Processes::on_a_serial_line(7, faults, 2.0);
    let flown = fly(&mut processes, &mut outcome);
    assert_eq!(flown, Ok(()), "{outcome:?}");
    assert_eq!((outcome.lost, outcome.twice), (0, 0), "{outcome:?}");
}

#[test]
fn a_flight_over_a_good_line() {
    flight(Faults::NONE);
}

#[test]
fn a_flight_over_a_noisy_line() {
    // A stream has no packets to overtake each other or to come twice.
    flight(Faults {
        loss: 0.05,
        flip: 0.05,
        truncate: 0.05,
        ..Faults::NONE
    });
}
