//! The facts, one row a message, in groups and in the order of their types.

mod command;
mod configuration;
mod flight_status;
mod handover;
mod held;
mod mission;
mod payload;
mod private;
mod services;
mod video;
mod zeroize;

use super::row::MessageSupport;

/// Every message that this VSM takes or sends, by groups in the order of their types.
pub(super) static SUPPORT: &[&[MessageSupport]] = &[
    command::ROWS,
    flight_status::ROWS,
    mission::ROWS,
    services::ROWS,
    payload::ROWS,
    handover::ROWS,
    configuration::ROWS,
    private::ROWS,
    held::ROWS,
    zeroize::ROWS,
    video::ROWS,
];
