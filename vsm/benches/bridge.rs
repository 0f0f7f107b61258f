//! One message through the whole bridge, both ways, without sockets: a signed frame of the vehicle in and a stick
//! command in, each with what it sets off going out.

#![allow(missing_docs, reason = "a bench has no callers")]

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use kit::bridge::{Rig, cucs, vehicle_id};
use mavlink_link::frame::MAX_FRAME;
use stanag_msgs::messages::UaStickCommand;
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, TimeStamp};
use vsm::session::Peer;

/// Lets the bridge do what is due, and drains what it says.
fn settle(rig: &mut Rig) {
    let now = rig.now();
    let bridge = rig.bridge.as_mut().expect("it runs");
    if bridge.poll_timeout(now.mono) <= now.mono {
        bridge.handle_timeout(now, &mut rig.store);
    }
    while bridge.poll_vehicle().is_some() {}
    while bridge.poll_dli().is_some() {}
}

fn telemetry(iterations: u64) -> Duration {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let (mut left, mut spent, mut frame) = (iterations, Duration::ZERO, [0; MAX_FRAME]);
    while left > 0 {
        rig.clock.advance(STEP);
        let now = rig.now();
        rig.vehicles[0].step(STEP);
        while let Some(sent) = rig.vehicles[0].poll_transmit(&mut frame) {
            let peer = Peer::Udp(kit::bridge::vehicle_address(0));
            let bytes = &frame[..sent.len];
            let begun = Instant::now();
            let bridge = rig.bridge.as_mut().expect("it runs");
            bridge.handle_vehicle(now, 0, peer, bytes, &mut rig.store, &mut |_, _| {});
            settle(&mut rig);
            spent += begun.elapsed();
            left = left.saturating_sub(1);
        }
    }
    spent
}

fn sticks(iterations: u64) -> Duration {
    let mut rig = Rig::ready();
    let mut spent = Duration::ZERO;
    for _ in 0..iterations {
        rig.clock.advance(STEP);
        let now = rig.now();
        let message = Message::UaStickCommand(UaStickCommand {
            time_stamp: Some(TimeStamp::from_unix_ms(now.wall.as_millis() as u64)),
            lateral_stick: Some(0),
            throttle_stick_engine_1: Some(50),
            ..UaStickCommand::default()
        });
        let mut bytes = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(cucs(0), vehicle_id(0));
        let length = message.encode(&envelope, &mut bytes).expect("it fits");
        let from = kit::bridge::station_address(0);
        let begun = Instant::now();
        let bridge = rig.bridge.as_mut().expect("it runs");
        bridge.handle_dli(now, from, &bytes[..length], &mut rig.store);
        settle(&mut rig);
        spent += begun.elapsed();
    }
    spent
}

fn bridge(criterion: &mut Criterion) {
    criterion.bench_function("bridge: signed frame in, reports out", |bench| {
        bench.iter_custom(telemetry);
    });
    criterion.bench_function("bridge: 2010 in, MAVLink out", |bench| {
        bench.iter_custom(sticks);
    });
}

const STEP: Duration = Duration::from_millis(10);

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(2));
    targets = bridge
}
criterion_main!(benches);
