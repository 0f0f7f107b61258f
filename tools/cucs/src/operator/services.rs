//! What this project adds to the DLI, in words: parameters, software version, ping, areas (50010 to 50018).

use std::io::Write;
use std::path::Path;

use serde_json::json;
use stanag_msgs::enums::{AreaPlanMode, ParameterKind, PingTarget};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, GenericInformationRequestMessage, ParameterReport,
    ParameterRequest, ParameterSetCommand, PingRequest, SoftwareVersionReport,
};
use stanag_msgs::{Id, Message, Text};

use super::{Done, Operator, OperatorError, Style};
use crate::fence;
use crate::session::Event;

impl<W: Write> Operator<W> {
    /// 50010, and what comes of it.
    pub(super) async fn parameters(&mut self, name: Option<&str>) -> Done {
        let vehicle = self.meet().await?;
        let request = ParameterRequest {
            parameter_name: name.map(Text::new),
            ..ParameterRequest::default()
        };
        let what = "parameters (50010)";
        let answers = self.ask(vehicle, request, what).await?;
        let mut told: Vec<&ParameterReport> = answers
            .iter()
            .filter_map(|message| match message {
                Message::ParameterReport(report) => Some(report),
                _ => None,
            })
            .collect();
        told.sort_by_key(|report| report.parameter_index);
        for report in told {
            self.tell_parameter(report)?;
        }
        Ok(self.out.flush()?)
    }

    /// 50011.
    pub(super) async fn set_parameter(&mut self, name: &str, value: f64) -> Done {
        let vehicle = self.meet().await?;
        let command = ParameterSetCommand {
            parameter_name: Some(Text::new(name)),
            commanded_value: Some(value),
            ..ParameterSetCommand::default()
        };
        let answers = self.ask(vehicle, command, "parameter (50011)").await?;
        let told = answers.iter().rev().find_map(|message| match message {
            Message::ParameterReport(report) => Some(report),
            _ => None,
        });
        told.map_or(Ok(()), |report| self.tell_parameter(report))
    }

    fn tell_parameter(&mut self, report: &ParameterReport) -> Done {
        let name = report
            .parameter_name
            .as_ref()
            .map_or("?", |name| name.as_str());
        let kind = match report.parameter_kind {
            Some(ParameterKind::Integer) => "integer",
            _ => "float",
        };
        let number = |value: Option<f64>| value.map_or_else(|| "?".to_owned(), |v| v.to_string());
        let range = match (report.minimum, report.maximum) {
            (None, None) => String::new(),
            (low, high) => format!(" ({} to {})", number(low), number(high)),
        };
        self.tell(
            &format!("{name} = {}{range}", number(report.value)),
            json!({
                "parameter": name,
                "value": report.value,
                "kind": kind,
                "minimum": report.minimum,
                "maximum": report.maximum,
            }),
        )
    }

    /// 17002 for 50013.
    pub(super) async fn software(&mut self) -> Done {
        let vehicle = self.meet().await?;
        let request = GenericInformationRequestMessage {
            message_type: Some(SoftwareVersionReport::ID),
            ..GenericInformationRequestMessage::default()
        };
        self.ask(vehicle, request, "software version (17002)")
            .await?;
        let report = loop {
            match self
                .station
                .next_event(self.station.timeouts.command)
                .await?
            {
                Event::Message { from, message } if from == vehicle => {
                    if let Message::SoftwareVersionReport(report) = *message {
                        break report;
                    }
                }
                _ => {}
            }
        };
        let text = |field: Option<&str>| field.unwrap_or("not told").to_owned();
        let vsm = text(report.vsm_version.as_ref().map(|text| text.as_str()));
        let autopilot = text(report.autopilot_version.as_ref().map(|text| text.as_str()));
        let source = report.autopilot_source.as_ref().map(|text| text.as_str());
        let hardware = report.hardware_id.as_ref().map(|text| text.as_str());
        self.tell(
            &format!(
                "{vehicle}: VSM {vsm}, autopilot {autopilot}, source {}, hardware {}",
                text(source),
                text(hardware)
            ),
            json!({"vsm": vsm, "autopilot": autopilot, "source": source, "hardware": hardware}),
        )
    }

    /// 50014.
    pub(super) async fn ping(&mut self, through: bool) -> Done {
        let vehicle = self.meet().await?;
        let request = PingRequest {
            ping_number: Some(1),
            ping_target: Some(if through {
                PingTarget::Vehicle
            } else {
                PingTarget::Vsm
            }),
            ..PingRequest::default()
        };
        let began = tokio::time::Instant::now();
        let answers = self.ask(vehicle, request, "ping (50014)").await?;
        // What is waited for after the answer is no part of the way.
        let ms = (began.elapsed().saturating_sub(super::configuring::SETTLE)).as_secs_f64() * 1e3;
        let round_trip = answers.iter().find_map(|message| match message {
            Message::PingResponse(answer) => Some(answer.vehicle_round_trip),
            _ => None,
        });
        let link = round_trip.flatten().map(|s| f64::from(s) * 1e3);
        let beyond = link.map_or_else(String::new, |ms| {
            format!(", {ms:.1} ms of it beyond the VSM")
        });
        self.tell(
            &format!("{vehicle}: answered in {ms:.1} ms{beyond}"),
            json!({"ping_ms": ms, "vehicle_round_trip_ms": link}),
        )
    }

    /// 50016 and 50017: a file of areas goes aboard.
    pub(super) async fn send_fence(&mut self, file: &Path) -> Done {
        let vertices = fence::load(file)?;
        let vehicle = self.meet().await?;
        self.station.store(vehicle, &vertices).await?.accepted()?;
        self.transfer_areas(vehicle, AreaPlanMode::Load).await?;
        let count = vertices.len();
        self.tell(
            &format!(
                "{vehicle}: {} with {count} vertices is aboard",
                file.display()
            ),
            json!({"fence": file.display().to_string(), "vertices": count}),
        )
    }

    /// 50017 mode 1.
    pub(super) async fn clear_fence(&mut self) -> Done {
        let vehicle = self.meet().await?;
        self.transfer_areas(vehicle, AreaPlanMode::Clear).await?;
        self.tell(
            &format!("{vehicle}: areas cleared"),
            json!({"done": "areas cleared"}),
        )
    }

    /// 50017 mode 3.
    pub(super) async fn download_fence(&mut self, path: Option<&Path>) -> Done {
        let vehicle = self.meet().await?;
        let answers = self.transfer_areas(vehicle, AreaPlanMode::Download).await?;
        let vertices: Vec<&AreaVertex> = answers
            .iter()
            .filter_map(|message| match message {
                Message::AreaVertex(vertex) => Some(vertex),
                _ => None,
            })
            .collect();
        let text = fence::to_toml(vertices);
        match path {
            None if self.style == Style::People => Ok(write!(self.out, "{text}")?),
            None => Ok(writeln!(self.out, "{}", json!({"fence": text}))?),
            Some(path) => {
                std::fs::write(path, text).map_err(|source| OperatorError::Write {
                    path: path.to_owned(),
                    source,
                })?;
                self.tell(
                    &format!("{vehicle}: areas written to {}", path.display()),
                    json!({"written": path.display().to_string()}),
                )
            }
        }
    }

    async fn transfer_areas(
        &mut self,
        vehicle: Id,
        mode: AreaPlanMode,
    ) -> Result<Vec<Message>, OperatorError> {
        let command = AreaTransferCommand {
            area_plan_mode: Some(mode),
            ..AreaTransferCommand::default()
        };
        let what = format!("areas (50017 mode {})", mode.raw());
        self.ask(vehicle, command, &what).await
    }
}
