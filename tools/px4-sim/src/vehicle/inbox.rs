//! Messages in: what the vehicle does with each.

#![allow(
    deprecated,
    reason = "PX4 still uses messages that MAVLink has replaced"
)]

use mavlink::dialects::development as mav;
use mavlink::dialects::development::{
    MavAutopilot, MavMessage, MavMissionResult, MavMissionType, MavType, PING_DATA, TIMESYNC_DATA,
};
use mavlink::{MavlinkVersion, Message as _, MessageData as _};
use mavlink_link::service::Node;

use super::command::{Command, is_for};
use super::operator::changes_state;
use super::state::{ClockFault, Outgoing, Vehicle};
use crate::config::Param;
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
                    self.decide(|commander, _, notes| commander.ground_station(now, notes));
                }
            }
            M::COMMAND_LONG(m) => self.queue_command(Command::from_long(m, from)),
            M::COMMAND_INT(m) => self.queue_command(Command::from_int(m, from)),
            // As PX4's receiver does, SET_MODE becomes DO_SET_MODE, and so is answered by a COMMAND_ACK for 176.
            M::SET_MODE(m) if m.target_system == own.system => {
                let [_, _, main, sub] = m.custom_mode.to_le_bytes();
                self.queue_command(Command {
                    id: 176,
                    params: [m.base_mode.bits(), main, sub, 0, 0, 0, 0].map(f64::from),
                    target: own,
                    from,
                    garbled: false,
                });
            }
            M::GIMBAL_MANAGER_SET_ATTITUDE(m) => self.payloads.set_attitude(from, m, own.system),
            M::GIMBAL_MANAGER_SET_PITCHYAW(m) => self.payloads.set_pitch_yaw(from, m, own.system),
            M::MANUAL_CONTROL(m) if [0, own.system].contains(&m.target) => {
                // ManualControlSelector: 0 takes those of a remote control alone, 4 none.
                if !matches!(self.params.int(Param::COM_RC_IN_MODE), 0 | 4) {
                    self.sticks = Sticks::new(m);
                    self.commander.sticks(now, self.sticks.gesture());
                    let moved = self.movement.take(now, self.sticks, &self.params);
                    self.give_way_to_sticks(moved);
                }
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
            M::REQUEST_EVENT(m) if is_for(own, m.target_system, m.target_component) => {
                let mut answers = Vec::new();
                self.texts
                    .events
                    .request(from, m, |answer| answers.push(answer));
                answers.into_iter().for_each(|answer| self.send(answer));
            }
            M::TERRAIN_DATA(m) => {
                if let Some(grid) = &mut self.ground {
                    grid.take(m);
                }
            }
            M::PING(m) if m.target_system == 0 && m.target_component == 0 => {
                self.send(M::PING(PING_DATA {
                    target_system: from.system,
                    target_component: from.component,
                    ..m.clone()
                }));
            }
            M::TIMESYNC(m) if m.tc1 == 0 && self.health_faults.clock != ClockFault::Silent => {
                let ahead_ms = match self.health_faults.clock {
                    ClockFault::AheadMs(ahead_ms) => i64::from(ahead_ms),
                    ClockFault::None | ClockFault::Silent => 0,
                };
                let tc1 = (self.boot_us() as i64 + ahead_ms * 1000) * 1000;
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
                } else if self.ftp.handle_message(now, from, message) {
                    while let Some(answer) = self.ftp.poll_transmit() {
                        self.send(answer);
                    }
                }
            }
        }
    }

    /// Handles a message that the dialect's structs refuse because one of its enums lacks a value. PX4 answers some
    /// of them (an unknown command is UNSUPPORTED), so they cannot be dropped earlier; the rest is dropped, as by
    /// PX4.
    pub fn handle_raw(&mut self, from: Node, id: u32, payload: &[u8]) {
        match id {
            mav::COMMAND_LONG_DATA::ID => {
                self.queue_command(Command::from_long_payload(payload, from))
            }
            mav::COMMAND_INT_DATA::ID => {
                self.queue_command(Command::from_int_payload(payload, from))
            }
            mav::MISSION_ITEM_INT_DATA::ID => self.handle_odd_item(from, payload),
            mav::MISSION_COUNT_DATA::ID => self.refuse_plan_kind(from, payload),
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

    /// An item with a command or frame beyond the dialect is refused like one that PX4 does not accept: as NAV_LAST,
    /// or in a local frame.
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
            if let Ok(message) =
                MavMessage::parse(MavlinkVersion::V2, mav::MISSION_ITEM_INT_DATA::ID, &changed)
            {
                self.handle_message(from, &message);
                return;
            }
        }
    }

    /// A count of a plan of an unknown kind: PX4 answers NO_SPACE.
    fn refuse_plan_kind(&mut self, from: Node, payload: &[u8]) {
        let at = |i: usize| payload.get(i).copied().unwrap_or(0);
        let kind = at(4);
        if !self.node().is_target(at(2), at(3)) {
            return;
        }
        debug_assert!(kind > MavMissionType::MAV_MISSION_TYPE_RALLY as u8);
        let result = MavMissionResult::MAV_MISSION_NO_SPACE as u8;
        let payload = vec![from.system, from.component, result, kind, 0, 0, 0, 0];
        self.out.push_back(Outgoing::Raw {
            id: mav::MISSION_ACK_DATA::ID,
            payload,
        });
    }
}

/// MAV_CMD_NAV_LAST: not a command.
const NAV_LAST: u8 = 95;
/// MAV_FRAME_LOCAL_NED.
const LOCAL_NED: u8 = 1;
