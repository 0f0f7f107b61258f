//! Commands to payload stations (19001, 19100), which need LOI 3 of the station.

use stanag_msgs::{Id, Message, table};

use super::endpoint::Station;
use super::outcome::{Outcome, StationError};

impl Station {
    /// Sends a payload command and waits until it is carried out or refused.
    ///
    /// # Errors
    /// There is no final answer within [`Timeouts::command`](crate::Timeouts).
    pub async fn operate_payload(
        &mut self,
        vehicle: Id,
        command: impl Into<Message>,
    ) -> Result<Outcome, StationError> {
        let command = command.into();
        let what = table::named(command.id()).to_string();
        let within = self.timeouts.command;
        self.command(vehicle, command, what, within).await
    }
}
