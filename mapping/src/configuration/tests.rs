//! The answers hold what a CUCS needs, and claim nothing that is not true.

use std::sync::OnceLock;

use stanag_msgs::enums::{ConfigRequestType, EnumIndexEnable, FieldAvailable};
use stanag_msgs::messages::FieldConfigurationRequest;

use stanag_msgs::{Id, Message, table};

use super::answer::{answers, is_used};
use super::bounds::{Subject, bounds};
use super::controls::{Controls, ValuesBy};
use super::request::{Request, RequestError};
use crate::altitude::Agl;
use crate::limits::Limits;
use crate::parameter::Parameters;
use crate::telemetry::Place;

fn parameters() -> Parameters {
    let mut parameters = Parameters::default();
    for (name, value) in [
        ("MPC_XY_VEL_MAX", 12.0),
        ("MPC_XY_CRUISE", 5.0),
        ("MIS_TAKEOFF_ALT", 2.5),
        ("NAV_LOITER_RAD", 80.0),
        ("GF_MAX_VER_DIST", 120.0),
        ("BAT_LOW_THR", 0.15),
        ("BAT_CRIT_THR", 0.07),
    ] {
        assert!(parameters.set(name, value));
    }
    parameters
}

static NO_CONTROLS: OnceLock<Controls> = OnceLock::new();

fn subject(parameters: &Parameters) -> Subject<'_> {
    Subject {
        vsm: Id(0x1b00_0001),
        vehicle_type: 2,
        hovers: true,
        vtol: false,
        home: Some(Place {
            latitude: 47.4,
            longitude: 8.5,
            amsl_m: 488.0,
        }),
        limits: Limits::default().of(parameters),
        agl: Agl::AboveHome,
        parameters,
        web_page: Some("http://127.0.0.1:8586/"),
        controls: NO_CONTROLS.get_or_init(Controls::default),
        values_by: ValuesBy::Field,
    }
}

fn answers_to(kind: ConfigRequestType, message: u32, field: u8) -> Vec<Message> {
    let request = FieldConfigurationRequest {
        request_type: Some(kind),
        requested_message: Some(message),
        requested_field: Some(field),
        ..FieldConfigurationRequest::default()
    };
    answers(&subject(&parameters()), &Request::read(&request).unwrap())
}

#[test]
fn a_vtol_reports_the_speeds_of_its_wings_and_of_its_hover() {
    let mut known = parameters();
    for (name, value) in [
        ("MPC_XY_VEL_MAX", 8.0),
        ("FW_AIRSPD_MIN", 7.0),
        ("FW_AIRSPD_TRIM", 10.0),
        ("FW_AIRSPD_MAX", 14.0),
    ] {
        known.set(name, value);
    }
    let of = |hovers, message, field| {
        let subject = Subject {
            hovers,
            vtol: true,
            ..subject(&known)
        };
        let found = super::bounds::bounds(&subject, message, field).expect("bounds");
        (found.low, found.low_caution, found.default, found.high)
    };
    // What is commanded now, as it flies now.
    let now = (2016, "Commanded Speed");
    assert_eq!(
        of(true, now.0, now.1),
        (Some(0.5), None, Some(5.0), Some(8.0))
    );
    assert_eq!(
        of(false, now.0, now.1),
        (Some(7.0), None, Some(10.0), Some(14.0))
    );
    // A VTOL's route has legs of both kinds, whichever way it flies now.
    for hovers in [true, false] {
        let both = of(hovers, 13002, "Waypoint to Speed");
        assert_eq!(both, (Some(0.5), Some(7.0), Some(10.0), Some(14.0)));
    }
}

#[test]
fn a_speed_is_bounded_by_the_vehicle_and_starts_at_its_own() {
    let answers = answers_to(ConfigRequestType::SingleParameter, 2016, 13);
    let [
        Message::FieldConfigurationUnsignedResponse(speed),
        Message::ConfigurationComplete(_),
    ] = &answers[..]
    else {
        panic!("{answers:?}")
    };
    assert_eq!(speed.max_value, Some(24));
    assert_eq!(speed.default_value, Some(10));
    assert_eq!(speed.min_value, Some(1));
}

#[test]
fn an_altitude_is_bounded_by_the_fence() {
    let answers = answers_to(ConfigRequestType::SingleParameter, 13002, 6);
    let Message::FieldConfigurationIntegerResponse(altitude) = &answers[0] else {
        panic!("{answers:?}")
    };
    assert_eq!(altitude.max_value, Some(6_000));
    assert_eq!(altitude.min_value, Some(2));
    assert_eq!(altitude.default_value, Some(125));
}

#[test]
fn the_battery_has_its_caution_and_its_warning() {
    let answers = answers_to(ConfigRequestType::SingleParameter, 3002, 12);
    let Message::FieldConfigurationUnsignedResponse(energy) = &answers[0] else {
        panic!("{answers:?}")
    };
    let percent = |steps: Option<u32>| f64::from(steps.unwrap()) * 0.0016;
    assert!((percent(energy.low_caution_limit) - 15.0).abs() < 0.001);
    assert!((percent(energy.low_warning_limit) - 7.0).abs() < 0.001);
}

#[test]
fn refused_values_unused_fields_and_unsupported_messages_are_reported() {
    let reported = |kind, message, field, index: Option<u8>| {
        answers_to(kind, message, 0)
            .iter()
            .any(|answer| match answer {
                Message::MessageParameterAvailability(reported) => {
                    reported.reported_message == Some(message)
                        && reported.reported_field == Some(field)
                        && reported.reported_enumerated_index == index
                        && match index {
                            None => reported.field_available == Some(FieldAvailable::NotAvailable),
                            Some(_) => {
                                reported.enumerated_index_enable
                                    == Some(EnumIndexEnable::NotImplemented)
                            }
                        }
                }
                _ => false,
            })
    };
    let single = ConfigRequestType::SingleParameter;
    // Terrain avoidance; thrust; the configuration of the whole vehicle.
    assert!(reported(single, 2016, 2, Some(16)));
    assert!(!reported(single, 2016, 2, Some(11)));
    assert!(reported(single, 2016, 22, None));
    assert!(!reported(single, 2016, 13, None));
    assert!(reported(single, 2000, 0, None));
}

#[test]
fn own_modes_are_described_by_name() {
    let answers = answers_to(ConfigRequestType::Loi2, 0, 0);
    let rtl = answers.iter().find_map(|answer| match answer {
        Message::FieldConfigurationEnumeratedResponse(own)
            if own.requested_message == Some(3001)
                && own.vehicle_specific_enumeration_index == Some(32) =>
        {
            own.vehicle_specific_enumeration_text
        }
        _ => None,
    });
    assert_eq!(rtl.unwrap().as_str(), "RTL");
    // What a payload can do beyond the modes of the edition.
    let answers = answers_to(ConfigRequestType::Loi3, 0, 0);
    let own = answers.iter().filter_map(|answer| match answer {
        Message::FieldConfigurationEnumeratedResponse(own) => {
            let text = own.vehicle_specific_enumeration_text.as_ref()?;
            let number = own.vehicle_specific_enumeration_index?;
            Some((own.requested_message?, number, text.as_str().to_owned()))
        }
        _ => None,
    });
    let expected = [
        (19100, 10, "record"),
        (19100, 11, "photograph"),
        (19100, 12, "end record"),
        (21101, 10, "recording"),
    ];
    assert_eq!(
        own.collect::<Vec<_>>(),
        expected.map(|(message, number, text)| (message, number, text.to_owned()))
    );
}

#[test]
fn every_answer_fits_a_datagram_and_every_level_ends() {
    use ConfigRequestType as T;
    for kind in [T::Loi2, T::Loi3, T::Loi4, T::Loi5, T::DataLink, T::Abort] {
        let answers = answers_to(kind, 0, 0);
        assert!(matches!(
            answers.last(),
            Some(Message::ConfigurationComplete(_))
        ));
        for answer in &answers {
            let mut data = [0; 528];
            assert!(answer.encode_data(&mut data).is_ok(), "{answer:?}");
        }
    }
}

#[test]
fn bounds_hold_for_every_supported_field_that_has_them() {
    let parameters = parameters();
    let subject = subject(&parameters);
    for message in table::MESSAGES {
        for field in message.fields {
            let Some(found) = bounds(&subject, message.id, field.name) else {
                continue;
            };
            assert!(is_used(message, field), "{} {}", message.id, field.name);
            assert!(found.help.len() < 80, "{}", found.help);
            if let (Some(low), Some(high)) = (found.low, found.high) {
                assert!(low <= high, "{} {}", message.id, field.name);
                if let Some(default) = found.default {
                    assert!((low..=high).contains(&default), "{}", field.name);
                }
            }
        }
    }
}

#[test]
fn nothing_is_made_up_before_the_vehicle_is_known() {
    let none = Parameters::default();
    let subject = Subject {
        home: None,
        parameters: &none,
        ..subject(&none)
    };
    let latitude = bounds(&subject, 13002, "Waypoint to Latitude or Relative Y").unwrap();
    assert_eq!(latitude.default, None);
    assert_eq!(
        bounds(&subject, 2017, "Loiter Radius").unwrap().default,
        None
    );
    let speed = bounds(&subject, 2016, "Commanded Speed").unwrap();
    assert_eq!((speed.default, speed.high), (None, Some(100.0)));
}

#[test]
fn requests_that_are_none_are_refused() {
    let read = |kind, message, field| {
        Request::read(&FieldConfigurationRequest {
            request_type: kind,
            requested_message: message,
            requested_field: field,
            ..FieldConfigurationRequest::default()
        })
        .map(|_| ())
    };
    let single = Some(ConfigRequestType::SingleParameter);
    assert_eq!(read(None, None, None), Err(RequestError::NoType));
    assert_eq!(
        read(Some(ConfigRequestType::Unknown(9)), None, None),
        Err(RequestError::Type(9))
    );
    assert_eq!(
        read(single, Some(2001), None),
        Err(RequestError::Message(2001))
    );
    assert_eq!(
        read(single, Some(16002), Some(2)),
        Err(RequestError::Field {
            message: 16002,
            field: 2,
            fields: 1
        })
    );
}
