//! The log of a program that must not block: a separate thread writes it, so that an unread pipe blocks only that thread.
//!
//! Lines that do not fit in the queue are lost, and the log reports their number once it is read again.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::time::Duration;

/// The place to write lines to. Cheap to clone.
#[derive(Debug, Clone)]
pub struct LogPipe {
    lines: SyncSender<Entry>,
    lost: Arc<AtomicU64>,
}

#[derive(Debug)]
enum Entry {
    Line(Vec<u8>),
    /// Everything before this has been written.
    End(Sender<()>),
}

impl LogPipe {
    /// Starts the thread that writes to `out`.
    ///
    /// # Errors
    /// There can be no thread.
    pub fn new(out: impl Write + Send + 'static) -> io::Result<LogPipe> {
        let (lines, entries) = sync_channel(MAX_LINES);
        let lost = Arc::new(AtomicU64::new(0));
        let counter = lost.clone();
        std::thread::Builder::new()
            .name("log".to_owned())
            .spawn(move || write(out, &entries, &counter))?;
        Ok(LogPipe { lines, lost })
    }

    /// Waits until the logged lines are written, a second at most.
    pub fn finish(&self) {
        let (done, end) = channel();
        // A queue that is full is not being read: there is nothing to wait for.
        if self.lines.try_send(Entry::End(done)).is_ok() {
            let _ = end.recv_timeout(END_WITHIN);
        }
    }
}

impl Write for LogPipe {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        // Never an error: `tracing` would report it to standard error, which is the pipe that is full.
        if let Err(TrySendError::Full(_)) = self.lines.try_send(Entry::Line(line.to_vec())) {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn write(mut out: impl Write, entries: &Receiver<Entry>, lost: &AtomicU64) {
    // Nobody is left to report to when the log cannot be written.
    while let Ok(entry) = entries.recv() {
        match entry {
            Entry::Line(line) => {
                let _ = out.write_all(&line);
            }
            Entry::End(done) => {
                let _ = done.send(());
            }
        }
        let lost = lost.swap(0, Ordering::Relaxed);
        if lost > 0 {
            let text = format!("{lost} lines of the log are lost: standard error was not read\n");
            let _ = out.write_all(text.as_bytes());
        }
    }
}

/// Lines that may wait: some 200 kB.
const MAX_LINES: usize = 2_048;
const END_WITHIN: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use std::sync::mpsc::SyncSender;

    use super::*;

    /// A pipe that holds one line until it is read.
    struct Pipe(SyncSender<Vec<u8>>);

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0
                .send(bytes.to_vec())
                .map_err(|_| io::ErrorKind::BrokenPipe)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_pipe_that_nobody_reads_stops_nobody_and_what_is_lost_is_counted() {
        let (sender, pipe) = sync_channel(1);
        let mut log = LogPipe::new(Pipe(sender)).unwrap();
        for number in 0..5_000 {
            // One call a line, as the log makes it.
            log.write_all(format!("line {number}\n").as_bytes())
                .unwrap();
        }
        // Full: this does not wait.
        log.finish();
        let read = std::thread::spawn(move || {
            let bytes: Vec<u8> = pipe.iter().flatten().collect();
            String::from_utf8(bytes).unwrap()
        });
        // Once it is read again the log continues, and ends when its last writer does.
        while log.lines.try_send(Entry::Line(Vec::new())).is_err() {
            std::thread::yield_now();
        }
        drop(log);
        let text = read.join().unwrap();
        assert!(text.starts_with("line 0\n"), "{text}");
        assert!(
            text.contains("lines of the log are lost: standard error was not read"),
            "{text}"
        );
        let lines = text
            .lines()
            .filter(|line| line.starts_with("line "))
            .count();
        assert!((MAX_LINES..5_000).contains(&lines), "{lines}");
    }
}
