//! One link between a station and a vehicle: frames, signatures, the clock, the peer lock, a change of its key, and the
//! client sides of PX4's services.

mod allocations;
mod c_library;
mod captures;
mod challenges;
mod copies;
mod every_clock_history;
mod every_frame;
mod histories;
mod link;
mod parser;
mod pitfalls;
mod rollover;
mod services;
mod support;
mod vectors;
