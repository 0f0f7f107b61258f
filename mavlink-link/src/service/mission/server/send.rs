//! Sending the stored plan: MISSION_REQUEST_LIST, then request after request.

use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_COUNT_DATA, MavMessage, MavMissionResult, MavMissionType,
};

use super::{Server, State};
use crate::service::Node;
use crate::service::mission::{FRAME_GLOBAL, FRAME_GLOBAL_RELATIVE, ItemRules, px4_read_back};

impl<R: ItemRules> Server<R> {
    pub(super) fn handle_request_list(&mut self, now: Duration, from: Node, kind: MavMissionType) {
        if let State::Sending { next, .. } = self.state {
            let all_sent = usize::from(next) == self.items(self.kind).len();
            let again = self.kind == kind && self.partner == Some(from);
            if !all_sent && !again {
                self.text("Mission download request ignored, already active\t");
                return;
            }
        } else if self.is_busy() {
            self.text("Mission download request ignored, already active\t");
            return;
        }
        self.last_heard = now;
        self.kind = kind;
        self.partner = Some(from);
        let count = u16::try_from(self.items(kind).len()).unwrap_or(u16::MAX);
        self.state = State::Sending { count, next: 0 };
        self.send_count(now);
    }

    pub(super) fn handle_request(
        &mut self,
        now: Duration,
        from: Node,
        seq: u16,
        kind: MavMissionType,
    ) {
        if self.partner != Some(from) {
            self.text("WPM: REJ. CMD: partner id mismatch\t");
            return;
        }
        match &mut self.state {
            State::Idle => {}
            State::Receiving { .. } => self.text("WPM: REJ. CMD: Busy\t"),
            State::Sending { count, next } if kind == self.kind => {
                self.last_heard = now;
                if seq == *next && *next < *count {
                    *next += 1;
                } else if seq.checked_add(1) != Some(*next) {
                    self.abort_sending(from);
                    return;
                }
                self.send_item(now, from, seq);
            }
            State::Sending { .. } => {}
        }
    }

    fn abort_sending(&mut self, to: Node) {
        self.state = State::Idle;
        self.send_ack(to, MavMissionResult::MAV_MISSION_ERROR, 0);
        self.text("WPM: REJ. CMD: Req. WP was unexpected\t");
    }

    pub(super) fn send_count(&mut self, now: Duration) {
        let (Some(to), State::Sending { count, .. }) = (self.partner, &self.state) else {
            return;
        };
        let message = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: *count,
            target_system: to.system,
            target_component: to.component,
            mission_type: self.kind,
            opaque_id: self.opaque_id(self.kind),
        });
        self.last_sent = now;
        self.out.push(message);
    }

    fn send_item(&mut self, now: Duration, to: Node, seq: u16) {
        let Some(stored) = self.items(self.kind).get(usize::from(seq)) else {
            self.abort_sending(to);
            return;
        };
        let mut item = px4_read_back(self.kind, stored);
        item.current = self.current == Some(seq);
        self.last_sent = now;
        let message = if self.int {
            item.to_message(to, self.kind, seq)
        } else {
            // The float message has the frames that are not called INT.
            item.frame = match item.frame {
                5 => FRAME_GLOBAL,
                6 => FRAME_GLOBAL_RELATIVE,
                frame => frame,
            };
            item.to_float_message(to, self.kind, seq)
        };
        // What came in a message fits in one, so that this cannot fail.
        if let Ok(message) = message {
            self.out.push(message);
        }
    }
}
