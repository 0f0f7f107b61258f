//! Parameters, software versions and pings: the private messages 50010 to 50015.

use kit::bridge::{Faults, Rig, Setup, orders, vehicle_id};
use mavlink_link::dialect::{MavMessage, PARAM_SET_DATA};
use mavlink_link::service::Node;
use mavlink_link::service::param::{Name, Value};
use stanag_msgs::enums::{AckType, LoiBitmap, ParameterKind, PingTarget, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, GenericInformationRequestMessage, ParameterReport, ParameterRequest,
    ParameterSetCommand, PingRequest,
};
use stanag_msgs::{Message, Text, U40};

fn read(name: &str) -> ParameterRequest {
    ParameterRequest {
        parameter_name: Some(Text::new(name)),
        ..ParameterRequest::default()
    }
}

fn write(name: &str, value: f64) -> ParameterSetCommand {
    ParameterSetCommand {
        parameter_name: Some(Text::new(name)),
        commanded_value: Some(value),
        ..ParameterSetCommand::default()
    }
}

/// The 50012s that a station has received since `mark`.
fn parameter_reports(rig: &Rig, station: usize, mark: usize) -> Vec<ParameterReport> {
    let received = rig.stations[station].received[mark..].iter();
    received
        .filter_map(|(_, _, message)| match message {
            Message::ParameterReport(report) => Some(report.clone()),
            _ => None,
        })
        .collect()
}

fn stored(rig: &Rig, name: &str) -> f64 {
    let name = Name::new(name).unwrap();
    let table = rig.vehicles[0].vehicle().params().table();
    let found = table.into_iter().find(|entry| entry.name == name);
    match found.expect("a parameter of the simulated vehicle").value {
        Value::Int(value) => value.into(),
        Value::Real(value) => value.into(),
    }
}

fn refused(rig: &mut Rig, message: impl Into<Message>, why: &str) {
    assert_eq!(rig.carry_out(message), Some(AckType::Refused), "{why}");
    rig.run(0.1);
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
}

#[test]
fn a_parameter_is_reported_with_its_kind_and_its_range() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    rig.done(read("COM_DL_LOSS_T"));
    let [report] = &parameter_reports(&rig, 0, mark)[..] else {
        panic!("{:?}", parameter_reports(&rig, 0, mark))
    };
    assert_eq!(report.parameter_kind, Some(ParameterKind::Integer));
    assert_eq!(report.value, Some(10.0));
    assert_eq!((report.minimum, report.maximum), (Some(5.0), Some(300.0)));
    refused(
        &mut rig,
        read("NO_SUCH_ONE"),
        "parameter NO_SUCH_ONE: the vehicle",
    );
    refused(&mut rig, read("no name"), "1 to 16 printable");
}

#[test]
fn all_parameters_come_once_each_over_a_bad_link() {
    let mut rig = Rig::new(Setup {
        mav: Faults {
            loss: 0.1,
            ..Faults::NONE
        },
        ..Setup::default()
    });
    rig.run(9.0);
    rig.done(orders::request_control());
    let mark = rig.station().received.len();
    rig.done(ParameterRequest::default());
    let parameter_reports = parameter_reports(&rig, 0, mark);
    let count = rig.vehicles[0].vehicle().params().table().count();
    assert_eq!(parameter_reports.len(), count);
    for (index, report) in parameter_reports.iter().enumerate() {
        assert_eq!(report.parameter_index.map(usize::from), Some(index));
        assert_eq!(report.parameter_count.map(usize::from), Some(count));
    }
}

#[test]
fn a_write_is_carried_out_once_the_vehicle_reports_the_value() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    rig.done(write("MPC_XY_CRUISE", 7.5));
    assert_eq!(stored(&rig, "MPC_XY_CRUISE"), 7.5);
    let reports = parameter_reports(&rig, 0, mark);
    assert_eq!(reports.last().and_then(|report| report.value), Some(7.5));
    rig.done(write("NAV_DLL_ACT", 1.0));
    assert_eq!(stored(&rig, "NAV_DLL_ACT"), 1.0);
    // Reporting it sends nothing to the vehicle when nothing is requested.
    rig.mav.faults.loss = 1.0;
    refused(
        &mut rig,
        write("MPC_XY_CRUISE", 6.0),
        "the vehicle does not answer: it may have been carried out",
    );
}

#[test]
fn what_the_vehicle_would_store_blindly_never_reaches_it() {
    let mut rig = Rig::ready();
    for (name, value, why) in [
        ("NAV_DLL_ACT", 99.0, "expected one of [0, 1, 2, 3, 5, 6]"),
        ("COM_DL_LOSS_T", 1_000.0, "expected 5 to 300"),
        ("COM_DL_LOSS_T", 7.5, "a whole number"),
        ("MIS_TAKEOFF_ALT", -5.0, "expected 0 to inf"),
        ("MPC_XY_CRUISE", f64::NAN, "expected a number"),
        ("MAV_SYS_ID", 2.0, "identifies the vehicle on this link"),
        ("MY_OWN", 2.0, "its range is not known"),
    ] {
        refused(&mut rig, write(name, value), why);
    }
    let nothing = ParameterSetCommand {
        parameter_name: Some(Text::new("MPC_XY_CRUISE")),
        ..ParameterSetCommand::default()
    };
    refused(&mut rig, nothing, "Commanded Value is missing");
    assert_eq!(stored(&rig, "NAV_DLL_ACT"), 0.0);
    assert_eq!(stored(&rig, "COM_DL_LOSS_T"), 10.0);
    assert_eq!(stored(&rig, "MIS_TAKEOFF_ALT"), 2.5);
    assert_eq!(stored(&rig, "MAV_SYS_ID"), 1.0);
}

#[test]
fn reading_needs_loi_2_and_writing_loi_4() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    assert_eq!(rig.carry_out(read("NAV_DLL_ACT")), Some(AckType::Refused));
    let loi_2 = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    };
    rig.done(loi_2);
    rig.done(read("NAV_DLL_ACT"));
    assert_eq!(
        rig.carry_out(write("NAV_DLL_ACT", 2.0)),
        Some(AckType::Refused)
    );
    assert_eq!(stored(&rig, "NAV_DLL_ACT"), 0.0);
}

#[test]
fn a_change_by_another_station_is_reported_to_those_that_requested_it() {
    let mut rig = Rig::ready();
    rig.done(read("NAV_DLL_ACT"));
    let mark = rig.station().received.len();
    // The other station is on another link of the vehicle; PX4 reports to every link.
    let name = *b"NAV_DLL_ACT\0\0\0\0\0";
    let change = MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: Value::Int(3).to_wire(),
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type: Value::Int(3).kind(),
    });
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(Node::new(255, 190), &change);
    rig.run(1.0);
    let reports = parameter_reports(&rig, 0, mark);
    assert_eq!(reports.last().and_then(|report| report.value), Some(3.0));
    assert!(
        rig.station()
            .has_alert("parameter NAV_DLL_ACT is now 3, it was 0: not changed through this VSM"),
        "{:?}",
        rig.station().alerts()
    );
    // Reported once, however often the vehicle sends it.
    let mark = rig.station().received.len();
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(Node::new(255, 190), &change);
    rig.run(1.0);
    assert_eq!(parameter_reports(&rig, 0, mark), []);
}

#[test]
fn parameters_are_reported_only_on_request() {
    let mut rig = Rig::ready();
    rig.take_off(10.0);
    rig.run(5.0);
    assert!(
        rig.station()
            .received
            .iter()
            .all(|(_, _, message)| message.id() < 50_000)
    );
}

#[test]
fn software_versions_are_reported_on_request() {
    let mut rig = Rig::ready();
    let ask = |fields: Option<u64>| GenericInformationRequestMessage {
        message_type: Some(50013),
        requested_field_presence_vector: fields.map(|bits| U40::new(bits).unwrap()),
        ..GenericInformationRequestMessage::default()
    };
    let version = |rig: &Rig| {
        rig.station()
            .last(vehicle_id(0), 50013, |message| match message {
                Message::SoftwareVersionReport(report) => Some(report.clone()),
                _ => None,
            })
    };
    rig.done(ask(None));
    assert!(rig.until(2.0, |rig| version(rig).is_some()));
    let report = version(&rig).unwrap();
    let text = |text: Option<Text<20>>| text.map(|text| text.as_str().to_owned());
    assert_eq!(
        text(report.vsm_version).as_deref(),
        Some(env!("CARGO_PKG_VERSION"))
    );
    assert_eq!(
        text(report.autopilot_version).as_deref(),
        Some("1.18.0-beta")
    );
    assert_eq!(report.hardware_id.unwrap().as_str(), "0000000053494d01");
    rig.done(ask(Some(0b100)));
    let report = version(&rig).unwrap();
    assert!(report.autopilot_version.is_some() && report.vsm_version.is_none());
    // A silent vehicle has reported none: the VSM's own is reported.
    let mut rig = Rig::ready();
    rig.mav.faults.loss = 1.0;
    rig.done(ask(None));
    assert!(rig.until(5.0, |rig| version(rig).is_some()));
    assert_eq!(version(&rig).unwrap().autopilot_version, None);
}

/// They go before commands, on the link that these need.
#[test]
fn a_station_that_pings_without_pause_leaves_the_link_to_commands() {
    const PING: u32 = 4;
    let mut rig = Rig::ready();
    let before = rig.arrived.get(&PING).copied().unwrap_or(0);
    for number in 0..500 {
        rig.send_once(PingRequest {
            ping_number: Some(number),
            ping_target: Some(PingTarget::Vehicle),
            ..PingRequest::default()
        });
        rig.run(0.02);
    }
    let sent = rig.arrived.get(&PING).copied().unwrap_or(0) - before;
    // 16 at once, then two a second.
    assert!((16..45).contains(&sent), "{sent} in 10 s");
    let alerts = rig.station().alerts();
    let often = "this station pings the vehicle too often";
    assert!(rig.station().has_alert(often), "{alerts:?}");
}

#[test]
fn a_ping_measures_the_way_to_the_vehicle_and_back() {
    let mut rig = Rig::ready_with(Setup {
        mav: Faults {
            delay: (
                std::time::Duration::from_millis(100),
                std::time::Duration::from_millis(100),
            ),
            ..Faults::NONE
        },
        ..Setup::default()
    });
    let ping = |number, target| PingRequest {
        ping_number: Some(number),
        ping_target: Some(target),
        ..PingRequest::default()
    };
    let answer = |rig: &Rig| {
        rig.station()
            .last(vehicle_id(0), 50015, |message| match message {
                Message::PingResponse(answer) => Some(answer.clone()),
                _ => None,
            })
    };
    rig.done(ping(7, PingTarget::Vsm));
    let own = answer(&rig).unwrap();
    assert_eq!((own.ping_number, own.vehicle_round_trip), (Some(7), None));
    assert!(own.request_time_stamp.is_some());
    rig.done(ping(8, PingTarget::Vehicle));
    let far = answer(&rig).unwrap();
    assert_eq!(far.ping_number, Some(8));
    let round_trip = far.vehicle_round_trip.unwrap();
    assert!((0.15..0.4).contains(&round_trip), "{round_trip}");
    refused(&mut rig, ping(9, PingTarget::Unknown(9)), "Ping Target 9");
    rig.mav.faults.loss = 1.0;
    refused(
        &mut rig,
        ping(10, PingTarget::Vehicle),
        "does not answer the ping",
    );
    rig.run(6.0);
    refused(
        &mut rig,
        ping(11, PingTarget::Vehicle),
        "no data from the vehicle",
    );
}
