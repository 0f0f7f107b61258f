//! The rollover of a key: each step, and every history of one or two faults, against a vehicle that does with
//! SETUP_SIGNING what PX4 was seen to do.

mod clocks;
mod faults;
mod px4;
mod steps;
mod strangers;
mod world;
