//! `dli-check capture`: judge recorded traffic without sending anything.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;

use super::output::{Outputs, profile};
use crate::bench::net::Datagram;
use crate::catalogue::{Catalogue, Subject as Role};
use crate::outcome::sha256;
use crate::passive::{View, judges};
use crate::report::capture::{Captured, read};
use crate::report::{DLI, Report, RuleReport, SCHEMA, Subject};
use crate::wire::{Direction, Seen, split};

/// Arguments of `dli-check capture`.
#[derive(Debug, Args)]
pub(super) struct CaptureArguments {
    /// A pcap or pcapng file
    file: PathBuf,
    /// Profile of the VSM (TOML)
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// Edition of the interface: 3 or 4
    #[arg(long, value_name = "E")]
    edition: Option<String>,
    /// A broken "should" is a fail
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    outputs: Outputs,
}

const EPOCH_2000_MS: u64 = 946_684_800_000;

/// Which addresses are VSMs': those that send what only a VSM sends.
fn vsms(captured: &[Captured]) -> Vec<SocketAddr> {
    let mut found: Vec<SocketAddr> = captured
        .iter()
        .filter(|datagram| split(&datagram.bytes).0.iter().any(|piece| matches!(piece.message_type, 2 | 3 | 3000..=4001 | 14000 | 16000 | 41000..=41005)))
        .map(|datagram| datagram.from)
        .collect();
    found.sort();
    found.dedup();
    found
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
    let vsms = vsms(&captured);
    let start = captured
        .first()
        .map_or(Duration::ZERO, |datagram| datagram.wall);
    let mut sockets: BTreeMap<SocketAddr, usize> = BTreeMap::new();
    let datagrams: Vec<Datagram> = captured
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
            let (pieces, fault) = split(&datagram.bytes);
            let at = datagram.wall.saturating_sub(start);
            let wall_ms = (datagram.wall.as_millis() as u64).saturating_sub(EPOCH_2000_MS);
            let messages = pieces
                .into_iter()
                .map(|piece| Arc::new(Seen::new(at, wall_ms, direction, socket, piece)))
                .collect();
            Datagram {
                at,
                wall: datagram.wall,
                direction,
                local,
                remote,
                bytes: datagram.bytes,
                messages,
                fault,
            }
        })
        .collect();
    let view = View {
        datagrams: &datagrams,
        profile: &profile,
        survey: None,
        live: false,
    };
    let mut rules: Vec<RuleReport> = Vec::new();
    for judge in judges() {
        let Some(rule) = catalogue.find(judge.rule).filter(|rule| {
            rule.subject != Role::Cucs && rule.editions.contains(&profile.subject.edition)
        }) else {
            continue;
        };
        let (judgement, evidence) = crate::runner::judged_by(judge, &view);
        let judgement = judgement.at_level(rule.level, arguments.strict);
        if let Some(known) = rules.iter_mut().find(|known| known.id == rule.id) {
            if judgement.verdict.is_fail() && !known.verdict.is_fail() {
                (known.verdict, known.reason) = (judgement.verdict, judgement.reason);
                known.evidence = evidence.iter().map(|seen| seen.evidence()).collect();
            }
            continue;
        }
        rules.push(RuleReport {
            verdict: judgement.verdict,
            reason: judgement.reason,
            evidence: evidence.iter().map(|seen| seen.evidence()).collect(),
            ..RuleReport::new(rule, &profile.subject.edition)
        });
    }
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
            vehicles: view.vehicles().iter().map(ToString::to_string).collect(),
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
