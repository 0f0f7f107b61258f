//! Nothing is allocated for a message, received or sent.

use kit::heap::{Counting, allocations};
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};

use crate::support::*;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn no_message_costs_an_allocation() {
    // Everything that PX4 sent in a recording, over a signed link, with noise and refusals between.
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let mut open: Link<Addr> = Link::new(LinkConfig::new(1, Security::Off, Endpoint::Listen));
    let recording = kit::captures::read("01-boot-heartbeats");
    let messages: Vec<_> = recording
        .iter()
        .filter_map(|d| {
            mavlink_link::frame::FrameView::parse(&d.bytes)
                .ok()?
                .message()
                .ok()
        })
        .take(2_000)
        .collect();
    let signed: Vec<_> = messages.iter().map(|m| vehicle.send(m)).collect();
    let forged = Vehicle {
        key: other_key(),
        ..Vehicle::new(vehicle.stamp)
    }
    .heartbeat();
    let noise = [0xfd; 300];

    let mut delivered = 0;
    let mut out = [0; MAX_FRAME];
    let (count, ()) = allocations(|| {
        for (n, (message, frame)) in messages.iter().zip(&signed).enumerate() {
            let now = at(10 + n as u64 * 3);
            for (from, bytes) in [
                (VEHICLE, &frame[..]),
                (VEHICLE, frame),
                (STRANGER, &forged),
                (STRANGER, &noise),
            ] {
                let auth = Station::auth(&mut station.keys, &mut station.store);
                station
                    .link
                    .handle_datagram(now, from, bytes, auth, &mut |_| delivered += 1);
            }
            open.handle_datagram(now, VEHICLE, frame, Auth::Off, &mut |_| delivered += 1);
            station.link.handle_timeout(now);
            let auth = Station::auth(&mut station.keys, &mut station.store);
            station.link.poll_transmit(now, auth, &mut out);
            let auth = Station::auth(&mut station.keys, &mut station.store);
            station.link.send(now, auth, message, &mut out).unwrap();
            while station.link.poll_event().is_some() {}
        }
    });
    assert_eq!(count, 0);
    assert_eq!(delivered, 2 * messages.len());

    // And the counter counts.
    assert_eq!(
        allocations(|| std::hint::black_box(Box::new(delivered))).0,
        1
    );
}
