//! What the agent flies by itself while nothing is received from the ground: the machine of
//! [`session::contingency`](crate::session::contingency), which the bridge runs too, on what PX4 reports here.
//!
//! ```text
//! the ground is there --no verified frame for link_lost_s--> alone: causes are judged, actions commanded
//!         ^                                                     |
//!         +---- a verified frame: what was done is sent to it --+   and from then on it decides
//! ```
//!
//! It promises: nothing is commanded while the ground is there, over a pilot, or over a failsafe of PX4
//! ([`other`](crate::session::other)); each action is confirmed by the mode that the vehicle reports. It is off unless
//! configured.

use std::time::Duration;

use mapping::area::{Area, is_breached};
use mapping::mode::Px4Mode;
use mapping::telemetry::Telemetry;
use mavlink_link::Now;
use mavlink_link::dialect::{MavCmd, MavMessage, MavSeverity};
use mavlink_link::frame::FrameView;
use mavlink_link::receiver::AUTOPILOT;
use mavlink_link::service::{Node, command};
use mavlink_link::store::{Disk, Store as _, StoreError};
use serde::Serialize;
use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::output::Reports;
use crate::config::{self, AgentContingency, ContingencyAction};
use crate::session::LogLevel;
use crate::session::alerts::Cause;
use crate::session::contingency::{
    self, Contingencies, ContingencyContext, Outlet, Provision, Record, Seen, What, reported,
};
use crate::session::maneuver::set_mode;
use crate::session::other::{Holding, Other};

/// The causes, what PX4 reports about them, and whether the ground is there.
#[derive(Debug)]
pub(super) struct Alone {
    settings: Option<Settings>,
    vehicle: Id,
    machine: Contingencies,
    telemetry: Telemetry,
    /// When PX4 last reported its mode, and when its last HEARTBEAT, which reports whether it is armed.
    mode_at: Option<Duration>,
    beat_at: Option<Duration>,
    commanded_at: Option<Duration>,
    /// The mode that was commanded, while the vehicle is in it: nobody else has entered it.
    entered: Option<Px4Mode>,
    holding: Holding,
    /// Since when the ground is lost.
    lost_since: Option<Duration>,
    looks: u32,
    look_at: Duration,
    /// The command to send.
    command: Option<Px4Mode>,
    /// Active alerts.
    standing: Vec<(Cause, String)>,
    /// A summary of what was done, and when to send it to the ground once more.
    again: Option<(Duration, Vec<String>)>,
    last: Vec<String>,
}

#[derive(Debug)]
struct Settings {
    lost_after: Duration,
    provision: Provision,
    areas: Vec<Area>,
}

/// Its state, for the status.
#[derive(Debug, Clone, Serialize)]
pub struct AloneStatus {
    /// How long nothing has been received from the ground, s; `None` while it is there.
    pub ground_lost_s: Option<f64>,
    /// Active alerts.
    pub standing: Vec<String>,
    /// What was done the last time that the ground was lost.
    pub last: Vec<String>,
}

/// What the caller knows.
pub(super) struct Surroundings<'a> {
    pub(super) now: Now,
    /// When the agent was started, and when the ground was last there: by a frame that was not held back, even if it
    /// verified. Otherwise, whoever jams the radio and lets one old frame through at a time would keep the vehicle from
    /// returning.
    pub(super) started: Duration,
    pub(super) ground: Option<Duration>,
    /// Whether PX4 can be commanded now.
    pub(super) reaches_px4: bool,
    pub(super) disk: &'a mut dyn Disk,
    pub(super) reports: &'a mut Reports,
}

impl Alone {
    pub(super) fn new(configured: Option<&AgentContingency>, vehicle: Id) -> Alone {
        let settings = configured.map(|one| Settings {
            lost_after: one.link_lost(),
            provision: Provision {
                battery: one.battery,
                battery_percent: one.battery_percent,
                position: one.position,
                fence: one.fence,
                engine: one.engine,
                link: one.link,
            },
            areas: one.area.iter().map(config::Area::area).collect(),
        });
        Alone {
            settings,
            vehicle,
            machine: Contingencies::default(),
            telemetry: Telemetry::default(),
            mode_at: None,
            beat_at: None,
            commanded_at: None,
            entered: None,
            holding: Holding::default(),
            lost_since: None,
            looks: 0,
            look_at: Duration::ZERO,
            command: None,
            standing: Vec::new(),
            again: None,
            last: Vec::new(),
        }
    }

    /// Restores what an earlier process has done about causes that may persist.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn restore(
        &mut self,
        now: Now,
        disk: &mut dyn Disk,
        reports: &mut Reports,
    ) -> Result<(), StoreError> {
        if self.settings.is_none() {
            return Ok(());
        }
        let (mut machine, mut standing) = (Contingencies::default(), Vec::new());
        machine.restore(&mut Agents {
            now: now.mono,
            vehicle: self.vehicle,
            disk,
            reports,
            standing: &mut standing,
        })?;
        self.machine = machine;
        Ok(())
    }

    /// Takes a verified frame of PX4.
    pub(super) fn take(&mut self, mono: Duration, frame: &FrameView<'_>) {
        if self.settings.is_none() || frame.header().component_id != AUTOPILOT {
            return;
        }
        let Ok(message) = frame.message() else {
            return;
        };
        match &message {
            MavMessage::HEARTBEAT(_) => (self.mode_at, self.beat_at) = (Some(mono), Some(mono)),
            MavMessage::CURRENT_MODE(_) => self.mode_at = Some(mono),
            _ => {}
        }
        self.telemetry.update(&message);
    }

    /// PX4 has restarted: its earlier reports no longer hold.
    pub(super) fn px4_restarted(&mut self) {
        self.telemetry = Telemetry::default();
        (self.mode_at, self.beat_at, self.entered) = (None, None, None);
    }

    /// Checks whether the ground is there, and if not, what PX4 reports.
    pub(super) fn step(&mut self, with: &mut Surroundings<'_>) {
        let now = with.now.mono;
        let Some(settings) = &self.settings else {
            return;
        };
        let received = with.ground.unwrap_or(with.started).max(with.started);
        let lost = now.saturating_sub(received) >= settings.lost_after;
        match (lost, self.lost_since) {
            (false, None) => {
                // The contingency of an earlier process; the ground's return has ended it.
                if with.ground.is_some() && self.machine.has_handled() {
                    self.stand_down(with);
                }
                return self.report_again(with);
            }
            (false, Some(since)) => return self.ground_is_back(since, with),
            (true, None) => {
                self.lost_since = Some(received);
                self.look_at = now;
                with.reports.note(
                    LogLevel::Warning,
                    format!(
                        "nothing is received of the ground for {:.0} s: its contingencies are this agent's from now on",
                        settings.lost_after.as_secs_f64()
                    ),
                );
            }
            (true, Some(_)) => {}
        }
        if now < self.look_at {
            return;
        }
        self.look_at = now.saturating_add(LOOK_EVERY);
        self.looks = self.looks.saturating_add(1);
        let context = self.context(now);
        let mut agents = Agents {
            now,
            vehicle: self.vehicle,
            disk: with.disk,
            reports: with.reports,
            standing: &mut self.standing,
        };
        // The causes are watched even while PX4 cannot be commanded, so that nothing is missed meanwhile.
        self.machine.watch(&context, &mut agents);
        if !with.reaches_px4 {
            return;
        }
        if let Some(action) = self.machine.poll(&context, &mut agents) {
            self.machine.announce(&context.config, &mut agents);
            let mode = contingency::modes(action).first().copied();
            (self.command, self.entered) = (mode, mode);
            self.commanded_at = Some(now);
        }
    }

    fn context(&mut self, now: Duration) -> ContingencyContext {
        let telemetry = &self.telemetry;
        let fresh = |at: Option<Duration>, life| at.is_some_and(|at| now.saturating_sub(at) < life);
        let live = fresh(self.mode_at, SILENCE) && fresh(self.beat_at, NO_HEARTBEAT);
        // A report that was in transit when a command was sent shows the earlier mode.
        let settled = self.commanded_at.is_none_or(|at| {
            let newer = at.saturating_add(ON_ITS_WAY);
            self.mode_at.is_some_and(|mode_at| mode_at >= newer)
        });
        let mode = telemetry.mode.filter(|_| settled);
        // A report from just after the command may still show the earlier mode.
        let awaited = fresh(self.commanded_at, SHOWN_WITHIN);
        if settled {
            let stays = |entered: &Px4Mode| awaited || mode == Some(*entered);
            self.entered = self.entered.filter(stays);
            self.holding.note(Other::of(telemetry), now);
        }
        let other = mode.and_then(|_| Other::of(telemetry));
        let stays = |other: &Other| other.may_stay() && self.holding.leads_nowhere(now);
        // A return or landing that this agent commanded belongs to nobody else.
        let own =
            |other: &Other| matches!(other, Other::Ending(mode) if self.entered == Some(*mode));
        let (config, areas) = match &self.settings {
            Some(settings) => (settings.provision, settings.areas.as_slice()),
            None => (Provision::default(), &[][..]),
        };
        let config = for_airframe(config, telemetry);
        let outside = |at| is_breached(areas, at);
        let outside = (!areas.is_empty()).then_some(&outside as &dyn Fn((f64, f64)) -> bool);
        let [engine, position, fence, battery] = reported(telemetry, &config, outside);
        let link = Seen {
            number: self.looks,
            what: What::Present,
        };
        ContingencyContext {
            now,
            config,
            live,
            airborne: telemetry.airborne(),
            down: telemetry.armed == Some(false),
            mode,
            other: other.filter(|other| !stays(other) && !own(other)),
            seen: [engine, position, fence, battery, Some(link)],
            // The agent stores no routes and knows none of the ground's.
            carries: None,
            flies: None,
            completed: None,
            // The ground is lost, so nobody controls the vehicle.
            controlled: false,
            lands: false,
            busy: awaited,
            operator_waits: false,
            on_final: is_on_final(telemetry),
            stored: [false, false],
            may_change_mission: false,
        }
    }

    /// From now on the ground decides, so it must know what was done.
    fn ground_is_back(&mut self, since: Duration, with: &mut Surroundings<'_>) {
        let lost_s = with.now.mono.saturating_sub(since).as_secs_f64();
        let config = self
            .settings
            .as_ref()
            .map_or_else(Provision::default, |one| {
                for_airframe(one.provision, &self.telemetry)
            });
        let mut texts = vec![format!("Agent: the ground was lost for {lost_s:.0} s")];
        let done = self.machine.summary(&config);
        texts.extend(done.into_iter().map(|text| format!("Agent: {text}")));
        if texts.len() == 1 {
            texts.push("Agent: nothing was flown for it".to_owned());
        }
        for text in &texts {
            with.reports.note(LogLevel::Warning, text.clone());
        }
        send(&texts, with.reports);
        let again = with.now.mono.saturating_add(SAY_AGAIN);
        self.again = Some((again, texts.clone()));
        self.last = texts;
        self.lost_since = None;
        self.stand_down(with);
    }

    fn stand_down(&mut self, with: &mut Surroundings<'_>) {
        (self.command, self.entered, self.commanded_at) = (None, None, None);
        let mut agents = Agents {
            now: with.now.mono,
            vehicle: self.vehicle,
            disk: with.disk,
            reports: with.reports,
            standing: &mut self.standing,
        };
        self.machine
            .stand_down("the ground is received again, and decides", &mut agents);
    }

    /// A radio can lose texts, so the summary is sent twice.
    fn report_again(&mut self, with: &mut Surroundings<'_>) {
        let due = |(at, _): &mut (Duration, Vec<String>)| with.now.mono >= *at;
        if let Some((_, texts)) = self.again.take_if(due) {
            send(&texts, with.reports);
        }
    }

    /// The command to send to PX4.
    pub(super) fn poll_command(&mut self, system: u8) -> Option<MavMessage> {
        let mode = self.command.take()?;
        let to = Node::new(system, AUTOPILOT);
        Some(command::long(
            to,
            MavCmd::MAV_CMD_DO_SET_MODE,
            set_mode(mode),
        ))
    }

    /// When [`Alone::step`] is next needed.
    pub(super) fn poll_timeout(&self, started: Duration, ground: Option<Duration>) -> Duration {
        let Some(settings) = &self.settings else {
            return Duration::MAX;
        };
        if self.lost_since.is_some() {
            return self.look_at;
        }
        let received = ground.unwrap_or(started).max(started);
        let again = self.again.as_ref().map_or(Duration::MAX, |(at, _)| *at);
        received.saturating_add(settings.lost_after).min(again)
    }

    pub(super) fn status(&self, mono: Duration) -> Option<AloneStatus> {
        self.settings.as_ref()?;
        Some(AloneStatus {
            ground_lost_s: self
                .lost_since
                .map(|since| mono.saturating_sub(since).as_secs_f64()),
            standing: self.standing.iter().map(|(_, text)| text.clone()).collect(),
            last: self.last.clone(),
        })
    }
}

/// In AUTO.LAND, PX4 puts a fixed wing down wherever it is. Instead it returns, and lands by PX4's own approach. Without a
/// position only a landing is possible.
fn for_airframe(provision: Provision, telemetry: &Telemetry) -> Provision {
    let located = telemetry.evidence.located.is_none_or(|one| one.value);
    if telemetry.vehicle_type.is_none() || telemetry.hovers() || !located {
        return provision;
    }
    let returns = |action: Option<ContingencyAction>| match action {
        Some(ContingencyAction::Land) => Some(ContingencyAction::Rtl),
        other => other,
    };
    Provision {
        battery: returns(provision.battery),
        fence: returns(provision.fence),
        engine: returns(provision.engine),
        link: returns(provision.link),
        ..provision
    }
}

/// Whether a fixed wing may be flying to its touch-down: the last item of its mission.
fn is_on_final(telemetry: &Telemetry) -> bool {
    let last = |total: u16, seq: u16| seq.saturating_add(1) >= total;
    telemetry.mode == Some(Px4Mode::MISSION)
        && telemetry.vehicle_type.is_some()
        && !telemetry.hovers()
        && telemetry
            .mission
            .is_some_and(|mission| mission.total.is_some_and(|total| last(total, mission.seq)))
}

fn send(texts: &[String], reports: &mut Reports) {
    for text in texts {
        reports.alert_ground(MavSeverity::MAV_SEVERITY_WARNING, text.clone());
    }
}

/// The machine's outlet: the agent's disk, its log, and texts for the ground, which may still receive although nothing is
/// received from it.
struct Agents<'a> {
    now: Duration,
    vehicle: Id,
    disk: &'a mut dyn Disk,
    reports: &'a mut Reports,
    standing: &'a mut Vec<(Cause, String)>,
}

impl Outlet for Agents<'_> {
    fn now(&self) -> Duration {
        self.now
    }

    fn load(&mut self) -> Result<Option<Record>, StoreError> {
        self.disk.load(&self.vehicle)
    }

    fn save(&mut self, record: &Record) -> Result<(), StoreError> {
        self.disk.save(&self.vehicle, record)
    }

    fn raise(
        &mut self,
        cause: Cause,
        priority: AlertPriority,
        _subsystem: SubsystemId,
        text: String,
    ) {
        let stands = |(standing, before): &(Cause, String)| *standing == cause && *before == text;
        if self.standing.iter().any(stands) {
            return;
        }
        self.standing.retain(|(standing, _)| *standing != cause);
        self.notify(priority, SubsystemId::VsmStatus, text.clone());
        self.standing.push((cause, text));
    }

    fn clear(&mut self, cause: Cause, text: &str) {
        let before = self.standing.len();
        self.standing.retain(|(standing, _)| *standing != cause);
        if self.standing.len() != before {
            self.reports.note(LogLevel::Info, text);
        }
    }

    fn warn(&mut self, cause: Cause, text: String) {
        self.raise(cause, AlertPriority::Warning, SubsystemId::VsmStatus, text);
    }

    fn notify(&mut self, priority: AlertPriority, _subsystem: SubsystemId, text: String) {
        if priority == AlertPriority::Emergency {
            let severity = MavSeverity::MAV_SEVERITY_ALERT;
            self.reports
                .alert_ground(severity, format!("Agent: {text}"));
        }
        self.reports.note(LogLevel::Warning, text);
    }
}

/// The link needs three checks in a row, as the other causes need three reports.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// HEARTBEAT comes at 1 Hz, and a commanded mode takes a moment.
const SHOWN_WITHIN: Duration = Duration::from_millis(2_500);
/// The line to PX4 is short: a report in transit arrives within this time.
const ON_ITS_WAY: Duration = Duration::from_millis(200);
/// As for the bridge.
const SILENCE: Duration = crate::session::SILENCE;
const NO_HEARTBEAT: Duration = Duration::from_secs(10);
const SAY_AGAIN: Duration = Duration::from_secs(5);
