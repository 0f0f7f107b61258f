//! A radio of few bits a second (`vehicle.rate_bps`): what is on the line stays within its budget while everything is done that
//! fills it, and a command does not wait.

use std::collections::BTreeMap;
use std::time::Duration;

use kit::bridge::{Faults, Rig, Setup, bridge_mav, orders, vehicle_address};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

/// The vehicle streams here as PX4 does to its simulator's ground station, over 15 kB a second; on a serial line it keeps to its
/// MAV_n_RATE. So the line gets its pace once the bridge has requested its rates.
fn on_a_radio(rate_bps: u32, keys: &'static str) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        mav: Faults::NONE.delayed_ms(20, 60),
        vehicle_keys: keys,
        ..Setup::default()
    });
    rig.run(15.0);
    rig.mav.faults.bytes_s = Some(f64::from(rate_bps) / 10.0);
    rig
}

/// `count` waypoints, 20 m apart, in a zigzag.
fn plan(count: u16) -> Vec<Message> {
    let waypoints = (1..=count).map(|number| {
        let next = if number == count { 0 } else { number + 1 };
        let east = if number % 2 == 0 { 30.0 } else { 0.0 };
        orders::waypoint(number, next, 20.0 * f64::from(number), east, 30.0).into()
    });
    std::iter::once(orders::route(1).into())
        .chain(waypoints)
        .collect()
}

/// A route is loaded while orders are given, then flown, with an order each five seconds. From when on that was.
fn fly(rig: &mut Rig, waypoints: u16) -> Duration {
    rig.run(10.0);
    let begun = rig.clock.elapsed();
    rig.take_off(15.0);
    rig.send_plan(plan(waypoints));
    let load = rig.send(orders::load());
    for _ in 0..3 {
        rig.run(1.5);
        let end = rig.carry_out(orders::mode(Mode::Loiter));
        assert_eq!(
            end,
            Some(AckType::CarriedOut),
            "{:?}",
            rig.station().alerts()
        );
    }
    assert!(rig.until(120.0, |rig| rig.station().end(load).is_some()));
    assert_eq!(
        rig.station().end(load),
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Waypoint)),
        Some(AckType::CarriedOut)
    );
    for _ in 0..6 {
        rig.run(5.0);
        rig.send_once(orders::mode(Mode::Waypoint));
    }
    begun
}

/// The most bytes that both directions carried within five seconds, a second of it.
fn busiest(rig: &Rig, from: Duration) -> f64 {
    let mut seconds = BTreeMap::<u64, usize>::new();
    for one in rig.mav.carried.iter().filter(|one| one.waited.0 >= from) {
        *seconds.entry(one.waited.1.as_secs()).or_default() += one.bytes;
    }
    let seconds: Vec<f64> = seconds.into_values().map(|bytes| bytes as f64).collect();
    let means = seconds
        .windows(5)
        .map(|five| five.iter().sum::<f64>() / 5.0);
    means.fold(0.0, f64::max)
}

/// The longest time that a frame to the vehicle waited for the line.
fn longest_wait(rig: &Rig, from: Duration) -> Duration {
    let to_vehicle = |to| to == vehicle_address(0);
    let sent = rig.mav.carried.iter();
    let sent = sent.filter(|one| to_vehicle(one.to) && one.waited.0 >= from);
    let waits = sent.map(|one| one.waited.1 - one.waited.0);
    waits.max().expect("something was sent")
}

#[test]
fn the_budget_of_a_radio_is_kept_and_commands_do_not_wait() {
    for (rate_bps, keys, waypoints) in [
        (9_600, "rate_bps = 9600\n", 20),
        (57_600, "rate_bps = 57600\n", 60),
    ] {
        let mut rig = on_a_radio(rate_bps, keys);
        let begun = fly(&mut rig, waypoints);
        let line = f64::from(rate_bps) / 10.0;
        let used = busiest(&rig, begun) / line;
        assert!(used < 0.9, "{rate_bps}: {used}");
        // What is on the line is used, too.
        assert!(used > 0.3, "{rate_bps}: {used}");
        let waited = longest_wait(&rig, begun);
        assert!(
            waited <= Duration::from_millis(200),
            "{rate_bps}: {waited:?}"
        );
        let alerts = rig.station().alerts();
        assert!(
            !rig.station().has_alert("no data from the vehicle"),
            "{alerts:?}"
        );
    }
}

#[test]
fn without_a_budget_the_same_radio_is_full() {
    let mut rig = on_a_radio(9_600, "");
    rig.run(30.0);
    let to_bridge = |to| to == bridge_mav(0);
    let late = rig.mav.carried.iter().filter(|one| to_bridge(one.to));
    let longest = late.map(|one| one.waited.1 - one.waited.0).max();
    assert!(longest > Some(Duration::from_millis(900)), "{longest:?}");
    assert!(rig.mav.lost() > 100, "{}", rig.mav.lost());
}

#[test]
fn a_radio_that_is_full_from_the_start_is_given_its_rates() {
    for (rate_bps, keys) in [
        (9_600, "rate_bps = 9600\n"),
        (19_200, "rate_bps = 19200\n"),
        (57_600, "rate_bps = 57600\n"),
    ] {
        let line = f64::from(rate_bps) / 10.0;
        let mut rig = Rig::new(Setup {
            mav: Faults {
                bytes_s: Some(line),
                ..Faults::NONE.delayed_ms(20, 60)
            },
            vehicle_keys: keys,
            ..Setup::default()
        });
        rig.run(90.0);
        assert!(rig.mav.lost() > 100, "{rate_bps}: {}", rig.mav.lost());
        let (begun, lost) = (rig.clock.elapsed(), rig.mav.lost());
        rig.run(20.0);
        let used = busiest(&rig, begun) / line;
        assert!(used < 0.9, "{rate_bps}: {used}");
        assert_eq!(rig.mav.lost(), lost, "{rate_bps}");
    }
}
