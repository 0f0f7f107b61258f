//! `vsm decode` and `vsm encode`: datagrams in hex and messages in JSON, one per line.

use std::io::{self, BufRead, BufWriter, Write};

use anyhow::anyhow;
use stanag_msgs::json;

use super::process::{Failure, failed};

pub(crate) fn decode(raw: bool) -> Result<(), Failure> {
    each_line("decoded", |line, out| {
        let mut whole = true;
        for value in json::decode_line(line, raw) {
            whole &= value.get("error").is_none();
            writeln!(out, "{value}")?;
        }
        Ok(whole)
    })
}

pub(crate) fn encode(raw: bool) -> Result<(), Failure> {
    each_line("encoded", |line, out| match json::encode_line(line, raw) {
        Ok(hex) => writeln!(out, "{hex}").map(|()| true),
        Err(fault) => writeln!(out, "{}", fault.to_value()).map(|()| false),
    })
}

/// Answers every line at once, so that another program can converse with this one. `answer` returns whether the line was good;
/// where one was not, the rest is answered too, and the exit status is 1.
fn each_line(
    done_to: &str,
    mut answer: impl FnMut(&str, &mut dyn Write) -> io::Result<bool>,
) -> Result<(), Failure> {
    let (mut lines, mut bad) = (0_u64, 0_u64);
    let mut out = BufWriter::new(io::stdout().lock());
    let mut line = Vec::new();
    let mut input = io::stdin().lock();
    let done = loop {
        line.clear();
        match input.read_until(b'\n', &mut line) {
            Ok(0) => break out.flush(),
            Ok(_) => {}
            Err(cause) => break Err(cause),
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if text.is_empty() {
            continue;
        }
        match answer(text, &mut out).and_then(|good| out.flush().map(|()| good)) {
            Ok(good) => {
                lines += 1;
                bad += u64::from(!good);
            }
            Err(cause) => break Err(cause),
        }
    };
    match done {
        // The reader of our output has closed it.
        Err(cause) if cause.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(cause) => Err(failed(cause)),
        Ok(()) if bad > 0 => Err(failed(anyhow!(
            "{bad} of {lines} lines not {done_to}: see the \"error\" of each on standard output"
        ))),
        Ok(()) => Ok(()),
    }
}
