//! Datagrams for stations that are sent together.
//!
//! With many vehicles, the way of each datagram through the system's network code costs more than the report in it. Datagrams of
//! one length for one station take it once, as segments of one message (UDP GSO). Each station gets its own in their order.

use std::io::{self, IoSlice};
use std::net::SocketAddr;
use std::ops::Range;
use std::os::fd::AsRawFd as _;
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrStorage, sendmsg};
use tokio::io::Interest;
use tokio::net::UdpSocket;

/// What waits to be sent.
#[derive(Debug, Default)]
pub(super) struct Batch {
    each: Vec<Entry>,
    bytes: Vec<u8>,
    /// Since when the socket has had no room.
    stuck: Option<Duration>,
    /// The system, or the way to a station, takes no segments: its first answer to some reports it.
    one_by_one: bool,
}

#[derive(Debug, Clone)]
struct Entry {
    to: SocketAddr,
    /// Its place in `Batch::bytes`.
    range: Range<usize>,
}

impl Batch {
    pub(super) fn add(&mut self, to: SocketAddr, bytes: &[u8]) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        let range = start..self.bytes.len();
        self.each.push(Entry { to, range });
    }

    pub(super) fn is_full(&self) -> bool {
        self.each.len() >= MAX_BATCH
    }

    pub(super) fn clear(&mut self) {
        self.each.clear();
        self.bytes.clear();
        self.stuck = None;
    }

    /// Sends them. Returns false where the socket has no room: they stay for [`PATIENCE`], the time that a network takes for a
    /// burst, and after it they are lost, as on any link, like all others until there is room again; `lost` is called for each.
    pub(super) fn send(
        &mut self,
        socket: &UdpSocket,
        mono: Duration,
        mut lost: impl FnMut(),
    ) -> bool {
        by_station(&mut self.each);
        let mut sent = 0;
        while let Some(rest) = self.each.get(sent..).filter(|rest| !rest.is_empty()) {
            let most = if self.one_by_one { 1 } else { MAX_SEGMENTS };
            let run = rest.get(..run(rest, most)).unwrap_or(rest);
            match socket.try_io(Interest::WRITABLE, || send_run(socket, &self.bytes, run)) {
                Ok(()) => {
                    sent += run.len();
                    self.stuck = None;
                }
                Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => {
                    let since = *self.stuck.get_or_insert(mono);
                    if mono.saturating_sub(since) < PATIENCE {
                        self.each.drain(..sent);
                        return false;
                    }
                    rest.iter().for_each(|_| lost());
                    break;
                }
                Err(cause) if run.len() > 1 && takes_no_segments(&cause) => {
                    tracing::debug!("datagrams to CUCSs are sent one by one: {cause}");
                    self.one_by_one = true;
                }
                Err(cause) => {
                    // Those behind them are still sent.
                    let count = run.len();
                    tracing::debug!("{count} datagrams to a CUCS were not sent: {cause}");
                    sent += count;
                }
            }
        }
        self.each.clear();
        self.bytes.clear();
        true
    }

    /// Waits until what stays here can be sent, or is lost.
    pub(super) async fn room(&self, socket: &UdpSocket) {
        if self.each.is_empty() {
            return std::future::pending().await;
        }
        // A fault is reported by the next call.
        let _ = tokio::time::timeout(PATIENCE, socket.writable()).await;
    }
}

/// Puts those of one station together, the station first whose first one has waited for longest.
fn by_station(each: &mut [Entry]) {
    let mut stations: Vec<SocketAddr> = Vec::new();
    for entry in each.iter() {
        if !stations.contains(&entry.to) {
            stations.push(entry.to);
        }
    }
    // Stable: their order stays.
    each.sort_by_key(|entry| stations.iter().position(|to| *to == entry.to));
}

/// How many of the first can be segments of one message: of one station and of one length, but for the last, which may be shorter.
fn run(each: &[Entry], most: usize) -> usize {
    let Some(first) = each.first() else { return 0 };
    let length = first.range.len();
    let mut count = 1;
    for entry in each.iter().take(most).skip(1) {
        // An empty one would be no segment.
        if entry.to != first.to || entry.range.is_empty() || entry.range.len() > length {
            break;
        }
        count += 1;
        if entry.range.len() < length {
            break;
        }
    }
    count
}

fn send_run(socket: &UdpSocket, bytes: &[u8], run: &[Entry]) -> io::Result<()> {
    let Some(first) = run.first() else {
        return Ok(());
    };
    let content = |entry: &Entry| bytes.get(entry.range.clone()).unwrap_or_default();
    let slices: Vec<IoSlice<'_>> = run.iter().map(|one| IoSlice::new(content(one))).collect();
    let to = SockaddrStorage::from(first.to);
    let length = u16::try_from(first.range.len()).unwrap_or(u16::MAX);
    let segments = [ControlMessage::UdpGsoSegments(&length)];
    let control = if run.len() > 1 { &segments[..] } else { &[] };
    let fd = socket.as_raw_fd();
    sendmsg(fd, &slices, control, MsgFlags::empty(), Some(&to))?;
    Ok(())
}

/// What a kernel, a network device or a path answers that cannot cut a message into segments.
fn takes_no_segments(cause: &io::Error) -> bool {
    let raw = cause.raw_os_error().map(Errno::from_raw);
    matches!(raw, Some(Errno::EIO | Errno::EINVAL | Errno::EMSGSIZE))
}

/// Datagrams that are sent together: more gain little, and delay what follows them.
const MAX_BATCH: usize = 64;
/// The kernel takes 64, and a message of 64 KiB in all: of datagrams of up to 1,000 bytes.
const MAX_SEGMENTS: usize = 64;
/// How long a burst waits for room.
const PATIENCE: Duration = Duration::from_millis(100);

#[cfg(test)]
mod tests {
    use super::*;

    async fn socket() -> UdpSocket {
        UdpSocket::bind("127.0.0.1:0").await.unwrap()
    }

    /// What has arrived so far.
    fn arrived(socket: &UdpSocket) -> Vec<Vec<u8>> {
        let mut bytes = [0; 2_048];
        let one = || {
            socket
                .try_recv(&mut bytes)
                .ok()
                .map(|n| bytes[..n].to_vec())
        };
        std::iter::from_fn(one).collect()
    }

    fn numbered(count: u8, length: impl Fn(u8) -> usize) -> Vec<Vec<u8>> {
        (0..count).map(|n| vec![n; length(n)]).collect()
    }

    #[tokio::test]
    async fn each_station_gets_its_own_datagrams_in_their_order_whatever_their_lengths() {
        for one_by_one in [false, true] {
            let (from, first, second) = (socket().await, socket().await, socket().await);
            let mut batch = Batch {
                one_by_one,
                ..Batch::default()
            };
            // Runs of one length, longer ones and shorter ones behind them, and an empty one.
            let all = numbered(60, |n| match n {
                0..20 => 90,
                20..25 => 548,
                25..40 => 90 - usize::from(n),
                40 => 0,
                _ => 60 + usize::from(n % 3),
            });
            for datagram in &all {
                batch.add(first.local_addr().unwrap(), datagram);
                batch.add(
                    second.local_addr().unwrap(),
                    &[datagram.as_slice(), b"2"].concat(),
                );
            }
            from.writable().await.unwrap();
            assert!(batch.send(&from, Duration::ZERO, || panic!("lost")));
            assert_eq!(batch.one_by_one, one_by_one, "segments are refused here");
            first.readable().await.unwrap();
            second.readable().await.unwrap();
            assert_eq!(arrived(&first), all);
            let with_mark = all.iter().map(|one| [one.as_slice(), b"2"].concat());
            assert_eq!(arrived(&second), with_mark.collect::<Vec<_>>());
            assert!(batch.each.is_empty() && batch.bytes.is_empty());
        }
    }

    #[test]
    fn a_run_ends_with_the_station_a_longer_one_and_behind_a_shorter_one() {
        let (a, b) = (
            "127.0.0.1:1".parse().unwrap(),
            "127.0.0.1:2".parse().unwrap(),
        );
        let entries = |each: &[(SocketAddr, usize)]| -> Vec<Entry> {
            let one = |(to, length): &(SocketAddr, usize)| Entry {
                to: *to,
                range: 0..*length,
            };
            each.iter().map(one).collect()
        };
        assert_eq!(run(&entries(&[(a, 9), (a, 9), (b, 9)]), 64), 2);
        assert_eq!(run(&entries(&[(a, 9), (a, 10)]), 64), 1);
        assert_eq!(run(&entries(&[(a, 9), (a, 8), (a, 8)]), 64), 2);
        assert_eq!(run(&entries(&[(a, 9); 70]), 64), 64);
        assert_eq!(run(&entries(&[(a, 9); 70]), 1), 1);
        let mut mixed = entries(&[(b, 1), (a, 2), (b, 3), (a, 1)]);
        by_station(&mut mixed);
        let order: Vec<_> = mixed.iter().map(|one| (one.to, one.range.len())).collect();
        assert_eq!(order, [(b, 1), (b, 3), (a, 2), (a, 1)]);
    }
}
