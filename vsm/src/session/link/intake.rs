//! Reception: only frames that the link accepts update the vehicle's state, and only fresh ones answer a request.

use std::time::Duration;

use mapping::report;
use mavlink_link::dialect::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult, MavType};
use mavlink_link::frame::{FrameView, Header};
use mavlink_link::service::{Node, param};

use super::event::VehicleEvent;
use super::frame::Peer;
use super::key_recovery::KeyChange;
use super::services::Services;
use super::state::VehicleState;
use super::{Fresh, VehicleLink, auth};
use crate::session::effects::Effects;

impl VehicleLink {
    /// Handles received bytes. `tap` is called with every accepted frame, for a recording.
    pub(crate) fn handle_datagram(
        &mut self,
        from: Peer,
        bytes: &[u8],
        vehicle: &mut VehicleState,
        effects: &mut Effects<'_>,
        tap: &mut dyn FnMut(&FrameView<'_>),
    ) {
        let now = effects.dli.now;
        // While the key is unknown, the key recovery takes every datagram, so that no frame is accepted under the wrong key.
        if (self.key_recovery).handle_datagram(now, from, bytes, effects.dli.disk) {
            return self.advance_key_recovery(effects);
        }
        let (current, out, store) = (self.key.as_ref(), &mut self.out, &mut *effects.dli.disk);
        let proven = self.agreement.look(now, from, bytes, current, out, store);
        // The key recovery has consumed the bytes that proved the key: the next datagram is the link's first under this key.
        if proven.is_some() {
            self.key = proven;
            self.key_recovery.change = Some(KeyChange::Commit);
            self.collect(vehicle, effects);
            self.flush(vehicle, effects);
            return;
        }
        let was_silent = self.is_silent(now.mono);
        // The link is borrowed while it delivers frames, so they are handled afterwards.
        let mut accepted = std::mem::take(&mut self.accepted);
        let (asked, components) = (self.asked, &self.asked_components);
        let (link, key, received) = (&mut self.link, self.key.as_mut(), &mut self.received);
        let (loss, autopilot) = (&mut self.loss, self.vehicle);
        link.handle_datagram(
            now,
            from,
            bytes,
            auth(key, effects.dli.disk),
            &mut |delivery| {
                tap(&delivery.frame);
                received.count(delivery.header.message_id);
                let header = delivery.header;
                if Node::new(header.system_id, header.component_id) == autopilot {
                    loss.note(now.mono, header.seq);
                }
                let fresh = Fresh {
                    mission: delivery.can_answer(asked.mission),
                    command: delivery.can_answer(asked.command),
                    payload: delivery.can_answer(components.get(&header.component_id).copied()),
                    parameter: delivery.can_answer(asked.parameter),
                    file: delivery.can_answer(asked.file),
                    state: delivery.can_answer(asked.last),
                    clock: delivery.can_answer(asked.clock),
                };
                if let Ok(message) = delivery.message {
                    let Header {
                        system_id,
                        component_id,
                        ..
                    } = delivery.header;
                    let node = Node::new(system_id, component_id);
                    accepted.push((node, message, fresh));
                }
            },
        );
        for (node, message, fresh) in accepted.drain(..) {
            self.handle_message(node, &message, fresh, vehicle, effects);
        }
        self.accepted = accepted;
        if self.link.accepted_at() == Some(now.mono) {
            self.stopped = Duration::ZERO;
            if was_silent {
                self.live_since = Some(now.mono);
            }
            if let Some(key) = &self.key {
                self.verified = Some((now.mono, key.id()));
            }
        }
        self.collect(vehicle, effects);
        self.flush(vehicle, effects);
    }

    fn handle_message(
        &mut self,
        node: Node,
        message: &MavMessage,
        fresh: Fresh,
        vehicle: &mut VehicleState,
        effects: &mut Effects<'_>,
    ) {
        let now = effects.dli.now.mono;
        // Texts are accepted from any component of the vehicle's system; state and answers only from its autopilot.
        self.texts.handle_message(now, node, message);
        if node.system == self.vehicle.system && is_of_payload(message) {
            vehicle.payloads.update(now, node.component, message);
            self.events.push_back(VehicleEvent::PayloadReported);
        }
        // A radio inserts this message into the stream itself, unsigned and with its own system id (a SiK radio: system 51,
        // component 68). The link accepts it from the peer's address only. It is used only for the quality of the data link.
        if let MavMessage::RADIO_STATUS(_) = message {
            vehicle.telemetry.equipment.update(now, message);
        }
        if node.system == self.vehicle.system
            && let Some(commands) = effects.vehicle.components.get_mut(&node.component)
        {
            commands.handle_message(now, node, message, fresh.payload);
        }
        if node != self.vehicle {
            return;
        }
        self.watch_control(node, message, effects);
        #[allow(deprecated, reason = "what PX4 answers")]
        if let MavMessage::PING(ping) = message
            && ping.target_system == self.link.config().own_system
        {
            self.events.push_back(VehicleEvent::PingReturned(ping.seq));
        }
        if let MavMessage::TERRAIN_REQUEST(request) = message {
            effects.vehicle.ground.take(now, request);
            Self::send_ground(effects);
        }
        let mode = vehicle.telemetry.mode;
        let state = report::ua_state(&vehicle.telemetry);
        if (vehicle.measured).takes(now, &effects.vehicle.clock, message) {
            vehicle.telemetry.update(message);
        }
        (vehicle.payloads).note_time(now, vehicle.telemetry.boot_ms());
        vehicle.telemetry.equipment.update(now, message);
        if matches!(
            message,
            MavMessage::HEARTBEAT(_) | MavMessage::CURRENT_MODE(_)
        ) {
            // A heartbeat that was in transit when a command was sent shows the mode before the command and confirms
            // nothing.
            vehicle.note_mode(now, fresh.state);
        }
        let Services {
            missions,
            commands,
            parameters,
            files,
            events,
            intervals,
            clock,
            ..
        } = &mut *effects.vehicle;
        if let MavMessage::HEARTBEAT(_) = message {
            vehicle.heartbeat_at = Some(now);
            if vehicle.silent {
                vehicle.silent = false;
                vehicle.measured.begin_again(now, &mut vehicle.telemetry);
                // Another station may have uploaded a different mission meanwhile.
                vehicle.telemetry.mission = None;
                intervals.request_again();
                // The vehicle may have rebooted.
                clock.reset();
                self.events.push_back(VehicleEvent::LinkUp);
            }
        }
        if has_restarted(message, vehicle) {
            // A reboot resets the requested message rates.
            vehicle.telemetry.restart();
            vehicle.measured.restart();
            clock.reset();
            intervals.request_again();
            events.reset();
            self.events.push_back(VehicleEvent::Restarted);
        }
        clock.handle_message(now, node, message, fresh.clock);
        events.handle_message(now, node, message);
        if let MavMessage::COMPONENT_METADATA(named) = message {
            self.events.push_back(VehicleEvent::Metadata(named.clone()));
        }
        vehicle.measured.note(now, clock, message);
        if let MavMessage::MISSION_CURRENT(_) = message {
            vehicle.progress_boot_ms = vehicle.boot_ms;
            vehicle.progress_at = Some(now);
        }
        if vehicle.telemetry.mode != mode {
            self.events.push_back(VehicleEvent::ModeChanged);
        } else if vehicle.live() && report::ua_state(&vehicle.telemetry) != state {
            self.events.push_back(VehicleEvent::StateChanged);
        }
        missions.handle_message(now, node, message, fresh.mission);
        commands.handle_message(now, node, message, fresh.command);
        files.handle_message(now, node, message, fresh.file);
        let answered = parameters.handle_message(now, node, message, fresh.parameter);
        if let MavMessage::PARAM_VALUE(reported) = message
            && !answered
            && let Some((name, value)) = param::named_value(reported)
        {
            let event = VehicleEvent::ParameterReported(name, value);
            self.events.push_back(event);
        }
    }

    /// Handles reports about who commands the vehicle: answers to other systems, who is in control, and who requests
    /// control.
    fn watch_control(&mut self, node: Node, message: &MavMessage, effects: &mut Effects<'_>) {
        let own = self.link.config().own_system;
        match message {
            // PX4 forwards between its links: an answer to another system shows that another system commands the vehicle
            // too.
            MavMessage::COMMAND_ACK(ack)
                if ack.target_system != 0
                    && ack.target_system != own
                    && !self.commanders.contains(&ack.target_system) =>
            {
                self.events.push_back(VehicleEvent::ForeignControl(format!(
                    "MAVLink system {} commands the vehicle too: command {}, not through this VSM",
                    ack.target_system, ack.command as u32
                )));
            }
            MavMessage::CONTROL_STATUS(status) => {
                let event = VehicleEvent::ControlStatus(status.clone());
                self.events.push_back(event);
            }
            MavMessage::COMMAND_LONG(requested)
                if requested.command == MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL
                    && requested.target_system == own =>
            {
                self.events.push_back(VehicleEvent::ForeignControl(format!(
                    "MAVLink system {} requests operator control of the vehicle: granted once control is released",
                    requested.param4 as u8
                )));
                // This only acknowledges the request: the CUCS decides whether to give up control.
                effects
                    .vehicle
                    .post(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                        command: requested.command,
                        result: MavResult::MAV_RESULT_ACCEPTED,
                        target_system: node.system,
                        target_component: node.component,
                        ..COMMAND_ACK_DATA::default()
                    }));
            }
            _ => {}
        }
    }
}

/// Whether a message is about a gimbal or a camera, whichever component of the vehicle sends it.
#[allow(deprecated, reason = "MOUNT_ORIENTATION, which PX4 sends")]
pub(crate) fn is_of_payload(message: &MavMessage) -> bool {
    use MavMessage as M;
    match message {
        M::HEARTBEAT(beat) => beat.mavtype == MavType::MAV_TYPE_CAMERA,
        M::GIMBAL_MANAGER_INFORMATION(_)
        | M::GIMBAL_MANAGER_STATUS(_)
        | M::GIMBAL_DEVICE_ATTITUDE_STATUS(_)
        | M::MOUNT_ORIENTATION(_)
        | M::CAMERA_INFORMATION(_)
        | M::CAMERA_SETTINGS(_)
        | M::CAMERA_CAPTURE_STATUS(_)
        | M::CAMERA_FOV_STATUS(_)
        | M::STORAGE_INFORMATION(_)
        | M::VIDEO_STREAM_INFORMATION(_)
        | M::VIDEO_STREAM_STATUS(_) => true,
        _ => false,
    }
}

/// Tracks the vehicle's time since boot. If it goes back, the vehicle has rebooted.
fn has_restarted(message: &MavMessage, vehicle: &mut VehicleState) -> bool {
    // Both are requested at 5 Hz, so the first one reveals a reboot.
    let boot_ms = match message {
        MavMessage::ATTITUDE(m) => m.time_boot_ms,
        MavMessage::GLOBAL_POSITION_INT(m) => m.time_boot_ms,
        _ => return false,
    };
    // Frames on one link may arrive slightly out of order.
    let earlier = vehicle
        .boot_ms
        .is_some_and(|before| boot_ms.saturating_add(BOOT_SLACK_MS) < before);
    vehicle.boot_ms = Some(boot_ms);
    earlier
}

const BOOT_SLACK_MS: u32 = 1_000;
