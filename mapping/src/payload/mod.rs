//! Payload stations: gimbals and cameras of MAVLink as the payload stations of STANAG 4586.
//!
//! - [`state`]: what gimbals and cameras have reported, and the stations that result.
//! - [`pointing`]: where a sensor looks: its direction in the frames of both standards, and its footprint on the ground.
//! - [`report`]: messages 21000, 21100, 21101 and 50025 from that.
//! - [`waypoint`]: what a 13004 requests of a station at a waypoint.
//!
//! A station is a gimbal, a camera or both. Without a configuration a station has the number of its device among the
//! component ids of MAVLink: camera 100 or gimbal 154 is station 1, camera 101 or gimbal 171 is station 2. If the number
//! depended on the order in which devices report, a restart could give a station to another operator.

pub mod pointing;
pub mod report;
pub mod state;
pub mod waypoint;

pub use pointing::{Direction, Footprint};
pub use state::{Camera, Equipment, Gimbal, Payloads, StreamInformation};
