//! Wings: the landing pattern of the configuration, the loss of the controlling station in it and in a transition, and a VTOL
//! that drops out of its wings. Whole flights are flown by `tests/interop/wings.py`.

use kit::bridge::{Rig, Setup, orders};
use px4_sim::{Airframe, Config, HealthFaults, Mode as Px4};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, LoiBitmap, LoiterType, MissionPlanMode, RequestedAccess,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, LoiterConfiguration, PositiveHandoverAuthorisationRequest,
    VehicleOperatingModeCommand,
};

fn winged(airframe: Airframe, tables: &'static str) -> Rig {
    Rig::ready_with(Setup {
        vehicles: vec![Config {
            airframe,
            ..Config::default()
        }],
        vehicle_keys: "landing = { course_deg = 90.0, height_m = 40.0 }",
        tables,
        stations: 2,
        ..Setup::default()
    })
}

fn done(rig: &mut Rig, message: impl Into<stanag_msgs::Message>) {
    let end = rig.carry_out(message);
    assert_eq!(
        end,
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
}

/// In the air, with a route of two waypoints aboard.
fn flies(airframe: Airframe, tables: &'static str) -> Rig {
    let mut rig = winged(airframe, tables);
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 300.0, 0.0, 60.0).into(),
        orders::waypoint(2, 0, 600.0, 300.0, 60.0).into(),
    ]);
    done(&mut rig, orders::load());
    rig.take_off(50.0);
    let up = rig.until(200.0, |rig| {
        rig.truth().mode == Px4::Loiter && !rig.truth().landed
    });
    assert!(up, "{:?}", rig.truth());
    rig
}

#[test]
fn a_configured_pattern_lands_a_wing_from_its_route() {
    let mut rig = flies(Airframe::Plane, "");
    done(&mut rig, orders::mode(Mode::Waypoint));
    // The loiter at the end of the route, not the landing.
    assert!(rig.until(200.0, |rig| rig.truth().mission_seq == 2));
    rig.run(60.0);
    assert_eq!(
        (rig.truth().mission_seq, rig.truth().mode),
        (2, Px4::Mission)
    );
    done(&mut rig, orders::mode(Mode::AutolandEngage));
    let down = rig.until(400.0, |rig| !rig.truth().armed);
    let truth = rig.truth();
    assert!(down, "{truth:?} {:?}", rig.station().alerts());
    let off_m = truth.position.n.hypot(truth.position.e);
    assert!(off_m < 150.0, "{truth:?}");
}

#[test]
fn the_loss_action_takes_a_wing_out_of_its_landing() {
    let mut rig = flies(Airframe::Plane, "[authority]\non_loss = \"hold\"\n");
    rig.stations[0].heartbeats = true;
    done(&mut rig, orders::mode(Mode::AutolandEngage));
    // In the loiter before the glide: 2 the loiter at the end of the route, 3 DO_LAND_START.
    assert!(rig.until(100.0, |rig| rig.truth().mission_seq >= 4));
    rig.stations[0].heartbeats = false;
    let held = rig.until(40.0, |rig| rig.truth().mode == Px4::Loiter);
    assert!(held && !rig.truth().landed, "{:?}", rig.truth());
}

#[test]
fn the_loss_action_waits_for_no_transition() {
    let mut rig = winged(Airframe::Vtol, "[authority]\non_loss = \"rtl\"\n");
    rig.stations[0].heartbeats = true;
    rig.take_off(40.0);
    // AUTO.VTOL_TAKEOFF climbs, and transitions.
    rig.stations[0].heartbeats = false;
    let home = rig.until(60.0, |rig| rig.truth().mode == Px4::Rtl);
    assert!(home, "{:?} {:?}", rig.truth(), rig.stations[1].alerts());
}

#[test]
fn a_vtol_that_drops_out_of_its_wings_raises_an_alert() {
    let mut rig = flies(Airframe::Vtol, "");
    assert!(!rig.station().has_alert("transition failed"));
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults {
            quad_chute: true,
            ..HealthFaults::default()
        });
    let text = "transition failed: the VTOL fell back to hovering (quad-chute)";
    let alerted = rig.until(20.0, |rig| rig.station().has_alert(text));
    assert!(alerted, "{:?}", rig.station().alerts());
    assert_eq!(rig.truth().mode, Px4::Rtl);
}

/// On wings, in PX4's course mode.
fn steered(tables: &'static str) -> Rig {
    let mut rig = flies(Airframe::Plane, tables);
    rig.stations[0].heartbeats = true;
    done(&mut rig, orders::mode(Mode::Autopilot));
    assert_eq!(rig.truth().mode, Px4::Course);
    rig
}

#[test]
fn a_steered_wing_is_held_when_its_controller_is_lost() {
    let mut rig = steered("");
    rig.stations[0].heartbeats = false;
    let held = rig.until(60.0, |rig| rig.truth().mode == Px4::Loiter);
    assert!(held, "{:?} {:?}", rig.truth(), rig.stations[1].alerts());
}

#[test]
fn a_steered_wing_is_held_when_control_of_it_is_released() {
    let mut rig = steered("");
    rig.send(CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    });
    let held = rig.until(20.0, |rig| rig.truth().mode == Px4::Loiter);
    assert!(held, "{:?}", rig.truth());
}

#[test]
fn a_wing_on_its_final_approach_lands_when_its_controller_is_lost() {
    let mut rig = flies(Airframe::Plane, "[authority]\non_loss = \"hold\"\n");
    rig.stations[0].heartbeats = true;
    done(&mut rig, orders::mode(Mode::AutolandEngage));
    // 2 the loiter at the end of the route, 3 DO_LAND_START, 4 the loiter before the glide, 5 the touch-down.
    assert!(rig.until(400.0, |rig| rig.truth().mission_seq == 5));
    assert!(rig.until(100.0, |rig| -rig.truth().position.d < 35.0));
    // Another mission would put it on hold here.
    for command in [orders::load(), orders::transfer(MissionPlanMode::Clear)] {
        assert_eq!(rig.carry_out(command), Some(AckType::Refused));
        assert!(
            rig.station()
                .has_alert("final approach: abort the landing first")
        );
    }
    assert_eq!(rig.truth().mode, Px4::Mission);
    rig.stations[0].heartbeats = false;
    let left = rig.until(300.0, |rig| {
        !rig.truth().armed || rig.truth().mode != Px4::Mission
    });
    let truth = rig.truth();
    assert!(left && truth.landed, "{truth:?}");
}

#[test]
fn launch_and_landing_of_a_vtol_pass_to_another_by_override_only() {
    // Else it is forwarded to the holder, who has 20 s.
    let refused = |rig: &mut Rig| {
        let wish = PositiveHandoverAuthorisationRequest {
            requested_handover_loi: Some(LoiBitmap::LOI4),
            requesting_cucs_id: Some(rig.stations[1].id),
            ..PositiveHandoverAuthorisationRequest::default()
        };
        let wish = rig.send_as(1, 0, wish);
        rig.run(2.0);
        rig.stations[1].end(wish) == Some(AckType::Refused)
    };
    let mut rig = winged(Airframe::Vtol, "");
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 300.0, 0.0, 60.0).into(),
        orders::waypoint(2, 0, 600.0, 300.0, 60.0).into(),
    ]);
    done(&mut rig, orders::load());
    rig.send(orders::launch(40.0));
    assert!(rig.until(60.0, |rig| rig.truth().mode == Px4::VtolTakeoff));
    assert!(refused(&mut rig), "{:?}", rig.stations[1].alerts());
    assert!(rig.until(200.0, |rig| rig.truth().mode == Px4::Loiter));
    rig.run(10.0);
    done(&mut rig, orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.truth().mode, Px4::Mission);
    assert!(refused(&mut rig), "{:?}", rig.stations[1].alerts());
    done(&mut rig, orders::mode(Mode::Loiter));
    assert!(!refused(&mut rig), "it neither takes off nor lands");
}

#[test]
fn a_vtol_that_hovers_transitions_before_it_flies_on_along_its_route() {
    let mut rig = flies(Airframe::Vtol, "");
    done(&mut rig, orders::mode(Mode::Waypoint));
    // 0 transition, 1 and 2 the waypoints.
    assert!(rig.until(200.0, |rig| rig.truth().mission_seq == 2));
    done(
        &mut rig,
        LoiterConfiguration {
            loiter_type: Some(LoiterType::Hover),
            ..LoiterConfiguration::default()
        },
    );
    let speed = |rig: &Rig| {
        let velocity = rig.truth().velocity;
        velocity.n.hypot(velocity.e)
    };
    for waypoint in [None, Some(1)] {
        done(&mut rig, orders::mode(Mode::Loiter));
        let hovers = rig.until(60.0, |rig| speed(rig) < 1.0);
        assert!(hovers, "{:?}", rig.truth());
        done(
            &mut rig,
            VehicleOperatingModeCommand {
                commanded_waypoint_number: waypoint,
                ..orders::mode(Mode::Waypoint)
            },
        );
        rig.run(5.0);
        let truth = rig.truth();
        assert_eq!(truth.mode, Px4::Mission);
        assert!(speed(&rig) > 8.0, "it hovers along its route: {truth:?}");
    }
}
