//! `curve-plan`: plans curved routes, says what they cost, and sends them as a ground station does.
//!
//! A library only so that its command line can be had by what makes completions and the manual page: [`command`].
//!
//! Exit status 0: done; 1: the answer is no (the route cannot be flown, or cannot be had within what was asked for);
//! 2: the command line or a file is wrong, with the file, the line and the field on standard error.
#![forbid(unsafe_code)]

mod check;
mod compare;
mod convert;
mod densify;
mod failure;
mod fit;
mod formats;
mod json_line;
mod load;
mod plot;
mod progress;
mod route;
mod send;
mod tlog;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use failure::Failure;

/// Plans curved routes for unmanned aircraft: cubic Bezier legs, flown as straight ones within a proven tolerance.
#[derive(Debug, Parser)]
#[command(name = "curve-plan", version, about, propagate_version = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fewest straight legs against fewest cubic ones for a recorded track.
    Compare(compare::Compare),
    /// A curved route as the straight legs that it is flown by.
    Densify(densify::Command),
    /// A recorded or drawn track as the fewest cubic legs within a tolerance.
    Fit(fit::Command),
    /// Whether a route can be flown at a speed, where it is too tight, and what flying will add.
    Check(check::Command),
    /// A picture of a route, what is flown of it, and how far the one is from the other.
    Plot(plot::Command),
    /// A route from one format to another, or into the messages that a ground station sends.
    Convert(convert::Command),
    /// Upload a route through a VSM, as a ground station (CUCS) does.
    Send(send::Command),
}

/// The command line, for completions and the manual page.
#[must_use]
pub fn command() -> clap::Command {
    Arguments::command()
}

/// The program: reads the command line, does it, and says the exit status.
#[must_use]
pub fn run() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Compare(c) => c.run(),
        Command::Densify(c) => c.run(),
        Command::Fit(c) => c.run(),
        Command::Check(c) => c.run(),
        Command::Plot(c) => c.run(),
        Command::Convert(c) => c.run(),
        Command::Send(c) => c.run(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Writes to standard output; a reader that has gone away ends the program quietly.
fn print(text: &str) -> Result<(), Failure> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::file("standard output", e))
        }
        _ => Ok(()),
    }
}
