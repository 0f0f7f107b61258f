//! Nothing is resumed that its CUCS could not command now: neither after a release, nor past a later command.

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
    assert_eq!(rig.carry_out(release()), Some(AckType::CarriedOut));
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
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Loiter)),
        Some(AckType::CarriedOut)
    );
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
    assert_eq!(rig.carry_out(taken), Some(AckType::CarriedOut));
    assert!(kept(&rig));
}
