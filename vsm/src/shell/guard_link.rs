//! The guard's path to its VSM: the socket, the key files that both may change, and `vsm guard pair`, by which a guard and
//! a VSM get to know each other.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use dli_group::GroupError;
use mavlink_link::Now;
use mavlink_link::exchange::{PairingCode, PublicKey, Status};
use mavlink_link::signing::KeyId;
use mavlink_link::store::StoreError;
use stanag_msgs::Id;
use stanag_msgs::guard::{ExchangeDatagram, MAX_GUARDED};
use tokio::net::UdpSocket;
use tokio::time::{Instant, sleep_until};

use super::clock::Clock;
use super::disk::{FileDisk, OpenError};
use super::key_file::{KeyFileError, system_random};
use super::key_store::{KeyStore, KeyStoreError};
use crate::guard_exchange::{CucsEnd, CucsFiles, CucsNews};
use crate::key_exchange::identity;

/// A guard that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum GuardError {
    /// Its address is open to others.
    #[error("--listen {0} is not of loopback: whoever reaches it would command in the name of the CUCS, expected such as 127.0.0.1:{port}", port = .0.port())]
    Open(SocketAddr),
    /// The key.
    #[error(transparent)]
    Key(#[from] KeyFileError),
    /// The key files.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// What is in it.
    #[error(transparent)]
    Record(#[from] StoreError),
    /// The multicast group.
    #[error(transparent)]
    Group(#[from] GroupError),
    /// The threads that write to the store.
    #[error("--store: {0}")]
    Writer(io::Error),
    /// A socket.
    #[error("cannot listen on {at}: {cause}")]
    Bind {
        /// The address.
        at: SocketAddr,
        /// The system's reason.
        cause: io::Error,
    },
}

/// What a guard needs to reach its VSM.
#[derive(Debug, Clone)]
pub struct GuardSide {
    /// CUCS ID.
    pub cucs: Id,
    /// VSM ID.
    pub vsm: Id,
    /// Where the VSM listens for its CUCSs.
    pub to: SocketAddr,
    /// The key that the VSM has for this CUCS.
    pub key_file: PathBuf,
    /// Where the stamps of the key live, and who the VSM is.
    pub store: PathBuf,
}

/// Opens the machine that agrees on keys, and the key files, which it locks; there need not be a key yet.
pub(super) fn open_agreement(
    side: &GuardSide,
    code: Option<PairingCode>,
    now: Now,
    disk: &mut FileDisk,
) -> Result<(CucsEnd, KeyStore), GuardError> {
    let keys = KeyStore::open(&side.key_file)?;
    keys.bury(disk)?;
    let own = identity(disk, &mut system_random)?;
    let ids = (side.cucs, side.vsm);
    let end = CucsEnd::new(ids, own, code, now, &mut plain(disk, &keys))?;
    Ok((end, keys))
}

/// Files that are written while the caller waits.
fn plain<'a>(disk: &'a mut FileDisk, keys: &'a KeyStore) -> CucsFiles<'a> {
    CucsFiles {
        store: disk,
        records: None,
        keys,
    }
}

/// A socket from which the VSM is reached.
pub(super) async fn socket_to(to: SocketAddr) -> Result<UdpSocket, GuardError> {
    let any = match to.ip() {
        // To a VSM on this computer the socket is bound to loopback: no other host can answer in its name.
        IpAddr::V4(to) if to.is_loopback() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(to) if to.is_loopback() => Ipv6Addr::LOCALHOST.into(),
        IpAddr::V4(_) => IpAddr::from(Ipv4Addr::UNSPECIFIED),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    bind(SocketAddr::new(any, 0)).await
}

pub(super) async fn bind(at: SocketAddr) -> Result<UdpSocket, GuardError> {
    let bound = UdpSocket::bind(at).await;
    bound.map_err(|cause| GuardError::Bind { at, cause })
}

/// A pairing in progress.
#[derive(Debug)]
pub struct GuardPairing {
    side: GuardSide,
    end: CucsEnd,
    keys: KeyStore,
    disk: FileDisk,
    clock: Clock,
    socket: UdpSocket,
    own: PublicKey,
}

/// How the pairing ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GuardEnding {
    /// Both know each other, and share a key.
    Paired {
        /// The VSM's static key.
        peer: Option<PublicKey>,
        /// The key's name.
        key: KeyId,
    },
    /// Nobody answered with the code; holds the last unproven status.
    NotAnswered(Option<Status>),
}

impl GuardPairing {
    /// Opens files and socket.
    ///
    /// # Errors
    /// Any of them cannot be opened; nothing has been sent in that case.
    pub async fn open(side: GuardSide, code: PairingCode) -> Result<GuardPairing, GuardError> {
        let clock = Clock::default();
        let mut disk = FileDisk::open(&side.store)?;
        let own = identity(&mut disk, &mut system_random)?.public();
        let (end, keys) = open_agreement(&side, Some(code), clock.now(), &mut disk)?;
        Ok(GuardPairing {
            socket: socket_to(side.to).await?,
            side,
            end,
            keys,
            disk,
            clock,
            own,
        })
    }

    /// The key that the people at both ends compare.
    #[must_use]
    pub fn own_key(&self) -> PublicKey {
        self.own
    }

    /// Tries until it succeeds, at most `patience`. `report` receives the events meanwhile.
    pub async fn run(
        mut self,
        patience: Duration,
        report: &mut dyn FnMut(&CucsNews),
    ) -> GuardEnding {
        let mut bytes = [0; MAX_GUARDED + 1];
        let mut unproven = None;
        loop {
            let now = self.clock.now();
            let mut files = plain(&mut self.disk, &self.keys);
            self.end.handle_timeout(now, &mut system_random, &mut files);
            while let Some(step) = self.end.poll_transmit() {
                // A datagram that cannot be sent is lost, as on any network.
                let _ = self.socket.send_to(&step, self.side.to).await;
            }
            let due = self.end.poll_timeout().unwrap_or(Duration::MAX);
            let until = due.min(patience).max(self.clock.mono());
            tokio::select! {
                received = self.socket.recv_from(&mut bytes) => match received {
                    Ok((length, _)) => {
                        let step = bytes.get(..length).and_then(ExchangeDatagram::parse);
                        if let Some(step) = step {
                            let now = self.clock.now();
                            let mut files = plain(&mut self.disk, &self.keys);
                            // The reason for ignoring a step matters only to its sender.
                            let _ = self.end.handle(now, false, &step, &mut files);
                        }
                    }
                    // An ICMP error for an earlier datagram: nobody listens there yet.
                    Err(_) => tokio::time::sleep(PAUSE).await,
                },
                () = sleep_until(Instant::from_std(self.clock.instant(until))) => {}
            }
            while let Some(news) = self.end.poll_news() {
                report(&news);
                match news {
                    CucsNews::InForce(key, peer) => return GuardEnding::Paired { peer, key },
                    CucsNews::Rejected(status) => unproven = Some(status),
                    _ => {}
                }
            }
            if self.clock.mono() >= patience {
                return GuardEnding::NotAnswered(unproven);
            }
        }
    }
}

const PAUSE: Duration = Duration::from_millis(200);
