//! Requests to the VSM and the vehicle: configuration (40000), parameters (50010, 50011), software (50013), ping
//! (50014).

use std::io::Write;

use serde_json::{Value, json};
use stanag_msgs::enums::{ConfigRequestType, ParameterKind, PingTarget};
use stanag_msgs::messages::{
    FieldConfigurationRequest, GenericInformationRequestMessage, ParameterReport, ParameterRequest,
    ParameterSetCommand, PingRequest, SoftwareVersionReport,
};
use stanag_msgs::{Message, Text};

use super::configuration::ConfigurationTable;
use super::console::{Done, Operator, SETTLE, Style};
use super::error::OperatorError;
use crate::session::machine::Event;
use crate::station::outcome::StationError;

/// A parameter as a person writes it: PX4's floats have 32 bits, and the float 0.1 would be printed as
/// 0.10000000149011612.
pub(super) fn shortest(value: f64) -> String {
    let narrow = value as f32;
    if f64::from(narrow).to_bits() == value.to_bits() {
        narrow.to_string()
    } else {
        value.to_string()
    }
}

/// The same as a JSON number.
pub(super) fn as_written(value: f64) -> Value {
    // Null where JSON has no number for it.
    shortest(value)
        .parse::<f64>()
        .map_or(Value::Null, Value::from)
}

impl<W: Write> Operator<W> {
    /// 50010: requests one parameter or all, and prints the reports by their index.
    pub(super) async fn parameters(&mut self, name: Option<&str>) -> Done {
        let vehicle = self.find_vehicle().await?;
        let request = ParameterRequest {
            parameter_name: name.map(Text::new),
            ..ParameterRequest::default()
        };
        let what = "parameters (50010)";
        let answers = self.query(vehicle, request, what).await?;
        let mut reports: Vec<&ParameterReport> = answers
            .iter()
            .filter_map(|message| match message {
                Message::ParameterReport(report) => Some(report),
                _ => None,
            })
            // Not the reports of changes, which nobody requested.
            .filter(|report| {
                let of = report.parameter_name.as_ref().map(|of| of.as_str());
                name.is_none() || of == name
            })
            .collect();
        reports.sort_by_key(|report| report.parameter_index);
        if reports.is_empty() {
            self.print(
                &format!("{vehicle}: no parameters"),
                json!({"parameters": []}),
            )?;
        }
        for report in reports {
            self.print_parameter(report)?;
        }
        Ok(self.out.flush()?)
    }

    /// Sets a parameter (50011).
    pub(super) async fn set_parameter(&mut self, name: &str, value: f64) -> Done {
        let vehicle = self.find_vehicle().await?;
        let command = ParameterSetCommand {
            parameter_name: Some(Text::new(name)),
            commanded_value: Some(value),
            ..ParameterSetCommand::default()
        };
        let answers = self.query(vehicle, command, "parameter (50011)").await?;
        let stored = answers.iter().rev().find_map(|message| match message {
            Message::ParameterReport(report) => Some(report),
            _ => None,
        });
        stored.map_or(Ok(()), |report| self.print_parameter(report))
    }

    fn print_parameter(&mut self, report: &ParameterReport) -> Done {
        let name = report
            .parameter_name
            .as_ref()
            .map_or("?", |name| name.as_str());
        let kind = match report.parameter_kind {
            Some(ParameterKind::Integer) => "integer",
            _ => "float",
        };
        let number = |value: Option<f64>| value.map_or_else(|| "?".to_owned(), shortest);
        let range = match (report.minimum, report.maximum) {
            (None, None) => String::new(),
            (low, high) => format!(" ({} to {})", number(low), number(high)),
        };
        self.print(
            &format!("{name} = {}{range}", number(report.value)),
            json!({
                "parameter": name,
                "value": report.value.map(as_written),
                "kind": kind,
                "minimum": report.minimum.map(as_written),
                "maximum": report.maximum.map(as_written),
            }),
        )
    }

    /// Requests the software versions (17002 for 50013).
    pub(super) async fn software(&mut self) -> Done {
        let vehicle = self.find_vehicle().await?;
        let request = GenericInformationRequestMessage {
            message_type: Some(SoftwareVersionReport::ID),
            ..GenericInformationRequestMessage::default()
        };
        let what = "software version (17002)";
        let answers = self.query(vehicle, request, what).await?;
        let report_of = |message: Message| match message {
            Message::SoftwareVersionReport(report) => Some(report),
            _ => None,
        };
        // The report may arrive before or after the acknowledgement.
        let mut report = answers.into_iter().find_map(report_of);
        let within = self.station.timeouts.command;
        let end = tokio::time::Instant::now() + within;
        let report = loop {
            if let Some(report) = report {
                break report;
            }
            // Other messages arrive all the time, so each one is checked against the deadline.
            let left = end.saturating_duration_since(tokio::time::Instant::now());
            if left.is_zero() {
                return Err(OperatorError::Station(StationError::TimedOut {
                    expected: "software version (50013)".to_owned(),
                    within,
                    seen: "the request was acknowledged".to_owned(),
                }));
            }
            report = match self.station.next_event(left).await? {
                Event::Message { from, message } if from == vehicle => report_of(*message),
                _ => None,
            };
        };
        let text = |field: Option<&str>| field.unwrap_or("not reported").to_owned();
        let vsm = text(report.vsm_version.as_ref().map(|text| text.as_str()));
        let autopilot = text(report.autopilot_version.as_ref().map(|text| text.as_str()));
        let source = report.autopilot_source.as_ref().map(|text| text.as_str());
        let hardware = report.hardware_id.as_ref().map(|text| text.as_str());
        self.print(
            &format!(
                "{vehicle}: VSM {vsm}, autopilot {autopilot}, source {}, hardware {}",
                text(source),
                text(hardware)
            ),
            json!({"vsm": vsm, "autopilot": autopilot, "source": source, "hardware": hardware}),
        )
    }

    /// Measures the round trip (50014).
    pub(super) async fn ping(&mut self, through_to_vehicle: bool) -> Done {
        let vehicle = self.find_vehicle().await?;
        let request = PingRequest {
            ping_number: Some(1),
            ping_target: Some(if through_to_vehicle {
                PingTarget::Vehicle
            } else {
                PingTarget::Vsm
            }),
            ..PingRequest::default()
        };
        let began = tokio::time::Instant::now();
        let answers = self.query(vehicle, request, "ping (50014)").await?;
        // The pause for late answers is not part of the round trip.
        let ms = (began.elapsed().saturating_sub(SETTLE)).as_secs_f64() * 1e3;
        let round_trip = answers.iter().find_map(|message| match message {
            Message::PingResponse(answer) => Some(answer.vehicle_round_trip),
            _ => None,
        });
        let link = round_trip.flatten().map(|s| f64::from(s) * 1e3);
        let beyond = link.map_or_else(String::new, |ms| {
            format!(", {ms:.1} ms of it beyond the VSM")
        });
        self.print(
            &format!("{vehicle}: answered in {ms:.1} ms{beyond}"),
            json!({"ping_ms": ms, "vehicle_round_trip_ms": link}),
        )
    }

    /// Requests the configuration, level by level (40000), and prints the answers as one table.
    pub(super) async fn configuration(&mut self, loi: Option<u8>) -> Done {
        let vehicle = self.find_vehicle().await?;
        let mut table = ConfigurationTable::default();
        for level in loi.map_or(2..=5, |only| only..=only) {
            let request = FieldConfigurationRequest {
                request_type: Some(ConfigRequestType::from_raw(level - 1)),
                ..FieldConfigurationRequest::default()
            };
            let what = format!("configuration for LOI {level} (40000)");
            for message in self.query(vehicle, request, &what).await? {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_of_32_bits_is_shown_as_a_person_writes_it() {
        for written in [0.1_f32, 6.283_185_5, -1.5, 7.0] {
            assert_eq!(shortest(f64::from(written)), written.to_string());
        }
        assert_eq!(as_written(f64::from(0.1_f32)).to_string(), "0.1");
        // A value of 64 bits is printed in full.
        assert_eq!(shortest(0.1), "0.1");
        assert_eq!(shortest(0.123_456_789_012), "0.123456789012");
        assert_eq!(as_written(f64::NAN), Value::Null);
    }
}
