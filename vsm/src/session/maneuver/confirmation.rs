//! What the vehicle must show before a step counts as done.

use mapping::limits::metres;
use mapping::mode::Px4Mode;
use mapping::telemetry::{Orbit, Place, Telemetry};

use crate::session::link::state::VehicleState;

/// What the vehicle must show.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Confirmation {
    /// One of these modes.
    Mode(&'static [Px4Mode]),
    /// Motors armed.
    Armed,
    /// Motors disarmed.
    Disarmed,
    /// Off the ground.
    OffTheGround,
    /// It flies this circle: centre, radius, negative counter-clockwise, and its altitude where only that is another one.
    Orbit {
        centre: (f64, f64),
        radius_m: f64,
        climb: Option<Climb>,
    },
    /// It flies about as fast as this, m/s over ground.
    Speed(f64),
    /// It flies about this course over ground, rad from true north.
    Course(f64),
    /// A VTOL flies on its wings, or hovers.
    Hovers(bool),
    /// It flies to this place, or to this altitude only.
    Target {
        place: Option<(f64, f64)>,
        amsl_m: Option<f64>,
    },
    /// It stays where it is, hovering or on a circle of this radius, m.
    Stays { circle_m: f64 },
}

/// A commanded altitude, and that of the circle flown before, m above mean sea level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Climb {
    pub(crate) from_m: f64,
    pub(crate) to_m: f64,
}

impl Climb {
    /// The climb that shows the command of this circle where the vehicle flies it already, at another altitude.
    ///
    /// `None` for any other circle: its centre and radius are in the report only once it is commanded. Its altitude would be a
    /// wrong refusal: on the way there PX4 climbs in proportion to the distance (PositionSmoothing), so that 5 m more take a
    /// minute where the circle is 400 m away.
    pub(crate) fn on_the_same(
        flown: Option<Orbit>,
        here: (f64, f64),
        centre: (f64, f64),
        radius_m: f64,
        to_m: f64,
    ) -> Option<Climb> {
        let flown = flown.filter(|orbit| is_circle(orbit, centre, radius_m))?;
        let on_it = (metres(centre, here) - radius_m.abs()).abs() < ON_IT_M;
        // The set point, not the vehicle's altitude: a vehicle that sags 2 m below it would seem to have begun its climb.
        let from_m = flown.centre.amsl_m;
        on_it.then_some(Climb { from_m, to_m })
    }

    /// Whether a set point of this altitude shows it: there, or on its way.
    ///
    /// While a multicopter approaches its circle, PX4 reports the altitude that it is set to at that moment, which reaches
    /// the commanded one only at the end (FlightTaskOrbit): waiting for that could take minutes.
    fn is_shown_by(self, amsl_m: f64) -> bool {
        let (all, left) = (self.to_m - self.from_m, self.to_m - amsl_m);
        left.abs() < TARGET_SLACK_M || left.abs() + BEGUN_M < all.abs()
    }
}

fn is_circle(flown: &Orbit, centre: (f64, f64), radius_m: f64) -> bool {
    let place = (flown.centre.latitude, flown.centre.longitude);
    metres(centre, place) < TARGET_SLACK_M && (flown.radius_m - radius_m).abs() < RADIUS_SLACK_M
}

impl Confirmation {
    /// Whether the vehicle shows it. A mode and the arming state count only in a message made after the last command.
    pub(super) fn is_seen(&self, vehicle: &VehicleState) -> bool {
        let telemetry = &vehicle.telemetry;
        match self {
            Confirmation::Mode(modes) => {
                // A report from before the command proves nothing, even if it shows the right mode.
                vehicle.state_is_newer_than_command()
                    && telemetry.mode.is_some_and(|mode| modes.contains(&mode))
            }
            Confirmation::Armed => {
                vehicle.state_is_newer_than_command() && telemetry.armed == Some(true)
            }
            Confirmation::Disarmed => {
                vehicle.state_is_newer_than_command() && telemetry.armed == Some(false)
            }
            Confirmation::OffTheGround => telemetry.airborne(),
            // PX4 accepts circles that it then does not fly: ORBIT_EXECUTION_STATUS shows the one that is flown.
            Confirmation::Orbit {
                centre,
                radius_m,
                climb,
            } => telemetry.orbit.is_some_and(|orbit| {
                is_circle(&orbit, *centre, *radius_m)
                    // The same circle at another altitude is another one.
                    && climb.is_none_or(|climb| climb.is_shown_by(orbit.centre.amsl_m))
            }),
            Confirmation::Speed(wanted) => telemetry
                .groundspeed
                .is_some_and(|flown| (flown - wanted).abs() < speed_slack(*wanted)),
            Confirmation::Course(wanted) => course(telemetry).is_some_and(|flown| {
                // By sine and cosine, so that north (0 and 2 pi) needs no special case.
                (flown - wanted).sin().abs() < COURSE_SLACK.sin() && (flown - wanted).cos() > 0.0
            }),
            Confirmation::Hovers(wanted) => !telemetry.transits() && telemetry.hovers() == *wanted,
            // The set point is compared, not the position: the flight there may take minutes.
            Confirmation::Target { place, amsl_m } => {
                telemetry.target.is_some_and(|target: Place| {
                    let there = place.is_none_or(|place| {
                        metres(place, (target.latitude, target.longitude)) < TARGET_SLACK_M
                    });
                    there
                        && amsl_m
                            .is_none_or(|wanted| (wanted - target.amsl_m).abs() < TARGET_SLACK_M)
                })
            }
            Confirmation::Stays { circle_m } => {
                Away::of(telemetry, *circle_m).is_some_and(|away| away.is_braked(telemetry))
            }
        }
    }

    /// What has not been seen, for the operator.
    pub(super) fn awaited(&self, vehicle: &VehicleState) -> String {
        match self {
            // An older report may already show this mode: "not AUTO.LOITER, it is in AUTO.LOITER" would explain nothing.
            Confirmation::Mode(modes) if !vehicle.state_is_newer_than_command() => {
                let wanted = modes.first().map_or("", |mode| mode.name());
                format!("{wanted}: it has not reported its mode since the command")
            }
            Confirmation::Mode(modes) => {
                let wanted = modes.first().map_or("", |mode| mode.name());
                let present = vehicle.telemetry.mode.map_or("no mode", Px4Mode::name);
                format!("{wanted}, it is in {present}")
            }
            Confirmation::Armed => "armed motors".to_owned(),
            Confirmation::Disarmed => "disarmed motors".to_owned(),
            Confirmation::OffTheGround => "that it has left the ground".to_owned(),
            Confirmation::Orbit { climb, .. } => {
                let level = climb.map(|climb| format!(" at {:.0} m above sea level", climb.to_m));
                let level = level.unwrap_or_default();
                format!("that it flies the commanded circle{level}")
            }
            Confirmation::Speed(wanted) => {
                let flown = vehicle.telemetry.groundspeed.unwrap_or(0.0);
                format!("{wanted:.1} m/s, it flies {flown:.1}")
            }
            Confirmation::Course(wanted) => {
                let flown = course(&vehicle.telemetry).unwrap_or(0.0);
                format!(
                    "a course of {:.0} deg, it flies {:.0}",
                    wanted.to_degrees().rem_euclid(360.0),
                    flown.to_degrees().rem_euclid(360.0)
                )
            }
            Confirmation::Hovers(true) => "that it hovers".to_owned(),
            Confirmation::Hovers(false) => "that it flies on its wings".to_owned(),
            Confirmation::Target { .. } => "that it flies to the commanded place".to_owned(),
            Confirmation::Stays { .. } => "that it stays where it is".to_owned(),
        }
    }
}

/// How much further a vehicle flies until it hovers or circles, m: what one that does so is off by is not counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Away {
    pub(crate) ground_m: f64,
    pub(crate) height_m: f64,
}

impl Away {
    /// By its set point; `None` where it has not reported that and its position. `circle_m`: the radius of its circle, 0 for a hover.
    pub(crate) fn of(telemetry: &Telemetry, circle_m: f64) -> Option<Away> {
        let (target, here) = telemetry.target.zip(telemetry.position)?;
        let place = |at: Place| (at.latitude, at.longitude);
        let (near_m, level_m) = if circle_m > 0.0 {
            (2.0 * circle_m + CIRCLE_SLACK_M, CIRCLE_LEVEL_M)
        } else {
            (HOVER_SLACK_M, HOVER_LEVEL_M)
        };
        Some(Away {
            ground_m: (metres(place(target), place(here)) - near_m).max(0.0),
            height_m: ((target.amsl_m - here.amsl_m).abs() - level_m).max(0.0),
        })
    }

    /// Whether it is no further than a vehicle flies that brakes.
    fn is_braked(self, telemetry: &Telemetry) -> bool {
        let [north, east, down] = telemetry.velocity_ned.unwrap_or_default();
        self.ground_m <= BRAKES_WITHIN_S * north.hypot(east)
            && self.height_m <= BRAKES_WITHIN_S * down.abs()
    }
}

/// Course over ground, rad; `None` for a vehicle that hardly moves.
fn course(telemetry: &Telemetry) -> Option<f64> {
    let [north, east, _] = telemetry.velocity_ned?;
    (north.hypot(east) > SLOWEST_M_S).then(|| east.atan2(north))
}

/// Tolerance of a flown speed. On a circle PX4 lags behind its set point, by a sixth at 5 m/s on 30 m, and wind makes it
/// fluctuate.
fn speed_slack(speed_m_s: f64) -> f64 {
    (0.25 * speed_m_s).max(0.5)
}

/// Tolerance of the radius of a circle, m.
const RADIUS_SLACK_M: f64 = 0.5;
/// Tolerance of a course over ground, rad: gusts turn a small wing by more than a degree.
const COURSE_SLACK: f64 = 0.1;
/// Below this speed a course means nothing, m/s.
const SLOWEST_M_S: f64 = 2.0;
/// Tolerance of a set point, m.
const TARGET_SLACK_M: f64 = 2.0;
/// A vehicle hovers this near to its set point, over ground and in height, m.
const HOVER_SLACK_M: f64 = 5.0;
const HOVER_LEVEL_M: f64 = 3.0;
/// The same of wings on their circle, beyond its far side.
const CIRCLE_SLACK_M: f64 = 20.0;
const CIRCLE_LEVEL_M: f64 = 10.0;
/// A multicopter brakes from its highest speed in half of this time.
const BRAKES_WITHIN_S: f64 = 5.0;
/// A vehicle this near to a circle flies it, m.
const ON_IT_M: f64 = 5.0;
/// So much nearer to its altitude a climb or a descent has begun, m.
const BEGUN_M: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::testing::World;

    #[test]
    fn a_circle_at_another_altitude_is_not_the_commanded_one() {
        let mut vehicle = World::new().vehicle;
        let mut shown = |amsl_m: f64, climb: Option<Climb>| {
            vehicle.telemetry.orbit = Some(Orbit {
                centre: Place {
                    latitude: 47.4,
                    longitude: 8.5,
                    amsl_m,
                },
                radius_m: 30.0,
            });
            let circle = Confirmation::Orbit {
                centre: (47.4, 8.5),
                radius_m: 30.0,
                climb,
            };
            circle.is_seen(&vehicle)
        };
        let (from_m, to_m) = (500.0, 550.0);
        let climb = Some(Climb { from_m, to_m });
        assert!(!shown(500.0, climb), "it still flies the circle before");
        assert!(!shown(480.0, climb), "the other way");
        assert!(shown(502.0, climb), "on its way");
        assert!(shown(549.0, climb));
        assert!(!shown(600.0, climb), "above it");
        assert!(shown(600.0, None), "no altitude is commanded");
        let descent = Some(Climb {
            from_m: to_m,
            to_m: from_m,
        });
        assert!(!shown(550.0, descent));
        assert!(shown(548.0, descent));
    }

    #[test]
    fn only_the_circle_that_is_flown_already_is_shown_by_its_altitude() {
        let centre = (47.4, 8.5);
        let orbit = Orbit {
            centre: Place {
                latitude: centre.0,
                longitude: centre.1,
                amsl_m: 500.0,
            },
            radius_m: 30.0,
        };
        // 30 m and 400 m to the north.
        let (on_it, far) = ((47.400_27, 8.5), (47.403_6, 8.5));
        let climb = |flown, here, centre, radius_m| {
            Climb::on_the_same(flown, here, centre, radius_m, 505.0)
        };
        let (from_m, to_m) = (500.0, 505.0);
        let same = climb(Some(orbit), on_it, centre, 30.0);
        assert_eq!(same, Some(Climb { from_m, to_m }), "by its set point");
        // Of these PX4 shows centre and radius at once, and the altitude perhaps only after a minute.
        assert_eq!(climb(None, on_it, centre, 30.0), None);
        assert_eq!(climb(Some(orbit), far, centre, 30.0), None);
        assert_eq!(climb(Some(orbit), on_it, (47.401, 8.5), 30.0), None);
        assert_eq!(climb(Some(orbit), on_it, centre, -30.0), None);
    }
}
