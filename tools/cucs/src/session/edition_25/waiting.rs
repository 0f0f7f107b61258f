//! Messages that await their result, and how far each has got.

use std::collections::VecDeque;

use stanag_msgs::enums::AckType;
use stanag_msgs::messages::{
    FieldConfigurationRequest, MessageAcknowledgement, MissionTransferCommand,
    PositiveHandoverAuthorisationRequest, VehicleOperatingModeCommand,
};
use stanag_msgs::{Id, Message, TimeStamp};

use super::commands;
use super::payload::Shows;

/// The latest messages that await a result.
#[derive(Debug, Default)]
pub(super) struct Waiting(VecDeque<One>);

/// One of them.
#[derive(Debug)]
pub(super) struct One {
    vehicle: Id,
    /// Its Message Type in Edition 4.
    pub(super) ed4: u16,
    stamp: TimeStamp,
    /// The mode that it commands.
    pub(super) mode: Option<u8>,
    /// Whether it is part of a handover.
    pub(super) hands_over: bool,
    /// For a payload command, what #302 reports once it is carried out.
    pub(super) shows: Option<Shows>,
    /// The parameter that it requests or sets: #2012 for it is the result; empty for all parameters.
    pub(super) parameter: Option<String>,
    /// Whether #1400 has arrived.
    pub(super) received: bool,
}

impl Waiting {
    /// A message is sent.
    pub(super) fn sent(&mut self, vehicle: Id, message: &Message, stamp: TimeStamp) {
        let mode = match message {
            Message::VehicleOperatingModeCommand(command) => command
                .select_flight_path_control_mode
                .map(|mode| mode.raw()),
            _ => None,
        };
        self.0.truncate(MAX_WAITING - 1);
        self.0.push_front(One {
            vehicle,
            ed4: message.id(),
            stamp,
            mode,
            hands_over: message.id() == PositiveHandoverAuthorisationRequest::ID,
            shows: Shows::of(message),
            parameter: parameter(message),
            received: false,
        });
    }

    /// #1400 for the message with this stamp: a message that only stores or requests is done by it.
    pub(super) fn received(&mut self, stamp: TimeStamp, number: u32) -> Option<Message> {
        let number = u16::try_from(number).ok()?;
        let mut all = self.0.iter_mut().enumerate();
        let (index, one) = all.find(|(_, one)| one.stamp == stamp)?;
        if !one.hands_over && commands::ed4_of(number) != Some(one.ed4) {
            return None;
        }
        one.received = true;
        let ed4 = one.ed4;
        let has_later_result = one.mode.is_some()
            || one.hands_over
            || one.shows.is_some()
            || one.parameter.is_some()
            || ed4 == FieldConfigurationRequest::ID
            || ed4 == MissionTransferCommand::ID;
        let kind = if has_later_result {
            AckType::Received
        } else {
            self.0.remove(index);
            AckType::CarriedOut
        };
        Some(acknowledgement(ed4, stamp, kind))
    }

    /// The latest matching message of a vehicle has its result.
    pub(super) fn end(
        &mut self,
        vehicle: Id,
        kind: AckType,
        meant: impl Fn(&One) -> bool,
    ) -> Option<Message> {
        self.end_earlier(vehicle, kind, 0, meant)
    }

    /// The same for the one sent this many before the latest.
    pub(super) fn end_earlier(
        &mut self,
        vehicle: Id,
        kind: AckType,
        earlier: usize,
        meant: impl Fn(&One) -> bool,
    ) -> Option<Message> {
        let all = self.0.iter().enumerate();
        let mut all = all.filter(|(_, one)| one.vehicle == vehicle && meant(one));
        let (index, _) = all.nth(earlier)?;
        let one = self.0.remove(index)?;
        // An older command of the same kind was replaced by this one, and waits for nothing more.
        if one.ed4 == VehicleOperatingModeCommand::ID {
            self.0.retain(|other| {
                (other.vehicle, other.ed4) != (one.vehicle, one.ed4) || other.stamp > one.stamp
            });
        }
        Some(acknowledgement(one.ed4, one.stamp, kind))
    }
}

fn parameter(message: &Message) -> Option<String> {
    let name = match message {
        Message::ParameterRequest(request) => &request.parameter_name,
        Message::ParameterSetCommand(command) => &command.parameter_name,
        _ => return None,
    };
    Some(name.as_ref().map_or("", |name| name.as_str()).to_owned())
}

/// A 17000 as the session handles it.
fn acknowledgement(ed4: u16, stamp: TimeStamp, kind: AckType) -> Message {
    MessageAcknowledgement {
        time_stamp: Some(stamp),
        original_message_time_stamp: Some(stamp),
        original_message_type: Some(ed4),
        acknowledgement_type: Some(kind),
    }
    .into()
}

/// Messages that await a result at most; beyond that the oldest are given up.
const MAX_WAITING: usize = 256;
