//! What somebody with a receiver can read on the radio between the bridge and the agent.

use std::collections::BTreeMap;

use mavlink_link::dialect::MavMessage;
use mavlink_link::frame::{FrameView, KEY_EXCHANGE_ID, STX};

/// MAVLink in the clear, at any place of any datagram.
#[derive(Debug, Default)]
pub(super) struct Overheard {
    /// Frames by the id of their message.
    pub(super) frames: BTreeMap<u32, u64>,
    /// Seconds since the vehicle's boot and metres above home, of GLOBAL_POSITION_INT.
    pub(super) positions: Vec<(f64, f64)>,
}

impl Overheard {
    pub(super) fn of(datagrams: &[Vec<u8>]) -> Overheard {
        let mut found = Overheard::default();
        for bytes in datagrams {
            let starts = (0..bytes.len()).filter(|&at| bytes.get(at) == Some(&STX));
            let frames = starts.filter_map(|at| FrameView::parse(bytes.get(at..)?).ok());
            // A frame with an unknown id has no checksum to verify: some random bytes look like one.
            for frame in frames.filter(FrameView::is_checked) {
                found.read(&frame);
            }
        }
        found
    }

    fn read(&mut self, frame: &FrameView<'_>) {
        *self.frames.entry(frame.header().message_id).or_default() += 1;
        if let Ok(MavMessage::GLOBAL_POSITION_INT(at)) = frame.message() {
            let time_s = f64::from(at.time_boot_ms) / 1e3;
            self.positions
                .push((time_s, f64::from(at.relative_alt) / 1e3));
        }
    }

    /// Which messages, and how many of each: the most frequent ones first.
    pub(super) fn text(&self) -> String {
        let mut frames: Vec<_> = self.frames.iter().collect();
        frames.sort_by_key(|(_, count)| u64::MAX - *count);
        let named = frames.iter().take(NAMED).map(|(id, count)| {
            let name = match **id {
                // The message is not in the dialect.
                KEY_EXCHANGE_ID => "KEY_EXCHANGE",
                id => crate::message_name(id),
            };
            format!("{count} {name}")
        });
        let mut text = named.collect::<Vec<_>>().join(", ");
        if frames.len() > NAMED {
            text += &format!(" and {} other messages", frames.len() - NAMED);
        }
        text
    }
}

const NAMED: usize = 1;
