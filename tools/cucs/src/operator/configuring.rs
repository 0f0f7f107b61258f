//! The configuration phase in words.

use std::io::Write;
use std::time::Duration;

use serde_json::json;
use stanag_msgs::enums::ConfigRequestType;
use stanag_msgs::messages::FieldConfigurationRequest;
use stanag_msgs::{Id, Message};

use super::{Done, Operator, OperatorError, Style};
use crate::configuration::ConfigurationTable;
use crate::outcome::Refused;
use crate::sender::Delivery;
use crate::session::Event;

impl<W: Write> Operator<W> {
    /// Asks what the vehicle is, level by level (40000), and prints the answers as one table.
    pub(super) async fn configuration(&mut self, loi: Option<u8>) -> Done {
        let vehicle = self.meet().await?;
        let mut table = ConfigurationTable::default();
        for level in loi.map_or(2..=5, |only| only..=only) {
            let request = FieldConfigurationRequest {
                request_type: Some(ConfigRequestType::from_raw(level - 1)),
                ..FieldConfigurationRequest::default()
            };
            let what = format!("configuration for LOI {level} (40000)");
            for message in self.ask(vehicle, request, &what).await? {
                table.take(&message);
            }
        }
        match self.style {
            Style::People => {
                for line in table.lines() {
                    writeln!(self.out, "{line}")?;
                }
            }
            Style::Json => {
                for object in table.objects() {
                    writeln!(self.out, "{object}")?;
                }
            }
        }
        Ok(self.out.flush()?)
    }

    /// Sends a message, waits until it is carried out, and gives what came of the vehicle meanwhile. Alerts are told
    /// when it is over.
    ///
    /// # Errors
    /// It is refused, or there is no answer.
    pub(super) async fn ask(
        &mut self,
        vehicle: Id,
        request: impl Into<Message>,
        what: &str,
    ) -> Result<Vec<Message>, OperatorError> {
        let within = self.station.timeouts.command;
        let delivery = self.station.send(vehicle, request, within).await?;
        // The last answers, and the reason of a refusal, may overtake the acknowledgement.
        self.station.idle(SETTLE).await?;
        let mut answers = Vec::new();
        let mut alerts = Vec::new();
        while let Some(event) = self.station.session.poll_event() {
            match event {
                Event::Message { from, message } if from == vehicle => answers.push(*message),
                Event::Alert { from, alert } => alerts.push((from, alert)),
                _ => {}
            }
        }
        if delivery != Delivery::CarriedOut {
            let refused = Refused {
                what: what.to_owned(),
                waypoint: None,
                reasons: alerts.into_iter().map(|(_, alert)| alert.text).collect(),
                held: self
                    .state(vehicle)
                    .map(|state| state.granted())
                    .unwrap_or_default(),
            };
            return Err(refused.into());
        }
        for (from, alert) in alerts {
            self.tell(
                &format!("{from}: 16000: {}", alert.text),
                json!({"alert": alert.text, "vehicle": from.to_string()}),
            )?;
        }
        Ok(answers)
    }
}

pub(super) const SETTLE: Duration = Duration::from_millis(100);
