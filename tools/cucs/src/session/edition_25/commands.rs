//! Sending: a message of Edition 4 as the messages of Edition 2.5 with the same meaning.
//!
//! A message whose fields all have a place is translated by the table. A mode with its demands is not: Edition 4 has
//! a single 2016, Edition 2.5 has #42 for the mode, #43 for the demands, and #48 for which of the two overrides the
//! other (tables B1-22 and B1-23). A field with a value other than 0 and without a place is never left out: the
//! message is not sent.

use stanag_msgs::ed25::{self, Record};
use stanag_msgs::messages::{
    FieldConfigurationRequest, LoiterConfiguration, PositiveHandoverAuthorisationRequest,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Id, Message};

use super::payload::Payloads;
use super::places::{NoCounterpart, all_placed, empty};

/// Commands to and reports of one vehicle, as far as later commands depend on them.
#[derive(Clone, Debug, Default)]
pub(super) struct Steering {
    /// The last #48: what overrides altitude, speed, course and heading.
    preference: [u8; 3],
    /// Altitude and its type (4000).
    altitude: Option<(f64, u8)>,
    pub(super) payloads: Payloads,
}

impl Steering {
    /// Notes a report of the vehicle.
    pub(super) fn note(&mut self, message: &Message) {
        if let Message::InertialStates(states) = message
            && let (Some(altitude), Some(datum)) = (states.altitude, states.altitude_type)
        {
            self.altitude = Some((altitude.si(), datum.raw()));
        }
        if let Message::EoIrLaserOperatingState(state) = message {
            self.payloads.note(state);
        }
    }
}

/// The messages with this meaning, in order; none where Edition 2.5 does not need it.
pub(super) fn records(
    own: Id,
    steering: &mut Steering,
    message: &Message,
) -> Result<Vec<Record>, NoCounterpart> {
    let ed4 = Record::of(message);
    match message {
        // Editions before the third have no heartbeats, and the border sends acknowledgements itself.
        Message::Heartbeat(_) | Message::MessageAcknowledgement(_) => Ok(Vec::new()),
        Message::VehicleOperatingModeCommand(_) => steering.mode(&ed4),
        Message::LoiterConfiguration(_) => {
            let mut record = placed(41, &ed4)?;
            // #41 always has an altitude, so one is needed. It overrides in mode 12 only where #48 allows it, which
            // this CUCS never does.
            let Some((metres, datum)) = steering.altitude else {
                let why = "#41 names an altitude, and the vehicle has reported none yet (#101)";
                return Err(NoCounterpart(why.to_owned()));
            };
            record.set(9, metres);
            record.set(10, datum);
            Ok(vec![record])
        }
        Message::UaRoute(_) | Message::UaPositionWaypoint(_) | Message::UaLoiterWaypoint(_) => {
            let record = ed25::plan_record(message).map_err(NoCounterpart)?;
            let record = record.ok_or_else(|| no_place(&ed4))?;
            let number = record.id();
            all_placed(&[number], &ed4)?;
            Ok(vec![record])
        }
        Message::PayloadSteeringCommand(_) => Ok(vec![steering.payloads.steering(&ed4)?]),
        Message::EoIrLaserPayloadCommand(_) => Ok(vec![steering.payloads.sensor(&ed4)?]),
        Message::PositiveHandoverAuthorisationRequest(wish) => Ok(vec![handover(own, wish)?]),
        Message::MissionTransferCommand(_) => {
            let mut transfer = ed4;
            // A mission is loaded as a whole: the type of a route decides whether it is flown.
            if transfer.whole(3) == LOAD {
                transfer.clear(ROUTE_ID);
            }
            Ok(vec![placed(800, &transfer)?])
        }
        Message::ScheduleMessageUpdateCommand(_) => named(1402, &ed4, 4),
        Message::GenericInformationRequestMessage(_) => named(1403, &ed4, 7),
        Message::FieldConfigurationRequest(request) => {
            let mut record = placed(1200, &ed4)?;
            let message = request.requested_message.unwrap_or(0);
            if message != 0 {
                let field = request.requested_field.unwrap_or(0);
                let place = u16::try_from(message).ok();
                let place = place.and_then(|message| ed25::places(message, field).next());
                let (info, field) = place.ok_or_else(|| {
                    NoCounterpart(format!("field {field} of message {message} has no place"))
                })?;
                record.set(7, u32::from(info.id));
                record.set(8, field.map_or(0, |field| field.bit + 1));
            }
            Ok(vec![record])
        }
        _ => {
            let number = ed25::commands_of(ed4.id()).next();
            Ok(vec![placed(number.ok_or_else(|| no_place(&ed4))?, &ed4)?])
        }
    }
}

impl Steering {
    fn mode(&mut self, ed4: &Record) -> Result<Vec<Record>, NoCounterpart> {
        all_placed(&[42, 43], ed4)?;
        let mode = ed4.number(2).map(|mode| mode as u8);
        if let Some(mode @ (2 | 23..)) = mode {
            let why = format!("flight path control mode {mode} is flown by nothing that it has");
            return Err(NoCounterpart(why));
        }
        let commanded = [
            ed4.whole(3) != 0,
            ed4.number(13).is_some(),
            ed4.whole(6) != 0 || ed4.number(18).is_some(),
        ];
        let demands =
            commanded.contains(&true) || [15, 16].iter().any(|field| ed4.number(*field).is_some());
        self.preference = match mode {
            Some(WAYPOINT) => commanded.map(|one| if one { MANUAL } else { CONFIGURATION }),
            // What is not commanded must stay unchanged, but #41 would command its altitude.
            Some(LOITER) => [MANUAL; 3],
            None => {
                let mut kept = self.preference;
                for (kept, commanded) in kept.iter_mut().zip(commanded) {
                    if commanded {
                        *kept = MANUAL;
                    }
                }
                kept
            }
            Some(_) => self.preference,
        };
        let mut preference = empty(48)?;
        for (field, value) in (4..).zip(self.preference) {
            preference.set(field, value);
        }
        let mut command = empty(42)?;
        if let Some(mode) = mode {
            command.set(4, mode);
        }
        let mut demand = empty(43)?;
        demand.take_from(ed4);
        if demand.number(15).is_none() {
            demand.set(15, NO_WAYPOINT);
        }
        // A waypoint takes effect only where it differs from that of the #43 before.
        let mut neutral = empty(43)?;
        neutral.set(15, NO_WAYPOINT);
        let names_waypoint = ed4.number(15).is_some();
        let mut all = Vec::new();
        match mode {
            None => all.extend([preference, demand]),
            // The demand is sent after its mode: before it, it would steer in the present mode.
            Some(WAYPOINT | LOITER | AUTOPILOT) => {
                if mode != Some(AUTOPILOT) {
                    all.push(preference);
                }
                if names_waypoint {
                    all.push(neutral);
                }
                all.push(command);
                if demands {
                    all.push(demand);
                }
            }
            // Other modes begin with values sent before them, such as the altitude of a launch.
            Some(_) => {
                if demands {
                    all.push(demand);
                }
                all.push(command);
            }
        }
        Ok(all)
    }
}

/// Message 4: a request is a #1 that waits for coordination by the holder; the holder consents by #600.
fn handover(own: Id, wish: &PositiveHandoverAuthorisationRequest) -> Result<Record, NoCounterpart> {
    let levels = wish.requested_handover_loi.unwrap_or_default();
    let acquirer = wish.requesting_cucs_id.unwrap_or(own);
    if levels.is_empty() {
        let why = "a handover is refused or withdrawn by silence";
        return Err(NoCounterpart(why.to_owned()));
    }
    if acquirer != own {
        let mut record = empty(600)?;
        record.set(4, Id::NULL.0);
        record.set(5, acquirer.0);
        return Ok(record);
    }
    let mut record = empty(1)?;
    record.set(4, wish.vsm_id.unwrap_or(Id::BROADCAST).0);
    record.set(5, Id::NULL.0);
    record.set(8, levels.raw());
    record.set(10, REQUEST_CONTROL);
    record.set(11, WAIT_FOR_COORDINATION);
    Ok(record)
}

/// A message that names another message in this field.
fn named(number: u16, ed4: &Record, field: u8) -> Result<Vec<Record>, NoCounterpart> {
    let mut record = placed(number, ed4)?;
    let of = u16::try_from(record.whole(field)).unwrap_or(0);
    let report = ed25::reports_of(of).next();
    let report = report.ok_or_else(|| NoCounterpart(format!("it has no message for {of}")))?;
    record.set(field, report);
    Ok(vec![record])
}

/// Translates a message by the places of the table.
fn placed(number: u16, ed4: &Record) -> Result<Record, NoCounterpart> {
    all_placed(&[number], ed4)?;
    let mut record = empty(number)?;
    record.take_from(ed4);
    Ok(record)
}

fn no_place(ed4: &Record) -> NoCounterpart {
    NoCounterpart(format!("message {} has no counterpart", ed4.id()))
}

/// The message of Edition 4 to which a message of Edition 2.5 belongs.
pub(super) fn ed4_of(number: u16) -> Option<u16> {
    match number {
        41 => Some(LoiterConfiguration::ID),
        42 | 43 | 48 => Some(VehicleOperatingModeCommand::ID),
        1200 => Some(FieldConfigurationRequest::ID),
        _ => ed25::ed4_of(number.into()),
    }
}

// Values of #48: the configuration, or the values commanded by hand, are in effect.
const CONFIGURATION: u8 = 0;
const MANUAL: u8 = 2;
// Modes of #42.
const WAYPOINT: u8 = 11;
const LOITER: u8 = 12;
const AUTOPILOT: u8 = 15;
// Mission Plan Mode of 13000.
const LOAD: u32 = 2;
/// Field Route ID of 13000.
const ROUTE_ID: u8 = 5;
const NO_WAYPOINT: u32 = 65_535;
const REQUEST_CONTROL: u32 = 1;
const WAIT_FOR_COORDINATION: u32 = 1;
