//! Who has the vehicle since the latest 2016 was carried out, for a station that repeats it (`repeated`).

use mapping::mode::Px4Mode;
use stanag_msgs::enums::FlightPathControlMode as Mode;

use super::{Context, Flight};
use crate::session::maneuver::Maneuver;
use crate::session::other::Other;

impl Flight {
    /// Who has taken the vehicle out of the mode that a CUCS repeats, or is about to. `at_end`: the route aboard was flown to its end.
    pub(super) fn taken_by(&self, context: &Context<'_>, at_end: bool) -> Option<String> {
        let latest = self.repeated.latest.as_ref()?;
        let (vehicle, now) = (context.vehicle, context.mono());
        let telemetry = &vehicle.telemetry;
        let mode = telemetry.mode?;
        // Also by a report of before the last command: nothing of the stream has led there.
        let other = self.shown_other(vehicle, now);
        let stops = latest.stops(mode);
        let Some(reached) = latest.reached else {
            return other
                .filter(|other| !stops && latest.is_met_by(*other))
                .map(|other| other.to_string());
        };
        if latest.mode() == Some(Mode::Launch) && telemetry.stands() {
            return Some("the vehicle has landed since".to_owned());
        }
        // Nothing is flown, and nobody is about to.
        if telemetry.armed == Some(false) && !matches!(other, Some(Other::Pilot(_))) {
            return None;
        }
        let theirs = self.entered_by_others(reached);
        // A held command may be to fly on.
        if theirs.is_some_and(|theirs| !theirs.modes().any(|mode| latest.stops(mode))) {
            return Some("this VSM is commanding another mode".to_owned());
        }
        if self.is_in(reached, mode) {
            // A mode that is commanded again ends a failsafe that holds before it acts. PX4's warning in any other mode is no reason
            // to refuse what takes nothing from it.
            let keeps = |other: &Other| {
                matches!(other, Other::Pilot(_)) || *other == Other::Failsafe(Px4Mode::LOITER)
            };
            // It has left its failsafe without a command.
            if self.steering.is_aside() {
                return Some("the vehicle is in OFFBOARD again by itself or by a pilot".to_owned());
            }
            let other = self.other(vehicle, now).filter(keeps);
            return other.map(|other| other.to_string());
        }
        if stops {
            return None;
        }
        let running = self.maneuver.as_ref().map(|(_, running)| running);
        let enters = running.is_some_and(Maneuver::enters_a_mode);
        let is_own = match other {
            Some(Other::Ending(mode)) => running.is_some_and(|running| running.enters(mode)),
            Some(_) => false,
            // A load puts the vehicle on hold.
            None => {
                (enters && !self.is_on_curve(reached))
                    || context.mission.is_transferring()
                    || (mode == Px4Mode::LOITER
                        && ends_in_a_hold(reached, at_end, telemetry.stands()))
            }
        };
        if is_own {
            return None;
        }
        let others = other.filter(|_| self.watched.entered != Some(mode));
        Some(match others {
            Some(other) => other.to_string(),
            None => format!(
                "the vehicle is in {} now, by its pilot, another station or this VSM",
                mode.name()
            ),
        })
    }

    /// Whether the latest 2016 has stopped the vehicle, or had it return or land, and is a new command because the vehicle flies on since,
    /// or is about to.
    pub(super) fn is_left(&self, context: &Context<'_>) -> bool {
        let latest = self.repeated.latest.as_ref();
        let Some((latest, reached)) = latest.and_then(|one| Some((one, one.reached?))) else {
            return false;
        };
        let telemetry = &context.vehicle.telemetry;
        let shown = telemetry.mode.filter(|_| telemetry.armed != Some(false));
        let elsewhere = shown.filter(|mode| !self.is_in(reached, *mode));
        let theirs = self.entered_by_others(reached);
        let mut entered = theirs.into_iter().flat_map(Maneuver::modes);
        elsewhere.is_some_and(|mode| latest.stops(mode)) || entered.any(|mode| latest.stops(mode))
    }

    /// What enters a mode without a command of a station at this moment: the VSM's own, or a held one.
    fn entered_by_others(&self, reached: Px4Mode) -> Option<&Maneuver> {
        let (by, running) = self.maneuver.as_ref()?;
        let of_station = by.is_some_and(|by| by.held.is_none());
        (running.enters_a_mode() && !of_station && !self.is_on_curve(reached)).then_some(running)
    }

    /// Whether a vehicle in this mode is in the one that was reached.
    fn is_in(&self, reached: Px4Mode, mode: Px4Mode) -> bool {
        mode == reached || (mode == Px4Mode::OFFBOARD && self.is_on_curve(reached))
    }

    /// OFFBOARD, and the mission again, are the VSM's own way along the route.
    fn is_on_curve(&self, reached: Px4Mode) -> bool {
        self.curve_stream.is_flown() && reached == Px4Mode::MISSION
    }

    /// Whether the vehicle still flies what the latest 2016 has led to, or has landed by it, so that to carry it out again would only command the mode once
    /// more: a pilot or a failsafe that has just taken the vehicle, and is not reported yet, would lose it.
    pub(super) fn is_still_flown(&self, context: &Context<'_>) -> bool {
        let latest = self.repeated.latest.as_ref();
        let Some((latest, reached)) = latest.and_then(|one| Some((one, one.reached?))) else {
            return false;
        };
        let is_shown = self.settled_mode(context) == Some(reached);
        match reached {
            // It is not in the mode any more: PX4 leaves it as it disarms.
            Px4Mode::RTL | Px4Mode::LAND if context.vehicle.telemetry.stands() => true,
            Px4Mode::LOITER | Px4Mode::ORBIT | Px4Mode::RTL | Px4Mode::LAND => {
                is_shown && latest.mode() != Some(Mode::Launch)
            }
            Px4Mode::POSCTL => is_shown && self.sticks.fresh(context.mono()),
            Px4Mode::MISSION => self.curve_stream.is_flown(),
            // Nothing in it commands the mode.
            _ => false,
        }
    }
}

/// Whether PX4 itself leads from this mode to AUTO.LOITER. `stands`: on the ground, where it does so as it disarms.
fn ends_in_a_hold(reached: Px4Mode, at_end: bool, stands: bool) -> bool {
    match reached {
        Px4Mode::TAKEOFF | Px4Mode::VTOL_TAKEOFF => true,
        Px4Mode::MISSION => at_end,
        Px4Mode::RTL | Px4Mode::LAND => stands,
        _ => false,
    }
}
