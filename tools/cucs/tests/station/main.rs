//! The CUCS against a VSM made of the codec alone: as a machine under virtual time, as a station on a socket, and as a
//! program.

mod commands;
mod program;
mod reports;
mod retransmission;
mod route_files;
mod support;
