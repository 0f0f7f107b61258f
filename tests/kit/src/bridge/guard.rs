//! The guard beside a station: `vsm guard run` without its sockets.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;
use stanag_msgs::guard::{ClockDatagram, Direction, Guarded, MAX_GUARDED, is_offer};
use stanag_msgs::{Id, frames};
use vsm::session::{GroupReceiver, GuardEnd, GuardRefusal};

use super::parties::VSM;

/// The guard of one station.
#[derive(Debug)]
pub struct StationGuard {
    station: Id,
    key: SigningKey,
    end: GuardEnd,
    disk: MemoryDisk,
    group: GroupReceiver,
    /// What it has accepted from the group, for its own station.
    pub group_taken: Vec<Vec<u8>>,
    /// Everything that it has sent, as sealed bytes.
    pub sent: Vec<Vec<u8>>,
}

impl StationGuard {
    /// A guard with the key of its station.
    pub fn new(station: Id, now: Now) -> StationGuard {
        StationGuard::with_key(station, guard_key(station), now)
    }

    /// A guard with another key, such as the next one of its station.
    pub fn with_key(station: Id, key: SigningKey, now: Now) -> StationGuard {
        let mut disk = MemoryDisk::default();
        let end = start(station, &key, now, &mut disk);
        StationGuard {
            station,
            key,
            end,
            disk,
            group: GroupReceiver::new(VSM),
            group_taken: Vec::new(),
            sent: Vec::new(),
        }
    }

    /// Restarts as after `kill -9`.
    pub fn restart(&mut self, now: Now) {
        self.end = start(self.station, &self.key, now, &mut self.disk);
        self.group = GroupReceiver::new(VSM);
    }

    /// Seals a datagram of its station.
    pub fn seal(&mut self, now: Now, datagram: &[u8]) -> Vec<u8> {
        let mut out = [0; MAX_GUARDED];
        let sealed = self.end.seal(now, datagram, &mut out, &mut self.disk);
        let sealed = out[..sealed.expect("it has a key and a disk")].to_vec();
        self.sent.push(sealed.clone());
        sealed
    }

    /// The content of a datagram of the VSM. Where it is refused, or is about clocks, the reply for the VSM.
    ///
    /// # Errors
    /// It has no trailer, or the trailer does not verify.
    pub fn open(&mut self, now: Now, bytes: &[u8]) -> Result<Vec<u8>, Option<Vec<u8>>> {
        let mut out = [0; MAX_GUARDED];
        if let Some(about) = ClockDatagram::parse(bytes) {
            let answer = self.end.take_clock(now, &about, &mut out, &mut self.disk);
            let length = answer.ok().flatten();
            return Err(length.map(|length| out[..length].to_vec()));
        }
        let guarded = Guarded::parse(bytes).ok_or(None)?;
        let anywhere = (([127, 0, 0, 1], 4_586).into(), None);
        let opened = self.end.open_from(now, &guarded, anywhere, &mut self.disk);
        if let Ok((inside, key)) = opened
            && is_offer(inside)
        {
            let offer = self.end.unwrap_offer(key, inside);
            self.group.take(offer.expect("it was made for this guard"));
            return Ok(Vec::new());
        }
        let opened = opened.map(|(inside, _)| inside.to_vec());
        opened.map_err(|why: GuardRefusal| {
            let replies = why.wants_reply();
            let length = replies.then(|| self.end.reply(now, &mut out, &mut self.disk));
            length.flatten().map(|length| out[..length].to_vec())
        })
    }

    /// The content of a datagram of the group.
    ///
    /// # Errors
    /// It is refused, with the reason; `None` where it has no trailer.
    pub fn open_group(&mut self, now: Now, bytes: &[u8]) -> Result<Vec<u8>, Option<GuardRefusal>> {
        let guarded = Guarded::parse(bytes).ok_or(None)?;
        let opened = self.group.open(now.mono, &guarded);
        opened.map(<[u8]>::to_vec).map_err(Some)
    }

    /// What of the group is passed on to its station.
    pub fn take_group(&mut self, now: Now, bytes: &[u8]) -> Option<Vec<u8>> {
        let inside = self.open_group(now, bytes).ok()?;
        let first = frames(&inside).next()?.ok()?;
        if first.header.destination != self.station {
            return None;
        }
        self.group_taken.push(inside.clone());
        Some(inside)
    }
}

fn start(station: Id, key: &SigningKey, now: Now, disk: &mut MemoryDisk) -> GuardEnd {
    let keys = vec![(key.duplicate(), None)];
    let ids = (station, VSM);
    let end = GuardEnd::new(ids, Direction::ToVsm, keys, Duration::ZERO, now, disk);
    end.expect("its disk is good")
}

/// The guard key of a station.
pub fn guard_key(station: Id) -> SigningKey {
    let mut bytes = [0x67; 32];
    bytes[..4].copy_from_slice(&station.0.to_be_bytes());
    SigningKey::new(bytes).expect("not all zero")
}

/// The key that signs access lists.
pub fn access_key() -> SigningKey {
    SigningKey::new([0x61; 32]).expect("not all zero")
}
