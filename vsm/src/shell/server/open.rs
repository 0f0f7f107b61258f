//! How a server opens its store, keys, sockets and recordings, before anything is sent.

use std::cell::RefCell;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;

use mavlink_link::Now;
use mavlink_link::store::Disk;
use tokio::net::TcpListener;
use tokio::sync::{Notify, watch};
use zeroize::Zeroize as _;

use super::encryption::open_encryption;
use super::forward::{self, ForwardReader, Forwards, OpenForward};
use super::guard_thread::GuardThread;
use super::guards;
use super::shared::{Alarm, Core, OpenPort, Shared};
use super::vehicle::{
    OpenKeys, find_port, open_exchange, open_keys, open_port, record_vehicle, share,
};
use super::{Server, StartError};
use crate::config::Config;
use crate::key_exchange::KeyExchange;
use crate::session::{AuditKey, Bridge, BridgeError, HostClocks, LinkEnd};
use crate::shell::clock::{Clock, NOT_BEFORE};
use crate::shell::disk::FileDisk;
use crate::shell::dli_recording::DliRecording;
use crate::shell::encryption::Encryption;
use crate::shell::key_file::system_random;
use crate::shell::key_store::KeyStore;
use crate::shell::ordered_files::OrderedKeys;
use crate::shell::pairing_socket;
use crate::shell::queued_disk::QueuedDisk;
use crate::shell::recording::{Recorder, Recording};
use crate::shell::sockets::{DliSockets, Hosts, VehicleReader, VehicleWriter, ask_system};
use crate::shell::status_socket;
use crate::shell::timer::Timer;
use crate::shell::web::control::{self, Clients};
use crate::shell::web::{Page, Tiles};

impl Server {
    /// Opens store, keys, sockets and recordings. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// Any of them cannot be opened; nothing has been sent in that case.
    pub fn open(config: &Config) -> Result<Server, StartError> {
        // The store's lock comes first: a second bridge stops here, before it opens keys or sockets.
        Server::open_on(config, FileDisk::open(&config.store.dir)?)
    }

    /// As [`Server::open`], with the store on this disk.
    ///
    /// # Errors
    /// As [`Server::open`].
    pub fn open_on(config: &Config, mut store: FileDisk) -> Result<Server, StartError> {
        let how = How {
            keys: &KeyStore::open,
            records: true,
        };
        let Opened {
            config,
            clock,
            dli,
            bridge,
            readers,
            ports,
            writers,
            recorder,
            recordings,
            dli_recording,
            key_stores,
            exchanges,
            encryptions,
            forwards,
            forward_readers,
            page,
        } = Opened::of(config, &mut store, &how)?;
        let control = (config.web.control)
            .then(|| control::open(config.dli.vsm_id))
            .transpose()
            .map_err(StartError::WebClients)?;
        let status = status_socket::listen(&config.store.dir, status_socket::STATUS)
            .map_err(StartError::Status)?;
        let settings = status_socket::listen(&config.store.dir, status_socket::SETTINGS)
            .map_err(StartError::Status)?;
        let files = status_socket::listen(&config.store.dir, status_socket::FILES)
            .map_err(StartError::Status)?;
        let zeroize = status_socket::listen(&config.store.dir, status_socket::ZEROIZE)
            .map_err(StartError::Status)?;
        let pairing = pairing_socket::listen(&config.store.dir).map_err(StartError::Status)?;
        let (guard_thread, agreed) =
            GuardThread::start(&config, store.shared(), clock).map_err(StartError::Writer)?;
        let stored = Arc::new(Notify::new());
        // From here on nothing waits for the disk.
        let start = |keys| OrderedKeys::start(keys, &store, stored.clone());
        let key_stores = key_stores
            .into_iter()
            .map(|keys| keys.map(&start))
            .collect();
        let store = QueuedDisk::new(store, stored.clone()).map_err(StartError::Writer)?;
        let shared = Shared {
            clock,
            vsm: config.dli.vsm_id.to_string(),
            events: RefCell::default(),
            core: RefCell::new(Core {
                bridge,
                config,
                ports,
                writers,
                forwards,
                store,
                recorder,
                recordings,
                dli_recording,
                key_stores,
                exchanges,
                encryptions,
                guard_thread,
                web: Clients::default(),
                lease: watch::channel(None).1,
                gathering: Arc::default(),
            }),
            outgoing: Notify::new(),
            alarm: Alarm::default(),
            stored,
            zeroize: Notify::new(),
            ended: Notify::new(),
        };
        Ok(Server {
            shared: Rc::new(shared),
            dli,
            readers,
            forwards: forward_readers,
            status,
            settings,
            files,
            zeroize,
            pairing,
            agreed,
            page,
            control,
            reload: None,
            resolver: ask_system,
            timer: Timer::new().map_err(StartError::Timer)?,
        })
    }
}

/// How a start treats files.
pub(super) struct How<'a> {
    pub(super) keys: OpenKeys<'a>,
    /// Recordings are begun.
    pub(super) records: bool,
}

/// What a start opens of files and sockets, and the machine on these: everything that can be wrong with a configuration, its
/// files and this computer. What follows needs the store's folder and threads.
pub(super) struct Opened {
    config: Config,
    clock: Clock,
    dli: DliSockets,
    bridge: Bridge,
    readers: Vec<(usize, VehicleReader, Rc<Notify>)>,
    ports: Vec<Option<OpenPort>>,
    writers: Vec<VehicleWriter>,
    recorder: Recorder,
    recordings: Vec<Option<Recording>>,
    dli_recording: Option<DliRecording>,
    key_stores: Vec<Option<KeyStore>>,
    exchanges: Vec<(usize, KeyExchange)>,
    encryptions: Vec<(usize, Encryption)>,
    forwards: Vec<OpenForward>,
    forward_readers: Vec<ForwardReader>,
    page: Option<(TcpListener, Page)>,
}

impl Opened {
    pub(super) fn of(
        config: &Config,
        store: &mut dyn Disk,
        how: &How<'_>,
    ) -> Result<Opened, StartError> {
        let before = config;
        let mut config = config.clone();
        config.read_terrain(Some(before))?;
        let clock = Clock::default();
        let now = clock.now();
        let dli = DliSockets::open(&config.dli)?;
        let (mut readers, mut writers, mut ends, mut recordings) = (vec![], vec![], vec![], vec![]);
        let (mut key_stores, mut key_ids) = (vec![], vec![]);
        let mut ports: Vec<Option<OpenPort>> = vec![];
        let recorder = Recorder::default();
        for vehicle in config.vehicles() {
            let (key, keys) = open_keys(vehicle, &mut key_ids, store, how.keys)?;
            key_stores.push(keys);
            // Vehicles on one link share its socket: PX4 answers the port that spoke first, so there must be one port.
            if find_port(&ports, &vehicle.link).is_none() {
                let (reader, port) = open_port(vehicle, &Hosts::AskNow, store)?;
                readers.push((ports.len(), reader, port.close.clone()));
                ports.push(Some(port));
            }
            if let Some(port) = find_port(&ports, &vehicle.link) {
                writers.push(port.writer.clone());
                let peer = port.peer;
                ends.push(LinkEnd { key, peer });
            }
            recordings.push(match how.records {
                true => record_vehicle(&config, vehicle, now, &recorder)?,
                false => None,
            });
        }
        let dli_recording = match how.records {
            true => record_dli(&config, now, &recorder)?,
            false => None,
        };
        // Needed before the bridge verifies its audit logs and chains the next line to them.
        AuditKey::load_or_make(store, &mut system_random).map_err(BridgeError::Store)?;
        let clocks = HostClocks {
            not_before: NOT_BEFORE,
            boot: clock.boot(),
        };
        let mut bridge = Bridge::new(&config, ends, now, clocks, store)?;
        let mut secret = [0; 32];
        system_random(&mut secret).map_err(|fault| StartError::Random(io::Error::other(fault)))?;
        bridge.set_secret(secret);
        system_random(&mut secret).map_err(|fault| StartError::Random(io::Error::other(fault)))?;
        bridge.set_group_secret(secret, now);
        // The bridge has its own copies of both.
        secret.zeroize();
        bridge.set_trace(tracing::enabled!(tracing::Level::DEBUG));
        let mut exchanges = vec![];
        for (at, keys) in config.vehicles().enumerate().zip(&key_stores) {
            if let Some(keys) = keys {
                let machine = (&mut bridge, &mut *store as &mut dyn Disk);
                let exchange = open_exchange(&config, at, keys, None, now, machine)?;
                exchanges.extend(exchange.map(|exchange| (at.0, exchange)));
            }
        }
        let mut encryptions = vec![];
        for (index, vehicle) in config.vehicles().enumerate() {
            let at = find_port(&ports, &vehicle.link).and_then(|port| port.peer);
            let opened = open_encryption(&config, vehicle, at, now, store)?;
            encryptions.extend(opened.map(|one| (index, one)));
        }
        let forward_keys = forward::keys(&config, &key_ids)?;
        let others = forward::owners(&config, &key_ids, &forward_keys);
        let guard_keys = guards::keys(&config, others, now)?;
        let of_guards = guards::owners(&guard_keys);
        bridge.set_guard_keys(guard_keys, now, NOT_BEFORE, store)?;
        if let Some(access) = &config.access {
            let others = forward::owners(&config, &key_ids, &forward_keys).chain(of_guards);
            let key = guards::access_key(access, others)?;
            let file = guards::access_list(&access.list);
            bridge.set_access(&key, file, now, NOT_BEFORE, store)?;
        }
        let Forwards {
            ends,
            opened: forwards,
            readers: forward_readers,
        } = forward::open(&config, forward_keys, None, store)?;
        let prepared = bridge.prepare_forwards(&config, ends, now, NOT_BEFORE, store)?;
        bridge.take_forwards(prepared);
        Ok(Opened {
            page: open_page(&config)?,
            config,
            clock,
            dli,
            bridge,
            readers,
            ports,
            writers,
            recorder,
            recordings,
            dli_recording,
            key_stores,
            exchanges,
            encryptions,
            forwards,
            forward_readers,
        })
    }
}

/// The listener of the operator's page, where one is served.
fn open_page(config: &Config) -> Result<Option<(TcpListener, Page)>, StartError> {
    let Some(http) = &config.http else {
        return Ok(None);
    };
    let page = Page {
        hosts: http.hosts.clone(),
        tiles: (config.web.tiles.as_deref().map(Tiles::open)).transpose()?,
        ..Page::default()
    };
    Ok(Some((listen(http.listen)?, page)))
}

fn record_dli(
    config: &Config,
    now: Now,
    recorder: &Recorder,
) -> Result<Option<DliRecording>, StartError> {
    let Some(record) = &config.record else {
        return Ok(None);
    };
    let stations = config.stations().map(|station| station.id).collect();
    let quota = share(config, record);
    let begun = DliRecording::begin(&record.dir, stations, now.wall, quota, recorder);
    begun.map(Some).map_err(|cause| StartError::Recording {
        folder: record.dir.clone(),
        cause,
    })
}

pub(super) fn listen(address: SocketAddr) -> Result<TcpListener, StartError> {
    let listener = std::net::TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        TcpListener::from_std(listener)
    });
    listener.map_err(|cause| StartError::Http { address, cause })
}
