//! `vsm run` with its vehicle on a serial line, a pseudo terminal: a whole flight, the process killed in the middle, over
//! a line that is good and one that loses, bends and cuts bytes; and flights over radios that carry little, whose bytes are counted.

use std::collections::BTreeMap;
use std::time::Duration;

use kit::bridge::flight::{Outcome, World as _, fly};
use kit::bridge::{Faults, Processes, orders};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

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

/// A radio with as much room as anybody wants, until it gets its pace.
const RADIO: Faults = Faults {
    loss: 0.01,
    bytes_s: Some(1e9),
    ..Faults::NONE.delayed_ms(30, 30)
};

/// The vehicle streams here as PX4 does to its simulator's ground station, over 15 kB a second; on a serial line it keeps to its
/// MAV_n_RATE. So the line gets its pace once the bridge has requested its rates; the time of that.
fn on_a_radio(rate_bps: u32) -> (Processes, Duration) {
    let mut processes = Processes::on_a_radio(7, RADIO, rate_bps);
    processes.longest = Duration::from_secs(58);
    let line = f64::from(rate_bps) / 10.0;
    let has_its_rates = |processes: &Processes| {
        let carried = &processes.line().carried;
        let to_bridge = processes.bridge_end();
        let requests = carried.iter().filter(|one| one.to != to_bridge).count();
        let since = processes.clock().saturating_sub(Duration::from_secs(1));
        let latest = carried.iter().rev().take_while(|one| one.waited.0 >= since);
        let reports = latest.filter(|one| one.to == to_bridge);
        let bytes: usize = reports.map(|one| one.bytes).sum();
        requests >= REQUESTS && (bytes as f64) < 0.7 * line
    };
    assert!(
        processes.wait(20.0, &has_its_rates),
        "the bridge's rates are in force"
    );
    processes.line_mut().faults.bytes_s = Some(line);
    // A vehicle refuses to arm for some seconds after its start.
    processes.pass(4.0);
    let begun = processes.clock();
    (processes, begun)
}

/// Gives an order, and expects that it is confirmed at the first time.
#[track_caller]
fn done(processes: &mut Processes, order: impl Into<Message>) {
    let order = order.into();
    let ticket = processes.give(order.clone());
    let end = processes.ended(ticket);
    let alerts = processes.station.alerts();
    assert_eq!(end, Some(AckType::CarriedOut), "{}: {alerts:?}", order.id());
}

#[track_caller]
fn wait_for(processes: &mut Processes, what: &str, so: impl Fn(&Processes) -> bool) {
    let came = processes.wait(25.0, &so);
    assert!(came, "{what}: {:?}", processes.flown());
}

fn take_off(processes: &mut Processes) {
    // The first may come before the vehicle can arm, or before it has reported its home.
    let launched = (0..8).any(|_| {
        let ticket = processes.give(orders::launch(HEIGHT_M).into());
        let launched = processes.ended(ticket) == Some(AckType::CarriedOut);
        if !launched {
            processes.pass(2.0);
        }
        launched
    });
    assert!(launched, "{:?}", processes.station.alerts());
    wait_for(processes, "its height", |processes| {
        -processes.flown().position.d > HEIGHT_M - 1.0
    });
}

/// What the line carried since then, both ways together: never over nine tenths in a second, where nothing else takes the processor
/// (`VSM_QUIET=1`), and elsewhere, where the bytes of one second may come in the next, in three; and no frame to the vehicle waited over
/// 200 ms for those before it.
fn assert_within_the_line(processes: &Processes, begun: Duration, rate_bps: u32) {
    let to_bridge = processes.bridge_end();
    let carried = processes.line().carried.iter();
    let carried: Vec<_> = carried.filter(|one| one.waited.0 >= begun).collect();
    let mut seconds = BTreeMap::<u64, usize>::new();
    for one in &carried {
        *seconds.entry(one.waited.1.as_secs()).or_default() += one.bytes;
    }
    let span = if std::env::var_os("VSM_QUIET").is_some() {
        1
    } else {
        3
    };
    let busiest = seconds.keys().map(|first| {
        let those = seconds.range(first..&(first + span));
        those.map(|(_, bytes)| bytes).sum::<usize>()
    });
    let busiest = busiest.max().unwrap_or(0) as f64 / span as f64;
    let used = busiest / (f64::from(rate_bps) / 10.0);
    assert!(used <= 0.9, "{rate_bps}: {used:.2}, {seconds:?}");
    let bytes = [true, false].map(|down| {
        let way = carried.iter().filter(|one| (one.to == to_bridge) == down);
        way.map(|one| one.bytes).sum::<usize>()
    });
    let sent = carried.iter().filter(|one| one.to != to_bridge);
    let waits = sent.map(|one| one.waited.1 - one.waited.0);
    let longest = waits.max().expect("something was sent");
    assert!(
        longest <= Duration::from_millis(200),
        "{rate_bps}: {longest:?}, {bytes:?} bytes down and up"
    );
    // It counts, and loses.
    assert!(bytes[0] > bytes[1] && bytes[1] > 0, "{bytes:?}");
    assert!(processes.line().lost() > 0);
}

#[test]
fn a_flight_over_a_radio_of_57600_baud() {
    let (mut processes, begun) = on_a_radio(57_600);
    done(&mut processes, orders::request_control());
    done(&mut processes, orders::route(1));
    for (number, next, north, east) in [(1, 2, 15.0, 0.0), (2, 0, 15.0, 15.0)] {
        done(
            &mut processes,
            orders::waypoint(number, next, north, east, HEIGHT_M),
        );
    }
    done(&mut processes, orders::load());
    take_off(&mut processes);
    done(&mut processes, orders::mode(Mode::Waypoint));
    wait_for(&mut processes, "the second waypoint", |processes| {
        processes.flown().mission_seq >= 1
    });
    done(&mut processes, orders::mode(Mode::Loiter));
    done(&mut processes, orders::mode(Mode::AutolandEngage));
    wait_for(&mut processes, "the ground", |processes| {
        !processes.flown().armed
    });
    assert_within_the_line(&processes, begun, 57_600);
}

#[test]
fn a_mode_change_over_a_radio_of_9600_baud() {
    let (mut processes, begun) = on_a_radio(9_600);
    done(&mut processes, orders::request_control());
    take_off(&mut processes);
    done(&mut processes, orders::mode(Mode::Loiter));
    processes.pass(3.0);
    done(&mut processes, orders::mode(Mode::AutolandEngage));
    processes.pass(3.0);
    assert_within_the_line(&processes, begun, 9_600);
}

/// Low, so that a flight takes little time.
const HEIGHT_M: f64 = 8.0;
/// More frames than the bridge sends before it requests rates, and fewer than it requests of them.
const REQUESTS: usize = 20;
