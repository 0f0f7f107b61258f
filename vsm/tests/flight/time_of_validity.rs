//! The Time Stamp of what the vehicle measures is when it was measured, by the bridge's clock: within 5 ms over any delay of
//! the link, and nobody but the vehicle moves it. The heading is of that moment too. Where its clock is not
//! known, or cannot be believed, it is the time of arrival. And a CUCS whose own clock is off is named.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::time::Duration;

use kit::bridge::{Rig, Setup, bridge_mav, orders, vehicle_address, vehicle_id};
use kit::clock::START;
use kit::network::Faults;
use mavlink_link::dialect::{MavMessage, TIMESYNC_DATA};
use mavlink_link::frame::{self, Header, MAX_FRAME};
use px4_sim::{ClockFault, Config, HealthFaults};
use stanag_msgs::enums::{
    EoirPointingMode, FlightPathControlMode, HeadingCommandType, LoiBitmap, StationBitmap1To16,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, EoIrLaserPayloadCommand, GenericInformationRequestMessage, Heartbeat,
    PayloadSteeringCommand, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Message, Scaled, TimeStamp};

/// In the air, flying north at its own speed, on a link with these faults.
fn flying(mav: Faults) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        mav,
        ..Setup::default()
    });
    rig.take_off(30.0);
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 30.0, 0.0, 30.0).into(),
        orders::waypoint(2, 0, 3_000.0, 0.0, 30.0).into(),
    ]);
    for order in [
        Message::from(orders::load()),
        orders::mode(FlightPathControlMode::Waypoint).into(),
    ] {
        rig.done(order);
    }
    assert!(rig.until(60.0, |rig| rig.truth().velocity.n > 4.0));
    rig.run(4.0);
    rig
}

/// Time goes in small steps from here on, until the clocks are known as well as that: a step of 10 ms is one of the links too.
fn precise(rig: &mut Rig) {
    rig.step = Duration::from_millis(2);
    rig.run(11.0);
}

/// For some seconds each 4000: by how many ms its stamp is later than the moment at which the vehicle believed to be there.
fn errors_ms(rig: &mut Rig, seconds: f64, mut each: impl FnMut(&mut Rig)) -> Vec<f64> {
    let mut track: Vec<(f64, f64)> = Vec::new();
    let first = rig.station().received.len();
    let end = rig.clock.elapsed() + Duration::from_secs_f64(seconds);
    // What was measured before, and arrives now, has its place on the track too.
    let begin = rig.clock.elapsed() + Duration::from_secs(2);
    while rig.clock.elapsed() < end {
        each(rig);
        rig.run(0.01);
        track.push((
            rig.truth().believed.latitude_deg,
            rig.clock.elapsed().as_secs_f64(),
        ));
    }
    let reported = rig.station().received[first..]
        .iter()
        .filter_map(|(at, _, message)| match message {
            Message::InertialStates(states) if *at > begin => {
                Some((states.latitude?.degrees(), states.time_stamp?))
            }
            _ => None,
        });
    let errors = reported.filter_map(|(latitude, stamp)| {
        let after = track
            .iter()
            .position(|(known, _)| *known >= latitude)?
            .max(1);
        let [(south, from), (north, to)] = [track[after - 1], track[after]];
        let there_s = from + (to - from) * (latitude - south) / (north - south);
        Some((seconds_of(stamp) - there_s) * 1e3)
    });
    let errors: Vec<f64> = errors.collect();
    assert!(errors.len() > 10, "{} reports", errors.len());
    errors
}

/// A stamp as the test's own time.
fn seconds_of(stamp: TimeStamp) -> f64 {
    stamp.unix_ms() as f64 / 1e3 - START.as_secs_f64()
}

fn largest(errors: &[f64]) -> f64 {
    errors
        .iter()
        .fold(0.0, |worst, error| error.abs().max(worst))
}

/// The stamps of each message type have risen, each by itself.
fn assert_stamps_rise(rig: &Rig) {
    let mut last: BTreeMap<u16, TimeStamp> = BTreeMap::new();
    for (_, _, message) in &rig.station().received {
        let stamp = match message {
            Message::InertialStates(m) => m.time_stamp,
            Message::FromToNextWaypointStates(m) => m.time_stamp,
            Message::VehicleOperatingStates(m) => m.time_stamp,
            Message::VehicleOperatingModeReport(m) => m.time_stamp,
            Message::EoIrLaserOperatingState(m) => m.time_stamp,
            _ => continue,
        };
        let stamp = stamp.expect("a stamp");
        let before = last.insert(message.id(), stamp);
        assert!(
            before.is_none_or(|before| before < stamp),
            "{}: {before:?}, {stamp:?}",
            message.id()
        );
    }
}

#[test]
fn a_position_is_stamped_with_the_moment_it_was_measured() {
    let far = Faults::NONE.delayed_ms(120, 120);
    for faults in [
        Faults::NONE,
        Faults {
            duplicate: 0.5,
            ..far
        },
    ] {
        let mut rig = flying(faults);
        precise(&mut rig);
        let errors = errors_ms(&mut rig, 5.0, |_| ());
        assert!(largest(&errors) < 5.0, "{faults:?}: {errors:?}");
        assert_stamps_rise(&rig);
    }
}

#[test]
fn what_is_reported_of_one_measurement_has_one_stamp() {
    let mut rig = flying(Faults::NONE);
    precise(&mut rig);
    let first = rig.station().received.len();
    rig.run(5.0);
    let mut positions: BTreeMap<Duration, TimeStamp> = BTreeMap::new();
    let mut pairs = 0;
    for (at, _, message) in &rig.station().received[first..] {
        match message {
            Message::InertialStates(states) => {
                positions.insert(*at, states.time_stamp.expect("a stamp"));
            }
            // Made with the 4000 that has just arrived, of what the vehicle had reported by then.
            Message::FromToNextWaypointStates(states) => {
                if let Some(stamp) = positions.get(at) {
                    assert_eq!(states.time_stamp, Some(*stamp), "{at:?}");
                    pairs += 1;
                }
            }
            _ => {}
        }
    }
    assert!(pairs >= 8, "{pairs}");
}

/// One camera looks down from a vehicle on a slow link; another looks to the sky, where its direction is all that is known.
#[test]
fn what_a_camera_sees_is_stamped_with_the_moment_of_the_position() {
    let mut rig = Rig::ready_with(Setup {
        mav: Faults::NONE.delayed_ms(120, 120),
        vehicles: vec![Config {
            payloads: 2,
            ..Config::default()
        }],
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    });
    let (sky, ground) = (0b01, 0b10);
    rig.done(CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0e)),
        controlled_station_1_16: Some(StationBitmap1To16::from_raw(sky | ground)),
        ..orders::request_control()
    });
    rig.take_off(30.0);
    for (station, up_deg) in [(sky, 20.0), (ground, -40.0)] {
        let station = Some(StationBitmap1To16::from_raw(station));
        rig.done(EoIrLaserPayloadCommand {
            station_number_1_16: station,
            set_eo_ir_pointing_mode: Some(EoirPointingMode::AngleToUa),
            ..EoIrLaserPayloadCommand::default()
        });
        rig.done(PayloadSteeringCommand {
            station_number_1_16: station,
            set_centreline_azimuth_angle: Some(Bam16::from_degrees(20.0)),
            set_centreline_elevation_angle: Some(Bam16::from_degrees(up_deg)),
            ..PayloadSteeringCommand::default()
        });
    }
    precise(&mut rig);
    let first = rig.station().received.len();
    rig.run(6.0);
    // Its relative altitude is of the position as well.
    rig.done(GenericInformationRequestMessage {
        message_type: Some(3016),
        ..GenericInformationRequestMessage::default()
    });
    rig.run(1.0);
    let (mut positions, mut of_position): (Vec<TimeStamp>, Vec<TimeStamp>) = Default::default();
    let last = rig.clock.elapsed() - Duration::from_millis(500);
    for (index, (at, _, message)) in rig.station().received.iter().enumerate() {
        match message {
            Message::InertialStates(m) => positions.extend(m.time_stamp),
            Message::EoIrLaserOperatingState(m) if index >= first && *at < last => {
                let sees_ground = m.station_number_1_16 == Some(ground);
                assert_eq!(m.image_position, Some(u8::from(sees_ground)));
                of_position.extend(m.time_stamp);
            }
            Message::RelativeRouteWaypointLocationReport(m) => of_position.extend(m.time_stamp),
            _ => {}
        }
    }
    assert!(of_position.len() > 20, "{} reports", of_position.len());
    for stamp in of_position {
        let apart_ms = positions.iter().map(|of| of.0.abs_diff(stamp.0)).min();
        // The report of the second station, and one of a position that was reported before, are stamped a millisecond later.
        assert!(
            apart_ms.is_some_and(|apart| apart <= 2),
            "{stamp:?}: {apart_ms:?}"
        );
    }
    assert_stamps_rise(&rig);
}

/// Degrees by which the heading of each 4000 differs from that of the vehicle at its stamp, by a track of (s, rad).
fn heading_errors_deg(rig: &Rig, first: usize, track: &[(f64, f64)]) -> Vec<f64> {
    let turn = |from: f64, to: f64| (to - from + PI).rem_euclid(TAU) - PI;
    let reported =
        rig.station().received[first..]
            .iter()
            .filter_map(|(_, _, message)| match message {
                Message::InertialStates(states) => {
                    Some((states.heading?.radians(), seconds_of(states.time_stamp?)))
                }
                _ => None,
            });
    let errors = reported.filter_map(|(heading, stamp)| {
        let after = track.iter().position(|(at, _)| *at >= stamp)?;
        let [(from, before), (to, behind)] = [track[after.checked_sub(1)?], track[after]];
        let then = before + turn(before, behind) * (stamp - from) / (to - from);
        Some(turn(then, heading).to_degrees())
    });
    errors.collect()
}

/// ATTITUDE of another moment would be degrees off.
#[test]
fn the_heading_in_a_fast_turn_is_that_of_the_moment_of_the_stamp() {
    let mut rig = Rig::ready();
    rig.take_off(30.0);
    rig.done(VehicleOperatingModeCommand {
        heading_command_type: Some(HeadingCommandType::TurnRate),
        commanded_turn_rate: Some(Scaled::saturating_from_si(1.0)),
        ..orders::mode(FlightPathControlMode::Autopilot)
    });
    rig.run(5.0);
    precise(&mut rig);
    let first = rig.station().received.len();
    let mut track = Vec::new();
    for _ in 0..500 {
        rig.run(0.01);
        track.push((rig.clock.elapsed().as_secs_f64(), rig.truth().attitude[2]));
    }
    let (from, to) = (track[0].1, track[50].1);
    let turned = (to - from).rem_euclid(TAU);
    assert!((0.4..0.6).contains(&turned), "{turned} rad in 0.5 s");
    let errors = heading_errors_deg(&rig, first, &track);
    assert!(errors.len() > 10, "{} reports", errors.len());
    assert!(largest(&errors) < 1.0, "{errors:?}");
}

/// A computer that knows leap seconds by its clock alone shows the last second of the day twice.
#[test]
fn the_stamps_of_a_leap_second_do_not_fall() {
    let mut rig = flying(Faults::NONE);
    rig.clock.set_wall_step(-1.0);
    let first = rig.station().received.len();
    rig.run(6.0);
    assert!(rig.station().received.len() > first + 40);
    assert_stamps_rise(&rig);
    // A command of that second is taken as any other.
    let hold = orders::mode(FlightPathControlMode::Loiter);
    rig.done(hold);
}

#[test]
fn a_queue_on_the_way_counts_no_more_than_the_shortest_round_trip_leaves_open() {
    let mut rig = flying(Faults::NONE.delayed_ms(30, 400));
    rig.run(30.0);
    let errors = errors_ms(&mut rig, 10.0, |_| ());
    let status = rig
        .bridge
        .as_ref()
        .map(|one| one.status(String::new(), rig.now().mono))
        .expect("it runs");
    let half_ms = status.vehicles[0].link.round_trip_s.expect("it answers") * 500.0;
    assert!(largest(&errors) < half_ms + 20.0, "{half_ms}: {errors:?}");
    assert_stamps_rise(&rig);
}

#[test]
fn without_timesync_the_stamp_is_when_it_arrived() {
    let mut rig = flying(Faults::NONE.delayed_ms(80, 80));
    let errors = errors_ms(&mut rig, 6.0, |_| ());
    assert!(largest(&errors) < 20.0, "{errors:?}");
    let silent = HealthFaults {
        clock: ClockFault::Silent,
        ..HealthFaults::default()
    };
    rig.vehicles[0].vehicle_mut().set_health_faults(silent);
    // What is known of the clock stays true until the vehicle restarts or is lost.
    rig.restart_bridge();
    rig.run(8.0);
    rig.done(orders::request_control());
    rig.run(1.0);
    let errors = errors_ms(&mut rig, 6.0, |_| ());
    assert!(
        errors.iter().all(|error| (70.0..110.0).contains(error)),
        "{errors:?}"
    );
    let status = rig
        .bridge
        .as_ref()
        .map(|one| one.status(String::new(), rig.now().mono));
    assert!(!status.expect("it runs").vehicles[0].link.clock_known);
}

/// A stopped process (SIGSTOP), or a computer that slept: the oldest of what arrived meanwhile is read at once, seconds later.
#[test]
fn what_waited_while_the_bridge_did_not_run_is_not_stamped_as_of_now() {
    for (answers, timers_first) in [(true, true), (true, false), (false, true), (false, false)] {
        let mut rig = flying(Faults::NONE);
        if !answers {
            let silent = HealthFaults {
                clock: ClockFault::Silent,
                ..HealthFaults::default()
            };
            rig.vehicles[0].vehicle_mut().set_health_faults(silent);
            rig.restart_bridge();
            rig.run(8.0);
            rig.done(orders::request_control());
        }
        precise(&mut rig);
        let before = rig.station().alerts().len();
        let mut round = 0_u32;
        let errors = errors_ms(&mut rig, 25.0, |rig| {
            round += 1;
            if round == 400 {
                rig.suspend_bridge(13.0, timers_first);
            }
        });
        let case = format!("answers {answers}, timers first {timers_first}");
        // The track has a gap of 13 s: between its ends it is a straight line at one speed, about.
        assert!(largest(&errors) < 500.0, "{case}: {errors:?}");
        assert_stamps_rise(&rig);
        let alerts = &rig.station().alerts()[before..];
        for words in [
            "no data from the vehicle",
            "no longer arrives",
            "has received nothing",
            "stopped reporting its position",
        ] {
            let none = alerts.iter().all(|text| !text.contains(words));
            assert!(none, "{case}: {alerts:?}");
        }
    }
}

/// What somebody beside the vehicle sends: an answer to whatever may have been asked just now, ten seconds wrong.
fn forged(rig: &Rig) -> Vec<u8> {
    let answer = MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: (rig.clock.elapsed() + Duration::from_secs(10)).as_nanos() as i64,
        ts1: rig.now().mono.as_nanos() as i64,
        ..TIMESYNC_DATA::default()
    });
    let header = Header {
        seq: 7,
        system_id: 1,
        component_id: 1,
        message_id: 0,
        incompat: 0,
        compat: 0,
    };
    let mut bytes = [0; MAX_FRAME];
    let length = frame::encode(&answer, header, &mut bytes);
    bytes[..length].to_vec()
}

#[test]
fn unsigned_answers_on_a_signed_link_move_nothing() {
    let mut rig = flying(Faults::NONE);
    let mut sent = 0;
    let before = errors_ms(&mut rig, 6.0, |_| ());
    let errors = errors_ms(&mut rig, 12.0, |rig| {
        let (now, bytes) = (rig.clock.elapsed(), forged(rig));
        rig.mav.send(now, vehicle_address(0), bridge_mav(0), bytes);
        sent += 1;
    });
    assert!(sent > 1_000);
    assert!(
        largest(&errors) < largest(&before) + 3.0,
        "{before:?}: {errors:?}"
    );
    let status = rig
        .bridge
        .as_ref()
        .map(|one| one.status(String::new(), rig.now().mono))
        .expect("it runs");
    let refused: u64 = status.vehicles[0].link.refused.values().sum();
    assert!(
        refused >= sent - 10,
        "{:?}",
        status.vehicles[0].link.refused
    );
}

#[test]
fn a_vehicle_whose_clock_lies_is_stamped_by_arrival_and_never_ahead() {
    let mut rig = flying(Faults::NONE);
    let lie = |rig: &mut Rig, clock| {
        let faults = HealthFaults {
            clock,
            ..HealthFaults::default()
        };
        rig.vehicles[0].vehicle_mut().set_health_faults(faults);
    };
    // For good, by more than a message can take, and now and then.
    for ahead_ms in [2_000, -2_000, 86_400_000, i32::MIN] {
        lie(&mut rig, ClockFault::AheadMs(ahead_ms));
        rig.run(20.0);
        let errors = errors_ms(&mut rig, 6.0, |_| ());
        assert!(
            errors.iter().all(|error| (-5.0..50.0).contains(error)),
            "{ahead_ms}: {errors:?}"
        );
    }
    lie(&mut rig, ClockFault::None);
    rig.run(20.0);
    let errors = errors_ms(&mut rig, 6.0, |_| ());
    assert!(largest(&errors) < 12.0, "{errors:?}");
    let mut round = 0_u32;
    let errors = errors_ms(&mut rig, 12.0, |rig| {
        round += 1;
        let now_and_then = round.is_multiple_of(300);
        lie(
            rig,
            if now_and_then {
                ClockFault::AheadMs(1_500)
            } else {
                ClockFault::None
            },
        );
    });
    assert!(
        errors.iter().all(|error| (-5.0..50.0).contains(error)),
        "{errors:?}"
    );
    assert_stamps_rise(&rig);
}

#[test]
fn a_restart_of_the_vehicle_begins_anew_and_stamps_still_rise() {
    let mut rig = Rig::ready_with(Setup {
        mav: Faults::NONE.delayed_ms(60, 60),
        ..Setup::default()
    });
    let age_ms = |rig: &Rig| {
        let at = rig.clock.elapsed().as_secs_f64();
        let stamp = rig
            .station()
            .last(vehicle_id(0), 4000, |message| match message {
                Message::InertialStates(states) => states.time_stamp,
                _ => None,
            });
        (at - seconds_of(stamp.expect("a 4000"))) * 1e3
    };
    rig.run(5.0);
    rig.vehicles[0].restart();
    rig.run(20.0);
    assert!((60.0..300.0).contains(&age_ms(&rig)), "{}", age_ms(&rig));
    let status = rig
        .bridge
        .as_ref()
        .map(|one| one.status(String::new(), rig.now().mono))
        .expect("it runs");
    let link = &status.vehicles[0].link;
    assert!(
        link.clock_known
            && link
                .round_trip_s
                .is_some_and(|trip| (0.1..0.2).contains(&trip)),
        "{link:?}"
    );
    assert_stamps_rise(&rig);
}

#[test]
fn a_cucs_whose_clock_is_off_by_more_than_a_second_is_named_and_cleared() {
    for (ahead_ms, words) in [
        (1_400_i64, "are over 1 s ahead of"),
        (-1_400, "are over 1 s behind"),
    ] {
        let mut rig = Rig::ready();
        let beat = |rig: &mut Rig, ahead_ms: i64| {
            for _ in 0..25 {
                let wall_ms = rig.now().wall.as_millis() as i64 + ahead_ms;
                let beat = Heartbeat {
                    time_stamp: Some(TimeStamp::from_unix_ms(wall_ms as u64)),
                };
                rig.stations[0].send_as_is(vehicle_id(0), &beat.into());
                rig.run(1.0);
            }
        };
        beat(&mut rig, 300);
        assert!(
            !rig.station().has_alert("this computer's clock"),
            "{:?}",
            rig.station().alerts()
        );
        beat(&mut rig, ahead_ms);
        assert!(
            rig.station().has_alert(words),
            "{ahead_ms}: {:?}",
            rig.station().alerts()
        );
        beat(&mut rig, 0);
        assert!(
            rig.station().has_alert("cleared: the time stamps of CUCS"),
            "{:?}",
            rig.station().alerts()
        );
    }
}
