//! A vehicle that does with SETUP_SIGNING what PX4 was seen to do.

use std::collections::HashMap;
use std::time::Duration;

use mavlink_link::dialect::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, STATUSTEXT_DATA,
};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign, verify};

use crate::support::ack;

/// The vehicle's side: key in memory and in its file, one table of streams for its life.
pub(super) struct Px4 {
    pub(super) system: u8,
    pub(super) running: Option<SigningKey>,
    pub(super) file: Option<(SigningKey, Stamp)>,
    pub(super) clock: Stamp,
    pub(super) streams: HashMap<(u8, u8, u8), Stamp>,
    pub(super) armed: bool,
    pub(super) can_sign: bool,
    pub(super) seq: u8,
    pub(super) to_send: Vec<MavMessage>,
}

impl Px4 {
    pub(super) fn new(key: Option<SigningKey>) -> Self {
        let clock = Stamp::new(1);
        Self {
            system: 1,
            running: key.as_ref().map(SigningKey::duplicate),
            file: key.map(|key| (key, clock)),
            clock,
            streams: HashMap::new(),
            armed: false,
            can_sign: true,
            seq: 0,
            to_send: vec![],
        }
    }

    pub(super) fn reboot(&mut self) {
        self.running = self.file.as_ref().map(|(key, _)| key.duplicate());
        self.clock = self.file.as_ref().map_or(Stamp::ZERO, |(_, stamp)| *stamp);
        self.streams.clear();
        self.armed = false;
    }

    pub(super) fn receive(&mut self, bytes: &[u8]) {
        let frame = FrameView::parse(bytes).expect("a frame of ours");
        let header = frame.header();
        if let Some(key) = &self.running {
            let Some(signature) = frame.signature() else {
                return;
            };
            let stream = (header.system_id, header.component_id, signature.link_id);
            if verify(key, &frame).is_err() {
                return;
            }
            match self.streams.get(&stream) {
                Some(&last) if signature.stamp <= last => return,
                None if signature.stamp.plus(Duration::from_secs(60)) < self.clock => return,
                _ => {}
            }
            self.streams.insert(stream, signature.stamp);
            self.clock = self.clock.max(signature.stamp);
        }
        if header.message_id == 256 && self.can_sign {
            if self.armed {
                let text = "MAVLink signing: rejected while armed";
                self.to_send.push(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                    text: text.into(),
                    ..STATUSTEXT_DATA::default()
                }));
                return;
            }
            let Ok(MavMessage::SETUP_SIGNING(setup)) = frame.message() else {
                panic!("SETUP_SIGNING")
            };
            assert_eq!((setup.target_system, setup.target_component), (1, 1));
            assert_ne!(setup.secret_key, [0; 32]);
            let stamp = Stamp::new(setup.initial_timestamp);
            assert!(stamp > self.clock, "first stamp above all seen");
            let key = SigningKey::new(setup.secret_key).unwrap();
            self.running = Some(key.duplicate());
            self.file = Some((key, stamp));
            self.clock = stamp;
        }
    }

    pub(super) fn send(&mut self, message: &MavMessage) -> Vec<u8> {
        let header = Header {
            seq: self.seq,
            system_id: self.system,
            component_id: 1,
            incompat: if self.running.is_some() {
                INCOMPAT_SIGNED
            } else {
                0
            },
            ..Header::default()
        };
        self.seq = self.seq.wrapping_add(1);
        let mut out = [0; MAX_FRAME];
        let mut len = encode(message, header, &mut out);
        if let Some(key) = &self.running {
            len = sign(key, 0, self.clock, &mut out, len).unwrap();
            self.clock = self.clock.next().unwrap();
        }
        out[..len].to_vec()
    }

    /// What it sends by itself: a heartbeat each second, something else five times.
    pub(super) fn speak(&mut self, tick: u64) -> Vec<Vec<u8>> {
        let mut sent: Vec<_> = self.to_send.drain(..).collect();
        if tick % 10 == 3 {
            sent.push(self.heartbeat());
        }
        if tick.is_multiple_of(2) {
            sent.push(ack());
        }
        sent.iter().map(|message| self.send(message)).collect()
    }

    pub(super) fn heartbeat(&self) -> MavMessage {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, self.armed);
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode,
            ..HEARTBEAT_DATA::default()
        })
    }

    pub(super) fn has(&self, key: &SigningKey) -> bool {
        self.running.as_ref().is_some_and(|own| own.same_as(key))
    }
}
