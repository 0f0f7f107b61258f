//! Others on the line, and our own frames come back: who is the peer, and who has a place in the table.

use mavlink_link::frame::FrameView;
use mavlink_link::link::{Endpoint, Link, LinkConfig, Security};
use mavlink_link::signing::Stamp;

use crate::support::{
    Addr, STRANGER, Station, VEHICLE, Vehicle, ack, at, heartbeat, live_pair, other_key,
};

#[test]
fn pitfall_07_a_full_table_still_has_a_place_for_the_autopilot() {
    let mut station = Station::new(Endpoint::Listen, at(0));
    let high = Stamp::from_unix(at(1_000).wall);
    for component in 2..30 {
        let mut other = Vehicle {
            component,
            ..Vehicle::new(high)
        };
        station.receive(at(0), VEHICLE, &other.heartbeat());
    }
    assert_eq!(station.link.stats().delivered_verified, 12);
    assert_eq!(station.link.stats().stream_table_full, 16);
    let mut autopilot = Vehicle::new(high);
    assert_eq!(
        station
            .receive(at(0), VEHICLE, &autopilot.heartbeat())
            .len(),
        1
    );
}

#[test]
fn pitfall_21_a_strangers_datagram_does_not_move_the_peer() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let replay = vehicle.heartbeat();
    station.receive(at(10), VEHICLE, &replay);
    let mut forger = Vehicle {
        key: other_key(),
        ..Vehicle::new(vehicle.stamp)
    };
    for datagram in [
        replay,
        forger.heartbeat(),
        vehicle.send_unsigned(&heartbeat()),
        vec![0xfd],
        vec![],
    ] {
        assert!(station.receive(at(11), STRANGER, &datagram).is_empty());
        assert_eq!(station.link.peer(), Some(VEHICLE));
    }
    assert_eq!(station.send(at(12), &ack()).1.to, VEHICLE);
    // A start of a frame from elsewhere is not joined with the peer's bytes.
    station.receive(at(13), STRANGER, &vehicle.heartbeat()[..11]);
    assert_eq!(
        station.receive(at(14), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );
    // The vehicle on a new port is received at once, and followed when nothing comes from the old one any more.
    for (ms, peer) in [(15, VEHICLE), (3_000, VEHICLE + 1)] {
        let frame = vehicle.heartbeat();
        assert_eq!(station.receive(at(ms), VEHICLE + 1, &frame).len(), 1);
        assert_eq!(station.link.peer(), Some(peer));
    }
}

#[test]
fn pitfall_22_our_own_frames_come_back_and_are_refused() {
    let (mut station, _) = live_pair(Endpoint::Listen);
    let (frame, _) = station.send(at(10), &ack());
    assert!(station.receive(at(11), VEHICLE, &frame).is_empty());
    assert_eq!(station.link.stats().reflected, 1);

    // Even where the vehicle was configured with our own system id.
    let config = LinkConfig::new(245, Security::Signed, Endpoint::Listen);
    let mut link: Link<Addr> = Link::new(config);
    let auth = Station::auth(&mut station.keys, &mut station.store);
    link.handle_datagram(at(11), VEHICLE, &frame, auth, &mut |_| {
        panic!("a reflection")
    });
    assert_eq!(link.stats().reflected, 1);
}

#[test]
fn pitfall_24_strangers_heartbeats_raise_no_alarm_and_pass_for_nobody() {
    let (mut station, vehicle) = live_pair(Endpoint::Listen);
    let accepted = station.link.accepted_at();
    for n in 0..200 {
        let mut stranger = Vehicle {
            system: 255,
            component: 190,
            key: other_key(),
            ..Vehicle::new(vehicle.stamp)
        };
        // As the recordings show: forwarded by the vehicle, from its address.
        assert!(
            station
                .receive(at(10 + n), VEHICLE, &stranger.heartbeat())
                .is_empty()
        );
        assert!(
            station
                .receive(at(10 + n), VEHICLE, &stranger.send_unsigned(&heartbeat()))
                .is_empty()
        );
    }
    assert_eq!(station.link.stats().unexpected_system, 400);
    assert_eq!(station.link.stats().bad_signature, 0);
    assert_eq!(station.link.poll_event(), None);
    assert_eq!(station.link.accepted_at(), accepted);
}

#[test]
fn pitfall_26_the_vehicles_own_frame_is_not_taken_back_by_its_side_of_the_link() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let frame = vehicle.send(&ack());
    // The vehicle itself would take its own frame: the key is right, and the stream is new to it.
    assert!(vehicle.receive(&frame));
    // An end of ours on its side does not, wherever the frame comes from.
    let config = LinkConfig {
        own_system: 1,
        own_component: 191,
        ..LinkConfig::new(245, Security::Signed, Endpoint::Listen)
    };
    let mut air_side: Link<Addr> = Link::new(config);
    let auth = Station::auth(&mut station.keys, &mut station.store);
    air_side.handle_datagram(at(10), STRANGER, &frame, auth, &mut |_| {
        panic!("a reflection")
    });
    assert_eq!((air_side.stats().reflected, air_side.peer()), (1, None));
    // And our ground end never sends under the vehicle's id, so nobody can reflect through it.
    let (ours, _) = station.send(at(11), &ack());
    assert_eq!(FrameView::parse(&ours).unwrap().header().system_id, 245);
}
