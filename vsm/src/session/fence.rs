//! The geofence of one vehicle: areas of the configuration and of a CUCS (50016, 50017), taken aboard, read back and
//! compared; 50018 tells how it went.
//!
//! Areas of the configuration are always part of the fence. What the fence should be is compared with what the vehicle
//! says it holds when it is first heard, and from then on: one that is the same is not sent again, one that another
//! station has changed is warned of and not fought over.

use std::time::Duration;

use mapping::area::{self, Area, AreaError, Areas, FencePoint};
use mavlink_link::service::mission::{
    self, Failure, Item, MavMissionType, Operation, plan_id, verify,
};
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{AckType, AreaPlanMode as Mode, MissionTransferStatus};
use stanag_msgs::messages::{AreaTransferCommand, AreaTransferStatus, AreaVertex};
use stanag_msgs::{Id, Message};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::{Desk, Origin};
use super::plan_record::{decode_messages, encode_messages};
use super::store::{record_fault, vehicle_record};
use super::transfer::explain;
use mavlink_link::store::{Store as _, StoreError};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Fence {
    pub(super) configured: Vec<Area>,
    /// As a CUCS has sent them.
    sent: Areas,
    /// Those that were loaded last.
    loaded: Areas,
    /// Whether a fence was ever asked for, here or in the configuration: else the vehicle's own is let alone.
    wanted: bool,
    /// The id by which the vehicle names the fence that it should hold.
    id: Option<u32>,
    /// When what the vehicle holds is compared for the first time.
    look_at: Option<Duration>,
    work: Option<Work>,
}

#[derive(Debug)]
struct Work {
    /// Who asked; none where the VSM does by itself.
    origin: Option<(Origin, Mode)>,
    areas: Areas,
    points: Vec<FencePoint>,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Clearing,
    Sending,
    Reading,
    Checking { id: u32, deadline: Duration },
}

/// How far a step of it has come.
enum Course {
    Going(Phase),
    Done(u32),
    Refused(Option<(u16, u8)>, String),
}

#[derive(Serialize, Deserialize)]
struct Record {
    sent: Vec<String>,
    loaded: Vec<String>,
    wanted: bool,
}

vehicle_record!(Record, "areas", Process);

impl Fence {
    /// With the areas of the configuration.
    pub(crate) fn new(configured: Vec<Area>) -> Fence {
        Fence {
            wanted: !configured.is_empty(),
            configured,
            ..Fence::default()
        }
    }

    /// Whether a fence is on its way.
    pub(crate) fn busy(&self) -> bool {
        self.work.is_some()
    }

    /// The vehicle is there, or there again: what it holds is compared once it has had the time to say so.
    pub(super) fn look_again(&mut self, now: Duration) {
        self.look_at = Some(now + LOOK_AFTER);
    }

    fn points(&self, areas: &Areas, at: Option<(f64, f64)>) -> Result<Vec<FencePoint>, AreaError> {
        area::fence(&self.configured, &areas.whole()?, at)
    }
}

impl Aircraft {
    /// 50016: stored at once, flown with after 50017.
    pub(super) fn store_area(&mut self, desk: &mut Desk<'_>, origin: Origin, vertex: &AreaVertex) {
        let before = self.fence.sent.clone();
        let stored = self
            .fence
            .sent
            .store(vertex)
            .map_err(|fault| fault.to_string());
        let stored = stored.and_then(|()| {
            self.save_fence(desk)
                .map_err(|fault| format!("it cannot be stored: {fault}"))
        });
        match stored {
            Ok(()) => desk.acknowledge(self.id(), &origin, AckType::CarriedOut),
            Err(why) => {
                self.fence.sent = before;
                self.refuse(desk, Some(origin), why);
            }
        }
    }

    /// 50017.
    pub(super) fn transfer_areas(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        command: &AreaTransferCommand,
    ) {
        desk.acknowledge(self.id(), &origin, AckType::Received);
        let Some(mode) = command.area_plan_mode else {
            let why = "Area Plan Mode is missing".to_owned();
            return self.refuse(desk, Some(origin), why);
        };
        let none = |reason| AreaError {
            area: 0,
            vertex: None,
            reason,
        };
        match mode {
            Mode::Load if self.fence.sent.is_empty() => {
                self.refuse_areas(desk, (origin, mode), &none(area::Reason::None));
            }
            Mode::Load => {
                let place = self.mav.telemetry.position;
                let at = place.map(|place| (place.latitude, place.longitude));
                match self.fence.points(&self.fence.sent, at) {
                    Ok(points) => {
                        let areas = self.fence.sent.clone();
                        self.begin_fence(desk, Some((origin, mode)), areas, points);
                    }
                    Err(fault) => self.refuse_areas(desk, (origin, mode), &fault),
                }
            }
            Mode::Clear => match self.fence.points(&Areas::default(), None) {
                Ok(points) => {
                    self.begin_fence(desk, Some((origin, mode)), Areas::default(), points);
                }
                Err(fault) => self.refuse_areas(desk, (origin, mode), &fault),
            },
            Mode::Download if self.fence.sent.is_empty() => {
                self.refuse_areas(desk, (origin, mode), &none(area::Reason::None));
            }
            Mode::Download => {
                let mut all: Vec<Message> = self.fence.sent.messages().collect();
                all.push(status(mode, MissionTransferStatus::Complete, None).into());
                self.answer_later(desk, origin.station, all, Some(origin));
            }
            Mode::Unknown(value) => {
                let why = format!("Area Plan Mode {value}, expected 1 to 3");
                self.refuse(desk, Some(origin), why);
            }
        }
    }

    fn begin_fence(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<(Origin, Mode)>,
        areas: Areas,
        points: Vec<FencePoint>,
    ) {
        let kind = MavMissionType::MAV_MISSION_TYPE_FENCE;
        let items: Vec<Item> = points.iter().map(|point| point.item).collect();
        let begun = self.may_change_mission().and_then(|()| {
            let missions = &mut self.mav.missions;
            let (phase, begun) = if items.is_empty() {
                (Phase::Clearing, missions.clear(desk.now.mono, kind))
            } else {
                (Phase::Sending, missions.upload(desk.now.mono, kind, items))
            };
            begun
                .map(|()| phase)
                .map_err(|fault| format!("the mission service is {fault}"))
        });
        match begun {
            Ok(phase) => {
                if let Some((origin, mode)) = origin {
                    self.tell_areas(
                        desk,
                        origin.station,
                        mode,
                        MissionTransferStatus::InProgress,
                        None,
                    );
                }
                self.fence.work = Some(Work {
                    origin,
                    areas,
                    points,
                    phase,
                });
                self.run_until_idle(desk);
            }
            Err(why) => self.end_fence(desk, origin, None, why),
        }
    }

    /// What the mission service has done with the fence. False where it is about a mission.
    pub(super) fn fence_sees_mission(
        &mut self,
        desk: &mut Desk<'_>,
        event: &mission::Event,
    ) -> bool {
        let Some(mut work) = self.fence.work.take() else {
            return false;
        };
        let now = desk.now.mono;
        let course = match (work.phase, event) {
            (Phase::Clearing, mission::Event::Cleared { .. }) => Course::Done(0),
            (Phase::Sending, mission::Event::Uploaded { .. }) => {
                let kind = MavMissionType::MAV_MISSION_TYPE_FENCE;
                match self.mav.missions.download(now, kind) {
                    Ok(()) => Course::Going(Phase::Reading),
                    Err(fault) => {
                        Course::Refused(None, format!("the read-back cannot begin: {fault}"))
                    }
                }
            }
            (
                Phase::Reading,
                mission::Event::Downloaded {
                    items, opaque_id, ..
                },
            ) => {
                let sent: Vec<Item> = work.points.iter().map(|point| point.item).collect();
                match verify(MavMissionType::MAV_MISSION_TYPE_FENCE, &sent, items) {
                    Ok(()) => Course::Going(Phase::Checking {
                        id: *opaque_id,
                        deadline: now + CURRENT_WITHIN,
                    }),
                    Err(difference) => Course::Refused(
                        None,
                        format!("the vehicle holds another fence: {difference}"),
                    ),
                }
            }
            (
                phase,
                mission::Event::Failed {
                    operation, reason, ..
                },
            ) => match operation {
                Operation::SetCurrent => Course::Going(phase),
                _ => Course::Refused(vertex_of(&work.points, reason), explain(reason)),
            },
            (phase, _) => Course::Going(phase),
        };
        match course {
            Course::Going(phase) => {
                work.phase = phase;
                self.fence.work = Some(work);
            }
            Course::Done(id) => self.fence_is_aboard(desk, work.origin, work.areas, id),
            Course::Refused(vertex, why) => self.end_fence(desk, work.origin, vertex, why),
        }
        true
    }

    /// MISSION_CURRENT must name the fence that was read back; and later still.
    pub(super) fn watch_fence(&mut self, desk: &mut Desk<'_>) {
        let aboard = self.mav.telemetry.mission.map(|mission| mission.fence_id);
        let now = desk.now.mono;
        if let Some(Work {
            phase: Phase::Checking { id, deadline },
            ..
        }) = &self.fence.work
        {
            let (id, late) = (*id, *deadline <= now);
            if id != 0 && aboard != Some(id) && !late {
                return;
            }
            let Some(work) = self.fence.work.take() else {
                return;
            };
            if id == 0 || aboard == Some(id) {
                return self.fence_is_aboard(desk, work.origin, work.areas, id);
            }
            let why = "the vehicle does not report the loaded fence as its own".to_owned();
            return self.end_fence(desk, work.origin, None, why);
        }
        if !self.fence.wanted || !self.mav.live() || self.may_change_mission().is_err() {
            return;
        }
        if self.fence.look_at.is_some_and(|at| at <= now) {
            self.fence.look_at = None;
            let areas = self.fence.loaded.clone();
            match self.fence.points(&areas, None) {
                Ok(points) => {
                    let items: Vec<Item> = points.iter().map(|point| point.item).collect();
                    let id = plan_id(&items);
                    if aboard == Some(id) {
                        self.fence.id = Some(id);
                    } else {
                        self.begin_fence(desk, None, areas, points);
                    }
                }
                Err(fault) => self.warn(desk, Cause::Fence, fault.to_string()),
            }
            return;
        }
        let (Some(id), None) = (self.fence.id.filter(|id| *id != 0), self.fence.look_at) else {
            return;
        };
        if aboard.is_some_and(|aboard| aboard != id) {
            let text = "the fence aboard is not the one that was loaded: load it again (50017)";
            self.warn(desk, Cause::Fence, text.to_owned());
        } else {
            self.clear_fence_warning(desk);
        }
    }

    fn fence_is_aboard(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<(Origin, Mode)>,
        areas: Areas,
        id: u32,
    ) {
        self.fence.loaded = areas;
        self.fence.wanted = !self.fence.loaded.is_empty() || !self.fence.configured.is_empty();
        self.fence.id = Some(id);
        if let Some((_, Mode::Clear)) = origin {
            self.fence.sent.clear();
        }
        self.clear_fence_warning(desk);
        if let Err(fault) = self.save_fence(desk) {
            let why = format!("the fence is aboard, but cannot be stored: {fault}");
            return self.end_fence(desk, origin, None, why);
        }
        if self.fence.wanted {
            self.say_breach(desk);
        }
        if let Some((origin, mode)) = origin {
            let complete = MissionTransferStatus::Complete;
            self.tell_areas(desk, origin.station, mode, complete, None);
            desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
        }
    }

    /// What the vehicle does where it breaks the fence, by its own parameter.
    fn say_breach(&mut self, desk: &mut Desk<'_>) {
        let Some(action) = self.parameter("GF_ACTION") else {
            return;
        };
        let what = match action as i64 {
            0 => "does nothing",
            1 => "only says so",
            2 => "holds",
            3 => "returns",
            4 => "terminates its flight",
            5 => "lands",
            _ => "does something that is not known here",
        };
        self.advise(
            desk,
            format!("where it breaks the fence the vehicle {what} (GF_ACTION {action})"),
        );
    }

    fn clear_fence_warning(&mut self, desk: &mut Desk<'_>) {
        let raised = self.alerts.clear(Cause::Fence, "the fence is aboard");
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
    }

    fn refuse_areas(&mut self, desk: &mut Desk<'_>, origin: (Origin, Mode), fault: &AreaError) {
        let vertex = (fault.area, fault.vertex.unwrap_or(0));
        self.end_fence(desk, Some(origin), Some(vertex), fault.to_string());
    }

    fn end_fence(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Option<(Origin, Mode)>,
        vertex: Option<(u16, u8)>,
        why: String,
    ) {
        match origin {
            Some((origin, mode)) => {
                let aborted = MissionTransferStatus::Aborted;
                self.tell_areas(desk, origin.station, mode, aborted, vertex);
                self.refuse(desk, Some(origin), why);
            }
            None => {
                // Tried again: the vehicle flies without a fence that it should have.
                self.fence.look_at = Some(desk.now.mono + TRY_AGAIN);
                self.warn(
                    desk,
                    Cause::Fence,
                    format!("the fence is not aboard: {why}"),
                );
            }
        }
    }

    fn tell_areas(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        mode: Mode,
        state: MissionTransferStatus,
        vertex: Option<(u16, u8)>,
    ) {
        let told = AreaTransferStatus {
            time_stamp: Some(desk.stamp()),
            ..status(mode, state, vertex)
        };
        desk.send(station, self.id(), &told.into());
    }

    fn save_fence(&self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let lines = |areas: &Areas| encode_messages(areas.messages(), Id::NULL, self.id());
        let record = Record {
            sent: lines(&self.fence.sent),
            loaded: lines(&self.fence.loaded),
            wanted: self.fence.wanted,
        };
        desk.store.save(&self.id(), &record)
    }

    /// The areas of before a restart.
    ///
    /// # Errors
    /// Their record is there and cannot be read.
    pub(super) fn restore_fence(&mut self, desk: &Desk<'_>) -> Result<(), StoreError> {
        let Some(record) = desk.store.load::<Record>(&self.id())? else {
            return Ok(());
        };
        let id = self.id();
        let unreadable = |cause: String| record_fault("areas", id, cause);
        let areas = |lines: &[String]| {
            let mut areas = Areas::default();
            for (_, message) in decode_messages(lines).map_err(|cause| cause.to_string())? {
                if let Message::AreaVertex(vertex) = message {
                    areas.store(&vertex).map_err(|cause| cause.to_string())?;
                }
            }
            Ok(areas)
        };
        self.fence.sent = areas(&record.sent).map_err(unreadable)?;
        self.fence.loaded = areas(&record.loaded).map_err(unreadable)?;
        self.fence.wanted |= record.wanted;
        Ok(())
    }
}

fn status(
    mode: Mode,
    status: MissionTransferStatus,
    vertex: Option<(u16, u8)>,
) -> AreaTransferStatus {
    AreaTransferStatus {
        area_plan_mode: Some(mode),
        status: Some(status),
        area_id: vertex.map(|(area, _)| area),
        vertex_number: vertex.map(|(_, vertex)| vertex),
        ..AreaTransferStatus::default()
    }
}

/// The vertex of the item at which the vehicle refused.
fn vertex_of(points: &[FencePoint], reason: &Failure) -> Option<(u16, u8)> {
    match reason {
        Failure::Refused { seq: Some(seq), .. } => points
            .get(usize::from(*seq))
            .map(|point| (point.area, point.vertex)),
        _ => None,
    }
}

/// MISSION_CURRENT comes at 1 Hz, and some are lost.
const CURRENT_WITHIN: Duration = Duration::from_secs(5);
const LOOK_AFTER: Duration = Duration::from_secs(3);
const TRY_AGAIN: Duration = Duration::from_secs(30);
