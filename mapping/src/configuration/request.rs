//! What a 40000 requests.

use stanag_msgs::enums::ConfigRequestType;
use stanag_msgs::messages::{FieldConfigurationRequest, ParameterSetCommand};
use stanag_msgs::table::{self, Direction, FieldInfo, MessageInfo};

use super::controls::Controls;

/// A request that can be answered.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    /// What is requested.
    pub scope: Scope,
}

/// How much of the interface.
#[derive(Debug, Clone, Copy)]
pub enum Scope {
    /// One field (Request Type 0).
    Field {
        /// Its message.
        message: &'static MessageInfo,
        /// The field.
        field: &'static FieldInfo,
    },
    /// A message with all its fields (Request Type 0, Requested Field absent or 0).
    Message(&'static MessageInfo),
    /// One control, a field of 50011 (Request Type 0).
    Control(u8),
    /// All messages of a level of interoperability, or of the data link (Request Types 1 to 5).
    Level(Level),
    /// Stop the answers (Request Type 6).
    Abort,
}

/// A level of interoperability, or the data link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// LOI 2: status.
    Status,
    /// LOI 3: payload.
    Payload,
    /// LOI 4: routes and modes.
    Control,
    /// LOI 5: launch, landing, engines, termination.
    LaunchAndRecovery,
    /// The data link.
    DataLink,
}

impl Level {
    /// Whether a message belongs to this level. The messages of the configuration phase belong to none.
    #[must_use]
    pub fn has(self, message: &MessageInfo) -> bool {
        let down = message.direction == Direction::ToCucs;
        match (self, message.id) {
            (Level::Status, 3000..=4999 | 6000..=6999 | 12000..=12999 | 15000..=18999) => true,
            (Level::Payload, 13004 | 19000..=23999) => true,
            (Level::Control, 2005 | 2008 | 13004) => false,
            (Level::Control, 2000..=2999 | 5000..=5999 | 13000..=14999 | 50000..) => true,
            (Level::LaunchAndRecovery, 2005 | 2008 | 2016) => !down,
            (Level::DataLink, 28000..=35999) => true,
            _ => false,
        }
    }

    /// Whether the services of the VSM are reported at this level.
    #[must_use]
    pub fn is_status(self) -> bool {
        self == Level::Status
    }

    /// Whether the routes that can be loaded are reported at this level.
    #[must_use]
    pub fn is_control(self) -> bool {
        self == Level::Control
    }
}

/// A request that cannot be answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// Request Type is absent.
    #[error("Request Type is missing")]
    NoType,
    /// Request Type is out of range.
    #[error("Request Type {0}, expected 0 to 6")]
    Type(u8),
    /// Requested Message is absent, or has no layout.
    #[error("Requested Message {0} is not known")]
    Message(u32),
    /// The message has no such field.
    #[error("Requested Field {field}, message {message} has {fields}")]
    Field {
        /// The message.
        message: u16,
        /// The field, from 1.
        field: u8,
        /// How many there are.
        fields: usize,
    },
}

impl Request {
    /// Whether only controls are requested.
    #[must_use]
    pub fn is_of_controls(&self) -> bool {
        match self.scope {
            Scope::Control(_) => true,
            Scope::Message(message) => message.id == ParameterSetCommand::ID,
            _ => false,
        }
    }

    /// Reads a 40000.
    ///
    /// # Errors
    /// A field is missing or out of range, or names something that the interface does not have.
    pub fn read(request: &FieldConfigurationRequest) -> Result<Request, RequestError> {
        use ConfigRequestType as T;
        let scope = match request.request_type.ok_or(RequestError::NoType)? {
            T::SingleParameter => single(request)?,
            T::Loi2 => Scope::Level(Level::Status),
            T::Loi3 => Scope::Level(Level::Payload),
            T::Loi4 => Scope::Level(Level::Control),
            T::Loi5 => Scope::Level(Level::LaunchAndRecovery),
            T::DataLink => Scope::Level(Level::DataLink),
            T::Abort => Scope::Abort,
            T::Unknown(value) => return Err(RequestError::Type(value)),
        };
        Ok(Request { scope })
    }
}

fn single(request: &FieldConfigurationRequest) -> Result<Scope, RequestError> {
    let requested = request.requested_message.unwrap_or(0);
    let message = u16::try_from(requested)
        .ok()
        .and_then(table::message)
        .ok_or(RequestError::Message(requested))?;
    match request.requested_field {
        None | Some(0) => Ok(Scope::Message(message)),
        Some(number @ Controls::FIRST..) if message.id == ParameterSetCommand::ID => {
            Ok(Scope::Control(number))
        }
        Some(number) => message
            .fields
            .get(usize::from(number) - 1)
            .map(|field| Scope::Field { message, field })
            .ok_or(RequestError::Field {
                message: message.id,
                field: number,
                fields: message.fields.len(),
            }),
    }
}
