//! What a CUCS may not do, and what is sent in its name, uses up none of the moments in which it will command: not in
//! memory, and not over a restart.

use std::time::Duration;

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, PositiveHandoverAuthorisationRequest, UaStickCommand,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Message, TimeStamp};

const DONE: Option<AckType> = Some(AckType::CarriedOut);

/// The clock of the stations, so many ms ahead.
fn stamp(rig: &Rig, ahead_ms: u64) -> TimeStamp {
    let at = rig.now().wall + Duration::from_millis(ahead_ms);
    TimeStamp::from_unix_ms(at.as_millis() as u64)
}

/// What somebody sends as station 1, with a stamp of the future: nothing of it is authorised.
fn forged(stamp: TimeStamp) -> [Message; 6] {
    let time_stamp = Some(stamp);
    let request = |levels, access| CucsAuthorisationRequest {
        time_stamp,
        requested_handover_loi: Some(levels),
        requested_handover_access: Some(access),
        ..orders::request_control()
    };
    let wish = PositiveHandoverAuthorisationRequest {
        time_stamp,
        requested_handover_loi: Some(LoiBitmap::LOI4),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    [
        VehicleOperatingModeCommand {
            time_stamp,
            ..orders::mode(Mode::Loiter)
        }
        .into(),
        request(LoiBitmap::LOI4, RequestedAccess::Request).into(),
        request(LoiBitmap::LOI4, RequestedAccess::Relinquish).into(),
        request(LoiBitmap::LOI2, RequestedAccess::Request).into(),
        wish.into(),
        UaStickCommand {
            time_stamp,
            ..UaStickCommand::default()
        }
        .into(),
    ]
}

#[test]
fn what_is_not_authorised_uses_up_no_moment_to_come() {
    let stations = Setup {
        stations: 2,
        ..Setup::default()
    };
    for kind in 0..6 {
        let mut rig = Rig::ready_with(stations.clone());
        // Every second of 25 minutes that begin in two; then others, for which those are forgotten.
        let first = stamp(&rig, 120_000);
        for n in 0..1_500 {
            let of = TimeStamp(first.0 + 1_000 * n);
            let message = &forged(of)[kind];
            rig.stations[1].send_as_is(vehicle_id(0), message);
            if n % 20 == 19 {
                rig.run(0.05);
            }
        }
        rig.run(65.0);
        for n in 0..1_600 {
            let of = TimeStamp(first.0 + 7_200_000 + 2_000 * n);
            rig.stations[1].send_as_is(vehicle_id(0), &forged(of)[kind]);
            if n % 20 == 19 {
                rig.run(0.05);
            }
        }
        if kind % 2 == 0 {
            rig.restart_bridge();
        }
        // In the time that was meant the station itself takes control, and flies.
        rig.run(180.0);
        assert!(stamp(&rig, 0) > first, "too early for this test");
        rig.stations[1].heartbeats = true;
        rig.run(10.0);
        let release = CucsAuthorisationRequest {
            requested_handover_access: Some(RequestedAccess::Relinquish),
            ..orders::request_control()
        };
        rig.done(release);
        let control = rig.send_as(1, 0, orders::request_control());
        assert_eq!(rig.end_as(1, control), DONE, "{kind}");
        for _ in 0..10 {
            let waypoint = orders::waypoint(300, 0, 10.0, 0.0, 20.0);
            let ticket = rig.send_as(1, 0, waypoint);
            let alerts = rig.stations[1].alerts();
            assert_eq!(rig.end_as(1, ticket), DONE, "{kind}: {alerts:?}");
            rig.run(0.3);
        }
        for _ in 0..30 {
            let sticks = UaStickCommand {
                time_stamp: Some(stamp(&rig, 0)),
                ..UaStickCommand::default()
            };
            rig.stations[1].send_as_is(vehicle_id(0), &sticks.into());
            rig.run(0.05);
        }
        let by_hand = rig.send_as(1, 0, orders::mode(Mode::FlightDirector));
        rig.run(0.1);
        let alerts = rig.stations[1].alerts();
        let missing = "no sticks (2010) received";
        assert!(
            !alerts.iter().any(|alert| alert.contains(missing)),
            "{kind}: {alerts:?}"
        );
        rig.stations[1].give_up(by_hand);
    }
}
