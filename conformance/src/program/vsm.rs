//! `dli-check vsm`: judge a VSM by playing a CUCS against it.

use std::collections::{BTreeMap, BTreeSet};
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};

use super::output::profile;
use crate::bench::context::Bench;
use crate::catalogue::{Catalogue, Hazard};
use crate::outcome::{Outputs, eprint, print, print_rule, rounds, sha256, stop_on_interrupt};
use crate::profile::Profile;
use crate::report::{DLI, Report, RuleReport, SCHEMA, Subject, now};
use crate::rules;
use crate::runner::{Options, Run};

/// Arguments of `dli-check vsm`.
#[derive(Clone, Debug, Args)]
pub(super) struct VsmArguments {
    /// Where the VSM listens, 192.0.2.7:4586; the profile's where it is left out
    pub(super) address: Option<String>,
    /// Profile of what the VSM claims (TOML), as `dli-check init` writes it
    #[arg(long, value_name = "FILE")]
    pub(super) profile: Option<PathBuf>,
    /// Edition of the interface: 2.5, 3 or 4
    #[arg(long, value_name = "E")]
    pub(super) edition: Option<String>,
    /// A broken "should" is a fail
    #[arg(long)]
    strict: bool,
    /// Judge just this rule (repeatable)
    #[arg(long, value_name = "ID")]
    rule: Vec<String>,
    /// Show what would be sent with which hazard, and send nothing
    #[arg(long)]
    dry_run: bool,
    /// State that the vehicle is simulated: releases the hazards ground, flight and destructive
    #[arg(long)]
    pub(super) simulated: bool,
    /// Judge with a real vehicle of this tail number, as message 3 reports it; needs --allow and a typed confirmation
    #[arg(long, value_name = "TAIL-NUMBER", conflicts_with = "simulated")]
    real_vehicle: Option<String>,
    /// Hazards to release on a real vehicle, and "override"
    #[arg(long, value_delimiter = ',', value_name = "HAZARD")]
    allow: Vec<Allow>,
    /// Multiply all times of the suite by this
    #[arg(long, value_name = "F")]
    factor: Option<f64>,
    /// How much faster than real time the simulated vehicle is
    #[arg(long, value_name = "F")]
    pub(super) speed: Option<f64>,
    /// Do not repeat a rule that fails
    #[arg(long)]
    no_repeat: bool,
    /// Begin no further rule after this many seconds: the others are inconclusive. Otherwise the time is that of the rules
    #[arg(long, value_name = "S")]
    within: Option<u64>,
    /// Print only the summary
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    outputs: Outputs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Allow {
    Ground,
    Flight,
    Override,
}

/// The address and the profile with what the command line adds.
pub(super) fn subject(arguments: &VsmArguments) -> Result<(SocketAddr, Profile), String> {
    let mut profile = profile(arguments.profile.as_deref())?;
    if let Some(edition) = &arguments.edition {
        profile.subject.edition.clone_from(edition);
    }
    if let Some(factor) = arguments.factor {
        profile.timers.insert("factor".into(), factor);
    }
    if let Some(speed) = arguments.speed {
        profile.figures.speed_factor = speed;
    }
    let text = arguments
        .address
        .clone()
        .or(profile.subject.address.clone());
    let text =
        text.ok_or("no address: give it as an argument, or as subject.address in the profile")?;
    profile.subject.address = Some(text.clone());
    profile.check().map_err(|error| error.to_string())?;
    let mut addresses = text
        .to_socket_addrs()
        .map_err(|error| format!("address {text:?}: {error}; expected HOST:PORT"))?;
    let address = addresses
        .next()
        .ok_or_else(|| format!("address {text:?} names no host"))?;
    Ok((address, profile))
}

fn hazards(arguments: &VsmArguments, profile: &Profile) -> BTreeSet<Hazard> {
    if arguments.simulated || profile.simulated() {
        return [
            Hazard::None,
            Hazard::Ground,
            Hazard::Flight,
            Hazard::Destructive,
        ]
        .into();
    }
    let mut released = BTreeSet::from([Hazard::None]);
    if arguments.real_vehicle.is_some() {
        released.extend(arguments.allow.iter().filter_map(|allow| match allow {
            Allow::Ground => Some(Hazard::Ground),
            Allow::Flight => Some(Hazard::Flight),
            Allow::Override => None,
        }));
    }
    released
}

/// Releases a real vehicle: its tail number, as message 3 reports it, is typed once more.
fn confirm(arguments: &VsmArguments, bench: &Arc<Bench>) -> Result<(), String> {
    let Some(tail) = &arguments.real_vehicle else {
        return Ok(());
    };
    let survey = crate::bench::discovery::survey(bench).map_err(|stop| stop.judgement().reason)?;
    let vehicle = survey.vehicle().ok_or("no vehicle was offered")?.id;
    let cucs = survey
        .cucs
        .first()
        .ok_or("the subject offers nothing to the CUCS ids of the profile")?
        .id;
    let station = crate::bench::station::Station::new(bench, cucs, vehicle)
        .map_err(|stop| stop.judgement().reason)?;
    let reported = station
        .query(3)
        .map_err(|stop| stop.judgement().reason)?
        .text("Tail Number")
        .unwrap_or_default();
    if reported != *tail {
        return Err(format!(
            "--real-vehicle is {tail:?}, message 3 reports the tail number {reported:?}: nothing was begun"
        ));
    }
    eprint(&format!(
        "This commands the real vehicle {tail}. Type its tail number to begin:"
    ));
    let mut typed = String::new();
    std::io::stdin()
        .read_line(&mut typed)
        .map_err(|error| error.to_string())?;
    if typed.trim() == tail {
        Ok(())
    } else {
        Err("the tail number was not typed: nothing was begun".into())
    }
}

fn options(
    arguments: &VsmArguments,
    profile: &Profile,
    catalogue: &Catalogue,
) -> Result<Options, String> {
    Ok(Options {
        rules: catalogue.ids(&arguments.rule, "dli-check")?,
        strict: arguments.strict,
        hazards: hazards(arguments, profile),
        overrides: arguments.allow.contains(&Allow::Override),
        repeat: !arguments.no_repeat,
        expected: BTreeSet::new(),
        within: arguments.within.map(std::time::Duration::from_secs),
    })
}

/// Runs and reports; returns the exit status.
pub(super) fn judge(arguments: &VsmArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let (address, profile) = subject(arguments)?;
    let mut options = options(arguments, &profile, &catalogue)?;
    let expected = arguments.outputs.read_expected()?;
    let fails = expected.iter().filter(|entry| entry.verdict.is_fail());
    options.expected = fails.map(|entry| entry.rule.clone()).collect();
    if arguments.dry_run {
        dry_run(&catalogue, &options);
        return Ok(0);
    }
    let bench = Bench::new(&catalogue, profile, address);
    stop_on_interrupt(&bench.net);
    confirm(arguments, &bench)?;
    eprint(&format!(
        "judging the VSM at {address}, all rules in some 10 min: each is printed when it ends, unless --quiet; Ctrl-C ends the run"
    ));
    let report = run(&catalogue, &options, &bench, arguments.quiet);
    let datagrams = std::mem::take(&mut bench.net.recording().datagrams);
    arguments.outputs.finish(report, expected, &datagrams)
}

/// One rule many times.
pub(super) fn repeat(rule: &str, times: u32, arguments: &VsmArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let (address, profile) = subject(arguments)?;
    let mut arguments = arguments.clone();
    arguments.rule = vec![rule.to_owned()];
    let mut options = options(&arguments, &profile, &catalogue)?;
    options.repeat = false;
    rounds(rule, times, || {
        let bench = Bench::new(&catalogue, profile.clone(), address);
        stop_on_interrupt(&bench.net);
        let mut report = run(&catalogue, &options, &bench, true);
        let found = (!report.rules.is_empty()).then(|| report.rules.remove(0));
        Ok((found, bench.net.interrupted()))
    })
}

fn dry_run(catalogue: &Catalogue, options: &Options) {
    for scene in rules::scenes() {
        let Some(rule) = catalogue.find(scene.rule) else {
            continue;
        };
        if !options.rules.is_empty() && !options.rules.contains(&rule.id) {
            continue;
        }
        let released = options.hazards.contains(&rule.hazard);
        print(&format!(
            "{:<11} hazard {:<11} {} sends {:?}: {}",
            rule.id,
            rule.hazard.to_string(),
            if released { "runs   " } else { "skipped" },
            rule.messages,
            rule.observable
        ));
    }
}

fn run(catalogue: &Catalogue, options: &Options, bench: &Arc<Bench>, quiet: bool) -> Report {
    let started = now();
    let mut show = |rule: &RuleReport| {
        if !quiet {
            print_rule(rule, 11);
        }
    };
    let mut run = Run {
        bench: bench.clone(),
        catalogue,
        options,
        show: &mut show,
        remarks: Vec::new(),
        cast: std::collections::BTreeSet::new(),
    };
    let rules = run.rules();
    let remarks = run.remarks;
    let survey = bench.survey.get();
    let profile = &bench.profile;
    let text = profile.to_toml();
    let mut report = Report {
        schema: SCHEMA.into(),
        suite: DLI.into(),
        program: format!("dli-check {}", env!("CARGO_PKG_VERSION")),
        catalogue: catalogue.catalogue.clone(),
        subject: Subject {
            role: "vsm".into(),
            name: profile.subject.name.clone(),
            version: profile.subject.version.clone(),
            address: bench.address.to_string(),
            edition: profile.subject.edition.clone(),
            vehicles: survey
                .map(|survey| {
                    survey
                        .vehicles
                        .iter()
                        .map(|vehicle| vehicle.id.to_string())
                        .collect()
                })
                .unwrap_or_default(),
            cucs: survey
                .map(|survey| {
                    survey
                        .cucs
                        .iter()
                        .map(|cucs| format!("{} (LOI 0x{:02x})", cucs.id, cucs.authorised))
                        .collect()
                })
                .unwrap_or_default(),
        },
        started,
        duration_s: bench.net.now().as_secs_f64(),
        strict: options.strict,
        hashes: BTreeMap::from([
            ("profile".to_owned(), sha256(text.as_bytes())),
            ("catalogue".to_owned(), sha256(Catalogue::text().as_bytes())),
        ]),
        profile: text,
        remarks,
        counts: BTreeMap::new(),
        expected: Vec::new(),
        rules,
    };
    if bench.net.interrupted() {
        report.remarks.push("interrupted by the operator".into());
    }
    report.count();
    report
}
