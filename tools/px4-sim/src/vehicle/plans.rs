//! Uploaded plans and parameters: what the servers of MAVLink's services store takes effect here.

use std::time::Duration;

use mavlink::dialects::development::{MavMissionType, MavSeverity};

use super::state::Vehicle;
use crate::config::Param;
use crate::flight::items::Fence;
use crate::flight::mode::Mode;
use crate::physics::airframe::Tuning;
use crate::services::mission::ServerEvent;
use crate::services::param;

impl Vehicle {
    pub(crate) fn serve(&mut self) {
        let now = self.now_duration();
        if self.missions.poll_timeout().is_some_and(|at| at <= now) {
            self.missions.handle_timeout(now);
        }
        if self.fence_unread && self.fence_read_at <= now {
            self.fence_unread = false;
            self.judge_fence();
        }
        if !self.plan_checked && self.home.is_some() && self.fence_read_at <= now {
            self.plan_checked = true;
            self.check_plan();
        }
        let current =
            (self.navigator.mission.count() > 0).then(|| self.navigator.mission.index() as u16);
        self.missions.set_current(current);
        self.drain_services();
        if self
            .param_service
            .poll_timeout()
            .is_some_and(|at| at <= now)
        {
            self.param_service.handle_timeout(now);
        }
        self.ftp.handle_timeout(now);
        while let Some(message) = self.ftp.poll_transmit() {
            self.send(message);
        }
    }

    /// Sends what the mission and parameter servers have queued, and applies their events.
    pub(crate) fn drain_services(&mut self) {
        while let Some(message) = self.missions.poll_transmit() {
            self.send(message);
        }
        while let Some(event) = self.missions.poll_event() {
            self.take_event(event);
        }
        while let Some(message) = self.param_service.poll_transmit() {
            self.send(message);
        }
        while let Some(param::ServerEvent::Set { name, value }) = self.param_service.poll_event() {
            self.params.store(name, value);
            self.counters.parameters_set += 1;
            self.tuning = Tuning::read(self.config.airframe, &self.params);
        }
    }

    fn take_event(&mut self, event: ServerEvent) {
        let active = self.commander.is_armed() && self.commander.mode() == Mode::Mission;
        match event {
            ServerEvent::Text(text) => self.texts.queue(MavSeverity::MAV_SEVERITY_CRITICAL, text),
            ServerEvent::CurrentSet(seq) => {
                self.navigate(|nav, view, notes| {
                    nav.mission.select(seq.into(), active, view, notes);
                });
            }
            ServerEvent::Stored {
                kind: MavMissionType::MAV_MISSION_TYPE_MISSION,
                start,
                ..
            } => {
                self.counters.plans_stored += 1;
                let items = self
                    .missions
                    .items(MavMissionType::MAV_MISSION_TYPE_MISSION)
                    .to_vec();
                let start = start.map(usize::from);
                self.reached = None;
                self.plan_checked = false;
                self.navigate(|nav, view, notes| {
                    nav.mission.replace(items, start, active, view, notes);
                });
            }
            ServerEvent::Stored { kind, .. } => {
                self.counters.plans_stored += 1;
                if kind == MavMissionType::MAV_MISSION_TYPE_FENCE {
                    self.take_fence();
                }
                if kind == MavMissionType::MAV_MISSION_TYPE_RALLY {
                    self.navigator.set_rally(self.missions.items(kind));
                }
            }
        }
    }

    /// The navigator reads a fence of another id, and none that it has read.
    fn take_fence(&mut self) {
        let kind = MavMissionType::MAV_MISSION_TYPE_FENCE;
        let id = self.missions.opaque_id(kind);
        if std::mem::replace(&mut self.fence_id, id) == id {
            return;
        }
        let items = self.missions.items(kind);
        self.fence = Fence::new(items, &self.frame);
        let read_in: Duration = items.iter().map(|_| VERTEX_READ_IN).sum();
        self.fence_read_at = self.now_duration() + read_in;
        self.fence_unread = true;
        self.plan_checked = false;
    }

    /// It leaves out areas as it reads them: where a home is known, and by the position where it is in the air and GF_ACTION is not 0.
    fn judge_fence(&mut self) {
        let is_flown = !self.landed && self.params.int(Param::GF_ACTION) != 0;
        let flown = is_flown.then(|| self.believed());
        for text in self.fence.leave_out(self.home, flown) {
            self.texts.queue(MavSeverity::MAV_SEVERITY_CRITICAL, text);
        }
    }

    /// PX4's few checks of a plan, once it has a home. An accepted upload is no safety check: latitude 200, a first
    /// waypoint 20 km away and a jump to a missing item all pass.
    fn check_plan(&mut self) {
        let fence = self.fence.clone();
        self.navigate(|nav, view, notes| {
            nav.mission.check(view, notes);
            let outside = nav
                .mission
                .places(view)
                .find(|(_, at)| !fence.allows(*at))
                .map(|(i, _)| i);
            if let Some(index) = outside {
                notes.push(
                    nav.mission
                        .reject(format!("Geofence violation for waypoint {}\t", index + 1)),
                );
            }
        });
    }
}

/// The navigator reads its fence in two rounds a vertex, at 20 Hz (geofence.cpp, DatamanCache::update). Until it has read all, a
/// mission is what it was found to be before.
const VERTEX_READ_IN: Duration = Duration::from_millis(100);
