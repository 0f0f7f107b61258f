//! Arming, the flown mode beside the requested mode, and the failsafes.
//!
//! PX4 keeps both modes: HEARTBEAT.custom_mode is the one flown, CURRENT_MODE.intended_custom_mode the one requested. A
//! failsafe replaces the first and leaves the second, so that a ground station can see what was overridden.

use crate::config::{Param, Params};
use crate::flight::mode::Mode;
use crate::flight::steering::Gesture;
use crate::flight::view::Note;

/// Seconds after boot at which PX4's simulator reports things or becomes able to do them, as observed.
pub(crate) mod boot {
    /// First HEARTBEAT.
    pub(crate) const FIRST_HEARTBEAT: f64 = 1.95;
    /// "no heading reference" is reported.
    pub(crate) const PREFLIGHT_TEXT: f64 = 3.2;
    /// HOME_POSITION is known.
    pub(crate) const HOME: f64 = 4.0;
    /// The estimator is good and arming is allowed.
    pub(crate) const READY: f64 = 4.9;
}

/// The facts on which the commander decides.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facts<'a> {
    /// Time since boot, s.
    pub now: f64,
    /// On the ground.
    pub landed: bool,
    /// The mission has passed its checks.
    pub mission_valid: bool,
    /// Parameters.
    pub params: &'a Params,
}

/// Why the vehicle is not in the requested mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cause {
    Sticks,
    Setpoints,
    GroundStation,
    Wings,
    Fence,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Failsafe {
    cause: Cause,
    /// The mode flown now.
    mode: Mode,
    /// When it changes to which mode: PX4 holds first, then acts.
    then: Option<(f64, Mode)>,
}

/// The commander. The default is PX4's state at boot: disarmed, in hold.
#[derive(Debug, Clone, Default)]
pub(crate) struct Commander {
    armed: bool,
    armed_at: f64,
    flown: bool,
    landed_at: Option<f64>,
    intended: Mode,
    /// The mode to which disarming leads back.
    after_disarming: Mode,
    failsafe: Option<Failsafe>,
    overridden: [bool; 5],
    sticks_at: Option<f64>,
    sticks_regained: bool,
    /// The corner in which the left stick is, and since when; infinite once that was obeyed.
    gesture: Option<(Gesture, f64)>,
    setpoints_at: Option<f64>,
    ground_station_at: Option<f64>,
    ground_station_connected: bool,
    preflight_text_sent: bool,
}

impl Commander {
    /// Motors enabled.
    pub(crate) fn is_armed(&self) -> bool {
        self.armed
    }

    /// When it was armed, seconds since boot.
    pub(crate) fn armed_at(&self) -> f64 {
        self.armed_at
    }

    /// The flown mode: HEARTBEAT.custom_mode.
    pub(crate) fn mode(&self) -> Mode {
        self.failsafe.map_or(self.intended, |f| f.mode)
    }

    /// The requested mode: CURRENT_MODE.intended_custom_mode.
    pub(crate) fn intended(&self) -> Mode {
        self.intended
    }

    /// A failsafe has replaced the requested mode.
    pub(crate) fn in_failsafe(&self) -> bool {
        self.failsafe.is_some()
    }

    /// MANUAL_CONTROL was received.
    pub(crate) fn sticks(&mut self, now: f64, gesture: Option<Gesture>) {
        self.sticks_at = Some(now);
        self.overridden[Cause::Sticks as usize] = false;
        if self.armed {
            self.sticks_regained = true;
        }
        let before = self.gesture;
        self.gesture = gesture.map(|shown| match before {
            Some((same, since)) if same == shown => (same, since),
            _ => (shown, now),
        });
    }

    /// The sticks are being moved. In a mode that flies by itself PX4 takes that for a pilot who wants the vehicle
    /// (Commander::manualControlCheck), but not while a failsafe holds before it acts.
    pub(crate) fn sticks_moved(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        if !self.armed || !self.mode().gives_way_to_sticks() || !self.can_run(Mode::PosCtl, facts) {
            return;
        }
        match self.failsafe {
            Some(Failsafe { then: Some(_), .. }) => return,
            Some(Failsafe { cause, .. }) => {
                self.overridden[cause as usize] = true;
                self.failsafe = None;
            }
            None => {}
        }
        self.intend(Mode::PosCtl);
        notes.push(Note::Info("Pilot took over using sticks\t".into()));
    }

    /// A setpoint that OFFBOARD can fly was received.
    pub(crate) fn setpoint(&mut self, now: f64) {
        self.setpoints_at = Some(now);
        self.overridden[Cause::Setpoints as usize] = false;
    }

    /// A ground station's HEARTBEAT was received. Its return ends no failsafe: as observed, PX4 resumes nothing by
    /// itself.
    pub(crate) fn ground_station(&mut self, now: f64, notes: &mut Vec<Note>) {
        if !self.ground_station_connected {
            self.ground_station_connected = true;
            self.overridden[Cause::GroundStation as usize] = false;
            notes.push(Note::Info("GCS connection regained\t".into()));
        }
        self.ground_station_at = Some(now);
    }

    fn sticks_alive(&self, facts: &Facts<'_>) -> bool {
        let limit = facts.params.get(Param::COM_RC_LOSS_T);
        self.sticks_at.is_some_and(|at| facts.now - at <= limit)
    }

    fn setpoints_alive(&self, facts: &Facts<'_>) -> bool {
        let limit = facts.params.get(Param::COM_OF_LOSS_T);
        self.setpoints_at.is_some_and(|at| facts.now - at <= limit)
    }

    /// The estimator is good enough to fly.
    pub(crate) fn is_ready(facts: &Facts<'_>) -> bool {
        facts.now >= boot::READY
    }

    /// The mode could be flown now.
    fn can_run(&self, mode: Mode, facts: &Facts<'_>) -> bool {
        if !Self::is_ready(facts) {
            return false;
        }
        match mode {
            Mode::Mission => facts.mission_valid,
            Mode::PosCtl | Mode::AltCtl => self.sticks_alive(facts),
            // The attitude modes exist by name only, and cannot be flown: see docs/guide/simulator.md.
            Mode::Manual | Mode::Acro | Mode::Stabilized => false,
            Mode::Offboard => self.setpoints_alive(facts),
            Mode::Loiter
            | Mode::Takeoff
            | Mode::VtolTakeoff
            | Mode::Course
            | Mode::Rtl
            | Mode::Land
            | Mode::Orbit
            | Mode::Termination => true,
        }
    }

    /// HEARTBEAT.system_status on the ground: standby or uninitialised.
    pub(crate) fn can_arm(&self, facts: &Facts<'_>) -> bool {
        let mode = self.intended;
        !prevents_arming(mode) && self.can_run(mode, facts)
    }

    /// Requests a mode. On the ground PX4 acknowledges every mode, flyable or not: the acknowledgement proves
    /// nothing, and a bridge must read HEARTBEAT. In the air PX4 accepts only a mode that can be flown, and that ends
    /// a failsafe.
    pub(crate) fn request(&mut self, mode: Mode, force: bool, facts: &Facts<'_>) -> bool {
        if self.armed && !force && !self.can_run(mode, facts) {
            return false;
        }
        // Only a restart ends a termination: no command, no pilot, and not the end of the failsafe that caused it.
        if self.mode() == Mode::Termination {
            return false;
        }
        if let Some(failsafe) = self.failsafe.take() {
            self.overridden[failsafe.cause as usize] = true;
            // Also where the loss of the sticks came after it; inside the fence it does not last.
            self.overridden[Cause::Fence as usize] = true;
        }
        // Sticks that were lost on the ground do not start the failsafe in the air: the operator has decided without them. In
        // the air only a failsafe that is flown can be taken over: a landing or a return outlasts the loss, and the next
        // mode begins its failsafe.
        if facts.landed && !self.sticks_alive(facts) {
            self.overridden[Cause::Sticks as usize] = true;
        }
        self.intend(mode);
        true
    }

    /// While disarmed, PX4 is in the last requested mode in which it could have been armed: a vehicle that is
    /// commanded to land during a mission is in AUTO.MISSION afterwards, with the rest of the mission.
    fn intend(&mut self, mode: Mode) {
        self.intended = mode;
        if !prevents_arming(mode) && !matches!(mode, Mode::Takeoff | Mode::VtolTakeoff)
            || mode == Mode::Termination
        {
            self.after_disarming = mode;
        }
    }

    /// The navigator has finished a mode, and another mode follows.
    pub(crate) fn follow_with(&mut self, mode: Mode) {
        if self.mode() == Mode::Termination {
            return;
        }
        match &mut self.failsafe {
            Some(failsafe) => failsafe.mode = mode,
            None => self.intend(mode),
        }
    }

    /// Arms, or notes the reason why not.
    pub(crate) fn arm(&mut self, reason: &str, facts: &Facts<'_>, notes: &mut Vec<Note>) -> bool {
        if self.armed {
            return true;
        }
        if !self.can_arm(facts) {
            notes.push(Note::Critical(
                "Arming denied: Resolve system health failures first\t".into(),
            ));
            return false;
        }
        self.armed = true;
        self.armed_at = facts.now;
        self.flown = false;
        self.landed_at = None;
        self.sticks_regained = self.sticks_alive(facts);
        self.overridden = [false; 5];
        notes.push(Note::Info(format!("Armed by {reason}\t")));
        true
    }

    /// Disarms; in the air only if forced.
    pub(crate) fn disarm(
        &mut self,
        reason: &str,
        force: bool,
        facts: &Facts<'_>,
        notes: &mut Vec<Note>,
    ) -> bool {
        if !self.armed {
            return true;
        }
        if !facts.landed && !force {
            notes.push(Note::Critical("Disarming denied: not landed\t".into()));
            return false;
        }
        self.armed = false;
        if self.mode() == Mode::Termination {
            self.after_disarming = Mode::Termination;
        }
        self.failsafe = None;
        self.intended = self.after_disarming;
        notes.push(Note::Info(format!("Disarmed by {reason}\t")));
        true
    }

    /// The land detector has changed its state.
    pub(crate) fn landed(&mut self, landed: bool, now: f64, notes: &mut Vec<Note>) {
        if landed {
            self.landed_at = Some(now);
            notes.push(Note::Info("Landing detected\t".into()));
        } else {
            self.landed_at = None;
            self.flown = true;
            notes.push(Note::Info("Takeoff detected\t".into()));
        }
    }

    /// One step: time-outs and failsafes.
    pub(crate) fn step(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        if !self.preflight_text_sent && facts.now >= boot::PREFLIGHT_TEXT {
            self.preflight_text_sent = true;
            notes.push(Note::Critical(
                "Preflight Fail: no heading reference".into(),
            ));
        }
        if let Some(at) = self.ground_station_at
            && self.ground_station_connected
            && facts.now - at > facts.params.get(Param::COM_DL_LOSS_T)
        {
            self.ground_station_connected = false;
            if !self.armed {
                notes.push(Note::Info("Connection to ground station lost\t".into()));
            }
        }
        self.obey_gesture(facts, notes);
        if !self.armed {
            return;
        }
        self.auto_disarm(facts, notes);
        if self.armed && !facts.landed {
            self.watch(facts, notes);
        }
    }

    /// MAN_ARM_GESTURE: the left stick in a lower corner for a second arms, and disarms on the ground
    /// (ManualControl::processStickArming).
    fn obey_gesture(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        let Some((gesture, since)) = self.gesture else {
            return;
        };
        if !self.sticks_alive(facts) || facts.params.int(Param::MAN_ARM_GESTURE) == 0 {
            self.gesture = None;
            return;
        }
        if facts.now - since < GESTURE_S {
            return;
        }
        // Once, until the stick has left the corner.
        self.gesture = Some((gesture, f64::INFINITY));
        match gesture {
            Gesture::Arm => {
                self.arm("stick gesture", facts, notes);
            }
            // In the air it is ignored, without a text.
            Gesture::Disarm if facts.landed => {
                self.disarm("stick gesture", false, facts, notes);
            }
            Gesture::Disarm => {}
        }
    }

    fn auto_disarm(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        if !facts.landed {
            return;
        }
        let (since, limit, reason) = match (self.flown, self.landed_at) {
            (true, Some(at)) => (at, facts.params.get(Param::COM_DISARM_LAND), "landing"),
            (false, _) => (
                self.armed_at,
                facts.params.get(Param::COM_DISARM_PRFLT),
                "auto preflight disarming",
            ),
            (true, None) => return,
        };
        if limit > 0.0 && facts.now - since >= limit {
            self.disarm(reason, false, facts, notes);
        }
    }

    fn watch(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        if let Some(failsafe) = &mut self.failsafe {
            if let Some((at, mode)) = failsafe.then
                && facts.now >= at
            {
                failsafe.then = None;
                if failsafe.mode != mode {
                    failsafe.mode = mode;
                    notes.push(Note::Critical("Failsafe activated\t".into()));
                }
            }
            // A hold is left for what the loss of the sticks is to do.
            if *failsafe == HOLD_AT_FENCE
                && let Some(lost_at) = self.sticks_lost(facts)
            {
                let action = after_loss(facts.params.int(Param::NAV_RCL_ACT));
                self.begin(Cause::Sticks, action, lost_at, facts, notes);
            }
            return;
        }
        if self.intended == Mode::Offboard && !self.setpoints_alive(facts) {
            return self.setpoints_lost(facts, notes);
        }
        if let Some(lost_at) = self.sticks_lost(facts) {
            let action = facts.params.int(Param::NAV_RCL_ACT);
            if action == HOLD_WITHOUT_FAILSAFE && self.intended.needs_sticks() {
                // Commander::manualControlLossModeSwitch
                self.intend(Mode::Loiter);
                notes.push(Note::Info(
                    "Manual control lost: switching to Hold\t".into(),
                ));
            } else {
                self.begin(Cause::Sticks, after_loss(action), lost_at, facts, notes);
            }
        }
        if self.failsafe.is_none()
            && !self.ground_station_connected
            && self.ground_station_at.is_some()
            && self.intended != Mode::Land
            && !is_exempt(self.intended, facts.params.int(Param::COM_DLL_EXCEPT))
            && !self.overridden[Cause::GroundStation as usize]
        {
            let action = after_loss(facts.params.int(Param::NAV_DLL_ACT));
            self.begin(Cause::GroundStation, action, facts.now, facts, notes);
        }
    }

    /// Since when sticks are missing in a mode that needs them, or in any other once they have been present in this flight.
    fn sticks_lost(&self, facts: &Facts<'_>) -> Option<f64> {
        if self.sticks_alive(facts) {
            return None;
        }
        let exempt = is_exempt(self.intended, facts.params.int(Param::COM_RCL_EXCEPT));
        let missed = self.sticks_regained && !exempt && !self.overridden[Cause::Sticks as usize];
        (self.intended.needs_sticks() || missed).then(|| {
            let after = facts.params.get(Param::COM_RC_LOSS_T);
            self.sticks_at.map_or(facts.now, |at| at + after)
        })
    }

    /// A VTOL has lost its wings (quad-chute): COM_QC_ACT acts at once.
    pub(crate) fn quad_chute(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        let mode = match facts.params.int(Param::COM_QC_ACT) {
            0 => Mode::Rtl,
            1 => Mode::Land,
            2 => Mode::Loiter,
            _ => return,
        };
        self.failsafe = Some(Failsafe {
            cause: Cause::Wings,
            mode,
            then: None,
        });
        notes.push(Note::Critical("Failsafe activated\t".into()));
    }

    /// It is beyond GF_MAX_HOR_DIST: GF_ACTION acts at once, and again where it has been inside since a mode was commanded.
    pub(crate) fn watch_fence(&mut self, beyond: bool, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        if !beyond {
            self.overridden[Cause::Fence as usize] = false;
            return;
        }
        if self.failsafe.is_some() || self.overridden[Cause::Fence as usize] {
            return;
        }
        // Failsafe::fromGfActParam
        let mode = match facts.params.int(Param::GF_ACTION) {
            2 => Mode::Loiter,
            3 => Mode::Rtl,
            4 => Mode::Termination,
            5 => Mode::Land,
            _ => return,
        };
        self.failsafe = Some(Failsafe {
            mode,
            ..HOLD_AT_FENCE
        });
        notes.push(Note::Critical("Failsafe activated\t".into()));
    }

    /// OFFBOARD setpoints are lost. Without sticks PX4 then acts as on the loss of sticks, at once and without a
    /// hold.
    fn setpoints_lost(&mut self, facts: &Facts<'_>, notes: &mut Vec<Note>) {
        // Failsafe::fromOffboardLossActParam. Motors that 7 (disarm) stops are flown as a termination.
        let mode = match facts.params.int(Param::COM_OBL_RC_ACT) {
            3 => Mode::Rtl,
            4 => Mode::Land,
            5 => Mode::Loiter,
            6 | 7 => Mode::Termination,
            by_hand if self.sticks_alive(facts) => match by_hand {
                0 => Mode::PosCtl,
                _ => Mode::AltCtl,
            },
            _ => after_loss(facts.params.int(Param::NAV_RCL_ACT)).unwrap_or(Mode::Loiter),
        };
        self.failsafe = Some(Failsafe {
            cause: Cause::Setpoints,
            mode,
            then: None,
        });
        notes.push(Note::Critical("Failsafe activated\t".into()));
    }

    /// What was lost at `since` is acted on. Holds for COM_FAIL_ACT_T first, counted from then.
    fn begin(
        &mut self,
        cause: Cause,
        action: Option<Mode>,
        since: f64,
        facts: &Facts<'_>,
        notes: &mut Vec<Note>,
    ) {
        let Some(action) = action else { return };
        // FailsafeBase::getSelectedAction: a landing and a return are not left for a return, of which there is a warning
        // alone. The failsafe waits for the next mode.
        if action == Mode::Rtl && matches!(self.intended, Mode::Land | Mode::Rtl) {
            return;
        }
        // Nothing holds a vehicle that is given up.
        let holds_s = match action {
            Mode::Termination => 0.0,
            _ => facts.params.get(Param::COM_FAIL_ACT_T).max(0.0),
        };
        let left_s = since + holds_s - facts.now;
        let intended = self.intended;
        // Failsafe::modifyUserIntendedMode
        if intended == Mode::Orbit {
            self.intend(Mode::Loiter);
        }
        let then = (left_s > 0.0).then_some((facts.now + left_s, action));
        if then.is_none() {
            notes.push(Note::Critical("Failsafe activated\t".into()));
        } else if intended != Mode::Loiter {
            notes.push(Note::Critical(format!(
                "Failsafe activated: entering Hold for {left_s:.0} seconds\t"
            )));
        }
        self.failsafe = Some(Failsafe {
            cause,
            mode: then.map_or(action, |_| Mode::Loiter),
            then,
        });
    }
}

/// Whether a loss has no consequence in a mode: COM_RCL_EXCEPT, COM_DLL_EXCEPT (Failsafe::isFailsafeIgnored).
fn is_exempt(mode: Mode, exceptions: i32) -> bool {
    let bit = match mode {
        Mode::Mission => 1,
        Mode::Loiter
        | Mode::Takeoff
        | Mode::VtolTakeoff
        | Mode::Land
        | Mode::Rtl
        | Mode::Orbit
        | Mode::Course => 2,
        Mode::Offboard => 4,
        _ => 0,
    };
    exceptions & bit != 0
}

fn prevents_arming(mode: Mode) -> bool {
    matches!(
        mode,
        Mode::Rtl | Mode::Land | Mode::Orbit | Mode::Termination
    )
}

/// The mode for a value of NAV_DLL_ACT or NAV_RCL_ACT.
fn after_loss(action: i32) -> Option<Mode> {
    match action {
        1 => Some(Mode::Loiter),
        2 => Some(Mode::Rtl),
        3 => Some(Mode::Land),
        5 | 6 => Some(Mode::Termination),
        _ => None,
    }
}

/// GF_ACTION: hold.
const HOLD_AT_FENCE: Failsafe = Failsafe {
    cause: Cause::Fence,
    mode: Mode::Loiter,
    then: None,
};
/// How long the left stick stays in a corner before that counts, s.
const GESTURE_S: f64 = 1.0;
/// NAV_RCL_ACT: hold by a change of mode, without a failsafe.
const HOLD_WITHOUT_FAILSAFE: i32 = 7;
