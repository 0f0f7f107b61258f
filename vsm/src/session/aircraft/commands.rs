//! What the bridge requests of a vehicle for a message of a CUCS.

use mapping::airframe;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::{
    Contingency, HandoverStatusReport, HeldCommandState, VsmAuthorisationResponse,
};

use super::{Aircraft, Effects};
use crate::config::{self, Provisional};
use crate::session::access::{Group, Permitted};
use crate::session::context::{Bounds, Origin, Settings};
use crate::session::effects::DliEffects;
use crate::session::station::GroundStation;
use crate::session::{authority, flight, held, mission, payload, reports, termination};

/// Whether a station is sent messages whose layout is derived from Edition 2.
fn has_provisional(dli: &DliEffects<'_>, station: usize) -> bool {
    let one = dli.stations.get(station);
    one.is_some_and(|one| one.profile.provisional != Provisional::Off)
}

impl Aircraft {
    /// A message for the authority machine: 1, 4 or 34000. The caller acknowledges it with the returned answer.
    pub(crate) fn ask_authority(
        &mut self,
        dli: &mut DliEffects<'_>,
        input: authority::Input<'_>,
    ) -> AckType {
        let answer = self.authority(dli, input);
        self.run_until_idle(dli);
        answer
    }

    /// 17001, 17002 or 40000.
    ///
    /// # Errors
    /// The reason, for the operator; for 17001 and 17002 only. The caller answers.
    pub(crate) fn ask_reports(
        &mut self,
        dli: &mut DliEffects<'_>,
        input: reports::Input<'_>,
    ) -> Result<(), String> {
        if let reports::Input::ReportOnce { station, request } = input
            && request.message_type == Some(HeldCommandState::ID)
        {
            self.held(dli, held::Input::List { station });
            return Ok(());
        }
        if let reports::Input::ReportOnce { station, request } = input
            && request.message_type == Some(Contingency::ID)
        {
            self.flight(dli, flight::Input::ListContingencies { station });
            return Ok(());
        }
        // The authority machine composes messages 2 and 35000: only it knows which rights are held and handed over.
        if let reports::Input::ReportOnce { station, request } = input {
            let input = match request.message_type {
                Some(VsmAuthorisationResponse::ID) => Some(authority::Input::Again {
                    station,
                    request: None,
                }),
                Some(HandoverStatusReport::ID) if has_provisional(dli, station) => {
                    Some(authority::Input::ReportHandover { station })
                }
                _ => None,
            };
            if let Some(input) = input {
                self.authority(dli, input);
                return Ok(());
            }
        }
        let answer = self.reports(dli, input);
        self.run_until_idle(dli);
        answer
    }

    /// The right that a message needs; `None` if the message is not a command of a CUCS. A 50020 needs the right of the
    /// command that it holds.
    pub(crate) fn right_for(&self, message: &Message) -> Option<LoiBitmap> {
        let right = |message: &Message| {
            let mode = flight::mode_of(message, &self.vehicle.telemetry);
            authority::right_for(message, mode)
        };
        let of_inner = held::inner(message).and_then(|inner| right(&inner));
        of_inner.or_else(|| right(message))
    }

    /// Whether the access list allows a message of this group to the station that sends it.
    pub(crate) fn permitted(
        &self,
        dli: &DliEffects<'_>,
        origin: &Origin,
        group: Group,
    ) -> Permitted {
        let station = dli.stations.get(origin.station);
        let flies = self.vehicle.may_fly();
        station.map_or(Permitted::NotListed, |one| {
            one.permitted(self.id(), group, flies, false)
        })
    }

    /// A held command that is due: its right is checked as if it arrived now.
    pub(super) fn carry_out_held(
        &mut self,
        dli: &mut DliEffects<'_>,
        origin: Origin,
        message: &Message,
    ) {
        // It would be fresh neither by its own Time Stamp nor by its station's clock.
        if is_never_held(message) {
            return self.effects(dli).refuse(Some(origin), NEVER_HELD);
        }
        let rights = self.authority.rights();
        let cucs = dli.stations.get(origin.station).map(GroundStation::id);
        let held = |right| cucs.is_some_and(|cucs| rights.holds(cucs, right));
        let contingency = origin.held.is_some_and(|held| held.contingency);
        let nobody_controls = rights.controller().is_none();
        match self.right_for(message) {
            Some(right) if held(right) || (contingency && nobody_controls) => {
                let group = Group::of(message, right);
                let station = dli.stations.get(origin.station);
                let flies = self.vehicle.may_fly();
                let listed = station.map(|one| one.permitted(self.id(), group, flies, true));
                match listed.and_then(Permitted::refusal) {
                    Some((counter, why)) => {
                        dli.counters.count(counter);
                        self.effects(dli).refuse(Some(origin), why);
                    }
                    None => self.hand_on(dli, origin, message),
                }
            }
            _ => {
                let why = "its CUCS no longer holds the right that it needs";
                self.effects(dli).refuse(Some(origin), why);
            }
        }
    }

    /// A command of a CUCS that holds the right for it.
    pub(crate) fn command(&mut self, dli: &mut DliEffects<'_>, origin: Origin, message: &Message) {
        self.hand_on(dli, origin, message);
        self.run_until_idle(dli);
    }

    /// Passes a command to its machine.
    fn hand_on(&mut self, dli: &mut DliEffects<'_>, origin: Origin, message: &Message) {
        let autopilot = self.vehicle.telemetry.autopilot;
        if let Some(why) = autopilot.and_then(airframe::refused_autopilot) {
            return self.effects(dli).refuse(Some(origin), why);
        }
        self.observe(
            dli,
            reports::Input::NoteIgnored {
                origin: &origin,
                message,
            },
        );
        let right = self.right_for(message);
        if let Message::FlightTerminationCommand(command) = message {
            let handover = self.authority.is_handed_over();
            let input = termination::Input::Command {
                origin,
                command,
                handover,
            };
            return self.terminate(dli, input);
        }
        if held::inner(message).is_some_and(|inner| is_never_held(&inner)) {
            return self.effects(dli).refuse(Some(origin), NEVER_HELD);
        }
        // Payload stations can still be commanded: their pictures of the termination are useful.
        let flies = |right: LoiBitmap| right.intersects(LoiBitmap::LOI4 | LoiBitmap::LOI5);
        if self.termination.view(true).holds && right.is_some_and(flies) {
            return self.effects(dli).refuse(Some(origin), TERMINATING);
        }
        // The order is stored and takes effect within seconds, whatever happens: a vehicle that took off now would fly
        // without keys.
        if self.zeroizing && !self.vehicle.may_fly() && right.is_some_and(flies) {
            return self.effects(dli).refuse(Some(origin), ZEROIZING);
        }
        match message {
            Message::VehicleOperatingModeCommand(_)
            | Message::LoiterConfiguration(_)
            | Message::UaStickCommand(_)
            | Message::EngineCommand(_)
            | Message::Contingency(_)
            | Message::UnmannedAircraftLights(_) => {
                self.flight(dli, flight::Input::Command { origin, message });
            }
            Message::PayloadSteeringCommand(_) | Message::EoIrLaserPayloadCommand(_) => {
                self.payload(dli, payload::Input::Command { origin, message });
            }
            Message::ParameterRequest(_)
            | Message::ParameterSetCommand(_)
            | Message::PingRequest(_)
            | Message::DataLinkControlRequest(_)
            | Message::SubsystemStatusRequest(_)
            | Message::SubsystemStatusDetailRequest(_) => {
                self.observe(dli, reports::Input::Command { origin, message });
            }
            Message::HoldCommand(_) | Message::HeldCommandCancel(_) => {
                self.held(dli, held::Input::Command { origin, message });
            }
            _ => self.mission(dli, mission::Input::Command { origin, message }),
        }
    }

    /// Applies a changed configuration. The authority machine is updated separately.
    pub(crate) fn reconfigure(
        &mut self,
        dli: &mut DliEffects<'_>,
        config: &config::Vehicle,
        settings: &Settings,
    ) {
        let areas = config.area != self.config.area;
        let rally = config.rally != self.config.rally;
        self.config.clone_from(config);
        self.settings.clone_from(settings);
        self.bounds = Bounds::of(config);
        self.services.ground.serve(self.bounds.terrain.clone());
        if areas {
            let areas = config.area.iter().map(config::Area::area).collect();
            self.mission.set_areas(areas, dli.now.mono);
            self.run_until_idle(dli);
        }
        if rally {
            let points = config.rally.iter().map(config::Rally::point).collect();
            self.mission.set_rally(points, dli.now.mono);
        }
        self.terminate(dli, termination::Input::Reconfigured);
        self.run_until_idle(dli);
    }

    /// Effects for actions that belong to no machine.
    pub(crate) fn effects<'a>(&'a mut self, dli: &'a mut DliEffects<'_>) -> Effects<'a> {
        Effects {
            dli: dli.reborrow(),
            id: self.config.id,
            alerts: &mut self.alerts,
            listeners: &mut self.listeners,
            vehicle: &mut self.services,
            requests: &mut self.requests,
        }
    }
}

/// Why other commands are refused.
const TERMINATING: &str = "a flight termination is commanded: other commands are refused until it is reset (2005 state 0, reset) where it can be";
const ZEROIZING: &str = "a zeroize is ordered: the vehicle is on the ground, and stays there";
const NEVER_HELD: &str =
    "a flight termination is never held, nor is a zeroize: two orders of the moment command it";

fn is_never_held(message: &Message) -> bool {
    matches!(
        message,
        Message::FlightTerminationCommand(_) | Message::ZeroizeCommand(_)
    )
}
