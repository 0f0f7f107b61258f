//! What has to hold for any bytes at all. Each target takes bytes and panics where a promise is broken.
//!
//! `vsm/tests/any_input` runs them on mutated seeds in every test run; `tests/fuzz` runs them with coverage as a guide.

pub mod access_list;
pub mod config;
pub mod frame;
pub mod ftp;
pub mod route_file;
pub mod session;
pub mod web_frame;
