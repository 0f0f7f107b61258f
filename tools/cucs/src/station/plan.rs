//! Plans: sending a route, clearing, downloading (13000 and 14000).

use std::collections::BTreeSet;
use std::time::Duration;

use stanag_msgs::enums::{MissionPlanMode, MissionTransferStatus};
use stanag_msgs::messages::MissionTransferCommand;
use stanag_msgs::{Id, Message};
use tokio::time::Instant;

use super::endpoint::{Station, time_waited};
use super::outcome::{Outcome, StationError};
use crate::session::machine::Session;
use crate::session::sender::Delivery;
use route_files::Download;
use route_files::route::model::Route;

impl Station {
    /// Sends a route (13001 and its other messages), then loads it (13000 mode 2), and waits until 14000 reports it
    /// as loaded or refused.
    ///
    /// # Errors
    /// The route cannot be written as messages, or there is no answer.
    pub async fn send_route(
        &mut self,
        vehicle: Id,
        route: &Route,
    ) -> Result<Outcome, StationError> {
        let load = route.load_command()?;
        let messages = route.messages(vehicle, self.session.id())?;
        if let Outcome::Refused(refused) = self.store(vehicle, &messages).await? {
            return Ok(Outcome::Refused(refused));
        }
        self.transfer(vehicle, load).await
    }

    /// Sends messages that are only stored, and waits until each is stored or one is refused.
    ///
    /// # Errors
    /// One of them has no answer.
    pub async fn store(
        &mut self,
        vehicle: Id,
        messages: &[Message],
    ) -> Result<Outcome, StationError> {
        let mark = self.alert_mark(vehicle);
        let within = self.timeouts.store;
        let began = Instant::now();
        let now = self.now();
        let tickets = self
            .session
            .send_all(now, vehicle, messages.iter().cloned())?;
        let expected = format!("acknowledgements (17000) of {} messages", tickets.len());
        self.awaits(expected, within);
        let ended = self
            .until(began + within, |session| {
                let mut deliveries = tickets.iter().map(|ticket| session.delivery(*ticket));
                let refused = deliveries
                    .clone()
                    .any(|delivery| matches!(delivery, Delivery::Refused | Delivery::Unanswered));
                (refused || deliveries.all(Delivery::is_final)).then_some(())
            })
            .await?;
        self.awaits_nothing();
        let waited = time_waited(began, within);
        let found = tickets.iter().zip(messages).find_map(|(ticket, message)| {
            let delivery = self.session.delivery(*ticket);
            (delivery != Delivery::CarriedOut).then_some((delivery, what(message)))
        });
        // After a refusal the rest of the plan is no longer sent.
        for ticket in &tickets {
            self.session.withdraw(*ticket);
        }
        match found {
            None => Ok(Outcome::CarriedOut),
            Some((Delivery::Refused, what)) => {
                let refused = self.refusal(vehicle, what, None, mark).await?;
                Ok(Outcome::Refused(refused))
            }
            Some(_) if !self.answered => Err(self.no_vsm(waited)),
            Some((_, what)) => {
                let tries = if ended.is_some() { "in any try" } else { "yet" };
                let expected = format!("acknowledgement (17000) of {what} {tries}");
                Err(self.timed_out(expected, waited, vehicle))
            }
        }
    }

    /// Clears the plan, in the VSM and in the vehicle (13000 mode 1).
    ///
    /// # Errors
    /// There is no answer.
    pub async fn clear(&mut self, vehicle: Id) -> Result<Outcome, StationError> {
        self.transfer(vehicle, plan_mode(MissionPlanMode::Clear))
            .await
    }

    /// Cancels the transfer in progress (13000 mode 5).
    ///
    /// # Errors
    /// There is no answer.
    pub async fn cancel(&mut self, vehicle: Id) -> Result<Outcome, StationError> {
        self.transfer(vehicle, plan_mode(MissionPlanMode::Cancel))
            .await
    }

    /// Downloads the whole plan (13000 mode 3). A long plan arrives in a burst, of which a network may lose a part:
    /// where a named waypoint did not arrive, every waypoint is requested separately (mode 4), with its loiter.
    /// Waypoints that the VSM does not have either stay [missing](Download::missing). A lost curve is not noticed.
    ///
    /// # Errors
    /// It is refused, or there is no answer.
    pub async fn download(&mut self, vehicle: Id) -> Result<Download, StationError> {
        self.session.start_download(vehicle);
        self.transfer(vehicle, plan_mode(MissionPlanMode::Download))
            .await?
            .accepted()?;
        // 14000 may arrive before the last waypoints.
        let deadline = Instant::now() + self.timeouts.quiet;
        self.until(deadline, |session| {
            let state = session.vehicle(vehicle)?;
            state.download.missing().is_empty().then_some(())
        })
        .await?;
        if self.downloaded(vehicle).missing().is_empty() {
            return Ok(self.downloaded(vehicle));
        }
        let mut requested = BTreeSet::new();
        // Each waypoint that arrives may name others that are missing.
        while let Some(number) = self
            .downloaded(vehicle)
            .named()
            .into_iter()
            .find(|number| !requested.contains(number))
        {
            requested.insert(number);
            let request = MissionTransferCommand {
                waypoint_number: Some(number),
                ..plan_mode(MissionPlanMode::DownloadWaypoint)
            };
            // A refusal means that the VSM does not have the waypoint: it stays missing.
            self.transfer(vehicle, request).await?;
        }
        Ok(self.downloaded(vehicle))
    }

    fn downloaded(&self, vehicle: Id) -> Download {
        self.vehicle(vehicle)
            .map(|state| state.download.clone())
            .unwrap_or_default()
    }

    /// Sends a 13000 and waits for the end of the transfer that 14000 reports.
    ///
    /// # Errors
    /// There is no answer, or the transfer does not end in time.
    pub async fn transfer(
        &mut self,
        vehicle: Id,
        command: MissionTransferCommand,
    ) -> Result<Outcome, StationError> {
        let mode = command.mission_plan_mode;
        let what = match mode {
            Some(MissionPlanMode::Load) => "loading (13000 mode 2, load)".to_owned(),
            Some(MissionPlanMode::Clear) => "clearing (13000 mode 1, clear)".to_owned(),
            Some(MissionPlanMode::Cancel) => "cancelling (13000 mode 5, cancel)".to_owned(),
            Some(MissionPlanMode::Download | MissionPlanMode::DownloadWaypoint) => {
                "download (13000 mode 3 or 4, download)".to_owned()
            }
            other => format!("13000 mode {}", other.map_or(0, MissionPlanMode::raw)),
        };
        let within = self.timeouts.transfer;
        let began = Instant::now();
        let deadline = began + within;
        let count = |session: &Session| session.vehicle(vehicle).map_or(0, |state| state.transfers);
        let before = count(&self.session);
        let mark = self.alert_mark(vehicle);
        let now = self.now();
        let ticket = self.session.send(now, vehicle, command)?;
        let reported = |session: &Session| {
            let state = session
                .vehicle(vehicle)
                .filter(|_| count(session) > before)?;
            let report = state.transfer.as_ref()?;
            // A 14000 may belong to another transfer.
            if report.mission_plan_mode.is_some() && report.mission_plan_mode != mode {
                return None;
            }
            let waypoint = report.waypoint_request.filter(|number| *number != 0);
            match report.status? {
                MissionTransferStatus::Complete => Some(End::Complete),
                MissionTransferStatus::Aborted => Some(End::Refused(waypoint)),
                _ => None,
            }
        };
        let downloads = mode == Some(MissionPlanMode::Download);
        let mut size = 0;
        self.awaits(format!("end (14000) of {what}"), within);
        let mut end = loop {
            let look = (Instant::now() + STALL).min(deadline);
            let end = self
                .until(look, |session| {
                    reported(session).or_else(|| match session.delivery(ticket) {
                        Delivery::Refused => Some(End::Refused(None)),
                        Delivery::CarriedOut => Some(End::Complete),
                        Delivery::Unanswered => Some(End::Unanswered),
                        _ => None,
                    })
                })
                .await?;
            if end.is_some() || Instant::now() >= deadline {
                break end;
            }
            // A full buffer loses the end of a burst first, and the 14000 is at the end.
            let before = std::mem::replace(&mut size, self.downloaded(vehicle).len());
            if downloads && size > 0 && size == before {
                break Some(End::Complete);
            }
        };
        self.awaits_nothing();
        let waited = time_waited(began, within);
        // 17000 may arrive before 14000, which has more (the refused waypoint); and a 14000 that arrives later would
        // be taken for the answer to the next transfer.
        if matches!(end, Some(End::Complete | End::Refused(None))) {
            let grace = Instant::now() + self.timeouts.reason;
            end = self
                .until(grace, |session| reported(session))
                .await?
                .or(end);
        }
        self.session.withdraw(ticket);
        match end {
            Some(End::Complete) => Ok(Outcome::CarriedOut),
            Some(End::Refused(waypoint)) => {
                let refused = self.refusal(vehicle, what, waypoint, mark).await?;
                Ok(Outcome::Refused(refused))
            }
            Some(End::Unanswered) if !self.answered => Err(self.no_vsm(waited)),
            Some(End::Unanswered) => Err(self.timed_out(
                format!("acknowledgement (17000) of {what}"),
                waited,
                vehicle,
            )),
            None => Err(self.timed_out(format!("end (14000) of {what}"), waited, vehicle)),
        }
    }
}

#[derive(Clone, Copy)]
enum End {
    Complete,
    Refused(Option<u16>),
    Unanswered,
}

fn plan_mode(mode: MissionPlanMode) -> MissionTransferCommand {
    MissionTransferCommand {
        mission_plan_mode: Some(mode),
        ..MissionTransferCommand::default()
    }
}

/// A plan message for people: its number and waypoint.
fn what(message: &Message) -> String {
    let number = match message {
        Message::UaPositionWaypoint(point) => point.waypoint_number,
        Message::UaLoiterWaypoint(loiter) => loiter.waypoint_number,
        Message::CurveSegment(curve) => curve.p1_waypoint_no,
        Message::CurveSegmentPaper(curve) => curve.p1_waypoint_no,
        _ => None,
    };
    match number {
        Some(number) => format!("{} of waypoint {number}", message.id()),
        None => message.id().to_string(),
    }
}

/// A download without messages for this long has ended.
const STALL: Duration = Duration::from_secs(1);
