//! The vehicle's reported health: as alerts (16000) that are active as long as their cause, and as subsystem status on
//! request (15000, 15001).
//!
//! A cause must last for a while before it is raised, and be gone for a while before it is cleared, so that an intermittent
//! cause makes one alert and not a storm. While the vehicle is silent nothing changes: its last report may no longer hold.

use std::collections::BTreeMap;
use std::time::Duration;

use mapping::health::{Finding, HealthFault, findings};
use mapping::parameter::Parameters;
use mapping::status;
use stanag_msgs::Text;
use stanag_msgs::enums::{AckType, SubsystemBitmap, SubsystemId};
use stanag_msgs::messages::{
    SubsystemStatusDetailRequest, SubsystemStatusReport, SubsystemStatusRequest,
};

use crate::config::Provisional;
use crate::session::alerts::{Alerts, Cause};
use crate::session::context::{Context, Origin, WATCH_SLACK};
use crate::session::effects::Effects;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct HealthWatch {
    /// Causes that are raised or about to be raised.
    causes: BTreeMap<HealthFault, Watched>,
    /// Whether the vehicle was live at the last check: otherwise nothing is due.
    live: bool,
}

#[derive(Debug)]
struct Watched {
    /// Since when it has been in its present state: present or gone.
    since: Duration,
    present: bool,
    raised: bool,
}

impl HealthWatch {
    /// Raises causes that have lasted long enough, and clears those that are gone.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        parameters: &Parameters,
        effects: &mut Effects<'_>,
    ) {
        self.live = context.vehicle.live();
        if !self.live {
            return;
        }
        let found = findings(&context.vehicle.telemetry, parameters);
        for fault in HealthFault::ALL {
            let finding = found.iter().find(|finding| finding.fault == fault);
            self.watch_one(context.mono(), fault, finding, effects);
        }
    }

    /// The bridge did not run for so long: what it saw before has not lasted by that.
    pub(super) fn note_stop(&mut self, stopped: Duration) {
        for watched in self.causes.values_mut() {
            watched.since += stopped;
        }
    }

    fn watch_one(
        &mut self,
        now: Duration,
        fault: HealthFault,
        finding: Option<&Finding>,
        effects: &mut Effects<'_>,
    ) {
        if finding.is_none() && !self.causes.contains_key(&fault) {
            return;
        }
        let watched = self.causes.entry(fault).or_insert(Watched {
            since: now,
            present: true,
            raised: false,
        });
        if watched.present != finding.is_some() {
            watched.present = finding.is_some();
            watched.since = now;
        }
        let lasted = now.saturating_sub(watched.since);
        match finding {
            // Once raised, a new text or priority is sent at once: only the cause itself must last.
            Some(finding) if watched.raised || lasted >= RAISE_AFTER => {
                watched.raised = true;
                let Finding {
                    priority,
                    subsystem,
                    ..
                } = *finding;
                let text = finding.text.as_str();
                effects.raise(Cause::HealthFault(fault), priority, subsystem, text);
            }
            None if lasted >= CLEAR_AFTER => {
                self.causes.remove(&fault);
                effects.clear(Cause::HealthFault(fault), fault.over());
            }
            _ => {}
        }
    }

    /// When the next cause must be raised or cleared.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let pending =
            self.causes
                .values()
                .filter_map(|watched| match (watched.present, watched.raised) {
                    (true, true) => None,
                    (true, false) => Some(watched.since + RAISE_AFTER),
                    (false, _) => Some(watched.since + CLEAR_AFTER),
                });
        pending
            .filter(|_| self.live)
            .map(|at| at + WATCH_SLACK)
            .min()
    }
}

/// 15000: sends 16001 for each requested subsystem, or for all if none is named.
pub(super) fn subsystem_status(
    context: &Context<'_>,
    parameters: &Parameters,
    origin: Origin,
    request: &SubsystemStatusRequest,
    effects: &mut Effects<'_>,
) {
    if let Err(why) = edition_2(context, origin.station) {
        return effects.refuse(Some(origin), why);
    }
    let requested = request.subsystem_id.map_or(0, SubsystemBitmap::raw);
    let live = context.vehicle.live();
    let states = status::subsystems(&context.vehicle.telemetry, parameters, live);
    let wanted: Vec<_> = states
        .into_iter()
        .filter(|(subsystem, _)| requested == 0 || requested >> subsystem.raw() & 1 == 1)
        .collect();
    if wanted.is_empty() {
        let why = format!("no state is known for the subsystems {requested:#x}");
        return effects.refuse(Some(origin), why);
    }
    for state in wanted {
        let reference = detail_reference(effects.alerts, state.0);
        let report = status::subsystem_report(state, reference, effects.stamp());
        effects.send(origin.station, &report.into());
    }
    effects.acknowledge(&origin, AckType::CarriedOut);
}

/// 15001: sends 16001 with the text of each active alert of a subsystem.
pub(super) fn subsystem_detail(
    context: &Context<'_>,
    origin: Origin,
    request: &SubsystemStatusDetailRequest,
    effects: &mut Effects<'_>,
) {
    if let Err(why) = edition_2(context, origin.station) {
        return effects.refuse(Some(origin), why);
    }
    let reference = request.subsystem_state_report_reference.unwrap_or(NO_MORE);
    let standing: Vec<_> = effects
        .alerts
        .standing()
        .filter(|alert| reference_of(alert.subsystem) == reference)
        .map(|alert| (alert.subsystem, alert.priority, alert.text.clone()))
        .collect();
    if standing.is_empty() {
        let why = format!("there is no further report for reference {reference}");
        return effects.refuse(Some(origin), why);
    }
    for (subsystem, priority, text) in standing {
        let report = SubsystemStatusReport {
            report_text_reference: Some(Text::new(&text)),
            ..status::subsystem_report((subsystem, priority), NO_MORE, effects.stamp())
        };
        effects.send(origin.station, &report.into());
    }
    effects.acknowledge(&origin, AckType::CarriedOut);
}

/// The reference with which 15001 requests details of this subsystem: -1 if it has no active alert.
pub(super) fn detail_reference(alerts: &Alerts, subsystem: SubsystemId) -> i32 {
    let stands = alerts.standing().any(|alert| alert.subsystem == subsystem);
    if stands {
        reference_of(subsystem)
    } else {
        NO_MORE
    }
}

fn reference_of(subsystem: SubsystemId) -> i32 {
    i32::from(subsystem.raw()) + 1
}

/// Both requests are known from Edition 2 alone.
pub(super) fn edition_2(context: &Context<'_>, station: usize) -> Result<(), String> {
    match context.provisional(station) {
        Provisional::Off => {
            Err("its layout is derived from Edition 2, and dli.provisional is off".to_owned())
        }
        Provisional::Status | Provisional::All => Ok(()),
    }
}

/// SYS_STATUS arrives at 1 Hz: a fault that is reported only once is ignored.
const RAISE_AFTER: Duration = Duration::from_millis(1_500);
const CLEAR_AFTER: Duration = Duration::from_secs(3);
/// 1101.06: no further details.
const NO_MORE: i32 = -1;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::link::state::VehicleState;
    use crate::session::testing::World;

    /// A look at a vehicle with or without a GPS position.
    fn watch(world: &mut World, health: &mut HealthWatch, gps_fix: bool) -> usize {
        world.vehicle.telemetry.gps_fix = Some(gps_fix);
        world.act(|context, views, effects| {
            health.watch(&context, views.parameters.values, effects);
        });
        world.alerts.standing().count()
    }

    #[test]
    fn a_fault_is_raised_once_it_has_lasted_and_cleared_once_it_is_gone() {
        let (mut world, mut health) = (World::new(), HealthWatch::default());
        let millisecond = Duration::from_millis(1);
        assert_eq!(watch(&mut world, &mut health, false), 0);
        let due = world.now.mono + RAISE_AFTER + WATCH_SLACK;
        assert_eq!(health.poll_timeout(), Some(due));
        world.advance(RAISE_AFTER - millisecond);
        assert_eq!(watch(&mut world, &mut health, false), 0);
        world.advance(millisecond);
        assert_eq!(watch(&mut world, &mut health, false), 1);
        assert_eq!(health.poll_timeout(), None, "it stands as long as it lasts");
        assert_eq!(watch(&mut world, &mut health, true), 1);
        let due = world.now.mono + CLEAR_AFTER + WATCH_SLACK;
        assert_eq!(health.poll_timeout(), Some(due));
        world.advance(CLEAR_AFTER - millisecond);
        assert_eq!(watch(&mut world, &mut health, true), 1);
        world.advance(millisecond);
        assert_eq!(watch(&mut world, &mut health, true), 0);
        assert_eq!(health.poll_timeout(), None);
    }

    #[test]
    fn a_fault_that_comes_and_goes_is_no_storm_of_alerts() {
        let (mut world, mut health) = (World::new(), HealthWatch::default());
        for round in 0..20 {
            assert_eq!(watch(&mut world, &mut health, round % 2 == 1), 0);
            world.advance(Duration::from_secs(1));
        }
        world.advance(RAISE_AFTER);
        watch(&mut world, &mut health, false);
        world.advance(RAISE_AFTER);
        assert_eq!(watch(&mut world, &mut health, false), 1);
        for round in 0..20 {
            assert_eq!(watch(&mut world, &mut health, round % 2 == 0), 1);
            world.advance(Duration::from_secs(1));
        }
    }

    #[test]
    fn a_fault_has_not_lasted_while_the_bridge_did_not_run() {
        let (mut world, mut health) = (World::new(), HealthWatch::default());
        watch(&mut world, &mut health, false);
        let stopped = Duration::from_secs(60);
        world.advance(stopped);
        health.note_stop(stopped);
        assert_eq!(watch(&mut world, &mut health, false), 0);
        world.advance(RAISE_AFTER);
        assert_eq!(watch(&mut world, &mut health, false), 1);
    }

    #[test]
    fn nothing_is_raised_cleared_or_awaited_while_the_vehicle_is_silent() {
        for fault in [false, true] {
            let (mut world, mut health) = (World::new(), HealthWatch::default());
            watch(&mut world, &mut health, !fault);
            world.advance(RAISE_AFTER);
            let before = watch(&mut world, &mut health, !fault);
            assert_eq!(before, usize::from(fault));
            // Its last messages show the contrary, and it is silent from then on.
            watch(&mut world, &mut health, fault);
            assert!(health.poll_timeout().is_some());
            world.vehicle = VehicleState::default();
            world.advance(Duration::from_secs(60));
            assert_eq!(watch(&mut world, &mut health, fault), before);
            assert_eq!(health.poll_timeout(), None);
        }
    }
}
