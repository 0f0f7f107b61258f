//! The simulated PX4 as a ground station sees it: in virtual time, against recordings of the real one, and as a program.

mod boot;
mod commands;
mod determinism;
mod failsafes;
mod fixed_wing;
mod mission;
mod modes;
mod plan_checks;
mod program;
mod recordings;
mod reports;
mod reupload;
mod signing;
mod support;
mod wings;
