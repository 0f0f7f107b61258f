//! The owners of this computer's UDP sockets: `/proc/self/net/udp` names the user of each, and a separate thread reads it.
//!
//! Any user can open sockets, and the time that the kernel needs for its table grows faster than their number: 20,000 take
//! seconds. So the thread that handles datagrams does not depend on it:
//!
//! - The reading thread reads once a second, whatever arrives, and pauses at least as long as the reading took. The last table is
//!   used until the next one is complete.
//! - A look-up takes at most five steps, however large the table is.
//! - A caller that needs a current table asks for one: a reading begins at once, and the caller is notified when it is complete.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

/// The address of a socket, and its user.
pub(super) type Socket = (SocketAddr, u32);

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
    /// The kernel reports no owner.
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

/// The owners from the last reading. The thread ends when this is dropped.
#[derive(Debug)]
pub(super) struct SocketOwners {
    shared: Arc<Shared>,
}

impl SocketOwners {
    /// Starts the thread; only these users are permitted. `looked` is notified when a requested reading is complete.
    pub(super) fn start(
        permitted: Vec<u32>,
        looked: Arc<Notify>,
        read: impl FnMut() -> io::Result<Vec<Socket>> + Send + 'static,
    ) -> SocketOwners {
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                table: Err(NOT_YET.to_owned()),
                readings: 0,
                took: Duration::ZERO,
                asked: 0,
                answered: 0,
                ended: false,
            }),
            changed: Condvar::new(),
            looked,
        });
        let of_thread = shared.clone();
        let started = std::thread::Builder::new()
            .name("socket-owners".to_owned())
            .spawn(move || of_thread.keep_reading(&permitted, read));
        if let Err(cause) = started {
            // Then nobody is admitted, and nobody waits.
            let mut state = shared.lock();
            state.table = Err(cause.to_string());
            state.ended = true;
        }
        SocketOwners { shared }
    }

    /// Checks in the last table that each socket which a datagram to `at` could reach belongs to a permitted user.
    pub(super) fn judge(&self, at: SocketAddr) -> Result<(), Stranger> {
        match &self.shared.lock().table {
            Ok(table) => table.judge(at),
            Err(cause) => Err(Stranger::Unknown {
                at,
                cause: cause.clone(),
            }),
        }
    }

    /// How often the table has been read.
    pub(super) fn readings(&self) -> u64 {
        self.shared.lock().readings
    }

    /// Requests a reading that begins now; returns its number.
    pub(super) fn ask(&self) -> u64 {
        let mut state = self.shared.lock();
        state.asked += 1;
        let number = state.asked;
        drop(state);
        self.shared.changed.notify_all();
        number
    }

    /// Whether that reading is complete.
    pub(super) fn has_answered(&self, number: u64) -> bool {
        self.shared.lock().has_answered(number)
    }

    /// Whether the last reading was so short that another one may be waited for.
    pub(super) fn is_quick(&self) -> bool {
        self.shared.lock().took < QUICK
    }

    /// Waits until that reading is complete; false if it takes longer than `within`.
    pub(super) fn wait(&self, number: u64, within: Duration) -> bool {
        let state = self.shared.lock();
        let changed = &self.shared.changed;
        let waited = changed.wait_timeout_while(state, within, |state: &mut State| {
            !state.has_answered(number)
        });
        let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        state.has_answered(number)
    }
}

impl Drop for SocketOwners {
    fn drop(&mut self) {
        self.shared.lock().ended = true;
        self.shared.changed.notify_all();
    }
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    looked: Arc<Notify>,
}

#[derive(Debug)]
struct State {
    /// The last table, or why it could not be read.
    table: Result<Table, String>,
    readings: u64,
    /// How long the last one took.
    took: Duration,
    /// The last number that was requested.
    asked: u64,
    /// The last number that had been requested when the present table's reading began.
    answered: u64,
    ended: bool,
}

impl State {
    fn has_answered(&self, number: u64) -> bool {
        self.ended || self.answered >= number
    }
}

impl Shared {
    /// Held only for a look-up: slow work is done outside.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn keep_reading(&self, permitted: &[u32], mut read: impl FnMut() -> io::Result<Vec<Socket>>) {
        let mut failing = false;
        loop {
            let asked = self.lock().asked;
            let began = Instant::now();
            let table = read().map(|sockets| Table::of(&sockets, permitted));
            let took = began.elapsed();
            if let Err(cause) = &table
                && !failing
            {
                tracing::error!("the owners of sockets cannot be read: {cause}");
            }
            failing = table.is_err();
            let table = table.map_err(|cause| cause.to_string());
            let mut state = self.lock();
            let before = std::mem::replace(&mut state.table, table);
            state.readings += 1;
            state.took = took;
            let was_asked = std::mem::replace(&mut state.answered, asked) < asked;
            drop(state);
            // Dropped outside the lock: it may be large.
            drop(before);
            self.changed.notify_all();
            if was_asked {
                self.looked.notify_one();
            }
            // At most half of a core's time, however many sockets somebody holds.
            let pause = READ_EVERY.saturating_sub(took).max(took);
            let is_idle = |state: &mut State| state.asked == asked && !state.ended;
            let waited = self.changed.wait_timeout_while(self.lock(), pause, is_idle);
            let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
            if state.ended {
                return;
            }
        }
    }
}

/// The sockets of one reading.
#[derive(Debug)]
struct Table {
    permitted: Vec<u32>,
    /// For each address and port: a user with a socket there who is not permitted, if any.
    foreign: HashMap<(IpAddr, u16), Option<u32>>,
}

impl Table {
    fn of(sockets: &[Socket], permitted: &[u32]) -> Table {
        let mut foreign: HashMap<(IpAddr, u16), Option<u32>> =
            HashMap::with_capacity(sockets.len());
        for (bound, uid) in sockets {
            let here = foreign.entry((bound.ip(), bound.port())).or_default();
            if !permitted.contains(uid) {
                *here = Some(*uid);
            }
        }
        Table {
            permitted: permitted.to_vec(),
            foreign,
        }
    }

    /// Each socket that a datagram to `at` could reach must be a permitted user's: with `SO_REUSEADDR` there may be several.
    fn judge(&self, at: SocketAddr) -> Result<(), Stranger> {
        let (mut found, mut by_ipv4) = (false, false);
        for bound in reaching(at.ip()) {
            let Some(foreign) = self.foreign.get(&(bound, at.port())) else {
                continue;
            };
            // If an IPv4 socket is bound there, the system gives [::] no IPv4 datagrams. Any user may bind [::] with
            // IPV6_V6ONLY to PX4's port, and must not be able to cut PX4 off with that.
            if by_ipv4 && bound == ANY_IPV6 {
                continue;
            }
            if let Some(uid) = *foreign {
                let expected = self.permitted.clone();
                return Err(Stranger::OtherUser { at, uid, expected });
            }
            by_ipv4 |= bound.is_ipv4();
            found = true;
        }
        if found {
            Ok(())
        } else {
            Err(Stranger::Nobody { at })
        }
    }
}

/// The addresses of sockets that receive datagrams to this address: IPv4 ones first, then [::], which receives IPv4 too.
fn reaching(to: IpAddr) -> [IpAddr; 5] {
    match to.to_canonical() {
        IpAddr::V4(to) => {
            let any = Ipv4Addr::UNSPECIFIED;
            let (mapped, any_mapped) = (to.to_ipv6_mapped(), any.to_ipv6_mapped());
            [
                to.into(),
                any.into(),
                mapped.into(),
                any_mapped.into(),
                ANY_IPV6,
            ]
        }
        to => [to, to, to, to, ANY_IPV6],
    }
}

/// The UDP sockets of this network name space and their users.
pub(super) fn sockets() -> io::Result<Vec<Socket>> {
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

/// Reads the table line by line, without a bound on its length: any user can open sockets, and a bound would let them have
/// everyone dropped. The kernel's limits on open files bound the memory, some 40 bytes a socket.
fn add_entries(mut table: impl BufRead, all: &mut Vec<Socket>) -> io::Result<()> {
    let mut line = String::new();
    while table.read_line(&mut line)? > 0 {
        // The first line is a heading, not an entry.
        all.extend(entry(&line));
        line.clear();
    }
    Ok(())
}

/// `sl local_address rem_address st tx_queue:rx_queue tr:when retrnsmt uid ...`
fn entry(line: &str) -> Option<Socket> {
    let mut fields = line.split_ascii_whitespace();
    let (address, port) = fields.nth(1)?.split_once(':')?;
    let uid = fields.nth(5)?.parse().ok()?;
    let port = u16::from_str_radix(port, 16).ok()?;
    // Words of 32 bits, each printed as a number in this computer's byte order.
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

const ANY_IPV6: IpAddr = IpAddr::V6(Ipv6Addr::UNSPECIFIED);
pub(super) const NOT_YET: &str = "it has not been looked up yet";
const READ_EVERY: Duration = Duration::from_secs(1);
/// Three times what the table of 20,000 sockets takes, on a slow computer.
pub(super) const PATIENCE: Duration = Duration::from_secs(30);
/// Longer than a reading of a few hundred sockets, shorter than one of a few thousand.
const QUICK: Duration = Duration::from_millis(20);

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::sync::mpsc::channel;

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
            Table::of(&sockets, &[1_000, 0]).judge(px4)
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
    fn many_sockets_on_one_port_are_told_apart() {
        let mut sockets: Vec<Socket> = (0..100_000_u32)
            .map(|number| (IpAddr::V4(Ipv4Addr::from(0x7f01_0000 + number)), 1_001))
            .map(|(ip, uid)| (SocketAddr::new(ip, 14_580), uid))
            .collect();
        sockets.push((at("127.0.0.1:14580"), 1_000));
        let table = Table::of(&sockets, &[1_000]);
        assert_eq!(table.judge(at("127.0.0.1:14580")), Ok(()));
        assert_eq!(table.judge(at("[::ffff:127.0.0.1]:14580")), Ok(()));
        let other = table.judge(at("127.1.0.7:14580"));
        assert!(
            matches!(other, Err(Stranger::OtherUser { uid: 1_001, .. })),
            "{other:?}"
        );
    }

    #[test]
    fn nobody_waits_for_a_reading_and_what_was_read_last_counts_until_the_next_is_there() {
        let px4 = at("127.0.0.1:14580");
        let (begun, begins) = channel();
        let (go, gone) = channel::<u32>();
        // Each reading takes until it is let go, and finds this user.
        let owners = SocketOwners::start(vec![1_000], Arc::default(), move || {
            begun.send(()).map_err(io::Error::other)?;
            let uid = gone.recv().map_err(io::Error::other)?;
            Ok(vec![(px4, uid)])
        });
        begins.recv().unwrap();
        let unknown = Stranger::Unknown {
            at: px4,
            cause: NOT_YET.to_owned(),
        };
        assert_eq!(owners.judge(px4), Err(unknown));
        // The one that runs had begun before: another answers.
        let first = owners.ask();
        go.send(1_000).unwrap();
        begins.recv().unwrap();
        assert!(!owners.has_answered(first));
        go.send(1_000).unwrap();
        assert!(owners.wait(first, PATIENCE));
        let second = owners.ask();
        let begin = Instant::now();
        for _ in 0..10_000 {
            assert_eq!(owners.judge(px4), Ok(()));
        }
        assert!(begin.elapsed() < Duration::from_secs(5));
        assert!(!owners.has_answered(second));
        for _ in 0..2 {
            go.send(1_001).unwrap();
        }
        assert!(owners.wait(second, PATIENCE));
        let other = owners.judge(px4);
        assert!(
            matches!(other, Err(Stranger::OtherUser { uid: 1_001, .. })),
            "{other:?}"
        );
    }

    #[test]
    fn a_table_that_cannot_be_read_admits_nobody() {
        let px4 = at("127.0.0.1:14580");
        let mut before = 0;
        let owners = SocketOwners::start(vec![0], Arc::default(), move || {
            before += 1;
            match before {
                1 => Ok(vec![(px4, 0)]),
                _ => Err(io::Error::other("no table")),
            }
        });
        // The first may have begun before it was asked for.
        for _ in 0..2 {
            assert!(owners.wait(owners.ask(), PATIENCE));
        }
        let refused = owners.judge(px4).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "the owner of 127.0.0.1:14580 is not known: no table"
        );
    }

    #[test]
    fn it_reads_once_a_second_and_ends_with_who_asks() {
        let read = Arc::new(AtomicU32::new(0));
        let counted = read.clone();
        let begin = Instant::now();
        let owners = SocketOwners::start(vec![0], Arc::default(), move || {
            counted.fetch_add(1, Ordering::Relaxed);
            Ok(vec![])
        });
        while begin.elapsed() < Duration::from_millis(1_500) {
            assert!(owners.judge(at("127.0.0.1:9")).is_err());
            std::thread::sleep(Duration::from_millis(1));
        }
        let so_far = read.load(Ordering::Relaxed);
        let most = u32::try_from(begin.elapsed().as_secs()).unwrap() + 1;
        assert!((1..=most).contains(&so_far), "{so_far} of {most}");
        drop(owners);
        // What it read by belongs to the thread, and goes with it.
        while Arc::strong_count(&read) > 1 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
