//! The subcommands that judge: from arguments to a bench, a run, and a report.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use clap::{Args, ValueEnum};
use conformance::catalogue::Hazard;
use conformance::outcome::{Outputs, eprint, on_interrupt, print, print_rule, rounds, sha256};
use conformance::report::{Report, RuleReport, SCHEMA, Subject};
use conformance::verdict::Verdict;

use crate::autopilot::{self, survey};
use crate::bench::peer::station_heartbeat;
use crate::bench::trial::Probe;
use crate::bench::{Bench, Net, Peer, Port};
use crate::catalogue::{Catalogue, Role};
use crate::runner::{Options, Run};
use crate::wire::Key;
use crate::{router, station};

/// What every judging subcommand takes.
#[derive(Clone, Debug, Args)]
pub(super) struct Common {
    /// Signing key that the subject has: a file of 64 hexadecimal digits, or of 32 bytes
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
    /// Judge only the rules of signing (SIGN, KEY)
    #[arg(long)]
    signed_only: bool,
    /// Judge just this rule (repeatable)
    #[arg(long, value_name = "ID")]
    rule: Vec<String>,
    /// A broken "should" is a fail
    #[arg(long)]
    strict: bool,
    /// Do not repeat a rule that fails
    #[arg(long)]
    no_repeat: bool,
    #[command(flatten)]
    outputs: Outputs,
    /// Files of the subject (logs, recordings) in which neither the key nor signed frames may be found (repeatable)
    #[arg(long, value_name = "FILE")]
    logs: Vec<PathBuf>,
    /// File with the pass phrase from which the subject made its key
    #[arg(long, value_name = "FILE")]
    phrase_file: Option<PathBuf>,
    /// Send a SYSTEM_TIME that is ten years off (SIGN-011). Never to a subject that may set a clock that matters: PX4 in SITL, run as
    /// root, sets that of the whole computer. Nothing else releases it
    #[arg(long)]
    system_time: bool,
    /// Multiply all times of the suite by this
    #[arg(long, value_name = "F", default_value_t = 1.0)]
    factor: f64,
    /// Name and version of the subject, for the report
    #[arg(long, value_name = "TEXT")]
    name: Option<String>,
    /// Print only the summary
    #[arg(long, short)]
    quiet: bool,
}

/// Arguments of `mavlink-check autopilot`.
#[derive(Clone, Debug, Args)]
pub(super) struct AutopilotArguments {
    /// Link to the autopilot: udpin:HOST:PORT waits for it, udpout:HOST:PORT sends to it
    link: String,
    /// A second link of the same autopilot, for what must not pass from one to the other
    #[arg(long, value_name = "LINK")]
    second: Option<String>,
    /// System id of the autopilot; the first that is received where it is left out
    #[arg(long, value_name = "ID")]
    system: Option<u8>,
    /// System and component id that the suite's station has
    #[arg(long, value_name = "SYSTEM/COMPONENT", default_value = "245/190", value_parser = identity)]
    identity: (u8, u8),
    /// State that the vehicle is simulated: releases the hazards ground, flight and destructive, but not setup-signing
    #[arg(long)]
    simulated: bool,
    /// Hazards to release, and "setup-signing"
    #[arg(long, value_delimiter = ',', value_name = "HAZARD")]
    allow: Vec<Allow>,
    /// Command that restarts the autopilot
    #[arg(long, value_name = "COMMAND")]
    restart: Option<String>,
    /// Parameter (a float) that may be changed, and is restored
    #[arg(long, value_name = "NAME")]
    parameter: Option<String>,
    /// Show what would be judged with which hazard, and send nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    common: Common,
}

/// Arguments of `mavlink-check station`.
#[derive(Clone, Debug, Args)]
pub(super) struct StationArguments {
    /// Link to the ground station: udpout:HOST:PORT sends to it as PX4 does, udpin:HOST:PORT waits for it
    #[arg(long, value_name = "LINK")]
    listen: String,
    /// Command that starts the ground station, or makes it do something; ended after the run
    #[arg(long, value_name = "COMMAND")]
    command: Option<String>,
    /// How long the suite plays the vehicle, in seconds
    #[arg(long, value_name = "S", default_value_t = 40.0)]
    time: f64,
    /// System id of the vehicle that is played
    #[arg(long, value_name = "ID", default_value_t = 1)]
    system: u8,
    #[command(flatten)]
    common: Common,
}

/// Arguments of `mavlink-check router`.
#[derive(Clone, Debug, Args)]
pub(super) struct RouterArguments {
    /// End at which the suite plays a vehicle
    #[arg(long, value_name = "LINK")]
    vehicle: String,
    /// End at which the suite plays a ground station
    #[arg(long, value_name = "LINK")]
    station: String,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Allow {
    Ground,
    Flight,
    Destructive,
    SetupSigning,
}

fn identity(text: &str) -> Result<(u8, u8), String> {
    text.split_once('/')
        .and_then(|(system, component)| Some((system.parse().ok()?, component.parse().ok()?)))
        .filter(|(system, _)| *system > 0)
        .ok_or_else(|| "expected SYSTEM/COMPONENT, each 1 to 255, such as 245/190".into())
}

/// A key file: 64 hexadecimal digits, 32 bytes, or PX4's own 40 bytes, of which the first 32 are the key.
fn read_key(path: &Path) -> Result<Key, String> {
    let bytes =
        std::fs::read(path).map_err(|error| format!("key file {}: {error}", path.display()))?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim();
    if text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        let mut key = [0; 32];
        for (byte, digits) in key.iter_mut().zip(text.as_bytes().chunks(2)) {
            *byte = u8::from_str_radix(&String::from_utf8_lossy(digits), 16).unwrap_or_default();
        }
        return Ok(Key(key));
    }
    match bytes.first_chunk::<32>() {
        Some(key) if matches!(bytes.len(), 32 | 40) => Ok(Key(*key)),
        _ => Err(format!(
            "key file {}: {} bytes; expected 64 hexadecimal digits, 32 bytes, or PX4's 40",
            path.display(),
            bytes.len()
        )),
    }
}

impl Common {
    fn key(&self) -> Result<Option<Key>, String> {
        self.key_file.as_deref().map(read_key).transpose()
    }

    fn options(&self, catalogue: &Catalogue) -> Result<Options, String> {
        let rules = catalogue.ids(&self.rule, "mavlink-check")?;
        if !(0.1..=100.0).contains(&self.factor) {
            return Err(format!("--factor {}: expected 0.1 to 100", self.factor));
        }
        Ok(Options {
            rules,
            signed_only: self.signed_only,
            strict: self.strict,
            repeat: !self.no_repeat,
        })
    }

    fn phrase(&self) -> Result<Option<String>, String> {
        let read = |path: &PathBuf| {
            std::fs::read_to_string(path)
                .map_err(|error| format!("pass phrase file {}: {error}", path.display()))
        };
        Ok(self
            .phrase_file
            .as_ref()
            .map(read)
            .transpose()?
            .map(|text| text.trim_end_matches(['\r', '\n']).to_owned()))
    }

    fn bench(&self, net: &Arc<Net>, port: Port) -> Result<Bench, String> {
        Ok(Bench {
            net: net.clone(),
            port: Arc::new(port),
            second: None,
            subject: (0, 0),
            autopilot: 0,
            probe: Probe::Timesync,
            identity: (245, 190),
            factor: self.factor,
            hazards: BTreeSet::from([Hazard::None]),
            setup_signing: false,
            system_time: self.system_time,
            restart: None,
            logs: self.logs.clone(),
            phrase: self.phrase()?,
            parameter: None,
            paused: Arc::default(),
        })
    }

    fn show(&self) -> impl FnMut(&RuleReport) + use<> {
        let quiet = self.quiet;
        move |rule| {
            if !quiet {
                print_rule(rule, 10);
            }
        }
    }

    /// Writes and prints; the exit status.
    fn conclude(
        &self,
        catalogue: &Catalogue,
        bench: &Bench,
        subject: Subject,
        remarks: Vec<String>,
        rules: Vec<RuleReport>,
    ) -> Result<u8, String> {
        let expected = self.outputs.read_expected()?;
        let mut subject = subject;
        if let Some(name) = &self.name {
            subject.name.clone_from(name);
        }
        let duration = bench.net.now();
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let mut report = Report {
            schema: SCHEMA.into(),
            suite: "MAVLink conformance".into(),
            program: format!("mavlink-check {}", env!("CARGO_PKG_VERSION")),
            catalogue: catalogue.catalogue.clone(),
            subject,
            started: now.saturating_sub(duration).as_secs(),
            duration_s: duration.as_secs_f64(),
            strict: self.strict,
            profile: format!("{:?}", std::env::args().skip(1).collect::<Vec<_>>()),
            hashes: BTreeMap::from([(
                "catalogue".to_owned(),
                sha256(Catalogue::text().as_bytes()),
            )]),
            remarks,
            rules,
            ..Report::default()
        };
        if bench.net.interrupted() {
            report.remarks.push("interrupted by the operator".into());
        }
        let (dropped, skipped) = {
            let recording = bench.net.recording();
            (recording.dropped, recording.skipped)
        };
        if dropped > 0 {
            report.remarks.push(format!(
                "{dropped} datagrams found no room in the recording"
            ));
        }
        if skipped > 0 {
            report.remarks.push(format!(
                "{skipped} bytes of the subject were part of no frame"
            ));
        }
        let datagrams = std::mem::take(&mut bench.net.recording().datagrams);
        self.outputs.finish(report, expected, &datagrams)
    }
}

/// Printed first, so that whoever waits for output knows that the run has begun.
fn begun() {
    eprint(
        "judging, for some minutes: each rule is printed when it ends, unless --quiet; Ctrl-C ends the run",
    );
}

fn watch(net: &Arc<Net>) {
    let net = net.clone();
    on_interrupt(move || {
        net.interrupt();
        eprint("interrupted: restoring what was changed; a second signal ends at once");
    });
}

fn nothing_judged(
    common: &Common,
    catalogue: &Catalogue,
    role: Role,
    options: &Options,
    reason: &str,
) -> Vec<RuleReport> {
    let mut show = common.show();
    let rules: Vec<RuleReport> = catalogue
        .rule
        .iter()
        .filter(|rule| rule.subjects.contains(&role) && options.wants(rule))
        .map(|rule| RuleReport {
            verdict: Verdict::Inconclusive,
            reason: reason.to_owned(),
            ..rule.report()
        })
        .collect();
    if let Some(first) = rules.first() {
        show(first);
    }
    rules
}

/// The bench of an autopilot.
fn autopilot_bench(arguments: &AutopilotArguments) -> Result<(Bench, Peer), String> {
    let net = Net::new(arguments.common.key()?);
    let mut bench = arguments
        .common
        .bench(&net, Port::open(&net, &arguments.link)?)?;
    bench.second = arguments
        .second
        .as_ref()
        .map(|link| Port::open(&net, link).map(Arc::new))
        .transpose()?;
    bench.identity = arguments.identity;
    bench.restart.clone_from(&arguments.restart);
    bench.parameter.clone_from(&arguments.parameter);
    bench.setup_signing = arguments.allow.contains(&Allow::SetupSigning);
    if arguments.simulated {
        bench
            .hazards
            .extend([Hazard::Ground, Hazard::Flight, Hazard::Destructive]);
    }
    bench
        .hazards
        .extend(arguments.allow.iter().filter_map(|allow| match allow {
            Allow::Ground => Some(Hazard::Ground),
            Allow::Flight => Some(Hazard::Flight),
            Allow::Destructive => Some(Hazard::Destructive),
            Allow::SetupSigning => None,
        }));
    let peer = Peer::new(&net, &bench.port, arguments.identity, 0);
    Ok((bench, peer))
}

fn play_autopilot(
    arguments: &AutopilotArguments,
    catalogue: &Catalogue,
    options: &Options,
    quiet: bool,
) -> Result<(Bench, Subject, Vec<String>, Vec<RuleReport>), String> {
    let (mut bench, peer) = autopilot_bench(arguments)?;
    watch(&bench.net);
    if !quiet {
        begun();
    }
    let mut subject = Subject {
        role: "autopilot".into(),
        name: "not found".into(),
        address: arguments.link.clone(),
        ..Subject::default()
    };
    let remarks = match survey::survey(&mut bench, &peer, arguments.system) {
        Ok(remarks) => remarks,
        Err(reason) => {
            let rules = nothing_judged(
                &arguments.common,
                catalogue,
                Role::Autopilot,
                options,
                &reason,
            );
            return Ok((bench, subject, vec![reason], rules));
        }
    };
    (subject.name, subject.version) = survey::describe(&bench);
    subject.vehicles = vec![format!(
        "system {}, component {}",
        bench.subject.0, bench.subject.1
    )];
    let ended = peer.heartbeats(station_heartbeat(), bench.paused.clone());
    let other = bench.second.as_ref().map(|second| peer.on(second));
    // The second link has to know the suite's station too. It is another component there, so that its timestamps are
    // a stream of their own.
    let ended_there = other.map(|other| {
        other
            .with_component(other.component.wrapping_add(1).max(1))
            .heartbeats(station_heartbeat(), bench.paused.clone())
    });
    let scenes = autopilot::scenes();
    let mut show = arguments.common.show();
    let mut silent = |_: &RuleReport| {};
    let rules = Run {
        role: Role::Autopilot,
        bench: &bench,
        catalogue,
        options,
        show: if quiet { &mut silent } else { &mut show },
    }
    .rules(&peer, &scenes);
    ended.store(true, std::sync::atomic::Ordering::SeqCst);
    if let Some(ended) = ended_there {
        ended.store(true, std::sync::atomic::Ordering::SeqCst);
    }
    Ok((bench, subject, remarks, rules))
}

/// `mavlink-check autopilot`.
pub(super) fn autopilot(arguments: &AutopilotArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let options = arguments.common.options(&catalogue)?;
    if arguments.dry_run {
        let (bench, _) = autopilot_bench(arguments)?;
        for rule in catalogue
            .rule
            .iter()
            .filter(|rule| rule.subjects.contains(&Role::Autopilot) && options.wants(rule))
        {
            let released = rule.hazard == Hazard::None || bench.hazards.contains(&rule.hazard);
            print(&format!(
                "{:<10} hazard {:<11} {} {}",
                rule.id,
                rule.hazard.to_string(),
                if released { "runs   " } else { "skipped" },
                rule.observable
            ));
        }
        return Ok(0);
    }
    let (bench, subject, remarks, rules) = play_autopilot(arguments, &catalogue, &options, false)?;
    arguments
        .common
        .conclude(&catalogue, &bench, subject, remarks, rules)
}

/// `mavlink-check repeat`.
pub(super) fn repeat(rule: &str, times: u32, arguments: &AutopilotArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let mut arguments = arguments.clone();
    arguments.common.rule = vec![rule.to_owned()];
    let mut options = arguments.common.options(&catalogue)?;
    options.repeat = false;
    rounds(rule, times, || {
        let (bench, _, _, mut rules) = play_autopilot(&arguments, &catalogue, &options, true)?;
        let net = bench.net.clone();
        drop(bench);
        // The port is free once its receiving thread has ended.
        net.pause(std::time::Duration::from_millis(120));
        let found = (!rules.is_empty()).then(|| rules.remove(0));
        Ok((found, net.interrupted()))
    })
}

/// `mavlink-check station`.
pub(super) fn station(arguments: &StationArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let options = arguments.common.options(&catalogue)?;
    let net = Net::new(arguments.common.key()?);
    let bench = arguments
        .common
        .bench(&net, Port::open(&net, &arguments.listen)?)?;
    watch(&net);
    begun();
    let played = station::play(
        &bench,
        arguments.system,
        arguments.command.as_deref(),
        arguments.time,
    )?;
    let mut show = arguments.common.show();
    let rules = station::judge(&bench, &catalogue, &options, &played, &mut show);
    let subject = Subject {
        role: "station".into(),
        name: "ground station".into(),
        address: arguments.listen.clone(),
        ..Subject::default()
    };
    arguments
        .common
        .conclude(&catalogue, &bench, subject, played.remarks, rules)
}

/// `mavlink-check router`.
pub(super) fn router(arguments: &RouterArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let options = arguments.common.options(&catalogue)?;
    let net = Net::new(arguments.common.key()?);
    let mut bench = arguments
        .common
        .bench(&net, Port::open(&net, &arguments.vehicle)?)?;
    bench.second = Some(Arc::new(Port::open(&net, &arguments.station)?));
    watch(&net);
    begun();
    let subject = Subject {
        role: "router".into(),
        name: "router".into(),
        address: format!("{}, {}", arguments.vehicle, arguments.station),
        ..Subject::default()
    };
    let peer = Peer::new(&net, &bench.port, (1, 1), 0);
    let mut show = arguments.common.show();
    let (remarks, rules) = match router::begin(&bench) {
        Err(reason) => (
            vec![reason.clone()],
            nothing_judged(
                &arguments.common,
                &catalogue,
                Role::Router,
                &options,
                &reason,
            ),
        ),
        Ok(()) => {
            let scenes: Vec<_> = router::SCENES.iter().collect();
            let mut run = Run {
                role: Role::Router,
                bench: &bench,
                catalogue: &catalogue,
                options: &options,
                show: &mut show,
            };
            (Vec::new(), run.rules(&peer, &scenes))
        }
    };
    arguments
        .common
        .conclude(&catalogue, &bench, subject, remarks, rules)
}
