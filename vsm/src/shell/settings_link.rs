//! `vsm check-vehicle` without a running bridge: a vehicle's link, used by this process alone, to read settings.
//!
//! It sends only heartbeats, challenges and PARAM_REQUEST_READ, signed with the current key. Store and key are locked
//! meanwhile, since two writers of one stream would make each other's stamps stale.

use std::path::PathBuf;
use std::time::Duration;

use mapping::hardening;
use mavlink_link::clock::Origin;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Auth, Link, LinkState};
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::service::{Node, param};
use mavlink_link::signing::Stamp;
use mavlink_link::store::StoreError;
use tokio::time::{Instant, sleep_until};

use super::clock::{Clock, NOT_BEFORE};
use super::disk::{FileDisk, OpenError};
use super::key_store::{KeyStore, KeyStoreError};
use super::sockets::{self, Hosts, SocketError, VehicleReader, VehicleWriter};
use crate::config::{Config, Signing, Vehicle};
use crate::session::{LinkEnd, Peer, VehicleSettings, link_config};

/// Why settings cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum SettingsLinkError {
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// The keys.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// The link.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The clock, or the record of the link.
    #[error(transparent)]
    Record(#[from] StoreError),
    /// Without a key the vehicle would answer nothing.
    #[error("there is no key {path} yet: begin with `vsm pair` or `vsm key provision`", path = path.display())]
    NoKey {
        /// The key file.
        path: PathBuf,
    },
    /// Only a running bridge has the link's keys.
    #[error(
        "the vehicle's link is encrypted (vehicle.encrypt): start `vsm run`, which this command asks then"
    )]
    Encrypted,
}

/// A link on which settings are read.
#[derive(Debug)]
pub struct SettingsLink {
    link: Link<Peer>,
    key: Option<KeyState>,
    parameters: param::Client,
    vehicle: Node,
    /// The timestamp of the outstanding request: no answer has an older one.
    requested: Option<Stamp>,
    found: VehicleSettings,
    store: FileDisk,
    /// Locked as long as the link is in use.
    _keys: Option<KeyStore>,
    clock: Clock,
    reader: VehicleReader,
    writer: VehicleWriter,
}

impl SettingsLink {
    /// Opens the vehicle's link. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// Another process uses the store or the key, there is no key, or a file or socket cannot be opened. Nothing has been
    /// sent in that case.
    pub fn open(config: &Config, vehicle: &Vehicle) -> Result<SettingsLink, SettingsLinkError> {
        if vehicle.encrypt {
            return Err(SettingsLinkError::Encrypted);
        }
        let clock = Clock::default();
        let now = clock.now();
        let mut store = FileDisk::open(&config.store.dir)?;
        let (key, keys) = match &vehicle.signing {
            Signing::Off => (None, None),
            Signing::KeyFile(path, _) => {
                let keys = KeyStore::open(path)?;
                let path = path.clone();
                let key = keys.current()?.ok_or(SettingsLinkError::NoKey { path })?;
                (Some(key), Some(keys))
            }
        };
        let record = sockets::port_record(config, vehicle);
        let (reader, writer, peer) = sockets::open_link(
            "vehicle.link",
            &vehicle.link,
            &Hosts::AskNow,
            &record,
            &mut store,
        )?;
        let own = Node::new(config.mavlink.system_id, config.mavlink.component_id);
        let end = LinkEnd { key, peer };
        let link = Link::new(link_config(vehicle, own, &end, &store)?);
        let not_before = Stamp::from_unix(NOT_BEFORE);
        let key = end
            .key
            .map(|key| KeyState::start(key, Origin::KeyFile, not_before, now, &mut store))
            .transpose()?;
        let node = Node::new(vehicle.system_id, AUTOPILOT);
        Ok(SettingsLink {
            link,
            key,
            parameters: param::Client::new(own, node, param::Timing::default()),
            vehicle: node,
            requested: None,
            found: VehicleSettings {
                id: vehicle.id.to_string(),
                tail_number: vehicle.tail_number.clone(),
                ..VehicleSettings::default()
            },
            store,
            _keys: keys,
            clock,
            reader,
            writer,
        })
    }

    /// Reads every setting that [`hardening`] judges, for at most `patience`; settings without an answer stay unknown. If
    /// nothing at all arrives, it ends after [`NOTHING_FOR`] and returns `true`: PX4 sends a heartbeat each second.
    pub async fn read(mut self, patience: Duration) -> (VehicleSettings, bool) {
        let mut names = hardening::SETTINGS
            .iter()
            .filter_map(|setting| param::Name::new(setting.name).ok());
        let mut bytes = vec![0; 65_536];
        loop {
            let now = self.clock.mono();
            while let Some(event) = self.parameters.poll_event() {
                self.found.note(&event);
            }
            // One request at a time, so that `requested` is the timestamp of this one.
            if self.link.state() == LinkState::Live && self.parameters.pending() == 0 {
                self.found.live = true;
                self.requested = None;
                match names.next() {
                    Some(name) => drop(self.parameters.read(now, name)),
                    None => return (self.found, false),
                }
            }
            let nothing = self.link.stats().datagrams == 0;
            if now >= patience || nothing && now >= NOTHING_FOR {
                return (self.found, nothing);
            }
            self.send().await;
            let due = self.parameters.poll_timeout();
            let due = due.unwrap_or(patience).min(self.link.poll_timeout());
            let until = Instant::from_std(self.clock.instant(due.min(now + LOOK)));
            tokio::select! {
                received = self.reader.receive(&mut bytes) => match received {
                    Ok((length, from)) => self.take(from, bytes.get(..length).unwrap_or_default()),
                    Err(_) => tokio::time::sleep(LOOK).await,
                },
                () = sleep_until(until) => {}
            }
            self.parameters.handle_timeout(self.clock.mono());
            self.link.handle_timeout(self.clock.now());
        }
    }

    fn take(&mut self, from: Peer, bytes: &[u8]) {
        let now = self.clock.now();
        let (parameters, vehicle, requested) = (&mut self.parameters, self.vehicle, self.requested);
        let auth = auth(&mut self.key, &mut self.store);
        self.link
            .handle_datagram(now, from, bytes, auth, &mut |delivery| {
                let sender = Node::new(delivery.header.system_id, delivery.header.component_id);
                let fresh = delivery.can_answer(requested);
                if let Ok(message) = &delivery.message
                    && sender == vehicle
                {
                    parameters.handle_message(now.mono, sender, message, fresh);
                }
            });
    }

    async fn send(&mut self) {
        let mut out = [0; MAX_FRAME];
        loop {
            let now = self.clock.now();
            let due = self
                .link
                .poll_transmit(now, auth(&mut self.key, &mut self.store), &mut out);
            let sent = match due {
                Some(sent) => sent,
                None => {
                    let Some(message) = self.parameters.poll_transmit() else {
                        return;
                    };
                    let auth = auth(&mut self.key, &mut self.store);
                    // The client repeats what cannot be sent now.
                    let Ok(sent) = self.link.send(now, auth, &message, &mut out) else {
                        continue;
                    };
                    self.requested = self.requested.or(sent.stamp);
                    sent
                }
            };
            let frame = out.get(..sent.len).unwrap_or_default();
            // A frame that cannot be sent counts as lost.
            drop(self.writer.send(frame, sent.to).await);
        }
    }
}

fn auth<'a>(key: &'a mut Option<KeyState>, store: &'a mut FileDisk) -> Auth<'a> {
    match key {
        Some(key) => Auth::Signed { key, store },
        None => Auth::Off,
    }
}

/// How long to wait if nothing at all arrives.
pub const NOTHING_FOR: Duration = Duration::from_secs(8);
/// The shortest pause between looks at the clock.
const LOOK: Duration = Duration::from_millis(50);
