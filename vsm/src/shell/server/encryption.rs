//! Encrypted links of vehicles: what arrives passes them before the bridge sees it, and what leaves after it.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::encrypted::Role;
use mavlink_link::store::Disk;
use stanag_msgs::enums::AlertPriority;

use super::StartError;
use super::shared::Core;
use super::tasks::recorder;
use crate::config::{Config, Signing, Vehicle};
use crate::key_exchange::{self, ExchangeRecord};
use crate::session::{ExchangeNotice, LogEntry, LogLevel, Peer};
use crate::shell::encryption::{Encryption, EncryptionEnd};
use crate::shell::key_file::system_random;
use crate::shell::sockets::VehicleWriter;

/// The encrypted link of a vehicle whose configuration wants one; `at`: the fixed address of its agent.
pub(super) fn open_encryption(
    config: &Config,
    vehicle: &Vehicle,
    at: Option<Peer>,
    now: Now,
    store: &mut dyn Disk,
) -> Result<Option<Encryption>, StartError> {
    let Signing::KeyFile(_, settings) = &vehicle.signing else {
        return Ok(None);
    };
    if !vehicle.encrypt {
        return Ok(None);
    }
    let end = EncryptionEnd {
        role: Role::Ground,
        parties: key_exchange::parties(config, vehicle, *settings),
        identity: key_exchange::identity(store, &mut system_random)?,
        peer: ExchangeRecord::load(store, vehicle.id)?.peer(),
        at,
    };
    Ok(Some(Encryption::open(&vehicle.link, end, now, store)?))
}

impl Core {
    /// Hands what arrived on a link to the bridge: of an encrypted one what is inside.
    pub(super) fn receive_vehicle(&mut self, now: Now, port: usize, from: Peer, bytes: &[u8]) {
        let Core {
            bridge,
            store,
            recordings,
            ports,
            encryptions,
            ..
        } = self;
        let mut tap = recorder(recordings, now.wall);
        let link = ports
            .get(port)
            .and_then(Option::as_ref)
            .map(|port| &port.link);
        let mut encrypted = encryptions.iter_mut();
        let (from, bytes) = match encrypted.find(|(_, one)| Some(&one.address) == link) {
            Some((_, one)) => one.handle(now, from, bytes, store),
            None => (from, bytes),
        };
        if !bytes.is_empty() {
            bridge.handle_vehicle(now, port, from, bytes, store, &mut tap);
        }
    }

    /// Encrypts a frame to this vehicle; false where its link is not encrypted.
    pub(super) fn encrypt(&mut self, now: Duration, index: usize, to: Peer, frame: &[u8]) -> bool {
        match self.encryptions.iter_mut().find(|(at, _)| *at == index) {
            Some((_, one)) => {
                one.send(now, to, frame);
                true
            }
            None => false,
        }
    }

    /// The next bytes that leave on an encrypted link.
    pub(super) fn poll_encrypted(
        &mut self,
        now: Duration,
    ) -> Option<(VehicleWriter, Peer, Vec<u8>)> {
        for (index, one) in &mut self.encryptions {
            if let Some((to, bytes)) = one.poll_transmit(now, &mut self.store)
                && let Some(writer) = self.writers.get(*index)
            {
                return Some((writer.clone(), to, bytes.to_vec()));
            }
        }
        None
    }

    /// Does what is due on the encrypted links. Returns what is to be logged.
    pub(super) fn step_encryptions(&mut self, now: Now) -> Vec<LogEntry> {
        let mut log = vec![];
        for (index, one) in &mut self.encryptions {
            one.handle_timeout(now, &mut self.store);
            if let Some(packets) = one.poll_arrivals() {
                self.bridge.note_packets(*index, packets);
            }
            while let Some((level, text)) = one.poll_notice(now.mono) {
                if level == LogLevel::Warning {
                    // The alert is logged, too.
                    let notice = ExchangeNotice::Once(AlertPriority::Warning, text);
                    self.bridge
                        .notify_of_exchange(*index, now, notice, &mut self.store);
                } else if let Some(about) = self.bridge.vehicles().nth(*index) {
                    log.push(LogEntry { level, about, text });
                }
            }
        }
        log
    }
}
