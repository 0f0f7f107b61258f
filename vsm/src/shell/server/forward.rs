//! The links of other ground stations (`[[forward]]`): opened at the start, and changed when the configuration is read
//! again.
//!
//! A place belongs to a link: as long as the configuration has a `[[forward]]` on that link, its socket stays open,
//! whatever else changes. The bridge identifies the ground station again only where its key or ids have changed.

use std::rc::Rc;

use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::Disk;
use stanag_msgs::Id;
use tokio::sync::Notify;

use super::StartError;
use crate::config::{Config, Forward, ForwardLink};
use crate::session::{Bridge, LinkEnd, Peer};
use crate::shell::key_file;
use crate::shell::local_peers::LocalPeers;
use crate::shell::sockets::{self, Hosts, VehicleReader, VehicleWriter};

/// An open link, which a task reads.
#[derive(Debug)]
pub(super) struct OpenForward {
    /// Its place, by which the bridge knows it as long as it is open.
    pub(super) number: usize,
    pub(super) link: ForwardLink,
    pub(super) writer: VehicleWriter,
    /// The fixed peer of a udpout or serial link.
    peer: Option<Peer>,
    /// Whose programs may be there, where that is checked.
    pub(super) peers: LocalPeers,
    /// Ends the task that reads it.
    pub(super) close: Rc<Notify>,
}

/// Whose programs may be on the link of a ground station.
pub(super) fn peers(forward: &Forward) -> LocalPeers {
    match &forward.link {
        // A signed station proves itself, so its socket's owner does not matter.
        ForwardLink::Shared(link) => LocalPeers::new(link, !forward.unsigned, &forward.users),
        ForwardLink::TcpIn(_) | ForwardLink::TcpOut(_) => LocalPeers::of_users(None),
    }
}

/// For a reading task: the place, the link, and what ends the task.
pub(super) type ForwardReader = (usize, VehicleReader, Rc<Notify>);
/// The bridge's end of each link, by its place; `None` where the present one stays.
pub(super) type ForwardEnds = Vec<(usize, Option<LinkEnd>)>;

/// The links of a configuration.
#[derive(Default)]
pub(super) struct Forwards {
    pub(super) ends: ForwardEnds,
    pub(super) opened: Vec<OpenForward>,
    pub(super) readers: Vec<ForwardReader>,
}

/// What is already being served.
#[derive(Clone, Copy)]
pub(super) struct Served<'a> {
    pub(super) config: &'a Config,
    pub(super) bridge: &'a Bridge,
    pub(super) forwards: &'a [OpenForward],
    /// The resolved addresses for the links that are opened in addition.
    pub(super) hosts: &'a Hosts,
}

/// Links of other ground stations with these [`keys`], in addition to those that are open and stay.
pub(super) fn open(
    config: &Config,
    keys: Vec<Option<SigningKey>>,
    served: Option<Served<'_>>,
    store: &mut dyn Disk,
) -> Result<Forwards, StartError> {
    let mut forwards = Forwards::default();
    let open = served.map_or(&[][..], |served| served.forwards);
    let hosts = served.map_or(&Hosts::AskNow, |served| served.hosts);
    let mut next = open.iter().map(|one| one.number + 1).max().unwrap_or(0);
    for (forward, key) in config.forwards().zip(keys) {
        let is_there = open.iter().find(|one| one.link == forward.link);
        if let Some((served, open)) = served.zip(is_there) {
            let stays = stays(&served, open.number, forward, key.as_ref());
            let peer = open.peer;
            let end = (!stays).then_some(LinkEnd { key, peer });
            forwards.ends.push((open.number, end));
            continue;
        }
        let record = format!("port-forward-{}", forward.name);
        let (reader, writer, peer) = sockets::open_forward(&forward.link, hosts, &record, store)?;
        let close = Rc::new(Notify::new());
        forwards.ends.push((next, Some(LinkEnd { key, peer })));
        forwards.readers.push((next, reader, close.clone()));
        forwards.opened.push(OpenForward {
            number: next,
            link: forward.link.clone(),
            writer,
            peer,
            peers: peers(forward),
            close,
        });
        next += 1;
    }
    Ok(forwards)
}

/// Whether the ground station of the link has the same key and ids as before.
fn stays(served: &Served<'_>, number: usize, forward: &Forward, key: Option<&SigningKey>) -> bool {
    let mut before = served.config.forwards();
    let before = before.find(|one| one.link == forward.link);
    let ids = |one: &Forward| (one.system_id, one.link_id, one.unsigned);
    before.is_some_and(|before| ids(before) == ids(forward))
        && served.bridge.forward_key(number) == key.map(SigningKey::id)
}

/// The owners of keys: vehicles, and other ground stations.
pub(super) fn owners<'a>(
    config: &'a Config,
    vehicles: &'a [(Id, KeyId)],
    forwards: &'a [Option<SigningKey>],
) -> impl Iterator<Item = (String, KeyId)> + 'a {
    let vehicles = vehicles
        .iter()
        .map(|(id, key)| (format!("vehicle {id}"), *key));
    let forwards = config.forwards().zip(forwards);
    let forwards = forwards
        .filter_map(|(one, key)| Some((format!("[[forward]] {}", one.name), key.as_ref()?.id())));
    vehicles.chain(forwards)
}

/// The key of each. None may be the key of a vehicle, or of another ground station.
pub(super) fn keys(
    config: &Config,
    vehicles: &[(Id, KeyId)],
) -> Result<Vec<Option<SigningKey>>, StartError> {
    let vehicles = vehicles
        .iter()
        .map(|(id, key)| (format!("vehicle {id}"), *key));
    let mut known: Vec<(String, KeyId)> = vehicles.collect();
    let mut keys = vec![];
    for forward in config.forwards() {
        let name = forward.name.clone();
        let key = forward
            .key_file
            .as_deref()
            .map(key_file::read)
            .transpose()?;
        if let Some(key) = key.as_ref().map(SigningKey::id) {
            if let Some((other, _)) = known.iter().find(|(_, known)| *known == key) {
                let other = other.clone();
                return Err(StartError::ForwardKey { name, other, key });
            }
            known.push((format!("[[forward]] {name}"), key));
        }
        keys.push(key);
    }
    Ok(keys)
}
