//! `dli-check capture`: judge recorded traffic without sending anything.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::output::profile;
use crate::bench::net::Datagram;
use crate::catalogue::{Catalogue, Subject as Role};
use crate::outcome::{Outputs, sha256};
use crate::passive::{View, judges_of};
use crate::report::capture::{Captured, read};
use crate::report::{DLI, Report, RuleReport, SCHEMA, Subject};
use crate::verdict::{Judgement, Verdict, also};
use crate::wire::dialect::Role as Side;
use crate::wire::{Direction, Piece, split};

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

/// The edition that the first message of a VSM shows.
fn shown(captured: &[Captured]) -> Option<&'static str> {
    let pieces = captured
        .iter()
        .flat_map(|datagram| split(&datagram.bytes).0);
    let first = pieces.into_iter().find(only_of_a_vsm)?;
    Some(match (&first.wrapped, first.idd()) {
        (Some(_), _) => "2.5",
        (None, 30) => "3",
        (None, _) => "4",
    })
}

/// Which addresses are VSMs': those that send what only a VSM sends.
fn vsms(captured: &[Captured]) -> Vec<SocketAddr> {
    let mut found: Vec<SocketAddr> = captured
        .iter()
        .filter(|datagram| split(&datagram.bytes).0.iter().any(only_of_a_vsm))
        .map(|datagram| datagram.from)
        .collect();
    found.sort();
    found.dedup();
    found
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

/// Every rule that can be judged by looking.
fn judged(catalogue: &Catalogue, view: &View<'_>, strict: bool) -> Vec<RuleReport> {
    let edition = &view.profile.subject.edition;
    let mut rules: Vec<RuleReport> = Vec::new();
    for applied in judges_of(edition, Role::Vsm) {
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
    let captured =
        read(&bytes).map_err(|error| format!("{}: {error}", arguments.file.display()))?;
    if let (None, None, Some(shown)) = (&arguments.edition, &arguments.profile, shown(&captured)) {
        shown.clone_into(&mut profile.subject.edition);
    }
    let vsms = vsms(&captured);
    let start = captured
        .first()
        .map_or(Duration::ZERO, |datagram| datagram.wall);
    let datagrams = datagrams(captured, &vsms, &profile.subject.edition);
    let view = View {
        datagrams: &datagrams,
        profile: &profile,
        survey: None,
        live: false,
        as_they_are: false,
    };
    let rules = judged(&catalogue, &view, arguments.strict);
    let vehicles = view.vehicles();
    let text = profile.to_toml();
    let mut report = Report {
        schema: SCHEMA.into(),
        suite: DLI.into(),
        program: format!("dli-check {}", env!("CARGO_PKG_VERSION")),
        catalogue: catalogue.catalogue.clone(),
        subject: Subject {
            role: "capture".into(),
            name: profile.subject.name.clone(),
            version: profile.subject.version.clone(),
            address: vsms
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join(", "),
            edition: profile.subject.edition.clone(),
            vehicles: vehicles.iter().map(ToString::to_string).collect(),
            cucs: Vec::new(),
        },
        started: start.as_secs(),
        duration_s: datagrams
            .last()
            .map_or(0.0, |datagram| datagram.at.as_secs_f64()),
        strict: arguments.strict,
        hashes: BTreeMap::from([("capture".to_owned(), sha256(&bytes))]),
        profile: text,
        remarks: Vec::new(),
        counts: BTreeMap::new(),
        expected: Vec::new(),
        rules,
    };
    if vsms.is_empty() {
        report
            .remarks
            .push("no datagram of a VSM was found in the file".into());
    }
    arguments.outputs.finish(report, expected, &datagrams)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use stanag_msgs::json::encode_line;

    use super::*;

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
                    json!({ "Original Message Instance ID": 7, "Original Message Type": 41 }),
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
        let catalogue = Catalogue::embedded();
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
        let mut profile = crate::profile::Profile::default();
        profile.subject.edition = "2.5".into();
        let datagrams = datagrams(captured, &[VSM.parse().unwrap()], "2.5");
        let view = View {
            datagrams: &datagrams,
            profile: &profile,
            survey: None,
            live: false,
            as_they_are: false,
        };
        judged(&catalogue, &view, false)
            .into_iter()
            .map(|rule| (rule.id, (rule.verdict, rule.reason)))
            .collect()
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
}
