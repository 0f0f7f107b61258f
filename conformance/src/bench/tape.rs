//! The clock of a run, what it has recorded, and waiting for more: shared by the programs of the suite.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Bytes that are recorded at most: a subject that floods must not fill the memory.
pub const MAX_RECORDED_BYTES: usize = 256 << 20;

/// A recording of the form `R`, with the clock of the run.
#[derive(Debug)]
pub struct Tape<R> {
    start: Instant,
    recording: Mutex<R>,
    arrived: Condvar,
    interrupted: AtomicBool,
    sockets: AtomicUsize,
}

impl<R: Default> Default for Tape<R> {
    fn default() -> Self {
        Self {
            start: Instant::now(),
            recording: Mutex::default(),
            arrived: Condvar::new(),
            interrupted: AtomicBool::new(false),
            sockets: AtomicUsize::new(0),
        }
    }
}

impl<R> Tape<R> {
    /// Time since the run began.
    #[must_use]
    pub fn now(&self) -> Duration {
        self.start.elapsed()
    }

    /// Ends every wait: the operator stops the run.
    pub fn interrupt(&self) {
        self.interrupted.store(true, Ordering::SeqCst);
        self.arrived.notify_all();
    }

    /// Whether the operator stopped the run.
    #[must_use]
    pub fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::SeqCst)
    }

    /// The recording, locked.
    pub fn recording(&self) -> MutexGuard<'_, R> {
        self.recording
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes all waiters: something has arrived.
    pub fn notify(&self) {
        self.arrived.notify_all();
    }

    /// The number for the next socket.
    pub fn next_socket(&self) -> usize {
        self.sockets.fetch_add(1, Ordering::SeqCst)
    }

    /// What `find` returns from the recording, called at each arrival until `deadline` (time of the run). `find`
    /// keeps its own position, so that nothing is searched twice.
    pub fn wait_for<T>(
        &self,
        deadline: Duration,
        mut find: impl FnMut(&R) -> Option<T>,
    ) -> Option<T> {
        let mut recording = self.recording();
        loop {
            if let Some(found) = find(&recording) {
                return Some(found);
            }
            let left = deadline.saturating_sub(self.now());
            if left.is_zero() || self.interrupted() {
                return None;
            }
            recording = self
                .arrived
                .wait_timeout(recording, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    /// Waits this long, or until the operator stops the run.
    pub fn pause(&self, time: Duration) {
        let deadline = self.now() + time;
        while !self.interrupted() && self.now() < deadline {
            std::thread::sleep(
                (deadline - self.now().min(deadline)).min(Duration::from_millis(20)),
            );
        }
    }
}
