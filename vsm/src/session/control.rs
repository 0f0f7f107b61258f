//! Who controls the aircraft: message 1, its answers, and what the silence of the controller leads to.

use mapping::mode::Px4Mode;
use stanag_msgs::enums::{
    AccessGranted, AckType, AlertPriority, FlightPathControlMode as Mode, LoiBitmap,
    PresenceVectorSupport, RequestedAccess, SubsystemId,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, VehicleOperatingModeCommand, VsmAuthorisationResponse,
};
use stanag_msgs::{Id, Message};

use super::aircraft::Aircraft;
use super::alerts::{Cause, Raised};
use super::authority::{Authority, CONTROL, Request};
use super::bridge::LogLevel;
use super::desk::{Desk, Origin};
use super::maneuver::{self, Maneuver};
use super::station::Silence;
use crate::config::OnLoss;

impl Aircraft {
    /// Message 1 to this vehicle: a request, a release, or a question where it names no access.
    pub(super) fn authorise(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
    ) -> AckType {
        let Some(asker) = desk
            .stations
            .get(origin.station)
            .map(|station| station.asker())
        else {
            return AckType::Refused;
        };
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        let wish = match request.requested_handover_access {
            Some(RequestedAccess::Relinquish) => Some(Request::Release(levels)),
            Some(RequestedAccess::Request) if !levels.is_empty() => Some(Request::Control(levels)),
            Some(RequestedAccess::Override) if !levels.is_empty() => {
                Some(Request::Override(levels))
            }
            _ => None,
        };
        let Some(wish) = wish else {
            self.answer_authorisation(desk, origin.station, Some(request));
            return AckType::CarriedOut;
        };
        let before = self.authority.clone();
        let offered = self.silence >= Silence::Offered;
        let mut outcome = self.authority.request(asker, wish, offered);
        if self.authority != before
            && let Err(fault) = self.store_authority(desk)
        {
            // A right that would not survive a restart is not granted.
            self.authority = before.clone();
            outcome.in_full = false;
            outcome.deposed.clear();
            let text = format!("authority cannot be stored, nothing changes: {fault}");
            self.warn(desk, Cause::Store, text);
        }
        for deposed in &outcome.deposed {
            let index = desk
                .stations
                .iter()
                .position(|station| station.id() == *deposed);
            if let Some(index) = index {
                self.answer_authorisation(desk, index, None);
            }
        }
        if self.authority != before {
            self.say_change_of_control(desk, &before);
        }
        self.answer_authorisation(desk, origin.station, Some(request));
        let now_listens = self.authority.holds(asker.id, LoiBitmap::LOI2);
        if now_listens != (!before.granted(asker.id).is_empty()) {
            self.push.reset(origin.station);
            if now_listens {
                self.welcome(desk, origin.station);
            }
        }
        if outcome.in_full {
            AckType::CarriedOut
        } else {
            AckType::Refused
        }
    }

    pub(super) fn say_change_of_control(&mut self, desk: &mut Desk<'_>, before: &Authority) {
        let (from, to) = (before.controller(), self.authority.controller());
        if from != to {
            let name = |id: Option<Id>| id.map_or_else(|| "nobody".to_owned(), |id| id.to_string());
            let text = format!("control passes from {} to {}", name(from), name(to));
            desk.note(LogLevel::Info, self.id(), text);
            self.silence = Silence::None;
            if let Some(raised) = self
                .alerts
                .clear(Cause::CucsSilent, "control has passed on")
            {
                let listeners = desk.listeners(&self.authority, None);
                desk.alert(self.id(), &listeners, Some(raised));
            }
        }
    }

    /// Message 2: what this station may have and now holds.
    pub(super) fn answer_authorisation(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        request: Option<&CucsAuthorisationRequest>,
    ) {
        let Some(asker) = desk.stations.get(station).map(|station| station.asker()) else {
            return;
        };
        let granted = self.authority.granted(asker.id);
        let in_control = granted.intersects(LoiBitmap::LOI3.union(CONTROL));
        let response = VsmAuthorisationResponse {
            time_stamp: Some(desk.stamp()),
            vsm_id: Some(desk.vsm),
            data_link_id: Some(Id::NULL),
            access_authorized: Some(u8::from(!asker.authorised.is_empty())),
            access_granted: Some(if in_control {
                AccessGranted::InControl
            } else {
                AccessGranted::NotInControl
            }),
            loi_authorized: Some(asker.authorised),
            loi_granted: Some(granted),
            controlled_station_1_16: request.and_then(|request| request.controlled_station_1_16),
            access_requested: request
                .and_then(|request| request.requested_handover_access)
                .map(RequestedAccess::raw),
            vehicle_type: Some(self.vehicle_type()),
            vehicle_subtype: Some(0),
            cucs_type: request.and_then(|request| request.cucs_type),
            cucs_subtype: request.and_then(|request| request.cucs_subtype),
            presence_vector_support: Some(PresenceVectorSupport::Partial),
            ..VsmAuthorisationResponse::default()
        };
        desk.send(
            station,
            self.id(),
            &Message::VsmAuthorisationResponse(response.clone()),
        );
        desk.send_to_group(self.id(), &Message::VsmAuthorisationResponse(response));
    }

    /// What a station is told first: message 3, and the alerts that stand.
    pub(super) fn welcome(&mut self, desk: &mut Desk<'_>, station: usize) {
        let message = Message::VehicleId(self.vehicle_id(desk));
        desk.send(station, self.id(), &message);
        for alert in self.alerts.standing().cloned().collect::<Vec<_>>() {
            let raised = Raised { alert, first: true };
            desk.alert(self.id(), &[station], Some(raised));
        }
    }
    pub(super) fn watch_controller(&mut self, desk: &mut Desk<'_>) {
        let controller = self.authority.controller();
        let station = desk
            .stations
            .iter()
            .find(|station| Some(station.id()) == controller);
        let silence = station.map_or(Silence::None, |station| {
            station.silence(desk.now.mono, &desk.loss)
        });
        if silence == self.silence {
            return;
        }
        self.silence = silence;
        let name = controller.map_or_else(String::new, |id| id.to_string());
        let listeners = desk.listeners(&self.authority, None);
        let raised = match silence {
            Silence::None => self
                .alerts
                .clear(Cause::CucsSilent, "the controlling CUCS is heard again"),
            Silence::Warned => {
                let text = format!("the controlling CUCS {name} is silent");
                self.alerts.raise(
                    Cause::CucsSilent,
                    AlertPriority::Caution,
                    SubsystemId::Comms,
                    text,
                )
            }
            Silence::Offered => {
                let text =
                    format!("the controlling CUCS {name} is silent: another may take control");
                self.alerts.raise(
                    Cause::CucsSilent,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    text,
                )
            }
            Silence::Lost => {
                let text = format!(
                    "the controlling CUCS {name} is lost: {}",
                    loss_text(desk.loss.on_loss)
                );
                self.alerts.raise(
                    Cause::CucsSilent,
                    AlertPriority::Emergency,
                    SubsystemId::Comms,
                    text,
                )
            }
        };
        desk.alert(self.id(), &listeners, raised);
        if silence == Silence::Lost {
            self.lose_controller(desk, controller);
        }
    }

    pub(super) fn lose_controller(&mut self, desk: &mut Desk<'_>, controller: Option<Id>) {
        if let Some(id) = controller {
            self.authority.release(id, CONTROL);
            if let Err(fault) = self.store_authority(desk) {
                self.warn(
                    desk,
                    Cause::Store,
                    format!("authority cannot be stored: {fault}"),
                );
            }
        }
        let mode = match desk.loss.on_loss {
            OnLoss::Continue => return,
            OnLoss::Hold => Mode::Loiter,
            OnLoss::Contingency => Mode::ContingencyA,
            OnLoss::Rtl => {
                let steps = maneuver::enter(&[Px4Mode::RTL]);
                return self.begin(desk, None, Maneuver::new(steps, self.commanded));
            }
        };
        if self.mav.telemetry.airborne() {
            let command = VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(mode),
                ..VehicleOperatingModeCommand::default()
            };
            self.operate(desk, None, &command);
        }
    }
}

fn loss_text(on_loss: OnLoss) -> &'static str {
    match on_loss {
        OnLoss::Continue => "the vehicle goes on",
        OnLoss::Hold => "the vehicle holds",
        OnLoss::Contingency => "contingency A is flown",
        OnLoss::Rtl => "the vehicle returns",
    }
}
