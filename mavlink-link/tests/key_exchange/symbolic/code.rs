//! The model against the code: the real machines are led along histories of the model. What they send must be, byte for
//! byte, the model's terms; what they accept and store must be what the model accepts and stores.

use core::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Identity, Inbound, Initiator, InitiatorConfig, InitiatorEvent, InitiatorStore as _, Message,
    PairingCode, PinnedPeer, PublicKey, Received, Responder, ResponderConfig, Step, Trust,
};

use super::ends::{Phase, State};
use super::search::{Action, Scope};
use super::terms::{Name, Term, key_pair, secret_bytes, value};
use crate::disks::{AirDisk, GroundDisk, Key};
use crate::world::{AIR, GROUND, HONEST, WANTED, parties, wire};

/// Longer than any attempt, pause and half-open session.
const LONG: Duration = Duration::from_secs(61);

pub(super) struct Code {
    ground: Initiator,
    air: Responder<u8>,
    ground_disk: GroundDisk,
    air_disk: AirDisk,
    /// The two have clocks of their own, so that one can give up before the other.
    clocks: [Duration; 2],
    sent: Vec<Vec<u8>>,
}

fn key(term: Term) -> Key {
    value(term).try_into().unwrap()
}

pub(super) fn identity(name: Name) -> Identity {
    Identity::new(secret_bytes(name).try_into().unwrap())
}

pub(super) fn public(name: Name) -> PublicKey {
    PublicKey::new(*key_pair(name).1.as_bytes())
}

fn code() -> PairingCode {
    PairingCode::parse(&"A".repeat(32)).unwrap()
}

fn initiator(disk: &GroundDisk, now: Duration) -> Initiator {
    let trust = disk
        .peer
        .map_or_else(|| Trust::Pairing(code()), Trust::Pinned);
    let identity = identity(Name::Ground);
    let config = InitiatorConfig {
        parties: parties(),
        identity,
        trust,
        wanted: WANTED,
    };
    Initiator::new(config, disk.memory(), now)
}

pub(super) fn responder(disk: &AirDisk, now: Duration) -> Responder<u8> {
    let identity = identity(Name::Air);
    let config = ResponderConfig {
        parties: parties(),
        identity,
        wanted: WANTED,
    };
    Responder::new(config, disk.memory(), now)
}

impl Code {
    fn new(state: &State) -> Code {
        let mut ground_disk = GroundDisk::default();
        let mut air_disk = AirDisk::default();
        ground_disk.current = state.ground.current.map(key);
        ground_disk.peer = state.ground.peer.map(public);
        air_disk.current = state.air.current.map(key);
        let pinned = |(name, counter): (Name, u8)| PinnedPeer {
            key: public(name),
            counter: counter.into(),
        };
        air_disk.peer = state.air.peer.map(pinned);
        let now = Duration::from_secs(1);
        Code {
            ground: initiator(&ground_disk, now),
            air: responder(&air_disk, now),
            ground_disk,
            air_disk,
            clocks: [now; 2],
            sent: vec![],
        }
    }

    /// Random bytes as the model names them: a session is its number, an ephemeral key that of its session or answer.
    fn random(
        session: u8,
        ephemeral: Name,
    ) -> impl FnMut(&mut [u8]) -> Result<(), mavlink_link::exchange::NoRandom> {
        move |out: &mut [u8]| {
            match out.len() {
                4 => out.copy_from_slice(&[session, 0, 0, 0]),
                32 => out.copy_from_slice(&secret_bytes(ephemeral)),
                _ => out.fill(0),
            }
            Ok(())
        }
    }

    fn begin(&mut self, waits: bool, session: u8) {
        self.ground.want();
        let mut random = Self::random(session, Name::GroundOnce(session));
        for _ in 0..4 {
            self.clocks[0] += LONG;
            if waits {
                self.clocks[1] += LONG;
                self.air.handle_timeout(self.clocks[1]);
            }
            // Its counter is then one more than the last.
            let now = Now {
                mono: self.clocks[0],
                wall: Duration::ZERO,
            };
            self.ground
                .handle_timeout(now, &mut random, &mut self.ground_disk);
            let message = self.ground.poll_transmit();
            if let Some(message) = message.filter(|message| message.session == u32::from(session)) {
                assert_eq!(message.step, Step::Offer);
                self.sent.push(wire(&message.to_payload()));
                return;
            }
        }
        panic!("it does not begin");
    }

    fn deliver(&mut self, payload: &[u8], answers: u8) {
        let Ok(Received::Exchange(message)) = Message::parse(payload) else {
            panic!("the model has made what cannot be read");
        };
        let up = matches!(message.step, Step::Offer | Step::Confirm);
        let source = if up { GROUND } else { AIR };
        if up {
            // Time for the rate limit.
            self.clocks[1] += Duration::from_millis(250);
            let inbound = Inbound {
                from: HONEST,
                source,
                verified: false,
                payload,
            };
            let mut random = Self::random(0, Name::AirOnce(answers));
            let _ = self
                .air
                .handle(self.clocks[1], inbound, &mut random, &mut self.air_disk);
        } else {
            let inbound = Inbound {
                from: (),
                source,
                verified: false,
                payload,
            };
            let now = Now {
                mono: self.clocks[0],
                wall: Duration::ZERO,
            };
            let _ = self.ground.handle(now, inbound, &mut self.ground_disk);
        }
        let answers = std::iter::from_fn(|| self.air.poll_transmit());
        let answers: Vec<_> = answers.map(|out| out.message).collect();
        for message in answers.into_iter().chain(self.ground.poll_transmit()) {
            if message.step != Step::Reject {
                self.sent.push(wire(&message.to_payload()));
            }
        }
        while let Some(event) = self.ground.poll_event() {
            let first = self.ground_disk.current.is_none();
            if first && matches!(event, InitiatorEvent::Agreed { .. }) {
                self.ground_disk.current = self.ground_disk.next.take();
                self.ground.key_in_use(&mut self.ground_disk).unwrap();
            }
        }
    }

    fn act(&mut self, action: Action, before: &State, after: &State) {
        match action {
            Action::Begin => self.begin(before.ground.waits(), after.sessions),
            Action::Deliver(content) => {
                let mut state = before.clone();
                let message = state.deliver(content, None).unwrap();
                self.deliver(&wire(&value(message.wire)), after.answers);
            }
            Action::Install => {
                self.air_disk.next.as_mut().unwrap().1 = true;
                self.air.key_sent();
            }
            Action::SeenInAir => {
                let (key, _) = self.air_disk.next.take().unwrap();
                self.air_disk.current = Some(key);
                self.air.key_active();
            }
            Action::RolledBack => {
                self.air_disk.next = None;
                self.air.key_dropped();
            }
            Action::SeenOnGround => {
                self.ground_disk.promote_next().unwrap();
                self.ground.key_in_use(&mut self.ground_disk).unwrap();
                if let Some((peer, _)) = self.ground_disk.pending.take() {
                    self.ground_disk.peer = Some(peer);
                    self.ground = initiator(&self.ground_disk, self.clocks[0]);
                }
            }
            Action::RestartGround => self.ground = initiator(&self.ground_disk, self.clocks[0]),
            Action::RestartAir => self.air = responder(&self.air_disk, self.clocks[1]),
            Action::OpenWindow => {
                let opened = self
                    .air
                    .open_window(self.clocks[1], &code(), &mut self.air_disk);
                opened.unwrap();
            }
            Action::Take | Action::FallBack | Action::InstallAgain | Action::Leak(_) => {}
        }
    }

    /// What is on both disks.
    fn disks(&self) -> String {
        let (ground, air) = (&self.ground_disk, &self.air_disk);
        format!(
            "{:?} {} {} {:?} {:?}, {:?} {} {:?} {:?}",
            ground.peer,
            ground.counter,
            ground.epoch,
            ground.current,
            ground.next,
            air.peer.map(|peer| (peer.key, peer.counter)),
            air.epoch,
            air.current,
            air.next,
        )
    }
}

/// What the model has on them.
fn disks(state: &State) -> String {
    let (ground, air) = (&state.ground, &state.air);
    format!(
        "{:?} {} {} {:?} {:?}, {:?} {} {:?} {:?}",
        ground.peer.map(public),
        ground.counter,
        ground.epoch,
        ground.current.map(key),
        ground.next.map(key),
        air.peer.map(|(name, counter)| (public(name), counter)),
        air.epoch,
        air.current.map(key),
        air.next.map(|(next, sent)| (key(next), sent)),
    )
}

/// Leads the machines along a history, and then plays to them everything that the model would not take.
pub(super) fn follow(scope: &Scope, trace: &[Action]) {
    let states = scope.states(trace);
    let mut code = Code::new(&states[0]);
    for (at, action) in trace.iter().enumerate() {
        let [before, after] = [&states[at], &states[at + 1]];
        code.act(*action, before, after);
        let here = || format!("{:#?}", &trace[..=at]);
        assert_eq!(code.disks(), disks(after), "{}", here());
        for message in after.tape.difference(&before.tape) {
            let bytes = wire(&value(message.wire));
            assert!(
                code.sent.contains(&bytes),
                "{:?} after {}",
                message.content,
                here()
            );
        }
        let tape: Vec<_> = after
            .tape
            .iter()
            .map(|message| wire(&value(message.wire)))
            .collect();
        for sent in &code.sent {
            assert!(
                tape.contains(sent),
                "{:?} after {}",
                Message::parse(sent),
                here()
            );
        }
    }
    let last = &states[trace.len()];
    for message in &last.tape {
        let taken = last.clone().deliver(message.content, None);
        if taken.is_none_or(|taken| taken.wire != message.wire) {
            let before = code.disks();
            code.deliver(&wire(&value(message.wire)), u8::MAX);
            assert_eq!(
                code.disks(),
                before,
                "{:?} after {trace:#?}",
                message.content
            );
        }
    }
    let busy = matches!(last.ground.phase, Phase::Idle) || code.ground.is_busy();
    assert!(busy, "the attempt has ended in the code, after {trace:#?}");
}
