//! How far a fit is, said on a terminal.

use std::io::{IsTerminal, Write};

/// Says it in whole percents on standard error, where that is a terminal.
pub(crate) fn progress() -> impl FnMut(f64) {
    let terminal = std::io::stderr().is_terminal();
    let mut said = 0;
    move |done| {
        let percent = (done * 100.0) as u32;
        if terminal && percent != said {
            said = percent;
            let end = if percent == 100 { "\r          \r" } else { "" };
            let _ = write!(std::io::stderr(), "\rfit {percent:>3} %{end}");
        }
    }
}
