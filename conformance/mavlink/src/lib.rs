#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod autopilot;
pub mod bench;
pub mod catalogue;
pub mod passive;
mod program;
pub mod router;
pub mod runner;
pub mod scene;
pub mod station;
pub mod wire;

pub use program::{command, run};
