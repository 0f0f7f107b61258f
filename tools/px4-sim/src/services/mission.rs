//! The vehicle's end of missions, as PX4 v1.18's mission manager behaves on the wire.
//!
//! One transfer at a time, and one outstanding item request, repeated every 0.25 s. 5 s after the partner's last message
//! the transfer is dropped, with a text and without a MISSION_ACK. Each item is checked on arrival, and the first bad one
//! ends the transfer; the previous plan stays until the last item of the new one has arrived.

use std::time::Duration;

use mavlink::Message as _;
use mavlink::dialects::development::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_REQUEST_DATA, MISSION_REQUEST_INT_DATA,
    MavMessage, MavMissionResult, MavMissionType,
};
use mavlink_link::service::mission::{
    FRAME_GLOBAL, FRAME_GLOBAL_RELATIVE, Item, extend_plan_id, px4_read_back,
};
use mavlink_link::service::{Bounded, Node};

use super::mission_rules::{ItemFault, ItemRules};

/// How many items of a kind the vehicle stores.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Limits {
    /// Mission items.
    pub mission: u16,
    /// Vertices and circles of the geofence.
    pub fence: u16,
    /// Rally points.
    pub rally: u16,
}

impl Limits {
    /// PX4 v1.18 in its simulation; boards hold 500 to 2000 mission items.
    pub const PX4_SITL: Self = Self {
        mission: 10_000,
        fence: 64,
        rally: 32,
    };
}

/// What happened to the vehicle's plans.
#[derive(Clone, PartialEq, Debug)]
pub enum ServerEvent {
    /// Another plan of this kind is stored; an upload of the stored plan raises no event.
    Stored {
        /// What kind of plan.
        kind: MavMissionType,
        /// Its id; 0 when it was cleared.
        opaque_id: u32,
        /// The last item that carried current = 1.
        start: Option<u16>,
    },
    /// MISSION_SET_CURRENT was accepted.
    CurrentSet(u16),
    /// A STATUSTEXT to send, of severity MAV_SEVERITY_CRITICAL.
    Text(&'static str),
}

/// The mission services of a simulated PX4.
#[derive(Debug)]
pub struct Server<R> {
    us: Node,
    limits: Limits,
    rules: R,
    plans: [Plan; 3],
    current: Option<u16>,
    /// Whether the partner last used MISSION_ITEM_INT instead of MISSION_ITEM. PX4 keeps the choice for the next
    /// upload.
    int: bool,
    partner: Option<Node>,
    kind: MavMissionType,
    state: State,
    /// The CRC and the number of items of the transfer received last.
    received: (u32, u16),
    last_sent: Duration,
    last_received: Duration,
    out: Bounded<MavMessage>,
    events: Bounded<ServerEvent>,
}

#[derive(Clone, Debug, Default)]
struct Plan {
    items: Vec<Item>,
    opaque_id: u32,
}

#[derive(Debug)]
enum State {
    Idle,
    Receiving {
        count: u16,
        items: Vec<Item>,
    },
    /// `next`: the request that is expected.
    Sending {
        count: u16,
        next: u16,
    },
}

impl<R: ItemRules> Server<R> {
    /// A vehicle without plans.
    pub fn new(us: Node, limits: Limits, rules: R) -> Self {
        Self {
            us,
            limits,
            rules,
            plans: Default::default(),
            current: None,
            int: true,
            partner: None,
            kind: MavMissionType::MAV_MISSION_TYPE_MISSION,
            state: State::Idle,
            received: (0, 0),
            last_sent: Duration::ZERO,
            last_received: Duration::ZERO,
            out: Bounded::new(MAX_OUT),
            events: Bounded::new(MAX_EVENTS),
        }
    }

    /// The stored items of a kind, as they were received.
    pub fn items(&self, kind: MavMissionType) -> &[Item] {
        index(kind).map_or(&[], |index| &self.plans[index].items)
    }

    /// The id of the stored plan: MISSION_CURRENT.mission_id, fence_id, rally_points_id.
    pub fn opaque_id(&self, kind: MavMissionType) -> u32 {
        index(kind).map_or(0, |index| self.plans[index].opaque_id)
    }

    /// The current mission item, which a download marks; the vehicle reports its progress here.
    pub fn set_current(&mut self, seq: Option<u16>) {
        self.current = seq;
    }

    /// The current mission item.
    pub const fn current(&self) -> Option<u16> {
        self.current
    }

    /// Whether a transfer is in progress.
    pub const fn is_busy(&self) -> bool {
        !matches!(self.state, State::Idle)
    }

    /// Handles a message of `from`; returns whether it was for this service.
    pub fn handle_message(&mut self, now: Duration, from: Node, message: &MavMessage) -> bool {
        use MavMessage as M;
        let (Some(system), Some(component)) =
            (message.target_system_id(), message.target_component_id())
        else {
            return false;
        };
        // PX4 treats MAV_COMP_ID_MISSIONPLANNER as its own component id in mission messages.
        let planner = (system, component) == (self.us.system, MISSION_PLANNER);
        if !planner && !self.us.is_target(system, component) {
            return false;
        }
        match message {
            M::MISSION_ACK(m) => self.handle_ack(now, from, m),
            M::MISSION_SET_CURRENT(m) => self.handle_set_current(now, m.seq),
            M::MISSION_REQUEST_LIST(m) => self.handle_request_list(now, from, m.mission_type),
            M::MISSION_REQUEST(m) => {
                self.int = false;
                self.handle_request(now, from, m.seq, m.mission_type);
            }
            M::MISSION_REQUEST_INT(m) => {
                self.int = true;
                self.handle_request(now, from, m.seq, m.mission_type);
            }
            M::MISSION_COUNT(m) => self.handle_count(now, from, m.count, m.mission_type),
            M::MISSION_ITEM(m) => {
                self.int = false;
                let bytes = (m.x.to_le_bytes(), m.y.to_le_bytes());
                self.handle_item(now, from, m.seq, m.mission_type, m.into(), bytes);
            }
            M::MISSION_ITEM_INT(m) => {
                self.int = true;
                let bytes = (m.x.to_le_bytes(), m.y.to_le_bytes());
                self.handle_item(now, from, m.seq, m.mission_type, m.into(), bytes);
            }
            M::MISSION_CLEAR_ALL(m) => self.handle_clear(now, from, m.mission_type),
            _ => return false,
        }
        true
    }

    /// Repeats a request or drops a transfer, whichever is due.
    pub fn handle_timeout(&mut self, now: Duration) {
        if !self.is_busy() {
            return;
        }
        if now.saturating_sub(self.last_received) > TIMEOUT {
            self.text("Mission sync timeout\t");
            self.state = State::Idle;
        } else if now.saturating_sub(self.last_sent) > RETRY {
            match &self.state {
                State::Receiving { .. } => self.send_request(now),
                State::Sending { next: 0, .. } => self.send_count(now),
                _ => {}
            }
        }
    }

    /// When [`Server::handle_timeout`] is next needed.
    pub fn poll_timeout(&self) -> Option<Duration> {
        // The comparison in `handle_timeout` is strict, so one tick is added.
        let give_up = self.last_received + TIMEOUT + TICK;
        match self.state {
            State::Idle => None,
            State::Sending { next, .. } if next > 0 => Some(give_up),
            _ => Some(give_up.min(self.last_sent + RETRY + TICK)),
        }
    }

    /// The next message to send; it names its target.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<ServerEvent> {
        self.events.pop()
    }

    fn handle_ack(&mut self, now: Duration, from: Node, ack: &MISSION_ACK_DATA) {
        if self.partner != Some(from) {
            self.text("REJ. WP CMD: partner id mismatch\t");
            return;
        }
        match self.state {
            // Whatever the result, the partner requests no further items.
            State::Sending { .. } if ack.mission_type == self.kind => self.state = State::Idle,
            State::Receiving { .. } => match ack.mavtype {
                MavMissionResult::MAV_MISSION_UNSUPPORTED => {
                    self.int = !self.int;
                    self.send_request(now);
                }
                MavMissionResult::MAV_MISSION_OPERATION_CANCELLED => self.state = State::Idle,
                _ => {}
            },
            _ => {}
        }
    }

    fn handle_set_current(&mut self, now: Duration, seq: u16) {
        if self.is_busy() {
            self.text("WPM: IGN WP CURR CMD: Busy\t");
            return;
        }
        self.last_received = now;
        let mission = self.items(MavMissionType::MAV_MISSION_TYPE_MISSION);
        if usize::from(seq) < mission.len() {
            self.current = Some(seq);
            self.events.push(ServerEvent::CurrentSet(seq));
        } else {
            self.text("WPM: WP CURR CMD: Not in list\t");
        }
    }

    fn handle_clear(&mut self, now: Duration, from: Node, kind: MavMissionType) {
        if self.is_busy() {
            self.text("WPM: IGN CLEAR CMD: Busy\t");
            return;
        }
        self.last_received = now;
        self.kind = kind;
        for each in KINDS {
            if [each, MavMissionType::MAV_MISSION_TYPE_ALL].contains(&kind) {
                self.store(each, Vec::new(), 0);
            }
        }
        self.send_ack(from, MavMissionResult::MAV_MISSION_ACCEPTED, 0);
    }

    fn store(&mut self, kind: MavMissionType, items: Vec<Item>, opaque_id: u32) {
        let Some(index) = index(kind) else {
            return;
        };
        // PX4 applies `current` of each item as it arrives, so the last one wins.
        let start = items.iter().rposition(|item| item.current);
        let start = start.and_then(|seq| u16::try_from(seq).ok());
        self.plans[index] = Plan { items, opaque_id };
        if kind == MavMissionType::MAV_MISSION_TYPE_MISSION {
            self.current = start;
        }
        self.events.push(ServerEvent::Stored {
            kind,
            opaque_id,
            start,
        });
    }

    fn max(&self, kind: MavMissionType) -> u16 {
        match kind {
            MavMissionType::MAV_MISSION_TYPE_MISSION => self.limits.mission,
            MavMissionType::MAV_MISSION_TYPE_FENCE => self.limits.fence,
            MavMissionType::MAV_MISSION_TYPE_RALLY => self.limits.rally,
            MavMissionType::MAV_MISSION_TYPE_ALL => 0,
        }
    }

    fn send_ack(&mut self, to: Node, result: MavMissionResult, opaque_id: u32) {
        self.out.push(MavMessage::MISSION_ACK(MISSION_ACK_DATA {
            target_system: to.system,
            target_component: to.component,
            mavtype: result,
            mission_type: self.kind,
            opaque_id,
        }));
    }

    fn reject(&mut self, from: Node, text: &'static str) {
        self.text(text);
        self.send_ack(from, MavMissionResult::MAV_MISSION_ERROR, 0);
    }

    fn text(&mut self, text: &'static str) {
        self.events.push(ServerEvent::Text(text));
    }
}

/// Receiving a plan: MISSION_COUNT, then item after item.
impl<R: ItemRules> Server<R> {
    fn handle_count(&mut self, now: Duration, from: Node, count: u16, kind: MavMissionType) {
        match &self.state {
            State::Idle => {
                self.last_received = now;
                self.partner = Some(from);
                self.kind = kind;
                let accepted = MavMissionResult::MAV_MISSION_ACCEPTED;
                if count > self.max(kind) {
                    self.send_ack(from, MavMissionResult::MAV_MISSION_NO_SPACE, 0);
                    return;
                }
                if count == 0 {
                    self.store(kind, Vec::new(), 0);
                    self.send_ack(from, accepted, 0);
                    return;
                }
                self.state = State::Receiving {
                    count,
                    items: Vec::new(),
                };
                self.received = (0, 0);
            }
            State::Receiving { items, .. } => {
                self.last_received = now;
                if self.partner != Some(from) {
                    self.send_ack(from, MavMissionResult::MAV_MISSION_ERROR, 0);
                    return;
                }
                // Before the first item, PX4 takes a repeated count as a sign that its answer was lost.
                if !items.is_empty() {
                    return self.reject(from, "WPM: REJ. CMD: Busy\t");
                }
            }
            State::Sending { .. } => return self.reject(from, "WPM: IGN MISSION_COUNT: Busy\t"),
        }
        self.send_request(now);
    }

    fn handle_item(
        &mut self,
        now: Duration,
        from: Node,
        seq: u16,
        kind: MavMissionType,
        item: Item,
        (x, y): ([u8; 4], [u8; 4]),
    ) {
        use MavMissionResult as R;
        if self.partner != Some(from) {
            self.text("REJ. MIS ITEM: partner id mismatch\t");
            return;
        }
        if kind != self.kind {
            self.send_ack(from, R::MAV_MISSION_ERROR, 0);
            return;
        }
        let (crc, received) = self.received;
        let (count, items) = match &mut self.state {
            State::Receiving { count, items } => (*count, items),
            State::Idle if seq.checked_add(1) == Some(received) => {
                // The last MISSION_ACK was lost, and this item is a repetition.
                self.send_ack(from, R::MAV_MISSION_ACCEPTED, crc);
                return;
            }
            State::Idle => return self.reject(from, "IGN MISSION_ITEM: No transfer\t"),
            State::Sending { .. } => return self.reject(from, "IGN MISSION_ITEM: Busy\t"),
        };
        self.last_received = now;
        if seq != received {
            return;
        }
        if let Err(fault) = self.rules.check(kind, &item, self.int) {
            self.refuse(from, fault);
            return;
        }
        items.push(item);
        let crc = extend_plan_id(crc, &item, x, y);
        self.received = (crc, received + 1);
        if received + 1 < count {
            self.send_request(now);
            return;
        }
        let items = std::mem::take(items);
        self.state = State::Idle;
        // PX4 compares the CRC with that of the stored plan: an identical upload changes nothing in flight.
        if crc != self.opaque_id(kind) {
            self.store(kind, items, crc);
        }
        self.send_ack(from, R::MAV_MISSION_ACCEPTED, crc);
    }

    fn refuse(&mut self, from: Node, fault: ItemFault) {
        // PX4 sends a text only for faults of the item itself.
        if fault != ItemFault::Other {
            self.text("IGN MISSION_ITEM: Invalid item\t");
        }
        self.state = State::Idle;
        self.send_ack(from, fault.result(), 0);
    }

    fn send_request(&mut self, now: Duration) {
        let Some(to) = self.partner else {
            return;
        };
        self.last_sent = now;
        let (target_system, target_component) = (to.system, to.component);
        let (_, seq) = self.received;
        let mission_type = self.kind;
        self.out.push(if self.int {
            MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            })
        } else {
            MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            })
        });
    }
}

/// Sending the stored plan: MISSION_REQUEST_LIST, then request after request.
impl<R: ItemRules> Server<R> {
    fn handle_request_list(&mut self, now: Duration, from: Node, kind: MavMissionType) {
        let again = self.kind == kind && self.partner == Some(from);
        let ignored = match self.state {
            State::Idle => false,
            State::Sending { next, .. } => {
                // Once all items were requested PX4 counts the transfer as complete, even without a MISSION_ACK.
                usize::from(next) != self.items(self.kind).len() && !again
            }
            State::Receiving { .. } => true,
        };
        if ignored {
            self.text("Mission download request ignored, already active\t");
            return;
        }
        self.last_received = now;
        self.kind = kind;
        self.partner = Some(from);
        let count = u16::try_from(self.items(kind).len()).unwrap_or(u16::MAX);
        self.state = State::Sending { count, next: 0 };
        self.send_count(now);
    }

    fn handle_request(&mut self, now: Duration, from: Node, seq: u16, kind: MavMissionType) {
        if self.partner != Some(from) {
            self.text("WPM: REJ. CMD: partner id mismatch\t");
            return;
        }
        match &mut self.state {
            State::Idle => {}
            State::Receiving { .. } => self.text("WPM: REJ. CMD: Busy\t"),
            State::Sending { count, next } if kind == self.kind => {
                self.last_received = now;
                if seq == *next && *next < *count {
                    *next += 1;
                } else if seq.checked_add(1) != Some(*next) {
                    self.abort_sending(from);
                    return;
                }
                self.send_item(now, from, seq);
            }
            State::Sending { .. } => {}
        }
    }

    fn abort_sending(&mut self, to: Node) {
        self.state = State::Idle;
        self.reject(to, "WPM: REJ. CMD: Req. WP was unexpected\t");
    }

    fn send_count(&mut self, now: Duration) {
        let (Some(to), State::Sending { count, .. }) = (self.partner, &self.state) else {
            return;
        };
        let message = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: *count,
            target_system: to.system,
            target_component: to.component,
            mission_type: self.kind,
            opaque_id: self.opaque_id(self.kind),
        });
        self.last_sent = now;
        self.out.push(message);
    }

    fn send_item(&mut self, now: Duration, to: Node, seq: u16) {
        let Some(stored) = self.items(self.kind).get(usize::from(seq)) else {
            self.abort_sending(to);
            return;
        };
        let mut item = px4_read_back(self.kind, stored);
        item.current = self.current == Some(seq);
        self.last_sent = now;
        let message = if self.int {
            item.to_message(to, self.kind, seq)
        } else {
            // The float message uses the frames without INT in their names.
            item.frame = match item.frame {
                5 => FRAME_GLOBAL,
                6 => FRAME_GLOBAL_RELATIVE,
                frame => frame,
            };
            item.to_float_message(to, self.kind, seq)
        };
        // The item arrived in a message, so a message can carry it: this cannot fail.
        if let Ok(message) = message {
            self.out.push(message);
        }
    }
}

/// PX4's MAVLINK_MISSION_PROTOCOL_TIMEOUT_DEFAULT.
const TIMEOUT: Duration = Duration::from_secs(5);
/// PX4's MAVLINK_MISSION_RETRY_TIMEOUT_DEFAULT.
const RETRY: Duration = Duration::from_millis(250);
/// The smallest step of the clock.
const TICK: Duration = Duration::from_micros(1);
/// MAV_COMP_ID_MISSIONPLANNER, an alias of the autopilot for missions.
const MISSION_PLANNER: u8 = 190;
/// Messages and events that wait at most; a test may never poll them.
const MAX_OUT: usize = 64;
const MAX_EVENTS: usize = 64;

/// The kinds of plan that a vehicle stores.
pub(crate) const KINDS: [MavMissionType; 3] = [
    MavMissionType::MAV_MISSION_TYPE_MISSION,
    MavMissionType::MAV_MISSION_TYPE_FENCE,
    MavMissionType::MAV_MISSION_TYPE_RALLY,
];

fn index(kind: MavMissionType) -> Option<usize> {
    KINDS.iter().position(|&known| known == kind)
}
