//! Keys agreed about with the guards of CUCSs: a thread that answers them and writes their files, and the socket by which a person
//! at this computer opens a window or has a key rotated (`vsm guard pair`, `vsm guard rotate`).
//!
//! The thread is another than the machine's, since a step is answered only once its key is on the disk, which takes its time while
//! vehicles fly. What it has decided comes back as [`Done`]; nothing else of the bridge is within its reach.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use mavlink_link::clock::Ceiling;
use mavlink_link::exchange::PairingCode;
use mavlink_link::signing::KeyId;
use mavlink_link::store::Record as _;
use stanag_msgs::Id;
use stanag_msgs::guard::ExchangeDatagram;
use tokio::net::{UdpSocket, UnixListener, UnixStream};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::timeout;

use super::shared::{Core, Shared};
use super::tasks::pause_after;
use crate::config::Config;
use crate::guard_exchange::{VsmEnd, VsmNews};
use crate::key_exchange::guard_identity;
use crate::session::GuardKeyUntil;
use crate::shell::clock::{Clock, NOT_BEFORE};
use crate::shell::disk::FileDisk;
use crate::shell::guard_agreed::AgreedFiles;
use crate::shell::guard_file;
use crate::shell::key_file::system_random;
use crate::shell::pairing_socket::Asker;
use crate::shell::tasks::Beat;

/// Where the key of each CUCS is, or will be.
pub(super) type KeyPaths = Vec<(Id, PathBuf)>;

/// What the thread is given.
pub(super) enum Work {
    /// What has arrived.
    Step(SocketAddr, Box<[u8]>),
    /// A person opens the window of a CUCS.
    Open(Id, PairingCode),
    /// That person is gone.
    Close,
    /// A person wants another key for a CUCS.
    Rotate(Id),
    /// The configuration has been read again, and key files may have been changed by hand.
    Files(KeyPaths),
}

/// What has come of it.
pub(super) enum Done {
    /// To be sent.
    Send(SocketAddr, Vec<u8>),
    /// Whether the window of this CUCS is open: this VSM's fingerprint, or why not.
    Opened(Id, Result<String, String>),
    /// To be sent to the guard of this CUCS under its key, or why not.
    Ask(Id, Result<Vec<u8>, String>),
    /// What is in force of a paired CUCS, read after the configuration was: another key may have been agreed about meanwhile.
    Keys(Id, Vec<GuardKeyUntil>),
    /// This key is on the disk, with what is in force now, or why that cannot be read.
    Agreed(Id, KeyId, Result<Vec<GuardKeyUntil>, String>),
    /// Anything else that has happened.
    News(Id, VsmNews),
}

/// The thread, as long as anybody may give it work.
#[derive(Debug)]
pub(super) struct GuardThread {
    work: SyncSender<Work>,
}

impl GuardThread {
    /// Starts it. What it does comes out of the receiver.
    pub(super) fn start(
        config: &Config,
        store: FileDisk,
        clock: Clock,
    ) -> io::Result<(GuardThread, UnboundedReceiver<Done>)> {
        let (work, todo) = sync_channel(MAX_WORK);
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
                answers.run(&todo, files);
            })?;
        Ok((GuardThread { work }, results))
    }

    /// Gives it work; false where it has too much, and what has arrived is lost as on any link.
    pub(super) fn give(&self, work: Work) -> bool {
        self.work.try_send(work).is_ok()
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
    /// None before the first pairing: a VSM that never had one needs no static key.
    end: Option<VsmEnd>,
    files: Vec<(Id, AgreedFiles)>,
    done: UnboundedSender<Done>,
}

impl Answers {
    fn run(mut self, todo: &Receiver<Work>, files: KeyPaths) {
        self.take_files(files);
        loop {
            let due = self.end.as_ref().and_then(VsmEnd::poll_timeout);
            let wait = due.map_or(IDLE, |at| at.saturating_sub(self.clock.mono()));
            match todo.recv_timeout(wait.max(SHORTEST)) {
                Ok(work) => self.take(work),
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
        // Nobody reads it any more once the bridge has ended.
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

    /// What nobody has paired with costs no more than this look.
    fn take_step(&mut self, from: SocketAddr, bytes: &[u8]) {
        let Some(step) = ExchangeDatagram::parse(bytes) else {
            return;
        };
        let mut files = self.files.iter_mut();
        let of = files.find(|(id, _)| *id == step.cucs);
        if let (Some((_, files)), Some(end)) = (of, &mut self.end) {
            let now = self.clock.mono();
            // Why it was ignored is counted by the machine.
            let _ = end.handle(now, from, &step, &mut system_random, files);
        }
    }

    fn take_files(&mut self, files: KeyPaths) {
        let known = |id: Id| files.iter().any(|(one, _)| *one == id);
        if let Some(end) = &mut self.end {
            end.retain(known);
        }
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
            tracing::error!("guards cannot agree about keys: {why}");
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
                Err(fault) => tracing::error!("CUCS {id} cannot agree about keys: {fault}"),
            }
        }
        for (id, keys) in paired {
            match keys {
                Ok(keys) => self.send(Done::Keys(id, keys)),
                Err(fault) => tracing::error!("CUCS {id}: {fault}"),
            }
        }
    }

    /// The static key is made with the first pairing.
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

    /// Answers and news; a key that is agreed about goes to the bridge before its guard is answered.
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
        while let Some((to, bytes)) = end.poll_transmit() {
            all.push(Done::Send(to, bytes));
        }
        all.into_iter().for_each(|one| self.send(one));
    }
}

/// A person at this computer, and what they wait for.
struct Waiting {
    asker: Asker,
    cucs: Id,
    what: Wish,
    key: Option<KeyId>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Wish {
    Pair,
    Rotate,
}

/// Moves what the thread has done to the bridge, the socket and whoever waits for it.
pub(super) async fn serve(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    socket: Rc<UdpSocket>,
    mut results: UnboundedReceiver<Done>,
    listener: UnixListener,
) {
    let mut waiting: Option<Waiting> = None;
    loop {
        let next = async {
            tokio::select! {
                done = results.recv() => Next::Done(done),
                accepted = listener.accept() => Next::Asked(accepted.map(|(stream, _)| stream)),
                () = gone(&mut waiting) => Next::Gone,
            }
        };
        match beat.during(next).await {
            Next::Done(Some(done)) => take(&shared, &beat, &socket, done, &mut waiting).await,
            // The thread has panicked.
            Next::Done(None) => return,
            Next::Asked(Ok(stream)) => greet(&shared, &beat, stream, &mut waiting).await,
            Next::Asked(Err(cause)) => pause_after("the socket for pairing", &cause).await,
            Next::Gone => {
                if waiting.take().is_some_and(|one| one.what == Wish::Pair) {
                    // However much strangers send: nobody is at the window any more.
                    while !shared.with(|core, _| core.guard_thread.give(Work::Close)) {
                        beat.during(tokio::time::sleep(AGAIN)).await;
                    }
                }
            }
        }
    }
}

enum Next {
    Done(Option<Done>),
    Asked(io::Result<UnixStream>),
    Gone,
}

async fn gone(waiting: &mut Option<Waiting>) {
    match waiting {
        Some(Waiting {
            what: Wish::Rotate,
            asker,
            ..
        }) => {
            // A guard that is there answers in a moment.
            let _ = timeout(ROTATE_WITHIN, asker.gone()).await;
            asker
                .send_line("not rotated: its guard has not answered; the key in force stays. Is it paired, running, and has it been received of late (`vsm guard status`)?")
                .await;
        }
        Some(one) => one.asker.gone().await,
        None => std::future::pending().await,
    }
}

/// `pair ID [CODE]` or `rotate ID`.
async fn greet(shared: &Shared, beat: &Beat, stream: UnixStream, waiting: &mut Option<Waiting>) {
    let greeted = timeout(GREETING_WITHIN, Asker::listen_to(stream));
    let Ok(Some((mut asker, line))) = beat.during(greeted).await else {
        return;
    };
    if waiting.is_some() {
        let text =
            "refused: another `vsm guard pair` or `vsm guard rotate` is under way: end that first";
        return beat.during(asker.send_line(text)).await;
    }
    let mut words = line.split_whitespace();
    let (what, cucs) = (words.next(), words.next().map(str::parse::<Id>));
    let (what, work, cucs) = match (what, cucs) {
        (Some("pair"), Some(Ok(cucs))) => match Asker::code(words.next().unwrap_or_default()) {
            Ok(code) => {
                let text = format!("pairing code  {}", &*code.text());
                beat.during(asker.send_line(&text)).await;
                (Wish::Pair, Work::Open(cucs, code), cucs)
            }
            Err(fault) => {
                return beat
                    .during(asker.send_line(&format!("refused: {fault}")))
                    .await;
            }
        },
        (Some("rotate"), Some(Ok(cucs))) => {
            if shared.core.borrow().config.access.is_some() {
                return beat.during(asker.send_line(LISTED)).await;
            }
            (Wish::Rotate, Work::Rotate(cucs), cucs)
        }
        _ => {
            return beat
                .during(asker.send_line("refused: no such request"))
                .await;
        }
    };
    if shared.with(|core, _| core.guard_thread.give(work)) {
        *waiting = Some(Waiting {
            asker,
            cucs,
            what,
            key: None,
        });
    } else {
        beat.during(asker.send_line("refused: too much at once, try again"))
            .await;
    }
}

async fn take(
    shared: &Shared,
    beat: &Beat,
    socket: &UdpSocket,
    done: Done,
    waiting: &mut Option<Waiting>,
) {
    let mut ended = false;
    let waits_for = waiting.as_ref().map(|one| one.cucs);
    let is_for = |cucs: Id| waits_for == Some(cucs);
    let line = match done {
        Done::Send(to, bytes) => {
            if let Err(cause) = beat.during(socket.send_to(&bytes, to)).await {
                tracing::debug!("a step of an exchange was not sent: {cause}");
            }
            return;
        }
        Done::Opened(cucs, Ok(own)) => {
            tracing::info!("CUCS {cucs}: the window for pairing its guard is open for 10 minutes");
            Some(format!(
                "this VSM      {own}\nthe window is open for 10 minutes, for one pairing of CUCS {cucs}"
            ))
        }
        Done::Opened(_, Err(why)) | Done::Ask(_, Err(why)) => {
            ended = true;
            Some(format!("refused: {why}"))
        }
        Done::Ask(cucs, Ok(bytes)) => {
            let sent = shared.with(|core, now| {
                let Core { bridge, store, .. } = core;
                bridge.send_guard(now, cucs, &bytes, store)
            });
            ended = !sent;
            let text = match sent {
                true => format!("CUCS {cucs} is asked to agree about another key"),
                false => format!("refused: nothing of the guard of CUCS {cucs} has verified yet"),
            };
            Some(text)
        }
        Done::Keys(cucs, keys) => {
            if let Err(why) = put_in_force(shared, cucs, None, keys) {
                tracing::error!("CUCS {cucs} has no guard key: {why}");
            }
            return;
        }
        Done::Agreed(cucs, key, keys) => {
            tracing::info!("CUCS {cucs}: a new guard key {key} is agreed about");
            if let Some(one) = waiting.as_mut().filter(|one| one.cucs == cucs) {
                one.key = Some(key);
                ended = one.what == Wish::Rotate;
            }
            let keyed = keys.and_then(|keys| put_in_force(shared, cucs, Some(key), keys));
            match keyed {
                Ok(()) => Some(format!(
                    "key           {key}, in force; the one before is accepted for 24 h"
                )),
                Err(why) => {
                    tracing::error!("CUCS {cucs} has no guard key: {why}");
                    Some(format!("key           {key}, which cannot be used: {why}"))
                }
            }
            .filter(|_| is_for(cucs))
        }
        Done::News(cucs, VsmNews::Paired(peer)) => {
            ended = is_for(cucs);
            let print = peer.fingerprint();
            tracing::info!("CUCS {cucs} is paired with the guard {print}");
            Some(paired(shared, cucs, &print.to_string()))
        }
        // It comes as `Done::Agreed`, with its keys.
        Done::News(_, VsmNews::Agreed(_)) => None,
        Done::News(_, VsmNews::WrongCode) => Some("pairing attempt with a wrong code".to_owned()),
        Done::News(cucs, VsmNews::Closed) => {
            ended = is_for(cucs);
            Some("closed without a pairing".to_owned())
        }
        Done::News(cucs, VsmNews::OtherVersion(version)) => Some(format!(
            "a guard in the name of CUCS {cucs} speaks version {version} of the exchange: update the older end"
        )),
        Done::News(cucs, VsmNews::NotStored(fault)) => {
            tracing::error!("CUCS {cucs}: an agreed key is not stored, and not answered: {fault}");
            Some(format!("not stored: {fault}"))
        }
    };
    if let (Some(line), Some(one)) = (line, waiting.as_mut()) {
        beat.during(one.asker.send_line(&line)).await;
    }
    if ended {
        *waiting = None;
    }
}

/// What the person still has to do.
fn paired(shared: &Shared, cucs: Id, print: &str) -> String {
    let core = shared.core.borrow();
    let guarded = core.config.stations().find(|one| one.id == cucs);
    let guarded = guarded.is_some_and(|one| one.guard.is_some());
    let path = paths(&core.config).into_iter().find(|(id, _)| *id == cucs);
    let path = path.map(|(_, path)| std::path::absolute(&path).unwrap_or(path));
    let path = path.map_or(String::new(), |path| path.display().to_string());
    let mut text = format!("paired with   {print}");
    if !guarded {
        text += &format!(
            "\nput this line into the [[cucs]] of {cucs}, then `vsm reload`: from then on nothing is taken in its name without the guard\n\
             guard = {{ key_file = \"{path}\" }}"
        );
    }
    if core.config.access.is_some() {
        text += "\nthe access list has no entry for this key: `vsm access grant`, `vsm access sign`, `vsm reload`";
    }
    text
}

/// The bridge seals and verifies under these keys; of a CUCS that has no guard yet by the configuration nothing changes. `new`: one that
/// has just been agreed about.
fn put_in_force(
    shared: &Shared,
    cucs: Id,
    new: Option<KeyId>,
    keys: Vec<GuardKeyUntil>,
) -> Result<(), String> {
    shared.with(|core, now| {
        let Core { bridge, store, .. } = core;
        // It was never used: nothing is to be read of it, while vehicles fly.
        if let Some(new) = new {
            store.know(&Ceiling::name(&new), None);
        }
        let set = bridge.set_guard_keys(vec![(cucs, keys)], now, NOT_BEFORE, store);
        set.map_err(|fault| fault.to_string())
    })
}

const LISTED: &str = "refused: an access list is in force, whose entries name guard keys: the CUCS would have no rights under a key that nobody knows before. \
     Use `vsm guard rotate FILE`, grant the new key, then copy the file; or pair again on the ground";
/// Steps that wait for the thread.
const MAX_WORK: usize = 64;
const IDLE: Duration = Duration::from_secs(60);
const SHORTEST: Duration = Duration::from_millis(1);
const AGAIN: Duration = Duration::from_millis(20);
const GREETING_WITHIN: Duration = Duration::from_secs(1);
const ROTATE_WITHIN: Duration = Duration::from_secs(15);
