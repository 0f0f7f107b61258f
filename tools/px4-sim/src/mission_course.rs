//! Where an item leads: its place, the next one, jumps, and the guidance to fly there.

use mavlink_link::service::mission::Item;

use super::attitude::GRAVITY;
use super::config::Airframe;
use super::geo::{Geodetic, Ned};
use super::guidance::{Guidance, Heading};
use super::mission::{Mission, Work};
use super::params::Param;
use super::trajectory::Leg;
use super::view::{View, loiter};

impl Mission {
    pub(super) fn guide(&self, view: &View<'_>) -> (Guidance, Heading) {
        let speed = self.speed.unwrap_or_else(|| view.cruise());
        let acceptance = view.acceptance();
        if let Some(hold) = self.hold {
            return (loiter(hold, view), Heading::Hold);
        }
        let item = self.items.get(self.index).filter(|_| self.running);
        let Some(item) = item else {
            let here = if view.landed {
                Guidance::Ground
            } else {
                loiter(view.position, view)
            };
            return (here, Heading::Hold);
        };
        let yaw = f64::from(item.params[3]);
        let heading =
            if yaw.is_finite() && is_place_command(item.command) && item.command != TAKEOFF {
                Heading::To(yaw.to_radians())
            } else {
                Heading::Along
            };
        match self.work {
            Work::Climb(top) => {
                let leg = Leg::to(top, acceptance, speed);
                (
                    if view.landed || view.home.d - view.position.d < 10.0 {
                        Guidance::Climb(leg)
                    } else {
                        Guidance::Leg(leg)
                    },
                    Heading::Hold,
                )
            }
            Work::ToLand(height) => {
                let over = Ned {
                    d: height,
                    ..self.target(item, view)
                };
                (
                    Guidance::Leg(Leg {
                        from: self.from,
                        target: over,
                        next: over,
                        acceptance,
                        speed,
                    }),
                    heading,
                )
            }
            Work::Landing => (
                Guidance::Land(Leg::to(self.target(item, view), acceptance, speed)),
                Heading::Hold,
            ),
            Work::Item => (self.along(item, view, speed), heading),
        }
    }

    pub(super) fn along(&self, item: &Item, view: &View<'_>, speed: f64) -> Guidance {
        let Some(target) = self.place_from(self.index, view) else {
            return loiter(view.position, view);
        };
        let stays = matches!(item.command, LOITER_UNLIM | LOITER_TIME | LOITER_TO_ALT);
        if view.airframe == Airframe::Plane
            && (stays || self.reached_at.is_some() && hold_time(item) > 0.0)
        {
            return Guidance::Circle {
                centre: target,
                radius: loiter_radius(item, view),
                speed,
                altitude_d: target.d,
            };
        }
        let own = f64::from(item.params[1]);
        let uses_own = item.command == WAYPOINT
            && own.is_finite()
            && own > 0.0
            && view.airframe == Airframe::Quad;
        let acceptance = if uses_own { own } else { view.acceptance() };
        let brakes = stays || !item.autocontinue || hold_time(item) > 0.0;
        let next = if brakes { None } else { self.place_after(view) };
        Guidance::Leg(Leg {
            from: self.from,
            target,
            next: next.unwrap_or(target),
            acceptance,
            speed,
        })
    }

    /// The place of the first item at or after `index` that has one.
    pub(super) fn place_from(&self, index: usize, view: &View<'_>) -> Option<Ned> {
        self.place_index(index)
            .map(|i| self.target(&self.items[i], view))
    }

    pub(super) fn place_after(&self, view: &View<'_>) -> Option<Ned> {
        let here = self.place_index(self.index)?;
        let next = self.place_index(here + 1)?;
        let target = self.target(&self.items[next], view);
        // PX4 flies to a landing point at the height it comes from.
        Some(if self.items[next].command == LAND {
            Ned {
                d: self.target(&self.items[here], view).d,
                ..target
            }
        } else {
            target
        })
    }

    /// Follows jumps as they would be taken, without taking them.
    pub(super) fn place_index(&self, mut index: usize) -> Option<usize> {
        for _ in 0..=self.items.len() {
            let item = self.items.get(index)?;
            if has_place(item) {
                return Some(index);
            }
            index = match self.jump_target(index) {
                Some(to) => to,
                None => index + 1,
            };
        }
        None
    }

    pub(super) fn jump_target(&self, index: usize) -> Option<usize> {
        let item = self.items.get(index).filter(|i| i.command == JUMP)?;
        let repeats = item.params[1];
        let left = repeats < 0.0
            || f64::from(self.jumps.get(index).copied().unwrap_or(0)) < f64::from(repeats);
        let to = item.params[0];
        (left && to >= 0.0 && (to as usize) < self.items.len()).then_some(to as usize)
    }

    /// The item to go on with at `index`, jumps taken.
    pub(super) fn next_index(&mut self, mut index: usize, take: bool) -> Option<usize> {
        for _ in 0..=self.items.len() {
            let item = self.items.get(index)?;
            if item.command != JUMP {
                return Some(index);
            }
            index = match self.jump_target(index) {
                Some(to) => {
                    if take && let Some(count) = self.jumps.get_mut(index) {
                        *count = count.saturating_add(1);
                    }
                    to
                }
                None => index + 1,
            };
        }
        None
    }

    pub(super) fn target(&self, item: &Item, view: &View<'_>) -> Ned {
        let altitude_m = self.altitude(item, view);
        // INT32_MAX and 0/0 are no place: PX4 takes the place where it is.
        if item.x == i32::MAX || item.y == i32::MAX {
            return Ned {
                d: view.frame.origin().altitude_m - altitude_m,
                ..view.position
            };
        }
        view.frame.to_local(Geodetic {
            latitude_deg: f64::from(item.x) * 1e-7,
            longitude_deg: f64::from(item.y) * 1e-7,
            altitude_m,
        })
    }

    /// AMSL, m.
    pub(super) fn altitude(&self, item: &Item, view: &View<'_>) -> f64 {
        let z = f64::from(item.z);
        let relative = matches!(item.frame, 3 | 6);
        let home = view.frame.origin().altitude_m - view.home.d;
        match (z.is_finite(), relative) {
            (true, true) => home + z,
            (true, false) => z,
            (false, _) => view.frame.origin().altitude_m - view.position.d,
        }
    }
}

pub(super) fn hold_time(item: &Item) -> f64 {
    match item.command {
        WAYPOINT | LOITER_TIME => f64::from(item.params[0]).max(0.0),
        _ => 0.0,
    }
}

pub(super) fn loiter_radius(item: &Item, view: &View<'_>) -> f64 {
    let own = f64::from(if item.command == LOITER_TO_ALT {
        item.params[1]
    } else {
        item.params[2]
    });
    if own.is_finite() && own.abs() > 1e-6 {
        own
    } else {
        view.params.get(Param::NAV_LOITER_RAD)
    }
}

/// How early a plane turns: the tangent of its turn circle, at least the acceptance radius.
pub(super) fn turn_switch_distance(view: &View<'_>) -> f64 {
    let bank = view.params.get(Param::FW_R_LIM).to_radians().min(0.8);
    let radius = view.velocity.horizontal().powi(2) / (GRAVITY * bank.tan());
    view.acceptance().max(0.6 * radius)
}

pub(super) fn has_place(item: &Item) -> bool {
    is_place_command(item.command)
}

pub(super) fn is_place_command(command: u16) -> bool {
    matches!(
        command,
        WAYPOINT | LOITER_UNLIM | LOITER_TIME | LAND | TAKEOFF | LOITER_TO_ALT | 84 | 85
    )
}

pub(super) const WAYPOINT: u16 = 16;
pub(super) const LOITER_UNLIM: u16 = 17;
pub(super) const LOITER_TIME: u16 = 19;
pub(super) const RETURN_TO_LAUNCH: u16 = 20;
pub(super) const LAND: u16 = 21;
pub(super) const TAKEOFF: u16 = 22;
pub(super) const LOITER_TO_ALT: u16 = 31;
pub(super) const DELAY: u16 = 93;
pub(super) const JUMP: u16 = 177;
pub(super) const CHANGE_SPEED: u16 = 178;
