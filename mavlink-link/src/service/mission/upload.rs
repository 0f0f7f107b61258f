//! An upload: the vehicle requests one item after the other.

use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MavMessage, MavMissionResult, MavMissionType,
};

use super::event::{Event, Failure, Operation};
use super::item::{Item, plan_id};
use super::transfer::{Context, Repeat};

/// The state of one upload.
#[derive(Debug)]
pub(super) struct Upload {
    kind: MavMissionType,
    items: Vec<Item>,
    count: u16,
    id: u32,
    /// How many times the transfer was started.
    attempt: u8,
    /// Items that the vehicle has requested in this attempt: all below this one.
    requested: u16,
    /// Repeats MISSION_COUNT while no item was requested, and the last item once all were.
    repeat: Repeat,
    /// The attempt has failed then, unless the vehicle requests a further item.
    stalled_at: Duration,
    /// The attempt is restarted then, unless the vehicle requests any item.
    restart_at: Option<Duration>,
    /// The failure to report when no attempt succeeds.
    last_error: Option<Failure>,
}

type End = Option<Result<Event, Failure>>;

impl Upload {
    /// Sends the first MISSION_COUNT. `count` is the number of items.
    pub(super) fn start(
        now: Duration,
        kind: MavMissionType,
        items: Vec<Item>,
        count: u16,
        context: &mut Context<'_>,
    ) -> Self {
        let id = plan_id(&items);
        let mut upload = Self {
            kind,
            items,
            count,
            id,
            attempt: 0,
            requested: 0,
            repeat: Repeat::first(now, &context.timing),
            stalled_at: now,
            restart_at: None,
            last_error: None,
        };
        upload.begin(now, context);
        upload
    }

    pub(super) const fn kind(&self) -> MavMissionType {
        self.kind
    }

    pub(super) fn deadline(&self) -> Duration {
        if self.requested == 0 {
            // Nothing was requested yet: after MAV_MISSION_ERROR the vehicle is busy, and repeated counts would keep it so.
            return self.restart_at.unwrap_or(self.repeat.at);
        }
        // PX4 requests a lost item again every 0.25 s. After the last item it has nothing left to request, so we repeat
        // that one.
        let own = if self.requested == self.count {
            self.repeat.at.min(self.stalled_at)
        } else {
            self.stalled_at
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
            MavMessage::MISSION_REQUEST_INT(m) => self.handle_request(now, m.seq, context),
            // After a float transfer PX4 requests with MISSION_REQUEST (40), and accepts MISSION_ITEM_INT all the same.
            MavMessage::MISSION_REQUEST(m) => self.handle_request(now, m.seq, context),
            MavMessage::MISSION_ACK(m) => return self.handle_ack(now, m, context),
            _ => {}
        }
        None
    }

    pub(super) fn handle_timeout(&mut self, now: Duration, context: &mut Context<'_>) -> End {
        // PX4 ends a stalled transfer after 5 s without MISSION_ACK, so silence is the only sign of it.
        let lost = self.requested > 0 && self.stalled_at <= now;
        if lost || self.restart_at.is_some_and(|at| at <= now) {
            return self.restart(now, context);
        }
        if self.requested == 0 {
            if self.restart_at.is_some() {
                return None;
            }
            if !self.repeat.again(now, &context.timing) {
                return Some(Err(self.failure()));
            }
            self.send_count(context);
        } else if self.requested == self.count {
            // The last item or its MISSION_ACK is lost; PX4 answers a repeated last item with another MISSION_ACK.
            self.repeat.at = now + context.timing.item;
            self.send_item(self.count - 1, context);
        }
        None
    }

    fn handle_request(&mut self, now: Duration, seq: u16, context: &mut Context<'_>) {
        if seq > self.requested || seq >= self.count {
            // Out of order: the vehicle is in another transfer, and would mix the two plans.
            context.cancel(self.kind);
            self.restart_at = Some(now + context.timing.settle);
            return;
        }
        if seq == self.requested {
            self.requested += 1;
            self.stalled_at = now + context.timing.stall;
            // A request for an item shows that all before it are stored.
            context.progress(Operation::Upload, seq, self.count);
        }
        // The vehicle requests items, so the error was about a late duplicate.
        self.restart_at = None;
        self.repeat.at = now + context.timing.item;
        // On a slow link the vehicle requests an item again before it has arrived. Once it requests the next item, a queued
        // repetition is useless and would delay that one by as much again.
        context.out.retain(
            |waits| !matches!(waits, MavMessage::MISSION_ITEM_INT(item) if item.seq != seq),
        );
        self.send_item(seq, context);
    }

    fn handle_ack(&mut self, now: Duration, ack: &MISSION_ACK_DATA, context: &Context<'_>) -> End {
        use MavMissionResult as R;
        let soon = now + context.timing.settle;
        match ack.mavtype {
            R::MAV_MISSION_ACCEPTED => {
                // 0 comes from autopilots without plan ids, such as ArduPilot.
                let ours = ack.opaque_id == 0 || ack.opaque_id == self.id;
                if ours && self.requested == self.count {
                    return Some(Ok(Event::Uploaded {
                        kind: self.kind,
                        opaque_id: ack.opaque_id,
                    }));
                }
                // Late, of another transfer; or this transfer has gone wrong.
                if !ours {
                    self.last_error = Some(Failure::OtherPlan {
                        expected: self.id,
                        found: ack.opaque_id,
                    });
                }
                self.restart_at.get_or_insert(soon);
            }
            result @ (R::MAV_MISSION_ERROR | R::MAV_MISSION_INVALID_SEQUENCE) => {
                self.last_error = Some(self.refusal(result));
                // Before the first request it means busy, possibly with another station. PX4 drops a dead transfer only
                // when nobody sends MISSION_COUNT for 5 s.
                let at = if self.requested == 0 {
                    now + context.timing.stall
                } else {
                    soon
                };
                self.restart_at.get_or_insert(at);
            }
            // Late: it is about an item, and we have sent none.
            R::MAV_MISSION_UNSUPPORTED_FRAME
            | R::MAV_MISSION_UNSUPPORTED
            | R::MAV_MISSION_INVALID_PARAM1
            | R::MAV_MISSION_INVALID_PARAM2
            | R::MAV_MISSION_INVALID_PARAM3
            | R::MAV_MISSION_INVALID_PARAM4
            | R::MAV_MISSION_INVALID_PARAM5_X
            | R::MAV_MISSION_INVALID_PARAM6_Y
            | R::MAV_MISSION_INVALID_PARAM7
                if self.requested == 0 => {}
            result => return Some(Err(self.refusal(result))),
        }
        None
    }

    fn restart(&mut self, now: Duration, context: &mut Context<'_>) -> End {
        if self.attempt >= context.timing.attempts {
            return Some(Err(self.failure()));
        }
        // Items still in the queue belong to the transfer that ends here.
        context.out.clear();
        // With nothing requested the vehicle may be in a transfer with another station. PX4 rejects a cancellation of
        // anyone else, with a critical STATUSTEXT.
        if self.requested > 0 {
            context.cancel(self.kind);
        }
        self.begin(now, context);
        None
    }

    fn begin(&mut self, now: Duration, context: &mut Context<'_>) {
        self.attempt += 1;
        self.requested = 0;
        self.repeat = Repeat::first(now, &context.timing);
        self.stalled_at = now + context.timing.stall;
        self.restart_at = None;
        self.send_count(context);
    }

    fn refusal(&self, result: MavMissionResult) -> Failure {
        Failure::Refused {
            result,
            seq: self.requested.checked_sub(1),
        }
    }

    fn failure(&self) -> Failure {
        self.last_error.unwrap_or(Failure::NoAnswer {
            seq: self.requested.checked_sub(1),
        })
    }

    fn send_count(&self, context: &mut Context<'_>) {
        context
            .out
            .push_once(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                count: self.count,
                target_system: context.vehicle.system,
                target_component: context.vehicle.component,
                mission_type: self.kind,
                // PX4 computes the id itself and returns it; the field carries none on the way up.
                opaque_id: 0,
            }));
    }

    fn send_item(&self, seq: u16, context: &mut Context<'_>) {
        let Some(item) = self.items.get(usize::from(seq)) else {
            return;
        };
        // Every item was checked against the dialect before the transfer began.
        if let Ok(message) = item.to_message(context.vehicle, self.kind, seq) {
            context.out.push_once(message);
        }
    }
}
