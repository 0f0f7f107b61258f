//! The events interface of PX4 v1.18: EVENT (410) beside each STATUSTEXT that ends with a tab, kept and sent again on
//! request, and the metadata with the meaning of each.
//!
//! As in `mavlink_events.cpp`: numbers start near the end of their range, so that they wrap soon; 20 events are kept;
//! the newest number is sent every 3 s, with the reset flag while there is none; a request for an event that is no
//! longer kept is answered by an error.

use std::collections::VecDeque;
use std::fmt::Write as _;

use mavlink::dialects::development::{
    CURRENT_EVENT_SEQUENCE_DATA, EVENT_DATA, MavEventCurrentSequenceFlags, MavEventErrorReason,
    MavMessage, REQUEST_EVENT_DATA, RESPONSE_EVENT_ERROR_DATA,
};
use mavlink_link::service::Node;

/// The events of one vehicle; without effect where events are off.
#[derive(Debug, Clone, Default)]
pub(crate) struct Events {
    in_use: bool,
    kept: VecDeque<EVENT_DATA>,
    /// How many of the last recorded ones have not been sent yet.
    unsent: usize,
    newest: Option<u16>,
    named_at: Option<f64>,
    /// The number of coming events that are not sent by themselves, as on a link that loses them.
    pub(crate) lose: usize,
}

/// An event that this simulator sends, as PX4 defines it.
struct Known {
    name: &'static str,
    /// External log level.
    level: u8,
    /// The text, with at most one argument, at its end or in its middle.
    message: &'static str,
    argument: Option<Kind>,
    /// The text of PX4's STATUSTEXT before its argument; the same as the message where empty.
    text: &'static str,
}

#[derive(Clone, Copy)]
enum Kind {
    Float,
    Int,
    ArmReason,
}

impl Events {
    pub(crate) fn new(in_use: bool) -> Self {
        Self {
            in_use,
            ..Self::default()
        }
    }

    /// PX4 sends an event beside each text that ends with a tab.
    pub(crate) fn beside_text(&mut self, text: &str) {
        let Some(text) = text.strip_suffix('\t') else {
            return;
        };
        for known in KNOWN {
            if let Some(arguments) = known.arguments_of(text) {
                return self.record(known.name, known.level, &arguments);
            }
        }
    }

    /// Records an event by its name in PX4's source.
    pub(crate) fn record(&mut self, name: &str, level: u8, arguments: &[u8]) {
        if !self.in_use {
            return;
        }
        let sequence = self.newest.unwrap_or(FIRST - 1).wrapping_add(1);
        let mut event = EVENT_DATA {
            id: id_of(name),
            sequence,
            log_levels: level << 4 | level,
            ..EVENT_DATA::default()
        };
        event.arguments[..arguments.len()].copy_from_slice(arguments);
        self.newest = Some(sequence);
        self.kept.push_back(event);
        if self.kept.len() > KEPT {
            self.kept.pop_front();
        }
        self.unsent = (self.unsent + 1).min(KEPT);
    }

    /// A complete report on health and arming checks; PX4 sends one whenever a check changes.
    pub(crate) fn report_checks(&mut self, fails: bool) {
        self.record("commander_arming_check_summary", PROTOCOL, &[]);
        // As on every PX4 without a remote control: the modes flown by sticks fail.
        self.record("check_modes_manual_control", ERROR, &[0x07, 0, 0, 0, 0]);
        if fails {
            self.record(CHECK, ERROR, &[0xff, 0xff, 0xff, 0xff, 0]);
        }
        self.record("commander_health_summary", PROTOCOL, &[]);
    }

    /// Sends what is due now.
    pub(crate) fn poll(&mut self, now: f64, boot_ms: u32, mut send: impl FnMut(MavMessage)) {
        if !self.in_use {
            return;
        }
        let first = self.kept.len() - self.unsent;
        for event in self.kept.iter_mut().skip(first) {
            event.event_time_boot_ms = boot_ms;
            if self.lose > 0 {
                self.lose -= 1;
            } else {
                send(MavMessage::EVENT(event.clone()));
            }
        }
        self.unsent = 0;
        if self.named_at.is_none_or(|at| now - at > CURRENT_EVERY_S) {
            self.named_at = Some(now);
            let flags = if self.newest.is_none() {
                MavEventCurrentSequenceFlags::MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET
            } else {
                MavEventCurrentSequenceFlags::empty()
            };
            let sequence = self.newest.unwrap_or(FIRST - 1);
            let current = CURRENT_EVENT_SEQUENCE_DATA { sequence, flags };
            send(MavMessage::CURRENT_EVENT_SEQUENCE(current));
        }
    }

    /// Sends again what is requested.
    pub(crate) fn request(
        &self,
        from: Node,
        request: &REQUEST_EVENT_DATA,
        mut send: impl FnMut(MavMessage),
    ) {
        let count = request.last_sequence.wrapping_sub(request.first_sequence);
        // PX4 answers each number, however many are requested; a simulator need not.
        for at in 0..=count.min(MAX_REQUEST) {
            let sequence = request.first_sequence.wrapping_add(at);
            match self.kept.iter().find(|event| event.sequence == sequence) {
                Some(event) => send(MavMessage::EVENT(event.clone())),
                None => {
                    let after = |event: &&EVENT_DATA| event.sequence.wrapping_sub(sequence);
                    let oldest = self.kept.iter().min_by_key(after);
                    send(MavMessage::RESPONSE_EVENT_ERROR(
                        RESPONSE_EVENT_ERROR_DATA {
                            sequence,
                            sequence_oldest_available: oldest.map_or(sequence, |one| one.sequence),
                            target_system: from.system,
                            target_component: from.component,
                            reason: MavEventErrorReason::MAV_EVENT_ERROR_REASON_UNAVAILABLE,
                        },
                    ));
                }
            }
        }
    }
}

impl Known {
    /// The packed arguments of a text that has this event's wording.
    fn arguments_of(&self, text: &str) -> Option<Vec<u8>> {
        let form = if self.text.is_empty() {
            self.message
        } else {
            self.text
        };
        let Some(kind) = self.argument else {
            return (form == text).then(Vec::new);
        };
        let (before, _) = form.split_once('{')?;
        let value = text.strip_prefix(before)?;
        let number = value
            .split(|c: char| !c.is_ascii_digit() && c != '.' && c != '-')
            .next()?;
        Some(match kind {
            Kind::Float => number.parse::<f32>().ok()?.to_le_bytes().to_vec(),
            Kind::Int => number.parse::<i32>().ok()?.to_le_bytes().to_vec(),
            Kind::ArmReason => {
                let reason = ARM_REASONS.iter().find(|(_, name)| *name == value);
                vec![reason.map_or(0, |(number, _)| *number)]
            }
        })
    }
}

/// The metadata as PX4's build makes them from the comments in its source.
pub(super) fn definitions() -> String {
    let mut events = String::new();
    for known in KNOWN {
        let kind = match known.argument {
            None => "",
            Some(Kind::Float) => r#"{"name": "arg0", "type": "float"}"#,
            Some(Kind::Int) => r#"{"name": "arg0", "type": "int32_t"}"#,
            Some(Kind::ArmReason) => r#"{"name": "arg0", "type": "px4::arm_disarm_reason_t"}"#,
        };
        let comma = if events.is_empty() { "" } else { ", " };
        let number = id_of(known.name) & 0xff_ffff;
        let (name, message) = (known.name, known.message);
        let _ = write!(
            events,
            r#"{comma}"{number}": {{"name": "{name}", "message": "{message}", "arguments": [{kind}]}}"#
        );
    }
    let reasons: Vec<String> = ARM_REASONS
        .iter()
        .map(|(number, name)| format!(r#""{number}": {{"description": "{name}"}}"#))
        .collect();
    let check = id_of(CHECK) & 0xff_ffff;
    format!(
        r#"{{"version": 2, "components": {{"1": {{"namespace": "px4",
        "enums": {{"arm_disarm_reason_t": {{"type": "uint8_t", "entries": {{{}}}}}}},
        "event_groups": {{"default": {{"events": {{{events}}}}}, "arming_check": {{"events": {{
        "{check}": {{"name": "{CHECK}", "message": "No valid global position estimate", "arguments":
        [{{"name": "modes", "type": "uint32_t"}}, {{"name": "index", "type": "uint8_t"}}]}}}}}}}}}}}}}}"#,
        reasons.join(", ")
    )
}

/// 24 bits of FNV-1a of its name, and component 1.
fn id_of(name: &str) -> u32 {
    let hash = name.bytes().fold(0x811c_9dc5_u32, |hash, byte| {
        (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    });
    hash & 0xff_ffff | 1 << 24
}

const fn known(name: &'static str, level: u8, message: &'static str) -> Known {
    Known {
        name,
        level,
        message,
        argument: None,
        text: "",
    }
}

const fn with(kind: Kind, text: &'static str, event: Known) -> Known {
    Known {
        argument: Some(kind),
        text,
        ..event
    }
}

/// Levels and messages from PX4 v1.18's source; also the wording of its STATUSTEXT where that differs.
const KNOWN: &[Known] = &[
    known("commander_landing_detected", INFO, "Landing detected"),
    known("commander_takeoff_detected", INFO, "Takeoff detected"),
    with(
        Kind::ArmReason,
        "",
        known("commander_armed_by", INFO, "Armed by {1}"),
    ),
    with(
        Kind::ArmReason,
        "",
        known("commander_disarmed_by", INFO, "Disarmed by {1}"),
    ),
    known(
        "commander_arm_denied_resolve_failures",
        CRITICAL,
        "Arming denied: Resolve system health failures first",
    ),
    known(
        "commander_disarm_denied_not_landed",
        CRITICAL,
        "Disarming denied: not landed",
    ),
    known("commander_dl_regained", INFO, "GCS connection regained"),
    Known {
        text: "Connection to ground station lost",
        ..known(
            "commander_gcs_lost",
            WARNING,
            "Connection to ground control station lost",
        )
    },
    known("mission_execute", INFO, "Executing Mission"),
    with(
        Kind::Float,
        "Climb to {1} meters above home",
        known(
            "mission_climb_before_start",
            INFO,
            "Climb to {1:.1m_v} above home",
        ),
    ),
    known(
        "mission_finished_loiter",
        INFO,
        "Mission finished, loitering",
    ),
    known("mission_finished", INFO, "Mission finished, landed"),
    with(
        Kind::Float,
        "",
        known(
            "navigator_takeoff_default_alt",
            INFO,
            "Using default takeoff altitude: {1:.2m}",
        ),
    ),
    known("rtl_land_at_destination", INFO, "RTL: land at destination"),
    known(
        "mission_not_valid_loiter",
        ERROR,
        "No valid mission available, loitering",
    ),
    known(
        "mission_not_valid_refuse",
        ERROR,
        "No valid mission available, refusing takeoff",
    ),
    known(
        "commander_mission_start_denied_no_mission",
        CRITICAL,
        "Mission start denied! No valid mission",
    ),
    known(
        "commander_landing_current_pos",
        INFO,
        "Landing at current position",
    ),
    known(
        "orbit_radius_exceeded",
        CRITICAL,
        "Orbit radius limit exceeded",
    ),
    known(
        "navigator_geofence_invalid_against_home",
        CRITICAL,
        "Geofence invalid, doesn't contain Home position",
    ),
    known(
        "navigator_geofence_invalid_against_cur_pos",
        CRITICAL,
        "Geofence invalid, doesn't contain current vehicle position",
    ),
    with(
        Kind::Int,
        "",
        known(
            "navigator_mis_geofence_violation",
            ERROR,
            "Geofence violation for waypoint {1}",
        ),
    ),
];

const ARM_REASONS: &[(u8, &str)] = &[
    (1, "stick gesture"),
    (2, "RC switch"),
    (3, "internal command"),
    (4, "external command"),
    (5, "mission start"),
    (6, "landing"),
    (7, "preflight inaction"),
    (8, "kill switch"),
    (13, "RC button"),
    (14, "failsafe"),
];

/// The check that fails on a vehicle without a position.
const CHECK: &str = "check_modes_global_pos";
/// The number of the first event: PX4's counter starts at 65525 (`initial_event_sequence`), and is raised before use.
const FIRST: u16 = 65_526;
/// Capacity of PX4's EventBuffer.
const KEPT: usize = 20;
/// PX4's `current_sequence_interval`.
const CURRENT_EVERY_S: f64 = 3.0;
/// Events of one request that are answered.
const MAX_REQUEST: u16 = 256;
/// External log levels, with the numbers of MAV_SEVERITY.
const CRITICAL: u8 = 2;
const ERROR: u8 = 3;
const WARNING: u8 = 4;
const INFO: u8 = 6;
/// A log level for programs only.
const PROTOCOL: u8 = 8;
