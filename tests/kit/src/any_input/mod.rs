//! What has to hold for any bytes at all. Each target takes bytes and panics where a promise is broken.
//!
//! `vsm/tests/any_input` runs them on mutated seeds in every test run; `tests/fuzz` runs them with coverage as a guide.

pub mod access_list;
pub mod config;
pub mod dli;
pub mod encrypted_link;
pub mod frame;
pub mod ftp;
pub mod guard;
pub mod key_exchange;
pub mod route_file;
pub mod session;
pub mod web_frame;
