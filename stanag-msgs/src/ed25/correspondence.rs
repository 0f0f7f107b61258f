//! Which place in Edition 2.5 corresponds to which in Edition 4, by the rows of both tables: sender and receiver of a
//! message, the messages and fields with the same content, and the parts of a plan.
//!
//! Both ends of the link need it that use Edition 2.5 on the wire and Edition 4 inside: a VSM and a ground station.
//! What the modes and demands of the editions mean (#41, #42, #43, #48) is not here: each end needs one direction of
//! it only.

use super::record::Record;
use super::table::{message, messages};
use super::wrapper::{Frame, Version};
use crate::enums::{LoiterDurationUnits, WaypointType};
use crate::id::Id;
use crate::table::{Direction, FieldInfo, Message, MessageInfo};

/// CUCS, vehicle and type of a message of Edition 2.5: what the wrapper of Edition 4 names.
#[derive(Debug, Clone, Copy)]
pub struct Parties {
    /// Field CUCS ID.
    pub cucs: Id,
    /// Field Vehicle ID; VSM ID where no vehicle is named.
    pub vehicle: Id,
    /// Its row; `None` where the table has no message of this type, or its data has another length.
    pub info: Option<&'static MessageInfo>,
}

/// Reads sender and receiver of a message: fields 2 and 3 of every message. `None` where the data ends before them.
#[must_use]
pub fn parties(frame: &Frame<'_>) -> Option<Parties> {
    let word = |at: usize| {
        let bytes = frame.data.get(at..at + 4)?;
        Some(Id(u32::from_be_bytes(bytes.try_into().ok()?)))
    };
    let (vehicle, cucs) = (word(8)?, word(12)?);
    let info = message(frame.header.message_type, frame.header.version)
        .filter(|info| info.full_bytes() == frame.data.len());
    let names_vsm = info.is_some_and(|info| {
        let fourth = info.fields.get(3);
        fourth.is_some_and(|field| field.name == "VSM ID")
    });
    // The text advises against a logical id of 0, so 0 names nobody.
    let vehicle = match vehicle {
        Id::NULL | Id(0) if names_vsm => word(16)?,
        vehicle => vehicle,
    };
    Some(Parties {
        cucs,
        vehicle,
        info,
    })
}

/// Where a message of Edition 4, or one field of it by its number from 1, is in Edition 2.5; 0 is the whole message.
pub fn places(
    ed4: u16,
    number: u8,
) -> impl Iterator<Item = (&'static MessageInfo, Option<&'static FieldInfo>)> {
    messages()
        .filter(move |info| info.ed4_messages.contains(&ed4))
        .flat_map(move |info| {
            let fields = info.fields.iter();
            let fields = fields.filter(move |field| field.ed4 == Some((ed4, number)));
            let whole = (number == 0).then_some((info, None));
            whole
                .into_iter()
                .chain(fields.map(move |field| (info, Some(field))))
        })
}

/// The messages that one end sends for one of Edition 4: those that have its Time Stamp, since one may become
/// several. `excluded` is the direction that is left out.
fn stamped_by(ed4: u16, excluded: Direction) -> impl Iterator<Item = u16> {
    messages()
        .filter(move |info| {
            let stamp = info.fields.first().and_then(|field| field.ed4);
            info.direction != excluded && stamp.is_some_and(|(of, _)| of == ed4)
        })
        .map(|info| info.id)
}

/// The messages of Edition 2.5 that a VSM sends for one of Edition 4.
pub fn reports_of(ed4: u16) -> impl Iterator<Item = u16> {
    stamped_by(ed4, Direction::ToVsm)
}

/// The messages of Edition 2.5 that a CUCS sends for one of Edition 4.
pub fn commands_of(ed4: u16) -> impl Iterator<Item = u16> {
    stamped_by(ed4, Direction::ToCucs)
}

/// The message of Edition 4 that corresponds to one of Edition 2.5 with this number.
#[must_use]
pub fn ed4_of(number: u32) -> Option<u16> {
    let info = message(number, Version::Ed25)?;
    info.ed4_messages.first().copied()
}

/// A part of a plan (13001 to 13004, 13006) as #801 to #804 or #806; `Ok(None)` for every other message.
///
/// Where a waypoint leads on contingency is left open (#802.13, #802.14): Edition 4 has routes for that.
///
/// # Errors
/// What of it Edition 2.5 cannot express: the end of a loop, or a loiter that does not end after whole seconds.
pub fn plan_record(part: &Message) -> Result<Option<Record>, String> {
    let ed4 = Record::of(part);
    let (number, route_type) = match part {
        // A route without a type is a flight route.
        Message::UaRoute(_) => (801, Some(FLIGHT)),
        Message::UaPositionWaypoint(waypoint) => {
            let normal = WaypointType::from_raw(0);
            if waypoint.waypoint_type.is_some_and(|kind| kind != normal) {
                let number = waypoint.waypoint_number.unwrap_or(0);
                return Err(format!(
                    "waypoint {number} ends a loop, which Edition 2.5 cannot name"
                ));
            }
            (802, None)
        }
        Message::UaLoiterWaypoint(loiter) => {
            let units = loiter.loiter_duration_units;
            let in_seconds = units.is_none_or(|units| units == LoiterDurationUnits::Seconds);
            // A duration of 0 is not a loiter in both editions.
            if loiter.loiter_duration != Some(0)
                && (!in_seconds || loiter.loiter_duration.is_none())
            {
                let number = loiter.waypoint_number.unwrap_or(0);
                return Err(format!(
                    "the loiter at waypoint {number} has no end in seconds, which Edition 2.5 cannot name"
                ));
            }
            (803, None)
        }
        Message::PayloadActionWaypoint(_) => (804, None),
        Message::VehicleSpecificWaypoint(_) => (806, None),
        _ => return Ok(None),
    };
    let mut record = Record::ed25(number);
    if let (Some(record), Some(kind)) = (&mut record, route_type) {
        record.set(6, kind);
    }
    if let Some(record) = &mut record {
        record.take_from(&ed4);
    }
    Ok(record)
}

/// Route Type of #801: a flight route.
const FLIGHT: u32 = 2;
