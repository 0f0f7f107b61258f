//! The key commands and what the status page says of keys, on the program itself with a simulated vehicle.

#[path = "../program_support/mod.rs"]
mod program_support;

mod commands;
mod ground;
mod strangers;
mod unfinished;
