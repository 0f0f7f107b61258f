//! Messages in: what the vehicle does with each.

#![allow(
    deprecated,
    reason = "PX4 still uses messages that MAVLink has replaced"
)]

use mavlink::dialects::development::{
    MavAutopilot, MavMessage, MavMissionResult, MavMissionType, MavType, PING_DATA, TIMESYNC_DATA,
};
use mavlink::{MavlinkVersion, Message as _};
use mavlink_link::service::Node;

use super::command::Command;
use super::operator::changes_state;
use super::state::{Outgoing, Vehicle};
use crate::flight::steering::{Setpoint, Sticks};

impl Vehicle {
    /// Handles a message from `from`.
    pub fn handle_message(&mut self, from: Node, message: &MavMessage) {
        use MavMessage as M;
        let own = self.node();
        let now = self.now();
        if changes_state(message) && !self.operator.obeys(from) {
            self.counters.commands_ignored += 1;
            return;
        }
        match message {
            M::HEARTBEAT(m) => {
                self.operator.heartbeat(from, now);
                let ground = m.mavtype == MavType::MAV_TYPE_GCS
                    || m.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID && from.component == 190;
                if ground && from.system != own.system {
                    let mut notes = Vec::new();
                    self.commander.ground_station(now, &mut notes);
                    self.take_notes(notes);
                }
            }
            M::COMMAND_LONG(m) => self.queue_command(Command::from_long(m, from)),
            M::COMMAND_INT(m) => self.queue_command(Command::from_int(m, from)),
            M::SET_MODE(m) if m.target_system == own.system => {
                let [_, _, main, sub] = m.custom_mode.to_le_bytes();
                let params = [
                    f64::from(m.base_mode.bits()),
                    f64::from(main),
                    f64::from(sub),
                ];
                self.queue_command(Command {
                    id: 176,
                    params: [params[0], params[1], params[2], 0.0, 0.0, 0.0, 0.0],
                    target: own,
                    from,
                    garbled: false,
                });
            }
            M::MANUAL_CONTROL(m) if m.target == own.system => {
                self.sticks = Sticks::new(m);
                self.commander.sticks(now);
            }
            M::SET_POSITION_TARGET_LOCAL_NED(m)
                if is_for(own, m.target_system, m.target_component) =>
            {
                let yaw = self.body.motion().attitude[2];
                self.take_setpoint(Setpoint::from_local(m, yaw));
            }
            M::SET_POSITION_TARGET_GLOBAL_INT(m)
                if is_for(own, m.target_system, m.target_component) =>
            {
                let setpoint = Setpoint::from_global(m, &self.frame, self.home_or_zero());
                self.take_setpoint(setpoint);
            }
            M::PING(m) if m.target_system == 0 && m.target_component == 0 => {
                self.send(M::PING(PING_DATA {
                    target_system: from.system,
                    target_component: from.component,
                    ..m.clone()
                }));
            }
            M::TIMESYNC(m) if m.tc1 == 0 => {
                let tc1 = self.boot_us() as i64 * 1000;
                self.send(M::TIMESYNC(TIMESYNC_DATA {
                    tc1,
                    ts1: m.ts1,
                    target_system: from.system,
                    target_component: from.component,
                }));
            }
            _ => {
                let now = self.now_duration();
                if self.missions.handle_message(now, from, message)
                    || self.param_service.handle_message(now, from, message)
                {
                    self.drain_services();
                }
            }
        }
    }

    /// Handles a message that the dialect's structs refuse because one of its enums does not know a value. PX4 answers some of
    /// them (an unknown command is UNSUPPORTED), so they cannot be dropped before; the rest is dropped, as by PX4.
    pub fn handle_raw(&mut self, from: Node, id: u32, payload: &[u8]) {
        match id {
            COMMAND_LONG => self.queue_command(Command::from_long_payload(payload, from)),
            COMMAND_INT => self.queue_command(Command::from_int_payload(payload, from)),
            MISSION_ITEM_INT => self.handle_odd_item(from, payload),
            MISSION_COUNT | MISSION_REQUEST_LIST | MISSION_CLEAR_ALL => {
                self.refuse_plan_kind(from, id, payload)
            }
            _ => {}
        }
    }

    fn take_setpoint(&mut self, setpoint: Option<Setpoint>) {
        if let Some(setpoint) = setpoint {
            self.setpoint = Some(setpoint);
            let now = self.now();
            self.commander.setpoint(now);
        }
    }

    /// An item with a command or frame beyond the dialect is refused like one that PX4 does not
    /// take: as NAV_LAST, or in a local frame.
    fn handle_odd_item(&mut self, from: Node, payload: &[u8]) {
        let mut bytes = [0; 38];
        let len = payload.len().min(bytes.len());
        bytes[..len].copy_from_slice(&payload[..len]);
        for (at, value) in [(30, NAV_LAST), (34, LOCAL_NED)] {
            let mut changed = bytes;
            changed[at] = value;
            if at == 30 {
                changed[31] = 0;
            }
            if let Ok(message) = MavMessage::parse(MavlinkVersion::V2, MISSION_ITEM_INT, &changed) {
                self.handle_message(from, &message);
                return;
            }
        }
    }

    /// Plans of an unknown kind: PX4 answers NO_SPACE.
    fn refuse_plan_kind(&mut self, from: Node, id: u32, payload: &[u8]) {
        let (target_at, kind_at) = if id == MISSION_COUNT { (2, 4) } else { (0, 2) };
        let at = |i: usize| payload.get(i).copied().unwrap_or(0);
        let target = Node::new(at(target_at), at(target_at + 1));
        if !self.node().is_target(target.system, target.component) || id != MISSION_COUNT {
            return;
        }
        debug_assert!(at(kind_at) > MavMissionType::MAV_MISSION_TYPE_RALLY as u8);
        let result = MavMissionResult::MAV_MISSION_NO_SPACE as u8;
        let payload = vec![from.system, from.component, result, at(kind_at), 0, 0, 0, 0];
        self.out.push_back(Outgoing::Raw {
            id: MISSION_ACK,
            payload,
        });
    }
}

fn is_for(own: Node, system: u8, component: u8) -> bool {
    (system == own.system || system == 0) && (component == own.component || component == 0)
}

const COMMAND_LONG: u32 = 76;
const COMMAND_INT: u32 = 75;
const MISSION_REQUEST_LIST: u32 = 43;
const MISSION_COUNT: u32 = 44;
const MISSION_CLEAR_ALL: u32 = 45;
const MISSION_ACK: u32 = 47;
const MISSION_ITEM_INT: u32 = 73;
/// MAV_CMD_NAV_LAST: no command at all.
const NAV_LAST: u8 = 95;
/// MAV_FRAME_LOCAL_NED.
const LOCAL_NED: u8 = 1;
