//! Settings and parameters of a simulated vehicle.
//!
//! [`Config`] is what this simulator is started with, [`Params`] are PX4's parameters, with the names, types and
//! values of PX4 v1.18 in its built-in simulator. A parameter is stored as it is sent: as observed on the wire, PX4
//! checks the type and nothing else, so that NAV_DLL_ACT=99 is accepted.

use crate::physics::motion::Geodetic;
use crate::services::files::Files;
use crate::services::param::Parameter;
use mavlink_link::service::param::{Name, Value};

/// Kind of airframe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Airframe {
    /// Quadrotor: hovers, turns on the spot (HEARTBEAT.type 2).
    Quad,
    /// Fixed wing: no hover, a loiter is an orbit (HEARTBEAT.type 1).
    Plane,
    /// Standard VTOL: a quadrotor that transitions to wings (HEARTBEAT.type 22).
    Vtol,
}

impl Airframe {
    /// Parameters that differ from a quadrotor's when PX4 starts this airframe: rc.fw_defaults, rc.vtol_defaults, and
    /// the airframes 10041 and 10043.
    pub(crate) fn defaults(self) -> &'static [(Param, f64)] {
        match self {
            Self::Quad => &[],
            Self::Plane => &[
                (Param::MAV_TYPE, 1.0),
                (Param::MIS_TKO_LAND_REQ, 2.0),
                (Param::COM_DISARM_PRFLT, -1.0),
                (Param::MIS_TAKEOFF_ALT, 25.0),
                (Param::RTL_RETURN_ALT, 100.0),
                (Param::RTL_DESCEND_ALT, 100.0),
                (Param::RTL_LAND_DELAY, -1.0),
                (Param::RTL_TYPE, 1.0),
            ],
            Self::Vtol => &[
                (Param::MAV_TYPE, 22.0),
                (Param::MIS_TKO_LAND_REQ, 2.0),
                (Param::MIS_TAKEOFF_ALT, 20.0),
                (Param::MPC_XY_VEL_MAX, 8.0),
                (Param::FW_AIRSPD_MIN, 7.0),
                (Param::FW_AIRSPD_TRIM, 10.0),
                (Param::FW_AIRSPD_MAX, 12.0),
                (Param::RTL_TYPE, 1.0),
            ],
        }
    }
}

/// Settings of one simulated vehicle. The same settings and the same calls give the same flight, to the last bit.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// MAVLink system id, 1 to 255.
    pub system_id: u8,
    /// Where it stands at boot; altitude AMSL.
    pub home: Geodetic,
    /// Airframe.
    pub airframe: Airframe,
    /// Seed of every noise in this vehicle.
    pub seed: u64,
    /// Height of the geoid above the WGS-84 ellipsoid at home, metres; GPS_RAW_INT.alt_ellipsoid
    /// is AMSL plus this. (PX4's built-in simulator reports zero; a receiver does not.)
    pub geoid_separation_m: f64,
    /// Steady wind, m/s: the velocity of the air to the north and to the east.
    pub wind_ne_ms: [f64; 2],
    /// Heading at boot, radians clockwise from true north.
    pub heading_rad: f64,
    /// Magnetic declination, radians, east positive. The vehicle's headings are true.
    pub declination_rad: f64,
    /// Wall clock at boot, microseconds since 1970, as a GPS receiver would give it; zero where it is not known. Only
    /// SYSTEM_TIME carries it.
    pub unix_time_us: u64,
    /// Parameters that differ from the defaults at boot.
    pub params: Vec<(Param, f64)>,
    /// Implements operator control (REQUEST_OPERATOR_CONTROL, CONTROL_STATUS), which PX4 v1.18 does not.
    pub operator_control: bool,
    /// Sends EVENT beside its texts, and has their metadata and that of its parameters among its files, as PX4 does.
    pub events: bool,
    /// A combustion engine, which reports itself by EFI_STATUS and idles while disarmed.
    pub combustion: bool,
    /// The files on its card at the first boot.
    pub files: Files,
    /// Payload stations, 0 to 2: gimbals and cameras as components of their own. PX4's simulator has none.
    pub payloads: u8,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            system_id: 1,
            home: Geodetic::new(47.397_743_4, 8.545_593_9, 488.0),
            airframe: Airframe::Quad,
            seed: 1,
            geoid_separation_m: 47.4,
            wind_ne_ms: [0.0; 2],
            heading_rad: 0.0,
            declination_rad: 3.41_f64.to_radians(),
            unix_time_us: 0,
            params: Vec::new(),
            operator_control: false,
            events: false,
            combustion: false,
            files: Files::default(),
            payloads: 0,
        }
    }
}

macro_rules! parameters {
    ($($name:ident = $kind:ident($value:expr);)*) => {
        /// A parameter by its name.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[allow(
            non_camel_case_types,
            missing_docs,
            reason = "the names are PX4's own"
        )]
        #[repr(usize)]
        pub enum Param { $($name,)* }

        const DEFAULTS: &[(&str, Value)] = &[$((stringify!($name), Value::$kind($value)),)*];
    };
}

// Sorted by name, the order in which PX4 lists them.
parameters! {
    BAT1_CAPACITY = Real(-1.0);
    BAT1_N_CELLS = Int(4);
    BAT1_V_CHARGED = Real(4.05);
    BAT1_V_EMPTY = Real(3.6);
    BAT_CRIT_THR = Real(0.07);
    BAT_EMERGEN_THR = Real(0.05);
    BAT_LOW_THR = Real(0.15);
    CBRK_FLIGHTTERM = Int(121212);
    CBRK_IO_SAFETY = Int(22027);
    CBRK_SUPPLY_CHK = Int(0);
    CBRK_USB_CHK = Int(197848);
    CBRK_VTOLARMING = Int(0);
    COM_ARM_ON_BOOT = Int(0);
    COM_ARM_WO_GPS = Int(1);
    COM_DISARM_LAND = Real(2.0);
    COM_DISARM_PRFLT = Real(10.0);
    COM_DLL_EXCEPT = Int(0);
    COM_DL_LOSS_T = Int(10);
    COM_FAIL_ACT_T = Real(5.0);
    COM_FLIGHT_UUID = Int(0);
    COM_GNSSLOSS_ACT = Int(0);
    COM_HOME_EN = Int(1);
    COM_LOW_BAT_ACT = Int(3);
    COM_OBL_RC_ACT = Int(0);
    COM_OF_LOSS_T = Real(1.0);
    COM_POS_LOW_ACT = Int(3);
    COM_QC_ACT = Int(0);
    COM_RCL_EXCEPT = Int(0);
    COM_RC_IN_MODE = Int(1);
    COM_RC_LOSS_T = Real(0.5);
    COM_SPOOLUP_TIME = Real(1.0);
    FW_AIRSPD_MAX = Real(20.0);
    FW_AIRSPD_MIN = Real(10.0);
    FW_AIRSPD_TRIM = Real(15.0);
    FW_LND_ANG = Real(5.0);
    FW_R_LIM = Real(50.0);
    FW_T_CLMB_MAX = Real(5.0);
    FW_T_CLMB_R_SP = Real(3.0);
    FW_T_SINK_MAX = Real(5.0);
    FW_T_SINK_R_SP = Real(2.0);
    GF_ACTION = Int(2);
    GF_MAX_HOR_DIST = Real(0.0);
    GF_MAX_VER_DIST = Real(0.0);
    LNDMC_Z_VEL_MAX = Real(0.25);
    MAN_ARM_GESTURE = Int(1);
    MAN_OVERRIDE_SPD = Real(1.0);
    MAV_0_FORWARD = Int(1);
    MAV_0_MODE = Int(0);
    MAV_1_FORWARD = Int(0);
    MAV_2_FORWARD = Int(0);
    MAV_COMP_ID = Int(1);
    MAV_FWDEXTSP = Int(1);
    MAV_PROTO_VER = Int(2);
    MAV_SYS_ID = Int(1);
    MAV_TYPE = Int(2);
    MAV_USEHILGPS = Int(0);
    MC_YAWRATE_MAX = Real(200.0);
    MIS_DIST_1WP = Real(10000.0);
    MIS_LND_ABRT_ALT = Int(30);
    MIS_TAKEOFF_ALT = Real(2.5);
    MIS_TKO_LAND_REQ = Int(0);
    MIS_YAW_ERR = Real(12.0);
    MIS_YAW_TMT = Real(-1.0);
    MPC_ACC_DOWN_MAX = Real(3.0);
    MPC_ACC_HOR = Real(3.0);
    MPC_ACC_HOR_MAX = Real(5.0);
    MPC_ACC_UP_MAX = Real(4.0);
    MPC_JERK_AUTO = Real(4.0);
    MPC_JERK_MAX = Real(8.0);
    MPC_LAND_ALT1 = Real(10.0);
    MPC_LAND_ALT2 = Real(5.0);
    MPC_LAND_ALT3 = Real(1.0);
    MPC_LAND_CRWL = Real(0.3);
    MPC_LAND_SPEED = Real(0.7);
    MPC_MAN_Y_MAX = Real(150.0);
    MPC_THR_HOVER = Real(0.5);
    MPC_TILTMAX_AIR = Real(45.0);
    MPC_TKO_RAMP_T = Real(3.0);
    MPC_TKO_SPEED = Real(1.5);
    MPC_VEL_MANUAL = Real(10.0);
    MPC_XY_CRUISE = Real(5.0);
    MPC_XY_ERR_MAX = Real(2.0);
    MPC_XY_P = Real(0.95);
    MPC_XY_TRAJ_P = Real(0.5);
    MPC_XY_VEL_MAX = Real(12.0);
    MPC_XY_VEL_P_ACC = Real(1.8);
    MPC_YAWRAUTO_ACC = Real(20.0);
    MPC_YAWRAUTO_MAX = Real(60.0);
    MPC_YAW_MODE = Int(0);
    MPC_Z_ERR_MAX = Real(1.0);
    MPC_Z_VEL_MAX_DN = Real(1.5);
    MPC_Z_VEL_MAX_UP = Real(3.0);
    MPC_Z_V_AUTO_DN = Real(1.5);
    MPC_Z_V_AUTO_UP = Real(3.0);
    NAV_ACC_RAD = Real(10.0);
    NAV_DLL_ACT = Int(0);
    NAV_FW_ALT_RAD = Real(10.0);
    NAV_LOITER_RAD = Real(80.0);
    NAV_MC_ALT_RAD = Real(0.8);
    NAV_MIN_LTR_ALT = Real(-1.0);
    NAV_RCL_ACT = Int(2);
    NPFG_DAMPING = Real(0.7);
    NPFG_PERIOD = Real(10.0);
    NPFG_ROLL_TC = Real(0.5);
    NPFG_SW_DST_MLT = Real(0.32);
    RTL_CONE_ANG = Int(45);
    RTL_DESCEND_ALT = Real(10.0);
    RTL_LAND_DELAY = Real(0.0);
    RTL_LOITER_RAD = Real(80.0);
    RTL_MIN_DIST = Real(10.0);
    RTL_RETURN_ALT = Real(30.0);
    RTL_TYPE = Int(0);
    SIH_LOC_H0 = Real(489.4);
    SIH_LOC_LAT0 = Real(47.397_743);
    SIH_LOC_LON0 = Real(8.545_594);
    SIH_WIND_E = Real(0.0);
    SIH_WIND_N = Real(0.0);
    SYS_AUTOSTART = Int(10040);
    SYS_FAILURE_EN = Int(1);
    SYS_HAS_GPS = Int(1);
    SYS_HAS_MAG = Int(1);
    SYS_HITL = Int(0);
    VTO_LOITER_ALT = Real(80.0);
    VT_FW_MIN_ALT = Real(0.0);
}

/// The vehicle's parameters.
#[derive(Debug, Clone)]
pub struct Params(Vec<Value>);

impl Params {
    /// A parameter's number.
    pub fn get(&self, param: Param) -> f64 {
        match self.0[param as usize] {
            Value::Int(v) => f64::from(v),
            Value::Real(v) => f64::from(v),
        }
    }

    /// A parameter's number, truncated to an integer.
    pub fn int(&self, param: Param) -> i32 {
        self.get(param) as i32
    }

    /// Sets a parameter that the simulation uses.
    pub fn set(&mut self, param: Param, value: f64) {
        let slot = &mut self.0[param as usize];
        *slot = match slot {
            Value::Int(_) => Value::Int(value as i32),
            Value::Real(_) => Value::Real(value as f32),
        };
    }

    /// The list that the parameter protocol serves.
    pub fn table(&self) -> impl Iterator<Item = Parameter> + '_ {
        DEFAULTS
            .iter()
            .zip(&self.0)
            .filter_map(|((name, _), value)| {
                let name = Name::new(name).ok()?;
                Some(Parameter {
                    name,
                    value: *value,
                    used: true,
                    read_only: false,
                })
            })
    }

    /// Stores a value that the parameter protocol has set.
    pub fn store(&mut self, name: Name, value: Value) {
        if let Ok(index) = DEFAULTS.binary_search_by_key(&name.as_str(), |(name, _)| name) {
            self.0[index] = value;
        }
    }
}

impl Default for Params {
    /// The defaults of this build.
    fn default() -> Self {
        Self(DEFAULTS.iter().map(|(_, value)| *value).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_their_field_and_are_sorted() {
        assert!(DEFAULTS.iter().all(|(name, _)| name.len() <= 16));
        assert!(DEFAULTS.windows(2).all(|w| w[0].0 < w[1].0));
    }

    #[test]
    fn every_parameter_is_served_and_stored_by_name() {
        let mut params = Params::default();
        assert_eq!(params.table().count(), DEFAULTS.len());
        let name = Name::new("NAV_DLL_ACT").unwrap();
        params.store(name, Value::Int(99));
        assert_eq!(params.int(Param::NAV_DLL_ACT), 99);
    }
}
