//! Sending to the vehicle. Frames are signed at the moment of sending; the timestamps of requests are kept, so that an
//! answer can be distinguished from a replay of an older one.

use std::time::Duration;

use mavlink::Message as _;
use mavlink_link::Now;
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode_raw,
};
use mavlink_link::link::Security;
use mavlink_link::service::command;
use mavlink_link::signing::{Stamp, sign};
use mavlink_link::store::Disk;

use super::budget::answer_bytes;
use super::event::VehicleEvent;
use super::frame::{HEARTBEAT, OutFrame, Peer};
use super::services::Services;
use super::state::VehicleState;
use super::{VehicleLink, auth};
use crate::session::effects::Effects;

impl VehicleLink {
    /// Signs and queues the frames of the link and the services; called after each change of them.
    pub(crate) fn flush(&mut self, vehicle: &mut VehicleState, effects: &mut Effects<'_>) {
        let Effects {
            dli,
            vehicle: services,
            ..
        } = effects;
        self.flush_services(dli.now, vehicle, services, dli.disk);
    }

    pub(super) fn flush_services(
        &mut self,
        now: Now,
        vehicle: &mut VehicleState,
        services: &mut Services,
        store: &mut dyn Disk,
    ) {
        let mut bytes = [0; MAX_FRAME];
        while let Some(sent) =
            self.link
                .poll_transmit(now, auth(self.key.as_mut(), store), &mut bytes)
        {
            self.sent.count(HEARTBEAT);
            self.budget.spend(now.mono, sent.len, 0);
            self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
        while let Some(message) = services.posts.pop_front() {
            self.send(now, &message, store);
        }
        // The operation has ended: answers to the next one are compared with the timestamp of its own first message.
        if services.missions.take_cancelled() || services.missions.busy().is_none() {
            self.asked.mission = None;
        }
        while self.budget.has_room(now.mono)
            && let Some(message) = services.missions.poll_transmit()
        {
            self.budget.take_turn();
            let stamp = self.send(now, &message, store);
            // Keep the first timestamp: the answer to it may arrive after a retry was sent.
            self.asked.mission = self.asked.mission.or(stamp);
        }
        if services.parameters.pending() == 0 {
            self.asked.parameter = None;
        }
        while self.budget.has_room(now.mono)
            && let Some(message) = services.parameters.poll_transmit()
        {
            self.budget.take_turn();
            let stamp = self.send(now, &message, store);
            self.asked.parameter = self.asked.parameter.or(stamp);
        }
        if !services.clock.is_waiting() {
            self.asked.clock = None;
        }
        while let Some(request) = services.clock.poll_transmit() {
            let stamp = self.send(now, &request, store);
            self.asked.clock = self.asked.clock.or(stamp);
        }
        // PX4 loses acknowledgements of commands sent back to back, so only one is outstanding, and the next is sent when it
        // ends.
        loop {
            while let Some(event) = services.commands.poll_event() {
                self.asked.command = None;
                if services.intervals.handle_event(now.mono, &event) {
                    services.intervals.advance(now.mono, &mut services.commands);
                } else {
                    self.events.push_back(VehicleEvent::Command(event));
                }
            }
            let Some(message) = services.commands.poll_transmit() else {
                break;
            };
            let stamp = self.send(now, &message, store);
            self.asked.command = self.asked.command.or(stamp);
            if may_change_state(&message) {
                self.asked.last = stamp.or(self.asked.last);
                vehicle.state_is_newer = false;
            }
        }
        if let Some(request) = self.request_of_round(now, vehicle, services) {
            self.send(now, &request, store);
        }
        // As for the autopilot, separately for each component. None of these commands changes the mode or arms.
        for (component, commands) in &mut services.components {
            loop {
                while let Some(event) = commands.poll_event() {
                    if let command::Event::Done { .. } = event {
                        self.asked_components.remove(component);
                    }
                    let event = VehicleEvent::ComponentCommand(*component, event);
                    self.events.push_back(event);
                }
                if !self.budget.has_room(now.mono) {
                    break;
                }
                let Some(message) = commands.poll_transmit() else {
                    break;
                };
                self.budget.take_turn();
                if let Some(stamp) = self.send(now, &message, store) {
                    self.asked_components.entry(*component).or_insert(stamp);
                }
            }
        }
        while self.budget.has_room(now.mono)
            && let Some(message) = services.events.poll_transmit()
        {
            self.budget.take_turn();
            self.send(now, &message, store);
        }
        if !services.files.is_active() {
            self.asked.file = None;
        }
        // Last: no flight command waits for a file.
        while self.budget.has_room(now.mono)
            && let Some(message) = services.files.poll_transmit()
        {
            self.budget.take_turn();
            let stamp = self.send(now, &message, store);
            self.asked.file = self.asked.file.or(stamp);
        }
    }

    /// The next rate to request without waiting for an answer. PX4's default streams, or an agent that passes on all of them, fill a
    /// slow radio, and HEARTBEATs and answers are lost with the rest: the vehicle would not be live before its rates are lowered, nor
    /// these before it is.
    fn request_of_round(
        &self,
        now: Now,
        vehicle: &VehicleState,
        services: &mut Services,
    ) -> Option<MavMessage> {
        let received = self.live_for(now.mono)?;
        if !self.budget.is_limited() || !self.budget.is_free(now.mono) {
            return None;
        }
        let full = !vehicle.live() && received >= WITHOUT_HEARTBEAT;
        services.intervals.poll_round(now.mono, self.vehicle, full)
    }

    /// Sends the terrain block that is due, to a vehicle that has requested it.
    pub(super) fn send_ground(effects: &mut Effects<'_>) {
        match effects.vehicle.ground.advance(effects.dli.now.mono) {
            Some(Ok(block)) => effects.vehicle.post(block),
            Some(Err(())) => effects
                .dli
                .counters
                .count("terrain asked for beyond vehicle.terrain"),
            None => {}
        }
    }

    fn send(&mut self, now: Now, message: &MavMessage, store: &mut dyn Disk) -> Option<Stamp> {
        let mut bytes = [0; MAX_FRAME];
        // The link counts failures and raises alerts; the service retries or gives up by its own timing.
        let sent = self
            .link
            .send(now, auth(self.key.as_mut(), store), message, &mut bytes)
            .ok()?;
        self.sent.count(message.message_id());
        self.budget.spend(now.mono, sent.len, answer_bytes(message));
        self.queue(now, sent.to, sent.len, bytes);
        sent.stamp
    }

    /// Queues a signed frame; one for the vehicle to everywhere it may be. (What the link itself sends is not among these: its
    /// PINGs ask at one address each.)
    fn queue(&mut self, now: Now, to: Peer, len: usize, bytes: [u8; MAX_FRAME]) {
        self.out.push_back(OutFrame::new(to, len, bytes));
        if self.link.peer() == Some(to) {
            for other in self.link.others(now.mono) {
                self.out.push_back(OutFrame::new(other, len, bytes));
            }
        }
    }

    /// Whether there is room for the frame of another ground station.
    pub(crate) fn has_room(&self, now: Now) -> bool {
        self.budget.is_free(now.mono)
    }

    /// Forwards a frame of another ground station, under that station's ids and signed with the vehicle's key. Returns false
    /// if it cannot be sent now. PX4 answers the sender named in a frame. `link_id`: link id of the signature, if it differs
    /// from the link's own.
    pub(crate) fn pass_on(
        &mut self,
        now: Now,
        frame: &FrameView<'_>,
        link_id: Option<u8>,
        store: &mut dyn Disk,
    ) -> bool {
        let Some(to) = self.link.peer() else {
            return false;
        };
        let link_id = link_id.unwrap_or(self.link.config().link_id);
        let signed = self.key.is_some();
        if !signed && self.link.config().security == Security::Signed {
            return false;
        }
        let incompat = if signed { INCOMPAT_SIGNED } else { 0 };
        let header = Header {
            incompat,
            ..frame.header()
        };
        let mut bytes = [0; MAX_FRAME];
        let Ok(mut length) = encode_raw(header, frame.payload(), &mut bytes) else {
            return false;
        };
        if let Some(key) = &mut self.key {
            let Ok(stamp) = key.take_stamp(now, store) else {
                return false;
            };
            match sign(key.key(), link_id, stamp, &mut bytes, length) {
                Ok(signed) => length = signed,
                Err(_) => return false,
            }
        }
        self.sent.count(header.message_id);
        let answer = frame.message().map_or(0, |message| answer_bytes(&message));
        self.budget.spend(now.mono, length, answer);
        self.queue(now, to, length, bytes);
        true
    }

    /// Sends a KEY_EXCHANGE payload to the vehicle's peer, or to `otherwise` if there is none yet. Returns false if it
    /// cannot be sent now.
    pub(crate) fn send_key_exchange(
        &mut self,
        now: Now,
        payload: &[u8],
        otherwise: Option<Peer>,
        store: &mut dyn Disk,
    ) -> bool {
        let to = self.link.peer().or(otherwise);
        let mut bytes = [0; MAX_FRAME];
        let auth = auth(self.key.as_mut(), store);
        let sent = self
            .link
            .send_raw(now, auth, KEY_EXCHANGE_ID, payload, to, &mut bytes);
        if let Ok(sent) = &sent {
            self.sent.count(KEY_EXCHANGE_ID);
            self.budget.spend(now.mono, sent.len, 0);
            self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
        }
        sent.is_ok()
    }
}

/// Two HEARTBEATs that did not arrive, although other frames do.
const WITHOUT_HEARTBEAT: Duration = Duration::from_secs(2);

/// Whether a command may change the mode, or arm or disarm. Requests for rates, messages and operator control are frequent,
/// and others change a value within a mode (PX4 rejects an altitude or a course in modes that do not use it): such commands
/// do not make an earlier report of the mode stale.
fn may_change_state(command: &MavMessage) -> bool {
    let command = match command {
        MavMessage::COMMAND_LONG(command) => command.command,
        MavMessage::COMMAND_INT(command) => command.command,
        _ => return true,
    };
    !matches!(
        command,
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
            | MavCmd::MAV_CMD_REQUEST_MESSAGE
            | MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL
            | MavCmd::MAV_CMD_DO_CHANGE_SPEED
            | MavCmd::MAV_CMD_DO_CHANGE_ALTITUDE
            | MavCmd::MAV_CMD_GUIDED_CHANGE_HEADING
    )
}
