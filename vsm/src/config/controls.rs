//! `vehicle.controls`: which parameters of the vehicle a CUCS is offered as controls, and may write. Without the table none is
//! offered, and 50011 writes what its range allows.

use std::collections::BTreeSet;

use mapping::parameter::{self, Described};
use mapping::parameter_metadata::ParameterMetadata;
use serde::Deserialize;

use super::error::{Fault, fault};
use super::key::WhenAbsent::Nothing;
use super::key::table;
use crate::relay_policy::{self, is_safety_net};

table! {
    /// `vehicle.controls`
    #[derive(Debug, Clone, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Controls {
        /// Parameters that a CUCS is offered as controls, to build a screen of ([controls.md](../guide/controls.md)): names
        /// of 1 to 16 of A-Z, 0-9 and _, `*` for any characters. No other is written by 50011 then. Those by which PX4 defends itself, which the ground does not
        /// write through an air-side agent either ([keys.md](../guide/keys.md#what-the-ground-may-ask-of-px4)), are none unless they are named in
        /// full
        #[serde(default)]
        pub parameters: Vec<String> => Nothing("none"),
        /// Groups of parameters that are controls, as the vehicle's own metadata names them, such as
        /// `"Multicopter Position Control"`; none of them before the metadata is read, on the ground, by MAVLink FTP
        #[serde(default)]
        pub groups: Vec<String> => Nothing("none"),
    }
}

impl Controls {
    /// Whether a parameter is one of them, with what the vehicle's metadata says of it.
    #[must_use]
    pub fn offers(&self, name: &str, described: Option<&Described>) -> bool {
        if self.parameters.iter().any(|chosen| chosen == name) {
            return true;
        }
        let by_pattern = || {
            let mut patterns = self.parameters.iter();
            patterns.any(|pattern| relay_policy::fits(pattern, name))
        };
        let by_group = || described.is_some_and(|of| self.groups.contains(&of.group));
        (by_pattern() || by_group()) && !is_safety_net(name)
    }

    /// The parameters to read of a vehicle, in the order of their names: of the table of PX4 v1.18, of its metadata, and those
    /// named in full.
    #[must_use]
    pub fn names<'a>(&'a self, metadata: &'a ParameterMetadata) -> BTreeSet<&'a str> {
        let table = parameter::names().map(|name| -> &'a str { name });
        let known = table.chain(metadata.names());
        let whole = self.parameters.iter().map(String::as_str);
        known
            .chain(whole.filter(|name| !name.contains('*')))
            .filter(|name| self.offers(name, metadata.get(name)))
            .collect()
    }

    /// `at` is where the table of the vehicle begins.
    pub(super) fn check(&self, at: usize) -> Result<(), Fault> {
        if self.parameters.is_empty() && self.groups.is_empty() {
            let expected = "parameters or groups";
            return fault(at, "vehicle.controls", "neither", expected);
        }
        let is_pattern = |name: &String| {
            let of_names = |byte: u8| {
                byte.is_ascii_uppercase() || byte.is_ascii_digit() || b"_*".contains(&byte)
            };
            (1..=16).contains(&name.len()) && name.bytes().all(of_names)
        };
        if let Some(name) = self.parameters.iter().find(|name| !is_pattern(name)) {
            let expected = "the name of a parameter, 1 to 16 of A-Z, 0-9, _ and *";
            return fault(at, "vehicle.controls.parameters", name, expected);
        }
        if let Some(group) = self.groups.iter().find(|group| group.is_empty()) {
            let expected = "the name of a group of parameters";
            return fault(at, "vehicle.controls.groups", group, expected);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controls(parameters: &[&str], groups: &[&str]) -> Controls {
        let all = |of: &[&str]| of.iter().map(|name| (*name).to_owned()).collect();
        Controls {
            parameters: all(parameters),
            groups: all(groups),
        }
    }

    #[test]
    fn what_defends_the_vehicle_is_offered_only_where_it_is_named_in_full() {
        let all = controls(&["*", "COM_DL_LOSS_T"], &[]);
        let names = all.names(&ParameterMetadata::default()).len();
        assert!(names > 500, "{names}");
        assert!(all.offers("MPC_XY_CRUISE", None) && all.offers("COM_DL_LOSS_T", None));
        for protected in [
            "COM_ARM_WO_GPS",
            "NAV_DLL_ACT",
            "GF_ACTION",
            "CBRK_USB_CHK",
            "MAV_SYS_ID",
            "BAT_CRIT_THR",
            "RC_MAP_KILL_SW",
            "RC_KILLSWITCH_TH",
            "CA_FAILURE_MODE",
            "VT_QC_T_LOSS",
            "VT_FW_QC_P",
            "RTL_RETURN_ALT",
            "CAL_MAG0_ID",
            "PWM_MAIN_FUNC1",
            "EKF2_GPS_CHECK",
            "NAV_FORCE_VT",
            "BAT1_V_EMPTY",
            "LNDMC_ROT_MAX",
        ] {
            assert!(!all.offers(protected, None), "{protected}");
            assert!(controls(&[protected], &[]).offers(protected, None));
        }
    }

    #[test]
    fn a_group_is_chosen_by_the_metadata_alone() {
        let file = r#"{"parameters":[{"name":"GF_X","type":"Float","group":"G"},
            {"name":"OWN_X","type":"Float","group":"G"},{"name":"OWN_Y","type":"Float","group":"H"}]}"#;
        let metadata = ParameterMetadata::read(file.as_bytes()).expect("the form of PX4");
        let group = controls(&[], &["G"]);
        assert!(group.names(&ParameterMetadata::default()).is_empty());
        let names: Vec<_> = group.names(&metadata).into_iter().collect();
        assert_eq!(names, ["OWN_X"]);
    }
}
