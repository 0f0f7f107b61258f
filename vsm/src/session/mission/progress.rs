//! The vehicle's position along its route: the previous waypoint, the current one and the next (4001).
//!
//! The order of the route is not enough: a vehicle that was sent to a waypoint has not passed the one before it, and a loop
//! leads back several times. A waypoint is reached when the vehicle reports it (MISSION_ITEM_REACHED); the laps of a loop
//! are counted by MISSION_CURRENT. PX4 v1.18 reports an item without a position that it executes at the waypoint, such as the speed
//! of the next leg, in place of the waypoint: it counts where the vehicle was flying to that waypoint.
//!
//! After a start of this VSM in the middle of a route, the preceding waypoint is taken as
//! the previous one until the vehicle reaches the next. That a route was flown to its end is stored ([`super::store`]): in
//! AUTO.LAND PX4 v1.18 no longer reports it.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::Along;
use mapping::route::CompiledMission;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MissionState;

use super::approach::{HOVER_NEAR_M, away_from};

/// The machine. Legs are indices of [`CompiledMission::order`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct RouteProgress {
    /// This process has seen the beginning of the flight.
    witnessed: bool,
    /// The route, or a part of it, has been flown since it was uploaded.
    begun: bool,
    /// AUTO.TAKEOFF or AUTO.LAND was entered, or the route uploaded, and none of it has been flown since: what is complete then is not
    /// the route.
    completes_other: bool,
    from: Option<usize>,
    /// A reached item that the vehicle still reports as the current one.
    arrived: Option<usize>,
    to: Option<usize>,
    /// The leg that it flew to in AUTO.MISSION before this one, unless it was sent here.
    left: Option<usize>,
    end: End,
    /// When PX4 was first seen to report it as complete while it flies it.
    complete_since: Option<Duration>,
    /// The vehicle is known to be elsewhere than at the end of the route.
    away: bool,
    /// Completed laps of the loop.
    laps: u16,
    /// The item reached before the route was restarted: its repeated messages prove nothing.
    outdated: Option<u16>,
}

/// The end of the route. PX4 v1.18 reports a completed mission as active again in AUTO.LAND.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum End {
    #[default]
    Ahead,
    /// Flown to its end, and AUTO.MISSION has not been left since.
    Reached,
    /// And AUTO.MISSION has been left for a hold, which lasts: entered again, the mission is flown again.
    Held,
    /// The same for any other mode, such as a landing.
    Left,
}

impl RouteProgress {
    /// After a start of this VSM: the route was flown to its end before.
    pub(super) fn ended(compiled: &CompiledMission) -> RouteProgress {
        RouteProgress {
            begun: true,
            // Its current item then: another one is reported if it was sent on meanwhile.
            to: compiled.order.len().checked_sub(1),
            // Whether it has only held since is for its position to show.
            end: End::Held,
            ..RouteProgress::default()
        }
    }

    /// Another route is uploaded: none of it has been flown.
    pub(crate) fn begin(&mut self, vehicle: &Telemetry) {
        *self = RouteProgress {
            witnessed: true,
            completes_other: true,
            outdated: vehicle.reached,
            ..RouteProgress::default()
        };
    }

    /// The vehicle is sent to an item of the route. PX4 v1.18 continues to count the laps of a loop even if the route is
    /// restarted, as seen in its own simulation.
    pub(crate) fn sent_on(&mut self, vehicle: &Telemetry) {
        let laps = self.laps;
        self.begin(vehicle);
        self.laps = laps;
    }

    /// Whether it may have been flown, completely or in part.
    pub(crate) fn was_flown(&self) -> bool {
        self.begun || !self.witnessed
    }

    /// Whether the route was flown to its end, and not begun again since.
    pub(super) fn has_ended(&self) -> bool {
        self.end != End::Ahead
    }

    /// Whether the vehicle flies to no item of the route: it was flown to its end, whatever PX4 reports since, or PX4 reports it as
    /// complete.
    pub(crate) fn is_over(&self, compiled: &CompiledMission, vehicle: &Telemetry) -> bool {
        self.has_ended() || self.is_complete(compiled, vehicle)
    }

    /// Whether PX4 reports the route as complete. PX4 v1.18 also sets MISSION_STATE_COMPLETE at the end of AUTO.TAKEOFF and AUTO.LAND
    /// (takeoff.cpp, land.cpp), whatever item is the current one; both take it back where they begin.
    fn is_complete(&self, compiled: &CompiledMission, vehicle: &Telemetry) -> bool {
        let complete = MissionState::MISSION_STATE_COMPLETE;
        let mission = vehicle.mission.filter(|mission| mission.state == complete);
        // The mode alone is not enough: a restart of this VSM, or a silence, may hide how the mission was left.
        !self.completes_other
            && mission.is_some_and(|mission| is_at_its_last_waypoint(compiled, mission.seq))
    }

    /// Whether the route was flown to its end, and the vehicle has only held since, there as far as it reports its position: a hold
    /// may have been moved by somebody else (DO_REPOSITION of a `[[forward]]`), which is no end of a contingency route.
    pub(crate) fn stays_at_end(&self, compiled: &CompiledMission, vehicle: &Telemetry) -> bool {
        let holds = match self.end {
            // After a start of this VSM there, only PX4 knows.
            End::Ahead => self.was_flown() && self.is_complete(compiled, vehicle),
            End::Reached | End::Held => true,
            End::Left => false,
        };
        holds && !self.away
    }

    /// Updates from the vehicle's present report. `streamed`: it follows a curve of the route in OFFBOARD, where PX4 reports no
    /// item as reached; the VSM then sets the current item as the curve passes it. `circle_m`: the radius of the vehicle's own
    /// circles, if it circles where it holds. `reported_at`: when it last sent MISSION_CURRENT.
    pub(crate) fn look(
        &mut self,
        compiled: &CompiledMission,
        vehicle: &Telemetry,
        streamed: bool,
        circle_m: Option<f64>,
        reported_at: Option<Duration>,
    ) {
        // Where it was last known to hold counts until its position is known again, which a stop of the bridge or a silence has it
        // forget. Where it was on its way does not.
        let away = is_away_from_end(compiled, vehicle, circle_m);
        self.away = away.unwrap_or(self.away && self.has_ended());
        let Some(mission) = vehicle.mission else {
            return;
        };
        let to = compiled.leg_of_item(mission.seq);
        self.watch_mode(vehicle);
        let over = self.is_complete(compiled, vehicle);
        let stays = self.stays_complete(vehicle, over, reported_at);
        self.watch_end(compiled, vehicle, (over, stays), to != self.to);
        if to != self.to {
            let led_back = compiled
                .circuit()
                .is_some_and(|(end, start, _)| self.to == Some(end) && to == Some(start));
            // A restart of the route after its end is not a lap.
            if led_back && self.begun && mission.state != MissionState::MISSION_STATE_COMPLETE {
                self.laps = self.laps.saturating_add(1);
            }
            if streamed && self.to.is_some_and(|before| to == Some(before + 1)) {
                self.from = self.to;
                self.witnessed = true;
            }
            // MISSION_ITEM_REACHED may arrive before MISSION_CURRENT changes: only now is the waypoint passed.
            if self.arrived.is_some() && self.arrived != to {
                self.from = self.arrived.take();
            }
            let flown = vehicle.mode == Some(Px4Mode::MISSION);
            self.left = self.to.filter(|_| flown);
            self.to = to;
        }
        let Some(seq) = vehicle.reached else {
            return;
        };
        // PX4 v1.18 repeats MISSION_ITEM_REACHED up to ten times: an old one counts only if it fits the leg.
        if self.outdated == Some(seq) && compiled.leg_of_item(seq) != to {
            return;
        }
        self.outdated = None;
        let passed = || {
            let mut legs = [self.to, self.left].into_iter().flatten();
            legs.find(|leg| compiled.is_executed_behind(seq, *leg))
        };
        let Some(leg) = compiled.leg_ended_by(seq).or_else(passed) else {
            return;
        };
        // From here on the previous waypoint is known and no longer inferred from the order.
        self.witnessed = true;
        if Some(leg) == to && !over {
            self.arrived = Some(leg);
        } else {
            self.from = Some(leg);
        }
    }

    /// Whether the route is flown, or something else that PX4 completes. On the ground AUTO.MISSION flies nothing.
    fn watch_mode(&mut self, vehicle: &Telemetry) {
        match vehicle.mode {
            Some(Px4Mode::MISSION) if !vehicle.stands() => {
                self.begun = true;
                self.completes_other = false;
            }
            Some(Px4Mode::TAKEOFF | Px4Mode::VTOL_TAKEOFF | Px4Mode::LAND) => {
                self.completes_other = true;
            }
            _ => {}
        }
    }

    /// Whether PX4 reports the route as complete in more than one report while it flies it. The first may be from before: AUTO.TAKEOFF
    /// has completed something too, and is taken back only once AUTO.MISSION has begun.
    fn stays_complete(
        &mut self,
        vehicle: &Telemetry,
        over: bool,
        reported_at: Option<Duration>,
    ) -> bool {
        let flies = vehicle.mode == Some(Px4Mode::MISSION) && vehicle.airborne();
        let reported_at = reported_at.filter(|_| flies && over);
        let since = self.complete_since.filter(|_| reported_at.is_some());
        self.complete_since = since.or(reported_at);
        let lasted = since.zip(reported_at);
        lasted.is_some_and(|(since, at)| at >= since + TAKEN_BACK_WITHIN)
    }

    /// Keeps the end of the route until the mission is flown again. `over`: PX4 reports the route as complete; `stays`: in more than one
    /// report while it flies it; `moves`: another leg as the current one.
    fn watch_end(
        &mut self,
        compiled: &CompiledMission,
        vehicle: &Telemetry,
        (over, stays): (bool, bool),
        moves: bool,
    ) {
        let flies = vehicle.mode == Some(Px4Mode::MISSION);
        let last = compiled.order.len().checked_sub(1);
        // A report from before a restart of the mission may still call it complete: behind its last waypoint it is, or where that was
        // reached unseen, in a silence or while the bridge was down, and PX4 calls it so again.
        let behind_last = self.was_flown() && self.from.is_some() && self.from == last;
        let ends = over && (behind_last || stays);
        match self.end {
            End::Ahead if ends => self.end = End::Reached,
            End::Ahead => {}
            _ if moves && !over => self.sent_on(vehicle),
            End::Held | End::Left if flies && !over => self.end = End::Ahead,
            End::Reached | End::Held if !flies => {
                let holds = vehicle.mode == Some(Px4Mode::LOITER);
                self.end = if holds { End::Held } else { End::Left };
            }
            End::Reached | End::Held | End::Left => {}
        }
    }

    /// The values for 4001.
    pub(crate) fn along(&self, compiled: &CompiledMission, vehicle: &Telemetry) -> Along {
        let along = self.along_route(compiled, vehicle);
        // A landing or a return flies to no waypoint of the route; a hold only interrupts it.
        let leaves = [Px4Mode::LAND, Px4Mode::RTL, Px4Mode::TERMINATION];
        if vehicle.mode.is_some_and(|mode| leaves.contains(&mode)) {
            return Along {
                from: along.from,
                ..Along::default()
            };
        }
        along
    }

    /// The values while the route is flown, held, or will be flown.
    fn along_route(&self, compiled: &CompiledMission, vehicle: &Telemetry) -> Along {
        let Some(mission) = vehicle.mission else {
            return Along::default();
        };
        let there = |leg: usize| (leg < compiled.order.len()).then_some(leg);
        if self.is_over(compiled, vehicle) {
            // A completed route has no current waypoint. A route that has not been started leads to its first waypoint,
            // whatever the vehicle reports about the previous one.
            return if self.was_flown() {
                // A landing pattern may have been entered from any leg, so its end proves nothing about the last waypoint.
                let inferred = compiled.landing_start().is_none();
                let last = compiled.order.len().checked_sub(1);
                Along {
                    from: self.from.or(last.filter(|_| inferred)),
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
        // Inferred only after a start of this VSM during a route: after a jump the vehicle has not passed the preceding
        // waypoint.
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

/// Whether the vehicle is elsewhere than at the end of the route; `None` while its position is not known.
fn is_away_from_end(
    compiled: &CompiledMission,
    vehicle: &Telemetry,
    circle_m: Option<f64>,
) -> Option<bool> {
    let last = compiled.order.last().map(|leg| leg.number);
    let mut items = compiled.items.iter().zip(&compiled.waypoint_of).rev();
    let (item, _) = items.find(|(item, number)| item.is_flown_to() && Some(**number) == last)?;
    let away = away_from(vehicle, item)?;
    // A circle may be the item's own.
    let circle_m = circle_m.map_or(0.0, |own_m| own_m.max(f64::from(item.params[2]).abs()));
    Some(away.ground_m > 2.0 * circle_m + HOVER_NEAR_M || away.height_m > HEIGHT_NEAR_M)
}

/// Whether the last waypoint of the route, or a landing behind it, is the current item: PX4 leaves it at the last one that it has flown.
fn is_at_its_last_waypoint(compiled: &CompiledMission, seq: u16) -> bool {
    let last = compiled.order.last().map(|leg| leg.number);
    let mut numbers = compiled.waypoint_of.iter();
    let first = numbers.position(|number| Some(*number) == last);
    first.is_some_and(|first| usize::from(seq) >= first)
}

/// PX4 takes back what another mode has completed in the turn of its navigator in which AUTO.MISSION begins, at 20 Hz; then it has
/// to send that.
const TAKEN_BACK_WITHIN: Duration = Duration::from_millis(500);
/// A hold at a height is within this of it, also on wings, m.
const HEIGHT_NEAR_M: f64 = 20.0;

#[cfg(test)]
mod tests {
    use mapping::altitude::Level;
    use mapping::route::Leg;
    use mapping::telemetry::{LandedState, MissionProgress, Place};
    use mavlink_link::service::mission::Item;

    use super::*;

    /// MAV_CMD_NAV_WAYPOINT, DO_LAND_START, NAV_LAND.
    const PATTERN: [u16; 3] = [16, 189, 21];

    /// A mission of these items, of which the first is the place of waypoint 7.
    fn compiled(commands: &[u16]) -> CompiledMission {
        let item = |command: &u16| Item {
            command: *command,
            ..Item::default()
        };
        CompiledMission {
            items: commands.iter().map(item).collect(),
            waypoint_of: vec![7, 0, 0],
            order: vec![Leg {
                number: 7,
                latitude: 47.0,
                longitude: 8.0,
                level: Level::AboveHome(50.0),
                speed_m_s: None,
            }],
            ..CompiledMission::default()
        }
    }

    /// A vehicle at the end of its mission, in this mode.
    fn at_the_end(mode: Px4Mode) -> Telemetry {
        Telemetry {
            mode: Some(mode),
            mission: Some(MissionProgress {
                seq: 0,
                total: None,
                state: MissionState::MISSION_STATE_COMPLETE,
                mission_id: 1,
                fence_id: 0,
                rally_points_id: 0,
            }),
            ..Telemetry::default()
        }
    }

    /// The From of 4001 after a mission of these items, none of which was reported as reached.
    fn from_at_the_end(commands: &[u16]) -> Option<usize> {
        let (compiled, vehicle) = (compiled(commands), at_the_end(Px4Mode::MISSION));
        let mut progress = RouteProgress::default();
        progress.begin(&vehicle);
        progress.look(&compiled, &vehicle, false, None, None);
        progress.along(&compiled, &vehicle).from
    }

    #[test]
    fn a_landing_proves_nothing_about_the_last_waypoint_of_its_route() {
        assert_eq!(from_at_the_end(&PATTERN[..1]), Some(0));
        assert_eq!(from_at_the_end(&PATTERN), None);
    }

    #[test]
    fn a_route_stays_over_after_a_landing_and_the_vehicle_is_no_longer_at_its_end() {
        let compiled = compiled(&PATTERN[..1]);
        let mut vehicle = at_the_end(Px4Mode::MISSION);
        let mut progress = RouteProgress::default();
        progress.begin(&vehicle);
        vehicle.reached = Some(0);
        let mut look = |mode, state| {
            vehicle.mode = Some(mode);
            vehicle.mission = vehicle
                .mission
                .map(|mission| MissionProgress { state, ..mission });
            // What was reached counts from the next report on.
            progress.look(&compiled, &vehicle, false, None, None);
            progress.look(&compiled, &vehicle, false, None, None);
            (
                progress.is_over(&compiled, &vehicle),
                progress.stays_at_end(&compiled, &vehicle),
            )
        };
        let (active, complete) = (
            MissionState::MISSION_STATE_ACTIVE,
            MissionState::MISSION_STATE_COMPLETE,
        );
        assert_eq!(look(Px4Mode::MISSION, active), (false, false));
        assert_eq!(look(Px4Mode::MISSION, complete), (true, true));
        assert_eq!(look(Px4Mode::LOITER, complete), (true, true));
        // PX4 takes it back.
        assert_eq!(look(Px4Mode::LAND, active), (true, false));
        assert_eq!(look(Px4Mode::LOITER, active), (true, false));
        // It is flown again.
        assert_eq!(look(Px4Mode::MISSION, active), (false, false));
    }

    /// At the end of its route, of which the last item is a circle of 100 m.
    fn with_a_place() -> (CompiledMission, Telemetry) {
        let mut compiled = compiled(&PATTERN[..1]);
        compiled.items[0] = Item {
            frame: 6,
            command: 16,
            params: [0.0, 0.0, -100.0, f32::NAN],
            x: 470_000_000,
            y: 80_000_000,
            z: 50.0,
            ..Item::default()
        };
        let home = Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m: 400.0,
        };
        let vehicle = Telemetry {
            home: Some(home),
            ..at_the_end(Px4Mode::LOITER)
        };
        (compiled, vehicle)
    }

    #[test]
    fn a_hold_that_is_known_to_be_elsewhere_is_not_at_the_end_of_the_route() {
        let (compiled, mut vehicle) = with_a_place();
        for (circle_m, north_m, above_m, expected) in [
            (None, 0.0, 50.0, true),
            (None, 45.0, 50.0, true),
            (None, 60.0, 50.0, false),
            (None, 0.0, 35.0, true),
            (None, 0.0, 25.0, false),
            (Some(80.0), 240.0, 50.0, true),
            (Some(80.0), 260.0, 50.0, false),
            (Some(300.0), 640.0, 50.0, true),
        ] {
            let home = vehicle.home.expect("it has one");
            vehicle.position = Some(Place {
                latitude: home.latitude + north_m / 111_195.0,
                amsl_m: home.amsl_m + above_m,
                ..home
            });
            // This process has seen it reach the end, or begins there.
            for mut progress in [RouteProgress::ended(&compiled), RouteProgress::default()] {
                progress.look(&compiled, &vehicle, false, circle_m, None);
                let there = progress.stays_at_end(&compiled, &vehicle);
                assert_eq!(there, expected, "{circle_m:?} {north_m} {above_m}");
                // Wherever it holds, the route has ended.
                assert!(progress.is_over(&compiled, &vehicle));
            }
        }
        // A position that is forgotten, as after a stop of the bridge, does not bring it back there.
        let mut progress = RouteProgress::ended(&compiled);
        vehicle.position = vehicle.home.map(|home| Place {
            latitude: home.latitude + 0.01,
            amsl_m: home.amsl_m + 50.0,
            ..home
        });
        for _ in 0..2 {
            progress.look(&compiled, &vehicle, false, None, None);
            assert!(!progress.stays_at_end(&compiled, &vehicle));
            vehicle.position = None;
        }
        // What was never known proves nothing.
        let mut progress = RouteProgress::ended(&compiled);
        progress.look(&compiled, &vehicle, false, None, None);
        assert!(progress.stays_at_end(&compiled, &vehicle));
    }

    #[test]
    fn an_end_from_before_a_start_of_the_vsm_lasts_until_the_mission_is_flown_again() {
        let compiled = compiled(&PATTERN[..1]);
        let active = |mode, seq| {
            let mut vehicle = at_the_end(mode);
            if let Some(mission) = &mut vehicle.mission {
                (mission.state, mission.seq) = (MissionState::MISSION_STATE_ACTIVE, seq);
            }
            vehicle
        };
        let look = |progress: &mut RouteProgress, vehicle: &Telemetry| {
            progress.look(&compiled, vehicle, false, None, None);
            assert_eq!(progress.has_ended(), progress.is_over(&compiled, vehicle));
            let stays = progress.stays_at_end(&compiled, vehicle);
            (progress.has_ended(), stays)
        };
        // PX4 takes it back in AUTO.LAND.
        let mut progress = RouteProgress::ended(&compiled);
        for mode in [Px4Mode::LAND, Px4Mode::LOITER] {
            assert_eq!(look(&mut progress, &active(mode, 0)), (true, false));
        }
        let again = active(Px4Mode::MISSION, 0);
        assert_eq!(look(&mut progress, &again), (false, false));
        // Somebody has sent it to another item meanwhile.
        let mut progress = RouteProgress::ended(&compiled);
        let elsewhere = active(Px4Mode::LOITER, 1);
        assert_eq!(look(&mut progress, &elsewhere), (false, false));
    }

    /// Waypoints 1 to 4, an item each.
    fn of_four() -> CompiledMission {
        let one = compiled(&PATTERN[..1]);
        let leg = |number| Leg {
            number,
            ..one.order[0]
        };
        CompiledMission {
            items: vec![one.items[0]; 4],
            waypoint_of: vec![1, 2, 3, 4],
            order: [1, 2, 3, 4].map(leg).into(),
            ..CompiledMission::default()
        }
    }

    /// A route that is followed, and the vehicle as it reports itself.
    struct Followed {
        compiled: CompiledMission,
        vehicle: Telemetry,
        progress: RouteProgress,
    }

    impl Followed {
        fn uploaded(compiled: CompiledMission) -> Followed {
            let mut vehicle = at_the_end(Px4Mode::LOITER);
            vehicle.landed = Some(LandedState::OnGround);
            let mut progress = RouteProgress::default();
            progress.begin(&vehicle);
            Followed {
                compiled,
                vehicle,
                progress,
            }
        }

        fn look(&mut self, mode: Px4Mode, landed: LandedState, seq: u16, state: MissionState) {
            (self.vehicle.mode, self.vehicle.landed) = (Some(mode), Some(landed));
            let mission = self.vehicle.mission.as_mut().expect("it reports one");
            (mission.seq, mission.state) = (seq, state);
            // What was reached counts from the next report on.
            for _ in 0..2 {
                self.progress
                    .look(&self.compiled, &self.vehicle, false, None, None);
            }
        }

        fn is_over(&self) -> bool {
            self.progress.is_over(&self.compiled, &self.vehicle)
        }

        fn along(&self) -> [Option<usize>; 3] {
            let along = self.progress.along(&self.compiled, &self.vehicle);
            [along.from, along.to, along.next]
        }
    }

    const ACTIVE: MissionState = MissionState::MISSION_STATE_ACTIVE;
    const COMPLETE: MissionState = MissionState::MISSION_STATE_COMPLETE;
    const GROUND: LandedState = LandedState::OnGround;
    const AIR: LandedState = LandedState::InAir;

    /// PX4 v1.18 calls the mission complete after AUTO.LAND and AUTO.TAKEOFF too, with the item at which it was left.
    #[test]
    fn a_route_that_a_landing_and_a_launch_have_broken_off_is_not_over() {
        let mut at = Followed::uploaded(of_four());
        at.look(Px4Mode::MISSION, AIR, 0, ACTIVE);
        for reached in [0, 1] {
            at.vehicle.reached = Some(reached);
            at.look(Px4Mode::MISSION, AIR, reached + 1, ACTIVE);
        }
        assert_eq!(at.along(), [Some(1), Some(2), Some(3)]);
        for (mode, landed, state) in [
            (Px4Mode::RTL, AIR, MissionState::MISSION_STATE_PAUSED),
            (Px4Mode::LAND, AIR, ACTIVE),
            (Px4Mode::LAND, GROUND, COMPLETE),
            (Px4Mode::TAKEOFF, AIR, ACTIVE),
            (Px4Mode::LOITER, AIR, COMPLETE),
        ] {
            at.look(mode, landed, 2, state);
            assert!(!at.is_over() && !at.progress.has_ended(), "{mode:?}");
            assert_eq!(at.along()[0], Some(1), "{mode:?}");
        }
        assert_eq!(at.along(), [Some(1), Some(2), Some(3)]);
        assert!(!at.progress.stays_at_end(&at.compiled, &at.vehicle));
        // A VSM that was started again here knows the item alone.
        let restarted = RouteProgress::default();
        assert!(!restarted.is_over(&at.compiled, &at.vehicle));
        // Flown to its end, it is over.
        at.vehicle.reached = Some(2);
        at.look(Px4Mode::MISSION, AIR, 3, ACTIVE);
        at.vehicle.reached = Some(3);
        at.look(Px4Mode::MISSION, AIR, 3, COMPLETE);
        assert!(at.is_over() && at.progress.has_ended());
        assert_eq!(at.along(), [Some(3), None, None]);
    }

    /// Its last waypoint was reached in a silence, or while the bridge was down.
    #[test]
    fn a_route_that_has_ended_unseen_stays_over_in_the_modes_that_follow() {
        let complete = |seen: &[u64]| {
            let mut at = Followed::uploaded(of_four());
            at.look(Px4Mode::MISSION, AIR, 0, ACTIVE);
            at.vehicle.reached = Some(0);
            at.look(Px4Mode::MISSION, AIR, 1, ACTIVE);
            at.vehicle.reached = None;
            let mission = at.vehicle.mission.as_mut().expect("it reports one");
            (mission.seq, mission.state) = (3, COMPLETE);
            for at_ms in seen {
                let reported_at = Some(Duration::from_millis(*at_ms));
                at.progress
                    .look(&at.compiled, &at.vehicle, false, None, reported_at);
            }
            at.look(Px4Mode::LAND, AIR, 3, ACTIVE);
            at.look(Px4Mode::LOITER, AIR, 3, ACTIVE);
            (at.is_over(), at.progress.has_ended())
        };
        assert_eq!(complete(&[5_000, 6_000]), (true, true));
        // One report, however often it is looked at, may be from before the mode; so may one right behind it.
        assert_eq!(complete(&[5_000, 5_000]), (false, false));
        assert_eq!(complete(&[5_000, 5_050]), (false, false));
    }

    #[test]
    fn on_the_way_to_its_last_waypoint_a_landing_does_not_end_the_route() {
        let mut at = Followed::uploaded(of_four());
        at.look(Px4Mode::MISSION, AIR, 3, ACTIVE);
        at.look(Px4Mode::LAND, AIR, 3, ACTIVE);
        at.look(Px4Mode::LAND, GROUND, 3, COMPLETE);
        assert!(!at.is_over());
        assert_eq!(at.along(), [None; 3]);
    }

    #[test]
    fn the_mission_mode_on_the_ground_flies_nothing_of_the_route() {
        for compiled in [of_four(), compiled(&PATTERN[..1])] {
            let next = (compiled.order.len() > 1).then_some(1);
            let mut at = Followed::uploaded(compiled);
            at.look(Px4Mode::MISSION, GROUND, 0, ACTIVE);
            at.look(Px4Mode::TAKEOFF, AIR, 0, ACTIVE);
            at.look(Px4Mode::LOITER, AIR, 0, COMPLETE);
            assert!(!at.is_over() && !at.progress.was_flown());
            assert_eq!(at.along(), [None, Some(0), next]);
        }
    }
}
