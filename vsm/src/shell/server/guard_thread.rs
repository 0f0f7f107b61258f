//! Keys agreed on with the guards of CUCSs: a thread that answers them and writes their files.
//!
//! It is separate from the machine's thread, since a step is answered only once its key is on the disk, which takes time
//! while vehicles fly. Its decisions come back as [`Done`]; it can reach nothing else of the bridge.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use mavlink_link::exchange::PairingCode;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use stanag_msgs::guard::ExchangeDatagram;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use crate::config::Config;
use crate::guard_exchange::{VsmEnd, VsmNews};
use crate::key_exchange::guard_identity;
use crate::session::GuardKeyUntil;
use crate::shell::clock::Clock;
use crate::shell::disk::FileDisk;
use crate::shell::guard_agreed::AgreedFiles;
use crate::shell::guard_file;
use crate::shell::key_file::system_random;

/// Where the key of each CUCS is, or will be.
pub(super) type KeyPaths = Vec<(Id, PathBuf)>;

/// Work for the thread.
pub(super) enum Work {
    /// A received datagram.
    Step(SocketAddr, Box<[u8]>),
    /// A person opens the window of a CUCS.
    Open(Id, PairingCode),
    /// That person has disconnected.
    Close,
    /// A person requests another key for a CUCS.
    Rotate(Id),
    /// The configuration has been read again, and key files may have been changed by hand.
    Files(KeyPaths),
}

/// Results of the thread.
pub(super) enum Done {
    /// To be sent.
    Send(SocketAddr, Vec<u8>),
    /// Whether the window of this CUCS is open: this VSM's fingerprint, or why not.
    Opened(Id, Result<String, String>),
    /// A datagram for the guard of this CUCS, to be sealed with its key, or why there is none.
    Ask(Id, Result<Vec<u8>, String>),
    /// The keys of a paired CUCS, read after the configuration: another key may have been agreed on meanwhile.
    Keys(Id, Vec<GuardKeyUntil>),
    /// This key is on the disk; with the keys now in use, or why they cannot be read.
    Agreed(Id, KeyId, Result<Vec<GuardKeyUntil>, String>),
    /// Any other event.
    News(Id, VsmNews),
}

/// The thread, as long as anyone may give it work.
#[derive(Debug)]
pub(super) struct GuardThread {
    work: Sender<Work>,
    /// Steps that wait for the thread.
    steps: Arc<AtomicUsize>,
}

impl GuardThread {
    /// Starts the thread. Its results arrive at the receiver.
    pub(super) fn start(
        config: &Config,
        store: FileDisk,
        clock: Clock,
    ) -> io::Result<(GuardThread, UnboundedReceiver<Done>)> {
        let (work, todo) = channel();
        let steps = Arc::new(AtomicUsize::new(0));
        let taken = steps.clone();
        let (done, results) = unbounded_channel();
        let vsm = config.dli.vsm_id;
        let files = paths(config);
        thread::Builder::new()
            .name("guard keys".to_owned())
            .spawn(move || {
                let answers = Answers {
                    vsm,
                    store,
                    clock,
                    end: None,
                    files: Vec::new(),
                    done,
                };
                answers.run(&todo, &taken, files);
            })?;
        Ok((GuardThread { work, steps }, results))
    }

    /// Passes on a received datagram; false if too many wait already. It is then lost, as on any link.
    pub(super) fn give_step(&self, from: SocketAddr, bytes: Box<[u8]>) -> bool {
        if self.steps.fetch_add(1, Ordering::Relaxed) >= MAX_STEPS {
            self.steps.fetch_sub(1, Ordering::Relaxed);
            return false;
        }
        self.give(Work::Step(from, bytes));
        true
    }

    /// Passes on work of this computer, which a flood of strangers cannot displace.
    pub(super) fn give(&self, work: Work) {
        // A thread that has ended has panicked; the reader of its results finds that out.
        let _ = self.work.send(work);
    }
}

/// Where the key of each listed CUCS is: as configured, or, before it has a guard, in the store.
pub(super) fn paths(config: &Config) -> KeyPaths {
    let of = |station: &crate::config::Cucs| match &station.guard {
        Some(guard) => guard.key_file.clone(),
        None => config
            .store
            .dir
            .join(format!("guard-{:08x}.key", station.id.0)),
    };
    let each = config.stations().map(|one| (one.id, of(one)));
    each.collect()
}

/// The state of the thread.
struct Answers {
    vsm: Id,
    store: FileDisk,
    clock: Clock,
    /// `None` before the first pairing: a VSM without pairings needs no static key.
    end: Option<VsmEnd>,
    files: Vec<(Id, AgreedFiles)>,
    done: UnboundedSender<Done>,
}

impl Answers {
    fn run(mut self, todo: &Receiver<Work>, steps: &AtomicUsize, files: KeyPaths) {
        self.take_files(files);
        loop {
            let due = self.end.as_ref().and_then(VsmEnd::poll_timeout);
            let wait = due.map_or(IDLE, |at| at.saturating_sub(self.clock.mono()));
            match todo.recv_timeout(wait.max(SHORTEST)) {
                Ok(work) => {
                    if matches!(work, Work::Step(..)) {
                        steps.fetch_sub(1, Ordering::Relaxed);
                    }
                    self.take(work);
                }
                Err(RecvTimeoutError::Timeout) => {}
                // The bridge has ended.
                Err(RecvTimeoutError::Disconnected) => return,
            }
            let now = self.clock.mono();
            if let Some(end) = &mut self.end {
                end.handle_timeout(now);
            }
            self.report();
        }
    }

    fn send(&self, done: Done) {
        // After the end of the bridge nobody reads it.
        let _ = self.done.send(done);
    }

    fn take(&mut self, work: Work) {
        match work {
            Work::Step(from, bytes) => self.take_step(from, &bytes),
            Work::Open(cucs, code) => {
                let opened = self.open(cucs, &code);
                self.send(Done::Opened(cucs, opened));
            }
            Work::Close => {
                if let Some(end) = &mut self.end {
                    end.close_window();
                }
                self.files
                    .iter_mut()
                    .for_each(|(_, files)| files.set_pairing(false));
            }
            Work::Rotate(cucs) => {
                let now = self.clock.mono();
                let paired = self.end.as_mut().filter(|end| end.peer(cucs).is_some());
                let asked = match paired {
                    None => Err(format!(
                        "CUCS {cucs} is not paired: `vsm guard pair` pairs it; `vsm guard rotate FILE` makes a key to be copied"
                    )),
                    Some(end) => (end.please(now, cucs)).ok_or_else(|| {
                        "its guard was asked less than 10 s ago: wait for its answer".to_owned()
                    }),
                };
                self.send(Done::Ask(cucs, asked));
            }
            Work::Files(files) => self.take_files(files),
        }
    }

    /// Handles a step. Without any pairing this check is the only cost.
    fn take_step(&mut self, from: SocketAddr, bytes: &[u8]) {
        let Some(step) = ExchangeDatagram::parse(bytes) else {
            return;
        };
        let mut files = self.files.iter_mut();
        let of = files.find(|(id, _)| *id == step.cucs);
        if let (Some((_, files)), Some(end)) = (of, &mut self.end) {
            let now = self.clock.mono();
            // The machine counts why a step was ignored.
            let _ = end.handle(now, from, &step, &mut system_random, files);
        }
    }

    fn take_files(&mut self, files: KeyPaths) {
        let known = |id: Id| files.iter().any(|(one, _)| *one == id);
        if let Some(end) = &mut self.end {
            end.retain(known);
        }
        // Kept where the path is the same: an open window must survive a reload.
        let pairs = |id: Id, path: &PathBuf| {
            let mut known = self.files.iter();
            let same = known.find(|(one, files)| *one == id && files.path() == path);
            same.map(|(_, files)| files.clone())
        };
        let files: Vec<_> = files
            .into_iter()
            .map(|(id, path)| {
                (
                    id,
                    pairs(id, &path).unwrap_or_else(|| AgreedFiles::new(&path)),
                )
            })
            .collect();
        self.files = files;
        let paired = self.files.iter().any(|(_, files)| files.peer().is_some());
        if paired && let Err(why) = self.make_end() {
            tracing::error!("guards cannot agree on keys: {why}");
        }
        let now = self.clock.now();
        let Some(end) = &mut self.end else { return };
        let mut paired = Vec::new();
        for (id, files) in &self.files {
            match files.memory() {
                Ok(memory) => {
                    paired.extend(
                        memory
                            .peer
                            .map(|_| (*id, guard_file::read(files.path(), now))),
                    );
                    end.set(*id, memory, now.mono);
                }
                Err(fault) => tracing::error!("CUCS {id} cannot agree on keys: {fault}"),
            }
        }
        for (id, keys) in paired {
            match keys {
                Ok(keys) => self.send(Done::Keys(id, keys)),
                Err(fault) => tracing::error!("CUCS {id}: {fault}"),
            }
        }
    }

    /// Creates the machine; the first pairing creates its static key.
    fn make_end(&mut self) -> Result<(), String> {
        if self.end.is_none() {
            let identity = guard_identity(&mut self.store, &mut system_random);
            let identity = identity.map_err(|fault| fault.to_string())?;
            self.end = Some(VsmEnd::new(self.vsm, identity));
        }
        Ok(())
    }

    fn open(&mut self, cucs: Id, code: &PairingCode) -> Result<String, String> {
        self.make_end()?;
        let now = self.clock.mono();
        let end = self.end.as_mut().ok_or("no static key")?;
        let mut files = self.files.iter_mut();
        let Some((_, files)) = files.find(|(id, _)| *id == cucs) else {
            let fault = crate::guard_exchange::OpenError::Unknown(cucs);
            return Err(fault.to_string());
        };
        let memory = files.memory().map_err(|fault| fault.to_string())?;
        end.set(cucs, memory, now);
        let opened = end.open_window(now, cucs, code, files);
        opened.map_err(|fault| fault.to_string())?;
        files.set_pairing(true);
        Ok(end.own_key().fingerprint().to_string())
    }

    /// Passes on answers and news. An agreed key reaches the bridge before its guard is answered.
    fn report(&mut self) {
        let Some(end) = &mut self.end else { return };
        let mut all = Vec::new();
        while let Some((cucs, news)) = end.poll_news() {
            let files = self.files.iter_mut().find(|(id, _)| *id == cucs);
            let Some((_, files)) = files else { continue };
            all.push(match news {
                VsmNews::Agreed(key) => {
                    let keys = guard_file::read(files.path(), self.clock.now());
                    Done::Agreed(cucs, key, keys.map_err(|fault| fault.to_string()))
                }
                news => {
                    if matches!(news, VsmNews::Paired(_) | VsmNews::Closed) {
                        files.set_pairing(false);
                    }
                    Done::News(cucs, news)
                }
            });
        }
        // Answers last: after step 4 the guard may seal with the new key at once, which the bridge must know by then.
        while let Some((to, bytes)) = end.poll_transmit() {
            all.push(Done::Send(to, bytes));
        }
        all.into_iter().for_each(|one| self.send(one));
    }
}

/// Steps that wait for the thread.
const MAX_STEPS: usize = 64;
const IDLE: Duration = Duration::from_secs(60);
const SHORTEST: Duration = Duration::from_millis(1);
