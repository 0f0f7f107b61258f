//! The facts, one row for each message, in groups by rising type.

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

/// Every message that this VSM accepts or sends, in groups by rising type.
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
