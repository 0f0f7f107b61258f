//! The rally points of one vehicle: those of the configuration, uploaded, read back and compared like the fence.
//!
//! Before any point is uploaded, it is stored that the vehicle may hold points of this VSM. So points removed from the
//! configuration are cleared on the vehicle after a restart too.

use std::time::Duration;

use mapping::rally::{self, RallyPoint};
use mavlink_link::service::mission::{self, Item, MavMissionType};
use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};

use super::input::Context;
use super::kept::{Kept, Seen};
use super::upload::{Progress, Upload};
use crate::session::alerts::Cause;
use crate::session::effects::Effects;
use crate::session::store::vehicle_record;

/// The machine.
#[derive(Debug)]
pub(super) struct Rally {
    points: Vec<RallyPoint>,
    kept: Kept,
    work: Option<Work>,
    /// The record as it is on disk.
    stored: Record,
    /// Since when the vehicle has reported points although the configuration has none.
    strange_since: Option<Duration>,
}

#[derive(Debug)]
struct Work {
    /// What is sent and read back: the points of the configuration may change meanwhile.
    items: Vec<Item>,
    upload: Upload,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Record {
    /// Whether the vehicle may hold points of this VSM.
    wanted: bool,
}

vehicle_record!(Record, "rally", Process);

impl Rally {
    /// With the points of the configuration.
    pub(super) fn new(points: Vec<RallyPoint>) -> Rally {
        Rally {
            kept: Kept::new(KIND, !points.is_empty()),
            points,
            work: None,
            stored: Record::default(),
            strange_since: None,
        }
    }

    /// Restores the record after a restart.
    ///
    /// # Errors
    /// The record exists but cannot be read.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        self.stored = effects.disk().load(&vehicle)?.unwrap_or_default();
        // Without points in the configuration they are cleared.
        self.kept.wanted |= self.stored.wanted;
        Ok(())
    }

    fn store(&mut self, wanted: bool, effects: &mut Effects<'_>) -> Result<(), String> {
        let record = Record { wanted };
        if self.stored != record {
            let vehicle = effects.id;
            let saved = effects.disk().save(&vehicle, &record);
            saved.map_err(|fault| format!("what the vehicle holds cannot be stored: {fault}"))?;
            self.stored = record;
        }
        Ok(())
    }

    /// The points of the configuration have changed: they are uploaded as soon as possible.
    pub(super) fn set_configured(&mut self, points: Vec<RallyPoint>, now: Duration) {
        self.points = points;
        self.kept.change(now);
    }

    /// The vehicle's link is up, for the first time or again.
    pub(super) fn look_again(&mut self, now: Duration) {
        self.kept.look_again(now);
    }

    /// The points of the configuration.
    pub(super) fn points(&self) -> &[RallyPoint] {
        &self.points
    }

    /// The bridge did not run for so long: what the vehicle has reported meanwhile is not read yet.
    pub(super) fn postpone(&mut self, stopped: Duration) {
        if let Some(work) = &mut self.work {
            work.upload.postpone(stopped);
        }
    }

    /// The bridge did not run for so long: nothing has lasted by that.
    pub(super) fn note_stop(&mut self, stopped: Duration) {
        self.strange_since = self.strange_since.map(|since| since + stopped);
    }

    /// Whether points are being uploaded.
    pub(super) fn busy(&self) -> bool {
        self.work.is_some()
    }

    /// The id under which the vehicle was read back to hold them.
    pub(super) fn id(&self) -> Option<u32> {
        self.kept.id().filter(|_| !self.busy())
    }

    /// When [`Rally::watch`] is next due.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let upload = self.work.as_ref().map(|work| &work.upload);
        self.kept.poll_timeout(upload)
    }

    /// Handles an event of the mission service. Returns false if it is not about rally points.
    pub(super) fn handle_service(
        &mut self,
        context: &Context<'_>,
        event: &mission::Event,
        effects: &mut Effects<'_>,
    ) -> bool {
        let Some(Work { items, upload }) = &mut self.work else {
            return false;
        };
        let progress = upload.handle(context.mono(), event, items, effects.vehicle);
        self.follow(context, progress, effects);
        true
    }

    /// Compares the vehicle's points. `may_change`: whether an upload can begin now.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        may_change: bool,
        effects: &mut Effects<'_>,
    ) {
        if let Some(work) = &self.work {
            // MISSION_CURRENT.mission_state is about the mission alone.
            let named = self.kept.named(context);
            let progress = work.upload.check(context.mono(), named, true);
            return self.follow(context, progress, effects);
        }
        let items = rally::items(&self.points);
        match self.kept.look(context, may_change) {
            Seen::Nothing => {}
            Seen::Due => {
                let stored = self.store(true, effects);
                if stored.is_ok() && self.kept.holds(context, &items) {
                    return self.compare(context, effects);
                }
                let now = context.mono();
                match stored.and_then(|()| self.kept.send(now, &items, effects.vehicle)) {
                    Ok(upload) => self.work = Some(Work { items, upload }),
                    Err(why) => self.failed(context, &why, effects),
                }
            }
            Seen::Other => effects.warn(
                Cause::Rally,
                "the vehicle's rally points are not those of the configuration: restart this VSM, or its link, to upload them",
            ),
            Seen::Same => effects.clear(Cause::Rally, UPLOADED),
        }
        self.compare(context, effects);
    }

    fn compare(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        self.compare_return(context, effects);
        // Leave them, but warn: the vehicle may return to them.
        let unknown = self.points.is_empty() && !self.kept.wanted && context.vehicle.live();
        let named = self.kept.named(context).filter(|_| unknown);
        match named {
            Some(0) | None => self.strange_since = None,
            Some(_) => {
                let since = *self.strange_since.get_or_insert(context.mono());
                // The latest MISSION_CURRENT may still be from before a clearing.
                if context.mono() >= since + STRANGE_AFTER {
                    effects.warn(Cause::Rally, STRANGE);
                }
            }
        }
        if named == Some(0) {
            effects.clear(Cause::Rally, "the vehicle holds no rally points");
        }
    }

    fn follow(&mut self, context: &Context<'_>, progress: Progress, effects: &mut Effects<'_>) {
        match progress {
            Progress::Going | Progress::Percent(_) => {}
            Progress::Done(id) => {
                let sent = self.work.take().map_or(0, |work| work.items.len());
                // The configuration may have changed since they were sent: what is aboard and no longer configured has yet to
                // be cleared.
                self.kept.wanted = sent > 0 || !self.points.is_empty();
                self.kept.uploaded(id);
                effects.clear(Cause::Rally, UPLOADED);
                if let Err(why) = self.store(self.kept.wanted, effects) {
                    effects.advise(format!("rally points: {why}"));
                }
                effects.advise(match sent {
                    0 => "the rally points are cleared: the vehicle returns to home".to_owned(),
                    1 => "1 rally point is aboard".to_owned(),
                    count => format!("{count} rally points are aboard"),
                });
            }
            Progress::Failed(fault) => {
                self.work = None;
                self.failed(context, &fault.explain("set of rally points"), effects);
            }
        }
    }

    fn failed(&mut self, context: &Context<'_>, why: &str, effects: &mut Effects<'_>) {
        // The vehicle would return to a wrong place.
        self.kept.try_again(context.mono());
        effects.warn(
            Cause::Rally,
            format!("the rally points are not uploaded: {why}"),
        );
    }

    /// Warns if the vehicle's RTL_TYPE ignores the points.
    fn compare_return(&self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let rtl_type = context.parameters.get("RTL_TYPE");
        match rtl_type.filter(|value| !self.points.is_empty() && !rally::are_used(*value)) {
            Some(value) => effects.warn(
                Cause::RallyIgnored,
                format!(
                    "the vehicle ignores its rally points where it returns: RTL_TYPE {value}, expected 0, 1, 3 or 5"
                ),
            ),
            None => effects.clear(Cause::RallyIgnored, "RTL_TYPE uses the rally points"),
        }
    }
}

const KIND: MavMissionType = MavMissionType::MAV_MISSION_TYPE_RALLY;
/// Text of the cleared warning.
const UPLOADED: &str = "the rally points are uploaded";
/// MISSION_CURRENT arrives at 1 Hz at least, and some are lost.
const STRANGE_AFTER: Duration = Duration::from_secs(5);
const STRANGE: &str = "the vehicle holds rally points that the configuration does not have: it may return to them; clear them, \
                       or name them there";
