//! What kind of aircraft a vehicle is, and which autopilot flies it (HEARTBEAT.type, HEARTBEAT.autopilot).
//!
//! A VTOL is one vehicle with two sets of limits: it hovers, or it flies on its wings, and EXTENDED_SYS_STATE.vtol_state says
//! which. As PX4 does, one in a transition counts as a multicopter until it flies on its wings.

use mavlink_link::dialect::{MavAutopilot, MavType};

/// The kinds that are flown differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Airframe {
    /// Stands still in the air; so does every type that is not named here.
    Multicopter,
    /// Never stands still.
    FixedWing,
    /// Either.
    Vtol,
}

impl Airframe {
    /// Of HEARTBEAT.type.
    #[must_use]
    pub fn of(kind: MavType) -> Airframe {
        use MavType as T;
        match kind {
            T::MAV_TYPE_FIXED_WING => Airframe::FixedWing,
            T::MAV_TYPE_VTOL_TAILSITTER_DUOROTOR
            | T::MAV_TYPE_VTOL_TAILSITTER_QUADROTOR
            | T::MAV_TYPE_VTOL_TILTROTOR
            | T::MAV_TYPE_VTOL_FIXEDROTOR
            | T::MAV_TYPE_VTOL_TAILSITTER
            | T::MAV_TYPE_VTOL_TILTWING
            | T::MAV_TYPE_VTOL_RESERVED5 => Airframe::Vtol,
            _ => Airframe::Multicopter,
        }
    }

    /// Whether its routes are flown on wings: they need a landing, and no waypoint is hovered at.
    #[must_use]
    pub fn has_wings(self) -> bool {
        self != Airframe::Multicopter
    }
}

/// Why an autopilot is not flown by this VSM; `None` for PX4. Its modes, missions and parameters mean something else: flown
/// half, a command would do what nobody has commanded.
#[must_use]
pub fn refused_autopilot(autopilot: MavAutopilot) -> Option<&'static str> {
    (autopilot == MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA).then_some(
        "the vehicle's autopilot is ArduPilot (HEARTBEAT.autopilot 3): only PX4 is flown",
    )
}
