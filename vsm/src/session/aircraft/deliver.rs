//! Which machine receives what: the requests that machines make of each other, and the events of the vehicle.

use super::{Aircraft, Effects};
use crate::session::effects::{DliEffects, Request};
use crate::session::link::event::VehicleEvent;
use crate::session::{authority, flight, held, mission, payload, reports, termination};

impl Aircraft {
    pub(super) fn deliver_requests(&mut self, dli: &mut DliEffects<'_>) {
        let mut control_changed = false;
        while let Some(request) = self.requests.pop_front() {
            match request {
                Request::Fly {
                    origin,
                    command,
                    just_loaded,
                } => {
                    let input = flight::Input::Fly {
                        origin,
                        command: &command,
                        just_loaded,
                    };
                    self.flight(dli, input);
                }
                Request::Hold => self.flight(dli, flight::Input::Hold),
                Request::YieldToTermination => {
                    self.mission(dli, mission::Input::YieldToTermination);
                    self.flight(dli, flight::Input::YieldToTermination);
                    self.hold_operator_control(dli);
                }
                Request::Audit { what, by, why } => {
                    let why = &why;
                    self.authority(dli, authority::Input::Audit { what, by, why });
                }
                Request::Audited(written) => {
                    self.terminate(dli, termination::Input::Audited(written));
                }
                Request::ControlChanged => {
                    self.terminate(dli, termination::Input::ControlChanged);
                    self.flight(dli, flight::Input::ControlChanged);
                    control_changed = true;
                }
                Request::ControllerLost => self.flight(dli, flight::Input::ControllerLost),
                Request::LoadAndFly {
                    origin,
                    route_type,
                    command,
                } => {
                    let input = mission::Input::LoadAndFly {
                        origin,
                        route_type,
                        command,
                    };
                    self.mission(dli, input);
                }
                Request::DropWaitingCommand { why, without_right } => {
                    let input = mission::Input::DropWaitingCommand { why, without_right };
                    self.mission(dli, input);
                }
                Request::CarryOut { origin, message } => {
                    self.carry_out_held(dli, origin, &message);
                }
                Request::HeldEnded {
                    serial,
                    answer,
                    why,
                } => {
                    let input = held::Input::Ended {
                        serial,
                        answer,
                        why,
                    };
                    self.held(dli, input);
                }
                Request::ListenerChanged { station } => {
                    self.observe(dli, reports::Input::ListenerChanged { station });
                    self.payload(dli, payload::Input::ListenerChanged { station });
                    self.terminate(dli, termination::Input::ListenerChanged { station });
                }
                Request::Configured { changed, by } => {
                    self.observe(dli, reports::Input::Configured { changed, by });
                }
                Request::AnswerLater {
                    station,
                    answers,
                    origin,
                } => {
                    let input = reports::Input::AnswerLater {
                        station,
                        answers,
                        origin,
                    };
                    self.observe(dli, input);
                }
            }
        }
        // Only after all of them: the loss of the controller follows the change of control and flies the loss action. If
        // operator control were released in between, another MAVLink system could get it, and the vehicle would refuse that
        // action.
        if control_changed {
            self.held(dli, held::Input::Watch);
            self.mission(dli, mission::Input::WatchUpload);
            self.link.operator_control.soon();
            self.hold_operator_control(dli);
        }
    }

    pub(super) fn deliver(&mut self, dli: &mut DliEffects<'_>, event: VehicleEvent) {
        match event {
            VehicleEvent::LinkUp => {
                self.mission(dli, mission::Input::LinkUp);
                self.observe(dli, reports::Input::LinkUp);
            }
            VehicleEvent::Restarted => {
                // As after a silence: compare the plan aboard with the loaded one.
                self.mission(dli, mission::Input::LinkUp);
                for reader in &mut self.metadata {
                    reader.restart(&mut self.services);
                }
                self.observe(dli, reports::Input::Restarted);
            }
            VehicleEvent::Silent => self.observe(dli, reports::Input::LinkDown),
            VehicleEvent::ModeChanged => {
                self.flight(dli, flight::Input::ModeChanged);
                self.observe(dli, reports::Input::ModeChanged);
            }
            VehicleEvent::StateChanged => self.observe(dli, reports::Input::StateChanged),
            VehicleEvent::Command(event) => {
                self.link.operator_control.answered(&event);
                self.flight(dli, flight::Input::CommandEnded(&event));
                self.mission(dli, mission::Input::CommandEnded(&event));
            }
            VehicleEvent::ComponentCommand(component, event) => {
                let event = &event;
                self.payload(dli, payload::Input::CommandEnded { component, event });
            }
            VehicleEvent::PayloadReported => self.payload(dli, payload::Input::Poll),
            VehicleEvent::Mission(event) => {
                self.flight(dli, flight::Input::MissionServiceEnded(&event));
                self.mission(dli, mission::Input::ServiceEnded(event));
            }
            VehicleEvent::Parameter(event) => {
                self.observe(dli, reports::Input::ParameterServiceEnded(event));
            }
            VehicleEvent::ParameterReported(name, value) => {
                self.observe(dli, reports::Input::ParameterReported(name, value));
            }
            VehicleEvent::PingReturned(seq) => {
                self.observe(dli, reports::Input::PingReturned(seq));
            }
            VehicleEvent::Text(text) => self.observe(dli, reports::Input::Text(text)),
            VehicleEvent::Event(event) => self.observe(dli, reports::Input::Event(event)),
            VehicleEvent::Metadata(named) => {
                for reader in &mut self.metadata {
                    reader.named(&named);
                }
            }
            VehicleEvent::Link(event) => self.link.report(event, effects!(self, dli)),
            VehicleEvent::ForeignControl(text) => effects!(self, dli).warn_of_link(text),
            VehicleEvent::ControlStatus(status) => {
                self.link
                    .operator_control
                    .note(&status, effects!(self, dli));
                self.hold_operator_control(dli);
            }
        }
    }
}
