//! A start of the agent that finds an order to zeroize whose process ended before PX4 had another key. Only PX4's line is
//! open, until PX4 has a key that nobody keeps, or does not answer, or stays armed. Nothing is sent to the radio, and
//! nothing is received from it.

use std::sync::Arc;
use std::time::Instant;

use mavlink_link::exchange::AutopilotKey;
use mavlink_link::frame::MAX_FRAME;
use tokio::sync::Notify;
use zeroize::Zeroize;

use super::airside::{
    AirsideError, FOREIGN, LARGEST, LAST_WRITES, NOT_SENT, held, may_carry_keys, settings,
    write_log,
};
use super::airside_disk::AirsideDisk;
use super::clock::Clock;
use super::disk::FileDisk;
use super::key_file::system_random;
use super::key_store::KeyStore;
use super::local_peers::LocalPeers;
use super::ordered_files::OrderedKeys;
use super::queued_disk::QueuedDisk;
use super::rest::Rest;
use super::sockets::{self, Hosts};
use crate::airside::{Agent, Settings, Side};
use crate::config::airside::AirsideConfig;
use crate::key_exchange;

/// Gives PX4 a key that nobody keeps, once it is present and disarmed. Returns the outcome within a minute. Must be called
/// within a tokio runtime.
///
/// # Errors
/// Keys or the link to PX4 cannot be opened, or the link is open to others; nothing has been sent in that case.
pub async fn discard(
    config: &AirsideConfig,
    mut store: FileDisk,
) -> Result<AutopilotKey, AirsideError> {
    let (own, px4) = (config.agent.get_ref(), config.px4.get_ref());
    may_carry_keys(px4)?;
    let clock = Clock::default();
    let keys = KeyStore::open(&own.key_file)?;
    let hosts = Hosts::AskNow;
    let (mut reader, writer, autopilot) =
        sockets::open_link("px4.link", &px4.link, &hosts, "port-px4", &mut store)?;
    let mut peers = LocalPeers::new(&px4.link, px4.i_trust_this_link, &px4.users);
    let settings = Settings {
        // The present key is to be replaced: it is neither sent again, nor used to fly by.
        restamp: false,
        contingency: None,
        ..settings(config, None, autopilot)
    };
    let identity = key_exchange::identity(&mut store, &mut system_random)?;
    let stored = Arc::new(Notify::new());
    let ordered = OrderedKeys::start(keys, &store, stored.clone());
    let store = QueuedDisk::new(store, stored.clone()).map_err(AirsideError::Writer)?;
    let mut disk = AirsideDisk {
        store,
        ordered,
        vehicle: own.vehicle_id,
    };
    let held = held(&disk)?;
    let mut agent = Agent::start(settings, identity, held, clock.now(), &mut disk)?;
    let (mut bytes, mut rest) = (vec![0; LARGEST], Rest::default());
    loop {
        let now = clock.now();
        agent.handle_timeout(now, &mut disk);
        agent.resume_zeroize(now, &mut system_random, &mut disk);
        let mut out = [0; MAX_FRAME];
        while let Some(sent) = agent.poll_transmit(clock.now(), &mut disk, &mut out) {
            let stranger = sent.secret.then(|| peers.may_have_key(sent.to));
            match stranger {
                // The machine may want to report to the ground, but this start has no radio.
                _ if sent.side == Side::Radio => {}
                Some(Err(stranger)) => tracing::error!("{NOT_SENT}: {stranger}"),
                _ => {
                    let frame = out.get(..sent.len).unwrap_or_default();
                    if let Err(cause) = writer.send(frame, sent.to).await {
                        tracing::debug!("a frame to {} was not sent: {cause}", sent.to);
                    }
                }
            }
            if sent.secret {
                out.zeroize();
            }
        }
        while let Some(note) = agent.poll_note() {
            write_log(note.level, &note.text);
        }
        if let Some(key) = agent.zeroized_key() {
            // Pending writes would recreate files after they have been erased.
            let end = Instant::now() + LAST_WRITES;
            disk.store.wait(LAST_WRITES);
            disk.ordered.files.wait(end);
            return Ok(key);
        }
        let due = clock.instant(agent.poll_timeout());
        tokio::select! {
            received = rest.before(reader.receive(&mut bytes)) => match received {
                Ok((length, from)) => {
                    let now = clock.now();
                    let bytes = bytes.get(..length).unwrap_or_default();
                    if peers.admits(now.mono, from) {
                        agent.handle_px4(now, from, bytes, &mut disk);
                    } else {
                        agent.count_held_back(FOREIGN);
                    }
                }
                Err(cause) => rest.begin("PX4's link", &cause),
            },
            () = stored.notified() => drop(disk.store.poll()),
            () = tokio::time::sleep_until(due.into()) => {}
        }
    }
}
