//! The vehicle's controls: the parameters that the VSM offers as fields of 50011 (40000, 41000, 41001), and their
//! values (44000, 44001; 50012 in Edition 2.5).

use std::collections::BTreeMap;
use std::io::Write;

use serde_json::json;
use stanag_msgs::enums::ConfigRequestType;
use stanag_msgs::messages::{FieldConfigurationRequest, ParameterSetCommand};
use stanag_msgs::{Message, Text};

use super::console::{Done, Operator};
use super::error::OperatorError;
use super::services::{as_written, shortest};

/// The controls that a VSM has described, by the number of the field.
#[derive(Debug, Default)]
struct Controls(BTreeMap<u8, Control>);

#[derive(Debug, Default)]
struct Control {
    name: String,
    /// Unit and meaning.
    help: String,
    low: Option<f64>,
    high: Option<f64>,
    value: Option<f64>,
}

impl Controls {
    fn of(answers: &[Message]) -> Controls {
        let mut all = Controls::default();
        for message in answers {
            all.take(message);
        }
        all
    }

    fn take(&mut self, message: &Message) {
        match message {
            Message::FieldConfigurationIntegerResponse(m) => {
                let limits = [m.min_value, m.max_value].map(|limit| limit.map(f64::from));
                self.describe(m.requested_message, m.requested_field, m.help_text, limits);
            }
            Message::FieldConfigurationFloatResponse(m) => {
                let limits = [m.min_value, m.max_value].map(|limit| limit.map(f64::from));
                self.describe(m.requested_message, m.requested_field, m.help_text, limits);
            }
            Message::FieldChangeIntegerCommand(m) => {
                let value = m.commanded_value.map(f64::from);
                self.set(m.requested_message, m.requested_field, value);
            }
            Message::FieldChangeFloatCommand(m) => {
                let value = m.commanded_value.map(f64::from);
                self.set(m.requested_message, m.requested_field, value);
            }
            Message::ParameterReport(m) => {
                let name = m.parameter_name.as_ref().map_or("", Text::as_str);
                if let Some(control) = self.named(name) {
                    control.value = m.value;
                }
            }
            _ => {}
        }
    }

    fn describe(
        &mut self,
        message: Option<u32>,
        field: Option<u8>,
        help: Option<Text<80>>,
        [low, high]: [Option<f64>; 2],
    ) {
        let (Some(field @ FIRST..), Some(help)) = (field, help) else {
            return;
        };
        let (name, help) = help.as_str().split_once(':').unwrap_or_default();
        if message == Some(ParameterSetCommand::ID.into()) && !name.is_empty() {
            let control = self.0.entry(field).or_default();
            (control.name, control.help) = (name.to_owned(), help.trim().to_owned());
            (control.low, control.high) = (low, high);
        }
    }

    fn set(&mut self, message: Option<u16>, field: Option<u8>, value: Option<f64>) {
        let of_it = message == Some(ParameterSetCommand::ID);
        if let Some(control) = field.filter(|_| of_it).and_then(|at| self.0.get_mut(&at)) {
            control.value = value;
        }
    }

    fn named(&mut self, name: &str) -> Option<&mut Control> {
        self.0.values_mut().find(|control| control.name == name)
    }
}

impl<W: Write> Operator<W> {
    /// Requests the controls (40000 for 50011) and prints them, or sets one of them by 50011.
    pub(super) async fn controls(&mut self, name: Option<&str>, value: Option<f64>) -> Done {
        let vehicle = self.find_vehicle().await?;
        let request = FieldConfigurationRequest {
            request_type: Some(ConfigRequestType::SingleParameter),
            requested_message: Some(ParameterSetCommand::ID.into()),
            ..FieldConfigurationRequest::default()
        };
        let answers = self.query(vehicle, request, "controls (40000)").await?;
        let mut controls = Controls::of(&answers);
        match (name, value) {
            (None, _) => {
                for control in controls.0.values() {
                    self.print_control(control)?;
                }
                if controls.0.is_empty() {
                    self.print(
                        &format!("{vehicle}: no controls offered (vehicle.controls of the VSM)"),
                        json!({"controls": []}),
                    )?;
                }
                Ok(self.out.flush()?)
            }
            (Some(name), value) => {
                let Some(control) = controls.named(name) else {
                    return Err(OperatorError::NoControl(name.to_owned()));
                };
                match value {
                    None => self.print_control(control),
                    Some(value) => self.set_parameter(name, value).await,
                }
            }
        }
    }

    fn print_control(&mut self, control: &Control) -> Done {
        let number = |value: Option<f64>| value.map_or_else(|| "?".to_owned(), shortest);
        let range = match (control.low, control.high) {
            (None, None) => String::new(),
            (low, high) => format!(" ({} to {})", number(low), number(high)),
        };
        self.print(
            &format!(
                "{} = {}{range} {}",
                control.name,
                number(control.value),
                control.help
            ),
            json!({
                "control": control.name,
                "value": control.value.map(as_written),
                "minimum": control.low.map(as_written),
                "maximum": control.high.map(as_written),
                "help": control.help,
            }),
        )
    }
}

/// The first field of 50011 that is a control.
const FIRST: u8 = 11;
