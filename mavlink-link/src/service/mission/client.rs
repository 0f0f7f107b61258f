//! The client: one operation at a time with one vehicle.
//!
//! MAVLink gives a transfer no id, so messages of an earlier one can disturb the present one. Countermeasures:
//! - items are sent in the order requested, 0 first, with any number of repeats; a request out of order
//!   belongs to another transfer, which is cancelled before it can mix two plans;
//! - an upload is complete only when every item was requested and MISSION_ACK.opaque_id is
//!   this plan's [`plan_id`](super::plan_id) (0, from autopilots without plan ids, is accepted);
//! - PX4 answers a late duplicate with MAV_MISSION_ERROR as well as a real failure, so it
//!   ends nothing by itself: the vehicle continues to request items, or the transfer starts again.

use std::ops::RangeInclusive;
use std::time::Duration;

use mavlink::dialects::development::{MavMessage, MavMissionResult, MavMissionType};

use super::download::Download;
use super::event::{Event, Failure, Operation, StartError, Timing};
use super::item::Item;
use super::transfer::{Context, Repeat, cancel, clear_all, set_current};
use super::upload::Upload;
use crate::frame::Node;
use crate::service::bounded::Bounded;

/// The mission service of one vehicle, as a ground station uses it.
#[derive(Debug)]
pub struct Client {
    us: Node,
    vehicle: Node,
    timing: Timing,
    job: Option<Job>,
    /// The vehicle may still be in this transfer: it did not acknowledge the end.
    unconfirmed: Option<MavMissionType>,
    cancelled: bool,
    out: Bounded<MavMessage>,
    events: Bounded<Event>,
}

impl Client {
    /// A client named `us` on the link, for the plans of `vehicle`.
    pub const fn new(us: Node, vehicle: Node, timing: Timing) -> Self {
        Self {
            us,
            vehicle,
            timing,
            job: None,
            unconfirmed: None,
            cancelled: false,
            out: Bounded::new(MAX_OUT),
            events: Bounded::new(MAX_EVENTS),
        }
    }

    /// The current operation.
    pub fn busy(&self) -> Option<Operation> {
        self.job.as_ref().map(Job::operation)
    }

    /// Begins an upload; ends in [`Event::Uploaded`] or [`Event::Failed`].
    ///
    /// # Errors
    /// Another operation is in progress, or no message can carry the plan.
    pub fn upload(
        &mut self,
        now: Duration,
        kind: MavMissionType,
        items: Vec<Item>,
    ) -> Result<(), StartError> {
        self.check_idle()?;
        check_single(kind)?;
        // PX4 takes MISSION_COUNT with 0 as "clear"; that is an operation of its own here, with another end.
        if items.is_empty() {
            return Err(StartError::Empty);
        }
        let count = u16::try_from(items.len()).map_err(|_| StartError::TooMany(items.len()))?;
        for (seq, item) in items.iter().enumerate() {
            item.check_dialect()
                .map_err(|fault| StartError::Item { seq, fault })?;
        }
        // PX4 answers MISSION_COUNT with MAV_MISSION_ERROR while it is still in a transfer.
        self.cancel_unconfirmed();
        let job = Upload::start(now, kind, items, count, &mut self.context());
        self.job = Some(Job::Upload(job));
        Ok(())
    }

    /// Begins a download of the stored plan; ends in [`Event::Downloaded`] or [`Event::Failed`].
    ///
    /// # Errors
    /// Another operation is in progress, or `kind` is not a single kind of plan.
    pub fn download(&mut self, now: Duration, kind: MavMissionType) -> Result<(), StartError> {
        self.check_idle()?;
        check_single(kind)?;
        let job = Download::start(now, kind, &mut self.context());
        self.job = Some(Job::Download(job));
        Ok(())
    }

    /// Begins to clear a kind of plan, or all; ends in [`Event::Cleared`] or [`Event::Failed`].
    ///
    /// # Errors
    /// Another operation is in progress.
    pub fn clear(&mut self, now: Duration, kind: MavMissionType) -> Result<(), StartError> {
        self.check_idle()?;
        self.cancel_unconfirmed();
        let repeat = self.first_repeat(now);
        self.out.push(clear_all(self.vehicle, kind));
        self.job = Some(Job::Clear { kind, repeat });
        Ok(())
    }

    /// Begins to make the first of these items the current one; ends in [`Event::CurrentSet`], when MISSION_CURRENT names
    /// one of them, or in [`Event::Failed`].
    ///
    /// PX4 finishes items without a position (DO_CHANGE_SPEED) before MISSION_CURRENT names them, so `items` ends with the
    /// first one that has a position.
    ///
    /// # Errors
    /// Another operation is in progress.
    pub fn set_current(
        &mut self,
        now: Duration,
        items: RangeInclusive<u16>,
    ) -> Result<(), StartError> {
        self.check_idle()?;
        // PX4 ignores MISSION_SET_CURRENT while a transfer is in progress, and reports that by STATUSTEXT only.
        self.cancel_unconfirmed();
        let repeat = self.first_repeat(now);
        self.out.push(set_current(self.vehicle, *items.start()));
        self.job = Some(Job::SetCurrent { items, repeat });
        Ok(())
    }

    /// Makes an item the current one, without an event: the caller looks at MISSION_CURRENT, and sends the next one soon.
    /// Nothing is sent while an operation is in progress, in which PX4 would ignore it.
    pub fn point_to(&mut self, item: u16) {
        if self.check_idle().is_ok() {
            self.out.push(set_current(self.vehicle, item));
        }
    }

    /// Ends the present operation and cancels it at the vehicle, without an event: the caller may begin another one at once, and
    /// would take the end of this one for that one's.
    pub fn cancel(&mut self) {
        if let Some(job) = self.job.take() {
            self.close(&job, true);
            self.cancelled = true;
        }
    }

    /// Whether an operation was cancelled since the last call: an answer that is older than the next one's first message may
    /// be to it.
    pub fn take_cancelled(&mut self) -> bool {
        std::mem::take(&mut self.cancelled)
    }

    /// Takes a message of `from`; `fresh` is false when it may be a replay.
    ///
    /// Returns whether the message was for this service.
    pub fn handle_message(
        &mut self,
        now: Duration,
        from: Node,
        message: &MavMessage,
        fresh: bool,
    ) -> bool {
        if from != self.vehicle || !fresh {
            return false;
        }
        let Some((target, kind)) = target_and_kind(message) else {
            return false;
        };
        if target.is_some_and(|node| !self.us.is_target(node.system, node.component)) {
            return false;
        }
        let Some(mut job) = self.job.take() else {
            // A transfer that we know nothing of is a leftover of our own: the request is addressed to us.
            self.cancel_unexpected_request(message, kind);
            return true;
        };
        if kind.is_some_and(|kind| kind != job.kind()) || !job.expects(message) {
            self.cancel_unexpected_request(message, kind);
            self.job = Some(job);
            return true;
        }
        match job.handle_message(now, message, &mut self.context()) {
            Some(end) => self.end(&job, end),
            None => self.job = Some(job),
        }
        true
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Duration) {
        let Some(mut job) = self.job.take() else {
            return;
        };
        if job.deadline() > now {
            self.job = Some(job);
            return;
        }
        match job.handle_timeout(now, &mut self.context()) {
            Some(end) => self.end(&job, end),
            None => self.job = Some(job),
        }
    }

    /// When [`Client::handle_timeout`] is next needed.
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.job.as_ref().map(Job::deadline)
    }

    /// The next message for the vehicle.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    fn context(&mut self) -> Context<'_> {
        Context {
            vehicle: self.vehicle,
            timing: self.timing,
            out: &mut self.out,
            events: &mut self.events,
        }
    }

    fn first_repeat(&self, now: Duration) -> Repeat {
        Repeat::first(now, &self.timing)
    }

    fn check_idle(&self) -> Result<(), StartError> {
        if let Some(busy) = self.busy() {
            return Err(StartError::Busy(busy));
        }
        // Room for one progress event and for the end.
        if self.events.len() + 2 > MAX_EVENTS {
            return Err(StartError::Unread);
        }
        Ok(())
    }

    /// Cancels a transfer whose end the vehicle did not acknowledge. PX4 would otherwise answer MAV_MISSION_ERROR, or
    /// continue with the old number of items and the new items.
    fn cancel_unconfirmed(&mut self) {
        if let Some(kind) = self.unconfirmed.take() {
            self.out.push(cancel(self.vehicle, kind));
        }
    }

    fn end(&mut self, job: &Job, end: Result<Event, Failure>) {
        self.close(job, end.is_err());
        self.events.push(end.unwrap_or_else(|reason| Event::Failed {
            operation: job.operation(),
            kind: job.kind(),
            reason,
        }));
    }

    fn close(&mut self, job: &Job, failed: bool) {
        let (operation, kind) = (job.operation(), job.kind());
        // What a slow link had no room for yet is not sent after its end was reported: a MISSION_SET_CURRENT could move the
        // aircraft then. A MISSION_ACK only closes a transfer.
        self.out
            .retain(|message| matches!(message, MavMessage::MISSION_ACK(_)));
        if failed && matches!(operation, Operation::Upload | Operation::Download) {
            self.out.push(cancel(self.vehicle, kind));
            self.unconfirmed = Some(kind);
        }
        if operation == Operation::Download {
            // Our last MISSION_ACK may be lost; PX4 then waits 5 s for it.
            self.unconfirmed = Some(kind);
        }
        if matches!(self.events.last_mut(), Some(Event::Progress { .. })) {
            self.events.pop_last();
        }
    }

    /// Cancels a transfer other than the current one: it would keep the vehicle busy for 5 s.
    fn cancel_unexpected_request(&mut self, message: &MavMessage, kind: Option<MavMissionType>) {
        // Left alone, PX4 would repeat the request for 5 s and answer a new transfer with MAV_MISSION_ERROR meanwhile.
        let request = matches!(
            message,
            MavMessage::MISSION_REQUEST(_) | MavMessage::MISSION_REQUEST_INT(_)
        );
        if request {
            self.out
                .push(cancel(self.vehicle, kind.unwrap_or_default()));
        }
    }
}

/// The current operation.
#[derive(Debug)]
enum Job {
    Upload(Upload),
    Download(Download),
    Clear {
        kind: MavMissionType,
        repeat: Repeat,
    },
    SetCurrent {
        /// The item to be set, to the last one that proves it.
        items: RangeInclusive<u16>,
        repeat: Repeat,
    },
}

impl Job {
    fn operation(&self) -> Operation {
        match self {
            Self::Upload(_) => Operation::Upload,
            Self::Download(_) => Operation::Download,
            Self::Clear { .. } => Operation::Clear,
            Self::SetCurrent { .. } => Operation::SetCurrent,
        }
    }

    fn kind(&self) -> MavMissionType {
        match self {
            Self::Upload(upload) => upload.kind(),
            Self::Download(download) => download.kind(),
            Self::Clear { kind, .. } => *kind,
            Self::SetCurrent { .. } => MavMissionType::MAV_MISSION_TYPE_MISSION,
        }
    }

    fn expects(&self, message: &MavMessage) -> bool {
        use MavMessage as M;
        match (self, message) {
            (Self::Upload(_), M::MISSION_REQUEST(_) | M::MISSION_REQUEST_INT(_))
            | (Self::Download(_), M::MISSION_COUNT(_))
            | (Self::Download(_), M::MISSION_ITEM_INT(_) | M::MISSION_ITEM(_))
            | (Self::SetCurrent { .. }, M::MISSION_CURRENT(_)) => true,
            // PX4 sends no MISSION_ACK for MISSION_SET_CURRENT; its effect shows in the next MISSION_CURRENT, at 1 Hz.
            (Self::SetCurrent { .. }, _) => false,
            (_, M::MISSION_ACK(_)) => true,
            _ => false,
        }
    }

    fn handle_message(
        &mut self,
        now: Duration,
        message: &MavMessage,
        context: &mut Context<'_>,
    ) -> Option<Result<Event, Failure>> {
        match (self, message) {
            (Self::Upload(upload), _) => upload.handle_message(now, message, context),
            (Self::Download(download), _) => download.handle_message(now, message, context),
            (Self::Clear { kind, .. }, MavMessage::MISSION_ACK(ack)) => match ack.mavtype {
                // With a plan id it is the late acknowledgement of an upload.
                MavMissionResult::MAV_MISSION_ACCEPTED if ack.opaque_id == 0 => {
                    Some(Ok(Event::Cleared { kind: *kind }))
                }
                // Late answers to an earlier transfer, as in an upload: a retry or the right answer follows.
                MavMissionResult::MAV_MISSION_ACCEPTED
                | MavMissionResult::MAV_MISSION_ERROR
                | MavMissionResult::MAV_MISSION_INVALID_SEQUENCE => None,
                result => Some(Err(Failure::Refused { result, seq: None })),
            },
            (Self::SetCurrent { items, .. }, MavMessage::MISSION_CURRENT(current)) => items
                // Any of them proves it: PX4 may have advanced past items without a position before the next
                // MISSION_CURRENT.
                .contains(&current.seq)
                .then_some(Ok(Event::CurrentSet {
                    seq: *items.start(),
                })),
            _ => None,
        }
    }

    fn handle_timeout(
        &mut self,
        now: Duration,
        context: &mut Context<'_>,
    ) -> Option<Result<Event, Failure>> {
        let (repeat, message, seq) = match self {
            Self::Upload(upload) => return upload.handle_timeout(now, context),
            Self::Download(download) => return download.handle_timeout(now, context),
            Self::Clear { kind, repeat } => (repeat, clear_all(context.vehicle, *kind), None),
            Self::SetCurrent { items, repeat } => {
                let seq = *items.start();
                (repeat, set_current(context.vehicle, seq), Some(seq))
            }
        };
        if !repeat.again(now, &context.timing) {
            return Some(Err(Failure::NoAnswer { seq }));
        }
        context.out.push(message);
        None
    }

    fn deadline(&self) -> Duration {
        match self {
            Self::Upload(upload) => upload.deadline(),
            Self::Download(download) => download.deadline(),
            Self::Clear { repeat, .. } | Self::SetCurrent { repeat, .. } => repeat.at,
        }
    }
}

/// Messages that wait for the caller; what does not fit is retried.
const MAX_OUT: usize = 32;
/// Events that wait for the caller: one final event an operation, and one progress.
const MAX_EVENTS: usize = 64;

fn check_single(kind: MavMissionType) -> Result<(), StartError> {
    if kind == MavMissionType::MAV_MISSION_TYPE_ALL {
        return Err(StartError::Kind);
    }
    Ok(())
}

/// The target of a mission message (`None`: everybody) and its kind of plan (`None`: no particular kind); `None` for a
/// message of another service.
fn target_and_kind(message: &MavMessage) -> Option<(Option<Node>, Option<MavMissionType>)> {
    use MavMessage as M;
    let (system, component, kind) = match message {
        M::MISSION_CURRENT(_) => return Some((None, None)),
        M::MISSION_ACK(m) => (m.target_system, m.target_component, m.mission_type),
        M::MISSION_COUNT(m) => (m.target_system, m.target_component, m.mission_type),
        M::MISSION_REQUEST(m) => (m.target_system, m.target_component, m.mission_type),
        M::MISSION_REQUEST_INT(m) => (m.target_system, m.target_component, m.mission_type),
        M::MISSION_ITEM(m) => (m.target_system, m.target_component, m.mission_type),
        M::MISSION_ITEM_INT(m) => (m.target_system, m.target_component, m.mission_type),
        _ => return None,
    };
    Some((Some(Node::new(system, component)), Some(kind)))
}
