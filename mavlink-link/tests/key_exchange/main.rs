//! The key exchange: both ends driven against each other under a virtual clock, by an honest network, a bad one, dying
//! processes and attackers.

mod agreement;
mod attacks;
mod cost;
mod disks;
mod encrypted;
mod faults;
mod orders;
mod symbolic;
mod under_load;
mod world;
