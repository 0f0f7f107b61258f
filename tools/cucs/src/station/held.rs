//! Commands that are held until a condition is met (50020, 50021), and contingencies (50023).

use stanag_msgs::messages::{Contingency, HeldCommandCancel, HoldCommand};
use stanag_msgs::{Id, MAX_DATAGRAM, Message, Text, TimeStamp};
use tokio::time::Instant;

use super::endpoint::{Station, time_waited};
use super::outcome::{Outcome, StationError};
use crate::session::machine::Session;
use crate::session::sender::{Delivery, SendError};

/// A command and its condition.
#[derive(Clone, Debug)]
pub struct Holding {
    /// Its number, and the condition.
    pub hold: HoldCommand,
    /// For a condition that is a time, the seconds until then.
    pub after_s: Option<f64>,
    /// The command.
    pub command: Message,
}

impl Station {
    /// Holds a command; carried out means here that it is held. Its later result is reported by 50022.
    ///
    /// # Errors
    /// There is no answer within [`Timeouts::command`](crate::Timeouts), or the command cannot be written.
    pub async fn hold(&mut self, vehicle: Id, holding: Holding) -> Result<Outcome, StationError> {
        let Holding {
            mut hold,
            after_s,
            command,
        } = holding;
        let mut data = [0; MAX_DATAGRAM];
        let length = command.encode_data(&mut data).map_err(SendError::from)?;
        let bytes = data.get(..length).unwrap_or_default();
        let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        hold.held_message_type = Some(command.id());
        hold.held_message_data = Some(Text::new(&hex));
        let now = self.now();
        hold.condition_time = after_s.map(|seconds| {
            // In milliseconds, rounded up: never before the Time Stamp.
            TimeStamp::from_unix_ms(now.unix_ms + (seconds * 1e3).ceil() as u64 + 1)
        });
        let mark = self.alert_mark(vehicle);
        let ticket = self.session.send(now, vehicle, hold)?;
        let within = self.timeouts.command;
        let answered = |session: &mut Session| {
            let delivery = session.delivery(ticket);
            (delivery == Delivery::Received || delivery.is_final()).then_some(delivery)
        };
        let began = Instant::now();
        self.awaits("answer (17000) to a 50020", within);
        let delivery = self.until(began + within, answered).await?;
        self.awaits_nothing();
        let waited = time_waited(began, within);
        // Its result may be hours away, and 50022 reports it too.
        self.session.withdraw(ticket);
        match delivery {
            Some(Delivery::Received | Delivery::CarriedOut) => Ok(Outcome::CarriedOut),
            Some(Delivery::Refused) => {
                let what = "hold (50020)".to_owned();
                let refused = self.refusal(vehicle, what, None, mark).await?;
                Ok(Outcome::Refused(refused))
            }
            _ => Err(self.timed_out("answer (17000) to a 50020".to_owned(), waited, vehicle)),
        }
    }

    /// Cancels held commands.
    ///
    /// # Errors
    /// There is no answer within [`Timeouts::command`](crate::Timeouts).
    pub async fn cancel_held(
        &mut self,
        vehicle: Id,
        cancel: HeldCommandCancel,
    ) -> Result<Outcome, StationError> {
        let within = self.timeouts.command;
        let what = "cancellation (50021)".to_owned();
        self.command(vehicle, cancel, what, within).await
    }

    /// Sets what the VSM flies for a cause (50023).
    ///
    /// # Errors
    /// There is no answer within [`Timeouts::command`](crate::Timeouts).
    pub async fn set_contingency(
        &mut self,
        vehicle: Id,
        message: Contingency,
    ) -> Result<Outcome, StationError> {
        let within = self.timeouts.command;
        let what = "contingency (50023)".to_owned();
        self.command(vehicle, message, what, within).await
    }
}
