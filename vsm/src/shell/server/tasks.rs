//! The tasks around the machine: each moves bytes to or from it, or wakes it when it is due.
//!
//! No task returns while the bridge serves, and each waits for its work within [`Beat::during`].

use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::thread;
use std::time::Duration;

use dli_group::Group;
use mavlink_link::frame::FrameView;
use stanag_msgs::guard::MAX_GUARDED;
use tokio::net::{UdpSocket, UnixListener};
use tokio::sync::{Notify, oneshot};

use super::batch::Batch;
use super::checks::{self, Keys};
use super::file_changes::FileChanges;
use super::inbox::Inbox;
use super::shared::{Core, Shared, write_log};
use crate::session::findings::host::{KeyFault, StoreFact};
use crate::session::{Datagram, Destination, OutFrame, Peer, WebWay};
use crate::shell::interfaces::listen_elsewhere;
use crate::shell::recording::Recording;
use crate::shell::sockets::{VehicleReader, VehicleWriter};
use crate::shell::status_socket;
use crate::shell::tasks::Beat;
use crate::shell::timer::Timer;

/// Receives from stations. With a `group`, the socket is its member, and datagrams that are not from its sources are
/// dropped.
pub(super) async fn receive_dli(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    socket: Rc<UdpSocket>,
    group: Option<Group>,
) {
    let mut bytes = vec![0; LARGEST_DATAGRAM];
    let here = socket.local_addr();
    let handle = |from: SocketAddr, bytes: &[u8]| {
        shared.with(|core, now| {
            if group
                .as_ref()
                .is_some_and(|group| !group.takes_from(from.ip()))
            {
                return core.bridge.count_dropped("not a source of the group");
            }
            if let (Some(recording), Ok(here)) = (&mut core.dli_recording, &here) {
                recording.received(now.wall, from, *here, bytes);
            }
            core.bridge.handle_dli(now, from, bytes, &mut core.store);
        });
    };
    let mut inbox = Inbox::default();
    let mut turn = shared.clock.mono();
    loop {
        match receive_canonical(&socket, &mut bytes) {
            Ok((length, from)) => handle(from, bytes.get(..length).unwrap_or_default()),
            Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => {
                if let Err(cause) = beat.during(socket.readable()).await {
                    pause_after("the DLI socket", &cause).await;
                }
                turn = shared.clock.mono();
            }
            Err(cause) => pause_after("the DLI socket", &cause).await,
        }
        // A socket that is never empty would occupy the thread: vehicles, timers and queued datagrams get their turn in between.
        // What has arrived meanwhile is handled in the order of its senders' turns.
        while shared.clock.mono().saturating_sub(turn) >= TURN {
            beat.during(tokio::task::yield_now()).await;
            for _ in 0..MAX_EMPTIED {
                let Ok((length, from)) = receive_canonical(&socket, &mut bytes) else {
                    break;
                };
                let bridge = &mut shared.core.borrow_mut().bridge;
                let sender = bridge.sender_at(from);
                if !inbox.push(sender, from, bytes.get(..length).unwrap_or_default()) {
                    bridge.count_dropped("more than is handled in time");
                }
            }
            turn = shared.clock.mono();
            while let Some((from, bytes)) = inbox.pop() {
                handle(from, &bytes);
                if shared.clock.mono().saturating_sub(turn) >= TURN {
                    break;
                }
            }
        }
    }
}

/// An IPv6 socket that also accepts IPv4 shows IPv4 addresses in mapped form; a station must have the same address on both.
fn receive_canonical(socket: &UdpSocket, bytes: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
    let (length, from) = socket.try_recv_from(bytes)?;
    Ok((
        length,
        SocketAddr::new(from.ip().to_canonical(), from.port()),
    ))
}

pub(super) async fn receive_vehicle(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    port: usize,
    mut reader: VehicleReader,
    close: Rc<Notify>,
) {
    let mut bytes = vec![0; LARGEST_DATAGRAM];
    // Datagrams that were handled since others had their turn.
    let mut taken_in_turn = 0;
    loop {
        let received = async {
            tokio::select! {
                received = reader.receive(&mut bytes) => Some(received),
                () = close.notified() => None,
            }
        };
        let Some(received) = beat.during(received).await else {
            // No vehicle uses this link now; its socket closes with this task.
            return beat.finish();
        };
        match received {
            Ok(first) => {
                taken_in_turn += shared.with(|core, now| {
                    // Many vehicles on a link mean many datagrams: their effects (timers, frames, reports) are handled once
                    // for all of them. Not where keys are agreed on: exchange messages are handled one by one.
                    let at_once = if core.exchanges.is_empty() {
                        AT_ONCE
                    } else {
                        1
                    };
                    let (mut next, mut taken) = (Some(first), 0);
                    while let Some((length, from)) = next {
                        let bytes_of_it = bytes.get(..length).unwrap_or_default();
                        core.receive_vehicle(now, port, from, bytes_of_it);
                        taken += 1;
                        let more = (taken < at_once).then(|| reader.try_receive(&mut bytes));
                        next = more.flatten();
                    }
                    core.gathering.count_arrived(taken);
                    taken
                });
                // A socket that is never empty would occupy the thread, and with a thousand vehicles there are several of them: what
                // is to be sent, and what is due, waits for a turn of each.
                if taken_in_turn >= AT_ONCE {
                    beat.during(tokio::task::yield_now()).await;
                    taken_in_turn = 0;
                }
            }
            Err(cause) => pause_after("a vehicle's link", &cause).await,
        }
    }
}

pub(super) async fn receive_forward(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    number: usize,
    mut reader: VehicleReader,
    close: Rc<Notify>,
) {
    let mut bytes = vec![0; LARGEST_DATAGRAM];
    loop {
        let received = async {
            tokio::select! {
                received = reader.receive(&mut bytes) => Some(received),
                () = close.notified() => None,
            }
        };
        let Some(received) = beat.during(received).await else {
            // Removed from the configuration; its socket closes with this task.
            return beat.finish();
        };
        match received {
            Ok((length, from)) => shared.with(|core, now| {
                let Core {
                    bridge,
                    store,
                    forwards,
                    ..
                } = core;
                let bytes = bytes.get(..length).unwrap_or_default();
                let mut forward = forwards.iter_mut().find(|one| one.number == number);
                if let Some(forward) = &mut forward
                    && !forward.peers.admits(now.mono, from)
                {
                    return bridge.count_foreign(number);
                }
                bridge.handle_forward(now, number, from, bytes, store);
                // Only now is the sender known to be the ground station: a TCP connection may stay.
                if let Some(forward) = forward
                    && bridge.forward_peer(number) == Some(from)
                {
                    forward.writer.accept(from);
                }
            }),
            Err(cause) => pause_after("the link of a ground station", &cause).await,
        }
        // A station that sends continuously must not block vehicles and timers.
        beat.during(tokio::task::yield_now()).await;
    }
}

pub(super) fn recorder(
    recordings: &mut [Option<Recording>],
    wall: Duration,
) -> impl FnMut(usize, &FrameView<'_>) {
    move |index, frame| {
        if let Some(Some(recording)) = recordings.get_mut(index) {
            recording.write(wall, frame);
        }
    }
}

pub(super) async fn send(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    unicast: Rc<UdpSocket>,
    group: Option<(Rc<UdpSocket>, SocketAddr)>,
) {
    let sockets = DliSockets {
        takes_both: unicast.local_addr().is_ok_and(|here| here.is_ipv6()),
        unicast,
        group,
    };
    let unicast = &sockets.unicast;
    let mut guarded = [0; MAX_GUARDED];
    let mut batch = Batch::new(unicast);
    // Before the runtime has polled a socket once, `try_send` on it always fails.
    let _ = unicast.writable().await;
    let writers: Vec<_> = shared.core.borrow().writers.clone();
    for writer in writers {
        writer.ready().await;
    }
    loop {
        beat.during(async {
            tokio::select! {
                () = shared.outgoing.notified() => {}
                () = batch.room(unicast) => {}
            }
        })
        .await;
        // Frames for vehicles go first, however much is queued for stations. Nothing here waits for a socket: datagrams to a
        // computer that is not on the network stay in the send buffer for three seconds, until ARP gives up, and anybody
        // there can make the VSM answer an address that nobody has.
        loop {
            // For each datagram: a process that stood still continues anywhere.
            {
                let mut core = shared.core.borrow_mut();
                core.keep_to_lease(shared.clock.mono());
                if core.lease_has_ended() {
                    batch.clear();
                }
            }
            let sealed = shared.core.borrow_mut().poll_encrypted(shared.clock.mono());
            if let Some((writer, to, bytes)) = sealed {
                if !write_bytes(&bytes, to, &writer) {
                    return;
                }
                continue;
            }
            let frame = shared.core.borrow_mut().bridge.poll_vehicle();
            if let Some((index, frame)) = frame {
                if tracing::enabled!(tracing::Level::DEBUG) {
                    write_log(&shared.core.borrow().bridge.trace_vehicle(index, &frame));
                }
                // A writer is a shared handle, so cloning is cheap.
                let writer = {
                    let core = shared.core.borrow();
                    core.gathering.count_sent();
                    core.writers.get(index).cloned()
                };
                if let Some(writer) = writer
                    && !send_frame(&shared, index, &frame, &writer)
                {
                    return;
                }
                continue;
            }
            let lift = shared.core.borrow_mut().bridge.poll_lift();
            if let Some((to, bytes)) = lift {
                if let Err(cause) = unicast.try_send_to(&bytes, sockets.reached(to)) {
                    tracing::debug!("a datagram to a guard was not sent: {cause}");
                }
                continue;
            }
            if batch.is_full() && !send_batch(&mut batch, unicast, &shared) {
                send_forwards(&shared);
                break;
            }
            // Bound to a name so that the borrow of the core ends here.
            let datagram = shared.core.borrow_mut().bridge.poll_dli();
            let Some(datagram) = datagram else {
                send_batch(&mut batch, unicast, &shared);
                send_forwards(&shared);
                break;
            };
            sockets.send(&shared, &datagram, &mut batch, &mut guarded);
        }
    }
}

/// The sockets towards stations.
struct DliSockets {
    unicast: Rc<UdpSocket>,
    group: Option<(Rc<UdpSocket>, SocketAddr)>,
    /// An IPv6 socket reaches an IPv4 address only in mapped form.
    takes_both: bool,
}

impl DliSockets {
    fn reached(&self, to: SocketAddr) -> SocketAddr {
        match to {
            SocketAddr::V4(v4) if self.takes_both => {
                SocketAddr::new(v4.ip().to_ipv6_mapped().into(), v4.port())
            }
            to => to,
        }
    }

    /// Sends a datagram to the group, or adds it to the batch of those to stations.
    fn send(
        &self,
        shared: &Shared,
        datagram: &Datagram,
        batch: &mut Batch,
        guarded: &mut [u8; MAX_GUARDED],
    ) {
        let (socket, to) = match (datagram.to, &self.group) {
            (Destination::Unicast(to), _) => (&self.unicast, to),
            (Destination::Multicast, Some((socket, group))) => (socket, *group),
            (Destination::Multicast, None) => return,
        };
        if tracing::enabled!(tracing::Level::DEBUG) {
            write_log(&shared.core.borrow().bridge.trace_dli(to, datagram));
        }
        if let Some(recording) = &mut shared.core.borrow_mut().dli_recording
            && let Ok(here) = socket.local_addr()
        {
            recording.sent(shared.clock.now().wall, here, to, datagram.bytes());
        }
        // Only after the recording, which holds web traffic too.
        if pass_to_web(shared, datagram) {
            return;
        }
        let bytes = {
            let mut core = shared.core.borrow_mut();
            let Core { bridge, store, .. } = &mut *core;
            bridge.sealed(shared.clock.now(), datagram, guarded, store)
        };
        // The bridge has counted a datagram without a key.
        let Some(bytes) = bytes else { return };
        if let Destination::Unicast(to) = datagram.to {
            return batch.add(self.reached(to), bytes);
        }
        if let Err(cause) = socket.try_send_to(bytes, to) {
            tracing::debug!("a datagram to a CUCS was not sent: {cause}");
        }
    }
}

/// False if the socket has no room: the batch stays.
fn send_batch(batch: &mut Batch, socket: &UdpSocket, shared: &Shared) -> bool {
    let lost = || {
        let bridge = &mut shared.core.borrow_mut().bridge;
        bridge.count_dropped("not sent: the socket has no room");
    };
    batch.send(socket, shared.clock.mono(), lost)
}

/// True if the datagram is for a web client: it was queued, or the client is not connected.
fn pass_to_web(shared: &Shared, datagram: &Datagram) -> bool {
    let mut core = shared.core.borrow_mut();
    let Core { bridge, web, .. } = &mut *core;
    match bridge.web_way(datagram.destination()) {
        WebWay::Datagrams => return false,
        WebWay::Nowhere => {}
        WebWay::Connection(number) => {
            if let Err(why) = web.send(number, datagram.bytes()) {
                bridge.close_web(shared.clock.mono(), number, why);
            }
        }
    }
    true
}

/// Sends frames to other ground stations, last of all. A full socket loses them, as on any link.
fn send_forwards(shared: &Shared) {
    let mut core = shared.core.borrow_mut();
    while let Some((number, frame)) = core.bridge.poll_forward() {
        if let Some(open) = core.forwards.iter().find(|one| one.number == number)
            && let Err(cause) = open.writer.try_send(frame.bytes(), frame.to)
        {
            tracing::debug!("a frame to a ground station was not sent: {cause}");
        }
    }
}

/// Sends a frame to a vehicle; false if the line is gone for good.
fn send_frame(shared: &Shared, index: usize, frame: &OutFrame, writer: &VehicleWriter) -> bool {
    {
        let mut core = shared.core.borrow_mut();
        if let (Some(recording), Ok(view)) = (
            core.recordings.get_mut(index).and_then(Option::as_mut),
            FrameView::parse(frame.bytes()),
        ) {
            recording.write(shared.clock.now().wall, &view);
        }
        // After the recording, which must be readable without the link's keys.
        if core.encrypt(shared.clock.mono(), index, frame.to, frame.bytes()) {
            return true;
        }
    }
    write_bytes(frame.bytes(), frame.to, writer)
}

/// False if the line is gone for good.
fn write_bytes(bytes: &[u8], to: Peer, writer: &VehicleWriter) -> bool {
    match writer.try_send(bytes, to) {
        // The task that writes the serial port has ended, so this one ends too.
        Err(cause) if cause.kind() == io::ErrorKind::BrokenPipe => return false,
        Err(cause) => tracing::debug!("a frame to the vehicle was not sent: {cause}"),
        Ok(()) => {}
    }
    true
}

/// Applies changes that have waited for the disk.
pub(super) async fn take_stored(shared: Rc<Shared>, beat: Rc<Beat>) {
    loop {
        beat.during(shared.stored.notified()).await;
        shared.with(|core, now| {
            if core.store.poll() {
                core.bridge.handle_durable(now, &mut core.store);
            }
        });
    }
}

pub(super) async fn keep_time(shared: Rc<Shared>, beat: Rc<Beat>, timer: Timer) {
    let mut flush_at = Duration::ZERO;
    // A machine that is always due must not starve the sockets.
    let mut not_before = Duration::ZERO;
    loop {
        let now = shared.clock.mono();
        let due = shared.core.borrow_mut().poll_timeout(now);
        if due.max(not_before) <= now {
            shared.with(|Core { bridge, store, .. }, now| bridge.handle_timeout(now, store));
            if flush_at <= now {
                flush_at = now + FLUSH_EVERY;
                shared.core.borrow_mut().flush();
            }
            not_before = shared.clock.mono() + SHORTEST_WAIT;
            continue;
        }
        shared.alarm.set(due);
        let woken = beat
            .during(async {
                tokio::select! {
                    ended = timer.sleep(due.max(not_before) - now) => ended,
                    () = shared.alarm.earlier() => Ok(()),
                }
            })
            .await;
        if let Err(cause) = woken {
            pause_after("the timer", &cause).await;
        }
    }
}

/// Checks from time to time whether the group's datagrams arrive on another interface than the one that joined it.
pub(super) async fn watch_group(shared: Rc<Shared>, beat: Rc<Beat>, group: Group) {
    let mut pause = FIRST_WATCH;
    loop {
        beat.during(tokio::time::sleep(pause)).await;
        pause = WATCH_EVERY;
        match beat
            .during(listen_elsewhere(
                group.address,
                group.interface.as_ref(),
                WATCH_FOR,
            ))
            .await
        {
            Ok(None) => {}
            Ok(Some((at, from))) => shared.with(|core, now| {
                core.bridge.note_group_elsewhere(now.mono, at, from);
            }),
            Err(cause) => tracing::debug!("the interfaces cannot be listened on: {cause}"),
        }
    }
}

/// Looks whether the next start could read the key files: the bridge has the keys in memory, and works without; whether they
/// hold the keys that are in force; and at the room on the disk. It looks now and then, and soon after a key file has changed.
pub(super) async fn watch_files(shared: Rc<Shared>, beat: Rc<Beat>) {
    let changes = FileChanges::new();
    let named = || checks::named_files(&shared.core.borrow().config, None);
    let mut pause = FILES_EVERY;
    loop {
        let watched = named();
        let keys = watched.iter().filter(|file| file.is_key());
        changes.watch(keys.map(|file| file.path.as_path()));
        let has_changed = async {
            tokio::select! {
                () = tokio::time::sleep(pause) => false,
                () = changes.changed() => true,
            }
        };
        if beat.during(has_changed).await {
            // A key and the one before it are replaced one after the other.
            beat.during(tokio::time::sleep(FILES_SETTLED)).await;
        }
        pause = FILES_EVERY;
        let files = named();
        let (store, is_shared) = {
            let store = &shared.core.borrow().config.store;
            (store.dir.clone(), store.shared().is_some())
        };
        let now = shared.clock.now();
        let (sender, receiver) = oneshot::channel();
        let look = move || {
            let keys = checks::look_at_key_files(&files, now);
            drop(sender.send((keys, checks::look_at_store(&store, is_shared))));
        };
        // A file server may not answer. Not the runtime's own thread for such work: the end of the program would wait for it.
        let look = thread::Builder::new().name("files".to_owned()).spawn(look);
        if let Err(cause) = look {
            tracing::debug!("no thread to look at the files: {cause}");
            continue;
        }
        if let Ok((keys, store)) = beat.during(receiver).await
            && shared.with(|core, _| note_files(core, keys, store.as_ref()))
        {
            pause = FILES_AGAIN;
        }
    }
}

/// Returns whether something is wrong that the look before has not found: it counts once the next one finds it too.
fn note_files(core: &mut Core, keys: Keys, store: Option<&StoreFact>) -> bool {
    let Keys { mut faults, guards } = keys;
    let bridge = &mut core.bridge;
    let others = guards
        .into_iter()
        .filter(|(cucs, key, _)| !bridge.has_guard_key(*cucs, *key));
    faults.extend(others.map(|(cucs, key, path)| KeyFault {
        whose: format!("CUCS {cucs}"),
        why: format!(
            "its key file {} holds key {key}, which is not in force here: it was rotated or revoked since",
            path.display()
        ),
        reload: true,
    }));
    bridge.note_store(store);
    bridge.note_key_files(faults)
}

pub(super) async fn send_status(shared: Rc<Shared>, beat: Rc<Beat>, listener: UnixListener) {
    loop {
        match beat.during(listener.accept()).await {
            Ok((stream, _)) => {
                status_socket::answer(stream, &shared.status(), STATUS_WITHIN).await;
            }
            Err(cause) => pause_after("the status socket", &cause).await,
        }
    }
}

/// `vsm check-vehicle`: one request after the other, each as long as the vehicles take to answer.
pub(super) async fn send_settings(shared: Rc<Shared>, beat: Rc<Beat>, listener: UnixListener) {
    loop {
        let stream = match beat.during(listener.accept()).await {
            Ok((stream, _)) => stream,
            Err(cause) => {
                pause_after("the settings socket", &cause).await;
                continue;
            }
        };
        shared.with(|Core { bridge, store, .. }, now| bridge.read_settings(now, store));
        let end = shared.clock.mono() + SETTINGS_WITHIN;
        let settings = loop {
            let settings = shared.core.borrow().bridge.vehicle_settings();
            let reading = settings.iter().any(|vehicle| vehicle.reading);
            if !reading || shared.clock.mono() >= end {
                break settings;
            }
            beat.during(tokio::time::sleep(SETTINGS_EVERY)).await;
        };
        status_socket::answer(stream, &settings, STATUS_WITHIN).await;
    }
}

/// Logs an error and pauses, so that a socket that keeps failing does not flood the log or use a whole core.
pub(super) async fn pause_after(what: &str, cause: &io::Error) {
    tracing::warn!("{what}: {cause}");
    tokio::time::sleep(Duration::from_millis(500)).await;
}

/// The longest UDP datagram, so that one that is too long is counted and not cut off.
const LARGEST_DATAGRAM: usize = 65_536;
const FLUSH_EVERY: Duration = Duration::from_secs(1);
const SHORTEST_WAIT: Duration = Duration::from_millis(1);
/// Datagrams of a vehicle link that are handled before their effects: under a millisecond.
const AT_ONCE: u64 = 32;
/// Datagrams that are taken out of the DLI socket before the next is handled.
const MAX_EMPTIED: usize = 1_024;
/// How long the datagrams of the DLI socket are handled before others get their turn.
const TURN: Duration = Duration::from_micros(500);
/// A station sends a heartbeat each second or two.
const WATCH_FOR: Duration = Duration::from_secs(3);
const FIRST_WATCH: Duration = Duration::from_secs(2);
/// Shorter than evidence of the DLI side lasts, so that a finding stays active as long as its cause. Each check joins the
/// group on other interfaces, which adds traffic to their networks, so it is rare.
const WATCH_EVERY: Duration = Duration::from_secs(240);
const FILES_EVERY: Duration = Duration::from_secs(10);
/// After a change. With [`FILES_AGAIN`] a fault has an alert within two or three seconds.
const FILES_SETTLED: Duration = Duration::from_millis(300);
/// A file that is just being replaced is whole by then.
const FILES_AGAIN: Duration = Duration::from_secs(1);
const STATUS_WITHIN: Duration = Duration::from_secs(1);
/// How long the vehicles may take to answer about their settings: over a slow radio each takes a second or so.
const SETTINGS_WITHIN: Duration = Duration::from_secs(120);
const SETTINGS_EVERY: Duration = Duration::from_millis(50);
