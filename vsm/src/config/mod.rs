//! The configuration files: every key, its default, its range, and errors that name line, key and expectation.
//!
//! Parsing ends in values that cannot be illegal: identification numbers are [`Id`](stanag_msgs::Id)s, links and
//! addresses are parsed, relative paths are resolved against the folder of the file. Unknown keys are refused.
//!
//! In this order: `key` declares a table once for parser and reference; `value` parses what is more than text or a number;
//! `disputed`, `station`, `vehicle` and `bridge` are the tables of `vsm.toml` from the inside out, with the checks of
//! ranges and of relations between keys. `forward` holds other ground stations, `payload` payload stations, `rally` places
//! to return to, `counted` the vehicles of a table with `count`, `controls` the parameters that a CUCS may set, `terrain` the elevation files, `termination` the action of
//! a commanded flight termination, `zeroize` what a zeroize erases, `access` the name of the access list, `web` the
//! stations of the page. `explain` explains errors; `changes` decides what a reload changes; [`airside`] is `airside.toml`,
//! and `agent_contingency` a table of it; `stored` is what a file has of its store, also where the rest is wrong; `named_file` opens the files; [`reference`](mod@reference) writes `docs/reference/configuration.md`.
//!
//! ```
//! use vsm::config::Config;
//!
//! let text = "
//!     [dli]
//!     vsm_id = \"1b:00:00:01\"
//!     listen = \"127.0.0.1:4586\"
//!     [store]
//!     dir = \"state\"
//! ";
//! let config = Config::parse(text, std::path::Path::new("/etc/vsm"))?;
//! assert_eq!(config.store.dir.to_str(), Some("/etc/vsm/state"));
//! # Ok::<(), vsm::config::ConfigError>(())
//! ```

mod access;
mod agent_contingency;
pub mod airside;
mod bridge;
mod changes;
mod contingency;
mod controls;
mod counted;
mod disputed;
mod error;
mod explain;
mod forward;
mod key;
mod named_file;
mod payload;
mod rally;
pub mod reference;
mod station;
mod stored;
mod termination;
mod terrain;
mod value;
mod vehicle;
mod web;
mod zeroize;

pub use access::Access;
pub use agent_contingency::AgentContingency;
pub use bridge::{Authority, Config, Dli, Mavlink, Record, SharedStore, Store};
pub use changes::{Changes, Report};
pub use contingency::{Contingency, ContingencyAction};
pub use controls::Controls;
pub use disputed::Readings;
pub use error::ConfigError;
pub use explain::line_in;
pub use forward::{Commands, Forward, ForwardLink, Relay};
pub(crate) use named_file::{open_at_once, open_file};
pub use payload::Payload;
pub use rally::Rally;
pub use station::{Checksum, Cucs, Delivery, Edition, Guard, Presence};
pub use stored::Stored;
pub use termination::{Termination, TerminationAction};
pub use terrain::{TerrainFault, TerrainFolder};
pub use value::{
    Exchange, ExchangeMode, LinkAddress, LoiSet, OnLoss, Provisional, Signing, StoreKind,
    owner_name,
};
pub use vehicle::{
    Agl, Area, Curve, CurveMode, CurvePolicy, CurveVertices, Keep, Landing, Limits, Outside,
    Vehicle,
};
pub use web::{Http, Web};
pub use zeroize::Zeroize;
