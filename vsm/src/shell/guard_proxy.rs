//! `vsm guard run`: the guard beside a CUCS. What the CUCS sends to it on loopback goes to the VSM sealed; what verifies of the
//! VSM goes to the CUCS as it is.
//!
//! On loopback the sender has no key: it is looked up whose socket it is, as for a vehicle that is given a key
//! ([`LocalPeers`]), and programs of other users are not let in.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::store::StoreError;
use rustix::time::{ClockId, clock_gettime};
use stanag_msgs::guard::{Direction, Guarded, MAX_GUARDED};
use stanag_msgs::{Id, MAX_DATAGRAM, ed25, frames};
use tokio::net::UdpSocket;
use tokio::time::{MissedTickBehavior, interval};

use super::clock::{Clock, NOT_BEFORE};
use super::disk::{FileDisk, OpenError};
use super::guard_file;
use super::key_file::KeyFileError;
use super::local_peers::LocalPeers;
use crate::config::LinkAddress;
use crate::session::{Counters, GuardEnd, GuardStatus, Peer};

/// What a guard is between.
#[derive(Debug, Clone)]
pub struct GuardConfig {
    /// CUCS ID.
    pub cucs: Id,
    /// VSM ID.
    pub vsm: Id,
    /// Where the CUCS sends to: an address of loopback.
    pub listen: SocketAddr,
    /// Where the VSM listens for its CUCSs.
    pub to: SocketAddr,
    /// The key that the VSM has for this CUCS.
    pub key_file: PathBuf,
    /// Where the stamps of the key live.
    pub store: PathBuf,
    /// Users beside this process's own and root whose programs may be the CUCS.
    pub users: Vec<u32>,
}

/// A guard that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum GuardError {
    /// Its address is open to others.
    #[error("--listen {0} is not of loopback: whoever reaches it would command in the name of the CUCS, expected such as 127.0.0.1:{port}", port = .0.port())]
    Open(SocketAddr),
    /// The key.
    #[error(transparent)]
    Key(#[from] KeyFileError),
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// What is in it.
    #[error(transparent)]
    Record(#[from] StoreError),
    /// A socket.
    #[error("cannot listen on {at}: {cause}")]
    Bind {
        /// The address.
        at: SocketAddr,
        /// The system's reason.
        cause: io::Error,
    },
}

/// A guard with its sockets open.
#[derive(Debug)]
pub struct GuardProxy {
    config: GuardConfig,
    near: UdpSocket,
    far: UdpSocket,
    peers: LocalPeers,
    end: GuardEnd,
    disk: FileDisk,
    clock: Clock,
    /// Since boot.
    started: Duration,
    /// Where the CUCS sent from last.
    cucs: Option<SocketAddr>,
    dropped: Counters,
    /// What was in the log last.
    logged: (u64, u64),
}

impl GuardProxy {
    /// Opens key, store and sockets.
    ///
    /// # Errors
    /// Any of them cannot be had.
    pub async fn open(config: GuardConfig) -> Result<GuardProxy, GuardError> {
        if !config.listen.ip().is_loopback() {
            return Err(GuardError::Open(config.listen));
        }
        let (clock, started) = (Clock::default(), since_boot());
        let now = clock.now();
        let keys = guard_file::read(&config.key_file, now)?;
        // The key before is the VSM's to accept: a guard that has the new one sends under that.
        let keys = keys.into_iter().take(1).collect();
        let mut disk = FileDisk::open(&config.store)?;
        let ids = (config.cucs, config.vsm);
        let end = GuardEnd::new(ids, Direction::ToVsm, keys, NOT_BEFORE, now, &mut disk)?;
        let any = match config.to.ip() {
            IpAddr::V4(to) if to.is_loopback() => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(to) if to.is_loopback() => Ipv6Addr::LOCALHOST.into(),
            IpAddr::V4(_) => IpAddr::from(Ipv4Addr::UNSPECIFIED),
            IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        Ok(GuardProxy {
            near: bind(config.listen).await?,
            far: bind(SocketAddr::new(any, 0)).await?,
            peers: LocalPeers::new(&LinkAddress::UdpIn(config.listen), false, &config.users),
            end,
            disk,
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

    /// Time runs on while the computer sleeps, as it does for the VSM: after an hour each would be too far ahead for the other.
    fn now(&self) -> Now {
        Now {
            mono: since_boot().saturating_sub(self.started),
            ..self.clock.now()
        }
    }

    /// Serves until `stop` is done.
    pub async fn serve(mut self, stop: impl Future<Output = ()>) {
        let mut second = interval(Duration::from_secs(1));
        second.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let (mut near, mut far) = ([0; ROOM], [0; ROOM]);
        let mut out = [0; MAX_GUARDED];
        tokio::pin!(stop);
        loop {
            tokio::select! {
                () = &mut stop => return self.report(),
                _ = second.tick() => {
                    let now = self.now();
                    self.end.keep(now, &mut self.disk);
                    self.log_changes();
                }
                received = self.near.recv_from(&mut near) => match received {
                    Ok((length, from)) => {
                        let sealed = self.seal(from, near.get(..length).unwrap_or_default(), &mut out);
                        if let Some(length) = sealed {
                            self.send(&self.far, out.get(..length).unwrap_or_default(), self.config.to).await;
                        }
                    }
                    // ICMP of what was sent before; the CUCS is not there for the moment.
                    Err(cause) => tracing::debug!("the CUCS's socket: {cause}"),
                },
                received = self.far.recv_from(&mut far) => match received {
                    Ok((length, _)) => {
                        let bytes = far.get(..length).unwrap_or_default();
                        match self.answer(bytes, &mut out) {
                            Answer::ToCucs(inside, to) => self.send(&self.near, inside, to).await,
                            Answer::Lift(length) => {
                                let lift = out.get(..length).unwrap_or_default();
                                self.send(&self.far, lift, self.config.to).await;
                            }
                            Answer::None => {}
                        }
                    }
                    Err(cause) => tracing::debug!("the VSM's socket: {cause}"),
                },
            }
        }
    }

    /// Seals what the CUCS sends; the length.
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
        // In Edition 2.5 the wrapper does not say who sends: there the VSM looks.
        let other = |source: Id| source != self.config.cucs;
        if !ed25::is_ed25(bytes) && frames(bytes).next_source().is_some_and(other) {
            self.dropped.count("source is not the CUCS of this guard");
            return None;
        }
        self.cucs = Some(from);
        match self.end.seal(now, bytes, out, &mut self.disk) {
            Ok(length) => Some(length),
            Err(cause) => {
                self.dropped.count("no stamp");
                tracing::debug!("a datagram of the CUCS is not sent: {cause}");
                None
            }
        }
    }

    /// What of the VSM's datagram goes where.
    fn answer<'a>(&mut self, bytes: &'a [u8], out: &mut [u8; MAX_GUARDED]) -> Answer<'a> {
        let now = self.now();
        let Some(guarded) = Guarded::parse(bytes) else {
            self.dropped.count("no trailer");
            return Answer::None;
        };
        match self.end.open(now, &guarded, &mut self.disk) {
            Ok([]) => Answer::None,
            Ok(inside) => match self.cucs {
                Some(cucs) => Answer::ToCucs(inside, cucs),
                None => {
                    self.dropped.count("the CUCS has sent nothing yet");
                    Answer::None
                }
            },
            Err(why) if why.wants_lift() => {
                let lift = self.end.lift(now, out, &mut self.disk);
                lift.map_or(Answer::None, Answer::Lift)
            }
            Err(_) => Answer::None,
        }
    }

    async fn send(&self, socket: &UdpSocket, bytes: &[u8], to: SocketAddr) {
        if let Err(cause) = socket.send_to(bytes, to).await {
            tracing::debug!("a datagram to {to} was not sent: {cause}");
        }
    }

    /// Once a second at most: that the VSM verifies, and what was refused since.
    fn log_changes(&mut self) {
        let status = self.end.status(self.now().mono);
        let refused = total(&status.refused) + total(&self.dropped);
        let (verified, before) = self.logged;
        if verified == 0 && status.verified > 0 {
            tracing::info!("the VSM's datagrams verify");
        }
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
    /// What is inside, and where the CUCS is.
    ToCucs(&'a [u8], SocketAddr),
    /// So many bytes that lift the VSM's stamps.
    Lift(usize),
    None,
}

fn since_boot() -> Duration {
    let at = clock_gettime(ClockId::Boottime);
    Duration::try_from(at).unwrap_or_default()
}

fn total(counters: &Counters) -> u64 {
    counters.iter().map(|(_, count)| count).sum()
}

async fn bind(at: SocketAddr) -> Result<UdpSocket, GuardError> {
    let bound = UdpSocket::bind(at).await;
    bound.map_err(|cause| GuardError::Bind { at, cause })
}

/// One byte more shows what is longer than anything that is taken.
const ROOM: usize = MAX_GUARDED + 1;
