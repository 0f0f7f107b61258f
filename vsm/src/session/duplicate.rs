//! Duplicates: the same source, destination, type, stamp and octets; acknowledged again, not carried out again.

use std::collections::VecDeque;

use stanag_msgs::TimeStamp;
use stanag_msgs::enums::AckType;
use stanag_msgs::wrapper::Frame;

/// The latest messages of one CUCS and what each was answered.
#[derive(Debug, Default)]
pub(crate) struct Recent {
    seen: VecDeque<Seen>,
}

#[derive(Debug)]
struct Seen {
    octets: Vec<u8>,
    stamp: TimeStamp,
    message_type: u16,
    answer: Option<AckType>,
}

impl Recent {
    /// The answer given to this very message before: `Some(None)` where it was seen and not answered yet.
    pub(crate) fn find(&self, frame: &Frame<'_>, stamp: TimeStamp) -> Option<Option<AckType>> {
        self.seen
            .iter()
            .rev()
            .find(|seen| seen.stamp == stamp && seen.octets == frame.octets)
            .map(|seen| seen.answer)
    }

    /// Remembers a message. One without a stamp cannot be told from a new one, and is not remembered.
    pub(crate) fn remember(&mut self, frame: &Frame<'_>, stamp: TimeStamp) {
        // The oldest gives its octets' place to the newest: in the long run nothing is allocated for a message.
        let oldest = if self.seen.len() == DEPTH {
            self.seen.pop_front()
        } else {
            None
        };
        let mut octets = oldest.map(|seen| seen.octets).unwrap_or_default();
        octets.clear();
        octets.extend_from_slice(frame.octets);
        self.seen.push_back(Seen {
            octets,
            stamp,
            message_type: frame.header.message_type,
            answer: None,
        });
    }

    /// Notes the answer to the latest message of this type and stamp.
    pub(crate) fn answered(&mut self, message_type: u16, stamp: TimeStamp, answer: AckType) {
        let mut latest = self.seen.iter_mut().rev();
        if let Some(seen) =
            latest.find(|seen| seen.message_type == message_type && seen.stamp == stamp)
        {
            seen.answer = Some(answer);
        }
    }
}

/// Messages remembered a CUCS: an upload of 500 waypoints, sent twice, is told apart.
const DEPTH: usize = 1024;
