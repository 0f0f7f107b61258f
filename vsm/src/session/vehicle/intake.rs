//! What a vehicle says, taken in: only what the link believes, and only what is fresh as an answer.

use mavlink_link::Now;
use mavlink_link::dialect::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};
use mavlink_link::frame::{FrameView, Header};
use mavlink_link::service::{Node, param};
use mavlink_link::store::Disk;

use super::{Fresh, Peer, VehicleEvent, VehicleLink, auth};

impl VehicleLink {
    /// Takes what arrived. `tap` sees every frame that was believed, for a recording.
    pub(crate) fn handle_datagram(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        store: &mut dyn Disk,
        tap: &mut dyn FnMut(&FrameView<'_>),
    ) {
        if self.settle_datagram(now, from, bytes, store) {
            return;
        }
        if self.look_for_next_key(now, from, bytes, store) {
            self.collect(now.mono);
            self.flush(now, store);
            return;
        }
        // The link borrows itself while it delivers: what it delivers is taken in afterwards.
        let mut believed = std::mem::take(&mut self.believed);
        let asked = self.asked;
        let (link, key, received) = (&mut self.link, self.key.as_mut(), &mut self.received);
        link.handle_datagram(now, from, bytes, auth(key, store), &mut |delivery| {
            tap(&delivery.frame);
            received.count(delivery.header.message_id);
            let fresh = Fresh {
                mission: delivery.can_answer(asked.mission),
                command: delivery.can_answer(asked.command),
                parameter: delivery.can_answer(asked.parameter),
                state: delivery.can_answer(asked.last),
            };
            if let Ok(message) = delivery.message {
                let Header {
                    system_id,
                    component_id,
                    ..
                } = delivery.header;
                believed.push((Node::new(system_id, component_id), message, fresh));
            }
        });
        for (node, message, fresh) in believed.drain(..) {
            self.take_message(now, node, &message, fresh);
        }
        self.believed = believed;
        self.collect(now.mono);
        self.flush(now, store);
    }

    fn take_message(&mut self, now: Now, node: Node, message: &MavMessage, fresh: Fresh) {
        self.texts.handle_message(now.mono, node, message);
        if node != self.vehicle {
            return;
        }
        self.take_word_of_control(node, message);
        #[allow(deprecated, reason = "what PX4 answers")]
        if let MavMessage::PING(ping) = message
            && ping.target_system == self.link.config().own_system
        {
            self.events.push_back(VehicleEvent::PingReturned(ping.seq));
        }
        let mode = self.telemetry.mode;
        self.telemetry.update(message);
        if matches!(
            message,
            MavMessage::HEARTBEAT(_) | MavMessage::CURRENT_MODE(_)
        ) {
            self.state_is_newer |= fresh.state;
            self.heard_at = Some(now.mono);
        }
        if let MavMessage::HEARTBEAT(_) = message {
            self.heartbeat_at = Some(now.mono);
            if self.silent {
                self.silent = false;
                // It may have been given another plan meanwhile.
                self.telemetry.mission = None;
                self.intervals.request_again();
                self.events.push_back(VehicleEvent::Heard);
            }
        }
        self.watch_boot(message);
        if let MavMessage::MISSION_CURRENT(_) = message {
            self.progress_told_ms = self.boot_ms;
        }
        if self.telemetry.mode != mode {
            self.events.push_back(VehicleEvent::ModeChanged);
        }
        self.missions
            .handle_message(now.mono, node, message, fresh.mission);
        self.commands
            .handle_message(now.mono, node, message, fresh.command);
        let answered = self
            .parameters
            .handle_message(now.mono, node, message, fresh.parameter);
        if let MavMessage::PARAM_VALUE(told) = message
            && !answered
            && let Some((name, value)) = param::named_value(told)
        {
            self.events
                .push_back(VehicleEvent::ParameterTold(name, value));
        }
    }

    /// What it says of who commands it: answers to other systems, who is in control, and who asks for it.
    fn take_word_of_control(&mut self, node: Node, message: &MavMessage) {
        let own = self.link.config().own_system;
        if let MavMessage::COMMAND_ACK(ack) = message
            && ack.target_system != 0
            && ack.target_system != own
        {
            let event = VehicleEvent::ForeignCommand(ack.target_system, ack.command as u32);
            self.events.push_back(event);
        }
        match message {
            MavMessage::CONTROL_STATUS(status) => {
                self.events
                    .push_back(VehicleEvent::ControlStatus(status.clone()));
            }
            MavMessage::COMMAND_LONG(asked)
                if asked.command == MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL
                    && asked.target_system == own =>
            {
                self.events
                    .push_back(VehicleEvent::ControlAsked(asked.param4 as u8));
                // That it has been heard, no more.
                self.post(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                    command: asked.command,
                    result: MavResult::MAV_RESULT_ACCEPTED,
                    target_system: node.system,
                    target_component: node.component,
                    ..COMMAND_ACK_DATA::default()
                }));
            }
            _ => {}
        }
    }

    /// A clock since boot that goes back is another boot: the rates asked for are forgotten.
    fn watch_boot(&mut self, message: &MavMessage) {
        let boot_ms = match message {
            MavMessage::ATTITUDE(m) => m.time_boot_ms,
            MavMessage::GLOBAL_POSITION_INT(m) => m.time_boot_ms,
            _ => return,
        };
        // Frames of one link may overtake each other a little.
        if self
            .boot_ms
            .is_some_and(|before| boot_ms.saturating_add(BOOT_SLACK_MS) < before)
        {
            self.telemetry.start_anew();
            self.intervals.request_again();
            self.events.push_back(VehicleEvent::Restarted);
        }
        self.boot_ms = Some(boot_ms);
    }
}

const BOOT_SLACK_MS: u32 = 1_000;
