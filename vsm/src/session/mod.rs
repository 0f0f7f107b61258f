//! The sessions: sans-I/O state machines. They are given the time, and know no sockets, clocks or files.
//!
//! [`Bridge`] combines them: datagrams of both sides and the time go in, datagrams and log entries come out. What must
//! survive a restart is written to the [`Disk`](mavlink_link::store::Disk) that the caller passes in, before it is answered.
//!
//! A CUCS requests control and gets its answer before any data of the vehicle arrives:
//!
//! ```
//! use std::net::SocketAddr;
//! use std::time::Duration;
//!
//! use mavlink_link::Now;
//! use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
//! use stanag_msgs::messages::CucsAuthorisationRequest;
//! use stanag_msgs::{Envelope, Id, Message, TimeStamp};
//! use vsm::config::Config;
//! use mavlink_link::store::MemoryDisk;
//! use vsm::session::{Bridge, LinkEnd};
//!
//! let text = r#"
//!     [dli]
//!     vsm_id = "1b:00:00:01"
//!     listen = "127.0.0.1:4586"
//!     [[cucs]]
//!     id = "1b:00:00:a0"
//!     loi = [2, 3, 4, 5]
//!     address = "127.0.0.1" # without it the address must prove itself first
//!     [[vehicle]]
//!     id = "1b:00:01:01"
//!     link = "udpin:127.0.0.1:14550"
//!     system_id = 1
//!     signing = "off"
//!     [store]
//!     dir = "state"
//! "#;
//! let config = Config::parse(text, std::path::Path::new("."))?;
//! let now = Now { mono: Duration::ZERO, wall: Duration::from_secs(1_795_219_200) };
//! let (mut store, end) = (MemoryDisk::default(), LinkEnd { key: None, peer: None });
//! let mut bridge = Bridge::new(&config, vec![end], now, Duration::ZERO, &mut store)?;
//!
//! let (cucs, vehicle) = (Id(0x1b00_00a0), Id(0x1b00_0101));
//! let request = CucsAuthorisationRequest {
//!     time_stamp: Some(TimeStamp(848_534_400_000)), // needed by whatever commands
//!     requested_handover_loi: Some(LoiBitmap::from_raw(0x0d)), // LOI 2, 4 and 5
//!     requested_handover_access: Some(RequestedAccess::Request),
//!     ..CucsAuthorisationRequest::default()
//! };
//! let mut bytes = [0; stanag_msgs::MAX_DATAGRAM];
//! let length = Message::from(request).encode(&Envelope::new(cucs, vehicle), &mut bytes)?;
//! let from: SocketAddr = "127.0.0.1:40000".parse()?;
//! bridge.handle_dli(now, from, &bytes[..length], &mut store);
//!
//! let mut granted = None;
//! while let Some(answer) = bridge.poll_dli() {
//!     for frame in stanag_msgs::frames(answer.bytes()) {
//!         let frame = frame?;
//!         if let Message::VsmAuthorisationResponse(response) =
//!             Message::decode(frame.header.message_type, frame.data)?
//!         {
//!             granted = response.loi_granted;
//!         }
//!     }
//! }
//! assert_eq!(granted, Some(LoiBitmap::from_raw(0x0d)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod access;
mod aircraft;
pub(crate) mod alerts;
mod allowance;
mod authority;
mod bridge;
mod clock_offset;
mod context;
pub(crate) mod contingency;
mod counters;
mod dates;
mod duplicates;
mod editions;
mod effects;
mod files;
pub mod findings;
mod fleet;
mod flight;
mod forward;
mod guard;
mod held;
mod ignored_fields;
mod limits;
mod link;
mod log;
mod logical;
pub(crate) mod maneuver;
mod metadata;
mod mission;
pub(crate) mod other;
mod outbox;
mod paths;
mod payload;
pub mod replay;
mod reports;
mod station;
mod station_profile;
pub(crate) mod store;
mod termination;
#[cfg(test)]
mod testing;
pub(crate) mod trace;
pub(crate) mod trigger;
pub(crate) mod turns;
mod two_steps;
mod vehicle_pattern;
pub mod web;
mod zeroize;

pub(crate) use access::examine as examine_access;
pub use access::{
    AccessEntry, AccessError, AccessKey, AccessList, AccessStatus, Group as AccessGroup, ListError,
    MAX_LIST_BYTES, PreparedAccess, RenewError, UnknownGroup, parse_until,
};
pub(crate) use authority::audit::AUDIT_KEY;
pub use authority::audit::{AuditKey, Broken, Chain, Entry, Verified};
pub(crate) use authority::record::examine as examine_audit;
pub use authority::rules::{
    Access, Answer, Asker, Authority, CONSENT_WITHIN, CONTROL, Change, Circumstances, Decision,
    Ended, GUARDED_RANK, Handover, Outcome, Reason, Record, Refusal, Rights, Silence, Stage,
    Stations,
};
pub(crate) use authority::trail::{Kind as AuditKind, MAX_LOG_BYTES, read_log};
pub use bridge::map::{AreaMap, FenceMap, PlaceMap, RouteMap, VehicleMap, WaypointMap};
pub use bridge::status::{LATELY, LinkStatus, Logged, StationStatus, Status, VehicleStatus};
pub use bridge::{
    Bridge, BridgeError, DliSender, HostClocks, LinkEnd, PreparedForwards, Tap, WebOpened, WebWay,
    link_config,
};
pub use counters::{ByType, Counters};
pub use files::{FileEvent, FileRefusal};
pub use findings::vehicle::EncryptedArrivals;
pub use forward::ForwardStatus;
pub use guard::{GroupReceiver, GuardEnd, GuardKeyUntil, GuardRefusal, GuardStatus, SealError};
pub use link::encryption_status::EncryptionStatus;
pub(crate) use link::frame::computer_of;
pub use link::frame::{OutFrame, Peer};
pub use link::key_agreement::{ExchangeNotice, ExchangeStatus};
pub use link::key_recovery::KeyChange;
pub(crate) use link::state::SILENCE;
pub(crate) use link::{alert_text as link_alert_text, link_state_name};
pub use log::{LogEntry, LogLevel};
pub use outbox::{Datagram, Destination};
pub use reports::VehicleSettings;
pub use store::Boot;
pub(crate) use store::vehicle_record;
pub use vehicle_pattern::VehiclePattern;
