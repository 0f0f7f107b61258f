//! The vehicle's ends of the MAVLink services: what PX4 v1.18 answers on the wire.
//!
//! The ground station's ends are in `mavlink_link::service`; the tests run both ends against each other over a bad network.
//! - [`mission`]: stores missions, fences and rally points, and gives them back;
//! - [`mission_rules`]: which items PX4 accepts, and which parameters of a command it uses;
//! - [`param`]: lists, reads and sets parameters.

#![allow(
    deprecated,
    reason = "PX4 still sends and takes MISSION_REQUEST and MISSION_ITEM"
)]

pub mod mission;
pub mod mission_rules;
pub mod param;
