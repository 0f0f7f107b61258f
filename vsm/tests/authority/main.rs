//! Who may command a vehicle: the authority machine by itself (`model`, checked over every state and over long random
//! histories), and in the bridge with three ground stations (`scene`).

mod audit_log;
mod every_state;
mod handover;
mod histories;
mod interleaved_uploads;
mod lossy_links;
mod model;
mod release;
mod scene;
mod slow_disk;
