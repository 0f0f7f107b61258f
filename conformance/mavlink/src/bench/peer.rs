//! A station or vehicle that the suite plays: an identity on a port, which sends honest frames unless a scene changes
//! them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::time::Duration;

use conformance::verdict::{Judged, Stop};
use conformance::wire::Direction;

use super::net::{Net, Port, Seen};
use crate::wire::{Craft, Draft};

/// A sender of frames.
#[derive(Clone, Debug)]
pub struct Peer {
    /// The network.
    pub net: Arc<Net>,
    /// Its socket.
    pub port: Arc<Port>,
    /// Its system id.
    pub system: u8,
    /// Its component id.
    pub component: u8,
    /// Its link id.
    pub link: u8,
    seq: Arc<AtomicU8>,
}

impl Peer {
    /// A peer on a port.
    #[must_use]
    pub fn new(net: &Arc<Net>, port: &Arc<Port>, (system, component): (u8, u8), link: u8) -> Self {
        Self {
            net: net.clone(),
            port: port.clone(),
            system,
            component,
            link,
            seq: Arc::default(),
        }
    }

    /// The same peer with another link id: another stream.
    #[must_use]
    pub fn with_link(&self, link: u8) -> Self {
        Self {
            link,
            ..self.clone()
        }
    }

    /// The same system with another component id.
    #[must_use]
    pub fn with_component(&self, component: u8) -> Self {
        Self {
            component,
            seq: Arc::default(),
            ..self.clone()
        }
    }

    /// The same peer from another port.
    #[must_use]
    pub fn on(&self, port: &Arc<Port>) -> Self {
        Self {
            port: port.clone(),
            ..self.clone()
        }
    }

    /// An honest frame: numbered, stamped and signed now, so a new one for every sending.
    #[must_use]
    pub fn craft(&self, draft: &Draft) -> Craft {
        let mut craft = draft.craft(self.system, self.component);
        craft.seq = self.seq.fetch_add(1, Ordering::SeqCst);
        craft.link = self.link;
        craft.key = self.net.key();
        if craft.key.is_some() {
            craft.stamp = self.net.stamp();
        }
        craft
    }

    /// Sends an honest frame; returns the mark before it.
    pub fn send(&self, draft: &Draft) -> usize {
        self.send_with(draft, |_| {}).0
    }

    /// Sends a frame that `change` has altered; returns the mark before it, and its bytes.
    pub fn send_with(&self, draft: &Draft, change: impl FnOnce(&mut Craft)) -> (usize, Vec<u8>) {
        // Between its stamp and its sending nothing else of the suite may be stamped: this frame would arrive behind
        // a later stamp, and be refused.
        let _held = self.net.hold();
        let mut craft = self.craft(draft);
        change(&mut craft);
        let bytes = craft.bytes();
        (self.send_bytes(&bytes), bytes)
    }

    /// Sends bytes unchanged; returns the mark before them.
    pub fn send_bytes(&self, bytes: &[u8]) -> usize {
        let mark = self.net.mark();
        self.port.send(bytes);
        mark
    }

    /// Whether a received frame is for this peer, or a broadcast.
    #[must_use]
    pub fn is_mine(&self, seen: &Seen) -> bool {
        seen.direction == Direction::Received
            && seen.socket == self.port.number
            && seen.frame.target().is_none_or(|(system, component)| {
                (system == 0 || system == self.system)
                    && (component == 0 || component == self.component)
            })
    }

    /// The first frame for this peer from `mark` on that `wanted` accepts.
    pub fn wait(
        &self,
        mark: usize,
        time: Duration,
        mut wanted: impl FnMut(&Seen) -> bool,
    ) -> Option<Arc<Seen>> {
        self.net.wait(mark, self.net.now() + time, |seen| {
            self.is_mine(seen) && wanted(seen)
        })
    }

    /// Sends a request up to three times until it is answered.
    ///
    /// # Errors
    /// A fail where no answer came; the operator stopped the run.
    pub fn request(
        &self,
        draft: &Draft,
        time: Duration,
        what: &str,
        mut wanted: impl FnMut(&Seen) -> bool,
    ) -> Judged<Arc<Seen>> {
        for _ in 0..3 {
            let mark = self.send(draft);
            if let Some(seen) = self.wait(mark, time, &mut wanted) {
                return Ok(seen);
            }
            if self.net.interrupted() {
                return Err(Stop::Interrupted);
            }
        }
        Err(Stop::fail(format!(
            "expected {what} within {:.1} s of {}; none came in three tries",
            time.as_secs_f64(),
            draft.name()
        )))
    }

    /// Sends this every second until the returned flag is set; pauses while `paused` is set.
    pub fn heartbeats(&self, draft: Draft, paused: Arc<AtomicBool>) -> Arc<AtomicBool> {
        let ended = Arc::new(AtomicBool::new(false));
        let (peer, until) = (self.clone(), ended.clone());
        std::thread::spawn(move || {
            while !until.load(Ordering::SeqCst) {
                if !paused.load(Ordering::SeqCst) {
                    peer.send(&draft);
                }
                for _ in 0..20 {
                    std::thread::sleep(Duration::from_millis(50));
                    if until.load(Ordering::SeqCst) {
                        return;
                    }
                }
            }
        });
        ended
    }
}

/// The heartbeat of a ground station.
#[must_use]
pub fn station_heartbeat() -> Draft {
    Draft::new("HEARTBEAT")
        .set("type", 6)
        .set("autopilot", 8)
        .set("system_status", 4)
        .set("mavlink_version", 3)
}
