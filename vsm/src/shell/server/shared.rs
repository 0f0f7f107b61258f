//! What all tasks of a server share: the machine with its store, recordings and keys, and the notifications between tasks.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mavlink_link::Now;
use mavlink_link::service::text::one_line;
use mavlink_link::store::Disk as _;
use tokio::sync::{Notify, watch};

use super::forward::OpenForward;
use super::gathering::Gathering;
use super::guard_thread::GuardThread;
use crate::config::{Config, LinkAddress};
use crate::key_exchange::{KeyExchange, Surroundings};
use crate::session::findings::{self, Code, Finding};
use crate::session::web::WebRefusal;
use crate::session::{Bridge, KeyChange, LogEntry, LogLevel, Peer, Status, VehicleMap};
use crate::shell::clock::{Clock, NOT_BEFORE};
use crate::shell::dli_recording::DliRecording;
use crate::shell::encryption::Encryption;
use crate::shell::key_file::system_random;
use crate::shell::memory;
use crate::shell::ordered_files::OrderedKeys;
use crate::shell::queued_disk::QueuedDisk;
use crate::shell::recording::{Recorder, Recording};
use crate::shell::sockets::VehicleWriter;
use crate::shell::web::control::Clients;
use crate::shell::web::{Event, Events, PageInfo, Source};

/// Writes a machine's entry to the log: one line, whatever texts of vehicles and stations are in it.
pub(super) fn write_log(entry: &LogEntry) {
    let LogEntry { level, about, text } = entry;
    let text = one_line(text);
    match level {
        LogLevel::Debug => tracing::debug!("{about}: {text}"),
        LogLevel::Info => tracing::info!("{about}: {text}"),
        LogLevel::Warning => tracing::warn!("{about}: {text}"),
        LogLevel::Error => tracing::error!("{about}: {text}"),
    }
}

/// Shared by the tasks of one thread.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) clock: Clock,
    /// The id of this VSM, as the status shows it.
    pub(super) vsm: String,
    pub(super) core: RefCell<Core>,
    /// Recent log entries, for the page.
    pub(super) events: RefCell<Events>,
    /// Something waits to be sent.
    pub(super) outgoing: Notify,
    /// Wakes the task that keeps time.
    pub(super) alarm: Alarm,
    /// The disk has made something durable, or has failed to.
    pub(super) stored: Arc<Notify>,
    /// An order to zeroize must be stored.
    pub(super) zeroize: Notify,
    /// The order is stored and announced: the bridge ends.
    pub(super) ended: Notify,
}

/// When the task that keeps time wakes up.
///
/// No wake-up is lost: between its look at what is due and [`Alarm::set`] the task does not wait, so nothing becomes due in between,
/// as all is on one thread; whatever becomes due after that, does so in [`Shared::with`], which calls [`Alarm::due`].
#[derive(Debug, Default)]
pub(super) struct Alarm {
    /// Where the next timeout has moved to later, the task wakes up once in vain.
    at: Cell<Duration>,
    earlier: Notify,
}

impl Alarm {
    /// Something is due then: wakes the task where it would sleep longer.
    fn due(&self, at: Duration) {
        if at < self.at.get() {
            self.earlier.notify_one();
        }
    }

    /// The task sleeps until then, for nothing is due before.
    pub(super) fn set(&self, at: Duration) {
        self.at.set(at);
    }

    /// Waits until something is due before that.
    pub(super) async fn earlier(&self) {
        self.earlier.notified().await;
    }
}

/// An open link, which a task reads.
#[derive(Debug)]
pub(super) struct OpenPort {
    pub(super) link: LinkAddress,
    pub(super) writer: VehicleWriter,
    /// The fixed peer of a udpout or serial link.
    pub(super) peer: Option<Peer>,
    /// Ends the task that reads it.
    pub(super) close: Rc<Notify>,
}

/// The machine and its resources.
#[derive(Debug)]
pub(super) struct Core {
    pub(super) bridge: Bridge,
    /// The present configuration.
    pub(super) config: Config,
    /// The links, by the bridge's numbers; `None` for one that is no longer needed.
    pub(super) ports: Vec<Option<OpenPort>>,
    /// One for each other ground station.
    pub(super) forwards: Vec<OpenForward>,
    /// One for each vehicle.
    pub(super) writers: Vec<VehicleWriter>,
    pub(super) store: QueuedDisk,
    /// Writes the recordings.
    pub(super) recorder: Recorder,
    /// One for each vehicle, where recordings are made.
    pub(super) recordings: Vec<Option<Recording>>,
    pub(super) dli_recording: Option<DliRecording>,
    /// Locked as long as the bridge runs.
    pub(super) key_stores: Vec<Option<OrderedKeys>>,
    /// For the vehicles that agree on keys over the air, by their index.
    pub(super) exchanges: Vec<(usize, KeyExchange)>,
    /// For the vehicles with an encrypted link, by their index.
    pub(super) encryptions: Vec<(usize, Encryption)>,
    /// Agrees on keys with the guards of CUCSs.
    pub(super) guard_thread: GuardThread,
    /// The web clients that are connected.
    pub(super) web: Clients,
    /// When this node's lease of the VSM ends, where several nodes share its store.
    pub(super) lease: watch::Receiver<Option<Instant>>,
    /// Counts what arrives from vehicles, and what is sent to them.
    pub(super) gathering: Arc<Gathering>,
}

impl Core {
    /// Lets the bridge answer and command while this node's lease lasts, and no longer.
    pub(super) fn keep_to_lease(&mut self, mono: Duration) {
        let ended = self.lease_has_ended();
        self.bridge.pause(mono, ended);
        if ended {
            self.web.end_all(WebRefusal::Ends);
        }
    }

    /// Where several nodes share the store: whether another one may serve this VSM.
    pub(super) fn lease_has_ended(&self) -> bool {
        let until = *self.lease.borrow();
        until.is_some_and(|until| Instant::now() >= until)
    }

    /// Passes received messages to the key exchanges, and does what is due.
    fn step_exchanges(&mut self, now: Now, in_use: Option<usize>, events: &RefCell<Events>) {
        self.each_exchange(|index, exchange, with| {
            if in_use == Some(index) {
                exchange.key_in_use(now, with);
            }
            exchange.handle(now, with);
            while let Some(entry) = exchange.poll_log() {
                events.borrow_mut().push(now.wall, &entry);
                write_log(&entry);
            }
        });
    }

    fn each_exchange(
        &mut self,
        mut act: impl FnMut(usize, &mut KeyExchange, &mut Surroundings<'_>),
    ) {
        for (index, exchange) in &mut self.exchanges {
            let Some(Some(keys)) = self.key_stores.get_mut(*index) else {
                continue;
            };
            let mut with = Surroundings {
                bridge: &mut self.bridge,
                store: &mut self.store,
                records: Some(&mut keys.records),
                keys: &keys.keys,
                random: &mut system_random,
                not_before: NOT_BEFORE,
            };
            act(*index, exchange, &mut with);
        }
    }

    /// An order to zeroize is in place here: orders the agents to zeroize too.
    pub(super) fn order_agents(&mut self, now: Now) {
        let in_flight = self.bridge.zeroizes_in_flight();
        self.each_exchange(|_, exchange, with| exchange.order_zeroize(now, in_flight, with));
    }

    /// Whether all agents have reported.
    pub(super) fn agents_have_answered(&self) -> bool {
        let mut exchanges = self.exchanges.iter();
        exchanges.all(|(_, one)| one.zeroized().is_some())
    }

    /// Whether anything may be there to be sent. What encrypted links gather is sent as it is due.
    fn may_send(&mut self) -> bool {
        !self.encryptions.is_empty() || self.bridge.may_send()
    }

    /// When anything is next due.
    pub(super) fn poll_timeout(&mut self, now: Duration) -> Duration {
        let of_bridge = self.bridge.poll_timeout(now);
        let exchanges = self.exchanges.iter().map(|(_, one)| one.poll_timeout());
        let encryptions = self.encryptions.iter().map(|(_, one)| one.poll_timeout());
        exchanges.chain(encryptions).fold(of_bridge, Duration::min)
    }

    /// Passes the recordings' buffers to their thread.
    pub(super) fn flush(&mut self) {
        self.recordings
            .iter_mut()
            .flatten()
            .for_each(Recording::flush);
        self.dli_recording.iter_mut().for_each(DliRecording::flush);
    }
}

impl Shared {
    /// Calls the bridge, then handles what follows from the call.
    ///
    /// Every task comes through here with what it has received, with a result of another thread (the disk, keys of guards, a
    /// reload), or because something is due: so this is the one place that wakes the tasks that send and that keep time. What a
    /// task does with the core beside it is to take out what is there, and to count.
    pub(super) fn with<T>(&self, act: impl FnOnce(&mut Core, Now) -> T) -> T {
        let mut core = self.core.borrow_mut();
        let now = self.clock.now();
        core.bridge.note_zero(self.clock.zero());
        core.keep_to_lease(now.mono);
        let done = act(&mut core, now);
        core.step_exchanges(now, None, &self.events);
        for entry in core.step_encryptions(now) {
            self.events.borrow_mut().push(now.wall, &entry);
            write_log(&entry);
        }
        while let Some(entry) = core.bridge.poll_log() {
            self.events.borrow_mut().push(now.wall, &entry);
            write_log(&entry);
        }
        while let Some((index, change)) = core.bridge.poll_key_change() {
            let Core {
                key_stores, store, ..
            } = &mut *core;
            let Some(Some(OrderedKeys { keys, .. })) = key_stores.get(index) else {
                continue;
            };
            let (done, what) = match change {
                KeyChange::Commit => (keys.commit(), "the vehicle has the new key"),
                KeyChange::DropNext => (keys.drop_next(), "the vehicle keeps its key"),
            };
            match done {
                Ok(()) => {
                    tracing::info!("{what}");
                    if let Err(fault) = keys.bury(store) {
                        tracing::debug!("the clock of a dead key cannot be deleted: {fault}");
                    }
                    // The exchange learns of it after the commit, and sends nothing before that is durable.
                    let in_use = (change == KeyChange::Commit).then_some(index);
                    core.step_exchanges(now, in_use, &self.events);
                }
                // The next start finds it out again.
                Err(fault) => tracing::error!("{what}, but {fault}"),
            }
        }
        while let Some((from, bytes)) = core.bridge.poll_guard_step() {
            if !core.guard_thread.give_step(from, bytes) {
                core.bridge
                    .count_dropped("guard: too many steps of exchanges at once");
            }
        }
        while let Some((number, why)) = core.bridge.poll_web_end() {
            core.web.end(number, why);
        }
        if core.bridge.zeroize_to_store() {
            self.zeroize.notify_one();
        }
        // Most frames of telemetry lead to nothing, and to wake a task costs more than to handle one.
        if core.may_send() {
            self.outgoing.notify_one();
        }
        self.alarm.due(core.poll_timeout(now.mono));
        done
    }

    /// The status of everything.
    pub(super) fn status(&self) -> Status {
        let core = self.core.borrow();
        let now = self.clock.mono();
        let mut status = core.bridge.status(self.vsm.clone(), now);
        for (index, one) in &core.exchanges {
            if let Some(vehicle) = status.vehicles.get_mut(*index) {
                vehicle.link.exchange = Some(one.status());
            }
        }
        for (index, one) in &core.encryptions {
            if let Some(vehicle) = status.vehicles.get_mut(*index) {
                vehicle.link.encryption = Some(one.status(now));
            }
        }
        for recording in core.recordings.iter().flatten() {
            recording.count(&mut status.recordings);
        }
        if let Some(recording) = &core.dli_recording {
            recording.count(&mut status.recordings);
        }
        status.memory_locked = memory::is_locked();
        if core.lease_has_ended() {
            status.warnings.push(NO_LEASE.to_owned());
        }
        // A full disk has been found already, and each vehicle has an alert of its own.
        let known = |one: &Finding| one.code == Code::Store && one.about == "store";
        if let Some(cause) = core.store.failing()
            && !status.findings.iter().any(known)
        {
            let is_shared = core.config.store.shared().is_some();
            status.findings.push(findings::failing(&cause, is_shared));
        }
        status.logged = self.events.borrow().lately(self.clock.now().wall);
        status
    }
}

impl Source for Rc<Shared> {
    fn page(&self) -> PageInfo {
        PageInfo {
            control: self.core.borrow().config.web.control,
            ..PageInfo::default()
        }
    }

    fn status(&self, _moment: Option<Duration>) -> Status {
        Shared::status(self)
    }

    fn map(&self, _moment: Option<Duration>) -> Vec<VehicleMap> {
        self.core.borrow().bridge.map()
    }

    fn events(&self, _moment: Option<Duration>) -> Vec<Event> {
        self.events.borrow().all().cloned().collect()
    }
}

const NO_LEASE: &str = "the lease of this node has ended, and etcd has not renewed it: it answers no station and commands no vehicle until \
    etcd does; see that it reaches etcd";

#[cfg(test)]
mod tests {
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    use super::*;

    /// The task that keeps time, as `keep_time` has it, one step at a time.
    #[derive(Debug, Default)]
    struct Keeper {
        alarm: Alarm,
        /// Until when it sleeps; `None` while it has not begun, or works.
        sleeps: Option<Duration>,
    }

    impl Keeper {
        /// Whether the runtime would run it now; a notification is used up.
        fn is_woken(&mut self, now: Duration) -> bool {
            let Some(until) = self.sleeps else {
                return true;
            };
            let notified = pin!(self.alarm.earlier());
            let notified = notified.poll(&mut Context::from_waker(Waker::noop()));
            until <= now || notified == Poll::Ready(())
        }

        /// It is run: looks, and works or sleeps. Returns whether it has worked.
        fn run(&mut self, now: Duration, due: Duration) -> bool {
            if !self.is_woken(now) {
                return false;
            }
            self.sleeps = (due > now).then_some(due);
            if let Some(until) = self.sleeps {
                self.alarm.set(until);
            }
            self.sleeps.is_none()
        }
    }

    /// Every history of seven steps: time passes, a call leaves something due (now, soon, later, at the end of all), the task is run.
    #[test]
    fn what_is_due_is_done_whenever_it_has_become_due() {
        const MS: Duration = Duration::from_millis(1);
        const STEPS: u32 = 7;
        for history in 0..6_u32.pow(STEPS) {
            let (mut keeper, mut now, mut due) = (Keeper::default(), MS, 9 * MS);
            for step in 0..STEPS {
                match history / 6_u32.pow(step) % 6 {
                    0 => now += MS,
                    1 => {
                        // What is done leaves the next thing far away.
                        if keeper.run(now, due) {
                            due = now + 9 * MS;
                        }
                    }
                    choice => {
                        due = now + MS * [0, 1, 3, 9][choice as usize - 2];
                        keeper.alarm.due(due);
                    }
                }
            }
            // Nothing else happens: the runtime runs it until it sleeps, then when its time has come.
            for _ in 0..3 {
                if keeper.run(now, due) {
                    due = now + 9 * MS;
                }
            }
            let until = keeper.sleeps.expect("it sleeps");
            assert!(until <= due, "history {history}: {until:?}, due {due:?}");
        }
    }
}
