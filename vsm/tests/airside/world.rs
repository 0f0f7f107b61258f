//! An agent between a simulated PX4 and a ground that signs, under one virtual clock, with a disk that outlives it.

#![allow(dead_code, reason = "each test file uses its part")]

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::exchange::{self, Agreed, Identity, PinnedPeer, ResponderStore};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode, encode_raw,
};
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::{KeyState, Stream};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use mavlink_link::store::{MemoryDisk, StoreError};
use px4_sim::{Autopilot, Config, Signing};
use vsm::airside::{Agent, Held, Keys, RelayPolicy, Settings, Side, Transmit};
use vsm::session::Peer;

pub(crate) fn key(byte: u8) -> SigningKey {
    SigningKey::new([byte; 32]).unwrap()
}

pub(crate) fn at(port: u16) -> Peer {
    Peer::Udp(SocketAddr::from(([127, 0, 0, 1], port)))
}

pub(crate) const GROUND: u16 = 1001;
pub(crate) const PX4: u16 = 1002;
pub(crate) const STRANGER: u16 = 1003;

/// What lies on the agent's disk.
#[derive(Default)]
pub(crate) struct Disk {
    pub(crate) ceilings: MemoryDisk,
    pub(crate) current: Option<SigningKey>,
    pub(crate) next: Option<SigningKey>,
    pub(crate) previous: Option<SigningKey>,
    pub(crate) peer: Option<PinnedPeer>,
    pub(crate) epoch: u32,
    pub(crate) full: bool,
    /// Keys and what the exchange keeps are on their way to it.
    pub(crate) slow: bool,
}

impl Disk {
    pub(crate) fn with(current: Option<SigningKey>) -> Disk {
        Disk {
            current,
            ..Disk::default()
        }
    }

    pub(crate) fn held(&self) -> Held {
        let copy = |key: &Option<SigningKey>| key.as_ref().map(SigningKey::duplicate);
        Held {
            current: copy(&self.current),
            next: copy(&self.next),
            previous: copy(&self.previous),
            peer: self.peer,
            epoch: self.epoch,
        }
    }

    fn writable(&self) -> Result<(), StoreError> {
        if self.full {
            Err(StoreError::new("key", "no space left"))
        } else {
            Ok(())
        }
    }

    fn exchange_writable(&self) -> Result<(), exchange::StoreError> {
        self.writable().map_err(|fault| exchange::StoreError {
            reason: fault.cause,
        })
    }
}

impl ResponderStore for Disk {
    fn withdraw_next(&mut self) -> Result<(), exchange::StoreError> {
        self.exchange_writable()?;
        self.next = None;
        Ok(())
    }

    fn store_agreed(
        &mut self,
        peer: &PinnedPeer,
        agreed: &Agreed,
    ) -> Result<(), exchange::StoreError> {
        self.exchange_writable()?;
        self.peer = Some(*peer);
        self.epoch = agreed.epoch;
        self.next = Some(agreed.key.duplicate());
        Ok(())
    }
}

impl Keys for Disk {
    fn disk(&mut self) -> &mut dyn mavlink_link::store::Disk {
        self.ceilings.full = self.full.then_some("");
        &mut self.ceilings
    }

    fn for_exchange(&mut self) -> &mut dyn ResponderStore {
        self
    }

    fn is_stored(&self) -> bool {
        !self.slow
    }

    fn next(&mut self) -> Result<Option<SigningKey>, StoreError> {
        Ok(self.next.as_ref().map(SigningKey::duplicate))
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.writable()?;
        if let Some(next) = self.next.take() {
            self.previous = self.current.replace(next);
        }
        Ok(())
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.writable()?;
        self.next = None;
        Ok(())
    }

    fn drop_previous(&mut self) -> Result<(), StoreError> {
        self.writable()?;
        self.previous = None;
        Ok(())
    }
}

/// The ground: a link under one key.
pub(crate) struct Ground {
    pub(crate) link: Link<Peer>,
    pub(crate) key: KeyState,
    pub(crate) disk: MemoryDisk,
    /// Ids of frames of component 1 delivered so far.
    pub(crate) received: Vec<u32>,
    /// The agent's texts.
    pub(crate) texts: Vec<String>,
}

impl Ground {
    pub(crate) fn new(key: SigningKey, now: Now) -> Ground {
        let endpoint = Endpoint::Fixed(at(9));
        let config = LinkConfig::new(1, Security::Signed, endpoint);
        let mut disk = MemoryDisk::default();
        let key = KeyState::start(key, Origin::KeyFile, BUILD, now, &mut disk).unwrap();
        Ground {
            link: Link::new(config),
            key,
            disk,
            received: vec![],
            texts: vec![],
        }
    }

    /// It is killed and started again; the disk stays.
    pub(crate) fn restart(&mut self, now: Now) {
        let key = self.key.key().duplicate();
        self.key = KeyState::start(key, Origin::KeyFile, BUILD, now, &mut self.disk).unwrap();
        self.link = Link::new(*self.link.config());
    }

    pub(crate) fn take(&mut self, now: Now, bytes: &[u8]) {
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.disk,
        };
        let (received, texts) = (&mut self.received, &mut self.texts);
        self.link
            .handle_datagram(now, at(9), bytes, auth, &mut |delivery| {
                assert!(delivery.verified);
                if delivery.header.component_id == 1 {
                    received.push(delivery.header.message_id);
                } else if let Ok(MavMessage::STATUSTEXT(text)) = &delivery.message {
                    texts.push(text.text.to_str().unwrap().to_owned());
                }
            });
    }

    /// What it wants to send by itself now.
    pub(crate) fn beat(&mut self, now: Now) -> Vec<Vec<u8>> {
        self.link.handle_timeout(now);
        std::iter::from_fn(|| self.transmit(now)).collect()
    }

    fn transmit(&mut self, now: Now) -> Option<Vec<u8>> {
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.disk,
        };
        let mut out = [0; MAX_FRAME];
        let sent = self.link.poll_transmit(now, auth, &mut out)?;
        Some(out[..sent.len].to_vec())
    }

    /// A frame of the VSM, signed now.
    pub(crate) fn frame(&mut self, now: Now, message: &MavMessage) -> Vec<u8> {
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.disk,
        };
        let mut out = [0; MAX_FRAME];
        let sent = self.link.send(now, auth, message, &mut out).unwrap();
        out[..sent.len].to_vec()
    }

    pub(crate) fn stamp(&mut self, now: Now) -> Stamp {
        self.key.take_stamp(now, &mut self.disk).unwrap()
    }
}

/// What can happen when it fits least.
#[derive(Clone, Copy)]
pub(crate) enum Mishap {
    DiskFull,
    LineCut,
}

pub(crate) struct World {
    pub(crate) now: Now,
    pub(crate) px4: Autopilot<Peer>,
    pub(crate) agent: Agent,
    pub(crate) settings: Settings,
    pub(crate) disk: Disk,
    pub(crate) ground: Option<Ground>,
    /// All that was relayed or sent to PX4, the newest last.
    pub(crate) to_px4: Vec<Vec<u8>>,
    /// Payloads of KEY_EXCHANGE that the agent has sent to the ground.
    pub(crate) exchanged: Vec<Vec<u8>>,
    pub(crate) log: Vec<String>,
    /// How often a frame with a key in it went out.
    pub(crate) secrets: usize,
    /// Datagrams between agent and PX4 so far, to name the one that is lost.
    pub(crate) datagrams: usize,
    pub(crate) lost: Option<usize>,
    pub(crate) px4_connected: bool,
    /// What the agent was given as random bytes last.
    rolls: u8,
    /// Nothing of the ground arrives at the agent.
    pub(crate) uplink_cut: bool,
    /// What happens at the very moment that PX4 has been sent a key.
    pub(crate) on_secret: Option<Mishap>,
    /// This PX4 does not know SETUP_SIGNING.
    pub(crate) cannot_sign: bool,
}

pub(crate) fn settings() -> Settings {
    Settings {
        vehicle_system: 1,
        own_system: 246,
        own_component: 191,
        own_link_id: 0,
        talkers: vec![VSM],
        policy: RelayPolicy::default(),
        radio: Endpoint::Listen,
        px4: Endpoint::Fixed(at(PX4)),
        restamp: false,
        replace_px4_key: true,
        contingency: None,
        not_before: BUILD,
        ids: [0x1b00_0001, 0x1b00_0101],
    }
}

pub(crate) const VSM: Stream = Stream {
    system: 245,
    component: 190,
    link: 0,
};
pub(crate) const BUILD: Stamp = Stamp::new(34_715_520_000_000);

pub(crate) fn start(settings: Settings, disk: &mut Disk, now: Now) -> Agent {
    let held = disk.held();
    Agent::start(settings, Identity::new([7; 32]), held, now, disk).unwrap()
}

impl World {
    /// Agent and ground hold `key`; PX4 that of `px4`.
    pub(crate) fn new(key: Option<SigningKey>, px4: Signing) -> World {
        World::with(settings(), Disk::with(key), px4)
    }

    pub(crate) fn with(settings: Settings, mut disk: Disk, px4: Signing) -> World {
        let now = Now {
            mono: Duration::from_secs(100),
            wall: Duration::from_secs(1_795_246_260),
        };
        let ground = disk
            .current
            .as_ref()
            .map(|key| Ground::new(key.duplicate(), now));
        World {
            now,
            px4: Autopilot::new(Config::default(), px4, vec![Some(at(9))]),
            agent: start(settings.clone(), &mut disk, now),
            settings,
            disk,
            ground,
            to_px4: vec![],
            exchanged: vec![],
            log: vec![],
            secrets: 0,
            datagrams: 0,
            lost: None,
            px4_connected: true,
            rolls: 9,
            uplink_cut: false,
            cannot_sign: false,
            on_secret: None,
        }
    }

    /// A world in which PX4, agent and ground share a key, and accept each other's frames.
    pub(crate) fn live() -> World {
        let mut world = World::new(Some(key(5)), Signing::with_key(key(5), 0));
        world.run(4.0);
        assert!(!world.received().is_empty(), "{:?}", world.log);
        world.to_px4.clear();
        world
    }

    fn arrives(&mut self) -> bool {
        self.datagrams += 1;
        self.px4_connected && self.lost != Some(self.datagrams)
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 20.0) as usize {
            self.tick();
        }
    }

    /// A twentieth of a second.
    pub(crate) fn tick(&mut self) {
        self.now = self.now.after(TICK);
        self.px4.step(TICK);
        let mut out = [0; MAX_FRAME];
        while let Some(sent) = self.px4.poll_transmit(&mut out) {
            if self.arrives() {
                let bytes = &out[..sent.len];
                self.agent
                    .handle_px4(self.now, at(PX4), bytes, &mut self.disk);
                self.drain();
            }
        }
        let beats = self.ground.as_mut().map(|ground| ground.beat(self.now));
        for beat in beats.unwrap_or_default() {
            if self.uplink_cut {
                continue;
            }
            self.radio(GROUND, &beat);
        }
        self.agent.handle_timeout(self.now, &mut self.disk);
        self.drain();
    }

    /// What comes in from the radio.
    pub(crate) fn radio(&mut self, from: u16, bytes: &[u8]) {
        let rolls = &mut self.rolls;
        let mut random = |out: &mut [u8]| {
            *rolls = rolls.wrapping_add(1);
            out.fill(*rolls);
            Ok(())
        };
        self.agent
            .handle_radio(self.now, at(from), bytes, &mut random, &mut self.disk);
        self.drain();
    }

    pub(crate) fn drain(&mut self) {
        let mut out = [0; MAX_FRAME];
        while let Some(Transmit {
            side, len, secret, ..
        }) = self.agent.poll_transmit(self.now, &mut self.disk, &mut out)
        {
            let bytes = out[..len].to_vec();
            self.secrets += usize::from(secret);
            match side {
                Side::Px4 => {
                    if self.arrives() && !(secret && self.cannot_sign) {
                        self.px4.handle_datagram(0, at(9), &bytes);
                    }
                    match self.on_secret {
                        Some(Mishap::DiskFull) if secret => self.disk.full = true,
                        Some(Mishap::LineCut) if secret => self.px4_connected = false,
                        _ => {}
                    }
                    self.to_px4.push(bytes);
                }
                Side::Radio => {
                    let frame = FrameView::parse(&bytes).unwrap();
                    if frame.header().message_id == KEY_EXCHANGE_ID {
                        self.exchanged.push(frame.payload().to_vec());
                    }
                    if let Some(ground) = &mut self.ground {
                        ground.take(self.now, &bytes);
                    }
                }
            }
        }
        while let Some(note) = self.agent.poll_note() {
            self.log.push(note.text);
        }
    }

    /// A command of the ground.
    pub(crate) fn command(
        &mut self,
        command: MavCmd,
        [param1, param2, param3]: [f32; 3],
        param7: f32,
    ) {
        let params = [param1, param2, param3, 0.0, 0.0, 0.0, param7];
        let message = command::long(Node::new(1, 1), command, params);
        let now = self.now;
        let bytes = self.ground.as_mut().unwrap().frame(now, &message);
        assert!(self.passes(GROUND, &bytes));
    }

    /// In the air, and on hold.
    pub(crate) fn take_off(&mut self) {
        // PX4 arms some seconds after its start.
        self.run(12.0);
        self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0], 0.0);
        self.run(1.0);
        let amsl_m = self.px4.vehicle().truth().place.altitude_m + 20.0;
        self.command(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 3], amsl_m as f32);
        self.run(25.0);
        let truth = self.px4.vehicle().truth();
        assert!(
            truth.armed && truth.mode == px4_sim::Mode::Loiter,
            "{truth:?} {:?}",
            self.log
        );
    }

    /// The agent is killed and started again; the disk stays.
    pub(crate) fn restart_agent(&mut self) {
        self.agent = start(self.settings.clone(), &mut self.disk, self.now);
    }

    pub(crate) fn received(&self) -> &[u32] {
        self.ground.as_ref().map_or(&[], |ground| &ground.received)
    }

    pub(crate) fn state(&self) -> &'static str {
        self.agent.status(String::new(), self.now.mono).state
    }

    pub(crate) fn held_back(&self, why: &str) -> u64 {
        let status = self.agent.status(String::new(), self.now.mono);
        status.held_back.get(why)
    }

    pub(crate) fn refused(&self, why: &str) -> u64 {
        let status = self.agent.status(String::new(), self.now.mono);
        status.radio.frames.get(why).copied().unwrap_or(0)
    }

    /// Whether the agent passed these bytes to PX4 unaltered.
    pub(crate) fn passes(&mut self, from: u16, bytes: &[u8]) -> bool {
        self.to_px4.clear();
        self.radio(from, bytes);
        self.to_px4.iter().any(|sent| sent == bytes)
    }

    pub(crate) fn px4_has(&self, key: &SigningKey) -> bool {
        self.px4.signing().key().is_some_and(|own| own.same_as(key))
    }
}

/// A frame of whomever, signed or not.
pub(crate) fn frame(
    stream: Stream,
    id: u32,
    payload: &[u8],
    signature: Option<(&SigningKey, Stamp)>,
) -> Vec<u8> {
    let header = Header {
        seq: 1,
        system_id: stream.system,
        component_id: stream.component,
        message_id: id,
        incompat: signature.map_or(0, |_| INCOMPAT_SIGNED),
        compat: 0,
    };
    let mut out = [0; MAX_FRAME];
    let mut len = encode_raw(header, payload, &mut out).unwrap();
    if let Some((key, stamp)) = signature {
        len = sign(key, stream.link, stamp, &mut out, len).unwrap();
    }
    out[..len].to_vec()
}

pub(crate) fn encoded(stream: Stream, message: &MavMessage) -> Vec<u8> {
    let header = Header {
        system_id: stream.system,
        component_id: stream.component,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode(message, header, &mut out);
    out[..len].to_vec()
}

const TICK: Duration = Duration::from_millis(50);
