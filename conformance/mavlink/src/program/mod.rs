//! The program `mavlink-check`: its command line.

mod judge;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};
use conformance::outcome::print;
use serde_json::json;

use crate::catalogue::{Catalogue, Role};

/// Judge a MAVLink 2 autopilot, ground station or router by the rules of signing, missions, commands and parameters.
#[derive(Debug, Parser)]
#[command(
    name = "mavlink-check",
    version,
    after_help = "Exit status: 0 as expected, 1 unexpected fail, 2 usage, 3 nothing could be judged.\n\nExample: mavlink-check autopilot udpin:127.0.0.1:14550 --key-file uav1.key --simulated --out report"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Judge an autopilot: play a ground station to it
    Autopilot(judge::AutopilotArguments),
    /// Judge a ground station: play an autopilot to it
    Station(judge::StationArguments),
    /// Judge a router: play a vehicle and a ground station at its ends
    Router(judge::RouterArguments),
    /// Play one rule of an autopilot again and again, to see whether its verdict holds
    Repeat {
        /// Rule id, SIGN-003
        #[arg(id = "repeated", value_name = "RULE")]
        rule: String,
        /// How many times
        #[arg(long, default_value_t = 20)]
        times: u32,
        #[command(flatten)]
        arguments: judge::AutopilotArguments,
    },
    /// List the rules of the catalogue
    List {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Show everything about a rule
    Explain {
        /// Rule id, SIGN-003
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
    conformance::outcome::program("mavlink-check", |cli: Cli| match cli.command {
        Command::Autopilot(arguments) => judge::autopilot(&arguments),
        Command::Station(arguments) => judge::station(&arguments),
        Command::Router(arguments) => judge::router(&arguments),
        Command::Repeat {
            rule,
            times,
            arguments,
        } => judge::repeat(&rule, times, &arguments),
        Command::List { json } => {
            list(json);
            Ok(0)
        }
        Command::Explain { rule } => explain(&rule),
    })
}

fn subjects(roles: &[Role]) -> String {
    roles
        .iter()
        .map(|role| role.name())
        .collect::<Vec<_>>()
        .join("+")
}

fn list(as_json: bool) {
    let catalogue = Catalogue::embedded();
    if as_json {
        let value = json!({ "catalogue": catalogue.catalogue, "rules": catalogue.rule });
        print(&serde_json::to_string_pretty(&value).unwrap_or_default());
        return;
    }
    for rule in &catalogue.rule {
        print(&format!(
            "{:<10} {:<6} {:<17} {:<11} {}",
            rule.id,
            rule.level.name(),
            subjects(&rule.subjects),
            rule.hazard.to_string(),
            rule.title
        ));
    }
}

fn explain(id: &str) -> Result<u8, String> {
    let catalogue = Catalogue::embedded();
    let rule = catalogue.named(id, "mavlink-check")?;
    print(&format!(
        "{} {}\n\n{}\n\nJudges     {}, {}, hazard {}\nNeeds      {}\nObserved   {}\nBreaks     {}\nSource     {}\nPitfall    {}",
        rule.id,
        rule.title,
        rule.rule,
        subjects(&rule.subjects),
        rule.level.name(),
        rule.hazard,
        if rule.needs.is_empty() {
            "nothing but a reachable subject".into()
        } else {
            rule.needs.join(", ")
        },
        rule.observable,
        rule.breaks,
        rule.source,
        rule.pitfall
            .map_or_else(|| "none of the list".into(), |number| number.to_string()),
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
