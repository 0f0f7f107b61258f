//! The programs of this project together, each as a process of its own: the air-side agent, its encrypted link, three ground stations, a
//! guard, a planned route, and what outlives the end of a process.

mod airside;
mod encrypted;
mod field;
mod fleet;
mod guard;
mod guard_pairing;
mod handover;
mod kills;
mod planned_route;
mod survives;
mod without_ground;
