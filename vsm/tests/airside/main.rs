//! The air-side agent between a simulated PX4 and a ground that signs (`world`): as a relay, and as PX4's key store.

mod provisioning;
mod relay;
mod world;
