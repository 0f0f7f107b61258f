//! The routes and waypoints that a CUCS has sent for one vehicle, as it sent them.
//!
//! A plan only stores. A fault within one message is refused at once ([`StoreError`]). A fault that depends on other
//! messages is reported when the route is loaded ([`crate::route`]), so that waypoints may arrive in any order.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::RangeInclusive;

use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::{
    CurveSegment, CurveSegmentPaper, PayloadActionWaypoint, UaLoiterWaypoint, UaPositionWaypoint,
    UaRoute, VehicleSpecificWaypoint,
};
use stanag_msgs::{Id, Message, TimeStamp};

use crate::action::{self, Action};
use crate::payload::waypoint::PayloadAction;

/// Routes (13001), waypoints (13002), their loiters (13003), actions (13004, 13006) and curves (50001, 50002).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    routes: Vec<UaRoute>,
    waypoints: BTreeMap<u16, UaPositionWaypoint>,
    loiters: BTreeMap<u16, UaLoiterWaypoint>,
    curves: BTreeMap<(u16, u16), Curve>,
    actions: BTreeMap<u16, Actions>,
}

/// The actions at a waypoint, as received.
#[derive(Debug, Clone, Default, PartialEq)]
struct Actions {
    payload: Option<PayloadActionWaypoint>,
    specific: Option<VehicleSpecificWaypoint>,
}

impl Actions {
    fn messages(&self) -> impl Iterator<Item = Message> + use<> {
        let payload = self.payload.clone().map(Message::PayloadActionWaypoint);
        let specific = self.specific.clone();
        payload
            .into_iter()
            .chain(specific.map(Message::VehicleSpecificWaypoint))
    }
}

/// A curved leg, as received.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// 50001, the paper's message.
    Paper(CurveSegmentPaper),
    /// 50002, in the scalars of Edition 4.
    Native(CurveSegment),
}

impl Curve {
    fn message(&self) -> Message {
        match self {
            Curve::Paper(curve) => Message::CurveSegmentPaper(curve.clone()),
            Curve::Native(curve) => Message::CurveSegment(curve.clone()),
        }
    }
}

/// A message that the plan accepts, under its number.
enum Part<'m> {
    Route(&'m UaRoute),
    Waypoint(u16, &'m UaPositionWaypoint),
    Loiter(u16, &'m UaLoiterWaypoint),
    Curve((u16, u16), Curve),
    Payload(u16, &'m PayloadActionWaypoint),
    Specific(u16, &'m VehicleSpecificWaypoint),
}

/// A message that the plan does not accept.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StoreError {
    /// The number that identifies it is absent.
    #[error("{message} without {field}")]
    Missing {
        /// Message type.
        message: u16,
        /// The field as the tables name it.
        field: &'static str,
    },
    /// A waypoint number outside 1 to 65534.
    #[error("{field} {number}, expected 1 to 65534")]
    Number {
        /// The field as the tables name it.
        field: &'static str,
        /// The number.
        number: u16,
    },
    /// A coordinate of 50001 that is no angle on the earth.
    #[error("50001 {field} {value} rad, expected -{max:.4} to {max:.4}")]
    Angle {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// The greatest possible value.
        max: f64,
    },
    /// A Time Stamp of 50001 that is no number.
    #[error("50001 Time Stamp {0} ms, expected a number")]
    Stamp(f64),
    /// 50001 that names another vehicle or CUCS than its wrapper.
    #[error("50001 {field} {found}, expected the wrapper's {expected}")]
    NotTheWrappers {
        /// The field.
        field: &'static str,
        /// What it holds.
        found: Id,
        /// What the wrapper holds.
        expected: Id,
    },
    /// A 13004 or 13006 with an action that no PX4 mission can do.
    #[error("{0}")]
    Action(String),
    /// The plan is full: a bound on memory, beyond what any vehicle carries.
    #[error("more than {0} {1} in one plan")]
    Full(usize, &'static str),
    /// Not a message of a plan.
    #[error("message {0} is not part of a plan")]
    NotAPlanMessage(u16),
}

/// Most waypoints, curves and loiters that a plan stores (each): PX4's own bound in simulation.
pub const MAX_WAYPOINTS: usize = 10_000;
/// Where the numbers of waypoints begin.
const FIRST: u16 = 1;
/// Most routes that a plan stores.
pub const MAX_ROUTES: usize = 64;

impl Plan {
    /// Stores one message; a later one for the same route or waypoint replaces the earlier.
    ///
    /// `cucs` and `vehicle` are the wrapper's source and destination.
    ///
    /// # Errors
    /// The message cannot be stored; the plan is as before.
    pub fn store(&mut self, message: &Message, cucs: Id, vehicle: Id) -> Result<(), StoreError> {
        match self.checked(message, cucs, vehicle)? {
            Part::Route(route) => {
                // The latest definition stands last: a load without a Route ID means that one.
                self.routes.retain(|known| !is_same(known, route));
                if !removes(route) {
                    self.routes.push(route.clone());
                }
            }
            Part::Waypoint(number, waypoint) => {
                let before = self.waypoints.insert(number, waypoint.clone());
                // A changed Next Waypoint ends the leg that a curve described.
                if let Some(before) = before.as_ref().map(next)
                    && before != next(waypoint)
                {
                    self.curves.remove(&(number, before));
                }
            }
            Part::Loiter(number, loiter) => {
                self.loiters.insert(number, loiter.clone());
            }
            Part::Curve(ends, curve) => {
                self.curves.insert(ends, curve);
            }
            Part::Payload(number, payload) => {
                self.actions.entry(number).or_default().payload = Some(payload.clone());
            }
            Part::Specific(number, specific) => {
                self.actions.entry(number).or_default().specific = Some(specific.clone());
            }
        }
        Ok(())
    }

    /// Whether [`Plan::store`] would store a message: a caller can log the message before it stores it.
    ///
    /// # Errors
    /// As [`Plan::store`].
    pub fn check(&self, message: &Message, cucs: Id, vehicle: Id) -> Result<(), StoreError> {
        self.checked(message, cucs, vehicle).map(drop)
    }

    fn checked<'m>(
        &self,
        message: &'m Message,
        cucs: Id,
        vehicle: Id,
    ) -> Result<Part<'m>, StoreError> {
        match message {
            Message::UaRoute(route) => {
                if route.initial_waypoint_number.is_none() {
                    return Err(StoreError::Missing {
                        message: 13001,
                        field: "Initial Waypoint Number",
                    });
                }
                let others = self.routes.iter().filter(|known| !is_same(known, route));
                if !removes(route) && others.count() == MAX_ROUTES {
                    return Err(StoreError::Full(MAX_ROUTES, "routes"));
                }
                Ok(Part::Route(route))
            }
            Message::UaPositionWaypoint(waypoint) => {
                let number = numbered(13002, "Waypoint Number", waypoint.waypoint_number)?;
                has_room(&self.waypoints, &number, "waypoints")?;
                Ok(Part::Waypoint(number, waypoint))
            }
            Message::UaLoiterWaypoint(loiter) => {
                let number = numbered(13003, "Waypoint Number", loiter.waypoint_number)?;
                has_room(&self.loiters, &number, "loiter waypoints")?;
                Ok(Part::Loiter(number, loiter))
            }
            Message::CurveSegment(curve) => {
                let ends = ends(50002, curve.p1_waypoint_no, curve.p4_waypoint_no)?;
                has_room(&self.curves, &ends, "curves")?;
                Ok(Part::Curve(ends, Curve::Native(curve.clone())))
            }
            Message::CurveSegmentPaper(curve) => {
                let ends = ends(50001, curve.p1_waypoint_no, curve.p4_waypoint_no)?;
                the_wrappers("Vehicle ID", curve.vehicle_id, vehicle)?;
                the_wrappers("CUCS ID", curve.cucs_id, cucs)?;
                if let Some(value) = curve.time_stamp.filter(|stamp| !stamp.is_finite()) {
                    return Err(StoreError::Stamp(value));
                }
                angle("P2 Latitude", curve.p2_latitude, FRAC_PI_2)?;
                angle("P2 Longitude", curve.p2_longitude, PI)?;
                angle("P3 Latitude", curve.p3_latitude, FRAC_PI_2)?;
                angle("P3 Longitude", curve.p3_longitude, PI)?;
                has_room(&self.curves, &ends, "curves")?;
                Ok(Part::Curve(ends, Curve::Paper(curve.clone())))
            }
            Message::VehicleSpecificWaypoint(specific) => {
                let number = numbered(13006, "Waypoint Number", specific.waypoint_number)?;
                action::tagged(specific).map_err(StoreError::Action)?;
                has_room(&self.actions, &number, "waypoints with actions")?;
                Ok(Part::Specific(number, specific))
            }
            Message::PayloadActionWaypoint(payload) => {
                let number = numbered(13004, "Waypoint Number", payload.waypoint_number)?;
                PayloadAction::of(payload).map_err(StoreError::Action)?;
                has_room(&self.actions, &number, "waypoints with actions")?;
                Ok(Part::Payload(number, payload))
            }
            other => Err(StoreError::NotAPlanMessage(other.id())),
        }
    }

    /// Deletes everything (13000 mode 1).
    pub fn clear(&mut self) {
        *self = Plan::default();
    }

    /// Deletes one route, with the waypoints, loiters and curves that no other route leads to (13000 mode 1 with a Route
    /// ID).
    pub fn clear_route(&mut self, name: &str) {
        let Some(route) = self.route_named(name).cloned() else {
            return;
        };
        let gone = self.part(&route);
        self.routes.retain(|known| !is_same(known, &route));
        let others: Vec<Plan> = self.routes.iter().map(|other| self.part(other)).collect();
        let still_led_to = |number: &u16| {
            others
                .iter()
                .any(|other| other.waypoints.contains_key(number))
        };
        for number in gone.waypoints.keys().filter(|number| !still_led_to(number)) {
            self.waypoints.remove(number);
            self.drop_unsent(*number, &Plan::default());
        }
    }

    /// Deletes the loiter, the actions and the curves at a waypoint that `sent` does not have there.
    pub fn drop_unsent(&mut self, number: u16, sent: &Plan) {
        if !sent.loiters.contains_key(&number) {
            self.loiters.remove(&number);
        }
        if let Some(known) = self.actions.get_mut(&number) {
            let sent = sent.actions.get(&number).cloned().unwrap_or_default();
            known.payload.take_if(|_| sent.payload.is_none());
            known.specific.take_if(|_| sent.specific.is_none());
            if *known == Actions::default() {
                self.actions.remove(&number);
            }
        }
        // A range, and not all curves: a CUCS may send ten thousand of both.
        let here = self.curves.range(curves_at(number)).map(|(ends, _)| *ends);
        let unsent: Vec<_> = here
            .filter(|ends| !sent.curves.contains_key(ends))
            .collect();
        for ends in unsent {
            self.curves.remove(&ends);
        }
    }

    /// The numbers of the waypoints.
    pub fn numbers(&self) -> impl Iterator<Item = u16> + '_ {
        self.waypoints.keys().copied()
    }

    /// Whether nothing is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Plan::default()
    }

    /// The latest route of a type; absent is flight (0801.06).
    #[must_use]
    pub fn route_of_type(&self, wanted: RouteType) -> Option<&UaRoute> {
        self.routes
            .iter()
            .rev()
            .find(|route| route_type(route) == wanted)
    }

    /// The route with this Route ID.
    #[must_use]
    pub fn route_named(&self, name: &str) -> Option<&UaRoute> {
        let mut routes = self.routes.iter();
        routes.find(|route| route_name(route) == Some(name))
    }

    /// Whether it holds the route that a 13001 defines: of the same name, or, where neither has one, of the same type.
    #[must_use]
    pub fn defines(&self, route: &UaRoute) -> bool {
        self.routes.iter().any(|known| is_same(known, route))
    }

    /// All routes, the latest last.
    #[must_use]
    pub fn routes(&self) -> &[UaRoute] {
        &self.routes
    }

    /// The implied flight route of waypoints without any 13001 (Edition 2.5, #801: a route without one is of type flight).
    /// It begins at waypoint 1, to which no other leads.
    ///
    /// `None` if there is a 13001, or if the waypoints are not one chain from waypoint 1: an ambiguous start is not
    /// guessed. If a chain begins at 3, then 3 may be the first waypoint, or the first that arrived of an upload whose
    /// 13001 and first waypoints were lost (nothing else counts them). Before 1 none can be missing: numbers are 1 to
    /// 65534.
    #[must_use]
    pub fn route_of_waypoints(&self) -> Option<UaRoute> {
        if !self.routes.is_empty() {
            return None;
        }
        let led_to: BTreeSet<u16> = self.waypoints.values().map(next).collect();
        let mut starts = self.numbers().filter(|number| !led_to.contains(number));
        let (Some(start @ FIRST), None) = (starts.next(), starts.next()) else {
            return None;
        };
        let route = UaRoute {
            initial_waypoint_number: Some(start),
            route_type: Some(RouteType::Flight),
            ..UaRoute::default()
        };
        let is_whole = self.part(&route).waypoints.len() == self.waypoints.len();
        is_whole.then_some(route)
    }

    /// The waypoint of this number.
    #[must_use]
    pub fn waypoint(&self, number: u16) -> Option<&UaPositionWaypoint> {
        self.waypoints.get(&number)
    }

    /// The loiter at the waypoint of this number.
    #[must_use]
    pub fn loiter(&self, number: u16) -> Option<&UaLoiterWaypoint> {
        self.loiters.get(&number)
    }

    /// What is done at the waypoint of this number (13006), in its order.
    #[must_use]
    pub fn actions(&self, number: u16) -> Vec<Action> {
        // `store` refuses invalid ones.
        let specific = self.actions.get(&number);
        specific
            .and_then(|known| action::tagged(known.specific.as_ref()?).ok())
            .unwrap_or_default()
    }

    /// What a payload station does from the leg to the waypoint of this number on (13004).
    #[must_use]
    pub fn payload_action(&self, number: u16) -> Option<PayloadAction> {
        // `store` refuses invalid ones.
        PayloadAction::of(self.actions.get(&number)?.payload.as_ref()?).ok()
    }

    /// The curved legs that start at this waypoint: (P4's number, curve).
    pub fn curves_from(&self, p1: u16) -> impl Iterator<Item = (u16, &Curve)> {
        self.curves
            .range(curves_at(p1))
            .map(|((_, p4), curve)| (*p4, curve))
    }

    /// A curved leg, P1 and P4, with an end that no 13002 has described.
    #[must_use]
    pub fn curve_without_end(&self) -> Option<(u16, u16)> {
        let known = |end: u16| self.waypoints.contains_key(&end);
        let mut curves = self.curves.keys().copied();
        curves.find(|(p1, p4)| !known(*p1) || !known(*p4))
    }

    /// A single route: its definition, its waypoints, and their loiters, actions and curves.
    #[must_use]
    pub fn part(&self, route: &UaRoute) -> Plan {
        let mut part = Plan {
            routes: vec![route.clone()],
            ..Plan::default()
        };
        let mut number = route.initial_waypoint_number.unwrap_or(0);
        while let Some(waypoint) = self.waypoints.get(&number)
            && part.waypoints.insert(number, waypoint.clone()).is_none()
        {
            if let Some(loiter) = self.loiters.get(&number) {
                part.loiters.insert(number, loiter.clone());
            }
            if let Some(actions) = self.actions.get(&number) {
                part.actions.insert(number, actions.clone());
            }
            for (to, curve) in self.curves_from(number) {
                part.curves.insert((number, to), curve.clone());
            }
            number = next(waypoint);
        }
        part
    }

    /// The launch, approach and contingency routes whose definition is unchanged since `before`, but not their content,
    /// each with the numbers of the waypoints that differ.
    ///
    /// Waypoints have one numbering for all routes (13002.Waypoint Number), so a message for one route changes the others
    /// that use its numbers. For flight routes that is usual; the others are flown later, without being loaded again.
    #[must_use]
    pub fn routes_changed_since(&self, before: &Plan) -> Vec<(&UaRoute, Vec<u16>)> {
        let kept = |route: &&UaRoute| {
            route_type(route) != RouteType::Flight && before.routes.contains(route)
        };
        let changes = self.routes.iter().filter(kept).map(|route| {
            let (was, is) = (before.part(route), self.part(route));
            if was == is {
                return (route, Vec::new());
            }
            let numbers: BTreeSet<u16> = was.numbers().chain(is.numbers()).collect();
            let differ = |number: &u16| !was.is_alike_at(&is, *number);
            (route, numbers.into_iter().filter(differ).collect())
        });
        changes
            .filter(|(_, numbers): &(_, Vec<u16>)| !numbers.is_empty())
            .collect()
    }

    /// Whether another plan has the same content at a waypoint, regardless of when it was sent.
    fn is_alike_at(&self, other: &Plan, number: u16) -> bool {
        let content = |plan: &Plan| -> Vec<Message> {
            let messages = plan.messages_about(number);
            messages
                .map(|message| message.stamped(TimeStamp(0)))
                .collect()
        };
        content(self) == content(other)
    }

    /// What is known in addition to an uploaded route: that route as it was then, and the other routes as sent since.
    /// Waypoints to which no route leads any longer are left out.
    #[must_use]
    pub fn beside(&self, aboard: &Plan) -> Plan {
        let is_aboard = |route: &UaRoute| {
            let mut known = aboard.routes.iter();
            known.any(|known| is_same(known, route))
        };
        let mut whole = Plan::default();
        for route in self.routes.iter().filter(|route| !is_aboard(route)) {
            whole.lay(self.part(route));
        }
        whole.lay(aboard.clone());
        whole
    }

    /// Replaces what another plan also describes.
    fn lay(&mut self, upper: Plan) {
        let Plan {
            routes,
            waypoints,
            loiters,
            curves,
            actions,
        } = upper;
        let covers = |number: &u16| waypoints.contains_key(number);
        self.loiters.retain(|number, _| !covers(number));
        self.actions.retain(|number, _| !covers(number));
        self.curves.retain(|(p1, _), _| !covers(p1));
        self.routes.extend(routes);
        self.waypoints.extend(waypoints);
        self.loiters.extend(loiters);
        self.curves.extend(curves);
        self.actions.extend(actions);
    }

    /// The messages about one waypoint: the waypoint, its loiter and actions, and the curves that start at it.
    pub fn messages_about(&self, number: u16) -> impl Iterator<Item = Message> + '_ {
        let waypoint = self.waypoint(number).cloned();
        let loiter = self.loiter(number).cloned();
        let actions = self.actions.get(&number).into_iter();
        let curves = self.curves_from(number).map(|(_, curve)| curve.message());
        waypoint
            .map(Message::UaPositionWaypoint)
            .into_iter()
            .chain(loiter.map(Message::UaLoiterWaypoint))
            .chain(actions.flat_map(Actions::messages))
            .chain(curves)
    }

    /// Everything as messages, in upload order: routes, waypoints with their loiters, actions, curves.
    pub fn messages(&self) -> impl Iterator<Item = Message> + '_ {
        let routes = self.routes.iter().cloned().map(Message::UaRoute);
        let waypoints = self.waypoints.iter().flat_map(|(number, waypoint)| {
            let loiter = self
                .loiters
                .get(number)
                .cloned()
                .map(Message::UaLoiterWaypoint);
            std::iter::once(Message::UaPositionWaypoint(waypoint.clone())).chain(loiter)
        });
        let without_waypoint = self
            .loiters
            .iter()
            .filter(|(number, _)| !self.waypoints.contains_key(number));
        let without_waypoint =
            without_waypoint.map(|(_, loiter)| Message::UaLoiterWaypoint(loiter.clone()));
        let actions = self.actions.values().flat_map(Actions::messages);
        let curves = self.curves.values().map(Curve::message);
        routes
            .chain(waypoints)
            .chain(without_waypoint)
            .chain(actions)
            .chain(curves)
    }
}

/// The keys of the curves that start at a waypoint.
fn curves_at(p1: u16) -> RangeInclusive<(u16, u16)> {
    (p1, 0)..=(p1, u16::MAX)
}

/// The name of a route; an empty Route ID is none.
#[must_use]
pub fn route_name(route: &UaRoute) -> Option<&str> {
    let name = route.route_id.as_ref().map(|id| id.as_str());
    name.filter(|name| !name.is_empty())
}

/// Whether a 13001 redefines a known route: one with the same name, or, if neither has a name, with the same type.
fn is_same(known: &UaRoute, new: &UaRoute) -> bool {
    match (route_name(known), route_name(new)) {
        (None, None) => route_type(known) == route_type(new),
        (known, new) => known == new,
    }
}

/// Whether a 13001 removes its route: it leads to no waypoint.
fn removes(route: &UaRoute) -> bool {
    route.initial_waypoint_number == Some(0)
}

/// The type of a route; absent is flight.
#[must_use]
pub fn route_type(route: &UaRoute) -> RouteType {
    route.route_type.unwrap_or(RouteType::Flight)
}

/// What a route is for, in words.
#[must_use]
pub fn purpose(route: &UaRoute) -> &'static str {
    match route_type(route) {
        RouteType::Launch => "launch",
        RouteType::Approach => "approach",
        RouteType::Flight => "flight",
        RouteType::ContingencyA => "contingency A",
        RouteType::ContingencyB => "contingency B",
        RouteType::Unknown(_) => "unknown",
    }
}

/// Next Waypoint; only 0 ends a route (13002.11). 65535 is no waypoint's number: a route that leads there is refused, as one
/// that leads to any waypoint that was not received.
pub(crate) fn next(waypoint: &UaPositionWaypoint) -> u16 {
    waypoint.next_waypoint.unwrap_or(0)
}

fn numbered(message: u16, field: &'static str, number: Option<u16>) -> Result<u16, StoreError> {
    match number.ok_or(StoreError::Missing { message, field })? {
        number @ (0 | u16::MAX) => Err(StoreError::Number { field, number }),
        number => Ok(number),
    }
}

fn ends(message: u16, p1: Option<u16>, p4: Option<u16>) -> Result<(u16, u16), StoreError> {
    Ok((
        numbered(message, "P1 Waypoint No", p1)?,
        numbered(message, "P4 Waypoint No", p4)?,
    ))
}

/// A float can be no number at all: BAM cannot.
fn angle(field: &'static str, found: Option<f64>, max: f64) -> Result<(), StoreError> {
    match found {
        Some(value) if !(-max..=max).contains(&value) => {
            Err(StoreError::Angle { field, value, max })
        }
        _ => Ok(()),
    }
}

fn the_wrappers(field: &'static str, found: Option<Id>, expected: Id) -> Result<(), StoreError> {
    let found = found.ok_or(StoreError::Missing {
        message: 50001,
        field,
    })?;
    if found == expected {
        Ok(())
    } else {
        Err(StoreError::NotTheWrappers {
            field,
            found,
            expected,
        })
    }
}

fn has_room<K: Ord, V>(
    map: &BTreeMap<K, V>,
    key: &K,
    what: &'static str,
) -> Result<(), StoreError> {
    if map.len() >= MAX_WAYPOINTS && !map.contains_key(key) {
        return Err(StoreError::Full(MAX_WAYPOINTS, what));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUCS: Id = Id(0x1b00_00a0);
    const VEHICLE: Id = Id(0x1b00_0101);

    fn waypoint(number: u16, next: u16) -> Message {
        UaPositionWaypoint {
            waypoint_number: Some(number),
            next_waypoint: Some(next),
            ..UaPositionWaypoint::default()
        }
        .into()
    }

    fn curve(p1: u16, p4: u16) -> Message {
        CurveSegment {
            p1_waypoint_no: Some(p1),
            p4_waypoint_no: Some(p4),
            ..CurveSegment::default()
        }
        .into()
    }

    fn route(name: &str, initial: u16) -> Message {
        UaRoute {
            initial_waypoint_number: Some(initial),
            route_id: Some(stanag_msgs::Text::new(name)),
            ..UaRoute::default()
        }
        .into()
    }

    fn plan(messages: &[Message]) -> Plan {
        let mut plan = Plan::default();
        for message in messages {
            plan.store(message, CUCS, VEHICLE).expect("it is stored");
        }
        plan
    }

    fn ends(plan: &Plan, p1: u16) -> Vec<u16> {
        plan.curves_from(p1).map(|(p4, _)| p4).collect()
    }

    #[test]
    fn waypoints_without_a_route_are_a_flight_from_the_first_that_no_other_leads_to() {
        let start = |messages: &[Message]| {
            let mut plan = Plan::default();
            for message in messages {
                plan.store(message, CUCS, VEHICLE).expect("stored");
            }
            let route = plan.route_of_waypoints()?;
            assert_eq!(route_type(&route), RouteType::Flight);
            route.initial_waypoint_number
        };
        let chain = [waypoint(3, 0), waypoint(1, 4), waypoint(4, 3)];
        assert_eq!(start(&chain), Some(1));
        // The end of a loop leads back into the route.
        assert_eq!(
            start(&[waypoint(1, 2), waypoint(2, 5), waypoint(5, 2)]),
            Some(1)
        );
        let two = [&chain[..], &[waypoint(20, 21), waypoint(21, 0)]].concat();
        let circle_beside = [&chain[..], &[waypoint(20, 21), waypoint(21, 20)]].concat();
        let with_a_route = [&chain[..], &[route("R", 1)]].concat();
        // Its first waypoint may have been lost.
        let headless = [waypoint(3, 0), waypoint(9, 4), waypoint(4, 3)];
        for open in [
            &[][..],
            &two,
            &circle_beside,
            &with_a_route,
            &circle_beside[3..],
            &headless,
        ] {
            assert_eq!(start(open), None, "{open:?}");
        }
    }

    #[test]
    fn a_waypoint_that_leads_elsewhere_takes_the_curve_of_its_old_leg_away_whichever_comes_first() {
        let before = [waypoint(1, 2), waypoint(2, 3), waypoint(3, 0), curve(1, 2)];
        let mut curve_first = plan(&before);
        for message in [curve(1, 3), waypoint(1, 3)] {
            curve_first.store(&message, CUCS, VEHICLE).expect("stored");
        }
        let mut waypoint_first = plan(&before);
        for message in [waypoint(1, 3), curve(1, 3)] {
            waypoint_first
                .store(&message, CUCS, VEHICLE)
                .expect("stored");
        }
        assert_eq!(
            (ends(&curve_first, 1), ends(&waypoint_first, 1)),
            (vec![3], vec![3])
        );
        // The same leg, sent again, keeps its curve.
        let mut same = plan(&before);
        same.store(&waypoint(1, 2), CUCS, VEHICLE).expect("stored");
        assert_eq!(ends(&same, 1), [2]);
    }

    #[test]
    fn beside_a_route_aboard_stand_the_other_routes_and_nothing_of_earlier_plans() {
        let mut plan = plan(&[
            route("M", 1),
            waypoint(1, 2),
            waypoint(2, 0),
            curve(1, 2),
            route("C", 7),
            waypoint(7, 0),
            waypoint(90, 0),
        ]);
        let main = plan.route_named("M").cloned().expect("it is there");
        let aboard = plan.part(&main);
        plan.store(&waypoint(2, 90), CUCS, VEHICLE).expect("stored");
        let whole = plan.beside(&aboard);
        assert_eq!(whole.waypoint(2).and_then(|one| one.next_waypoint), Some(0));
        assert!(whole.waypoint(7).is_some() && whole.waypoint(90).is_none());
        assert_eq!(whole.messages_about(1).count(), 2);
        let names: Vec<_> = whole.routes().iter().map(|one| one.route_id).collect();
        assert_eq!(
            names,
            [
                Some(stanag_msgs::Text::new("C")),
                Some(stanag_msgs::Text::new("M"))
            ]
        );
    }

    #[test]
    fn routes_without_a_name_are_kept_apart_by_their_type() {
        let unnamed = |initial, kind, id: Option<&str>| -> Message {
            UaRoute {
                initial_waypoint_number: Some(initial),
                route_type: Some(kind),
                route_id: id.map(stanag_msgs::Text::new),
                ..UaRoute::default()
            }
            .into()
        };
        let mut plan = plan(&[
            unnamed(1, RouteType::Flight, None),
            unnamed(7, RouteType::ContingencyA, Some("")),
        ]);
        let initial = |plan: &Plan, kind| {
            let route = plan.route_of_type(kind);
            route.and_then(|route| route.initial_waypoint_number)
        };
        assert_eq!(initial(&plan, RouteType::Flight), Some(1));
        assert_eq!(initial(&plan, RouteType::ContingencyA), Some(7));
        // The same once more, and its end.
        for (number, left) in [(9, Some(9)), (0, None)] {
            let message = unnamed(number, RouteType::ContingencyA, None);
            plan.store(&message, CUCS, VEHICLE).expect("stored");
            assert_eq!(initial(&plan, RouteType::ContingencyA), left);
            assert_eq!(initial(&plan, RouteType::Flight), Some(1));
        }
    }

    #[test]
    fn a_route_is_changed_by_what_is_sent_for_another_that_uses_its_numbers() {
        let at = |number, next, north: f64, stamp| -> Message {
            UaPositionWaypoint {
                time_stamp: Some(TimeStamp(stamp)),
                waypoint_number: Some(number),
                next_waypoint: Some(next),
                waypoint_to_latitude_or_relative_y: Some(stanag_msgs::Bam32::from_degrees(north)),
                ..UaPositionWaypoint::default()
            }
            .into()
        };
        let kind = |kind, name, initial| -> Message {
            UaRoute {
                route_type: Some(kind),
                route_id: Some(stanag_msgs::Text::new(name)),
                initial_waypoint_number: Some(initial),
                ..UaRoute::default()
            }
            .into()
        };
        let home = |initial| kind(RouteType::ContingencyA, "A", initial);
        let before = plan(&[
            home(1),
            at(1, 2, 47.0, 1),
            at(2, 0, 47.1, 2),
            kind(RouteType::Approach, "B", 7),
            at(7, 0, 46.0, 3),
            route("F", 2),
        ]);
        let changed = |messages: &[Message]| -> Vec<(String, Vec<u16>)> {
            let mut after = before.clone();
            for message in messages {
                after.store(message, CUCS, VEHICLE).expect("stored");
            }
            let changed = after.routes_changed_since(&before);
            let named = changed
                .into_iter()
                .map(|(route, numbers)| (route_name(route).unwrap_or("").to_owned(), numbers));
            named.collect()
        };
        // The same, sent again later; and other numbers.
        assert_eq!(
            changed(&[at(2, 0, 47.1, 9), route("C", 3), at(3, 0, 47.2, 9)]),
            []
        );
        assert_eq!(
            changed(&[route("C", 2), at(2, 0, 48.0, 9)]),
            [("A".to_owned(), vec![2])]
        );
        // It leads on to the other's waypoints.
        assert_eq!(
            changed(&[route("C", 2), at(2, 3, 47.1, 9), at(3, 0, 48.0, 9)]),
            [("A".to_owned(), vec![2, 3])]
        );
        assert_eq!(changed(&[curve(1, 2)]), [("A".to_owned(), vec![1])]);
        // What is defined again is meant.
        assert_eq!(changed(&[home(2)]), []);
    }

    #[test]
    fn a_route_that_is_cleared_takes_only_its_own_waypoints_with_it() {
        let mut plan = plan(&[
            route("M", 1),
            waypoint(1, 2),
            waypoint(2, 5),
            curve(1, 2),
            route("C", 7),
            waypoint(7, 5),
            waypoint(5, 0),
        ]);
        plan.clear_route("nobody's");
        assert_eq!(plan.messages().count(), 7);
        plan.clear_route("M");
        let left: Vec<_> = [1, 2, 5, 7]
            .into_iter()
            .filter(|number| plan.waypoint(*number).is_some())
            .collect();
        assert_eq!(left, [5, 7]);
        assert_eq!(plan.messages().count(), 3);
    }

    #[test]
    fn a_curve_whose_stamp_is_no_number_is_not_stored() {
        // It would never be the same as itself, and mode 11 would load its route for ever.
        let curve = CurveSegmentPaper {
            time_stamp: Some(f64::NAN),
            vehicle_id: Some(VEHICLE),
            cucs_id: Some(CUCS),
            p1_waypoint_no: Some(1),
            p4_waypoint_no: Some(2),
            ..CurveSegmentPaper::default()
        };
        let stored = Plan::default().store(&curve.into(), CUCS, VEHICLE);
        assert!(matches!(stored, Err(StoreError::Stamp(_))), "{stored:?}");
    }

    #[test]
    fn a_loop_is_a_part_of_its_route_once() {
        let plan = plan(&[route("M", 1), waypoint(1, 2), waypoint(2, 1)]);
        let part = plan.part(&plan.routes()[0]);
        assert_eq!(part.messages().count(), 3);
    }
}
