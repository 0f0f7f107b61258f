//! The sessions: sans-I/O machines that know time, and nothing of sockets, clocks or files.
//!
//! [`Bridge`] is the whole of it: datagrams of both sides and the time go in, datagrams and log entries come out.
//! What must survive a restart goes through the [`Store`] that is handed in, before it is answered.

mod aircraft;
mod alerts;
mod altimeter;
mod audit;
mod authority;
mod bridge;
mod ceiling;
mod configuration;
mod control;
mod control_loss;
mod counters;
mod custody;
mod desk;
mod detail;
mod duplicate;
mod engine;
mod handover;
mod key_agreement;
mod maneuver;
mod manual;
mod mission_transfer;
mod mode_command;
mod operating;
mod operator_control;
mod outbox;
mod plan_record;
mod push;
mod reporting;
mod settling;
mod station;
mod status;
mod steering;
mod store;
mod transfer;
mod vehicle;

pub(crate) use aircraft::link_alert_text;
pub use audit::{Broken, Chain, Entry, Verified};
pub use authority::{
    Access, Answer, Asker, Authority, CONSENT_WITHIN, CONTROL, Change, Circumstances, Decision,
    Ended, Handover, Outcome, Reason, Record, Refusal, Rights, Silence, Stage, Stations,
};
pub use bridge::{Bridge, BridgeError, LinkEnd, LogEntry, LogLevel, Tap};
pub(crate) use ceiling::Ceilings;
pub use counters::{ByType, Counters};
pub use key_agreement::{ExchangeNotice, ExchangeStatus};
pub use outbox::{Datagram, Destination};
pub use settling::KeyChange;
pub use status::{LinkStatus, StationStatus, Status, VehicleStatus};
pub(crate) use store::record_name;
pub use store::{Durability, Store, StoreError};
pub use vehicle::{OutFrame, Peer};
