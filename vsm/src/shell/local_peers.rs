//! Who stands at the other end of a UDP link on this computer: only a program of a permitted user may be the vehicle there.
//!
//! PX4 takes its first key unsigned, and after a power cut it is unsigned again; so whoever sends unsigned heartbeats in its
//! name is given the key. On a serial line that is whoever holds the cable. On loopback it would be any program of this
//! computer, whoever runs it, unless the kernel is asked whose socket it is: `/proc/self/net/udp` names the user of each.
//!
//! - What comes from a socket of another user is dropped, before any machine sees it: such a program can neither pose as
//!   the vehicle nor keep a key from it by posing as a second one.
//! - Just before a key leaves, the receiver is looked up once more, in a fresh table. Between that look and the sending
//!   (microseconds) the vehicle's program would have to end and another to take its port.
//!
//! Permitted are this process's own user, root, who could read the key anyway, and the users of the configuration. A person
//! who vouches for the link (`i_trust_this_link`) switches the check off.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

use crate::config::LinkAddress;
use crate::session::Peer;

/// A peer that may not have a key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Stranger {
    /// A socket at its address belongs to somebody else.
    #[error("{at} belongs to user {uid}, expected user {}", list(expected))]
    OtherUser {
        /// The address.
        at: SocketAddr,
        /// The user's id.
        uid: u32,
        /// The users that are permitted.
        expected: Vec<u32>,
    },
    /// No socket of this computer is there.
    #[error("no program of this computer has {at} open")]
    Nobody {
        /// The address.
        at: SocketAddr,
    },
    /// The kernel gives no owner.
    #[error("the owner of {at} is not known: {cause}")]
    Unknown {
        /// The address.
        at: SocketAddr,
        /// The system's reason.
        cause: String,
    },
}

fn list(uids: &[u32]) -> String {
    let uids: Vec<String> = uids.iter().map(u32::to_string).collect();
    uids.join(" or ")
}

/// The check for one link.
#[derive(Debug)]
pub struct LocalPeers {
    /// `None`: anyone on the link may have the key.
    permitted: Option<Vec<u32>>,
    sockets: Vec<(SocketAddr, u32)>,
    read_at: Option<Duration>,
    /// The last that was admitted, so that a frame costs one comparison.
    admitted: Option<SocketAddr>,
    /// The last that was not, and is in the log.
    reported_at: Option<Duration>,
    dropped: u64,
}

impl LocalPeers {
    /// For this link: nobody is looked up on a serial line, nor where a person vouches for the link (`trusted`).
    #[must_use]
    pub fn new(link: &LinkAddress, trusted: bool, users: &[u32]) -> LocalPeers {
        let checked = !trusted && !matches!(link, LinkAddress::Serial { .. });
        LocalPeers::of_users(checked.then(|| permitted(users)))
    }

    /// With exactly these users permitted.
    #[must_use]
    pub fn of_users(permitted: Option<Vec<u32>>) -> LocalPeers {
        LocalPeers {
            permitted,
            sockets: Vec::new(),
            read_at: None,
            admitted: None,
            reported_at: None,
            dropped: 0,
        }
    }

    /// Whether what came from there may be looked at. The table is read once a second, and where an address is not in it,
    /// at most four times a second: a program with many ports costs no more than that.
    pub fn admits(&mut self, mono: Duration, from: Peer) -> bool {
        let Peer::Udp(from) = from else {
            return true;
        };
        if self.permitted.is_none() {
            return true;
        }
        let age = self.read_at.map(|at| mono.saturating_sub(at));
        if age.is_none_or(|age| age >= READ_AGAIN) {
            self.read(mono);
        } else if self.admitted == Some(from) {
            return true;
        } else if age.is_some_and(|age| age >= READ_FOR_UNKNOWN) && !self.knows(from) {
            self.read(mono);
        }
        let permitted = self.permitted.as_deref().unwrap_or_default();
        let judged = judge(&self.sockets, permitted, from);
        if let Err(stranger) = judged {
            self.dropped = self.dropped.saturating_add(1);
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
            return false;
        }
        self.admitted = Some(from);
        true
    }

    /// Whether the peer may be sent a key, by a table that is read now.
    ///
    /// # Errors
    /// It may not.
    pub fn may_have_key(&self, to: Peer) -> Result<(), Stranger> {
        let (Some(permitted), Peer::Udp(at)) = (&self.permitted, to) else {
            return Ok(());
        };
        let sockets = sockets().map_err(|cause| Stranger::Unknown {
            at,
            cause: cause.to_string(),
        })?;
        judge(&sockets, permitted, at)
    }

    /// Datagrams dropped so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    fn knows(&self, from: SocketAddr) -> bool {
        self.sockets.iter().any(|(bound, _)| reaches(*bound, from))
    }

    fn read(&mut self, mono: Duration) {
        self.read_at = Some(mono);
        self.admitted = None;
        // Without a table nobody is admitted: `judge` finds nobody at the address.
        self.sockets = sockets().unwrap_or_else(|cause| {
            tracing::error!("the owners of sockets cannot be read: {cause}");
            Vec::new()
        });
    }
}

/// This process's own user, root and these.
fn permitted(users: &[u32]) -> Vec<u32> {
    let own = rustix::process::geteuid().as_raw();
    // In a user name space this stands for everyone who has no number there.
    let own = Some(own).filter(|own| *own != OVERFLOW_USER);
    let mut all: Vec<u32> = own.into_iter().chain([0]).chain(users.to_vec()).collect();
    all.dedup();
    all
}

/// Each socket that a datagram to `at` could reach must be a permitted user's: with `SO_REUSEADDR` there may be several.
fn judge(sockets: &[(SocketAddr, u32)], permitted: &[u32], at: SocketAddr) -> Result<(), Stranger> {
    let reached = |(bound, _): &&(SocketAddr, u32)| reaches(*bound, at);
    // Beside a socket of IPv4 itself the system gives [::] nothing of IPv4: any user may bind that one, with IPV6_V6ONLY,
    // to PX4's port, and must not cut PX4 off by it.
    let by_ipv4 = sockets
        .iter()
        .filter(reached)
        .any(|(bound, _)| bound.is_ipv4());
    let mut found = false;
    for (bound, uid) in sockets.iter().filter(reached) {
        if by_ipv4 && bound.is_ipv6() && bound.ip().is_unspecified() {
            continue;
        }
        if !permitted.contains(uid) {
            let (uid, expected) = (*uid, permitted.to_vec());
            return Err(Stranger::OtherUser { at, uid, expected });
        }
        found = true;
    }
    if found {
        Ok(())
    } else {
        Err(Stranger::Nobody { at })
    }
}

/// Whether a socket bound there gets what is sent to `to`.
fn reaches(bound: SocketAddr, to: SocketAddr) -> bool {
    let (here, to_ip) = (bound.ip().to_canonical(), to.ip().to_canonical());
    // [::] is given IPv4 too.
    let any = here == IpAddr::V6(Ipv6Addr::UNSPECIFIED)
        || (here == IpAddr::V4(Ipv4Addr::UNSPECIFIED) && to_ip.is_ipv4());
    bound.port() == to.port() && (any || here == to_ip)
}

/// The UDP sockets of this network name space and their users.
fn sockets() -> io::Result<Vec<(SocketAddr, u32)>> {
    let mut all = Vec::new();
    for path in ["/proc/self/net/udp", "/proc/self/net/udp6"] {
        match File::open(path) {
            Ok(file) => add_entries(BufReader::new(file), &mut all)?,
            // A kernel without IPv6.
            Err(cause) if cause.kind() == io::ErrorKind::NotFound && path.ends_with('6') => break,
            Err(cause) => return Err(cause),
        }
    }
    Ok(all)
}

/// Line by line, whatever the length of the table: any user can open sockets, and a bound on it would be a way to have
/// everybody dropped. The kernel's limits of open files bound what is kept, some 40 bytes a socket.
fn add_entries(mut table: impl BufRead, all: &mut Vec<(SocketAddr, u32)>) -> io::Result<()> {
    let mut line = String::new();
    while table.read_line(&mut line)? > 0 {
        // The first line is a heading, and no entry.
        all.extend(entry(&line));
        line.clear();
    }
    Ok(())
}

/// `sl local_address rem_address st tx_queue:rx_queue tr:when retrnsmt uid ...`
fn entry(line: &str) -> Option<(SocketAddr, u32)> {
    let mut fields = line.split_ascii_whitespace();
    let (address, port) = fields.nth(1)?.split_once(':')?;
    let uid = fields.nth(5)?.parse().ok()?;
    let port = u16::from_str_radix(port, 16).ok()?;
    // Words of 32 bits, each printed as a number of this computer's byte order.
    let word = |at: usize| u32::from_str_radix(address.get(at..at + 8)?, 16).ok();
    let ip = match address.len() {
        8 => IpAddr::from(word(0)?.to_ne_bytes()),
        32 => {
            let mut bytes = [0; 16];
            for (at, part) in bytes.chunks_mut(4).enumerate() {
                part.copy_from_slice(&word(8 * at)?.to_ne_bytes());
            }
            IpAddr::from(bytes)
        }
        _ => return None,
    };
    Some((SocketAddr::new(ip, port), uid))
}

const READ_AGAIN: Duration = Duration::from_secs(1);
const READ_FOR_UNKNOWN: Duration = Duration::from_millis(250);
const REPORT_AGAIN: Duration = Duration::from_secs(10);
const OVERFLOW_USER: u32 = 65_534;

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;

    use super::*;

    fn at(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    #[test]
    fn the_kernels_table_is_read() {
        // As Linux prints them on a little-endian computer.
        let v4 = "  411: 0100007F:38D6 00000000:0000 07 00000000:00000000 00:00000000 00000000  1001        0 19340 2 0 0";
        let v6 = " 1284: 0000000000000000FFFF00000100007F:1F90 00000000000000000000000000000000:0000 07 \
                  00000000:00000000 00:00000000 00000000     0        0 5 2 0 0";
        if cfg!(target_endian = "little") {
            assert_eq!(entry(v4), Some((at("127.0.0.1:14550"), 1_001)));
            let (mapped, root) = entry(v6).unwrap();
            assert_eq!(
                (mapped.ip().to_canonical(), root),
                (at("127.0.0.1:8080").ip(), 0)
            );
        }
        for cut in 0..40 {
            assert_eq!(entry(&v4[..cut]), None);
        }
    }

    #[test]
    fn a_table_of_any_length_is_read_to_its_end() {
        let line = |port: u32| {
            format!(
                "  411: 0100007F:{port:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000  1001        0 19340 2 \
                 0000000000000000 0\n"
            )
        };
        let heading =
            "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n";
        let others: String = (0..100_000)
            .map(|number| line(1 + number % 60_000))
            .collect();
        let table = format!("{heading}{others}{}", line(65_000));
        assert!(table.len() > 8 << 20);
        let mut all = vec![];
        add_entries(table.as_bytes(), &mut all).unwrap();
        assert_eq!(all.len(), 100_001);
        assert_eq!(all.last().unwrap().0.port(), 65_000);
    }

    #[test]
    fn every_socket_that_could_get_the_key_must_be_a_permitted_users() {
        let px4 = at("127.0.0.1:14580");
        let judged = |sockets: &[(&str, u32)]| {
            let sockets: Vec<_> = sockets.iter().map(|(text, uid)| (at(text), *uid)).collect();
            judge(&sockets, &[1_000, 0], px4)
        };
        for good in [
            &[("127.0.0.1:14580", 1_000)][..],
            &[("0.0.0.0:14580", 0)],
            &[("[::]:14580", 1_000)],
            &[("[::ffff:127.0.0.1]:14580", 1_000)],
            // Beside IPv4 itself [::] is given nothing of it, whoever binds it.
            &[("127.0.0.1:14580", 1_000), ("[::]:14580", 1_001)],
            &[("0.0.0.0:14580", 1_000), ("[::]:14580", 1_001)],
            // Others that are somewhere else.
            &[
                ("127.0.0.1:14580", 1_000),
                ("127.0.0.1:14581", 1_001),
                ("127.0.0.2:14580", 1_001),
                ("[::1]:14580", 7),
            ],
        ] {
            assert_eq!(judged(good), Ok(()), "{good:?}");
        }
        for bad in [
            &[("127.0.0.1:14580", 1_001)][..],
            &[("0.0.0.0:14580", 1_001)],
            // One address shared by SO_REUSEADDR.
            &[("127.0.0.1:14580", 1_000), ("127.0.0.1:14580", 1_001)],
        ] {
            let found = judged(bad);
            assert!(
                matches!(found, Err(Stranger::OtherUser { uid: 1_001, .. })),
                "{bad:?}: {found:?}"
            );
        }
        assert_eq!(
            judged(&[("127.0.0.1:9", 1_000)]),
            Err(Stranger::Nobody { at: px4 })
        );
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
        drop(socket);
        assert_eq!(
            ours.may_have_key(peer),
            Err(Stranger::Nobody { at: address })
        );
        assert!(!ours.admits(READ_AGAIN, peer), "it is gone");
    }

    #[test]
    fn one_that_opens_a_port_later_is_admitted() {
        let own = rustix::process::geteuid().as_raw();
        let mut peers = LocalPeers::of_users(Some(vec![own]));
        let first = UdpSocket::bind("127.0.0.1:0").unwrap();
        assert!(peers.admits(Duration::ZERO, Peer::Udp(first.local_addr().unwrap())));
        let second = UdpSocket::bind("127.0.0.1:0").unwrap();
        let from = Peer::Udp(second.local_addr().unwrap());
        assert!(
            !peers.admits(Duration::from_millis(1), from),
            "not read again yet"
        );
        assert!(peers.admits(READ_FOR_UNKNOWN, from));
    }
}
