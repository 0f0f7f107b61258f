//! The vehicle's controls: parameters that a station is offered, set by 50011 alone and read back, described by the vehicle's
//! own metadata or without a range.

use std::collections::BTreeMap;

use kit::bridge::{Rig, Setup, VSM, orders};
use mavlink_link::dialect::{MavMessage, MavParamType, PARAM_SET_DATA};
use mavlink_link::service::Node;
use px4_sim::Param;
use stanag_msgs::enums::{AckType, ConfigRequestType, FlightPathControlMode as Mode};
use stanag_msgs::messages::{FieldConfigurationRequest, ParameterSetCommand};
use stanag_msgs::{Message, Text};

/// NAV_DLL_ACT is a failsafe, which a pattern does not offer; MPC_XY_CRUISE is in both.
const CHOSEN: &str = "[vehicle.controls]\nparameters = [\"MPC_XY_CRUISE\", \"NAV_*\", \"MIS_LND_ABRT_ALT\"]\n\
                      groups = [\"Multicopter Position Control\"]\n";
const METADATA: &str = "/etc/extras/parameters.json.xz";

fn setup(metadata: bool) -> Setup {
    Setup {
        vehicles: vec![px4_sim::Config {
            events: metadata,
            ..px4_sim::Config::default()
        }],
        vehicle_keys: CHOSEN,
        ..Setup::default()
    }
}

/// A screen as a ground station builds it of what it has received: field to name, range, help, value.
#[derive(Debug, Default, Clone, PartialEq)]
struct Shown {
    range: (Option<f64>, Option<f64>),
    help: String,
    value: Option<f64>,
}

fn screen(rig: &Rig) -> BTreeMap<String, Shown> {
    let mut fields: BTreeMap<u8, (String, Shown)> = BTreeMap::new();
    for (_, _, message) in &rig.station().received {
        let (of, field, range, help) = match message {
            Message::FieldConfigurationIntegerResponse(m) => (
                m.requested_message,
                m.requested_field,
                (m.min_value.map(f64::from), m.max_value.map(f64::from)),
                m.help_text,
            ),
            Message::FieldConfigurationFloatResponse(m) => (
                m.requested_message,
                m.requested_field,
                (m.min_value.map(f64::from), m.max_value.map(f64::from)),
                m.help_text,
            ),
            Message::FieldChangeIntegerCommand(m) if m.requested_message == Some(50011) => {
                let field = m.requested_field.expect("a field");
                let known = fields.get_mut(&field).expect("described before");
                known.1.value = m.commanded_value.map(f64::from);
                continue;
            }
            Message::FieldChangeFloatCommand(m) => {
                let field = m.requested_field.expect("a field");
                let known = fields.get_mut(&field).expect("described before");
                known.1.value = m.commanded_value.map(f64::from);
                continue;
            }
            Message::MessageParameterAvailability(m) if m.reported_message == Some(50011) => {
                fields.remove(&m.reported_field.expect("a field"));
                continue;
            }
            _ => continue,
        };
        let field = field.expect("a field");
        if of != Some(50011) || field < 11 {
            continue;
        }
        let help = help.expect("a text").to_string();
        let (name, help) = help.split_once(':').expect("a name, a colon and a help");
        let known = fields.entry(field).or_default();
        assert!(known.0.is_empty() || known.0 == name, "{field}: {name}");
        known.0 = name.to_owned();
        (known.1.range, known.1.help) = (range, help.to_owned());
    }
    fields.into_values().collect()
}

fn ask(rig: &mut Rig) {
    let request = FieldConfigurationRequest {
        vsm_id: Some(VSM),
        request_type: Some(ConfigRequestType::SingleParameter),
        requested_message: Some(50011),
        ..FieldConfigurationRequest::default()
    };
    rig.done(request);
}

fn set(rig: &mut Rig, name: &str, value: f64) -> Option<AckType> {
    let end = rig.carry_out(ParameterSetCommand {
        parameter_name: Some(Text::new(name)),
        commanded_value: Some(value),
        ..ParameterSetCommand::default()
    });
    rig.run(1.0);
    end
}

fn stored(rig: &Rig, param: Param) -> f64 {
    rig.vehicles[0].vehicle().params().get(param)
}

fn logged(rig: &Rig, text: &str) -> bool {
    rig.log.iter().any(|entry| entry.text.contains(text))
}

#[test]
fn without_metadata_controls_have_no_range_and_no_other_parameter_is_written() {
    let mut rig = Rig::ready_with(setup(false));
    ask(&mut rig);
    rig.run(1.0);
    let shown = screen(&rig);
    let names: Vec<&str> = shown.keys().map(String::as_str).collect();
    assert!(
        names.contains(&"NAV_LOITER_RAD") && names.contains(&"MPC_XY_CRUISE"),
        "{names:?}"
    );
    // Failsafes are chosen by no pattern, and no group is known without metadata.
    for none in ["NAV_DLL_ACT", "NAV_RCL_ACT", "MPC_Z_V_AUTO_UP"] {
        assert!(!names.contains(&none), "{names:?}");
    }
    assert!(shown.values().all(|one| one.range == (None, None)));
    assert!(shown["MPC_XY_CRUISE"].help.contains("range not known"));
    assert_eq!(shown["MPC_XY_CRUISE"].value, Some(5.0));
    assert_eq!(shown["MIS_LND_ABRT_ALT"].value, Some(30.0));
    // Carried out once the vehicle has it; the screen shows what the vehicle reports.
    assert_eq!(
        set(&mut rig, "MPC_XY_CRUISE", 6.5),
        Some(AckType::CarriedOut)
    );
    assert_eq!(stored(&rig, Param::MPC_XY_CRUISE), 6.5);
    assert_eq!(screen(&rig)["MPC_XY_CRUISE"].value, Some(6.5));
    assert_eq!(
        set(&mut rig, "MIS_LND_ABRT_ALT", 25.0),
        Some(AckType::CarriedOut)
    );
    assert_eq!(screen(&rig)["MIS_LND_ABRT_ALT"].value, Some(25.0));
    for (name, value, why) in [
        ("MIS_TAKEOFF_ALT", 10.0, "not one of the vehicle's controls"),
        ("NAV_DLL_ACT", 0.0, "not one of the vehicle's controls"),
        ("MPC_XY_CRUISE", 25.0, "expected 3 to 20"),
    ] {
        assert_eq!(set(&mut rig, name, value), Some(AckType::Refused), "{name}");
        let alerts = rig.station().alerts();
        let said = alerts
            .iter()
            .any(|text| text.contains(name) && text.contains(why));
        assert!(said, "{name}: {alerts:#?}");
    }
    assert_eq!(stored(&rig, Param::MIS_TAKEOFF_ALT), 2.5);
    assert_eq!(stored(&rig, Param::MPC_XY_CRUISE), 6.5);
}

#[test]
fn an_advice_names_a_parameter_that_waits_for_a_restart() {
    let mut rig = Rig::ready();
    for (name, value, waits) in [("SYS_HAS_MAG", 0.0, true), ("NAV_LOITER_RAD", 60.0, false)] {
        assert_eq!(set(&mut rig, name, value), Some(AckType::CarriedOut));
        let alerts = rig.station().alerts();
        let advised = alerts
            .iter()
            .any(|text| text.contains(name) && text.contains("once it has restarted"));
        assert_eq!(advised, waits, "{name}: {alerts:#?}");
    }
}

#[test]
fn the_vehicles_metadata_gives_ranges_units_and_groups_also_to_who_has_asked_before() {
    let mut rig = Rig::ready_with(setup(true));
    ask(&mut rig);
    let read = "parameters of the vehicle are described by its metadata";
    assert!(rig.until(20.0, |rig| logged(rig, read)));
    rig.run(2.0);
    let shown = screen(&rig);
    let cruise = &shown["MPC_XY_CRUISE"];
    assert_eq!(cruise.range, (Some(3.0), Some(20.0)));
    assert_eq!(
        cruise.help,
        " [m/s] Default horizontal velocity in autonomous modes"
    );
    // Of the group alone.
    let up = &shown["MPC_Z_V_AUTO_UP"];
    assert_eq!((up.range, up.value), ((Some(0.5), Some(8.0)), Some(3.0)));
    assert!(!shown.contains_key("NAV_DLL_ACT"));
    // The bounds as reported are taken, what is outside is refused with them.
    for (value, end) in [
        (8.0, AckType::CarriedOut),
        (8.1, AckType::Refused),
        (0.4, AckType::Refused),
    ] {
        assert_eq!(
            set(&mut rig, "MPC_Z_V_AUTO_UP", value),
            Some(end),
            "{value}"
        );
    }
    let why = "parameter MPC_Z_V_AUTO_UP: 8.1, expected 0.5 to 8";
    assert!(rig.station().has_alert(why));
    assert_eq!(stored(&rig, Param::MPC_Z_V_AUTO_UP), 8.0);
    // Another ground station changes one: 44001.
    let change = MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: 4.5,
        target_system: 1,
        target_component: 1,
        param_id: "MPC_Z_V_AUTO_UP".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    });
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(Node::new(255, 190), &change);
    rig.run(1.0);
    assert_eq!(screen(&rig)["MPC_Z_V_AUTO_UP"].value, Some(4.5));
}

#[test]
fn metadata_is_read_on_the_ground_alone() {
    let mut rig = Rig::ready_with(setup(true));
    rig.take_off(15.0);
    rig.log.clear();
    rig.restart_bridge();
    let read = "parameters of the vehicle are described by its metadata";
    rig.run(30.0);
    assert!(!logged(&rig, read), "read in flight");
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(90.0, |rig| !rig.truth().armed));
    assert!(rig.until(20.0, |rig| logged(rig, read)));
}

#[test]
fn damaged_metadata_gives_no_range_and_takes_no_control_away() {
    let mut setup = setup(true);
    setup.vehicles[0].files.insert(METADATA, *b"{]");
    let mut rig = Rig::ready_with(setup);
    let why = "the vehicle's controls have no ranges: not the JSON";
    assert!(rig.until(20.0, |rig| logged(rig, why)));
    ask(&mut rig);
    rig.run(1.0);
    assert_eq!(screen(&rig)["MPC_XY_CRUISE"].range, (None, None));
    assert_eq!(
        set(&mut rig, "MPC_XY_CRUISE", 4.0),
        Some(AckType::CarriedOut)
    );
}
