//! Somebody on the way copies the vehicle's frames, and the vehicle itself moves: which address the link follows.

use mavlink_link::dialect::MavMessage;
#[expect(
    deprecated,
    reason = "PX4 answers PING; TIMESYNC, which replaces it, sets its clock"
)]
use mavlink_link::dialect::PING_DATA;
use mavlink_link::frame::FrameView;
use mavlink_link::link::{Alert, Endpoint, Event};

use crate::support::{STRANGER, Station, VEHICLE, Vehicle, ack, at, heartbeat, live_pair};

/// After a second of telemetry.
fn known_pair() -> (Station, Vehicle) {
    let (mut station, mut vehicle) = live_pair(Endpoint::Listen);
    for n in 0..64 {
        station.receive(at(10 + n), VEHICLE, &vehicle.heartbeat());
    }
    (station, vehicle)
}

/// What PX4 sends back for this frame, if it takes it and it is a PING.
#[expect(
    deprecated,
    reason = "PX4 answers PING; TIMESYNC, which replaces it, sets its clock"
)]
fn answer(vehicle: &mut Vehicle, frame: &[u8]) -> Option<Vec<u8>> {
    if !vehicle.receive(frame) {
        return None;
    }
    let view = FrameView::parse(frame).unwrap();
    let Ok(MavMessage::PING(ping)) = view.message() else {
        return None;
    };
    let header = view.header();
    Some(vehicle.send(&MavMessage::PING(PING_DATA {
        target_system: header.system_id,
        target_component: header.component_id,
        ..ping
    })))
}

fn count(station: &mut Station, wanted: impl Fn(&Event<u16>) -> bool) -> usize {
    std::iter::from_fn(|| station.link.poll_event())
        .filter(|event| wanted(event))
        .count()
}

#[test]
fn a_copy_that_is_always_first_moves_nothing_and_is_reported() {
    for passes_pings_on in [false, true] {
        let (mut station, mut vehicle) = known_pair();
        for n in 0..1_000 {
            let ms = 100 + 20 * n;
            let frame = vehicle.heartbeat();
            assert_eq!(station.receive(at(ms), STRANGER, &frame).len(), 1);
            assert!(station.receive(at(ms + 5), VEHICLE, &frame).is_empty());
            for (to, frame) in station.tick(at(ms + 6)) {
                if (to == VEHICLE || passes_pings_on)
                    && let Some(answer) = answer(&mut vehicle, &frame)
                {
                    station.receive(at(ms + 8), STRANGER, &answer);
                    station.receive(at(ms + 9), VEHICLE, &answer);
                }
            }
            assert_eq!(station.send(at(ms + 10), &ack()).1.to, VEHICLE);
        }
        assert!(station.link.stats().copied >= 1_000);
        let reported = count(&mut station, |event| *event == Event::Alert(Alert::Copied));
        assert_eq!(reported, 2, "in 20 s");
    }
}

#[test]
fn a_vehicle_that_has_moved_is_followed_by_its_answer_or_else_by_the_silence_it_left() {
    for (answers, every, by) in [(true, 100, 1_200), (false, 100, 2_700), (false, 10, 700)] {
        let (mut station, mut vehicle) = known_pair();
        let mut moved = None;
        for n in 1..300 {
            let ms = 100 + every * n;
            station.receive(at(ms), VEHICLE + 1, &vehicle.heartbeat());
            for (to, frame) in station.tick(at(ms)) {
                // Nobody is at the old address.
                if to == VEHICLE + 1
                    && let Some(answer) = answer(&mut vehicle, &frame)
                    && answers
                {
                    station.receive(at(ms + 1), VEHICLE + 1, &answer);
                }
            }
            if station.link.peer() == Some(VEHICLE + 1) {
                moved = moved.or(Some(every * n));
            }
        }
        let moved = moved.expect("followed");
        assert!((by - 300..=by).contains(&moved), "{moved} ms");
    }
}

#[test]
fn one_recorded_frame_at_the_start_does_not_keep_the_link_from_the_vehicle() {
    for answers in [true, false] {
        let mut station = Station::new(Endpoint::Listen, at(0));
        let mut vehicle = Vehicle::new(mavlink_link::signing::Stamp::from_unix(at(1_000).wall));
        let recorded = vehicle.heartbeat();
        assert_eq!(station.receive(at(0), STRANGER, &recorded).len(), 1);
        assert_eq!(station.link.peer(), Some(STRANGER));
        // From now on the stranger repeats what the vehicle sends.
        for n in 1..400 {
            let ms = 20 * n;
            let frame = vehicle.send(&heartbeat());
            station.receive(at(ms), VEHICLE, &frame);
            station.receive(at(ms + 2), STRANGER, &frame);
            for (to, frame) in station.tick(at(ms + 3)) {
                if to == VEHICLE
                    && let Some(answer) = answer(&mut vehicle, &frame)
                    && answers
                {
                    station.receive(at(ms + 4), VEHICLE, &answer);
                }
            }
            let expected = ms >= if answers { 1_200 } else { 1_300 };
            assert!(!expected || station.link.peer() == Some(VEHICLE), "{ms}");
        }
    }
}
