//! Every report against what is really so of the simulated vehicle: units, signs, frames, datums.

use kit::bridge::{Rig, Setup, orders};
use stanag_msgs::Message;
use stanag_msgs::enums::{
    AckType, AlertPriority, AltitudeType, EngineStatus, FlightPathControlMode as Mode,
    LoiterDurationUnits, LoiterType, MissionPlanMode, SubsystemId,
};
use stanag_msgs::messages::{
    GenericInformationRequestMessage, LoiterConfiguration, MissionTransferCommand,
    ScheduleMessageUpdateCommand, UaStickCommand, VehicleOperatingModeCommand,
};
use stanag_msgs::{Scaled, Text};

fn ask(message: u16) -> GenericInformationRequestMessage {
    GenericInformationRequestMessage {
        message_type: Some(message),
        ..GenericInformationRequestMessage::default()
    }
}

/// Asks for a report by 17002 and gives all that came of this type.
fn asked<T>(rig: &mut Rig, message: u16, pick: impl Fn(&Message) -> Option<T>) -> Vec<T> {
    let mark = rig.station().received.len();
    assert_eq!(
        rig.carry_out(ask(message)),
        Some(AckType::CarriedOut),
        "{message}"
    );
    rig.run(0.1);
    let received = rig.station().received[mark..].iter();
    received
        .filter_map(|(_, _, message)| pick(message))
        .collect()
}

macro_rules! report {
    ($rig:expr, $id:literal, $Kind:ident) => {
        asked($rig, $id, |message| match message {
            Message::$Kind(report) => Some(report.clone()),
            _ => None,
        })
        .pop()
        .expect(concat!("a report ", $id))
    };
}

fn near(what: &str, reported: Option<f64>, truth: f64, within: f64) {
    let reported = reported.unwrap_or_else(|| panic!("{what} is absent"));
    assert!(
        (reported - truth).abs() <= within,
        "{what}: reported {reported}, is {truth}"
    );
}

/// A vehicle that flies a leg north-east, with another altimeter setting.
fn in_flight() -> Rig {
    let mut rig = Rig::ready();
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 0, 400.0, 400.0, 60.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(20.0);
    let go = VehicleOperatingModeCommand {
        altimeter_setting: Some(Scaled::saturating_from_si(99_000.0)),
        ..orders::mode(Mode::Waypoint)
    };
    rig.done(go);
    assert!(rig.until(60.0, |rig| rig.truth().velocity.horizontal() > 3.0));
    rig.run(8.0);
    rig
}

#[test]
fn status_messages_are_not_pushed_before_they_are_requested() {
    let mut rig = Rig::ready();
    rig.run(5.0);
    let details = [3000, 3004, 3005, 3006, 3007, 3009, 3010, 3011, 12101, 16001];
    for (_, _, message) in &rig.station().received {
        assert!(!details.contains(&message.id()), "{}", message.id());
    }
}

#[test]
fn sticks_are_reported_only_while_they_arrive() {
    let mut rig = Rig::ready();
    rig.send_once(UaStickCommand {
        lateral_stick: Some(40),
        ..UaStickCommand::default()
    });
    let reported = report!(&mut rig, 3011, UaStickStatus);
    assert_eq!(reported.lateral_stick, Some(40));
    rig.run(0.5);
    assert_eq!(rig.carry_out(ask(3011)), Some(AckType::Refused));
}

#[test]
fn inertial_states_are_true_and_above_the_ellipsoid() {
    let mut rig = in_flight();
    let reported = report!(&mut rig, 4000, InertialStates);
    let truth = rig.truth();
    near(
        "latitude",
        reported.latitude.map(|a| a.degrees()),
        truth.place.latitude_deg,
        3e-5,
    );
    near(
        "longitude",
        reported.longitude.map(|a| a.degrees()),
        truth.place.longitude_deg,
        3e-5,
    );
    assert_eq!(reported.altitude_type, Some(AltitudeType::Wgs84));
    let geoid_m = px4_sim::Config::default().geoid_separation_m;
    near(
        "altitude",
        reported.altitude.map(|a| a.si()),
        truth.place.altitude_m + geoid_m,
        2.0,
    );
    near("U", reported.u_speed.map(|v| v.si()), truth.velocity.n, 0.6);
    near("V", reported.v_speed.map(|v| v.si()), truth.velocity.e, 0.6);
    near("W", reported.w_speed.map(|v| v.si()), truth.velocity.d, 0.6);
    near(
        "heading",
        reported.heading.map(|a| a.radians().sin()),
        truth.attitude[2].sin(),
        0.05,
    );
    near(
        "pitch",
        reported.pitch.map(|a| a.radians().sin()),
        truth.attitude[1].sin(),
        0.05,
    );
}

#[test]
fn air_and_ground_states_keep_datums_and_signs_apart() {
    let mut rig = in_flight();
    let reported = report!(&mut rig, 3009, AirAndGroundRelativeStates);
    let truth = rig.truth();
    let amsl_m = truth.place.altitude_m;
    near(
        "barometric",
        reported.barometric_altitude.map(|a| a.si()),
        amsl_m,
        2.0,
    );
    near(
        "WGS-84",
        reported.wgs_84_altitude.map(|a| a.si()),
        amsl_m + 47.4,
        2.0,
    );
    near(
        "AGL",
        reported.agl_altitude.map(|a| a.si()),
        -truth.position.d,
        2.0,
    );
    // 23 hPa below standard: the standard altimeter shows about 190 m more.
    let above = reported.pressure_altitude.map(|a| a.si() - amsl_m);
    near("pressure altitude", above, 193.0, 8.0);
    near(
        "setting",
        reported.altimeter_setting.map(|p| p.si()),
        99_000.0,
        5.0,
    );
    near(
        "north",
        reported.u_ground.map(|v| v.si()),
        truth.velocity.n,
        0.6,
    );
    near(
        "east",
        reported.v_ground.map(|v| v.si()),
        truth.velocity.e,
        0.6,
    );
    near(
        "climb",
        reported.barometric_altitude_rate.map(|v| v.si()),
        -truth.velocity.d,
        0.6,
    );
    // A multicopter here estimates no wind and has no air speed sensor: absent, not zero.
    assert_eq!((reported.u_wind, reported.v_wind), (None, None));
    assert_eq!(
        (reported.true_airspeed, reported.outside_air_temp),
        (None, None)
    );
}

#[test]
fn a_fixed_wing_reports_the_wind_as_the_direction_the_air_moves_to() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            airframe: px4_sim::Airframe::Plane,
            wind_ne_ms: [3.0, -5.0],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    // The first request asks the vehicle for its wind, the second reports it.
    report!(&mut rig, 3009, AirAndGroundRelativeStates);
    rig.run(4.0);
    let reported = report!(&mut rig, 3009, AirAndGroundRelativeStates);
    near("U wind", reported.u_wind.map(|v| v.si()), 3.0, 0.1);
    near("V wind", reported.v_wind.map(|v| v.si()), -5.0, 0.1);
}

#[test]
fn body_rates_engines_battery_and_configuration_are_the_vehicles() {
    let mut rig = in_flight();
    let reported = report!(&mut rig, 3010, BodyRelativeSensedStates);
    near("roll rate", reported.roll_rate.map(|r| r.si()), 0.0, 0.3);
    let engines = asked(&mut rig, 3007, |message| match message {
        Message::EngineOperatingStates(report) => Some(report.clone()),
        _ => None,
    });
    let numbers: Vec<_> = engines
        .iter()
        .filter_map(|engine| engine.engine_number)
        .collect();
    assert_eq!(numbers, [1, 2, 3, 4]);
    for engine in &engines {
        assert_eq!(engine.engine_status, Some(EngineStatus::Running));
        near(
            "power",
            engine.engine_power_setting.map(|p| p.si()),
            50.0,
            35.0,
        );
    }
    let battery = report!(&mut rig, 12101, BatteryReport);
    let volts = battery.bus_voltage.map(|steps| f64::from(steps) * 0.01);
    near("volts", volts, 15.3, 1.0);
    let charge = battery.battery_charge_remaining;
    near(
        "charge",
        charge.map(|steps| f64::from(steps) * 0.0016),
        90.0,
        11.0,
    );
    assert_eq!(
        (battery.battery_current, battery.battery_temperature),
        (None, None)
    );
    let airframe = report!(&mut rig, 3000, VehicleConfiguration);
    assert_eq!(airframe.number_of_engines, Some(4));
    assert_eq!(airframe.propulsion_fuel_capacity, Some(-1.0));
    assert_eq!(
        report!(&mut rig, 3006, VehicleLightsState).navigation_lights_state,
        None
    );
    report!(&mut rig, 3005, FlightTerminationModeReport);
}

#[test]
fn subsystems_are_well_until_the_vehicle_is_silent() {
    let mut rig = in_flight();
    let states = |rig: &mut Rig| {
        asked(rig, 16001, |message| match message {
            Message::SubsystemStatusReport(report) => {
                report.subsystem_id.zip(report.subsystem_state)
            }
            _ => None,
        })
    };
    states(&mut rig);
    rig.run(3.0);
    for (subsystem, state) in states(&mut rig) {
        assert_eq!(state, AlertPriority::Nominal, "{subsystem:?}");
    }
    rig.mav.faults.loss = 1.0;
    rig.run(6.0);
    let silent = states(&mut rig);
    assert!(silent.contains(&(SubsystemId::Comms, AlertPriority::Failed)));
    assert!(silent.contains(&(SubsystemId::Navigation, AlertPriority::Cleared)));
    assert_eq!(
        rig.carry_out(ask(3009)),
        Some(AckType::Refused),
        "a stale value is not reported"
    );
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    let link = &status.vehicles[0].link;
    assert_eq!((link.state, link.live_s), ("silent", None));
    assert_eq!((link.round_trip_s, link.lost), (None, None));
    assert!(!link.clock_known && link.accepted_s > Some(4.0), "{link:?}");
}

#[test]
fn a_loiter_configuration_is_returned_and_a_schedule_is_kept() {
    let mut rig = in_flight();
    let loiter = LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(60.0)),
        loiter_duration: Some(3),
        loiter_duration_units: Some(LoiterDurationUnits::Turns),
        ..LoiterConfiguration::default()
    };
    rig.done(loiter);
    let reported = report!(&mut rig, 3004, LoiterConfigurationReport);
    assert_eq!(reported.loiter_type, Some(LoiterType::Circular));
    near("radius", reported.loiter_radius.map(|r| r.si()), 60.0, 0.8);
    // It flies its mission: neither is the loiter's, and no loiter ends by itself.
    assert_eq!(
        (reported.loiter_altitude, reported.loiter_speed),
        (None, None)
    );
    assert_eq!(
        (reported.loiter_duration, reported.loiter_duration_units),
        (None, None)
    );
    assert!(
        rig.station()
            .has_alert("2017: ignored: Loiter Duration, Loiter Duration Units")
    );

    let every = |hertz| ScheduleMessageUpdateCommand {
        requested_message_type: Some(3009),
        frequency: Some(hertz),
        ..ScheduleMessageUpdateCommand::default()
    };
    let count = |rig: &Rig| {
        let received = rig.station().received.iter();
        received
            .filter(|(_, _, message)| message.id() == 3009)
            .count()
    };
    rig.done(every(4));
    let before = count(&rig);
    rig.run(5.0);
    let came = count(&rig) - before;
    assert!((19..=22).contains(&came), "{came}");
    rig.done(every(0));
    let before = count(&rig);
    rig.run(3.0);
    assert_eq!(count(&rig), before);
}

#[test]
fn message_3_is_sent_unrequested_where_the_mission_id_changes() {
    let mut rig = Rig::ready();
    let missions = |rig: &Rig, mark: usize| -> Vec<Option<String>> {
        let received = rig.station().received[mark..].iter();
        let of = |(_, _, message): &(_, _, Message)| match message {
            Message::VehicleId(id) => Some(id.mission_id.map(|id| id.as_str().to_owned())),
            _ => None,
        };
        received.filter_map(of).collect()
    };
    rig.send_plan(orders::square());
    for (name, reported) in [("M1", true), ("M2", true), ("M2", false)] {
        let mark = rig.station().received.len();
        let load = MissionTransferCommand {
            mission_id: Some(Text::new(name)),
            ..orders::load()
        };
        rig.done(load);
        rig.run(1.0);
        let expected = reported.then(|| Some(name.to_owned()));
        assert_eq!(missions(&rig, mark), Vec::from_iter(expected));
    }
    let mark = rig.station().received.len();
    let clear = orders::transfer(MissionPlanMode::Clear);
    rig.done(clear);
    rig.run(1.0);
    assert_eq!(missions(&rig, mark), [None]);
}
