//! A ground station under test: the suite plays a vehicle with the faults and attacks that a station has to survive,
//! and judges what the station sends.

use std::collections::{BTreeMap, BTreeSet};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use conformance::report::RuleReport;
use conformance::verdict::{Judgement, Verdict};
use conformance::wire::Direction;

use crate::bench::{Bench, Peer, Seen};
use crate::catalogue::{Catalogue, Role, Rule};
use crate::passive::{JUDGES, View};
use crate::runner::Options;
use crate::wire::{Draft, Key, STAMP_HZ, wall_stamp};

/// What happened during the play, for the judges. Positions are those of the recording.
#[derive(Debug, Default)]
pub struct Played {
    /// Remarks about the run as a whole.
    pub remarks: Vec<String>,
    /// When a command was left without an answer: command, position.
    unanswered: Vec<(i64, usize)>,
    /// When an old acknowledgement was sent again: command, position.
    replayed: Vec<(i64, usize)>,
    /// When an honest acknowledgement was sent.
    acknowledged: Vec<(i64, usize)>,
    /// When which item was requested.
    requested: Vec<(i64, usize)>,
    /// A MISSION_COUNT that was left unanswered.
    uncounted: Option<usize>,
    /// When the parameter list was sent with a gap.
    gap: Option<usize>,
    /// When frames of foreign systems were sent.
    strangers: Option<usize>,
    /// When a time ten years ahead was sent.
    wrong_time: Option<usize>,
    /// When a frame with a timestamp one year ahead was sent.
    year_ahead: Option<usize>,
    /// When a new key was accepted without an answer.
    rekeyed: Option<(usize, Key)>,
    end: usize,
}

/// System ids of the foreign systems: one unsigned, one wrongly signed.
const STRANGERS: [u8; 2] = [77, 78];
/// How long a station may take to repeat.
const RETRY: Duration = Duration::from_secs(6);

struct Vehicle<'a> {
    bench: &'a Bench,
    peer: Peer,
    played: Played,
    seen_commands: BTreeMap<i64, u32>,
    old_acks: BTreeMap<i64, Vec<u8>>,
    uploading: Option<(i64, i64, i64)>,
    plan: i64,
    silent_until: Duration,
    asked_twice: bool,
}

/// Plays the vehicle for `time` seconds, with the station's command beside it.
///
/// # Errors
/// The command cannot be run.
pub fn play(bench: &Bench, system: u8, command: Option<&str>, time: f64) -> Result<Played, String> {
    let peer = Peer::new(&bench.net, &bench.port, (system, 1), 0);
    let mut vehicle = Vehicle {
        bench,
        peer,
        played: Played::default(),
        seen_commands: BTreeMap::new(),
        old_acks: BTreeMap::new(),
        uploading: None,
        plan: 0,
        silent_until: Duration::ZERO,
        asked_twice: false,
    };
    let child = command.map(start).transpose()?;
    vehicle.live(Duration::from_secs_f64(time), child);
    vehicle.played.end = bench.net.mark();
    if bench
        .net
        .all(0, |seen| seen.direction == Direction::Received)
        .is_empty()
    {
        vehicle.played.remarks.push(format!(
            "no frame of a station came to {}",
            bench.port.local()
        ));
    }
    Ok(vehicle.played)
}

fn start(command: &str) -> Result<Child, String> {
    Command::new("sh")
        .args(["-c", &format!("exec {command}")])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| format!("{command:?} cannot be run: {error}"))
}

impl Vehicle<'_> {
    fn live(&mut self, end: Duration, mut child: Option<Child>) {
        let net = self.bench.net.clone();
        let (mut next, mut tick, mut beat) = (0, 0_u32, Duration::ZERO);
        while net.now() < end && !net.interrupted() {
            if net.now() >= beat {
                beat += Duration::from_millis(250);
                tick += 1;
                if net.now() >= self.silent_until {
                    self.telemetry(tick);
                }
                self.hostile(net.now().as_secs_f64() / end.as_secs_f64());
            }
            let deadline = beat.min(end);
            let seen = net.wait(next, deadline, |seen| seen.direction == Direction::Received);
            let Some(seen) = seen else {
                next = next.max(net.mark().saturating_sub(1));
                if let Some(process) = &mut child
                    && matches!(process.try_wait(), Ok(Some(_)))
                {
                    child = None;
                }
                continue;
            };
            next = self.position(&seen) + 1;
            // The played vehicle acts only on what verifies; on everything where no key was given.
            let believed = match self.bench.net.key() {
                Some(_) => seen.verified == Some(true),
                None => true,
            };
            if believed && net.now() >= self.silent_until {
                self.answer(&seen, next);
            }
        }
        if let Some(mut child) = child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    fn position(&self, seen: &Arc<Seen>) -> usize {
        let recording = self.bench.net.recording();
        recording
            .seen
            .iter()
            .rposition(|other| Arc::ptr_eq(other, seen))
            .unwrap_or_default()
    }

    fn telemetry(&self, tick: u32) {
        let ms = self.bench.net.now().as_millis() as f64;
        if tick % 4 == 1 {
            self.peer.send(
                &Draft::new("HEARTBEAT")
                    .set("type", 2)
                    .set("autopilot", 12)
                    .set("base_mode", 0x1D)
                    .set("custom_mode", 0x0304_0000)
                    .set("system_status", 3)
                    .set("mavlink_version", 3),
            );
            self.peer.send(
                &Draft::new("SYS_STATUS")
                    .set("onboard_control_sensors_health", 0x1000_0000)
                    .set("voltage_battery", 16_000)
                    .set("battery_remaining", 90),
            );
            self.peer
                .send(&Draft::new("EXTENDED_SYS_STATE").set("landed_state", 1));
            self.peer.send(
                &Draft::new("MISSION_CURRENT")
                    .set("total", self.plan as f64)
                    .set("mission_state", 2),
            );
            self.peer.send(
                &Draft::new("HOME_POSITION")
                    .set("latitude", 473_977_434)
                    .set("longitude", 85_455_939)
                    .set("altitude", 488_000),
            );
        }
        self.peer.send(
            &Draft::new("GLOBAL_POSITION_INT")
                .set("time_boot_ms", ms)
                .set("lat", 473_977_434)
                .set("lon", 85_455_939)
                .set("alt", 488_000)
                .set("hdg", 9_000),
        );
        self.peer.send(
            &Draft::new("ATTITUDE")
                .set("time_boot_ms", ms)
                .set("yaw", 1.5),
        );
        self.peer.send(
            &Draft::new("GPS_RAW_INT")
                .set("fix_type", 3)
                .set("lat", 473_977_434)
                .set("lon", 85_455_939)
                .set("alt", 488_000)
                .set("satellites_visible", 12),
        );
    }

    /// Sends what a station has to survive, each at its part of the play.
    fn hostile(&mut self, part: f64) {
        let foreign = |system: u8| Peer::new(&self.bench.net, &self.bench.port, (system, 1), 0);
        let vehicle = Draft::new("HEARTBEAT")
            .set("type", 2)
            .set("autopilot", 12)
            .set("mavlink_version", 3);
        let signed = self.bench.net.key().is_some();
        if signed && part > 0.3 && part < 0.5 {
            self.played.strangers.get_or_insert(self.bench.net.mark());
            foreign(STRANGERS[0]).send_with(&vehicle, |craft| craft.key = None);
            foreign(STRANGERS[1]).send_with(&vehicle, |craft| craft.hash_flip = 1);
        }
        if signed && self.bench.system_time && part > 0.5 && self.played.wrong_time.is_none() {
            self.played.wrong_time = Some(self.bench.net.mark());
            let time = (wall_stamp() + crate::wire::EPOCH_2015_S * STAMP_HZ) * 10
                + 10 * 365 * 86_400 * 1_000_000;
            for _ in 0..3 {
                self.peer.send(
                    &Draft::new("SYSTEM_TIME")
                        .bits("time_unix_usec", time)
                        .set("time_boot_ms", 1_000),
                );
            }
        }
        if signed && part > 0.85 && self.played.year_ahead.is_none() {
            self.played.year_ahead = Some(self.bench.net.mark());
            let odd = self.peer.with_link(74);
            odd.send_with(&vehicle, |craft| craft.stamp += 365 * 86_400 * STAMP_HZ);
        }
    }

    fn for_us(&self, seen: &Seen) -> bool {
        seen.frame.target().is_none_or(|(system, component)| {
            (system == 0 || system == self.peer.system) && component <= 1
        })
    }

    fn answer(&mut self, seen: &Seen, position: usize) {
        if !self.for_us(seen) {
            return;
        }
        let frame = &seen.frame;
        let from = (frame.system, frame.component);
        let kind = frame.int("mission_type");
        match frame.name().as_str() {
            "COMMAND_LONG" | "COMMAND_INT" => self.command(seen, position),
            "TIMESYNC" if frame.int("tc1") == 0 => {
                let now = self.bench.net.now().as_nanos() as u64;
                self.peer.send(
                    &Draft::new("TIMESYNC")
                        .bits("ts1", frame.int("ts1") as u64)
                        .bits("tc1", now.max(1)),
                );
            }
            "PING" if frame.int("target_system") == 0 => {
                self.peer.send(
                    &Draft::new("PING")
                        .to(from)
                        .set("seq", frame.int("seq") as f64)
                        .bits("time_usec", frame.int("time_usec") as u64),
                );
            }
            "PARAM_REQUEST_LIST" => {
                // Index 1 is left out the first time.
                for index in [0, 2] {
                    self.parameter(index);
                }
                self.played.gap.get_or_insert(position);
            }
            "PARAM_REQUEST_READ" => {
                let index = frame.int("param_index");
                let by_name = PARAMETERS
                    .iter()
                    .position(|(name, _)| *name == frame.text("param_id"));
                if let Some(index) = usize::try_from(index).ok().or(by_name) {
                    self.parameter(index);
                }
            }
            "PARAM_SET" => {
                if let Some(index) = PARAMETERS
                    .iter()
                    .position(|(name, _)| *name == frame.text("param_id"))
                {
                    self.peer.send(
                        &Draft::new("PARAM_VALUE")
                            .text("param_id", PARAMETERS[index].0)
                            .bits("param_value", frame.float("param_value").to_bits().into())
                            .set("param_count", PARAMETERS.len() as f64)
                            .set("param_index", index as f64)
                            .set("param_type", 9),
                    );
                }
            }
            "MISSION_REQUEST_LIST" => {
                let count = if kind == 0 { self.plan } else { 0 };
                self.peer.send(
                    &Draft::new("MISSION_COUNT")
                        .to(from)
                        .set("count", count.min(0) as f64)
                        .set("mission_type", kind as f64),
                );
            }
            "MISSION_CLEAR_ALL" => {
                self.plan = 0;
                self.mission_ack(from, kind);
            }
            "MISSION_COUNT" => {
                let count = frame.int("count");
                if self.played.uncounted.is_none() {
                    // The first MISSION_COUNT is treated as lost.
                    self.played.uncounted = Some(position);
                } else if count == 0 {
                    self.mission_ack(from, kind);
                } else {
                    self.uploading = Some((0, count, kind));
                    self.request(from, 0, kind);
                }
            }
            "MISSION_ITEM_INT" | "MISSION_ITEM" => self.item(frame.int("seq"), from),
            "SETUP_SIGNING" => self.take_key(seen, position),
            _ => {}
        }
    }

    fn command(&mut self, seen: &Seen, position: usize) {
        let command = seen.frame.int("command");
        let from = (seen.frame.system, seen.frame.component);
        let times = self.seen_commands.entry(command).or_default();
        *times += 1;
        let times = *times;
        if times == 1 {
            self.played.unanswered.push((command, position));
            return;
        }
        // Where a command that was acknowledged before is sent again, the old acknowledgement is sent first: a
        // replay.
        if let Some(old) = self.old_acks.get(&command)
            && self.bench.net.key().is_some()
            && !self
                .played
                .replayed
                .iter()
                .any(|(known, _)| *known == command)
        {
            self.peer.send_bytes(&old.clone());
            self.played.replayed.push((command, position));
            return;
        }
        let version = command == 512 && seen.frame.float("param1") == 148.0 || command == 520;
        let result = if command == 512 && !version { 2 } else { 0 };
        let ack = Draft::new("COMMAND_ACK")
            .to(from)
            .set("command", command as f64)
            .set("result", result);
        let (_, bytes) = self.peer.send_with(&ack, |_| {});
        self.old_acks.insert(command, bytes);
        self.played
            .acknowledged
            .push((command, self.bench.net.mark()));
        if version {
            self.peer.send(
                &Draft::new("AUTOPILOT_VERSION")
                    .bits("capabilities", 0xE8FF)
                    .set("flight_sw_version", 0x0112_0080),
            );
        }
    }

    fn parameter(&self, index: usize) {
        if let Some((name, value)) = PARAMETERS.get(index) {
            self.peer.send(
                &Draft::new("PARAM_VALUE")
                    .text("param_id", name)
                    .set("param_value", *value)
                    .set("param_count", PARAMETERS.len() as f64)
                    .set("param_index", index as f64)
                    .set("param_type", 9),
            );
        }
    }

    fn mission_ack(&self, from: (u8, u8), kind: i64) {
        self.peer.send(
            &Draft::new("MISSION_ACK")
                .to(from)
                .set("mission_type", kind as f64),
        );
    }

    fn request(&mut self, from: (u8, u8), seq: i64, kind: i64) {
        self.peer.send(
            &Draft::new("MISSION_REQUEST_INT")
                .to(from)
                .set("seq", seq as f64)
                .set("mission_type", kind as f64),
        );
        self.played.requested.push((seq, self.bench.net.mark()));
    }

    fn item(&mut self, seq: i64, from: (u8, u8)) {
        let Some((expected, count, kind)) = self.uploading else {
            return;
        };
        if seq != expected {
            return;
        }
        // The first item is requested twice, as if it had been lost.
        if !self.asked_twice {
            self.asked_twice = true;
            self.request(from, seq, kind);
            return;
        }
        if seq + 1 == count {
            self.uploading = None;
            if kind == 0 {
                self.plan = count;
            }
            self.mission_ack(from, kind);
        } else {
            self.uploading = Some((seq + 1, count, kind));
            self.request(from, seq + 1, kind);
        }
    }

    /// Accepts a key and stays silent for four seconds, as if the answer had been lost.
    fn take_key(&mut self, seen: &Seen, position: usize) {
        let Some(bytes) = seen.frame.payload.get(10..42) else {
            return;
        };
        let mut key = [0; 32];
        key.copy_from_slice(bytes);
        self.bench.net.set_key(Some(Key(key)));
        self.silent_until = self.bench.net.now() + Duration::from_secs(4);
        self.played.rekeyed = Some((position, Key(key)));
    }
}

const PARAMETERS: [(&str, f32); 3] = [
    ("MIS_TAKEOFF_ALT", 2.5),
    ("NAV_ACC_RAD", 10.0),
    ("RTL_RETURN_ALT", 60.0),
];

type Judge = fn(&Bench, &Played) -> Option<Judgement>;

/// Rules that are judged by the station's answers to what was played; `None` where it did not occur.
const PLAYED: &[(&str, Judge)] = &[
    ("CMD-101", repeats_unanswered),
    ("CMD-102", stops_when_answered),
    ("CMD-103", addresses_the_vehicle),
    ("MISS-101", answers_requests),
    ("MISS-102", repeats_count),
    ("PARAM-101", fills_gap),
    ("SIGN-025", old_acknowledgement),
    ("SIGN-024", follows_no_stranger),
    ("SIGN-011", own_time),
    ("SIGN-012", not_dragged),
    ("SIGN-027", keeps_new_key),
];

fn from_station(bench: &Bench, mark: usize, wanted: impl Fn(&Seen) -> bool) -> Vec<Arc<Seen>> {
    bench.net.all(mark, |seen| {
        seen.direction == Direction::Received && wanted(seen)
    })
}

fn is_command(seen: &Seen, command: i64) -> bool {
    (seen.frame.is("COMMAND_LONG") || seen.frame.is("COMMAND_INT"))
        && seen.frame.int("command") == command
}

fn verdict(holds: bool, reason: impl FnOnce() -> String) -> Option<Judgement> {
    Some(if holds {
        Judgement::pass()
    } else {
        Judgement::new(Verdict::Fail, reason())
    })
}

/// Time of the frame before a position.
fn at(bench: &Bench, position: usize) -> Duration {
    let recording = bench.net.recording();
    recording
        .seen
        .get(position.saturating_sub(1))
        .map_or(Duration::ZERO, |seen| seen.at)
}

fn repeats_unanswered(bench: &Bench, played: &Played) -> Option<Judgement> {
    let end = at(bench, played.end);
    let (command, position) = *played
        .unanswered
        .iter()
        .find(|(_, position)| at(bench, *position) + RETRY < end)?;
    let again = from_station(bench, position, |seen| is_command(seen, command));
    verdict(!again.is_empty(), || {
        format!(
            "command {command} had no answer and was not sent again within {} s",
            RETRY.as_secs()
        )
    })
}

fn stops_when_answered(bench: &Bench, played: &Played) -> Option<Judgement> {
    let (command, position) = *played.acknowledged.first()?;
    let began = at(bench, position);
    let after = from_station(bench, position, |seen| {
        is_command(seen, command)
            && seen.frame.int("confirmation") > 0
            && seen.at > began + Duration::from_millis(1_000)
            && seen.at < began + RETRY
    });
    verdict(after.len() <= 1, || {
        format!("command {command} was acknowledged and is repeated all the same")
    })
}

fn addresses_the_vehicle(bench: &Bench, _: &Played) -> Option<Judgement> {
    let commands = from_station(bench, 0, |seen| {
        seen.frame.is("COMMAND_LONG")
            || seen.frame.is("COMMAND_INT")
            || seen.frame.is("MISSION_COUNT")
    });
    if commands.is_empty() {
        return None;
    }
    let vehicles: BTreeSet<u8> = bench
        .net
        .all(0, |seen| seen.direction == Direction::Sent)
        .iter()
        .map(|seen| seen.frame.system)
        .collect();
    let lost = commands.iter().find(|seen| {
        seen.frame
            .target()
            .is_some_and(|(system, _)| system != 0 && !vehicles.contains(&system))
    });
    verdict(lost.is_none(), || {
        format!(
            "{} is addressed to a system that was never seen",
            lost.map_or_else(String::new, |seen| seen.frame.name())
        )
    })
}

fn answers_requests(bench: &Bench, played: &Played) -> Option<Judgement> {
    if played.requested.is_empty() {
        return None;
    }
    for (seq, position) in &played.requested {
        let asked = at(bench, *position);
        let item = from_station(bench, *position, |seen| {
            (seen.frame.is("MISSION_ITEM_INT") || seen.frame.is("MISSION_ITEM"))
                && seen.frame.int("seq") == *seq
                && seen.at < asked + Duration::from_secs(2)
        });
        if item.is_empty() {
            return verdict(false, || {
                format!(
                    "MISSION_REQUEST_INT {seq} was not answered with that item within 2 s (the first item is requested twice)"
                )
            });
        }
    }
    Some(Judgement::pass())
}

fn repeats_count(bench: &Bench, played: &Played) -> Option<Judgement> {
    let position = played.uncounted?;
    if at(bench, position) + RETRY > at(bench, played.end) {
        return None;
    }
    let again = from_station(bench, position, |seen| seen.frame.is("MISSION_COUNT"));
    verdict(!again.is_empty(), || {
        format!(
            "MISSION_COUNT had no answer and was not sent again within {} s",
            RETRY.as_secs()
        )
    })
}

fn fills_gap(bench: &Bench, played: &Played) -> Option<Judgement> {
    let position = played.gap?;
    let again = from_station(bench, position, |seen| {
        seen.frame.is("PARAM_REQUEST_READ") || seen.frame.is("PARAM_REQUEST_LIST")
    });
    verdict(!again.is_empty(), || {
        "of three parameters the second was lost, and it was not requested".into()
    })
}

fn old_acknowledgement(bench: &Bench, played: &Played) -> Option<Judgement> {
    let (command, position) = *played.replayed.first()?;
    if at(bench, position) + RETRY > at(bench, played.end) {
        return None;
    }
    let again = from_station(bench, position, |seen| is_command(seen, command));
    verdict(!again.is_empty(), || {
        format!(
            "command {command} was answered with an old COMMAND_ACK, byte by byte; it passed for the answer to the new command"
        )
    })
}

fn follows_no_stranger(bench: &Bench, played: &Played) -> Option<Judgement> {
    let position = played.strangers?;
    let followed = from_station(bench, position, |seen| {
        seen.frame
            .target()
            .is_some_and(|(system, _)| STRANGERS.contains(&system))
    });
    verdict(followed.is_empty(), || {
        let first = &followed[0].frame;
        format!(
            "{} was sent to system {}, whose HEARTBEATs are unsigned or badly signed",
            first.name(),
            first.int("target_system")
        )
    })
}

/// The highest timestamp of the station between two positions.
fn highest(bench: &Bench, from: usize) -> Option<u64> {
    from_station(bench, from, |seen| seen.frame.signature.is_some())
        .iter()
        .filter_map(|seen| seen.frame.signature)
        .map(|signature| signature.stamp)
        .max()
}

fn own_time(bench: &Bench, played: &Played) -> Option<Judgement> {
    let stamp = highest(bench, played.wrong_time?)?;
    // A station that follows a frame of next year is judged by SIGN-012.
    verdict(stamp < wall_stamp() + 5 * 365 * 86_400 * STAMP_HZ, || {
        "after a SYSTEM_TIME of ten years ahead the station stamps years ahead".into()
    })
}

fn not_dragged(bench: &Bench, played: &Played) -> Option<Judgement> {
    let stamp = highest(bench, played.year_ahead?)?;
    verdict(stamp < wall_stamp() + 2 * 3_600 * STAMP_HZ, || {
        format!(
            "one verified frame from a year ahead carried the station's timestamps along: {} days ahead",
            (stamp - wall_stamp()) / (86_400 * STAMP_HZ)
        )
    })
}

fn keeps_new_key(bench: &Bench, played: &Played) -> Option<Judgement> {
    let (position, key) = played.rekeyed?;
    let signed = from_station(bench, position, |seen| {
        seen.frame.verifies(&key) == Some(true) && !seen.frame.is("SETUP_SIGNING")
    });
    verdict(!signed.is_empty(), || {
        "the vehicle took the new key and its answer was lost; the station never signed with that key again".into()
    })
}

/// Judges what was played; reports in the order of the catalogue.
pub fn judge(
    bench: &Bench,
    catalogue: &Catalogue,
    options: &Options,
    played: &Played,
    show: &mut dyn FnMut(&RuleReport),
) -> Vec<RuleReport> {
    let frames = from_station(bench, 0, |_| true);
    let view = View {
        frames: &frames,
        role: Role::Station,
        key: if played.rekeyed.is_some() {
            None
        } else {
            bench.net.key()
        },
        rekeyed: played.rekeyed.map(|(position, _)| at(bench, position)),
        shifted: played
            .wrong_time
            .or(played.year_ahead)
            .map(|position| at(bench, position)),
        logs: &bench.logs,
        phrase: bench.phrase.as_deref(),
    };
    let mut reports = Vec::new();
    for rule in catalogue
        .rule
        .iter()
        .filter(|rule| options.wants(rule) && rule.subjects.contains(&Role::Station))
    {
        let report = judged(rule, bench, played, &view, options.strict);
        show(&report);
        reports.push(report);
    }
    reports
}

fn judged(
    rule: &Rule,
    bench: &Bench,
    played: &Played,
    view: &View<'_>,
    strict: bool,
) -> RuleReport {
    let unseen = || {
        Judgement::new(
            Verdict::Inconclusive,
            "not seen: the station did nothing that this rule is about",
        )
    };
    let (judgement, evidence) =
        if let Some((_, judge)) = PLAYED.iter().find(|(id, _)| *id == rule.id) {
            (judge(bench, played).unwrap_or_else(unseen), Vec::new())
        } else if let Some(judge) = JUDGES.iter().find(|judge| judge.rule == rule.id) {
            (judge.judge)(view)
        } else {
            (unseen(), Vec::new())
        };
    let judgement = judgement.at_level(rule.level, strict);
    RuleReport {
        verdict: judgement.verdict,
        reason: judgement.reason,
        evidence: evidence.iter().map(|seen| seen.evidence()).collect(),
        ..rule.report()
    }
}
