//! What becomes of each message on the other side, as data: the source of `docs/reference/mapping-tables.md`.

/// A DLI message that leads to MAVLink.
#[derive(Debug, Clone, Copy)]
pub struct ToVehicle {
    /// Message Type.
    pub dli: u16,
    /// Which part of it, where one message leads to several.
    pub part: &'static str,
    /// What is sent to the vehicle.
    pub mavlink: &'static str,
    /// What of the vehicle shows that it is done.
    pub shown_by: &'static str,
}

/// A MAVLink message of the vehicle that is read.
#[derive(Debug, Clone, Copy)]
pub struct FromVehicle {
    /// Its name.
    pub mavlink: &'static str,
    /// Which of its fields.
    pub fields: &'static str,
    /// The DLI messages that are made of it.
    pub dli: &'static [u16],
}

const fn to(
    dli: u16,
    part: &'static str,
    mavlink: &'static str,
    shown_by: &'static str,
) -> ToVehicle {
    ToVehicle {
        dli,
        part,
        mavlink,
        shown_by,
    }
}

const fn from(mavlink: &'static str, fields: &'static str, dli: &'static [u16]) -> FromVehicle {
    FromVehicle {
        mavlink,
        fields,
        dli,
    }
}

/// Every DLI message that leads to MAVLink, in the order of the types.
pub static TO_VEHICLE: &[ToVehicle] = &[
    to(
        2008,
        "start, stop",
        "COMMAND_LONG COMPONENT_ARM_DISARM, after DO_SET_MODE AUTO.LOITER",
        "HEARTBEAT.base_mode",
    ),
    to(
        2010,
        "while mode 2 is entered or flown",
        "MANUAL_CONTROL, 25 a second",
        "HEARTBEAT.custom_mode",
    ),
    to(
        2016,
        "mode 2",
        "DO_SET_MODE POSCTL, once MANUAL_CONTROL runs",
        "HEARTBEAT, CURRENT_MODE",
    ),
    to(
        2016,
        "mode 11",
        "MISSION_SET_CURRENT where a waypoint is commanded, DO_SET_MODE AUTO.MISSION",
        "MISSION_CURRENT; HEARTBEAT, CURRENT_MODE",
    ),
    to(
        2016,
        "mode 12",
        "DO_SET_MODE AUTO.LOITER, or COMMAND_INT DO_REPOSITION, DO_ORBIT",
        "HEARTBEAT, CURRENT_MODE; POSITION_TARGET_GLOBAL_INT",
    ),
    to(
        2016,
        "mode 15",
        "SET_POSITION_TARGET_LOCAL_NED, 20 a second, then DO_SET_MODE OFFBOARD",
        "HEARTBEAT, CURRENT_MODE",
    ),
    to(
        2016,
        "mode 19",
        "DO_SET_MODE AUTO.LAND",
        "HEARTBEAT, CURRENT_MODE",
    ),
    to(
        2016,
        "mode 21",
        "DO_SET_MODE AUTO.LOITER, COMPONENT_ARM_DISARM, NAV_TAKEOFF",
        "HEARTBEAT.base_mode, EXTENDED_SYS_STATE.landed_state",
    ),
    to(
        2016,
        "modes 23, 24",
        "a mission upload where such a route is stored, DO_SET_MODE AUTO.MISSION; else AUTO.RTL, AUTO.LAND",
        "HEARTBEAT, CURRENT_MODE",
    ),
    to(
        2016,
        "Commanded Speed",
        "DO_CHANGE_SPEED; of a multicopter's circle DO_ORBIT",
        "its COMMAND_ACK; VFR_HUD.groundspeed where a circle is flown already",
    ),
    to(
        13000,
        "modes 1, 2",
        "MISSION_CLEAR_ALL; MISSION_COUNT, MISSION_ITEM_INT, read back by MISSION_REQUEST_LIST, MISSION_REQUEST_INT",
        "the items read back; MISSION_CURRENT.mission_id and mission_state",
    ),
    to(
        13002,
        "after 13000",
        "NAV_WAYPOINT, DO_CHANGE_SPEED, DO_JUMP",
        "as 13000",
    ),
    to(
        13003,
        "after 13000",
        "NAV_LOITER_TIME, NAV_LOITER_UNLIM",
        "as 13000",
    ),
    to(
        17001,
        "3009, 3010, 16001",
        "SET_MESSAGE_INTERVAL of WIND_COV, HIGHRES_IMU, ESTIMATOR_STATUS",
        "the message",
    ),
    to(
        50001,
        "after 13000",
        "NAV_WAYPOINT, one a chord",
        "as 13000",
    ),
    to(
        50002,
        "after 13000",
        "NAV_WAYPOINT, one a chord",
        "as 13000",
    ),
    to(
        50010,
        "",
        "PARAM_REQUEST_READ, PARAM_REQUEST_LIST",
        "PARAM_VALUE, PARAM_ERROR",
    ),
    to(
        50011,
        "",
        "PARAM_SET",
        "PARAM_VALUE with the value that was set",
    ),
    to(50014, "to the vehicle", "PING", "PING"),
    to(
        50017,
        "modes 1, 2",
        "MISSION_CLEAR_ALL, MISSION_COUNT, MISSION_ITEM_INT of type fence: NAV_FENCE_POLYGON_VERTEX_INCLUSION, NAV_FENCE_POLYGON_VERTEX_EXCLUSION, NAV_FENCE_CIRCLE_INCLUSION, NAV_FENCE_CIRCLE_EXCLUSION",
        "the items read back; MISSION_CURRENT.fence_id",
    ),
];

/// Every MAVLink message of the vehicle whose content is kept, by name.
pub static FROM_VEHICLE: &[FromVehicle] = &[
    from("ATTITUDE", "angles and rates", &[3010, 4000]),
    from("AUTOPILOT_VERSION", "versions, board, uid", &[50013]),
    from(
        "BATTERY_STATUS",
        "voltages, current, temperature, charge",
        &[3002, 12101, 16000, 16001],
    ),
    from("CURRENT_MODE", "custom_mode", &[3001, 3002]),
    from("ESTIMATOR_STATUS", "flags", &[16000, 16001]),
    from("EXTENDED_SYS_STATE", "landed_state", &[3002]),
    from(
        "GLOBAL_POSITION_INT",
        "position, height above home, velocity",
        &[3009, 4000, 4001],
    ),
    from(
        "GPS_RAW_INT",
        "fix_type, and the geoid by alt and alt_ellipsoid",
        &[3002, 3009, 4000, 4001, 16000, 16001],
    ),
    from(
        "HEARTBEAT",
        "type, custom_mode, armed, system_status",
        &[2, 3, 3000, 3001, 3002, 3007, 16000, 16001],
    ),
    from("HIGHRES_IMU", "accelerations", &[3010]),
    from("HOME_POSITION", "home", &[4001]),
    from("LOCAL_POSITION_NED", "velocity", &[3009, 4000]),
    from(
        "MISSION_CURRENT",
        "seq, state, ids of mission and fence",
        &[3002, 4001, 14000, 50018],
    ),
    from("MISSION_ITEM_REACHED", "seq", &[]),
    from(
        "ORBIT_EXECUTION_STATUS",
        "centre and radius of the circle flown",
        &[17000],
    ),
    from("POSITION_TARGET_GLOBAL_INT", "set point", &[17000]),
    from(
        "SYS_STATUS",
        "sensors, voltage, charge",
        &[3002, 12101, 16000, 16001],
    ),
    from(
        "VFR_HUD",
        "air speed, ground speed, throttle",
        &[3002, 3007, 3009, 4001],
    ),
    from("WIND_COV", "wind", &[3009]),
];

/// Messages of the vehicle that answer what was asked, and are not kept.
pub static ANSWERS: &[FromVehicle] = &[
    from("COMMAND_ACK", "result", &[16000, 17000]),
    from("MISSION_ACK", "type, opaque_id", &[14000, 50018]),
    from("MISSION_COUNT", "count, opaque_id", &[14000, 50018]),
    from("MISSION_ITEM_INT", "the plan aboard", &[14000, 50018]),
    from("MISSION_REQUEST_INT", "seq", &[14000, 50018]),
    from("PARAM_ERROR", "error", &[16000]),
    from(
        "PARAM_VALUE",
        "name, type, value",
        &[41000, 41001, 41003, 50012],
    ),
    from("PING", "seq", &[50015]),
    from("STATUSTEXT", "severity, text, its chunks", &[16000]),
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use mavlink::{MavlinkVersion, Message as _};
    use mavlink_link::dialect::MavMessage;

    use super::*;
    use crate::support;
    use crate::telemetry::Telemetry;

    #[test]
    fn every_message_that_is_kept_is_listed_and_no_other() {
        let mut kept = Vec::new();
        for id in 0..=20_000 {
            // No payload is a payload of zeros.
            let Ok(message) = MavMessage::parse(MavlinkVersion::V2, id, &[]) else {
                continue;
            };
            if Telemetry::default().update(&message) {
                kept.push(message.message_name());
            }
        }
        kept.sort_unstable();
        let listed: Vec<&str> = FROM_VEHICLE.iter().map(|row| row.mavlink).collect();
        assert_eq!(kept, listed);
    }

    /// The names of the dialect's commands: each as COMMAND_LONG carries it.
    fn commands() -> BTreeSet<String> {
        let named = |id: u16| {
            let mut payload = [0; 33];
            payload[28..30].copy_from_slice(&id.to_le_bytes());
            match MavMessage::parse(MavlinkVersion::V2, COMMAND_LONG, &payload) {
                Ok(MavMessage::COMMAND_LONG(command)) => Some(format!("{:?}", command.command)),
                _ => None,
            }
        };
        (0..=u16::MAX).filter_map(named).collect()
    }

    const COMMAND_LONG: u32 = 76;

    #[test]
    fn names_are_those_of_the_dialect_and_types_those_of_the_support_table() {
        for row in FROM_VEHICLE.iter().chain(ANSWERS) {
            assert!(
                MavMessage::message_id_from_name(row.mavlink).is_some(),
                "{}",
                row.mavlink
            );
            for id in row.dli {
                let sent = support::message(*id).is_some_and(|of| !of.sends.is_empty());
                assert!(sent, "{} is not sent, {}", id, row.mavlink);
            }
        }
        assert!(TO_VEHICLE.is_sorted_by_key(|row| row.dli));
        let commands = commands();
        for row in TO_VEHICLE {
            let taken = support::message(row.dli).is_some_and(|of| !of.taken.is_empty());
            assert!(taken, "{} is not taken", row.dli);
            let words = row
                .mavlink
                .split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            for word in words
                .filter(|word| word.contains('_') && word.chars().all(|c| !c.is_ascii_lowercase()))
            {
                let known = MavMessage::message_id_from_name(word).is_some()
                    || commands.contains(&format!("MAV_CMD_{word}"));
                assert!(known, "{word} of {}", row.dli);
            }
        }
    }
}
