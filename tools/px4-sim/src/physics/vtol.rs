//! A standard VTOL: a quadrotor and a fixed wing in one, and the transitions between them.
//!
//! As in PX4's state machine: a transition to wings accelerates along the nose until the wings carry, one to a hover
//! slows down. A quad-chute leaves the wings at once, without a transition.

use mavlink::dialects::development::MavVtolState;

use crate::physics::motion::{Motion, Ned};
use crate::physics::plane::{Plane, PlaneTuning};
use crate::physics::quad::{Quad, QuadTuning};
use crate::physics::trajectory::{Guidance, Heading};

/// EXTENDED_SYS_STATE.vtol_state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VtolState {
    /// On its rotors.
    Hover,
    /// Accelerates until the wings carry.
    ToWings,
    /// On its wings.
    Wings,
    /// Slows down until the rotors carry.
    ToHover,
}

impl VtolState {
    /// The number on the wire.
    pub(crate) fn reported(self) -> MavVtolState {
        match self {
            Self::Hover => MavVtolState::MAV_VTOL_STATE_MC,
            Self::ToWings => MavVtolState::MAV_VTOL_STATE_TRANSITION_TO_FW,
            Self::Wings => MavVtolState::MAV_VTOL_STATE_FW,
            Self::ToHover => MavVtolState::MAV_VTOL_STATE_TRANSITION_TO_MC,
        }
    }
}

/// The airframe's state.
#[derive(Debug, Clone)]
pub(crate) struct Vtol {
    pub(crate) quad: Quad,
    pub(crate) plane: Plane,
    pub(crate) state: VtolState,
}

impl Vtol {
    /// On the ground at the origin.
    pub(crate) fn new(heading: f64, wind: [f64; 2], seed: u64) -> Self {
        Self {
            quad: Quad::new(heading, wind, seed),
            plane: Plane::new(heading, wind, seed),
            state: VtolState::Hover,
        }
    }

    /// The true motion.
    pub(crate) fn motion(&self) -> &Motion {
        match self.state {
            VtolState::Hover => &self.quad.motion,
            _ => &self.plane.motion,
        }
    }

    /// Begins a transition; does nothing where the vehicle already flies so, or is in that transition.
    pub(crate) fn turn(&mut self, to_wings: bool) {
        self.state = match (self.state, to_wings) {
            (VtolState::Hover | VtolState::ToHover, true) => {
                let motion = *self.motion();
                self.plane.take_over(motion, motion.velocity.horizontal());
                VtolState::ToWings
            }
            (VtolState::Wings | VtolState::ToWings, false) => VtolState::ToHover,
            (state, _) => state,
        };
    }

    /// Leaves the wings at once.
    pub(crate) fn quad_chute(&mut self) {
        let motion = *self.motion();
        self.quad.take_over(motion);
        self.state = VtolState::Hover;
    }

    /// One step.
    pub(crate) fn step(
        &mut self,
        dt: f64,
        guidance: &Guidance,
        heading: &Heading,
        error: Ned,
        (quad, plane): (&QuadTuning, &PlaneTuning),
    ) {
        match self.state {
            VtolState::Hover => self.quad.step(dt, guidance, heading, error, quad),
            VtolState::Wings => self.plane.step(dt, guidance, error, plane),
            VtolState::ToWings => {
                let carries = plane.airspeed_min * CARRIES;
                if self.plane.glide_level(dt, PUSH_M_S2, carries) {
                    self.state = VtolState::Wings;
                }
            }
            VtolState::ToHover => {
                if self.plane.glide_level(dt, -BRAKE_M_S2, SLOW_M_S) {
                    self.quad_chute();
                }
            }
        }
    }
}

/// VT_ARSP_TRANS as a multiple of the least airspeed.
const CARRIES: f64 = 1.2;
/// Acceleration by the pusher, m/s2.
const PUSH_M_S2: f64 = 3.0;
/// The default of VT_B_DEC_MSS, m/s2.
pub(crate) const BRAKE_M_S2: f64 = 2.0;
/// Below this speed the rotors take over, m/s.
const SLOW_M_S: f64 = 3.0;
