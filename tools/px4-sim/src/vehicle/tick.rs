//! One step of the vehicle: what happens every 4 ms, and in which order.
//!
//! Commands are executed before the commander's step and the physics after it, so that a mode accepted in a step is flown
//! in the same one; reports come last and show the result.

use std::time::Duration;

use mavlink::MessageData as _;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::MissionState;

use super::reports::mission_mode_active;
use super::state::{DT, TICK, Vehicle};
use crate::config::{Airframe, Param};
use crate::flight::commander::{Commander, boot};
use crate::flight::mode::Mode;
use crate::physics::trajectory::{Guidance, Heading};

impl Vehicle {
    /// Lets time pass. Physics runs in steps of [`TICK`]; a remainder is kept for the next call.
    pub fn step(&mut self, dt: Duration) {
        self.carry += dt;
        while self.carry >= TICK {
            self.carry -= TICK;
            self.tick();
        }
    }

    fn tick(&mut self) {
        self.ticks += 1;
        let now = self.now();
        if self.ticks.is_multiple_of(ESTIMATOR_EVERY) {
            self.estimator.step(DT * ESTIMATOR_EVERY as f64);
        }
        if self.home.is_none() && now >= boot::HOME {
            self.set_home();
        }
        if self.ticks.is_multiple_of(COMMANDS_EVERY) {
            while let Some(command) = self.commands.pop_front() {
                self.execute(&command);
            }
        }
        self.command();
        self.fly(now);
        self.detect_ground(now);
        if self.gimbal_centred_at.take_if(|at| now >= *at).is_some() {
            self.payloads.centre();
        }
        if self.config.payloads > 0 && self.ticks.is_multiple_of(PAYLOADS_EVERY) {
            let carrier = self.carrier();
            let sent = self.payloads.step(DT * PAYLOADS_EVERY as f64, &carrier);
            self.send_of_components(sent);
        }
        let before = self.actions.triggers;
        self.actions.step(now, self.body.motion().position);
        self.trigger_cameras_since(before);
        self.serve();
        for message in self
            .ground
            .iter_mut()
            .flat_map(|grid| grid.due(now))
            .collect::<Vec<_>>()
        {
            self.send(message);
        }
        self.report_due(now);
    }

    fn command(&mut self) {
        let now = self.now();
        let moved = self.movement.judge_again(now, &self.params);
        self.give_way_to_sticks(moved);
        let was_armed = self.commander.is_armed();
        self.decide(Commander::step);
        let armed = self.commander.is_armed();
        if was_armed != armed {
            self.charge = self.charge.max(0.5);
        }
        // By a gesture of the sticks: a command has set it.
        if armed && !was_armed {
            self.set_home();
        }
    }

    /// Of a multicopter, and of a VTOL that hovers.
    pub(crate) fn give_way_to_sticks(&mut self, moved: bool) {
        if moved && self.body.flown_as() != Airframe::Plane {
            self.decide(Commander::sticks_moved);
        }
    }

    fn fly(&mut self, now: f64) {
        if self.health_faults.quad_chute && !self.landed && self.body.quad_chute() {
            self.decide(|commander, facts, notes| commander.quad_chute(facts, notes));
        }
        let farthest_m = self.params.get(Param::GF_MAX_HOR_DIST);
        if farthest_m > 0.0
            && self.commander.is_armed()
            && !self.landed
            && let Some(home) = self.home
        {
            let at = self.believed();
            let beyond = (at.n - home.n).hypot(at.e - home.e) > farthest_m;
            self.decide(|commander, facts, notes| commander.watch_fence(beyond, facts, notes));
        }
        let (mode, armed) = (self.commander.mode(), self.commander.is_armed());
        if armed {
            self.charge = (self.charge - DT / 1500.0).max(0.5);
        }
        if self.ticks.is_multiple_of(NAVIGATE_EVERY) || self.navigated != (mode, armed) {
            self.navigated = (mode, armed);
            let step = self.navigate(|nav, view, notes| nav.step(mode, armed, view, notes));
            if let Some(next) = step.then {
                self.commander.follow_with(next);
            }
            self.course = (step.guidance, step.heading);
        }
        let spooling = now - self.commander.armed_at() < self.params.get(Param::COM_SPOOLUP_TIME);
        let (mut guidance, heading) = if !armed || spooling && self.landed {
            (Guidance::Ground, Heading::Hold)
        } else {
            self.steer(mode).unwrap_or(self.course)
        };
        let low_m = f64::from(self.health_faults.low_m);
        match &mut guidance {
            Guidance::Leg(leg) | Guidance::Climb(leg) if mode == Mode::Mission => {
                leg.target.d += low_m;
            }
            Guidance::Circle(circle) if mode == Mode::Mission => circle.centre.d += low_m,
            _ => {}
        }
        self.target = match &guidance {
            Guidance::Leg(leg) | Guidance::Climb(leg) | Guidance::Land(leg) => leg.target,
            // The centre of a whole eight, not of the end that is flown now.
            Guidance::Circle(circle) => self.navigator.eight().unwrap_or(circle.centre),
            Guidance::Ground | Guidance::Steer { .. } | Guidance::Track { .. } => {
                self.body.setpoint().position
            }
        };
        let error = self.estimator.position_error();
        self.body.step(DT, &guidance, &heading, error, &self.tuning);
        // Landed requires contact with the ground and a vehicle that is commanded down: one that is about to take off
        // also touches the ground.
        let sinking = matches!(guidance, Guidance::Land(_) | Guidance::Ground)
            || matches!(guidance, Guidance::Steer { .. } | Guidance::Track { .. } if self.body.setpoint().velocity.d > 0.05);
        let touching = self.body.motion().position.d >= -0.001;
        self.contact = if touching && sinking {
            self.contact + DT
        } else {
            0.0
        };
    }

    /// The guidance of the modes that are steered from outside.
    fn steer(&self, mode: Mode) -> Option<(Guidance, Heading)> {
        let ground = Some((Guidance::Ground, Heading::Hold));
        let yaw = self.body.motion().attitude[2];
        match mode {
            Mode::PosCtl | Mode::AltCtl => {
                if self.landed && !self.sticks.wants_up() {
                    return ground;
                }
                Some(self.sticks.guidance(yaw, &self.params))
            }
            Mode::Offboard => {
                let setpoint = self.setpoint?;
                if self.landed && !setpoint.wants_up(self.believed().d) {
                    return ground;
                }
                Some(setpoint.guidance())
            }
            Mode::Termination => ground,
            _ => None,
        }
    }

    fn detect_ground(&mut self, now: f64) {
        let motion = self.body.motion();
        let landed = if self.landed {
            motion.position.d > -LIFTED_M
        } else {
            let still = match self.body.flown_as() {
                Airframe::Quad | Airframe::Vtol => true,
                Airframe::Plane => motion.velocity.horizontal() < 1.0,
            };
            self.contact >= LANDED_AFTER_S && still
        };
        if landed != self.landed {
            self.landed = landed;
            self.decide(|commander, _, notes| commander.landed(landed, now, notes));
        }
    }

    fn report_due(&mut self, now: f64) {
        if self.is_located()
            && let Some(status) = self.operator.poll(now)
        {
            self.send(status);
        }
        let mut due = Vec::new();
        self.streams.poll(now, |id| due.push(id));
        let seq = self.navigator.mission.index();
        if seq != self.last_seq
            && !due.contains(&mav::MISSION_CURRENT_DATA::ID)
            && self.is_located()
        {
            due.push(mav::MISSION_CURRENT_DATA::ID);
        }
        self.last_seq = seq;
        for message in due {
            if message == mav::MISSION_CURRENT_DATA::ID {
                self.update_mission_state();
            }
            if let Some(report) = self.report(message) {
                self.send(report);
            }
            if message == mav::MISSION_CURRENT_DATA::ID {
                self.repeat_reached();
            }
        }
        if self.is_located() {
            let mut due_texts = Vec::new();
            self.texts.poll(now, |text| due_texts.push(text));
            let boot_ms = self.boot_ms();
            self.texts
                .events
                .poll(now, boot_ms, |event| due_texts.push(event));
            due_texts.into_iter().for_each(|text| self.send(text));
        }
    }

    /// MISSION_CURRENT.mission_state by PX4's own rules. They leave out one case, in which the state keeps its value.
    fn update_mission_state(&mut self) {
        let mission = &self.navigator.mission;
        let active = mission_mode_active(self.commander.mode());
        self.mission_state = if !mission.is_valid() {
            MissionState::MISSION_STATE_NO_MISSION
        } else if mission.is_finished() {
            MissionState::MISSION_STATE_COMPLETE
        } else if active {
            MissionState::MISSION_STATE_ACTIVE
        } else if mission.reached().is_some() {
            MissionState::MISSION_STATE_PAUSED
        } else if mission.index() < 1 {
            MissionState::MISSION_STATE_NOT_STARTED
        } else {
            return;
        };
    }

    fn repeat_reached(&mut self) {
        let Some((seq, sent)) = &mut self.reached else {
            return;
        };
        if *sent < REACHED_REPEATS && self.navigator.mission.count() > 0 {
            *sent += 1;
            let seq = *seq;
            self.send_reached(seq);
        }
    }
}

/// The estimator's errors are computed at 25 Hz.
const ESTIMATOR_EVERY: u64 = 10;
/// The commander reads its command queue every 8 ms: acknowledgements take 4 to 18 ms on the wire.
const COMMANDS_EVERY: u64 = 2;
/// The navigator checks the position at about 20 Hz, so that a fast vehicle can pass a small radius between two checks.
const NAVIGATE_EVERY: u64 = 13;
/// Gimbals are driven at 50 Hz.
const PAYLOADS_EVERY: u64 = 5;
/// Higher than this above the ground the vehicle has taken off, m.
const LIFTED_M: f64 = 0.05;
/// Time of contact before the land detector reports the ground, s.
const LANDED_AFTER_S: f64 = 0.8;
/// PX4 repeats MISSION_ITEM_REACHED at 1 Hz up to this often.
const REACHED_REPEATS: u8 = 10;
