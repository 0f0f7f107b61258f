//! The command line of `cucs`.
//!
//! Each subcommand may be a process of its own: rights belong to the CUCS ID, and a CUCS that sends from another port
//! keeps them. Exit status: 0 done, 1 refused or no answer, 2 wrong arguments or a faulty file.

use std::io::{BufRead as _, Stdout, Write as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::Duration;

use clap::{CommandFactory as _, Parser, Subcommand};
use dli_group::{Group, Interface};
use stanag_msgs::Id;

use crate::operator::error::READER_GONE;
use crate::operator::file_kind::{self, Reader};
use crate::{
    Edition, Line, Operator, SessionConfig, Station, StationError, Style, Verb, parse_line,
};

/// Command vehicles as a STANAG 4586 ground station (CUCS).
#[derive(Debug, Parser)]
#[command(name = "cucs", version)]
struct Arguments {
    /// Address on which the VSM listens.
    #[arg(
        long,
        value_name = "HOST:PORT",
        default_value = "127.0.0.1:4586",
        global = true
    )]
    vsm: String,
    /// Multicast group to send to and receive from, in place of --vsm; for example 239.45.86.1:26001.
    #[arg(long, value_name = "GROUP:PORT", global = true, conflicts_with = "vsm")]
    multicast: Option<SocketAddr>,
    /// Network interface of the group, by name or address (default: by the system's routes); for example eth0.
    #[arg(
        long,
        value_name = "NAME|ADDRESS",
        global = true,
        requires = "multicast"
    )]
    interface: Option<Interface>,
    /// Edition of STANAG 4586 to speak: 2.5, 3 or 4.
    #[arg(long, value_name = "2.5|3|4", default_value = "4", global = true)]
    edition: Edition,
    /// Maximum number of hops for datagrams to the group, 0 to 255.
    #[arg(long, value_name = "HOPS", default_value_t = 1, global = true)]
    ttl: u8,
    /// Id of this CUCS; the VSM's configuration must list it.
    #[arg(long, default_value = "1b:00:00:a0", global = true)]
    id: Id,
    /// Own address (default: any port; on the loopback interface if the VSM is there).
    #[arg(long, value_name = "HOST:PORT", global = true)]
    listen: Option<SocketAddr>,
    /// Id of the vehicle to command (default: the only one discovered).
    #[arg(long, value_name = "ID", global = true)]
    vehicle: Option<Id>,
    /// Print one JSON object a line, for programs.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Verb(Verb),
    /// Run the subcommands in a file, one a line; stop at the first that fails.
    Script {
        /// Script file; route files in it are relative to it.
        file: PathBuf,
    },
    /// Start an interactive shell: run subcommands, print alerts as they arrive.
    Shell,
}

/// The line for standard error, and the exit status.
struct Failure {
    text: String,
    status: u8,
}

/// The command line, for completions and the manual page.
#[must_use]
pub fn command() -> clap::Command {
    Arguments::command()
}

/// The program: carries out the command line and returns the exit status.
#[must_use]
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let outcome = match runtime {
        Ok(runtime) => runtime.block_on(run(arguments)),
        Err(error) => Err(failure(1, error)),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        // Without a message, as other programs end then.
        Err(Failure { status, .. }) if status == READER_GONE => ExitCode::from(status),
        Err(Failure { text, status }) => {
            report(&format!("cucs: {text}"));
            ExitCode::from(status)
        }
    }
}

async fn run(arguments: Arguments) -> Result<(), Failure> {
    // A faulty script is reported before anything is sent.
    let script = match &arguments.command {
        Command::Script { file } => {
            file_kind::check(file, Reader::Script).map_err(|fault| failure(2, fault))?;
            Some((file, Line::load(file).map_err(|fault| failure(2, fault))?))
        }
        _ => None,
    };
    let station = match arguments.multicast {
        Some(group) => in_group(&arguments, group),
        None => Station::reach(config(&arguments), arguments.listen, &arguments.vsm).await,
    };
    let mut station = station.map_err(|fault| failure(fault.exit_status(), fault))?;
    station.on_wait = Some(report_wait);
    let style = if arguments.json {
        Style::Json
    } else {
        Style::People
    };
    let mut operator = Operator::new(station, arguments.vehicle, style, std::io::stdout());
    match (&arguments.command, script) {
        (Command::Verb(verb), _) => operator
            .run(verb, Path::new(""))
            .await
            .map_err(|fault| failure(fault.exit_status(), fault)),
        (Command::Shell, _) => shell(&mut operator).await,
        (Command::Script { .. }, None) => Ok(()),
        (Command::Script { .. }, Some((file, lines))) => {
            let folder = file.parent().unwrap_or(Path::new(""));
            for line in lines {
                if let Err(fault) = operator.run(&line.verb, folder).await {
                    let at = format!("{}:{}: {}", file.display(), line.number, line.text);
                    return Err(failure(fault.exit_status(), format!("{at}: {fault}")));
                }
            }
            Ok(())
        }
    }
}

/// A station in a group. Only the port of an own address is used: the address is that of the interface.
fn in_group(arguments: &Arguments, address: SocketAddr) -> Result<Station, StationError> {
    if !address.ip().is_multicast() {
        return Err(StationError::Address {
            address: address.to_string(),
            reason:
                "no multicast group: expected one such as 239.45.86.1:26001 or [ff15::4586]:26001"
                    .to_owned(),
        });
    }
    let group = Group {
        interface: arguments.interface.clone(),
        ttl: arguments.ttl,
        ..Group::new(address)
    };
    let port = arguments.listen.map_or(0, |listen| listen.port());
    Station::in_group(config(arguments), &group, port)
}

fn config(arguments: &Arguments) -> SessionConfig {
    SessionConfig::of(arguments.edition, arguments.id)
}

/// Runs lines from standard input, and serves the station between them.
async fn shell(operator: &mut Operator<Stdout>) -> Result<(), Failure> {
    let lines = typed_lines();
    prompt();
    loop {
        match lines.try_recv() {
            Err(TryRecvError::Disconnected) => return Ok(()),
            Err(TryRecvError::Empty) => operator
                .idle(SERVE_SPAN)
                .await
                .map_err(|fault| failure(1, fault))?,
            Ok(line) if matches!(line.trim(), "exit" | "quit") => return Ok(()),
            Ok(line) => {
                match parse_line(&line) {
                    Err(message) => report(&message),
                    Ok(None) => {}
                    Ok(Some(verb)) => {
                        if let Err(fault) = operator.run(&verb, Path::new("")).await {
                            report(&fault.to_string());
                        }
                    }
                }
                prompt();
            }
        }
    }
}

/// Lines of standard input, read by a thread: a blocking read cannot be interrupted to serve the station.
fn typed_lines() -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            let Ok(line) = line else { return };
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

fn prompt() {
    let mut error = std::io::stderr();
    // A closed standard error does not end the shell.
    let _ = write!(error, "cucs> ").and_then(|()| error.flush());
}

fn failure(status: u8, text: impl std::fmt::Display) -> Failure {
    Failure {
        text: text.to_string(),
        status,
    }
}

fn report(line: &str) {
    // A closed standard error does not change the result.
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// On standard error, so that standard output has results only.
fn report_wait(what: &str, left: Duration) {
    report(&format!(
        "cucs: waiting for the {what}, {:.0} s at most",
        left.as_secs_f64()
    ));
}

/// How long the shell serves the station between two looks at its input.
const SERVE_SPAN: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_value_of_a_subcommand_passes_for_an_option_of_the_program() {
        let parsed = |words: &str| Arguments::try_parse_from(words.split(' ')).unwrap();
        let own = parsed("cucs discover").id;
        let one = Id(0x1b00_0101);
        let asks = |through| Command::Verb(Verb::Ping { vehicle: through });
        for (words, vehicle, command) in [
            ("cucs ping", None, asks(None)),
            ("cucs ping --vehicle", None, asks(Some(None))),
            (
                "cucs ping --vehicle 1b:00:01:01",
                Some(one),
                asks(Some(Some(one))),
            ),
            (
                "cucs --vehicle 1b:00:01:01 ping",
                Some(one),
                asks(Some(Some(one))),
            ),
            (
                "cucs vehicle 1b:00:01:01",
                None,
                Command::Verb(Verb::Vehicle { selected: one }),
            ),
        ] {
            let found = parsed(words);
            assert_eq!((found.id, found.vehicle), (own, vehicle), "{words}");
            assert_eq!(
                format!("{:?}", found.command),
                format!("{command:?}"),
                "{words}"
            );
        }
    }

    /// Clap keeps one value for an option of the program and an argument of a subcommand with the same name;
    /// different types make the program panic.
    #[test]
    fn arguments_of_one_name_are_of_one_type() {
        fn check(command: &clap::Command, globals: &[&clap::Arg]) {
            for sub in command.get_subcommands() {
                for argument in sub.get_arguments() {
                    let same = globals.iter().find(|one| one.get_id() == argument.get_id());
                    let type_of = |one: &clap::Arg| one.get_value_parser().type_id();
                    assert!(
                        same.is_none_or(|one| type_of(one) == type_of(argument)),
                        "{}: {}",
                        sub.get_name(),
                        argument.get_id()
                    );
                }
                check(sub, globals);
            }
        }
        let command = command();
        let globals: Vec<_> = command
            .get_arguments()
            .filter(|one| one.is_global_set())
            .collect();
        check(&command, &globals);
    }
}
