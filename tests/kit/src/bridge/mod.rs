//! The bridge between simulated vehicles and ground stations, in one process under a virtual clock. No socket, no thread,
//! no wall clock: the same seed gives the same history.
//!
//! - [`Rig`]: the bridge with its vehicles (`px4-sim`) and stations; both links can be as bad as [`Faults`] describes, bridge
//!   and vehicles can be restarted at any moment, and the disk can be full
//! - [`Station`]: a ground station that records everything that it receives
//! - [`StationGuard`]: the guard beside a station that the configuration gives one
//! - [`WebParty`]: the connection of a station that is a web client
//! - [`orders`]: the messages that a station sends
//! - [`flight`]: a whole flight, the same in a [`Rig`] and between processes
//! - [`Processes`]: `vsm run` between real sockets or on a serial line, in real time
//! - [`parties`]: ids, addresses and keys of all of them
//!
//! ```
//! use kit::bridge::{Rig, orders};
//!
//! let mut rig = Rig::ready();
//! rig.done(orders::launch(20.0));
//! assert!(rig.until(30.0, |rig| !rig.truth().landed));
//! ```

pub mod flight;
pub mod orders;
pub mod parties;

mod guard;
mod real_time;
mod rig;
mod station;
mod web;

pub use crate::network::Faults;
pub use guard::{StationGuard, access_key, guard_key};
pub use parties::{VSM, bridge_mav, cucs, key, station_address, vehicle_address, vehicle_id};
pub use real_time::{Processes, memory_folder};
pub use rig::{FORWARD_KEYS, Restart, Rig, Setup};
pub use station::{Station, Ticket};
pub use web::WebParty;
