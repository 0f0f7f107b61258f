//! The tasks around the machine: each moves bytes to or from it, or wakes it when it is due.
//!
//! None returns while the bridge serves, and each waits for its work within [`Beat::during`].

use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::time::Duration;

use mavlink_link::frame::FrameView;
use tokio::net::{UdpSocket, UnixListener};

use super::shared::{Core, Shared};
use crate::session::Destination;
use crate::shell::recording::Recording;
use crate::shell::sockets::{VehicleReader, VehicleWriter};
use crate::shell::status_socket;
use crate::shell::tasks::Beat;

pub(super) async fn receive_dli(shared: Rc<Shared>, beat: Rc<Beat>, socket: Rc<UdpSocket>) {
    let mut bytes = vec![0; LARGEST_DATAGRAM];
    let here = socket.local_addr();
    loop {
        match beat.during(socket.recv_from(&mut bytes)).await {
            Ok((length, from)) => shared.with(|core, now| {
                let bytes = bytes.get(..length).unwrap_or_default();
                if let (Some(recording), Ok(here)) = (&mut core.dli_recording, &here) {
                    recording.received(now.wall, from, *here, bytes);
                }
                core.bridge.handle_dli(now, from, bytes, &mut core.store);
            }),
            Err(cause) => pause_after("the DLI socket", &cause).await,
        }
    }
}

pub(super) async fn receive_vehicle(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    index: usize,
    mut reader: VehicleReader,
) {
    let mut bytes = vec![0; LARGEST_DATAGRAM];
    loop {
        match beat.during(reader.receive(&mut bytes)).await {
            Ok((length, from)) => shared.with(
                |Core {
                     bridge,
                     store,
                     recordings,
                     ..
                 },
                 now| {
                    let bytes = bytes.get(..length).unwrap_or_default();
                    let recording = recordings.get_mut(index).and_then(Option::as_mut);
                    let mut tap = recorder(recording, now.wall);
                    bridge.handle_vehicle(now, index, from, bytes, store, &mut tap);
                },
            ),
            Err(cause) => pause_after("a vehicle's link", &cause).await,
        }
    }
}

fn recorder(mut recording: Option<&mut Recording>, wall: Duration) -> impl FnMut(&FrameView<'_>) {
    move |frame| {
        if let Some(recording) = &mut recording {
            recording.write(wall, frame);
        }
    }
}

pub(super) async fn send(
    shared: Rc<Shared>,
    beat: Rc<Beat>,
    unicast: Rc<UdpSocket>,
    group: Option<(Rc<UdpSocket>, SocketAddr)>,
    mut writers: Vec<VehicleWriter>,
) {
    loop {
        beat.during(shared.outgoing.notified()).await;
        // Taken one by one: the machine is not held while the system takes its time.
        loop {
            let frame = shared.core.borrow_mut().bridge.poll_vehicle();
            let Some((index, frame)) = frame else { break };
            {
                let mut core = shared.core.borrow_mut();
                if let (Some(recording), Ok(view)) = (
                    core.recordings.get_mut(index).and_then(Option::as_mut),
                    FrameView::parse(frame.bytes()),
                ) {
                    recording.write(shared.clock.now().wall, &view);
                }
            }
            if let Some(writer) = writers.get_mut(index)
                && let Err(cause) = writer.send(frame.bytes(), frame.to).await
            {
                if cause.kind() == io::ErrorKind::BrokenPipe {
                    // The task that writes the serial port is gone: its end is ours, too.
                    return;
                }
                tracing::debug!("a frame to the vehicle was not sent: {cause}");
            }
        }
        loop {
            // Bound to a name so that the borrow of the core ends here, and not after the await below.
            let datagram = shared.core.borrow_mut().bridge.poll_dli();
            let Some(datagram) = datagram else { break };
            let (socket, to) = match (datagram.to, &group) {
                (Destination::Unicast(to), _) => (&unicast, to),
                (Destination::Multicast, Some((socket, group))) => (socket, *group),
                (Destination::Multicast, None) => continue,
            };
            if let Some(recording) = &mut shared.core.borrow_mut().dli_recording
                && let Ok(here) = socket.local_addr()
            {
                recording.sent(shared.clock.now().wall, here, to, datagram.bytes());
            }
            if let Err(cause) = socket.send_to(datagram.bytes(), to).await {
                tracing::debug!("a datagram to a CUCS was not sent: {cause}");
            }
        }
    }
}

pub(super) async fn keep_time(shared: Rc<Shared>, beat: Rc<Beat>) {
    let mut flush_at = Duration::ZERO;
    loop {
        // The borrow must end before the await below.
        let due = {
            let core = shared.core.borrow();
            core.poll_timeout(shared.clock.mono())
        };
        if due <= shared.clock.mono() {
            shared.with(|Core { bridge, store, .. }, now| bridge.handle_timeout(now, store));
            if flush_at <= shared.clock.mono() {
                flush_at = shared.clock.mono() + FLUSH_EVERY;
                shared.core.borrow_mut().flush();
            }
            // A machine that is due at once, always, must not starve the sockets.
            beat.during(tokio::time::sleep(SHORTEST_WAIT)).await;
            continue;
        }
        let due = tokio::time::sleep_until(shared.clock.instant(due).into());
        beat.during(async {
            tokio::select! {
                () = due => {}
                () = shared.timing.notified() => {}
            }
        })
        .await;
    }
}

pub(super) async fn tell_status(shared: Rc<Shared>, beat: Rc<Beat>, listener: UnixListener) {
    loop {
        match beat.during(listener.accept()).await {
            Ok((stream, _)) => {
                status_socket::answer(stream, &shared.status(), STATUS_WITHIN).await;
            }
            Err(cause) => pause_after("the status socket", &cause).await,
        }
    }
}

/// A socket that fails again and again is said once in a while, and takes no whole core.
async fn pause_after(what: &str, cause: &io::Error) {
    tracing::warn!("{what}: {cause}");
    tokio::time::sleep(Duration::from_millis(500)).await;
}

/// Longest datagram that UDP can carry: one that is too long is counted, not cut.
const LARGEST_DATAGRAM: usize = 65_536;
const FLUSH_EVERY: Duration = Duration::from_secs(1);
const SHORTEST_WAIT: Duration = Duration::from_millis(1);
const STATUS_WITHIN: Duration = Duration::from_secs(1);
