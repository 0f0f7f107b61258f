//! A route as uploaded to PX4: its items, the waypoint of each, and the vehicle's progress by item.

use curve_paths::{BezierLeg, Ground};
use mavlink_link::service::mission::Item;
use serde::{Deserialize, Serialize};

use super::brake;
use super::error::{Reason, RouteError};
use super::item::{
    self, DO_CHANGE_SPEED, DO_JUMP, DO_LAND_START, DO_VTOL_TRANSITION, NAV_LAND, NAV_LOITER_UNLIM,
    NAV_VTOL_LAND, VTOL_STATE_MC, degrees_e7,
};
use super::site::Site;
use crate::altitude::Level;
use crate::limits::{Limits, Performance};

/// A route as uploaded to PX4, with the waypoint of each item.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CompiledMission {
    /// The items, the first with `current` set.
    pub items: Vec<Item>,
    /// The CUCS's waypoint number of each item.
    pub waypoint_of: Vec<u16>,
    /// The waypoints in flying order.
    pub order: Vec<Leg>,
    /// A summary of its curved legs, if any.
    pub curved: Option<Curved>,
    /// The curved legs that may be streamed; none unless that is configured.
    pub streamed: Vec<StreamedRun>,
    /// Notes for the operator.
    pub notes: Vec<String>,
}

/// Curved legs, one after the other, that are streamed together.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamedRun {
    /// The item of the first P1: while it is flown to, the stream may begin.
    pub entry: u16,
    /// The legs, in flying order.
    pub legs: Vec<StreamedLeg>,
    /// The item from which the mission continues.
    pub resume: u16,
    /// Where that item leads: the vehicle passes the last P4 on its way there. `None`: it stops at the last P4, whose item
    /// the mission then completes.
    pub exit: Option<(Ground, Level)>,
}

/// A curved leg that is streamed.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamedLeg {
    /// P1 and P4, by the CUCS's numbers.
    pub ends: (u16, u16),
    /// The curve, its altitudes in the reference that `above_home` names.
    pub curve: BezierLeg,
    /// Its altitudes are heights above home; otherwise above mean sea level.
    pub above_home: bool,
    /// Commanded speed, m/s.
    pub speed_m_s: f64,
    /// Its chords' ends without P1 and P4, and the item that follows each.
    pub vertices: Vec<(Ground, u16)>,
    /// The item of P4.
    pub end: u16,
}

/// A waypoint of a route with what 4001 reports of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The CUCS's number.
    pub number: u16,
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Its altitude.
    pub level: Level,
    /// Commanded speed of the leg to it, m/s.
    pub speed_m_s: Option<f64>,
}

impl Leg {
    /// Its end, degrees north and east.
    pub(crate) fn place(&self) -> (f64, f64) {
        (self.latitude, self.longitude)
    }
}

/// A summary of the curved legs of a route; JSON uses these field names.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Curved {
    /// Curved legs.
    pub legs: usize,
    /// Their chords.
    pub chords: usize,
    /// The tolerance of the chords, m: the configured one, or the smallest that the items allow.
    pub tolerance_m: f64,
    /// Proven deviation of the chords from the curves, both ways, m.
    pub bound_m: f64,
    /// The predicted deviation in flight, m, within which every measured flight stayed; on wings with the assumed wind
    /// (`vehicle.curve.wind_m_s`), `None` if that is too strong for the speed.
    pub predicted_m: Option<f64>,
    /// Predicted time that the curved legs take, s.
    pub time_s: f64,
}

impl Curved {
    /// The text of the alert about it.
    pub(crate) fn note(&self, wished_m: f64, items: usize) -> String {
        let Self {
            legs,
            chords,
            tolerance_m,
            bound_m,
            time_s,
            ..
        } = self;
        let mut text = format!(
            "{legs} curved legs in {chords} chords, proven within {bound_m:.2} m, {time_s:.0} s on them"
        );
        if let Some(predicted_m) = self.predicted_m {
            // An upper bound is rounded up.
            let predicted_m = (predicted_m * 10.0).ceil() * 0.1;
            text += &format!("; flown within {predicted_m:.1} m, predicted and not promised");
        }
        if *tolerance_m > wished_m {
            text += &format!(
                "; tolerance {tolerance_m:.2} m, not {wished_m} m: the smallest that {items} items allow"
            );
        }
        text
    }
}

impl CompiledMission {
    /// The first item made for a waypoint: where a flight to it starts.
    #[must_use]
    pub fn first_item_of(&self, waypoint: u16) -> Option<u16> {
        let leg = self.order.iter().find(|leg| leg.number == waypoint)?;
        let (x, y) = (degrees_e7(leg.latitude), degrees_e7(leg.longitude));
        // Skips the chords of a curve to the waypoint: a flight to the waypoint goes straight there.
        let mut at = self
            .items
            .iter()
            .zip(&self.waypoint_of)
            .position(|(item, number)| {
                *number == waypoint && item.is_flown_to() && (item.x, item.y) == (x, y)
            })?;
        while let Some(before) = at.checked_sub(1)
            && self.waypoint_of.get(before) == Some(&waypoint)
            && self.items.get(before).is_some_and(item::prepares_leg)
        {
            at = before;
        }
        u16::try_from(at).ok()
    }

    /// The first waypoint from this item on that a multicopter could miss for good at this speed, commanded
    /// separately from the route: it climbs or descends there. `level` is whether the first one is reached without
    /// that, for a vehicle that does not come from the waypoint before.
    #[must_use]
    pub fn missed_at(
        &self,
        seq: u16,
        level: Option<bool>,
        speed_m_s: f64,
        performance: &Performance,
    ) -> Option<u16> {
        let at = brake::missed_at(&self.items, seq.into(), level, speed_m_s, performance)?;
        self.waypoint_of.get(at).copied()
    }

    /// The speed that a jump to this item must bring along, m/s; `None` where an item on the way to its place sets one.
    ///
    /// It is the speed that the leg is planned for: that of the items before, the vehicle's cruise speed before any. PX4 v1.18
    /// flies it where it comes from those items or enters AUTO.MISSION, but keeps the present speed over DO_JUMP and
    /// MISSION_SET_CURRENT.
    #[must_use]
    pub fn speed_of_jump(&self, seq: u16, cruise_m_s: f64) -> Option<f64> {
        (!self.sets_speed(seq)).then(|| self.speed_before_m_s(seq.into(), cruise_m_s))
    }

    /// The speed that the landing pattern of a wing must be given when it is begun, m/s: the vehicle's cruise speed, for which it is
    /// planned, as a route of its own. `None` where it has that speed, or an item on the way to its first place sets one.
    ///
    /// `jumps`: it is begun within AUTO.MISSION, where PX4 v1.18 keeps the present speed. Where that mode is entered, PX4 repeats the
    /// last speed of the route.
    #[must_use]
    pub fn speed_of_landing(&self, jumps: bool, cruise_m_s: f64) -> Option<f64> {
        let start = self.landing_start()?;
        let other = jumps || item::speed_before(&self.items, start.into()).is_some();
        (other && !self.sets_speed(start)).then_some(cruise_m_s)
    }

    /// Whether an item on the way to the place of this one sets a speed.
    fn sets_speed(&self, seq: u16) -> bool {
        let way = usize::from(seq)..usize::from(self.place_from(seq));
        let mut way = self.items.get(way).unwrap_or_default().iter();
        way.any(|item| item.command == DO_CHANGE_SPEED)
    }

    /// The first item with a position at or after this one: PX4 executes the ones before it immediately.
    #[must_use]
    pub fn place_from(&self, seq: u16) -> u16 {
        let on = self.items.iter().skip(usize::from(seq));
        let steps = on.take_while(|item| !item.is_flown_to()).count();
        seq.saturating_add(u16::try_from(steps).unwrap_or(0))
    }

    /// The leg that is complete when this item is reached, as an index of `order`: `None` for the chords of a curve on the
    /// way to its end, and for items without a position.
    #[must_use]
    pub fn leg_ended_by(&self, seq: u16) -> Option<usize> {
        let at = usize::from(seq);
        let number = self.waypoint_of.get(at)?;
        let mut after = self.items.iter().zip(&self.waypoint_of).skip(at + 1);
        let more = after.any(|(item, of)| of == number && item.is_flown_to());
        (self.items.get(at)?.is_flown_to() && !more).then(|| self.leg_of_item(seq))?
    }

    /// Whether this item has no position and is executed where this leg, an index of `order`, ends: before the next leg, or where
    /// the route leads back from it.
    ///
    /// PX4 v1.18 executes it at once and reports it as reached in place of the waypoint. A landing pattern may be entered from
    /// any leg, so its start follows none.
    #[must_use]
    pub fn is_executed_behind(&self, seq: u16, leg: usize) -> bool {
        let executed = |item: &Item| !item.is_flown_to() && item.command != DO_LAND_START;
        if !self.items.get(usize::from(seq)).is_some_and(executed) {
            return false;
        }
        let mut before = self.items.iter().take(usize::from(seq));
        let place = before.rposition(Item::is_flown_to);
        let place = place.and_then(|at| u16::try_from(at).ok());
        if place.and_then(|at| self.leg_ended_by(at)) == Some(leg) {
            return true;
        }
        let mut items = self.items.iter();
        let jump = items.find(|item| item.command == DO_JUMP);
        let first = jump.map(|item| item.params[0] as u16);
        let ends = self.circuit().is_some_and(|(end, ..)| end == leg);
        ends && first.is_some_and(|at| at <= seq && self.place_from(at) == self.place_from(seq))
    }

    /// The loop of the route: (its last leg, its first leg, how often it leads back), legs as indices of `order`.
    #[must_use]
    pub fn circuit(&self) -> Option<(usize, usize, u16)> {
        let at = self.items.iter().position(|item| item.command == DO_JUMP)?;
        let [first, times, ..] = self.items.get(at)?.params;
        let end = self.leg_of_item(u16::try_from(at).ok()?)?;
        Some((end, self.leg_of_item(first as u16)?, times as u16))
    }

    /// The leg that an item belongs to, as an index of `order`.
    #[must_use]
    pub fn leg_of_item(&self, seq: u16) -> Option<usize> {
        let number = self.waypoint_of.get(usize::from(seq))?;
        self.order.iter().position(|leg| leg.number == *number)
    }

    /// The waypoint that an item, an index, was made for, for an operator: the vehicle knows its items alone.
    #[must_use]
    pub fn item_in_words(&self, item: usize) -> Option<String> {
        let number = *self.waypoint_of.get(item)?;
        Some(match number {
            0 => "a place of its landing".to_owned(),
            number => format!("waypoint {number}"),
        })
    }

    /// Checks that it can be flown from the present home. It was compiled for an earlier one: PX4 sets home again when it
    /// arms, and an altitude above sea level does not move with home.
    ///
    /// # Errors
    /// The first waypoint that is below home now, or beyond the limits.
    pub fn check_heights(&self, home_amsl_m: f64, limits: &Limits) -> Result<(), RouteError> {
        for (level, waypoint) in self.levels() {
            let checked = limits.check_height(level, home_amsl_m);
            checked.map_err(|fault| RouteError {
                waypoint,
                reason: Reason::Height(fault),
            })?;
        }
        Ok(())
    }

    /// Its lowest altitude, m above mean sea level; a landing is excluded.
    #[must_use]
    pub fn lowest_amsl_m(&self, home_amsl_m: f64) -> Option<f64> {
        let levels = self.levels().map(|(level, _)| level.amsl(home_amsl_m));
        levels.min_by(f64::total_cmp)
    }

    /// Whether a VTOL hovers along the leg with which a flight from this item begins; otherwise it is on its wings.
    #[must_use]
    pub fn hovers_from(&self, seq: u16) -> bool {
        let before = self.items.iter().take(usize::from(self.place_from(seq)));
        let turned = before.rev().find(|item| item.command == DO_VTOL_TRANSITION);
        turned.is_some_and(|item| item.params[0] == VTOL_STATE_MC)
    }

    /// Whether a flight from this item begins with a transition of its own.
    #[must_use]
    pub fn turns_at(&self, seq: u16) -> bool {
        let range = usize::from(seq)..usize::from(self.place_from(seq));
        let items = self.items.get(range).unwrap_or_default();
        items.iter().any(|item| item.command == DO_VTOL_TRANSITION)
    }

    /// Whether it ends in a landing.
    #[must_use]
    pub fn has_landing(&self) -> bool {
        self.items.iter().any(touches_down)
    }

    /// Where the landing pattern of a wing begins.
    #[must_use]
    pub fn landing_start(&self) -> Option<u16> {
        let mut items = self.items.iter();
        let at = items.position(|item| item.command == DO_LAND_START)?;
        u16::try_from(at).ok()
    }

    /// Whether this item is the touch-down of a landing.
    #[must_use]
    pub fn is_touch_down(&self, seq: u16) -> bool {
        self.items.get(usize::from(seq)).is_some_and(touches_down)
    }

    /// Whether the route is complete when this item is current: a wing then stays there, or lands.
    #[must_use]
    pub fn is_past_the_route(&self, seq: u16) -> bool {
        let staying = self.landing_start().map(|at| at.saturating_sub(1));
        let stays = |at: &u16| {
            let item = self.items.get(usize::from(*at));
            item.is_some_and(|item| item.command == NAV_LOITER_UNLIM)
        };
        staying.filter(stays).is_some_and(|at| seq >= at)
    }

    /// Whether this item lands the vehicle, or leads to one that does.
    #[must_use]
    pub fn lands(&self, seq: u16) -> bool {
        self.landing_start().is_some_and(|start| seq >= start) || self.is_touch_down(seq)
    }

    /// The level of each item with a position, and the waypoint that it belongs to.
    fn levels(&self) -> impl Iterator<Item = (Level, u16)> + '_ {
        let route = self.landing_start().map_or(self.items.len(), usize::from);
        let items = self.items.iter().zip(&self.waypoint_of).take(route);
        items
            .filter(|(item, number)| item.is_flown_to() && !touches_down(item) && **number != 0)
            .filter_map(|(item, waypoint)| {
                Some((Level::of_frame(item.frame, item.z.into())?, *waypoint))
            })
    }

    /// Ends the route by landing at its last waypoint: an approach of a multicopter.
    pub(super) fn land_at_the_end(&mut self) {
        let Some(last) = self.order.last().copied() else {
            return;
        };
        let params = [0.0, 0.0, 0.0, f32::NAN];
        let item = item::placed(last.place(), Level::AboveHome(0.0), NAV_LAND, params);
        self.push(last.number, item);
    }

    /// The speed in force where an item begins that is reached from the items before it, m/s.
    pub(super) fn speed_before_m_s(&self, at: usize, cruise_m_s: f64) -> f64 {
        item::speed_before(&self.items, at).map_or(cruise_m_s, f64::from)
    }

    /// The speed commanded last in the present state of a VTOL, m/s; PX4's own cruise speed before any.
    pub(super) fn speed_m_s(&self, site: &Site) -> f64 {
        let turns = |item: &Item| item.command == DO_VTOL_TRANSITION;
        let turned = self.items.iter().rposition(turns);
        let at = turned.and_then(|at| self.waypoint_of.get(at));
        let at = at.and_then(|number| self.order.iter().position(|leg| leg.number == *number));
        let since = self.order.iter().skip(at.map_or(0, |at| at + 1));
        let of_legs_m_s = since
            .rev()
            .find_map(|leg| leg.speed_m_s)
            .unwrap_or(site.performance.cruise_m_s);
        // The speed of a loiter lasts where its leg has none to return to. An item holds a speed in single precision.
        item::speed_before(&self.items, self.items.len())
            .filter(|set_m_s| *set_m_s != of_legs_m_s as f32)
            .map_or(of_legs_m_s, f64::from)
    }

    /// Adds an item of a waypoint.
    pub(super) fn push(&mut self, waypoint: u16, item: Item) {
        self.items.push(item);
        self.waypoint_of.push(waypoint);
    }
}

/// Whether an item is the touch-down of a landing, of wings or not.
pub(super) fn touches_down(item: &Item) -> bool {
    matches!(item.command, NAV_LAND | NAV_VTOL_LAND)
}

#[cfg(test)]
mod tests {
    use mavlink_link::service::mission::FRAME_MISSION;

    use super::*;

    /// Three waypoints, each behind the speed of its leg; then back to the first, twice.
    fn with_speeds() -> CompiledMission {
        let without_place = |command| Item {
            frame: FRAME_MISSION,
            command,
            ..Item::default()
        };
        let place = Item {
            command: item::NAV_WAYPOINT,
            ..Item::default()
        };
        let mut compiled = CompiledMission::default();
        for number in [11, 12, 13] {
            compiled.push(number, without_place(DO_CHANGE_SPEED));
            compiled.push(number, place);
            compiled.order.push(Leg {
                number,
                latitude: 47.0,
                longitude: 8.0,
                level: Level::AboveHome(50.0),
                speed_m_s: Some(5.0),
            });
        }
        let back = Item {
            params: [0.0, 2.0, 0.0, 0.0],
            ..without_place(DO_JUMP)
        };
        compiled.push(13, back);
        compiled
    }

    #[test]
    fn a_speed_is_executed_behind_the_leg_before_it_and_behind_the_end_of_a_loop() {
        let compiled = with_speeds();
        let behind = |seq| -> Vec<usize> {
            let legs = 0..compiled.order.len();
            legs.filter(|leg| compiled.is_executed_behind(seq, *leg))
                .collect()
        };
        assert_eq!(behind(0), [2]);
        assert_eq!(behind(2), [0]);
        assert_eq!(behind(4), [1]);
        for place in [1, 3, 5, 7, u16::MAX] {
            assert!(behind(place).is_empty(), "{place}");
        }
    }
}
