//! `vsm airside`: the agent between its two links. One thread, one loop, one machine.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mavlink_link::encrypted::Role;
use mavlink_link::exchange::{PairingCode, PinnedPeer};
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::Endpoint;
use mavlink_link::receiver::Stream;
use mavlink_link::signing::Stamp;
use tokio::io::AsyncReadExt as _;
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::Notify;
use tokio::task::JoinHandle;
use tokio::time::Interval;
use zeroize::Zeroize;

use super::airside_disk::AirsideDisk;
use super::clock::{Clock, NOT_BEFORE};
use super::disk::{FileDisk, OpenError};
use super::encryption::{Encryption, EncryptionEnd};
use super::erase::{self, Order};
use super::key_file::system_random;
use super::key_link;
use super::key_store::{KeyStore, KeyStoreError};
use super::local_peers::LocalPeers;
use super::memory;
use super::ordered_files::OrderedKeys;
use super::pairing_socket::{self, Asker};
use super::queued_disk::QueuedDisk;
use super::rest::Rest;
use super::service;
use super::sockets::{self, Hosts, SocketError, VehicleReader, VehicleWriter};
use super::status_socket::{self, Ordered};
use super::tasks::TaskFault;
use crate::airside::{
    Agent, AgentError, AirsideStatus, Held, Keys as _, PairingNews, Settings, Side, Trace,
    sent_text,
};
use crate::config::airside::{AirsideConfig, Px4};
use crate::key_exchange::{self, ExchangeRecord};
use crate::session::{LogLevel, Peer};
use mavlink_link::store::StoreError;

/// An agent that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum AirsideError {
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// The keys.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// A link.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// The machine.
    #[error(transparent)]
    Agent(#[from] AgentError),
    /// Keys would be readable by anyone on the link.
    #[error(
        "px4.link = \"{link}\": PX4's keys go over it, so it must be a serial line or loopback; or vouch for it with \
         px4.i_trust_this_link = true"
    )]
    OpenLink {
        /// The link.
        link: String,
    },
    /// The stored state of the exchange.
    #[error(transparent)]
    Exchange(#[from] StoreError),
    /// The threads that write to the store.
    #[error("the [store] dir: {0}")]
    Writer(io::Error),
    /// The status or the pairing socket.
    #[error("the sockets in the [store] dir: {0}")]
    Status(io::Error),
}

/// An agent with its links open, ready to serve.
#[derive(Debug)]
pub struct AirsideServer {
    agent: Agent,
    disk: AirsideDisk,
    /// The disk has made changes durable, or has failed to.
    stored: Arc<Notify>,
    clock: Clock,
    vehicle: String,
    radio: (VehicleReader, VehicleWriter),
    /// For the ground's link, where it is encrypted.
    encryption: Option<Encryption>,
    px4: (VehicleReader, VehicleWriter),
    /// Who may be PX4.
    px4_peers: LocalPeers,
    status: UnixListener,
    pairing: UnixListener,
    zeroize: UnixListener,
    /// What an order to zeroize erases.
    order: Order,
    /// A client on this computer whose request has not arrived yet.
    greeting: Option<Greeting>,
    /// The client of the open pairing window.
    asker: Option<Asker>,
    /// The client on this computer that has ordered a zeroize and waits for its result.
    orderer: Option<UnixStream>,
}

type Greeting = JoinHandle<Option<(Asker, PairingCode)>>;

impl AirsideServer {
    /// Opens store, keys and links. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// Any of them cannot be opened; nothing has been sent in that case.
    pub fn open(config: &AirsideConfig) -> Result<AirsideServer, AirsideError> {
        AirsideServer::open_on(config, &|dir| FileDisk::open(dir))
    }

    /// As [`AirsideServer::open`], with the store opened by `open`.
    ///
    /// # Errors
    /// As [`AirsideServer::open`].
    pub fn open_on(
        config: &AirsideConfig,
        open: &dyn Fn(&Path) -> Result<FileDisk, OpenError>,
    ) -> Result<AirsideServer, AirsideError> {
        let (own, radio, px4) = (
            config.agent.get_ref(),
            config.radio.get_ref(),
            config.px4.get_ref(),
        );
        may_carry_keys(px4)?;
        let clock = Clock::default();
        let mut store = open(&config.store.dir)?;
        // Store and key are locked before a link is opened: a second agent stops before PX4 can see its port.
        let keys = KeyStore::open(&own.key_file)?;
        let (radio_reader, radio_writer, ground) = sockets::open_link(
            "radio.link",
            &radio.link,
            &Hosts::AskNow,
            "port-radio",
            &mut store,
        )?;
        let (px4_reader, px4_writer, autopilot) = sockets::open_link(
            "px4.link",
            &px4.link,
            &Hosts::AskNow,
            "port-px4",
            &mut store,
        )?;
        let status = status_socket::listen(&config.store.dir, status_socket::STATUS)
            .map_err(AirsideError::Status)?;
        let pairing = pairing_socket::listen(&config.store.dir).map_err(AirsideError::Status)?;
        let zeroize = status_socket::listen(&config.store.dir, status_socket::ZEROIZE)
            .map_err(AirsideError::Status)?;
        let settings = settings(config, ground, autopilot);
        let identity = key_exchange::identity(&mut store, &mut system_random)?;
        let encryption = if radio.encrypt {
            let end = EncryptionEnd {
                role: Role::Air,
                parties: settings.parties(),
                identity: identity.duplicate(),
                peer: ExchangeRecord::load(&store, own.vehicle_id)?.peer(),
                at: ground,
            };
            Some(Encryption::open(&radio.link, end, clock.now(), &store)?)
        } else {
            None
        };
        let stored = Arc::new(Notify::new());
        // From here on no frame waits for the disk.
        let ordered = OrderedKeys::start(keys, &store, stored.clone());
        let store = QueuedDisk::new(store, stored.clone()).map_err(AirsideError::Writer)?;
        let mut disk = AirsideDisk {
            store,
            ordered,
            vehicle: own.vehicle_id,
        };
        disk.bury();
        let held = held(&disk)?;
        let agent = Agent::start(settings, identity, held, clock.now(), &mut disk)?;
        Ok(AirsideServer {
            agent,
            disk,
            stored,
            clock,
            vehicle: own.vehicle_id.to_string(),
            radio: (radio_reader, radio_writer),
            encryption,
            px4: (px4_reader, px4_writer),
            px4_peers: LocalPeers::new(&px4.link, px4.i_trust_this_link, &px4.users),
            status,
            pairing,
            zeroize,
            order: Order::of_agent(config),
            greeting: None,
            asker: None,
            orderer: None,
        })
    }

    /// Where the ground and PX4 reach it; `None` where a link is a serial line.
    #[must_use]
    pub fn addresses(&self) -> Option<(SocketAddr, SocketAddr)> {
        Some((self.radio.1.local_addr()?, self.px4.1.local_addr()?))
    }

    /// Serves until `stop` is done, then returns the last status. Everything except the serial ports is this one task,
    /// which pings the service manager's watchdog itself: an agent that is stuck anywhere is restarted.
    ///
    /// # Errors
    /// A task that writes a serial port has ended.
    pub async fn serve(
        mut self,
        stop: impl Future<Output = ()>,
    ) -> Result<AirsideStatus, TaskFault> {
        let mut stop = std::pin::pin!(stop);
        let (mut from_radio, mut from_px4) = (vec![0; LARGEST], vec![0; LARGEST]);
        let mut pings = service::ping_interval().map(tokio::time::interval);
        let (stored, looked) = (self.stored.clone(), self.px4_peers.looked());
        let (mut radio_rest, mut px4_rest) = (Rest::default(), Rest::default());
        let (mut status_rest, mut pairing_rest) = (Rest::default(), Rest::default());
        let mut zeroize_rest = Rest::default();
        for (_, writer) in [&self.radio, &self.px4] {
            writer.ready().await;
        }
        // Frames and alerts of the start, before the first wait.
        self.settle().await?;
        loop {
            let encryption = self.encryption.as_ref().map(Encryption::poll_timeout);
            let due = encryption.map_or(Duration::MAX, |at| at.max(self.clock.mono()));
            let due = self.clock.instant(self.agent.poll_timeout().min(due));
            tokio::select! {
                () = &mut stop => break,
                () = next_ping(&mut pings) => service::alive(),
                () = stored.notified() => drop(self.disk.store.poll()),
                // A key that waited for the lookup is sent below.
                () = looked.notified() => {}
                received = radio_rest.before(self.radio.0.receive(&mut from_radio)) => match received {
                    Ok((length, from)) => {
                        let bytes = from_radio.get(..length).unwrap_or_default();
                        self.take_radio(from, bytes);
                    }
                    Err(cause) => radio_rest.begin("the ground's link", &cause),
                },
                received = px4_rest.before(self.px4.0.receive(&mut from_px4)) => match received {
                    Ok((length, from)) => {
                        let bytes = from_px4.get(..length).unwrap_or_default();
                        self.take_px4(from, bytes);
                    }
                    Err(cause) => px4_rest.begin("PX4's link", &cause),
                },
                asked = status_rest.before(self.status.accept()) => match asked {
                    Ok((stream, _)) => {
                        status_socket::answer(stream, &self.picture(), STATUS_WITHIN).await;
                    }
                    Err(cause) => status_rest.begin("the status socket", &cause),
                },
                asked = pairing_rest.before(self.pairing.accept()) => match asked {
                    Ok((stream, _)) => {
                        let greeted = tokio::time::timeout(GREETING_WITHIN, Asker::greet(stream));
                        // In a separate task, so that a slow client delays no frame. The latest client is served.
                        let greeting = async { greeted.await.ok().flatten() };
                        self.greeting = Some(tokio::spawn(greeting));
                    }
                    Err(cause) => pairing_rest.begin("the pairing socket", &cause),
                },
                asked = zeroize_rest.before(self.zeroize.accept()) => match asked {
                    Ok((stream, _)) => self.take_zeroize(stream).await,
                    Err(cause) => zeroize_rest.begin("the zeroize socket", &cause),
                },
                greeted = greeted(&mut self.greeting) => {
                    self.greeting = None;
                    if let Some((asker, code)) = greeted {
                        self.open_window(asker, code).await;
                    }
                }
                () = gone(&mut self.asker) => {
                    self.asker = None;
                    // A window without its client would stay open unseen.
                    self.agent.close_window();
                }
                () = tokio::time::sleep_until(due.into()) => {
                    let now = self.clock.now();
                    if let Some(encryption) = &mut self.encryption {
                        encryption.handle_timeout(now, &mut self.disk.store);
                    }
                    self.agent.handle_timeout(now, &mut self.disk);
                }
            }
            self.settle().await?;
            if self.agent.is_zeroized(self.clock.mono()) {
                break;
            }
        }
        // The next process that opens the store only erases it: PX4 has received another key, or this agent ended before it
        // could send one.
        erase::claim(&mut self.disk.store.files().shared());
        let end = Instant::now() + LAST_WRITES;
        self.disk.store.wait(LAST_WRITES);
        self.disk.ordered.files.wait(end);
        Ok(self.picture())
    }

    /// Takes data from the ground; on an encrypted link, the decrypted content.
    fn take_radio(&mut self, from: Peer, bytes: &[u8]) {
        let now = self.clock.now();
        // Taken out for the call: `handle` borrows the rest of `self` too, and its result borrows the link.
        let mut encryption = self.encryption.take();
        let (from, bytes) = match &mut encryption {
            Some(one) => one.handle(now, from, bytes, &mut self.disk.store),
            None => (from, bytes),
        };
        if !bytes.is_empty() {
            let mut random = system_random;
            let trace = self.begin_trace(Side::Radio);
            self.agent
                .handle_radio(now, from, bytes, &mut random, &mut self.disk);
            self.end_trace(trace, from, bytes);
        }
        self.encryption = encryption;
    }

    fn take_px4(&mut self, from: Peer, bytes: &[u8]) {
        let now = self.clock.now();
        let trace = self.begin_trace(Side::Px4);
        if self.px4_peers.admits(now.mono, from) {
            self.agent.handle_px4(now, from, bytes, &mut self.disk);
        } else {
            self.agent.count_held_back(FOREIGN);
        }
        self.end_trace(trace, from, bytes);
    }

    /// For a log that shows each datagram.
    fn begin_trace(&self, side: Side) -> Option<Trace> {
        let traced = tracing::enabled!(tracing::Level::DEBUG);
        traced.then(|| self.agent.begin_trace(side))
    }

    fn end_trace(&self, trace: Option<Trace>, from: Peer, bytes: &[u8]) {
        if let Some(trace) = trace {
            tracing::debug!("{}", self.agent.end_trace(trace, from, bytes));
        }
    }

    fn picture(&self) -> AirsideStatus {
        let now = self.clock.mono();
        let mut status = self.agent.status(self.vehicle.clone(), now);
        status.encryption = self.encryption.as_ref().map(|one| one.status(now));
        status.memory_locked = memory::is_locked();
        status
    }

    /// A client on this computer requests a zeroize.
    async fn take_zeroize(&mut self, mut stream: UnixStream) {
        let read = tokio::time::timeout(STATUS_WITHIN, stream.read_u8()).await;
        let Ok(Ok(word)) = read else {
            return;
        };
        let in_flight = word == status_socket::IN_FLIGHT;
        match self.agent.zeroize_here(self.clock.mono(), in_flight) {
            Ok(()) => self.orderer = Some(stream),
            Err(why) => answer_order(stream, Some(why.to_owned()), vec![]).await,
        }
    }

    /// Stores an order to zeroize before acknowledging it, and answers a client on this computer.
    async fn settle_zeroize(&mut self) {
        if self.agent.zeroize_to_store() {
            // On this thread: everything else that waits for the disk is erased anyway.
            let mut disk = self.disk.store.files().shared();
            let stored = erase::begin(&mut disk, &self.order).map_err(|fault| fault.to_string());
            let now = self.clock.now();
            self.agent
                .zeroize_stored(now, &stored, &mut system_random, &mut self.disk);
            if let Err(why) = stored
                && let Some(stream) = self.orderer.take()
            {
                answer_order(stream, Some(why), vec![]).await;
            }
        }
        if let Some(key) = self.agent.zeroized_key()
            && let Some(stream) = self.orderer.take()
        {
            answer_order(stream, None, vec![key.to_string()]).await;
        }
    }

    /// A client on this computer requests a pairing.
    async fn open_window(&mut self, mut asker: Asker, code: PairingCode) {
        let now = self.clock.now();
        match self.agent.open_window(now, &code, &mut self.disk) {
            Ok(()) => {
                asker
                    .send_line(&format!("pairing code  {}", &*code.text()))
                    .await;
                let own = self.picture().identity;
                asker.send_line(&format!("this agent    {own}")).await;
                asker
                    .send_line("the window is open for 10 minutes, for one pairing")
                    .await;
                self.asker = Some(asker);
            }
            Err(fault) => asker.send_line(&format!("refused: {fault}")).await,
        }
    }

    /// Reports the events of the pairing window to the client that opened it.
    async fn report_pairing(&mut self) {
        // A pairing does not exist until it is stored.
        while self.disk.is_stored()
            && let Some(news) = self.agent.poll_pairing()
        {
            let Some(asker) = &mut self.asker else {
                continue;
            };
            match news {
                // The window stays open: otherwise anyone on the radio could close it with a wrong code.
                PairingNews::WrongCode => {
                    asker.send_line("pairing attempt with a wrong code").await
                }
                PairingNews::Paired(peer) => {
                    if let Some(encryption) = &mut self.encryption {
                        encryption.set_peer(peer, self.clock.mono(), &mut self.disk.store);
                    }
                    asker
                        .send_line(&format!("paired with   {}", peer.fingerprint()))
                        .await;
                    self.asker = None;
                }
                PairingNews::Closed => {
                    asker.send_line("closed without a pairing").await;
                    self.asker = None;
                }
            }
        }
    }

    /// Sends what is due and writes the log.
    async fn settle(&mut self) -> Result<(), TaskFault> {
        self.settle_zeroize().await;
        let mut out = [0; MAX_FRAME];
        loop {
            // Before each frame: the lookup of a key's receiver expires.
            self.hold_key();
            let now = self.clock.now();
            let Some(sent) = self.agent.poll_transmit(now, &mut self.disk, &mut out) else {
                break;
            };
            let frame = out.get(..sent.len).unwrap_or_default();
            let (writer, task) = match sent.side {
                Side::Radio => (&mut self.radio.1, RADIO_WRITER),
                Side::Px4 => (&mut self.px4.1, "writer of PX4's serial port"),
            };
            if tracing::enabled!(tracing::Level::DEBUG) {
                tracing::debug!("{}", sent_text(sent.side, sent.to, frame));
            }
            // PX4's key may go only to the process that is PX4. Another program of this computer can take its port after a
            // crash.
            let stranger = sent.secret.then(|| self.px4_peers.take_look(sent.to));
            if let (Side::Radio, Some(encryption)) = (sent.side, &mut self.encryption) {
                encryption.send(self.clock.mono(), sent.to, frame);
                // At once: it holds few packets, and a burst of PX4's frames makes many.
                self.send_encrypted()?;
            } else if let Some(Err(stranger)) = stranger {
                tracing::error!("{NOT_SENT}: {stranger}");
                self.agent.count_held_back(FOREIGN);
            } else if let Err(cause) = writer.try_send(frame, sent.to) {
                // The writer's task has ended; nothing would be sent on this line any more. Any other error is of this
                // frame alone.
                if cause.kind() == io::ErrorKind::BrokenPipe {
                    return Err(TaskFault::Ended { task });
                }
                tracing::debug!("a frame to {} was not sent: {cause}", sent.to);
            }
            // The next frame may be shorter and would leave the end of the key in the buffer.
            if sent.secret {
                out.zeroize();
            }
        }
        self.px4_peers.forget_look();
        self.report_pairing().await;
        self.send_encrypted()?;
        while let Some(note) = self.agent.poll_note() {
            write_log(note.level, &note.text);
        }
        Ok(())
    }

    /// A key waits until its receiver has been looked up on another thread: the lookup reads /proc and may be slow.
    fn hold_key(&mut self) {
        let mono = self.clock.mono();
        let hold = self.agent.key_is_due(mono) && !self.px4_peers.has_looked(mono);
        self.agent.hold_key(hold);
    }

    /// Sends what the encrypted link has for the radio, and writes its log.
    fn send_encrypted(&mut self) -> Result<(), TaskFault> {
        let Some(encryption) = &mut self.encryption else {
            return Ok(());
        };
        let disk = &mut self.disk.store;
        while let Some((to, bytes)) = encryption.poll_transmit(self.clock.mono(), disk) {
            if let Err(cause) = self.radio.1.try_send(bytes, to) {
                if cause.kind() == io::ErrorKind::BrokenPipe {
                    let task = RADIO_WRITER;
                    return Err(TaskFault::Ended { task });
                }
                tracing::debug!("a packet to {to} was not sent: {cause}");
            }
        }
        while let Some((level, text)) = encryption.poll_notice(self.clock.mono()) {
            write_log(level, &text);
        }
        Ok(())
    }
}

/// Keys for PX4 can be read by anyone who can receive the link.
pub(super) fn may_carry_keys(px4: &Px4) -> Result<(), AirsideError> {
    if px4.i_trust_this_link || key_link::is_local(&px4.link) {
        return Ok(());
    }
    let link = px4.link.to_string();
    Err(AirsideError::OpenLink { link })
}

/// The settings of the machine. `ground` and `autopilot` are the peers, where the links name them.
pub(super) fn settings(
    config: &AirsideConfig,
    ground: Option<Peer>,
    autopilot: Option<Peer>,
) -> Settings {
    let (own, radio, px4) = (
        config.agent.get_ref(),
        config.radio.get_ref(),
        config.px4.get_ref(),
    );
    // A serial line or udpout names its peer; a listening link learns it from the frames received.
    let endpoint = |peer: Option<Peer>| peer.map_or(Endpoint::Listen, Endpoint::Fixed);
    Settings {
        vehicle_system: px4.system_id,
        own_system: own.system_id,
        own_component: own.component_id,
        own_link_id: own.link_id,
        talkers: radio.talkers.iter().copied().map(Stream::from).collect(),
        policy: config.relay.policy(),
        radio: endpoint(ground),
        px4: endpoint(autopilot),
        restamp: px4.restamp,
        replace_px4_key: config.zeroize.px4_key,
        contingency: config.contingency.as_ref().map(|one| one.get_ref().clone()),
        not_before: Stamp::from_unix(NOT_BEFORE),
        ids: [own.vsm_id.0, own.vehicle_id.0],
    }
}

async fn answer_order(stream: UnixStream, refused: Option<String>, beyond: Vec<String>) {
    let answer = Ordered { refused, beyond };
    status_socket::answer(stream, &answer, STATUS_WITHIN).await;
}

pub(super) fn write_log(level: LogLevel, text: &str) {
    match level {
        LogLevel::Debug => tracing::debug!("{text}"),
        LogLevel::Info => tracing::info!("{text}"),
        LogLevel::Warning => tracing::warn!("{text}"),
        LogLevel::Error => tracing::error!("{text}"),
    }
}

/// The keys on disk, and the peer that the agent was paired with.
pub(super) fn held(disk: &AirsideDisk) -> Result<Held, AirsideError> {
    let record = ExchangeRecord::load(&disk.ordered.records, disk.vehicle)?;
    let peer = record.peer().map(|key| PinnedPeer {
        key,
        counter: record.counter,
    });
    Ok(Held {
        peer,
        epoch: record.epoch,
        current: disk.ordered.keys.current()?,
        next: disk.ordered.keys.next()?,
        previous: disk.ordered.keys.previous()?,
    })
}

/// The request of a client of the pairing window; never completes without a client.
async fn greeted(greeting: &mut Option<Greeting>) -> Option<(Asker, PairingCode)> {
    match greeting {
        Some(greeting) => match greeting.await {
            Ok(greeted) => greeted,
            // A panic in our own task ends the program.
            Err(cause) => cause
                .try_into_panic()
                .map_or(None, |panic| resume_unwind(panic)),
        },
        None => std::future::pending().await,
    }
}

/// Done when the next ping is due; never where no service manager waits for one.
async fn next_ping(pings: &mut Option<Interval>) {
    match pings {
        Some(pings) => drop(pings.tick().await),
        None => std::future::pending().await,
    }
}

/// Completes when the client of the pairing window disconnects; never completes without a client.
async fn gone(asker: &mut Option<Asker>) {
    match asker {
        Some(asker) => asker.gone().await,
        None => std::future::pending().await,
    }
}

/// Time limit for remaining writes at the end: longer than a slow disk takes, shorter than a service manager waits.
pub(super) const LAST_WRITES: Duration = Duration::from_secs(10);

/// How the status names datagrams, and keys, whose other end is not a permitted user's.
pub(super) const FOREIGN: &str = "PX4's link: not a permitted user's socket";
pub(super) const NOT_SENT: &str = "PX4's key is NOT sent";
const RADIO_WRITER: &str = "writer of the ground's serial port";
pub(super) const LARGEST: usize = 65_536;
/// A socket buffers a whole status: a client that does not read delays the links for at most this long.
const STATUS_WITHIN: Duration = Duration::from_millis(100);
const GREETING_WITHIN: Duration = Duration::from_secs(5);

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use mavlink_link::clock::Ceiling;
    use mavlink_link::dialect::{
        ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType,
    };
    use mavlink_link::frame::{FrameView, Header, SETUP_SIGNING_ID, encode};
    use tokio::net::UdpSocket;

    use super::*;
    use crate::shell::key_file;

    /// PX4 is on UDP at this port.
    fn config(folder: &Path, radio: &str, px4: u16) -> AirsideConfig {
        let text = format!(
            "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"airside.key\"\n\
             [radio]\nlink = \"{radio}\"\n[px4]\nlink = \"udpin:127.0.0.1:{px4}\"\nsystem_id = 1\n\
             [store]\ndir = \"state\"\n"
        );
        AirsideConfig::parse(&text, folder).unwrap()
    }

    /// An agent that had a key in force before it was started, PX4 on UDP, and a program that poses as an unsigned,
    /// disarmed PX4: whether it is given the key within three seconds, and the agent's last status.
    async fn posing(permitted: Option<Vec<u32>>) -> (bool, AirsideStatus) {
        let folder = tempfile::tempdir().unwrap();
        let key = folder.path().join("airside.key");
        std::fs::write(&key, "5a".repeat(32)).unwrap();
        std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).unwrap();
        let (radio, port) = (kit::process::free_udp_port(), kit::process::free_udp_port());
        let config = config(folder.path(), &format!("udpin:127.0.0.1:{radio}"), port);
        // In an earlier run the key was in use, and PX4 has it.
        let mut store = FileDisk::open(&config.store.dir).unwrap();
        let id = key_file::read(&key).unwrap().id();
        let used = Stamp::from_unix(NOT_BEFORE);
        Ceiling::raise(&mut store, &id, used).unwrap();
        drop(store);
        let mut server = AirsideServer::open(&config).unwrap();
        // Before the table is read, so that it is in the first.
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        server.px4_peers = LocalPeers::of_users(permitted);
        let mut given = false;
        let pose = async {
            let end = tokio::time::Instant::now() + Duration::from_secs(3);
            let mut seq = 0;
            while !given && tokio::time::Instant::now() < end {
                let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                    autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
                    mavtype: MavType::MAV_TYPE_QUADROTOR,
                    base_mode: MavModeFlag::empty(),
                    ..HEARTBEAT_DATA::default()
                });
                // Heartbeats alone could be somebody else's that PX4 has forwarded.
                let attitude = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
                for message in [heartbeat, attitude] {
                    let mut out = [0; MAX_FRAME];
                    seq += 1;
                    let header = Header {
                        system_id: 1,
                        component_id: 1,
                        seq,
                        ..Header::default()
                    };
                    let len = encode(&message, header, &mut out);
                    socket
                        .send_to(&out[..len], ("127.0.0.1", port))
                        .await
                        .unwrap();
                }
                let mut bytes = [0; 512];
                let pause = Duration::from_millis(50);
                while let Ok(Ok(len)) = tokio::time::timeout(pause, socket.recv(&mut bytes)).await {
                    let frame = FrameView::parse(&bytes[..len]).unwrap();
                    given |= frame.header().message_id == SETUP_SIGNING_ID;
                }
            }
        };
        let status = server.serve(pose).await.unwrap();
        (given, status)
    }

    #[tokio::test]
    async fn a_program_of_another_user_that_poses_as_px4_gets_no_key() {
        // The test's own user is another one here.
        let own = rustix::process::geteuid().as_raw();
        let (given, status) = posing(Some(vec![own + 1])).await;
        assert!(!given);
        // It has not even made the agent doubt PX4: what it sent was dropped unseen.
        assert_eq!(status.state, "relaying");
        assert!(status.held_back.get(FOREIGN) > 0, "{:?}", status.held_back);
    }

    #[tokio::test]
    async fn a_program_of_a_permitted_user_is_px4() {
        let own = rustix::process::geteuid().as_raw();
        let (given, status) = posing(Some(vec![own])).await;
        assert!(given, "{status:?}");
    }

    #[tokio::test]
    async fn an_unplugged_radio_delays_no_datagram_of_px4() {
        let folder = tempfile::tempdir().unwrap();
        let (radio, port) = (kit::serial::Device::new(), kit::process::free_udp_port());
        let config = config(folder.path(), &format!("serial:{}:57600", radio.name), port);
        let mut server = AirsideServer::open(&config).unwrap();
        let px4 = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        // As another user's it is counted with each datagram that is taken.
        let own = rustix::process::geteuid().as_raw();
        server.px4_peers = LocalPeers::of_users(Some(vec![own + 1]));
        drop(radio);
        let sender = std::thread::spawn(move || {
            for _ in 0..200 {
                px4.send_to(&[0xfd; 20], ("127.0.0.1", port)).unwrap();
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let stop = async {
            while !sender.is_finished() {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        let status = server.serve(stop).await.unwrap();
        sender.join().unwrap();
        let taken = status.held_back.get(FOREIGN);
        assert!(taken >= 180, "{taken} of 200 were read in their time");
    }
}
