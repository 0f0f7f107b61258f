//! `vsm audit`: verifies the audit logs of a store, and prints them; also while the bridge runs.

use std::path::Path;

use anyhow::{Context as _, anyhow};
use clap::{Subcommand, ValueEnum};
use serde_json::{Map, Value};
use stanag_msgs::Id;

use super::config_arg::ConfigArg;
use super::process::{Failure, bad, failed, load_stored, print, report_line};
use crate::config::Stored;
use crate::session::{AuditKind, examine_audit, read_log};
use crate::shell::disk::ReadOnlyDisk;

#[derive(Debug, Subcommand)]
pub(crate) enum Action {
    /// Verify the audit logs: report what was changed, cut off, deleted or replaced; exit status 1 where anything was
    Verify {
        #[command(flatten)]
        config: ConfigArg,
        /// Expect a line with these 64 digits, reported by an earlier verification; faults recorded before it are known
        #[arg(long, value_name = "DIGITS", value_parser = digits)]
        head: Vec<String>,
    },
    /// Print the audit logs, the oldest line first
    Export {
        #[command(flatten)]
        config: ConfigArg,
        /// Print the logs of this vehicle only, such as 1b:00:01:01
        #[arg(long, value_name = "ID")]
        vehicle: Option<Id>,
        /// Print in this form
        #[arg(long, value_enum, default_value_t = Format::Json)]
        format: Format,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// One JSON object a line
    Json,
    /// A table with a row of names
    Csv,
}

pub(crate) fn run(action: Action) -> Result<(), Failure> {
    match action {
        Action::Verify { config, head } => verify(config.path(), &head),
        Action::Export {
            config,
            vehicle,
            format,
        } => export(config.path(), vehicle, format),
    }
}

fn verify(path: &Path, heads: &[String]) -> Result<(), Failure> {
    let stored = load_stored(path)?;
    let disk = open(&stored)?;
    let (mut text, mut faults) = (String::new(), 0);
    let mut absent: Vec<&String> = heads.iter().collect();
    for vehicle in &stored.vehicles {
        let logs = examine_audit(vehicle.id, heads, &disk).map_err(failed)?;
        for log in logs {
            let name = log.kind.name();
            let present = |head: &String| log.present.iter().find(|(digits, _)| digits == head);
            absent.retain(|head| present(head).is_none());
            // A person who has kept the digits of a line knows what was reported before it.
            let known = heads.iter().filter_map(present).map(|(_, line)| *line);
            let known = known.max().unwrap_or(0);
            text += &match (log.chain.lines(), log.findings.len()) {
                (0, 0) => format!("vehicle {} {name}: no line\n", vehicle.id),
                (lines, 0) => format!(
                    "vehicle {} {name}: intact, {lines} lines, {}, head {}\n",
                    vehicle.id,
                    match log.chain.keyed() {
                        Some(id) => format!("key {id}"),
                        None => "without a key".to_owned(),
                    },
                    log.chain.digits()
                ),
                (lines, count) => {
                    format!(
                        "vehicle {} {name}: {lines} lines, faults: {count}\n",
                        vehicle.id
                    )
                }
            };
            for finding in &log.findings {
                faults += 1;
                text += &format!("  {finding}\n");
            }
            for (line, report) in &log.reported {
                faults += usize::from(*line > known);
                text += &format!("  line {line}: {report}\n");
            }
        }
    }
    for head in absent {
        faults += 1;
        text += &format!("no log has the line {head}: it is an older copy, or another log\n");
    }
    print(&text)?;
    match faults {
        0 => Ok(()),
        _ => Err(failed(anyhow!(
            "the audit logs are not intact, or lack lines; faults: {faults}"
        ))),
    }
}

fn export(path: &Path, only: Option<Id>, format: Format) -> Result<(), Failure> {
    let stored = load_stored(path)?;
    let vehicles = chosen(&stored, only)?;
    let disk = open(&stored)?;
    if format == Format::Csv {
        print(&(COLUMNS.join(",") + "\n"))?;
    }
    for vehicle in vehicles {
        for kind in AuditKind::ALL {
            for (_, file) in kind.files(vehicle) {
                let (bytes, cut) = read_log(&file, &disk).map_err(failed)?;
                if cut {
                    report_line(&format!(
                        "{file} is longer than a log becomes: only its beginning is printed"
                    ));
                }
                let lines = String::from_utf8_lossy(&bytes);
                let rows = lines.lines().filter_map(|line| row(kind, line));
                let text: String = rows.map(|row| shown(&row, format) + "\n").collect();
                print(&text)?;
            }
        }
    }
    Ok(())
}

/// The vehicles whose logs are meant. No line of a vehicle that there is not would look as if nothing had happened to it.
fn chosen(stored: &Stored, only: Option<Id>) -> Result<Vec<Id>, Failure> {
    let all: Vec<Id> = stored.vehicles.iter().map(|vehicle| vehicle.id).collect();
    match only {
        None => Ok(all),
        Some(one) if all.contains(&one) => Ok(vec![one]),
        Some(other) => {
            let names: Vec<String> = all.iter().map(Id::to_string).collect();
            Err(bad(anyhow!(
                "vehicle {other} is not in the configuration, expected one of its vehicles: {}",
                names.join(", ")
            )))
        }
    }
}

/// A line as an object that also names its log and its digits; none of what a crash has cut off.
fn row(kind: AuditKind, line: &str) -> Option<Map<String, Value>> {
    let (digits, object) = line.split_once(' ')?;
    let Ok(Value::Object(mut row)) = serde_json::from_str(object) else {
        return None;
    };
    row.insert("log".to_owned(), kind.name().into());
    row.insert("digits".to_owned(), digits.into());
    Some(row)
}

fn shown(row: &Map<String, Value>, format: Format) -> String {
    if format == Format::Json {
        return Value::Object(row.clone()).to_string();
    }
    let cells = COLUMNS.iter().map(|name| match row.get(*name) {
        None => String::new(),
        Some(Value::String(text)) => cell(text),
        Some(other) => cell(&other.to_string()),
    });
    cells.collect::<Vec<_>>().join(",")
}

fn cell(text: &str) -> String {
    if text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

fn open(stored: &Stored) -> Result<ReadOnlyDisk, Failure> {
    ReadOnlyDisk::open(&stored.dir)
        .with_context(|| format!("[store] dir {}", stored.dir.display()))
        .map_err(failed)
}

fn digits(text: &str) -> Result<String, String> {
    let hex = |digit: char| digit.is_ascii_digit() || ('a'..='f').contains(&digit);
    if text.len() == 64 && text.chars().all(hex) {
        Ok(text.to_owned())
    } else {
        Err("expected 64 hex digits".to_owned())
    }
}

const COLUMNS: [&str; 18] = [
    "log",
    "line",
    "time_ms",
    "vehicle",
    "what",
    "from",
    "lost",
    "to",
    "gained",
    "why",
    "holders",
    "times_gained",
    "times_lost",
    "not_written",
    "until_ms",
    "after",
    "key",
    "digits",
];
