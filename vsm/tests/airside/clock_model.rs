//! Every short history of wall clocks that are set by up to ten years, on ground and agent, with restarts of ground, agent
//! and vehicle in between, over the real machines: [`Agent`], and the link and receiver that the bridge has.
//!
//! A state is the history that led to it; two histories are one state where everything that decides about frames is the
//! same: wall clocks, signing clocks, what is stored, how the links stand. From every state two things must follow: without
//! a person, and whatever the wall clocks say, both ends are live and a command of the ground reaches the vehicle within
//! [`HEALED_S`]; and nothing that was ever recorded is accepted.

use std::hash::{Hash, Hasher};
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Ceiling;
use mavlink_link::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::Endpoint;
use mavlink_link::signing::{Stamp, sign, verify};
use mavlink_link::store::Store as _;
use stateright::{Checker as _, Model, Property};
use vsm::airside::{Agent, Settings, Side};

use crate::world::{Disk, GROUND, Ground, PX4, STRANGER, at, key, settings, start};

const TICK: Duration = Duration::from_millis(250);
/// Within this time of the last step or restart everything is well again.
const HEALED_S: u32 = 8;
/// 2026-11-21 07:31 UTC.
const REAL: Duration = Duration::from_secs(1_795_246_260);

/// By how much a wall clock is wrong, s: 2 h, 300 days, ten years.
const WRONG: [i64; 5] = [0, 7_200, 300 * 86_400, 3_653 * 86_400, -3_653 * 86_400];
/// No signing clock is ever further ahead than the wall clock that it may believe, and what is written ahead.
const MAX_AHEAD: Duration = Duration::from_secs(301 * 86_400);

/// One thing that happens; a quarter of a second later the next may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Happens {
    GroundWall(usize),
    AirWall(usize),
    GroundRestarts,
    AgentRestarts,
    VehicleRestarts,
    AllRestart,
    /// Four seconds.
    Nothing,
}

/// Signs and judges as PX4 does: no wall clock, one stamp a packet, lifted by what verifies, back at the first at a start.
struct Vehicle {
    stamp: Stamp,
    streams: Vec<((u8, u8, u8), Stamp)>,
    answers: Vec<Vec<u8>>,
}

impl Vehicle {
    fn new() -> Vehicle {
        Vehicle {
            stamp: Stamp::new(1),
            streams: vec![],
            answers: vec![],
        }
    }

    fn take(&mut self, bytes: &[u8]) -> bool {
        let frame = FrameView::parse(bytes).unwrap();
        let (header, signature) = (frame.header(), frame.signature().unwrap());
        assert!(verify(&key(5), &frame).is_ok());
        let name = (header.system_id, header.component_id, signature.link_id);
        let known = self.streams.iter_mut().find(|(stream, _)| *stream == name);
        match known {
            Some((_, last)) if signature.stamp <= *last => return false,
            Some((_, last)) => *last = signature.stamp,
            None if signature.stamp.plus(Duration::from_secs(60)) < self.stamp => return false,
            None => self.streams.push((name, signature.stamp)),
        }
        self.stamp = self.stamp.max(signature.stamp);
        #[allow(deprecated, reason = "PX4 answers it")]
        if let Ok(MavMessage::PING(mut ping)) = frame.message()
            && ping.target_system == 0
        {
            (ping.target_system, ping.target_component) = (header.system_id, header.component_id);
            let answer = self.frame(&MavMessage::PING(ping));
            self.answers.push(answer);
        }
        true
    }

    fn frame(&mut self, message: &MavMessage) -> Vec<u8> {
        let header = Header {
            system_id: 1,
            component_id: 1,
            incompat: INCOMPAT_SIGNED,
            ..Header::default()
        };
        let mut out = [0; MAX_FRAME];
        let len = encode(message, header, &mut out);
        let len = sign(&key(5), 0, self.stamp, &mut out, len).unwrap();
        self.stamp = self.stamp.next().unwrap();
        out[..len].to_vec()
    }

    fn sends(&mut self) -> Vec<Vec<u8>> {
        let beat = self.frame(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::default()
        }));
        let mut sent = std::mem::take(&mut self.answers);
        sent.push(beat);
        sent
    }
}

struct World {
    elapsed: Duration,
    wrong: [usize; 2],
    ground: Ground,
    agent: Agent,
    disk: Disk,
    vehicle: Vehicle,
    /// Frames on the radio, up and down.
    recorded: [Vec<Vec<u8>>; 2],
    /// Frames of the ground that the vehicle has taken.
    taken: Vec<Vec<u8>>,
    air_stamp: Stamp,
}

fn air() -> Settings {
    Settings {
        radio: Endpoint::Listen,
        ..settings()
    }
}

impl World {
    fn new() -> World {
        let now = Now {
            mono: Duration::ZERO,
            wall: REAL,
        };
        let mut disk = Disk::with(Some(key(5)));
        let mut world = World {
            elapsed: Duration::ZERO,
            wrong: [0; 2],
            ground: Ground::new(key(5), now),
            agent: start(air(), &mut disk, now),
            disk,
            vehicle: Vehicle::new(),
            recorded: [vec![], vec![]],
            taken: vec![],
            air_stamp: Stamp::ZERO,
        };
        world.run(4);
        world
    }

    fn after(history: &[Happens]) -> World {
        let mut world = World::new();
        for &what in history {
            world.happens(what);
        }
        world
    }

    fn now(&self, whose: usize) -> Now {
        let wall = (REAL + self.elapsed).as_secs_f64() + WRONG[self.wrong[whose]] as f64;
        Now {
            mono: self.elapsed,
            wall: Duration::from_secs_f64(wall),
        }
    }

    fn happens(&mut self, what: Happens) {
        match what {
            Happens::GroundWall(wrong) => self.wrong[0] = wrong,
            Happens::AirWall(wrong) => self.wrong[1] = wrong,
            Happens::GroundRestarts => self.ground.restart(self.now(0)),
            Happens::AgentRestarts => self.restart_agent(),
            Happens::VehicleRestarts => self.vehicle = Vehicle::new(),
            Happens::AllRestart => {
                self.ground.restart(self.now(0));
                self.restart_agent();
                self.vehicle = Vehicle::new();
            }
            Happens::Nothing => self.run(4),
        }
        self.tick();
    }

    fn restart_agent(&mut self) {
        let now = self.now(1);
        self.agent = start(air(), &mut self.disk, now);
    }

    fn run(&mut self, seconds: u32) {
        for _ in 0..seconds * 4 {
            self.tick();
        }
    }

    fn tick(&mut self) {
        self.elapsed += TICK;
        for bytes in self.vehicle.sends() {
            let now = self.now(1);
            self.agent.handle_px4(now, at(PX4), &bytes, &mut self.disk);
            self.drain();
        }
        for bytes in self.ground.beat(self.now(0)) {
            self.recorded[0].push(bytes.clone());
            self.radio(GROUND, &bytes);
        }
        let now = self.now(1);
        self.agent.handle_timeout(now, &mut self.disk);
        self.drain();
    }

    fn radio(&mut self, from: u16, bytes: &[u8]) {
        let mut random = |out: &mut [u8]| {
            out.fill(9);
            Ok(())
        };
        let now = self.now(1);
        self.agent
            .handle_radio(now, at(from), bytes, &mut random, &mut self.disk);
        self.drain();
    }

    fn drain(&mut self) {
        let mut out = [0; MAX_FRAME];
        let now = self.now(1);
        while let Some(sent) = self.agent.poll_transmit(now, &mut self.disk, &mut out) {
            let bytes = out[..sent.len].to_vec();
            let frame = FrameView::parse(&bytes).unwrap();
            match sent.side {
                Side::Px4 => {
                    let of_ground = frame.header().system_id == 245;
                    if self.vehicle.take(&bytes) && of_ground {
                        self.taken.push(bytes);
                    }
                }
                Side::Radio => {
                    if frame.header().component_id == 191 {
                        self.air_stamp = frame.signature().unwrap().stamp;
                    }
                    self.recorded[1].push(bytes.clone());
                    if sent.to == at(GROUND) {
                        let now = self.now(0);
                        self.ground.take(now, &bytes);
                    }
                }
            }
        }
    }

    /// Both ends are live and answered.
    fn is_live(&self) -> bool {
        let air = self.agent.status(String::new(), self.elapsed);
        let answered = |age: Option<Duration>| age.is_some_and(|age| age <= Duration::from_secs(5));
        let ground = &self.ground.link;
        ground.state() == mavlink_link::link::LinkState::Live
            && answered(ground.unanswered(self.elapsed))
            && air.radio.state == "live"
            && air.px4.state == "live"
    }

    /// Whether a frame that the ground makes now reaches the vehicle.
    fn commands(&mut self) -> bool {
        let now = self.now(0);
        let bytes = self
            .ground
            .frame(now, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        self.radio(GROUND, &bytes);
        self.recorded[0].push(bytes.clone());
        self.taken.last() == Some(&bytes)
    }

    /// How many recorded frames are accepted, at either end.
    fn replays(&mut self) -> usize {
        let [up, down] = std::mem::take(&mut self.recorded);
        let (taken, received) = (self.taken.len(), self.ground.received.len());
        for bytes in up {
            self.radio(STRANGER, &bytes);
        }
        let now = self.now(0);
        for bytes in down {
            self.ground.take(now, &bytes);
        }
        self.taken.len() - taken + self.ground.received.len() - received
    }

    fn stored(&self) -> [Stamp; 2] {
        let id = key(5).id();
        [&self.ground.disk, &self.disk.ceilings].map(|disk| {
            let stored = disk.load::<Ceiling>(&id).unwrap();
            stored.map_or(Stamp::ZERO, |Ceiling(stamp)| stamp)
        })
    }

    /// What decides about frames, in half hours from the right time: finer differences are followed by every end.
    fn digest(&self) -> Vec<i64> {
        let real = Stamp::from_unix(REAL + self.elapsed).get() as i64;
        let near = |stamp: Stamp| (stamp.get() as i64 - real).div_euclid(180_000_000);
        let clock = self.ground.key.clock();
        let air = self.agent.status(String::new(), self.elapsed);
        let states = ["waiting", "live", "silent", "unanswered", "behind", "ahead"];
        let named = |name: &str| states.iter().position(|state| *state == name).unwrap() as i64;
        let mut digest = vec![
            self.wrong[0] as i64,
            self.wrong[1] as i64,
            near(clock.reading(self.now(0))),
            near(clock.floor()),
            near(self.air_stamp),
            // The vehicle's own stamp right after a start is a small number, whatever the time.
            near(self.vehicle.stamp.max(Stamp::from_unix(REAL / 2))),
            self.ground.link.state() as i64,
            clock.wall_state() as i64,
            i64::from(self.ground.link.peer().is_some()),
            named(air.radio.state),
            named(air.px4.state),
            i64::from(air.radio.peer.is_some()),
        ];
        digest.extend(self.stored().map(near));
        digest.extend(self.vehicle.streams.iter().map(|(_, last)| near(*last)));
        digest
    }
}

#[derive(Debug, Clone)]
struct State {
    history: Vec<Happens>,
    digest: Vec<i64>,
    accepted_replays: usize,
    heals: bool,
    bounded: bool,
}

impl PartialEq for State {
    fn eq(&self, other: &State) -> bool {
        self.digest == other.digest
    }
}

impl Eq for State {}

impl Hash for State {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.digest.hash(state);
    }
}

impl State {
    fn of(history: Vec<Happens>) -> State {
        let mut world = World::after(&history);
        let digest = world.digest();
        // Right after a restart a frame that was refused before may still come late, for the first time: never twice.
        let refused: Vec<Vec<u8>> = world.recorded[0].clone();
        let late = refused
            .iter()
            .filter(|one| !world.taken.contains(one))
            .count();
        let accepted_replays = world.replays().saturating_sub(late);
        world.recorded[0] = refused;
        world.run(HEALED_S);
        let heals = world.is_live() && world.commands();
        let most = Stamp::from_unix(REAL + world.elapsed).plus(MAX_AHEAD);
        State {
            history,
            digest,
            accepted_replays: accepted_replays + world.replays(),
            heals,
            bounded: world.stored().iter().all(|stored| *stored <= most),
        }
    }
}

struct Clocks {
    depth: usize,
}

impl Model for Clocks {
    type State = State;
    type Action = Happens;

    fn init_states(&self) -> Vec<State> {
        vec![State::of(vec![])]
    }

    fn actions(&self, state: &State, actions: &mut Vec<Happens>) {
        if state.history.len() >= self.depth {
            return;
        }
        for wrong in 0..WRONG.len() {
            if state.digest[0] != wrong as i64 {
                actions.push(Happens::GroundWall(wrong));
            }
            if state.digest[1] != wrong as i64 {
                actions.push(Happens::AirWall(wrong));
            }
        }
        actions.extend([
            Happens::GroundRestarts,
            Happens::AgentRestarts,
            Happens::VehicleRestarts,
            Happens::AllRestart,
            Happens::Nothing,
        ]);
    }

    fn next_state(&self, last: &State, action: Happens) -> Option<State> {
        let mut history = last.history.clone();
        history.push(action);
        Some(State::of(history))
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always(
                "both ends are live and a command passes",
                |_, state: &State| state.heals,
            ),
            Property::always("no recording is accepted", |_, state: &State| {
                state.accepted_replays == 0
            }),
            Property::always("no clock runs away", |_, state: &State| state.bounded),
        ]
    }
}

fn check(depth: usize, min_states: usize) {
    let checker = Clocks { depth }.checker().threads(1).spawn_bfs().join();
    checker.assert_properties();
    let states = checker.unique_state_count();
    assert!(
        states >= min_states,
        "{states} states: the model does not move"
    );
}

#[test]
fn every_history_of_three_steps_and_restarts_heals() {
    check(3, 100);
}

/// Minutes; run by hand: `cargo test -p vsm --test airside every_history_of_five -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn every_history_of_five_steps_and_restarts_heals() {
    check(5, 1_000);
}
