//! Fifty simulated vehicles behind one bridge, all of them flying: what the process holds does not grow with time.
//!
//! One minute of virtual time is measured here; `VSM_FLEET_MINUTES=60 cargo test --release -p vsm --test hot_path
//! memory -- --nocapture` is the hour, and prints what it found.
#![allow(clippy::print_stderr, reason = "the figure is printed")]

use std::time::Instant;

use kit::bridge::{Rig, Setup, orders};
use kit::heap::held;
use stanag_msgs::enums::AckType;

#[test]
fn the_memory_of_fifty_vehicles_is_flat() {
    let minutes: u32 = std::env::var("VSM_FLEET_MINUTES")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(1);
    let mut rig = Rig::new(Setup {
        vehicles: vec![px4_sim::Config::default(); VEHICLES],
        stations: 4,
        ..Setup::default()
    });
    rig.run(9.0);
    for order in [
        kit::bridge::orders::request_control().into(),
        stanag_msgs::Message::from(orders::launch(20.0)),
    ] {
        let tickets: Vec<_> = (0..VEHICLES)
            .map(|vehicle| rig.send_as(vehicle % 4, vehicle, order.clone()))
            .collect();
        for (vehicle, ticket) in tickets.into_iter().enumerate() {
            assert_eq!(rig.end_as(vehicle % 4, ticket), Some(AckType::CarriedOut));
        }
    }
    rig.run(10.0);
    forget(&mut rig);

    let (begun, first) = (Instant::now(), held());
    let (mut min, mut max, mut received) = (first, first, 0);
    for _ in 0..minutes * 6 {
        rig.run(10.0);
        received += forget(&mut rig);
        min = min.min(held());
        max = max.max(held());
    }
    eprintln!(
        "{VEHICLES} vehicles, {minutes} min of virtual time in {:.0} s: {received} reports, {:.1} MiB at first, \
         {:.1} to {:.1} MiB after",
        begun.elapsed().as_secs_f64(),
        mib(first),
        mib(min),
        mib(max)
    );
    // Four reports for each vehicle at 2 Hz and faster.
    assert!(received > u64::from(minutes) * 60 * 8 * VEHICLES as u64);
    assert!(rig.vehicles.iter().all(|v| !v.vehicle().truth().landed));
    assert!(max - first < SLACK, "{first} at first, {max} at most");
}

/// What the stations and the rig remember is theirs, not the bridge's. Returns how much was received.
fn forget(rig: &mut Rig) -> u64 {
    rig.log.clear();
    let stations = rig.stations.iter_mut();
    stations
        .map(|station| std::mem::take(&mut station.received).len() as u64)
        .sum()
}

fn mib(bytes: i64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

const VEHICLES: usize = 50;
/// Packets on their way and queues that grow once: far below a kilobyte a vehicle and minute.
const SLACK: i64 = 512 << 10;
