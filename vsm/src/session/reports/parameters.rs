//! The vehicle's parameters for ground stations: 50010 reads, 50011 writes, 50012 reports.
//!
//! A value out of its range is refused here, since PX4 stores what it is given. A write is carried out once the vehicle
//! reports the new value. Whoever has requested a parameter is sent its later changes, also those that another station
//! makes; that a station beside us changes any known parameter is a 16000 alert too.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use mapping::parameter;
use mavlink_link::service::param::{Event, Name, Refusal, StartError, Value};
use stanag_msgs::Message;
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::{ParameterRequest, ParameterSetCommand};

use crate::session::context::Origin;
use crate::session::effects::Effects;

/// The machine: for whom each request on its way to the vehicle is, in their order.
#[derive(Debug, Default)]
pub(super) struct ParameterRequests {
    work: VecDeque<Purpose>,
    /// As the vehicle has last reported them.
    known: BTreeMap<Name, Value>,
    /// Which parameters each station has requested.
    followed: BTreeMap<usize, Followed>,
}

#[derive(Debug)]
pub(super) enum Purpose {
    Configuration,
    /// `vsm check-vehicle`.
    Settings,
    Station(Origin),
}

#[derive(Debug)]
enum Followed {
    All,
    These(BTreeSet<Name>),
}

impl ParameterRequests {
    fn follow(&mut self, station: usize, name: Option<Name>) {
        let followed = self.followed.entry(station);
        let followed = followed.or_insert_with(|| Followed::These(BTreeSet::new()));
        match (followed, name) {
            (followed, None) => *followed = Followed::All,
            (Followed::These(names), Some(name)) => {
                names.insert(name);
            }
            (Followed::All, Some(_)) => {}
        }
    }

    pub(super) fn followers(&self, name: Name) -> impl Iterator<Item = usize> + '_ {
        let follows = move |followed: &Followed| match followed {
            Followed::All => true,
            Followed::These(names) => names.contains(&name),
        };
        let stations = self.followed.iter();
        stations.filter_map(move |(station, followed)| follows(followed).then_some(*station))
    }
}

impl ParameterRequests {
    /// Reads parameters for the configuration phase; how many could be requested.
    pub(super) fn read_for_configuration(
        &mut self,
        names: Vec<Name>,
        effects: &mut Effects<'_>,
    ) -> usize {
        let now = effects.dli.now.mono;
        let mut requested = 0;
        for name in names {
            // A name that finds the queue full is left out: the count must match the answers that will come.
            if effects.vehicle.parameters.read(now, name).is_ok() {
                self.work.push_back(Purpose::Configuration);
                requested += 1;
            }
        }
        requested
    }

    /// Reads one for `vsm check-vehicle`; false where too many wait already.
    pub(super) fn read_setting(&mut self, name: Name, effects: &mut Effects<'_>) -> bool {
        let now = effects.dli.now.mono;
        let begun = effects.vehicle.parameters.read(now, name).is_ok();
        if begun {
            self.work.push_back(Purpose::Settings);
        }
        begun
    }

    /// 50010.
    pub(super) fn request(
        &mut self,
        origin: Origin,
        request: &ParameterRequest,
        effects: &mut Effects<'_>,
    ) {
        let name = request
            .parameter_name
            .as_ref()
            .map_or("", |name| name.as_str());
        let name = match name {
            "" => None,
            name => match Name::new(name) {
                Ok(name) => Some(name),
                Err(fault) => return effects.refuse(Some(origin), fault.to_string()),
            },
        };
        let now = effects.dli.now.mono;
        let begun = match name {
            Some(name) => effects.vehicle.parameters.read(now, name),
            None => effects.vehicle.parameters.list(now),
        };
        self.begin(origin, name, begun, effects);
    }

    /// 50011.
    pub(super) fn set(
        &mut self,
        origin: Origin,
        command: &ParameterSetCommand,
        effects: &mut Effects<'_>,
    ) {
        let name = command
            .parameter_name
            .as_ref()
            .map_or("", |name| name.as_str());
        // PX4 v1.18 accepts and stores values out of range (NAV_DLL_ACT 99): only this check stands before it.
        let checked = match command.commanded_value {
            Some(value) => parameter::checked(name, value).map_err(|fault| fault.to_string()),
            None => Err("Commanded Value is missing".to_owned()),
        };
        let name = Name::new(name).map_err(|fault| fault.to_string());
        match name.and_then(|name| checked.map(|value| (name, value))) {
            Ok((name, value)) => {
                let now = effects.dli.now.mono;
                let begun = effects.vehicle.parameters.set(now, name, value);
                self.begin(origin, Some(name), begun, effects);
            }
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    fn begin(
        &mut self,
        origin: Origin,
        name: Option<Name>,
        begun: Result<(), StartError>,
        effects: &mut Effects<'_>,
    ) {
        if let Err(full) = begun {
            return effects.refuse(Some(origin), full.to_string());
        }
        effects.acknowledge(&origin, AckType::Received);
        self.work.push_back(Purpose::Station(origin));
        self.follow(origin.station, name);
    }

    /// For whom the request is that has just ended. Requests end in the order in which they began.
    pub(super) fn ended(&mut self) -> Option<Purpose> {
        self.work.pop_front()
    }

    /// Keeps a value that the vehicle has reported; what it was before, where it was known.
    pub(super) fn learn(&mut self, name: Name, value: Value) -> Option<Value> {
        if self.known.len() >= MAX_KNOWN && !self.known.contains_key(&name) {
            return None;
        }
        self.known.insert(name, value)
    }
}

/// What a station is sent that follows a parameter, or has requested it.
pub(super) fn report(name: Name, value: Value) -> Message {
    parameter::report(name.as_str(), value, None, None).into()
}

/// Why a request was refused, for the operator.
pub(super) fn refusal(event: &Event) -> Option<String> {
    match event {
        Event::Refused { name, reason } => Some(format!("parameter {name}: {}", why(reason))),
        Event::ListFailed { have, total } => Some(format!("{have} of {total} parameters received")),
        _ => None,
    }
}

/// The alert of a change that another station has made.
pub(super) fn foreign_change(name: Name, value: Value, before: Value) -> String {
    format!(
        "parameter {name} is now {}, it was {}: not changed through this VSM",
        number(value),
        number(before)
    )
}

fn number(value: Value) -> f64 {
    match value {
        Value::Int(value) => value.into(),
        Value::Real(value) => value.into(),
    }
}

fn why(reason: &Refusal) -> String {
    match reason {
        Refusal::Error(error) => {
            let name = format!("{error:?}").to_ascii_lowercase();
            let name = name
                .trim_start_matches("mav_param_error_")
                .replace('_', " ");
            format!("the vehicle refuses: {name}")
        }
        Refusal::NoAnswer => "the vehicle does not answer".to_owned(),
        Refusal::OtherValue(value) => format!("the vehicle keeps {}", number(*value)),
    }
}

/// A bound on memory: PX4 has some 950.
const MAX_KNOWN: usize = 4_096;
