//! What is flown while something is wrong with the vehicle (`vehicle.contingency`), and who wins: PX4's failsafe, the pilot, the CUCS in
//! control.

use std::path::Path;

use kit::bridge::{Rig, Setup, orders};
use px4_sim::{HealthFaults, Mode as Px4};
use stanag_msgs::enums::{
    AckType, AreaPlanMode, AreaType, ContingencyAction, ContingencyCause, ContingencyState,
    FlightPathControlMode as Mode, HeadingCommandType, LoiBitmap, RequestedAccess, RouteType,
    SpeedType,
};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, Contingency, CucsAuthorisationRequest,
    GenericInformationRequestMessage, UaRoute, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled, Text};
use vsm::config::Config;

/// In the air and on hold, with these contingencies.
fn flying(vehicle_keys: &'static str, plan: Vec<Message>) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys,
        ..Setup::default()
    });
    if !plan.is_empty() {
        rig.send_plan(orders::square());
        rig.send_plan(plan);
        rig.done(orders::load());
    }
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig
}

fn faults(rig: &mut Rig, faults: HealthFaults) {
    rig.vehicles[0].vehicle_mut().set_health_faults(faults);
}

fn battery(rig: &mut Rig, percent: u8) {
    faults(
        rig,
        HealthFaults {
            battery: Some(percent),
            ..HealthFaults::default()
        },
    );
}

fn enters(rig: &mut Rig, mode: Px4) {
    assert!(
        rig.until(30.0, |rig| rig.truth().mode == mode),
        "{mode:?}: {:?}",
        rig.station().alerts()
    );
}

#[test]
fn a_low_battery_brings_it_home_once_and_the_operator_has_the_last_word() {
    let keys = "[vehicle.contingency]\nbattery = \"rtl\"\nbattery_percent = 30";
    let mut rig = flying(keys, Vec::new());
    battery(&mut rig, 30);
    rig.run(5.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    battery(&mut rig, 29);
    enters(&mut rig, Px4::Rtl);
    // Not before an operator can have read the alert.
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Loiter)),
        Some(AckType::Refused)
    );
    rig.run(4.0);
    for text in [
        "30 %: commanding return",
        "30 %: the vehicle is in AUTO.RTL",
    ] {
        assert!(
            rig.station().has_alert(text),
            "{:?}",
            rig.station().alerts()
        );
    }
    rig.done(orders::mode(Mode::Loiter));
    rig.run(10.0);
    assert_eq!(rig.truth().mode, Px4::Loiter, "not against the operator");
    // Nor after a restart, which knows of it.
    rig.restart_bridge();
    rig.run(10.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert!(rig.station().has_alert("a CUCS has sent another command"));
    // Between the thresholds it is not over; gone, and there again.
    battery(&mut rig, 33);
    rig.run(15.0);
    battery(&mut rig, 20);
    rig.run(6.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    battery(&mut rig, 60);
    rig.run(15.0);
    assert!(
        rig.station()
            .has_alert("the cause of the contingency is gone")
    );
    battery(&mut rig, 20);
    enters(&mut rig, Px4::Rtl);
}

#[test]
fn a_station_that_repeats_its_command_ends_no_contingency() {
    let mut rig = flying("[vehicle.contingency]\nbattery = \"rtl\"", Vec::new());
    battery(&mut rig, 10);
    for _ in 0..60 {
        rig.send(orders::mode(Mode::Loiter));
        rig.run(0.3);
    }
    assert_eq!(rig.truth().mode, Px4::Rtl);
    let why = "this only continues or repeats an earlier command";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    // After a pause the same mode is a decision again.
    rig.run(6.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(6.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn one_bad_report_sends_no_vehicle_home() {
    let mut rig = flying("[vehicle.contingency]\nbattery = \"land\"", Vec::new());
    for _ in 0..3 {
        battery(&mut rig, 1);
        rig.run(1.0);
        battery(&mut rig, 80);
        rig.run(2.0);
    }
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert!(!rig.station().has_alert("battery below"));
}

#[test]
fn what_was_not_flown_before_a_restart_is_flown_after_it() {
    let mut rig = flying("[vehicle.contingency]\nbattery = \"land\"", Vec::new());
    rig.stop_bridge();
    battery(&mut rig, 10);
    rig.run(3.0);
    rig.start_bridge();
    enters(&mut rig, Px4::Land);
}

/// In the air with a station that falls silent, and one that listens.
fn with_loss(tables: &'static str, vehicle_keys: &'static str) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        tables,
        vehicle_keys,
        stations: 2,
        ..Setup::default()
    });
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    rig
}

#[test]
fn the_more_urgent_of_loss_action_and_contingency_is_flown() {
    // The return for the battery is not ended by the hold for the lost CUCS.
    let keys = "[vehicle.contingency]\nbattery = \"rtl\"\nengine = \"land\"";
    let mut rig = with_loss("[authority]\non_loss = \"hold\"\n", keys);
    let (east, north) = (0.0, 300.0);
    let (latitude, longitude) = orders::place(north, east);
    let beyond = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    };
    rig.send(beyond);
    rig.run(30.0);
    battery(&mut rig, 10);
    enters(&mut rig, Px4::Rtl);
    rig.stations[0].heartbeats = false;
    assert!(rig.until(20.0, |rig| rig.station().has_alert("nobody controls")));
    rig.run(8.0);
    assert_eq!(rig.truth().mode, Px4::Rtl);
    // And a motor that fails lands it.
    let motor = HealthFaults {
        unhealthy: 0x8000,
        battery: Some(10),
        ..HealthFaults::default()
    };
    faults(&mut rig, motor);
    enters(&mut rig, Px4::Land);

    // A hold for the fault does not keep it from the return for the lost CUCS.
    let keys = "[vehicle.contingency]\nbattery = \"hold\"";
    let mut rig = with_loss("[authority]\non_loss = \"rtl\"\n", keys);
    battery(&mut rig, 10);
    rig.run(6.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    rig.stations[0].heartbeats = false;
    enters(&mut rig, Px4::Rtl);
}

#[test]
fn what_an_operator_has_ended_is_flown_once_that_operator_is_lost() {
    let keys = "[vehicle.contingency]\nbattery = \"land\"";
    let mut rig = with_loss("", keys);
    battery(&mut rig, 10);
    enters(&mut rig, Px4::Land);
    rig.run(4.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(6.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    rig.stations[0].heartbeats = false;
    enters(&mut rig, Px4::Land);
}

#[test]
fn a_contingency_that_cannot_be_watched_is_named_before_the_flight() {
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: "[vehicle.contingency]\nfence = \"rtl\"\nbattery = \"rtl\"",
        ..Setup::default()
    });
    rig.run(12.0);
    let text = "contingencies are not watched: fence (no area";
    assert!(
        rig.station().has_alert(text),
        "{:?}",
        rig.station().alerts()
    );
    assert!(!rig.station().has_alert("battery (no level"));
}

#[test]
fn a_contingency_route_is_flown_and_a_return_where_there_is_none() {
    let keys = "[vehicle.contingency]\nbattery = \"contingency-a\"";
    let mut rig = flying(keys, contingency_a());
    battery(&mut rig, 10);
    enters(&mut rig, Px4::Mission);
    let mut rig = flying(keys, Vec::new());
    battery(&mut rig, 10);
    enters(&mut rig, Px4::Rtl);
}

/// Contingency A, 60 m north and then 50 m east of home.
fn contingency_a() -> Vec<Message> {
    let route = UaRoute {
        route_id: Some(Text::new("CA")),
        route_type: Some(RouteType::ContingencyA),
        ..orders::route(7)
    };
    vec![
        route.into(),
        orders::waypoint(7, 8, 60.0, 0.0, 30.0).into(),
        orders::waypoint(8, 0, 60.0, 50.0, 30.0).into(),
    ]
}

/// On hold at the end of contingency A.
fn holds_at_its_end(rig: &mut Rig) {
    enters(rig, Px4::Mission);
    assert!(rig.until(90.0, |rig| rig.truth().mode == Px4::Loiter));
    let at = rig.truth().position;
    // A waypoint is reached within NAV_ACC_RAD, 10 m.
    assert!(
        (at.n - 60.0).abs() < 12.0 && (at.e - 50.0).abs() < 12.0,
        "{at:?}"
    );
    rig.run(3.0);
}

#[test]
fn a_contingency_route_that_was_flown_to_its_end_is_not_flown_again() {
    let keys = "[vehicle.contingency]\nbattery = \"contingency-a\"";
    let mut rig = flying(keys, contingency_a());
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    battery(&mut rig, 10);
    holds_at_its_end(&mut rig);
    let why = "contingency A is flown to its end, and the vehicle holds there";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    // Who controls it decides what follows, also where the VSM is started again meanwhile.
    rig.restart_bridge();
    rig.run(20.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    rig.stations[0].heartbeats = false;
    assert!(rig.until(40.0, |rig| rig.truth().mode != Px4::Loiter));
    assert_eq!(rig.truth().mode, Px4::Rtl);
}

#[test]
fn a_route_for_a_lost_cucs_that_was_flown_to_its_end_is_not_flown_again() {
    let mut rig = Rig::ready_with(Setup {
        tables: "[authority]\non_loss = \"contingency\"\n",
        ..Setup::default()
    });
    rig.send_plan(orders::square());
    rig.send_plan(contingency_a());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    rig.stations[0].heartbeats = false;
    holds_at_its_end(&mut rig);
    // It is there again, commands nothing, and is lost again.
    for commanded in [false, true] {
        rig.stations[0].heartbeats = true;
        rig.done(orders::request_control());
        if commanded {
            rig.done(orders::mode(Mode::Loiter));
        }
        rig.run(2.0);
        rig.stations[0].heartbeats = false;
        let flies = rig.until(40.0, |rig| rig.truth().mode != Px4::Loiter);
        // Once it was put on hold by a command it may have been anywhere since.
        assert_eq!(flies, commanded);
    }
}

#[test]
fn nothing_less_than_the_configuration_is_set_by_message() {
    use {ContingencyAction as A, ContingencyCause as C};
    let keys = "[vehicle.contingency]\nbattery = \"rtl\"\nbattery_percent = 30\nengine = \"contingency-a\"";
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: keys,
        ..Setup::default()
    });
    let low = |action, percent| Contingency {
        contingency_percent: Some(percent),
        ..set(C::Battery, action)
    };
    for (less, why) in [
        (
            set(C::Battery, A::Hold),
            "a hold is less than the return that vehicle.contingency.battery promises",
        ),
        (low(A::ContingencyA, 40), "a contingency A is less"),
        (
            low(A::Landing, 29),
            "29 % is later than the 30 % of vehicle.contingency.battery_percent: expected 30 to 90",
        ),
        (set(C::Engine, A::Hold), "vehicle.contingency.engine"),
    ] {
        assert_eq!(rig.carry_out(less), Some(AckType::Refused), "{why}");
        rig.run(0.3);
        assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    }
    assert_eq!(reported(&mut rig, C::Battery).0, Some(A::Return));
    for more in [
        low(A::Landing, 30),
        low(A::Return, 90),
        set(C::Engine, A::ContingencyB),
    ] {
        rig.done(more);
    }
    // Where nothing is configured a level promises nothing.
    rig.done(set(C::Fence, A::Hold));
}

#[test]
fn who_takes_control_over_is_alerted_to_what_the_one_before_has_ended() {
    let mut rig = Rig::new(Setup {
        vehicle_keys: "[vehicle.contingency]\nbattery = \"land\"",
        stations: 2,
        ..Setup::default()
    });
    let id = format!("id = \"{}\"\n", rig.stations[1].id);
    let text = rig.text.replace(&id, &format!("{id}override = true\n"));
    rig.restart_with(&text);
    rig.run(12.0);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    battery(&mut rig, 10);
    enters(&mut rig, Px4::Land);
    rig.run(4.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(6.0);
    let why = "the CUCS that controlled the vehicle before has sent another command";
    assert!(!rig.stations[1].has_alert(why));
    let over = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Override),
        ..orders::request_control()
    };
    rig.send_as(1, 0, over);
    assert!(
        rig.until(5.0, |rig| rig.stations[1].has_alert(why)),
        "{:?}",
        rig.stations[1].alerts()
    );
    rig.run(5.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn a_failed_motor_a_lost_position_and_a_left_fence_have_actions_of_their_own() {
    let keys = "[vehicle.contingency]\nengine = \"land\"\nposition = \"land\"\nfence = \"rtl\"";
    let mut rig = flying(keys, Vec::new());
    faults(
        &mut rig,
        HealthFaults {
            unhealthy: 0x8000,
            ..HealthFaults::default()
        },
    );
    enters(&mut rig, Px4::Land);
    assert!(
        rig.station()
            .has_alert("a motor has failed: commanding landing")
    );
    let mut rig = flying(keys, Vec::new());
    faults(
        &mut rig,
        HealthFaults {
            estimator: 0x10,
            ..HealthFaults::default()
        },
    );
    enters(&mut rig, Px4::Land);
    assert!(
        rig.station()
            .has_alert("the position is lost: commanding landing")
    );
    let mut rig = flying(keys, Vec::new());
    let (latitude, longitude) = orders::place(0.0, 0.0);
    let inside = AreaVertex {
        area_id: Some(1),
        area_type: Some(AreaType::KeepInCircle),
        vertex_count: Some(1),
        vertex_number: Some(1),
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        radius: Some(40.0),
        ..AreaVertex::default()
    };
    rig.send_plan(vec![inside.into()]);
    let load = AreaTransferCommand {
        area_plan_mode: Some(AreaPlanMode::Load),
        ..AreaTransferCommand::default()
    };
    rig.done(load);
    let north = VehicleOperatingModeCommand {
        heading_command_type: Some(HeadingCommandType::Course),
        commanded_course: Some(Bam16::from_degrees(0.0)),
        commanded_speed: Some(Scaled::saturating_from_si(4.0)),
        speed_type: Some(SpeedType::Ground),
        ..orders::mode(Mode::Autopilot)
    };
    rig.done(north);
    enters(&mut rig, Px4::Rtl);
    assert!(
        rig.station()
            .has_alert("the vehicle has left its fence: commanding return")
    );
}

#[test]
fn nothing_is_flown_on_the_ground_or_without_a_contingency() {
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: "[vehicle.contingency]\nbattery = \"land\"",
        ..Setup::default()
    });
    battery(&mut rig, 5);
    rig.run(5.0);
    assert!(!rig.station().has_alert("commanding landing"));
    let mut rig = flying("", Vec::new());
    battery(&mut rig, 5);
    rig.run(8.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn a_configuration_that_cannot_be_flown_is_refused() {
    let text = Rig::new(Setup::default()).text;
    for (table, expected) in [
        ("position = \"rtl\"", "\"land\""),
        ("battery_percent = 95", "1 to 90 (per cent)"),
        ("engine = \"eject\"", "contingency-a"),
    ] {
        let text = text.replace(
            "[store]",
            &format!("[vehicle.contingency]\n{table}\n[store]"),
        );
        let fault = Config::parse(&text, Path::new("/nowhere")).expect_err(table);
        assert!(fault.to_string().contains(expected), "{fault}");
    }
}

fn set(cause: ContingencyCause, action: ContingencyAction) -> Contingency {
    Contingency {
        contingency_cause: Some(cause),
        contingency_action: Some(action),
        ..Contingency::default()
    }
}

/// What is reported of a cause when it is asked for.
fn reported(
    rig: &mut Rig,
    cause: ContingencyCause,
) -> (
    Option<ContingencyAction>,
    Option<u8>,
    Option<ContingencyState>,
) {
    let request = GenericInformationRequestMessage {
        message_type: Some(Contingency::ID),
        ..GenericInformationRequestMessage::default()
    };
    rig.done(request);
    rig.run(0.3);
    let mut received = rig.station().received.iter().rev();
    let last = received.find_map(|(_, _, message)| match message {
        Message::Contingency(one) if one.contingency_cause == Some(cause) => Some((
            one.contingency_action,
            one.contingency_percent,
            one.contingency_state,
        )),
        _ => None,
    });
    last.expect("a report of the cause")
}

#[test]
fn a_contingency_is_set_by_message_before_the_flight_kept_over_a_restart_and_read_back() {
    use {ContingencyAction as A, ContingencyCause as C, ContingencyState as S};
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: "[vehicle.contingency]\nengine = \"hold\"",
        stations: 2,
        ..Setup::default()
    });
    assert_eq!(
        reported(&mut rig, C::Battery),
        (Some(A::AsConfigured), Some(25), Some(S::None))
    );
    let low = Contingency {
        contingency_percent: Some(40),
        ..set(C::Battery, A::Landing)
    };
    // Without the right for it.
    let listen = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        ..orders::request_control()
    };
    let ticket = rig.send_as(1, 0, listen);
    rig.until(5.0, |rig| rig.stations[1].end(ticket).is_some());
    let ticket = rig.send_as(1, 0, low.clone());
    rig.until(5.0, |rig| rig.stations[1].end(ticket).is_some());
    assert_eq!(rig.stations[1].end(ticket), Some(AckType::Refused));
    // What cannot be flown.
    let of_another = Contingency {
        contingency_percent: Some(40),
        ..set(C::Engine, A::Landing)
    };
    let never = Contingency {
        contingency_percent: Some(95),
        ..set(C::Battery, A::Landing)
    };
    let nothing = Contingency {
        contingency_action: None,
        ..set(C::Battery, A::Landing)
    };
    for (wrong, why) in [
        (set(C::Position, A::Return), "expected Contingency Action 3"),
        (set(C::Unknown(7), A::Return), "Contingency Cause 7"),
        (set(C::Battery, A::Unknown(9)), "Contingency Action 9"),
        (of_another, "is of cause 1"),
        (never, "95 %, expected 1 to 90"),
        (nothing, "Contingency Action is missing"),
    ] {
        assert_eq!(rig.carry_out(wrong), Some(AckType::Refused), "{why}");
        rig.run(0.3);
        assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    }
    rig.done(low);
    rig.done(set(C::Engine, A::Return));
    rig.restart_bridge();
    rig.run(5.0);
    let watched = (Some(A::Landing), Some(40), Some(S::Watched));
    assert_eq!(reported(&mut rig, C::Battery), watched);
    // What the configuration has is changed, and comes back; it is never nothing.
    assert_eq!(reported(&mut rig, C::Engine).0, Some(A::Return));
    rig.done(set(C::Engine, A::AsConfigured));
    assert_eq!(reported(&mut rig, C::Engine).0, Some(A::Hold));
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    let late = rig.carry_out(set(C::Fence, A::Return));
    assert_eq!(late, Some(AckType::Refused));
    battery(&mut rig, 39);
    enters(&mut rig, Px4::Land);
    rig.run(4.0);
    let flown = (Some(A::Landing), Some(40), Some(S::Flown));
    assert_eq!(reported(&mut rig, C::Battery), flown);
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(reported(&mut rig, C::Battery).2, Some(S::Ended));
}
