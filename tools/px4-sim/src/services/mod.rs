//! PX4's side of the MAVLink services: what v1.18 answers on the wire, each a state machine without socket or clock.
//!
//! The ground station's ends are in `mavlink_link::service`; the tests run both ends against each other over a bad
//! network.
//!
//! - [`mission_rules`]: which items PX4 accepts, and which parameters of a command it uses;
//! - [`mission`]: stores missions, fences and rally points, and sends them back;
//! - `events`: EVENT beside the texts, and what each means;
//! - `metadata`: what its events and parameters mean, among its files;
//! - [`ftp`]: lists, reads and writes the [`files`] of its card;
//! - [`param`]: lists, reads and sets parameters;
//! - `streams`: which messages go out unrequested, and how often;
//! - `texts`: the queue of STATUSTEXT.

#![allow(
    deprecated,
    reason = "PX4 still sends and takes MISSION_REQUEST and MISSION_ITEM"
)]

pub(crate) mod events;
pub mod files;
pub mod ftp;
pub(crate) mod metadata;
pub mod mission;
pub mod mission_rules;
pub mod param;
pub(crate) mod streams;
pub(crate) mod texts;
