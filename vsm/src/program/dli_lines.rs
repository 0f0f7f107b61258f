//! `vsm decode` and `vsm encode`: datagrams in hex and messages in JSON, a line each.

use std::io::{self, BufRead, BufWriter, Write};

use stanag_msgs::json;

use super::process::{Failure, failed};

pub(crate) fn decode(raw: bool) -> Result<(), Failure> {
    each_line(|line, out| {
        for value in json::decode_line(line, raw) {
            writeln!(out, "{value}")?;
        }
        Ok(())
    })
}

pub(crate) fn encode(raw: bool) -> Result<(), Failure> {
    each_line(|line, out| match json::encode_line(line, raw) {
        Ok(hex) => writeln!(out, "{hex}"),
        Err(fault) => writeln!(out, "{}", fault.to_value()),
    })
}

/// Answers every line at once, so that another program can converse with this one.
fn each_line(
    mut answer: impl FnMut(&str, &mut dyn Write) -> io::Result<()>,
) -> Result<(), Failure> {
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
        if let Err(cause) = answer(text, &mut out).and_then(|()| out.flush()) {
            break Err(cause);
        }
    };
    match done {
        // Whoever read our output has seen enough.
        Err(cause) if cause.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other.map_err(failed),
    }
}
