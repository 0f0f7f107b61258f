//! The altitude band: whether the vehicle itself is between `lowest_m` and `highest_m` of its limits (`vehicle.limits`).
//!
//! No fence item of MAVLink has a floor or a ceiling, and PX4's own fence has one ceiling (GF_MAX_VER_DIST, which narrows
//! the band) and no floor. Routes and commands that leave the band are refused before they are sent. This module detects a
//! vehicle that leaves it anyway, because of a failsafe, a pilot or another station. An alert (16000) is active while it is
//! outside, and with `vehicle.limits.outside = "hold"` a vehicle in an automatic mode is put on hold.
//!
//! Every flight begins and most end below the floor, so a vehicle counts as below it only if it was above it in this flight
//! and is neither returning nor landing. A hold below the floor would keep a landing vehicle low. In a mission it is
//! therefore commanded only if the current item is known, freshly reported, part of the uploaded route and not a landing. A
//! vehicle is not put on hold if nobody controls it (nothing would end the hold) or if the VSM is already acting on it: then
//! there is only the alert.

use std::time::Duration;

use mapping::mode::Px4Mode;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::approach::FRESH_S;
use super::input::Context;
use super::record::UploadedMission;
use super::watchdog::{banks, flown, seconds};
use crate::config::Outside;
use crate::session::alerts::Cause;
use crate::session::effects::{Effects, Request};

/// The machine.
#[derive(Debug, Default)]
pub(super) struct BandWatch {
    /// Whether it was above the floor in this flight.
    entered: bool,
    /// Whether it is outside.
    outside: bool,
    /// Since when it is below the floor, by its own clock, s.
    below_s: Option<f64>,
    /// The hold that was commanded for that.
    held: Option<Held>,
}

/// The progress of a hold.
#[derive(Debug, Clone, Copy)]
enum Held {
    /// It was commanded then.
    Commanded(Duration),
    /// The vehicle has left its earlier mode: any later mode was commanded by somebody.
    Shown,
}

/// The vehicle's state; heights in m above home.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    height_m: f64,
    lowest_m: f64,
    highest_m: f64,
    /// It is landing, or returning to land.
    descends: bool,
    /// The vehicle's clock, s since its boot.
    time_s: Option<f64>,
    /// It flies a mission.
    in_mission: bool,
    /// When a MISSION_CURRENT last named the current item, by the same clock; `None` if the item is not ours or is a
    /// landing.
    route_named_s: Option<f64>,
}

impl Sample {
    /// Distance outside the band, m; 0 or less inside.
    fn beyond_m(&self) -> f64 {
        let below_m = match self.descends {
            true => f64::NEG_INFINITY,
            false => self.lowest_m - self.height_m,
        };
        below_m.max(self.height_m - self.highest_m)
    }
}

impl BandWatch {
    /// Whether the vehicle is outside.
    pub(super) fn outside(&self) -> bool {
        self.outside
    }

    /// Compares the vehicle with its band.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        uploaded: Option<&UploadedMission>,
        transferring: bool,
        effects: &mut Effects<'_>,
    ) {
        let telemetry = &context.vehicle.telemetry;
        if telemetry.stands() {
            *self = BandWatch::default();
            return effects.clear(Cause::AltitudeBand, "the vehicle is on the ground");
        }
        let Some(sample) = sample(context, uploaded).filter(|_| context.vehicle.live()) else {
            return;
        };
        if !self.judge(&sample) {
            return effects.clear(Cause::AltitudeBand, "within its altitude band again");
        }
        let Sample {
            height_m,
            lowest_m,
            highest_m,
            ..
        } = sample;
        // Altitude oscillations of a multicopter, or of a fixed wing in a gust, are no reason for a hold.
        let swing_m = if banks(telemetry.vehicle_type) {
            WINGS_M
        } else {
            HOVERING_M
        };
        let mode = context.vehicle.settled_mode();
        let by_itself = mode.map(|mode| BY_ITSELF.contains(&mode));
        let flight = &context.flight;
        // A maneuver in progress may be the recovery from this situation.
        let idle = !transferring && !flight.maneuver && !flight.loss_action && !flight.contingency;
        let acts = context.bounds.outside == Outside::Hold
            && sample.beyond_m() > swing_m
            && by_itself == Some(true)
            && idle
            && context.controller.is_some()
            && !context.termination.holds
            && self.is_no_landing(&sample);
        if let (Some(Held::Commanded(_)), Some(false)) = (self.held, by_itself) {
            self.held = Some(Held::Shown);
        }
        let now = context.mono();
        let due = match self.held {
            None => true,
            Some(Held::Commanded(at)) => now >= at + AGAIN,
            Some(Held::Shown) => false,
        };
        let first = acts && self.held.is_none();
        if acts && due {
            self.held = Some(Held::Commanded(now));
            effects.request(Request::Hold);
        }
        let end = if first { "; commanding hold" } else { "" };
        let text = format!(
            "the vehicle left its altitude band of {lowest_m:.0} to {highest_m:.0} m above home (vehicle.limits): it was at \
             {height_m:.0} m{end}"
        );
        // One text for each direction, and another when it is held: an alert with the current height would be a stream.
        if !self.outside || first {
            self.outside = true;
            let (priority, about) = (AlertPriority::Warning, SubsystemId::VsmStatus);
            effects.raise(Cause::AltitudeBand, priority, about, text);
        }
    }

    /// Whether it is outside.
    fn judge(&mut self, sample: &Sample) -> bool {
        self.entered |= sample.height_m >= sample.lowest_m;
        let beyond_m = sample.beyond_m();
        // Cleared only well inside: a measured altitude at the limit fluctuates.
        let edge_m = if self.outside { 0.0 } else { NOISE_M };
        let outside = self.entered && beyond_m > edge_m;
        if !outside {
            (self.outside, self.held) = (false, None);
        }
        self.below_s = match outside && sample.height_m < sample.lowest_m {
            true => self.below_s.or(sample.time_s),
            false => None,
        };
        outside
    }

    /// Whether a hold would not interrupt a landing.
    fn is_no_landing(&self, sample: &Sample) -> bool {
        if sample.height_m > sample.highest_m || !sample.in_mission {
            return true;
        }
        let times = (self.below_s, sample.time_s, sample.route_named_s);
        let (Some(below_s), Some(time_s), Some(named_s)) = times else {
            return false;
        };
        // The MISSION_CURRENT at the start of a landing may have been lost, so the item must have been reported since, and
        // recently.
        named_s >= below_s && time_s - named_s <= FRESH_S
    }
}

fn sample(context: &Context<'_>, uploaded: Option<&UploadedMission>) -> Option<Sample> {
    let telemetry = &context.vehicle.telemetry;
    let limits = context.parameters.limits(context);
    let lands = uploaded.is_some_and(|uploaded| uploaded.lands(telemetry));
    let descends = matches!(telemetry.mode, Some(Px4Mode::LAND | Px4Mode::RTL));
    Some(Sample {
        height_m: telemetry.position?.amsl_m - telemetry.home?.amsl_m,
        lowest_m: limits.floor_m(),
        highest_m: limits.highest_m,
        descends: lands || descends,
        time_s: context.vehicle.boot_ms().map(seconds),
        in_mission: telemetry.mode == Some(Px4Mode::MISSION),
        route_named_s: uploaded
            .filter(|uploaded| !lands && flown(context, uploaded).is_some())
            .and_then(|_| context.vehicle.progress_boot_ms())
            .map(seconds),
    })
}

/// Automatic modes that are not already a hold or a return.
const BY_ITSELF: [Px4Mode; 4] = [
    Px4Mode::MISSION,
    Px4Mode::OFFBOARD,
    Px4Mode::ORBIT,
    Px4Mode::COURSE,
];
/// Accuracy of a measured altitude, m.
const NOISE_M: f64 = 1.0;
/// PX4's own oscillation about an altitude, for a multicopter and for a fixed wing (`descent`), m.
const HOVERING_M: f64 = 5.0;
const WINGS_M: f64 = 20.0;
/// Time after which a hold that is not reported is commanded again.
const AGAIN: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use mapping::telemetry::Place;

    use super::*;
    use crate::session::context::FlightView;
    use crate::session::testing::World;

    fn at(height_m: f64) -> Sample {
        Sample {
            height_m,
            lowest_m: 30.0,
            highest_m: 120.0,
            descends: false,
            time_s: Some(10.0),
            in_mission: false,
            route_named_s: None,
        }
    }

    #[test]
    fn a_climb_into_the_band_and_a_landing_out_of_it_are_no_way_out() {
        let mut watch = BandWatch::default();
        let mut judge = |sample| {
            let outside = watch.judge(&sample);
            watch.outside = outside;
            outside
        };
        assert!(!judge(at(2.0)), "a take-off");
        assert!(!judge(at(60.0)));
        assert!(!judge(at(29.5)), "noise");
        assert!(judge(at(28.0)));
        assert!(judge(at(29.5)), "at the edge");
        assert!(!judge(at(31.0)));
        let landing = |height_m| Sample {
            descends: true,
            ..at(height_m)
        };
        assert!(!judge(landing(10.0)));
        assert!(judge(landing(125.0)), "a return above the ceiling");
    }
    #[test]
    fn a_mission_below_the_floor_is_held_only_where_its_item_is_known_and_fresh() {
        let in_mission = |time_s, route_named_s| Sample {
            time_s: Some(time_s),
            in_mission: true,
            route_named_s,
            ..at(10.0)
        };
        for (route_named_s, expected) in [
            (None, false),       // unknown, another station's, or a landing
            (Some(9.5), false),  // not named since it is below: a landing may have begun
            (Some(11.0), false), // no longer fresh
            (Some(19.0), true),
        ] {
            let mut watch = BandWatch::default();
            watch.judge(&at(60.0));
            assert!(watch.judge(&in_mission(10.0, Some(10.0))));
            let later = in_mission(20.0, route_named_s);
            assert!(watch.judge(&later));
            assert_eq!(watch.is_no_landing(&later), expected, "{route_named_s:?}");
        }
        let mut watch = BandWatch::default();
        watch.judge(&at(60.0));
        assert!(watch.judge(&at(10.0)));
        assert!(watch.is_no_landing(&at(10.0)), "no mission is flown");
    }

    /// Well above its ceiling, in this mode, with a hold configured.
    fn above(mode: Px4Mode) -> World {
        let mut world = World::airborne(mode);
        world.bounds.outside = Outside::Hold;
        let highest_m = world.bounds.limits.highest_m;
        let home = world.vehicle.telemetry.home.expect("a home");
        world.vehicle.telemetry.position = Some(Place {
            amsl_m: home.amsl_m + highest_m + 50.0,
            ..home
        });
        world
    }

    /// Whether a look commands a hold.
    fn looks(world: &mut World, watch: &mut BandWatch, transferring: bool, loss: bool) -> bool {
        world.requests.clear();
        world.act(|common, views, effects| {
            let context = Context {
                common,
                flight: FlightView {
                    loss_action: loss,
                    ..views.flight
                },
                parameters: views.parameters,
                rights: views.rights,
            };
            watch.watch(&context, None, transferring, effects);
        });
        assert!(watch.outside());
        let mut requests = world.requests.iter();
        requests.any(|request| matches!(request, Request::Hold))
    }

    #[test]
    fn nothing_that_is_under_way_is_superseded_and_no_vehicle_without_a_controller_is_held() {
        let held = |change: fn(&mut World), transferring, loss| {
            let mut world = above(Px4Mode::MISSION);
            change(&mut world);
            looks(&mut world, &mut BandWatch::default(), transferring, loss)
        };
        assert!(held(|_| {}, false, false));
        assert!(!held(|_| {}, true, false), "an upload");
        assert!(!held(|_| {}, false, true), "the loss action");
        assert!(!held(|world| world.maneuver = true, false, false));
        assert!(!held(|world| world.controller = None, false, false));
        assert!(!held(|world| world.termination.holds = true, false, false));
        assert!(
            !held(World::command_was_sent, false, false),
            "an older mode"
        );
    }

    #[test]
    fn a_hold_that_is_not_shown_is_commanded_again_and_one_that_was_is_not() {
        let (mut world, mut watch) = (above(Px4Mode::MISSION), BandWatch::default());
        assert!(looks(&mut world, &mut watch, false, false));
        for (wait_s, expected) in [(9, false), (2, true), (1, false)] {
            world.advance(Duration::from_secs(wait_s));
            assert_eq!(looks(&mut world, &mut watch, false, false), expected);
        }
        world.show_mode(Px4Mode::LOITER);
        assert!(!looks(&mut world, &mut watch, false, false));
        // Resumed by its operator.
        world.show_mode(Px4Mode::MISSION);
        world.advance(Duration::from_secs(20));
        assert!(!looks(&mut world, &mut watch, false, false));
    }
}
