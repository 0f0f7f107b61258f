//! What encryption costs on a radio of 57,600 baud, with the streams that PX4 v1.18 sends in its low-bandwidth mode. The
//! figures of docs/guide/encryption.md: `cargo test --release -p mavlink-link --test key_exchange cost -- --nocapture`.

use core::time::Duration;
use std::time::Instant;

use kit::streams::LOW_BANDWIDTH as STREAMS;
use mavlink_link::encrypted::{Carrier, MAX_WIRE};

use super::{AIR, World};
use crate::world::{HONEST, ms};

/// Header, checksum and signature.
const AROUND: usize = 25;

fn frame(payload: usize) -> Vec<u8> {
    let mut frame = vec![0x55; payload + AROUND];
    frame[..3].copy_from_slice(&[0xfd, u8::try_from(payload).unwrap(), 1]);
    frame
}

/// Bytes a second, signed and plain inside, and encrypted outside, over a minute.
fn a_minute(together: bool) -> [usize; 3] {
    let mut world = World::new(1, Carrier::Stream);
    world.recovery(Duration::from_secs(1));
    let begun = world.now;
    let (mut signed, mut encrypted) = (0, 0);
    let mut due: Vec<_> = (0..)
        .zip(STREAMS)
        .map(|(at, (_, every))| {
            // Started together, as at a start of PX4; or spread over their periods.
            begun + if together { ms(0) } else { ms(at * 37 % every) }
        })
        .collect();
    while world.now < begun + Duration::from_secs(60) {
        let (now, end) = (world.now, &mut world.ends[AIR]);
        let link = end.link.as_mut().unwrap();
        for (due, (payload, every)) in due.iter_mut().zip(STREAMS) {
            if *due <= now {
                *due += ms(every);
                signed += payload + AROUND;
                link.send(now, HONEST, &frame(payload));
            }
        }
        let mut out = [0; MAX_WIRE];
        while let Some((_, len)) = link.poll_transmit(now, &mut end.disk, &mut out) {
            encrypted += len;
        }
        world.now += ms(1);
    }
    let frames: u64 = STREAMS.iter().map(|(_, every)| 60_000 / every).sum();
    let plain = signed - usize::try_from(frames).unwrap() * 13;
    [plain / 60, signed / 60, encrypted / 60]
}

#[test]
#[allow(clippy::print_stderr, reason = "figures for the guide")]
fn the_low_bandwidth_streams_fit_on_a_radio_of_57600_baud() {
    for (together, most) in [(true, 1.5), (false, 2.2)] {
        let [plain, signed, encrypted] = a_minute(together);
        let share = encrypted as f64 / 5_760.0 * 100.0;
        eprintln!(
            "together {together}: plain {plain}, signed {signed}, encrypted {encrypted} bytes/s, {share:.0} % of 57,600 baud"
        );
        assert!(
            encrypted as f64 <= signed as f64 * most,
            "{signed} {encrypted}"
        );
        assert!(share < 75.0);
    }
}

#[test]
#[allow(clippy::print_stderr, reason = "figures for the guide")]
fn a_packet_costs_microseconds() {
    let mut world = World::new(1, Carrier::Stream);
    world.recovery(Duration::from_secs(1));
    world.run(ms(100), Duration::from_secs(60));
    let (now, clocks) = (world.now, world.clocks());
    let [ground, air] = &mut world.ends;
    let (ground_link, air_link) = (ground.link.as_mut().unwrap(), air.link.as_mut().unwrap());
    let frame = frame(40);
    let mut out = [0; MAX_WIRE];
    let begun = Instant::now();
    let (mut packets, mut got) = (0, 0);
    for _ in 0..20_000 {
        air_link.send(now, HONEST, &frame);
        while let Some((_, len)) = air_link.poll_transmit(now + ms(5), &mut air.disk, &mut out) {
            packets += 1;
            let mut random = ground.dice.fill();
            let inner =
                ground_link.handle(clocks, HONEST, &out[..len], &mut random, &mut ground.disk);
            got += inner.len();
        }
    }
    let each = begun.elapsed() / packets;
    eprintln!("{packets} packets sealed and opened, {each:?} each, both ends");
    assert_eq!(got, 20_000 * frame.len());
    assert!(each < Duration::from_micros(500));
}
