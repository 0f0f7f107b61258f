//! Positive handover on the wire: messages 4 and 5 between acquirer, holder and VSM, 34000 and 35000.
//!
//! The order of the actors is not documented in public sources: this one is ours, drawn in docs/guide/authority.md. A wish
//! (4 of the acquirer) is passed on to the holder as message 4 that names the acquirer; the holder consents with the
//! same. What a holder offers to its successor is told it by message 5. Every end is told the acquirer by message 5:
//! LOI Authorized is what was handed over, none where nothing was. 35000 tells all who listen.

use stanag_msgs::enums::{AckType, HandoverStatus, LoiBitmap, PresenceVectorSupport};
use stanag_msgs::messages::{
    HandoverStatusReport, PositiveHandoverAuthorisationGranted,
    PositiveHandoverAuthorisationRequest, VehicleDataLinkTransitionCoordination,
};
use stanag_msgs::{Id, Message};

use super::aircraft::Aircraft;
use super::authority::{Decision, Handover, Outcome, Rights, Stage, Stations};
use super::desk::{Desk, Origin};
use crate::config::Provisional;

impl Aircraft {
    /// Message 4.
    pub(super) fn hand_over(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        request: &PositiveHandoverAuthorisationRequest,
    ) -> AckType {
        let Some(by) = desk.asker(origin.station) else {
            return AckType::Refused;
        };
        let acquirer = request
            .requesting_cucs_id
            .filter(|id| *id != Id::NULL)
            .unwrap_or(by.id);
        let stations = Stations::from_bitmaps(
            request.controlled_station_1_16,
            request.controlled_station_17_32,
        );
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        let wanted = Rights::named(levels, stations);
        let answer = self.decide(desk, None, |authority, at| {
            authority.handover(at, &by, acquirer, wanted)
        });
        self.acknowledgement(desk, origin, by.id, &answer)
    }

    /// Message 4 once more, the same bytes: an answer to it may have been lost on either side.
    pub(super) fn hand_over_again(&mut self, desk: &mut Desk<'_>, station: usize) {
        self.answer_authorisation(desk, station, None);
        self.convey_pending(desk, station);
    }

    /// What a station is asked for, or offered, and has not answered: told again, since it may never have heard it.
    pub(super) fn convey_pending(&mut self, desk: &mut Desk<'_>, station: usize) {
        let Some(by) = desk.asker(station) else {
            return;
        };
        let pending: Vec<Handover> = self.authority.pending().to_vec();
        for handover in pending {
            if handover.to == by.id || handover.from == Some(by.id) {
                self.convey(desk, &handover);
            }
        }
    }

    /// 34000: the holder hands control to the acquiring CUCS, or the acquiring CUCS asks for it. The link to the
    /// vehicle stays where it is: a message that would tune it is refused.
    pub(super) fn coordinate_transition(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        message: &VehicleDataLinkTransitionCoordination,
    ) {
        let Some(by) = desk.asker(origin.station) else {
            return;
        };
        let why = if desk.provisional != Provisional::All {
            Some(
                "34000 is derived from Edition 2: it is carried out with dli.provisional = \"all\" only",
            )
        } else if sets_radio(message) {
            Some("34000: this VSM's vehicle link has no frequency and no code to set")
        } else if message.acquiring_cucs_id.is_none_or(|id| id == Id::NULL) {
            Some("34000: Acquiring CUCS ID is missing")
        } else {
            None
        };
        if let Some(why) = why {
            return self.refuse(desk, Some(origin), why.to_owned());
        }
        let acquirer = message.acquiring_cucs_id.unwrap_or(by.id);
        let wanted = Rights::of_control(super::authority::CONTROL);
        let answer = self.decide(desk, None, |authority, at| {
            authority.handover(at, &by, acquirer, wanted)
        });
        let answer = self.acknowledgement(desk, &origin, by.id, &answer);
        desk.acknowledge(self.id(), &origin, answer);
    }

    /// Tells of the handovers that began and ended.
    pub(super) fn begin_and_end(&mut self, desk: &mut Desk<'_>, decision: &Decision) {
        for handover in &decision.begun {
            self.convey(desk, handover);
            let status = HandoverStatus::InProgress;
            self.report_handover(desk, handover.from, Some(handover.to), status);
            let holder = handover
                .from
                .map_or_else(|| "nobody".to_owned(), |id| id.to_string());
            let Handover { to, rights, .. } = handover;
            let text = match handover.stage {
                Stage::Consent(_) => format!("{to} asks {holder} for {rights}"),
                Stage::Acceptance(_) => format!("{holder} offers {rights} to {to}"),
                Stage::Load(_) => format!("{rights} passes to {to} once the load has ended"),
            };
            let both = parties(desk, handover);
            self.tell_stations(desk, &both, text);
        }
        for ended in &decision.ended {
            let handover = &ended.handover;
            let (status, rights) = match ended.outcome {
                Outcome::Completed(rights) => (HandoverStatus::Successful, rights),
                _ => (HandoverStatus::Failed, Rights::NONE),
            };
            if let Some(station) = desk.station_of(handover.to) {
                self.authorise_handover(desk, station, handover.to, rights);
            }
            self.report_handover(desk, handover.from, Some(handover.to), status);
            let text = format!("handover to {}: {}", handover.to, ended.outcome);
            let both = parties(desk, handover);
            self.tell_stations(desk, &both, text);
            // Who asked by a message that waited is answered once nothing of its asking is left.
            for (asker, origin) in self
                .authority_record
                .ended(handover, self.authority.pending())
            {
                let answer = match ended.outcome {
                    Outcome::Completed(_) => AckType::CarriedOut,
                    _ => AckType::Refused,
                };
                self.answer_by_id(desk, asker);
                desk.acknowledge(self.id(), &origin, answer);
            }
        }
    }

    /// Passes a wish on to the holder, an offer on to the successor.
    fn convey(&mut self, desk: &mut Desk<'_>, handover: &Handover) {
        let Handover {
            from, to, rights, ..
        } = *handover;
        match handover.stage {
            Stage::Consent(_) => {
                let Some(holder) = from.and_then(|holder| desk.station_of(holder)) else {
                    return;
                };
                let message = PositiveHandoverAuthorisationRequest {
                    time_stamp: Some(desk.stamp()),
                    vsm_id: Some(desk.vsm),
                    data_link_id: Some(Id::NULL),
                    vehicle_type: Some(self.vehicle_type()),
                    vehicle_subtype: Some(0),
                    requested_handover_loi: Some(rights.levels_by_themselves()),
                    controlled_station_1_16: Some(rights.stations().low()),
                    controlled_station_17_32: Some(rights.stations().high()),
                    requesting_cucs_id: Some(to),
                    presence_vector_support: Some(PresenceVectorSupport::Partial),
                    ..PositiveHandoverAuthorisationRequest::default()
                };
                let message = Message::PositiveHandoverAuthorisationRequest(message);
                desk.send(holder, self.id(), &message);
            }
            Stage::Acceptance(_) => {
                if let Some(successor) = desk.station_of(to) {
                    self.authorise_handover(desk, successor, to, rights);
                }
            }
            Stage::Load(_) => {}
        }
    }

    /// Message 5.
    fn authorise_handover(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        acquirer: Id,
        rights: Rights,
    ) {
        let message = PositiveHandoverAuthorisationGranted {
            time_stamp: Some(desk.stamp()),
            vsm_id: Some(desk.vsm),
            data_link_id: Some(Id::NULL),
            loi_authorized: Some(rights.levels_by_themselves()),
            controlled_station_1_16_authorized: Some(rights.stations().low()),
            controlled_station_17_32_authorized: Some(rights.stations().high()),
            vehicle_type: Some(self.vehicle_type()),
            vehicle_subtype: Some(0),
            requesting_cucs_id: Some(acquirer),
            presence_vector_support: Some(PresenceVectorSupport::Partial),
            ..PositiveHandoverAuthorisationGranted::default()
        };
        let message = Message::PositiveHandoverAuthorisationGranted(message);
        desk.send(station, self.id(), &message);
    }

    /// 35000, to the two and to all who listen. The null id stands for nobody.
    pub(super) fn report_handover(
        &mut self,
        desk: &mut Desk<'_>,
        from: Option<Id>,
        to: Option<Id>,
        status: HandoverStatus,
    ) {
        if desk.provisional == Provisional::Off {
            return;
        }
        let report = HandoverStatusReport {
            time_stamp: Some(desk.stamp()),
            cucs_id_relinquishing_control: Some(from.unwrap_or(Id::NULL)),
            cucs_id_acquiring_control: Some(to.unwrap_or(Id::NULL)),
            status: Some(status),
            air_data_link_id: Some(Id::NULL),
        };
        let mut stations = desk.listeners(&self.authority, None);
        for party in [from, to].into_iter().flatten() {
            stations.extend(
                desk.station_of(party)
                    .filter(|index| !stations.contains(index)),
            );
        }
        let message = Message::HandoverStatusReport(report);
        for station in stations {
            desk.publish(station, self.id(), &message);
        }
    }
}

fn parties(desk: &Desk<'_>, handover: &Handover) -> Vec<usize> {
    let ids = [handover.from, Some(handover.to)];
    ids.into_iter()
        .flatten()
        .filter_map(|id| desk.station_of(id))
        .collect()
}

/// Whether a message would set something on a radio.
fn sets_radio(message: &VehicleDataLinkTransitionCoordination) -> bool {
    let frequencies = [
        message.set_forward_link_carrier_frequency_adt,
        message.set_return_link_carrier_frequency_adt,
    ];
    frequencies.into_iter().flatten().any(|hertz| hertz != 0.0)
        || message.set_pn_code_adt.is_some_and(|code| code != 0)
}
