//! The vehicle's parameters for ground stations: 50010 reads, 50011 writes, 50012 reports.
//!
//! A value out of range is refused here, since PX4 stores any value. A write is complete once the vehicle reports the new
//! value. A station that has requested a parameter receives its later changes, also those made by another station. If
//! another station changes any known parameter, a 16000 alert is raised too.
//!
//! Only one request to the vehicle is outstanding. The bridge's own requests come first, since a load waits for them. The
//! stations take turns ([`Turns`]), with [`MAX_PLACES`] queued requests each and a rate limit. Requests beyond that are
//! refused with the reason.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use mapping::parameter;
use mapping::parameter_metadata::ParameterMetadata;
use mavlink_link::service::param::{Event, Name, Refusal, Value};
use stanag_msgs::Message;
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::{ParameterRequest, ParameterSetCommand};

use super::controls::ControlWatch;
use crate::session::allowance::Allowance;
use crate::session::context::{Context, Origin};
use crate::session::effects::Effects;
use crate::session::limits::{PARAMETER_LISTS, PARAMETERS};
use crate::session::maneuver::MAY_BE_DONE;
use crate::session::turns::Turns;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct ParameterRequests {
    /// The bridge's own requests.
    own: VecDeque<(Purpose, Name)>,
    stations: Turns<(Purpose, Wanted)>,
    /// The requester of the outstanding request.
    active: Option<(Purpose, Wanted)>,
    /// The parameters as last reported by the vehicle.
    known: BTreeMap<Name, Known>,
    /// Stations that have requested all parameters and so follow each.
    follow_all: BTreeSet<usize>,
    /// The rate limits of the stations.
    rates: BTreeMap<usize, Allowances>,
}

/// The requester of a request.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    Configuration,
    /// The vehicle's controls: in turn with the stations, since there may be many.
    Controls,
    /// `vsm check-vehicle`.
    Settings,
    Station(Origin),
    /// Its requester no longer waits for it.
    Nobody,
}

#[derive(Debug, Clone, Copy)]
enum Wanted {
    Read(Name),
    Set(Name, Value),
    List,
}

#[derive(Debug)]
struct Known {
    value: Value,
    /// The stations that have requested it. Names that the vehicle does not have are not followed, since stations could
    /// invent any number of them.
    followers: BTreeSet<usize>,
}

#[derive(Debug, Default)]
struct Allowances {
    single: Allowance,
    lists: Allowance,
}

/// Requests to the vehicle.
impl ParameterRequests {
    /// Reads parameters for the configuration phase, each once.
    pub(super) fn read_for_configuration(
        &mut self,
        context: &Context<'_>,
        names: Vec<Name>,
        effects: &mut Effects<'_>,
    ) {
        // The rest of an earlier reading would end this one too early.
        self.drop_configuration();
        let names = names.into_iter();
        self.own
            .extend(names.map(|name| (Purpose::Configuration, name)));
        self.advance(context, effects);
    }

    /// Ends the reading for the configuration phase, even if it is incomplete.
    pub(super) fn drop_configuration(&mut self) {
        self.own
            .retain(|(purpose, _)| !matches!(purpose, Purpose::Configuration));
        // The vehicle will still answer this one: the answer must not be counted for the next reading.
        if let Some((purpose @ Purpose::Configuration, _)) = &mut self.active {
            *purpose = Purpose::Nobody;
        }
    }

    /// Reads the vehicle's controls, each once.
    pub(super) fn read_controls(
        &mut self,
        context: &Context<'_>,
        names: Vec<Name>,
        effects: &mut Effects<'_>,
    ) {
        for name in names {
            let one = (Purpose::Controls, Wanted::Read(name));
            self.stations.push(CONTROLS, one);
        }
        self.advance(context, effects);
    }

    /// Cancels the reading of the remaining controls.
    pub(super) fn drop_controls(&mut self) {
        self.stations.take(CONTROLS);
        if let Some((purpose @ Purpose::Controls, _)) = &mut self.active {
            *purpose = Purpose::Nobody;
        }
    }

    /// Reads one for `vsm check-vehicle`.
    pub(super) fn read_setting(
        &mut self,
        context: &Context<'_>,
        name: Name,
        effects: &mut Effects<'_>,
    ) {
        self.own.push_back((Purpose::Settings, name));
        self.advance(context, effects);
    }

    /// 50010.
    pub(super) fn request(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        request: &ParameterRequest,
        effects: &mut Effects<'_>,
    ) {
        let name = request
            .parameter_name
            .as_ref()
            .map_or("", |name| name.as_str());
        let wanted = match name {
            "" => Wanted::List,
            name => match Name::new(name) {
                Ok(name) => Wanted::Read(name),
                Err(fault) => return effects.refuse(Some(origin), fault.to_string()),
            },
        };
        self.begin(context, origin, wanted, effects);
    }

    /// 50011.
    pub(super) fn set(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &ParameterSetCommand,
        controls: &ControlWatch,
        effects: &mut Effects<'_>,
    ) {
        let name = command
            .parameter_name
            .as_ref()
            .map_or("", |name| name.as_str());
        // PX4 v1.18 accepts and stores values out of range (NAV_DLL_ACT 99): this is the only check.
        let checked = match command.commanded_value {
            Some(value) => {
                let described = controls.controls().metadata().get(name);
                let checked = parameter::checked(name, value, described);
                let chosen = controls.check_write(context.config.controls.as_ref(), name);
                chosen.and_then(|()| checked.map_err(|fault| fault.to_string()))
            }
            None => Err("Commanded Value is missing".to_owned()),
        };
        let name = Name::new(name).map_err(|fault| fault.to_string());
        match name.and_then(|name| checked.map(|value| (name, value))) {
            Ok((name, value)) => self.begin(context, origin, Wanted::Set(name, value), effects),
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    fn begin(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        wanted: Wanted,
        effects: &mut Effects<'_>,
    ) {
        let station = origin.station;
        if self.stations.waiting(station) >= MAX_PLACES {
            let why = format!(
                "{MAX_PLACES} parameter requests of this station wait already: wait for their answers"
            );
            return effects.refuse(Some(origin), why);
        }
        let rates = self.rates.entry(station).or_default();
        let (rate, allowance, what) = match wanted {
            Wanted::List => (PARAMETER_LISTS, &mut rates.lists, "all parameters"),
            Wanted::Read(_) | Wanted::Set(..) => (PARAMETERS, &mut rates.single, "parameters"),
        };
        if !allowance.take(context.mono(), rate) {
            let why = format!(
                "this station requests {what} too often: more than {} times within {} s",
                rate.at_once,
                rate.burst().as_secs()
            );
            return effects.refuse(Some(origin), why);
        }
        effects.acknowledge(&origin, AckType::Received);
        self.stations
            .push(station, (Purpose::Station(origin), wanted));
        self.advance(context, effects);
    }

    /// Sends the next request to the vehicle if none is outstanding.
    pub(super) fn advance(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        while self.active.is_none() {
            let own = self.own.pop_front();
            let next = own.map(|(purpose, name)| (purpose, Wanted::Read(name)));
            let next = next.or_else(|| {
                let (_, next) = self.stations.pop()?;
                Some(next)
            });
            let Some((purpose, wanted)) = next else {
                return;
            };
            // Checked again when it is sent: control may have passed to another CUCS while the write waited.
            if let (Purpose::Station(origin), Wanted::Set(..)) = (purpose, wanted)
                && context.asker(origin.station).map(|asker| asker.id) != context.controller
            {
                let why = "control of the vehicle was lost before it was asked";
                effects.refuse(Some(origin), why);
                continue;
            }
            let (client, now) = (&mut effects.vehicle.parameters, effects.dli.now.mono);
            let begun = match wanted {
                Wanted::Read(name) => client.read(now, name),
                Wanted::Set(name, value) => client.set(now, name, value),
                Wanted::List => client.list(now),
            };
            match (begun, purpose) {
                (Ok(()), _) => self.active = Some((purpose, wanted)),
                (Err(full), Purpose::Station(origin)) => {
                    effects.refuse(Some(origin), full.to_string());
                }
                // It has one request at a time, so this only waits for its unread events.
                (Err(_), _) => {
                    if let (Wanted::Read(_), Purpose::Controls) = (wanted, purpose) {
                        self.stations.push(CONTROLS, (purpose, wanted));
                    } else if let Wanted::Read(name) = wanted {
                        self.own.push_front((purpose, name));
                    }
                    return;
                }
            }
        }
    }

    /// The requester of the request that has just ended, and whether it was to set a value. The caller then starts the next one
    /// ([`Self::advance`]).
    pub(super) fn ended(&mut self) -> Option<(Purpose, bool)> {
        let (purpose, wanted) = self.active.take()?;
        if let (Purpose::Station(origin), Wanted::List) = (purpose, wanted) {
            self.follow_all.insert(origin.station);
        }
        Some((purpose, matches!(wanted, Wanted::Set(..))))
    }
}

/// Reported parameters, and the stations that follow them.
impl ParameterRequests {
    /// Stores a reported value, and adds the station as a follower. Returns the previous value, if known.
    pub(super) fn learn(
        &mut self,
        name: Name,
        value: Value,
        follower: Option<usize>,
    ) -> Option<Value> {
        if let Some(known) = self.known.get_mut(&name) {
            known.followers.extend(follower);
            return Some(std::mem::replace(&mut known.value, value));
        }
        if self.known.len() < MAX_KNOWN {
            let followers = follower.into_iter().collect();
            self.known.insert(name, Known { value, followers });
        }
        None
    }

    pub(super) fn followers(&self, name: Name) -> BTreeSet<usize> {
        let known = self.known.get(&name);
        let of_it = known.map(|known| &known.followers);
        self.follow_all
            .union(of_it.unwrap_or(&BTreeSet::new()))
            .copied()
            .collect()
    }

    /// Number of known names.
    #[cfg(test)]
    pub(super) fn remembered(&self) -> usize {
        self.known.len()
    }

    /// The station no longer listens.
    pub(super) fn forget(&mut self, station: usize) {
        self.follow_all.remove(&station);
        for known in self.known.values_mut() {
            known.followers.remove(&station);
        }
    }
}

/// The report for a station that follows or has requested a parameter.
pub(super) fn report(name: Name, value: Value, metadata: &ParameterMetadata) -> Message {
    let name = name.as_str();
    parameter::report(name, value, metadata.get(name), None).into()
}

/// Why a request was refused, for the operator; `sets`: it was to set a value.
pub(super) fn refusal(event: &Event, sets: bool) -> Option<String> {
    match event {
        Event::Refused {
            name,
            reason: reason @ Refusal::NoAnswer,
        } if sets => Some(format!("parameter {name}: {}: {MAY_BE_DONE}", why(reason))),
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

/// The controls' place among the turns of the stations.
const CONTROLS: usize = usize::MAX;
/// A bound on memory: PX4 has some 950.
const MAX_KNOWN: usize = 4_096;
/// Maximum number of waiting requests of one station.
pub(super) const MAX_PLACES: usize = 16;
