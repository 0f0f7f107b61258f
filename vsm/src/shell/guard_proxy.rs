//! `vsm guard run`: the guard beside a CUCS. It seals what the CUCS sends to it on loopback, and sends it to the VSM. It
//! passes on to the CUCS what verifies from the VSM.
//!
//! On loopback the sender has no key. So the guard looks up who owns the sending socket, as for a vehicle that is given a
//! key ([`LocalPeers`]), and refuses programs of other users.
//!
//! No datagram waits for the disk: other threads make what is written durable (`GuardDisk`). A ceiling is raised seconds before
//! it is needed, and a step of the exchange that promises a key leaves once the key is durable.

use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use dli_group::Group;
use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::{Changes, Disk as _, Progress};
use stanag_msgs::guard::{
    ClockDatagram, Direction, ExchangeDatagram, Guarded, MAX_GUARDED, is_offer,
};
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Id, MAX_DATAGRAM, ed25, frames};
use tokio::net::UdpSocket;
use tokio::sync::Notify;
use tokio::time::{MissedTickBehavior, interval};

use super::airside::LAST_WRITES;
use super::clock::{Clock, NOT_BEFORE, since_boot};
use super::disk::{FileDisk, OpenError};
use super::guard_link::{GuardError, GuardSide, bind, open_agreement, socket_to};
use super::key_file::{KeyFileError, system_random};
use super::key_store::{KeyStore, KeyStoreError};
use super::local_peers::LocalPeers;
use super::ordered_files::OrderedKeys;
use super::queued_disk::QueuedDisk;
use crate::config::LinkAddress;
use crate::guard_exchange::{CucsEnd, CucsFiles, CucsNews};
use crate::session::{
    Counters, GroupReceiver, GuardEnd, GuardKeyUntil, GuardRefusal, GuardStatus, Peer,
};

/// The ends between which a guard works.
#[derive(Debug, Clone)]
pub struct GuardConfig {
    /// Towards the VSM.
    pub side: GuardSide,
    /// Where the CUCS sends to: an address of loopback.
    pub listen: SocketAddr,
    /// The group that the VSM sends to, where the CUCS is to receive it.
    pub group: Option<Group>,
    /// Users beside this process's own and root whose programs may be the CUCS.
    pub users: Vec<u32>,
}

/// A guard with its sockets open.
#[derive(Debug)]
pub struct GuardProxy {
    config: GuardConfig,
    near: UdpSocket,
    far: UdpSocket,
    /// The socket that is a member of the group.
    member: Option<UdpSocket>,
    group: GroupReceiver,
    peers: LocalPeers,
    end: GuardEnd,
    agreement: CucsEnd,
    disk: GuardDisk,
    /// The disk has made changes durable, or has failed to.
    stored: Arc<Notify>,
    clock: Clock,
    /// Time since boot.
    started: Duration,
    /// Where the CUCS last sent from.
    cucs: Option<SocketAddr>,
    dropped: Counters,
    /// The counts last logged.
    logged: (u64, u64),
}

/// The files of a guard. Threads of their own synchronise them.
#[derive(Debug)]
struct GuardDisk {
    /// The ceilings of the clocks.
    store: QueuedDisk,
    /// The keys, and the record of the exchange.
    ordered: OrderedKeys,
}

impl GuardDisk {
    /// What the exchange reads and writes.
    fn for_exchange(&mut self) -> CucsFiles<'_> {
        let OrderedKeys { keys, records, .. } = &mut self.ordered;
        CucsFiles {
            store: &mut self.store,
            records: Some(records),
            keys,
        }
    }

    /// Whether all that was written is durable. The ceiling of a key's clock, too: the VSM may use the key as soon as it has it,
    /// and what is sealed under it then must not wait.
    fn is_stored(&self) -> bool {
        let clocks = Changes {
            after: 0,
            until: self.store.queued(),
        };
        self.ordered.files.is_durable() && self.store.progress(clocks) == Progress::Durable
    }

    /// Waits for the last writes, at the end.
    fn finish(&mut self) {
        let end = Instant::now() + LAST_WRITES;
        self.store.wait(LAST_WRITES);
        self.ordered.files.wait(end);
    }
}

impl GuardProxy {
    /// Opens key, store and sockets.
    ///
    /// # Errors
    /// Any of them cannot be opened.
    pub async fn open(config: GuardConfig) -> Result<GuardProxy, GuardError> {
        GuardProxy::open_on(config, FileDisk::open).await
    }

    /// As [`GuardProxy::open`], with the store opened by `open`.
    ///
    /// # Errors
    /// As [`GuardProxy::open`].
    pub async fn open_on(
        config: GuardConfig,
        open: impl FnOnce(&Path) -> Result<FileDisk, OpenError>,
    ) -> Result<GuardProxy, GuardError> {
        if !config.listen.ip().is_loopback() {
            return Err(GuardError::Open(config.listen));
        }
        let (clock, started) = (Clock::default(), since_boot());
        let now = clock.now();
        let side = &config.side;
        let mut store = open(&side.store)?;
        let (agreement, keys) = open_agreement(side, None, now, &mut store)?;
        let held = held(&keys)?;
        if held.is_empty() {
            let path = side.key_file.clone();
            return Err(KeyFileError::Absent { path }.into());
        }
        let ids = (side.cucs, side.vsm);
        // The first ceilings are durable when this returns: the first datagram of the CUCS is sent at once.
        let end = GuardEnd::new(ids, Direction::ToVsm, held, NOT_BEFORE, now, &mut store)?;
        // From here on no datagram waits for the disk.
        let stored = Arc::new(Notify::new());
        let disk = GuardDisk {
            ordered: OrderedKeys::start(keys, &store, stored.clone()),
            store: QueuedDisk::new(store, stored.clone()).map_err(GuardError::Writer)?,
        };
        let member = match &config.group {
            None => None,
            Some(group) => Some(join(group)?),
        };
        Ok(GuardProxy {
            member,
            group: GroupReceiver::new(config.side.vsm),
            near: bind(config.listen).await?,
            far: socket_to(config.side.to).await?,
            peers: LocalPeers::new(&LinkAddress::UdpIn(config.listen), false, &config.users),
            end,
            agreement,
            disk,
            stored,
            clock,
            started,
            cucs: None,
            dropped: Counters::default(),
            logged: (0, 0),
            config,
        })
    }

    /// Where the CUCS reaches it.
    ///
    /// # Errors
    /// The system's.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.near.local_addr()
    }

    /// Includes the time that the computer sleeps, as the VSM's clock does: no stamp has to be lifted after a sleep.
    fn now(&self) -> Now {
        Now {
            mono: since_boot().saturating_sub(self.started),
            ..self.clock.now()
        }
    }

    /// Serves until `stop` is done.
    pub async fn serve(mut self, stop: impl Future<Output = ()>) {
        let mut second = interval(Duration::from_secs(1));
        // A late second is not made up for: counting and log need no exact rhythm.
        second.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let (mut near, mut far, mut all) = ([0; ROOM], [0; ROOM], [0; ROOM]);
        let mut out = [0; MAX_GUARDED];
        let stored = self.stored.clone();
        tokio::pin!(stop);
        loop {
            self.agree(&mut out).await;
            let due = self.agreement.poll_timeout();
            let due = due.map_or(IDLE, |at| at.saturating_sub(self.now().mono));
            tokio::select! {
                () = &mut stop => break,
                () = stored.notified() => drop(self.disk.store.poll()),
                () = tokio::time::sleep(due.max(SHORTEST)) => {}
                _ = second.tick() => {
                    let now = self.now();
                    self.end.keep(now, &mut self.disk.store);
                    self.log_changes();
                }
                received = self.near.recv_from(&mut near) => match received {
                    Ok((length, from)) => {
                        let sealed = self.seal(from, near.get(..length).unwrap_or_default(), &mut out);
                        if let Some(length) = sealed {
                            self.send(&self.far, out.get(..length).unwrap_or_default(), self.config.side.to).await;
                        }
                    }
                    // An ICMP error for an earlier datagram: the CUCS is not there at the moment.
                    Err(cause) => tracing::debug!("the CUCS's socket: {cause}"),
                },
                received = self.far.recv_from(&mut far) => match received {
                    Ok((length, _)) => {
                        let bytes = far.get(..length).unwrap_or_default();
                        match self.answer(bytes, &mut out) {
                            Answer::ToCucs(inside, to) => self.send(&self.near, inside, to).await,
                            Answer::ToVsm(length) => {
                                let reply = out.get(..length).unwrap_or_default();
                                self.send(&self.far, reply, self.config.side.to).await;
                            }
                            Answer::None => {}
                        }
                    }
                    Err(cause) => tracing::debug!("the VSM's socket: {cause}"),
                },
                received = receive(self.member.as_ref(), &mut all) => match received {
                    Ok((length, from)) => {
                        let bytes = all.get(..length).unwrap_or_default();
                        if let Some((inside, to)) = self.take_group(from, bytes) {
                            self.send(&self.near, inside, to).await;
                        }
                    }
                    Err(cause) => tracing::debug!("the group's socket: {cause}"),
                },
            }
        }
        self.disk.finish();
        self.report();
    }

    /// Sends exchange messages that are due, and handles received ones.
    async fn agree(&mut self, out: &mut [u8; MAX_GUARDED]) {
        let now = self.now();
        let mut files = self.disk.for_exchange();
        self.agreement
            .handle_timeout(now, &mut system_random, &mut files);
        while let Some(news) = self.agreement.poll_news() {
            match &news {
                CucsNews::InForce(key, _) => tracing::info!("key {key} is in force"),
                CucsNews::Waiting => tracing::info!("agreeing on a new key"),
                CucsNews::Dropped(status) => {
                    tracing::warn!(
                        "the VSM does not have the new key ({status}): the previous key stays in force"
                    );
                }
                CucsNews::Failed(why) => tracing::error!("the key exchange: {why}"),
                CucsNews::NotAnswered => {
                    tracing::info!("the VSM does not answer the key exchange")
                }
                // Anyone can send these.
                CucsNews::Rejected(status) => tracing::debug!("unproven answer: {status}"),
            }
            if matches!(
                news,
                CucsNews::InForce(..) | CucsNews::Waiting | CucsNews::Dropped(_)
            ) {
                self.take_keys(now);
            }
        }
        // Persist, then send: the writes may be on their way to a slow disk, that of a new key's ceiling among them.
        while self.disk.is_stored()
            && let Some(step) = self.agreement.poll_transmit()
        {
            self.send(&self.far, &step, self.config.side.to).await;
        }
        // A probe under the next key shows whether the VSM has it.
        if self.agreement.takes_probe(now.mono)
            && let Ok(Some(next)) = self.disk.ordered.keys.next()
            && let Ok(length) = self.end.probe(next.id(), now, out, &mut self.disk.store)
        {
            let probe = out.get(..length).unwrap_or_default();
            self.send(&self.far, probe, self.config.side.to).await;
        }
    }

    /// Uses the present key files. The previous key is accepted for a while, since datagrams under it may still be in
    /// transit.
    fn take_keys(&mut self, now: Now) {
        let keys = &self.disk.ordered.keys;
        let kept = held(keys).map_err(|fault| fault.to_string());
        let kept = kept.and_then(|mut kept| {
            let before = keys.previous().map_err(|fault| fault.to_string())?;
            let new = |one: &SigningKey| kept.iter().all(|(key, _)| !key.same_as(one));
            let was = |one: &SigningKey| self.end.has(one.id());
            if let Some(before) = before.filter(new).filter(was) {
                kept.push((before, Some(now.mono + STILL_BELIEVED)));
            }
            let store = &mut self.disk.store;
            let set = self.end.set_keys(kept, NOT_BEFORE, now, store);
            set.map_err(|fault| fault.to_string())
        });
        if let Err(why) = kept {
            tracing::error!("the key cannot be changed, the previous one stays in force: {why}");
        }
    }

    /// Seals a datagram of the CUCS; returns the length.
    fn seal(
        &mut self,
        from: SocketAddr,
        bytes: &[u8],
        out: &mut [u8; MAX_GUARDED],
    ) -> Option<usize> {
        let now = self.now();
        if !self.peers.admits(now.mono, Peer::Udp(from)) {
            self.dropped.count("program of another user");
            return None;
        }
        if bytes.is_empty() || bytes.len() > MAX_DATAGRAM {
            self.dropped.count("of another length than 1 to 548 bytes");
            return None;
        }
        // In Edition 2.5 the wrapper does not name the sender, so the VSM checks it.
        let other = |source: Id| source != self.config.side.cucs;
        if !ed25::is_ed25(bytes) && frames(bytes).next_source().is_some_and(other) {
            self.dropped.count("source is not the CUCS of this guard");
            return None;
        }
        // Remembered only after the checks: the answers go there.
        self.cucs = Some(from);
        match self.end.seal(now, bytes, out, &mut self.disk.store) {
            Ok(length) => Some(length),
            Err(cause) => {
                self.dropped.count("no stamp");
                tracing::debug!("a datagram of the CUCS is not sent: {cause}");
                None
            }
        }
    }

    /// Decides what to do with a datagram of the VSM.
    fn answer<'a>(&mut self, bytes: &'a [u8], out: &mut [u8; MAX_GUARDED]) -> Answer<'a> {
        let now = self.now();
        // A sealed datagram may also begin as an exchange step does.
        let Some(guarded) = Guarded::parse(bytes) else {
            if let Some(about) = ClockDatagram::parse(bytes) {
                let store = &mut self.disk.store;
                let answer = self.end.take_clock(now, &about, out, store);
                if let Some(moved) = self.end.take_met() {
                    tracing::warn!("{moved}");
                }
                return answer.ok().flatten().map_or(Answer::None, Answer::ToVsm);
            }
            match ExchangeDatagram::parse(bytes) {
                Some(step) => self.take_step(now, false, &step),
                None => self.dropped.count("no trailer"),
            }
            return Answer::None;
        };
        let from = (self.config.side.to, None);
        // Unsealed datagrams are handled above: they are steps of the exchange or about clocks, and prove nothing by
        // themselves.
        let store = &mut self.disk.store;
        let opened = self.end.open_from(now, &guarded, from, store);
        if let Ok((_, key)) = opened {
            let mut files = self.disk.for_exchange();
            self.agreement.key_in_use(now, key, &mut files);
        }
        match opened.map(|(inside, _)| inside) {
            Ok([]) => Answer::None,
            // A message of the VSM for the guard itself.
            Ok(inside) if is_offer(inside) => {
                let offer = opened
                    .ok()
                    .and_then(|(_, key)| self.end.unwrap_offer(key, inside));
                match offer.map(|offer| self.group.take(offer)) {
                    Some(true) => tracing::info!("the VSM has given the key of its group"),
                    Some(false) => {}
                    None => self.dropped.count("group key that cannot be read"),
                }
                Answer::None
            }
            Ok(inside) if ExchangeDatagram::parse(inside).is_some() => {
                if let Some(step) = ExchangeDatagram::parse(inside) {
                    self.take_step(now, true, &step);
                }
                Answer::None
            }
            Ok(inside) => match self.cucs {
                Some(cucs) => Answer::ToCucs(inside, cucs),
                None => {
                    self.dropped.count("the CUCS has sent nothing yet");
                    Answer::None
                }
            },
            Err(why) if why.wants_reply() => {
                let reply = self.end.reply(now, out, &mut self.disk.store);
                reply.map_or(Answer::None, Answer::ToVsm)
            }
            Err(_) => Answer::None,
        }
    }

    fn take_step(&mut self, now: Now, verified: bool, step: &ExchangeDatagram<'_>) {
        let mut files = self.disk.for_exchange();
        // The reason for ignoring a step matters only to its sender.
        let _ = self.agreement.handle(now, verified, step, &mut files);
    }

    /// The part of a group datagram that goes to the CUCS, and where that is.
    fn take_group<'a>(
        &mut self,
        from: SocketAddr,
        bytes: &'a [u8],
    ) -> Option<(&'a [u8], SocketAddr)> {
        let now = self.now();
        let group = self.config.group.as_ref()?;
        if !group.takes_from(from.ip()) {
            self.dropped.count("group: not one of its sources");
            return None;
        }
        let Some(guarded) = Guarded::parse(bytes) else {
            // Datagrams for CUCSs without a guard use the same group.
            self.dropped.count("group: no trailer");
            return None;
        };
        let inside = match self.group.open(now.mono, &guarded) {
            Ok(inside) => inside,
            Err(why) => {
                self.dropped.count(match why {
                    GuardRefusal::Key => "group: unknown key",
                    GuardRefusal::Replayed => "group: replayed",
                    GuardRefusal::Old | GuardRefusal::Late => "group: too old",
                    GuardRefusal::Forged => "group: wrong trailer",
                    _ => "group: not of this VSM",
                });
                return None;
            }
        };
        // Each CUCS of the group gets its own copy.
        let other = |frame: Frame<'_>| {
            let to = frame.header.destination;
            to != self.config.side.cucs && to != Id::BROADCAST
        };
        let first = frames(inside).next().and_then(Result::ok);
        if !ed25::is_ed25(inside) && first.is_some_and(other) {
            return None;
        }
        Some((inside, self.cucs?))
    }

    async fn send(&self, socket: &UdpSocket, bytes: &[u8], to: SocketAddr) {
        if let Err(cause) = socket.send_to(bytes, to).await {
            tracing::debug!("a datagram to {to} was not sent: {cause}");
        }
    }

    /// At most once a second: that the VSM verifies, and what was refused since.
    fn log_changes(&mut self) {
        let status = self.end.status(self.now().mono);
        let refused = total(&status.refused) + total(&self.dropped);
        let (verified, before) = self.logged;
        if verified == 0 && status.verified > 0 {
            tracing::info!("the VSM's datagrams verify");
        }
        // Each line doubles the count of the one before, so a flood cannot fill the log.
        if refused >= before.saturating_mul(2).max(before + 1) {
            tracing::warn!("refused so far: {}", self.counted(&status));
            self.logged.1 = refused;
        }
        self.logged.0 = status.verified;
    }

    fn report(&self) {
        let status = self.end.status(self.now().mono);
        let refused = self.counted(&status);
        let refused = if refused.is_empty() {
            "nothing"
        } else {
            &refused
        };
        let verified = status.verified;
        tracing::info!("stopped; {verified} datagrams of the VSM verified, refused: {refused}");
    }

    fn counted(&self, status: &GuardStatus) -> String {
        let all = status.refused.iter().chain(self.dropped.iter());
        let all: Vec<String> = all.map(|(name, count)| format!("{name} {count}")).collect();
        all.join(", ")
    }
}

enum Answer<'a> {
    /// The content, and where the CUCS is.
    ToCucs(&'a [u8], SocketAddr),
    /// This many bytes for the VSM's end: a datagram that raises its stamps, a challenge, or the answer to one.
    ToVsm(usize),
    None,
}

/// Receives from the group, if there is one.
async fn receive(socket: Option<&UdpSocket>, bytes: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
    match socket {
        Some(socket) => socket.recv_from(bytes).await,
        None => std::future::pending().await,
    }
}

fn join(group: &Group) -> Result<UdpSocket, GuardError> {
    let at = group.address;
    let socket = group.receiver()?;
    let joined = socket
        .set_nonblocking(true)
        .and_then(|()| UdpSocket::from_std(socket));
    joined.map_err(|cause| GuardError::Bind { at, cause })
}

/// The keys that a guard seals and verifies under: the current one, and one that the VSM may have; only the latter if there is no
/// current one.
fn held(keys: &KeyStore) -> Result<Vec<GuardKeyUntil>, KeyStoreError> {
    let held = [keys.current()?, keys.next()?].into_iter().flatten();
    Ok(held.map(|key| (key, None)).collect())
}

fn total(counters: &Counters) -> u64 {
    counters.iter().map(|(_, count)| count).sum()
}

/// One byte more, to detect a datagram that is too long.
const ROOM: usize = MAX_GUARDED + 1;
const IDLE: Duration = Duration::from_secs(60);
const SHORTEST: Duration = Duration::from_millis(1);
/// How long datagrams of the VSM under the previous key are accepted after a change.
const STILL_BELIEVED: Duration = Duration::from_secs(60);
