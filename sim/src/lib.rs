//! A simulated PX4 and a CUCS.
