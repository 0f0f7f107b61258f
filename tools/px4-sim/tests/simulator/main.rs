//! The simulated PX4: its services with their clients (`services`), and the vehicle as a ground station sees it
//! (`vehicle`).

mod services;
mod vehicle;
