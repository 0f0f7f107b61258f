//! A simulated PX4 and a CUCS: what the demo, the tests and users without either stand on.

pub mod cucs;
pub mod px4;
