//! Discovery, rights over the vehicle, and handovers.

use std::io::Write;

use serde_json::json;
use stanag_msgs::Id;
use stanag_msgs::enums::{LoiBitmap, RequestedAccess, StationBitmap1To16};

use super::console::{Done, Operator};
use super::error::OperatorError;
use super::verb::{HandoverVerb, LoiList};
use crate::session::vehicle::Vehicle;
use crate::station::outcome::{levels, loi_numbers};
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

    /// Message 1: requests these levels, or all that this CUCS may have.
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

    /// Message 4: which CUCS and which levels it names decides what it means.
    pub(super) async fn hand_over(&mut self, verb: &HandoverVerb) -> Done {
        let vehicle = self.find_vehicle().await?;
        let own = self.station.session().id();
        let state = self.state(vehicle);
        let held = state.map_or(LoiBitmap::NONE, Vehicle::granted);
        let may = state.map_or(LoiBitmap::NONE, Vehicle::authorised);
        let request = state.and_then(Vehicle::handover_request);
        let offered = state.and_then(Vehicle::handover_offer);
        let named = |cucs: &Option<Id>| {
            cucs.or(request.map(|(id, _)| id))
                .ok_or(OperatorError::NobodyAsks(vehicle))
        };
        let (acquirer, loi, done) = match verb {
            HandoverVerb::Ask { loi } => {
                let requested = loi.map_or(may, |list| list.0);
                (own, requested, format!("LOI {} is ours", levels(requested)))
            }
            HandoverVerb::Accept { loi } => {
                let accepted = loi.map(|list| list.0).or(offered);
                let requested = accepted.ok_or(OperatorError::NothingOffered(vehicle))?;
                (own, requested, format!("LOI {} is ours", levels(requested)))
            }
            HandoverVerb::Decline => (own, LoiBitmap::NONE, "declined".to_owned()),
            HandoverVerb::Consent { cucs, loi } => {
                let to = named(cucs)?;
                let requested = request.filter(|(id, _)| *id == to).map(|(_, loi)| loi);
                let given = loi.map(|list| list.0).or(requested).unwrap_or(held);
                (to, given, format!("handed over to {to}"))
            }
            HandoverVerb::Refuse { cucs } => {
                let to = named(cucs)?;
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
}
