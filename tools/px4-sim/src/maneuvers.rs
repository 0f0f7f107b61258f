//! Commands that say where to go.

use mavlink::dialects::development::MavSeverity;

use super::command::Command;
use super::config::Airframe;
use super::dispatch::Answer;
use super::geo::{Geodetic, Ned};
use super::mode::Mode;
use super::navigator::{Orbit, Reposition};
use super::vehicle::Vehicle;

impl Vehicle {
    pub(super) fn reposition(&mut self, c: &Command) -> Answer {
        let change_mode = c.param(2) as i64 & 1 == 1;
        let holding = self.commander.mode() == Mode::Loiter;
        let answer = if change_mode {
            self.switch(Mode::Loiter, None)
        } else if holding {
            Answer::Accepted
        } else {
            Answer::Denied
        };
        // Disarmed, the place is not kept: a later switch to hold must not fly there.
        if answer == Answer::Accepted && self.commander.is_armed() {
            let target = self.local_target_of(c);
            let wish = Reposition {
                target,
                yaw: c.param(4),
                speed: c.given(1).filter(|s| *s > 0.0),
                radius: c.given(3).filter(|r| r.abs() > 1e-6),
            };
            self.navigate(|nav, view| nav.set_reposition(wish, view));
        }
        answer
    }

    pub(super) fn change_altitude(&mut self, c: &Command) -> Answer {
        if self.commander.mode() != Mode::Loiter {
            return Answer::TemporarilyRejected;
        }
        if self.commander.is_armed() {
            let d = self.frame.origin().altitude_m - c.param(1);
            let target = Ned::new(f64::NAN, f64::NAN, d);
            let wish = Reposition {
                target,
                yaw: f64::NAN,
                speed: None,
                radius: None,
            };
            self.navigate(|nav, view| nav.set_reposition(wish, view));
        }
        Answer::Accepted
    }

    pub(super) fn orbit(&mut self, c: &Command) -> Answer {
        if self.config.airframe == Airframe::Plane {
            let wish = Reposition {
                target: self.local_target_of(c),
                yaw: f64::NAN,
                speed: None,
                radius: c.given(1),
            };
            if !self.request(Mode::Loiter, false) {
                self.critical("Orbit command rejected");
                return Answer::TemporarilyRejected;
            }
            if self.commander.is_armed() {
                self.navigate(|nav, view| nav.set_reposition(wish, view));
            }
            return Answer::Accepted;
        }
        if !self.request(Mode::Orbit, false) {
            self.texts
                .say(MavSeverity::MAV_SEVERITY_CRITICAL, "Orbit command rejected");
            return Answer::TemporarilyRejected;
        }
        let target = self.local_target_of(c);
        let here = self.believed();
        let or = |v: f64, other: f64| if v.is_finite() { v } else { other };
        let radius = c.given(1).unwrap_or(1.0);
        if !(1.0..=1000.0).contains(&radius.abs()) {
            self.critical("Orbit radius limit exceeded");
            return Answer::Accepted;
        }
        // No more than 2 m/s2 toward the centre.
        let speed = c
            .given(2)
            .unwrap_or(1.0)
            .abs()
            .min((2.0 * radius.abs()).sqrt());
        self.navigator.set_orbit(Orbit {
            centre: Ned::new(
                or(target.n, here.n),
                or(target.e, here.e),
                or(target.d, here.d),
            ),
            radius: if c.given(2).unwrap_or(1.0) < 0.0 {
                -radius
            } else {
                radius
            },
            speed,
        });
        Answer::Accepted
    }

    /// param5 to param7 in the local frame, NaN where not given. The altitude is AMSL, whatever
    /// frame a COMMAND_INT names.
    pub(super) fn local_target_of(&self, c: &Command) -> Ned {
        let d = self.frame.origin().altitude_m - c.param(7);
        match (c.given(5), c.given(6)) {
            (Some(latitude_deg), Some(longitude_deg)) => {
                let at = self.frame.to_local(Geodetic {
                    latitude_deg,
                    longitude_deg,
                    altitude_m: 0.0,
                });
                Ned { d, ..at }
            }
            _ => Ned::new(f64::NAN, f64::NAN, d),
        }
    }

    pub(super) fn change_speed(&mut self, c: &Command) -> Answer {
        let speed = c.given(2).filter(|s| *s > 0.0);
        self.navigator.set_speed(speed);
        Answer::Accepted
    }

    pub(super) fn set_home_here(&mut self, c: &Command) -> Answer {
        if c.param(1) > 0.5 {
            self.set_home();
            return Answer::Accepted;
        }
        match (c.given(5), c.given(6), c.given(7)) {
            (Some(latitude_deg), Some(longitude_deg), Some(altitude_m)) => {
                self.set_home();
                self.home = Some(self.frame.to_local(Geodetic {
                    latitude_deg,
                    longitude_deg,
                    altitude_m,
                }));
                Answer::Accepted
            }
            _ => Answer::Denied,
        }
    }

    pub(super) fn terminate(&mut self, c: &Command) -> Answer {
        if c.param(1) > 0.5 && self.commander.is_armed() {
            self.request(Mode::Termination, true);
            return Answer::Accepted;
        }
        Answer::Denied
    }
}
