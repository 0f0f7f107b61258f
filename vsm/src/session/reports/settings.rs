//! The vehicle's settings for `vsm check-vehicle`: read on request, one after the other, each with its result.
//!
//! One at a time, so that stations that request parameters meanwhile wait for one answer and not for all.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use mapping::hardening::Reading;
use mavlink_link::service::param::{Event, MavParamError, Name, Refusal, Value};
use serde::{Deserialize, Serialize};

/// A vehicle's answers about its settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct VehicleSettings {
    /// Vehicle ID.
    pub id: String,
    /// Tail Number.
    pub tail_number: String,
    /// Whether data of the vehicle arrives.
    pub live: bool,
    /// Whether the rest is still being read.
    pub reading: bool,
    /// The values that were read.
    pub values: BTreeMap<String, f64>,
    /// The parameters that the vehicle does not have.
    pub absent: BTreeSet<String>,
}

impl VehicleSettings {
    /// Notes the result of reading a parameter; without an answer it stays unknown.
    pub fn note(&mut self, event: &Event) {
        match event {
            Event::Read { name, value } => {
                let value = match *value {
                    Value::Int(value) => value.into(),
                    // Shortest form: 0.1 as an f32 must not be shown as 0.10000000149.
                    Value::Real(value) => value.to_string().parse().unwrap_or(f64::NAN),
                };
                // JSON cannot represent a value that is not finite.
                if value.is_finite() {
                    self.values.insert(name.to_string(), value);
                }
            }
            Event::Refused {
                name,
                reason: Refusal::Error(MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST),
            } => {
                self.absent.insert(name.to_string());
            }
            _ => {}
        }
    }

    /// The result for one parameter.
    #[must_use]
    pub fn reading_of(&self, name: &str) -> Reading {
        match self.values.get(name) {
            Some(value) => Reading::Value(*value),
            None if self.absent.contains(name) => Reading::Absent,
            None => Reading::NotAnswered,
        }
    }
}

/// The machine.
#[derive(Debug, Default)]
pub(super) struct SettingsReading {
    left: VecDeque<Name>,
    /// The outstanding request.
    awaited: Option<Name>,
    found: VehicleSettings,
}

impl SettingsReading {
    /// Begins a new reading, unless one is in progress.
    pub(super) fn begin(&mut self, names: impl Iterator<Item = Name>) {
        if !self.is_reading() {
            self.left = names.collect();
            self.found = VehicleSettings::default();
        }
    }

    /// The next to request, if none is outstanding.
    pub(super) fn next(&mut self) -> Option<Name> {
        if self.awaited.is_some() {
            return None;
        }
        self.awaited = self.left.pop_front();
        self.awaited
    }

    pub(super) fn ended(&mut self, event: &Event) {
        self.awaited = None;
        self.found.note(event);
    }

    /// The vehicle is silent: settings that were not read stay unknown.
    pub(super) fn give_up(&mut self) {
        self.left.clear();
    }

    fn is_reading(&self) -> bool {
        self.awaited.is_some() || !self.left.is_empty()
    }

    pub(super) fn found(&self) -> VehicleSettings {
        VehicleSettings {
            reading: self.is_reading(),
            ..self.found.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> [Name; 3] {
        ["NAV_DLL_ACT", "MAV_SIGN_CFG", "COM_RC_LOSS_T"].map(|name| Name::new(name).unwrap())
    }

    #[test]
    fn one_is_requested_at_a_time_and_each_end_is_kept() {
        let [action, absent, loss] = names();
        let mut reading = SettingsReading::default();
        reading.begin(names().into_iter());
        assert_eq!((reading.next(), reading.next()), (Some(action), None));
        let value = Value::Int(2);
        reading.ended(&Event::Read {
            name: action,
            value,
        });
        assert_eq!(reading.next(), Some(absent));
        // A second request joins the first.
        reading.begin(names().into_iter());
        let reason = Refusal::Error(MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST);
        reading.ended(&Event::Refused {
            name: absent,
            reason,
        });
        assert_eq!(reading.next(), Some(loss));
        assert!(reading.found().reading);
        let reason = Refusal::NoAnswer;
        reading.ended(&Event::Refused { name: loss, reason });
        assert_eq!(reading.next(), None);
        let found = reading.found();
        assert!(!found.reading);
        assert_eq!(found.reading_of("NAV_DLL_ACT"), Reading::Value(2.0));
        assert_eq!(found.reading_of("MAV_SIGN_CFG"), Reading::Absent);
        assert_eq!(found.reading_of("COM_RC_LOSS_T"), Reading::NotAnswered);
    }

    #[test]
    fn a_silent_vehicle_ends_it_after_the_one_on_its_way() {
        let [action, ..] = names();
        let mut reading = SettingsReading::default();
        reading.begin(names().into_iter());
        reading.next();
        reading.give_up();
        assert!(reading.found().reading);
        let reason = Refusal::NoAnswer;
        reading.ended(&Event::Refused {
            name: action,
            reason,
        });
        assert_eq!(reading.next(), None);
        assert!(!reading.found().reading);
    }

    #[test]
    fn a_number_that_is_none_stays_unknown_and_short_ones_stay_short() {
        let name = Name::new("COM_RC_LOSS_T").unwrap();
        let mut found = VehicleSettings::default();
        let read = |value| Event::Read {
            name,
            value: Value::Real(value),
        };
        found.note(&read(f32::NAN));
        assert_eq!(found.reading_of("COM_RC_LOSS_T"), Reading::NotAnswered);
        found.note(&read(0.1));
        assert_eq!(found.reading_of("COM_RC_LOSS_T"), Reading::Value(0.1));
    }
}
