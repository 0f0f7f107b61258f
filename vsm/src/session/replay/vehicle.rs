//! What the recorded frames of a vehicle show: its motion, and the plans that were read back from it.

use std::collections::BTreeMap;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::payload::Payloads;
use mapping::payload::report::Ground;
use mapping::telemetry::{Place, Telemetry};
use mavlink_link::dialect::{MavAutopilot, MavMessage, MavMissionType};
use mavlink_link::frame::{FrameView, Node};
use mavlink_link::service::mission::Item;
use mavlink_link::service::text::Texts;
use stanag_msgs::Id;

use super::changes::{Changes, entry};
use crate::session::bridge::status::{FootprintStatus, MotionStatus, footprints, motion};
use crate::session::link::is_of_payload;
use crate::session::log::{LogEntry, LogLevel};

/// One vehicle: what is known of it while its recording is read, and what of that is kept by time.
#[derive(Debug, Default)]
pub(super) struct Vehicle {
    autopilot: Option<Node>,
    telemetry: Telemetry,
    payloads: Payloads,
    texts: Option<Texts>,
    mode_at: Option<Duration>,
    pub(super) samples: Changes<Sample>,
    /// Plans by MAV_MISSION_TYPE.
    reading: BTreeMap<u8, Reading>,
    pub(super) plans: BTreeMap<u8, Changes<Vec<Item>>>,
}

/// How it was at a moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    pub(super) position: Option<Place>,
    pub(super) home: Option<Place>,
    pub(super) motion: MotionStatus,
    pub(super) mode: Option<Px4Mode>,
    pub(super) armed: Option<bool>,
    pub(super) on_ground: Option<bool>,
    pub(super) battery: Option<u8>,
    /// When it last reported its mode: it is live for some seconds from then on.
    pub(super) mode_at: Option<Duration>,
    pub(super) looks_at: Vec<FootprintStatus>,
}

/// A plan that is being read back.
#[derive(Debug, Default)]
struct Reading {
    count: usize,
    items: BTreeMap<u16, Item>,
}

impl Vehicle {
    pub(super) fn take(
        &mut self,
        id: Id,
        wall: Duration,
        frame: &FrameView<'_>,
        events: &mut Vec<(Duration, LogEntry)>,
    ) {
        // A message of a newer dialect shows nothing here, as it showed the bridge nothing.
        let Ok(message) = frame.message() else {
            return;
        };
        let header = frame.header();
        let node = Node::new(header.system_id, header.component_id);
        // The file holds what was sent to the vehicle too: the vehicle is who has an autopilot.
        if let (None, MavMessage::HEARTBEAT(beat)) = (self.autopilot, &message)
            && beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
        {
            self.autopilot = Some(node);
            self.texts = Some(Texts::new(node.system));
        }
        let Some(autopilot) = self.autopilot else {
            return;
        };
        if node.system != autopilot.system {
            return;
        }
        if let Some(texts) = &mut self.texts {
            texts.handle_message(wall, node, &message);
            texts.handle_timeout(wall);
            while let Some(text) = texts.poll_event() {
                let level = LogLevel::of(mapping::alert::priority(text.severity));
                let text = mapping::alert::shortened(text.text);
                events.push((wall, entry(level, id, format!("{TEXT}{text}"))));
            }
        }
        if is_of_payload(&message) {
            self.payloads.update(wall, node.component, &message);
        }
        if node != autopilot {
            return;
        }
        let before = (self.telemetry.mode, self.telemetry.armed);
        self.telemetry.update(&message);
        self.payloads.note_time(wall, self.telemetry.boot_ms());
        if matches!(
            message,
            MavMessage::HEARTBEAT(_) | MavMessage::CURRENT_MODE(_)
        ) {
            self.mode_at = Some(wall);
        }
        self.read_plan(wall, &message);
        let (mode, armed) = (self.telemetry.mode, self.telemetry.armed);
        let mut changed = false;
        if let Some(mode) = mode.filter(|_| mode != before.0) {
            let text = format!("the vehicle is in mode {}", mode.name());
            events.push((wall, entry(LogLevel::Info, id, text)));
            changed = true;
        }
        if let Some(armed) = armed.filter(|_| armed != before.1) {
            let text = format!("motors {}", if armed { "armed" } else { "disarmed" });
            events.push((wall, entry(LogLevel::Info, id, text)));
            changed = true;
        }
        let last = self.samples.0.last().map(|(at, _)| *at);
        if changed || last.is_none_or(|last| wall.saturating_sub(last) >= SAMPLE_EVERY) {
            let sample = self.sample(wall);
            self.samples.push(wall, sample);
        }
    }

    fn sample(&self, wall: Duration) -> Sample {
        let telemetry = &self.telemetry;
        let ground = telemetry.home.map(|home| Ground::Flat(home.amsl_m));
        let looks_at =
            ground.map(|ground| footprints(&self.payloads, &[], telemetry, &ground, wall));
        Sample {
            position: telemetry.position,
            home: telemetry.home,
            motion: motion(telemetry),
            mode: telemetry.mode,
            armed: telemetry.armed,
            on_ground: telemetry.landed.map(|_| telemetry.stands()),
            battery: telemetry.battery,
            mode_at: self.mode_at,
            looks_at: looks_at.unwrap_or_default(),
        }
    }

    /// The vehicle answers a request for its plan by MISSION_COUNT, and an item for each that is requested.
    fn read_plan(&mut self, wall: Duration, message: &MavMessage) {
        let kind = match message {
            MavMessage::MISSION_COUNT(count) => {
                let kind = count.mission_type as u8;
                let count = usize::from(count.count);
                let items = BTreeMap::new();
                self.reading.insert(kind, Reading { count, items });
                kind
            }
            MavMessage::MISSION_ITEM_INT(item) => {
                let kind = item.mission_type as u8;
                let Some(reading) = self.reading.get_mut(&kind) else {
                    return;
                };
                reading.items.insert(item.seq, Item::from(item));
                kind
            }
            _ => return,
        };
        let whole = |reading: &Reading| reading.items.len() >= reading.count;
        if self.reading.get(&kind).is_some_and(whole)
            && let Some(reading) = self.reading.remove(&kind)
        {
            let items = reading.items.into_values().collect();
            self.plans.entry(kind).or_default().set(wall, items);
        }
    }

    /// The plan of a kind at this moment.
    pub(super) fn plan(&self, kind: MavMissionType, moment: Duration) -> Option<&[Item]> {
        let (_, items) = self.plans.get(&(kind as u8))?.at(moment)?;
        (!items.is_empty()).then_some(items.as_slice())
    }
}

/// What the vehicle's texts begin with, as events.
pub(super) const TEXT: &str = "the vehicle reports: ";
/// The page asks as often. A change of mode is sampled at once.
const SAMPLE_EVERY: Duration = Duration::from_millis(200);
