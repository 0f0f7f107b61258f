//! The files of the vehicle's metadata, as PX4 has them: a general one that names those of its events and parameters,
//! each packed as XZ.

use std::fmt::Write as _;
use std::io::Write as _;

use lzma_rust2::{XzOptions, XzWriter};
use mavlink_link::service::param::Value;

use super::events;
use super::param::Parameter;

/// The files with their paths.
pub(crate) fn files(parameters: impl Iterator<Item = Parameter>) -> [(&'static str, Vec<u8>); 3] {
    let general = format!(
        r#"{{"metadataTypes": [{{"type": 1, "uri": "mftp:/{PARAMETERS_FILE}", "fileCrc": 0}},
        {{"type": 4, "uri": "mftp:/{EVENTS_FILE}", "fileCrc": 0}}], "version": 1}}"#
    );
    [
        (GENERAL_FILE, pack(general.as_bytes())),
        (PARAMETERS_FILE, pack(describe(parameters).as_bytes())),
        (EVENTS_FILE, pack(events::definitions().as_bytes())),
    ]
}

/// As PX4's build makes it from the definitions in its source; a parameter outside [`KNOWN`] has no range here.
fn describe(parameters: impl Iterator<Item = Parameter>) -> String {
    let mut all = String::new();
    for Parameter { name, value, .. } in parameters {
        let comma = if all.is_empty() { "" } else { ",\n" };
        let (kind, value) = match value {
            Value::Int(value) => ("Int32", value.to_string()),
            Value::Real(value) => ("Float", value.to_string()),
        };
        let known = KNOWN.iter().find(|(of, _)| *of == name.as_str());
        let more = known.map_or(r#""group": "Simulator""#, |(_, more)| more);
        let _ = write!(
            all,
            r#"{comma}{{"name": "{name}", "type": "{kind}", "default": {value}, {more}}}"#
        );
    }
    format!(r#"{{"version": 1, "parameters": [{all}]}}"#)
}

fn pack(content: &[u8]) -> Vec<u8> {
    let packed = XzWriter::new(Vec::new(), XzOptions::with_preset(1)).and_then(|mut writer| {
        writer.write_all(content)?;
        writer.finish()
    });
    // Packing writes to memory only, so it cannot fail.
    packed.unwrap_or_default()
}

/// The URI in PX4's COMPONENT_METADATA.
pub(crate) const GENERAL_URI: &str = "mftp://etc/extras/component_general.json.xz";
const GENERAL_FILE: &str = "/etc/extras/component_general.json.xz";
const EVENTS_FILE: &str = "/etc/extras/all_events.json.xz";
const PARAMETERS_FILE: &str = "/etc/extras/parameters.json.xz";

/// Parameters as PX4 v1.18 describes them.
const KNOWN: [(&str, &str); 5] = [
    (
        "MIS_TAKEOFF_ALT",
        r#""group": "Mission", "shortDesc": "Default take-off altitude", "units": "m", "min": 0.0, "decimalPlaces": 1"#,
    ),
    (
        "MPC_XY_CRUISE",
        r#""group": "Multicopter Position Control", "shortDesc": "Default horizontal velocity in autonomous modes",
        "units": "m/s", "min": 3.0, "max": 20.0, "decimalPlaces": 0"#,
    ),
    (
        "MPC_Z_V_AUTO_UP",
        r#""group": "Multicopter Position Control", "shortDesc": "Ascent velocity in autonomous modes", "units": "m/s",
        "min": 0.5, "max": 8.0, "decimalPlaces": 1"#,
    ),
    (
        "NAV_DLL_ACT",
        r#""group": "Commander", "shortDesc": "Set GCS connection loss failsafe mode", "values": [{"value": 0,
        "description": "Disabled"}, {"value": 1, "description": "Hold mode"}, {"value": 2, "description": "Return mode"},
        {"value": 3, "description": "Land mode"}, {"value": 5, "description": "Terminate"},
        {"value": 6, "description": "Disarm"}]"#,
    ),
    (
        "NAV_LOITER_RAD",
        r#""group": "Mission", "shortDesc": "Loiter radius (FW only)", "units": "m", "min": -10000.0, "max": 10000.0,
        "decimalPlaces": 1"#,
    ),
];
