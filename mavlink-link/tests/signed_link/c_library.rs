//! The C library as oracle and adversary: each accepts what the other signs, both refuse replayed, damaged and
//! wrongly signed frames; and its pitfalls are not ours.

use std::path::PathBuf;
use std::time::Duration;

use crate::support::*;
use kit::process::{from_hex, hex};
use mavlink_link::link::Endpoint;
use mavlink_link::signing::Stamp;

/// A second after the station's start, so that it lies above the floor of a key file.
fn stamp() -> Stamp {
    Stamp::from_unix(WALL).plus(Duration::from_secs(1))
}

/// Without the library there is nothing to compare with: that is a failure, as for the other peers.
fn harness(test: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(test);
    comparison_benches::harness(&folder, &["-O2"]).unwrap_or_else(|missing| panic!("{missing}"))
}

fn signed_by_c(program: &std::path::Path, stamp: Stamp, count: usize) -> Vec<Vec<u8>> {
    let key = hex(key().expose());
    let (stamp, count) = (stamp.get().to_string(), count.to_string());
    comparison_benches::ask(program, &["sign", &key, &stamp, &count], "")
        .lines()
        .map(from_hex)
        .collect()
}

/// The library's verdict on each line of frames; its clock stands at `stamp`.
fn judged_by_c(program: &std::path::Path, stamp: Stamp, frames: &[Vec<u8>]) -> Vec<bool> {
    let input: String = frames.iter().map(|frame| hex(frame) + "\n").collect();
    let key = hex(key().expose());
    let verdicts =
        comparison_benches::ask(program, &["verify", &key, &stamp.get().to_string()], &input);
    let verdicts: Vec<_> = verdicts
        .lines()
        .map(|v| v.starts_with("accepted"))
        .collect();
    assert_eq!(verdicts.len(), frames.len());
    verdicts
}

#[test]
fn each_accepts_what_the_other_signs_once() {
    let program = harness("both_ways");
    let frames = signed_by_c(&program, stamp(), 100);
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    for frame in &frames {
        assert_eq!(
            station.receive(at(2_000), VEHICLE, frame).len(),
            1,
            "{}",
            hex(frame)
        );
    }
    for frame in &frames {
        assert!(station.receive(at(2_000), VEHICLE, frame).is_empty());
    }
    assert_eq!(station.link.stats().stale, 100);

    let ours: Vec<_> = (0..50).map(|_| station.send(at(2_000), &ack()).0).collect();
    let twice = [ours.clone(), ours].concat();
    let verdicts = judged_by_c(&program, stamp(), &twice);
    assert!(verdicts[..50].iter().all(|&taken| taken));
    assert!(verdicts[50..].iter().all(|&taken| !taken));
}

#[test]
fn any_inverted_bit_is_refused_by_both() {
    let program = harness("damaged");
    let good = signed_by_c(&program, stamp(), 1).remove(0);
    let mut damaged = vec![];
    for at in 1..good.len() {
        for bit in 0..8 {
            let mut frame = good.clone();
            frame[at] ^= 1 << bit;
            damaged.push(frame);
        }
    }
    // Each alone, at a fresh receiver of the library: an empty line between them.
    let key = hex(key().expose());
    let input: String = damaged.iter().map(|frame| hex(frame) + "\n\n").collect();
    let verdicts = comparison_benches::ask(
        &program,
        &["verify", &key, &stamp().get().to_string()],
        &input,
    );
    assert!(!verdicts.contains("accepted"), "{verdicts}");
    for frame in &damaged {
        let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
        assert!(
            station.receive(at(2_000), VEHICLE, frame).is_empty(),
            "{}",
            hex(frame)
        );
    }
}

#[test]
fn pitfall_07_the_table_of_the_c_library_fills_up_and_ours_keeps_a_place() {
    let program = harness("table");
    let mut frames: Vec<_> = (2..18)
        .map(|component| {
            Vehicle {
                component,
                ..Vehicle::new(stamp())
            }
            .heartbeat()
        })
        .collect();
    frames.push(Vehicle::new(stamp()).heartbeat());
    let verdicts = judged_by_c(&program, stamp(), &frames);
    assert!(verdicts[..16].iter().all(|&taken| taken));
    assert!(!verdicts[16], "the honest autopilot is refused");
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    for frame in &frames[..16] {
        station.receive(at(2_000), VEHICLE, frame);
    }
    assert_eq!(station.receive(at(2_000), VEHICLE, &frames[16]).len(), 1);
}

#[test]
fn pitfall_12_a_year_ahead_locks_the_c_library_and_not_us() {
    let program = harness("ahead");
    let ahead = Vehicle {
        component: 7,
        ..Vehicle::new(stamp().plus(365 * DAY))
    }
    .heartbeat();
    let honest = Vehicle::new(stamp()).heartbeat();
    let frames = vec![ahead, honest];
    assert_eq!(
        judged_by_c(&program, stamp(), &frames),
        [true, false],
        "the library is locked"
    );
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    assert!(station.receive(at(2_000), VEHICLE, &frames[0]).is_empty());
    assert_eq!(station.receive(at(2_000), VEHICLE, &frames[1]).len(), 1);
}

#[test]
fn pitfall_19_a_restarted_c_library_takes_the_last_minute_again_and_we_do_not() {
    let program = harness("restart");
    let mut station = Station::new(Endpoint::Fixed(VEHICLE), at(0));
    let frames = signed_by_c(&program, stamp(), 20);
    for frame in &frames {
        assert_eq!(station.receive(at(2_000), VEHICLE, frame).len(), 1);
    }
    let later = stamp().plus(Duration::from_secs(30));
    assert!(
        judged_by_c(&program, later, &frames)
            .iter()
            .all(|&taken| taken)
    );
    let mut station = station.restart(at(32_000));
    for frame in &frames {
        assert!(station.receive(at(32_000), VEHICLE, frame).is_empty());
    }
}
