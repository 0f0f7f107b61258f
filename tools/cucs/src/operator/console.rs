//! The operator's console: a station, the vehicle that it commands, and the output for results.
//!
//! What every subcommand needs: choosing the vehicle, a request with its answers, lines for people or JSON for programs.

use std::io::Write;
use std::time::Duration;

use serde_json::{Value, json};
use stanag_msgs::enums::AlertPriority;
use stanag_msgs::{Id, Message, table};

use super::error::OperatorError;
use crate::session::machine::Event;
use crate::session::sender::Delivery;
use crate::session::traffic::ByType;
use crate::session::vehicle::Vehicle;
use crate::station::endpoint::Station;
use crate::station::outcome::{Outcome, Refused, levels, loi_numbers};
use crate::station::report;

/// The form of the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Sentences, for people.
    #[default]
    People,
    /// One JSON object for each line, for programs.
    Json,
}

/// An operator at a station: carries out subcommands ([`Verb`](crate::Verb)) and prints their results.
#[derive(Debug)]
pub struct Operator<W> {
    pub(super) station: Station,
    pub(super) style: Style,
    pub(super) out: W,
    requested: Option<Id>,
    /// The commanded vehicle, once discovery has found it.
    vehicle: Option<Id>,
    /// Whether alerts are the subject of the subcommand, or are watched: then none is shortened.
    pub(super) alerts_in_full: bool,
    /// Whether the output is a file's contents: then alerts go to standard error.
    pub(super) alerts_aside: bool,
}

pub(super) type Done = Result<(), OperatorError>;

impl<W: Write> Operator<W> {
    /// An operator at this station; commands `vehicle`, or the only one that is discovered.
    pub fn new(station: Station, vehicle: Option<Id>, style: Style, out: W) -> Operator<W> {
        Operator {
            station,
            style,
            out,
            requested: vehicle,
            vehicle: None,
            alerts_in_full: false,
            alerts_aside: false,
        }
    }

    /// The station.
    pub fn station(&mut self) -> &mut Station {
        &mut self.station
    }

    /// Serves the station for a moment and prints alerts: between the lines of a shell.
    ///
    /// # Errors
    /// The socket or the output fails.
    pub async fn idle(&mut self, span: Duration) -> Result<(), OperatorError> {
        self.alerts_in_full = true;
        self.station.idle(span).await?;
        self.print_alerts(&[])
    }

    /// Discovers the vehicle to command: the requested one, or the only one. The discovery also gives the VSM the
    /// address of this station.
    ///
    /// # Errors
    /// No VSM answers, the vehicle is not there, or there are several and none was requested.
    pub async fn find_vehicle(&mut self) -> Result<Id, OperatorError> {
        if let Some(vehicle) = self.vehicle {
            return Ok(vehicle);
        }
        let discovered = self.station.discover().await?;
        let found: Vec<Id> = discovered.iter().map(|found| found.vehicle).collect();
        let names = || {
            let names: Vec<String> = found.iter().map(Id::to_string).collect();
            names.join(", ")
        };
        let vehicle = match (self.requested, found.as_slice()) {
            (Some(requested), _) if found.contains(&requested) => requested,
            (Some(requested), _) => {
                return Err(OperatorError::NoSuchVehicle {
                    requested,
                    found: names(),
                });
            }
            (None, [only]) => *only,
            (None, _) => return Err(OperatorError::Ambiguous(names())),
        };
        self.vehicle = Some(vehicle);
        if self.style == Style::People && !self.alerts_in_full {
            self.remark_active_alerts();
        }
        Ok(vehicle)
    }

    /// Prints alerts that were active before anything was commanded, on standard error, before the answer and
    /// shortened; an emergency in full. A VSM sends them to each station that begins to receive, and so to each
    /// process of `cucs`.
    fn remark_active_alerts(&mut self) {
        let mut rest = Vec::new();
        while let Some(event) = self.station.session.poll_event() {
            match event {
                // Nobody has to act on these; `watch` shows them.
                Event::Alert { alert, .. }
                    if matches!(
                        alert.priority,
                        AlertPriority::Cleared | AlertPriority::Nominal
                    ) => {}
                Event::Alert { from, alert } => {
                    let text = match alert.priority {
                        AlertPriority::Emergency | AlertPriority::Failed => alert.text.clone(),
                        _ => in_short(&alert.text),
                    };
                    let more = if text.len() < alert.text.len() {
                        WHOLE
                    } else {
                        ""
                    };
                    remark(&format!("{from}: {} stands: {text}{more}", alert.priority));
                }
                other => rest.push(other),
            }
        }
        self.station.session.put_back(rest);
    }

    /// As [`Self::find_vehicle`], for subcommands that need the vehicle's status: a VSM sends none to a CUCS without
    /// LOI.
    pub(super) async fn find_vehicle_with_status(&mut self) -> Result<Id, OperatorError> {
        let vehicle = self.find_vehicle().await?;
        let state = self.state(vehicle);
        if state.is_none_or(|state| state.granted().is_empty()) {
            return Err(OperatorError::NoRights(vehicle));
        }
        Ok(vehicle)
    }

    /// Commands another vehicle from now on.
    pub(super) async fn select_vehicle(&mut self, vehicle: Id) -> Done {
        self.requested = Some(vehicle);
        self.vehicle = None;
        self.find_vehicle().await.map(|_| ())
    }

    pub(super) fn state(&self, vehicle: Id) -> Option<&Vehicle> {
        self.station.vehicle(vehicle)
    }

    /// Sends a message, waits until it is carried out, and returns what the vehicle sent meanwhile. Prints alerts
    /// that arrived with it.
    ///
    /// # Errors
    /// It is refused, or there is no answer.
    pub(super) async fn query(
        &mut self,
        vehicle: Id,
        request: impl Into<Message>,
        what: &str,
    ) -> Result<Vec<Message>, OperatorError> {
        let within = self.station.timeouts.command;
        let delivery = self.station.send(vehicle, request, within).await?;
        // The last answers, and the reason of a refusal, may arrive after the acknowledgement.
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
                    .map(Vehicle::granted)
                    .unwrap_or_default(),
            };
            return Err(refused.into());
        }
        for (from, alert) in alerts {
            self.print(
                &format!("{from}: 16000: {}", alert.text),
                json!({"alert": alert.text, "vehicle": from.to_string()}),
            )?;
        }
        Ok(answers)
    }

    /// Prints what was done, or returns the refusal.
    pub(super) fn finish(&mut self, vehicle: Id, what: &str, outcome: Outcome) -> Done {
        outcome.accepted()?;
        self.print(&format!("{vehicle}: {what}"), json!({"done": what}))
    }

    pub(super) fn print(&mut self, line: &str, value: Value) -> Done {
        match self.style {
            Style::People => writeln!(self.out, "{line}")?,
            Style::Json => writeln!(self.out, "{value}")?,
        }
        Ok(self.out.flush()?)
    }

    pub(super) fn print_state(&mut self, vehicle: Id) -> Done {
        let Some(state) = self.station.vehicle(vehicle) else {
            return Ok(());
        };
        let (line, value) = (report::line(state), report::state(state));
        self.print(&line, value)
    }

    /// Prints alerts, and handovers that other stations request or offer. For people, an alert that an error has
    /// already quoted as a reason is left out.
    pub(super) fn print_alerts(&mut self, quoted: &[String]) -> Done {
        while let Some(event) = self.station.session.poll_event() {
            match event {
                Event::Alert { alert, .. }
                    if self.style == Style::People && quoted.contains(&alert.text) => {}
                Event::Alert { from, alert } => {
                    let priority = match alert.priority {
                        AlertPriority::Cleared => "cleared".to_owned(),
                        other => other.to_string(),
                    };
                    let line = format!("{from}: 16000 {priority}: {}", alert.text);
                    // An alert within the contents of a file would damage the file.
                    if self.alerts_aside && self.style == Style::People {
                        remark(&line);
                        continue;
                    }
                    self.print(
                        &line,
                        json!({
                            "alert": alert.text,
                            "vehicle": from.to_string(),
                            "priority": alert.priority.raw(),
                            "id": alert.id,
                            "first": alert.first,
                        }),
                    )?;
                }
                Event::HandoverRequested { vehicle, by, loi } => self.print(
                    &format!(
                        "{vehicle}: {by} requests LOI {}: `consent` or `refuse`",
                        levels(loi)
                    ),
                    json!({
                        "vehicle": vehicle.to_string(),
                        "asked_by": by.to_string(),
                        "loi": loi_numbers(loi),
                    }),
                )?,
                Event::HandoverOffered { vehicle, loi } => self.print(
                    &format!(
                        "{vehicle}: LOI {} is offered: `accept` or `decline`",
                        levels(loi)
                    ),
                    json!({
                        "vehicle": vehicle.to_string(),
                        "offered": loi_numbers(loi),
                    }),
                )?,
                Event::Message { .. } | Event::Answered { .. } => {}
            }
        }
        Ok(())
    }

    pub(super) fn print_traffic(&mut self) -> Done {
        let traffic = self.station.session().traffic().clone();
        let dropped = traffic
            .dropped
            .iter()
            .map(|(reason, count)| format!("\n  {reason}: {count}"));
        self.print(
            &format!(
                "sent, {} of it retransmissions:{}\nreceived:{}\ndropped:{}",
                traffic.retransmitted,
                by_type(&traffic.sent),
                by_type(&traffic.received),
                dropped.collect::<String>(),
            ),
            json!(traffic),
        )
    }
}

/// One line for each Message Type, with its name: `17000 Message Acknowledgement: 3`.
fn by_type(counts: &ByType) -> String {
    let line = |(id, count): (u16, u64)| {
        let name = table::message(id).map_or("unknown", |message| message.name);
        format!("\n  {id} {name}: {count}")
    };
    counts.iter().map(line).collect()
}

/// The cause of an alert, without its advice.
fn in_short(text: &str) -> String {
    let cause = text.split_once("; ").map_or(text, |(cause, _)| cause);
    if cause.chars().count() <= SHORT {
        return cause.to_owned();
    }
    let cut: String = cause.chars().take(SHORT).collect();
    cut + " .."
}

/// Characters of an earlier alert that are shown beside an answer.
const SHORT: usize = 110;
/// Where to find the rest of it.
const WHOLE: &str = " (whole: `cucs watch`)";

/// A line on standard error: a remark, not a result.
pub(super) fn remark(line: &str) {
    // Where standard error is closed, nobody is left to report to.
    let _ = writeln!(std::io::stderr(), "cucs: {line}");
}

/// How long the answers to a query may come after its acknowledgement.
pub(super) const SETTLE: Duration = Duration::from_millis(100);
