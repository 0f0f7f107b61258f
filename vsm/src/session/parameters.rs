//! The vehicle's parameters for ground stations: 50010 reads, 50011 writes, 50012 tells.
//!
//! A value out of its range is refused here, since PX4 stores what it is given. A write is carried out once the vehicle
//! tells the new value. Whoever has asked for a parameter is told of its later changes, also of those that another
//! station makes; that a station beside us changes any known parameter is said by 16000 too.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use mapping::parameter;
use mavlink_link::service::param::{Event, Name, Refusal, StartError, Value};
use stanag_msgs::Message;
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::{ParameterRequest, ParameterSetCommand};

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};

/// The machine: for whom each request on its way to the vehicle is, in their order.
#[derive(Debug, Default)]
pub(crate) struct ParameterDesk {
    work: VecDeque<Purpose>,
    /// What the vehicle has told last.
    known: BTreeMap<Name, Value>,
    /// Which parameters each station has asked for.
    followed: BTreeMap<usize, Followed>,
}

#[derive(Debug)]
enum Purpose {
    Configuration,
    Station(Origin),
}

#[derive(Debug)]
enum Followed {
    All,
    These(BTreeSet<Name>),
}

impl ParameterDesk {
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

    fn followers(&self, name: Name) -> impl Iterator<Item = usize> + '_ {
        let follows = move |followed: &Followed| match followed {
            Followed::All => true,
            Followed::These(names) => names.contains(&name),
        };
        let stations = self.followed.iter();
        stations.filter_map(move |(station, followed)| follows(followed).then_some(*station))
    }
}

impl Aircraft {
    /// Reads a parameter for the configuration phase. False where no more requests are taken now.
    pub(super) fn read_for_configuration(&mut self, desk: &Desk<'_>, name: Name) -> bool {
        let begun = self.mav.parameters.read(desk.now.mono, name).is_ok();
        if begun {
            self.parameters.work.push_back(Purpose::Configuration);
        }
        begun
    }

    /// 50010.
    pub(super) fn request_parameter(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        request: &ParameterRequest,
    ) {
        let name = request
            .parameter_name
            .as_ref()
            .map_or("", |name| name.as_str());
        let name = match name {
            "" => None,
            name => match Name::new(name) {
                Ok(name) => Some(name),
                Err(fault) => return self.refuse(desk, Some(origin), fault.to_string()),
            },
        };
        let now = desk.now.mono;
        let begun = match name {
            Some(name) => self.mav.parameters.read(now, name),
            None => self.mav.parameters.list(now),
        };
        if self.begin_parameter_work(desk, origin, begun) {
            self.parameters.follow(origin.station, name);
        }
    }

    /// 50011.
    pub(super) fn set_parameter(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        command: &ParameterSetCommand,
    ) {
        let name = command
            .parameter_name
            .as_ref()
            .map_or("", |name| name.as_str());
        let checked = match command.commanded_value {
            Some(value) => parameter::checked(name, value).map_err(|fault| fault.to_string()),
            None => Err("Commanded Value is missing".to_owned()),
        };
        let name = Name::new(name).map_err(|fault| fault.to_string());
        match name.and_then(|name| checked.map(|value| (name, value))) {
            Ok((name, value)) => {
                let begun = self.mav.parameters.set(desk.now.mono, name, value);
                if self.begin_parameter_work(desk, origin, begun) {
                    self.parameters.follow(origin.station, Some(name));
                }
            }
            Err(why) => self.refuse(desk, Some(origin), why),
        }
    }

    fn begin_parameter_work(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        begun: Result<(), StartError>,
    ) -> bool {
        if let Err(full) = begun {
            self.refuse(desk, Some(origin), full.to_string());
            return false;
        }
        desk.acknowledge(self.id(), &origin, AckType::Received);
        self.parameters.work.push_back(Purpose::Station(origin));
        self.run_until_idle(desk);
        true
    }

    /// The end of a request, or its progress. Requests end in the order in which they began.
    pub(super) fn take_parameter(&mut self, desk: &mut Desk<'_>, event: Event) {
        if let Event::Progress { .. } = event {
            return;
        }
        let Some(purpose) = self.parameters.work.pop_front() else {
            return;
        };
        match (purpose, event) {
            (Purpose::Configuration, Event::Read { name, value }) => {
                self.learn_parameter(desk, name, value, None);
                self.parameters_came(desk, 1);
            }
            // A vehicle that lacks it is bounded by the rest.
            (Purpose::Configuration, _) => self.parameters_came(desk, 1),
            (
                Purpose::Station(origin),
                Event::Read { name, value } | Event::Set { name, value },
            ) => {
                self.learn_parameter(desk, name, value, Some(origin.station));
                let told = parameter::report(name.as_str(), value, None, None);
                self.answer_later(desk, origin.station, [told.into()], Some(origin));
            }
            (Purpose::Station(origin), Event::List { entries, .. }) => {
                let count = u16::try_from(entries.len()).unwrap_or(u16::MAX);
                let told: Vec<Message> = (0..)
                    .zip(&entries)
                    .map(|(index, entry)| {
                        let place = Some((index, count));
                        parameter::report(entry.name.as_str(), entry.value, place, None).into()
                    })
                    .collect();
                for entry in entries {
                    self.learn_parameter(desk, entry.name, entry.value, Some(origin.station));
                }
                self.answer_later(desk, origin.station, told, Some(origin));
            }
            (Purpose::Station(origin), Event::Refused { name, reason }) => {
                let why = format!("parameter {name}: {}", why(&reason));
                self.refuse(desk, Some(origin), why);
            }
            (Purpose::Station(origin), Event::ListFailed { have, total }) => {
                let why = format!("{have} of {total} parameters came");
                self.refuse(desk, Some(origin), why);
            }
            (Purpose::Station(_), Event::Progress { .. }) => {}
        }
    }

    /// A parameter that the vehicle tells unasked: another station has changed it, or the vehicle itself.
    pub(super) fn parameter_told(&mut self, desk: &mut Desk<'_>, name: Name, value: Value) {
        let before = self.parameters.known.get(&name).copied();
        self.learn_parameter(desk, name, value, None);
        if let Some(before) = before.filter(|before| *before != value) {
            let text = format!(
                "parameter {name} is now {}, it was {}: not changed through this VSM",
                number(value),
                number(before)
            );
            self.advise(desk, text);
        }
    }

    /// Takes in a value. Who follows the parameter is told where it is another than before, but for `asker`.
    fn learn_parameter(
        &mut self,
        desk: &mut Desk<'_>,
        name: Name,
        value: Value,
        asker: Option<usize>,
    ) {
        self.keep_parameter(desk, name, value);
        let known = &mut self.parameters.known;
        if known.len() >= MAX_KNOWN && !known.contains_key(&name) {
            return;
        }
        let changed = known
            .insert(name, value)
            .is_some_and(|before| before != value);
        if !changed {
            return;
        }
        let others: Vec<usize> = self
            .parameters
            .followers(name)
            .filter(|station| Some(*station) != asker)
            .collect();
        for station in others {
            let told = parameter::report(name.as_str(), value, None, None);
            self.answer_later(desk, station, [told.into()], None);
        }
    }
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
