//! One aircraft: who holds which rights over it, its plan, what it is told, and what is told of it.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::route::{Curving, Policy, Vertices};
use mapping::{altitude, limits};
use mavlink_link::frame::FrameView;
use mavlink_link::service::mission;
use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, CommandedEngineState, SubsystemId};
use stanag_msgs::messages::LoiterConfiguration;

use super::alerts::{Alerts, Cause};
use super::authority::Authority;
use super::authority_record::AuthorityRecord;
use super::configuration::Configuration;
use super::desk::{Desk, Origin};
use super::fence::Fence;
use super::health::HealthWatch;
use super::ignored_fields;
use super::log::LogLevel;
use super::loss_action::LossAction;
use super::maneuver::{Maneuver, Progress};
use super::manual::Sticks;
use super::mission_transfer::{Download, Load};
use super::mission_watchdog::StallWatch;
use super::operator_control::OperatorControl;
use super::parameters::ParameterDesk;
use super::plan_record::UploadedMission;
use super::plan_resync::PlanCheck;
use super::push::Push;
use super::requests::Inquiries;
use super::route_progress::RouteProgress;
use super::steering::Steering;
use super::transfer::Bounds;
use super::vehicle::{Peer, VehicleEvent, VehicleLink};
use crate::config;

/// The machine.
#[derive(Debug)]
pub(crate) struct Aircraft {
    pub(crate) config: config::Vehicle,
    pub(crate) mav: VehicleLink,
    pub(crate) authority: Authority,
    pub(crate) plan: Plan,
    pub(crate) aboard: Option<UploadedMission>,
    /// What 13000 has loaded: flown by mode 11, also after another route was aboard for another mode.
    pub(super) loaded_mission: Option<UploadedMission>,
    pub(crate) load: Option<Load>,
    pub(super) download: Option<Download>,
    pub(crate) bounds: Bounds,
    pub(crate) alerts: Alerts,
    pub(super) maneuver: Option<(Option<Origin>, Maneuver)>,
    pub(super) loiter: LoiterConfiguration,
    pub(super) commanded: Commanded,
    /// The mode that it was commanded in.
    pub(super) commanded_in: Option<Px4Mode>,
    /// Fields without effect that stations were told of.
    pub(super) unused_told: ignored_fields::AlreadyReported,
    pub(super) sticks: Sticks,
    pub(super) steering: Steering,
    /// The last 2008.
    pub(super) engine_command: Option<CommandedEngineState>,
    pub(super) push: Push,
    pub(super) mission_watchdog: StallWatch,
    pub(super) configuration: Configuration,
    pub(super) parameters: ParameterDesk,
    pub(super) inquiries: Inquiries,
    pub(super) health: HealthWatch,
    pub(crate) fence: Fence,
    /// That AGL is flown above home has been said.
    said_agl: bool,
    pub(super) authority_record: AuthorityRecord,
    /// The vehicle's link id as it is stored.
    pub(super) kept_link_id: Option<u8>,
    /// What the VSM flies since the controlling CUCS is lost.
    pub(super) loss_action: Option<LossAction>,
    pub(super) plan_check: PlanCheck,
    pub(super) route_progress: RouteProgress,
    pub(super) operator_control: OperatorControl,
    /// A restart of the VSM cut off a launch, and what became of it is not known yet.
    pub(super) launch_cut_off: bool,
}

impl Aircraft {
    pub(crate) fn new(config: config::Vehicle, mav: VehicleLink, number: i32) -> Aircraft {
        let config::Limits {
            first_m,
            leg_m,
            lowest_m,
            highest_m,
            speed_m_s,
        } = config.limits;
        let items = usize::from(config.curve.max_items);
        let bounds = Bounds {
            agl: match config.agl {
                config::Agl::Home => altitude::Agl::AboveHome,
                config::Agl::Refuse => altitude::Agl::Refuse,
            },
            altimeter: altitude::Altimeter::STANDARD,
            limits: limits::Limits {
                first_m,
                leg_m,
                lowest_m,
                highest_m,
                speed_m_s,
                items,
            },
            curving: Curving {
                tolerance_m: config.curve.tolerance_m,
                policy: match config.curve.policy {
                    config::CurvePolicy::Slow => Policy::Slow,
                    config::CurvePolicy::Refuse => Policy::Refuse,
                },
                vertices: match config.curve.vertices {
                    config::CurveVertices::On => Vertices::OnCurve,
                    config::CurveVertices::Free => Vertices::Free,
                },
                ..Curving::default()
            },
        };
        let areas = config.area.iter().map(config::Area::area).collect();
        Aircraft {
            config,
            mav,
            authority: Authority::default(),
            plan: Plan::default(),
            aboard: None,
            loaded_mission: None,
            load: None,
            download: None,
            bounds,
            alerts: Alerts::new(number),
            maneuver: None,
            loiter: LoiterConfiguration::default(),
            commanded: Commanded::default(),
            commanded_in: None,
            unused_told: ignored_fields::AlreadyReported::default(),
            sticks: Sticks::default(),
            steering: Steering::default(),
            engine_command: None,
            push: Push::default(),
            mission_watchdog: StallWatch::default(),
            configuration: Configuration::default(),
            parameters: ParameterDesk::default(),
            inquiries: Inquiries::default(),
            health: HealthWatch::default(),
            fence: Fence::new(areas),
            said_agl: false,
            authority_record: AuthorityRecord::default(),
            kept_link_id: None,
            loss_action: None,
            plan_check: PlanCheck::default(),
            route_progress: RouteProgress::default(),
            operator_control: OperatorControl::default(),
            launch_cut_off: false,
        }
    }

    pub(crate) fn id(&self) -> Id {
        self.config.id
    }

    /// What stands from the start: nobody has heard the vehicle, and an unsigned link is said aloud.
    pub(crate) fn announce(&mut self, desk: &mut Desk<'_>) {
        let text = "the vehicle has not been heard yet: its state is not known".to_owned();
        let unheard = self.alerts.raise(
            Cause::VehicleSilent,
            AlertPriority::Caution,
            SubsystemId::Comms,
            text,
        );
        desk.alert(self.id(), &[], unheard);
        if self.config.signing == config::Signing::Off {
            let text =
                "MAVLink signing is off: anyone in range of the link can command this vehicle"
                    .to_owned();
            let raised = self.alerts.raise(
                Cause::SigningOff,
                AlertPriority::Warning,
                SubsystemId::Comms,
                text,
            );
            desk.alert(self.id(), &[], raised);
        }
    }

    /// A datagram from the vehicle's side.
    pub(super) fn handle_datagram(
        &mut self,
        desk: &mut Desk<'_>,
        from: Peer,
        bytes: &[u8],
        tap: &mut dyn FnMut(&FrameView<'_>),
    ) {
        self.mav
            .handle_datagram(desk.now, from, bytes, desk.store, tap);
        self.run_until_idle(desk);
        if let Some(aboard) = &self.aboard {
            self.route_progress
                .look(&aboard.compiled, &self.mav.telemetry);
        }
        self.watch_progress(desk);
        self.settle_authority(desk);
    }

    /// Does what is due.
    pub(super) fn handle_timeout(&mut self, desk: &mut Desk<'_>) {
        self.mav.handle_timeout(desk.now, desk.store);
        self.watch_controller(desk);
        self.run_until_idle(desk);
        self.watch_modes(desk);
        self.compare_plan(desk);
        self.end_launch_cut_off(desk);
        self.tend_operator_control(desk);
        self.send_configuration(desk);
        self.watch_inquiries(desk);
        self.watch_fence(desk);
        self.watch_health(desk);
        self.clear_answers(desk);
        self.advance_download(desk);
        self.settle_authority(desk);
        self.push_due(desk);
        self.keep_link_id(desk);
    }

    /// When [`Aircraft::handle_timeout`] is next needed.
    pub(super) fn poll_timeout(&self, now: Duration) -> Duration {
        [
            Some(self.mav.poll_timeout()),
            self.maneuver
                .as_ref()
                .and_then(|(_, maneuver)| maneuver.poll_timeout()),
            self.load.as_ref().and_then(Load::poll_timeout),
            self.push.poll_timeout(),
            self.download.as_ref().map(|download| download.next_at),
            self.sticks.poll_timeout(),
            self.steering.poll_timeout(),
            self.configuration.poll_timeout(),
            self.inquiries.poll_timeout(),
            self.authority.poll_timeout(),
            self.loss_action.as_ref().map(LossAction::poll_timeout),
            self.alerts.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .fold(now + LOOK_AGAIN, Duration::min)
    }

    /// Lets every machine take its next step, until nothing is left to do now.
    pub(super) fn run_until_idle(&mut self, desk: &mut Desk<'_>) {
        for _ in 0..MAX_ROUNDS {
            let mut events: VecDeque<VehicleEvent> = VecDeque::new();
            while let Some(event) = self.mav.poll_event() {
                events.push_back(event);
            }
            let idle = events.is_empty();
            for event in events {
                self.take_event(desk, event);
            }
            self.stream_sticks(desk);
            self.stream_set_points(desk);
            self.advance_maneuver(desk);
            self.advance_load(desk);
            self.mav.flush(desk.now, desk.store);
            if idle {
                break;
            }
        }
    }

    pub(super) fn take_event(&mut self, desk: &mut Desk<'_>, event: VehicleEvent) {
        let listeners = desk.listeners(&self.authority, None);
        match event {
            VehicleEvent::Heard => {
                self.plan_may_differ();
                let raised = self
                    .alerts
                    .clear(Cause::VehicleSilent, "the vehicle is heard");
                desk.alert(self.id(), &listeners, raised);
                self.report_on_change(desk);
                self.read_parameters(desk);
                self.fence.look_again(desk.now.mono);
            }
            VehicleEvent::Silent => {
                self.stop_reading(desk);
                let text = "the vehicle is silent: its state is not known".to_owned();
                let raised = self.alerts.raise(
                    Cause::VehicleSilent,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    text,
                );
                desk.alert(self.id(), &listeners, raised);
                self.report_on_change(desk);
            }
            VehicleEvent::Restarted => {
                self.plan_may_differ();
                self.read_parameters(desk);
                self.fence.look_again(desk.now.mono);
                let text = "the autopilot has restarted".to_owned();
                let raised = self.alerts.notice(
                    desk.now.mono,
                    AlertPriority::Warning,
                    AUTOPILOT_SUBSYSTEM,
                    text,
                );
                desk.alert(self.id(), &listeners, raised);
            }
            VehicleEvent::ModeChanged => self.mode_has_changed(desk),
            VehicleEvent::ForeignCommand(system, command) => {
                self.say_foreign_command(desk, system, command);
            }
            VehicleEvent::ControlStatus(status) => self.take_control_status(desk, &status),
            VehicleEvent::ControlAsked(system) => self.say_control_asked(desk, system),
            VehicleEvent::Parameter(event) => self.take_parameter(desk, event),
            VehicleEvent::ParameterTold(name, value) => self.parameter_told(desk, name, value),
            VehicleEvent::PingReturned(seq) => self.ping_returned(desk, seq),
            VehicleEvent::Text(text) => {
                let priority = mapping::alert::priority(text.severity);
                let raised =
                    self.alerts
                        .notice(desk.now.mono, priority, AUTOPILOT_SUBSYSTEM, text.text);
                desk.alert(self.id(), &listeners, raised);
            }
            VehicleEvent::Command(event) => {
                self.operator_control.answered(&event);
                if let Some((origin, maneuver)) = &mut self.maneuver
                    && let Progress::Refused(why) =
                        maneuver.handle_command(desk.now.mono, &event, &self.mav)
                {
                    let origin = *origin;
                    self.fail_maneuver(desk, origin, why);
                }
                self.load_sees_command(desk, &event);
            }
            VehicleEvent::Mission(event) => {
                if let mission::Event::CurrentSet { .. } = &event {
                    self.route_progress.sent_on(&self.mav.telemetry);
                }
                if let Some((origin, maneuver)) = &mut self.maneuver
                    && let Progress::Refused(why) = maneuver.handle_mission(&event)
                {
                    let origin = *origin;
                    self.fail_maneuver(desk, origin, why);
                }
                if !self.fence_sees_mission(desk, &event) {
                    self.load_sees_mission(desk, event);
                }
            }
            VehicleEvent::Link(event) => self.take_link_event(desk, &listeners, event),
        }
    }

    pub(super) fn take_link_event(
        &mut self,
        desk: &mut Desk<'_>,
        listeners: &[usize],
        event: mavlink_link::link::Event<Peer>,
    ) {
        use mavlink_link::link::Event as E;
        match event {
            E::PeerChanged { from, to } => {
                let text = match from {
                    None => format!("the vehicle's address is {to}"),
                    Some(from) => format!("the vehicle's address is {to}, it was {from}"),
                };
                desk.note(LogLevel::Info, self.id(), text);
            }
            E::Behind => desk.note(
                LogLevel::Info,
                self.id(),
                "its stamps are behind: it has restarted".to_owned(),
            ),
            E::Live => {
                desk.note(LogLevel::Info, self.id(), "the link is live".to_owned());
                self.say_signed(desk, listeners);
            }
            E::Alert(alert) => {
                let text = link_alert_text(alert).to_owned();
                let raised = self.alerts.notice(
                    desk.now.mono,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    text,
                );
                desk.alert(self.id(), listeners, raised);
            }
            // No exchange is configured for this vehicle.
            E::KeyExchange(_) => desk.counters.count("key exchange ignored"),
        }
    }

    /// Says once that altitude type 2 is flown as height above home.
    pub(super) fn say_agl(&mut self, desk: &mut Desk<'_>) {
        if !self.said_agl {
            self.said_agl = true;
            self.advise(
                desk,
                "altitude type 2 (AGL) is flown as height above home".to_owned(),
            );
        }
    }

    /// Something that operators should know.
    pub(super) fn advise(&mut self, desk: &mut Desk<'_>, text: String) {
        let listeners = desk.listeners(&self.authority, None);
        let raised = self.alerts.notice(
            desk.now.mono,
            AlertPriority::Nominal,
            SubsystemId::VsmStatus,
            text,
        );
        desk.alert(self.id(), &listeners, raised);
    }

    pub(super) fn warn(&mut self, desk: &mut Desk<'_>, cause: Cause, text: String) {
        let listeners = desk.listeners(&self.authority, None);
        let raised = self
            .alerts
            .raise(cause, AlertPriority::Warning, SubsystemId::VsmStatus, text);
        desk.alert(self.id(), &listeners, raised);
    }
}

/// What an operator is told of a link's alert.
pub(crate) fn link_alert_text(alert: mavlink_link::link::Alert) -> &'static str {
    use mavlink_link::link::Alert as A;
    match alert {
        A::WallFarAhead => {
            "this computer's clock is over a year ahead of the signing clock: check it"
        }
        A::CeilingNotStored => {
            "the signing clock cannot be stored: sending and accepting will stop"
        }
        A::ClockExhausted => "the signing clock is exhausted: a new key is needed",
        A::StaysBehind => "the vehicle's stamps stay behind: no frame of it is believed",
        A::VehicleUnsigned => "the vehicle sends unsigned: its key may be lost",
        A::BadSignatures => "many frames with bad signatures: an attack, or two keys",
        A::Future => "frames with stamps over an hour ahead are refused",
        A::LinkIdMoved => "the autopilot signs with another link id",
        A::StreamTableFull => "too many signing streams: one is refused",
    }
}

/// Subsystem ID of what the autopilot says of itself: VSM specific.
const AUTOPILOT_SUBSYSTEM: SubsystemId = SubsystemId::from_raw(20);
/// Silences are looked at this often.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// Bound on what one datagram may set off.
const MAX_ROUNDS: usize = 32;
