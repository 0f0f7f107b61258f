//! The airframes behind one set of calls, and the parameters by which they fly.

use curve_paths::flight::Npfg;

use crate::config::{Airframe, Config, Param, Params};
use crate::physics::motion::{Motion, Ned};
use crate::physics::plane::{Plane, PlaneTuning};
use crate::physics::quad::{Quad, QuadTuning};
use crate::physics::trajectory::{Guidance, Heading, Limits, Trajectory};
use crate::physics::vtol::{Vtol, VtolState};

/// One of the airframes.
#[derive(Debug, Clone)]
pub(crate) enum Body {
    /// Quadrotor.
    Quad(Box<Quad>),
    /// Fixed wing.
    Plane(Box<Plane>),
    /// Standard VTOL.
    Vtol(Box<Vtol>),
}

impl Body {
    /// On the ground at the origin.
    pub(crate) fn new(config: &Config) -> Self {
        match config.airframe {
            Airframe::Quad => Self::Quad(Box::new(Quad::new(
                config.heading_rad,
                config.wind_ne_ms,
                config.seed,
            ))),
            Airframe::Plane => Self::Plane(Box::new(Plane::new(
                config.heading_rad,
                config.wind_ne_ms,
                config.seed,
            ))),
            Airframe::Vtol => Self::Vtol(Box::new(Vtol::new(
                config.heading_rad,
                config.wind_ne_ms,
                config.seed,
            ))),
        }
    }

    /// The true motion.
    pub(crate) fn motion(&self) -> &Motion {
        match self {
            Self::Quad(quad) => &quad.motion,
            Self::Plane(plane) => &plane.motion,
            Self::Vtol(vtol) => vtol.motion(),
        }
    }

    /// Setpoint of the trajectory.
    pub(crate) fn setpoint(&self) -> &Trajectory {
        match self {
            Self::Quad(quad) => &quad.trajectory,
            Self::Plane(plane) => &plane.target,
            Self::Vtol(vtol) if vtol.state == VtolState::Hover => &vtol.quad.trajectory,
            Self::Vtol(vtol) => &vtol.plane.target,
        }
    }

    /// Heading setpoint, radians.
    pub(crate) fn heading_setpoint(&self) -> f64 {
        match self {
            Self::Quad(quad) => quad.heading,
            Self::Plane(plane) => plane.motion.attitude[2],
            Self::Vtol(vtol) if vtol.state == VtolState::Hover => vtol.quad.heading,
            Self::Vtol(vtol) => vtol.plane.motion.attitude[2],
        }
    }

    /// Throttle, 0 to 1.
    pub(crate) fn throttle(&self) -> f64 {
        match self {
            Self::Quad(quad) => quad.throttle,
            Self::Plane(plane) => plane.throttle,
            Self::Vtol(vtol) if vtol.state == VtolState::Hover => vtol.quad.throttle,
            Self::Vtol(vtol) => vtol.plane.throttle,
        }
    }

    /// Airspeed, m/s, where there is a sensor.
    pub(crate) fn airspeed(&self) -> Option<f64> {
        match self {
            Self::Quad(_) => None,
            Self::Plane(plane) => Some(plane.airspeed),
            Self::Vtol(vtol) if vtol.state == VtolState::Hover => {
                Some(vtol.quad.motion.velocity.horizontal())
            }
            Self::Vtol(vtol) => Some(vtol.plane.airspeed),
        }
    }

    /// The state of a VTOL.
    pub(crate) fn vtol(&self) -> Option<VtolState> {
        match self {
            Self::Vtol(vtol) => Some(vtol.state),
            Self::Quad(_) | Self::Plane(_) => None,
        }
    }

    /// The airframe of its present flight: PX4's vehicle_type.
    pub(crate) fn flown_as(&self) -> Airframe {
        match self {
            Self::Quad(_) => Airframe::Quad,
            Self::Plane(_) => Airframe::Plane,
            Self::Vtol(vtol) if vtol.state == VtolState::Wings => Airframe::Plane,
            Self::Vtol(_) => Airframe::Quad,
        }
    }

    /// Begins a transition, if it is a VTOL.
    pub(crate) fn turn(&mut self, to_wings: bool) {
        if let Self::Vtol(vtol) = self {
            vtol.turn(to_wings);
        }
    }

    /// Leaves its wings at once (quad-chute); true where it was on them, or in transition to them.
    pub(crate) fn quad_chute(&mut self) -> bool {
        match self {
            Self::Vtol(vtol) if matches!(vtol.state, VtolState::Wings | VtolState::ToWings) => {
                vtol.quad_chute();
                true
            }
            _ => false,
        }
    }

    /// One step.
    pub(crate) fn step(
        &mut self,
        dt: f64,
        guidance: &Guidance,
        heading: &Heading,
        error: Ned,
        tuning: &Tuning,
    ) {
        match (self, tuning) {
            (Self::Quad(quad), Tuning::Quad(tuning)) => {
                quad.step(dt, guidance, heading, error, tuning)
            }
            (Self::Plane(plane), Tuning::Plane(tuning)) => plane.step(dt, guidance, error, tuning),
            (Self::Vtol(vtol), Tuning::Vtol(quad, plane)) => {
                vtol.step(dt, guidance, heading, error, (quad, plane));
            }
            // Cannot occur: the tuning is read for the same airframe.
            _ => {}
        }
    }
}

/// The parameters by which an airframe flies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Tuning {
    /// Of a quadrotor.
    Quad(QuadTuning),
    /// Of a fixed wing.
    Plane(PlaneTuning),
    /// Of both.
    Vtol(QuadTuning, PlaneTuning),
}

impl Tuning {
    /// Reads them. PX4 stores whatever value is set, even out of range; a value that the formulas cannot use is
    /// replaced by the nearest one that they can.
    pub(crate) fn read(airframe: Airframe, p: &Params) -> Self {
        match airframe {
            Airframe::Quad => Self::Quad(quad(p)),
            Airframe::Plane => Self::Plane(plane(p)),
            Airframe::Vtol => Self::Vtol(quad(p), plane(p)),
        }
    }
}

fn above(p: &Params, param: Param, least: f64) -> f64 {
    let v = p.get(param);
    if v.is_finite() { v.max(least) } else { least }
}

fn quad(p: &Params) -> QuadTuning {
    let above = |param, least| above(p, param, least);
    QuadTuning {
        limits: Limits {
            acc_hor: above(Param::MPC_ACC_HOR, 0.1),
            jerk: above(Param::MPC_JERK_AUTO, 0.1),
            corner_gain: above(Param::MPC_XY_TRAJ_P, 0.01),
            speed_max: above(Param::MPC_XY_VEL_MAX, 0.1),
            climb: above(Param::MPC_Z_V_AUTO_UP, 0.1),
            sink: above(Param::MPC_Z_V_AUTO_DN, 0.1),
            acc_up: above(Param::MPC_ACC_UP_MAX, 0.1),
            acc_down: above(Param::MPC_ACC_DOWN_MAX, 0.1),
            lead_xy: above(Param::MPC_XY_ERR_MAX, 0.1),
            lead_z: above(Param::MPC_Z_ERR_MAX, 0.1),
            altitude_acceptance: above(Param::NAV_MC_ALT_RAD, 0.05),
        },
        position_gain: above(Param::MPC_XY_P, 0.0),
        velocity_gain: above(Param::MPC_XY_VEL_P_ACC, 0.1),
        takeoff_speed: above(Param::MPC_TKO_SPEED, 0.1),
        takeoff_ramp: above(Param::MPC_TKO_RAMP_T, 0.1),
        land_speed: above(Param::MPC_LAND_SPEED, 0.1),
        land_crawl: above(Param::MPC_LAND_CRWL, 0.1),
        land_altitudes: [
            above(Param::MPC_LAND_ALT1, 0.0),
            above(Param::MPC_LAND_ALT2, 0.0),
            above(Param::MPC_LAND_ALT3, 0.0),
        ],
        yaw_rate: above(Param::MPC_YAWRAUTO_MAX, 1.0).to_radians(),
        yaw_acc: above(Param::MPC_YAWRAUTO_ACC, 1.0).to_radians(),
    }
}

/// The guidance law of wings.
pub(crate) fn npfg(p: &Params) -> Npfg {
    Npfg {
        period_s: above(p, Param::NPFG_PERIOD, 1.0),
        damping: above(p, Param::NPFG_DAMPING, 0.1),
        switch_multiplier: above(p, Param::NPFG_SW_DST_MLT, 0.1),
    }
}

fn plane(p: &Params) -> PlaneTuning {
    let above = |param, least| above(p, param, least);
    PlaneTuning {
        airspeed_min: above(Param::FW_AIRSPD_MIN, 1.0),
        airspeed_max: above(Param::FW_AIRSPD_MAX, 1.0),
        bank_max: above(Param::FW_R_LIM, 5.0).min(65.0).to_radians(),
        climb: above(Param::FW_T_CLMB_R_SP, 0.1),
        sink: above(Param::FW_T_SINK_R_SP, 0.1),
        npfg: npfg(p),
    }
}
