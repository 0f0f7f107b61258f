//! The socket by which a person at this computer opens a window for the guard of a CUCS or has its key rotated (`vsm guard
//! pair`, `vsm guard rotate`), and the results of `guard_thread`, passed to the bridge.

use std::io;
use std::rc::Rc;
use std::time::Duration;

use mavlink_link::clock::Ceiling;
use mavlink_link::signing::KeyId;
use mavlink_link::store::Record as _;
use stanag_msgs::Id;
use tokio::net::{UdpSocket, UnixListener, UnixStream};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::time::{Instant, timeout, timeout_at};

use super::guard_thread::{self, Done, Work};
use super::shared::{Core, Shared};
use super::tasks::pause_after;
use crate::guard_exchange::VsmNews;
use crate::session::GuardKeyUntil;
use crate::shell::clock::NOT_BEFORE;
use crate::shell::pairing_socket::Asker;
use crate::shell::tasks::Beat;

/// A client on this computer, and what it waits for.
struct Waiting {
    asker: Asker,
    cucs: Id,
    what: Wish,
    key: Option<KeyId>,
    /// The time limit of a rotation, whatever else arrives meanwhile.
    until: Instant,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Wish {
    Pair,
    Rotate,
}

/// Passes the results of the thread to the bridge, the socket and waiting clients.
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
                // The client of the window has disconnected.
                if waiting.take().is_some_and(|one| one.what == Wish::Pair) {
                    shared.with(|core, _| core.guard_thread.give(Work::Close));
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
            until,
            ..
        }) => {
            // A guard that runs answers in a moment.
            let _ = timeout_at(*until, asker.gone()).await;
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
            // Entries of the access list name guard keys: see `LISTED`.
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
    shared.with(|core, _| core.guard_thread.give(work));
    *waiting = Some(Waiting {
        asker,
        cucs,
        what,
        key: None,
        until: Instant::now() + ROTATE_WITHIN,
    });
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
        // Another node may serve this VSM, and its guard keys.
        Done::Send(..) if shared.with(|core, _| core.lease_has_ended()) => return,
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
                true => format!("CUCS {cucs} is requested to agree on a new key"),
                false => format!(
                    "refused: nothing of the guard of CUCS {cucs} has verified yet, or the lease of this node has ended"
                ),
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
            tracing::info!("CUCS {cucs}: agreeing on the new guard key {key}");
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
        // Reported as `Done::Agreed`, with its keys.
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

/// The steps that are left to the person.
fn paired(shared: &Shared, cucs: Id, print: &str) -> String {
    let core = shared.core.borrow();
    let guarded = core.config.stations().find(|one| one.id == cucs);
    let guarded = guarded.is_some_and(|one| one.guard.is_some());
    let path = guard_thread::paths(&core.config)
        .into_iter()
        .find(|(id, _)| *id == cucs);
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

/// The bridge seals and verifies under these keys. For a CUCS without a guard in the configuration nothing changes. `new`:
/// a key that has just been agreed on.
fn put_in_force(
    shared: &Shared,
    cucs: Id,
    new: Option<KeyId>,
    keys: Vec<GuardKeyUntil>,
) -> Result<(), String> {
    shared.with(|core, now| {
        let Core { bridge, store, .. } = core;
        // The key was never used, so there is no ceiling to read: no disk access while vehicles fly.
        if let Some(new) = new {
            store.know(&Ceiling::name(&new), None);
        }
        let set = bridge.set_guard_keys(vec![(cucs, keys)], now, NOT_BEFORE, store);
        set.map_err(|fault| fault.to_string())
    })
}

const LISTED: &str = "refused: an access list is in force, whose entries name guard keys: the CUCS would have no rights under a key that nobody knows before. \
     Use `vsm guard rotate FILE`, grant the new key, then copy the file; or pair again on the ground";
const GREETING_WITHIN: Duration = Duration::from_secs(1);
const ROTATE_WITHIN: Duration = Duration::from_secs(15);
