//! Nothing is resumed that its CUCS could not command now: neither after a release, nor past a later command. Who lost
//! control by silence starts afresh.

use kit::bridge::{Rig, orders};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, LoiBitmap, RequestedAccess, RouteType,
};
use stanag_msgs::messages::{CucsAuthorisationRequest, UaRoute};
use stanag_msgs::{Message, Scaled, Text};

fn release() -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::NONE),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..CucsAuthorisationRequest::default()
    }
}

#[test]
fn a_launch_that_has_not_begun_ends_with_the_release() {
    let mut rig = Rig::ready();
    let launch = rig.send(orders::launch(20.0));
    rig.run(0.05);
    rig.done(release());
    rig.run(25.0);
    assert_eq!(rig.end(launch), Some(AckType::Refused));
    let truth = rig.truth();
    assert!(truth.landed && !truth.armed, "{truth:?}");
}

#[test]
fn a_command_that_waits_for_its_route_gives_way_to_a_later_one() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let contingency = UaRoute {
        route_id: Some(Text::new("CA")),
        route_type: Some(RouteType::ContingencyA),
        ..orders::route(7)
    };
    let plan: Vec<Message> = vec![
        contingency.into(),
        orders::waypoint(7, 8, 50.0, 0.0, 20.0).into(),
        orders::waypoint(8, 0, 50.0, 50.0, 20.0).into(),
    ];
    rig.send_plan(plan);
    let earlier = rig.send(orders::mode(Mode::ContingencyA));
    rig.run(0.02);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(15.0);
    assert_eq!(
        rig.end(earlier),
        Some(AckType::Refused),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(rig.truth().mode, px4_sim::Mode::Loiter);
}

#[test]
fn a_refused_command_leaves_the_altimeter_setting_as_it_was() {
    let mut rig = Rig::ready();
    let mut refused = orders::mode(Mode::AutolandWaveOff);
    refused.altimeter_setting = Scaled::from_si(99_000.0).ok();
    let kept = |rig: &Rig| {
        rig.store
            .records
            .keys()
            .any(|name| name.starts_with("altimeter"))
    };
    assert_eq!(rig.carry_out(refused), Some(AckType::Refused));
    assert!(!kept(&rig));
    let mut taken = orders::mode(Mode::Loiter);
    taken.altimeter_setting = Scaled::from_si(99_000.0).ok();
    rig.done(taken);
    assert!(kept(&rig));
}

/// It asked for LOI 2 by name and keeps that. The heartbeats of before the loss must not cost it control once more.
#[test]
fn who_lost_control_by_silence_may_come_back_without_heartbeats() {
    for restart in [false, true] {
        let mut rig = Rig::ready();
        rig.stations[0].heartbeats = true;
        rig.run(2.0);
        rig.stations[0].heartbeats = false;
        let status = |rig: &Rig| {
            let bridge = rig.bridge.as_ref().unwrap();
            bridge.status(String::new(), rig.now().mono).vehicles[0].clone()
        };
        let controls = |rig: &Rig| status(rig).controller.is_some();
        assert!(controls(&rig));
        assert!(rig.until(20.0, |rig| !controls(rig)), "silence counts");
        let rights = status(&rig).rights;
        assert_eq!(
            rights.values().copied().collect::<Vec<_>>(),
            [1],
            "LOI 2 is kept"
        );
        rig.run(1.0);
        if restart {
            rig.restart_bridge();
            rig.run(1.0);
        }
        rig.done(orders::request_control());
        rig.run(60.0);
        assert!(
            controls(&rig),
            "restart {restart}: {:?}",
            rig.station().alerts()
        );

        // Heartbeats that come again count again.
        rig.stations[0].heartbeats = true;
        rig.run(2.0);
        rig.stations[0].heartbeats = false;
        assert!(rig.until(20.0, |rig| !controls(rig)), "restart {restart}");
    }
}
