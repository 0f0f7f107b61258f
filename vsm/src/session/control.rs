//! Who controls the aircraft: message 1, its answer, and what a decision of the authority leads to.

use stanag_msgs::enums::{
    AccessGranted, AckType, FlightPathControlMode as Mode, LoiBitmap, PresenceVectorSupport,
    RequestedAccess, WaitTransition,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, VehicleOperatingModeCommand, VsmAuthorisationResponse,
};
use stanag_msgs::{Id, Message};

use mapping::mode::Px4Mode;

use super::aircraft::Aircraft;
use super::alerts::{Cause, Raised};
use super::authority::{
    Access, Answer, Asker, Authority, CONTROL, Change, Circumstances, Decision, Reason, Rights,
    Stations,
};
use super::desk::{Desk, Origin};
use super::log::LogLevel;

impl Aircraft {
    /// Message 1 to this vehicle: a request, a release, or a question where it names no access.
    pub(super) fn authorise(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
    ) -> AckType {
        let Some(asker) = desk.asker(origin.station) else {
            return AckType::Refused;
        };
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        // A release is always granted, whatever else the message says.
        let releases = request.requested_handover_access == Some(RequestedAccess::Relinquish);
        if let (false, Err(why)) = (releases, understood(desk, request, levels)) {
            self.answer_authorisation(desk, origin.station, Some(request));
            let text = format!("message 1 refused: {why}");
            self.tell_stations(desk, &[origin.station], text);
            return AckType::Refused;
        }
        let stations = Stations::from_bitmaps(
            request.controlled_station_1_16,
            request.controlled_station_17_32,
        );
        let access = match request.requested_handover_access {
            Some(RequestedAccess::Relinquish) => Access::Release,
            Some(RequestedAccess::Request) if !levels.is_empty() => Access::Control,
            Some(RequestedAccess::Override) if !levels.is_empty() => Access::Override,
            _ => {
                self.answer_authorisation(desk, origin.station, Some(request));
                self.convey_pending(desk, origin.station);
                return AckType::CarriedOut;
            }
        };
        let wanted = Rights::named(levels, stations);
        let waits_for_transition = request
            .wait_for_vehicle_data_link_transition_coordination_message
            == Some(WaitTransition::Wait);
        let answer = self.decide(desk, Some(asker.id), |authority, at| {
            if waits_for_transition && access == Access::Control {
                authority.handover(at, &asker, asker.id, wanted)
            } else {
                authority.request(at, &asker, access, wanted, !stations.is_empty())
            }
        });
        self.answer_authorisation(desk, origin.station, Some(request));
        self.acknowledgement(desk, origin, asker.id, &answer)
    }

    /// Message 1 to everybody, or to the VSM. It is a question for each vehicle, as a discovery is; a release of levels
    /// that it names is one of each vehicle. Rights are given by a vehicle alone.
    pub(super) fn authorise_to_all(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
    ) -> AckType {
        let named = request
            .requested_handover_loi
            .is_some_and(|levels| !levels.is_empty());
        let why = match request.requested_handover_access {
            Some(RequestedAccess::Relinquish) if named => {
                return self.authorise(desk, origin, request);
            }
            // Who discovers asks for no acknowledgement; who wants one, and holds something, meant to release it.
            Some(RequestedAccess::Relinquish)
                if origin.ack_requested && self.holds_anything(desk, origin.station) =>
            {
                "nothing is released: name the levels, or send it to the vehicle"
            }
            Some(RequestedAccess::Request | RequestedAccess::Override) => {
                "rights are asked of a vehicle, not of all"
            }
            Some(RequestedAccess::Unknown(_)) if named => {
                "Requested/Handover Access is none of 0 to 2"
            }
            _ => {
                self.answer_authorisation(desk, origin.station, Some(request));
                self.convey_pending(desk, origin.station);
                return AckType::CarriedOut;
            }
        };
        self.answer_authorisation(desk, origin.station, Some(request));
        let text = format!("message 1 refused: {why}");
        self.tell_stations(desk, &[origin.station], text);
        AckType::Refused
    }

    fn holds_anything(&self, desk: &Desk<'_>, station: usize) -> bool {
        desk.asker(station)
            .is_some_and(|asker| !self.authority.held(asker.id).is_empty())
    }

    /// What 17000 says of an answer. One that waits is acknowledged again when it is decided.
    pub(super) fn acknowledgement(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        asker: Id,
        answer: &Answer,
    ) -> AckType {
        match answer {
            Answer::Granted => AckType::CarriedOut,
            Answer::Waits => {
                self.authority_record.wait(asker, *origin);
                AckType::Received
            }
            Answer::Refused { missing, why } => {
                let what = if *missing == Rights::NONE {
                    "refused".to_owned()
                } else {
                    format!("{missing} refused")
                };
                let text = format!("message {}: {what}: {why}", origin.message_type);
                self.tell_stations(desk, &[origin.station], text);
                AckType::Refused
            }
        }
    }

    /// Asks the authority, and does what follows from its decision. `asker` is answered by who calls.
    pub(super) fn decide(
        &mut self,
        desk: &mut Desk<'_>,
        asker: Option<Id>,
        ask: impl FnOnce(&mut Authority, &Circumstances<'_>) -> Decision,
    ) -> Answer {
        let roster = desk.roster();
        let circumstances = Circumstances {
            now: desk.now.mono,
            roster: &roster,
            loading: self.loading(desk),
            launch_or_landing: self.launch_or_landing(),
        };
        let before = self.authority.clone();
        let decision = ask(&mut self.authority, &circumstances);
        if self.authority.record() != before.record()
            && let Err(fault) = self.keep(desk, &decision)
        {
            // A right that would not survive a restart is not granted.
            self.authority = before;
            let text = format!("authority cannot be stored, nothing changes: {fault}");
            self.warn(desk, Cause::Store, text);
            return Answer::Refused {
                missing: Rights::NONE,
                why: super::authority::Refusal::NotStored,
            };
        }
        let mut told: Vec<Id> = asker.into_iter().collect();
        for change in &decision.changes {
            for id in [change.from, change.to].into_iter().flatten() {
                if !told.contains(&id) {
                    told.push(id);
                    self.answer_by_id(desk, id);
                }
            }
        }
        let lost =
            |change: &Change| change.from == before.controller() && change.why == Reason::Lost;
        let lost = decision.changes.iter().any(lost);
        self.say_change_of_control(desk, &before, lost);
        self.begin_and_end(desk, &decision);
        for index in 0..desk.stations.len() {
            let Some(asker) = desk.asker(index) else {
                continue;
            };
            let listens = self.authority.holds(asker.id, LoiBitmap::LOI2);
            if listens != before.holds(asker.id, LoiBitmap::LOI2) {
                self.forget_schedule(desk, index);
                self.unused_told.forget(index);
                if listens {
                    self.welcome(desk, index);
                }
            }
        }
        decision.answer
    }

    /// Lets a decision that waited be taken: a load has ended, the vehicle flies otherwise, time has passed.
    pub(super) fn settle_authority(&mut self, desk: &mut Desk<'_>) {
        if !self.authority.pending().is_empty() {
            self.decide(desk, None, Authority::look_again);
        }
    }

    /// Who loads a mission just now; the null id where the VSM does by itself.
    fn loading(&self, desk: &Desk<'_>) -> Option<Id> {
        let load = self.load.as_ref()?;
        let station = load.owner().and_then(|index| desk.asker(index));
        Some(station.map_or(Id::NULL, |station| station.id))
    }

    fn launch_or_landing(&self) -> bool {
        let telemetry = &self.mav.telemetry;
        telemetry.armed == Some(true)
            && matches!(telemetry.mode, Some(Px4Mode::TAKEOFF | Px4Mode::LAND))
    }

    /// `lost`: the controller has lost it by silence, which is said apart.
    fn say_change_of_control(&mut self, desk: &mut Desk<'_>, before: &Authority, lost: bool) {
        let (from, to) = (before.controller(), self.authority.controller());
        if from == to {
            return;
        }
        let name = |id: Option<Id>| id.map_or_else(|| "nobody".to_owned(), |id| id.to_string());
        let text = format!("control passes from {} to {}", name(from), name(to));
        desk.note(LogLevel::Info, self.id(), text);
        if to.is_some() || !lost {
            let text = match to {
                Some(to) => format!("{to} controls the vehicle"),
                None => "control was given up, nobody controls the vehicle".to_owned(),
            };
            let raised = self.alerts.clear(Cause::CucsSilent, &text);
            let listeners = desk.listeners(&self.authority, None);
            desk.alert(self.id(), &listeners, raised);
        }
        self.end_commands_without_right(desk);
        self.operator_control.soon();
        self.tend_operator_control(desk);
        self.sticks.forget();
        if to.is_none() && self.steering.engaged() && self.mav.telemetry.airborne() {
            // Steered by nobody it would fly straight on for ever.
            let hold = VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(Mode::Loiter),
                ..VehicleOperatingModeCommand::default()
            };
            self.operate(desk, None, &hold);
        }
    }

    /// Message 2 to a CUCS whose rights have changed.
    pub(super) fn answer_by_id(&mut self, desk: &mut Desk<'_>, id: Id) {
        if let Some(index) = desk.station_of(id) {
            self.answer_authorisation(desk, index, None);
        }
    }

    /// Message 2: what this station may have and now holds.
    pub(super) fn answer_authorisation(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        request: Option<&CucsAuthorisationRequest>,
    ) {
        let Some(asker) = desk.asker(station) else {
            return;
        };
        let granted = self.authority.granted(asker.id);
        let stations = self.authority.held(asker.id).stations();
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
            controlled_station_1_16: Some(stations.low()),
            controlled_station_17_32: Some(stations.high()),
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
            &Message::VsmAuthorisationResponse(response),
        );
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

    /// 16000 with a text that concerns these stations only: the answer to one message, which stands for a while.
    pub(super) fn tell_stations(&mut self, desk: &mut Desk<'_>, to: &[usize], text: String) {
        let raised = self.alerts.answer(desk.now.mono, to, text);
        desk.alert(self.id(), to, Some(raised));
    }
}

/// Whether every value of message 1 is one that is known: of what is not nothing is granted.
fn understood(
    desk: &Desk<'_>,
    request: &CucsAuthorisationRequest,
    levels: LoiBitmap,
) -> Result<(), String> {
    if !desk.is_meant(request.vsm_id) {
        return Err("VSM ID is another VSM's".to_owned());
    }
    if let Some(RequestedAccess::Unknown(access)) = request.requested_handover_access
        && !levels.is_empty()
    {
        return Err(format!(
            "Requested/Handover Access {access}, expected 0 to 2"
        ));
    }
    let unknown = levels.raw() & !LoiBitmap::LOI2.union(LoiBitmap::LOI3).union(CONTROL).raw();
    if unknown != 0 {
        return Err(format!(
            "Requested/Handover LOI {:#04x}: bits {unknown:#04x} are none of LOI 2 to 5",
            levels.raw()
        ));
    }
    Ok(())
}

impl Desk<'_> {
    /// A station as the authority knows it.
    pub(super) fn asker(&self, index: usize) -> Option<Asker> {
        self.stations.get(index).map(|station| station.asker())
    }

    /// Every CUCS of the configuration.
    pub(super) fn roster(&self) -> Vec<Asker> {
        self.stations
            .iter()
            .map(|station| station.asker())
            .collect()
    }

    /// The index of a station.
    pub(super) fn station_of(&self, id: Id) -> Option<usize> {
        self.stations.iter().position(|station| station.id() == id)
    }
}
