//! `dli-check capture`: judge recorded traffic without sending anything.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use stanag_msgs::Id;

use super::output::profile;
use crate::bench::net::Datagram;
use crate::catalogue::{Catalogue, Subject as Role};
use crate::outcome::{Outputs, sha256};
use crate::passive::{View, judges_of};
use crate::profile::Profile;
use crate::report::capture::{Capture, Captured, read};
use crate::report::{DLI, Report, RuleReport, SCHEMA, Subject};
use crate::verdict::{Judgement, Verdict, also};
use crate::wire::dialect::Role as Side;
use crate::wire::{Direction, Piece, Seen, split};

/// Arguments of `dli-check capture`.
#[derive(Debug, Args)]
pub(super) struct CaptureArguments {
    /// A pcap or pcapng file
    file: PathBuf,
    /// Profile of the VSM (TOML)
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// Edition of the interface: 2.5, 3 or 4; what the recording shows where neither this nor a profile says
    #[arg(long, value_name = "E")]
    edition: Option<String>,
    /// A broken "should" is a fail
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    outputs: Outputs,
}

/// Whether only a VSM sends such a message.
fn only_of_a_vsm(piece: &Piece) -> bool {
    let kind = piece.message_type;
    match &piece.wrapped {
        None => matches!(kind, 2 | 3 | 3000..=4001 | 14000 | 16000 | 41000..=41005),
        Some(_) => matches!(kind, 20 | 21 | 100..=110 | 900 | 1100 | 1300..=1303),
    }
}

/// The edition that these messages show by the first one of a VSM.
fn shown<'a>(datagrams: impl IntoIterator<Item = &'a Captured>) -> Option<&'static str> {
    let pieces = datagrams
        .into_iter()
        .flat_map(|datagram| split(&datagram.bytes).0);
    let first = pieces.into_iter().find(only_of_a_vsm)?;
    Some(match (&first.wrapped, first.idd()) {
        (Some(_), _) => "2.5",
        (None, 30) => "3",
        (None, _) => "4",
    })
}

/// The VSM ID that a message names, where it names one.
fn vsm_id(piece: Piece) -> Option<Id> {
    let seen = Seen::new(Duration::ZERO, 0, Direction::Received, 0, piece);
    seen.info?.field("VSM ID")?;
    let id = Id(seen.raw("VSM ID")? as u32);
    (![Id(0), Id::NULL, Id::BROADCAST].contains(&id)).then_some(id)
}

/// Whether all of a datagram has the wrapper of Edition 2.5 where another edition is judged, or the other way round.
fn has_other_wrapper(bytes: &[u8], edition: &str) -> bool {
    let (pieces, fault) = split(bytes);
    let other = |piece: &Piece| match piece.wrapped {
        Some(_) => edition != "2.5",
        None => edition == "2.5" && matches!(piece.idd(), 30 | 32),
    };
    fault.is_none() && !pieces.is_empty() && pieces.iter().all(other)
}

/// A VSM of a recording.
#[derive(Debug)]
struct Vsm {
    id: Option<Id>,
    /// Where it sends from.
    addresses: Vec<SocketAddr>,
    edition: &'static str,
}

/// The VSMs of a recording: those that send what only a VSM sends. Each is judged by itself, since ids of alerts, logical
/// ids and the edition are its own. A VSM may send from several addresses, under one VSM ID.
fn vsms(captured: &[Captured]) -> Vec<Vsm> {
    let mut named: BTreeMap<SocketAddr, Option<Id>> = BTreeMap::new();
    for datagram in captured {
        let pieces = split(&datagram.bytes).0.into_iter();
        for piece in pieces.filter(only_of_a_vsm) {
            let id = named.entry(datagram.from).or_default();
            *id = id.or_else(|| vsm_id(piece));
        }
    }
    let mut found: Vec<Vsm> = Vec::new();
    let (with, without): (Vec<_>, Vec<_>) = named.into_iter().partition(|(_, id)| id.is_some());
    for (address, id) in with.into_iter().chain(without) {
        let at_ip = |vsm: &Vsm| vsm.addresses.iter().any(|other| other.ip() == address.ip());
        let of_ip = found.iter().filter(|vsm| at_ip(vsm)).count();
        let known = found.iter_mut().find(|vsm| match id {
            Some(_) => vsm.id == id,
            None => of_ip == 1 && at_ip(vsm),
        });
        if let Some(vsm) = known {
            vsm.addresses.push(address);
            continue;
        }
        let of_address = captured.iter().filter(|datagram| datagram.from == address);
        found.push(Vsm {
            id,
            addresses: vec![address],
            edition: shown(of_address).unwrap_or("4"),
        });
    }
    found
}

/// Which VSMs are judged: those of the edition, and the one that the profile names, where there are such. And why the others
/// are not.
fn chosen(vsms: Vec<Vsm>, profile: &Profile) -> (Vec<Vsm>, Vec<Vsm>, Vec<String>) {
    let edition = profile.subject.edition.as_str();
    let claimed = profile.subject.vsm_id.as_ref();
    let claimed: Option<Id> = claimed.and_then(|id| id.parse().ok());
    let is_claimed = |vsm: &Vsm| claimed.is_some() && vsm.id == claimed;
    let of_edition = |vsm: &Vsm| vsm.edition == edition;
    let any_claimed = vsms.iter().any(is_claimed);
    let any_of_edition = vsms.iter().any(of_edition);
    let mut remarks = Vec::new();
    let (judged, others) = vsms.into_iter().partition(|vsm| {
        let at = vsm.addresses.first();
        let at = at.map(ToString::to_string).unwrap_or_default();
        if any_claimed {
            if !is_claimed(vsm) {
                remarks.push(format!(
                    "the VSM at {at} is not that of the profile, and was not judged"
                ));
            }
            return is_claimed(vsm);
        }
        let wanted = of_edition(vsm) || !any_of_edition;
        if !wanted {
            remarks.push(format!(
                "the VSM at {at} speaks Edition {0}, and was not judged: judge it by --edition {0}",
                vsm.edition
            ));
        }
        wanted
    });
    (judged, others, remarks)
}

/// The datagrams with their messages; those of a VSM are received ones.
fn datagrams(captured: Vec<Captured>, vsms: &[SocketAddr], edition: &str) -> Vec<Datagram> {
    let dialect = (edition == "2.5").then_some(Side::Cucs);
    let start = captured
        .first()
        .map_or(Duration::ZERO, |datagram| datagram.wall);
    let mut sockets: BTreeMap<SocketAddr, usize> = BTreeMap::new();
    captured
        .into_iter()
        .map(|datagram| {
            let received = vsms.contains(&datagram.from);
            let direction = if received {
                Direction::Received
            } else {
                Direction::Sent
            };
            let (local, remote) = if received {
                (datagram.to, datagram.from)
            } else {
                (datagram.from, datagram.to)
            };
            let next = sockets.len();
            let socket = *sockets.entry(local).or_insert(next);
            let at = datagram.wall.saturating_sub(start);
            Datagram::new(
                (at, datagram.wall),
                direction,
                socket,
                (local, remote),
                datagram.bytes,
                dialect,
            )
        })
        .collect()
}

/// A recording as it is judged.
struct Recording {
    /// Where the VSMs that are judged send from.
    vsms: Vec<SocketAddr>,
    /// All datagrams but those of VSMs that are not judged.
    datagrams: Vec<Datagram>,
    /// Those of each VSM, where there are several.
    parts: Vec<Vec<Datagram>>,
    /// What was not judged, and why.
    remarks: Vec<String>,
}

impl Recording {
    fn new(mut captured: Vec<Captured>, profile: &Profile) -> Self {
        let edition = profile.subject.edition.as_str();
        let (judged, others, mut remarks) = chosen(vsms(&captured), profile);
        let addresses = |vsms: &[Vsm]| -> Vec<SocketAddr> {
            let all = vsms.iter().flat_map(|vsm| &vsm.addresses);
            all.copied().collect()
        };
        let (vsms, others) = (addresses(&judged), addresses(&others));
        captured.retain(|one| !others.contains(&one.from) && !others.contains(&one.to));
        // One VSM may speak both wrappers, each with the CUCSs that speak it.
        let of_edition = |one: &Captured| !has_other_wrapper(&one.bytes, edition);
        let own = |one: &Captured| vsms.contains(&one.from) && of_edition(one);
        if captured.iter().any(own) {
            let before = captured.len();
            captured.retain(of_edition);
            let left_out = before - captured.len();
            if left_out > 0 {
                remarks.push(format!(
                    "{left_out} datagrams have the wrapper of another edition, and were not judged: judge them by --edition"
                ));
            }
        }
        let datagrams = datagrams(captured, &vsms, edition);
        // What went to the address of another one is not for this one; what went to a group may be.
        let of = |vsm: &Vsm| -> Vec<Datagram> {
            let concerns = |datagram: &&Datagram| {
                let sent = datagram.direction == Direction::Sent;
                vsm.addresses.contains(&datagram.remote) || sent && !vsms.contains(&datagram.remote)
            };
            datagrams.iter().filter(concerns).cloned().collect()
        };
        let parts = if judged.len() > 1 {
            judged.iter().map(of).collect()
        } else {
            Vec::new()
        };
        Self {
            vsms,
            datagrams,
            parts,
            remarks,
        }
    }

    /// What the judges look at, one after the other.
    fn views<'a>(&'a self, profile: &'a Profile) -> Vec<View<'a>> {
        let view = |datagrams: &'a Vec<Datagram>| View {
            datagrams,
            profile,
            survey: None,
            live: false,
            as_they_are: false,
        };
        if self.parts.is_empty() {
            return vec![view(&self.datagrams)];
        }
        self.parts.iter().map(view).collect()
    }
}

/// What two judges of one rule found: what one of them did not see takes nothing from what the other one did.
fn together(first: Judgement, second: Judgement) -> Judgement {
    match (first.verdict, second.verdict) {
        (_, Verdict::Inconclusive) => first,
        (Verdict::Inconclusive, _) => second,
        // Both findings are kept, since only one of them may be expected.
        (Verdict::Fail, Verdict::Fail) => {
            Judgement::new(Verdict::Fail, also(&first.reason, &second.reason))
        }
        _ => first.and(second),
    }
}

/// Every rule that can be judged by looking, over all of these views of one profile.
fn judged(catalogue: &Catalogue, views: &[View<'_>], strict: bool) -> Vec<RuleReport> {
    let mut rules: Vec<RuleReport> = Vec::new();
    let all = views.iter().flat_map(|view| {
        let judges = judges_of(&view.profile.subject.edition, Role::Vsm);
        judges.into_iter().map(move |applied| (view, applied))
    });
    for (view, applied) in all {
        let edition = &view.profile.subject.edition;
        let Some(rule) = catalogue
            .find(applied.judge.rule)
            .filter(|rule| rule.subject != Role::Cucs && rule.editions.contains(edition))
        else {
            continue;
        };
        let (judgement, evidence) = applied.judge(view);
        let judgement = judgement.at_level(rule.level, strict);
        if let Some(known) = rules.iter_mut().find(|known| known.id == rule.id) {
            let before = Judgement::new(known.verdict, known.reason.clone());
            let after = together(before.clone(), judgement);
            if after != before {
                (known.verdict, known.reason) = (after.verdict, after.reason);
                known.evidence = evidence.iter().map(|seen| seen.evidence()).collect();
            }
            continue;
        }
        rules.push(RuleReport {
            verdict: judgement.verdict,
            reason: judgement.reason,
            evidence: evidence.iter().map(|seen| seen.evidence()).collect(),
            ..RuleReport::new(rule, edition)
        });
    }
    rules
}

pub(super) fn judge(arguments: &CaptureArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let mut profile = profile(arguments.profile.as_deref())?;
    if let Some(edition) = &arguments.edition {
        profile.subject.edition.clone_from(edition);
        profile.check().map_err(|error| error.to_string())?;
    }
    let expected = arguments.outputs.read_expected()?;
    let bytes = std::fs::read(&arguments.file)
        .map_err(|error| format!("{}: {error}", arguments.file.display()))?;
    let Capture {
        datagrams: captured,
        cut,
    } = read(&bytes).map_err(|error| format!("{}: {error}", arguments.file.display()))?;
    if let (None, None, Some(shown)) = (&arguments.edition, &arguments.profile, shown(&captured)) {
        shown.clone_into(&mut profile.subject.edition);
    }
    let start = captured
        .first()
        .map_or(Duration::ZERO, |datagram| datagram.wall);
    let recording = Recording::new(captured, &profile);
    let mut remarks = recording.remarks.clone();
    if cut > 0 {
        remarks.push(format!(
            "{cut} packets of the file have a part of a datagram only, and were not judged: record without a limit of the packet size"
        ));
    }
    if recording.vsms.is_empty() {
        remarks.push("no datagram of a VSM was found in the file".into());
    }
    let views = recording.views(&profile);
    let rules = judged(&catalogue, &views, arguments.strict);
    let vehicles: BTreeSet<Id> = views.iter().flat_map(View::vehicles).collect();
    let text = profile.to_toml();
    let report = Report {
        schema: SCHEMA.into(),
        suite: DLI.into(),
        program: format!("dli-check {}", env!("CARGO_PKG_VERSION")),
        catalogue: catalogue.catalogue.clone(),
        subject: Subject {
            role: "capture".into(),
            name: profile.subject.name.clone(),
            version: profile.subject.version.clone(),
            address: recording
                .vsms
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join(", "),
            edition: profile.subject.edition.clone(),
            vehicles: vehicles.iter().map(ToString::to_string).collect(),
            cucs: Vec::new(),
        },
        started: start.as_secs(),
        duration_s: recording
            .datagrams
            .last()
            .map_or(0.0, |datagram| datagram.at.as_secs_f64()),
        strict: arguments.strict,
        hashes: BTreeMap::from([("capture".to_owned(), sha256(&bytes))]),
        profile: text,
        remarks,
        counts: BTreeMap::new(),
        expected: Vec::new(),
        rules,
    };
    arguments
        .outputs
        .finish(report, expected, &recording.datagrams)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use stanag_msgs::json::encode_line;

    use super::*;
    use crate::wire::Draft;

    const VSM: &str = "10.0.0.1:4586";
    const CUCS: &str = "10.0.0.2:4586";
    const VEHICLE: u32 = 0x1b00_0101;
    const STATION: u32 = 0x1b00_00a0;
    /// When it was recorded: seconds since 1970.
    const THEN: f64 = 1_163_000_000.0;

    fn bytes(id: u16, instance: u32, mut fields: Value) -> Vec<u8> {
        fields["Time Stamp"] = json!(THEN);
        fields["Vehicle ID"] = json!(VEHICLE);
        fields["CUCS ID"] = json!(STATION);
        let line =
            json!({ "id": id, "idd": "2.5", "instance": instance, "fields": fields }).to_string();
        let hex = encode_line(&line, true).unwrap_or_else(|error| panic!("#{id}: {error}"));
        let digits: Vec<u8> = hex
            .chars()
            .map(|digit| digit.to_digit(16).unwrap() as u8)
            .collect();
        digits
            .chunks(2)
            .map(|pair| pair[0] << 4 | pair[1])
            .collect()
    }

    /// A short flight's traffic: who sent it, and the datagram.
    fn lawful() -> Vec<(bool, Vec<u8>)> {
        let alert = |id: i32, instance| {
            let text = json!({ "Warning ID": id, "Text": "LOW", "Priority": 2, "Type": 2, "Subsystem ID": 5, "Subsystem State Report Reference": -1 });
            bytes(1100, instance, text)
        };
        vec![
            (false, bytes(1, 1, json!({ "VSM ID": -1 }))),
            (
                true,
                bytes(21, 1, json!({ "LOI Authorized": 15, "LOI Granted": 4 })),
            ),
            (false, bytes(1401, 1, json!({ "Message Type": 41 }))),
            (
                false,
                bytes(41, 7, json!({ "Loiter Type": 1, "Loiter Radius": 90.0 })),
            ),
            (
                true,
                bytes(
                    1400,
                    1,
                    json!({ "Original Message Instance ID": 7, "Original Message Type": 41, "Original Message Time Stamp": THEN }),
                ),
            ),
            (
                true,
                bytes(
                    101,
                    1,
                    json!({ "Latitude": 0.8, "Longitude": 0.15, "Altitude": 500.0 }),
                ),
            ),
            (
                true,
                bytes(
                    101,
                    2,
                    json!({ "Latitude": 0.8, "Longitude": 0.15, "Altitude": 501.0 }),
                ),
            ),
            (true, alert(-5, 1)),
            (true, alert(5, 2)),
        ]
    }

    fn verdicts(traffic: Vec<(bool, Vec<u8>)>) -> BTreeMap<String, (Verdict, String)> {
        let captured: Vec<Captured> = traffic
            .into_iter()
            .enumerate()
            .map(|(index, (of_vsm, bytes))| {
                let (from, to) = if of_vsm { (VSM, CUCS) } else { (CUCS, VSM) };
                Captured {
                    wall: Duration::from_secs_f64(THEN) + Duration::from_millis(100 * index as u64),
                    from: from.parse().unwrap(),
                    to: to.parse().unwrap(),
                    bytes,
                }
            })
            .collect();
        assert_eq!(shown(&captured), Some("2.5"));
        let mut profile = Profile::default();
        profile.subject.edition = "2.5".into();
        verdicts_on(captured, &profile).0
    }

    /// Verdicts and reasons of the rules, and the remarks.
    fn verdicts_on(
        captured: Vec<Captured>,
        profile: &Profile,
    ) -> (BTreeMap<String, (Verdict, String)>, Vec<String>) {
        let recording = Recording::new(captured, profile);
        let rules = judged(&Catalogue::embedded(), &recording.views(profile), false);
        let verdicts = rules
            .into_iter()
            .map(|rule| (rule.id, (rule.verdict, rule.reason)))
            .collect();
        (verdicts, recording.remarks)
    }

    /// Recomputes the checksum.
    fn summed(mut bytes: Vec<u8>) -> Vec<u8> {
        let end = bytes.len() - 4;
        let sum: u32 = bytes[..end].iter().map(|&byte| u32::from(byte)).sum();
        bytes[end..].copy_from_slice(&sum.to_be_bytes());
        bytes
    }

    /// A fault: which datagram, how it is changed, and which rule has to find it.
    type Fault = (&'static str, usize, fn(Vec<u8>) -> Vec<u8>);

    const FAULTS: &[Fault] = &[
        ("WRAP-002", 5, |bytes| bytes[..bytes.len() - 1].to_vec()),
        ("WRAP-003", 5, |mut bytes| {
            // One field less, with a length and a sum that fit.
            let at = bytes.len() - 4 - 4;
            bytes.drain(at..at + 4);
            let length = (bytes.len() - 34) as u32;
            bytes[18..22].copy_from_slice(&length.to_be_bytes());
            summed(bytes)
        }),
        ("WRAP-006", 5, |mut bytes| {
            *bytes.last_mut().unwrap() ^= 1;
            bytes
        }),
        ("WRAP-011", 5, |mut bytes| {
            bytes[2] = b'7';
            summed(bytes)
        }),
        ("WRAP-015", 6, |mut bytes| {
            bytes[10..14].copy_from_slice(&1_u32.to_be_bytes());
            summed(bytes)
        }),
        ("WRAP-015", 6, |mut bytes| {
            bytes[26..30].copy_from_slice(&9_u32.to_be_bytes());
            summed(bytes)
        }),
        ("SCALAR-001", 5, |mut bytes| {
            bytes[18..22].reverse();
            bytes
        }),
        ("SCALAR-002", 5, |mut bytes| {
            bytes[46..54].copy_from_slice(&f64::NAN.to_be_bytes());
            summed(bytes)
        }),
        ("TIME-001", 5, |mut bytes| {
            bytes[30..38].copy_from_slice(&(THEN - 946_684_800.0).to_be_bytes());
            summed(bytes)
        }),
        ("ACK-002", 2, |_| {
            bytes(1401, 1, json!({ "Message Type": 42 }))
        }),
        ("ACK-004", 3, |_| {
            bytes(41, 8, json!({ "Loiter Type": 1, "Loiter Radius": 90.0 }))
        }),
        ("AUTH-011", 1, |_| {
            bytes(21, 1, json!({ "LOI Authorized": 3, "LOI Granted": 4 }))
        }),
        ("ALERT-003", 7, |_| {
            bytes(
                1100,
                1,
                json!({ "Warning ID": -5, "Text": "LOW", "Priority": 6, "Type": 2, "Subsystem ID": 5, "Subsystem State Report Reference": -1 }),
            )
        }),
    ];

    #[test]
    fn what_one_judge_did_not_see_hides_nothing() {
        use Verdict::{Fail, Inconclusive, Pass, Warning};
        for (first, second, both) in [
            (Inconclusive, Pass, Pass),
            (Inconclusive, Warning, Warning),
            (Pass, Inconclusive, Pass),
            (Pass, Warning, Warning),
            (Warning, Fail, Fail),
            (Fail, Pass, Fail),
        ] {
            let judged = |verdict: Verdict| Judgement::new(verdict, verdict.name());
            let found = together(judged(first), judged(second));
            assert_eq!(found.verdict, both, "{first:?} {second:?}");
        }
    }

    #[test]
    fn traffic_of_edition_2_5_is_judged_and_each_fault_is_found_by_its_rule() {
        let found = verdicts(lawful());
        for (id, (verdict, reason)) in &found {
            assert!(
                matches!(verdict, Verdict::Pass | Verdict::Inconclusive),
                "{id} {verdict:?} {reason}"
            );
        }
        for (rule, place, change) in FAULTS {
            assert_eq!(found[*rule].0, Verdict::Pass, "{rule}: {}", found[*rule].1);
            let mut traffic = lawful();
            traffic[*place].1 = change(traffic[*place].1.clone());
            let found = verdicts(traffic);
            assert_eq!(found[*rule].0, Verdict::Fail, "{rule}: {}", found[*rule].1);
        }
    }

    #[test]
    fn a_recording_of_edition_2_5_may_begin_late_and_contain_a_restart() {
        for first in 1..=5 {
            let found = verdicts(lawful().split_off(first));
            for (id, (verdict, reason)) in &found {
                assert!(!verdict.is_fail(), "{first} {id} {reason}");
            }
        }
        // The sender counts from the beginning again.
        let position = |instance: u32, altitude: f64| {
            let fields = json!({ "Latitude": 0.8, "Longitude": 0.15, "Altitude": altitude });
            (true, bytes(101, instance, fields))
        };
        let mut restarted = lawful();
        restarted.extend([position(40, 502.0), position(1, 503.0), position(2, 504.0)]);
        assert_eq!(verdicts(restarted.clone())["WRAP-015"].0, Verdict::Pass);
        restarted.push(position(2, 505.0));
        assert_eq!(verdicts(restarted)["WRAP-015"].0, Verdict::Fail);
    }

    #[test]
    fn what_concerns_all_vehicles_has_the_id_of_everybody_in_edition_2_5() {
        for id in [Id::BROADCAST, Id::NULL] {
            let mut traffic = lawful();
            let mut alert = traffic[7].1.clone();
            alert[38..42].copy_from_slice(&id.0.to_be_bytes());
            traffic[7].1 = summed(alert);
            let found = verdicts(traffic);
            assert_eq!(found["DISC-010"].0, Verdict::Pass, "{id}");
        }
    }

    /// A message of Edition 3 or 4 from one address to another, after so many ms.
    fn captured(at_ms: u64, [from, to]: [&str; 2], idd: u8, draft: &Draft) -> Captured {
        Captured {
            wall: Duration::from_secs_f64(THEN) + Duration::from_millis(at_ms),
            from: from.parse().unwrap(),
            to: to.parse().unwrap(),
            bytes: draft.clone().raw("Time Stamp", at_ms as i64).encode(
                Id(VEHICLE),
                Id(STATION),
                idd,
                1,
            ),
        }
    }

    const OTHER: &str = "10.0.0.3:4586";

    /// What two VSMs, which both have a vehicle of the logical id 1, send to one CUCS.
    fn two_vsms(idd: [u8; 2]) -> Vec<Captured> {
        let logical = Id(1);
        let of = |vsm: u32, kind: i64| {
            let draft = Draft::new(2).id("VSM ID", Id(vsm)).from(logical);
            draft.raw("Vehicle Type", kind).raw("Vehicle Subtype", 1)
        };
        let alert = Draft::new(16000)
            .raw("Alert (Warning) ID", -1)
            .raw("Priority", 0)
            .from(logical);
        let mut all = Vec::new();
        for step in 0..3 {
            let at_ms = step * 1_000;
            all.push(captured(at_ms, [VSM, CUCS], idd[0], &of(0x1b00_0001, 22)));
            all.push(captured(
                at_ms + 10,
                [OTHER, CUCS],
                idd[1],
                &of(0x1b00_0002, 21),
            ));
        }
        all.push(captured(3_000, [VSM, CUCS], idd[0], &alert));
        all.push(captured(3_010, [OTHER, CUCS], idd[1], &alert));
        all
    }

    #[test]
    fn each_vsm_of_a_recording_is_judged_by_itself() {
        let (found, remarks) = verdicts_on(two_vsms([32, 32]), &Profile::default());
        assert!(remarks.is_empty(), "{remarks:?}");
        for rule in ["DISC-006", "DISC-010", "WRAP-012", "WRAP-014"] {
            assert_eq!(found[rule].0, Verdict::Pass, "{rule} {}", found[rule].1);
        }
        assert_eq!(found["ALERT-001"].0, Verdict::Pass);
        // The fault of one is not hidden by the other.
        let mut faulty = two_vsms([32, 32]);
        let wrong = Draft::new(3)
            .id("VSM ID", Id(0x1b00_0002))
            .from(Id(1))
            .raw("Vehicle Type", 22)
            .raw("Vehicle Subtype", 1);
        faulty.insert(4, captured(1_500, [OTHER, CUCS], 32, &wrong));
        let (found, _) = verdicts_on(faulty, &Profile::default());
        assert_eq!(found["DISC-006"].0, Verdict::Fail);
    }

    #[test]
    fn a_vsm_of_another_edition_is_not_judged_by_this_one() {
        let mixed = two_vsms([32, 30]);
        let (found, remarks) = verdicts_on(mixed.clone(), &Profile::default());
        assert_eq!(found["WRAP-012"].0, Verdict::Pass);
        assert!(remarks[0].contains("--edition 3"), "{remarks:?}");
        // Where only such a VSM is there, it is the subject.
        let other: SocketAddr = OTHER.parse().unwrap();
        let only: Vec<Captured> = mixed
            .into_iter()
            .filter(|one| one.from == other)
            .chain([captured(9_000, [CUCS, OTHER], 32, &Draft::new(1))])
            .collect();
        let (found, _) = verdicts_on(only, &Profile::default());
        assert_eq!(found["WRAP-012"].0, Verdict::Fail);
    }

    #[test]
    fn one_vsm_may_speak_both_wrappers() {
        let both = |edition: &str| {
            let mut all: Vec<Captured> = (0..)
                .zip(lawful())
                .map(|(step, (of_vsm, bytes))| {
                    let (from, to) = if of_vsm { (VSM, CUCS) } else { (CUCS, VSM) };
                    Captured {
                        wall: Duration::from_secs_f64(THEN) + Duration::from_millis(100 * step),
                        from: from.parse().unwrap(),
                        to: to.parse().unwrap(),
                        bytes,
                    }
                })
                .collect();
            let second = "10.0.0.4:4586";
            all.push(captured(2_000, [second, VSM], 32, &Draft::new(1)));
            all.push(captured(2_100, [VSM, second], 32, &Draft::new(3001)));
            let mut profile = Profile::default();
            profile.subject.edition = edition.into();
            let (found, remarks) = verdicts_on(all, &profile);
            assert_eq!(remarks.len(), 1, "{remarks:?}");
            found
        };
        assert_eq!(both("4")["WRAP-012"].0, Verdict::Pass);
        assert_eq!(both("2.5")["WRAP-002"].0, Verdict::Pass);
    }

    #[test]
    fn one_vsm_may_send_from_several_addresses() {
        let id = Id(0x1b00_0001);
        let named = Draft::new(2).id("VSM ID", id);
        let all = [
            captured(0, ["10.0.0.1:4586", CUCS], 32, &named),
            captured(1, ["10.0.0.9:4586", CUCS], 32, &named),
            captured(
                2,
                ["10.0.0.9:5000", "239.1.1.1:4586"],
                32,
                &Draft::new(4000),
            ),
            captured(3, [OTHER, CUCS], 32, &Draft::new(3001)),
        ];
        let found = vsms(&all);
        let addresses: Vec<usize> = found.iter().map(|vsm| vsm.addresses.len()).collect();
        assert_eq!(addresses, [3, 1]);
        assert_eq!((found[0].id, found[1].id), (Some(id), None));
        let mut profile = Profile::default();
        profile.subject.vsm_id = Some(id.to_string());
        let (judged, others, remarks) = chosen(found, &profile);
        assert_eq!((judged.len(), others.len(), remarks.len()), (1, 1, 1));
    }
}
