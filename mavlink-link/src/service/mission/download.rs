//! A download: item by item in order, since PX4 aborts a transfer with requests out of order.

use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_REQUEST_INT_DATA, MISSION_REQUEST_LIST_DATA,
    MavMessage, MavMissionResult, MavMissionType,
};

use super::event::{Event, Failure, Operation};
use super::item::Item;
use super::transfer::{Context, Repeat, ack};

/// The state of one download.
#[derive(Debug)]
pub(super) struct Download {
    kind: MavMissionType,
    /// How many times the transfer was started.
    attempt: u8,
    /// MISSION_COUNT's count and opaque_id, once received.
    announced: Option<(u16, u32)>,
    items: Vec<Item>,
    /// Repeats MISSION_REQUEST_LIST, then the request for the next item.
    repeat: Repeat,
    /// The attempt has failed then, unless the next item arrives.
    stalled_at: Duration,
    /// The attempt is restarted then, unless the next item arrives: the vehicle has reported an error.
    restart_at: Option<Duration>,
    last_error: Option<Failure>,
}

type End = Option<Result<Event, Failure>>;

impl Download {
    /// Sends the first MISSION_REQUEST_LIST.
    pub(super) fn start(now: Duration, kind: MavMissionType, context: &mut Context<'_>) -> Self {
        let mut download = Self {
            kind,
            attempt: 0,
            announced: None,
            items: Vec::new(),
            repeat: Repeat::first(now, &context.timing),
            stalled_at: now,
            restart_at: None,
            last_error: None,
        };
        download.begin(now, context);
        download
    }

    pub(super) const fn kind(&self) -> MavMissionType {
        self.kind
    }

    pub(super) fn deadline(&self) -> Duration {
        let own = if self.announced.is_some() {
            self.repeat.at.min(self.stalled_at)
        } else {
            self.repeat.at
        };
        self.restart_at.map_or(own, |at| at.min(own))
    }

    pub(super) fn handle_message(
        &mut self,
        now: Duration,
        message: &MavMessage,
        context: &mut Context<'_>,
    ) -> End {
        match message {
            MavMessage::MISSION_COUNT(m) => self.handle_count(now, m, context),
            MavMessage::MISSION_ITEM_INT(m) => self.handle_item(now, m.seq, m.into(), context),
            MavMessage::MISSION_ITEM(m) => self.handle_item(now, m.seq, m.into(), context),
            MavMessage::MISSION_ACK(m) => self.handle_ack(now, m, context),
            _ => None,
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Duration, context: &mut Context<'_>) -> End {
        let lost = self.announced.is_some() && self.stalled_at <= now;
        // PX4 ends a stalled transfer after 5 s without MISSION_ACK, and then ignores requests for items.
        if lost || self.restart_at.is_some_and(|at| at <= now) {
            return self.restart(now, context);
        }
        if self.announced.is_some() {
            self.request_next(now, context);
        } else if self.repeat.again(now, &context.timing) {
            self.send_request_list(context);
        } else {
            return Some(Err(self.failure()));
        }
        None
    }

    fn handle_count(
        &mut self,
        now: Duration,
        count: &MISSION_COUNT_DATA,
        context: &mut Context<'_>,
    ) -> End {
        let announced = (count.count, count.opaque_id);
        // A repeat of the same count answers our repeated MISSION_REQUEST_LIST.
        if self.announced == Some(announced) {
            return None;
        }
        if !self.items.is_empty() {
            // The stored plan has changed meanwhile: the items so far belong to another one.
            return self.restart(now, context);
        }
        self.announced = Some(announced);
        self.stalled_at = now + context.timing.stall;
        self.continue_or_finish(now, context)
    }

    fn handle_item(
        &mut self,
        now: Duration,
        seq: u16,
        item: Item,
        context: &mut Context<'_>,
    ) -> End {
        let (count, _) = self.announced?;
        // A repeat of the item before, or one of an earlier transfer. PX4 expects requests in order, so no gap can be
        // filled later.
        if usize::from(seq) != self.items.len() {
            return None;
        }
        self.items.push(item);
        self.stalled_at = now + context.timing.stall;
        // An item arrived, so the vehicle has not aborted: the error was about a late duplicate of a request.
        self.restart_at = None;
        context.progress(Operation::Download, seq.saturating_add(1), count);
        self.continue_or_finish(now, context)
    }

    fn handle_ack(&mut self, now: Duration, ack: &MISSION_ACK_DATA, context: &Context<'_>) -> End {
        use MavMissionResult as R;
        match ack.mavtype {
            // The late end of an upload.
            R::MAV_MISSION_ACCEPTED => None,
            result @ (R::MAV_MISSION_ERROR | R::MAV_MISSION_INVALID_SEQUENCE) => {
                self.last_error = Some(self.refusal(result));
                // PX4 sends this for a late duplicate too: continue if the next item arrives, else restart.
                self.restart_at.get_or_insert(now + context.timing.settle);
                None
            }
            result => Some(Err(self.refusal(result))),
        }
    }

    fn continue_or_finish(&mut self, now: Duration, context: &mut Context<'_>) -> End {
        let (count, opaque_id) = self.announced?;
        if self.items.len() < usize::from(count) {
            self.request_next(now, context);
            return None;
        }
        // Without it PX4 stays in the transfer for 5 s and refuses an upload meanwhile.
        let accepted = MavMissionResult::MAV_MISSION_ACCEPTED;
        context.out.push(ack(context.vehicle, self.kind, accepted));
        Some(Ok(Event::Downloaded {
            kind: self.kind,
            items: std::mem::take(&mut self.items),
            opaque_id,
        }))
    }

    fn restart(&mut self, now: Duration, context: &mut Context<'_>) -> End {
        if self.attempt >= context.timing.attempts {
            return Some(Err(self.failure()));
        }
        self.begin(now, context);
        None
    }

    fn begin(&mut self, now: Duration, context: &mut Context<'_>) {
        // PX4 in this state accepts MISSION_REQUEST_LIST of its partner again and starts from item 0.
        self.attempt += 1;
        self.announced = None;
        self.items.clear();
        self.repeat = Repeat::first(now, &context.timing);
        self.restart_at = None;
        self.send_request_list(context);
    }

    fn next_seq(&self) -> Option<u16> {
        self.announced
            .and_then(|_| u16::try_from(self.items.len()).ok())
    }

    fn refusal(&self, result: MavMissionResult) -> Failure {
        Failure::Refused {
            result,
            seq: self.next_seq(),
        }
    }

    fn failure(&self) -> Failure {
        self.last_error.unwrap_or(Failure::NoAnswer {
            seq: self.next_seq(),
        })
    }

    fn send_request_list(&self, context: &mut Context<'_>) {
        let request = MISSION_REQUEST_LIST_DATA {
            target_system: context.vehicle.system,
            target_component: context.vehicle.component,
            mission_type: self.kind,
        };
        context
            .out
            .push_once(MavMessage::MISSION_REQUEST_LIST(request));
    }

    fn request_next(&mut self, now: Duration, context: &mut Context<'_>) {
        let Some(seq) = self.next_seq() else {
            return;
        };
        self.repeat.at = now + context.timing.item;
        let request = MISSION_REQUEST_INT_DATA {
            seq,
            target_system: context.vehicle.system,
            target_component: context.vehicle.component,
            mission_type: self.kind,
        };
        context
            .out
            .push_once(MavMessage::MISSION_REQUEST_INT(request));
    }
}
