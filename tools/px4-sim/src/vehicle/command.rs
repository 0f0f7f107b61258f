//! One command, from COMMAND_LONG or COMMAND_INT alike.

use mavlink::dialects::development::{COMMAND_INT_DATA, COMMAND_LONG_DATA};
use mavlink::{MavlinkVersion, MessageData};
use mavlink_link::service::Node;

/// A command as PX4 handles it internally: param5 and param6 in double precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Command {
    /// MAV_CMD, known to the dialect or not.
    pub id: u16,
    /// param1 to param7.
    pub params: [f64; 7],
    /// The target.
    pub target: Node,
    /// The sender.
    pub from: Node,
    /// Whether a COMMAND_INT had the bytes of a float NaN as coordinates: it is refused at once.
    pub garbled: bool,
}

impl Command {
    /// From the payload of COMMAND_LONG (76).
    pub(crate) fn from_long_payload(payload: &[u8], from: Node) -> Self {
        let p = |i: usize| f64::from(f32::from_le_bytes(bytes(payload, i * 4)));
        Self {
            id: u16::from_le_bytes(bytes(payload, 28)),
            params: [p(0), p(1), p(2), p(3), p(4), p(5), p(6)],
            target: Node::new(bytes::<1>(payload, 30)[0], bytes::<1>(payload, 31)[0]),
            from,
            garbled: false,
        }
    }

    /// From the payload of COMMAND_INT (75). PX4 ignores the frame for the altitude, which is always AMSL, and uses
    /// it only to scale x and y of a local frame.
    pub(crate) fn from_int_payload(payload: &[u8], from: Node) -> Self {
        let p = |i: usize| f64::from(f32::from_le_bytes(bytes(payload, i * 4)));
        let (x, y) = (
            i32::from_le_bytes(bytes(payload, 16)),
            i32::from_le_bytes(bytes(payload, 20)),
        );
        let id = u16::from_le_bytes(bytes(payload, 28));
        let frame = bytes::<1>(payload, 32)[0];
        let local = matches!(frame, 1 | 4 | 7 | 8 | 9 | 12 | 20 | 21);
        let scale = match (has_location(id), local) {
            (true, true) => 1e4,
            (true, false) => 1e7,
            (false, _) => 1.0,
        };
        let unset = x == i32::MAX && y == i32::MAX;
        let coordinate = |v: i32| {
            if unset {
                f64::NAN
            } else {
                f64::from(v) / scale
            }
        };
        Self {
            id,
            params: [p(0), p(1), p(2), p(3), coordinate(x), coordinate(y), p(6)],
            target: Node::new(bytes::<1>(payload, 30)[0], bytes::<1>(payload, 31)[0]),
            from,
            garbled: x == NAN_BYTES && y == NAN_BYTES,
        }
    }

    /// From the dialect's struct.
    pub(crate) fn from_long(m: &COMMAND_LONG_DATA, from: Node) -> Self {
        Self::from_long_payload(&payload(m), from)
    }

    /// From the dialect's struct.
    pub(crate) fn from_int(m: &COMMAND_INT_DATA, from: Node) -> Self {
        Self::from_int_payload(&payload(m), from)
    }

    /// Parameter `number`, 1 to 7.
    pub(crate) fn param(&self, number: usize) -> f64 {
        self.params
            .get(number.wrapping_sub(1))
            .copied()
            .unwrap_or(f64::NAN)
    }

    /// Parameter `number`, unless it is NaN.
    pub(crate) fn given(&self, number: usize) -> Option<f64> {
        Some(self.param(number)).filter(|v| v.is_finite())
    }
}

/// COMMAND_ACK.result, the values that PX4 sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    Accepted = 0,
    TemporarilyRejected = 1,
    Denied = 2,
    Unsupported = 3,
    Failed = 4,
    NotInControl = 10,
}

impl Answer {
    /// Accepted where `done`, otherwise the other answer.
    pub(crate) fn accepted_or(otherwise: Self, done: bool) -> Self {
        if done { Self::Accepted } else { otherwise }
    }
}

/// Whether a message is for this node; 0 means every system, or every component.
pub(crate) fn is_for(own: Node, system: u8, component: u8) -> bool {
    (system == own.system || system == 0) && (component == own.component || component == 0)
}

fn payload(message: &impl MessageData) -> [u8; 255] {
    let mut bytes = [0; 255];
    message.ser(MavlinkVersion::V2, &mut bytes);
    bytes
}

/// Bytes of a payload; bytes that the sender truncated are zero.
fn bytes<const N: usize>(payload: &[u8], at: usize) -> [u8; N] {
    let mut out = [0; N];
    for (o, i) in out.iter_mut().zip(at..) {
        *o = payload.get(i).copied().unwrap_or(0);
    }
    out
}

/// Commands whose param5 and param6 are a latitude and a longitude.
fn has_location(command: u16) -> bool {
    matches!(
        command,
        16..=19 | 21 | 22 | 30 | 31 | 33..=36 | 80 | 82 | 84 | 85 | 94 | 179 | 192 | 195 | 201 | 611 | 4501 | 5000..=5005 | 5100 | 43003
    )
}

/// MAV_CMD_REQUEST_OPERATOR_CONTROL.
pub(crate) const REQUEST_OPERATOR_CONTROL: u16 = 32_100;
/// 0x7ff80000: the upper half of a double NaN, sent as an integer by accident.
const NAN_BYTES: i32 = 0x7ff8_0000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trimmed_payload_is_padded_with_zeros() {
        let command = Command::from_long_payload(&[0, 0, 0x80, 0x3f], Node::new(255, 190));
        assert_eq!(command.params[0], 1.0);
        assert_eq!(command.id, 0);
        assert_eq!(command.target, Node::new(0, 0));
    }
}
