//! The message table: every message that has a layout, one row a message.
//!
//! The rows make the structs, the codec, the JSON form, the dissector and the documents; there is
//! no second list. The facts are those of public secondary sources, with their confidence.

mod auxiliary;
mod configuration;
mod data_link;
mod flight_command;
mod flight_status;
mod iff;
mod inertial;
mod info;
mod macros;
mod miscellaneous;
mod mission;
mod payload;
mod private;
mod select;
mod services;
mod subsystem;
mod system_id;
mod vehicle_services;
mod walk;

pub use info::{Confidence, Direction, FieldInfo, Layout, MessageInfo, Traffic, Wire};
pub use select::select;
pub use walk::{Walk, walk};

use crate::codec::{DecodeError, EncodeError};
use crate::wrapper::{self, Envelope};

/// The message of this type, where the table has it.
pub fn message(message_type: u16) -> Option<&'static MessageInfo> {
    let index = MESSAGES
        .binary_search_by_key(&message_type, |message| message.id)
        .ok()?;
    Some(&MESSAGES[index])
}

/// What every message struct can do, for code that is generic over them.
pub trait Body: Sized + Into<Message> {
    /// The Message Type.
    const ID: u16;
    /// The row in the table.
    const INFO: MessageInfo;

    /// Reads message data: presence vector and fields.
    fn decode(data: &[u8]) -> Result<Self, DecodeError>;

    /// Writes message data, presence vector and fields, and says how many bytes.
    fn encode_data(&self, out: &mut [u8]) -> Result<usize, EncodeError>;

    /// Writes wrapper, data and checksum, and says how many bytes.
    fn encode(&self, envelope: &Envelope, out: &mut [u8]) -> Result<usize, EncodeError> {
        wrapper::encode(Self::ID, envelope, out, |out| self.encode_data(out))
    }
}

/// Gathers the messages of all groups, in the order of their types.
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
            pub fn decode(message_type: u16, data: &[u8]) -> Result<Self, DecodeError> {
                match message_type {
                    $($($Name::ID => Ok(Self::$Name($Name::decode(data)?)),)*)*
                    _ => Err(DecodeError::UnknownMessage { message_type }),
                }
            }

            /// The message of this type with no field set.
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

            /// Writes message data, presence vector and fields, and says how many bytes.
            pub fn encode_data(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
                match self {
                    $($(Self::$Name(message) => message.encode_data(out),)*)*
                }
            }

            /// Writes wrapper, data and checksum, and says how many bytes.
            pub fn encode(&self, envelope: &Envelope, out: &mut [u8]) -> Result<usize, EncodeError> {
                match self {
                    $($(Self::$Name(message) => message.encode(envelope, out),)*)*
                }
            }
        }

        $($(
            impl From<$Name> for Message {
                fn from(message: $Name) -> Self {
                    Self::$Name(message)
                }
            }

            impl Body for $Name {
                const ID: u16 = $Name::ID;
                const INFO: MessageInfo = $Name::INFO;

                fn decode(data: &[u8]) -> Result<Self, DecodeError> {
                    $Name::decode(data)
                }

                fn encode_data(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
                    self.encode_data(out)
                }
            }
        )*)*
    };
}

gather! {
    system_id: CucsAuthorisationRequest, VsmAuthorisationResponse, VehicleId,
        PositiveHandoverAuthorisationRequest, PositiveHandoverAuthorisationGranted;
    flight_command: VehicleConfigurationCommand, FlightTerminationCommand,
        UnmannedAircraftLights, EngineCommand, UaStickCommand, VehicleOperatingModeCommand,
        LoiterConfiguration;
    flight_status: VehicleConfiguration, VehicleOperatingModeReport,
        VehicleOperatingStates, LoiterConfigurationReport, FlightTerminationModeReport,
        VehicleLightsState, EngineOperatingStates, AirAndGroundRelativeStates,
        BodyRelativeSensedStates, UaStickStatus, RelativeRouteWaypointLocationReport;
    inertial: InertialStates, FromToNextWaypointStates;
    iff: IffSsrCodeCommand, IffSsrIdentSquawkCommand, IffSsrStatusReport;
    auxiliary: ElectricalReport, BatteryReport;
    mission: MissionTransferCommand, UaRoute, UaPositionWaypoint, UaLoiterWaypoint,
        PayloadActionWaypoint, AirframeActionWaypoint, VehicleSpecificWaypoint,
        MissionUploadDownloadStatus;
    subsystem: SubsystemStatusRequest, SubsystemStatusDetailRequest, SubsystemStatusAlert,
        SubsystemStatusReport, Heartbeat;
    miscellaneous: MessageAcknowledgement, ScheduleMessageUpdateCommand,
        GenericInformationRequestMessage, FileTransferNotification, MeteorologicalTableReport,
        GpsStatusReport;
    payload: PayloadSteeringCommand, EoIrLaserPayloadCommand, SarPayloadCommand,
        PayloadConfiguration, EoIrConfigurationState, EoIrLaserOperatingState;
    data_link: DataLinkControlRequest, DataLinkConfigurationAssignmentMessage,
        DlToVehicleIdReport, DlControlStatusReport, RfCommandProcessingStatusReport,
        LegacyDlStatusReport, LegacyDlControlCommandStatus, AntennaPedestalLocationStatusReport,
        AntennaControlStatusReport, AntennaPositionReport, LegacyPedestalStatusReport,
        LinkHealthStatus, DlFallbackStatus, DataLinkUdpCount, UaIpDisclosureMessage,
        DlInControlReport, LostLinkDelayTimerReport, VehicleDataLinkTransitionCoordination,
        HandoverStatusReport;
    configuration: FieldConfigurationRequest, FieldConfigurationIntegerResponse,
        FieldConfigurationFloatResponse, FieldConfigurationEnumeratedResponse,
        FieldConfigurationUnsignedResponse, FieldConfigurationCharacterResponse,
        ConfigurationComplete;
    services: DisplayUnitRequest, ReportControllableElementMessage,
        VsmServicesReportMessage, UaRouteConfiguration, RemoteWindowsGuiDefinition,
        FieldChangeIntegerCommand, FieldChangeFloatCommand, FieldChangeEnumeratedCommand,
        MessageParameterAvailability;
    private: CurveSegmentPaper, CurveSegment;
    vehicle_services: ParameterRequest, ParameterSetCommand, ParameterReport,
        SoftwareVersionReport, PingRequest, PingResponse, AreaVertex, AreaTransferCommand,
        AreaTransferStatus;
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
}
