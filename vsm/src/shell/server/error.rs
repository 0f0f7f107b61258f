//! Why a bridge does not start.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use mavlink_link::provisioning::StartError as HandoverError;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;

use crate::config::TerrainFault;
use crate::session::{AccessError, BridgeError};
use crate::shell::disk::OpenError;
use crate::shell::key_file::KeyFileError;
use crate::shell::key_store::KeyStoreError;
use crate::shell::sockets::SocketError;
use crate::shell::web::TilesError;

/// A bridge that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// The thread that writes to the store.
    #[error("the [store] dir: {0}")]
    Writer(io::Error),
    /// The timer of what is due.
    #[error("no timer: {0}")]
    Timer(io::Error),
    /// The thread of the web clients.
    #[error("[web] control: no thread for its connections: {0}")]
    WebClients(io::Error),
    /// Elevation files.
    #[error(transparent)]
    Terrain(#[from] TerrainFault),
    /// A key.
    #[error(transparent)]
    Key(#[from] KeyFileError),
    /// The keys of a vehicle.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// Two vehicles' files hold one key: each link would count its stamps on its own.
    #[error(
        "vehicles {one} and {other} have the same key {key}: each vehicle needs a key of its own, see `vsm keygen`"
    )]
    SameKey {
        /// A vehicle.
        one: Id,
        /// Another.
        other: Id,
        /// The key's name.
        key: KeyId,
    },
    /// The key of another ground station also belongs to a vehicle, or to another ground station.
    #[error(
        "[[forward]] {name} has the key {key} of {other}: each needs a key of its own, see `vsm keygen`"
    )]
    ForwardKey {
        /// The ground station.
        name: String,
        /// The key's other owner.
        other: String,
        /// The key's name.
        key: KeyId,
    },
    /// The guard key of a CUCS has another owner too.
    #[error(
        "CUCS {station} has the guard key {key} of {other}: each needs a key of its own, see `vsm guard keygen`"
    )]
    GuardKey {
        /// The CUCS.
        station: Id,
        /// Who has it too.
        other: String,
        /// The key's name.
        key: KeyId,
    },
    /// The key of the access list has another owner too.
    #[error(
        "access.key_file has the key {key} of {other}: it needs a key of its own, see `vsm keygen`"
    )]
    AccessKey {
        /// Who has it too.
        other: String,
        /// The key's name.
        key: KeyId,
    },
    /// There is no access list.
    #[error("{0}")]
    Access(#[from] AccessError),
    /// An unfinished handover.
    #[error(transparent)]
    Handover(#[from] HandoverError),
    /// A socket.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// What was stored.
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    /// The recording.
    #[error("[record] dir {folder}: {cause}", folder = folder.display())]
    Recording {
        /// The folder.
        folder: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// The status page.
    #[error("cannot listen on http.listen = \"{address}\": {cause}")]
    Http {
        /// The address.
        address: SocketAddr,
        /// The system's reason.
        cause: io::Error,
    },
    /// The pictures under the map.
    #[error("[web] tiles {0}")]
    Tiles(#[from] TilesError),
    /// There is no key yet, and the exchange that would bring one needs a pairing.
    #[error("there is no key {path} yet: pair with the air-side agent by `vsm pair` first", path = path.display())]
    NotPaired {
        /// The key file.
        path: PathBuf,
    },
    /// A first key was made for the vehicle and never sent to it.
    #[error("the vehicle has never been sent its first key {path}.next: run `vsm key provision`", path = path.display())]
    NeverSent {
        /// The key file.
        path: PathBuf,
    },
    /// The clock of a key, or a record of the key exchange.
    #[error(transparent)]
    Record(#[from] mavlink_link::store::StoreError),
    /// No key can be made.
    #[error("the system has no random bytes: {0}")]
    Random(io::Error),
    /// The status socket.
    #[error("the status socket in the [store] dir: {0}")]
    Status(io::Error),
}
