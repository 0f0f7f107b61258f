//! Missions: #800 to #806 and #900. Waypoints go over field by field; contingencies do not.
//!
//! In Edition 2.5 each waypoint names where to go from it on contingency A and B; Edition 4 has a route of each kind. A
//! waypoint that names one makes that route, which begins there. One vehicle flies one route of a kind, so all waypoints of
//! a flight route must name the same, or none: a load of others is refused. On a download each waypoint names the
//! contingency routes.

use std::collections::{BTreeMap, BTreeSet};

use stanag_msgs::Message;
use stanag_msgs::ed25::{self, Record};
use stanag_msgs::enums::{LoiterDurationUnits, RouteType};
use stanag_msgs::messages::{
    MissionTransferCommand, UaLoiterWaypoint, UaPositionWaypoint, UaRoute,
};

use super::form::{Refusal, clear_unused_of_loiter, generic, new, to};

/// What a station has sent of a plan, and was sent.
#[derive(Debug, Default)]
pub(crate) struct Plans {
    /// Each waypoint: the next one, and where it goes on contingency A and B.
    waypoints: BTreeMap<u16, [u16; 3]>,
    /// Where flight routes begin, by their names.
    routes: BTreeMap<String, u16>,
    /// The routes of this upload: the same once more begins another.
    uploaded: BTreeSet<String>,
    /// Where its contingency routes begin.
    named: [u16; 2],
    /// Where the contingency routes of a download begin.
    sent: [u16; 2],
}

impl Plans {
    /// #800 to #806: what they are, in order.
    pub(super) fn received(&mut self, record: &Record) -> Result<Vec<Message>, Refusal> {
        match record.id() {
            800 => self.command(record),
            801 => {
                let (first, kind) = (record.whole(4) as u16, record.whole(6));
                let name = record.text(5).to_owned();
                if self.uploaded.contains(&name) || self.uploaded.len() >= MAX_ROUTES {
                    self.end_upload();
                }
                self.uploaded.insert(name.clone());
                // Its waypoints may name the route that is sent here: it is one, not two.
                if let Some(named) = kind
                    .checked_sub(CONTINGENCY_A)
                    .and_then(|kind| self.named.get_mut(kind as usize))
                {
                    *named = first;
                }
                if first == 0 {
                    self.routes.remove(&name);
                } else if kind < CONTINGENCY_A && self.routes.len() < MAX_ROUTES {
                    self.routes.insert(name, first);
                }
                // A route that is deleted begins nowhere, which must be said.
                let mut route = record.clone();
                route.set(4, first);
                Ok(vec![to(&route, UaRoute::ID)?])
            }
            802 => self.waypoint(record),
            803 => loiter(record),
            _ => Ok(vec![generic(record)?]),
        }
    }

    fn waypoint(&mut self, record: &Record) -> Result<Vec<Message>, Refusal> {
        let mut waypoint = record.clone();
        // A speed of 0 fills its place, and an arrival time counts with speed type 3 alone.
        let by_time = record.whole(11) == ARRIVAL_TIME;
        if record.number(10).is_none_or(|speed| speed == 0.0) || by_time {
            waypoint.clear(10);
        }
        if !by_time {
            waypoint.clear(15);
        }
        // 0 ends the series: it is a value here.
        waypoint.set(12, record.whole(12));
        let message = to(&waypoint, UaPositionWaypoint::ID)?;
        let number = record.whole(4) as u16;
        let links = [12, 13, 14].map(|field| record.whole(field) as u16);
        let mut messages = Vec::new();
        for (kind, first) in (0..2).zip(&links[1..]) {
            match self.named[kind] {
                named if *first == 0 || named == *first => {}
                0 => messages.push(contingency(record, kind, *first)?),
                // A second 13001 of the route would begin another upload.
                named => {
                    return Err(Refusal::new(
                        "not supported",
                        format!(
                            "Contingency Waypoint {} {first}, of other waypoints it is {named}: one contingency route is \
                             flown, name the same in all of them",
                            NAMES[kind]
                        ),
                    ));
                }
            }
        }
        for (named, first) in self.named.iter_mut().zip(&links[1..]) {
            if *first != 0 {
                *named = *first;
            }
        }
        self.waypoints.insert(number, links);
        messages.push(message);
        Ok(messages)
    }

    /// What follows is another upload.
    fn end_upload(&mut self) {
        self.uploaded.clear();
        self.named = [0; 2];
    }

    /// #800.
    fn command(&mut self, record: &Record) -> Result<Vec<Message>, Refusal> {
        let mut command = record.clone();
        match record.whole(5) {
            CLEAR => {
                *self = Plans::default();
                command.clear(6);
            }
            LOAD => {
                self.check()?;
                self.end_upload();
                command.clear(6);
            }
            DOWNLOAD => {
                self.sent = [0; 2];
                command.clear(6);
            }
            CANCEL => self.end_upload(),
            _ => {}
        }
        Ok(vec![to(&command, MissionTransferCommand::ID)?])
    }

    /// Whether all waypoints of a flight route name one contingency of each kind, or none.
    fn check(&self) -> Result<(), Refusal> {
        for (name, first) in &self.routes {
            let mut at = *first;
            let mut seen = BTreeMap::new();
            while let Some(links) = self.waypoints.get(&at).filter(|_| !seen.contains_key(&at)) {
                seen.insert(at, [links[1], links[2]]);
                at = links[0];
            }
            for (index, kind) in NAMES.iter().enumerate() {
                let mut all = seen.iter().map(|(number, links)| (*number, links[index]));
                let Some((begin, named)) = all.next() else {
                    continue;
                };
                if let Some((number, other)) = all.find(|(_, other)| *other != named) {
                    return Err(Refusal::new(
                        "not supported",
                        format!(
                            "route {name}: Contingency Waypoint {kind} of waypoint {begin} is {named}, of {number} it \
                             is {other}: one contingency route is flown, name the same in all of them"
                        ),
                    ));
                }
            }
        }
        Ok(())
    }

    /// A part of a plan on its way to the station; `Ok(None)` where there is nothing to send.
    ///
    /// # Errors
    /// What of it Edition 2.5 cannot say.
    pub(super) fn sent(&mut self, message: &Message) -> Result<Option<Record>, String> {
        let mut record = ed25::plan_record(message)?;
        match (message, &mut record) {
            (Message::UaRoute(route), _) => {
                let first = route.initial_waypoint_number.unwrap_or(0);
                match route.route_type {
                    Some(RouteType::ContingencyA) => self.sent[0] = first,
                    Some(RouteType::ContingencyB) => self.sent[1] = first,
                    _ => {}
                }
            }
            (Message::UaPositionWaypoint(waypoint), Some(record)) => {
                let own = waypoint.waypoint_number.unwrap_or(0);
                for (field, first) in [13, 14].into_iter().zip(self.sent) {
                    record.set(field, if own == first { 0 } else { first });
                }
            }
            _ => {}
        }
        Ok(record)
    }
}

/// #803.
fn loiter(record: &Record) -> Result<Vec<Message>, Refusal> {
    let mut kept = record.clone();
    clear_unused_of_loiter(&mut kept, 6, 7);
    let mut message = to(&kept, UaLoiterWaypoint::ID)?;
    if let Message::UaLoiterWaypoint(loiter) = &mut message {
        // A time of 0 is kept: it is no loiter, where an absent one would have no end.
        loiter.loiter_duration = Some(record.whole(5) as u16);
        loiter.loiter_duration_units = Some(LoiterDurationUnits::Seconds);
    }
    Ok(vec![message])
}

/// 13001 for the contingency route that a waypoint names.
fn contingency(waypoint: &Record, kind: usize, first: u16) -> Result<Message, Refusal> {
    let mut route = new(801);
    route.set(1, waypoint.number(1).unwrap_or_default());
    route.set(4, first);
    route.set_text(5, ["CONTINGENCY A", "CONTINGENCY B"][kind.min(1)]);
    route.set(6, CONTINGENCY_A + kind as u32);
    to(&route, UaRoute::ID)
}

const CLEAR: u32 = 1;
const LOAD: u32 = 2;
const DOWNLOAD: u32 = 3;
const CANCEL: u32 = 5;
/// Of the contingencies.
const NAMES: [&str; 2] = ["A", "B"];
const CONTINGENCY_A: u32 = 3;
const ARRIVAL_TIME: u32 = 3;
/// Routes whose contingencies are compared; a plan has fewer.
const MAX_ROUTES: usize = 256;
