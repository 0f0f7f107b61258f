#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

#[cfg(test)]
mod bad_subjects;
pub mod bench;
mod beside;
pub mod catalogue;
pub mod cucs;
pub mod expected;
pub mod means;
pub mod outcome;
pub mod passive;
pub mod profile;
mod program;
pub mod report;
pub mod rules;
pub mod runner;
pub mod scripted;
pub mod verdict;
pub mod wire;

pub use program::{command, run};
