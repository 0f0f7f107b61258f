//! The CUCS against a VSM that is built on the codec alone: as a state machine under virtual time, as a station on a
//! socket, and as a program.

mod commands;
mod program;
mod reports;
mod retransmission;
mod route_files;
mod support;
