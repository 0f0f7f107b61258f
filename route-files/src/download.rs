//! A plan as a vehicle sends it: 13001, 13002, 13003, 50001 and 50002, in whatever order they arrive; and which actions at
//! waypoints (13004, 13005, 13006) it has, which no route file holds.

use std::collections::{BTreeMap, BTreeSet};

use stanag_msgs::Message;
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::{UaLoiterWaypoint, UaPositionWaypoint, UaRoute};

/// The messages of a plan received so far; a later one for the same route, waypoint or leg replaces the earlier.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Download {
    routes: Vec<UaRoute>,
    waypoints: BTreeMap<u16, UaPositionWaypoint>,
    /// Loiters and curves by (type, first number, second number).
    others: BTreeMap<(u16, u16, u16), Message>,
    /// Actions at waypoints by (number, type): what a file of this plan lacks.
    actions: BTreeSet<(u16, u16)>,
}

impl Download {
    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Download::default();
    }

    /// Whether nothing was received.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The routes, in the order of their arrival.
    #[must_use]
    pub fn routes(&self) -> &[UaRoute] {
        &self.routes
    }

    /// The waypoints by rising number.
    pub fn waypoints(&self) -> impl Iterator<Item = &UaPositionWaypoint> {
        self.waypoints.values()
    }

    /// A waypoint by its number, and its loiter.
    #[must_use]
    pub fn waypoint(
        &self,
        number: u16,
    ) -> Option<(&UaPositionWaypoint, Option<&UaLoiterWaypoint>)> {
        let loiter = match self.others.get(&(UaLoiterWaypoint::ID, number, 0)) {
            Some(Message::UaLoiterWaypoint(loiter)) => Some(loiter),
            _ => None,
        };
        Some((self.waypoints.get(&number)?, loiter))
    }

    /// All messages: routes, waypoints, then loiters and curves.
    pub fn messages(&self) -> impl Iterator<Item = Message> + '_ {
        let routes = self.routes.iter().cloned().map(Message::UaRoute);
        let waypoints = self.waypoints.values().cloned();
        routes
            .chain(waypoints.map(Message::UaPositionWaypoint))
            .chain(self.others.values().cloned())
    }

    /// How many messages were received; one that replaced another does not count.
    #[must_use]
    pub fn len(&self) -> usize {
        self.routes.len() + self.waypoints.len() + self.others.len() + self.actions.len()
    }

    /// The actions at its waypoints, which no route file holds: the number of the waypoint, 0 for the whole mission, and the
    /// message. Whoever sends a file of this plan takes them away.
    pub fn actions(&self) -> impl Iterator<Item = (u16, u16)> + '_ {
        self.actions.iter().copied()
    }

    /// The waypoints received, and those that a route or a waypoint refers to, by rising number.
    #[must_use]
    pub fn named(&self) -> BTreeSet<u16> {
        let first = self
            .routes
            .iter()
            .filter_map(|route| route.initial_waypoint_number);
        let next = self
            .waypoints
            .values()
            .filter_map(|point| point.next_waypoint);
        let there = self.waypoints.keys().copied();
        first
            .chain(next)
            .chain(there)
            .filter(|number| *number != 0)
            .collect()
    }

    /// Those of [`Download::named`] that were not received.
    #[must_use]
    pub fn missing(&self) -> Vec<u16> {
        let named = self.named().into_iter();
        named
            .filter(|number| !self.waypoints.contains_key(number))
            .collect()
    }

    /// Whether the message is part of a plan and was kept.
    pub fn take(&mut self, message: &Message) -> bool {
        match message {
            Message::UaRoute(route) => {
                // Sent again, as in a second download: the later one counts.
                self.routes.retain(|known| !is_same(known, route));
                if self.routes.len() >= MAX_ROUTES {
                    return false;
                }
                self.routes.push(route.clone());
                true
            }
            Message::UaPositionWaypoint(point) => match point.waypoint_number {
                Some(number) => {
                    self.waypoints.insert(number, point.clone());
                    true
                }
                None => false,
            },
            Message::UaLoiterWaypoint(loiter) => {
                self.keep(message, loiter.waypoint_number, Some(0))
            }
            Message::CurveSegment(curve) => {
                self.keep(message, curve.p1_waypoint_no, curve.p4_waypoint_no)
            }
            Message::CurveSegmentPaper(curve) => {
                self.keep(message, curve.p1_waypoint_no, curve.p4_waypoint_no)
            }
            Message::PayloadActionWaypoint(action) => self.note(message, action.waypoint_number),
            Message::AirframeActionWaypoint(action) => self.note(message, action.waypoint_number),
            Message::VehicleSpecificWaypoint(action) => self.note(message, action.waypoint_number),
            _ => false,
        }
    }

    /// Keeps which action is at a waypoint, not the action itself.
    fn note(&mut self, message: &Message, waypoint: Option<u16>) -> bool {
        let Some(waypoint) = waypoint else {
            return false;
        };
        self.actions.insert((waypoint, message.id()));
        true
    }

    fn keep(&mut self, message: &Message, first: Option<u16>, second: Option<u16>) -> bool {
        let (Some(first), Some(second)) = (first, second) else {
            return false;
        };
        let key = (message.id(), first, second);
        if self.others.len() >= MAX_OTHERS && !self.others.contains_key(&key) {
            return false;
        }
        self.others.insert(key, message.clone());
        true
    }
}

/// Whether two 13001 define one route: of the same name, or, where neither has one, of the same type.
fn is_same(known: &UaRoute, new: &UaRoute) -> bool {
    let name = |route: &UaRoute| route.route_id.filter(|id| !id.as_str().is_empty());
    let kind = |route: &UaRoute| route.route_type.unwrap_or(RouteType::Flight);
    match (name(known), name(new)) {
        (None, None) => kind(known) == kind(new),
        (known, new) => known == new,
    }
}

const MAX_ROUTES: usize = 256;
/// As many as there can be waypoints.
const MAX_OTHERS: usize = 65_534;

#[cfg(test)]
mod tests {
    use stanag_msgs::messages::{PayloadActionWaypoint, VehicleSpecificWaypoint};

    use super::*;

    #[test]
    fn an_action_at_a_waypoint_counts_once_however_often_it_arrives() {
        let mut download = Download::default();
        let vehicle_specific = |number| VehicleSpecificWaypoint {
            waypoint_number: number,
            ..VehicleSpecificWaypoint::default()
        };
        let gimbal = PayloadActionWaypoint {
            waypoint_number: Some(20),
            ..PayloadActionWaypoint::default()
        };
        // Sent again where a waypoint is requested separately.
        for _ in 0..2 {
            assert!(download.take(&vehicle_specific(Some(20)).into()));
            assert!(download.take(&vehicle_specific(Some(0)).into()));
            assert!(download.take(&gimbal.clone().into()));
        }
        assert!(!download.take(&vehicle_specific(None).into()));
        assert_eq!(download.len(), 3);
        let actions: Vec<_> = download.actions().collect();
        assert_eq!(actions, [(0, 13006), (20, 13004), (20, 13006)]);
        download.clear();
        assert!(download.is_empty());
    }
}
