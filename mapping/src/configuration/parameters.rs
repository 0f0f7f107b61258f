//! PX4's parameters that bound what can be commanded, and what it does by itself when it hears no ground station.

use std::collections::BTreeMap;

/// The parameters that are read once a vehicle is there.
pub const NAMES: &[&str] = &[
    "BAT_CRIT_THR",
    "BAT_EMERGEN_THR",
    "BAT_LOW_THR",
    "COM_DL_LOSS_T",
    "FW_AIRSPD_MAX",
    "FW_AIRSPD_MIN",
    "FW_AIRSPD_TRIM",
    "GF_ACTION",
    "GF_MAX_HOR_DIST",
    "GF_MAX_VER_DIST",
    "MIS_TAKEOFF_ALT",
    "MPC_ACC_HOR",
    "MPC_JERK_AUTO",
    "MPC_XY_CRUISE",
    "MPC_XY_VEL_MAX",
    "MPC_Z_VEL_MAX_DN",
    "MPC_Z_VEL_MAX_UP",
    "MPC_Z_V_AUTO_DN",
    "MPC_Z_V_AUTO_UP",
    "NAV_ACC_RAD",
    "NAV_DLL_ACT",
    "NAV_LOITER_RAD",
];

/// Their values, as far as they are known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parameters(BTreeMap<&'static str, f64>);

impl Parameters {
    /// The value of a parameter; one that is not finite is none.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// The value where it is above 0: PX4 writes 0 and below for "none".
    #[must_use]
    pub fn above_zero(&self, name: &str) -> Option<f64> {
        self.get(name).filter(|value| *value > 0.0)
    }

    /// Takes in a value; true where it is another than before. Names that are not in [`NAMES`] are not kept.
    pub fn set(&mut self, name: &str, value: f64) -> bool {
        let Some(known) = NAMES.iter().find(|known| **known == name) else {
            return false;
        };
        value.is_finite() && self.0.insert(known, value) != Some(value)
    }
}

#[cfg(test)]
mod tests {
    use mavlink_link::service::param::Name;

    use super::*;

    #[test]
    fn names_are_names_of_parameters() {
        assert!(NAMES.iter().all(|name| Name::new(name).is_ok()));
        assert!(NAMES.is_sorted());
    }

    #[test]
    fn only_finite_values_of_known_names_are_kept() {
        let mut parameters = Parameters::default();
        assert!(parameters.set("NAV_LOITER_RAD", 80.0));
        assert!(!parameters.set("NAV_LOITER_RAD", 80.0));
        assert!(!parameters.set("NAV_LOITER_RAD", f64::NAN));
        assert!(!parameters.set("OTHER", 1.0));
        assert_eq!(parameters.get("NAV_LOITER_RAD"), Some(80.0));
        assert!(parameters.set("GF_MAX_HOR_DIST", 0.0));
        assert_eq!(parameters.above_zero("GF_MAX_HOR_DIST"), None);
    }
}
