//! What an operator says and hears of handovers.

use std::io::Write;

use serde_json::json;
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::{Done, Operator, OperatorError};
use crate::outcome::levels;
use crate::report::loi_numbers;
use crate::vehicle::Vehicle;
use crate::verb::HandoverVerb;

impl<W: Write> Operator<W> {
    pub(super) async fn hand_over(&mut self, verb: &HandoverVerb) -> Done {
        let vehicle = self.meet().await?;
        let own = self.station.session().id();
        let state = self.state(vehicle);
        let held = state.map_or(LoiBitmap::NONE, Vehicle::granted);
        let may = state.map_or(LoiBitmap::NONE, Vehicle::authorised);
        let asked = state.and_then(Vehicle::wish);
        let offered = state.and_then(Vehicle::offer);
        let named = |cucs: &Option<Id>| {
            cucs.or(asked.map(|(id, _)| id))
                .ok_or(OperatorError::NobodyAsks(vehicle))
        };
        let (acquirer, loi, done) = match verb {
            HandoverVerb::Ask { loi } => {
                let wanted = loi.map_or(may, |list| list.0);
                (own, wanted, format!("LOI {} is ours", levels(wanted)))
            }
            HandoverVerb::Accept { loi } => {
                let wanted = loi.map(|list| list.0).or(offered);
                let wanted = wanted.ok_or(OperatorError::NothingOffered(vehicle))?;
                (own, wanted, format!("LOI {} is ours", levels(wanted)))
            }
            HandoverVerb::Decline => (own, LoiBitmap::NONE, "declined".to_owned()),
            HandoverVerb::Consent { cucs, loi } => {
                let to = named(cucs)?;
                let wished = asked.filter(|(id, _)| *id == to).map(|(_, loi)| loi);
                let given = loi.map(|list| list.0).or(wished).unwrap_or(held);
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

    /// Another CUCS asks for what this one holds.
    pub(super) fn tell_wish(&mut self, vehicle: Id, by: Id, loi: LoiBitmap) -> Done {
        self.tell(
            &format!(
                "{vehicle}: {by} asks for LOI {}: `consent` or `refuse`",
                levels(loi)
            ),
            json!({
                "vehicle": vehicle.to_string(),
                "asked_by": by.to_string(),
                "loi": loi_numbers(loi.raw()),
            }),
        )
    }

    /// The holder has named this CUCS its successor.
    pub(super) fn tell_offer(&mut self, vehicle: Id, loi: LoiBitmap) -> Done {
        self.tell(
            &format!(
                "{vehicle}: LOI {} is offered: `accept` or `decline`",
                levels(loi)
            ),
            json!({"vehicle": vehicle.to_string(), "offered": loi_numbers(loi.raw())}),
        )
    }
}
