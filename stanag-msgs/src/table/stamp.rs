//! A new Time Stamp for a finished message: it is sent later than it was made, or again.

use super::{Message, Wire};
use crate::TimeStamp;
use crate::wrapper::MAX_DATA;

impl Message {
    /// The same message with this Time Stamp (field 1). A message whose first field is not a stamp, or that cannot be
    /// written, is returned unchanged: its encoding will report the reason.
    #[must_use]
    pub fn stamped(&self, stamp: TimeStamp) -> Message {
        rewritten(self, stamp).unwrap_or_else(|| self.clone())
    }
}

fn rewritten(message: &Message, stamp: TimeStamp) -> Option<Message> {
    let info = message.info();
    let presence = usize::from(info.presence_bytes);
    let mut value = [0; 8];
    let wide = match info.fields.first()?.wire {
        Wire::U40 => {
            value[..5].copy_from_slice(&stamp.0.to_be_bytes()[3..]);
            5
        }
        // 50001 carries the same milliseconds as a double.
        Wire::F64 => {
            value = (stamp.0 as f64).to_be_bytes();
            8
        }
        _ => return None,
    };
    let mut old = [0; MAX_DATA];
    let length = message.encode_data(&mut old).ok()?;
    let (vector, fields) = old.get(..length)?.split_at_checked(presence)?;
    let was_stamped = vector.last()? & 1 != 0;
    let others = fields.get(if was_stamped { wide } else { 0 }..)?;

    let mut new = Vec::with_capacity(length + wide);
    new.extend_from_slice(vector);
    *new.last_mut()? |= 1;
    new.extend_from_slice(value.get(..wide)?);
    new.extend_from_slice(others);
    Message::decode(info.id, &new).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::enums::FlightPathControlMode;
    use crate::messages::{CurveSegmentPaper, VehicleOperatingModeCommand};

    #[test]
    fn a_stamp_is_put_in_and_replaced_and_nothing_else_changes() {
        let bare = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(FlightPathControlMode::Loiter),
            commanded_waypoint_number: Some(7),
            ..Default::default()
        };
        for stamp in [TimeStamp(1), TimeStamp(0xFF_FFFF_FFFF)] {
            let once = Message::from(bare.clone()).stamped(TimeStamp(99));
            let expected = VehicleOperatingModeCommand {
                time_stamp: Some(stamp),
                ..bare.clone()
            };
            assert_eq!(once.stamped(stamp), expected.into());
        }
    }

    #[test]
    fn every_message_of_the_table_can_be_stamped_but_is_otherwise_empty() {
        for info in crate::table::MESSAGES {
            let Some(empty) = Message::empty(info.id) else {
                panic!("{} is not in the table", info.id)
            };
            let message = empty.stamped(TimeStamp(0x12_3456_789A));
            let mut bytes = [0; MAX_DATA];
            let length = message.encode_data(&mut bytes).unwrap();
            let wide = info.fields[0].wire.bytes().unwrap();
            assert_eq!(
                length,
                usize::from(info.presence_bytes) + wide,
                "{}",
                info.id
            );
        }
    }

    #[test]
    fn the_papers_curve_carries_the_stamp_as_a_double() {
        let message = Message::from(CurveSegmentPaper::default()).stamped(TimeStamp(1234));
        let Message::CurveSegmentPaper(curve) = message else {
            panic!("another message");
        };
        assert_eq!(curve.time_stamp, Some(1234.0));
    }
}
