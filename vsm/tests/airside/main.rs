//! The air-side agent between a simulated PX4 and a ground that signs (`world`): as a relay, as PX4's key store,
//! and with wall clocks that are wrong (`chain` is the whole way from a station, `radio` an encrypted link in it,
//! `clock_model` walks every short history).

mod chain;
mod clock_model;
mod clocks;
mod contingency;
mod encrypted_radio;
mod provisioning;
mod radio;
mod relay;
mod under_attack;
mod world;
mod zeroize;
