//! The answers to a 40000: a field, a message, or a level of interoperability.

use stanag_msgs::enums::{
    EnumIndexEnable, EnumInfo, EnumKind, FieldAvailable, FieldSupported, RouteType, SubsystemId,
};
use stanag_msgs::messages::{
    ConfigurationComplete, FieldConfigurationCharacterResponse,
    FieldConfigurationEnumeratedResponse, FieldConfigurationFloatResponse,
    FieldConfigurationIntegerResponse, FieldConfigurationUnsignedResponse,
    MessageParameterAvailability, UaRouteConfiguration, VsmServicesReportMessage,
};
use stanag_msgs::table::{self, FieldInfo, MessageInfo, Wire};
use stanag_msgs::{Id, Message, Text};

use super::bounds::{Subject, bounds, default_value};
use super::controls::Controls;
use super::request::{Request, Scope};
use crate::mode::MODES;
use crate::payload::report::{END_RECORDING, PHOTOGRAPH, RECORDING};
use crate::plan::MAX_ROUTES;
use crate::report;
use crate::support::{self, Received};

/// The answers to a request (41000 to 41004, 43000, 43001, 44003), all without stamps; the last one is a 41005.
#[must_use]
pub fn answers(subject: &Subject<'_>, request: &Request) -> Vec<Message> {
    let mut answers = Vec::new();
    match request.scope {
        Scope::Field { message, field } => {
            self::field(subject, message, field, &mut answers);
        }
        Scope::Message(message) => self::message(subject, message, &mut answers),
        Scope::Control(number) => {
            answers.extend(control(subject, number));
            if answers.is_empty() {
                answers.push(Controls::gone(number));
            }
        }
        Scope::Level(level) => {
            for message in table::MESSAGES.iter().filter(|info| level.has(info)) {
                self::message(subject, message, &mut answers);
            }
            if level.is_status() {
                answers.push(services(subject));
            }
            if level.is_control() {
                answers.extend(routes(subject));
            }
        }
        Scope::Abort => {}
    }
    let with_controls = matches!(request.scope, Scope::Level(level) if level.is_control())
        || matches!(request.scope, Scope::Message(_)) && request.is_of_controls();
    if with_controls {
        let offered = subject.controls.offered();
        answers.extend(offered.flat_map(|number| control(subject, number)));
    }
    answers.push(Message::ConfigurationComplete(ConfigurationComplete {
        vsm_id: Some(subject.vsm),
        data_link_id: Some(Id::NULL),
        station_number_1_16: Some(0),
        vehicle_type: Some(subject.vehicle_type),
        vehicle_subtype: Some(0),
        ..ConfigurationComplete::default()
    }));
    answers
}

/// The limits of a control, and its value.
fn control(subject: &Subject<'_>, number: u8) -> impl Iterator<Item = Message> + use<> {
    let Subject { vsm, values_by, .. } = *subject;
    subject.controls.describe(number, vsm, values_by)
}

/// Whether this VSM uses any field of a message, on receipt or in sending.
fn is_supported(message: &MessageInfo) -> bool {
    support::message(message.id).is_some_and(|row| !row.taken.is_empty() || !row.sends.is_empty())
}

/// Whether a field is used: it has an effect, or is filled.
pub(super) fn is_used(message: &'static MessageInfo, field: &table::FieldInfo) -> bool {
    let does = support::field(message, field);
    match does.received {
        Received::Honoured(_) => true,
        // A field that is only kept and returned on download is not used.
        Received::Ignored | Received::Refused => false,
        Received::Never => does.sent.is_some(),
    }
}

/// 43000: the services of this VSM.
fn services(subject: &Subject<'_>) -> Message {
    Message::VsmServicesReportMessage(VsmServicesReportMessage {
        vsm_home_web_page_url: Some(Text::new(subject.web_page.unwrap_or(""))),
        ftp_url: Some(Text::new("")),
        ..VsmServicesReportMessage::default()
    })
}

/// 43001, one for each route type.
fn routes(subject: &Subject<'_>) -> impl Iterator<Item = Message> {
    let waypoints = u16::try_from(subject.limits.items).unwrap_or(u16::MAX);
    [
        RouteType::Launch,
        RouteType::Approach,
        RouteType::Flight,
        RouteType::ContingencyA,
        RouteType::ContingencyB,
    ]
    .map(|route_type| {
        Message::UaRouteConfiguration(UaRouteConfiguration {
            route_type: Some(route_type),
            instances: Some(u8::try_from(MAX_ROUTES).unwrap_or(u8::MAX)),
            maximum_number_of_waypoints: Some(waypoints),
            location_type_support: Some(ABSOLUTE_ONLY),
            ..UaRouteConfiguration::default()
        })
    })
    .into_iter()
}

/// All of a message: 44003 where it is not supported, otherwise its fields.
pub(super) fn message(
    subject: &Subject<'_>,
    message: &'static MessageInfo,
    out: &mut Vec<Message>,
) {
    if is_supported(message) {
        for field in message.fields {
            self::field(subject, message, field, out);
        }
    } else {
        out.push(unavailable(message, 0));
    }
}

/// One field: 44003 where it is not used, otherwise the answer for its kind.
pub(super) fn field(
    subject: &Subject<'_>,
    message: &'static MessageInfo,
    field: &FieldInfo,
    out: &mut Vec<Message>,
) {
    if !is_supported(message) {
        return out.push(unavailable(message, 0));
    }
    if !is_used(message, field) {
        if let Some(info) = field.enumeration
            && info.kind == EnumKind::Enumeration
        {
            out.push(enumerated(
                subject,
                message,
                field,
                FieldSupported::NotSupported,
            ));
        }
        return out.push(unavailable(message, number(field)));
    }
    match field.enumeration {
        Some(info) if info.kind == EnumKind::Enumeration => {
            enumeration(subject, message, field, info, out);
        }
        _ => out.push(plain(subject, message, field)),
    }
}

/// 41002, and 44003 for the values that the sources name and this VSM refuses.
fn enumeration(
    subject: &Subject<'_>,
    message: &'static MessageInfo,
    field: &FieldInfo,
    info: &EnumInfo,
    out: &mut Vec<Message>,
) {
    let Message::FieldConfigurationEnumeratedResponse(plain) =
        enumerated(subject, message, field, FieldSupported::Supported)
    else {
        return;
    };
    let own = own_values(message.id, field.name);
    let count = u8::try_from(own.len()).unwrap_or(u8::MAX);
    if own.is_empty() {
        out.push(Message::FieldConfigurationEnumeratedResponse(plain));
    } else {
        out.extend(own.into_iter().map(|(value, text, help)| {
            Message::FieldConfigurationEnumeratedResponse(FieldConfigurationEnumeratedResponse {
                vehicle_specific_enumeration_count: Some(count),
                vehicle_specific_enumeration_index: Some(value),
                vehicle_specific_enumeration_text: Some(Text::new(text)),
                vehicle_specific_help_text: Some(Text::new(help)),
                ..plain.clone()
            })
        }));
    }
    let Some(taken) = support::values(message.id, field.name, subject.hovers) else {
        return;
    };
    for (value, _, _) in info.values {
        let Ok(value) = u8::try_from(*value) else {
            continue;
        };
        if !taken.contains(&value) {
            out.push(Message::MessageParameterAvailability(
                MessageParameterAvailability {
                    field_available: Some(FieldAvailable::Available),
                    reported_enumerated_index: Some(value),
                    enumerated_index_enable: Some(EnumIndexEnable::NotImplemented),
                    ..availability(message, number(field))
                },
            ));
        }
    }
}

/// The VSM's own values that a field may report: value, short text, help.
fn own_values(message: u16, field: &str) -> Vec<(u8, &'static str, &'static str)> {
    match (message, field) {
        (3001, "Select Flight Path Control Mode") => MODES
            .iter()
            .filter(|(_, value, _)| *value > LAST_STANDARD_MODE)
            .map(|(_, value, name)| (*value, name.strip_prefix("AUTO.").unwrap_or(name), *name))
            .collect(),
        (3002, "UA State") => vec![
            (report::UA_STATE_AIRBORNE, "airborne", "in the air"),
            (report::UA_STATE_TAKE_OFF, "take-off", "taking off"),
            (report::UA_STATE_LANDING, "landing", "landing"),
            (
                report::UA_STATE_FAILSAFE,
                "failsafe",
                "a failsafe controls it",
            ),
            (
                report::UA_STATE_TO_WINGS,
                "to wings",
                "transition to its wings",
            ),
            (
                report::UA_STATE_TO_HOVER,
                "to hover",
                "transition to a hover",
            ),
        ],
        (19100, "System Operating Mode") => vec![
            (
                RECORDING.raw(),
                "record",
                "record video until mode 5 (active)",
            ),
            (PHOTOGRAPH.raw(), "photograph", "take one photograph"),
            (
                END_RECORDING.raw(),
                "end record",
                "end the recording; the gimbal stays",
            ),
        ],
        (21101, "System Operating Mode State") => {
            vec![(RECORDING.raw(), "recording", "active, and recording video")]
        }
        (16000, "Subsystem ID") => {
            vec![(AUTOPILOT, "autopilot", "the autopilot's own reports")]
        }
        _ => Vec::new(),
    }
}

fn enumerated(
    subject: &Subject<'_>,
    message: &MessageInfo,
    field: &FieldInfo,
    supported: FieldSupported,
) -> Message {
    let default = match supported {
        FieldSupported::Supported => default_value(subject, message.id, field.name),
        _ => None,
    };
    Message::FieldConfigurationEnumeratedResponse(FieldConfigurationEnumeratedResponse {
        vsm_id: Some(subject.vsm),
        data_link_id: Some(Id::NULL),
        station_number_1_16: Some(0),
        requested_message: Some(message.id.into()),
        requested_field: Some(number(field)),
        field_supported: Some(supported),
        default_value: default,
        vehicle_specific_enumeration_count: Some(0),
        ..FieldConfigurationEnumeratedResponse::default()
    })
}

fn plain(subject: &Subject<'_>, message: &'static MessageInfo, field: &FieldInfo) -> Message {
    let bounds = bounds(subject, message.id, field.name).unwrap_or_default();
    // Bounds are whole steps after a division that is not exact: a rounding error must not count as a step.
    let steps = |value: f64, to: fn(f64) -> f64| {
        let exact = value / field.step();
        let near = exact.round();
        if (exact - near).abs() < 1e-6 {
            near
        } else {
            to(exact)
        }
    };
    // The three numeric kinds have the same fields, each with its own type of number.
    macro_rules! numeric {
        ($Response:ident, $wire:expr) => {{
            let wire = $wire;
            Message::$Response($Response {
                vsm_id: Some(subject.vsm),
                data_link_id: Some(Id::NULL),
                requested_message: Some(message.id.into()),
                requested_field: Some(number(field)),
                field_supported: Some(FieldSupported::Supported),
                default_value: bounds.default.map(|value| wire(value, f64::round)),
                // Rounded inwards: a bound is never widened by its step.
                max_value: bounds.high.map(|value| wire(value, f64::floor)),
                min_value: bounds.low.map(|value| wire(value, f64::ceil)),
                low_caution_limit: bounds.low_caution.map(|value| wire(value, f64::round)),
                low_warning_limit: bounds.low_warning.map(|value| wire(value, f64::round)),
                help_text: Some(Text::new(bounds.help)),
                subsystem_id: Some(SubsystemId::NotAssigned),
                ..$Response::default()
            })
        }};
    }
    match field.wire {
        Wire::Char(_) | Wire::UnsizedText | Wire::UnsizedBytes => {
            Message::FieldConfigurationCharacterResponse(FieldConfigurationCharacterResponse {
                vsm_id: Some(subject.vsm),
                data_link_id: Some(Id::NULL),
                station_number_1_16: Some(0),
                requested_message: Some(message.id.into()),
                requested_field: Some(number(field)),
                field_supported: Some(FieldSupported::Supported),
                help_text: Some(Text::new(bounds.help)),
                subsystem_id: Some(SubsystemId::NotAssigned),
                ..FieldConfigurationCharacterResponse::default()
            })
        }
        Wire::F32 | Wire::F64 => numeric!(
            FieldConfigurationFloatResponse,
            |value: f64, _: fn(f64) -> f64| value as f32
        ),
        Wire::I8 | Wire::I16 | Wire::I24 | Wire::I32 | Wire::Bam16 | Wire::Bam32 => numeric!(
            FieldConfigurationIntegerResponse,
            |value, to| steps(value, to) as i32
        ),
        Wire::U8 | Wire::U16 | Wire::U24 | Wire::U32 | Wire::U40 => numeric!(
            FieldConfigurationUnsignedResponse,
            |value, to| steps(value, to) as u32
        ),
    }
}

/// 44003 for a field, from 1, or for the whole message with 0: not available.
fn unavailable(message: &MessageInfo, field: u8) -> Message {
    Message::MessageParameterAvailability(MessageParameterAvailability {
        field_available: Some(FieldAvailable::NotAvailable),
        ..availability(message, field)
    })
}

fn availability(message: &MessageInfo, field: u8) -> MessageParameterAvailability {
    MessageParameterAvailability {
        station_number_1_16: Some(0),
        reported_message: Some(message.id.into()),
        reported_field: Some(field),
        ..MessageParameterAvailability::default()
    }
}

/// The number of a field, from 1.
fn number(field: &FieldInfo) -> u8 {
    field.bit + 1
}

/// Location Type Support: no source gives its values. This one is the single Location Type that is flown.
const ABSOLUTE_ONLY: u8 = 0;
/// Modes above it are the VSM's own.
const LAST_STANDARD_MODE: u8 = 31;
/// Subsystem ID of the autopilot's own reports.
const AUTOPILOT: u8 = 20;
