//! PX4's own settings that weaken the link or what happens without it: from parameter values to findings.
//!
//! [`SETTINGS`] is the table: which values weaken what, and what to set instead, by PX4 v1.18's source. [`judge`]
//! turns values into [`Finding`]s, one for each row. A setting that was not read, or that the vehicle does not have,
//! is [`Verdict::Unknown`] and never good. Signing depends on no parameter here: PX4 v1.18 has none for it (see
//! `MAV_SIGN_CFG`).
//!
//! ```
//! use mapping::hardening::{Reading, Verdict, judge};
//!
//! let vehicle = |name: &str| match name {
//!     "NAV_DLL_ACT" => Reading::Value(0.0),
//!     _ => Reading::NotAnswered,
//! };
//! let findings = judge(vehicle);
//! let action = findings.iter().find(|one| one.setting.name == "NAV_DLL_ACT").unwrap();
//! assert_eq!((action.verdict, action.shown().as_str()), (Verdict::Weak, "0 (disabled)"));
//! assert!(findings.iter().all(|one| one.setting.name == "NAV_DLL_ACT" || one.verdict == Verdict::Unknown));
//! ```

mod setting;
mod table;

pub use self::setting::{Meaning, Setting, Verdict};
pub use self::table::SETTINGS;

/// The vehicle's answer about a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Its value.
    Value(f64),
    /// The vehicle has no parameter of this name.
    Absent,
    /// It was not read.
    NotAnswered,
}

/// What is reported about one setting.
#[derive(Debug, Clone, Copy)]
pub struct Finding {
    /// The row of the table.
    pub setting: &'static Setting,
    /// The vehicle's answer.
    pub reading: Reading,
    /// The judgement.
    pub verdict: Verdict,
    /// What it weakens, or why it is unknown; empty where it is good.
    pub why: &'static str,
}

/// Every setting, judged by the vehicle's answers.
pub fn judge(vehicle: impl Fn(&str) -> Reading) -> Vec<Finding> {
    let finding = |setting: &'static Setting| {
        let reading = vehicle(setting.name);
        let off = setting.needs.map(&vehicle) == Some(Reading::Value(0.0));
        let (verdict, why) = match reading {
            Reading::Value(_) if off => (Verdict::Good, ""),
            Reading::Value(value) => setting.judge(value),
            Reading::Absent => (Verdict::Unknown, "the vehicle has no such parameter"),
            Reading::NotAnswered => (Verdict::Unknown, "not read"),
        };
        Finding {
            setting,
            reading,
            verdict,
            why,
        }
    };
    SETTINGS.iter().map(finding).collect()
}

impl Finding {
    /// The value by number and name; "unknown" where it was not read.
    #[must_use]
    pub fn shown(&self) -> String {
        match self.reading {
            Reading::Value(value) => self.setting.meaning.show(value),
            Reading::Absent | Reading::NotAnswered => "unknown".to_owned(),
        }
    }

    /// What to set, by number and name.
    #[must_use]
    pub fn better_shown(&self) -> String {
        self.setting.meaning.show(self.setting.better)
    }
}

#[cfg(test)]
mod tests {
    use mavlink_link::service::param::Name;

    use super::*;
    use crate::parameter;

    fn judged(values: &[(&str, f64)], name: &str) -> Finding {
        let vehicle = |asked: &str| {
            let value = values.iter().find(|(name, _)| *name == asked);
            value.map_or(Reading::Absent, |(_, value)| Reading::Value(*value))
        };
        let found = judge(vehicle);
        *found.iter().find(|one| one.setting.name == name).unwrap()
    }

    #[test]
    fn each_setting_has_a_name_that_px4_can_be_asked_for_and_stands_once() {
        for setting in SETTINGS {
            assert!(Name::new(setting.name).is_ok(), "{}", setting.name);
            let same = SETTINGS.iter().filter(|one| one.name == setting.name);
            assert_eq!(same.count(), 1, "{}", setting.name);
            assert!(
                setting
                    .needs
                    .is_none_or(|name| SETTINGS.iter().any(|one| one.name == name))
            );
        }
    }

    #[test]
    fn what_is_recommended_is_good_and_px4_takes_it() {
        for setting in SETTINGS {
            let (verdict, why) = setting.judge(setting.better);
            assert_eq!((verdict, why), (Verdict::Good, ""), "{}", setting.name);
            // The parameters of ports, USB and DDS depend on the board, so the table of parameters does not have
            // them.
            if parameter::range(setting.name).is_some() {
                let taken = parameter::checked(setting.name, setting.better, None);
                assert!(taken.is_ok(), "{}: {taken:?}", setting.name);
            }
        }
    }

    #[test]
    fn values_have_the_names_of_px4s_own_enumerations() {
        for setting in SETTINGS {
            let (Meaning::Choice(named), Some(range)) =
                (setting.meaning, parameter::range(setting.name))
            else {
                continue;
            };
            if !range.values.is_empty() {
                let named: Vec<i32> = named.iter().map(|(value, _)| *value).collect();
                assert_eq!(named, range.values, "{}", setting.name);
            }
        }
    }

    #[test]
    fn every_rule_is_reached_by_a_value() {
        for setting in SETTINGS {
            for rule in setting.rules {
                let reached = (-1..2_000_000)
                    .map(f64::from)
                    .any(|value| setting.judge(value).1 == rule.why);
                assert!(reached, "{}: {}", setting.name, rule.why);
                assert!(matches!(rule.verdict, Verdict::Weak | Verdict::Decide));
            }
        }
    }

    #[test]
    fn what_is_not_read_and_what_is_not_there_is_never_good() {
        for reading in [Reading::Absent, Reading::NotAnswered] {
            for finding in judge(|_| reading) {
                assert_eq!(
                    finding.verdict,
                    Verdict::Unknown,
                    "{}",
                    finding.setting.name
                );
                assert!(!finding.why.is_empty());
            }
        }
    }

    #[test]
    fn a_value_that_px4_does_not_know_is_weak() {
        // PX4 stores 99, and its data-link failsafe then does nothing.
        let weak = judged(&[("NAV_DLL_ACT", 99.0)], "NAV_DLL_ACT");
        assert_eq!((weak.verdict, weak.shown().as_str()), (Verdict::Weak, "99"));
        for odd in [f64::NAN, f64::INFINITY, 1.5, -7.0] {
            assert_eq!(
                judged(&[("NAV_DLL_ACT", odd)], "NAV_DLL_ACT").verdict,
                Verdict::Weak,
                "{odd}"
            );
            assert_eq!(
                judged(&[("COM_DLL_EXCEPT", odd)], "COM_DLL_EXCEPT").verdict,
                Verdict::Weak,
                "{odd}"
            );
        }
    }

    #[test]
    fn what_px4_makes_of_sticks_is_to_be_decided() {
        let verdict = |name, value| judged(&[(name, value)], name).verdict;
        for value in [0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0] {
            let found = judged(&[("COM_RC_IN_MODE", value)], "COM_RC_IN_MODE");
            assert_eq!(found.verdict, Verdict::Decide, "{value}");
            assert!(found.why.contains("(2010)"), "{value}: {}", found.why);
        }
        assert_eq!(verdict("COM_RCL_EXCEPT", 0.0), Verdict::Good);
        assert_eq!(verdict("COM_RCL_EXCEPT", 7.0), Verdict::Decide);
        for off in [-1.0, 0.0] {
            assert_eq!(verdict("MAN_KILL_GEST_T", off), Verdict::Good);
        }
        assert_eq!(verdict("MAN_KILL_GEST_T", 0.5), Verdict::Decide);
    }

    #[test]
    fn forwarding_counts_only_on_a_port_that_is_in_use() {
        let of = |config| {
            judged(
                &[("MAV_1_FORWARD", 1.0), ("MAV_1_CONFIG", config)],
                "MAV_1_FORWARD",
            )
            .verdict
        };
        assert_eq!((of(0.0), of(102.0)), (Verdict::Good, Verdict::Decide));
        // Whether the port is in use is not known, so its forwarding cannot be called good.
        assert_eq!(
            judged(&[("MAV_1_FORWARD", 1.0)], "MAV_1_FORWARD").verdict,
            Verdict::Decide
        );
    }

    #[test]
    fn values_are_shown_by_name_with_the_number_beside_it() {
        let shown = |name, value| judged(&[(name, value)], name).shown();
        assert_eq!(shown("NAV_DLL_ACT", 2.0), "2 (return)");
        assert_eq!(shown("COM_DLL_EXCEPT", 3.0), "3 (mission, auto modes)");
        assert_eq!(shown("COM_DLL_EXCEPT", 0.0), "0 (none)");
        assert_eq!(shown("COM_DL_LOSS_T", 10.0), "10 s");
        assert_eq!(shown("MAV_0_CONFIG", 12.0), "12");
        assert_eq!(judged(&[], "MAV_0_CONFIG").shown(), "unknown");
    }
}
