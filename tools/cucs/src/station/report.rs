//! The state of a vehicle in one line, and as JSON.

use serde_json::{Value, json};
use stanag_msgs::enums::FlightPathControlMode as Mode;

use super::outcome::{levels, loi_numbers};
use crate::session::vehicle::Vehicle;
use route_files::route::form::altitude_type_name;

/// `1b:00:01:01 LOI 2,4,5, mode 11 (waypoint), airborne, 47.3977412 8.5455939 518.2 m wgs84, 5.0 m/s, to waypoint 20`
pub(crate) fn line(vehicle: &Vehicle) -> String {
    let mut parts = vec![format!("{} LOI {}", vehicle.id, levels(vehicle.granted()))];
    match vehicle.mode() {
        Some(mode) => parts.push(format!("mode {}", mode.in_words())),
        None => parts.push("mode unknown".to_owned()),
    }
    match vehicle.landed() {
        Some(true) => parts.push("on the ground".to_owned()),
        Some(false) => parts.push("airborne".to_owned()),
        None => parts.push("state unknown".to_owned()),
    }
    match vehicle.position() {
        Some(at) => parts.push(format!(
            "{:.7} {:.7} {:.1} m {}",
            at.latitude_deg,
            at.longitude_deg,
            at.altitude_m,
            altitude_type_name(at.altitude_type)
        )),
        None => parts.push("no position".to_owned()),
    }
    if let Some(speed) = vehicle.ground_speed_m_s() {
        parts.push(format!("{speed:.1} m/s"));
    }
    if let Some(number) = vehicle.to_waypoint() {
        parts.push(format!("to waypoint {number}"));
    }
    if let Some((status, percent)) = vehicle.transfer_status() {
        parts.push(format!("transfer {status} {percent} %"));
    }
    parts.join(", ")
}

/// The same for programs; unknown values are null.
pub(crate) fn state(vehicle: &Vehicle) -> Value {
    let position = vehicle.position();
    json!({
        "vehicle": vehicle.id.to_string(),
        "loi": loi_numbers(vehicle.granted()),
        "mode": vehicle.mode().map(Mode::raw),
        "ua_state": vehicle.ua_state().map(|state| state.raw()),
        "landed": vehicle.landed(),
        "latitude_deg": position.map(|at| at.latitude_deg),
        "longitude_deg": position.map(|at| at.longitude_deg),
        "altitude_m": position.map(|at| at.altitude_m),
        "altitude_type": position.map(|at| at.altitude_type.raw()),
        "ground_speed_m_s": vehicle.ground_speed_m_s(),
        "from_waypoint": vehicle.from_waypoint(),
        "to_waypoint": vehicle.to_waypoint(),
    })
}

/// Vehicle Type (messages 2 to 5): its name beside its number. The custodian's list of the later editions is not
/// public; where MAVLink's MAV_TYPE is used instead, as by `vsm`, these are its names.
pub(crate) fn vehicle_type(number: u16) -> String {
    let name = match number {
        0 => return "not known".to_owned(),
        1 => "fixed wing",
        2 => "quadrotor",
        3 => "coaxial helicopter",
        4 => "helicopter",
        10 => "ground rover",
        11 => "surface boat",
        12 => "submarine",
        13 => "hexarotor",
        14 => "octorotor",
        15 => "tricopter",
        19 => "VTOL, two-rotor tailsitter",
        20 => "VTOL, four-rotor tailsitter",
        21 => "VTOL, tiltrotor",
        22 => "VTOL, separate rotors",
        23 => "VTOL, tailsitter",
        24 => "VTOL, tiltwing",
        29 => "dodecarotor",
        35 => "decarotor",
        other => return other.to_string(),
    };
    format!("{number} ({name} in MAVLink's list)")
}

#[cfg(test)]
mod tests {
    use super::vehicle_type;

    #[test]
    fn a_type_of_vehicle_has_its_name() {
        assert_eq!(vehicle_type(0), "not known");
        assert_eq!(vehicle_type(2), "2 (quadrotor in MAVLink's list)");
        assert_eq!(
            vehicle_type(22),
            "22 (VTOL, separate rotors in MAVLink's list)"
        );
        assert_eq!(vehicle_type(99), "99");
    }
}
