//! What goes to the vehicle: signed at the moment of sending, and the stamps of questions kept.

use mavlink::Message as _;
use mavlink_link::Now;
use mavlink_link::dialect::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::signing::Stamp;
use mavlink_link::store::Disk;

use super::{OutFrame, VehicleEvent, VehicleLink, auth};

impl VehicleLink {
    /// Signs and queues what the link and the services want sent; called after each change of theirs.
    pub(crate) fn flush(&mut self, now: Now, store: &mut dyn Disk) {
        let mut bytes = [0; MAX_FRAME];
        while let Some(sent) =
            self.link
                .poll_transmit(now, auth(self.key.as_mut(), store), &mut bytes)
        {
            self.sent.count(HEARTBEAT);
            self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
        while let Some(message) = self.posts.pop_front() {
            self.send(now, &message, store);
        }
        if self.missions.busy().is_none() {
            self.asked.mission = None;
        }
        while let Some(message) = self.missions.poll_transmit() {
            let stamp = self.send(now, &message, store);
            self.asked.mission = self.asked.mission.or(stamp);
        }
        if self.parameters.pending() == 0 {
            self.asked.parameter = None;
        }
        while let Some(message) = self.parameters.poll_transmit() {
            let stamp = self.send(now, &message, store);
            self.asked.parameter = self.asked.parameter.or(stamp);
        }
        loop {
            while let Some(event) = self.commands.poll_event() {
                self.asked.command = None;
                if self.intervals.handle_event(now.mono, &event) {
                    self.intervals.advance(now.mono, &mut self.commands);
                } else {
                    self.events.push_back(VehicleEvent::Command(event));
                }
            }
            let Some(message) = self.commands.poll_transmit() else {
                break;
            };
            let stamp = self.send(now, &message, store);
            self.asked.command = self.asked.command.or(stamp);
            if may_change_state(&message) {
                self.asked.last = stamp.or(self.asked.last);
                self.state_is_newer = false;
            }
        }
    }

    fn send(&mut self, now: Now, message: &MavMessage, store: &mut dyn Disk) -> Option<Stamp> {
        let mut bytes = [0; MAX_FRAME];
        // Refusals are counted and alerted by the link; the service repeats or gives up by its own timing.
        let sent = self
            .link
            .send(now, auth(self.key.as_mut(), store), message, &mut bytes)
            .ok()?;
        self.sent.count(message.message_id());
        self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        sent.stamp
    }
}

/// Rates and messages are asked for all the time: what is told meanwhile is no older for it.
fn may_change_state(command: &MavMessage) -> bool {
    !matches!(
        command,
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL | MavCmd::MAV_CMD_REQUEST_MESSAGE,
            ..
        })
    )
}

const HEARTBEAT: u32 = 0;
