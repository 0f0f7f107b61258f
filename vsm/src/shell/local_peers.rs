//! The program at the other end of a UDP link on this computer: only one of a permitted user may be the vehicle.
//!
//! PX4 takes its first key unsigned, and after a power cut it may be unsigned again. So any sender of unsigned heartbeats
//! in its name would be given the key. On a serial line that is whoever holds the cable. On loopback it would be any
//! program of this computer, of any user, unless the bridge asks the kernel whose socket it is (`socket_owners`).
//!
//! - Datagrams from a socket of another user are dropped before any machine sees them. Such a program can neither pose as
//!   the vehicle nor keep a key from it by posing as a second one.
//! - Just before a key is sent, the receiver is looked up once more, in a table read after the key was due. Between that
//!   look and the sending (milliseconds; where users hold many thousands of sockets, as long as the kernel takes for its
//!   table) the vehicle's program would have to end and another to take its port.
//! - Neither sockets that somebody holds nor datagrams that somebody sends delay anyone: a datagram costs one look-up of
//!   constant length in what another thread has read. Datagrams from a port opened since are dropped too, for a second at
//!   most (or three times as long as a reading takes, if that is longer).
//!
//! Permitted are this process's own user, root, who could read the key anyway, and the users of the configuration. A person
//! who vouches for the link (`i_trust_this_link`) switches the check off.

use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Notify;

pub use super::socket_owners::Stranger;
use super::socket_owners::{NOT_YET, PATIENCE, Socket, SocketOwners, sockets};
use crate::config::LinkAddress;
use crate::session::Peer;

/// The check for one link.
#[derive(Debug)]
pub struct LocalPeers {
    /// `None`: anyone on the link may have the key.
    owners: Option<SocketOwners>,
    /// Notified when a look is done.
    looked: Arc<Notify>,
    /// The look before the key that is due, and when it was requested.
    look: Option<u64>,
    look_at: Option<Duration>,
    /// Addresses whose owner was recently not found, with the number of readings at that time.
    unknown: HashMap<SocketAddr, u64>,
    /// How long a datagram of an unknown port waits for another reading, and when one last did.
    waits: Duration,
    waited_at: Option<Duration>,
    /// When a refused datagram was last logged.
    reported_at: Option<Duration>,
    dropped: u64,
}

impl LocalPeers {
    /// For this link. Nobody is looked up on a serial line, or where a person vouches for the link (`trusted`).
    #[must_use]
    pub fn new(link: &LinkAddress, trusted: bool, users: &[u32]) -> LocalPeers {
        let checked = !trusted && !matches!(link, LinkAddress::Serial { .. });
        LocalPeers::of_users(checked.then(|| permitted(users)))
    }

    /// With exactly these users permitted.
    #[must_use]
    pub fn of_users(permitted: Option<Vec<u32>>) -> LocalPeers {
        LocalPeers {
            waits: NEW_PORT_WITHIN,
            ..LocalPeers::reading(permitted, sockets)
        }
    }

    /// With `read` in place of the kernel's table.
    fn reading(
        permitted: Option<Vec<u32>>,
        read: impl FnMut() -> io::Result<Vec<Socket>> + Send + 'static,
    ) -> LocalPeers {
        let looked = Arc::new(Notify::new());
        LocalPeers {
            owners: permitted.map(|users| SocketOwners::start(users, looked.clone(), read)),
            looked,
            look: None,
            look_at: None,
            unknown: HashMap::new(),
            waits: Duration::ZERO,
            waited_at: None,
            reported_at: None,
            dropped: 0,
        }
    }

    /// Whether datagrams from there are admitted, by the last reading. An unknown port may just have been opened: at most
    /// four times a second this waits for another reading, 10 ms at most, and not at all where readings take long.
    pub fn admits(&mut self, mono: Duration, from: Peer) -> bool {
        let (Some(owners), Peer::Udp(from)) = (&self.owners, from) else {
            return true;
        };
        let Err(mut stranger) = owners.judge(from) else {
            return true;
        };
        // The wait blocks the thread that flies, so neither a flood of ports nor a slow kernel may cause many.
        let rests = |at: Duration| mono.saturating_sub(at) < WAIT_AGAIN;
        let may_wait = !self.waits.is_zero() && !self.waited_at.is_some_and(rests);
        let is_unknown = !matches!(stranger, Stranger::OtherUser { .. });
        if is_unknown && may_wait && owners.is_quick() {
            self.waited_at = Some(mono);
            owners.wait(owners.ask(), self.waits);
            match owners.judge(from) {
                Ok(()) => return true,
                Err(now) => stranger = now,
            }
        }
        let readings = owners.readings();
        self.dropped = self.dropped.saturating_add(1);
        let is_other = matches!(stranger, Stranger::OtherUser { .. });
        // Not worth a warning: a program that has just started is in the next reading.
        if !is_other && self.may_be_new(from, readings) {
            tracing::debug!("a datagram of this computer is dropped: {stranger}");
            return false;
        }
        let quiet = self
            .reported_at
            .is_some_and(|at| mono.saturating_sub(at) < REPORT_AGAIN);
        if !quiet {
            self.reported_at = Some(mono);
            tracing::warn!(
                "a datagram of this computer is dropped ({} in all): {stranger}",
                self.dropped
            );
        }
        false
    }

    /// Whether the port may have been opened after the last reading began: two more readings decide that.
    fn may_be_new(&mut self, from: SocketAddr, readings: u64) -> bool {
        // Only the log level depends on these entries.
        if self.unknown.len() >= MAX_UNKNOWN && !self.unknown.contains_key(&from) {
            self.unknown.clear();
        }
        let first = *self.unknown.entry(from).or_insert(readings);
        readings < first.saturating_add(2)
    }

    /// Whether the peer may be sent a key, by a table that is read now. Blocks until then: not for a thread with other
    /// work.
    ///
    /// # Errors
    /// It may not.
    pub fn may_have_key(&self, to: Peer) -> Result<(), Stranger> {
        let (Some(owners), Peer::Udp(at)) = (&self.owners, to) else {
            return Ok(());
        };
        if !owners.wait(owners.ask(), PATIENCE) {
            let cause = "the kernel takes too long".to_owned();
            return Err(Stranger::Unknown { at, cause });
        }
        owners.judge(at)
    }

    /// For a key that is due: whether a look at its receiver, which begins now, is done. Never blocks;
    /// [`LocalPeers::looked`] is notified when it is worth asking again.
    pub fn has_looked(&mut self, mono: Duration) -> bool {
        let Some(owners) = &self.owners else {
            return true;
        };
        if let Some(number) = self.look {
            return owners.has_answered(number);
        }
        let rests = self
            .look_at
            .is_some_and(|at| mono.saturating_sub(at) < LOOK_AGAIN);
        if !rests {
            self.look = Some(owners.ask());
            self.look_at = Some(mono);
        }
        false
    }

    /// The result of the look. It holds for this one key; the next key needs another look.
    ///
    /// # Errors
    /// The peer may not have the key, or was not looked up.
    pub fn take_look(&mut self, to: Peer) -> Result<(), Stranger> {
        let (Some(owners), Peer::Udp(at)) = (&self.owners, to) else {
            return Ok(());
        };
        match self.look.take() {
            Some(number) if owners.has_answered(number) => owners.judge(at),
            _ => Err(Stranger::Unknown {
                at,
                cause: NOT_YET.to_owned(),
            }),
        }
    }

    /// Discards a finished look by which no key was sent: later it would be out of date.
    pub fn forget_look(&mut self) {
        if let Some(owners) = &self.owners {
            self.look = self.look.filter(|number| !owners.has_answered(*number));
        }
    }

    /// Notified when a look is done.
    #[must_use]
    pub fn looked(&self) -> Arc<Notify> {
        self.looked.clone()
    }

    /// Datagrams dropped so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

/// This process's own user, root and these.
fn permitted(users: &[u32]) -> Vec<u32> {
    let own = rustix::process::geteuid().as_raw();
    // In a user name space this id stands for everyone who has no number there.
    let own = Some(own).filter(|own| *own != OVERFLOW_USER);
    let mut all: Vec<u32> = own.into_iter().chain([0]).chain(users.to_vec()).collect();
    all.dedup();
    all
}

/// How long the thread that flies may wait for a reading: a few hundred sockets take a millisecond or two.
const NEW_PORT_WITHIN: Duration = Duration::from_millis(10);
const WAIT_AGAIN: Duration = Duration::from_millis(250);
/// Only the log level depends on these entries.
const MAX_UNKNOWN: usize = 64;
/// A key that is due and cannot be sent, because the disk is full, causes no more looks than this.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
const REPORT_AGAIN: Duration = Duration::from_secs(10);
const OVERFLOW_USER: u32 = 65_534;

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::sync::mpsc::channel;
    use std::time::Instant;

    use super::*;

    /// Waits for the reading that shows it, at most so long as one should take by far.
    fn soon(mut is_so: impl FnMut() -> bool) -> bool {
        let end = Instant::now() + Duration::from_secs(20);
        while Instant::now() < end {
            if is_so() {
                return true;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        false
    }

    #[test]
    fn a_socket_of_ours_is_found_by_the_kernel() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = socket.local_addr().unwrap();
        let peer = Peer::Udp(address);
        let own = rustix::process::geteuid().as_raw();
        let mut ours = LocalPeers::of_users(Some(vec![own]));
        assert_eq!(ours.may_have_key(peer), Ok(()));
        assert!(ours.admits(Duration::ZERO, peer));
        // Another user's, seen from there.
        let other = own + 1;
        let mut theirs = LocalPeers::of_users(Some(vec![other]));
        let refused = theirs.may_have_key(peer).unwrap_err();
        assert_eq!(
            refused.to_string(),
            format!("{address} belongs to user {own}, expected user {other}")
        );
        assert!(!theirs.admits(Duration::ZERO, peer));
        assert_eq!(theirs.dropped(), 1);
        // Where a person vouches for the link nobody is looked up.
        let mut trusted = LocalPeers::of_users(None);
        assert!(trusted.admits(Duration::ZERO, peer) && trusted.may_have_key(peer).is_ok());
        assert!(trusted.has_looked(Duration::ZERO) && trusted.take_look(peer).is_ok());
        drop(socket);
        assert_eq!(
            ours.may_have_key(peer),
            Err(Stranger::Nobody { at: address })
        );
        assert!(!ours.admits(Duration::ZERO, peer), "it is gone");
    }

    #[test]
    fn one_that_opens_a_port_later_is_admitted() {
        let own = rustix::process::geteuid().as_raw();
        let mut peers = LocalPeers::of_users(Some(vec![own]));
        let first = UdpSocket::bind("127.0.0.1:0").unwrap();
        let from = Peer::Udp(first.local_addr().unwrap());
        assert!(soon(|| peers.admits(Duration::ZERO, from)));
        // Not only after the next reading of the second.
        let begun = Instant::now();
        let mut at_once = 0;
        for n in 1..=20 {
            let another = UdpSocket::bind("127.0.0.1:0").unwrap();
            let from = Peer::Udp(another.local_addr().unwrap());
            at_once += u32::from(peers.admits(WAIT_AGAIN * n, from));
        }
        assert!(at_once > 10, "{at_once}");
        assert!(begun.elapsed() < Duration::from_secs(5));
    }

    #[test]
    fn an_address_that_is_anothers_by_now_is_judged_again() {
        let own = Arc::new(AtomicU32::new(1_000));
        let uid = own.clone();
        let px4: SocketAddr = "127.0.0.1:14580".parse().unwrap();
        let mut peers = LocalPeers::reading(Some(vec![1_000]), move || {
            Ok(vec![(px4, uid.load(Ordering::Relaxed))])
        });
        assert!(soon(|| peers.admits(Duration::ZERO, Peer::Udp(px4))));
        own.store(1_001, Ordering::Relaxed);
        assert!(soon(|| !peers.admits(Duration::ZERO, Peer::Udp(px4))));
        own.store(1_000, Ordering::Relaxed);
        assert!(soon(|| peers.admits(Duration::ZERO, Peer::Udp(px4))));
    }

    #[test]
    fn a_flood_of_foreign_datagrams_reads_nothing_and_keeps_little() {
        let (read, begin) = (Arc::new(AtomicU32::new(0)), Instant::now());
        let counted = read.clone();
        let mut peers = LocalPeers::reading(Some(vec![1_000]), move || {
            counted.fetch_add(1, Ordering::Relaxed);
            Ok(vec![])
        });
        for port in 1..=50_000 {
            let from = SocketAddr::from(([127, 0, 0, 1], port));
            assert!(!peers.admits(Duration::ZERO, Peer::Udp(from)));
        }
        assert_eq!(peers.dropped(), 50_000);
        assert!(peers.unknown.len() <= MAX_UNKNOWN);
        let most = u32::try_from(begin.elapsed().as_secs()).unwrap() + 1;
        assert!(read.load(Ordering::Relaxed) <= most);
    }

    #[test]
    fn a_key_waits_for_a_look_that_begins_after_it_was_due_and_nobody_else_does() {
        let px4: SocketAddr = "127.0.0.1:14580".parse().unwrap();
        let to = Peer::Udp(px4);
        let (go, gone) = channel::<u32>();
        let mut peers = LocalPeers::reading(Some(vec![1_000]), move || {
            let uid = gone.recv().map_err(io::Error::other)?;
            Ok(vec![(px4, uid)])
        });
        go.send(1_000).unwrap();
        assert!(soon(|| peers.admits(Duration::ZERO, to)));
        let taken = peers.take_look(to);
        assert!(
            matches!(taken, Err(Stranger::Unknown { .. })),
            "none was made: {taken:?}"
        );
        // The port is another's by the time that the reading is done.
        assert!(!peers.has_looked(Duration::ZERO));
        assert!(!peers.has_looked(Duration::ZERO));
        assert!(peers.admits(Duration::ZERO, to), "meanwhile frames pass");
        go.send(1_001).unwrap();
        go.send(1_001).unwrap();
        assert!(soon(|| peers.has_looked(Duration::ZERO)));
        let taken = peers.take_look(to);
        assert!(
            matches!(taken, Err(Stranger::OtherUser { uid: 1_001, .. })),
            "{taken:?}"
        );
        // The next key has a look of its own, which is not asked for at once.
        assert!(!peers.has_looked(Duration::ZERO) && peers.look.is_none());
        assert!(!peers.has_looked(LOOK_AGAIN));
        assert!(peers.look.is_some());
        go.send(1_000).unwrap();
        go.send(1_000).unwrap();
        assert!(soon(|| peers.has_looked(LOOK_AGAIN)));
        // No key has left by it.
        peers.forget_look();
        assert!(peers.take_look(to).is_err());
    }
}
