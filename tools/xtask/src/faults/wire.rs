//! What the captures have seen, and what must never be seen: the evidence of `cargo xtask faults`.
//!
//! Nothing here is reported by the bridge about itself. A MAVLink frame is counted for the node that its Ethernet address
//! names, since all nodes send from one IP address; its stamp is read from the signature block.

use std::collections::HashSet;
use std::time::Instant;

/// What has passed on the wire to the vehicles, and to the stations.
#[derive(Debug, Default)]
pub(super) struct Wire {
    /// By number.
    pub(super) vehicles: Vec<Vehicle>,
    /// 17000s of the nodes since the last [`Wire::begin`].
    pub(super) answers: Vec<Answer>,
    /// By node: first and last datagram to stations since then.
    pub(super) reports: [Option<(Instant, Instant)>; 3],
    /// What must not be, in words.
    pub(super) violations: Vec<String>,
    /// The last datagram to a vehicle, and to which port: to be sent again where a violation is planted.
    pub(super) last: Option<(u16, Vec<u8>)>,
}

/// One vehicle, and so one key.
#[derive(Debug, Default)]
pub(super) struct Vehicle {
    /// Every stamp that was ever sent under this key.
    stamps: HashSet<u64>,
    /// Of the frames that the vehicle accepts: a stamp below it is refused.
    highest: u64,
    /// The last stamp of each node.
    last: [u64; 3],
    /// The node whose frames the vehicle accepts.
    pub(super) serving: Option<usize>,
    /// When another node became that, since the last [`Wire::begin`].
    pub(super) changes: Vec<(Instant, usize)>,
    /// The altitudes that were commanded (MAV_CMD_DO_REPOSITION), in frames that the vehicle accepts.
    pub(super) orders: Vec<Order>,
    /// Frames of a node that the vehicle refuses, since another has sent higher stamps.
    pub(super) fenced: u64,
}

/// A commanded altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Order {
    pub(super) at: Instant,
    pub(super) node: usize,
    /// Above mean sea level.
    pub(super) altitude_m: f32,
}

/// A 17000 of a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    pub(super) at: Instant,
    pub(super) node: usize,
    /// 1 received, 2 carried out, 3 refused.
    pub(super) kind: u64,
}

impl Wire {
    pub(super) fn new(vehicles: usize) -> Wire {
        Wire {
            vehicles: (0..vehicles).map(|_| Vehicle::default()).collect(),
            ..Wire::default()
        }
    }

    /// A fault begins: forgets what only counts for one. Stamps count for ever.
    pub(super) fn begin(&mut self) {
        self.answers.clear();
        self.reports = [None; 3];
        for vehicle in &mut self.vehicles {
            vehicle.changes.clear();
            vehicle.orders.clear();
        }
    }

    /// A datagram of a node to a vehicle.
    pub(super) fn note_frame(&mut self, at: Instant, node: usize, number: usize, bytes: &[u8]) {
        let Some(vehicle) = self.vehicles.get_mut(number) else {
            return;
        };
        let mut rest = bytes;
        while !rest.is_empty() {
            let Some((frame, after)) = Frame::parse(rest) else {
                let fault = format!(
                    "vehicle {}: node {node} sent no MAVLink 2 frame",
                    number + 1
                );
                self.violations.push(fault);
                return;
            };
            rest = after;
            if let Some(fault) = vehicle.count(at, node, &frame) {
                let fault = format!("vehicle {}, from node {node}: {fault}", number + 1);
                self.violations.push(fault);
            }
        }
    }

    /// A datagram of a node to stations.
    pub(super) fn note_report(&mut self, at: Instant, node: usize) {
        let (_, last) = self.reports[node].get_or_insert((at, at));
        *last = at;
    }
}

impl Vehicle {
    /// Counts a frame; returns what is wrong with it.
    fn count(&mut self, at: Instant, node: usize, frame: &Frame<'_>) -> Option<String> {
        let Some(stamp) = frame.stamp else {
            return Some(format!("message {} is not signed", frame.message));
        };
        if !self.stamps.insert(stamp) {
            return Some(format!(
                "stamp {stamp} was used twice (message {})",
                frame.message
            ));
        }
        let last = std::mem::replace(&mut self.last[node], stamp);
        if stamp < last {
            return Some(format!("stamp {stamp} after {last}: it does not rise"));
        }
        if stamp < self.highest {
            self.fenced += 1;
            return None;
        }
        self.highest = stamp;
        if self.serving != Some(node) {
            self.serving = Some(node);
            self.changes.push((at, node));
        }
        if let Some(altitude_m) = frame.altitude_m() {
            self.orders.push(Order {
                at,
                node,
                altitude_m,
            });
        }
        None
    }

    /// The frames that commanded this altitude.
    pub(super) fn runs(&self, altitude_m: f32) -> Vec<Order> {
        let same = |order: &&Order| is_same(order.altitude_m, altitude_m);
        self.orders.iter().filter(same).copied().collect()
    }
}

/// Whether two altitudes are one on the wire: the DLI has steps of 0.02 m, and orders are further apart.
pub(super) fn is_same(one_m: f32, other_m: f32) -> bool {
    (one_m - other_m).abs() < 0.05
}

/// A MAVLink 2 frame, as far as it is read here.
struct Frame<'a> {
    message: u32,
    payload: &'a [u8],
    /// Of its signature, if it has one.
    stamp: Option<u64>,
}

impl Frame<'_> {
    /// The first frame, and what follows it.
    fn parse(bytes: &[u8]) -> Option<(Frame<'_>, &[u8])> {
        let (head, rest) = bytes.split_at_checked(HEADER)?;
        if head[0] != MAGIC {
            return None;
        }
        let (payload, rest) = rest.split_at_checked(head[1].into())?;
        let (_checksum, rest) = rest.split_at_checked(2)?;
        let signed = head[2] & 1 != 0;
        let (signature, rest) = rest.split_at_checked(if signed { SIGNATURE } else { 0 })?;
        let stamp = signature.get(1..7).map(|stamp| {
            let mut wide = [0; 8];
            wide[..6].copy_from_slice(stamp);
            u64::from_le_bytes(wide)
        });
        let message = u32::from_le_bytes([head[7], head[8], head[9], 0]);
        Some((
            Frame {
                message,
                payload,
                stamp,
            },
            rest,
        ))
    }

    /// The altitude of a COMMAND_INT that repositions. Zeros at the end of a payload are not sent.
    fn altitude_m(&self) -> Option<f32> {
        let byte = |at: usize| self.payload.get(at).copied().unwrap_or(0);
        let command = u16::from_le_bytes([byte(28), byte(29)]);
        let altitude = f32::from_le_bytes([byte(24), byte(25), byte(26), byte(27)]);
        let repositions = self.message == COMMAND_INT && command == DO_REPOSITION;
        // Not a number: at the altitude where it is.
        (repositions && altitude.is_finite()).then_some(altitude)
    }
}

const HEADER: usize = 10;
const MAGIC: u8 = 0xfd;
/// Link id, stamp, signature.
const SIGNATURE: usize = 13;
const COMMAND_INT: u32 = 75;
const DO_REPOSITION: u16 = 192;

#[cfg(test)]
mod tests {
    use super::*;

    /// A signed frame with this stamp that commands an altitude.
    fn frame(stamp: u64, altitude_m: f32) -> Vec<u8> {
        let mut payload = [0; 35];
        payload[24..28].copy_from_slice(&altitude_m.to_le_bytes());
        payload[28] = 192;
        payload[32] = 5;
        let mut bytes = vec![MAGIC, 35, 1, 0, 0, 245, 190, 75, 0, 0];
        bytes.extend(payload);
        bytes.extend([0; 3]);
        bytes.extend(&stamp.to_le_bytes()[..6]);
        bytes.extend([0; 6]);
        bytes
    }

    fn after(frames: &[(usize, Vec<u8>)]) -> Wire {
        let mut wire = Wire::new(1);
        for (node, bytes) in frames {
            wire.note_frame(Instant::now(), *node, 0, bytes);
        }
        wire
    }

    #[test]
    fn frames_that_rise_are_right_and_late_ones_of_the_earlier_owner_are_fenced() {
        let wire = after(&[
            (0, frame(10, 5.0)),
            (1, frame(1_000, 5.5)),
            // It does not know yet that it was replaced: the vehicle refuses this.
            (0, frame(20, 6.0)),
            (1, frame(1_001, 5.7)),
        ]);
        assert!(wire.violations.is_empty(), "{:?}", wire.violations);
        let vehicle = &wire.vehicles[0];
        assert_eq!((vehicle.fenced, vehicle.changes.len()), (1, 2));
        assert_eq!(vehicle.runs(5.5).len(), 1);
        assert!(vehicle.runs(6.0).is_empty(), "it was refused");
    }

    #[test]
    fn a_stamp_used_twice_is_found_whoever_sends_it() {
        for node in [0, 1] {
            let wire = after(&[(0, frame(10, 5.0)), (node, frame(10, 5.0))]);
            assert!(
                wire.violations[0].contains("used twice"),
                "{:?}",
                wire.violations
            );
        }
    }

    #[test]
    fn a_stamp_that_falls_and_a_frame_without_one_are_found() {
        let wire = after(&[(0, frame(10, 5.0)), (0, frame(9, 5.0))]);
        assert!(
            wire.violations[0].contains("does not rise"),
            "{:?}",
            wire.violations
        );
        let mut unsigned = frame(10, 5.0);
        unsigned[2] = 0;
        unsigned.truncate(HEADER + 35 + 2);
        let wire = after(&[(0, unsigned)]);
        assert!(
            wire.violations[0].contains("not signed"),
            "{:?}",
            wire.violations
        );
    }

    #[test]
    fn an_owner_that_is_accepted_again_is_another_change() {
        let wire = after(&[
            (0, frame(10, 5.0)),
            (1, frame(20, 5.0)),
            (0, frame(30, 5.0)),
        ]);
        // The epoch shows how many changes there may be.
        assert_eq!(wire.vehicles[0].changes.len(), 3);
        assert_eq!(wire.vehicles[0].runs(5.0).len(), 3);
    }
}
