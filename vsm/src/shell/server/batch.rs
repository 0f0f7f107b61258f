//! Datagrams for stations that are sent together.
//!
//! With many vehicles, the way of each datagram through the system's network code costs more than the report in it. Datagrams of
//! one length for one station take it once, as segments of one message (UDP GSO). Each station gets its own in their order.

use std::collections::VecDeque;
use std::io::{self, IoSlice};
use std::net::SocketAddr;
use std::ops::Range;
use std::os::fd::AsRawFd as _;
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::socket::sockopt::UdpGsoSegment;
use nix::sys::socket::{ControlMessage, MsgFlags, SockaddrStorage, getsockopt, sendmsg};
use tokio::io::Interest;
use tokio::net::UdpSocket;

/// What waits to be sent.
#[derive(Debug, Default)]
pub(super) struct Batch {
    each: Vec<Entry>,
    bytes: Vec<u8>,
    /// Since when the socket has had no room.
    stuck: Option<Duration>,
    /// The kernel knows segments: one before Linux 4.18 would send them as one datagram, which no station can read.
    segments: bool,
    /// Where a message in segments was refused, and when. Many network devices, tunnels and paths take none, which only the first
    /// message shows; and what one address answers says nothing of the others.
    refused: VecDeque<(SocketAddr, Duration)>,
}

#[derive(Debug, Clone)]
struct Entry {
    to: SocketAddr,
    /// Its place in `Batch::bytes`.
    range: Range<usize>,
}

impl Batch {
    /// For what is sent through this socket.
    pub(super) fn new(socket: &UdpSocket) -> Batch {
        Batch {
            segments: getsockopt(socket, UdpGsoSegment).is_ok(),
            ..Batch::default()
        }
    }

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
    pub(super) fn send(&mut self, socket: &UdpSocket, mono: Duration, lost: impl FnMut()) -> bool {
        self.send_by(mono, lost, |bytes, run| {
            socket.try_io(Interest::WRITABLE, || send_run(socket, bytes, run))
        })
    }

    /// As [`Batch::send`]; `send` sends a run in one message.
    fn send_by(
        &mut self,
        mono: Duration,
        mut lost: impl FnMut(),
        mut send: impl FnMut(&[u8], &[Entry]) -> io::Result<()>,
    ) -> bool {
        by_station(&mut self.each);
        let is_over = |(_, at): &(SocketAddr, Duration)| mono.saturating_sub(*at) >= REFUSED_FOR;
        while self.refused.front().is_some_and(is_over) {
            self.refused.pop_front();
        }
        let mut sent = 0;
        while let Some(first) = self.each.get(sent) {
            let to = first.to;
            let rest = self.each.get(sent..).unwrap_or_default();
            let most = if self.takes_segments(to) {
                MAX_SEGMENTS
            } else {
                1
            };
            let run = rest.get(..run(rest, most)).unwrap_or(rest);
            match send(&self.bytes, run) {
                Ok(()) => {
                    sent += run.len();
                    self.stuck = None;
                }
                Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => {
                    let since = *self.stuck.get_or_insert(mono);
                    if mono.saturating_sub(since) < PATIENCE {
                        self.drop_sent(sent);
                        return false;
                    }
                    rest.iter().for_each(|_| lost());
                    break;
                }
                Err(cause) if run.len() > 1 && takes_no_segments(&cause) => {
                    tracing::debug!("datagrams to {to} are sent one by one: {cause}");
                    if self.refused.len() >= MAX_REFUSED {
                        self.refused.pop_front();
                    }
                    self.refused.push_back((to, mono));
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

    fn takes_segments(&self, to: SocketAddr) -> bool {
        self.segments && self.refused.iter().all(|(of, _)| *of != to)
    }

    /// Drops the first ones, which were sent, and their bytes too: the batch may never be empty on a link that is always full.
    fn drop_sent(&mut self, sent: usize) {
        self.each.drain(..sent);
        let mut bytes = Vec::with_capacity(self.bytes.len());
        for entry in &mut self.each {
            let start = bytes.len();
            let content = self.bytes.get(entry.range.clone());
            bytes.extend_from_slice(content.unwrap_or_default());
            entry.range = start..bytes.len();
        }
        self.bytes = bytes;
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
/// How long datagrams to an address go one by one after a message in segments was refused: another way may lead there since.
const REFUSED_FOR: Duration = Duration::from_secs(60);
/// Addresses of which that is known. Anybody can have datagrams sent to an address that refuses them, and an address that is
/// forgotten costs one more call.
const MAX_REFUSED: usize = 64;
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
        let mut bytes = vec![0; 65_536];
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
        for segments in [true, false] {
            let (from, first, second) = (socket().await, socket().await, socket().await);
            let mut batch = Batch::new(&from);
            assert!(batch.segments, "this kernel knows none");
            batch.segments = segments;
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
            assert!(batch.refused.is_empty(), "segments are refused here");
            first.readable().await.unwrap();
            second.readable().await.unwrap();
            assert_eq!(arrived(&first), all);
            let with_mark = all.iter().map(|one| [one.as_slice(), b"2"].concat());
            assert_eq!(arrived(&second), with_mark.collect::<Vec<_>>());
            assert!(batch.each.is_empty() && batch.bytes.is_empty());
        }
    }

    /// Together longer than a message may be: refused as by a device or a path that takes no segments.
    #[tokio::test]
    async fn refused_segments_reach_their_station_one_by_one() {
        let (from, to) = (socket().await, socket().await);
        let mut batch = Batch::new(&from);
        let all = numbered(2, |_| 40_000);
        for datagram in &all {
            batch.add(to.local_addr().unwrap(), datagram);
        }
        from.writable().await.unwrap();
        assert!(batch.send(&from, Duration::ZERO, || panic!("lost")));
        to.readable().await.unwrap();
        assert_eq!(arrived(&to), all);
    }

    /// Station and length of those that were in one message.
    type Message = Vec<(SocketAddr, usize)>;

    /// Sends a batch of these stations and lengths to a network; returns whether all of it was sent, and the messages that were
    /// tried.
    fn tried(
        batch: &mut Batch,
        mono: Duration,
        all: &[(SocketAddr, usize)],
        network: impl Fn(&[(SocketAddr, usize)]) -> io::Result<()>,
    ) -> (bool, Vec<Message>) {
        for (to, length) in all {
            batch.add(*to, &vec![0; *length]);
        }
        let mut messages = Vec::new();
        let done = batch.send_by(
            mono,
            || panic!("lost"),
            |_, run| {
                let message: Message = run.iter().map(|one| (one.to, one.range.len())).collect();
                let sent = network(&message);
                messages.push(message);
                sent
            },
        );
        (done, messages)
    }

    fn station(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    fn knows_segments() -> Batch {
        Batch {
            segments: true,
            ..Batch::default()
        }
    }

    #[test]
    fn a_station_that_takes_no_segments_changes_nothing_for_the_others_and_is_tried_again_later() {
        let (a, b) = (station(1), station(2));
        let refuses = |message: &[(SocketAddr, usize)]| match message {
            [(to, _), _, ..] if *to == a => Err(io::Error::from(Errno::EINVAL)),
            _ => Ok(()),
        };
        let all = [(a, 9), (a, 9), (b, 9), (b, 9)];
        let (of_a, of_b): (Message, Message) = (vec![(a, 9)], vec![(b, 9); 2]);
        let mut batch = knows_segments();
        let first = [vec![(a, 9); 2], of_a.clone(), of_a.clone(), of_b.clone()];
        let at = Duration::from_secs(5);
        let (done, messages) = tried(&mut batch, at, &all, refuses);
        assert!(done && messages == first, "{messages:?}");
        // It is known.
        let at = at + REFUSED_FOR;
        let (_, messages) = tried(&mut batch, at - Duration::from_millis(1), &all, refuses);
        assert_eq!(messages, [of_a.clone(), of_a, of_b]);
        let (_, messages) = tried(&mut batch, at, &all, refuses);
        assert_eq!(messages, first);
        // Addresses that nobody has push none out for good, and take no room without bound.
        for port in 1_000..2_000 {
            let all = [(station(port), 9); 2];
            tried(&mut batch, at, &all, |_| {
                Err(io::Error::from(Errno::EINVAL))
            });
        }
        assert_eq!(batch.refused.len(), MAX_REFUSED);
    }

    #[test]
    fn an_unreachable_station_in_the_middle_costs_only_its_own() {
        for errno in [Errno::ENETUNREACH, Errno::EPERM, Errno::ECONNREFUSED] {
            let network = |message: &[(SocketAddr, usize)]| match message {
                [(to, _), ..] if *to == station(2) => Err(io::Error::from(errno)),
                _ => Ok(()),
            };
            let mut batch = knows_segments();
            let all = [1, 2, 3, 1, 2, 3].map(|port| (station(port), 9));
            let (done, messages) = tried(&mut batch, Duration::ZERO, &all, network);
            let each = [1, 2, 3].map(|port| vec![(station(port), 9_usize); 2]);
            assert!(done && messages == each, "{errno}: {messages:?}");
            assert!(batch.refused.is_empty());
        }
    }

    #[test]
    fn what_stays_for_want_of_room_is_sent_once_and_keeps_no_bytes_of_what_was_sent() {
        let (a, b) = (station(1), station(2));
        let mut batch = knows_segments();
        for round in 0..3_u8 {
            // One message has room each time.
            batch.add(a, &[round; 9]);
            batch.add(b, &[round + 100; 9]);
            let mut room = 1;
            let mut sent = Vec::new();
            let done = batch.send_by(
                Duration::ZERO,
                || panic!("lost"),
                |bytes, run| {
                    if room == 0 {
                        return Err(Errno::EAGAIN.into());
                    }
                    room -= 1;
                    sent.extend(run.iter().map(|one| (one.to, bytes[one.range.start])));
                    Ok(())
                },
            );
            assert!(!done);
            let expected = match round {
                0 => vec![(a, 0)],
                // That of the second station has waited for longest.
                1 => vec![(b, 100), (b, 101)],
                _ => vec![(a, 1), (a, 2)],
            };
            assert_eq!(sent, expected, "{round}");
            let waits: usize = batch.each.iter().map(|one| one.range.len()).sum();
            assert_eq!(batch.bytes.len(), waits);
        }
    }

    #[test]
    fn a_run_ends_with_the_station_a_longer_one_and_behind_a_shorter_one() {
        let (a, b) = (station(1), station(2));
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
