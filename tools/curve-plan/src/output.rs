//! What the program writes: the files that the command line names, answers on standard output, and the progress of a
//! fit on a terminal.

use std::io::{IsTerminal, Write};
use std::path::Path;

use clap::Args;
use cucs::formats::{self, Draft, Format, Losses, Output};

use crate::failure::Failure;
use crate::messages::Addresses;

/// The file to write where there is nothing to do without one.
#[derive(Clone, Debug, Args)]
#[command(mut_arg("written", |to| to.required_unless_present("output")))]
pub(crate) struct RequiredOutput {
    #[command(flatten)]
    output: Output,
}

impl RequiredOutput {
    pub(crate) fn path(&self) -> &Path {
        // The path is never empty: clap refuses a command line without one.
        self.output.path().unwrap_or(Path::new(""))
    }
}

/// Shows the progress of a fit in whole percents on standard error, where that is a terminal.
pub(crate) fn progress() -> impl FnMut(f64) {
    let terminal = std::io::stderr().is_terminal();
    let mut shown = 0;
    move |done| {
        let percent = (done * 100.0) as u32;
        if terminal && percent != shown {
            shown = percent;
            let end = if percent == 100 { "\r          \r" } else { "" };
            let _ = write!(std::io::stderr(), "\rfit {percent:>3} %{end}");
        }
    }
}

/// Writes a line to standard error: a remark, not the answer.
pub(crate) fn note(line: &str) {
    // Where standard error is closed, nobody is left to report to.
    let _ = writeln!(std::io::stderr(), "curve-plan: {line}");
}

/// Writes to standard output; where its reader has closed the pipe, the program ends quietly.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::file("standard output", e))
        }
        _ => Ok(()),
    }
}

/// Writes the route of the file `source` to another, in its format or as messages, and reports what is lost. With `--strict`
/// nothing is written where something would be lost.
pub(crate) fn write(
    source: &Path,
    file: &Path,
    route: &Draft,
    addresses: &Addresses,
    strict: bool,
) -> Result<Losses, Failure> {
    let format = Format::of(file)?;
    let (bytes, losses) = if matches!(format, Format::Hex | Format::Pcapng) {
        // What the messages do not carry is still in the source: they cannot be read again.
        let (plan, losses) = route.to_send(source)?;
        let bytes = match format {
            Format::Hex => addresses.hex(&plan)?.into_bytes(),
            _ => addresses.pcapng(&plan)?,
        };
        (bytes, losses)
    } else {
        formats::write(file, route)?
    };
    losses.report(&file.display().to_string(), strict)?;
    save(file, &bytes)?;
    Ok(losses)
}

/// Writes a file.
pub(crate) fn save(file: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(file, bytes).map_err(|e| {
        let problem = format!(
            "cannot be written: {e}; name a file in a folder that can be written, on a disk with free space"
        );
        Failure::file(file, problem)
    })
}
