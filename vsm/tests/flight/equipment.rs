//! What PX4 reports of its receivers, motors, buses and the air, and what the VSM knows of the data link: on request and by
//! schedule, absent where it is unknown.

use std::net::SocketAddr;
use std::time::Duration;

use kit::bridge::{Rig, Setup, bridge_mav, orders, vehicle_address, vehicle_id};
use kit::network::Faults;
use mavlink_link::dialect::{MavMessage, RADIO_STATUS_DATA};
use mavlink_link::frame::{Header, MAX_FRAME, encode};
use px4_sim::Airframe;
use stanag_msgs::enums::{AccessGranted, AckType, DlComsecState, DlState, EngineStatus};
use stanag_msgs::messages::{
    DataLinkControlRequest, DlInControlReport, DlToVehicleIdReport, ElectricalReport,
    EngineOperatingStates, GenericInformationRequestMessage, GpsStatusReport, IffSsrCodeCommand,
    LegacyDlStatusReport, LinkHealthStatus, LostLinkDelayTimerReport, MeteorologicalTableReport,
    RelativeRouteWaypointLocationReport, ScheduleMessageUpdateCommand,
};
use stanag_msgs::{Id, Message};

/// Requests a report, and whether that was carried out.
fn request(rig: &mut Rig, message_type: u16) -> Option<AckType> {
    let end = rig.carry_out(GenericInformationRequestMessage {
        message_type: Some(message_type),
        ..GenericInformationRequestMessage::default()
    });
    rig.run(0.2);
    end
}

/// Requests a report twice: the first time the vehicle is asked for what it is made of.
fn reported(rig: &mut Rig, message_type: u16) -> Message {
    let _ = request(rig, message_type);
    rig.run(2.5);
    assert_eq!(
        request(rig, message_type),
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
    rig.station().latest[&(vehicle_id(0), message_type)].clone()
}

macro_rules! report {
    ($rig:expr, $Name:ident) => {
        match reported($rig, $Name::ID) {
            Message::$Name(report) => report,
            other => panic!("{other:?}"),
        }
    };
}

fn ready(airframe: Airframe, mav: Faults) -> Rig {
    Rig::ready_with(Setup {
        mav,
        vehicles: vec![px4_sim::Config {
            airframe,
            wind_ne_ms: [3.0, -2.0],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    })
}

#[test]
fn the_receiver_the_bus_and_home_are_reported_and_nothing_that_was_not() {
    let mut rig = ready(Airframe::Quad, Faults::NONE);
    let gps = report!(&mut rig, GpsStatusReport);
    assert_eq!(
        (gps.number_of_satellites, gps.gps_mode, gps.gps_status),
        (Some(10), Some(3), Some(1))
    );
    assert_eq!(
        (gps.hdop, gps.vdop, gps.pdop),
        (Some(7), Some(11), Some(13))
    );
    assert_eq!(gps.gps_time, None, "it sends its time since boot");
    let bus = report!(&mut rig, ElectricalReport);
    assert_eq!((bus.bus_id, bus.bus_voltage), (Some(0), Some(16)));
    assert_eq!((bus.bus_current, bus.battery_time_remaining), (None, None));
    let home = report!(&mut rig, RelativeRouteWaypointLocationReport);
    let truth = rig.truth().place;
    assert!(
        (home.location_latitude_y_axis_zero.unwrap().degrees() - truth.latitude_deg).abs() < 1e-4
    );
    assert!(home.ua_relative_altitude.unwrap().si().abs() < 1.0);
    // By schedule too, until it is cancelled.
    let schedule = |hertz| ScheduleMessageUpdateCommand {
        requested_message_type: Some(GpsStatusReport::ID),
        frequency: Some(hertz),
        ..ScheduleMessageUpdateCommand::default()
    };
    let count = |rig: &Rig| {
        let all = rig.station().received.iter();
        all.filter(|(_, _, message)| message.id() == GpsStatusReport::ID)
            .count()
    };
    rig.done(schedule(2));
    let before = count(&rig);
    rig.run(5.0);
    assert!((9..=11).contains(&(count(&rig) - before)));
}

#[test]
fn motors_turn_as_their_controllers_report() {
    let mut rig = ready(Airframe::Quad, Faults::NONE);
    let engine = report!(&mut rig, EngineOperatingStates);
    assert_eq!(engine.engine_speed_1.map(|speed| speed.si()), Some(0.0));
    rig.take_off(15.0);
    let engine = report!(&mut rig, EngineOperatingStates);
    assert!(
        engine
            .engine_speed_1
            .is_some_and(|speed| speed.si() > 100.0),
        "{engine:?}"
    );
}

#[test]
fn a_combustion_engine_runs_by_its_own_report_while_the_vehicle_is_disarmed_too() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            airframe: Airframe::Plane,
            combustion: true,
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    let engine = report!(&mut rig, EngineOperatingStates);
    assert_eq!(engine.engine_status, Some(EngineStatus::Running));
    let idle = engine.engine_speed_1.expect("reported").si();
    assert!((150.0..165.0).contains(&idle), "{idle}");
    assert_eq!(
        engine.engine_power_setting.map(|power| power.si()),
        Some(0.0)
    );
    assert_eq!(engine.engine_temperature_1, None);
}

#[test]
fn the_air_is_reported_where_the_vehicle_is_as_it_estimates_it() {
    let mut rig = ready(Airframe::Plane, Faults::NONE);
    let weather = report!(&mut rig, MeteorologicalTableReport);
    assert_eq!((weather.u_speed, weather.v_speed), (Some(60), Some(-40)));
    let kelvin = weather.temperature.expect("a barometer has one").si();
    assert!(
        (282.0..286.0).contains(&kelvin),
        "{kelvin}: 488 m above 15 degrees"
    );
    assert!(weather.latitude.is_some() && weather.humidity.is_none());
    // PX4 estimates no wind for a multicopter in its simulator.
    let mut rig = ready(Airframe::Quad, Faults::NONE);
    let weather = report!(&mut rig, MeteorologicalTableReport);
    assert_eq!(
        (weather.u_speed, weather.temperature.is_some()),
        (None, true)
    );
}

#[test]
fn the_link_is_reported_with_its_loss_and_without_the_vehicle() {
    let lossy = Faults {
        loss: 0.3,
        ..Faults::NONE
    };
    for (faults, arrived, health) in [(Faults::NONE, 100..=100, 0), (lossy, 50..=85, 1)] {
        let mut rig = ready(Airframe::Quad, faults);
        rig.run(15.0);
        let status = report!(&mut rig, LegacyDlStatusReport);
        assert!(
            arrived.contains(&status.downlink_status.unwrap()),
            "{status:?}"
        );
        assert_eq!(status.data_link_state, Some(DlState::TxRx));
        assert_eq!(
            status.communication_security_state,
            Some(DlComsecState::Keyed)
        );
        assert_eq!(
            report!(&mut rig, LinkHealthStatus).bit_mode_status,
            Some(health)
        );
        let ends = report!(&mut rig, DlToVehicleIdReport);
        assert_eq!(
            (
                ends.uplink_communication_state,
                ends.downlink_communication_state
            ),
            (Some(1), Some(1))
        );
        rig.vehicles.clear();
        rig.run(12.0);
        assert_eq!(
            report!(&mut rig, LegacyDlStatusReport).data_link_state,
            Some(DlState::Off)
        );
        assert_eq!(report!(&mut rig, LinkHealthStatus).bit_mode_status, Some(2));
        assert_eq!(
            request(&mut rig, GpsStatusReport::ID),
            Some(AckType::Refused)
        );
    }
}

/// A RADIO_STATUS as a SiK radio puts it into the stream, from this address.
fn radio_reports(rig: &mut Rig, from: SocketAddr, free: u8) {
    let status = MavMessage::RADIO_STATUS(RADIO_STATUS_DATA {
        rssi: 180,
        remrssi: 180,
        noise: 40,
        remnoise: 40,
        txbuf: free,
        ..RADIO_STATUS_DATA::default()
    });
    let header = Header {
        system_id: 51,
        component_id: 68,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let length = encode(&status, header, &mut out);
    let now = rig.clock.elapsed();
    let bytes = out[..length].to_vec();
    rig.mav.send(now, from, bridge_mav(0), bytes);
    rig.run(0.1);
}

#[test]
fn a_radio_and_a_delay_degrade_the_link_and_a_stranger_does_not() {
    let mut rig = ready(Airframe::Quad, Faults::NONE);
    rig.run(5.0);
    let health = |rig: &mut Rig| report!(rig, LinkHealthStatus).bit_mode_status;
    assert_eq!(health(&mut rig), Some(0));
    // A stranger's, with a full send buffer, and the radio's own with an empty one.
    let stranger = SocketAddr::from(([10, 9, 9, 9], 14550));
    radio_reports(&mut rig, stranger, 3);
    assert_eq!(health(&mut rig), Some(0));
    radio_reports(&mut rig, vehicle_address(0), 98);
    assert_eq!(health(&mut rig), Some(0));
    radio_reports(&mut rig, vehicle_address(0), 3);
    assert_eq!(health(&mut rig), Some(1));
    // What it has not repeated counts no more.
    rig.run(10.0);
    assert_eq!(health(&mut rig), Some(0));
    // Signed, and over a second there and back.
    let late = Faults {
        delay: (Duration::from_millis(600), Duration::from_millis(600)),
        ..Faults::NONE
    };
    let mut rig = ready(Airframe::Quad, late);
    rig.run(15.0);
    assert_eq!(health(&mut rig), Some(1));
}

#[test]
fn who_controls_and_how_long_it_may_be_silent_is_reported_to_the_others() {
    let mut rig = Rig::ready_with(Setup {
        stations: 2,
        dli_keys: "",
        tables: "[authority]\nwarn_s = 3\noffer_s = 5\nact_s = 10\n",
        ..Setup::default()
    });
    let listen = stanag_msgs::messages::CucsAuthorisationRequest {
        requested_handover_loi: Some(stanag_msgs::enums::LoiBitmap::LOI2),
        ..orders::request_control()
    };
    let ticket = rig.send_as(1, 0, listen);
    assert_eq!(rig.end_as(1, ticket), Some(AckType::CarriedOut));
    let ask = |rig: &mut Rig, message_type: u16| {
        let ticket = rig.send_as(
            1,
            0,
            GenericInformationRequestMessage {
                message_type: Some(message_type),
                ..GenericInformationRequestMessage::default()
            },
        );
        assert_eq!(rig.end_as(1, ticket), Some(AckType::CarriedOut));
        rig.run(0.1);
        rig.stations[1].latest[&(vehicle_id(0), message_type)].clone()
    };
    let timer = |rig: &mut Rig| match ask(rig, LostLinkDelayTimerReport::ID) {
        Message::LostLinkDelayTimerReport(report) => (
            report.lost_link_delay_timer_status.unwrap(),
            report.current_delay_time.unwrap(),
        ),
        other => panic!("{other:?}"),
    };
    rig.stations[0].heartbeats = true;
    rig.stations[1].heartbeats = true;
    rig.run(5.0);
    assert_eq!(timer(&mut rig), (0, 10));
    let holder = ask(&mut rig, DlInControlReport::ID);
    assert!(
        matches!(holder, Message::DlInControlReport(report) if report.in_control_cucs_id == Some(kit::bridge::cucs(0)))
    );
    rig.stations[0].heartbeats = false;
    rig.run(5.0);
    let (status, left_s) = timer(&mut rig);
    assert!(
        status == 1 && (3..=6).contains(&left_s),
        "{status} {left_s}"
    );
    rig.run(10.0);
    let holder = ask(&mut rig, DlInControlReport::ID);
    assert!(
        matches!(holder, Message::DlInControlReport(report) if report.in_control_cucs_id == Some(Id::NULL))
    );
}

#[test]
fn a_station_may_ask_for_the_link_and_is_given_no_control_of_it() {
    let mut rig = ready(Airframe::Quad, Faults::NONE);
    for (asked, end) in [
        (1, AckType::CarriedOut),
        (0, AckType::Refused),
        (2, AckType::Refused),
    ] {
        let request = DataLinkControlRequest {
            control_assignment_request: Some(asked),
            ..DataLinkControlRequest::default()
        };
        assert_eq!(rig.carry_out(request), Some(end));
        rig.run(0.1);
        let Some(Message::DataLinkConfigurationAssignmentMessage(link)) =
            rig.station().latest.get(&(vehicle_id(0), 28_001))
        else {
            panic!("no 28001");
        };
        assert_eq!(
            (link.access_granted, link.access_requested),
            (Some(AccessGranted::NotInControl), Some(asked))
        );
    }
    assert!(
        rig.station()
            .has_alert("28000 (Data Link Control Request) refused: Control Assignment Request 0"),
        "{:?}",
        rig.station().alerts()
    );
    // To everybody it is the question which links there are.
    rig.stations[0].latest.remove(&(vehicle_id(0), 28_001));
    let request = DataLinkControlRequest {
        control_assignment_request: Some(0),
        ..DataLinkControlRequest::default()
    };
    let now = rig.station_now();
    rig.stations[0].send_once(now, Id::BROADCAST, request.into());
    rig.run(0.2);
    let found = rig.station().latest.get(&(vehicle_id(0), 28_001));
    assert!(
        matches!(found, Some(Message::DataLinkConfigurationAssignmentMessage(link)) if link.access_requested.is_none()),
        "{found:?}"
    );
}

#[test]
fn a_code_for_a_transponder_that_is_not_there_is_refused_with_that_reason() {
    let mut rig = ready(Airframe::Quad, Faults::NONE);
    let code = IffSsrCodeCommand {
        mode_3_a_code: Some(1_200),
        ..IffSsrCodeCommand::default()
    };
    assert_eq!(rig.carry_out(code), Some(AckType::Refused));
    assert!(
        rig.station().has_alert("no transponder is connected"),
        "{:?}",
        rig.station().alerts()
    );
}
