//! The altitude band: whether the vehicle itself is between `lowest_m` and `highest_m` of its limits (`vehicle.limits`).
//!
//! No fence item of MAVLink has a floor or a ceiling, and PX4's own fence has one ceiling (GF_MAX_VER_DIST, which narrows the
//! band) and no floor. Routes and commands that leave the band are refused before they are sent; here is the vehicle that
//! leaves it all the same, by a failsafe, a pilot or another station. An alert (16000) stands while it is outside, and with
//! `vehicle.limits.outside = "hold"` a vehicle that flies by itself is put on hold.
//!
//! Every flight begins and most end below the floor: below counts only a vehicle that was above it in this flight, and that
//! neither returns nor lands.

use mapping::mode::Px4Mode;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::input::Context;
use super::record::UploadedMission;
use super::watchdog::banks;
use crate::config::Outside;
use crate::session::alerts::Cause;
use crate::session::effects::{Effects, Request};

/// The machine.
#[derive(Debug, Default)]
pub(super) struct BandWatch {
    /// It was above the floor in this flight.
    entered: bool,
    /// It is outside.
    outside: bool,
    /// It was put on hold for that.
    held: bool,
}

/// What the vehicle shows, m above home.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    height_m: f64,
    lowest_m: f64,
    highest_m: f64,
    /// It lands, or returns to land.
    descends: bool,
}

impl Sample {
    /// How far outside the band it is, m; 0 and below within.
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
        effects: &mut Effects<'_>,
    ) {
        let telemetry = &context.vehicle.telemetry;
        if telemetry.landed.is_some() && !telemetry.airborne() {
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
        // A swing of a multicopter about its altitude, or of wings in a gust, is no reason to end what it flies.
        let swing_m = if banks(telemetry.vehicle_type) {
            WINGS_M
        } else {
            HOVERING_M
        };
        let acts = context.bounds.outside == Outside::Hold
            && sample.beyond_m() > swing_m
            && telemetry.mode.is_some_and(|mode| BY_ITSELF.contains(&mode))
            && !context.flight.maneuver;
        if acts && !self.held {
            self.held = true;
            effects.request(Request::Hold);
        }
        let end = if self.held { "; commanding hold" } else { "" };
        let text = format!(
            "the vehicle left its altitude band of {lowest_m:.0} to {highest_m:.0} m above home (vehicle.limits): it was at \
             {height_m:.0} m{end}"
        );
        // One text for each way out, and a further one where it is held: an alert that counts metres is a stream.
        if !self.outside || acts {
            self.outside = true;
            let (priority, about) = (AlertPriority::Warning, SubsystemId::VsmStatus);
            effects.raise(Cause::AltitudeBand, priority, about, text);
        }
    }

    /// Whether it is outside.
    fn judge(&mut self, sample: &Sample) -> bool {
        self.entered |= sample.height_m >= sample.lowest_m;
        let beyond_m = sample.beyond_m();
        // Back only where it is well within: an altitude measured at the edge flutters.
        let edge_m = if self.outside { 0.0 } else { NOISE_M };
        let outside = self.entered && beyond_m > edge_m;
        if !outside {
            (self.outside, self.held) = (false, false);
        }
        outside
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
    })
}

/// The modes that no pilot flies, and that neither hold nor return already.
const BY_ITSELF: [Px4Mode; 4] = [
    Px4Mode::MISSION,
    Px4Mode::OFFBOARD,
    Px4Mode::ORBIT,
    Px4Mode::COURSE,
];
/// An altitude is measured no better, m.
const NOISE_M: f64 = 1.0;
/// How far PX4 swings about an altitude by itself, of a multicopter and of wings (`descent`), m.
const HOVERING_M: f64 = 5.0;
const WINGS_M: f64 = 20.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn at(height_m: f64) -> Sample {
        Sample {
            height_m,
            lowest_m: 30.0,
            highest_m: 120.0,
            descends: false,
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
}
