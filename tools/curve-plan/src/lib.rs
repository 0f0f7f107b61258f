//! `curve-plan`: plans curved routes, reports what they cost, and sends them as a ground station does.
//!
//! A library only so that the generator of completions and manual pages can read its command line: [`command`].
//!
//! Exit status 0: done; 1: the answer is no (the route cannot be flown, or not within the requested bounds);
//! 2: the command line or a file is wrong, with the file, the line and the field on standard error.
#![forbid(unsafe_code)]

mod airframe;
mod check;
mod compare;
mod convert;
mod densify;
mod failure;
mod fit;
mod heights;
mod load;
mod messages;
mod output;
mod plot;
mod rally;
mod route;
mod send;
mod tlog;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

/// Plan curved routes for unmanned aircraft: cubic Bezier legs, flown as straight ones within a proven tolerance.
#[derive(Debug, Parser)]
#[command(name = "curve-plan", version, about, propagate_version = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Compare the fewest straight legs with the fewest cubic ones for a recorded track.
    Compare(compare::Compare),
    /// Turn a curved route into the straight legs that it is flown by.
    Densify(densify::Command),
    /// Fit the fewest cubic legs within a tolerance to a recorded or drawn track.
    Fit(fit::Command),
    /// Check whether a route can be flown at a speed, where it is too tight, and what flying will add.
    Check(check::Command),
    /// Draw a route, what is flown of it, and how far the one is from the other.
    Plot(plot::Command),
    /// Convert a route to another format, or into the messages that a ground station sends.
    Convert(convert::Command),
    /// Print the rally points of a .plan as tables for the configuration of a VSM (vsm.toml).
    Rally(rally::Command),
    /// Upload a route through a VSM, as a ground station (CUCS) does.
    Send(send::Command),
}

/// The command line, for completions and the manual page.
#[must_use]
pub fn command() -> clap::Command {
    Arguments::command()
}

/// The program: reads the command line, runs the subcommand, and returns the exit status.
#[must_use]
pub fn run() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Compare(c) => c.run(),
        Command::Densify(c) => c.run(),
        Command::Fit(c) => c.run(),
        Command::Check(c) => c.run(),
        Command::Plot(c) => c.run(),
        Command::Convert(c) => c.run(),
        Command::Rally(c) => c.run(),
        Command::Send(c) => c.run(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}
