//! Missions: #800 to #806 and #900. Waypoints are converted field by field; contingencies are not.
//!
//! In Edition 2.5 each waypoint names where to go from it on contingency A and B; Edition 4 has a route of each kind. A
//! waypoint that names a contingency creates that route, which begins at the named waypoint. A vehicle flies one route of a
//! kind, so all waypoints of a flight route must name the same one, or none: otherwise the load is refused. A mission that
//! names no contingency has none: its load deletes the route that an earlier mission has created. In a download each
//! waypoint names what it was sent with; where that is not known, those of a flight name the contingency routes.
//!
//! The bridge knows what has been sent ([`Upload`]), so a repeated datagram or a restart changes nothing here. Only what
//! the plan has no place for is kept: which contingencies a waypoint names. The bridge writes that to disk, one line per
//! waypoint ([`Contingencies::line`]). A waypoint whose line is lost has unknown contingencies; if any contingency is
//! named, that waypoint must be sent again before a load.

use std::collections::{BTreeMap, BTreeSet};

use mapping::plan::{Plan, route_type};
use stanag_msgs::ed25::{self, Record};
use stanag_msgs::enums::{LoiterDurationUnits, RouteType};
use stanag_msgs::messages::{
    MissionTransferCommand, UaLoiterWaypoint, UaPositionWaypoint, UaRoute,
};
use stanag_msgs::{Message, TimeStamp};

use super::form::{Refusal, clear_unused_of_loiter, generic, new, to};

/// The part of a plan that Edition 4 has no place for.
#[derive(Debug, Default)]
pub(crate) struct Plans {
    /// The waypoints that the plan has stored.
    waypoints: BTreeMap<u16, Contingencies>,
    /// Number of lines in their file.
    lines: usize,
    /// The first waypoints of the contingency routes of a download.
    sent: [u16; 2],
    /// What the waypoints of a download name, where that is known.
    links: BTreeMap<u16, [u16; 2]>,
}

/// Where a waypoint leads on contingency A and B; 0 if it names none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Contingencies {
    pub(crate) number: u16,
    /// The stamp of its #802: a waypoint with another stamp is another one.
    pub(crate) stamp: TimeStamp,
    links: [u16; 2],
}

impl Contingencies {
    /// The contingencies of a #802.
    pub(super) fn of(record: &Record) -> Option<Contingencies> {
        let stamp = record.stamp().filter(|_| record.id() == 802)?;
        Some(Contingencies {
            number: record.whole(4) as u16,
            stamp,
            links: [13, 14].map(|field| record.whole(field) as u16),
        })
    }

    /// The line of the file: number, stamp, A and B.
    fn line(&self) -> String {
        let [a, b] = self.links;
        format!("{} {} {a} {b}\n", self.number, self.stamp.0)
    }

    fn of_line(line: &str) -> Option<Contingencies> {
        let mut parts = line.split(' ');
        let mut next = || parts.next();
        Some(Contingencies {
            number: next()?.parse().ok()?,
            stamp: TimeStamp(next()?.parse().ok()?),
            links: [next()?.parse().ok()?, next()?.parse().ok()?],
        })
    }
}

/// A change of the file of contingencies.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// Append a line.
    Line(String),
    /// Replace all lines.
    All(String),
}

/// Why an upload is not loaded: its contingencies cannot be those of one mission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Unfit {
    pub(crate) why: String,
    /// The waypoint that is to be sent again. Otherwise the upload itself is wrong: it is dropped.
    pub(crate) missing: Option<u16>,
}

/// The bridge's plan for the station that sends to it. It is the truth about an upload: it survives a restart, and contains
/// neither refused messages nor duplicates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Upload<'a> {
    /// The plan that a load would take.
    pub(crate) plan: &'a Plan,
    /// The part of it that the station has sent since its last load.
    pub(crate) sent: Option<&'a Plan>,
}

impl Upload<'_> {
    /// Whether a flight route has been sent, so that this is a complete mission.
    fn is_of_a_flight(&self) -> bool {
        let routes = self.sent.map(|sent| sent.routes()).unwrap_or_default();
        routes.iter().any(is_flight)
    }

    fn has_sent(&self, number: u16) -> bool {
        self.sent
            .is_some_and(|sent| sent.waypoint(number).is_some())
    }
}

fn is_flight(route: &UaRoute) -> bool {
    u32::from(route_type(route).raw()) < CONTINGENCY_A
}

/// The contingency route of a kind that would be flown; a station may have sent it under a name of its own.
fn route_of(plan: &Plan, kind: usize) -> Option<&UaRoute> {
    plan.route_of_type(KINDS[kind.min(1)])
}

fn begins(plan: &Plan, kind: usize) -> Option<u16> {
    route_of(plan, kind)?.initial_waypoint_number
}

/// Whether a plan has the contingency route that the translator creates.
fn has_made(plan: &Plan, kind: usize) -> bool {
    plan.route_named(ROUTES[kind.min(1)]).is_some()
}

/// Whether a #800 requests a download.
pub(super) fn downloads(record: &Record) -> bool {
    record.id() == 800 && record.whole(5) == DOWNLOAD
}

impl Plans {
    /// #800 to #806: their messages of Edition 4, in order.
    pub(super) fn received(
        &self,
        record: &Record,
        upload: &Upload<'_>,
    ) -> Result<Vec<Message>, Refusal> {
        match record.id() {
            800 => self.command(record, upload),
            801 => {
                // 0 means that the route is deleted: the value must be present.
                let mut route = record.clone();
                route.set(4, record.whole(4));
                Ok(vec![to(&route, UaRoute::ID)?])
            }
            802 => waypoint(record, upload),
            803 => loiter(record),
            _ => Ok(vec![generic(record)?]),
        }
    }

    /// The plan holds this waypoint. Returns what has to be written about it, if it is not written yet. `holds`: whether a
    /// plan has a waypoint of this number; others are dropped when the file is rewritten.
    pub(super) fn stored(
        &mut self,
        waypoint: Contingencies,
        holds: impl Fn(u16) -> bool,
    ) -> Option<Kept> {
        if self.waypoints.insert(waypoint.number, waypoint) == Some(waypoint) {
            return None;
        }
        if self.lines < FOLD_LINES + 2 * self.waypoints.len() {
            self.lines += 1;
            return Some(Kept::Line(waypoint.line()));
        }
        self.waypoints
            .retain(|number, _| *number == waypoint.number || holds(*number));
        self.lines = self.waypoints.len();
        let lines = self.waypoints.values().map(Contingencies::line);
        Some(Kept::All(lines.collect()))
    }

    /// Restores what an earlier process has written. An incomplete last line is ignored.
    pub(super) fn restore(&mut self, text: &str) {
        let whole = text.rsplit_once('\n').map_or("", |(whole, _)| whole);
        for waypoint in whole.lines().filter_map(Contingencies::of_line) {
            self.waypoints.insert(waypoint.number, waypoint);
        }
        // After an incomplete line another one could not be appended, so the next change rewrites the file.
        self.lines = if whole.len() + 1 < text.len() {
            usize::MAX
        } else {
            whole.lines().count()
        };
    }

    pub(super) fn begin_download(&mut self, plan: &Plan) {
        self.sent = [0; 2];
        let part = |of: &UaRoute| plan.part(of).numbers().collect::<Vec<_>>();
        let routes = plan.routes().iter();
        let (flights, ways_out): (Vec<_>, Vec<_>) = routes.partition(|route| is_flight(route));
        let flown: BTreeSet<u16> = flights.into_iter().flat_map(part).collect();
        // Nothing leads on from a waypoint of a contingency route.
        let ways_out = ways_out.into_iter().flat_map(part);
        let ways_out = ways_out.filter(|number| !flown.contains(number));
        self.links = ways_out.map(|number| (number, [0; 2])).collect();
        let known = self.waypoints.keys();
        let known = known.filter_map(|number| Some((*number, self.of(plan, *number)?)));
        let known: Vec<_> = known.collect();
        self.links.extend(known);
    }

    /// Why the load of a #800 is refused. It is passed on all the same: who may load, and what follows from a refusal, is
    /// decided as for any other upload.
    pub(super) fn unfit(&self, record: &Record, upload: &Upload<'_>) -> Option<Unfit> {
        let loads = record.id() == 800 && record.whole(5) == LOAD;
        loads.then(|| self.check(upload).err()).flatten()
    }

    /// #800.
    fn command(&self, record: &Record, upload: &Upload<'_>) -> Result<Vec<Message>, Refusal> {
        let mut command = record.clone();
        let mut messages = Vec::new();
        match record.whole(5) {
            CLEAR | DOWNLOAD => command.clear(6),
            LOAD => {
                // An upload that is refused changes nothing.
                if self.unfit(record, upload).is_none() {
                    messages = self.stale(record, upload)?;
                }
                command.clear(6);
            }
            _ => {}
        }
        messages.push(to(&command, MissionTransferCommand::ID)?);
        Ok(messages)
    }

    /// The contingencies of a waypoint of the plan, if they are known.
    fn of(&self, plan: &Plan, number: u16) -> Option<[u16; 2]> {
        let known = self.waypoints.get(&number)?;
        let waypoint = plan.waypoint(number)?;
        (waypoint.time_stamp == Some(known.stamp)).then_some(known.links)
    }

    /// The messages that delete contingency routes of an earlier mission that the loaded one does not name. In Edition 4 a
    /// route stays until it is deleted: after a loss of the CUCS, the vehicle would fly a route that nobody has sent for
    /// this mission.
    fn stale(&self, load: &Record, upload: &Upload<'_>) -> Result<Vec<Message>, Refusal> {
        let (Some(sent), true) = (upload.sent, upload.is_of_a_flight()) else {
            return Ok(Vec::new());
        };
        let is_named = |kind: usize| {
            let mut links = sent.numbers().filter_map(|number| self.of(sent, number));
            match route_of(sent, kind) {
                Some(_) => has_made(sent, kind),
                None => links.any(|links| links[kind] != 0),
            }
        };
        let stale = (0..2).filter(|kind| has_made(upload.plan, *kind) && !is_named(*kind));
        stale.map(|kind| contingency(load, kind, 0)).collect()
    }

    /// Checks that all waypoints of a flight route name the same contingency of each kind, or none.
    fn check(&self, upload: &Upload<'_>) -> Result<(), Unfit> {
        let plan = upload.plan;
        let sends = |kind| {
            upload
                .sent
                .is_some_and(|sent| route_of(sent, kind).is_some())
        };
        let has_contingencies = (0..2).any(|kind| has_made(plan, kind) || sends(kind));
        for route in plan.routes().iter().filter(|route| is_flight(route)) {
            let part = plan.part(route);
            let unknown = |number: &u16| {
                has_contingencies && upload.has_sent(*number) && self.of(plan, *number).is_none()
            };
            if let Some(number) = part.numbers().find(unknown) {
                return Err(Unfit {
                    why: format!(
                        "the contingency waypoint of waypoint {number} is no longer known: the VSM has restarted and did not find \
                         it on its disk; send it again (#802), then #800"
                    ),
                    missing: Some(number),
                });
            }
            let known = part.numbers();
            let known = known.filter_map(|number| Some((number, self.of(plan, number)?)));
            let known: Vec<_> = known.collect();
            for (index, kind) in NAMES.iter().enumerate() {
                let mut all = known.iter().map(|(number, links)| (*number, links[index]));
                let Some((begin, named)) = all.next() else {
                    continue;
                };
                if let Some((number, other)) = all.find(|(_, other)| *other != named) {
                    let name = route.route_id.as_ref().map_or("", |id| id.as_str());
                    return Err(Unfit {
                        why: format!(
                            "route {name}: Contingency Waypoint {kind} of waypoint {begin} is {named}, of {number} it \
                             is {other}: one contingency route is flown, name the same in all of them"
                        ),
                        missing: None,
                    });
                }
            }
        }
        Ok(())
    }

    /// A part of a plan for the station; `Ok(None)` if there is nothing to send.
    ///
    /// # Errors
    /// What of it Edition 2.5 cannot express.
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
                let unknown = || self.sent.map(|first| if own == first { 0 } else { first });
                let links = self.links.get(&own).copied().unwrap_or_else(unknown);
                for (field, first) in [13, 14].into_iter().zip(links) {
                    record.set(field, first);
                }
            }
            _ => {}
        }
        Ok(record)
    }
}

/// #802.
fn waypoint(record: &Record, upload: &Upload<'_>) -> Result<Vec<Message>, Refusal> {
    let mut waypoint = record.clone();
    // A speed of 0 means none, and an arrival time counts only with speed type 3.
    let by_time = record.whole(11) == ARRIVAL_TIME;
    if record.number(10).is_none_or(|speed| speed == 0.0) || by_time {
        waypoint.clear(10);
    }
    if !by_time {
        waypoint.clear(15);
    }
    // 0 is a value here: it ends the series.
    waypoint.set(12, record.whole(12));
    let message = to(&waypoint, UaPositionWaypoint::ID)?;
    let mut messages = Vec::new();
    for (kind, field) in [13, 14].into_iter().enumerate() {
        let first = record.whole(field) as u16;
        if first == 0 {
            continue;
        }
        match upload.sent.and_then(|sent| begins(sent, kind)) {
            Some(named) if named == first => {}
            // A second 13001 of the route would begin another upload.
            Some(named) => {
                return Err(Refusal::new(
                    "not supported",
                    format!(
                        "Contingency Waypoint {} {first}, of other waypoints it is {named}: one contingency route is \
                         flown, name the same in all of them",
                        NAMES[kind]
                    ),
                ));
            }
            // A waypoint of the stored mission is changed, and leads where it did.
            None if !upload.is_of_a_flight() && begins(upload.plan, kind) == Some(first) => {}
            None => messages.push(contingency(record, kind, first)?),
        }
    }
    messages.push(message);
    Ok(messages)
}

/// #803.
fn loiter(record: &Record) -> Result<Vec<Message>, Refusal> {
    let mut kept = record.clone();
    clear_unused_of_loiter(&mut kept, 6, 7);
    let mut message = to(&kept, UaLoiterWaypoint::ID)?;
    if let Message::UaLoiterWaypoint(loiter) = &mut message {
        // A time of 0 is kept: it means no loiter, while an absent time would mean one without end.
        loiter.loiter_duration = Some(record.whole(5) as u16);
        loiter.loiter_duration_units = Some(LoiterDurationUnits::Seconds);
    }
    Ok(vec![message])
}

/// 13001 for a contingency route that waypoints name; one that begins at 0 is deleted.
fn contingency(of: &Record, kind: usize, first: u16) -> Result<Message, Refusal> {
    let mut route = new(801);
    route.set(1, of.number(1).unwrap_or_default());
    route.set(4, first);
    route.set_text(5, ROUTES[kind.min(1)]);
    route.set(6, CONTINGENCY_A + kind as u32);
    to(&route, UaRoute::ID)
}

/// A file with at most this many lines is not rewritten.
const FOLD_LINES: usize = 1_000;
const CLEAR: u32 = 1;
const LOAD: u32 = 2;
const DOWNLOAD: u32 = 3;
/// Names of the contingencies, and of the routes that the translator creates for them.
const NAMES: [&str; 2] = ["A", "B"];
const KINDS: [RouteType; 2] = [RouteType::ContingencyA, RouteType::ContingencyB];
const ROUTES: [&str; 2] = ["CONTINGENCY A", "CONTINGENCY B"];
const CONTINGENCY_A: u32 = 3;
const ARRIVAL_TIME: u32 = 3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_plan_has_is_dropped_when_all_is_written_again() {
        let mut plans = Plans::default();
        let waypoint = |number, stamp| Contingencies {
            number,
            stamp: TimeStamp(stamp),
            links: [1, 2],
        };
        for number in 1..=300 {
            plans.stored(waypoint(number, 5), |_| true);
        }
        let holds = |number| number <= 10;
        let written =
            (0..5_000).find_map(|stamp| match plans.stored(waypoint(3, stamp), holds)? {
                Kept::Line(_) => None,
                Kept::All(all) => Some(all),
            });
        let written = written.expect("it is written again");
        assert_eq!(written.lines().count(), 10, "{written}");
    }
}
