//! The message table: every message that has a layout, one row a message.
//!
//! The rows make the structs, the codec, the JSON form, the dissector and the documents; there is no second list. The
//! facts are those of public secondary sources, with their confidence.
//!
//! Bottom to top: `info` (what a row records), `codec` (reading and writing message data, and the macro that makes a
//! struct of a row), one file of rows for each group of messages in the order of their types, and here [`Message`],
//! which is any of them; `stamp` gives one another Time Stamp.

mod alerts_and_requests;
pub(crate) mod codec;
mod configuration;
mod data_link;
mod equipment;
mod flight_command;
mod flight_status;
mod held;
pub(crate) mod info;
mod mission;
mod payload;
mod private;
mod stamp;
mod system_id;
mod video;
mod zeroize;

pub use crate::field::{Confidence, FieldInfo, Wire};
pub use codec::walk;
pub use info::{Direction, Layout, MessageInfo, Traffic};

use crate::error::{DecodeError, EncodeError};
use crate::id::Id;
use crate::wrapper::{self, Envelope, MAX_DATA};

/// The message of this type, where the table has it.
pub fn message(message_type: u16) -> Option<&'static MessageInfo> {
    let index = MESSAGES
        .binary_search_by_key(&message_type, |message| message.id)
        .ok()?;
    Some(&MESSAGES[index])
}

/// A message type for people: `13000 (Mission Transfer Command)`.
#[must_use]
pub fn named(message_type: u16) -> String {
    let name = message(message_type).map_or("unknown", |info| info.name);
    format!("{message_type} ({name})")
}

/// Gathers the messages of all groups, in the order of their types: [`message`] finds one by binary search.
macro_rules! gather {
    ($($group:ident: $($Name:ident),*;)*) => {
        /// The structs, one a message.
        pub mod messages {
            $(pub use super::$group::{$($Name),*};)*
        }

        use messages::*;

        /// The table, in the order of the Message Types.
        pub static MESSAGES: &[MessageInfo] = &[$($($Name::INFO),*),*];

        /// Any message of the table.
        #[derive(Clone, Debug, PartialEq)]
        #[allow(
            clippy::large_enum_variant,
            reason = "boxing the long ones would allocate in the hot path; a message lives on the stack"
        )]
        pub enum Message {
            $($(#[doc = concat!("See [`", stringify!($Name), "`].")] $Name($Name),)*)*
        }

        impl Message {
            /// Reads the data, presence vector and fields, of a message of this type.
            ///
            /// # Errors
            /// The table has no such message, or the bytes are not its data.
            pub fn decode(message_type: u16, data: &[u8]) -> Result<Self, DecodeError> {
                match message_type {
                    $($($Name::ID => Ok(Self::$Name($Name::decode(data)?)),)*)*
                    _ => Err(DecodeError::UnknownMessage { message_type: message_type.into() }),
                }
            }

            /// The message of this type with no field set, where the table has it.
            pub fn empty(message_type: u16) -> Option<Self> {
                match message_type {
                    $($($Name::ID => Some(Self::$Name($Name::default())),)*)*
                    _ => None,
                }
            }

            /// The row in the table.
            pub fn info(&self) -> &'static MessageInfo {
                match self {
                    $($(Self::$Name(_) => const { &$Name::INFO },)*)*
                }
            }

            /// Writes message data, presence vector and fields; returns how many bytes.
            ///
            /// # Errors
            /// The buffer is too small, or a field is set whose length no source gives.
            pub fn encode_data(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
                match self {
                    $($(Self::$Name(message) => message.encode_data(out),)*)*
                }
            }
        }

        $($(
            impl From<$Name> for Message {
                fn from(message: $Name) -> Self {
                    Self::$Name(message)
                }
            }
        )*)*
    };
}

gather! {
    system_id: CucsAuthorisationRequest, VsmAuthorisationResponse, VehicleId,
        PositiveHandoverAuthorisationRequest, PositiveHandoverAuthorisationGranted;
    flight_command: VehicleConfigurationCommand, FlightTerminationCommand, UnmannedAircraftLights,
        EngineCommand, UaStickCommand, VehicleOperatingModeCommand, LoiterConfiguration;
    flight_status: VehicleConfiguration, VehicleOperatingModeReport, VehicleOperatingStates,
        LoiterConfigurationReport, FlightTerminationModeReport, VehicleLightsState, EngineOperatingStates,
        AirAndGroundRelativeStates, BodyRelativeSensedStates, UaStickStatus, RelativeRouteWaypointLocationReport,
        InertialStates, FromToNextWaypointStates;
    equipment: IffSsrCodeCommand, IffSsrIdentSquawkCommand, IffSsrStatusReport, ElectricalReport, BatteryReport;
    mission: MissionTransferCommand, UaRoute, UaPositionWaypoint, UaLoiterWaypoint, PayloadActionWaypoint,
        AirframeActionWaypoint, VehicleSpecificWaypoint, MissionUploadDownloadStatus;
    alerts_and_requests: SubsystemStatusRequest, SubsystemStatusDetailRequest, SubsystemStatusAlert,
        SubsystemStatusReport, Heartbeat, MessageAcknowledgement, ScheduleMessageUpdateCommand,
        GenericInformationRequestMessage, FileTransferNotification, MeteorologicalTableReport, GpsStatusReport;
    payload: PayloadSteeringCommand, EoIrLaserPayloadCommand, SarPayloadCommand, PayloadConfiguration,
        EoIrConfigurationState, EoIrLaserOperatingState;
    data_link: DataLinkControlRequest, DataLinkConfigurationAssignmentMessage, DlToVehicleIdReport,
        DlControlStatusReport, RfCommandProcessingStatusReport, LegacyDlStatusReport,
        LegacyDlControlCommandStatus, AntennaPedestalLocationStatusReport, AntennaControlStatusReport,
        AntennaPositionReport, LegacyPedestalStatusReport, LinkHealthStatus, DlFallbackStatus,
        DataLinkUdpCount, UaIpDisclosureMessage, DlInControlReport, LostLinkDelayTimerReport,
        VehicleDataLinkTransitionCoordination, HandoverStatusReport;
    configuration: FieldConfigurationRequest, FieldConfigurationIntegerResponse, FieldConfigurationFloatResponse,
        FieldConfigurationEnumeratedResponse, FieldConfigurationUnsignedResponse,
        FieldConfigurationCharacterResponse, ConfigurationComplete, DisplayUnitRequest,
        ReportControllableElementMessage, VsmServicesReportMessage, UaRouteConfiguration,
        RemoteWindowsGuiDefinition, FieldChangeIntegerCommand, FieldChangeFloatCommand,
        FieldChangeEnumeratedCommand, MessageParameterAvailability;
    private: CurveSegmentPaper, CurveSegment, ParameterRequest, ParameterSetCommand, ParameterReport,
        SoftwareVersionReport, PingRequest, PingResponse, AreaVertex, AreaTransferCommand, AreaTransferStatus;
    held: HoldCommand, HeldCommandCancel, HeldCommandState, Contingency;
    zeroize: ZeroizeCommand;
    video: VideoStreamReport;
}

impl Message {
    /// The Message Type.
    pub fn id(&self) -> u16 {
        self.info().id
    }

    /// The name.
    pub fn name(&self) -> &'static str {
        self.info().name
    }

    /// Writes wrapper, data and checksum; returns how many bytes.
    ///
    /// # Errors
    /// As [`Message::encode_data`], or the envelope requests a version or a checksum that there is not.
    pub fn encode(&self, envelope: &Envelope, out: &mut [u8]) -> Result<usize, EncodeError> {
        wrapper::encode(self.id(), envelope, out, |out| self.encode_data(out))
    }
}

/// The message reduced to the fields whose bits are set in `presence`; the time stamp, field 1, stays.
///
/// Bits of fields that the message does not have, or that are absent, change nothing. A message with a field of
/// unknown length is returned whole.
pub fn select(message: &Message, presence: u64) -> Message {
    try_select(message, presence | 1).unwrap_or_else(|| message.clone())
}

/// Message data with every field present: those that are absent in `data` are zeros, an identification number the
/// null id. `None` where `data` is not this message's, or a field has no known length.
///
/// For peers that accept only full presence vectors. The caller has to decide whether a zero in an absent field would
/// claim something false.
pub fn fill(info: &'static MessageInfo, data: &[u8], out: &mut [u8]) -> Option<usize> {
    fill_first(info, info.fields.len(), data, out)
}

/// [`fill`] with the first `count` fields, for a peer whose edition has no others.
pub(crate) fn fill_first(
    info: &'static MessageInfo,
    count: usize,
    data: &[u8],
    out: &mut [u8],
) -> Option<usize> {
    let head = usize::from(info.presence_bytes);
    let all = (1_u64 << count) - 1;
    out.get_mut(..head)?
        .copy_from_slice(all.to_be_bytes().get(8 - head..)?);
    let mut present = walk(info, data).peekable();
    let mut end = head;
    for field in info.fields.get(..count)? {
        let bytes = field.wire.bytes()?;
        let place = out.get_mut(end..end + bytes)?;
        match present.next_if(|next| matches!(next, Ok((known, _)) if known.bit == field.bit)) {
            Some(Ok((_, value))) => place.copy_from_slice(value),
            _ if field.identification => place.copy_from_slice(&Id::NULL.0.to_be_bytes()),
            _ => place.fill(0),
        }
        end += bytes;
    }
    // A further item is an error.
    present.next().is_none().then_some(end)
}

/// How many fields Edition 3 has of a message that has more in Edition 4: the text of Edition 3 ends 3002 with Thrust.
#[must_use]
pub fn edition_3_fields(id: u16) -> Option<usize> {
    (id == messages::VehicleOperatingStates::ID).then_some(19)
}

/// A message without the fields that Edition 3 does not have; `None` where it has them all.
#[must_use]
pub fn in_edition_3(message: &Message) -> Option<Message> {
    let count = edition_3_fields(message.id())?;
    Some(select(message, (1_u64 << count) - 1))
}

/// Whether the sender has left out a field of this message, and so uses partial presence vectors.
pub fn is_partial(info: &'static MessageInfo, data: &[u8]) -> bool {
    let vector = data.get(..usize::from(info.presence_bytes));
    let present = vector.map(|bytes| bytes.iter().map(|byte| byte.count_ones()).sum::<u32>());
    present.is_some_and(|present| (present as usize) < info.fields.len())
}

fn try_select(message: &Message, presence: u64) -> Option<Message> {
    let info = message.info();
    let (mut whole, mut part) = ([0; MAX_DATA], [0; MAX_DATA]);
    let length = message.encode_data(&mut whole).ok()?;
    let head = usize::from(info.presence_bytes);
    let (mut kept, mut end) = (0_u64, head);
    for field in walk(info, whole.get(..length)?) {
        let (field, bytes) = field.ok()?;
        if presence >> field.bit & 1 == 1 {
            kept |= 1 << field.bit;
            part.get_mut(end..end + bytes.len())?.copy_from_slice(bytes);
            end += bytes.len();
        }
    }
    let vector = kept.to_be_bytes();
    part.get_mut(..head)?
        .copy_from_slice(vector.get(8 - head..)?);
    Message::decode(info.id, part.get(..end)?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{InertialStates, VehicleId};
    use crate::{Bam32, Text, TimeStamp};

    #[test]
    fn requested_fields_and_the_time_stamp_stay() {
        let whole = Message::from(InertialStates {
            time_stamp: Some(TimeStamp(7)),
            latitude: Some(Bam32(1)),
            longitude: Some(Bam32(-2)),
            ..Default::default()
        });
        // Longitude, and an altitude that is not set.
        let part = select(&whole, 0b1100);
        let expected = InertialStates {
            time_stamp: Some(TimeStamp(7)),
            longitude: Some(Bam32(-2)),
            ..Default::default()
        };
        assert_eq!(part, Message::from(expected));
        assert_eq!(select(&whole, u64::MAX), whole);
    }

    #[test]
    fn every_message_can_be_filled_and_keeps_what_it_has() {
        for info in MESSAGES {
            let stamp = TimeStamp(0x12_3456_7890);
            let message = Message::empty(info.id)
                .expect("of the table")
                .stamped(stamp);
            let (mut some, mut full) = ([0; MAX_DATA], [0; MAX_DATA]);
            let length = message.encode_data(&mut some).expect("it fits");
            let some = &some[..length];
            assert_eq!(is_partial(info, some), info.fields.len() > 1, "{}", info.id);
            let sized = info.fields.iter().all(|field| field.wire.bytes().is_some());
            let Some(length) = fill(info, some, &mut full) else {
                assert!(!sized, "{}", info.id);
                continue;
            };
            let full = &full[..length];
            assert_eq!(length, info.full_bytes(), "{}", info.id);
            assert!(!is_partial(info, full), "{}", info.id);
            let mut fields = walk(info, full);
            let mut kept = walk(info, some);
            assert_eq!(fields.next(), kept.next(), "{}: its stamp", info.id);
            for field in fields {
                let (field, bytes) = field.expect("a whole field");
                let null = Id::NULL.0.to_be_bytes();
                if field.identification {
                    assert_eq!(bytes, null, "{} {}", info.id, field.name);
                } else {
                    assert!(
                        bytes.iter().all(|byte| *byte == 0),
                        "{} {}",
                        info.id,
                        field.name
                    );
                }
            }
            assert!(Message::decode(info.id, full).is_ok(), "{}", info.id);
        }
    }

    #[test]
    fn texts_are_kept_whole() {
        let whole = Message::from(VehicleId {
            tail_number: Some(Text::new("PX4-01")),
            mission_id: Some(Text::new("M1")),
            ..Default::default()
        });
        let Message::VehicleId(part) = select(&whole, 1 << 6) else {
            panic!("another message")
        };
        assert_eq!(part.tail_number, Some(Text::new("PX4-01")));
        assert_eq!(part.mission_id, None);
    }
}
