//! `vsm run`: the bridge between its sockets. One thread, one machine; tasks only move octets to and from it.

use std::cell::RefCell;
use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use mavlink_link::frame::FrameView;
use mavlink_link::provisioning::StartError as HandoverError;
use mavlink_link::signing::{KeyId, SigningKey};
use stanag_msgs::Id;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, UdpSocket, UnixListener};
use tokio::sync::Notify;
use tokio::task::LocalSet;

use super::clock::Clock;
use super::dli_recording::DliRecording;
use super::file_store::{FileStore, OpenError};
use super::http;
use super::key_clock;
use super::key_exchange::{KeyExchange, Surroundings};
use super::key_file::{self, KeyFileError};
use super::key_store::{KeyStore, KeyStoreError};
use super::recording::Recording;
use super::service;
use super::sockets::{self, DliSockets, SocketError, VehicleReader, VehicleWriter};
use super::status_socket;
use crate::config::{Config, ExchangeMode, Signing};
use crate::session::{Bridge, BridgeError, Destination, KeyChange, LinkEnd, LogLevel, Status};

/// A bridge that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// A key.
    #[error(transparent)]
    Key(#[from] KeyFileError),
    /// The keys of a vehicle.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// Two vehicles' files hold one key: both would count its stamps, each for itself.
    #[error(
        "vehicles {one} and {other} have the same key {key}: each vehicle needs a key of its own, see `vsm keygen`"
    )]
    SameKey {
        /// A vehicle.
        one: Id,
        /// Another.
        other: Id,
        /// The key's name.
        key: KeyId,
    },
    /// A handover that is not finished.
    #[error(transparent)]
    Handover(#[from] HandoverError),
    /// A socket.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// What was stored.
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    /// The recording.
    #[error("[record] dir {folder}: {cause}", folder = folder.display())]
    Recording {
        /// The folder.
        folder: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// The status page.
    #[error("cannot listen on http.listen = \"{address}\": {cause}")]
    Http {
        /// The address.
        address: SocketAddr,
        /// The system's reason.
        cause: io::Error,
    },
    /// There is no key yet, and the exchange that would bring one needs a pairing.
    #[error("there is no key {path} yet: pair with the air-side agent by `vsm pair` first", path = path.display())]
    NotPaired {
        /// The key file.
        path: PathBuf,
    },
    /// A first key was made for the vehicle and never sent to it.
    #[error("the vehicle has never been sent its first key {path}.next: go on with `vsm key provision`", path = path.display())]
    NeverSent {
        /// The key file.
        path: PathBuf,
    },
    /// The clock of a key.
    #[error(transparent)]
    Clock(#[from] mavlink_link::clock::StoreError),
    /// A record of the key exchange.
    #[error(transparent)]
    Record(#[from] crate::session::StoreError),
    /// No key can be made.
    #[error("the system has no random octets: {0}")]
    Random(io::Error),
    /// The status socket.
    #[error("the status socket in the [store] dir: {0}")]
    Status(io::Error),
}

/// A bridge with its sockets open, ready to serve.
#[derive(Debug)]
pub struct Server {
    shared: Rc<Shared>,
    dli: DliSockets,
    readers: Vec<VehicleReader>,
    writers: Vec<VehicleWriter>,
    status: UnixListener,
    page: Option<TcpListener>,
}

#[derive(Debug)]
struct Shared {
    clock: Clock,
    vsm: String,
    core: RefCell<Core>,
    /// Something waits to be sent.
    outgoing: Notify,
    /// The next time-out may have moved.
    timing: Notify,
}

#[derive(Debug)]
struct Core {
    bridge: Bridge,
    store: FileStore,
    recordings: Vec<Option<Recording>>,
    dli_recording: Option<DliRecording>,
    /// Locked as long as the bridge runs.
    key_stores: Vec<Option<KeyStore>>,
    /// Of the vehicles that agree about keys over the air, by their index.
    exchanges: Vec<(usize, KeyExchange)>,
}

impl Core {
    /// The key exchanges take what has come in for them, and do what is due.
    fn step_exchanges(&mut self, now: mavlink_link::Now, in_use: Option<usize>) {
        for (index, exchange) in &mut self.exchanges {
            let Some(Some(keys)) = self.key_stores.get(*index) else {
                continue;
            };
            let mut with = Surroundings {
                bridge: &mut self.bridge,
                store: &mut self.store,
                keys,
            };
            if in_use == Some(*index) {
                exchange.key_in_use(now, &mut with);
            }
            exchange.step(now, &mut with);
        }
    }

    /// When anything is next needed.
    fn poll_timeout(&self, now: Duration) -> Duration {
        let exchanges = self.exchanges.iter().map(|(_, one)| one.poll_timeout());
        exchanges.fold(self.bridge.poll_timeout(now), Duration::min)
    }
}

impl Server {
    /// Opens store, keys, sockets and recordings. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// Any of them cannot be had; nothing has been sent then.
    pub fn open(config: &Config) -> Result<Server, StartError> {
        let clock = Clock::default();
        let now = clock.now();
        let mut store = FileStore::open(&config.store.dir)?;
        let dli = DliSockets::open(&config.dli)?;
        let (mut readers, mut writers, mut ends, mut recordings) = (vec![], vec![], vec![], vec![]);
        let (mut key_stores, mut key_ids) = (vec![], vec![]);
        for vehicle in config.vehicles() {
            let (key, keys) = match &vehicle.signing {
                Signing::KeyFile(path, exchange) => {
                    let (key, keys) = vehicle_keys(path, exchange.mode, &mut store)?;
                    (Some(key), Some(keys))
                }
                Signing::Off => (None, None),
            };
            let held = keys.as_ref().map(KeyStore::ids).transpose()?;
            for key in held.into_iter().flatten() {
                match key_ids.iter().find(|(_, known)| *known == key) {
                    Some((one, _)) if *one != vehicle.id => {
                        let (one, other) = (*one, vehicle.id);
                        return Err(StartError::SameKey { one, other, key });
                    }
                    _ => key_ids.push((vehicle.id, key)),
                }
            }
            key_stores.push(keys);
            let record = format!("port-{:08x}", vehicle.id.0);
            let (reader, writer, peer) =
                sockets::open_link("vehicle.link", &vehicle.link, &record, &mut store)?;
            readers.push(reader);
            writers.push(writer);
            ends.push(LinkEnd { key, peer });
            recordings.push(match &config.record {
                None => None,
                Some(record) => {
                    let name = format!("{:08x}", vehicle.id.0);
                    let begun =
                        Recording::begin(&record.dir, &name, now.wall).map_err(|cause| {
                            StartError::Recording {
                                folder: record.dir.clone(),
                                cause,
                            }
                        })?;
                    Some(begun)
                }
            });
        }
        let dli_recording = match &config.record {
            None => None,
            Some(record) => {
                let stations = config.stations().map(|station| station.id).collect();
                let begun = DliRecording::begin(&record.dir, stations, now.wall);
                Some(begun.map_err(|cause| StartError::Recording {
                    folder: record.dir.clone(),
                    cause,
                })?)
            }
        };
        let mut bridge = Bridge::new(config, ends, now, NOT_BEFORE, &mut store)?;
        let mut exchanges = vec![];
        for ((index, keys), vehicle) in key_stores.iter().enumerate().zip(config.vehicles()) {
            if let (Signing::KeyFile(_, settings), Some(keys)) = (&vehicle.signing, keys)
                && settings.mode != ExchangeMode::Off
            {
                let mut with = Surroundings {
                    bridge: &mut bridge,
                    store: &mut store,
                    keys,
                };
                let mut exchange =
                    KeyExchange::open(config, vehicle, index, *settings, now, &mut with)?;
                // The agent hands it over: in flight the vehicle goes on under its current key.
                exchange.take_up_next(now, &mut with);
                exchanges.push((index, exchange));
                continue;
            }
            if let Some(next) = keys.as_ref().map(KeyStore::next).transpose()?.flatten() {
                tracing::warn!(
                    "a handover of key {} is not finished: finding out which key the vehicle has",
                    next.id()
                );
                bridge.settle_key(index, next, now, NOT_BEFORE, &mut store)?;
            }
        }
        let page = config
            .http
            .as_ref()
            .map(|http| listen(http.listen))
            .transpose()?;
        let status = status_socket::listen(&config.store.dir).map_err(StartError::Status)?;
        let shared = Shared {
            clock,
            vsm: config.dli.vsm_id.to_string(),
            core: RefCell::new(Core {
                bridge,
                store,
                recordings,
                dli_recording,
                key_stores,
                exchanges,
            }),
            outgoing: Notify::new(),
            timing: Notify::new(),
        };
        Ok(Server {
            shared: Rc::new(shared),
            dli,
            readers,
            writers,
            status,
            page,
        })
    }

    /// Where stations reach it.
    ///
    /// # Errors
    /// The system's.
    pub fn dli_address(&self) -> io::Result<SocketAddr> {
        self.dli.unicast.local_addr()
    }

    /// Where the vehicle with this index reaches it; `None` for a serial line.
    #[must_use]
    pub fn vehicle_address(&self, index: usize) -> Option<SocketAddr> {
        match self.readers.get(index)? {
            VehicleReader::Udp(socket) => socket.local_addr().ok(),
            VehicleReader::Serial(_) => None,
        }
    }

    /// The recording of the vehicle with this index.
    #[must_use]
    pub fn recording(&self, index: usize) -> Option<PathBuf> {
        let core = self.shared.core.borrow();
        core.recordings
            .get(index)?
            .as_ref()
            .map(|recording| recording.path().to_owned())
    }

    /// Serves until `stop` is done, then gives the last status.
    pub async fn serve(self, stop: impl Future<Output = ()>) -> Status {
        let Server {
            shared,
            dli,
            readers,
            writers,
            status,
            page,
        } = self;
        let local = LocalSet::new();
        let unicast = Rc::new(dli.unicast);
        local.spawn_local(receive_dli(shared.clone(), unicast.clone()));
        let group = dli.group.map(|(socket, group)| (Rc::new(socket), group));
        if let Some((socket, _)) = &group {
            local.spawn_local(receive_dli(shared.clone(), socket.clone()));
        }
        for (index, reader) in readers.into_iter().enumerate() {
            local.spawn_local(receive_vehicle(shared.clone(), index, reader));
        }
        local.spawn_local(send(shared.clone(), unicast, group, writers));
        local.spawn_local(keep_time(shared.clone()));
        local.spawn_local(tell_status(shared.clone(), status));
        local.spawn_local(service::keep_alive());
        if let Some(listener) = page {
            let shared = shared.clone();
            let picture = move || {
                shared
                    .core
                    .borrow()
                    .bridge
                    .status(shared.vsm.clone(), shared.clock.mono())
            };
            local.spawn_local(http::serve(listener, picture));
        }
        local.run_until(stop).await;
        let mut core = shared.core.borrow_mut();
        core.recordings
            .iter_mut()
            .flatten()
            .for_each(Recording::flush);
        core.dli_recording.iter_mut().for_each(DliRecording::flush);
        core.bridge.status(shared.vsm.clone(), shared.clock.mono())
    }
}

fn listen(address: SocketAddr) -> Result<TcpListener, StartError> {
    let listener = std::net::TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        TcpListener::from_std(listener)
    });
    listener.map_err(|cause| StartError::Http { address, cause })
}

impl Shared {
    /// Lets the bridge do something, then sees to what follows from it.
    fn with<T>(&self, act: impl FnOnce(&mut Core, mavlink_link::Now) -> T) -> T {
        let mut core = self.core.borrow_mut();
        let now = self.clock.now();
        let done = act(&mut core, now);
        core.step_exchanges(now, None);
        while let Some(entry) = core.bridge.poll_log() {
            match entry.level {
                LogLevel::Info => tracing::info!("{}: {}", entry.about, entry.text),
                LogLevel::Warning => tracing::warn!("{}: {}", entry.about, entry.text),
                LogLevel::Error => tracing::error!("{}: {}", entry.about, entry.text),
            }
        }
        while let Some((index, change)) = core.bridge.poll_key_change() {
            let Some(Some(keys)) = core.key_stores.get(index) else {
                continue;
            };
            let (done, what) = match change {
                KeyChange::Commit => (keys.commit(), "the vehicle has the new key"),
                KeyChange::DropNext => (keys.drop_next(), "the vehicle keeps its key"),
            };
            match done {
                Ok(()) => {
                    tracing::info!("{what}");
                    let in_use = (change == KeyChange::Commit).then_some(index);
                    core.step_exchanges(now, in_use);
                }
                // Found out again at the next start.
                Err(fault) => tracing::error!("{what}, but {fault}"),
            }
        }
        self.outgoing.notify_one();
        self.timing.notify_one();
        done
    }
}

/// The key in force and its files. A first key that was sent and whose end is not known is the one in force.
fn vehicle_keys(
    path: &Path,
    mode: ExchangeMode,
    store: &mut FileStore,
) -> Result<(SigningKey, KeyStore), StartError> {
    let keys = KeyStore::open(path)?;
    if keys.current()?.is_none() {
        // A key that is handed over has a clock on disk before it leaves.
        if mode == ExchangeMode::Off
            && let Some(next) = keys.next()?
            && key_clock::ceiling(store, &next.id())?.is_none()
        {
            let path = path.to_owned();
            return Err(StartError::NeverSent { path });
        }
        keys.commit()?;
    }
    if keys.current()?.is_none() && mode == ExchangeMode::Legacy {
        // Until there is an agreed key the link has one that nobody else holds: nothing unsigned is believed.
        keys.stage(&key_file::random().map_err(StartError::Random)?)?;
        keys.commit()?;
    }
    if keys.current()?.is_none() && mode == ExchangeMode::On {
        let path = path.to_owned();
        return Err(StartError::NotPaired { path });
    }
    match keys.current()? {
        Some(key) => Ok((key, keys)),
        None => Ok((key_file::read(path)?, keys)),
    }
}

async fn receive_dli(shared: Rc<Shared>, socket: Rc<UdpSocket>) {
    let mut octets = vec![0; LARGEST_DATAGRAM];
    let here = socket.local_addr();
    loop {
        match socket.recv_from(&mut octets).await {
            Ok((length, from)) => shared.with(|core, now| {
                let octets = octets.get(..length).unwrap_or_default();
                if let (Some(recording), Ok(here)) = (&mut core.dli_recording, &here) {
                    recording.received(now.wall, from, *here, octets);
                }
                core.bridge.handle_dli(now, from, octets, &mut core.store);
            }),
            Err(cause) => pause_after("the DLI socket", &cause).await,
        }
    }
}

async fn receive_vehicle(shared: Rc<Shared>, index: usize, mut reader: VehicleReader) {
    let mut octets = vec![0; LARGEST_DATAGRAM];
    loop {
        match reader.receive(&mut octets).await {
            Ok((length, from)) => shared.with(
                |Core {
                     bridge,
                     store,
                     recordings,
                     ..
                 },
                 now| {
                    let octets = octets.get(..length).unwrap_or_default();
                    let recording = recordings.get_mut(index).and_then(Option::as_mut);
                    let mut tap = recorder(recording, now.wall);
                    bridge.handle_vehicle(now, index, from, octets, store, &mut tap);
                },
            ),
            Err(cause) => pause_after("a vehicle's link", &cause).await,
        }
    }
}

fn recorder(mut recording: Option<&mut Recording>, wall: Duration) -> impl FnMut(&FrameView<'_>) {
    move |frame| {
        if let Some(recording) = &mut recording {
            recording.write(wall, frame);
        }
    }
}

async fn send(
    shared: Rc<Shared>,
    unicast: Rc<UdpSocket>,
    group: Option<(Rc<UdpSocket>, std::net::SocketAddr)>,
    mut writers: Vec<VehicleWriter>,
) {
    loop {
        shared.outgoing.notified().await;
        // Taken one by one: the machine is not held while the system takes its time.
        loop {
            let frame = shared.core.borrow_mut().bridge.poll_vehicle();
            let Some((index, frame)) = frame else { break };
            {
                let mut core = shared.core.borrow_mut();
                if let (Some(recording), Ok(view)) = (
                    core.recordings.get_mut(index).and_then(Option::as_mut),
                    FrameView::parse(frame.octets()),
                ) {
                    recording.write(shared.clock.now().wall, &view);
                }
            }
            if let Some(writer) = writers.get_mut(index)
                && let Err(cause) = writer.send(frame.octets(), frame.to).await
            {
                tracing::debug!("a frame to the vehicle was not sent: {cause}");
            }
        }
        loop {
            let datagram = shared.core.borrow_mut().bridge.poll_dli();
            let Some(datagram) = datagram else { break };
            let (socket, to) = match (datagram.to, &group) {
                (Destination::Unicast(to), _) => (&unicast, to),
                (Destination::Multicast, Some((socket, group))) => (socket, *group),
                (Destination::Multicast, None) => continue,
            };
            if let (Some(recording), Ok(here)) = (
                &mut shared.core.borrow_mut().dli_recording,
                socket.local_addr(),
            ) {
                recording.sent(shared.clock.now().wall, here, to, datagram.octets());
            }
            if let Err(cause) = socket.send_to(datagram.octets(), to).await {
                tracing::debug!("a datagram to a CUCS was not sent: {cause}");
            }
        }
    }
}

async fn keep_time(shared: Rc<Shared>) {
    let mut flush_at = Duration::ZERO;
    loop {
        let due = {
            let core = shared.core.borrow();
            core.poll_timeout(shared.clock.mono())
        };
        if due <= shared.clock.mono() {
            shared.with(|Core { bridge, store, .. }, now| bridge.handle_timeout(now, store));
            if flush_at <= shared.clock.mono() {
                flush_at = shared.clock.mono() + FLUSH_EVERY;
                let mut core = shared.core.borrow_mut();
                core.recordings
                    .iter_mut()
                    .flatten()
                    .for_each(Recording::flush);
                core.dli_recording.iter_mut().for_each(DliRecording::flush);
            }
            // A machine that is due at once, always, must not starve the sockets.
            tokio::time::sleep(SHORTEST_WAIT).await;
            continue;
        }
        tokio::select! {
            () = tokio::time::sleep_until(shared.clock.instant(due).into()) => {}
            () = shared.timing.notified() => {}
        }
    }
}

async fn tell_status(shared: Rc<Shared>, listener: UnixListener) {
    loop {
        match listener.accept().await {
            Ok((mut stream, _)) => {
                let status = shared
                    .core
                    .borrow()
                    .bridge
                    .status(shared.vsm.clone(), shared.clock.mono());
                let text = serde_json::to_string(&status).unwrap_or_default();
                // Whoever asks and does not read must not hold up the next.
                let _ =
                    tokio::time::timeout(STATUS_WITHIN, stream.write_all(text.as_bytes())).await;
            }
            Err(cause) => pause_after("the status socket", &cause).await,
        }
    }
}

/// A socket that fails again and again is said once in a while, and takes no whole core.
async fn pause_after(what: &str, cause: &io::Error) {
    tracing::warn!("{what}: {cause}");
    tokio::time::sleep(Duration::from_millis(500)).await;
}

/// Longest datagram that UDP can carry: one that is too long is counted, not cut.
const LARGEST_DATAGRAM: usize = 65_536;
const FLUSH_EVERY: Duration = Duration::from_secs(1);
const SHORTEST_WAIT: Duration = Duration::from_millis(1);
const STATUS_WITHIN: Duration = Duration::from_secs(1);
/// 2026-01-01: no clock of ours starts before the program was written.
pub(super) const NOT_BEFORE: Duration = Duration::from_secs(1_767_225_600);
