//! A message with some of its fields.

use super::{Message, walk};
use crate::wrapper::MAX_DATA;

/// The message with those fields only whose bits are set in `presence`; the time stamp, field 1, stays.
///
/// Bits of fields that the message does not have, or has not set, change nothing.
pub fn select(message: &Message, presence: u64) -> Message {
    try_select(message, presence | 1).unwrap_or_else(|| message.clone())
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
    fn the_fields_asked_for_and_the_stamp_stay() {
        let whole = Message::from(InertialStates {
            time_stamp: Some(TimeStamp(7)),
            latitude: Some(Bam32(1)),
            longitude: Some(Bam32(-2)),
            ..Default::default()
        });
        // Longitude, and an altitude that there is not.
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
