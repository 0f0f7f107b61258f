//! Uploads of two CUCSs, interleaved at random with loads, cancels, clearings, downloads, changes of control, silence and
//! restarts, against a model of what a plan is: whatever happens between, the stored plan and the vehicle's mission are what
//! one CUCS has sent, whole, or the change of one CUCS to what was stored; and a message is answered as the model says.
//!
//! Each upload has an altitude of its own, by which its waypoints are known.

use std::collections::{BTreeMap, BTreeSet};

use kit::bridge::orders;
use mavlink_link::dialect::MavMissionType;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, MissionPlanMode, RequestedAccess};

use crate::scene::{A, B, CONTROL, Scene};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const NO: Option<AckType> = Some(AckType::Refused);
/// Waypoints of the route, in its order.
const ROUTE: [u16; 4] = [1, 2, 3, 4];

/// Of which upload each waypoint is.
type Waypoints = BTreeMap<u16, u16>;

#[derive(Debug, Clone, Default)]
struct Plan {
    route: bool,
    waypoints: Waypoints,
}

#[derive(Debug, Clone)]
struct Staged {
    owner: usize,
    plan: Plan,
    /// Since the last 13000.
    sent: BTreeSet<u16>,
    route_sent: bool,
    failed: bool,
}

#[derive(Debug, Default)]
struct Model {
    controller: Option<usize>,
    stored: Plan,
    staged: Option<Staged>,
    dropped: bool,
    serial: u16,
}

/// What a 13000 leads to.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Load {
    Done,
    /// Refused at once.
    No,
}

impl Model {
    fn drop_staged(&mut self) {
        self.dropped |= self.staged.take().is_some();
    }

    fn control(&mut self, by: Option<usize>) {
        self.controller = by;
        if self
            .staged
            .as_ref()
            .is_some_and(|staged| by != Some(staged.owner))
        {
            self.drop_staged();
        }
    }

    fn stage(&mut self, by: usize) -> &mut Staged {
        let plan = self.stored.clone();
        self.staged.get_or_insert(Staged {
            owner: by,
            plan,
            sent: BTreeSet::new(),
            route_sent: false,
            failed: false,
        })
    }

    fn route(&mut self, by: usize) {
        if let Some(staged) = self
            .staged
            .clone()
            .filter(|one| one.route_sent || one.failed)
        {
            self.drop_staged();
            if !staged.route_sent {
                let new = self.stage(by);
                for number in staged.sent {
                    new.sent.insert(number);
                    new.plan
                        .waypoints
                        .insert(number, staged.plan.waypoints[&number]);
                }
            }
        }
        let new = self.stage(by);
        (new.route_sent, new.plan.route) = (true, true);
    }

    fn waypoint(&mut self, by: usize, number: u16, serial: u16) {
        let staged = self.stage(by);
        staged.sent.insert(number);
        staged.plan.waypoints.insert(number, serial);
    }

    fn load(&mut self) -> Load {
        let plan = self
            .staged
            .as_ref()
            .map_or(&self.stored, |staged| &staged.plan);
        let reached: Vec<u16> = ROUTE
            .into_iter()
            .take_while(|number| plan.waypoints.contains_key(number))
            .collect();
        let complete = plan.route && reached.len() == ROUTE.len();
        if self.dropped {
            let whole = self.staged.as_ref().is_some_and(|staged| {
                staged.route_sent && reached.iter().all(|number| staged.sent.contains(number))
            });
            if !whole {
                self.drop_staged();
                return Load::No;
            }
            self.dropped = false;
        }
        // Waypoints without a 13001 are a flight where they are one chain from waypoint 1.
        let numbers = plan.waypoints.keys();
        let mut starts = numbers.filter(|number| !plan.waypoints.contains_key(&(*number - 1)));
        let is_chain = starts.next() == Some(&ROUTE[0]) && starts.next().is_none();
        if !plan.route && is_chain {
            if plan.waypoints.contains_key(&ROUTE[3]) {
                return Load::Done;
            }
            self.drop_staged();
            self.dropped = true;
            return Load::No;
        }
        if !plan.route {
            if let Some(staged) = &mut self.staged {
                staged.sent.clear();
                (staged.route_sent, staged.failed) = (false, true);
            }
            return Load::No;
        }
        if !complete {
            self.drop_staged();
            self.dropped = true;
            return Load::No;
        }
        Load::Done
    }

    fn loaded(&mut self) {
        if let Some(staged) = self.staged.take() {
            self.stored = staged.plan;
        }
    }
}

struct Run {
    scene: Scene,
    model: Model,
    /// What the vehicle carries is the stored plan.
    carried: bool,
    history: Vec<String>,
}

impl Run {
    fn expect(&self, answer: Option<AckType>, expected: Option<AckType>) {
        assert_eq!(answer, expected, "{:#?}\n{:?}", self.history, self.alerts());
    }

    fn alerts(&self) -> Vec<String> {
        let all = [A, B].map(|by| self.scene.rig.stations[by].alerts());
        all.concat()
    }

    fn give(&mut self, by: usize, message: impl Into<Message>) -> Option<AckType> {
        let ticket = self.scene.rig.send_as(by, 0, message);
        self.scene.end(by, ticket)
    }

    /// A part of an upload: its 13001, and some of its waypoints.
    fn send(&mut self, by: usize, route: bool, numbers: &[u16]) {
        let may = self.model.controller == Some(by);
        self.model.serial += 1;
        let serial = self.model.serial;
        let expected = if may { DONE } else { NO };
        if route {
            let answer = self.give(by, orders::route(1));
            self.expect(answer, expected);
            if may {
                self.model.route(by);
            }
        }
        for &number in numbers {
            let next = if number == ROUTE[3] { 0 } else { number + 1 };
            let up = 20.0 + f64::from(serial);
            let (north, east) = (f64::from(number) * 15.0, 10.0);
            let answer = self.give(by, orders::waypoint(number, next, north, east, up));
            self.expect(answer, expected);
            if may {
                self.model.waypoint(by, number, serial);
            }
        }
    }

    fn load(&mut self, by: usize) {
        let answer = self.give(by, orders::load());
        if self.model.controller != Some(by) || self.model.load() == Load::No {
            return self.expect(answer, NO);
        }
        self.expect(answer, DONE);
        self.model.loaded();
        self.carried = true;
    }

    /// A load that something else follows at once, in its middle.
    fn load_and(&mut self, by: usize, then: impl FnOnce(&mut Scene) -> bool) {
        let begins = self.model.load() == Load::Done;
        let upload = self.model.staged.is_some();
        let ticket = self.scene.rig.send_as(by, 0, orders::load());
        self.scene.rig.run(0.04);
        let cancelled = then(&mut self.scene);
        let answer = self.scene.end(by, ticket);
        if !begins {
            self.expect(answer, NO);
            if cancelled {
                self.model.drop_staged();
            }
        } else if answer == DONE {
            self.model.loaded();
            self.carried = true;
        } else {
            self.expect(answer, NO);
            self.carried = false;
            if cancelled {
                self.model.drop_staged();
            } else if upload && let Some(staged) = &mut self.model.staged {
                // Cut off by a restart: it can be repeated.
                staged.sent.clear();
                (staged.route_sent, staged.failed) = (false, true);
            }
        }
    }

    fn hand_over(&mut self, from: usize, to: usize) {
        let wish = self.scene.hand_over(to, to, CONTROL);
        self.scene.rig.run(0.2);
        let consent = self.scene.hand_over(from, to, CONTROL);
        let answers = (self.scene.end(from, consent), self.scene.end(to, wish));
        self.expect(answers.0, DONE);
        self.expect(answers.1, DONE);
        self.model.control(Some(to));
    }

    fn act(&mut self, random: &mut fastrand::Rng) {
        let by = if random.u8(0..5) == 0 {
            random.usize(A..=B)
        } else {
            self.model.controller.unwrap_or(A)
        };
        let holds = self.model.controller == Some(by);
        let choice = random.u8(0..30);
        self.history
            .push(format!("{by}: {choice} of {:?}", self.model));
        match choice {
            0..3 => {
                self.send(by, true, &ROUTE);
                self.load(by);
            }
            3..6 => self.send(by, true, &ROUTE[..2]),
            6..9 => self.send(by, false, &ROUTE[2..]),
            9 => self.send(by, true, &[]),
            10 => self.send(by, false, &ROUTE[1..2]),
            11..17 => self.load(by),
            17 | 18 => {
                let answer = self.give(by, orders::transfer(MissionPlanMode::Cancel));
                self.expect(answer, if holds { DONE } else { NO });
                if holds {
                    self.model.drop_staged();
                }
            }
            19 => {
                let answer = self.give(by, orders::transfer(MissionPlanMode::Clear));
                self.expect(answer, if holds { DONE } else { NO });
                if holds {
                    self.model.drop_staged();
                    self.model.stored = Plan::default();
                    self.carried = true;
                }
            }
            20 | 21 => {
                // B may override, A may not.
                let granted = by == B || self.model.controller.is_none_or(|holder| holder == by);
                let ticket = self.scene.ask(by, RequestedAccess::Override, CONTROL);
                let answer = self.scene.end(by, ticket);
                self.expect(answer, if granted { DONE } else { NO });
                if granted {
                    self.model.control(Some(by));
                }
            }
            22 => {
                let ticket = self.scene.ask(by, RequestedAccess::Relinquish, CONTROL);
                let answer = self.scene.end(by, ticket);
                self.expect(answer, DONE);
                if holds {
                    self.model.control(None);
                }
            }
            23 if holds => self.hand_over(by, 1 - by),
            24 => {
                self.scene.rig.restart_bridge();
                self.scene.rig.run(3.0);
            }
            25 if holds => self.load_and(by, |scene| {
                scene.rig.restart_bridge();
                scene.rig.run(3.0);
                false
            }),
            26 if holds => self.load_and(by, |scene| {
                let cancel = orders::transfer(MissionPlanMode::Cancel);
                let ticket = scene.rig.send_as(by, 0, cancel);
                assert_eq!(scene.end(by, ticket), DONE);
                true
            }),
            27 if self.model.controller == Some(A) => {
                // Control passes once the load has ended.
                let mut wish = None;
                self.load_and(A, |scene| {
                    wish = Some(scene.ask(B, RequestedAccess::Override, CONTROL));
                    false
                });
                let answer = wish.and_then(|wish| self.scene.end(B, wish));
                self.expect(answer, DONE);
                self.model.control(Some(B));
            }
            28 if random.u8(0..4) == 0 => {
                self.scene.rig.run(301.0);
                self.model.drop_staged();
            }
            _ => {}
        }
        self.check();
    }

    fn check(&mut self) {
        let stored = &self.model.stored;
        if self.carried {
            let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
            let items = self.scene.rig.vehicles[0].vehicle().plan(kind).iter();
            let flown: Vec<u16> = items.map(|item| (item.z - 20.0).round() as u16).collect();
            let expected: Vec<u16> = stored.waypoints.values().copied().collect();
            assert_eq!(flown, expected, "{:#?}", self.history);
        }
        let Some(by) = self.model.controller else {
            return;
        };
        let mark = self.scene.rig.stations[by].received.len();
        let answer = self.give(by, orders::transfer(MissionPlanMode::Download));
        let nothing = self.model.stored.waypoints.is_empty();
        self.expect(answer, if nothing { NO } else { DONE });
        let received = self.scene.rig.stations[by].received[mark..].iter();
        let downloaded: Waypoints = received
            .filter_map(|(_, _, message)| match message {
                Message::UaPositionWaypoint(one) => {
                    let up = one.waypoint_to_altitude?.si();
                    Some((one.waypoint_number?, (up - 20.0).round() as u16))
                }
                _ => None,
            })
            .collect();
        assert_eq!(
            downloaded, self.model.stored.waypoints,
            "{:#?}",
            self.history
        );
    }
}

#[test]
fn no_interleaving_of_two_stations_mixes_plans_or_loads_what_was_dropped() {
    let seeds = std::env::var("VSM_SEEDS")
        .ok()
        .and_then(|all| all.parse().ok());
    let (mut loads, mut drops) = (0, 0);
    for seed in 0..seeds.unwrap_or(8) {
        let mut run = Run {
            scene: Scene::controlled(),
            model: Model {
                controller: Some(A),
                ..Model::default()
            },
            carried: false,
            history: vec![format!("seed {seed}")],
        };
        let mut random = fastrand::Rng::with_seed(seed);
        for _ in 0..40 {
            let (plan, dropped) = (run.model.stored.waypoints.clone(), run.model.dropped);
            run.act(&mut random);
            loads += u32::from(plan != run.model.stored.waypoints);
            drops += u32::from(!dropped && run.model.dropped);
        }
    }
    assert!(loads > 10 && drops > 10, "{loads} loads, {drops} dropped");
}
