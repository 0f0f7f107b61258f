//! A ground station of a few lines, in virtual time.

use std::time::Duration;

use mavlink::dialects::development as mav;
use mavlink::dialects::development::MavMessage;
use mavlink_link::service::Node;
use mavlink_link::service::mission::Item;
use px4_sim::{Config, Mode, Ned, Outgoing, Truth, Vehicle};

pub(crate) const GCS: Node = Node::new(255, 190);

/// A vehicle and everything that was received from it.
pub(crate) struct Flight {
    pub(crate) vehicle: Vehicle,
    pub(crate) received: Vec<(f64, MavMessage)>,
    pub(crate) raw: Vec<(u32, Vec<u8>)>,
    pub(crate) track: Vec<Truth>,
    pub(crate) heartbeats: bool,
    beat: f64,
    ticks: u64,
}

impl Flight {
    /// Just switched on.
    pub(crate) fn boot(config: Config) -> Self {
        Self {
            vehicle: Vehicle::new(config),
            received: Vec::new(),
            raw: Vec::new(),
            track: Vec::new(),
            heartbeats: true,
            beat: 0.0,
            ticks: 0,
        }
    }

    /// Switched on and ready to arm.
    pub(crate) fn ready() -> Self {
        let mut flight = Self::boot(Config::default());
        flight.run(8.0);
        flight
    }

    pub(crate) fn now(&self) -> f64 {
        self.vehicle.truth().time.as_secs_f64()
    }

    /// Lets this many seconds pass.
    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 250.0).round() as u64 {
            self.tick();
        }
    }

    /// Lets time pass until `so` is true; returns false after `limit` seconds.
    pub(crate) fn until(&mut self, limit: f64, so: impl Fn(&Truth) -> bool) -> bool {
        for _ in 0..(limit * 250.0) as u64 {
            if so(&self.vehicle.truth()) {
                return true;
            }
            self.tick();
        }
        false
    }

    fn tick(&mut self) {
        if self.heartbeats && self.now() >= self.beat {
            self.beat = self.now() + 1.0;
            self.vehicle.handle_message(GCS, &heartbeat());
        }
        self.vehicle.step(Duration::from_millis(4));
        self.ticks += 1;
        if self.ticks.is_multiple_of(25) {
            self.track.push(self.vehicle.truth());
        }
        self.drain();
    }

    fn drain(&mut self) {
        let now = self.now();
        while let Some(out) = self.vehicle.poll_transmit() {
            match out {
                Outgoing::Message(message) | Outgoing::Component(_, message) => {
                    self.received.push((now, message));
                }
                Outgoing::Raw { id, payload } => self.raw.push((id, payload)),
            }
        }
    }

    pub(crate) fn send(&mut self, message: &MavMessage) {
        self.vehicle.handle_message(GCS, message);
        self.drain();
    }

    /// Sends a COMMAND_LONG and returns the result of its COMMAND_ACK, if one arrives within a second.
    pub(crate) fn command(&mut self, id: u16, params: &[f32]) -> Option<u32> {
        let mark = self.received.len();
        let raw = self.raw.len();
        let mut payload = [0; 33];
        for (i, p) in params.iter().enumerate() {
            payload[i * 4..i * 4 + 4].copy_from_slice(&p.to_le_bytes());
        }
        payload[28..30].copy_from_slice(&id.to_le_bytes());
        payload[30] = 1;
        payload[31] = 1;
        self.vehicle.handle_raw(GCS, 76, &payload);
        self.run(0.1);
        let result = self.received[mark..].iter().find_map(|(_, m)| match m {
            MavMessage::COMMAND_ACK(ack) if ack.command as u16 == id => Some(ack.result as u32),
            _ => None,
        });
        result.or_else(|| {
            self.raw[raw..]
                .iter()
                .find(|(id, _)| *id == 77)
                .map(|(_, p)| u32::from(p[2]))
        })
    }

    pub(crate) fn set_mode(&mut self, mode: Mode) -> Option<u32> {
        let (main, sub) = mode.main_sub();
        self.command(176, &[1.0, f32::from(main), f32::from(sub)])
    }

    pub(crate) fn arm(&mut self) -> Option<u32> {
        self.command(400, &[1.0])
    }

    /// Uploads a plan by the protocol; returns MISSION_ACK.type.
    pub(crate) fn upload(&mut self, items: &[Item]) -> Option<u32> {
        self.upload_kind(items, mav::MavMissionType::MAV_MISSION_TYPE_MISSION)
    }

    pub(crate) fn upload_kind(&mut self, items: &[Item], kind: mav::MavMissionType) -> Option<u32> {
        let mut mark = self.received.len();
        self.send(&MavMessage::MISSION_COUNT(mav::MISSION_COUNT_DATA {
            count: items.len() as u16,
            target_system: 1,
            target_component: 1,
            mission_type: kind,
            opaque_id: 0,
        }));
        for _ in 0..items.len() * 4 + 500 {
            while mark < self.received.len() {
                let (_, message) = self.received[mark].clone();
                mark += 1;
                match message {
                    MavMessage::MISSION_REQUEST_INT(request) => {
                        let item = items[usize::from(request.seq)];
                        let message = item.to_message(Node::new(1, 1), kind, request.seq).unwrap();
                        self.send(&message);
                    }
                    MavMessage::MISSION_ACK(ack) => return Some(ack.mavtype as u32),
                    _ => {}
                }
            }
            self.tick();
        }
        None
    }

    /// The texts since `mark`, without tabs, chunks joined.
    pub(crate) fn texts(&self) -> Vec<String> {
        let mut out: Vec<String> = Vec::new();
        for (_, message) in &self.received {
            if let MavMessage::STATUSTEXT(t) = message {
                let words: String = t
                    .text
                    .iter()
                    .take_while(|o| **o != 0)
                    .map(|o| char::from(*o))
                    .collect();
                match (t.chunk_seq, out.last_mut()) {
                    (0, _) | (_, None) => out.push(words),
                    (_, Some(last)) => last.push_str(&words),
                }
            }
        }
        out
    }

    pub(crate) fn has_text(&self, text: &str) -> bool {
        self.texts().iter().any(|t| t.contains(text))
    }

    /// The last message for which `pick` returns something.
    pub(crate) fn last<T>(&self, pick: impl Fn(&MavMessage) -> Option<T>) -> Option<T> {
        self.received.iter().rev().find_map(|(_, m)| pick(m))
    }

    pub(crate) fn heartbeat(&self) -> mav::HEARTBEAT_DATA {
        self.last(|m| match m {
            MavMessage::HEARTBEAT(h) => Some(h.clone()),
            _ => None,
        })
        .unwrap()
    }

    pub(crate) fn mission_current(&self) -> mav::MISSION_CURRENT_DATA {
        self.last(|m| match m {
            MavMessage::MISSION_CURRENT(c) => Some(c.clone()),
            _ => None,
        })
        .unwrap()
    }
}

pub(crate) fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(mav::HEARTBEAT_DATA {
        mavtype: mav::MavType::MAV_TYPE_GCS,
        autopilot: mav::MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: mav::MavModeFlag::from_bits_retain(0),
        system_status: mav::MavState::MAV_STATE_ACTIVE,
        ..Default::default()
    })
}

/// An item at a place north and east of home, `up` metres above it.
pub(crate) fn item(command: u16, params: [f32; 4], north: f64, east: f64, up: f32) -> Item {
    let home = Config::default().home;
    let frame = px4_sim::LocalFrame::new(home);
    let at = frame.to_global(Ned::new(north, east, 0.0));
    Item {
        frame: 6,
        command,
        current: false,
        autocontinue: true,
        params,
        x: (at.latitude_deg * 1e7).round() as i32,
        y: (at.longitude_deg * 1e7).round() as i32,
        z: up,
    }
}

/// An item without a place.
pub(crate) fn action(command: u16, params: [f32; 4]) -> Item {
    Item {
        frame: 2,
        command,
        current: false,
        autocontinue: true,
        params,
        x: i32::MAX,
        y: i32::MAX,
        z: 0.0,
    }
}

pub(crate) fn takeoff(up: f32) -> Item {
    item(22, [0.0, 0.0, 0.0, f32::NAN], 0.0, 0.0, up)
}

pub(crate) fn waypoint(north: f64, east: f64, up: f32) -> Item {
    item(16, [0.0, 0.0, 0.0, f32::NAN], north, east, up)
}

pub(crate) fn land(north: f64, east: f64) -> Item {
    item(21, [0.0, 0.0, 0.0, f32::NAN], north, east, 0.0)
}

/// Distance from the polyline of `points` (north, east), largest over the track.
pub(crate) fn deviation(track: &[Truth], points: &[(f64, f64)]) -> f64 {
    track
        .iter()
        .map(|t| {
            points
                .windows(2)
                .map(|w| segment_distance((t.position.n, t.position.e), w[0], w[1]))
                .fold(f64::INFINITY, f64::min)
        })
        .fold(0.0, f64::max)
}

fn segment_distance(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let len = dx * dx + dy * dy;
    let t = if len > 0.0 {
        (((p.0 - a.0) * dx + (p.1 - a.1) * dy) / len).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p.0 - a.0 - t * dx).hypot(p.1 - a.1 - t * dy)
}
