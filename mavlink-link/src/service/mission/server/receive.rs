//! Receiving a plan: MISSION_COUNT, then item after item.

use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_REQUEST_DATA, MISSION_REQUEST_INT_DATA, MavMessage, MavMissionResult, MavMissionType,
};

use super::{Server, State};
use crate::service::Node;
use crate::service::mission::item::Item;
use crate::service::mission::plan_id::extend;
use crate::service::mission::{ItemFault, ItemRules};

impl<R: ItemRules> Server<R> {
    pub(super) fn handle_count(
        &mut self,
        now: Duration,
        from: Node,
        count: u16,
        kind: MavMissionType,
    ) {
        match &self.state {
            State::Idle => {
                self.last_heard = now;
                self.partner = Some(from);
                self.kind = kind;
                let accepted = MavMissionResult::MAV_MISSION_ACCEPTED;
                if count > self.max(kind) {
                    self.send_ack(from, MavMissionResult::MAV_MISSION_NO_SPACE, 0);
                    return;
                }
                if count == 0 {
                    self.store(kind, Vec::new(), 0);
                    self.send_ack(from, accepted, 0);
                    return;
                }
                self.state = State::Receiving {
                    count,
                    items: Vec::new(),
                };
                self.received = (0, 0);
            }
            State::Receiving { items, .. } => {
                self.last_heard = now;
                let error = MavMissionResult::MAV_MISSION_ERROR;
                if self.partner != Some(from) {
                    self.send_ack(from, error, 0);
                    return;
                }
                // While no item came, a repeated count is taken for one whose answer was lost.
                if !items.is_empty() {
                    self.text("WPM: REJ. CMD: Busy\t");
                    self.send_ack(from, error, 0);
                    return;
                }
            }
            State::Sending { .. } => {
                self.text("WPM: IGN MISSION_COUNT: Busy\t");
                self.send_ack(from, MavMissionResult::MAV_MISSION_ERROR, 0);
                return;
            }
        }
        self.send_request(now);
    }

    pub(super) fn handle_item(
        &mut self,
        now: Duration,
        from: Node,
        seq: u16,
        kind: MavMissionType,
        item: Item,
        (x, y): ([u8; 4], [u8; 4]),
    ) {
        use MavMissionResult as R;
        if self.partner != Some(from) {
            self.text("REJ. MIS ITEM: partner id mismatch\t");
            return;
        }
        if kind != self.kind {
            self.send_ack(from, R::MAV_MISSION_ERROR, 0);
            return;
        }
        let (crc, received) = self.received;
        let (count, items) = match &mut self.state {
            State::Receiving { count, items } => (*count, items),
            State::Idle if seq.checked_add(1) == Some(received) => {
                // Our last MISSION_ACK was lost, and the item is a repeat.
                self.send_ack(from, R::MAV_MISSION_ACCEPTED, crc);
                return;
            }
            State::Idle => {
                self.text("IGN MISSION_ITEM: No transfer\t");
                self.send_ack(from, R::MAV_MISSION_ERROR, 0);
                return;
            }
            State::Sending { .. } => {
                self.text("IGN MISSION_ITEM: Busy\t");
                self.send_ack(from, R::MAV_MISSION_ERROR, 0);
                return;
            }
        };
        self.last_heard = now;
        if seq != received {
            return;
        }
        if let Err(fault) = self.rules.check(kind, &item, self.int) {
            self.refuse(from, fault);
            return;
        }
        items.push(item);
        let crc = extend(crc, &item, x, y);
        self.received = (crc, received + 1);
        if received + 1 < count {
            self.send_request(now);
            return;
        }
        let items = std::mem::take(items);
        self.state = State::Idle;
        if crc != self.opaque_id(kind) {
            self.store(kind, items, crc);
        }
        self.send_ack(from, R::MAV_MISSION_ACCEPTED, crc);
    }

    pub(super) fn refuse(&mut self, from: Node, fault: ItemFault) {
        // Only what is wrong with the item itself has a text.
        if fault != ItemFault::Other {
            self.text("IGN MISSION_ITEM: Invalid item\t");
        }
        self.state = State::Idle;
        self.send_ack(from, fault.result(), 0);
    }

    pub(super) fn send_request(&mut self, now: Duration) {
        let Some(to) = self.partner else {
            return;
        };
        self.last_sent = now;
        let (target_system, target_component) = (to.system, to.component);
        let (_, seq) = self.received;
        let mission_type = self.kind;
        self.out.push(if self.int {
            MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            })
        } else {
            MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            })
        });
    }
}
