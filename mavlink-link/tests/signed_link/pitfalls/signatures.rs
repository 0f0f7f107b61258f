//! What is verified, what is not, and that each delivery, state and counter shows it.

use mavlink_link::dialect::{MavMessage, RADIO_STATUS_DATA};
use mavlink_link::frame::checksum;
use mavlink_link::link::{Alert, Endpoint, Event, Link, LinkConfig, LinkState, Security};

use crate::support::{
    Got, STRANGER, Station, VEHICLE, ack, at, heartbeat, key, live_pair, other_key,
};

#[test]
fn pitfall_08_a_message_accepted_unsigned_is_refused_with_a_wrong_signature() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let status = MavMessage::RADIO_STATUS(RADIO_STATUS_DATA {
        rssi: 9,
        ..Default::default()
    });
    let got = station.receive(at(10), VEHICLE, &vehicle.send_unsigned(&status));
    assert!(matches!(&got[..], [one] if !one.verified && one.stamp.is_none()));

    vehicle.key = other_key();
    assert!(
        station
            .receive(at(11), VEHICLE, &vehicle.send(&status))
            .is_empty()
    );
    assert_eq!(station.link.stats().bad_signature, 1);
    // And from elsewhere than the peer not even unsigned.
    assert!(
        station
            .receive(at(12), STRANGER, &vehicle.send_unsigned(&status))
            .is_empty()
    );
    assert_eq!(station.link.stats().unsigned_stranger, 1);
}

#[test]
fn pitfall_09_checksum_and_signature_are_each_checked() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    // A wrong checksum under a right signature: made by signing a frame whose checksum is off.
    let good = vehicle.heartbeat();
    let crc_at = 10 + usize::from(good[1]);
    let mut out = [0; 280];
    out[..good.len()].copy_from_slice(&good);
    out[crc_at] ^= 1;
    let len = mavlink_link::signing::sign(&key(), 0, vehicle.stamp, &mut out, crc_at + 2).unwrap();
    assert!(station.receive(at(10), VEHICLE, &out[..len]).is_empty());
    assert_eq!(
        (
            station.link.stats().bad_crc,
            station.link.stats().bad_signature
        ),
        (1, 0)
    );

    // A right checksum under a signature that was made before the payload was changed.
    let mut forged = vehicle.heartbeat();
    forged[12] ^= 1;
    let crc = checksum(&forged[1..crc_at], 50);
    forged[crc_at..crc_at + 2].copy_from_slice(&crc.to_le_bytes());
    assert!(station.receive(at(11), VEHICLE, &forged).is_empty());
    assert_eq!(
        (
            station.link.stats().bad_crc,
            station.link.stats().bad_signature
        ),
        (1, 1)
    );
}

#[test]
fn pitfall_15_every_delivery_says_whether_it_was_verified() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    let got = station.receive(at(10), VEHICLE, &vehicle.heartbeat());
    assert!(got[0].verified && got[0].stamp.is_some());
    assert_eq!(station.link.state(), LinkState::Live);

    // With signing off even a signed frame is delivered as unverified: there is no key to verify it.
    let mut open = Link::new(LinkConfig::new(1, Security::Off, Endpoint::Listen));
    let mut got = Vec::new();
    for frame in [vehicle.heartbeat(), vehicle.send_unsigned(&heartbeat())] {
        let auth = mavlink_link::link::Auth::Off;
        open.handle_datagram(at(10), VEHICLE, &frame, auth, &mut |d| {
            got.push(Got::of(&d))
        });
    }
    assert_eq!(got.len(), 2);
    assert!(got.iter().all(|got| !got.verified && got.stamp.is_none()));
}

#[test]
fn pitfall_15_state_and_counters_say_whether_signing_is_on() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    assert_eq!(station.link.state(), LinkState::Live);
    let mut unsigned = Station::new(Endpoint::Listen, at(0));
    unsigned.receive(at(1), VEHICLE, &vehicle.send_unsigned(&ack()));
    assert_eq!(unsigned.link.state(), LinkState::Waiting);
    let stats = unsigned.link.stats();
    assert_eq!((stats.unsigned_vehicle, stats.delivered_verified), (1, 0));
    // A vehicle that restarts is seen to be behind until it is lifted.
    vehicle.restart();
    for n in 0..4 {
        station.receive(at(5_000 + n), VEHICLE, &vehicle.heartbeat());
    }
    assert_eq!(station.link.state(), LinkState::Behind);
}

#[test]
fn pitfall_23_a_vehicle_that_lost_its_key_is_noticed() {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    // Its heartbeats alone prove nothing: anyone can send those; and nothing does beside frames that have just verified.
    station.receive(at(1_900), VEHICLE, &vehicle.send_unsigned(&ack()));
    station.receive(at(3_000), VEHICLE, &vehicle.send_unsigned(&heartbeat()));
    assert_eq!(station.link.poll_event(), None);
    assert!(
        station
            .receive(at(3_001), VEHICLE, &vehicle.send_unsigned(&ack()))
            .is_empty()
    );
    assert_eq!(
        station.link.poll_event(),
        Some(Event::Alert(Alert::VehicleUnsigned))
    );
    assert_eq!(station.link.stats().unsigned_vehicle, 3);
}
