//! What an operator tells: lines for people, JSON objects for programs.

use std::io::Write;

use serde_json::{Value, json};
use stanag_msgs::Id;
use stanag_msgs::enums::AlertPriority;

use super::{Done, Operator, Style};
use crate::report;
use crate::session::Event;
use crate::traffic::ByType;

impl<W: Write> Operator<W> {
    pub(super) fn traffic(&mut self) -> Done {
        let traffic = self.station.session().traffic().clone();
        let by_type = |counts: &ByType| -> Vec<String> {
            counts
                .iter()
                .map(|(kind, count)| format!("{kind}: {count}"))
                .collect()
        };
        let object = |counts: &ByType| -> Value {
            counts
                .iter()
                .map(|(kind, count)| (kind.to_string(), json!(count)))
                .collect::<serde_json::Map<_, _>>()
                .into()
        };
        let dropped: Vec<String> = traffic
            .dropped
            .iter()
            .map(|(reason, count)| format!("{reason}: {count}"))
            .collect();
        self.tell(
            &format!(
                "sent {} ({} again); received {}; dropped {}",
                by_type(&traffic.sent).join(", "),
                traffic.retransmitted,
                by_type(&traffic.received).join(", "),
                if dropped.is_empty() {
                    "none".to_owned()
                } else {
                    dropped.join(", ")
                }
            ),
            json!({
                "sent": object(&traffic.sent),
                "retransmitted": traffic.retransmitted,
                "received": object(&traffic.received),
                "dropped": traffic.dropped,
            }),
        )
    }

    pub(super) fn tell_state(&mut self, vehicle: Id) -> Done {
        let Some(state) = self.station.vehicle(vehicle) else {
            return Ok(());
        };
        let (line, value) = (report::line(state), report::state(state));
        self.tell(&line, value)
    }

    /// Alerts, and what others wish for or offer.
    pub(super) fn tell_alerts(&mut self, told: &str) -> Done {
        while let Some(event) = self.station.session.poll_event() {
            let (from, alert) = match event {
                Event::Alert { from, alert } => (from, alert),
                Event::Asked { vehicle, by, loi } => {
                    self.tell_wish(vehicle, by, loi)?;
                    continue;
                }
                Event::Offered { vehicle, loi } => {
                    self.tell_offer(vehicle, loi)?;
                    continue;
                }
                Event::Message { .. } | Event::Answered { .. } => continue,
            };
            if self.style == Style::People && told.contains(&alert.text) {
                continue;
            }
            self.tell(
                &format!("{from}: 16000 {}: {}", priority(alert.priority), alert.text),
                json!({
                    "alert": alert.text,
                    "vehicle": from.to_string(),
                    "priority": alert.priority.raw(),
                    "id": alert.id,
                    "first": alert.first,
                }),
            )?;
        }
        Ok(())
    }

    pub(super) fn tell(&mut self, line: &str, value: Value) -> Done {
        match self.style {
            Style::People => writeln!(self.out, "{line}")?,
            Style::Json => writeln!(self.out, "{value}")?,
        }
        Ok(self.out.flush()?)
    }
}

/// One word for a priority.
fn priority(priority: AlertPriority) -> String {
    match priority {
        AlertPriority::Cleared => "cleared".to_owned(),
        other => other.to_string(),
    }
}
