//! Discovery, rights over a vehicle (messages 1 and 2) and positive handover (message 4).
//!
//! The meaning of a message 4 depends on the CUCS in it. This CUCS: a request, the acceptance of an offer, or,
//! without a level, the end of either. Another CUCS: consent to its request, or its naming as successor; without a
//! level a refusal, or the end of the offer.

use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::{LoiBitmap, RequestedAccess, StationBitmap1To16};
use stanag_msgs::messages::{CucsAuthorisationRequest, PositiveHandoverAuthorisationRequest};
use tokio::time::Instant;

use super::endpoint::Station;
use super::outcome::{Outcome, StationError};
use crate::session::machine::Session;
use crate::session::sender::Delivery;
use crate::session::vehicle::Vehicle;

/// A vehicle that a VSM offers: message 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Discovered {
    /// The vehicle.
    pub vehicle: Id,
    /// The VSM behind which it is.
    pub vsm: Option<Id>,
    /// The levels that this CUCS may have.
    pub authorised: LoiBitmap,
    /// The levels that it holds already.
    pub granted: LoiBitmap,
    /// Vehicle Type, 0 where it is not known.
    pub vehicle_type: u16,
}

impl Station {
    /// Discovers vehicles: broadcasts message 1 until the VSMs have answered with a message 2 for each vehicle.
    ///
    /// # Errors
    /// No VSM answers.
    pub async fn discover(&mut self) -> Result<Vec<Discovered>, StationError> {
        let within = self.timeouts.answer;
        let quiet = self.timeouts.quiet;
        let deadline = Instant::now() + within;
        self.awaits("answer of a VSM (message 2)", within);
        // What was known before is not an answer: a vehicle may be gone by now.
        let before: Vec<(Id, u64)> = self
            .session
            .vehicles()
            .map(|vehicle| (vehicle.id, vehicle.authorisations))
            .collect();
        let answered = |session: &Session| -> Vec<Discovered> {
            let known = |id| before.iter().find(|(known, _)| *known == id);
            session
                .vehicles()
                .filter(|vehicle| {
                    vehicle.authorisations > known(vehicle.id).map_or(0, |(_, count)| *count)
                })
                .map(discovered)
                .collect()
        };
        while Instant::now() < deadline {
            let question = CucsAuthorisationRequest {
                vsm_id: Some(Id::BROADCAST),
                data_link_id: Some(Id::NULL),
                requested_handover_loi: Some(LoiBitmap::NONE),
                requested_handover_access: Some(RequestedAccess::Relinquish),
                presence_vector_support: self.session.presence_vector_support(),
                ..CucsAuthorisationRequest::default()
            };
            let now = self.now();
            self.session
                .send_unconfirmed(now, Id::BROADCAST, question)?;
            let again = (Instant::now() + REPEAT_INTERVAL).min(deadline);
            let first = self
                .until(again, |session| {
                    (!answered(session).is_empty()).then_some(())
                })
                .await?;
            if first.is_none() {
                continue;
            }
            self.awaits_nothing();
            // Each VSM answers once for each of its vehicles: wait until none has answered for a moment.
            let mut found = answered(&self.session).len();
            while self
                .until(Instant::now() + quiet, |session| {
                    (answered(session).len() > found).then_some(())
                })
                .await?
                .is_some()
            {
                found = answered(&self.session).len();
            }
            return Ok(answered(&self.session));
        }
        Err(self.no_vsm(within))
    }

    /// Requests rights over a vehicle and returns everything that this CUCS then holds, at least the requested
    /// levels. `access` is [`RequestedAccess::Request`], or `Override` to take them from another CUCS.
    ///
    /// # Errors
    /// Not all of it is granted, or no VSM answers.
    pub async fn request(
        &mut self,
        vehicle: Id,
        loi: LoiBitmap,
        access: RequestedAccess,
    ) -> Result<LoiBitmap, StationError> {
        self.request_stations(vehicle, loi, StationBitmap1To16::NONE, access)
            .await
    }

    /// The same for the payload stations of LOI 3; none means all that there are.
    ///
    /// # Errors
    /// As [`Station::request`].
    pub async fn request_stations(
        &mut self,
        vehicle: Id,
        loi: LoiBitmap,
        stations: StationBitmap1To16,
        access: RequestedAccess,
    ) -> Result<LoiBitmap, StationError> {
        let mark = self.alert_mark(vehicle);
        self.authorise(vehicle, loi, stations, access).await?;
        let held = self
            .vehicle(vehicle)
            .map_or(LoiBitmap::NONE, Vehicle::granted);
        if held.contains(loi) {
            return Ok(held);
        }
        let what = "request (message 1)".to_owned();
        let refused = self.refusal(vehicle, what, None, mark).await?;
        let state = self.session.vehicle(vehicle);
        Err(StationError::NotGranted {
            vehicle,
            requested: loi,
            granted: refused.held,
            authorised: state.map_or(LoiBitmap::NONE, Vehicle::authorised),
            reasons: refused.reasons,
        })
    }

    /// Releases all rights over a vehicle.
    ///
    /// # Errors
    /// The VSM keeps them, as where it cannot store the release; or no VSM answers.
    pub async fn release(&mut self, vehicle: Id) -> Result<(), StationError> {
        let mark = self.alert_mark(vehicle);
        let stations = StationBitmap1To16::NONE;
        self.authorise(
            vehicle,
            LoiBitmap::NONE,
            stations,
            RequestedAccess::Relinquish,
        )
        .await?;
        let held = self
            .vehicle(vehicle)
            .map_or(LoiBitmap::NONE, Vehicle::granted);
        if held == LoiBitmap::NONE {
            return Ok(());
        }
        let what = "release (message 1)".to_owned();
        let refused = self.refusal(vehicle, what, None, mark).await?;
        Err(StationError::NotReleased {
            vehicle,
            held: refused.held,
            reasons: refused.reasons,
        })
    }

    /// Sends message 1 to a vehicle until it has answered with message 2. Once it is acknowledged as received (17000 type 1) the
    /// outcome follows: the decision waits for the VSM's disk, or for the load of another CUCS. It is waited for as that of a
    /// command, and no second request is sent.
    async fn authorise(
        &mut self,
        vehicle: Id,
        loi: LoiBitmap,
        stations: StationBitmap1To16,
        access: RequestedAccess,
    ) -> Result<(), StationError> {
        let (mut within, began) = (self.timeouts.answer, Instant::now());
        let mut expected = format!("answer of vehicle {vehicle} (message 2)");
        self.awaits(&*expected, within);
        let count = |session: &Session| {
            session
                .vehicle(vehicle)
                .map_or(0, |vehicle| vehicle.authorisations)
        };
        // What the message requests is granted already, whatever its 17000 says.
        let granted = |session: &Session| {
            let Some(response) = session
                .vehicle(vehicle)
                .and_then(|state| state.authorisation.as_ref())
            else {
                return false;
            };
            let held = response.loi_granted.unwrap_or(LoiBitmap::NONE);
            let of = response.controlled_station_1_16;
            match access {
                RequestedAccess::Relinquish => held == LoiBitmap::NONE,
                _ => {
                    held.contains(loi) && of.unwrap_or(StationBitmap1To16::NONE).contains(stations)
                }
            }
        };
        while Instant::now() < began + within {
            let before = count(&self.session);
            let request = CucsAuthorisationRequest {
                vsm_id: Some(self.vsm_of(vehicle)),
                data_link_id: Some(Id::NULL),
                requested_handover_loi: Some(loi),
                requested_handover_access: Some(access),
                controlled_station_1_16: Some(stations),
                presence_vector_support: self.session.presence_vector_support(),
                ..CucsAuthorisationRequest::default()
            };
            let now = self.now();
            let ticket = self.session.send(now, vehicle, request)?;
            // An earlier message 2 may still be on its way: the answer is the one that arrives with the 17000, or
            // just before it.
            let answered = |session: &mut Session| {
                let ends = match session.delivery(ticket) {
                    Delivery::Queued | Delivery::Sent(_) => false,
                    Delivery::Received => granted(session),
                    _ => true,
                };
                (ends && count(session) > before).then_some(())
            };
            let again = (Instant::now() + REPEAT_INTERVAL * 2).min(began + within);
            let mut answer = self.until(again, answered).await?;
            if answer.is_none() && self.session.delivery(ticket) == Delivery::Received {
                within = within.max(self.timeouts.command);
                expected = format!(
                    "decision (17000 type 2, carried out, or 3, refused) on the received message 1 to vehicle {vehicle}"
                );
                let left = (began + within).saturating_duration_since(Instant::now());
                self.awaits(&*expected, left);
                let outcome = |session: &mut Session| {
                    let ends = session.delivery(ticket) != Delivery::Received;
                    (ends || answered(session).is_some()).then_some(())
                };
                self.until(began + within, outcome).await?;
                // The message 2 of the decision comes with its 17000.
                let again = (Instant::now() + REPEAT_INTERVAL * 2).min(began + within);
                answer = self.until(again, answered).await?;
            }
            let refused = self.session.delivery(ticket) == Delivery::Refused;
            self.session.withdraw(ticket);
            // A VSM that sends no 17000 for message 1 has answered by message 2 alone; one that refuses may send no message 2.
            if answer.is_some() || refused || count(&self.session) > before {
                self.awaits_nothing();
                return Ok(());
            }
        }
        if !self.answered {
            return Err(self.no_vsm(within));
        }
        Err(self.timed_out(expected, within, vehicle))
    }

    /// Sends message 4 with `acquirer` and these levels, and waits for the end of the handover. The same bytes are
    /// repeated, because a VSM repeats a lost decision only when it receives the request again.
    ///
    /// # Errors
    /// It does not end within [`Timeouts::consent`](crate::Timeouts).
    pub async fn hand_over(
        &mut self,
        vehicle: Id,
        acquirer: Id,
        levels: LoiBitmap,
    ) -> Result<Outcome, StationError> {
        let within = self.timeouts.consent;
        let message = PositiveHandoverAuthorisationRequest {
            vsm_id: Some(self.vsm_of(vehicle)),
            data_link_id: Some(Id::NULL),
            requested_handover_loi: Some(levels),
            requesting_cucs_id: Some(acquirer),
            presence_vector_support: self.session.presence_vector_support(),
            ..PositiveHandoverAuthorisationRequest::default()
        };
        let what = "handover (message 4)".to_owned();
        self.command(vehicle, message, what, within).await
    }

    /// The VSM of a vehicle; the broadcast id where it is not known.
    fn vsm_of(&self, vehicle: Id) -> Id {
        let authorisation = self
            .vehicle(vehicle)
            .and_then(|state| state.authorisation.as_ref());
        authorisation
            .and_then(|response| response.vsm_id)
            .unwrap_or(Id::BROADCAST)
    }
}

fn discovered(vehicle: &Vehicle) -> Discovered {
    let response = vehicle.authorisation.as_ref();
    Discovered {
        vehicle: vehicle.id,
        vsm: response.and_then(|response| response.vsm_id),
        authorised: vehicle.authorised(),
        granted: vehicle.granted(),
        vehicle_type: response
            .and_then(|response| response.vehicle_type)
            .unwrap_or(0),
    }
}

/// A request without acknowledgement is repeated after this time.
const REPEAT_INTERVAL: Duration = Duration::from_millis(500);
