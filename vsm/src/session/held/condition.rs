//! The conditions of held commands, and when they are met.
//!
//! Only fresh data of the vehicle counts. Passing a waypoint, or entering or leaving an area, needs a change: a command sent
//! while the vehicle is inside an area is not triggered by the vehicle being there already.

use std::time::Duration;

use mapping::area::{Area, Shape};
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::HoldCondition;
use stanag_msgs::messages::HoldCommand;

use super::input::Context;
use crate::session::authority::rules::Silence;
use crate::session::station::GroundStation;

/// A condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum Condition {
    Time {
        /// In the record: milliseconds since 1970, by the clock of this VSM.
        at_ms: u64,
        /// By the monotonic clock.
        #[serde(skip)]
        at: Duration,
    },
    Waypoint {
        number: u16,
        /// Since the command was sent, the vehicle has flown to another waypoint, or to none.
        beside: bool,
    },
    Area {
        outline: Outline,
        entered: bool,
        /// Since the command was sent, the vehicle has been on the other side.
        beside: bool,
    },
    Battery {
        below: u8,
        #[serde(skip)]
        since: Option<Duration>,
    },
    LinkLost,
    /// The serial number of the other command.
    Done {
        serial: u32,
        number: u16,
    },
}

/// An area, as it was when the command was sent: degrees north and east, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum Outline {
    Circle { centre: (f64, f64), radius_m: f64 },
    Polygon(Vec<(f64, f64)>),
}

impl Outline {
    fn contains(&self, at: (f64, f64)) -> bool {
        let shape = match self {
            Outline::Circle { centre, radius_m } => Shape::Circle {
                centre: *centre,
                radius_m: *radius_m,
            },
            Outline::Polygon(corners) => Shape::Polygon(corners.clone()),
        };
        let keep_in = true;
        Area { keep_in, shape }.contains(at)
    }

    fn of(area: &Area) -> Outline {
        match &area.shape {
            Shape::Circle { centre, radius_m } => Outline::Circle {
                centre: *centre,
                radius_m: *radius_m,
            },
            Shape::Polygon(corners) => Outline::Polygon(corners.clone()),
        }
    }
}

/// The result of checking a condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// Not met, unchanged.
    Waits,
    /// Not met, but a part of it is, which must be stored.
    Nearer,
    Met,
}

impl Condition {
    /// Reads the condition of a 50020. `serial_of` returns the serial number of another held command of this CUCS.
    ///
    /// # Errors
    /// A field is missing or out of range.
    pub(super) fn of(
        command: &HoldCommand,
        context: &Context<'_>,
        serial_of: impl Fn(u16) -> Option<u32>,
    ) -> Result<Condition, String> {
        let number = || {
            let given = command.condition_number.filter(|number| *number != 0);
            given.ok_or_else(|| "Condition Number is missing".to_owned())
        };
        match command.hold_condition {
            None => Err("Hold Condition is missing".to_owned()),
            Some(HoldCondition::Time) => time(command, context),
            Some(HoldCondition::WaypointPassed) => Ok(Condition::Waypoint {
                number: number()?,
                beside: false,
            }),
            Some(condition @ (HoldCondition::AreaEntered | HoldCondition::AreaLeft)) => {
                Ok(Condition::Area {
                    outline: match circle(command)? {
                        Some(circle) => circle,
                        None => stored(number()?, context)?,
                    },
                    entered: condition == HoldCondition::AreaEntered,
                    beside: false,
                })
            }
            Some(HoldCondition::BatteryBelow) => match command.condition_percent {
                Some(below @ 1..=100) => Ok(Condition::Battery { below, since: None }),
                Some(other) => Err(format!("Condition Percent {other}, expected 1 to 100")),
                None => Err("Condition Percent is missing".to_owned()),
            },
            Some(HoldCondition::LinkLost) => Ok(Condition::LinkLost),
            Some(HoldCondition::CommandDone) => {
                let number = number()?;
                let serial = serial_of(number)
                    .ok_or_else(|| format!("no held command {number} of this CUCS"))?;
                Ok(Condition::Done { serial, number })
            }
            Some(HoldCondition::Unknown(value)) => {
                Err(format!("Hold Condition {value}, expected 1 to 7"))
            }
        }
    }

    /// The condition as reported by 50022.
    pub(super) fn reported(&self) -> HoldCondition {
        match self {
            Condition::Time { .. } => HoldCondition::Time,
            Condition::Waypoint { .. } => HoldCondition::WaypointPassed,
            Condition::Area { entered: true, .. } => HoldCondition::AreaEntered,
            Condition::Area { entered: false, .. } => HoldCondition::AreaLeft,
            Condition::Battery { .. } => HoldCondition::BatteryBelow,
            Condition::LinkLost => HoldCondition::LinkLost,
            Condition::Done { .. } => HoldCondition::CommandDone,
        }
    }

    /// Checks whether it is met now. `owner` is the sender of the command. The caller checks [`Condition::Done`].
    pub(super) fn look(&mut self, context: &Context<'_>, owner: &GroundStation) -> Look {
        let (now, vehicle) = (context.mono(), context.vehicle);
        let telemetry = &vehicle.telemetry;
        // The last report of a silent vehicle may no longer hold.
        let live = vehicle.live();
        match self {
            Condition::Time { at, .. } => met(*at <= now),
            Condition::Waypoint { number, beside } => {
                let (Some(uploaded), true) = (context.mission.uploaded, live) else {
                    return Look::Waits;
                };
                let compiled = &uploaded.compiled;
                let from = context.mission.progress.along(compiled, telemetry).from;
                let last = from.and_then(|leg| compiled.order.get(leg));
                let there = last.is_some_and(|leg| leg.number == *number);
                change(there, beside)
            }
            Condition::Area {
                outline,
                entered,
                beside,
            } => match telemetry.position.filter(|_| live) {
                Some(at) => {
                    let inside = outline.contains((at.latitude, at.longitude));
                    change(inside == *entered, beside)
                }
                None => Look::Waits,
            },
            Condition::Battery { below, since } => {
                let low = telemetry.battery.is_some_and(|left| left < *below);
                if !(live && low) {
                    *since = None;
                    return Look::Waits;
                }
                // A single report that the next one does not confirm is ignored.
                met(now >= *since.get_or_insert(now) + BATTERY_LASTS)
            }
            // Silence alone does not meet it: until its control has ended, the end of that control would end what is begun.
            Condition::LinkLost => {
                let limits = &context.settings.authority;
                let commands = context.rights.commands(owner.id());
                met(!commands && owner.silence(now, limits) == Silence::Lost)
            }
            Condition::Done { .. } => Look::Waits,
        }
    }

    /// The bridge did not run for so long: nothing has lasted by that.
    pub(super) fn note_stop(&mut self, stopped: Duration) {
        if let Condition::Battery {
            since: Some(since), ..
        } = self
        {
            *since += stopped;
        }
    }

    /// When time alone meets it, or requires another check.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        match self {
            Condition::Time { at, .. } => Some(*at),
            Condition::Battery { since, .. } => since.map(|since| since + BATTERY_LASTS),
            _ => None,
        }
    }
}

fn met(so: bool) -> Look {
    if so { Look::Met } else { Look::Waits }
}

fn change(there: bool, beside: &mut bool) -> Look {
    match (there, *beside) {
        (true, true) => Look::Met,
        (true, false) | (false, true) => Look::Waits,
        (false, false) => {
            *beside = true;
            Look::Nearer
        }
    }
}

/// Condition Time is by the station's clock, so only its distance from the message's Time Stamp counts; the two clocks may
/// differ.
fn time(command: &HoldCommand, context: &Context<'_>) -> Result<Condition, String> {
    let (at, stamp) = command
        .condition_time
        .zip(command.time_stamp)
        .ok_or("Condition Time is missing")?;
    let after_ms = (at.0.checked_sub(stamp.0)).ok_or("Condition Time is before Time Stamp")?;
    let valid_ms = u64::from(command.valid_for.unwrap_or(0)) * 1_000;
    if after_ms >= valid_ms {
        return Err(format!(
            "Condition Time is {} s after Time Stamp, and Valid For ends before",
            after_ms / 1_000
        ));
    }
    let after = Duration::from_millis(after_ms);
    Ok(Condition::Time {
        at_ms: 0,
        at: context.mono() + after,
    })
}

fn circle(command: &HoldCommand) -> Result<Option<Outline>, String> {
    let place = (command.condition_latitude, command.condition_longitude);
    match (place, command.condition_radius) {
        ((None, None), None) => Ok(None),
        ((Some(latitude), Some(longitude)), Some(radius)) => {
            let latitude = latitude.degrees();
            let radius_m = f64::from(radius);
            if !(-90.0..=90.0).contains(&latitude) {
                return Err(format!(
                    "Condition Latitude {latitude:.4} deg, expected -90 to 90"
                ));
            }
            // Written so that NaN fails too: any comparison with NaN is false.
            if !(radius_m > 0.0 && radius_m <= WIDEST_M) {
                return Err(format!(
                    "Condition Radius {radius_m} m, expected above 0 to 100000"
                ));
            }
            Ok(Some(Outline::Circle {
                centre: (latitude, longitude.degrees()),
                radius_m,
            }))
        }
        _ => Err("a circle needs Condition Latitude, Longitude and Radius".to_owned()),
    }
}

/// An area that a CUCS has sent (50016).
fn stored(number: u16, context: &Context<'_>) -> Result<Outline, String> {
    let areas = context.mission.areas.whole();
    let areas = areas.map_err(|fault| fault.to_string())?;
    let found = areas.iter().find(|(id, _)| *id == number);
    let (_, area) = found.ok_or_else(|| format!("no area {number} has been received (50016)"))?;
    Ok(Outline::of(area))
}

/// How long low energy must be reported, as for an alert.
const BATTERY_LASTS: Duration = Duration::from_millis(1_500);
const WIDEST_M: f64 = 1e5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_battery_has_not_lasted_while_the_bridge_did_not_run() {
        let (seen, stopped) = (Duration::from_secs(1), Duration::from_secs(60));
        let mut condition = Condition::Battery {
            below: 30,
            since: Some(seen),
        };
        condition.note_stop(stopped);
        let due = seen + stopped + BATTERY_LASTS;
        assert_eq!(condition.poll_timeout(), Some(due));
    }
}
