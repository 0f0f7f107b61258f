//! Wings: the landing pattern of the configuration, the loss of the controlling station in it and in a transition, and a VTOL
//! that drops out of its wings. Whole flights are flown by `tests/interop/wings.py`.

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use px4_sim::{Airframe, Config, HealthFaults, Mode as Px4, VtolState};
use stanag_msgs::enums::{
    AckType, AltitudeCommandType, AltitudeType, AreaPlanMode, AreaType,
    FlightPathControlMode as Mode, HeadingCommandType, LoiBitmap, LoiterType, MissionPlanMode,
    RequestedAccess, RouteType,
};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, CucsAuthorisationRequest, LoiterConfiguration,
    MissionTransferCommand, PositiveHandoverAuthorisationRequest, UaPositionWaypoint, UaRoute,
    VehicleOperatingModeCommand, VehicleSpecificWaypoint,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled, Text};

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

/// In the air, with a route of two waypoints aboard.
fn flies(airframe: Airframe, tables: &'static str) -> Rig {
    let mut rig = winged(airframe, tables);
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 300.0, 0.0, 60.0).into(),
        orders::waypoint(2, 0, 600.0, 300.0, 60.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(50.0);
    let up = rig.until(200.0, |rig| {
        rig.truth().mode == Px4::Loiter && !rig.truth().landed
    });
    assert!(up, "{:?}", rig.truth());
    rig
}

/// Mode 21 climbs, and flies on along the launch route; mode 11 then flies what 13000 has loaded.
#[test]
fn a_launch_route_is_flown_after_the_climb() {
    for airframe in [Airframe::Plane, Airframe::Vtol] {
        let mut rig = winged(airframe, "");
        for (name, kind, first, north) in [
            ("L", RouteType::Launch, 1, 500.0),
            ("F", RouteType::Flight, 21, 900.0),
        ] {
            let route = UaRoute {
                route_id: Some(Text::new(name)),
                route_type: Some(kind),
                ..orders::route(first)
            };
            rig.send_plan(vec![
                route.into(),
                orders::waypoint(first, first + 1, north, 0.0, 60.0).into(),
                orders::waypoint(first + 1, 0, north, 300.0, 60.0).into(),
            ]);
        }
        let flight = MissionTransferCommand {
            route_id: Some(Text::new("F")),
            ..orders::load()
        };
        rig.done(flight);
        let launched = rig.send(orders::launch(50.0));
        let reached = rig.until(300.0, |rig| {
            let at = rig.truth().position;
            rig.truth().mode == Px4::Mission && (at.n - 500.0).abs() < 60.0 && at.e > 150.0
        });
        assert!(
            reached,
            "{airframe:?}: {:?} {:?}",
            rig.truth(),
            rig.station().alerts()
        );
        assert_eq!(rig.end(launched), Some(AckType::CarriedOut));
        rig.done(orders::mode(Mode::Waypoint));
        let reached = rig.until(200.0, |rig| (rig.truth().position.n - 900.0).abs() < 60.0);
        assert!(reached, "{airframe:?}: {:?}", rig.truth());
    }
}

/// 13006.
fn turn(number: u16, tag: &str) -> Message {
    VehicleSpecificWaypoint {
        waypoint_number: Some(number),
        tag_data: Some(Text::new(tag)),
        ..VehicleSpecificWaypoint::default()
    }
    .into()
}

/// UA State of every 3002 so far, repeats left out.
fn ua_states(rig: &Rig) -> Vec<u8> {
    let mut states = Vec::new();
    for message in &rig.station().received {
        if let (_, _, Message::VehicleOperatingStates(report)) = message
            && let Some(state) = report.ua_state.map(|state| state.raw())
            && states.last() != Some(&state)
        {
            states.push(state);
        }
    }
    states
}

#[test]
fn a_vtol_transitions_between_the_legs_of_its_route_and_reports_it() {
    let mut rig = winged(Airframe::Vtol, "");
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 200.0, 0.0, 60.0).into(),
        orders::waypoint(2, 3, 300.0, 150.0, 60.0).into(),
        turn(2, "TRANSITION HOVER"),
        orders::waypoint(3, 4, 270.0, 180.0, 70.0).into(),
        turn(3, "TRANSITION WINGS"),
        orders::waypoint(4, 0, 0.0, 250.0, 60.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(40.0);
    let up =
        |rig: &Rig| rig.truth().mode == Px4::Loiter && rig.truth().vtol == Some(VtolState::Wings);
    assert!(rig.until(200.0, up), "{:?}", rig.truth());
    rig.done(orders::mode(Mode::Waypoint));
    let hovers = |rig: &Rig| rig.truth().vtol == Some(VtolState::Hover);
    assert!(rig.until(200.0, hovers), "{:?}", rig.truth());
    // Waypoint 3, 42 m on and 10 m up, at the speed of a hover.
    let begun = rig.truth();
    let wings = |rig: &Rig| rig.truth().vtol == Some(VtolState::Wings);
    assert!(rig.until(200.0, wings), "{:?}", rig.truth());
    let at = rig.truth();
    assert!(
        (at.time - begun.time).as_secs_f64() > 8.0,
        "{begun:?} {at:?}"
    );
    let off = [at.position.n - 270.0, at.position.e - 180.0];
    assert!(
        off[0].hypot(off[1]) < 60.0 && -at.position.d > 62.0,
        "{at:?}"
    );
    assert!(
        rig.until(200.0, |rig| rig.truth().position.n < 20.0),
        "{:?}",
        rig.truth()
    );
    let states = ua_states(&rig);
    // To wings after the launch, to a hover, to wings again.
    let turns: Vec<u8> = states
        .into_iter()
        .filter(|state| [14, 15].contains(state))
        .collect();
    assert_eq!(turns, [14, 15, 14]);
    assert!(!rig.station().has_alert("transition failed"));
}

#[test]
fn a_route_is_begun_in_the_state_that_its_leg_is_flown_in() {
    let mut rig = winged(Airframe::Vtol, "");
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 200.0, 0.0, 60.0).into(),
        turn(1, "TRANSITION HOVER"),
        orders::waypoint(2, 3, 230.0, 30.0, 60.0).into(),
        turn(2, "TRANSITION WINGS"),
        orders::waypoint(3, 0, 0.0, 250.0, 60.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(40.0);
    let up =
        |rig: &Rig| rig.truth().mode == Px4::Loiter && rig.truth().vtol == Some(VtolState::Wings);
    assert!(rig.until(200.0, up), "{:?}", rig.truth());
    let mut to_2 = orders::mode(Mode::Waypoint);
    to_2.commanded_waypoint_number = Some(2);
    rig.done(to_2);
    // PX4 would fly there on its wings, and circle.
    assert_eq!(rig.truth().vtol, Some(VtolState::Hover));
    assert!(rig.until(200.0, |rig| rig.truth().vtol == Some(VtolState::Wings)));
}

#[test]
fn what_a_13006_does_not_mean_is_refused() {
    let mut rig = winged(Airframe::Vtol, "");
    for tag in ["FLAPS DOWN", "transition hover"] {
        let end = rig.carry_out(turn(1, tag));
        assert_eq!(end, Some(AckType::Refused), "{tag}");
        assert!(
            rig.station().has_alert("TRANSITION WINGS"),
            "{:?}",
            rig.station().alerts()
        );
    }
}

/// A contingency route whose end is north of home.
fn contingency(rig: &mut Rig) {
    let route = UaRoute {
        route_type: Some(RouteType::ContingencyA),
        route_id: Some(Text::new("LOST")),
        ..orders::route(51)
    };
    rig.send_plan(vec![
        route.into(),
        orders::waypoint(51, 52, 500.0, 0.0, 70.0).into(),
        orders::waypoint(52, 0, 500.0, -300.0, 70.0).into(),
        orders::route(1).into(),
        orders::waypoint(1, 2, 300.0, 0.0, 60.0).into(),
        orders::waypoint(2, 0, 600.0, 300.0, 60.0).into(),
    ]);
    rig.done(orders::load());
}

#[test]
fn the_contingency_route_of_wings_is_flown_out_of_a_landing_and_holds_at_its_end() {
    for airframe in [Airframe::Plane, Airframe::Vtol] {
        let mut rig = winged(airframe, "[authority]\non_loss = \"contingency\"\n");
        contingency(&mut rig);
        rig.take_off(50.0);
        let up = |rig: &Rig| rig.truth().mode == Px4::Loiter && !rig.truth().landed;
        assert!(rig.until(200.0, up), "{:?}", rig.truth());
        rig.stations[0].heartbeats = true;
        rig.done(orders::mode(Mode::AutolandEngage));
        let landing = |rig: &Rig| rig.truth().mission_seq >= 4 && rig.truth().mode == Px4::Mission;
        assert!(rig.until(100.0, landing), "{:?}", rig.truth());
        rig.stations[0].heartbeats = false;
        // Another mission goes aboard: to waypoint 51, then the loiter at 52, and no landing without an order.
        let there = |rig: &Rig| {
            let at = rig.truth().position;
            rig.truth().mode == Px4::Mission && (at.n - 500.0).hypot(at.e + 300.0) < 130.0
        };
        assert!(
            rig.until(300.0, there),
            "{airframe:?} {:?} {:?}",
            rig.truth(),
            rig.stations[1].alerts()
        );
        rig.run(90.0);
        assert!(
            there(&rig) && -rig.truth().position.d > 60.0,
            "{airframe:?} {:?}",
            rig.truth()
        );
    }
}

#[test]
fn a_landing_goes_on_without_its_station_where_the_loss_is_no_reason() {
    let mut rig = flies(Airframe::Plane, "[authority]\non_loss = \"continue\"\n");
    rig.stations[0].heartbeats = true;
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(100.0, |rig| rig.truth().mission_seq >= 4));
    rig.stations[0].heartbeats = false;
    let down = rig.until(400.0, |rig| !rig.truth().armed);
    assert!(down, "{:?} {:?}", rig.truth(), rig.stations[1].alerts());
}

#[test]
fn a_hold_in_a_transition_to_wings_ends_in_a_loiter_on_them() {
    let mut rig = winged(Airframe::Vtol, "[authority]\non_loss = \"hold\"\n");
    rig.stations[0].heartbeats = true;
    rig.take_off(40.0);
    let turning = |rig: &Rig| rig.truth().vtol == Some(VtolState::ToWings);
    assert!(rig.until(60.0, turning), "{:?}", rig.truth());
    rig.stations[0].heartbeats = false;
    let held =
        |rig: &Rig| rig.truth().mode == Px4::Loiter && rig.truth().vtol == Some(VtolState::Wings);
    assert!(
        rig.until(60.0, held),
        "{:?} {:?}",
        rig.truth(),
        rig.stations[1].alerts()
    );
    rig.run(30.0);
    assert!(held(&rig) && !rig.truth().landed, "{:?}", rig.truth());
}

/// PX4's DO_CHANGE_ALTITUDE would make a circle of it, and it compares only the centre with its fence.
#[test]
fn an_eight_is_kept_at_another_altitude_and_refused_where_it_leaves_the_fence() {
    let mut rig = flies(Airframe::Plane, "");
    let (latitude, longitude) = orders::place(0.0, 0.0);
    rig.done(AreaVertex {
        area_id: Some(1),
        area_type: Some(AreaType::KeepInCircle),
        vertex_count: Some(1),
        vertex_number: Some(1),
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        radius: Some(1_500.0),
        ..AreaVertex::default()
    });
    rig.done(AreaTransferCommand {
        area_plan_mode: Some(AreaPlanMode::Load),
        ..AreaTransferCommand::default()
    });
    let of_length = |length_m: f64| LoiterConfiguration {
        loiter_type: Some(LoiterType::Figure8),
        loiter_length: Some(Scaled::saturating_from_si(length_m)),
        loiter_bearing: Some(Bam16::from_degrees(90.0)),
        ..LoiterConfiguration::default()
    };
    let around = |north| {
        let (latitude, longitude) = orders::place(north, 0.0);
        VehicleOperatingModeCommand {
            loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
            loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
            ..orders::mode(Mode::Loiter)
        }
    };
    // NAV_LOITER_RAD is 80 m.
    rig.done(of_length(300.0));
    assert_eq!(rig.carry_out(around(0.0)), Some(AckType::Refused));
    rig.run(0.5);
    let why = "at least four times the vehicle's own radius";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    rig.done(of_length(600.0));
    assert_eq!(rig.carry_out(around(1_450.0)), Some(AckType::Refused));
    rig.run(0.5);
    let why = "the figure 8 of 600 m leaves area 1, to stay inside";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    rig.done(around(0.0));
    rig.run(60.0);
    rig.done(VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(80.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..VehicleOperatingModeCommand::default()
    });
    rig.run(30.0);
    let mut banks = Vec::new();
    for _ in 0..240 {
        rig.run(0.5);
        banks.push(rig.truth().attitude[0]);
    }
    let turns = |to: f64| banks.iter().any(|bank| bank * to > 0.2);
    assert!(turns(1.0) && turns(-1.0), "{banks:?}");
}

#[test]
fn a_configured_pattern_lands_a_wing_from_its_route() {
    let mut rig = flies(Airframe::Plane, "");
    rig.done(orders::mode(Mode::Waypoint));
    // The loiter at the end of the route, not the landing.
    assert!(rig.until(200.0, |rig| rig.truth().mission_seq == 2));
    rig.run(60.0);
    assert_eq!(
        (rig.truth().mission_seq, rig.truth().mode),
        (2, Px4::Mission)
    );
    rig.done(orders::mode(Mode::AutolandEngage));
    let down = rig.until(400.0, |rig| !rig.truth().armed);
    let truth = rig.truth();
    assert!(down, "{truth:?} {:?}", rig.station().alerts());
    let off_m = truth.position.n.hypot(truth.position.e);
    assert!(off_m < 150.0, "{truth:?}");
}

/// It circles below the altitude of its loiter, which PX4 does not leave so.
#[test]
fn a_landing_pattern_that_does_not_converge_is_named_until_it_is_flown_on() {
    let mut rig = flies(Airframe::Plane, "");
    let fly_low = |rig: &mut Rig, low_m| {
        let vehicle = rig.vehicles[0].vehicle_mut();
        vehicle.set_health_faults(HealthFaults {
            low_m,
            ..HealthFaults::default()
        });
    };
    fly_low(&mut rig, 20);
    rig.done(orders::mode(Mode::AutolandEngage));
    // 3 DO_LAND_START, 4 the loiter before the glide, 5 the touch-down.
    assert!(rig.until(100.0, |rig| rig.truth().mission_seq == 4));
    let named = "waiting for its altitude";
    let alerted = rig.until(400.0, |rig| rig.station().has_alert(named));
    assert!(alerted, "{:?} {:?}", rig.truth(), rig.station().alerts());
    rig.run(200.0);
    // Once, and nothing is commanded for it.
    let alerts = rig.station().alerts();
    let times = alerts.iter().filter(|text| text.contains(named)).count();
    assert_eq!(times, 1, "{alerts:?}");
    let truth = rig.truth();
    assert_eq!((truth.mission_seq, truth.mode), (4, Px4::Mission));
    let over = "no longer in the landing pattern before the final approach";
    let before = alerts.iter().filter(|text| text.contains(over)).count();
    assert_eq!(before, 0, "{alerts:?}");
    fly_low(&mut rig, 0);
    let flown_on = rig.until(60.0, |rig| rig.station().has_alert(over));
    assert!(flown_on, "{:?} {:?}", rig.truth(), rig.station().alerts());
    let down = rig.until(400.0, |rig| !rig.truth().armed);
    assert!(down, "{:?} {:?}", rig.truth(), rig.station().alerts());
}

#[test]
fn a_landing_pattern_in_wind_raises_no_alert() {
    for (airframe, wind) in [
        (Airframe::Plane, [0.0, 0.0]),
        (Airframe::Plane, [5.0, -4.0]),
        (Airframe::Vtol, [-3.0, 2.0]),
    ] {
        let mut rig = Rig::ready_with(Setup {
            vehicles: vec![Config {
                airframe,
                wind_ne_ms: wind,
                ..Config::default()
            }],
            vehicle_keys: "landing = { course_deg = 90.0, height_m = 40.0 }",
            ..Setup::default()
        });
        rig.send_plan(vec![
            orders::route(1).into(),
            orders::waypoint(1, 2, 300.0, 0.0, 60.0).into(),
            orders::waypoint(2, 0, 600.0, 300.0, 60.0).into(),
        ]);
        rig.done(orders::load());
        rig.take_off(50.0);
        let up = |rig: &Rig| rig.truth().mode == Px4::Loiter && !rig.truth().landed;
        assert!(rig.until(200.0, up), "{airframe:?}: {:?}", rig.truth());
        rig.done(orders::mode(Mode::AutolandEngage));
        // The touch-down is the last item.
        let last = if airframe == Airframe::Plane { 5 } else { 6 };
        let left = rig.until(400.0, |rig| rig.truth().mission_seq == last);
        assert!(left, "{airframe:?} {wind:?}: {:?}", rig.truth());
        assert!(!rig.station().has_alert("landing pattern:"), "{wind:?}");
    }
}

/// Mode 19 in the middle of a leg at 19 m/s, and out of a hold, after which PX4 repeats that speed of the route.
#[test]
fn the_landing_pattern_is_flown_at_the_vehicles_own_speed() {
    for holds in [false, true] {
        let mut rig = winged(Airframe::Plane, "");
        let fast = |number, next, north| UaPositionWaypoint {
            waypoint_to_speed: Some(Scaled::saturating_from_si(19.0)),
            ..orders::waypoint(number, next, north, 0.0, 60.0)
        };
        rig.send_plan(vec![
            orders::route(1).into(),
            fast(1, 2, 600.0).into(),
            fast(2, 0, 3_000.0).into(),
        ]);
        rig.done(orders::load());
        rig.take_off(50.0);
        assert!(rig.until(200.0, |rig| rig.truth().mode == Px4::Loiter));
        rig.done(orders::mode(Mode::Waypoint));
        let is_fast = |rig: &Rig| {
            rig.truth().position.n > 1_200.0 && rig.truth().velocity.horizontal() > 18.5
        };
        assert!(rig.until(200.0, is_fast), "{:?}", rig.truth());
        if holds {
            rig.done(orders::mode(Mode::Loiter));
        }
        rig.done(orders::mode(Mode::AutolandEngage));
        rig.run(15.0);
        let truth = rig.truth();
        assert!(
            (truth.velocity.horizontal() - 15.0).abs() < 1.0,
            "{holds}: {truth:?}"
        );
    }
}

#[test]
fn the_loss_action_takes_a_wing_out_of_its_landing() {
    let mut rig = flies(Airframe::Plane, "[authority]\non_loss = \"hold\"\n");
    rig.stations[0].heartbeats = true;
    rig.done(orders::mode(Mode::AutolandEngage));
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
    rig.done(orders::mode(Mode::Autopilot));
    assert_eq!(rig.truth().mode, Px4::Course);
    rig
}

/// The last HEARTBEAT still shows the course mode of before the hold: it is entered again, not only acknowledged.
#[test]
fn a_wing_that_is_steered_right_after_a_hold_is_steered() {
    for wait_s in [0.0, 0.2, 0.6] {
        let mut rig = steered("");
        rig.send(orders::mode(Mode::Loiter));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Loiter));
        rig.run(wait_s);
        rig.done(orders::mode(Mode::Autopilot));
        rig.run(3.0);
        assert_eq!(rig.truth().mode, Px4::Course, "{wait_s} s");
    }
}

/// 3002 has the course that is flown, for as long as it is.
#[test]
fn a_steered_wing_reports_its_commanded_course() {
    let mut rig = steered("");
    let reported = |rig: &mut Rig| {
        rig.run(0.6);
        let states = rig
            .station()
            .last(vehicle_id(0), 3002, |message| match message {
                Message::VehicleOperatingStates(states) => Some(states.clone()),
                _ => None,
            });
        let states = states.expect("a 3002");
        (states.commanded_course, states.heading_command_type)
    };
    assert_eq!(reported(&mut rig), (None, None));
    let south = Bam16::from_degrees(180.0);
    rig.done(VehicleOperatingModeCommand {
        heading_command_type: Some(HeadingCommandType::Course),
        commanded_course: Some(south),
        ..orders::mode(Mode::Autopilot)
    });
    let flown = (Some(south), Some(HeadingCommandType::Course));
    assert_eq!(reported(&mut rig), flown);
    // A speed alone turns nothing, and a refused direction changes nothing.
    rig.done(VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(16.0)),
        ..orders::mode(Mode::Autopilot)
    });
    assert_eq!(reported(&mut rig), flown);
    let refused = rig.carry_out(VehicleOperatingModeCommand {
        heading_command_type: Some(HeadingCommandType::Heading),
        commanded_heading: Some(Bam16::from_degrees(90.0)),
        ..orders::mode(Mode::Autopilot)
    });
    assert_eq!(refused, Some(AckType::Refused));
    assert_eq!(reported(&mut rig), flown);
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(reported(&mut rig), (None, None));
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
    rig.done(orders::mode(Mode::AutolandEngage));
    // 2 the loiter at the end of the route, 3 DO_LAND_START, 4 the loiter before the glide, 5 the touch-down.
    assert!(rig.until(400.0, |rig| rig.truth().mission_seq == 5));
    assert!(rig.until(100.0, |rig| -rig.truth().position.d < 35.0));
    // PX4 would acknowledge it and fly on at its own.
    let faster = rig.carry_out(VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(16.0)),
        ..VehicleOperatingModeCommand::default()
    });
    assert_eq!(faster, Some(AckType::Refused));
    assert!(rig.station().has_alert("on the final approach: PX4 flies"));
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

/// On its glide, 35 m above home.
fn on_final() -> Rig {
    let mut rig = flies(Airframe::Plane, "");
    rig.done(orders::mode(Mode::AutolandEngage));
    // 3 DO_LAND_START, 4 the loiter before the glide, 5 the touch-down.
    assert!(rig.until(400.0, |rig| rig.truth().mission_seq == 5));
    assert!(rig.until(100.0, |rig| -rig.truth().position.d < 35.0));
    rig
}

const BROKEN_OFF: &str = "the landing is broken off on the final approach, 3";

/// The operator decides, and learns what follows; so in every mode.
#[test]
fn a_command_that_breaks_off_a_final_approach_is_carried_out_and_named_with_the_height() {
    let to_1 = VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(1),
        ..orders::mode(Mode::Waypoint)
    };
    let keeps = "; it keeps that height until an altitude is commanded";
    for (command, mode, by, level) in [
        (to_1, Px4::Mission, "by AUTO.MISSION", false),
        (
            orders::mode(Mode::Waypoint),
            Px4::Mission,
            "by AUTO.MISSION",
            false,
        ),
        (
            orders::mode(Mode::Loiter),
            Px4::Loiter,
            "by AUTO.LOITER",
            true,
        ),
        (
            orders::mode(Mode::Autopilot),
            Px4::Course,
            "by GUIDED_COURSE",
            true,
        ),
        (
            orders::mode(Mode::ContingencyA),
            Px4::Rtl,
            "by AUTO.RTL",
            false,
        ),
    ] {
        let mut rig = on_final();
        rig.done(command);
        assert_eq!(rig.truth().mode, mode, "{by}");
        let alerts = rig.station().alerts();
        let mut named = alerts.iter().filter(|text| text.contains(BROKEN_OFF));
        let (text, again) = (named.next().expect(by), named.next());
        assert!(text.contains(by) && text.contains(keeps) == level, "{text}");
        assert_eq!(again, None);
    }
}

#[test]
fn of_a_go_around_and_a_landing_commanded_again_nothing_is_warned_and_an_altitude_is_flown() {
    for mode in [Mode::AutolandWaveOff, Mode::AutolandEngage] {
        let mut rig = on_final();
        rig.done(orders::mode(mode));
        let alerts = rig.station().alerts();
        assert!(!rig.station().has_alert(BROKEN_OFF), "{mode:?} {alerts:?}");
    }
    let mut rig = on_final();
    rig.done(VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(60.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..orders::mode(Mode::Loiter)
    });
    assert!(rig.station().has_alert(BROKEN_OFF));
    assert!(!rig.station().has_alert("it keeps that height"));
}

#[test]
fn a_hold_ends_the_flight_of_a_wing_to_a_commanded_place() {
    let mut rig = flies(Airframe::Plane, "");
    rig.run(20.0);
    let (latitude, longitude) = orders::place(3_000.0, 0.0);
    rig.done(VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    });
    rig.run(40.0);
    let here = rig.truth().position;
    rig.done(orders::mode(Mode::Loiter));
    for _ in 0..60 {
        rig.run(1.0);
        let truth = rig.truth();
        let off_m = (truth.position.n - here.n).hypot(truth.position.e - here.e);
        assert!(off_m < 300.0, "{truth:?}");
    }
}

/// Mode 19 again: not from the start of the pattern, and not with its speed.
#[test]
fn a_landing_that_is_commanded_again_continues() {
    let mut rig = flies(Airframe::Plane, "");
    rig.done(orders::mode(Mode::AutolandEngage));
    // 3 DO_LAND_START, 4 the loiter before the glide, 5 the touch-down.
    assert!(rig.until(100.0, |rig| rig.truth().mission_seq == 4));
    let speed = Some(Scaled::saturating_from_si(16.0));
    rig.done(VehicleOperatingModeCommand {
        commanded_speed: speed,
        ..VehicleOperatingModeCommand::default()
    });
    rig.run(1.5);
    rig.done(orders::mode(Mode::AutolandEngage));
    rig.run(0.6);
    let reported = |rig: &Rig| {
        let states = rig
            .station()
            .last(vehicle_id(0), 3002, |message| match message {
                Message::VehicleOperatingStates(states) => Some(states.clone()),
                _ => None,
            });
        states.expect("a 3002").commanded_speed
    };
    assert_eq!(reported(&rig), speed);
    assert!(rig.until(400.0, |rig| rig.truth().mission_seq == 5));
    assert!(rig.until(100.0, |rig| -rig.truth().position.d < 35.0));
    rig.done(orders::mode(Mode::AutolandEngage));
    rig.run(1.0);
    let truth = rig.truth();
    assert_eq!((truth.mission_seq, truth.mode), (5, Px4::Mission));
    let down = rig.until(300.0, |rig| !rig.truth().armed);
    assert!(down, "{:?} {:?}", rig.truth(), rig.station().alerts());
    rig.run(2.0);
    assert_eq!(reported(&rig), None, "on the ground");
}

/// Not with AUTO.LAND where it is then.
#[test]
fn a_vtol_that_hovers_towards_its_touch_down_is_landed_there() {
    let mut rig = flies(Airframe::Vtol, "");
    rig.done(orders::mode(Mode::AutolandEngage));
    let hovers = |rig: &Rig| rig.truth().vtol == Some(VtolState::Hover);
    assert!(rig.until(600.0, hovers), "{:?}", rig.truth());
    rig.run(1.5);
    assert_eq!(rig.truth().mode, Px4::Mission);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.truth().mode, Px4::Mission);
    let down = rig.until(300.0, |rig| !rig.truth().armed);
    assert!(down, "{:?} {:?}", rig.truth(), rig.station().alerts());
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
    rig.done(orders::load());
    rig.send(orders::launch(40.0));
    assert!(rig.until(60.0, |rig| rig.truth().mode == Px4::VtolTakeoff));
    assert!(refused(&mut rig), "{:?}", rig.stations[1].alerts());
    assert!(rig.until(200.0, |rig| rig.truth().mode == Px4::Loiter));
    rig.run(10.0);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.truth().mode, Px4::Mission);
    assert!(refused(&mut rig), "{:?}", rig.stations[1].alerts());
    rig.done(orders::mode(Mode::Loiter));
    assert!(!refused(&mut rig), "it neither takes off nor lands");
}

#[test]
fn a_vtol_that_hovers_transitions_before_it_flies_on_along_its_route() {
    let mut rig = flies(Airframe::Vtol, "");
    rig.done(orders::mode(Mode::Waypoint));
    // 0 transition, 1 and 2 the waypoints.
    assert!(rig.until(200.0, |rig| rig.truth().mission_seq == 2));
    rig.done(LoiterConfiguration {
        loiter_type: Some(LoiterType::Hover),
        ..LoiterConfiguration::default()
    });
    let speed = |rig: &Rig| {
        let velocity = rig.truth().velocity;
        velocity.n.hypot(velocity.e)
    };
    for waypoint in [None, Some(1)] {
        rig.done(orders::mode(Mode::Loiter));
        let hovers = rig.until(60.0, |rig| speed(rig) < 1.0);
        assert!(hovers, "{:?}", rig.truth());
        rig.done(VehicleOperatingModeCommand {
            commanded_waypoint_number: waypoint,
            ..orders::mode(Mode::Waypoint)
        });
        rig.run(5.0);
        let truth = rig.truth();
        assert_eq!(truth.mode, Px4::Mission);
        assert!(speed(&rig) > 8.0, "it hovers along its route: {truth:?}");
    }
}
