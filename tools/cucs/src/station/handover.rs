//! Positive handover from the CUCS's side: message 4, sent until what it leads to is known.
//!
//! Whom it names says what it is. Itself: a wish, the acceptance of an offer, or with no level the end of either.
//! Another: consent to its wish, or the naming of a successor; with no level a refusal, or the end of the offer.

use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::messages::PositiveHandoverAuthorisationRequest;
use tokio::time::Instant;

use super::Station;
use crate::outcome::{Outcome, StationError};
use crate::sender::Delivery;

impl Station {
    /// Sends message 4 that names `acquirer` and these levels, and waits for the end of what it began: the same
    /// bytes again and again, since a decision that was lost on its way is only told to who asks.
    ///
    /// # Errors
    /// There is no end to it within [`Timeouts::consent`](crate::Timeouts).
    pub async fn hand_over(
        &mut self,
        vehicle: Id,
        acquirer: Id,
        levels: LoiBitmap,
    ) -> Result<Outcome, StationError> {
        let within = self.timeouts.consent;
        let mark = self.alert_mark(vehicle);
        let vsm_id = self
            .vehicle(vehicle)
            .and_then(|state| state.authorisation.as_ref()?.vsm_id);
        let message = PositiveHandoverAuthorisationRequest {
            vsm_id: Some(vsm_id.unwrap_or(Id::BROADCAST)),
            data_link_id: Some(Id::NULL),
            requested_handover_loi: Some(levels),
            requesting_cucs_id: Some(acquirer),
            ..PositiveHandoverAuthorisationRequest::default()
        };
        let now = self.now();
        let ticket = self.session.send(now, vehicle, message)?;
        let deadline = Instant::now() + within;
        while Instant::now() < deadline {
            let again = (Instant::now() + self.session.retry()).min(deadline);
            let ended = self
                .until(again, |session| match session.delivery(ticket) {
                    end @ (Delivery::CarriedOut | Delivery::Refused) => Some(end),
                    _ => None,
                })
                .await?;
            match ended {
                Some(Delivery::Refused) => {
                    let what = "handover (message 4)".to_owned();
                    let refused = self.refusal(vehicle, what, None, mark).await?;
                    return Ok(Outcome::Refused(refused));
                }
                Some(_) => return Ok(Outcome::CarriedOut),
                None => self.session.ask_again(ticket),
            }
        }
        self.session.withdraw(ticket);
        if !self.heard {
            return Err(self.no_vsm(within));
        }
        let awaited = "end of the handover (17000 type 2 or 3 of 4)".to_owned();
        Err(self.timed_out(awaited, within, vehicle))
    }
}
