//! The facts, one row a message, in groups and in the order of their types.

mod configuration;
mod flight_command;
mod flight_status;
mod mission;
mod private;
mod services;
mod system_id;
mod vehicle_services;

use super::MessageSupport;

/// Every message that this VSM takes or sends, by groups in the order of their types.
pub static SUPPORT: &[&[MessageSupport]] = &[
    system_id::ROWS,
    flight_command::ROWS,
    flight_status::ROWS,
    mission::ROWS,
    services::ROWS,
    configuration::ROWS,
    private::ROWS,
    vehicle_services::ROWS,
];

const STAMP: &str = "rises strictly";
const HEARD_STAMP: &str = "tells a duplicate, and is returned in 17000";
const NULL_LINK: &str = "the null id: data links are the link's own matter";
const ECHO: &str = "returned in 2";
const AS_RECEIVED: &str = "as it was received";
