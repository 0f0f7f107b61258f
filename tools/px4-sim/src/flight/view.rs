//! What the navigator knows of the vehicle, and the notes that it returns.
//!
//! The notes keep the flight stack free of messages: the vehicle turns them into STATUSTEXT, MISSION_ITEM_REACHED and
//! mode changes.

use mavlink_link::service::mission::Item;

use crate::config::{Airframe, Param, Params};
use crate::physics::motion::{LocalFrame, Ned};
use crate::physics::trajectory::{Circle, Guidance, Leg};
use crate::physics::vtol::VtolState;

/// What the navigator knows of the vehicle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    /// Time since boot, s.
    pub now: f64,
    /// Estimated position.
    pub position: Ned,
    /// Estimated velocity.
    pub velocity: Ned,
    /// Heading, radians.
    pub yaw: f64,
    /// Standing on the ground.
    pub landed: bool,
    /// Home in the local frame.
    pub home: Ned,
    /// The local frame.
    pub frame: &'a LocalFrame,
    /// Parameters.
    pub params: &'a Params,
    /// The airframe of its present flight: a VTOL on its wings is a plane, otherwise a quadrotor.
    pub airframe: Airframe,
    /// The airframe itself.
    pub kind: Airframe,
    /// The state of a VTOL.
    pub vtol: Option<VtolState>,
}

impl View<'_> {
    /// Acceptance radius where an item gives none, m.
    pub(crate) fn acceptance(&self) -> f64 {
        self.params.get(Param::NAV_ACC_RAD)
    }

    /// Vertical acceptance, m.
    pub(crate) fn altitude_acceptance(&self) -> f64 {
        match self.airframe {
            Airframe::Quad | Airframe::Vtol => self.params.get(Param::NAV_MC_ALT_RAD),
            Airframe::Plane => self.params.get(Param::NAV_FW_ALT_RAD),
        }
    }

    /// Speed where nothing else is commanded, m/s.
    pub(crate) fn cruise(&self) -> f64 {
        match self.airframe {
            Airframe::Quad | Airframe::Vtol => self.params.get(Param::MPC_XY_CRUISE),
            Airframe::Plane => self.params.get(Param::FW_AIRSPD_TRIM),
        }
    }

    /// A leg to a place with the defaults.
    pub(crate) fn leg(&self, target: Ned) -> Leg {
        Leg::to(target, self.acceptance(), self.cruise())
    }
}

/// Something for the vehicle to send or to do.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Note {
    /// STATUSTEXT, severity 6.
    Info(String),
    /// STATUSTEXT, severity 2.
    Critical(String),
    /// MISSION_ITEM_REACHED.
    Reached(u16),
    /// A mission item without a place is carried out.
    Action(Item),
    /// Change to AUTO.RTL: the item was NAV_RETURN_TO_LAUNCH.
    ReturnHome,
    /// The navigator takes the gimbal soon, centres it, and lets go of it.
    CentreGimbal,
    /// Begin a transition of a VTOL.
    Transition { to_wings: bool },
}

/// The guidance to stay at a place: on it for a multicopter, around it on wings.
pub(crate) fn loiter(at: Ned, view: &View<'_>) -> Guidance {
    match view.airframe {
        Airframe::Quad | Airframe::Vtol => Guidance::Leg(view.leg(at)),
        Airframe::Plane => Guidance::Circle(Circle {
            centre: at,
            radius: view.params.get(Param::NAV_LOITER_RAD),
            speed: view.cruise(),
        }),
    }
}
