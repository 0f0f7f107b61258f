//! The program `vsm` itself: its configuration, how it is begun, its demos, its reload, and whole flights between real
//! sockets, over a serial line and from a disk that is full or read-only.

mod as_root;
mod audit_command;
mod bad_sockets;
mod broken_tasks;
mod config_mistakes;
mod configuration;
mod dead_neighbour;
mod demo_attack;
mod demo_curves;
mod demo_fleet;
mod demo_payload;
mod demo_web;
mod demo_wings;
mod doctor;
mod every_subcommand;
mod files;
mod guard_on_a_slow_disk;
mod init;
mod logging;
mod many_vehicles;
mod memory_lock;
mod multicast;
mod reload;
mod reload_on_a_slow_disk;
mod serial_line;
mod small_disk;
mod under_attack;
mod waits;
mod web_control;
mod zeroize;
