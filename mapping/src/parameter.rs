//! PX4's parameters: the values that this VSM reads of a vehicle, and what may be written to each parameter by name.
//!
//! PX4 stores what it is given, in range or not: a write is checked here first, and one of a parameter that the table
//! does not have is refused. The table is that of PX4 v1.18 (`data/px4-v1.18-parameters.csv`), sorted by name.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use mavlink_link::service::param::Value;
use stanag_msgs::Text;
use stanag_msgs::enums::ParameterKind;
use stanag_msgs::messages::ParameterReport;

/// The parameters that are read once a vehicle is there.
pub const NAMES: &[&str] = &[
    "BAT_CRIT_THR",
    "BAT_EMERGEN_THR",
    "BAT_LOW_THR",
    "COM_DL_LOSS_T",
    "COM_OBL_RC_ACT",
    "COM_OF_LOSS_T",
    "COM_RCL_EXCEPT",
    "COM_RC_IN_MODE",
    "COM_RC_LOSS_T",
    "FW_AIRSPD_MAX",
    "FW_AIRSPD_MIN",
    "FW_AIRSPD_TRIM",
    "FW_LND_ANG",
    "FW_R_LIM",
    "FW_T_CLMB_MAX",
    "FW_T_SINK_MAX",
    "GF_ACTION",
    "GF_MAX_HOR_DIST",
    "GF_MAX_VER_DIST",
    "MIS_TAKEOFF_ALT",
    "MIS_TKO_LAND_REQ",
    "MPC_ACC_HOR",
    "MPC_JERK_AUTO",
    "MPC_XY_CRUISE",
    "MPC_XY_TRAJ_P",
    "MPC_XY_VEL_MAX",
    "MPC_Z_VEL_MAX_DN",
    "MPC_Z_VEL_MAX_UP",
    "MPC_Z_V_AUTO_DN",
    "MPC_Z_V_AUTO_UP",
    "NAV_ACC_RAD",
    "NAV_DLL_ACT",
    "NAV_LOITER_RAD",
    "NAV_RCL_ACT",
    "NPFG_DAMPING",
    "NPFG_PERIOD",
    "NPFG_ROLL_TC",
    "NPFG_SW_DST_MLT",
    "RTL_TYPE",
    "VTO_LOITER_ALT",
    "VT_FW_MIN_ALT",
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

    /// Why PX4 ignores the sticks of a ground station (MANUAL_CONTROL), where it is known to do so: then it refuses every
    /// mode that is flown by them, and where a remote control is on, flies that one's.
    #[must_use]
    pub fn ignores_sticks(&self) -> Option<&'static str> {
        match self.get("COM_RC_IN_MODE")? as i64 {
            0 => Some("COM_RC_IN_MODE is 0 (a remote control only)"),
            4 => Some("COM_RC_IN_MODE is 4 (none)"),
            _ => None,
        }
    }

    /// Why PX4 ignores the sticks of a ground station that begin while others reach it, those of a remote control or of another station
    /// (ManualControlSelector::isInputValid), where it is known to do so.
    #[must_use]
    pub fn prefers_other_sticks(&self) -> Option<&'static str> {
        match self.get("COM_RC_IN_MODE")? as i64 {
            1 => Some("COM_RC_IN_MODE is 1 (of ground stations, the one that was first)"),
            2 => Some("COM_RC_IN_MODE is 2 (what was first, until it ends)"),
            3 => Some("COM_RC_IN_MODE is 3 (what was first since its start)"),
            5 => Some("COM_RC_IN_MODE is 5 (a remote control before ground stations)"),
            7 => Some("COM_RC_IN_MODE is 7 (a remote control before ground stations)"),
            _ => None,
        }
    }

    /// Why PX4 would bring the vehicle down once the sticks of a ground station end, whatever mode is flown then, where it is
    /// known to do so: sticks that have come once in a flight are lost in every mode that COM_RCL_EXCEPT does not name
    /// (Failsafe::checkStateAndMode).
    #[must_use]
    pub fn falls_without_sticks(&self) -> Option<&'static str> {
        /// Mission, automatic modes, OFFBOARD: those that a ground station commands.
        const COMMANDED: i64 = 0b111;
        let exempt = self.get("COM_RCL_EXCEPT").unwrap_or(0.0) as i64;
        match self.get("NAV_RCL_ACT")? as i64 {
            _ if exempt & COMMANDED == COMMANDED => None,
            5 => Some("NAV_RCL_ACT is 5 (terminate)"),
            6 => Some("NAV_RCL_ACT is 6 (disarm)"),
            _ => None,
        }
    }

    /// For how long PX4 flies sticks that have ended before it takes them for lost, s; its default where that is not known.
    #[must_use]
    pub fn sticks_last_s(&self) -> f64 {
        let set = self.get("COM_RC_LOSS_T").filter(|set| *set >= 0.0);
        set.map_or(0.5, |set| set.min(35.0))
    }

    /// Takes in a value; true where it is another than before. Names that are not in [`NAMES`] are not kept.
    pub fn set(&mut self, name: &str, value: f64) -> bool {
        let Some(known) = NAMES.iter().find(|known| **known == name) else {
            return false;
        };
        value.is_finite() && self.0.insert(known, value) != Some(value)
    }
}

/// What may be written to a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Range {
    /// Integer or float.
    pub kind: ParameterKind,
    /// The least value; `None` where only its kind bounds it.
    pub low: Option<f64>,
    /// The greatest.
    pub high: Option<f64>,
    /// The only values that mean something, where it is an enumeration.
    pub values: Vec<i32>,
}

/// A parameter as the vehicle's own metadata describe it.
#[derive(Debug, Clone, PartialEq)]
pub struct Described {
    /// What may be written to it.
    pub range: Range,
    /// The value of the firmware itself.
    pub default: Option<f64>,
    /// Its unit; empty where it has none.
    pub unit: String,
    /// What it is, in some words.
    pub short: String,
    /// The group that it belongs to.
    pub group: String,
    /// Digits after the point that mean something.
    pub decimals: Option<u8>,
    /// Whether the vehicle uses a new value only once it has restarted.
    pub restart: bool,
}

/// A write that is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// The table does not have it.
    #[error("parameter {0} is not in the table of PX4 v1.18: its range is not known")]
    Unknown(String),
    /// Written, the vehicle would no longer be found on this link.
    #[error(
        "parameter {0} identifies the vehicle on this link: it cannot be written through this VSM"
    )]
    Identity(String),
    /// The vehicle reports a float where the table has an integer, or the reverse.
    #[error(
        "parameter {0}: its metadata and the table of PX4 v1.18 differ in whether it is an integer: its range is not known"
    )]
    Disputed(String),
    /// No number, or not whole where it must be.
    #[error("parameter {name}: {value}, expected {expected}")]
    Kind {
        /// The parameter.
        name: String,
        /// What was to be written.
        value: f64,
        /// What it takes.
        expected: &'static str,
    },
    /// Outside its range.
    #[error("parameter {name}: {value}, expected {low} to {high}")]
    Range {
        /// The parameter.
        name: String,
        /// What was to be written.
        value: f64,
        /// The least.
        low: f64,
        /// The greatest.
        high: f64,
    },
    /// None of the values of an enumeration.
    #[error("parameter {name}: {value}, expected one of {values:?}")]
    Value {
        /// The parameter.
        name: String,
        /// What was to be written.
        value: f64,
        /// What it takes.
        values: Vec<i32>,
    },
}

/// What may be written to the parameter of this name; `None` where the table does not have it.
#[must_use]
pub fn range(name: &str) -> Option<Range> {
    let mut columns = line(name)?.split(',').skip(1);
    let kind = match columns.next() {
        Some("i") => ParameterKind::Integer,
        _ => ParameterKind::Float,
    };
    let mut bound = || columns.next().and_then(|number| number.parse().ok());
    let (low, high) = (bound(), bound());
    let values = columns.next().unwrap_or("").split_whitespace();
    Some(Range {
        kind,
        low,
        high,
        values: values.filter_map(|value| value.parse().ok()).collect(),
    })
}

/// Whether the vehicle uses a new value of this parameter only once it has restarted: by the table where its metadata does not deny it,
/// and by its metadata alone where the table does not have it. The metadata of PX4 v1.18 has `rebootRequired` also where the source
/// denies it (jsonout.py), such as for the filters of the gyroscopes.
#[must_use]
pub fn applies_after_restart(name: &str, described: Option<&Described>) -> bool {
    let by_table = line(name).map(|line| line.split(',').nth(5) == Some("r"));
    match described {
        None => by_table.unwrap_or(false),
        Some(described) => described.restart && by_table.unwrap_or(true),
    }
}

/// The names of the table, sorted.
pub fn names() -> impl Iterator<Item = &'static str> {
    let lines = TABLE.lines().filter(|line| !line.starts_with('#'));
    lines.filter_map(|line| line.split(',').next())
}

/// The same as the vehicle itself describes it, where it does: its firmware may be another than the table's. Where it
/// bounds nothing, the table does.
fn range_of(name: &str, described: Option<&Described>) -> Option<Range> {
    let Some(described) = described else {
        return range(name);
    };
    let own = &described.range;
    let bounds = own.low.is_some() || own.high.is_some() || !own.values.is_empty();
    let table = range(name).filter(|table| !bounds && table.kind == own.kind);
    Some(table.unwrap_or_else(|| own.clone()))
}

/// The value to write. `described` is the parameter in the vehicle's metadata.
///
/// # Errors
/// It must not be written.
pub fn checked(
    name: &str,
    value: f64,
    described: Option<&Described>,
) -> Result<Value, ParameterError> {
    let range =
        range_of(name, described).ok_or_else(|| ParameterError::Unknown(name.to_owned()))?;
    if IDENTITY.contains(&name) {
        return Err(ParameterError::Identity(name.to_owned()));
    }
    if self::range(name).is_some_and(|table| table.kind != range.kind) {
        return Err(ParameterError::Disputed(name.to_owned()));
    }
    let kind = |expected| ParameterError::Kind {
        name: name.to_owned(),
        value,
        expected,
    };
    let typed = match range.kind {
        ParameterKind::Integer => {
            let whole = value.fract() == 0.0
                && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&value);
            if !whole {
                return Err(kind("a whole number of 32 bits"));
            }
            Value::Int(value as i32)
        }
        _ => {
            let narrow = value as f32;
            if !narrow.is_finite() {
                return Err(kind("a number"));
            }
            Value::Real(narrow)
        }
    };
    let low = range.low.unwrap_or(f64::NEG_INFINITY);
    let high = range.high.unwrap_or(f64::INFINITY);
    // A float is compared as it is stored: 41001 has reported its range so, and 0.1 of 32 bits is above 0.1 of 64.
    let within = match typed {
        Value::Int(_) => (low..=high).contains(&value),
        Value::Real(narrow) => (low as f32..=high as f32).contains(&narrow),
    };
    if !within {
        return Err(ParameterError::Range {
            name: name.to_owned(),
            value,
            low,
            high,
        });
    }
    match typed {
        Value::Int(whole) if !range.values.is_empty() && !range.values.contains(&whole) => {
            Err(ParameterError::Value {
                name: name.to_owned(),
                value,
                values: range.values,
            })
        }
        typed => Ok(typed),
    }
}

/// 50012, without its stamp. `place` is index and count within an answer about all parameters.
#[must_use]
pub fn report(
    name: &str,
    value: Value,
    described: Option<&Described>,
    place: Option<(u16, u16)>,
) -> ParameterReport {
    let range = range_of(name, described);
    let (kind, value) = match value {
        Value::Int(value) => (ParameterKind::Integer, f64::from(value)),
        Value::Real(value) => (ParameterKind::Float, f64::from(value)),
    };
    let min = |range: &Range| range.values.first().map(|value| f64::from(*value));
    let greatest = |range: &Range| range.values.last().map(|value| f64::from(*value));
    ParameterReport {
        time_stamp: None,
        parameter_name: Some(Text::new(name)),
        parameter_kind: Some(kind),
        value: Some(value),
        minimum: range.as_ref().and_then(|range| range.low.or(min(range))),
        maximum: range
            .as_ref()
            .and_then(|range| range.high.or(greatest(range))),
        parameter_index: place.map(|(index, _)| index),
        parameter_count: place.map(|(_, count)| count),
    }
}

/// The line of a parameter.
fn line(name: &str) -> Option<&'static str> {
    static LINES: LazyLock<Vec<&str>> = LazyLock::new(|| TABLE.lines().collect());
    let name_of = |line: &&'static str| line.split(',').next().unwrap_or_default();
    let at = LINES.binary_search_by_key(&name, name_of).ok()?;
    LINES.get(at).copied()
}

static TABLE: &str = include_str!("../data/px4-v1.18-parameters.csv");
/// With another id, neither side would accept the other's frames any longer.
const IDENTITY: &[&str] = &["MAV_COMP_ID", "MAV_SYS_ID"];

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

    #[test]
    fn sticks_are_ignored_by_two_values_of_their_source() {
        let mut parameters = Parameters::default();
        assert_eq!(parameters.ignores_sticks(), None, "not known");
        let ignored = (0..=8).filter(|value| {
            parameters.set("COM_RC_IN_MODE", f64::from(*value));
            parameters.ignores_sticks().is_some()
        });
        assert_eq!(ignored.collect::<Vec<_>>(), [0, 4]);
    }

    #[test]
    fn other_sticks_go_first_unless_those_of_a_ground_station_have_priority() {
        let mut parameters = Parameters::default();
        assert_eq!(parameters.prefers_other_sticks(), None, "not known");
        for value in 0..=8 {
            parameters.set("COM_RC_IN_MODE", f64::from(value));
            let why = parameters.prefers_other_sticks();
            assert_eq!(why.is_some(), [1, 2, 3, 5, 7].contains(&value), "{value}");
            let named = format!("COM_RC_IN_MODE is {value} (");
            assert!(why.is_none_or(|why| why.starts_with(&named)), "{why:?}");
        }
    }

    #[test]
    fn sticks_that_end_bring_a_vehicle_down_by_two_values_unless_no_commanded_mode_misses_them() {
        let mut parameters = Parameters::default();
        assert_eq!(parameters.falls_without_sticks(), None, "not known");
        let falls = |parameters: &mut Parameters| {
            let falling = (1..=7).filter(|action| {
                parameters.set("NAV_RCL_ACT", f64::from(*action));
                parameters.falls_without_sticks().is_some()
            });
            falling.collect::<Vec<_>>()
        };
        assert_eq!(falls(&mut parameters), [5, 6]);
        parameters.set("COM_RCL_EXCEPT", 3.0);
        assert_eq!(falls(&mut parameters), [5, 6], "set points");
        parameters.set("COM_RCL_EXCEPT", 15.0);
        assert!(falls(&mut parameters).is_empty());
    }

    #[test]
    fn every_line_is_found_by_its_name_and_nothing_else_is() {
        let lines = TABLE.lines().filter(|line| !line.starts_with('#'));
        let mut count = 0;
        let mut before = "";
        for text in lines {
            let name = text.split(',').next().unwrap();
            assert!(before < name, "{name} after {before}");
            assert_eq!(line(name), Some(text));
            assert!(range(name).is_some());
            before = name;
            count += 1;
        }
        assert!(count > 1_800);
        for none in ["", "A", "MIS_TAKEOFF_AL", "MIS_TAKEOFF_ALTX", "ZZZ"] {
            assert_eq!(range(none), None, "{none}");
        }
    }

    #[test]
    fn what_the_vehicle_would_store_blindly_is_refused_here() {
        assert!(checked("NAV_DLL_ACT", 2.0, None) == Ok(Value::Int(2)));
        // A real vehicle takes all of these.
        assert!(matches!(
            checked("NAV_DLL_ACT", 99.0, None),
            Err(ParameterError::Value { .. })
        ));
        assert!(matches!(
            checked("NAV_DLL_ACT", 1.5, None),
            Err(ParameterError::Kind { .. })
        ));
        assert!(matches!(
            checked("COM_DL_LOSS_T", 4.0, None),
            Err(ParameterError::Range { .. })
        ));
        assert!(matches!(
            checked("MIS_TAKEOFF_ALT", -1.0, None),
            Err(ParameterError::Range { .. })
        ));
        assert!(matches!(
            checked("MIS_TAKEOFF_ALT", f64::NAN, None),
            Err(ParameterError::Kind { .. })
        ));
        assert!(matches!(
            checked("MPC_XY_CRUISE", 1e40, None),
            Err(ParameterError::Kind { .. })
        ));
        assert!(matches!(
            checked("NOT_A_PARAMETER", 1.0, None),
            Err(ParameterError::Unknown(_))
        ));
        assert!(matches!(
            checked("MAV_SYS_ID", 2.0, None),
            Err(ParameterError::Identity(_))
        ));
    }

    #[test]
    fn metadata_without_bounds_takes_none_away_and_its_kind_is_the_tables() {
        let of = |kind, high| Described {
            range: Range {
                kind,
                low: None,
                high,
                values: Vec::new(),
            },
            default: None,
            unit: String::new(),
            short: String::new(),
            group: String::new(),
            decimals: None,
            restart: false,
        };
        let write = |described: &Described| checked("COM_DL_LOSS_T", 400.0, Some(described));
        let open = of(ParameterKind::Integer, None);
        assert!(matches!(write(&open), Err(ParameterError::Range { .. })));
        let wider = of(ParameterKind::Integer, Some(500.0));
        assert_eq!(write(&wider), Ok(Value::Int(400)));
        let float = of(ParameterKind::Float, Some(500.0));
        assert!(matches!(write(&float), Err(ParameterError::Disputed(_))));
        let own = checked("NOT_IN_THE_TABLE", 0.5, Some(&float));
        assert_eq!(own, Ok(Value::Real(0.5)));
        for (name, by_table) in [("MNT_MODE_IN", true), ("NAV_DLL_ACT", false), ("A", false)] {
            assert_eq!(applies_after_restart(name, None), by_table, "{name}");
            assert!(!applies_after_restart(name, Some(&open)), "{name}");
        }
        let restart = Described {
            restart: true,
            ..open
        };
        for (name, waits) in [
            ("MNT_MODE_IN", true),
            ("IMU_GYRO_CUTOFF", false),
            ("A", true),
        ] {
            assert_eq!(applies_after_restart(name, Some(&restart)), waits, "{name}");
        }
    }

    #[test]
    fn a_report_contains_the_range_with_the_value() {
        let reported = report("COM_DL_LOSS_T", Value::Int(10), None, Some((3, 9)));
        assert_eq!(
            (reported.minimum, reported.maximum),
            (Some(5.0), Some(300.0))
        );
        assert_eq!(
            (reported.parameter_index, reported.parameter_count),
            (Some(3), Some(9))
        );
        let reported = report("NAV_DLL_ACT", Value::Int(0), None, None);
        assert_eq!((reported.minimum, reported.maximum), (Some(0.0), Some(6.0)));
    }
}
