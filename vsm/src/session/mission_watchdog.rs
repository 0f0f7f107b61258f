//! The watch on the flown sequence: a vehicle in AUTO.MISSION that gets no nearer to its item is put on hold, and said
//! so by 16000 with the waypoint in the CUCS's numbers.
//!
//! A multicopter under PX4 has no test of having passed a waypoint: one that misses it flies on along the leg's line,
//! or hangs beside it, in mission mode and without a word. Two findings end that:
//!
//! - *missed*: it is further from the item than it has been, by more than any turn takes at the speed it had, and has
//!   been so for some seconds;
//! - *stuck*: for longer than the configured time it has come no nearer, neither over ground nor in height.
//!
//! Promised of honest flight: neither is found. A turn, a climb on the spot, head wind, a slow speed, a hover, a loiter
//! and a jump are progress, or are allowed for; each new item begins a new course. Time is the vehicle's own, so that a
//! simulation faster or slower than time is judged as the flight that it is. Nothing is judged but by a MISSION_CURRENT
//! that says the item is still the same: a lost one must not make a passed waypoint a missed one.

use mapping::limits::metres;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mavlink_link::dialect::{MavType, MissionState};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::Desk;
use super::maneuver::{self, Maneuver};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct StallWatch {
    course: Option<Course>,
}

/// What the vehicle shows of its flight along a mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Confirmation {
    /// The vehicle's clock, s since its boot.
    time_s: f64,
    /// When a MISSION_CURRENT last named the item, by the same clock.
    told_s: f64,
    /// MISSION_CURRENT.seq.
    seq: u16,
    /// What lies between it and the item; none for an item without a place.
    away: Option<Away>,
    /// Where the item is a loiter.
    loiter: Option<Loiter>,
    /// Speed over ground, m/s.
    speed_m_s: f64,
    /// It turns by banking: a turn takes room.
    banks: bool,
    /// The slowest speed that anything commands, m/s.
    slowest_m_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Away {
    ground_m: f64,
    height_m: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Loiter {
    /// Within this distance it is at its loiter, m.
    near_m: f64,
    /// How long it stays, s; none for ever.
    stay_s: Option<f64>,
}

/// The flight to one item.
#[derive(Debug, Clone, Copy)]
struct Course {
    seq: u16,
    /// The nearest so far.
    best: Option<Away>,
    /// When it last came nearer, s.
    since_s: f64,
    /// The fastest since then, m/s.
    fastest_m_s: f64,
    /// Since when it has been further away than a turn takes it, s.
    beyond_s: Option<f64>,
}

/// What a look finds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Finding {
    /// Nothing to say.
    Nothing,
    /// It has come nearer, or has a new item.
    Progress,
    /// It flies away from the item: so far from it, m.
    Missed(f64),
    /// It comes no nearer, and has not for so long, s.
    Stuck(f64),
}

impl StallWatch {
    /// No mission is flown.
    pub(crate) fn forget(&mut self) {
        self.course = None;
    }

    /// Takes in what is seen; `limit_s` is the longest time without progress that needs no explanation.
    pub(crate) fn look(&mut self, confirmation: &Confirmation, limit_s: f64) -> Finding {
        let course = match &mut self.course {
            Some(course)
                if course.seq == confirmation.seq && course.since_s <= confirmation.time_s =>
            {
                course
            }
            _ => {
                self.course = Some(Course::begun(confirmation));
                return Finding::Progress;
            }
        };
        course.fastest_m_s = course.fastest_m_s.max(confirmation.speed_m_s);
        if course.is_nearer(confirmation) {
            return Finding::Progress;
        }
        // What follows is said of this item only where the vehicle has named it since, and just now.
        if confirmation.told_s < course.since_s
            || confirmation.time_s - confirmation.told_s > FRESH_S
        {
            return Finding::Nothing;
        }
        let finding = course.judge(confirmation, limit_s);
        if finding != Finding::Nothing {
            // Where the hold is not entered, the next look starts anew.
            self.course = Some(Course::begun(confirmation));
        }
        finding
    }
}

impl Course {
    fn begun(confirmation: &Confirmation) -> Course {
        Course {
            seq: confirmation.seq,
            best: confirmation.away,
            since_s: confirmation.time_s,
            fastest_m_s: confirmation.speed_m_s,
            beyond_s: None,
        }
    }

    /// Takes in a distance; whether it is progress.
    fn is_nearer(&mut self, confirmation: &Confirmation) -> bool {
        let (Some(best), Some(away)) = (&mut self.best, confirmation.away) else {
            self.best = self.best.or(confirmation.away);
            return false;
        };
        let ground = away.ground_m < best.ground_m - STEP_M;
        let height = away.height_m < best.height_m - STEP_M;
        if ground {
            best.ground_m = away.ground_m;
        }
        if height {
            best.height_m = away.height_m;
        }
        if ground || height {
            self.since_s = confirmation.time_s;
            self.fastest_m_s = confirmation.speed_m_s;
            self.beyond_s = None;
        }
        ground || height
    }

    fn judge(&mut self, confirmation: &Confirmation, limit_s: f64) -> Finding {
        let still_s = confirmation.time_s - self.since_s;
        // Turning back takes a time, and coming back the same again; a slow flight takes long for a step.
        let mut patience_s =
            limit_s + TURN_S * self.fastest_m_s + STEP_M / confirmation.slowest_m_s;
        let (Some(away), Some(best)) = (confirmation.away, self.best) else {
            return stuck(still_s, patience_s);
        };
        if let Some(loiter) = confirmation.loiter
            && away.ground_m <= loiter.near_m
        {
            self.beyond_s = None;
            let Some(stay_s) = loiter.stay_s else {
                self.since_s = confirmation.time_s;
                return Finding::Nothing;
            };
            // It counts its stay from when it is on its circle and at its height: some turns later.
            patience_s +=
                stay_s + CIRCLES * loiter.near_m / confirmation.speed_m_s.max(SLOWEST_CIRCLE_M_S);
            return stuck(still_s, patience_s);
        }
        let room_m = if confirmation.banks {
            BANKING_ROOM_M + self.fastest_m_s * self.fastest_m_s
        } else {
            HOVERING_ROOM_M + 0.5 * self.fastest_m_s * self.fastest_m_s
        };
        if away.ground_m > best.ground_m + room_m {
            let since_s = *self.beyond_s.get_or_insert(confirmation.time_s);
            if confirmation.time_s - since_s >= BEYOND_FOR_S && confirmation.told_s >= since_s {
                return Finding::Missed(away.ground_m);
            }
        } else {
            self.beyond_s = None;
        }
        stuck(still_s, patience_s)
    }
}

fn stuck(still_s: f64, patience_s: f64) -> Finding {
    if still_s > patience_s {
        Finding::Stuck(still_s)
    } else {
        Finding::Nothing
    }
}

impl Aircraft {
    /// Looks whether the vehicle gets on with its mission, and puts it on hold where it does not.
    pub(super) fn watch_progress(&mut self, desk: &mut Desk<'_>) {
        let Some(limit_s) = self.config.stall_s.filter(|_| self.mav.live()) else {
            return;
        };
        let Some(confirmation) = self.sight_of_course() else {
            return self.mission_watchdog.forget();
        };
        // What is under way changes mode or route: it is judged by itself.
        if self.maneuver.is_some() || self.load.is_some() {
            return;
        }
        let what = match self.mission_watchdog.look(&confirmation, limit_s) {
            Finding::Nothing => return,
            Finding::Progress => {
                let raised = self
                    .alerts
                    .clear(Cause::Stalled, "the route is flown again");
                let listeners = desk.listeners(&self.authority, None);
                return desk.alert(self.id(), &listeners, raised);
            }
            Finding::Missed(away_m) => format!("missed, {away_m:.0} m away and no turning back"),
            Finding::Stuck(still_s) => {
                let away_m = confirmation.away.map_or(0.0, |away| away.ground_m);
                format!("no nearer for {still_s:.0} s, {away_m:.0} m away")
            }
        };
        let waypoint = self
            .aboard
            .as_ref()
            .and_then(|aboard| {
                aboard
                    .compiled
                    .waypoint_of
                    .get(usize::from(confirmation.seq))
            })
            .copied()
            .unwrap_or(0);
        let text = format!("waypoint {waypoint}: {what}; the vehicle is told to hold");
        let raised = self.alerts.raise(
            Cause::Stalled,
            AlertPriority::Warning,
            SubsystemId::VsmStatus,
            text,
        );
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
        let hold = maneuver::enter(&[Px4Mode::LOITER]);
        self.begin(desk, None, Maneuver::new(hold, Commanded::default()));
    }

    /// None where no mission of ours is flown.
    fn sight_of_course(&self) -> Option<Confirmation> {
        let telemetry = &self.mav.telemetry;
        let (aboard, mission) = (self.aboard.as_ref()?, telemetry.mission?);
        let flown = telemetry.mode == Some(Px4Mode::MISSION) && telemetry.airborne();
        let over = mission.state == MissionState::MISSION_STATE_COMPLETE;
        let foreign = aboard.mission_id != 0
            && mission.mission_id != 0
            && aboard.mission_id != mission.mission_id;
        if !flown || over || foreign {
            return None;
        }
        let item = aboard.compiled.items.get(usize::from(mission.seq))?;
        let here = telemetry.position?;
        let above_home_m = if ABOVE_HOME.contains(&item.frame) {
            telemetry.home?.amsl_m
        } else {
            0.0
        };
        let (latitude, longitude) = (f64::from(item.x) / 1e7, f64::from(item.y) / 1e7);
        let away = item.is_global().then(|| Away {
            ground_m: metres((here.latitude, here.longitude), (latitude, longitude)),
            height_m: (f64::from(item.z) + above_home_m - here.amsl_m).abs(),
        });
        let banks = banks(telemetry.vehicle_type);
        let radius_m = f64::from(item.params[2]).abs();
        let near_m = match (banks, radius_m > 0.0) {
            (false, _) => HOVER_NEAR_M,
            (true, true) => 2.0 * radius_m + HOVER_NEAR_M,
            (true, false) => CIRCLE_NEAR_M,
        };
        let loiter = match item.command {
            NAV_LOITER_UNLIM => Some(None),
            NAV_LOITER_TIME => Some(Some(f64::from(item.params[0]))),
            _ => None,
        };
        let [north, east, _] = telemetry.velocity_ned?;
        let changes = aboard.compiled.items.iter();
        let slowest_m_s = changes
            .filter(|item| item.command == DO_CHANGE_SPEED)
            .map(|item| f64::from(item.params[1]))
            .chain(self.commanded.speed_m_s)
            .fold(UNCOMMANDED_M_S, f64::min);
        Some(Confirmation {
            time_s: seconds(self.mav.boot_ms()?),
            told_s: seconds(self.mav.progress_told_ms()?),
            seq: mission.seq,
            away,
            loiter: loiter.map(|stay_s| Loiter { near_m, stay_s }),
            speed_m_s: north.hypot(east),
            banks,
            slowest_m_s: slowest_m_s.max(SLOWEST_M_S),
        })
    }
}

/// All but the types that only hover: a convertiplane banks half of the time.
fn banks(kind: Option<MavType>) -> bool {
    use MavType as T;
    !matches!(
        kind,
        Some(
            T::MAV_TYPE_QUADROTOR
                | T::MAV_TYPE_COAXIAL
                | T::MAV_TYPE_HELICOPTER
                | T::MAV_TYPE_HEXAROTOR
                | T::MAV_TYPE_OCTOROTOR
                | T::MAV_TYPE_TRICOPTER
                | T::MAV_TYPE_DODECAROTOR
        )
    )
}

fn seconds(ms: u32) -> f64 {
    f64::from(ms) / 1e3
}

/// Less than this is no progress: a hovering vehicle moves by as much, m.
const STEP_M: f64 = 1.0;
/// Seconds for each m/s that turning back and coming back take.
const TURN_S: f64 = 2.0;
/// What a stop takes beside v^2 / 2 (a deceleration of 1 m/s^2), m.
const HOVERING_ROOM_M: f64 = 20.0;
/// What a turn takes beside v^2 (a circle at 20 degrees of bank, down wind), m.
const BANKING_ROOM_M: f64 = 100.0;
/// A position may jump for a moment, s.
const BEYOND_FOR_S: f64 = 5.0;
/// At a hover, m.
const HOVER_NEAR_M: f64 = 50.0;
/// At a circle of the vehicle's own radius (NAV_LOITER_RAD, 80 m), m.
const CIRCLE_NEAR_M: f64 = 300.0;
/// Length of the turns before a stay counts, in radii.
const CIRCLES: f64 = 20.0;
const SLOWEST_CIRCLE_M_S: f64 = 5.0;
/// Where no speed is commanded, m/s: slower than any cruise.
const UNCOMMANDED_M_S: f64 = 1.0;
/// A slower command is judged as this, m/s.
const SLOWEST_M_S: f64 = 0.01;
/// MISSION_CURRENT comes each second and on change, s.
const FRESH_S: f64 = 3.0;
/// Frames of heights above home.
const ABOVE_HOME: [u8; 2] = [3, 6];
const NAV_LOITER_UNLIM: u16 = 17;
const NAV_LOITER_TIME: u16 = 19;
const DO_CHANGE_SPEED: u16 = 178;

#[cfg(test)]
mod tests {
    use super::*;

    /// A multicopter at 5 m/s, so far from item 3.
    fn at(time_s: f64, ground_m: f64, height_m: f64) -> Confirmation {
        Confirmation {
            time_s,
            told_s: time_s,
            seq: 3,
            away: Some(Away { ground_m, height_m }),
            loiter: None,
            speed_m_s: 5.0,
            banks: false,
            slowest_m_s: 1.0,
        }
    }

    /// The first finding that is a mission_watchdog, and when.
    fn first_stall(sights: impl Iterator<Item = Confirmation>) -> Option<(f64, Finding)> {
        let mut watch = StallWatch::default();
        let mut looked =
            sights.map(|confirmation| (confirmation.time_s, watch.look(&confirmation, 30.0)));
        looked.find(|(_, finding)| matches!(finding, Finding::Missed(_) | Finding::Stuck(_)))
    }

    fn times(end_s: f64) -> impl Iterator<Item = f64> {
        (0..)
            .map(|k| f64::from(k) * 0.2)
            .take_while(move |t| *t <= end_s)
    }

    #[test]
    fn flying_past_is_found_within_a_hundred_metres() {
        let past = times(300.0).map(|t| at(t, (40.0 - 5.0 * t).hypot(1.5), 0.0));
        let (when, finding) = first_stall(past).expect("a mission_watchdog");
        let Finding::Missed(away_m) = finding else {
            panic!("{finding:?}")
        };
        assert!(away_m < 100.0 && when < 27.0, "{away_m} m at {when} s");
    }

    #[test]
    fn hanging_beside_a_waypoint_is_found_after_the_time_and_no_sooner() {
        let hanging = times(300.0).map(|t| Confirmation {
            speed_m_s: 0.1,
            ..at(t, (40.0 - 5.0 * t).max(2.5) + 0.3 * t.sin(), 0.0)
        });
        let (when, finding) = first_stall(hanging).expect("a mission_watchdog");
        assert!(matches!(finding, Finding::Stuck(still_s) if still_s > 30.0));
        assert!((37.0..60.0).contains(&when), "{when}");
    }

    #[test]
    fn slow_flight_a_climb_a_reversal_and_a_lost_report_are_no_stall() {
        // 5 cm/s against the wind, where 10 cm/s were commanded.
        let slow = times(900.0).map(|t| Confirmation {
            slowest_m_s: 0.05,
            speed_m_s: 0.05,
            ..at(t, 80.0 - 0.05 * t, 0.0)
        });
        assert_eq!(first_stall(slow), None);
        // A climb on the spot of 400 m at 0.5 m/s, then the leg.
        let climb = times(800.0).map(|t| at(t, 500.0, 400.0 - 0.5 * t));
        assert_eq!(first_stall(climb), None);
        // Braking from 20 m/s at 1.5 m/s^2, and back.
        let reversal = times(60.0).map(|t| {
            let v = (20.0 - 1.5 * t).max(-20.0);
            Confirmation {
                speed_m_s: v.abs(),
                ..at(t, 50.0 + 20.0 * t - 0.75 * t * t, 0.0)
            }
        });
        assert_eq!(
            first_stall(reversal.take_while(|s| s.away.is_some_and(|a| a.ground_m > 0.0))),
            None
        );
        // The item was passed 60 s ago, and no MISSION_CURRENT has come since.
        let unheard = times(60.0).map(|t| Confirmation {
            told_s: t.min(7.0),
            ..at(t, (40.0 - 5.0 * t).abs(), 0.0)
        });
        assert_eq!(first_stall(unheard), None);
    }

    #[test]
    fn a_loiter_is_no_stall_while_it_lasts() {
        let loiter = |stay_s| {
            times(4_000.0).map(move |t| Confirmation {
                loiter: Some(Loiter {
                    near_m: 50.0,
                    stay_s,
                }),
                ..at(t, 3.0, 0.2)
            })
        };
        assert_eq!(first_stall(loiter(None)), None);
        let (when, _) = first_stall(loiter(Some(1_000.0))).expect("it stays too long");
        assert!(when > 1_030.0, "{when}");
    }

    #[test]
    fn a_plane_may_turn_and_come_round_again() {
        // A circle of 150 m radius at 20 m/s that begins over the waypoint before.
        let turn = times(47.0).map(|t| {
            let a = 20.0 * t / 150.0;
            let (x, y) = (150.0 * a.sin(), 150.0 * (1.0 - a.cos()));
            Confirmation {
                banks: true,
                speed_m_s: 20.0,
                ..at(t, (x + 60.0).hypot(y), 0.0)
            }
        });
        assert_eq!(first_stall(turn), None);
        let away = times(200.0).map(|t| Confirmation {
            banks: true,
            speed_m_s: 20.0,
            ..at(t, 100.0 + 20.0 * t, 0.0)
        });
        assert!(matches!(first_stall(away), Some((_, Finding::Missed(_)))));
    }

    #[test]
    fn a_new_item_or_a_new_boot_begins_a_new_course() {
        let mut watch = StallWatch::default();
        watch.look(&at(0.0, 100.0, 0.0), 30.0);
        let later = Confirmation {
            seq: 4,
            ..at(500.0, 100.0, 0.0)
        };
        assert_eq!(watch.look(&later, 30.0), Finding::Progress);
        assert_eq!(
            watch.look(
                &Confirmation {
                    seq: 4,
                    ..at(1.0, 300.0, 0.0)
                },
                30.0
            ),
            Finding::Progress
        );
    }
}
