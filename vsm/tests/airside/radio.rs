//! The radio between bridge and agent as an encrypted link (`encrypt`): both ends with a disk of their own, and a line that
//! may carry little.

use std::collections::BTreeMap;
use std::time::Duration;

use kit::network::{Faults, Network};
use mavlink_link::Now;
use mavlink_link::encrypted::{
    Carrier, EncryptedConfig, EncryptedLink, EncryptedState, MAX_WIRE, Role, bytes_on_radio,
};
use mavlink_link::exchange::{Identity, NoRandom};
use mavlink_link::frame::FrameView;
use mavlink_link::store::MemoryDisk;
use vsm::session::Peer;

use crate::world::settings;

/// The ends, as the line addresses them.
pub(crate) const GROUND_END: usize = 0;
pub(crate) const AIR_END: usize = 1;

pub(crate) struct EncryptedRadio {
    rate_bps: u32,
    ends: [End; 2],
    /// The line, without a limit until [`EncryptedRadio::pace`].
    line: Network<usize, Vec<u8>>,
    /// The messages that have come out on the ground, and when.
    received: Vec<(Duration, u32)>,
}

struct End {
    link: EncryptedLink<Peer>,
    disk: MemoryDisk,
    random: u64,
}

impl EncryptedRadio {
    /// Ends that are paired, on a serial line of this rate. `now`: by the clock of their processes.
    pub(crate) fn new(rate_bps: u32, now: Duration) -> EncryptedRadio {
        let end = |end: usize| {
            let disk = MemoryDisk::default();
            End {
                link: open(end, rate_bps, now, &disk),
                disk,
                random: 1 + end as u64,
            }
        };
        EncryptedRadio {
            rate_bps,
            ends: [end(GROUND_END), end(AIR_END)],
            line: Network::new(5, Faults::NONE.delayed_ms(20, 60)),
            received: Vec::new(),
        }
    }

    /// From now on the line carries no more than its rate, ten bits a byte.
    pub(crate) fn pace(&mut self) {
        self.line.faults.bytes_s = Some(self.line_bytes_s());
    }

    fn line_bytes_s(&self) -> f64 {
        f64::from(self.rate_bps) / 10.0
    }

    /// The process at this end is started again: with what is on its disk, and without keys.
    pub(crate) fn restart(&mut self, end: usize, now: Duration) {
        let link = open(end, self.rate_bps, now, &self.ends[end].disk);
        self.ends[end].link = link;
    }

    /// Whether packets of the other end verify at both. `now`: by the clock of each end.
    pub(crate) fn is_up(&self, now: [Duration; 2]) -> bool {
        let ends = self.ends.iter().zip(now);
        let mut states = ends.map(|(end, now)| end.link.state(now));
        states.all(|state| state == EncryptedState::Encrypted)
    }

    /// An end sends a frame of MAVLink.
    pub(crate) fn send(&mut self, from: usize, now: Now, clock: Duration, frame: &[u8]) {
        self.ends[from].link.send(now.mono, Peer::Serial, frame);
        self.transmit(from, now, clock);
    }

    fn transmit(&mut self, from: usize, now: Now, clock: Duration) {
        let mut out = [0; MAX_WIRE];
        let End { link, disk, .. } = &mut self.ends[from];
        while let Some((_, length)) = link.poll_transmit(now.mono, disk, &mut out) {
            let bytes = out[..length].to_vec();
            self.line.send(clock, from, 1 - from, bytes);
        }
    }

    /// Lets both ends do what is due. What has arrived at each: whole frames, one behind the other.
    pub(crate) fn step(&mut self, clock: Duration, now: [Now; 2]) -> Vec<(usize, Vec<u8>)> {
        let mut arrived = Vec::new();
        while let Some(packet) = self.line.receive(clock) {
            let to = packet.to;
            let End { link, disk, random } = &mut self.ends[to];
            let bytes = &packet.payload;
            let frames = link.handle(now[to], Peer::Serial, bytes, &mut fill(random), disk);
            let frames = frames.to_vec();
            if to == GROUND_END {
                self.note_received(clock, &frames);
            }
            if !frames.is_empty() {
                arrived.push((to, frames));
            }
            self.transmit(to, now[to], clock);
        }
        for end in [GROUND_END, AIR_END] {
            let End { link, disk, random } = &mut self.ends[end];
            link.handle_timeout(now[end], &mut fill(random), disk);
            self.transmit(end, now[end], clock);
        }
        arrived
    }

    fn note_received(&mut self, clock: Duration, frames: &[u8]) {
        let mut rest = frames;
        while let Ok(frame) = FrameView::parse(rest) {
            self.received.push((clock, frame.header().message_id));
            rest = &rest[frame.as_bytes().len()..];
        }
    }

    /// How often a message has come out on the ground since then.
    pub(crate) fn count(&self, message: u32, from: Duration) -> usize {
        let since = self.received.iter().rev();
        let since = since.take_while(|(at, _)| *at >= from);
        since.filter(|(_, id)| *id == message).count()
    }

    /// The most that both directions carried within five seconds since then, in shares of the line.
    pub(crate) fn busiest(&self, from: Duration) -> f64 {
        let mut seconds = BTreeMap::<u64, usize>::new();
        let carried = self.line.carried.iter();
        for one in carried.filter(|one| one.waited.0 >= from) {
            *seconds.entry(one.waited.1.as_secs()).or_default() += one.bytes;
        }
        let seconds: Vec<f64> = seconds.into_values().map(|bytes| bytes as f64).collect();
        let means = seconds
            .windows(5)
            .map(|five| five.iter().sum::<f64>() / 5.0);
        means.fold(0.0, f64::max) / self.line_bytes_s()
    }

    /// The longest time that a packet to the vehicle waited for the line since then.
    pub(crate) fn longest_wait(&self, from: Duration) -> Duration {
        let sent = self.line.carried.iter();
        let sent = sent.filter(|one| one.to == AIR_END && one.waited.0 >= from);
        let waits = sent.map(|one| one.waited.1 - one.waited.0);
        waits.max().expect("something was sent")
    }

    /// How long the line takes for a packet.
    pub(crate) fn packet_time(&self) -> Duration {
        Duration::from_secs_f64(bytes_on_radio(1) as f64 / self.line_bytes_s())
    }
}

fn open(end: usize, rate_bps: u32, now: Duration, disk: &MemoryDisk) -> EncryptedLink<Peer> {
    let (role, own, other) = match end {
        GROUND_END => (Role::Ground, [1; 32], [2; 32]),
        _ => (Role::Air, [2; 32], [1; 32]),
    };
    // The agent's telemetry waits for a packet to be full for as long as the line takes for one, 100 ms at most.
    let packet_s = bytes_on_radio(1) as f64 * 10.0 / f64::from(rate_bps);
    let linger = match role {
        Role::Ground => Duration::ZERO,
        Role::Air => Duration::from_secs_f64(packet_s.min(0.1)),
    };
    let config = EncryptedConfig {
        role,
        parties: settings().parties(),
        identity: Identity::new(own),
        peer: Some(Identity::new(other).public()),
        carrier: Carrier::Stream,
        at: Some(Peer::Serial),
        before: None,
        linger,
    };
    EncryptedLink::open(config, now, disk).expect("the record of its epoch")
}

/// Bytes that nobody needs to be unable to guess.
fn fill(state: &mut u64) -> impl FnMut(&mut [u8]) -> Result<(), NoRandom> {
    move |out: &mut [u8]| {
        for byte in out {
            *state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            *byte = (*state >> 56) as u8;
        }
        Ok(())
    }
}
