//! What the program writes: answers on standard output, the progress of a fit on a terminal.

use crate::failure::Failure;
use std::io::{IsTerminal, Write};

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

/// Writes to standard output; a reader that has gone away ends the program quietly.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::file("standard output", e))
        }
        _ => Ok(()),
    }
}
