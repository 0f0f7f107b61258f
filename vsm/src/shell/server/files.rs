//! The bridge's end of `vsm files`.

use std::rc::Rc;
use std::time::Duration;

use mavlink_link::service::ftp::{Done, Failure, FilePath, Kind, MAX_WRITE, Operation, Resume};
use stanag_msgs::Id;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{UnixListener, UnixStream};

use super::shared::{Core, Shared};
use crate::session::{FileEvent, FileRefusal};
use crate::shell::files_socket::{Action, Entry, Reply, Request};
use crate::shell::tasks::Beat;

/// Serves one client at a time; further ones are refused, not kept waiting.
pub(super) async fn serve(shared: Rc<Shared>, beat: Rc<Beat>, listener: UnixListener) {
    let mut current = None;
    loop {
        let step = async {
            tokio::select! {
                accepted = listener.accept() => Some(accepted),
                () = async {
                    match current.as_mut() {
                        Some(job) => std::pin::Pin::as_mut(job).await,
                        None => std::future::pending().await,
                    }
                } => None,
            }
        };
        match beat.during(step).await {
            None => current = None,
            Some(Ok((stream, _))) if current.is_none() => {
                current = Some(Box::pin(answer(shared.clone(), stream)));
            }
            Some(Ok((mut stream, _))) => {
                refuse(
                    &mut stream,
                    "another file operation is under way on this bridge: wait until it ends",
                )
                .await;
            }
            Some(Err(cause)) => {
                tracing::warn!("the file socket: {cause}");
                beat.during(tokio::time::sleep(Duration::from_millis(500)))
                    .await;
            }
        }
    }
}

async fn answer(shared: Rc<Shared>, mut stream: UnixStream) {
    let read = tokio::time::timeout(REQUEST_WITHIN, read_request(&mut stream));
    let (vehicle, operation) = match read.await {
        Ok(Ok(request)) => request,
        Ok(Err(why)) => return refuse(&mut stream, &why).await,
        Err(_) => return,
    };
    let started = shared.with(|Core { bridge, store, .. }, now| {
        let vehicle = bridge.file_vehicle(vehicle)?;
        bridge.start_file(now, vehicle, operation, store)?;
        Ok::<Id, FileRefusal>(vehicle)
    });
    let vehicle = match started {
        Ok(vehicle) => vehicle,
        Err(why) => return refuse(&mut stream, &why.to_string()).await,
    };
    let ended = relay(&shared, vehicle, &mut stream).await;
    // The client has disconnected: nobody reads the events of the operation any more.
    if !ended {
        shared.with(|Core { bridge, store, .. }, now| {
            bridge.withdraw_file(now, vehicle, store);
            while bridge.poll_file(vehicle).is_some() {}
        });
    }
}

/// Passes on the events of the operation; returns whether it has ended.
async fn relay(shared: &Shared, vehicle: Id, stream: &mut UnixStream) -> bool {
    loop {
        let (is_there, event) = {
            let mut core = shared.core.borrow_mut();
            (
                core.bridge.has_vehicle(vehicle),
                core.bridge.poll_file(vehicle),
            )
        };
        if !is_there {
            refuse(stream, "vehicle was removed from the configuration").await;
            return true;
        }
        let Some(event) = event else {
            // A waiting client sends nothing, so anything readable means that it has disconnected.
            if stream.try_read(&mut [0]).is_ok() {
                return false;
            }
            tokio::time::sleep(LOOK_EVERY).await;
            continue;
        };
        let (reply, bytes) = match event {
            FileEvent::Opened(size) => (Reply::Opened(size), vec![]),
            FileEvent::Data(bytes) => (Reply::Data(bytes.len()), bytes),
            FileEvent::Written(bytes, of) => (Reply::Written(bytes, of), vec![]),
            FileEvent::Ended(Ok(done)) => (done_reply(done), vec![]),
            FileEvent::Ended(Err(why)) => {
                let anew = matches!(
                    why,
                    FileRefusal::Failed(Failure::Checksum { .. } | Failure::Changed { .. })
                );
                let why = why.to_string();
                (Reply::Refused { why, anew }, vec![])
            }
        };
        let last = matches!(
            reply,
            Reply::Listing(_) | Reply::Done { .. } | Reply::Refused { .. }
        );
        if !send(stream, &reply, &bytes).await {
            return last;
        }
        if last {
            return true;
        }
    }
}

fn done_reply(done: Done) -> Reply {
    match done {
        Done::Listing(entries) => Reply::Listing(
            entries
                .into_iter()
                .map(|entry| Entry {
                    name: entry.name,
                    size: match entry.kind {
                        Kind::File(size) => Some(size),
                        Kind::Directory => None,
                    },
                })
                .collect(),
        ),
        Done::Read { size, crc } | Done::Written { size, crc } => Reply::Done { size, crc },
        Done::Removed | Done::Created => Reply::Done { size: 0, crc: 0 },
    }
}

async fn read_request(stream: &mut UnixStream) -> Result<(Option<Id>, Operation), String> {
    // Bounded: a client that never ends its line cannot make the memory grow.
    let mut reader = tokio::io::BufReader::new(stream);
    let mut line = String::new();
    let read = (&mut reader).take(MAX_LINE).read_line(&mut line).await;
    read.map_err(|cause| format!("the request cannot be read: {cause}"))?;
    let request: Request = serde_json::from_str(&line)
        .map_err(|cause| format!("not a request of vsm files: {cause}"))?;
    let vehicle = request.vehicle.as_deref().map(|text| {
        let id = text.parse::<Id>();
        id.map_err(|_| format!("vehicle {text:?}: expected four bytes in hex such as 1b:00:01:01"))
    });
    let vehicle = vehicle.transpose()?;
    let path = FilePath::new(&request.path).map_err(|fault| fault.to_string())?;
    let operation = match request.action {
        Action::List => Operation::List(path),
        Action::Read { offset, crc } => {
            let resume = (offset > 0).then_some(Resume { offset, crc });
            Operation::Read { path, resume }
        }
        Action::Write { length } if length > MAX_WRITE => {
            return Err(format!(
                "a file of {length} bytes: expected at most {MAX_WRITE}"
            ));
        }
        Action::Write { length } => {
            // Bounded above: a client cannot make the bridge allocate more than a file may have.
            let mut content = vec![0; length];
            let read = reader.read_exact(&mut content).await;
            read.map_err(|cause| format!("the content was cut off: {cause}"))?;
            Operation::Write { path, content }
        }
        Action::Remove => Operation::Remove(path),
        Action::RemoveFolder => Operation::RemoveDirectory(path),
        Action::CreateFolder => Operation::CreateDirectory(path),
    };
    Ok((vehicle, operation))
}

async fn refuse(stream: &mut UnixStream, why: &str) {
    let why = why.to_owned();
    send(stream, &Reply::Refused { why, anew: false }, &[]).await;
}

/// Whether the client has received it.
async fn send(stream: &mut UnixStream, reply: &Reply, bytes: &[u8]) -> bool {
    let mut text = serde_json::to_vec(reply).unwrap_or_default();
    text.push(b'\n');
    text.extend_from_slice(bytes);
    let sent = tokio::time::timeout(TAKEN_WITHIN, stream.write_all(&text)).await;
    matches!(sent, Ok(Ok(())))
}

/// A path has at most 238 bytes, each of which JSON may write as six.
const MAX_LINE: u64 = 4_096;
const REQUEST_WITHIN: Duration = Duration::from_secs(10);
const TAKEN_WITHIN: Duration = Duration::from_secs(30);
const LOOK_EVERY: Duration = Duration::from_millis(2);
