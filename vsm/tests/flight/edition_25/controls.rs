//! Controls of the vehicle at a station of Edition 2.5: #1300 and #1301 of the private #2011, values by #2012.

use cucs::Delivery;
use kit::bridge::{Rig, Setup, VSM, orders};
use px4_sim::Param;
use stanag_msgs::enums::ConfigRequestType;
use stanag_msgs::messages::{FieldConfigurationRequest, ParameterReport, ParameterSetCommand};
use stanag_msgs::{Message, Text};

use super::operator::Operator;
use super::{TABLES, station::StationEd25};

const CHOSEN: &str = "[vehicle.controls]\nparameters = [\"MPC_XY_CRUISE\", \"MIS_LND_ABRT_ALT\"]\n";

fn operator(metadata: bool) -> (Rig, Operator) {
    let mut rig = Rig::new(Setup {
        vehicles: vec![px4_sim::Config {
            events: metadata,
            ..px4_sim::Config::default()
        }],
        vehicle_keys: CHOSEN,
        tables: TABLES,
        ..Setup::default()
    });
    rig.run(15.0);
    let station = StationEd25::new(super::CUCS, ([127, 0, 0, 2], 41_000).into());
    let mut operator = Operator::new(station.address);
    let taken = operator.send(&mut rig, orders::request_control());
    assert_eq!(taken, Delivery::CarriedOut, "{:?}", operator.texts);
    (rig, operator)
}

fn ask(rig: &mut Rig, operator: &mut Operator) {
    let request = FieldConfigurationRequest {
        vsm_id: Some(VSM),
        request_type: Some(ConfigRequestType::SingleParameter),
        requested_message: Some(ParameterSetCommand::ID.into()),
        ..FieldConfigurationRequest::default()
    };
    assert_eq!(operator.send(rig, request), Delivery::CarriedOut);
    operator.until(rig, 1.0, |_, _| false);
}

fn set(rig: &mut Rig, operator: &mut Operator, name: &str, value: f64) -> Delivery {
    operator.send(
        rig,
        ParameterSetCommand {
            parameter_name: Some(Text::new(name)),
            commanded_value: Some(value),
            ..ParameterSetCommand::default()
        },
    )
}

/// Least, greatest and help of the control of this name.
fn limits(operator: &Operator, name: &str) -> Option<(Option<f64>, Option<f64>, String)> {
    let all = operator.messages.iter().rev();
    let mut all = all.filter_map(|message| match message {
        Message::FieldConfigurationFloatResponse(m) => Some((
            m.min_value.map(f64::from),
            m.max_value.map(f64::from),
            m.help_text?.to_string(),
        )),
        Message::FieldConfigurationIntegerResponse(m) => Some((
            m.min_value.map(f64::from),
            m.max_value.map(f64::from),
            m.help_text?.to_string(),
        )),
        _ => None,
    });
    all.find(|(_, _, help)| help.starts_with(&format!("{name}:")))
}

fn value(operator: &Operator, name: &str) -> Option<f64> {
    let mut all = operator.messages.iter().rev();
    all.find_map(|message| match message {
        Message::ParameterReport(ParameterReport {
            parameter_name: Some(of),
            value,
            ..
        }) if of.as_str() == name => *value,
        _ => None,
    })
}

#[test]
fn a_control_is_described_set_and_refused_in_the_messages_of_the_edition() {
    let (mut rig, mut operator) = operator(true);
    ask(&mut rig, &mut operator);
    let (low, high, help) = limits(&operator, "MPC_XY_CRUISE").expect("it is described");
    assert_eq!((low, high), (Some(3.0), Some(20.0)));
    assert!(help.contains("[m/s] Default horizontal velocity"), "{help}");
    assert_eq!(value(&operator, "MPC_XY_CRUISE"), Some(5.0));
    assert_eq!(value(&operator, "MIS_LND_ABRT_ALT"), Some(30.0));
    let done = set(&mut rig, &mut operator, "MPC_XY_CRUISE", 7.0);
    assert_eq!(done, Delivery::CarriedOut, "{:?}", operator.texts);
    let stored = |rig: &Rig, param| rig.vehicles[0].vehicle().params().get(param);
    assert_eq!(stored(&rig, Param::MPC_XY_CRUISE), 7.0);
    assert_eq!(value(&operator, "MPC_XY_CRUISE"), Some(7.0));
    for (name, value, why) in [
        ("MPC_XY_CRUISE", 30.0, "expected 3 to 20"),
        ("NAV_DLL_ACT", 0.0, "not one of the vehicle's controls"),
    ] {
        let refused = set(&mut rig, &mut operator, name, value);
        assert_eq!(refused, Delivery::Refused, "{name}");
        let texts = operator.texts.concat();
        assert!(texts.contains("#2011") && texts.contains(why), "{texts}");
    }
    assert_eq!(stored(&rig, Param::MPC_XY_CRUISE), 7.0);
}

#[test]
fn an_unknown_range_is_that_of_the_type_and_no_limit() {
    let (mut rig, mut operator) = operator(false);
    ask(&mut rig, &mut operator);
    for name in ["MPC_XY_CRUISE", "MIS_LND_ABRT_ALT"] {
        let (low, high, help) = limits(&operator, name).expect("it is described");
        assert_eq!((low, high), (None, None), "{name}");
        assert!(help.contains("range not known"), "{help}");
    }
}
