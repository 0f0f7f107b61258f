//! The vehicle of the benches that have one: what its autopilot sends.

use std::cell::Cell;

use kit::clock::wall;
use mavlink_link::dialect::{
    ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType,
};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign};

pub(crate) struct Autopilot {
    pub(crate) signed: bool,
    sent: Cell<u64>,
    stamped: Cell<u64>,
}

impl Autopilot {
    pub(crate) fn new(signed: bool) -> Autopilot {
        Autopilot {
            signed,
            sent: Cell::new(0),
            stamped: Cell::new(0),
        }
    }

    /// In AUTO.MISSION, or in AUTO.LOITER; a 3001 reports a change.
    pub(crate) fn heartbeat(&self, mission: bool) -> Vec<u8> {
        self.frame(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: if mission { 0x0404_0000 } else { 0x0304_0000 },
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            mavlink_version: 3,
            ..HEARTBEAT_DATA::default()
        }))
    }

    /// The most frequent of PX4's messages.
    pub(crate) fn attitude(&self) -> Vec<u8> {
        let part = (self.sent.get() % 100) as f32 / 100.0;
        self.frame(&MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms: self.sent.get() as u32,
            roll: part,
            pitch: -part,
            yaw: part * 3.0,
            rollspeed: 0.1,
            pitchspeed: 0.2,
            yawspeed: 0.3,
        }))
    }

    fn frame(&self, message: &MavMessage) -> Vec<u8> {
        let count = self.sent.get() + 1;
        self.sent.set(count);
        let mut out = [0; MAX_FRAME];
        let header = Header {
            system_id: 1,
            component_id: 1,
            seq: count as u8,
            incompat: if self.signed { INCOMPAT_SIGNED } else { 0 },
            ..Header::default()
        };
        let mut length = encode(message, header, &mut out);
        if self.signed {
            let key = SigningKey::new(KEY).expect("a key");
            // As every signer must: two frames within 10 us do not share a stamp.
            let stamp = Stamp::from_unix(wall()).get().max(self.stamped.get() + 1);
            self.stamped.set(stamp);
            length = sign(&key, 0, Stamp::new(stamp), &mut out, length).expect("it fits");
        }
        out[..length].to_vec()
    }
}

/// The vehicle's signing key.
pub(crate) const KEY: [u8; 32] = [0x5a; 32];
