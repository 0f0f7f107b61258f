//! `dli-check cucs`: judge a CUCS by what it sends to a scripted vehicle, and by what its operator sees.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;

use super::output::profile;
use crate::bench::net::Net;
use crate::catalogue::Catalogue;
use crate::cucs::{Board, Session, listen_to_terminal, page};
use crate::outcome::{Outputs, eprint, print, sha256, stop_on_interrupt};
use crate::profile::Profile;
use crate::report::{DLI, Report, SCHEMA, Subject, now};
use crate::scripted::{Scenario, VEHICLE};
use crate::wire::dialect::Role;

/// Arguments of `dli-check cucs`.
#[derive(Debug, Args)]
pub(super) struct CucsArguments {
    /// Where the scripted vehicle listens
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:4586")]
    listen: SocketAddr,
    /// What the vehicle does to the CUCS: a built-in scenario, or a file of your own (repeatable; all built-in ones in turn where left out)
    #[arg(long, value_name = "NAME|FILE")]
    scenario: Vec<String>,
    /// Show the operator's cards on a page of this computer, such as 127.0.0.1:8080
    #[arg(long, value_name = "ADDR")]
    page: Option<SocketAddr>,
    /// Name of the operator, recorded with each answer
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
    /// Shell command that plays the CUCS in each scenario from beginning to end: on.start of the profile
    #[arg(long, value_name = "COMMAND")]
    command: Option<String>,
    /// How long a scenario lasts whose CUCS is played by one command, in seconds; it ends earlier with the command
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    time: f64,
    /// Profile (TOML): `[on]` has a command for each step of a session without an operator
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// Edition of the interface: 2.5, 3 or 4
    #[arg(long, value_name = "E")]
    edition: Option<String>,
    /// A broken "should" is a fail
    #[arg(long)]
    strict: bool,
    /// Judge just this rule (repeatable)
    #[arg(long, value_name = "ID")]
    rule: Vec<String>,
    /// Print the cards of the session, and do nothing else
    #[arg(long)]
    cards: bool,
    #[command(flatten)]
    outputs: Outputs,
}

pub(super) fn judge(arguments: &CucsArguments) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let mut profile = profile(arguments.profile.as_deref())?;
    if let Some(command) = &arguments.command {
        profile.on.insert("start".into(), command.clone());
    }
    if let Some(edition) = &arguments.edition {
        profile.subject.edition.clone_from(edition);
        profile.check().map_err(|error| error.to_string())?;
    }
    let scenarios = scenarios(&arguments.scenario)?;
    check_commands(&profile, &scenarios)?;
    if arguments.cards {
        cards(&scenarios);
        return Ok(0);
    }
    let expected = arguments.outputs.read_expected()?;
    let net = Net::new(&profile.subject.edition, Role::Vehicle);
    stop_on_interrupt(&net);
    let started = now();
    let mut session = Session {
        net: net.clone(),
        listen: arguments.listen,
        profile: &profile,
        catalogue: &catalogue,
        board: board(arguments, &profile)?,
        strict: arguments.strict,
        only: catalogue.ids(&arguments.rule, "dli-check")?,
        time: Duration::from_secs_f64(arguments.time),
        rules: BTreeMap::new(),
        remarks: Vec::new(),
    };
    eprint(&format!(
        "the vehicle {VEHICLE} listens on {}: {} scenarios",
        arguments.listen,
        scenarios.len()
    ));
    session.play(&scenarios)?;
    let answered = session.answered();
    if !answered {
        session
            .remarks
            .push(format!("nothing came to {}", session.listen));
    }
    let order = |id: &str| catalogue.rule.iter().position(|rule| rule.id == id);
    for missing in net.take_missing() {
        session.remarks.push(format!(
            "not sent, since Edition {} has nothing for it: {missing}",
            profile.subject.edition
        ));
    }
    let mut rules: Vec<_> = session.rules.into_values().collect();
    rules.sort_by_key(|rule| order(&rule.id));
    let text = profile.to_toml();
    let report = Report {
        schema: SCHEMA.into(),
        suite: DLI.into(),
        program: format!("dli-check {}", env!("CARGO_PKG_VERSION")),
        catalogue: catalogue.catalogue.clone(),
        subject: Subject {
            role: "cucs".into(),
            name: profile.subject.name.clone(),
            version: profile.subject.version.clone(),
            address: session.listen.to_string(),
            edition: profile.subject.edition.clone(),
            ..Subject::default()
        },
        started,
        duration_s: net.now().as_secs_f64(),
        strict: arguments.strict,
        hashes: BTreeMap::from([
            ("profile".to_owned(), sha256(text.as_bytes())),
            ("catalogue".to_owned(), sha256(Catalogue::text().as_bytes())),
        ]),
        profile: text,
        remarks: session.remarks,
        counts: BTreeMap::new(),
        expected: Vec::new(),
        rules,
    };
    for rule in &report.rules {
        let reason = if rule.reason.is_empty() { "" } else { ": " };
        print(&format!(
            "{:<14} {:<11} {}{reason}{}",
            rule.verdict.name(),
            rule.id,
            rule.title,
            rule.reason
        ));
    }
    let datagrams = std::mem::take(&mut net.recording().datagrams);
    let status = arguments.outputs.finish(report, expected, &datagrams)?;
    Ok(if answered { status } else { 3 })
}

fn scenarios(names: &[String]) -> Result<Vec<Scenario>, String> {
    let all: Vec<String> = match names {
        [] => Scenario::names().map(str::to_owned).collect(),
        chosen => chosen.to_vec(),
    };
    all.iter()
        .map(|name| Scenario::named(name).map_err(|error| error.to_string()))
        .collect()
}

/// Refuses a command for a step that no scenario has: it would never run, and nobody would notice.
fn check_commands(profile: &Profile, scenarios: &[Scenario]) -> Result<(), String> {
    let mut known: Vec<String> = scenarios
        .iter()
        .flat_map(|scenario| scenario.step.iter().map(|step| step.id.clone()))
        .chain(
            Scenario::names()
                .filter_map(|name| Scenario::named(name).ok())
                .flat_map(|scenario| scenario.step.into_iter().map(|step| step.id)),
        )
        .chain(["start".to_owned()])
        .collect();
    known.sort();
    known.dedup();
    match profile.on.keys().find(|id| !known.contains(id)) {
        None => Ok(()),
        Some(unknown) => Err(format!(
            "profile: on.{unknown} is a command for a step that no scenario has; expected one of {}",
            known.join(", ")
        )),
    }
}

/// Where the cards are shown: always where no command acts, otherwise where an operator is named.
fn board(arguments: &CucsArguments, profile: &Profile) -> Result<Option<Arc<Board>>, String> {
    let headless = !profile.on.is_empty();
    if headless && arguments.operator.is_none() && arguments.page.is_none() {
        return Ok(None);
    }
    let board = Arc::new(Board::new(
        arguments.operator.as_deref().unwrap_or("the operator"),
    ));
    if let Some(address) = arguments.page {
        let here = page::serve(address, &board)?;
        eprint(&format!("cards: http://{here}/"));
    }
    listen_to_terminal(&board);
    Ok(Some(board))
}

fn cards(scenarios: &[Scenario]) {
    let steps = scenarios
        .iter()
        .flat_map(|scenario| scenario.step.iter().map(move |step| (scenario, step)));
    for (number, (scenario, step)) in steps.enumerate() {
        let rules = if step.rules.is_empty() {
            String::new()
        } else {
            format!(" [{}]", step.rules.join(", "))
        };
        print(&format!(
            "{:>2}. {} (on.{}, scenario {}){rules}",
            number + 1,
            step.card,
            step.id,
            scenario.name
        ));
        if let Some(question) = &step.question {
            print(&format!(
                "    {question}  yes / no      name, time: ____________________"
            ));
        }
    }
}
