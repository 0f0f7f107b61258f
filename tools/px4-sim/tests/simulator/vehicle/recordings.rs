//! Sends the requests of recorded sessions with a real PX4 v1.18 to the simulated one, at their recorded times or,
//! where the ground station reacted to the vehicle, in reaction to the simulated one; the answers have to be the
//! recorded ones. Remaining differences are named here, with the reason.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use kit::captures::{self, Datagram};
use mavlink::dialects::development::MavMessage;
use mavlink_link::frame::{FrameView, MAX_FRAME, Parser};
use px4_sim::{Airframe, Autopilot, Config, Geodetic, Signing};

fn recording(names: &[&str]) -> Vec<Datagram> {
    names.iter().flat_map(|name| captures::read(name)).collect()
}

/// The parts of an answer that have to be equal; times and free-running values do not.
#[derive(Debug, Default, PartialEq)]
struct Answers {
    commands: Vec<(u16, u8)>,
    missions: Vec<(u8, u8)>,
    parameter_errors: Vec<(String, u8)>,
    /// MISSION_REQUEST and MISSION_REQUEST_INT in order, repetitions left out.
    requests: Vec<(u32, u16)>,
    /// MISSION_ITEM_REACHED in order, repetitions left out.
    reached: Vec<u16>,
    texts: BTreeSet<String>,
    modes: BTreeSet<u32>,
    /// Lasting states in order, repetitions left out: custom_mode, whether it flies on wings, whether it is on the
    /// ground.
    course: [Vec<u32>; 3],
    /// How often the vehicle has sent each message to which a ground station reacts.
    cues: BTreeMap<Cue, u32>,
    /// The latest of these.
    last: Option<Cue>,
}

/// A message that a ground station reacts to: its id, and the item or command that it is about.
type Cue = (u32, u16);

impl Answers {
    fn take(&mut self, bytes: &[u8]) {
        let mut parser = Parser::new();
        let mut frames = parser.feed(bytes);
        while let Some(found) = frames.next() {
            if let Ok(view) = found {
                self.take_frame(&view);
            }
        }
    }

    fn take_frame(&mut self, view: &FrameView<'_>) {
        let payload = |i: usize| view.payload().get(i).copied().unwrap_or(0);
        let words = |bytes: &[u8]| -> String {
            bytes
                .iter()
                .take_while(|o| **o != 0)
                .map(|o| char::from(*o))
                .collect()
        };
        let about = u16::from_le_bytes([payload(0), payload(1)]);
        if let id @ (40 | 46 | 47 | 51 | 77) = view.header().message_id {
            *self.cues.entry((id, about)).or_default() += 1;
            self.last = Some((id, about));
        }
        match (view.header().message_id, view.message()) {
            (46, _) if self.reached.last() != Some(&about) => self.reached.push(about),
            // The real vehicle's gimbal manager commands itself.
            (77, _) if about == 211 => {}
            (77, _) => self.commands.push((about, payload(2))),
            (47, _) => self.missions.push((payload(2), payload(3))),
            (id @ (40 | 51), _) => {
                let request = (id, about);
                if self.requests.last() != Some(&request) {
                    self.requests.push(request);
                }
            }
            (_, Ok(MavMessage::PARAM_ERROR(e))) => {
                self.parameter_errors
                    .push((words(&e.param_id[..]), e.error as u8));
            }
            (_, Ok(MavMessage::STATUSTEXT(t))) if t.chunk_seq == 0 => {
                self.texts.insert(words(&t.text[..]));
            }
            (_, Ok(MavMessage::HEARTBEAT(h))) => {
                self.modes.insert(h.custom_mode);
                self.enters(0, h.custom_mode);
            }
            (_, Ok(MavMessage::EXTENDED_SYS_STATE(state))) => {
                // A transient state is sent once a second at most, and so by chance: only hover and wings, ground and
                // air are compared.
                if let vtol @ (3 | 4) = state.vtol_state as u32 {
                    self.enters(1, vtol);
                }
                if let landed @ (1 | 2) = state.landed_state as u32 {
                    self.enters(2, landed);
                }
            }
            _ => {}
        }
    }
}

impl Answers {
    fn enters(&mut self, which: usize, state: u32) {
        if self.course[which].last() != Some(&state) {
            self.course[which].push(state);
        }
    }

    /// How many of each event there were: the other vehicle has to have as many before the ground station's next
    /// request.
    fn events(&self) -> [usize; 7] {
        let [modes, wings, landed] = [0, 1, 2].map(|which: usize| self.course[which].len());
        let (commands, missions) = (self.commands.len(), self.missions.len());
        [
            modes,
            wings,
            landed,
            commands,
            missions,
            self.requests.len(),
            self.reached.len(),
        ]
    }
}

/// The recorded answers, and those of the simulated vehicle.
fn replay(names: &[&str], config: Config, booted_s: f64) -> (Answers, Answers) {
    let (mut real, mut ours) = (Answers::default(), Answers::default());
    let datagrams = recording(names);
    let mut autopilot = Autopilot::new(config, Signing::off(), vec![Some(0_u8)]);
    let mut out = [0; MAX_FRAME];
    let mut answer = |autopilot: &mut Autopilot<u8>, span: Duration, ours: Option<&mut Answers>| {
        autopilot.step(span);
        let mut sink = Answers::default();
        let sink = ours.unwrap_or(&mut sink);
        while let Some(t) = autopilot.poll_transmit(&mut out) {
            sink.take(&out[..t.len]);
        }
    };
    answer(&mut autopilot, Duration::from_secs_f64(booted_s), None);
    let mut now = datagrams[0].at;
    for datagram in &datagrams {
        answer(&mut autopilot, datagram.at - now, Some(&mut ours));
        now = datagram.at;
        if datagram.from_autopilot {
            real.take(&datagram.bytes);
        } else {
            autopilot.handle_datagram(0, 0, &datagram.bytes);
        }
    }
    answer(&mut autopilot, Duration::from_secs(2), Some(&mut ours));
    (real, ours)
}

/// The same, where the ground station reacted to the vehicle: a request at once behind a message of the vehicle is
/// sent behind the same message of the simulated one, and everything after it keeps its distance in time.
fn replay_reacting(name: &str, config: Config) -> (Answers, Answers) {
    let (mut real, mut ours) = (Answers::default(), Answers::default());
    let datagrams = recording(&[name]);
    let mut autopilot = Autopilot::new(config, Signing::off(), vec![Some(0_u8)]);
    let mut out = [0; MAX_FRAME];
    let mut step = |autopilot: &mut Autopilot<u8>, ours: &mut Answers| {
        autopilot.step(STEP);
        while let Some(t) = autopilot.poll_transmit(&mut out) {
            ours.take(&out[..t.len]);
        }
    };
    let start = datagrams[0].at;
    let (mut clock, mut late, mut cue_at) = (Duration::ZERO, Duration::ZERO, Duration::ZERO);
    for datagram in &datagrams {
        let at = datagram.at - start;
        if datagram.from_autopilot {
            let cues: u32 = real.cues.values().sum();
            real.take(&datagram.bytes);
            if real.cues.values().sum::<u32>() > cues {
                cue_at = datagram.at;
            }
            continue;
        }
        let reaction = datagram.at - cue_at < AT_ONCE;
        match real.last.filter(|_| reaction) {
            Some(cue) => {
                let limit = clock + Duration::from_secs(60);
                while ours.cues.get(&cue) < real.cues.get(&cue) {
                    assert!(clock < limit, "{cue:?} does not come: {ours:?}");
                    step(&mut autopilot, &mut ours);
                    clock += STEP;
                }
                late = clock.saturating_sub(at);
            }
            None => {
                while clock < at + late {
                    step(&mut autopilot, &mut ours);
                    clock += STEP;
                }
            }
        }
        autopilot.handle_datagram(0, 0, &datagram.bytes);
    }
    for _ in 0..1_000 {
        step(&mut autopilot, &mut ours);
    }
    (real, ours)
}

/// The same for a flight at another speed: what the real vehicle reached (a mode, wings, the ground, an item) before
/// a request, the simulated one has to reach before it too, and the request keeps its distance in time from that.
fn replay_in_step(name: &str, config: Config) -> (Answers, Answers) {
    let (mut real, mut ours) = (Answers::default(), Answers::default());
    let datagrams = recording(&[name]);
    let mut autopilot = Autopilot::new(config, Signing::off(), vec![Some(0_u8)]);
    let mut out = [0; MAX_FRAME];
    let mut step = |autopilot: &mut Autopilot<u8>, ours: &mut Answers| {
        autopilot.step(STEP);
        while let Some(t) = autopilot.poll_transmit(&mut out) {
            ours.take(&out[..t.len]);
        }
    };
    for _ in 0..5_000 {
        step(&mut autopilot, &mut Answers::default());
    }
    let start = datagrams[0].at;
    let (mut clock, mut late) = (Duration::ZERO, Duration::ZERO);
    for datagram in &datagrams {
        let at = datagram.at - start;
        if datagram.from_autopilot {
            let before = real.events();
            real.take(&datagram.bytes);
            if real.events() == before {
                continue;
            }
            let limit = clock + Duration::from_secs(300);
            while ours
                .events()
                .iter()
                .zip(real.events())
                .any(|(ours, real)| *ours < real)
            {
                assert!(
                    clock < limit,
                    "at {at:?} the real one came to {real:?}\nours to {ours:?}"
                );
                step(&mut autopilot, &mut ours);
                clock += STEP;
            }
            late = late.max(clock.saturating_sub(at));
        } else {
            while clock < at + late {
                step(&mut autopilot, &mut ours);
                clock += STEP;
            }
            autopilot.handle_datagram(0, 0, &datagram.bytes);
        }
    }
    for _ in 0..1_000 {
        step(&mut autopilot, &mut ours);
    }
    (real, ours)
}

/// At the place of PX4's built-in simulation, at altitude 0.
fn winged(airframe: Airframe) -> Config {
    Config {
        airframe,
        home: Geodetic {
            latitude_deg: 47.397_742,
            longitude_deg: 8.545_594,
            altitude_m: 0.02,
        },
        ..Config::default()
    }
}

/// Compares what is equal on every flight of one kind.
fn compare_flights(name: &str, config: Config) {
    let (mut real, mut ours) = replay_in_step(name, config);
    assert_eq!(ours.commands, real.commands);
    assert_eq!(ours.missions, real.missions);
    assert_eq!(ours.requests, real.requests);
    assert_eq!(ours.reached, real.reached);
    assert_eq!(ours.course, real.course);
    // The log file and the sensors are the real vehicle's own, and the simulated one had no ground station before the
    // recording. For missions that it cannot fly the real one sent no text in these runs, but did in others. The
    // simulated one does not report how high it holds after a go-around, nor that a wing below its route climbs
    // first.
    // go-around, nor that a wing below its route climbs before it flies on.
    let own = |t: &String| {
        let begins = [
            "[logger]",
            "Preflight Fail",
            "GCS connection",
            "Connection to ground",
            "Mission rejected",
            "Holding at",
            "Climb to",
        ];
        begins.iter().any(|words| t.starts_with(words))
    };
    real.texts.retain(|t| !own(t));
    ours.texts.retain(|t| !own(t));
    assert_eq!(ours.texts, real.texts);
}

#[test]
fn the_flight_of_a_fixed_wing_is_answered_alike() {
    compare_flights("07-fixed-wing-flight", winged(Airframe::Plane));
}

#[test]
fn the_flight_of_a_vtol_is_answered_alike() {
    compare_flights("08-vtol-flight", winged(Airframe::Vtol));
}

const STEP: Duration = Duration::from_millis(4);
/// A request within this time after a message of the vehicle is a reaction to it.
const AT_ONCE: Duration = Duration::from_millis(20);

#[test]
fn parameters_commands_and_uploads_are_answered_alike() {
    let (mut real, ours) = replay(&["02-params-mission-upload"], Config::default(), 8.0);
    // A second ground station's MISSION_COUNT during a transfer came over a socket that was not recorded.
    let second = real.missions.iter().position(|ack| *ack == (1, 0)).unwrap();
    real.missions.remove(second);
    assert_eq!(ours.commands, real.commands);
    assert_eq!(ours.missions, real.missions);
    assert_eq!(ours.parameter_errors, real.parameter_errors);
    assert_eq!(ours.texts, real.texts);
    assert_eq!(ours.modes, real.modes);
    assert_eq!(ours.requests, real.requests);
}

#[test]
fn a_flight_is_answered_alike() {
    let (mut real, mut ours) = replay(
        &[
            "03-arm-takeoff-mission-landa",
            "03-arm-takeoff-mission-landb",
        ],
        Config::default(),
        8.0,
    );
    assert_eq!(ours.commands, real.commands);
    assert_eq!(ours.missions, real.missions);
    assert_eq!(ours.parameter_errors, real.parameter_errors);
    assert_eq!(ours.requests, real.requests);
    // The simulated vehicle had no ground station before the recording. The real one reports its log file, and its
    // home is 1.4 m higher, which shows in the figures of a return.
    let figures = |t: &String| {
        t.starts_with("GCS connection") || t.starts_with("[logger]") || t.starts_with("RTL: start")
    };
    real.texts.retain(|t| !figures(t));
    ours.texts.retain(|t| !figures(t));
    assert_eq!(ours.texts, real.texts);
    // Heartbeats come once a second, so each run misses other short modes.
    let common = ours.modes.intersection(&real.modes).count();
    assert!(
        common + 1 >= real.modes.len() && common + 1 >= ours.modes.len(),
        "{ours:?} {real:?}"
    );
}

#[test]
fn another_plan_in_flight_and_a_lost_ground_station_are_answered_alike() {
    let config = Config {
        system_id: 6,
        ..Config::default()
    };
    let (mut real, mut ours) = replay_reacting("06-reupload-failsafe", config);
    assert_eq!(ours.commands, real.commands);
    assert_eq!(ours.missions, real.missions);
    assert_eq!(ours.parameter_errors, real.parameter_errors);
    assert_eq!(ours.requests, real.requests);
    // Whether the last climb ends before the next command depends on the altitude at which it begins.
    assert!(ours.reached.len() >= 2, "{:?}", ours.reached);
    assert!(real.reached.starts_with(&ours.reached), "{ours:?} {real:?}");
    // The figures of a return differ with home's altitude, and the log file is the real vehicle's own.
    let figures = |t: &String| {
        t.starts_with("[logger]") || t.starts_with("RTL: start") || t.starts_with("Climb")
    };
    real.texts.retain(|t| !figures(t));
    ours.texts.retain(|t| !figures(t));
    assert_eq!(ours.texts, real.texts);
    let common = ours.modes.intersection(&real.modes).count();
    assert!(
        common + 1 >= real.modes.len() && common + 1 >= ours.modes.len(),
        "{ours:?} {real:?}"
    );
}
