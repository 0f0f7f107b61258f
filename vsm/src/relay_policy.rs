//! What may be asked of PX4 through the agent, and by another ground station through the bridge: an allow-list, against one that
//! somebody has captured.
//!
//! Who holds the signing key can command; a list bounds what that is worth. That of the agent is by default what the bridge itself
//! sends: its messages, its commands, and writes of parameters that are no safety net ([`RelayPolicy::default`]). That of another
//! ground station is shorter, and does not grow with what the bridge learns to send: what a person flies by there
//! ([`RelayPolicy::of_ground_station`]). Not on either are SERIAL_CONTROL (a shell on PX4),
//! FILE_TRANSFER_PROTOCOL (its SD card, and its key file with it), reboots, and the parameters by which PX4 defends itself:
//! failsafes, geofence, arming checks, the ports and their signing. The lists are the agent's own configuration, which nobody
//! changes over the radio.

use mavlink_link::frame::FrameView;

/// What passes; see `[relay]` of `airside.toml` and `forward.commands` of `vsm.toml`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RelayPolicy {
    /// MAVLink message ids.
    pub messages: Vec<u32>,
    /// Commands of COMMAND_LONG and COMMAND_INT.
    pub commands: Vec<u16>,
    /// Names of parameters that are not written; `*` stands for any characters.
    pub protected_parameters: Vec<String>,
}

impl RelayPolicy {
    /// What another ground station may ask of PX4 through the bridge by default. No elevations of the ground, clock or events, which
    /// are the bridge's; no payloads, which a CUCS may hold apart from the vehicle.
    #[must_use]
    pub fn of_ground_station() -> RelayPolicy {
        RelayPolicy {
            messages: STATION_MESSAGES.to_vec(),
            commands: STATION_COMMANDS.to_vec(),
            ..RelayPolicy::default()
        }
    }
}

impl Default for RelayPolicy {
    /// What the bridge itself sends.
    fn default() -> RelayPolicy {
        RelayPolicy {
            messages: MESSAGES.to_vec(),
            commands: COMMANDS.to_vec(),
            protected_parameters: PROTECTED.map(str::to_owned).to_vec(),
        }
    }
}

/// Why a frame is not passed on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Denied {
    /// Its message is not on the list.
    Message(u32),
    /// The command in it is not on the list.
    Command(u16),
    /// Such a command passes only while PX4 reports that it is disarmed.
    InFlight(u16),
    /// The motors would be stopped in flight.
    ForcedDisarm,
    /// The motors would be started, and the link to the ground ends within seconds.
    Zeroizing,
    /// It writes a parameter that is protected.
    Parameter([u8; 16]),
}

impl Denied {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Denied::Message(_) => "message not allowed (relay.messages)",
            Denied::Command(_) => "command not allowed (relay.commands)",
            Denied::InFlight(_) => "command not allowed unless disarmed",
            Denied::ForcedDisarm => "forced arming or disarming",
            Denied::Zeroizing => "a zeroize is ordered",
            Denied::Parameter(_) => "parameter protected (relay.protected_parameters)",
        }
    }
}

/// What a frame is judged by beside the lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Px4Now {
    /// PX4 has just reported that it is disarmed.
    pub(crate) disarmed: bool,
    /// A zeroize is ordered, and takes effect whatever happens: an aircraft that took off now would lose its keys in the air.
    pub(crate) zeroizing: bool,
}

impl RelayPolicy {
    /// Whether a verified frame of the ground may be forwarded to PX4.
    pub(crate) fn check(&self, frame: &FrameView<'_>, px4: Px4Now) -> Result<(), Denied> {
        let (id, payload) = (frame.header().message_id, frame.payload());
        if !self.messages.contains(&id) || NEVER.contains(&id) {
            return Err(Denied::Message(id));
        }
        if px4.zeroizing && px4.disarmed && may_arm(id, payload) {
            return Err(Denied::Zeroizing);
        }
        match id {
            COMMAND_INT | COMMAND_LONG => self.check_command(payload, px4.disarmed),
            PARAM_SET => {
                let mut name = [0; 16];
                for (to, at) in name.iter_mut().zip(6..) {
                    *to = byte(payload, at);
                }
                if self.protects(&name) {
                    Err(Denied::Parameter(name))
                } else {
                    Ok(())
                }
            }
            _ => Ok(()),
        }
    }

    fn check_command(&self, payload: &[u8], disarmed: bool) -> Result<(), Denied> {
        // In both messages param2 is at 4 and the command at 28; zeros at the end are cut off on the wire.
        let command = u16::from_le_bytes([byte(payload, 28), byte(payload, 29)]);
        if !self.commands.contains(&command) {
            return Err(Denied::Command(command));
        }
        if ONLY_DISARMED.contains(&command) && !disarmed {
            return Err(Denied::InFlight(command));
        }
        // The bridge never forces; PX4 cuts the motors in flight where param2 is 21196.
        let param2 = f32::from_le_bytes([4, 5, 6, 7].map(|at| byte(payload, at)));
        if command == ARM_DISARM && param2 != 0.0 {
            return Err(Denied::ForcedDisarm);
        }
        Ok(())
    }

    fn protects(&self, name: &[u8; 16]) -> bool {
        let end = name
            .iter()
            .position(|&byte| byte == 0)
            .unwrap_or(name.len());
        let name = name.get(..end).unwrap_or_default();
        let mut patterns = self.protected_parameters.iter();
        patterns.any(|pattern| matches(pattern.as_bytes(), name))
    }
}

/// Whether a life hangs on a parameter: PX4 defends itself by it, or it decides what a switch, a motor, an estimator or a return
/// does. It is no control of a CUCS by a pattern or a group.
pub(crate) fn is_safety_net(name: &str) -> bool {
    let mut patterns = PROTECTED.iter().chain(&NO_CONTROLS);
    patterns.any(|pattern| fits(pattern, name))
}

/// Whether the name of a parameter fits a pattern, `*` standing for any characters.
pub(crate) fn fits(pattern: &str, name: &str) -> bool {
    matches(pattern.as_bytes(), name.as_bytes())
}

fn byte(payload: &[u8], at: usize) -> u8 {
    payload.get(at).copied().unwrap_or(0)
}

/// Whether a name fits a pattern. A star is tried at each length: names have at most 16 characters.
fn matches(pattern: &[u8], name: &[u8]) -> bool {
    match pattern.split_first() {
        None => name.is_empty(),
        Some((b'*', rest)) => {
            (0..=name.len()).any(|at| matches(rest, name.get(at..).unwrap_or_default()))
        }
        Some((first, rest)) => name
            .split_first()
            .is_some_and(|(here, name)| here == first && matches(rest, name)),
    }
}

/// Whether PX4 may start its motors by it: MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_MISSION_START, or sticks, whose gesture arms.
fn may_arm(message_id: u32, payload: &[u8]) -> bool {
    match message_id {
        COMMAND_INT | COMMAND_LONG => {
            let command = u16::from_le_bytes([byte(payload, 28), byte(payload, 29)]);
            let param1 = f32::from_le_bytes([0, 1, 2, 3].map(|at| byte(payload, at)));
            command == MISSION_START || command == ARM_DISARM && param1 != 0.0
        }
        MANUAL_CONTROL => true,
        _ => false,
    }
}

/// Whether a FILE_TRANSFER_PROTOCOL message changes nothing on PX4's card: it lists, reads, sums, or ends a session.
pub(crate) fn reads_files(payload: &[u8]) -> bool {
    // Three bytes of addresses, then sequence (2), session (1) and the opcode.
    matches!(byte(payload, 6), 0..=5 | 14 | 15)
}

/// KEY_EXCHANGE and SETUP_SIGNING, whatever a list has: keys are changed by who has them.
const NEVER: [u32; 2] = [229, 256];
/// FILE_TRANSFER_PROTOCOL.
pub(crate) const FILE_TRANSFER: u32 = 110;
const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;
const PARAM_SET: u32 = 23;
const MANUAL_CONTROL: u32 = 69;
const MISSION_START: u16 = 300;
const ARM_DISARM: u16 = 400;

/// HEARTBEAT, PING; PARAM_REQUEST_READ, _LIST, _SET; the mission protocol; MANUAL_CONTROL; COMMAND_INT, _LONG, _ACK;
/// SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_INT; TIMESYNC; TERRAIN_DATA; GIMBAL_MANAGER_SET_ATTITUDE; REQUEST_EVENT. The kit of the
/// tests holds each frame of the bridge against this list and that of the commands.
const MESSAGES: [u32; 24] = [
    0,
    4,
    20,
    21,
    23,
    39,
    40,
    41,
    43,
    44,
    45,
    47,
    51,
    69,
    73,
    COMMAND_INT,
    COMMAND_LONG,
    77,
    84,
    86,
    111,
    134,
    282,
    412,
];

/// NAV_TAKEOFF, DO_ORBIT, DO_FIGURE_EIGHT, NAV_VTOL_TAKEOFF, DO_SET_MODE, DO_CHANGE_SPEED, DO_CHANGE_ALTITUDE, DO_GO_AROUND,
/// DO_REPOSITION, COMPONENT_ARM_DISARM, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE; SET_CAMERA_MODE, _ZOOM, _FOCUS, _SOURCE;
/// DO_GIMBAL_MANAGER_PITCHYAW, _CONFIGURE; IMAGE_START_CAPTURE, VIDEO_START_CAPTURE, VIDEO_STOP_CAPTURE; DO_VTOL_TRANSITION,
/// REQUEST_OPERATOR_CONTROL, GUIDED_CHANGE_HEADING. DO_FLIGHTTERMINATION, which the bridge sends too, is the owner's choice.
const COMMANDS: [u16; 24] = [
    22, 34, 35, 84, 176, 178, 186, 191, 192, ARM_DISARM, 511, 512, 530, 531, 532, 534, 1_000,
    1_001, 2_000, 2_500, 2_501, 3_000, 32_100, 43_002,
];

/// PING; PARAM_REQUEST_READ, _LIST, _SET; the mission protocol; MANUAL_CONTROL; COMMAND_INT, _LONG, _ACK;
/// SET_POSITION_TARGET_LOCAL_NED. (A HEARTBEAT is not passed on at all.)
const STATION_MESSAGES: [u32; 18] = [
    4,
    20,
    21,
    23,
    39,
    40,
    41,
    43,
    44,
    45,
    47,
    51,
    69,
    73,
    COMMAND_INT,
    COMMAND_LONG,
    77,
    84,
];

/// NAV_TAKEOFF, DO_ORBIT, DO_SET_MODE, DO_CHANGE_SPEED, DO_GO_AROUND, DO_REPOSITION, COMPONENT_ARM_DISARM, SET_MESSAGE_INTERVAL,
/// REQUEST_MESSAGE, REQUEST_OPERATOR_CONTROL.
///
/// DO_GO_AROUND (191) is what "abort landing" of a ground station sends. PX4 takes it of a wing on its final approach alone (its
/// set point is of type LAND), and climbs to MIS_LND_ABRT_ALT. That it is denied would be found out within the seconds in which
/// somebody stands on the runway; and it gives nothing that a change of mode (176) does not. Who needs another command of wings,
/// such as a transition (3000), finds that out on the ground, and lists it.
const STATION_COMMANDS: [u16; 10] = [22, 34, 176, 178, 191, 192, ARM_DISARM, 511, 512, 32_100];

/// PREFLIGHT_CALIBRATION, _SET_SENSOR_OFFSETS, _STORAGE, _REBOOT_SHUTDOWN: where the list has them, on the ground only.
const ONLY_DISARMED: [u16; 4] = [241, 242, 245, 246];

/// The failsafes and arming checks (COM_), what they do (NAV_), the geofence, the circuit breakers, the ports and the
/// signing on them, the termination, the operator control, the boot script's choices.
const PROTECTED: [&str; 13] = [
    "COM_*",
    "NAV_DLL_ACT",
    "NAV_RCL_ACT",
    "GF_*",
    "CBRK_*",
    "MAV_*",
    "SER_*",
    "FD_*",
    "BAT*_ACT",
    "BAT*_THR",
    "SYS_*",
    "UXRCE_*",
    "UAVCAN_*",
];

/// Beside those, for the controls of a CUCS alone: the switches of the remote control (its kill switch), the motors and servos, the
/// quadchute, the return, calibration, the estimator.
const NO_CONTROLS: [&str; 9] = [
    "RC_*",
    "CA_*",
    "VT_QC_*",
    "VT_FW_QC_*",
    "RTL_*",
    "CAL_*",
    "PWM_*",
    "EKF2_*",
    "NAV_FORCE_VT",
];

#[cfg(test)]
mod tests {
    use super::*;

    /// What it is by default is in docs/guide/beside-others.md, and does not follow the list of the agent.
    #[test]
    fn a_ground_station_may_ask_less_than_the_bridge_and_nothing_that_an_agent_would_hold_back() {
        let (station, bridge) = (RelayPolicy::of_ground_station(), RelayPolicy::default());
        assert!(
            station
                .messages
                .iter()
                .all(|one| bridge.messages.contains(one))
        );
        assert!(
            station
                .commands
                .iter()
                .all(|one| bridge.commands.contains(one))
        );
        assert_eq!(station.protected_parameters, bridge.protected_parameters);
        // TIMESYNC, TERRAIN_DATA, GIMBAL_MANAGER_SET_ATTITUDE, REQUEST_EVENT.
        for message in [111, 134, 282, 412] {
            assert!(!station.messages.contains(&message), "{message}");
        }
        // A landing is aborted by whoever began it.
        assert!(station.commands.contains(&191));
        // Cameras, gimbals, pictures; transitions, changes of altitude and heading.
        for command in [530, 1_000, 2_000, 84, 3_000, 186, 43_002] {
            assert!(!station.commands.contains(&command), "{command}");
        }
        let page = include_str!("../../docs/guide/beside-others.md");
        let listed = |numbers: Vec<String>| format!("({})", numbers.join(", "));
        let messages = listed(station.messages.iter().map(u32::to_string).collect());
        let commands = listed(station.commands.iter().map(u16::to_string).collect());
        for list in [messages, commands] {
            assert!(page.contains(&list), "{list}");
        }
    }

    #[test]
    fn patterns_match_whole_names() {
        for (pattern, name, fits) in [
            ("COM_*", "COM_DL_LOSS_T", true),
            ("COM_*", "XCOM_A", false),
            ("NAV_DLL_ACT", "NAV_DLL_ACT", true),
            ("NAV_DLL_ACT", "NAV_DLL_ACT2", false),
            ("BAT*_THR", "BAT_CRIT_THR", true),
            ("BAT*_THR", "BAT1_V_CHARGED", false),
            ("MAV_*SIGN*", "MAV_0_SIGN_CFG", true),
            ("*", "", true),
            ("**", "ABCDEFGHIJKLMNOP", true),
        ] {
            assert_eq!(
                matches(pattern.as_bytes(), name.as_bytes()),
                fits,
                "{pattern} {name}"
            );
        }
    }
}
