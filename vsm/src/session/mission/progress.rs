//! Where the vehicle is along its route: which waypoint it has been at, which it flies to, which comes next (4001).
//!
//! The order of the route alone does not show that: a vehicle that was sent to a waypoint has not been at the one
//! before it, and a loop leads back a number of times. A waypoint is reached where the vehicle reports it
//! (MISSION_ITEM_REACHED); the laps of a loop are counted by its MISSION_CURRENT. After a start of this VSM in the middle
//! of a route the waypoint before is taken as the one that the vehicle comes from, until it reaches the next.

use mapping::mode::Px4Mode;
use mapping::report::Along;
use mapping::route::CompiledMission;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MissionState;

/// The machine. Legs are indices of [`CompiledMission::order`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct RouteProgress {
    /// The beginning of the flight was seen by this process.
    witnessed: bool,
    /// The route has been flown, or a part of it, since it was uploaded.
    begun: bool,
    from: Option<usize>,
    /// Reached, while the vehicle still names it as the one that it flies to.
    arrived: Option<usize>,
    to: Option<usize>,
    /// How often the loop has led back.
    laps: u16,
    /// What was reached before the route was begun again: its repetitions prove nothing.
    outdated: Option<u16>,
}

impl RouteProgress {
    /// Another route is uploaded: none of it has been flown.
    pub(crate) fn begin(&mut self, vehicle: &Telemetry) {
        *self = RouteProgress {
            witnessed: true,
            outdated: vehicle.reached,
            ..RouteProgress::default()
        };
    }

    /// The vehicle is sent to an item of the route, wherever it was. PX4 v1.18 continues to count the laps of a loop, also
    /// where the route is flown again from its start: seen in its own simulation.
    pub(crate) fn sent_on(&mut self, vehicle: &Telemetry) {
        let laps = self.laps;
        self.begin(vehicle);
        self.laps = laps;
    }

    /// Whether it may have been flown already, whole or in part.
    pub(crate) fn was_flown(&self) -> bool {
        self.begun || !self.witnessed
    }

    /// Takes in what the vehicle reports now.
    pub(crate) fn look(&mut self, compiled: &CompiledMission, vehicle: &Telemetry) {
        let Some(mission) = vehicle.mission else {
            return;
        };
        self.begun |= vehicle.mode == Some(Px4Mode::MISSION);
        let to = compiled.leg_of_item(mission.seq);
        if to != self.to {
            let led_back = compiled
                .circuit()
                .is_some_and(|(end, start, _)| self.to == Some(end) && to == Some(start));
            // The item that begins the route again after its end is no lap.
            if led_back && self.begun && mission.state != MissionState::MISSION_STATE_COMPLETE {
                self.laps = self.laps.saturating_add(1);
            }
            // MISSION_ITEM_REACHED may come before MISSION_CURRENT moves on: only now is the waypoint left behind.
            if self.arrived.is_some() && self.arrived != to {
                self.from = self.arrived.take();
            }
            self.to = to;
        }
        let Some(seq) = vehicle.reached else {
            return;
        };
        // PX4 v1.18 repeats MISSION_ITEM_REACHED up to ten times: an old one counts only where it fits the leg.
        if self.outdated == Some(seq) && compiled.leg_of_item(seq) != to {
            return;
        }
        self.outdated = None;
        let Some(leg) = compiled.leg_ended_by(seq) else {
            return;
        };
        // From here on the waypoint before is known, and no longer inferred from the order.
        self.witnessed = true;
        if Some(leg) == to && mission.state != MissionState::MISSION_STATE_COMPLETE {
            self.arrived = Some(leg);
        } else {
            self.from = Some(leg);
        }
    }

    /// What 4001 reports.
    pub(crate) fn along(&self, compiled: &CompiledMission, vehicle: &Telemetry) -> Along {
        let Some(mission) = vehicle.mission else {
            return Along::default();
        };
        let there = |leg: usize| (leg < compiled.order.len()).then_some(leg);
        if mission.state == MissionState::MISSION_STATE_COMPLETE {
            // A route that is over leads nowhere; one that has not been begun leads to its first waypoint, whatever
            // the vehicle says of the one before.
            return if self.was_flown() {
                Along {
                    from: self.from.or_else(|| compiled.order.len().checked_sub(1)),
                    ..Along::default()
                }
            } else {
                Along {
                    from: None,
                    to: there(0),
                    next: there(1),
                }
            };
        }
        let to = compiled.leg_of_item(mission.seq);
        // Inferred only after a start of this VSM in mid-route: after a jump it was not at the one before.
        let before = to
            .filter(|_| !self.witnessed)
            .and_then(|to| to.checked_sub(1));
        let next = to.and_then(|to| match compiled.circuit() {
            Some((end, start, times)) if to == end => (self.laps < times).then_some(start),
            _ => there(to + 1),
        });
        Along {
            from: self.from.or(before),
            to,
            next,
        }
    }
}
