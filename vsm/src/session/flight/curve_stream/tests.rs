//! The stream without the flight around it, and a vehicle that is where its set points are.

#![expect(deprecated, reason = "MISSION_SET_CURRENT, which PX4 takes")]

use curve_paths::{BezierLeg, Control, Ground};
use mapping::altitude::Level;
use mapping::route::StreamedLeg;
use mavlink_link::dialect::{MavMessage, MissionState};

use super::*;
use crate::session::testing::World;

const MISSION_ID: u32 = 77;
const HOME: Place = Place {
    latitude: 47.0,
    longitude: 8.0,
    amsl_m: 400.0,
};
const HEIGHT_M: f64 = 30.0;
const DEGREES_NORTH: f64 = 1.0 / 111_181.0;
const DEGREES_EAST: f64 = 1.0 / 76_056.0;

fn place(north: f64, east: f64) -> (f64, f64) {
    (47.0 + north * DEGREES_NORTH, 8.0 + east * DEGREES_EAST)
}

/// A quarter circle of 60 m from 60 m north of home, items 3 to 5, then a leg to the east.
fn run() -> StreamedRun {
    let at = |north, east| {
        let (lat, lon) = place(north, east);
        Position::new(lat, lon, HEIGHT_M)
    };
    let control = |north, east| {
        let (lat, lon) = place(north, east);
        Control::level(lat, lon)
    };
    let curve = BezierLeg::new(
        at(60.0, 0.0),
        control(93.1, 0.0),
        control(120.0, 26.9),
        at(120.0, 60.0),
    );
    let curve = curve.expect("a leg");
    let middle = curve.at(0.5).ground();
    let (lat, lon) = place(120.0, 160.0);
    StreamedRun {
        entry: 2,
        legs: vec![StreamedLeg {
            ends: (10, 20),
            curve,
            above_home: true,
            speed_m_s: 5.0,
            vertices: vec![(middle, 4)],
            end: 4,
        }],
        resume: 5,
        exit: Some((Ground::new(lat, lon), Level::AboveHome(HEIGHT_M))),
    }
}

/// The vehicle, flown by the set points that it gets while it is in OFFBOARD, and north at 5 m/s otherwise. As PX4 does, it flies at
/// their velocity, and at a metre a second more for each metre that it is off their place.
struct Scene {
    world: World,
    stream: CurveStream,
    runs: Vec<StreamedRun>,
    mode: Px4Mode,
    item: u16,
    mission_id: u32,
    at: Position,
    velocity: [f64; 3],
    /// When the last position was measured; `None`: now.
    stale: Option<Duration>,
    /// When its mode was reported last; `None`: now.
    silent_since: Option<Duration>,
    maneuver: bool,
    transferring: bool,
    parameters: Parameters,
    /// The set points of the last call.
    sent: usize,
    orders: Vec<Order>,
}

impl Scene {
    fn new() -> Scene {
        let mut parameters = Parameters::default();
        parameters.set("COM_OBL_RC_ACT", 5.0);
        parameters.set("COM_OF_LOSS_T", 1.0);
        let (lat, lon) = place(0.0, 0.0);
        Scene {
            world: World::airborne(Px4Mode::MISSION),
            stream: CurveStream::default(),
            runs: vec![run()],
            mode: Px4Mode::MISSION,
            item: 2,
            mission_id: MISSION_ID,
            at: Position::new(lat, lon, HOME.amsl_m + HEIGHT_M),
            velocity: [5.0, 0.0, 0.0],
            stale: None,
            silent_since: None,
            maneuver: false,
            transferring: false,
            parameters,
            sent: 0,
            orders: Vec::new(),
        }
    }

    /// The same, streaming.
    fn streaming() -> Scene {
        let mut scene = Scene::new();
        assert!(scene.until(20.0, |scene| scene.orders == [Order::Enter]));
        scene.mode = Px4Mode::OFFBOARD;
        scene.maneuver = false;
        scene.run(1.0);
        scene
    }

    fn handle(&mut self, input: Input) -> Option<Order> {
        let now = self.world.now.mono;
        let context = StreamContext {
            now,
            system: 1,
            mode: Some(self.mode),
            mode_at: Some(self.silent_since.unwrap_or(now)),
            position: Some((
                Place {
                    latitude: self.at.lat_deg,
                    longitude: self.at.lon_deg,
                    amsl_m: self.at.alt_m,
                },
                self.stale.unwrap_or(now),
            )),
            velocity: Some(self.velocity),
            home: Some(HOME),
            mission: Some(MissionProgress {
                seq: self.item,
                total: Some(8),
                state: MissionState::MISSION_STATE_ACTIVE,
                mission_id: self.mission_id,
                fence_id: 0,
                rally_points_id: 0,
            }),
            runs: Some((&self.runs, MISSION_ID)),
            maneuver: self.maneuver,
            transferring: self.transferring,
            busy: false,
            parameters: &self.parameters,
            curving: Curving::default(),
            commanded_mps: None,
        };
        let stream = &mut self.stream;
        self.world
            .act(|_, _, effects| stream.handle(&context, input, effects))
    }

    /// Some seconds, in steps of 50 ms.
    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 20.0) as u32 {
            self.world.advance(Duration::from_millis(50));
            let flown = match self.mode {
                Px4Mode::OFFBOARD => None,
                _ => Some([5.0, 0.0, 0.0]),
            };
            if let Some(velocity) = flown {
                self.velocity = velocity;
            }
            let place = Place {
                latitude: self.at.lat_deg,
                longitude: self.at.lon_deg,
                amsl_m: self.at.alt_m,
            };
            self.at = way::moved(place, self.velocity, 0.05);
            let order = self.handle(Input::Advance);
            if let Some(order) = order {
                self.orders.push(order);
                self.maneuver = true;
            }
            self.sent = 0;
            for message in self.world.posts() {
                if let MavMessage::SET_POSITION_TARGET_GLOBAL_INT(to) = message {
                    self.sent += 1;
                    if self.mode == Px4Mode::OFFBOARD {
                        let (lat, lon) = (f64::from(to.lat_int), f64::from(to.lon_int));
                        let place = Position::new(lat * 1e-7, lon * 1e-7, to.alt.into());
                        let off = offset_m(self.at, place);
                        let [north, east, down] = [to.vx, to.vy, to.vz].map(f64::from);
                        self.velocity = [north + off.y, east + off.x, down - off.z];
                    }
                }
            }
            while let Some(message) = self.world.services.missions.poll_transmit() {
                if let MavMessage::MISSION_SET_CURRENT(to) = message {
                    self.item = to.seq;
                }
            }
        }
    }

    fn until(&mut self, seconds: f64, so: impl Fn(&Scene) -> bool) -> bool {
        for _ in 0..(seconds * 20.0) as u32 {
            if so(self) {
                return true;
            }
            self.run(0.05);
        }
        so(self)
    }

    fn alerts(&self) -> String {
        let texts = self.world.log.iter().map(|entry| entry.text.as_str());
        texts.collect::<Vec<_>>().join("; ")
    }
}

#[test]
fn a_curve_is_entered_near_its_first_point_and_handed_back_behind_its_last() {
    let mut scene = Scene::new();
    assert!(scene.until(20.0, |scene| scene.orders == [Order::Enter]));
    let north_m = (scene.at.lat_deg - 47.0) / DEGREES_NORTH;
    assert!((20.0..52.0).contains(&north_m), "{north_m}");
    assert_eq!(scene.sent, 1, "a set point before the mode");
    scene.run(0.3);
    assert!(scene.sent == 1 && scene.item == 2);
    scene.mode = Px4Mode::OFFBOARD;
    scene.maneuver = false;
    let curve = scene.runs[0].legs[0].curve;
    let mut off_m: f64 = 0.0;
    let mut items = vec![scene.item];
    for _ in 0..900 {
        scene.run(0.05);
        if items.last() != Some(&scene.item) {
            items.push(scene.item);
        }
        if scene.orders.len() > 1 {
            break;
        }
        let near = (0..=1000).map(|k| {
            let on = way::raised(curve.at(f64::from(k) * 1e-3), HOME.amsl_m);
            offset_m(on, scene.at).norm()
        });
        let before = scene.at.lat_deg < place(60.0, 0.0).0;
        if !before && scene.at.lon_deg < place(0.0, 60.0).1 {
            off_m = off_m.max(near.fold(f64::MAX, f64::min));
        }
    }
    assert_eq!(scene.orders, [Order::Enter, Order::HandBack]);
    assert_eq!(items, [2, 3, 4, 5], "PX4's item is kept in step");
    assert!(off_m < 0.3, "{off_m}");
    scene.mode = Px4Mode::MISSION;
    scene.maneuver = false;
    scene.run(0.1);
    assert!(!scene.stream.is_flown() && scene.sent == 0);
    assert!(scene.stream.poll_timeout().is_none());
}

#[test]
fn nothing_begins_without_what_must_be_known() {
    let cases: [(&str, Happens); 6] = [
        ("COM_OBL_RC_ACT is 0", |scene| {
            scene.parameters.set("COM_OBL_RC_ACT", 0.0);
        }),
        ("COM_OF_LOSS_T is 5", |scene| {
            scene.parameters.set("COM_OF_LOSS_T", 5.0);
        }),
        ("has not reported COM_OBL_RC_ACT", |scene| {
            scene.parameters = Parameters::default();
        }),
        ("", |scene| scene.mission_id = 1),
        ("", |scene| scene.item = 3),
        ("", |scene| scene.transferring = true),
    ];
    for (why, change) in cases {
        let mut scene = Scene::new();
        change(&mut scene);
        scene.run(14.0);
        assert!(scene.orders.is_empty(), "{why}");
        let alerts = scene.alerts();
        assert!(alerts.contains(why), "{why}: {alerts}");
        assert_eq!(why.is_empty(), !alerts.contains("not streamed"), "{alerts}");
    }
}

#[test]
fn a_vehicle_beside_its_curve_or_unseen_is_handed_back_with_the_chord_ahead() {
    for unseen in [false, true] {
        let mut scene = Scene::streaming();
        assert!(scene.until(30.0, |scene| scene.item == 3));
        if unseen {
            scene.stale = Some(scene.world.now.mono);
            scene.run(2.5);
        } else {
            scene.at.lon_deg += 2.0 * DEGREES_EAST;
            scene.velocity = [0.0; 3];
            scene.run(0.1);
        }
        assert!(scene.until(1.0, |scene| scene.orders.len() > 1));
        assert_eq!(scene.orders[1], Order::HandBack, "{unseen}");
        assert_eq!(scene.item, 3);
        assert!(scene.alerts().contains("no longer streamed"));
        assert_eq!(scene.sent, 1, "set points last until the mode is left");
    }
}

/// As where this process was stopped: PX4 holds by then, and a command would take it out of that.
#[test]
fn a_vehicle_without_a_report_for_two_seconds_is_commanded_nothing() {
    let mut scene = Scene::streaming();
    let now = scene.world.now.mono;
    (scene.stale, scene.silent_since) = (Some(now), Some(now));
    scene.world.advance(Duration::from_secs(4));
    scene.run(0.1);
    assert_eq!(scene.orders, [Order::Enter]);
    assert!(!scene.stream.is_flown() && scene.sent == 0);
    assert!(scene.alerts().contains("the set points of its curve end"));
}

#[test]
fn a_load_and_another_mission_are_held_for() {
    let cases: [fn(&mut Scene); 2] = [
        |scene| scene.transferring = true,
        |scene| scene.mission_id = 1,
    ];
    for change in cases {
        let mut scene = Scene::streaming();
        change(&mut scene);
        scene.run(0.1);
        assert_eq!(scene.orders, [Order::Enter, Order::Hold]);
    }
}

#[test]
fn what_supersedes_it_has_set_points_until_another_mode_is_shown() {
    let mut scene = Scene::streaming();
    scene.handle(Input::Superseded);
    scene.maneuver = true;
    scene.run(3.0);
    assert_eq!(scene.sent, 1);
    let speed = scene.velocity[0].hypot(scene.velocity[1]);
    assert!(speed < 0.1, "it brakes: {speed}");
    // Nothing took the vehicle out of OFFBOARD: it is held.
    scene.maneuver = false;
    scene.run(6.0);
    assert_eq!(scene.orders, [Order::Enter, Order::Hold]);
    scene.mode = Px4Mode::LOITER;
    scene.run(0.1);
    assert!(!scene.stream.is_flown() && scene.sent == 0);
    // Superseded before it was shown: the vehicle may still receive the command.
    let mut scene = Scene::new();
    assert!(scene.until(20.0, |scene| scene.orders == [Order::Enter]));
    scene.handle(Input::Superseded);
    scene.run(1.0);
    assert_eq!(scene.sent, 1);
    scene.run(1.5);
    assert!(!scene.stream.is_flown());
}

#[test]
fn a_mode_that_is_not_entered_leaves_the_mission_to_its_chords() {
    let mut scene = Scene::new();
    assert!(scene.until(20.0, |scene| scene.orders == [Order::Enter]));
    scene.maneuver = false;
    scene.run(3.0);
    assert!(!scene.stream.is_flown());
    scene.run(3.0);
    assert_eq!(scene.orders, [Order::Enter], "not once more");
}

/// What happens in a scene.
type Happens = fn(&mut Scene);
