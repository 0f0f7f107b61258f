//! Commands: the effect of each, and its answer.
//!
//! The numbers are those of MAV_CMD; the answers were observed on PX4 v1.18.

use mavlink::dialects::development as mav;
use mavlink::dialects::development::{MavMessage, MavSeverity};
use mavlink::{MavlinkVersion, Message as _, MessageData as _};
use mavlink_link::service::Node;
use mavlink_link::service::mission::Item;

use super::actions;
use super::command::{Answer, Command, REQUEST_OPERATOR_CONTROL, is_for};
use super::state::{Outgoing, Vehicle};
use crate::config::{Airframe, Param};
use crate::flight::mode::{Mode, UnknownMode};
use crate::flight::navigator::Reposition;
use crate::payload::gimbal;
use crate::physics::motion::{Geodetic, Ned};
use crate::physics::trajectory::Circle;
use crate::services::mission_rules::{Airframe as ParamUse, first_unused_param_set};

impl Vehicle {
    /// Queues a command. If the queue is full, the oldest one is lost without an answer. As observed, of 200 commands
    /// back to back most get no acknowledgement, so a bridge must keep one command outstanding and retry.
    pub(crate) fn queue_command(&mut self, command: Command) {
        let own = self.node();
        let Node { system, component } = command.target;
        // PX4 ignores a command from its own system and component.
        if system == own.system && component != 0 && component != own.component {
            return self.execute_by_component(&command);
        }
        if !is_for(own, system, component) || command.from == own {
            self.counters.commands_ignored += 1;
            return;
        }
        if self.commands.len() >= QUEUE {
            self.commands.pop_front();
            self.counters.commands_lost += 1;
        }
        self.commands.push_back(command);
    }

    pub(crate) fn execute(&mut self, command: &Command) {
        let answer = if command.garbled || self.sets_unused(command) {
            Some(Answer::Denied)
        } else if let Some(refused) = self.operator.refuse(command) {
            Some(refused)
        } else {
            self.carry_out(command)
        };
        match answer {
            Some(answer) => {
                if answer == Answer::Accepted {
                    self.counters.commands_accepted += 1;
                } else {
                    self.counters.commands_refused += 1;
                }
                self.acknowledge(command, answer);
            }
            None => self.counters.commands_ignored += 1,
        }
    }

    /// A parameter that PX4 does not use must be NaN or 0.
    fn sets_unused(&self, command: &Command) -> bool {
        let airframe = match self.config.airframe {
            Airframe::Quad => ParamUse::RotaryWing,
            Airframe::Plane => ParamUse::FixedWing,
            Airframe::Vtol => ParamUse::Vtol,
        };
        first_unused_param_set(
            command.id,
            false,
            airframe,
            command.params.map(|p| p as f32),
        )
        .is_some()
    }

    /// PX4 forwards commands for another component of its vehicle, and that component answers.
    fn execute_by_component(&mut self, command: &Command) {
        let carrier = self.carrier();
        let Some((answer, sent)) = self.payloads.execute(command, &carrier) else {
            self.counters.commands_ignored += 1;
            return;
        };
        self.acknowledge_by(command.target.component, command, answer);
        self.send_of_components(sent);
    }

    /// A mission item for a gimbal or a camera, as PX4's navigator publishes it: a command of the autopilot to itself, or to the
    /// camera that param1 names, 0 being the first (mission_block.cpp, issue_command; navigator_main.cpp,
    /// publish_vehicle_command).
    pub(crate) fn order_by_item(&mut self, item: &Item) {
        let [p1, p2, p3, p4] = item.params.map(f64::from);
        let own = self.node();
        let mut command = Command {
            id: item.command,
            params: [p1, p2, p3, p4, item.x.into(), item.y.into(), item.z.into()],
            target: own,
            from: own,
            garbled: false,
        };
        match item.command {
            gimbal::SET_ROI_LOCATION => {
                command.params[4] /= 1e7;
                command.params[5] /= 1e7;
                if matches!(item.frame, 3 | 6) {
                    command.params[6] += self.frame.origin().altitude_m - self.home_or_zero().d;
                }
                let placed = gimbal::place(&command, &self.carrier());
                self.payloads.execute_by_px4(&placed);
            }
            gimbal::CONFIGURE | gimbal::PITCHYAW | gimbal::SET_ROI_NONE => {
                self.payloads.execute_by_px4(&command);
            }
            // A single picture needs a number, which the camera trigger gives.
            actions::IMAGE_START_CAPTURE if p3 == 1.0 => self.trigger_camera(),
            SET_CAMERA_MODE
            | SET_CAMERA_SOURCE
            | actions::IMAGE_START_CAPTURE
            | actions::IMAGE_STOP_CAPTURE => {
                let camera = if p1 > 0.0 { p1 as u8 } else { FIRST_CAMERA };
                self.command_camera(camera, command);
            }
            actions::VIDEO_START_CAPTURE | actions::VIDEO_STOP_CAPTURE => {
                self.command_camera(FIRST_CAMERA, command);
            }
            _ => {}
        }
    }

    /// Sends the camera trigger's pulses since this count.
    pub(crate) fn trigger_cameras_since(&mut self, before: u32) {
        for _ in before..self.actions.triggers {
            self.trigger_camera();
        }
    }

    /// A pulse of the camera trigger, whose default interface is MAVLink (TRIG_INTERFACE 4): one picture
    /// (streams/CAMERA_TRIGGER.hpp).
    fn trigger_camera(&mut self) {
        let own = self.node();
        let command = Command {
            id: actions::IMAGE_START_CAPTURE,
            params: [0.0, 0.0, 1.0, 0.0, f64::NAN, f64::NAN, f64::NAN],
            target: own,
            from: own,
            garbled: false,
        };
        self.command_camera(FIRST_CAMERA, command);
    }

    /// A command of the autopilot itself to a camera. Its acknowledgement goes to the autopilot only.
    fn command_camera(&mut self, camera: u8, command: Command) {
        let target = Node::new(self.node().system, camera);
        let carrier = self.carrier();
        let command = Command { target, ..command };
        if let Some((_, sent)) = self.payloads.execute(&command, &carrier) {
            self.send_of_components(sent);
        }
    }

    fn acknowledge(&mut self, command: &Command, answer: Answer) {
        self.acknowledge_by(self.node().component, command, answer);
    }

    fn acknowledge_by(&mut self, component: u8, command: &Command, answer: Answer) {
        let mut payload = vec![0; 10];
        payload[..2].copy_from_slice(&command.id.to_le_bytes());
        payload[2] = answer as u8;
        payload[8] = command.from.system;
        payload[9] = command.from.component;
        // The dialect's struct if it knows the command; PX4 acknowledges unknown ones too.
        match MavMessage::parse(MavlinkVersion::V2, mav::COMMAND_ACK_DATA::ID, &payload) {
            Ok(message) if component == self.node().component => self.send(message),
            Ok(message) => self.send_of_components(vec![(component, message)]),
            Err(_) => self.out.push_back(Outgoing::Raw {
                id: mav::COMMAND_ACK_DATA::ID,
                payload,
            }),
        }
    }

    fn carry_out(&mut self, c: &Command) -> Option<Answer> {
        Some(match c.id {
            20 => self.switch(Mode::Rtl, Some("Returning to launch")),
            21 => self.force_land(),
            22 => self.take_off(c),
            34 => self.orbit(c),
            35 => self.figure_eight(c),
            84 => self.vtol_take_off(c),
            176 => self.set_mode(c),
            178 => self.change_speed(c),
            179 => self.set_home_here(c),
            185 => self.terminate(c),
            186 => self.change_altitude(c),
            191 => self.go_around(),
            192 => self.reposition(c),
            // Regions of interest, camera triggers and the like are accepted, but have no effect here.
            195 if self.config.payloads > 0 => {
                let placed = gimbal::place(c, &self.carrier());
                let pointed = self.payloads.execute_by_px4(&placed);
                pointed.unwrap_or(Answer::Accepted)
            }
            197 if self.config.payloads > 0 => {
                let pointed = self.payloads.execute_by_px4(c);
                pointed.unwrap_or(Answer::Accepted)
            }
            80 | 189 | 195 | 196 | 197 | 201 | 206 | 211 | 214 | 530..=532 => Answer::Accepted,
            // A board would accept a reboot; a simulator process cannot reboot.
            246 => Answer::accepted_or(Answer::Denied, c.param(1) == 0.0),
            262 => match Mode::from_standard(c.param(1) as u32) {
                Some(mode) => self.switch(mode, None),
                None => Answer::Denied,
            },
            300 => self.start_mission(c),
            400 => self.arm_or_disarm(c),
            401 => Answer::Accepted,
            // Nothing in PX4 handles them in these states, so nothing answers (recording 07).
            3000 if self.config.airframe != Airframe::Vtol => return None,
            43_002 if !self.commander.is_armed() => return None,
            3000 => self.transition(c),
            43_002 => self.change_course(c),
            410 => self.request_message(mav::HOME_POSITION_DATA::ID, c),
            510 => self.get_interval(c),
            511 => {
                let now = self.now();
                let message = (c.param(1) + 0.5) as i64;
                let set = self.streams.set(message, c.param(2) as f32, now);
                Answer::accepted_or(Answer::Failed, set)
            }
            512 => self.request_message((c.param(1).round()).clamp(0.0, 1e7) as u32, c),
            REQUEST_OPERATOR_CONTROL => {
                let (answer, forwarded) = self.operator.request(c, self.now());
                forwarded.into_iter().for_each(|message| self.send(message));
                answer
            }
            // Gimbal and camera commands: without such a device PX4 sends no acknowledgement at all.
            gimbal::PITCHYAW | gimbal::CONFIGURE => return self.payloads.execute_by_px4(c),
            203 | 205 => return None,
            _ => Answer::Unsupported,
        })
    }

    /// Requests a mode from the commander; `text` is sent on success.
    pub(crate) fn switch(&mut self, mode: Mode, text: Option<&str>) -> Answer {
        if self.request(mode, false) {
            if let Some(text) = text {
                self.info(text);
            }
            Answer::Accepted
        } else {
            self.unavailable(mode)
        }
    }

    fn unavailable(&mut self, mode: Mode) -> Answer {
        let title = mode.title();
        self.critical(&format!("Switching to {title} is currently not available"));
        Answer::TemporarilyRejected
    }

    pub(crate) fn request(&mut self, mode: Mode, force: bool) -> bool {
        self.decide(|commander, facts, _| commander.request(mode, force, facts))
    }

    fn info(&mut self, text: &str) {
        self.texts
            .queue(MavSeverity::MAV_SEVERITY_INFO, format!("{text}\t"));
    }

    /// NAV_LAND is accepted in every state, flyable or not.
    fn force_land(&mut self) -> Answer {
        self.request(Mode::Land, true);
        self.info("Landing at current position");
        Answer::Accepted
    }

    fn take_off(&mut self, c: &Command) -> Answer {
        let place = c.given(5).zip(c.given(6));
        let place = place.map(|_| self.local_target_of(c));
        self.navigator.set_takeoff(c.given(7), place);
        self.switch(Mode::Takeoff, None)
    }

    fn set_mode(&mut self, c: &Command) -> Answer {
        let whole = |v: f64| if v.is_finite() { v as i64 as u8 } else { 0 };
        let (base, main, sub) = (whole(c.param(1)), whole(c.param(2)), whole(c.param(3)));
        let mode = if base & 1 == 0 {
            match base {
                b if b & 4 != 0 => Ok(Mode::Mission),
                b if b & 64 != 0 && b & 8 != 0 => Ok(Mode::PosCtl),
                b if b & 64 != 0 && b & 16 != 0 => Ok(Mode::Stabilized),
                b if b & 64 != 0 => Ok(Mode::Manual),
                _ => Err("Unsupported base mode"),
            }
        } else {
            Mode::from_main_sub(main, sub).map_err(|unknown| match unknown {
                UnknownMode::Main => "Unsupported main mode",
                UnknownMode::Auto => "Unsupported auto mode",
            })
        };
        let mode = mode.map(|mode| self.health_faults.instead.take().unwrap_or(mode));
        match mode {
            Ok(mode) if self.request(mode, mode == Mode::Land) => Answer::Accepted,
            Ok(mode) => {
                // PX4 sends the reason only to component 190, a mission planner.
                if c.from.component == 190 {
                    self.unavailable(mode);
                }
                Answer::TemporarilyRejected
            }
            Err(text) => {
                self.critical(text);
                Answer::TemporarilyRejected
            }
        }
    }

    fn arm_or_disarm(&mut self, c: &Command) -> Answer {
        let was_armed = self.commander.is_armed();
        // Force does not skip the checks for a command from outside.
        let done = self.decide(|commander, facts, notes| match c.param(1).round() as i64 {
            1 => Some(commander.arm("external command", facts, notes)),
            0 => {
                let force = c.param(2).round() as i64 == FORCE;
                Some(commander.disarm("external command", force, facts, notes))
            }
            _ => None,
        });
        if !was_armed && self.commander.is_armed() {
            self.set_home();
        }
        match done {
            Some(true) => Answer::Accepted,
            Some(false) => Answer::TemporarilyRejected,
            None => {
                self.critical(&format!("Unsupported ARM_DISARM param: {:.3}", c.param(1)));
                Answer::Unsupported
            }
        }
    }

    fn start_mission(&mut self, c: &Command) -> Answer {
        if !self.navigator.mission.is_valid() {
            self.critical("Mission start denied! No valid mission");
            return Answer::Denied;
        }
        let Some(first) = c
            .given(1)
            .filter(|i| *i >= -1.0 && *i < self.navigator.mission.count() as f64)
        else {
            return Answer::Denied;
        };
        if first >= 0.0 {
            let active = self.commander.is_armed() && self.commander.mode() == Mode::Mission;
            // A mission starts at item 0 anyway; only another first item has to be set.
            if first as usize != self.navigator.mission.index() {
                self.navigate(|nav, view, notes| {
                    nav.mission.select(first as usize, active, view, notes);
                });
            }
        }
        let was_armed = self.commander.is_armed();
        let done = self.decide(|commander, facts, notes| {
            commander.request(Mode::Mission, false, facts)
                && commander.arm("mission start", facts, notes)
        });
        if !done {
            return self.unavailable(Mode::Mission);
        }
        if !was_armed {
            self.set_home();
        }
        Answer::Accepted
    }

    fn get_interval(&mut self, c: &Command) -> Answer {
        let message = (c.param(1) + 0.5) as u32;
        self.send_interval(message);
        Answer::Accepted
    }

    fn send_interval(&mut self, message: u32) {
        self.send(MavMessage::MESSAGE_INTERVAL(mav::MESSAGE_INTERVAL_DATA {
            interval_us: self.streams.interval_us(message),
            message_id: message as u16,
        }));
    }

    fn request_message(&mut self, message: u32, c: &Command) -> Answer {
        match message {
            mav::MESSAGE_INTERVAL_DATA::ID => {
                self.send_interval((c.param(2) + 0.5) as u32);
                Answer::Accepted
            }
            mav::AVAILABLE_MODES_DATA::ID => {
                let requested = c.param(2) as u8;
                let indices = if requested == 0 {
                    1..=u8::MAX
                } else {
                    requested..=requested
                };
                let modes: Vec<_> = indices.map_while(|i| self.available_mode(i)).collect();
                let answer = Answer::accepted_or(Answer::Denied, !modes.is_empty());
                modes.into_iter().for_each(|m| self.send(m));
                answer
            }
            _ => match self.report(message) {
                Some(report) => {
                    self.send(report);
                    Answer::Accepted
                }
                // Known, but without a value yet.
                None if self.streams.knows(message) => Answer::Accepted,
                None => Answer::Denied,
            },
        }
    }

    pub(crate) fn reposition(&mut self, c: &Command) -> Answer {
        let change_mode = c.param(2) as i64 & 1 == 1;
        let holding = self.commander.mode() == Mode::Loiter;
        let target = self.local_target_of(c);
        // Without a position the course is kept, with the new altitude and speed.
        if change_mode && self.commander.mode() == Mode::Course && !target.n.is_finite() {
            if c.given(1).is_some_and(|speed| speed > 0.0) {
                self.navigator.set_speed(c.given(1));
            }
            if target.d.is_finite() {
                self.navigator.set_course_height(target.d);
            }
            return Answer::Accepted;
        }
        let winged = self.body.flown_as() == Airframe::Plane;
        if holding && winged && !target.n.is_finite() && target.d.is_finite() {
            // The loiter is kept, an eight too.
            let kept = self.navigator.kept_loiter();
            self.hold_at(Reposition {
                target: Ned {
                    d: target.d,
                    ..kept.target
                },
                ..kept
            });
            return Answer::Accepted;
        }
        let answer = if change_mode {
            self.switch(Mode::Loiter, None)
        } else {
            Answer::accepted_or(Answer::Denied, holding)
        };
        if answer == Answer::Accepted {
            self.hold_at(Reposition {
                target,
                yaw: c.param(4),
                speed: c.given(1).filter(|s| *s > 0.0),
                radius: c.given(3).filter(|r| r.abs() > 1e-6),
                eight: None,
            });
        }
        answer
    }

    /// While disarmed the target is not kept: a later switch to hold must not fly there.
    fn hold_at(&mut self, reposition: Reposition) {
        if self.commander.is_armed() {
            self.navigate(|nav, view, _| nav.set_reposition(reposition, view));
        }
    }

    pub(crate) fn change_altitude(&mut self, c: &Command) -> Answer {
        let d = self.frame.origin().altitude_m - c.param(1);
        if self.commander.mode() == Mode::Course {
            self.navigator.set_course_height(d);
            return Answer::Accepted;
        }
        if self.commander.mode() != Mode::Loiter {
            return Answer::TemporarilyRejected;
        }
        let kept = self.navigator.kept_loiter();
        // PX4 takes over the radius, which of an eight is half its length, and not the pattern.
        self.hold_at(Reposition {
            target: Ned { d, ..kept.target },
            radius: kept.eight.map(|[half, ..]| half).or(kept.radius),
            eight: None,
            ..kept
        });
        Answer::Accepted
    }

    pub(crate) fn orbit(&mut self, c: &Command) -> Answer {
        if self.body.flown_as() == Airframe::Plane {
            if !self.request(Mode::Loiter, false) {
                self.critical("Orbit command rejected");
                return Answer::TemporarilyRejected;
            }
            self.hold_at(Reposition {
                radius: c.given(1),
                ..Reposition::to(self.local_target_of(c))
            });
            return Answer::Accepted;
        }
        // On a circle, what is not given stays (FlightTaskOrbit::applyCommandParameters).
        let flown = (self.navigator.orbit()).filter(|_| self.commander.mode() == Mode::Orbit);
        if !self.request(Mode::Orbit, false) {
            self.texts
                .queue(MavSeverity::MAV_SEVERITY_CRITICAL, "Orbit command rejected");
            return Answer::TemporarilyRejected;
        }
        let target = self.local_target_of(c);
        let radius = c.given(1).unwrap_or(1.0);
        if !(1.0..=1000.0).contains(&radius.abs()) {
            self.critical("Orbit radius limit exceeded");
            return Answer::Accepted;
        }
        // Limited to 2 m/s2 toward the centre.
        let requested = c.given(2).unwrap_or(1.0);
        let speed = requested.abs().min((2.0 * radius.abs()).sqrt());
        self.navigator.set_orbit(Circle {
            centre: target.or(flown.map_or(self.believed(), |circle| circle.centre)),
            radius: if requested < 0.0 { -radius } else { radius },
            speed,
        });
        Answer::Accepted
    }

    /// On wings only: PX4 has no figure eight for a multicopter.
    pub(crate) fn figure_eight(&mut self, c: &Command) -> Answer {
        if self.config.airframe == Airframe::Quad {
            self.critical("Figure 8 command only available for fixed wing and vtol vehicles.");
            return Answer::Unsupported;
        }
        if self.body.flown_as() != Airframe::Plane || !self.request(Mode::Loiter, false) {
            self.critical("Figure 8 command rejected, Only available in fixed wing mode.");
            return Answer::TemporarilyRejected;
        }
        let own = self.params.get(Param::NAV_LOITER_RAD).abs();
        let minor = c.given(2).filter(|r| r.abs() > 1e-6).map_or(own, f64::abs);
        let major = c.given(1).map_or(2.5 * minor, f64::abs).max(2.0 * minor);
        self.hold_at(Reposition {
            eight: Some([major, minor, c.given(4).unwrap_or(0.0)]),
            ..Reposition::to(self.local_target_of(c))
        });
        Answer::Accepted
    }

    fn vtol_take_off(&mut self, c: &Command) -> Answer {
        self.navigator
            .set_vtol_takeoff(c.given(7), self.local_target_of(c));
        self.switch(Mode::VtolTakeoff, None)
    }

    /// As in PX4, the answer does not depend on whether a transition begins.
    fn transition(&mut self, c: &Command) -> Answer {
        // On the ground it stays a multicopter.
        if !self.landed {
            self.body.turn(c.param(1).round() as i64 == WINGS);
        }
        Answer::Accepted
    }

    /// PX4 denies it in every other mode, for a heading, and for a vehicle that is not on wings.
    fn change_course(&mut self, c: &Command) -> Answer {
        let may = self.body.flown_as() == Airframe::Plane
            && self.commander.mode() == Mode::Course
            && c.param(1).round() == 0.0;
        match c.given(2).filter(|_| may) {
            Some(degrees) => {
                self.navigator.set_course(degrees.to_radians());
                Answer::Accepted
            }
            None => Answer::Denied,
        }
    }

    /// Accepted in every state; it ends the glide of a wing, which then loiters above the touch-down.
    fn go_around(&mut self) -> Answer {
        let loiter = self.navigate(|nav, view, _| nav.mission.abort_landing(view));
        if let Some(at) = loiter.filter(|_| self.commander.mode() == Mode::Mission)
            && self.request(Mode::Loiter, false)
        {
            self.hold_at(Reposition::to(at));
        }
        Answer::Accepted
    }

    /// param5 to param7 in the local frame, NaN where absent. The altitude is AMSL, whatever frame a COMMAND_INT
    /// names.
    pub(crate) fn local_target_of(&self, c: &Command) -> Ned {
        let d = self.frame.origin().altitude_m - c.param(7);
        match (c.given(5), c.given(6)) {
            (Some(latitude), Some(longitude)) => {
                let at = Geodetic::new(latitude, longitude, 0.0);
                Ned {
                    d,
                    ..self.frame.to_local(at)
                }
            }
            _ => Ned::new(f64::NAN, f64::NAN, d),
        }
    }

    pub(crate) fn change_speed(&mut self, c: &Command) -> Answer {
        let speed = c.given(2).filter(|s| *s > 0.0);
        self.navigator.set_speed(speed);
        Answer::Accepted
    }

    pub(crate) fn set_home_here(&mut self, c: &Command) -> Answer {
        if c.param(1) > 0.5 {
            self.set_home();
            return Answer::Accepted;
        }
        match (c.given(5), c.given(6), c.given(7)) {
            (Some(latitude), Some(longitude), Some(altitude)) => {
                self.set_home();
                let home = Geodetic::new(latitude, longitude, altitude);
                self.home = Some(self.frame.to_local(home));
                Answer::Accepted
            }
            _ => Answer::Denied,
        }
    }

    pub(crate) fn terminate(&mut self, c: &Command) -> Answer {
        // CBRK_FLIGHTTERM is ignored: it disables PX4's own failure detector only. A param1 of 0 does not end a
        // termination.
        if c.param(1) <= 0.5 || !self.commander.is_armed() {
            return Answer::Denied;
        }
        // A repetition is rejected once terminated, so a ground station must read HEARTBEAT.
        let done = self.request(Mode::Termination, false);
        Answer::accepted_or(Answer::TemporarilyRejected, done)
    }
}

const SET_CAMERA_MODE: u16 = 530;
const SET_CAMERA_SOURCE: u16 = 534;
/// MAV_COMP_ID_CAMERA.
const FIRST_CAMERA: u8 = 100;
/// Commands that wait for the commander at most: the depth of PX4's queue.
const QUEUE: usize = 8;
/// COMPONENT_ARM_DISARM.param2: forced, even in the air.
const FORCE: i64 = 21196;
/// DO_VTOL_TRANSITION.param1: MAV_VTOL_STATE_FW.
const WINGS: i64 = 4;
