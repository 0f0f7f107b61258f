//! The configuration phase: what a CUCS must know of the vehicle to build its screens and commands, as the messages
//! 41000 to 41005, 43000, 43001 and 44003 that answer a 40000.
//!
//! - A field that can be used is answered by the message of its kind: 41000 for signed integers and angles, 41003 for
//!   unsigned ones, 41001 for floats, 41002 for enumerations, 41004 for texts. Values are in steps of the field on the
//!   wire, so that a command is built of them as they are; the help text says what one is, and where it is from.
//! - A field that is not used, a message that is not supported, and a value of an enumeration that is refused, are
//!   said by 44003: Reported Field 0 is the whole message, and an Enumerated Index is the value itself.
//! - Values of this VSM's own (modes, states) are described one by one by 41002.
//! - What is not known, such as home before the vehicle has told it, is absent.
//! - What a command of another station, or the vehicle itself, has set since is said by 44000 and 44002 ([`forced`]).

mod answer;
mod bounds;
pub mod forced;
pub mod modes;

mod request;

pub use bounds::{Bounds, bounds};

pub use request::{Level, Request, RequestError, Scope};

use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::{
    ConfigurationComplete, UaRouteConfiguration, VsmServicesReportMessage,
};
use stanag_msgs::table::{self, MessageInfo};
use stanag_msgs::{Id, Message, Text};

use crate::altitude::Agl;
use crate::limits::Limits;
use crate::parameter::Parameters;
use crate::plan::MAX_ROUTES;
use crate::support::{self, Received};
use crate::telemetry::Place;

/// What the vehicle is.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Of this VSM.
    pub vsm: Id,
    /// HEARTBEAT.type; 0 before it is heard.
    pub vehicle_type: u16,
    /// Whether it can stand still.
    pub hovers: bool,
    /// Once it has told one.
    pub home: Option<Place>,
    /// Bounds of routes.
    pub limits: Limits,
    /// Whether heights above home are flown.
    pub agl: Agl,
    /// Its own parameters, as far as they have been read.
    pub parameters: &'a Parameters,
    /// The status page, where one is served.
    pub web_page: Option<&'a str>,
}

/// The answers to a request, all without their stamps, the last a 41005.
#[must_use]
pub fn answers(subject: &Subject<'_>, request: &Request) -> Vec<Message> {
    let mut answers = Vec::new();
    match request.scope {
        Scope::Field { message, field } => {
            answer::field(subject, message, field, &mut answers);
        }
        Scope::Message(message) => answer::message(subject, message, &mut answers),
        Scope::Level(level) => {
            for message in table::MESSAGES.iter().filter(|info| level.has(info)) {
                answer::message(subject, message, &mut answers);
            }
            if level.is_status() {
                answers.push(services(subject));
            }
            if level.is_control() {
                answers.extend(routes(subject));
            }
        }
        Scope::Abort => {}
    }
    answers.push(Message::ConfigurationComplete(ConfigurationComplete {
        vsm_id: Some(subject.vsm),
        data_link_id: Some(Id::NULL),
        station_number_1_16: Some(0),
        vehicle_type: Some(subject.vehicle_type),
        vehicle_subtype: Some(0),
        ..ConfigurationComplete::default()
    }));
    answers
}

/// Whether any field of a message is used by this VSM, on receipt or in sending.
fn is_supported(message: &MessageInfo) -> bool {
    support::message(message.id).is_some_and(|row| !row.taken.is_empty() || !row.sends.is_empty())
}

/// Whether a field is used: acted on, or filled.
fn is_used(message: &'static MessageInfo, field: &table::FieldInfo) -> bool {
    let does = support::field(message, field);
    match does.received {
        Received::Honoured(_) => true,
        // Kept and given back on download is not used.
        Received::Ignored | Received::Refused => false,
        Received::Never => does.sent.is_some(),
    }
}

/// 43000.
fn services(subject: &Subject<'_>) -> Message {
    Message::VsmServicesReportMessage(VsmServicesReportMessage {
        vsm_home_web_page_url: Some(Text::new(subject.web_page.unwrap_or(""))),
        ftp_url: Some(Text::new("")),
        ..VsmServicesReportMessage::default()
    })
}

/// 43001, one a route type.
fn routes(subject: &Subject<'_>) -> impl Iterator<Item = Message> {
    let waypoints = u16::try_from(subject.limits.items).unwrap_or(u16::MAX);
    [
        RouteType::Launch,
        RouteType::Approach,
        RouteType::Flight,
        RouteType::ContingencyA,
        RouteType::ContingencyB,
    ]
    .map(|route_type| {
        Message::UaRouteConfiguration(UaRouteConfiguration {
            route_type: Some(route_type),
            instances: Some(u8::try_from(MAX_ROUTES).unwrap_or(u8::MAX)),
            maximum_number_of_waypoints: Some(waypoints),
            location_type_support: Some(ABSOLUTE_ONLY),
            ..UaRouteConfiguration::default()
        })
    })
    .into_iter()
}

/// Location Type Support: no source gives its values; this is the one Location Type that is flown.
const ABSOLUTE_ONLY: u8 = 0;

#[cfg(test)]
mod tests;
