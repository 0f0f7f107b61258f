//! What may be asked of PX4 through the agent, and by another ground station through the bridge: an allow-list, against one that
//! somebody has captured.
//!
//! Who holds the signing key can command; a list bounds what that is worth. That of the agent is by default what the bridge itself
//! sends: its messages, its commands, and writes of parameters that are no safety net ([`RelayPolicy::default`]). That of another
//! ground station is shorter, and does not grow with what the bridge learns to send: what a person flies by there
//! ([`RelayPolicy::of_ground_station`]). Not on either are SERIAL_CONTROL (a shell on PX4),
//! FILE_TRANSFER_PROTOCOL (its SD card, and its key file with it), reboots, and the parameters by which PX4 defends itself
//! ([`RelayPolicy::protected_parameters`]). An item of a mission is judged as well: PX4 carries some of them out as commands. The lists
//! are the agent's own configuration, which nobody changes over the radio.
//!
//! What no list can tell apart is a fence or a set of rally points that the ground replaces from one that somebody with its key
//! removes: the bridge uploads both. PX4's own limits (GF_MAX_HOR_DIST, GF_MAX_VER_DIST) are parameters, and stay.

use mavlink_link::frame::FrameView;
use mavlink_link::receiver::AUTOPILOT;

/// What passes; see `[relay]` of `airside.toml` and `forward.commands` of `vsm.toml`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RelayPolicy {
    /// MAVLink message ids.
    pub messages: Vec<u32>,
    /// Commands of COMMAND_LONG and COMMAND_INT, and of items of a mission that plan nothing ([`RelayPolicy::lets_fly`]).
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
    /// It writes a parameter of a component that is not PX4.
    Elsewhere,
    /// It reaches for PX4's key on its card.
    KeyFile,
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
            Denied::Elsewhere => "parameter of another component than PX4",
            Denied::KeyFile => "file transfer that may reach PX4's key",
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
            COMMAND_INT | COMMAND_LONG => {
                self.check_command(number(payload, 28), payload, px4.disarmed)
            }
            // When the mission reaches it PX4 may be in the air, whatever it is now.
            MISSION_ITEM | MISSION_ITEM_INT => match number(payload, 30) {
                command if plans(command) => Ok(()),
                command => self.check_command(command, payload, false),
            },
            PARAM_SET => {
                let mut name = [0; 16];
                for (to, at) in name.iter_mut().zip(6..) {
                    *to = byte(payload, at);
                }
                // PX4 passes what is for another component on: to a camera, or to the node of that number on CAN, such as an ESC
                // (`mavlink_parameters.cpp`). Their parameters have names that nobody here knows.
                if ![EVERY_COMPONENT, AUTOPILOT].contains(&byte(payload, 5)) {
                    Err(Denied::Elsewhere)
                } else if self.protects(&name) {
                    Err(Denied::Parameter(name))
                } else {
                    Ok(())
                }
            }
            FILE_TRANSFER if may_reach_key(payload) => Err(Denied::KeyFile),
            _ => Ok(()),
        }
    }

    /// Whether an item of a mission passes: it plans, or is a command that is on the list.
    #[must_use]
    pub fn lets_fly(&self, command: u16) -> bool {
        plans(command) || self.commands.contains(&command)
    }

    /// In commands and in items of a mission param2 is at 4; zeros at the end of a payload are cut off on the wire.
    fn check_command(&self, command: u16, payload: &[u8], disarmed: bool) -> Result<(), Denied> {
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

/// Whether a life hangs on a parameter: it is one of those that the ground does not write through an agent. It is no control of a
/// CUCS by a pattern or a group either.
pub(crate) fn is_safety_net(name: &str) -> bool {
    PROTECTED.iter().any(|pattern| fits(pattern, name))
}

/// Whether the name of a parameter fits a pattern, `*` standing for any characters.
pub(crate) fn fits(pattern: &str, name: &str) -> bool {
    matches(pattern.as_bytes(), name.as_bytes())
}

fn byte(payload: &[u8], at: usize) -> u8 {
    payload.get(at).copied().unwrap_or(0)
}

fn number(payload: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([byte(payload, at), byte(payload, at + 1)])
}

/// Whether an item of a mission plans a flight, its pictures, its gimbal, a fence or a rally point. Of what else PX4 v1.18 takes
/// (`mavlink_mission.cpp`) it makes the command of the same number when the mission reaches it (`mission_block.cpp`), a forced disarming
/// among them (COMPONENT_ARM_DISARM), another home (DO_SET_HOME), a moved output (DO_SET_ACTUATOR), a released load (DO_GRIPPER, DO_WINCH),
/// DO_AUTOTUNE_ENABLE.
fn plans(command: u16) -> bool {
    matches!(
        command,
        // NAV_WAYPOINT to NAV_TAKEOFF, NAV_LOITER_TO_ALT, NAV_ROI, NAV_VTOL_TAKEOFF, NAV_VTOL_LAND, NAV_DELAY, CONDITION_DELAY, _DISTANCE.
        16..=22 | 31 | 80 | 84 | 85 | 93 | 112 | 114
        // DO_JUMP, DO_CHANGE_SPEED, DO_LAND_START, DO_VTOL_TRANSITION, CONDITION_GATE.
        | 177 | 178 | 189 | 3_000 | 4_501
        // DO_SET_ROI_LOCATION, _WPNEXT_OFFSET, _NONE, DO_SET_ROI; DO_MOUNT_CONFIGURE, _CONTROL; DO_GIMBAL_MANAGER_PITCHYAW, _CONFIGURE.
        | 195..=197 | 201 | 204 | 205 | 1_000 | 1_001
        // DO_CONTROL_VIDEO, DO_DIGICAM_CONTROL, DO_SET_CAM_TRIGG_DIST, _INTERVAL, OBLIQUE_SURVEY, DO_TRIGGER_CONTROL; SET_CAMERA_MODE,
        // _ZOOM, _FOCUS, _SOURCE; IMAGE_START_, IMAGE_STOP_, VIDEO_START_, VIDEO_STOP_CAPTURE.
        | 200 | 203 | 206 | 214 | 260 | 2_003 | 530..=532 | 534 | 2_000 | 2_001 | 2_500 | 2_501
        // NAV_FENCE_*, NAV_RALLY_POINT.
        | 5_000..=5_004 | 5_100
    )
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
            let command = number(payload, 28);
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

/// Whether a FILE_TRANSFER_PROTOCOL message names a path by which PX4's key can be read.
fn may_reach_key(payload: &[u8]) -> bool {
    // Of a write it is the content of a file; of what has no path, nothing. PX4 reads no further than a size that stands before
    // a path.
    byte(payload, 6) != WRITE_FILE && reaches_key(payload.get(15..).unwrap_or_default())
}

/// Whether PX4's key can be read by a path, or by one of two behind a zero, as where one is renamed: mavlink/mavlink-signing-key.bin on
/// its card, which PX4 gives anybody who may read files. Beside the folder that is a short name of FAT (MAVLIN~1.BIN), the card
/// as a device, and the memory of a process, where PX4 runs on Linux.
pub(crate) fn reaches_key(paths: &[u8]) -> bool {
    let mut folder = paths.windows(KEY_FOLDER.len());
    let mut names = paths.split(|byte| matches!(byte, 0 | b'/'));
    let is_system = |name: &[u8]| {
        let mut system = [&b"dev"[..], b"proc"].into_iter();
        system.any(|one| one.eq_ignore_ascii_case(name))
    };
    folder.any(|part| part.eq_ignore_ascii_case(KEY_FOLDER))
        || paths.contains(&b'~')
        || names.any(is_system)
}

/// KEY_EXCHANGE and SETUP_SIGNING, whatever a list has: keys are changed by who has them.
const NEVER: [u32; 2] = [229, 256];
/// FILE_TRANSFER_PROTOCOL.
pub(crate) const FILE_TRANSFER: u32 = 110;
const WRITE_FILE: u8 = 7;
const KEY_FOLDER: &[u8] = b"mavlink";
const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;
const PARAM_SET: u32 = 23;
const MISSION_ITEM: u32 = 39;
const MISSION_ITEM_INT: u32 = 73;
const MANUAL_CONTROL: u32 = 69;
/// MAV_COMP_ID_ALL: PX4 takes it as its own, and no node on CAN has the number.
const EVERY_COMPONENT: u8 = 0;
const MISSION_START: u16 = 300;
const ARM_DISARM: u16 = 400;

/// HEARTBEAT, PING; PARAM_REQUEST_READ, _LIST, _SET; the mission protocol; MANUAL_CONTROL; COMMAND_INT, _LONG, _ACK;
/// SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_INT; TIMESYNC; TERRAIN_DATA; GIMBAL_MANAGER_SET_ATTITUDE, _PITCHYAW; REQUEST_EVENT. The kit of
/// the tests holds each frame of the bridge against this list and that of the commands.
const MESSAGES: [u32; 25] = [
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
    287,
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

/// Parameters that the ground does not write, by families, so that one which PX4 adds to a family is protected too. Left are the gains,
/// limits and speeds of the controllers, how a mission, a payload and a picture is flown, the log, the transponder.
const PROTECTED: [&str; 65] = [
    // What is checked, what happens then, without the link or its battery, and where it returns to or may fly.
    "COM_*",
    "NAV_DLL_*",
    "NAV_RCL_*",
    "NAV_LTR_*",
    "NAV_MIN_*",
    "NAV_TRAFF_*",
    "NAV_FORCE_VT",
    "RTL_*",
    "GF_*",
    "MIS_TKO_LAND_REQ",
    "CBRK_*",
    "FD_*",
    "MOTFAIL_*",
    "ESC_*",
    "BAT*",
    "CP_*",
    "FW_GPSF_*",
    "FW_LND_ABORT",
    "VT_QC_*",
    "VT_FW_QC_*",
    "VT_FW_MIN_ALT",
    "VT_TRANS_TIMEOUT",
    // What counts as landed: PX4 disarms there, and no failsafe begins.
    "LND*",
    // Sticks and their switches, the kill switch among them.
    "RC*",
    "MAN_*",
    // Motors, servos and engines: what each output is, and its value when armed, disarmed and failed.
    "CA_*",
    "PWM_*",
    "DSHOT_*",
    "ICE_*",
    "VT_TYPE",
    "PASSTHRU_EN",
    "*_FUNC*",
    "*_FAIL*",
    "PCA9685_*",
    "TAP_ESC_*",
    "VOXL*",
    "VTQ_*",
    // Estimators and sensors: by these each of the above finds out.
    "EKF2_*",
    "LPE_*",
    "ATT_*",
    "HTE_*",
    "ASPD_*",
    "FW_AIRSPD_STALL",
    "CAL_*",
    "TC_*",
    "SENS_*",
    "GPS_*",
    "SEP_*",
    "MS_*",
    "VN_*",
    "SBG_*",
    "ILABS_*",
    "ADC_*",
    "INA2*",
    // Ports, what is spoken on them, signing, and what is started.
    "MAV_*",
    "SER_*",
    "SYS_*",
    "USB_*",
    "UXRCE_*",
    "ZENOH_*",
    "UAVCAN_*",
    "UCAN1_*",
    "CYPHAL_*",
    "*_CFG",
    "*_CONFIG",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_setting_that_check_vehicle_judges_is_protected() {
        for setting in mapping::hardening::SETTINGS {
            assert!(is_safety_net(setting.name), "{}", setting.name);
        }
    }

    /// A family of PX4's table that is neither here nor protected is one that nobody has decided about.
    #[test]
    fn of_px4s_table_only_these_families_are_written() {
        let written = "ADSB_* EV_* FLW_* FW_* IMU_* MBE_* MC_* MIS_* MNT_* MPC_* NAV_*_RAD NPFG_* OSD_* PD_* PLD_* PP_* RA_* RD_* RM_* RO_* \
                       RWTO_* SDLOG_* SIH_* SIM_* TEST_* THR_* TRIG_* TRIM_* UUV_* VTE_* VTO_* VT_* WEIGHT_* WV_*";
        for name in mapping::parameter::names().filter(|name| !is_safety_net(name)) {
            let mut families = written.split(' ');
            assert!(families.any(|family| fits(family, name)), "{name}");
        }
        // Each family is written indeed, so that the list above is no longer than it has to be.
        for family in written.split(' ') {
            let mut names = mapping::parameter::names();
            assert!(
                names.any(|name| fits(family, name) && !is_safety_net(name)),
                "{family}"
            );
        }
    }

    #[test]
    fn the_guide_has_the_protected_parameters() {
        let page = include_str!("../../docs/guide/keys.md");
        for pattern in PROTECTED {
            assert!(page.contains(&format!("`{pattern}`")), "{pattern}");
        }
    }

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
        // TIMESYNC, TERRAIN_DATA, GIMBAL_MANAGER_SET_ATTITUDE, _PITCHYAW, REQUEST_EVENT.
        for message in [111, 134, 282, 287, 412] {
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
