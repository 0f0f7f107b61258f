//! The command line of `vsm`. Exit status: 0 done, 1 failed, 2 bad arguments or configuration, 3 zeroized: what it would
//! have served is erased.

mod access;
mod airside;
mod audit;
mod check_config;
mod check_vehicle;
mod config_arg;
#[cfg(feature = "demo")]
mod demo;
mod dli_lines;
mod doctor;
mod files;
#[cfg(feature = "etcd")]
mod fleet;
mod guard;
mod init;
mod key;
#[cfg(feature = "klv")]
mod klv;
mod pair;
mod process;
mod reload;
mod replay;
mod run;
mod status;
mod status_vehicles;
mod zeroize;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};
use mavlink_link::store::remedy;

use self::config_arg::ConfigArg;
use self::process::{Failure, LogFormat, announce};
use crate::session::VehiclePattern;
use crate::shell::key_file;

/// A bridge from STANAG 4586 (AEP-84) to PX4 over signed MAVLink 2.
#[derive(Debug, Parser)]
#[command(name = "vsm", version, arg_required_else_help = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[cfg(feature = "demo")]
    Demo(demo::Arguments),
    /// Write a configuration and its signing key: ask for what the options leave out
    Init(init::Init),
    /// Run the bridge for the vehicles of a configuration, until SIGTERM or SIGINT
    Run {
        #[command(flatten)]
        config: ConfigArg,
        /// Write the log as text or as JSON, one object a line; RUST_LOG chooses how much of it
        #[arg(long, value_name = "FORMAT", default_value = "text")]
        log: LogFormat,
    },
    /// Run the agent beside PX4, until SIGTERM or SIGINT: a verifying relay that gives PX4 its keys
    Airside(airside::Arguments),
    /// Check a configuration: report the first error, or what each value means
    CheckConfig {
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Report which of PX4's own settings weaken the link: read over the running bridge, or over the link itself
    CheckVehicle {
        #[command(flatten)]
        config: ConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Wait at most this long for a vehicle's answers, s
        #[arg(long, default_value_t = 30)]
        wait_s: u64,
    },
    /// Show the state of a running bridge; of twelve vehicles and more a line each, and how many are in which state
    Status {
        #[command(flatten)]
        config: ConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Show the vehicles of which this is a part of the id or tail number, such as 01:2a, or with * for any text the whole, such as 'UAV-1*'
        #[arg(long, value_name = "PATTERN")]
        vehicle: Option<VehiclePattern>,
    },
    /// Find out what does not work: one line of cause and cure each, of the running bridge, else of this computer
    Doctor {
        #[command(flatten)]
        config: ConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// List, read, write and remove files of a vehicle, over the link that the running bridge holds
    Files(files::Files),
    #[cfg(feature = "etcd")]
    Fleet(fleet::Arguments),
    /// Send a vehicle's state as video metadata (MISB ST 0601 KLV), alone or in an MPEG transport stream with a video
    #[cfg(feature = "klv")]
    Klv(klv::Klv),
    Replay(replay::Arguments),
    /// Reload the configuration of a running bridge, and show which changes it applies
    Reload {
        #[command(flatten)]
        config: ConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Write a new random signing key (32 bytes in hex, mode 0600) to a file that must not exist
    Keygen {
        /// The key file to write
        file: PathBuf,
    },
    /// Provision, rotate, revoke and list signing keys
    Key {
        #[command(subcommand)]
        action: key::Action,
    },
    /// Authenticate a CUCS to its VSM: run the guard beside it, make and replace its keys
    Guard {
        #[command(subcommand)]
        action: guard::Action,
    },
    /// Write, sign and print the access list: what each CUCS may do with each vehicle
    Access {
        #[command(subcommand)]
        action: access::Action,
    },
    /// Verify and print the audit logs of who controlled which vehicle
    Audit {
        #[command(subcommand)]
        action: audit::Action,
    },
    /// Erase keys, identities, plans, recordings and logs of a bridge, or of an agent (with its airside.toml): for good
    Zeroize(zeroize::Arguments),
    /// Pair this VSM with a vehicle's air-side agent by a code
    Pair(pair::Pair),
    /// Decode DLI datagrams from standard input, one a line in hex, to one line of JSON for each message
    Decode {
        /// Keep integers as on the wire, without range checks
        #[arg(long)]
        raw: bool,
    },
    /// Encode messages from standard input, one a line of JSON, to one datagram in hex each
    Encode {
        /// Keep integers as on the wire, without range checks
        #[arg(long)]
        raw: bool,
    },
}

impl Command {
    /// Whether keys come into this process's memory.
    fn reads_keys(&self) -> bool {
        #[cfg(feature = "klv")]
        if matches!(self, Command::Klv(_)) {
            return false;
        }
        !matches!(
            self,
            Command::Status { .. }
                | Command::Files(_)
                | Command::Replay(_)
                | Command::Reload { .. }
                | Command::Decode { .. }
                | Command::Encode { .. }
        )
    }
}

/// The command line, for completions and the manual page.
#[must_use]
pub fn command() -> clap::Command {
    Arguments::command()
}

/// The program: reads the command line, runs the subcommand, and returns the exit status.
#[must_use]
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // Before any key is read, so that a later crash leaves no key in a core file.
    if arguments.command.reads_keys() {
        key_file::no_core_files();
    }
    process::end_on_panic();
    let done = match arguments.command {
        #[cfg(feature = "demo")]
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Init(arguments) => init::run(&arguments),
        Command::Run { config, log } => run::run(config.path(), log),
        Command::Airside(arguments) => airside::run(arguments),
        Command::CheckConfig { config } => check_config::check(config.path()),
        Command::CheckVehicle {
            config,
            json,
            wait_s,
        } => check_vehicle::run(config.path(), json, wait_s),
        Command::Status {
            config,
            json,
            vehicle,
        } => status::show(config.path(), json, vehicle.as_ref()),
        Command::Files(arguments) => files::run(&arguments),
        #[cfg(feature = "etcd")]
        Command::Fleet(arguments) => fleet::run(&arguments),
        #[cfg(feature = "klv")]
        Command::Klv(arguments) => klv::run(arguments),
        Command::Doctor { config, json } => doctor::run(config.path(), json),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Reload { config, json } => reload::reload(config.path(), json),
        Command::Keygen { file } => key::generate(&file),
        Command::Key { action } => key::run(action),
        Command::Guard { action } => guard::run(action),
        Command::Access { action } => access::run(action),
        Command::Audit { action } => audit::run(action),
        Command::Zeroize(arguments) => zeroize::run(&arguments),
        Command::Pair(arguments) => pair::run(arguments),
        Command::Decode { raw } => dli_lines::decode(raw),
        Command::Encode { raw } => dli_lines::encode(raw),
    };
    let (status, error) = match done {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Failed(error)) => (1, error),
        Err(Failure::Bad(error)) => (2, error),
        Err(Failure::Zeroized(error)) => (3, error),
    };
    announce("ERROR", &in_one_line(&error));
    ExitCode::from(status)
}

/// An error with its causes, each once: many name their cause in their own text already.
fn in_one_line(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text += &format!(": {cause}");
        }
    }
    text += remedy(&text);
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shell::key_file;

    #[test]
    fn a_cause_that_is_in_the_text_already_is_not_repeated() {
        let folder = tempfile::tempdir().unwrap();
        let fault = anyhow::Error::from(key_file::read(folder.path()).expect_err("it is a folder"));
        let text = in_one_line(&fault);
        assert_eq!(text.matches("regular file").count(), 1, "{text}");
        let outer = anyhow::anyhow!("inner").context("outer");
        assert_eq!(in_one_line(&outer), "outer: inner");
    }
}
