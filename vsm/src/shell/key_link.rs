//! Key rotation on a vehicle's link: `vsm key provision | rotate | revoke`, and a zeroize with `zeroize.px4_key`.
//!
//! This process holds the store's lock and the key's lock, so no bridge signs in the same stream of timestamps meanwhile.
//! SETUP_SIGNING carries the key in the clear, so it is sent over loopback and serial lines only, unless the operator
//! vouches for the link. On loopback it is sent only to a program of this command's user or of root.

use std::net::ToSocketAddrs;
use std::time::Duration;

use mavlink_link::clock::Origin;
use mavlink_link::exchange::AutopilotKey;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Endpoint, LinkConfig, Security};
use mavlink_link::provisioning::{
    Event, KeyRollover, KeyRolloverConfig, Outcome, StartError, State,
};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use tokio::time::{Instant, sleep_until};
use zeroize::Zeroize;

use super::clock::{Clock, NOT_BEFORE};
use super::disk::{FileDisk, OpenError};
use super::key_file;
use super::key_store::{KeyStore, KeyStoreError};
use super::local_peers::{LocalPeers, Stranger};
use super::sockets::{self, Hosts, SocketError, VehicleReader, VehicleWriter};
use crate::config::{Config, ExchangeMode, LinkAddress, Signing, Vehicle};
use crate::session::Peer;

/// Why a key rotation cannot start.
#[derive(Debug, thiserror::Error)]
pub enum KeyLinkError {
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// The keys.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// The link.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The clocks.
    #[error("the signing clock cannot be read: {0}")]
    Clock(#[from] mavlink_link::store::StoreError),
    /// The machine.
    #[error(transparent)]
    Start(#[from] StartError),
    /// There is no current key that could be sent again.
    #[error("there is no key in force, expected one to send again")]
    NoKey,
    /// SETUP_SIGNING would be sent in the clear on an encrypted link.
    #[error(
        "the vehicle's link is encrypted (vehicle.encrypt): its keys come from its agent, by `vsm pair`"
    )]
    Encrypted,
    /// The key would be readable by anyone on the link.
    #[error(
        "SETUP_SIGNING shows the key to anyone who can receive {link}: use a serial line or loopback, or \
         vouch for this link with --i-trust-this-link"
    )]
    OpenLink {
        /// The link.
        link: String,
    },
}

/// The key to install.
#[derive(Debug)]
pub enum What {
    /// Another key than the current one, or the vehicle's first.
    New(SigningKey),
    /// The current key again: the vehicle fell back to the previous one.
    InForceAgain,
    /// A key that nobody keeps, in place of the current one: a zeroize.
    Discarded(SigningKey),
}

/// What the operator vouches for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Trust {
    /// The key may be sent over this link, though it is neither a serial line nor loopback.
    pub open_link: bool,
    /// A vehicle that sends unsigned is accepted as the vehicle: it has lost its key.
    pub lost_key: bool,
}

/// How the rotation ended, for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// The rollover ended with this outcome.
    Ended(Outcome),
    /// No data from the vehicle.
    NotReceived,
    /// The vehicle signs, but with neither key.
    ForeignKey,
    /// Frames with the vehicle's system id arrived unsigned and were ignored.
    Unsigned,
    /// Only a program that may not receive the key sent frames with the vehicle's system id.
    Stranger(Stranger),
    /// The vehicle stayed armed.
    StayedArmed,
    /// No data from the vehicle after the key was sent: both keys are kept, and `vsm run` finds out which one it has.
    Unknown,
    /// The vehicle's timestamps are far ahead and it ignores our frames: somebody with the key has moved its clock.
    /// Both keys are kept.
    Dragged,
}

/// Progress to show to the operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// An event of the rollover.
    Event(Event),
    /// Frames with the vehicle's system id arrive that are signed with another key; still waiting for the vehicle's own.
    OtherKey,
    /// Frames with the vehicle's system id arrive unsigned and are ignored.
    Unsigned,
}

/// A key rotation in progress.
#[derive(Debug)]
pub struct KeyLink {
    rollover: KeyRollover<Peer>,
    keys: KeyStore,
    /// The key is already the current one, or is not kept at all: the files stay unchanged, however the rotation ends.
    keeps_files: bool,
    store: FileDisk,
    clock: Clock,
    reader: VehicleReader,
    writer: VehicleWriter,
    /// Who may be the vehicle.
    peers: LocalPeers,
    stranger: Option<Stranger>,
}

impl KeyLink {
    /// Opens the vehicle's link and stages the key, where it is a new one; an unfinished rollover continues with its own.
    /// Must be called within a tokio runtime.
    ///
    /// # Errors
    /// The link is open to others, another process holds the store or the key, or a file or socket cannot be opened.
    /// Nothing has been sent in that case.
    pub fn open(
        config: &Config,
        vehicle: &Vehicle,
        key_file: &std::path::Path,
        what: What,
        trust: Trust,
    ) -> Result<KeyLink, KeyLinkError> {
        may_carry_a_key(vehicle, trust)?;
        // A running bridge holds both locks: two writers of one stream would make each other's stamps stale.
        let store = FileDisk::open(&config.store.dir)?;
        KeyLink::open_on(config, vehicle, key_file, what, trust, store)
    }

    fn open_on(
        config: &Config,
        vehicle: &Vehicle,
        key_file: &std::path::Path,
        what: What,
        trust: Trust,
        mut store: FileDisk,
    ) -> Result<KeyLink, KeyLinkError> {
        may_carry_a_key(vehicle, trust)?;
        let clock = Clock::default();
        let now = clock.now();
        let keys = KeyStore::open(key_file)?;
        keys.bury(&mut store)?;
        let record = sockets::port_record(config, vehicle);
        let (reader, writer, peer) = sockets::open_link(
            "vehicle.link",
            &vehicle.link,
            &Hosts::AskNow,
            &record,
            &mut store,
        )?;
        // A key that nobody keeps must not reach the disk, and the current one is there already.
        let keeps_files = !matches!(what, What::New(_));
        let (old, new) = match what {
            What::New(new) => match keys.next()? {
                // The vehicle may have the unfinished key already: replacing it could leave nobody with that key.
                Some(unfinished) => (keys.current()?, unfinished),
                None => {
                    keys.stage(&new)?;
                    (keys.current()?, new)
                }
            },
            What::InForceAgain => {
                let current = keys.current()?.ok_or(KeyLinkError::NoKey)?;
                // The vehicle may sign with the previous key, and SETUP_SIGNING must be signed with the one it has.
                (keys.previous()?, current)
            }
            What::Discarded(other) => {
                let current = keys.current()?.ok_or(KeyLinkError::NoKey)?;
                (Some(current), other)
            }
        };
        let not_before = Stamp::from_unix(NOT_BEFORE);
        let old = match old {
            None => None,
            Some(old) => Some(KeyState::start(
                old,
                Origin::KeyFile,
                not_before,
                now,
                &mut store,
            )?),
        };
        let endpoint = peer.map_or(Endpoint::Listen, Endpoint::Fixed);
        let mut link = LinkConfig::new(vehicle.system_id, Security::Signed, endpoint);
        link.own_system = config.mavlink.system_id;
        link.own_component = config.mavlink.component_id;
        link.link_id = vehicle.link_id;
        link.vehicle_link_id = vehicle.vehicle_link_id;
        let settings = KeyRolloverConfig {
            link,
            not_before,
            may_send_key: true,
            believe_unsigned: trust.lost_key,
        };
        let rollover = KeyRollover::start(settings, old, new, now, &mut store)?;
        Ok(KeyLink {
            rollover,
            keys,
            keeps_files,
            store,
            clock,
            reader,
            writer,
            peers: LocalPeers::new(&vehicle.link, trust.open_link, &[]),
            stranger: None,
        })
    }

    /// Runs until the rotation has ended, at most `patience`. Progress is passed to `report` as it happens.
    ///
    /// # Errors
    /// The vehicle has the key and the files could not be changed: both keys are kept.
    pub async fn run(
        mut self,
        patience: Duration,
        report: &mut dyn FnMut(Progress),
    ) -> Result<Ending, KeyLinkError> {
        let mut bytes = vec![0; 65_536];
        let (mut other_key, mut unsigned) = (false, false);
        let mut unknown_since = None;
        loop {
            let until = self.rollover.poll_timeout().min(self.clock.mono() + LOOK);
            tokio::select! {
                received = self.reader.receive(&mut bytes) => match received {
                    Ok((length, from)) => {
                        let now = self.clock.now();
                        let bytes = bytes.get(..length).unwrap_or_default();
                        if self.peers.admits(now.mono, from) {
                            self.rollover.handle_datagram(now, from, bytes, &mut self.store);
                        } else if self.stranger.is_none() {
                            // Looked up for the message to the operator only.
                            self.stranger = self.peers.may_have_key(from).err();
                        }
                    }
                    Err(_) => tokio::time::sleep(LOOK).await,
                },
                () = sleep_until(Instant::from_std(self.clock.instant(until))) => {}
            }
            self.rollover.handle_timeout(self.clock.now());
            self.send().await;
            while let Some(event) = self.rollover.poll_event() {
                report(Progress::Event(event));
                match event {
                    _ if self.keeps_files => {}
                    Event::Commit => {
                        self.keys.commit()?;
                        self.bury();
                    }
                    // Only proof that the vehicle keeps its key deletes the new one; silence (UNKNOWN) proves nothing.
                    Event::Ended(Outcome::RolledBack) => {
                        self.keys.drop_next()?;
                        self.bury();
                    }
                    _ => {}
                }
            }
            if !self.rollover.has_received() {
                // Anyone can send such frames, so they decide nothing; they only show the operator why it takes long.
                if self.rollover.foreign_frames() > 0 && !std::mem::replace(&mut other_key, true) {
                    report(Progress::OtherKey);
                }
                if self.rollover.disbelieved_frames() > 0 && !std::mem::replace(&mut unsigned, true)
                {
                    report(Progress::Unsigned);
                }
            }
            let mono = self.clock.mono();
            let settled = mono.saturating_sub(self.rollover.entered_at());
            match self.rollover.outcome() {
                // PX4 writes its key file without synchronising it, so the vehicle is watched until that is done.
                Some(Outcome::Committed) if settled < KEEP_POWER => {}
                Some(outcome) => return Ok(Ending::Ended(outcome)),
                None => {}
            }
            if self.rollover.state() == State::Unknown {
                let since = *unknown_since.get_or_insert(mono);
                if mono.saturating_sub(since) > UNKNOWN_FOR {
                    return Ok(self.unknown());
                }
            } else {
                unknown_since = None;
            }
            if mono > patience && self.rollover.outcome().is_none() {
                return Ok(self.impatient());
            }
        }
    }

    /// Deletes the current key as soon as the vehicle has the new one, whichever process finds that out.
    ///
    /// # Errors
    /// The order could not be made durable.
    pub fn revoke_current(&self) -> Result<(), KeyStoreError> {
        self.keys.revoke_current()
    }

    /// A clock that stays behind is harmless; the next start deletes it.
    fn bury(&mut self) {
        if let Err(fault) = self.keys.bury(&mut self.store) {
            tracing::debug!("the clock of a dead key cannot be deleted: {fault}");
        }
    }

    /// The id of the key to install.
    #[must_use]
    pub fn new_id(&self) -> KeyId {
        self.rollover.new_id()
    }

    async fn send(&mut self) {
        let mut out = [0; MAX_FRAME];
        loop {
            let now = self.clock.now();
            let sent = self.rollover.poll_transmit(now, &mut self.store, &mut out);
            let Some(sent) = sent else { return };
            let frame = out.get(..sent.len).unwrap_or_default();
            let allowed = if sent.secret {
                self.peers.may_have_key(sent.to)
            } else {
                Ok(())
            };
            match allowed {
                // A frame that cannot be sent counts as lost.
                Ok(()) => drop(self.writer.send(frame, sent.to).await),
                Err(stranger) => self.stranger = Some(stranger),
            }
            if sent.secret {
                out.zeroize();
            }
        }
    }

    fn impatient(&mut self) -> Ending {
        match self.rollover.state() {
            State::Staged if self.stranger.is_some() => self
                .stranger
                .take()
                .map_or(Ending::NotReceived, Ending::Stranger),
            State::WaitDisarm => Ending::StayedArmed,
            State::Staged if self.rollover.foreign_frames() > 0 => Ending::ForeignKey,
            State::Staged if self.rollover.disbelieved_frames() > 0 => Ending::Unsigned,
            State::Staged => Ending::NotReceived,
            _ => self.unknown(),
        }
    }

    fn unknown(&self) -> Ending {
        if self.rollover.is_dragged() {
            Ending::Dragged
        } else {
            Ending::Unknown
        }
    }
}

fn may_carry_a_key(vehicle: &Vehicle, trust: Trust) -> Result<(), KeyLinkError> {
    if vehicle.encrypt {
        return Err(KeyLinkError::Encrypted);
    }
    if !trust.open_link && !is_local(&vehicle.link) {
        return Err(KeyLinkError::OpenLink {
            link: vehicle.link.to_string(),
        });
    }
    Ok(())
}

/// Carries out the part of a zeroize that replaces PX4's keys: each PX4 without an agent gets a key that nobody keeps,
/// where the configuration requires it. Returns the outcome for each vehicle.
pub async fn discard_keys(config: &Config, store: &FileDisk) -> Vec<String> {
    let mut outcomes = vec![];
    for vehicle in config.vehicles().filter(|_| config.zeroize.px4_key) {
        let Signing::KeyFile(key_file, exchange) = &vehicle.signing else {
            continue;
        };
        // With an exchange there is an agent, which has replaced PX4's key itself.
        if exchange.mode != ExchangeMode::Off {
            continue;
        }
        let outcome = match discard(config, vehicle, key_file, store.shared()).await {
            Ok(key) => key.to_string(),
            Err(fault) => format!("{} ({fault})", AutopilotKey::NotReached),
        };
        outcomes.push(format!("vehicle {}: {outcome}", vehicle.id));
    }
    outcomes
}

async fn discard(
    config: &Config,
    vehicle: &Vehicle,
    key_file: &std::path::Path,
    store: FileDisk,
) -> Result<AutopilotKey, KeyLinkError> {
    let Ok(other) = key_file::random() else {
        return Ok(AutopilotKey::NotTaken);
    };
    let mut tries = 0;
    let link = loop {
        let (what, store) = (What::Discarded(other.duplicate()), store.shared());
        match KeyLink::open_on(config, vehicle, key_file, what, Trust::default(), store) {
            // The bridge that has just ended still holds keys and sockets for a moment.
            Err(KeyLinkError::Keys(_) | KeyLinkError::Socket(_)) if tries < MAX_OPENS => {
                tries += 1;
                tokio::time::sleep(LOOK).await;
            }
            opened => break opened?,
        }
    };
    Ok(match link.run(DISCARD_WITHIN, &mut |_| {}).await? {
        Ending::Ended(Outcome::Committed) => AutopilotKey::Replaced,
        Ending::Ended(_) | Ending::ForeignKey | Ending::Unsigned | Ending::Dragged => {
            AutopilotKey::NotTaken
        }
        Ending::StayedArmed => AutopilotKey::Armed,
        Ending::NotReceived | Ending::Stranger(_) | Ending::Unknown => AutopilotKey::NotReached,
    })
}

/// Whether nobody else can receive the link: a serial line, or this computer itself.
#[must_use]
pub fn is_local(link: &LinkAddress) -> bool {
    match link {
        LinkAddress::Serial { .. } => true,
        LinkAddress::UdpIn(address) => address.ip().is_loopback(),
        LinkAddress::UdpOut(host) => host.to_socket_addrs().is_ok_and(|mut found| {
            let mut any = false;
            // Every address must be loopback, since the one used is not chosen here; no address at all is not local.
            found.all(|address| {
                any = true;
                address.ip().is_loopback()
            }) && any
        }),
    }
}

/// The shortest pause between looks at the clock.
const LOOK: Duration = Duration::from_millis(50);
/// How long the vehicle must stay powered after it has accepted the key: PX4 writes its key file without synchronising it.
pub const KEEP_POWER: Duration = Duration::from_secs(5);
/// Two seconds, with `LOOK` between the attempts.
const MAX_OPENS: u32 = 40;
/// 10 s to see that only one autopilot is on the link, then three tries.
const DISCARD_WITHIN: Duration = Duration::from_secs(20);
/// How long a silent vehicle is queried before the rest is left to `vsm run`.
pub const UNKNOWN_FOR: Duration = Duration::from_secs(60);
