//! `dli-check cucs`: judge a CUCS by what it sends to a scripted vehicle.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use clap::Args;

use super::output::profile;
use crate::bench::net::Net;
use crate::catalogue::{Catalogue, Subject as Role};
use crate::outcome::{eprint, print};
use crate::passive::{View, cucs_judges};
use crate::report::{DLI, Report, RuleReport, SCHEMA, Subject};
use crate::scripted::{Scenario, Vehicle};
use crate::verdict::Verdict;
use crate::wire::Direction;

/// Arguments of `dli-check cucs`.
#[derive(Debug, Args)]
pub(super) struct CucsArguments {
    /// Where the scripted vehicle listens
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:4586")]
    listen: SocketAddr,
    /// What the vehicle does to the CUCS (repeatable; all in turn where left out and --command is given)
    #[arg(long, value_enum)]
    scenario: Vec<Scenario>,
    /// Shell command that starts the CUCS for each scenario; {scenario} stands for its name. Without it an operator does it
    #[arg(long, value_name = "COMMAND")]
    command: Option<String>,
    /// How long a scenario lasts, in seconds; a command that ends earlier ends it
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    time: f64,
    /// Profile (TOML)
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// A broken "should" is a fail
    #[arg(long)]
    strict: bool,
    /// Judge just this rule (repeatable)
    #[arg(long, value_name = "ID")]
    rule: Vec<String>,
    /// Write report.json to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub(super) fn judge(arguments: &CucsArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let profile = profile(arguments.profile.as_deref())?;
    let scenarios = match (&arguments.scenario[..], &arguments.command) {
        ([], None) => vec![Scenario::Normal],
        ([], Some(_)) => vec![
            Scenario::Normal,
            Scenario::Deny,
            Scenario::Payload,
            Scenario::Revoke,
            Scenario::Damaged,
            Scenario::Handover,
            Scenario::Odd,
        ],
        (chosen, _) => chosen.to_vec(),
    };
    let mut rules: BTreeMap<String, RuleReport> = BTreeMap::new();
    let mut answered = false;
    for scenario in scenarios {
        let net = Net::new();
        let mut vehicle = Vehicle::new(&net, arguments.listen, scenario)
            .map_err(|error| format!("{}: {error}", arguments.listen))?;
        let name = format!("{scenario:?}").to_lowercase();
        eprint(&format!(
            "scenario {name}: the vehicle {} listens on {} for {:.0} s",
            crate::scripted::VEHICLE,
            vehicle.local(),
            arguments.time
        ));
        let child = match &arguments.command {
            None => {
                eprint(
                    "At the CUCS: search for vehicles, take control, upload a route of four points, command modes, release.",
                );
                None
            }
            Some(command) => {
                let command = command.replace("{scenario}", &name);
                let mut shell = Command::new("sh");
                shell
                    .args(["-c", &command])
                    .stdin(Stdio::null())
                    .stdout(Stdio::null())
                    .stderr(Stdio::null());
                Some(
                    shell
                        .spawn()
                        .map_err(|error| format!("{command:?}: {error}"))?,
                )
            }
        };
        let end = Duration::from_secs_f64(arguments.time);
        match child {
            None => vehicle.serve(end),
            Some(mut child) => {
                while net.now() < end {
                    let next = net.now() + Duration::from_millis(200);
                    vehicle.serve(next.min(end));
                    if matches!(child.try_wait(), Ok(Some(_))) {
                        let rest = net.now() + Duration::from_millis(500);
                        vehicle.serve(rest.min(end));
                        break;
                    }
                }
                let _ = child.kill();
                let _ = child.wait();
            }
        }
        let datagrams = net.recording().datagrams.clone();
        answered |= datagrams
            .iter()
            .any(|datagram| datagram.direction == Direction::Received);
        let view = View {
            datagrams: &datagrams,
            profile: &profile,
            survey: None,
            live: true,
        };
        for judge in cucs_judges() {
            let Some(rule) = catalogue.find(judge.rule).filter(|rule| {
                rule.subject != Role::Vsm && rule.editions.contains(&profile.subject.edition)
            }) else {
                continue;
            };
            if !arguments.rule.is_empty() && !arguments.rule.contains(&rule.id) {
                continue;
            }
            let (judgement, evidence) = crate::runner::judged_by(judge, &view);
            let judgement = judgement.at_level(rule.level, arguments.strict);
            let report = rules.entry(rule.id.clone()).or_insert_with(|| RuleReport {
                verdict: Verdict::Inconclusive,
                reason: "not seen: nothing that this rule is about occurred in the traffic".into(),
                ..RuleReport::new(rule, &profile.subject.edition)
            });
            let better = match (report.verdict, judgement.verdict) {
                (Verdict::Fail, _) => false,
                (_, Verdict::Fail) | (Verdict::Inconclusive, _) => true,
                (Verdict::Pass, Verdict::Warning) => true,
                _ => false,
            };
            if better {
                (report.verdict, report.reason) = (judgement.verdict, judgement.reason);
                report.notes = vec![format!("scenario {name}")];
                report.evidence = evidence.iter().map(|seen| seen.evidence()).collect();
            }
        }
    }
    let mut report = Report {
        schema: SCHEMA.into(),
        suite: DLI.into(),
        program: format!("dli-check {}", env!("CARGO_PKG_VERSION")),
        catalogue: catalogue.catalogue.clone(),
        subject: Subject {
            role: "cucs".into(),
            name: profile.subject.name.clone(),
            version: profile.subject.version.clone(),
            address: arguments.listen.to_string(),
            edition: profile.subject.edition.clone(),
            ..Subject::default()
        },
        started: 0,
        duration_s: 0.0,
        strict: arguments.strict,
        profile: profile.to_toml(),
        hashes: BTreeMap::new(),
        remarks: Vec::new(),
        counts: BTreeMap::new(),
        expected: Vec::new(),
        rules: rules.into_values().collect(),
    };
    if !answered {
        report
            .remarks
            .push(format!("nothing came to {}", arguments.listen));
    }
    report.count();
    if let Some(path) = &arguments.json {
        std::fs::write(path, report.to_json())
            .map_err(|error| format!("{}: {error}", path.display()))?;
    }
    for rule in &report.rules {
        print(&format!(
            "{:<14} {:<11} {}{}",
            rule.verdict.name(),
            rule.id,
            rule.title,
            if rule.reason.is_empty() {
                String::new()
            } else {
                format!(": {}", rule.reason)
            }
        ));
    }
    crate::outcome::summary(&report);
    Ok(if !answered {
        3
    } else {
        u8::from(!report.unexpected().is_empty())
    })
}
