//! The configuration phase in words.

use std::io::Write;
use std::time::Duration;

use serde_json::json;
use stanag_msgs::enums::ConfigRequestType;
use stanag_msgs::messages::FieldConfigurationRequest;

use super::{Done, Operator, Style};
use crate::cucs::configuration::ConfigurationTable;
use crate::cucs::outcome::{Outcome, Refused};
use crate::cucs::sender::Delivery;
use crate::cucs::session::Event;

impl<W: Write> Operator<W> {
    /// Asks what the vehicle is, level by level (40000), and prints the answers as one table.
    pub(super) async fn configuration(&mut self, loi: Option<u8>) -> Done {
        let vehicle = self.meet().await?;
        let mut table = ConfigurationTable::default();
        let mut later = Vec::new();
        for level in loi.map_or(2..=5, |only| only..=only) {
            let request = FieldConfigurationRequest {
                request_type: Some(ConfigRequestType::from_raw(level - 1)),
                ..FieldConfigurationRequest::default()
            };
            let within = self.station.timeouts.command;
            let delivery = self.station.send(vehicle, request, within).await?;
            // The last answers may overtake the acknowledgement.
            self.station.idle(SETTLE).await?;
            while let Some(event) = self.station.session.poll_event() {
                match event {
                    Event::Message { from, message } if from == vehicle => {
                        table.take(&message);
                    }
                    Event::Alert { from, alert } => later.push((from, alert)),
                    _ => {}
                }
            }
            if delivery != Delivery::CarriedOut {
                let refused = Refused {
                    what: format!("configuration for LOI {level} (40000)"),
                    waypoint: None,
                    reasons: later.into_iter().map(|(_, alert)| alert.text).collect(),
                    held: self
                        .state(vehicle)
                        .map(|state| state.granted())
                        .unwrap_or_default(),
                };
                return Ok(Outcome::Refused(refused).accepted()?);
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
        for (from, alert) in later {
            self.tell(
                &format!("{from}: 16000: {}", alert.text),
                json!({"alert": alert.text, "vehicle": from.to_string()}),
            )?;
        }
        Ok(self.out.flush()?)
    }
}

const SETTLE: Duration = Duration::from_millis(100);
