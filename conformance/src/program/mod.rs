//! The program `dli-check`: its command line.

mod capture;
mod compare;
mod cucs;
mod init;
mod output;
mod vsm;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};
use serde_json::json;

use crate::catalogue::{Catalogue, Subject};
use crate::outcome::print;
use crate::rules;

/// Judge a VSM or CUCS by the interoperability rules of the STANAG 4586 Data Link Interface.
#[derive(Debug, Parser)]
#[command(
    name = "dli-check",
    version,
    after_help = "Exit status: 0 as expected, 1 unexpected fail, 2 bad profile or usage, 3 nothing could be judged, or a fail that the network may have caused."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Judge a VSM: play a CUCS against it
    Vsm(vsm::VsmArguments),
    /// Judge the recorded traffic of a VSM, without sending anything
    Capture(capture::CaptureArguments),
    /// Judge a CUCS: play a vehicle that it connects to
    Cucs(cucs::CucsArguments),
    /// Discover a VSM and write the profile of what it claims
    Init(init::InitArguments),
    /// Play one rule again and again, to see whether its verdict holds
    Repeat {
        /// Rule id, AUTH-002
        #[arg(id = "repeated", value_name = "RULE")]
        rule: String,
        /// How many times
        #[arg(long, default_value_t = 20)]
        times: u32,
        #[command(flatten)]
        arguments: vsm::VsmArguments,
    },
    /// Compare the report.json files of several runs or systems
    Compare(compare::CompareArguments),
    /// Print the JSON Schema of report.json
    Schema,
    /// List the rules of the catalogue
    List {
        /// As JSON
        #[arg(long)]
        json: bool,
        /// Show which rules apply to this edition, and why others do not: 2.5, 3 or 4
        #[arg(long, value_name = "E", value_parser = ["2.5", "3", "4"])]
        edition: Option<String>,
    },
    /// Show everything about a rule
    Explain {
        /// Rule id, AUTH-002
        rule: String,
    },
}

/// The command line, for the tests and generators that list its subcommands.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

/// Runs the program; its exit status.
#[must_use]
pub fn run() -> ExitCode {
    crate::outcome::program("dli-check", |cli: Cli| match cli.command {
        Command::Vsm(arguments) => vsm::judge(&arguments),
        Command::Capture(arguments) => capture::judge(&arguments),
        Command::Cucs(arguments) => cucs::judge(&arguments),
        Command::Init(arguments) => init::write(&arguments),
        Command::Repeat {
            rule,
            times,
            arguments,
        } => vsm::repeat(&rule, times, &arguments),
        Command::Compare(arguments) => compare::compare(&arguments),
        Command::Schema => {
            print(crate::report::JSON_SCHEMA.trim_end());
            Ok(0)
        }
        Command::List { json, edition } => {
            list(json, edition.as_deref());
            Ok(0)
        }
        Command::Explain { rule } => explain(&rule),
    })
}

/// How a rule is judged by this program: by a scene, by traffic, by an operator's word, or not at all.
fn judged_by(id: &str) -> Vec<&'static str> {
    use crate::passive::{cucs_judges, judges_of};
    let scene = rules::scenes().iter().any(|scene| scene.rule == id);
    let traffic = cucs_judges().iter().any(|judge| judge.rule == id)
        || (judges_of("2.5", Subject::Vsm).iter()).any(|applied| applied.judge.rule == id);
    let step = crate::scripted::Scenario::names()
        .filter_map(|name| crate::scripted::Scenario::named(name).ok())
        .any(|scenario| {
            (scenario.step.iter()).any(|step| step.rules.iter().any(|rule| rule == id))
        });
    [("active", scene), ("passive", traffic), ("operator", step)]
        .into_iter()
        .filter(|(_, is)| *is)
        .map(|(name, _)| name)
        .collect()
}

fn list(as_json: bool, edition: Option<&str>) {
    let catalogue = Catalogue::embedded();
    if as_json {
        let rules: Vec<_> = catalogue
            .rule
            .iter()
            .map(|rule| {
                let mut value = serde_json::to_value(rule).unwrap_or_default();
                value["judged"] = json!(judged_by(&rule.id));
                if let Some(edition) = edition {
                    value["not_applicable"] = json!(rules::not_in_edition(rule, edition));
                }
                value
            })
            .collect();
        print(
            &serde_json::to_string_pretty(
                &json!({ "catalogue": catalogue.catalogue, "rules": rules }),
            )
            .unwrap_or_default(),
        );
        return;
    }
    for rule in &catalogue.rule {
        let left_out = edition.and_then(|edition| rules::not_in_edition(rule, edition));
        print(&format!(
            "{:<11} {:<6} {:<5} {:<9} {:<24} {}{}",
            rule.id,
            rule.level.name(),
            format!("{:?}", rule.subject).to_lowercase(),
            rule.profile,
            judged_by(&rule.id).join("+"),
            rule.title,
            left_out.map_or_else(String::new, |reason| format!(": not applicable: {reason}"))
        ));
    }
}

fn explain(id: &str) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let rule = catalogue.named(id, "dli-check")?;
    let judged = judged_by(&rule.id);
    let without = rules::WITHOUT_CODE
        .iter()
        .find(|(without, _)| *without == rule.id);
    let judged = match (judged.is_empty(), without) {
        (false, _) => judged.join(" and "),
        (true, Some((_, reason))) => format!("not judged: {reason}"),
        (true, None) => "not judged yet".into(),
    };
    print(&format!(
        "{} {}\n\n{}\n\nJudges     {:?}, editions {}, {:?}, set {}, hazard {}\nNeeds      {}\nObserved   {}\nBreaks     {}\nSource     {} ({}, confidence {})\nJudged by  {judged}\nDisputed   {}",
        rule.id,
        rule.title,
        rule.rule,
        rule.subject,
        rule.editions.join(", "),
        rule.level,
        rule.profile,
        rule.hazard,
        rule.needs.join(", "),
        rule.observable,
        rule.breaks,
        rule.source,
        rule.basis,
        rule.confidence,
        rule.disputed.as_deref().unwrap_or("no"),
    ));
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }
}
