//! A peer's reading of what the sources leave open, translated to and from this project's.
//!
//! The default profile is this project's own reading and costs one comparison a message. Any other profile translates
//! values between the wire and the structs, so that no other code sees the peer's values.
//!
//! ```
//! use stanag_msgs::{Profile, enums::AckType, messages::MessageAcknowledgement};
//!
//! // This peer numbers "received, carried out, refused" 0, 1, 2 where this project has 1, 2, 3.
//! let mut profile = Profile::default();
//! profile.set("ack_type", "0,1,2")?;
//! let message = profile.decode(MessageAcknowledgement::ID, &[0b1000, 2])?;
//! let refused = MessageAcknowledgement { acknowledgement_type: Some(AckType::Refused), ..Default::default() };
//! assert_eq!(message, refused.into());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::bytes::{Reader, Writer};
use crate::disputed::{Choices, DISPUTED, Disputed, Settled};
use crate::error::{DecodeError, EncodeError};
use crate::field::Field;
use crate::scalar::{FineAngularRate, Integer};
use crate::table::messages::PositiveHandoverAuthorisationGranted as Message5;
use crate::table::{self, Message};
use crate::wrapper::{self, Envelope, Frames, Header, Sum16Variant, frames_with};

/// How a peer reads what [`DISPUTED`] lists.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    checksum_1: Sum16Variant,
    turn_rate_factor: i64,
    message_5_presence_bytes: usize,
    ack_type: ValueMap,
    heading_reference: ValueMap,
    waypoint_type: ValueMap,
    limit_type: ValueMap,
    loiter_duration_units: ValueMap,
    loiter_length_units: ValueMap,
    presence_vector_support: ValueMap,
    flight_mode: ValueMap,
}

const DEFAULT: Profile = Profile {
    checksum_1: Sum16Variant::Sum,
    turn_rate_factor: 1,
    message_5_presence_bytes: 2,
    ack_type: ValueMap::SAME,
    heading_reference: ValueMap::SAME,
    waypoint_type: ValueMap::SAME,
    limit_type: ValueMap::SAME,
    loiter_duration_units: ValueMap::SAME,
    loiter_length_units: ValueMap::SAME,
    presence_vector_support: ValueMap::SAME,
    flight_mode: ValueMap::SAME,
};

impl Default for Profile {
    fn default() -> Self {
        DEFAULT
    }
}

impl Profile {
    /// Sets the reading of one entry of [`DISPUTED`], in the form of
    /// its [`Disputed::default`].
    ///
    /// # Errors
    /// There is no such entry, the reading is not one of its choices, or the point is [`Settled`] otherwise.
    pub fn set(&mut self, name: &str, reading: &str) -> Result<(), ProfileError> {
        if let Some(settled) = Settled::find(name) {
            let found = reading.to_owned();
            return if reading == settled.reading {
                Ok(())
            } else {
                Err(ProfileError::Settled { settled, found })
            };
        }
        let unknown = || ProfileError::Name {
            name: name.to_owned(),
        };
        let disputed = Disputed::find(name).ok_or_else(unknown)?;
        let refused = || ProfileError::Reading {
            disputed,
            found: reading.to_owned(),
        };
        let ours = match disputed.choices {
            Choices::OneOf(choices) if !choices.contains(&reading) => return Err(refused()),
            Choices::OneOf(_) => None,
            Choices::Values(_) => Some(
                ValueMap::parse(disputed.default, reading, disputed.lowest).ok_or_else(refused)?,
            ),
        };
        match (name, ours) {
            ("checksum_1", _) => {
                self.checksum_1 = if reading == "crc16" {
                    Sum16Variant::Crc16
                } else {
                    Sum16Variant::Sum
                };
            }
            ("turn_rate_step", _) => {
                self.turn_rate_factor = if reading == "0.005" { 50 } else { 1 }
            }
            ("message_5_presence_bytes", _) => {
                self.message_5_presence_bytes = if reading == "3" { 3 } else { 2 };
            }
            ("ack_type", Some(map)) => self.ack_type = map,
            ("heading_reference", Some(map)) => self.heading_reference = map,
            ("waypoint_type", Some(map)) => self.waypoint_type = map,
            ("limit_type", Some(map)) => self.limit_type = map,
            ("loiter_duration_units", Some(map)) => self.loiter_duration_units = map,
            ("loiter_length_units", Some(map)) => self.loiter_length_units = map,
            ("presence_vector_support", Some(map)) => self.presence_vector_support = map,
            ("contingency_modes", Some(map)) => self.flight_mode = map,
            _ => {}
        }
        Ok(())
    }

    /// [`frames`](crate::frames) under this profile.
    pub fn frames<'a>(&self, datagram: &'a [u8]) -> Frames<'a> {
        frames_with(self.checksum_1, datagram)
    }

    /// Makes the rest of a datagram be read under this profile. Several peers may have packed their messages into one
    /// datagram, and each message is read by its sender's profile ([`Frames::next_source`]).
    pub fn apply_to(&self, frames: &mut Frames<'_>) {
        frames.read_style_1(self.checksum_1);
    }

    /// [`Message::decode`] under this profile.
    ///
    /// # Errors
    /// As [`Message::decode`].
    pub fn decode(&self, message_type: u16, data: &[u8]) -> Result<Message, DecodeError> {
        // Most peers read the standard as this project does: then nothing is copied or translated.
        if *self == DEFAULT {
            return Message::decode(message_type, data);
        }
        let mut message = match data {
            [high, data @ ..]
                if message_type == Message5::ID && self.message_5_presence_bytes == 3 =>
            {
                // The message has 16 fields, so no bit of a third byte may be set.
                if *high != 0 {
                    let presence = u64::from(*high) << 16;
                    return Err(DecodeError::UnknownPresence {
                        message_type,
                        presence,
                        known: 0xFFFF,
                    });
                }
                Message::decode(message_type, data)?
            }
            _ => Message::decode(message_type, data)?,
        };
        self.translate(&mut message, Way::In);
        Ok(message)
    }

    /// [`Message::encode`] under this profile.
    ///
    /// # Errors
    /// As [`Message::encode`].
    pub fn encode(
        &self,
        message: &Message,
        envelope: &Envelope,
        out: &mut [u8],
    ) -> Result<usize, EncodeError> {
        if *self == DEFAULT {
            return message.encode(envelope, out);
        }
        let mut message = message.clone();
        self.translate(&mut message, Way::Out);
        let id = message.id();
        wrapper::encode_with(self.checksum_1, id, envelope, out, |out| {
            self.put_data(id, out, |out| message.encode_data(out))
        })
    }

    /// [`Profile::encode`] with a full presence vector, for a peer that accepts no other: absent fields are zeros
    /// ([`fill`](table::fill)). A message with a field of unknown length is written without this. For IDD version 30 the vector
    /// ends with the last field of Edition 3 ([`in_edition_3`](table::in_edition_3)).
    ///
    /// # Errors
    /// As [`Message::encode`].
    pub fn encode_full(
        &self,
        message: &Message,
        envelope: &Envelope,
        out: &mut [u8],
    ) -> Result<usize, EncodeError> {
        let info = message.info();
        if info.fields.iter().any(|field| field.wire.bytes().is_none()) {
            return self.encode(message, envelope, out);
        }
        let mut translated = message.clone();
        self.translate(&mut translated, Way::Out);
        let mut partial = [0; wrapper::MAX_DATA];
        let length = translated.encode_data(&mut partial)?;
        let partial = partial.get(..length).unwrap_or_default();
        let of_edition_3 = || table::edition_3_fields(info.id);
        let cut = (envelope.idd == Header::IDD_ED3).then(of_edition_3);
        let count = cut.flatten().unwrap_or(info.fields.len());
        wrapper::encode_with(self.checksum_1, info.id, envelope, out, |out| {
            self.put_data(info.id, out, |out| {
                let available = out.len();
                table::fill_first(info, count, partial, out)
                    .ok_or(EncodeError::BufferTooSmall { available })
            })
        })
    }

    /// Writes message data, behind the extra byte of the presence vector that only such a peer has.
    fn put_data(
        &self,
        id: u16,
        out: &mut [u8],
        put: impl FnOnce(&mut [u8]) -> Result<usize, EncodeError>,
    ) -> Result<usize, EncodeError> {
        match out {
            [high, rest @ ..] if id == Message5::ID && self.message_5_presence_bytes == 3 => {
                *high = 0;
                put(rest).map(|bytes| bytes + 1)
            }
            _ => put(out),
        }
    }

    fn translate(&self, message: &mut Message, way: Way) {
        // Three messages describe a loiter by the same fields.
        macro_rules! loiter {
            ($m:ident) => {{
                self.loiter_duration_units
                    .translate(&mut $m.loiter_duration_units, way);
                self.loiter_length_units
                    .translate(&mut $m.loiter_length_units, way);
            }};
        }
        match message {
            Message::CucsAuthorisationRequest(m) => {
                self.flight_mode
                    .translate(&mut m.requested_flight_mode, way);
                self.presence_vector_support
                    .translate(&mut m.presence_vector_support, way);
            }
            Message::VsmAuthorisationResponse(m) => {
                self.flight_mode.translate(&mut m.flight_modes_granted, way);
                self.presence_vector_support
                    .translate(&mut m.presence_vector_support, way);
            }
            Message::PositiveHandoverAuthorisationRequest(m) => {
                self.presence_vector_support
                    .translate(&mut m.presence_vector_support, way);
            }
            Message::PositiveHandoverAuthorisationGranted(m) => {
                self.presence_vector_support
                    .translate(&mut m.presence_vector_support, way);
            }
            Message::VehicleOperatingModeCommand(m) => {
                self.turn_rate(&mut m.commanded_turn_rate, way);
                self.flight_mode
                    .translate(&mut m.select_flight_path_control_mode, way);
                self.heading_reference
                    .translate(&mut m.heading_reference, way);
            }
            Message::VehicleOperatingModeReport(m) => self
                .flight_mode
                .translate(&mut m.select_flight_path_control_mode, way),
            Message::VehicleOperatingStates(m) => self.turn_rate(&mut m.commanded_turn_rate, way),
            Message::LoiterConfiguration(m) => loiter!(m),
            Message::LoiterConfigurationReport(m) => loiter!(m),
            Message::UaLoiterWaypoint(m) => loiter!(m),
            Message::UaPositionWaypoint(m) => {
                self.waypoint_type.translate(&mut m.waypoint_type, way);
                self.limit_type.translate(&mut m.limit_type, way);
            }
            Message::MessageAcknowledgement(m) => {
                self.ack_type.translate(&mut m.acknowledgement_type, way)
            }
            _ => {}
        }
    }

    fn turn_rate(&self, rate: &mut Option<FineAngularRate>, way: Way) {
        let Some(rate) = rate else { return };
        let raw = rate.raw().to_i64();
        let translated = match way {
            Way::In => raw * self.turn_rate_factor,
            Way::Out => (raw as f64 / self.turn_rate_factor as f64).round() as i64,
        };
        // A coarse rate above 3.2 rad/s does not fit the fine step: it is clamped, which is better than refusing the
        // whole message.
        *rate = FineAngularRate::from_raw(Integer::clamped(translated));
    }
}

/// Why an entry of a profile cannot be set.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ProfileError {
    /// There is no such entry.
    #[error("{name}: no such entry, expected one of {}", names())]
    Name {
        /// The name.
        name: String,
    },
    /// The point has one reading, and this is another.
    #[error("{}: found {found:?}, expected {:?}, which is settled: {} by {}", settled.name, settled.reading, settled.meaning, settled.by)]
    Settled {
        /// The entry.
        settled: &'static Settled,
        /// The reading.
        found: String,
    },
    /// The reading is not one of the choices.
    #[error("{}: found {found:?}, expected {}", disputed.name, expectation(disputed))]
    Reading {
        /// The entry.
        disputed: &'static Disputed,
        /// The reading.
        found: String,
    },
}

fn names() -> String {
    let names: Vec<_> = DISPUTED.iter().map(|disputed| disputed.name).collect();
    names.join(", ")
}

fn expectation(disputed: &Disputed) -> String {
    match disputed.choices {
        Choices::OneOf(choices) => choices.join(" or "),
        Choices::Values(meanings) => {
            format!(
                "different values {} to 255, as {}, for {}",
                disputed.lowest,
                disputed.default,
                meanings.join(", ")
            )
        }
    }
}

/// The direction of a translation: from the wire, or to it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    In,
    Out,
}

/// Pairs of values: ours and the wire's. Values that only one side uses are paired with each other, so that the map
/// is one to one: nothing is lost in translation, and no value has two meanings.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ValueMap {
    pairs: [(u8, u8); Self::MAX_PAIRS],
}

impl ValueMap {
    /// Three values of either side, each with its partner.
    const MAX_PAIRS: usize = 6;
    /// Every value is itself.
    const SAME: Self = Self {
        pairs: [(0, 0); Self::MAX_PAIRS],
    };

    /// `None` unless `wire` lists as many different values as `ours`, none of them below `lowest`.
    fn parse(ours: &str, wire: &str, lowest: u8) -> Option<Self> {
        let read = |text: &str| -> Option<Vec<u8>> {
            text.split(',')
                .map(|value| value.trim().parse().ok())
                .collect()
        };
        let (ours, wire) = (read(ours)?, read(wire)?);
        let twice = wire
            .iter()
            .enumerate()
            .any(|(index, value)| wire[..index].contains(value));
        let settled = wire.iter().any(|value| *value < lowest);
        if twice || settled || ours.len() != wire.len() || 2 * ours.len() > Self::MAX_PAIRS {
            return None;
        }
        // So that a profile with every point set to its default equals the default profile, and is as fast.
        if ours == wire {
            return Some(Self::SAME);
        }
        let only_wire = wire.iter().filter(|value| !ours.contains(value));
        let only_ours = ours.iter().filter(|value| !wire.contains(value));
        let named = ours.iter().zip(&wire);
        let mut pairs = [(ours[0], wire[0]); Self::MAX_PAIRS];
        for (pair, (&ours, &wire)) in pairs.iter_mut().zip(named.chain(only_wire.zip(only_ours))) {
            *pair = (ours, wire);
        }
        Some(Self { pairs })
    }

    /// Translates a field of one byte.
    fn translate<T: Field>(&self, field: &mut Option<T>, way: Way) {
        let Some(value) = field else { return };
        let mut byte = [0];
        if value.write(&mut Writer::new(&mut byte)).is_ok() {
            byte[0] = self.apply(byte[0], way);
            *field = T::read(&mut Reader::new(&byte)).ok();
        }
    }

    fn apply(&self, value: u8, way: Way) -> u8 {
        let mut pairs = self.pairs.iter();
        let found = match way {
            Way::Out => pairs.find(|pair| pair.0 == value).map(|pair| pair.1),
            Way::In => pairs.find(|pair| pair.1 == value).map(|pair| pair.0),
        };
        found.unwrap_or(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::enums::{AckType, FlightPathControlMode, LoiBitmap};
    use crate::messages::*;
    use crate::{ChecksumStyle, Id};

    const ENVELOPE: Envelope = Envelope::new(Id(1), Id(2)).summed(ChecksumStyle::Sum16);

    fn profile(name: &str, reading: &str) -> Profile {
        let mut profile = Profile::default();
        profile.set(name, reading).unwrap();
        profile
    }

    /// The data on the wire under the profile, which must also decode to the same message.
    fn wire(profile: &Profile, message: impl Into<Message>) -> Vec<u8> {
        let message = message.into();
        let mut out = [0; crate::MAX_DATAGRAM];
        let length = profile.encode(&message, &ENVELOPE, &mut out).unwrap();
        let frame = profile.frames(&out[..length]).next().unwrap().unwrap();
        assert_eq!(profile.decode(message.id(), frame.data), Ok(message));
        frame.data.to_vec()
    }

    #[test]
    fn turn_rates_change_their_step() {
        let coarse = profile("turn_rate_step", "0.005");
        let rate = FineAngularRate::from_si(0.1).unwrap();
        let command = VehicleOperatingModeCommand {
            commanded_turn_rate: Some(rate),
            ..Default::default()
        };
        assert_eq!(wire(&coarse, command.clone()), [0, 2, 0, 0, 20]);
        assert_eq!(wire(&Profile::default(), command), [0, 2, 0, 0x03, 0xE8]);
        let Ok(Message::VehicleOperatingStates(states)) =
            coarse.decode(3002, &[0, 0, 0x20, 0x7F, 0xFF])
        else {
            panic!("a 3002 with a turn rate")
        };
        assert_eq!(states.commanded_turn_rate.unwrap().raw(), i16::MAX);
    }

    #[test]
    fn message_5_may_have_three_presence_bytes() {
        let three = profile("message_5_presence_bytes", "3");
        let granted = Message5 {
            loi_authorized: Some(LoiBitmap::LOI4),
            ..Default::default()
        };
        assert_eq!(wire(&three, granted.clone()), [0, 0, 8, 4]);
        assert_eq!(wire(&Profile::default(), granted), [0, 8, 4]);
        let error = DecodeError::UnknownPresence {
            message_type: 5,
            presence: 0x10000,
            known: 0xFFFF,
        };
        assert_eq!(three.decode(5, &[1, 0, 8, 4]), Err(error));
        assert!(three.decode(5, &[]).is_err());
    }

    #[test]
    fn values_are_translated_and_none_is_lost() {
        let shifted = profile("ack_type", "0,1,2");
        let ack = |kind| MessageAcknowledgement {
            acknowledgement_type: Some(kind),
            ..Default::default()
        };
        assert_eq!(wire(&shifted, ack(AckType::Received)), [8, 0]);
        assert_eq!(wire(&shifted, ack(AckType::Refused)), [8, 2]);
        for raw in 0..=255 {
            wire(&shifted, ack(AckType::from_raw(raw)));
        }
        let modes = profile("contingency_modes", "40, 41, 42");
        let report = VehicleOperatingModeReport {
            select_flight_path_control_mode: Some(FlightPathControlMode::ContingencyB),
            ..Default::default()
        };
        assert_eq!(wire(&modes, report), [2, 41]);
    }

    #[test]
    fn checksum_1_may_be_a_crc() {
        let crc = profile("checksum_1", "crc16");
        let mut out = [0; 64];
        let beat = Message::from(Heartbeat::default());
        let length = crc.encode(&beat, &ENVELOPE, &mut out).unwrap();
        assert!(crc.frames(&out[..length]).all(|frame| frame.is_ok()));
        assert!(
            Profile::default()
                .frames(&out[..length])
                .all(|frame| frame.is_err())
        );
    }

    #[test]
    fn readings_are_checked() {
        let mut profile = Profile::default();
        let mut refuse =
            |name: &str, reading: &str| profile.set(name, reading).unwrap_err().to_string();
        assert!(refuse("ack", "m").starts_with("ack: no such entry, expected one of checksum_1, "));
        assert_eq!(
            refuse("checksum_1", "x"),
            "checksum_1: found \"x\", expected sum or crc16"
        );
        // One reading, by a clause.
        let settled = refuse("loi_bits", "m");
        assert!(
            settled.contains("settled: 1, 2, 4, 8") && settled.contains("0001.08"),
            "{settled}"
        );
        for reading in ["", "1", "1,1,2", "1,2,256", "1,2,3,4", "a,b,c"] {
            assert!(
                refuse("ack_type", reading).contains("different values"),
                "{reading}"
            );
        }
        // 11 is the mode of waypoints: it must not become a contingency.
        for reading in ["11,12,13", "22,23,24", "0,40,41"] {
            assert_eq!(
                refuse("contingency_modes", reading),
                format!(
                    "contingency_modes: found {reading:?}, expected different values 23 to 255, as 23,24,25, for contingency A, \
                     contingency B, slave to location"
                )
            );
        }
        for disputed in DISPUTED {
            profile.set(disputed.name, disputed.default).unwrap();
        }
        for settled in crate::disputed::SETTLED {
            profile.set(settled.name, settled.reading).unwrap();
        }
        assert_eq!(profile, Profile::default());
    }
}
