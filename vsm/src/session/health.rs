//! What the vehicle itself says is wrong, as alerts that stand as long as their cause (16000), and subsystem status on
//! request (15000, 15001).
//!
//! A cause must have lasted before it is raised, and be gone for a while before it is cleared: one that comes and goes
//! makes one alert, not a storm. Over a silent vehicle nothing changes: what it said last is not what is now.

use std::collections::BTreeMap;
use std::time::Duration;

use mapping::health::{Finding, HealthFault, findings};
use mapping::status;
use stanag_msgs::Text;
use stanag_msgs::enums::{AckType, SubsystemBitmap, SubsystemId};
use stanag_msgs::messages::{
    SubsystemStatusDetailRequest, SubsystemStatusReport, SubsystemStatusRequest,
};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::{Desk, Origin};
use crate::config::Provisional;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct HealthWatch {
    /// Causes that are raised, or about to be.
    causes: BTreeMap<HealthFault, Watched>,
}

#[derive(Debug)]
struct Watched {
    /// Since when it is as it is now: there, or gone.
    since: Duration,
    there: bool,
    raised: bool,
}

impl Aircraft {
    /// Raises what has lasted, clears what is gone.
    pub(super) fn watch_health(&mut self, desk: &mut Desk<'_>) {
        if !self.mav.live() {
            return;
        }
        let found = findings(&self.mav.telemetry, self.configured_parameters());
        for ailment in HealthFault::ALL {
            let finding = found.iter().find(|finding| finding.ailment == ailment);
            self.watch_ailment(desk, ailment, finding);
        }
    }

    fn watch_ailment(
        &mut self,
        desk: &mut Desk<'_>,
        ailment: HealthFault,
        finding: Option<&Finding>,
    ) {
        let now = desk.now.mono;
        let causes = &mut self.health.causes;
        if finding.is_none() && !causes.contains_key(&ailment) {
            return;
        }
        let watched = causes.entry(ailment).or_insert(Watched {
            since: now,
            there: true,
            raised: false,
        });
        if watched.there != finding.is_some() {
            watched.there = finding.is_some();
            watched.since = now;
        }
        let lasted = now.saturating_sub(watched.since);
        let raised = match finding {
            Some(finding) if watched.raised || lasted >= RAISE_AFTER => {
                watched.raised = true;
                self.alerts.raise(
                    Cause::HealthFault(ailment),
                    finding.priority,
                    finding.subsystem,
                    finding.text.clone(),
                )
            }
            None if lasted >= CLEAR_AFTER => {
                causes.remove(&ailment);
                self.alerts
                    .clear(Cause::HealthFault(ailment), ailment.over())
            }
            _ => None,
        };
        if raised.is_some() {
            let listeners = desk.listeners(&self.authority, None);
            desk.alert(self.id(), &listeners, raised);
        }
    }

    /// 15000: 16001 of each subsystem that is asked for, all where none is named.
    pub(super) fn subsystem_status(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        request: &SubsystemStatusRequest,
    ) {
        if let Err(why) = edition_2(desk) {
            return self.refuse(desk, Some(origin), why);
        }
        let asked = request.subsystem_id.map_or(0, SubsystemBitmap::raw);
        self.want_sources_of(SubsystemStatusReport::ID);
        let live = self.mav.live();
        let states = status::subsystems(&self.mav.telemetry, self.configured_parameters(), live);
        let wanted: Vec<_> = states
            .into_iter()
            .filter(|(subsystem, _)| asked == 0 || asked >> subsystem.raw() & 1 == 1)
            .collect();
        if wanted.is_empty() {
            let why = format!("nothing is known of the subsystems {asked:#x}");
            return self.refuse(desk, Some(origin), why);
        }
        for state in wanted {
            let reference = self.detail_reference(state.0);
            let report = status::subsystem_report(state, reference, desk.stamp());
            desk.send(origin.station, self.id(), &report.into());
        }
        desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
    }

    /// 15001: 16001 with the text of each alert that stands for a subsystem.
    pub(super) fn subsystem_detail(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        request: &SubsystemStatusDetailRequest,
    ) {
        if let Err(why) = edition_2(desk) {
            return self.refuse(desk, Some(origin), why);
        }
        let reference = request.subsystem_state_report_reference.unwrap_or(NO_MORE);
        let standing: Vec<_> = self
            .alerts
            .standing()
            .filter(|alert| reference_of(alert.subsystem) == reference)
            .map(|alert| (alert.subsystem, alert.priority, alert.text.clone()))
            .collect();
        if standing.is_empty() {
            let why = format!("there is nothing more to ask about {reference}");
            return self.refuse(desk, Some(origin), why);
        }
        for (subsystem, priority, text) in standing {
            let report = SubsystemStatusReport {
                report_text_reference: Some(Text::new(&text)),
                ..status::subsystem_report((subsystem, priority), NO_MORE, desk.stamp())
            };
            desk.send(origin.station, self.id(), &report.into());
        }
        desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
    }

    /// What 15001 asks about this subsystem with: -1 where no alert stands for it.
    pub(super) fn detail_reference(&self, subsystem: SubsystemId) -> i32 {
        let stands = self
            .alerts
            .standing()
            .any(|alert| alert.subsystem == subsystem);
        if stands {
            reference_of(subsystem)
        } else {
            NO_MORE
        }
    }
}

fn reference_of(subsystem: SubsystemId) -> i32 {
    i32::from(subsystem.raw()) + 1
}

/// Both requests are known from Edition 2 alone.
fn edition_2(desk: &Desk<'_>) -> Result<(), String> {
    match desk.provisional {
        Provisional::Off => {
            Err("its layout is derived from Edition 2, and dli.provisional is off".to_owned())
        }
        Provisional::Status | Provisional::All => Ok(()),
    }
}

/// SYS_STATUS comes at 1 Hz: one that is told once and never again is none.
const RAISE_AFTER: Duration = Duration::from_millis(1_500);
const CLEAR_AFTER: Duration = Duration::from_secs(3);
/// 1101.06: there is no more to be asked for.
const NO_MORE: i32 = -1;
