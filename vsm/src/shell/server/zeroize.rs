//! An order to zeroize, by message or by `vsm zeroize`: it is stored, agents beside PX4 receive the same order, and the
//! bridge ends. The program that ran the bridge then erases the files.

use std::rc::Rc;
use std::time::{Duration, Instant};

use tokio::io::AsyncReadExt as _;
use tokio::net::{UnixListener, UnixStream};

use super::shared::{Core, Shared};
use crate::key_exchange;
use crate::shell::erase::{self, Order};
use crate::shell::status_socket::{self, IN_FLIGHT, Ordered};
use crate::shell::tasks::Beat;

pub(super) async fn serve(shared: Rc<Shared>, beat: Rc<Beat>, listener: UnixListener) {
    loop {
        let step = async {
            tokio::select! {
                accepted = listener.accept() => Some(accepted),
                () = shared.zeroize.notified() => None,
            }
        };
        let mut asker = None;
        match beat.during(step).await {
            None => {}
            Some(Ok((mut stream, _))) => {
                let Some(in_flight) = beat.during(read_word(&mut stream)).await else {
                    continue;
                };
                let refused = shared.with(|core, now| {
                    let ordered = core.bridge.zeroize_here(now, in_flight, &mut core.store);
                    ordered.err()
                });
                if refused.is_some() {
                    let beyond = vec![];
                    let answer = Ordered { refused, beyond };
                    status_socket::answer(stream, &answer, ANSWER_WITHIN).await;
                    continue;
                }
                asker = Some(stream);
            }
            Some(Err(cause)) => {
                tracing::warn!("the zeroize socket: {cause}");
                beat.during(tokio::time::sleep(PAUSE)).await;
            }
        }
        let stored = shared.with(|core, now| {
            if !core.bridge.zeroize_to_store() {
                return None;
            }
            let order = Order::of_bridge(&core.config, core.bridge.zeroizes_in_flight());
            // On this thread: other queued writes are erased anyway.
            let mut disk = core.store.files().shared();
            let stored = erase::begin(&mut disk, &order).map_err(|fault| fault.to_string());
            core.bridge
                .zeroize_stored(now, stored.clone(), &mut core.store);
            Some(stored.map(|_| ()))
        });
        let Some(stored) = stored else { continue };
        let ended = stored.is_ok();
        let beyond = match ended {
            true => beyond(&shared, &beat).await,
            false => vec![],
        };
        if let Some(stream) = asker {
            let refused = stored.err();
            let answer = Ordered { refused, beyond };
            status_socket::answer(stream, &answer, ANSWER_WITHIN).await;
        }
        if ended {
            // Stations receive the outcome first.
            beat.during(tokio::time::sleep(LAST_WORDS)).await;
            shared.ended.notify_one();
            beat.during(std::future::pending::<()>()).await;
        }
    }
}

/// Sends the order to the agents beside PX4, while this computer still has its keys. Agents that do not answer within half
/// a minute delay nothing further.
async fn beyond(shared: &Shared, beat: &Beat) -> Vec<String> {
    shared.with(Core::order_agents);
    let end = Instant::now() + AGENTS_WITHIN;
    while !shared.with(|core, _| core.agents_have_answered()) && Instant::now() < end {
        beat.during(tokio::time::sleep(LOOK_AGAIN)).await;
    }
    shared.with(|core, now| {
        let each = core.exchanges.iter().map(|(_, one)| {
            let what = one.zeroized().unwrap_or(key_exchange::NOT_REACHED);
            (one.vehicle(), what.to_owned())
        });
        let each: Vec<_> = each.collect();
        for (vehicle, what) in &each {
            core.bridge
                .zeroized_beyond(now, *vehicle, what, &mut core.store);
        }
        let line = |(vehicle, what)| format!("vehicle {vehicle}: {what}");
        each.into_iter().map(line).collect()
    })
}

/// Whether the order is valid in flight too.
async fn read_word(stream: &mut UnixStream) -> Option<bool> {
    let read = tokio::time::timeout(ANSWER_WITHIN, stream.read_u8()).await;
    Some(read.ok()?.ok()? == IN_FLIGHT)
}

const ANSWER_WITHIN: Duration = Duration::from_secs(1);
/// The longest that a key exchange needs for its own end of it, with a margin.
const AGENTS_WITHIN: Duration = Duration::from_secs(32);
const LOOK_AGAIN: Duration = Duration::from_millis(50);
const PAUSE: Duration = Duration::from_millis(500);
const LAST_WORDS: Duration = Duration::from_millis(500);
