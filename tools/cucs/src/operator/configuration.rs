//! What a VSM reports in the configuration phase, as the table from which an operator's screen is built.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde_json::{Value, json};
use stanag_msgs::enums::{EnumIndexEnable, FieldAvailable, FieldSupported};
use stanag_msgs::table::{self, FieldInfo, MessageInfo};
use stanag_msgs::{Message, Text};

/// All answers, by message and field; fields count from 1, field 0 is the whole message.
#[derive(Clone, Debug, Default)]
pub struct ConfigurationTable {
    rows: BTreeMap<(u16, u8), Row>,
    services: Vec<String>,
}

/// One field. Numbers are in the unit of the field.
#[derive(Clone, Debug, Default)]
struct Row {
    supported: bool,
    default: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    caution: Option<f64>,
    warning: Option<f64>,
    help: String,
    /// The VSM's own values of an enumeration.
    own: Vec<(u8, String)>,
    /// Values that are refused, always or at present.
    refused: Vec<u8>,
    /// The value that another CUCS has set since.
    now: Option<f64>,
}

impl ConfigurationTable {
    /// Adds an answer; returns false where the message is not one of the configuration phase.
    pub fn take(&mut self, message: &Message) -> bool {
        // The answers have fields with the same names, each with its own type of number.
        macro_rules! answer {
            ($m:ident, $steps:expr, $help:expr) => {
                self.take_answer(
                    $m.requested_message,
                    $m.requested_field,
                    $m.field_supported,
                    $steps,
                    $help,
                )
            };
        }
        macro_rules! bounds {
            ($m:ident) => {{
                let steps = [
                    $m.default_value,
                    $m.min_value,
                    $m.max_value,
                    $m.low_caution_limit,
                    $m.low_warning_limit,
                ];
                answer!($m, steps.map(|value| value.map(f64::from)), &$m.help_text)
            }};
        }
        match message {
            Message::FieldConfigurationIntegerResponse(m) => bounds!(m),
            Message::FieldConfigurationUnsignedResponse(m) => bounds!(m),
            Message::FieldConfigurationFloatResponse(m) => bounds!(m),
            Message::FieldConfigurationCharacterResponse(m) => answer!(m, [None; 5], &m.help_text),
            Message::FieldConfigurationEnumeratedResponse(m) => {
                let default = m.default_value.map(f64::from);
                answer!(m, [default, None, None, None, None], &None);
                let own = m
                    .vehicle_specific_enumeration_index
                    .zip(m.vehicle_specific_enumeration_text);
                let row = self.row(m.requested_message, m.requested_field);
                if let (Some((value, text)), Some((row, _))) = (own, row) {
                    row.own.retain(|(known, _)| *known != value);
                    row.own.push((value, text.as_str().to_owned()));
                }
            }
            Message::MessageParameterAvailability(m) => {
                let Some((row, _)) = self.row(m.reported_message, m.reported_field) else {
                    return true;
                };
                row.supported = m.field_available == Some(FieldAvailable::Available);
                if let Some(value) = m.reported_enumerated_index {
                    row.refused.retain(|known| *known != value);
                    if m.enumerated_index_enable != Some(EnumIndexEnable::Available) {
                        row.refused.push(value);
                    }
                }
            }
            Message::FieldChangeIntegerCommand(m) => {
                self.take_change(m.requested_message, m.requested_field, m.commanded_value);
            }
            Message::FieldChangeEnumeratedCommand(m) => {
                let value = m.commanded_enumeration_index_value;
                self.take_change(m.requested_message, m.requested_field, value);
            }
            Message::VsmServicesReportMessage(m) => {
                let url = m.vsm_home_web_page_url.as_ref();
                if let Some(url) = url.map(|url| url.as_str()).filter(|url| !url.is_empty()) {
                    self.services.push(format!("status page {url}"));
                }
            }
            Message::UaRouteConfiguration(m) => {
                if let (Some(kind), Some(most)) = (m.route_type, m.maximum_number_of_waypoints) {
                    self.services
                        .push(format!("{kind} routes of at most {most} waypoints"));
                }
            }
            Message::ConfigurationComplete(_) => {}
            _ => return false,
        }
        true
    }

    /// One line for each field, for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![line([
            "field", "name", "start", "least", "most", "caution", "warning", "of it",
        ])];
        for (key, row) in &self.rows {
            let Some((message, field)) = place(*key) else {
                continue;
            };
            let Some(field) = field else {
                let text = if row.supported { "" } else { "not supported" };
                let id = message.id.to_string();
                lines.push(line([&id, message.name, "", "", "", "", "", text]));
                continue;
            };
            let number = |value: Option<f64>| value.map_or_else(String::new, short);
            lines.push(line([
                &format!("{}.{:02}", message.id, key.1),
                field.name,
                &number(row.default),
                &number(row.low),
                &number(row.high),
                &number(row.caution),
                &number(row.warning),
                &row.of_it(),
            ]));
        }
        lines.extend(self.services.iter().cloned());
        lines
    }

    /// One object for each field, for programs.
    #[must_use]
    pub fn objects(&self) -> Vec<Value> {
        let rows = self.rows.iter().filter_map(|(key, row)| {
            let (message, field) = place(*key)?;
            Some(json!({
                "message": message.id,
                "field": key.1,
                "name": field.map_or(message.name, |field| field.name),
                "unit": field.and_then(|field| field.unit),
                "supported": row.supported,
                "start": row.default,
                "least": row.low,
                "most": row.high,
                "caution_below": row.caution,
                "warning_below": row.warning,
                "help": row.help,
                "own_values": row.own.iter().map(|(value, text)| json!({"value": value, "text": text})).collect::<Vec<_>>(),
                "refused_values": row.refused,
                "now": row.now,
            }))
        });
        rows.collect()
    }

    /// The row of a field, and the field's step in its unit.
    fn row(&mut self, message: Option<u32>, field: Option<u8>) -> Option<(&mut Row, f64)> {
        let message = u16::try_from(message?).ok()?;
        let key = (message, field.unwrap_or(0));
        // Only fields that the message table has: received messages cannot make it grow without bound.
        let (_, info) = place(key)?;
        let step = info.map_or(1.0, FieldInfo::step);
        Some((self.rows.entry(key).or_default(), step))
    }

    /// The present value of a field, in steps of the field.
    fn take_change(&mut self, message: Option<u16>, field: Option<u8>, steps: Option<i32>) {
        let (Some(_), Some(steps)) = (field, steps) else {
            return;
        };
        if let Some((row, step)) = self.row(message.map(u32::from), field) {
            row.now = Some(f64::from(steps) * step);
        }
    }

    fn take_answer(
        &mut self,
        message: Option<u32>,
        field: Option<u8>,
        supported: Option<FieldSupported>,
        steps: [Option<f64>; 5],
        help: &Option<Text<80>>,
    ) {
        let Some((row, step)) = self.row(message, field) else {
            return;
        };
        row.supported = supported == Some(FieldSupported::Supported);
        [row.default, row.low, row.high, row.caution, row.warning] =
            steps.map(|value| value.map(|value| value * step));
        row.help = help.as_ref().map_or_else(String::new, Text::to_string);
    }
}

impl Row {
    fn of_it(&self) -> String {
        if !self.supported {
            return "not used".to_owned();
        }
        let mut text = self.help.clone();
        let mut also = |label: &str, list: String| {
            if !list.is_empty() {
                let gap = if text.is_empty() { "" } else { "; " };
                let _ = write!(text, "{gap}{label} {list}");
            }
        };
        let own = self
            .own
            .iter()
            .map(|(value, name)| format!("{value} {name}"));
        also("own", own.collect::<Vec<_>>().join(", "));
        let refused = self.refused.iter().map(u8::to_string);
        also("not", refused.collect::<Vec<_>>().join(", "));
        also("now", self.now.map_or_else(String::new, short));
        text
    }
}

/// The message, and the field unless the whole message is meant; `None` where there is none.
fn place((id, number): (u16, u8)) -> Option<(&'static MessageInfo, Option<&'static FieldInfo>)> {
    let message = table::message(id)?;
    match number {
        0 => Some((message, None)),
        number => {
            let field = message.fields.get(usize::from(number) - 1)?;
            Some((message, Some(field)))
        }
    }
}

fn line(cells: [&str; 8]) -> String {
    let [field, name, start, least, most, caution, warning, of_it] = cells;
    let text = format!(
        "{field:<9} {name:<38} {start:>10} {least:>10} {most:>10} {caution:>8} {warning:>8}  {of_it}"
    );
    text.trim_end().to_owned()
}

/// At most six decimals, without trailing zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0" } else { text }.to_owned()
}

#[cfg(test)]
mod tests {
    use stanag_msgs::Text;
    use stanag_msgs::messages::{
        FieldChangeIntegerCommand, FieldConfigurationEnumeratedResponse,
        FieldConfigurationUnsignedResponse, MessageParameterAvailability,
    };

    use super::*;

    #[test]
    fn a_field_is_shown_in_its_unit() {
        let mut table = ConfigurationTable::default();
        assert!(
            table.take(&Message::from(FieldConfigurationUnsignedResponse {
                requested_message: Some(2016),
                requested_field: Some(13),
                field_supported: Some(FieldSupported::Supported),
                default_value: Some(10),
                max_value: Some(24),
                help_text: Some(Text::new("m/s")),
                ..Default::default()
            }))
        );
        let lines = table.lines();
        let words: Vec<&str> = lines[1].split_whitespace().collect();
        assert_eq!(words, ["2016.13", "Commanded", "Speed", "5", "12", "m/s"]);
        assert_eq!(table.objects()[0]["most"], 12.0);
    }

    #[test]
    fn own_values_and_refused_ones_are_listed_and_come_back() {
        let mut table = ConfigurationTable::default();
        table.take(&Message::from(FieldConfigurationEnumeratedResponse {
            requested_message: Some(3001),
            requested_field: Some(2),
            field_supported: Some(FieldSupported::Supported),
            vehicle_specific_enumeration_index: Some(32),
            vehicle_specific_enumeration_text: Some(Text::new("RTL")),
            ..Default::default()
        }));
        let mode = |enable| {
            Message::from(MessageParameterAvailability {
                reported_message: Some(3001),
                reported_field: Some(2),
                field_available: Some(FieldAvailable::Available),
                reported_enumerated_index: Some(21),
                enumerated_index_enable: Some(enable),
                ..Default::default()
            })
        };
        table.take(&mode(EnumIndexEnable::Unavailable));
        assert!(table.lines()[1].ends_with("own 32 RTL; not 21"));
        table.take(&mode(EnumIndexEnable::Available));
        assert!(table.lines()[1].ends_with("own 32 RTL"));
    }

    #[test]
    fn a_value_that_another_has_set_is_shown_beside_its_bounds() {
        let mut table = ConfigurationTable::default();
        table.take(&Message::from(FieldConfigurationUnsignedResponse {
            requested_message: Some(2017),
            requested_field: Some(3),
            field_supported: Some(FieldSupported::Supported),
            help_text: Some(Text::new("m")),
            ..Default::default()
        }));
        table.take(&Message::from(FieldChangeIntegerCommand {
            requested_message: Some(2017),
            requested_field: Some(3),
            commanded_value: Some(40),
            ..Default::default()
        }));
        assert!(
            table.lines()[1].ends_with("m; now 60"),
            "{:?}",
            table.lines()
        );
        assert_eq!(table.objects()[0]["now"], 60.0);
    }

    #[test]
    fn what_is_about_nothing_is_not_kept() {
        let mut table = ConfigurationTable::default();
        for (message, field) in [
            (Some(2016), Some(99)),
            (Some(70_000), Some(1)),
            (None, None),
        ] {
            table.take(&Message::from(MessageParameterAvailability {
                reported_message: message,
                reported_field: field,
                ..Default::default()
            }));
        }
        assert_eq!(table.lines().len(), 1);
        assert!(!table.take(&Message::empty(4000).unwrap()));
    }
}
