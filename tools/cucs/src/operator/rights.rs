//! Discovery, rights over the vehicle, and handovers.

use std::io::Write;
use std::time::Duration;

use serde_json::json;
use stanag_msgs::Id;
use stanag_msgs::enums::{LoiBitmap, RequestedAccess, StationBitmap1To16};

use super::console::{Done, Operator};
use super::error::OperatorError;
use super::run::seconds;
use super::verb::{HandoverVerb, LoiList};
use crate::session::machine::Session;
use crate::session::vehicle::Vehicle;
use crate::station::outcome::{StationError, levels, loi_numbers};
use crate::station::report::vehicle_type;

impl<W: Write> Operator<W> {
    pub(super) async fn discover(&mut self) -> Done {
        for found in self.station.discover().await? {
            let vsm = found
                .vsm
                .map_or_else(|| "no VSM".to_owned(), |id| format!("VSM {id}"));
            self.print(
                &format!(
                    "{} behind {vsm}, vehicle type {}, LOI {} authorised, {} granted",
                    found.vehicle,
                    vehicle_type(found.vehicle_type),
                    levels(found.authorised),
                    levels(found.granted)
                ),
                json!({
                    "vehicle": found.vehicle.to_string(),
                    "vsm": found.vsm.map(|id| id.to_string()),
                    "vehicle_type": found.vehicle_type,
                    "authorised": loi_numbers(found.authorised),
                    "granted": loi_numbers(found.granted),
                }),
            )?;
        }
        Ok(())
    }

    /// Requests these levels (message 1), or all that this CUCS may have.
    pub(super) async fn take(
        &mut self,
        loi: Option<LoiList>,
        stations: Option<StationBitmap1To16>,
        override_holder: bool,
    ) -> Done {
        let vehicle = self.find_vehicle().await?;
        let authorised = self
            .state(vehicle)
            .map_or_else(Default::default, Vehicle::authorised);
        let requested = loi.map_or(authorised, |list| list.0);
        let access = if override_holder {
            RequestedAccess::Override
        } else {
            RequestedAccess::Request
        };
        let stations = stations.unwrap_or(StationBitmap1To16::NONE);
        let granted = self
            .station
            .request_stations(vehicle, requested, stations, access)
            .await?;
        self.print(
            &format!("{vehicle}: LOI {} granted", levels(granted)),
            json!({"granted": loi_numbers(granted)}),
        )
    }

    pub(super) async fn release(&mut self) -> Done {
        let vehicle = self.find_vehicle().await?;
        self.station.release(vehicle).await?;
        self.print(&format!("{vehicle}: released"), json!({"granted": []}))
    }

    /// Sends message 4: its meaning depends on the CUCS and the levels in it.
    pub(super) async fn hand_over(&mut self, verb: &HandoverVerb) -> Done {
        let vehicle = self.find_vehicle().await?;
        let own = self.station.session().id();
        let state = self.state(vehicle);
        let held = state.map_or(LoiBitmap::NONE, Vehicle::granted);
        let may = state.map_or(LoiBitmap::NONE, Vehicle::authorised);
        let (acquirer, loi, done) = match verb {
            HandoverVerb::Ask { loi } => {
                let requested = loi.map_or(may, |list| list.0);
                (own, requested, format!("LOI {} is ours", levels(requested)))
            }
            HandoverVerb::Accept { loi, within } => {
                let accepted = match loi {
                    Some(list) => list.0,
                    None => self.offered(vehicle, seconds(*within)?).await?,
                };
                (own, accepted, format!("LOI {} is ours", levels(accepted)))
            }
            HandoverVerb::Decline => (own, LoiBitmap::NONE, "declined".to_owned()),
            HandoverVerb::Consent { cucs, loi, within } => {
                let (to, requested) = self.requested_by(vehicle, *cucs, *within).await?;
                let given = loi.map_or(requested, |list| list.0);
                (to, given, format!("handed over to {to}"))
            }
            HandoverVerb::Refuse { cucs, within } => {
                let (to, _) = self.requested_by(vehicle, *cucs, *within).await?;
                (to, LoiBitmap::NONE, format!("refused to {to}"))
            }
            HandoverVerb::Successor { cucs, loi } => {
                let given = loi.map_or(held, |list| list.0);
                (*cucs, given, format!("{cucs} has accepted"))
            }
        };
        let outcome = self.station.hand_over(vehicle, acquirer, loi).await?;
        self.finish(vehicle, &done, outcome)
    }
    /// The CUCS that requests a handover, and its levels. A new process has not received the request yet, but the
    /// request is repeated; and the answer may be typed before the request. A message 4 without a request would be an
    /// offer.
    async fn requested_by(
        &mut self,
        vehicle: Id,
        named: Option<Id>,
        within_s: f64,
    ) -> Result<(Id, LoiBitmap), OperatorError> {
        let within = seconds(within_s)?;
        let from = named.map_or_else(|| "another CUCS".to_owned(), |id| format!("CUCS {id}"));
        let requests = |state: &Vehicle| {
            let request = state.handover_request();
            request.filter(|(id, _)| named.is_none_or(|named| *id == named))
        };
        let expected = format!("handover request of {from} (4)");
        let waited = self.station.wait_until(&expected, within, |session| {
            session
                .vehicle(vehicle)
                .is_some_and(|state| requests(state).is_some())
        });
        match waited.await {
            Err(StationError::TimedOut { .. }) | Ok(()) => {}
            Err(fault) => return Err(fault.into()),
        }
        let nobody = OperatorError::NobodyAsks {
            vehicle,
            from,
            within_s,
        };
        self.state(vehicle).and_then(requests).ok_or(nobody)
    }

    /// The levels that the holder offers.
    async fn offered(&mut self, vehicle: Id, within: Duration) -> Result<LoiBitmap, OperatorError> {
        let offered = |session: &Session| session.vehicle(vehicle)?.handover_offer();
        let waited = self
            .station
            .wait_until("offer of the holder (5)", within, |session| {
                offered(session).is_some()
            });
        match waited.await {
            Err(StationError::TimedOut { .. }) | Ok(()) => {}
            Err(fault) => return Err(fault.into()),
        }
        let nothing = OperatorError::NothingOffered(vehicle, within.as_secs_f64());
        offered(self.station.session()).ok_or(nothing)
    }
}
