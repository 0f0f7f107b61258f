//! The vehicle's controls: parameters from which a CUCS can build a screen, described by the messages of the
//! configuration phase.
//!
//! 42003 and 43002, which Edition 4 has for such screens, have texts of a length that no source gives, and no older
//! edition has them. So the controls are described as fields of 50011, by which they are set: from field
//! [`Controls::FIRST`] on each field is a control, with its range in 41000 or 41001, and its value in 44000 or 44001.
//! Edition 2.5 has #1300 and #1301 for the ranges, and no message for a value: there 50012 reports it.
//!
//! A control keeps its number as long as the bridge runs. A write names the parameter, so that a screen built during
//! an earlier run cannot change another one.

use mavlink_link::service::param::{Name, Value};
use stanag_msgs::enums::{FieldAvailable, FieldSupported, SubsystemId};
use stanag_msgs::messages::{
    FieldChangeFloatCommand, FieldChangeIntegerCommand, FieldConfigurationFloatResponse,
    FieldConfigurationIntegerResponse, MessageParameterAvailability, ParameterSetCommand,
};
use stanag_msgs::{Id, Message, Text};

use crate::parameter::{self, Described};
use crate::parameter_metadata::ParameterMetadata;

/// The controls of one vehicle, in the order of their numbers.
#[derive(Debug, Clone, Default)]
pub struct Controls {
    all: Vec<Control>,
    /// The parameters as the vehicle's metadata describe them.
    metadata: ParameterMetadata,
}

#[derive(Debug, Clone)]
struct Control {
    name: Name,
    /// The value that the vehicle reported last.
    value: Value,
    offered: bool,
}

/// Whether a control is new, or has another value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// It was not offered before.
    New(u8),
    /// Its value has changed.
    Value(u8),
}

/// How a CUCS is sent the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValuesBy {
    /// Edition 3 or 4: 44000 and 44001 by the number of the field.
    Field,
    /// Edition 2.5, which has no such message: 50012 by the name.
    Name,
}

impl Controls {
    /// The first field of 50011 that is a control.
    pub const FIRST: u8 = 11;
    /// Controls of a vehicle at most: Requested Field has one byte.
    pub const MAX: usize = (u8::MAX - Self::FIRST) as usize + 1;

    /// Stores a value that the vehicle reports for a chosen parameter. `None`: nothing has changed, or there are too
    /// many controls.
    pub fn learn(&mut self, name: Name, value: Value) -> Option<Change> {
        if let Some(at) = self.all.iter().position(|one| one.name == name) {
            let known = self.all.get_mut(at)?;
            let before = (std::mem::replace(&mut known.value, value), known.offered);
            known.offered = true;
            return match before {
                (_, false) => Some(Change::New(number(at)?)),
                (before, true) => (before != value).then_some(Change::Value(number(at)?)),
            };
        }
        let new = number(self.all.len())?;
        self.all.push(Control {
            name,
            value,
            offered: true,
        });
        Some(Change::New(new))
    }

    /// Replaces the vehicle's metadata. Parameters that are no longer `chosen` under it are no longer offered.
    /// Returns the numbers of the removed controls, and of those that are left.
    pub fn define(
        &mut self,
        metadata: ParameterMetadata,
        chosen: impl Fn(&str, Option<&Described>) -> bool,
    ) -> (Vec<u8>, Vec<u8>) {
        self.metadata = metadata;
        let (mut gone, mut left) = (Vec::new(), Vec::new());
        for (at, one) in self.all.iter_mut().enumerate() {
            let offered = chosen(one.name.as_str(), self.metadata.get(one.name.as_str()));
            if let Some(number) = number(at).filter(|_| one.offered) {
                if offered { &mut left } else { &mut gone }.push(number);
            }
            one.offered &= offered;
        }
        (gone, left)
    }

    /// The vehicle's metadata.
    #[must_use]
    pub fn metadata(&self) -> &ParameterMetadata {
        &self.metadata
    }

    /// The numbers of all offered controls.
    pub fn offered(&self) -> impl Iterator<Item = u8> {
        let offered = self.all.iter().enumerate().filter(|(_, one)| one.offered);
        offered.filter_map(|(at, _)| number(at))
    }

    /// All messages for a control: its limits, and its value.
    pub fn describe(
        &self,
        number: u8,
        vsm: Id,
        by: ValuesBy,
    ) -> impl Iterator<Item = Message> + use<> {
        let limits = self.limits(number, vsm);
        limits.into_iter().chain(self.value(number, by))
    }

    /// 44000, 44001 or 50012; `None` where there is no such control, or its value is not a number.
    #[must_use]
    pub fn value(&self, number: u8, by: ValuesBy) -> Option<Message> {
        let control = self.get(number)?;
        let (message, field) = (Some(ParameterSetCommand::ID), Some(number));
        Some(match (by, control.value) {
            (_, Value::Real(value)) if !value.is_finite() => return None,
            (ValuesBy::Name, value) => {
                let name = control.name.as_str();
                parameter::report(name, value, self.metadata.get(name), None).into()
            }
            (ValuesBy::Field, Value::Int(value)) => FieldChangeIntegerCommand {
                requested_message: message,
                requested_field: field,
                commanded_value: Some(value),
                ..FieldChangeIntegerCommand::default()
            }
            .into(),
            (ValuesBy::Field, Value::Real(value)) => FieldChangeFloatCommand {
                requested_message: message,
                requested_field: field,
                commanded_value: Some(value),
                ..FieldChangeFloatCommand::default()
            }
            .into(),
        })
    }

    /// 44003 for a control that is no longer offered, or never was.
    #[must_use]
    pub fn gone(number: u8) -> Message {
        Message::MessageParameterAvailability(MessageParameterAvailability {
            station_number_1_16: Some(0),
            reported_message: Some(ParameterSetCommand::ID.into()),
            reported_field: Some(number),
            field_available: Some(FieldAvailable::NotAvailable),
            ..MessageParameterAvailability::default()
        })
    }

    /// 41000 for an integer, 41001 for a float. Without metadata there is no range: writes are still checked by the
    /// table of PX4 v1.18, but that may be the table of another version than the vehicle's.
    fn limits(&self, number: u8, vsm: Id) -> Option<Message> {
        let control = self.get(number)?;
        let described = self.metadata.get(control.name.as_str());
        let range = described.map(|of| &of.range);
        let low = range.and_then(|range| range.low.or(range.values.first().map(|v| (*v).into())));
        let high = range.and_then(|range| range.high.or(range.values.last().map(|v| (*v).into())));
        let default = described.and_then(|of| of.default);
        let help = help(&control.name, described);
        macro_rules! limits {
            ($Response:ident, $low:expr, $high:expr, $default:expr, $step:expr) => {
                Message::$Response($Response {
                    vsm_id: Some(vsm),
                    data_link_id: Some(Id::NULL),
                    requested_message: Some(ParameterSetCommand::ID.into()),
                    requested_field: Some(number),
                    field_supported: Some(FieldSupported::Supported),
                    default_value: $default,
                    max_value: $high,
                    min_value: $low,
                    minimum_display_resolution: $step,
                    help_text: Some(Text::new(&help)),
                    subsystem_id: Some(SubsystemId::NotAssigned),
                    ..$Response::default()
                })
            };
        }
        Some(match control.value {
            Value::Int(_) => limits!(
                FieldConfigurationIntegerResponse,
                low.map(|low| low.ceil() as i32),
                high.map(|high| high.floor() as i32),
                default.map(|value| value.round() as i32),
                None
            ),
            Value::Real(_) => limits!(
                FieldConfigurationFloatResponse,
                low.map(|low| low as f32),
                high.map(|high| high as f32),
                default.map(|value| value as f32),
                described
                    .and_then(|of| of.decimals)
                    .map(|places| 10_f32.powi(-i32::from(places)))
            ),
        })
    }

    fn get(&self, number: u8) -> Option<&Control> {
        let at = number.checked_sub(Self::FIRST)?;
        self.all.get(usize::from(at)).filter(|one| one.offered)
    }
}

fn number(at: usize) -> Option<u8> {
    u8::try_from(at + usize::from(Controls::FIRST)).ok()
}

/// The name up to a colon, so that a program can find it; then the unit, whether a new value waits for a restart, and a description.
fn help(name: &Name, described: Option<&Described>) -> String {
    let Some(described) = described else {
        return format!("{name}: range not known (no metadata of the vehicle)");
    };
    let unit = match described.unit.as_str() {
        "" => String::new(),
        unit => format!(" [{unit}]"),
    };
    let after = match parameter::applies_after_restart(name.as_str(), Some(described)) {
        true => " (after a restart)",
        false => "",
    };
    format!("{name}:{unit}{after} {}", described.short)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(name: &str) -> Name {
        Name::new(name).expect("a name")
    }

    fn metadata() -> ParameterMetadata {
        let file = r#"{"parameters":[{"name":"A","type":"Float","group":"G","units":"m/s","min":0.5,"max":20,
            "decimalPlaces":1,"default":5,"shortDesc":"How fast"}]}"#;
        ParameterMetadata::read(file.as_bytes()).expect("the form of PX4")
    }

    #[test]
    fn without_metadata_a_control_has_no_range_and_says_so() {
        let mut controls = Controls::default();
        let new = controls.learn(name("A"), Value::Real(2.0));
        assert_eq!(new, Some(Change::New(11)));
        let all: Vec<_> = controls.describe(11, Id(1), ValuesBy::Field).collect();
        let [
            Message::FieldConfigurationFloatResponse(limits),
            Message::FieldChangeFloatCommand(value),
        ] = &all[..]
        else {
            panic!("{all:?}")
        };
        assert_eq!((limits.min_value, limits.max_value), (None, None));
        let text = limits.help_text.expect("a text").to_string();
        assert!(text.starts_with("A: range not known"), "{text}");
        assert_eq!(
            (
                value.requested_message,
                value.requested_field,
                value.commanded_value
            ),
            (Some(50011), Some(11), Some(2.0))
        );
    }

    #[test]
    fn with_metadata_it_has_range_unit_and_words() {
        let mut controls = Controls::default();
        controls.learn(name("A"), Value::Real(2.0));
        controls.learn(name("B"), Value::Int(7));
        let (gone, left) = controls.define(metadata(), |_, known| known.is_some());
        assert_eq!((gone, left), (vec![12], vec![11]));
        let limits = controls.describe(11, Id(1), ValuesBy::Field).next();
        let Some(Message::FieldConfigurationFloatResponse(limits)) = limits else {
            panic!("{limits:?}")
        };
        assert_eq!(
            (limits.min_value, limits.max_value, limits.default_value),
            (Some(0.5), Some(20.0), Some(5.0))
        );
        assert_eq!(limits.minimum_display_resolution, Some(0.1));
        let text = limits.help_text.expect("a text").to_string();
        assert_eq!(text, "A: [m/s] How fast");
        let mut described = metadata().get("A").expect("a parameter").clone();
        described.restart = true;
        let text = help(&name("A"), Some(&described));
        assert_eq!(text, "A: [m/s] (after a restart) How fast");
        assert_eq!(controls.describe(12, Id(1), ValuesBy::Field).count(), 0);
        // A parameter that is chosen again gets the number that it had.
        let again = controls.learn(name("B"), Value::Int(8));
        assert_eq!(again, Some(Change::New(12)));
    }

    #[test]
    fn a_value_is_of_the_kind_that_the_vehicle_reports_and_is_new_once() {
        let mut controls = Controls::default();
        controls.learn(name("B"), Value::Int(16_777_217));
        let value = controls.value(11, ValuesBy::Field);
        assert!(matches!(
            value,
            Some(Message::FieldChangeIntegerCommand(
                FieldChangeIntegerCommand {
                    commanded_value: Some(16_777_217),
                    ..
                }
            ))
        ));
        assert_eq!(controls.learn(name("B"), Value::Int(16_777_217)), None);
        let other = controls.learn(name("B"), Value::Int(3));
        assert_eq!(other, Some(Change::Value(11)));
        let named = controls.value(11, ValuesBy::Name);
        assert!(matches!(
            named,
            Some(Message::ParameterReport(report)) if report.value == Some(3.0)
        ));
        controls.learn(name("C"), Value::Real(f32::NAN));
        assert_eq!(controls.value(12, ValuesBy::Field), None);
    }

    #[test]
    fn numbers_end_with_the_byte_that_holds_them() {
        let mut controls = Controls::default();
        for at in 0..Controls::MAX {
            let new = controls.learn(name(&format!("P{at}")), Value::Int(0));
            assert!(matches!(new, Some(Change::New(_))), "{at}");
        }
        assert_eq!(controls.learn(name("MORE"), Value::Int(0)), None);
        assert_eq!(controls.offered().last(), Some(u8::MAX));
    }
}
