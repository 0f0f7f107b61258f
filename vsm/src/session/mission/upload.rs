//! The upload of items to the vehicle's mission store, for routes, the fence and rally points.
//!
//! A MISSION_ACK proves little: it may belong to another station's transfer, and PX4 stores some fields differently from how
//! they were sent. So the items are read back and compared, and then MISSION_CURRENT must report their id: only that proves
//! that the vehicle uses exactly these items.
//!
//! ```text
//! send ------> Sending --Uploaded--> Reading --same items--> Naming --MISSION_CURRENT--> done
//! read_back -----------------------> Reading --other items--> Sending (where nothing has been sent yet)
//! clear -----> Clearing --Cleared----------------------------------------------------> done
//! ```

use std::time::Duration;

use mavlink_link::service::mission::{
    self, Difference, Failure, Item, MavMissionResult, MavMissionType, Operation, StartError,
    verify,
};

use crate::session::link::services::Services;

/// The machine. Its owner keeps the items.
#[derive(Debug)]
pub(super) struct Upload {
    kind: MavMissionType,
    phase: Phase,
    /// The vehicle may hold some of the items.
    touched: bool,
    /// The last reported progress.
    percent: u8,
}

#[derive(Debug)]
enum Phase {
    Clearing,
    Sending,
    Reading,
    Naming { id: u32, deadline: Duration },
}

/// Its phase.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Progress {
    Going,
    /// Per cent complete, if that has grown; the read-back is the second half.
    Percent(u8),
    /// The vehicle reports the items with this id; 0 if it has no ids, or if everything is cleared.
    Done(u32),
    Failed(Fault),
}

/// Why it failed.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Fault {
    NotSent(StartError),
    NotRead(StartError),
    Service {
        operation: Operation,
        reason: Failure,
    },
    Differs(Difference),
    /// MISSION_CURRENT reports another id.
    NotNamed,
    /// MISSION_CURRENT reports its id, but not as flyable.
    Unusable,
}

impl Upload {
    /// Begins to send.
    pub(super) fn send(
        now: Duration,
        kind: MavMissionType,
        items: &[Item],
        vehicle: &mut Services,
    ) -> Result<Upload, StartError> {
        vehicle.missions.upload(now, kind, items.to_vec())?;
        Ok(Upload::begun(kind, Phase::Sending, 0))
    }

    /// Begins with the read-back: the vehicle already reports these items, and PX4 would ignore an upload.
    pub(super) fn read_back(
        now: Duration,
        kind: MavMissionType,
        vehicle: &mut Services,
    ) -> Result<Upload, StartError> {
        vehicle.missions.download(now, kind)?;
        Ok(Upload::begun(kind, Phase::Reading, HALF))
    }

    /// Begins to clear all items of a kind.
    pub(super) fn clear(
        now: Duration,
        kind: MavMissionType,
        vehicle: &mut Services,
    ) -> Result<Upload, StartError> {
        vehicle.missions.clear(now, kind)?;
        Ok(Upload::begun(kind, Phase::Clearing, 0))
    }

    fn begun(kind: MavMissionType, phase: Phase, percent: u8) -> Upload {
        Upload {
            kind,
            phase,
            touched: false,
            percent,
        }
    }

    /// Whether the vehicle may hold some of the items.
    pub(super) fn touched(&self) -> bool {
        self.touched
    }

    /// Handles an event of the mission service.
    pub(super) fn handle(
        &mut self,
        now: Duration,
        event: &mission::Event,
        items: &[Item],
        vehicle: &mut Services,
    ) -> Progress {
        use mission::Event as E;
        match (&self.phase, event) {
            (Phase::Clearing, E::Cleared { .. }) => Progress::Done(0),
            (
                Phase::Sending,
                E::Progress {
                    operation: Operation::Upload,
                    percent,
                    ..
                },
            ) => {
                // From here on the vehicle may hold different items than before, however the upload ends.
                self.touched = true;
                self.grown(percent / 2)
            }
            (
                Phase::Reading,
                E::Progress {
                    operation: Operation::Download,
                    percent,
                    ..
                },
            ) => self.grown(HALF + percent / 2),
            (Phase::Sending, E::Uploaded { .. }) => {
                self.touched = true;
                match vehicle.missions.download(now, self.kind) {
                    Ok(()) => {
                        self.phase = Phase::Reading;
                        self.grown(HALF)
                    }
                    Err(fault) => Progress::Failed(Fault::NotRead(fault)),
                }
            }
            (
                Phase::Reading,
                E::Downloaded {
                    items: read,
                    opaque_id,
                    ..
                },
            ) => match verify(self.kind, items, read) {
                Ok(()) => {
                    // The id of the read-back belongs to the compared items; a MISSION_ACK may belong to another transfer.
                    self.phase = Phase::Naming {
                        id: *opaque_id,
                        deadline: now + NAMED_WITHIN,
                    };
                    Progress::Going
                }
                Err(difference) if self.touched => Progress::Failed(Fault::Differs(difference)),
                // It reports this id but holds other items: send them after all. 14000 keeps its progress until that is
                // reached again.
                Err(_) => match vehicle.missions.upload(now, self.kind, items.to_vec()) {
                    Ok(()) => {
                        self.phase = Phase::Sending;
                        Progress::Going
                    }
                    Err(fault) => Progress::Failed(Fault::NotSent(fault)),
                },
            },
            (
                phase,
                E::Failed {
                    operation, reason, ..
                },
            ) if phase.operation() == Some(*operation) => Progress::Failed(Fault::Service {
                operation: *operation,
                reason: *reason,
            }),
            _ => Progress::Going,
        }
    }

    /// Checks whether MISSION_CURRENT reports the items as usable. `named`: its id for this kind.
    pub(super) fn check(&self, now: Duration, named: Option<u32>, usable: bool) -> Progress {
        let Phase::Naming { id, deadline } = self.phase else {
            return Progress::Going;
        };
        // ArduPilot has no ids: for it the read-back must be enough.
        let is_named = id == 0 || named == Some(id);
        if is_named && usable {
            Progress::Done(id)
        } else if now < deadline {
            Progress::Going
        } else if is_named {
            Progress::Failed(Fault::Unusable)
        } else {
            Progress::Failed(Fault::NotNamed)
        }
    }

    /// The vehicle judges the items only from this time on: [`Upload::check`] gives up no earlier than after it.
    pub(super) fn judged_from(&mut self, at: Duration) {
        if let Phase::Naming { deadline, .. } = &mut self.phase {
            *deadline = (*deadline).max(at + NAMED_WITHIN);
        }
    }

    /// The bridge did not run for so long: the vehicle's report may wait unread.
    pub(super) fn postpone(&mut self, stopped: Duration) {
        if let Phase::Naming { deadline, .. } = &mut self.phase {
            *deadline += stopped;
        }
    }

    /// When [`Upload::check`] gives up.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        match self.phase {
            Phase::Naming { deadline, .. } => Some(deadline),
            Phase::Clearing | Phase::Sending | Phase::Reading => None,
        }
    }

    /// Ends it.
    pub(super) fn cancel(&self, vehicle: &mut Services) {
        if self.phase.operation().is_some() {
            vehicle.missions.cancel();
        }
    }

    fn grown(&mut self, percent: u8) -> Progress {
        // In steps of five per cent: 14000 is a report, not a stream.
        if percent < self.percent.saturating_add(5) {
            return Progress::Going;
        }
        self.percent = percent;
        Progress::Percent(percent)
    }
}

impl Phase {
    /// The operation that the mission service is busy with.
    fn operation(&self) -> Option<Operation> {
        match self {
            Phase::Clearing => Some(Operation::Clear),
            Phase::Sending => Some(Operation::Upload),
            Phase::Reading => Some(Operation::Download),
            Phase::Naming { .. } => None,
        }
    }
}

impl Fault {
    /// For an operator; `what` is a plan, a fence or a set of rally points.
    pub(super) fn explain(&self, what: &str) -> String {
        match self {
            Fault::NotSent(fault) => format!("the upload cannot begin: {fault}"),
            Fault::NotRead(fault) => format!("the read-back cannot begin: {fault}"),
            Fault::Service { reason, .. } => explain(reason),
            Fault::Differs(difference) => format!("the vehicle holds another {what}: {difference}"),
            Fault::NotNamed => format!("the vehicle does not report the loaded {what} as its own"),
            Fault::Unusable => format!("the vehicle finds the {what} infeasible"),
        }
    }

    /// Whether the vehicle refuses the items themselves, so that a retry would fail too. The feasibility of a route also
    /// depends on the fence, which can be changed.
    pub(super) fn is_flaw(&self) -> bool {
        use MavMissionResult as R;
        // PX4 answers with these if two transfers overlap.
        let passing = [
            R::MAV_MISSION_ERROR,
            R::MAV_MISSION_OPERATION_CANCELLED,
            R::MAV_MISSION_INVALID_SEQUENCE,
            R::MAV_MISSION_DENIED,
        ];
        match self {
            Fault::Service {
                operation: Operation::Upload,
                reason: Failure::Refused { result, .. },
            } => !passing.contains(result),
            _ => false,
        }
    }

    /// The item at which the vehicle refused.
    pub(super) fn item(&self) -> Option<usize> {
        match self {
            Fault::Service {
                reason: Failure::Refused { seq: Some(seq), .. },
                ..
            } => Some(usize::from(*seq)),
            _ => None,
        }
    }
}

fn explain(reason: &Failure) -> String {
    match reason {
        Failure::Refused { result, seq } => {
            let at = seq.map_or_else(String::new, |seq| format!(" at item {seq}"));
            format!("the vehicle refuses it{at}: {}", mission_result(*result))
        }
        Failure::OtherPlan { .. } => "the vehicle acknowledged another plan".to_owned(),
        Failure::NoAnswer { .. } => "the vehicle does not answer".to_owned(),
    }
}

fn mission_result(result: MavMissionResult) -> &'static str {
    use MavMissionResult as R;
    match result {
        R::MAV_MISSION_NO_SPACE => "no space for so many items",
        R::MAV_MISSION_UNSUPPORTED => "unsupported item",
        R::MAV_MISSION_UNSUPPORTED_FRAME => "unsupported frame",
        R::MAV_MISSION_DENIED => "denied",
        R::MAV_MISSION_INVALID_SEQUENCE => "items out of sequence",
        R::MAV_MISSION_OPERATION_CANCELLED => "cancelled",
        // PX4 v1.18's answer to the second of two stations that transfer at the same time.
        R::MAV_MISSION_ERROR => "error, perhaps another station's transfer",
        _ => "invalid parameter",
    }
}

/// Per cent complete when the read-back begins.
const HALF: u8 = 50;
/// MISSION_CURRENT arrives at 1 Hz at least, and some are lost.
const NAMED_WITHIN: Duration = Duration::from_secs(5);
