//! The vehicle's own metadata of its parameters: names, units, ranges, decimals and short descriptions.
//!
//! The file belongs to the firmware that runs, unlike the table of [`crate::parameter`], which is that of PX4 v1.18;
//! it is found and unpacked like that of the events ([`crate::event`]). An invalid entry is left out, and never
//! replaced by a guess.

use std::collections::BTreeMap;

use mavlink_link::service::text::one_line;
use serde::{Deserialize, Deserializer};
use stanag_msgs::enums::ParameterKind;

use crate::event::{MetadataError, unpack};
use crate::parameter::{Described, Range};

/// What is known of the parameters of a vehicle, by their names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ParameterMetadata(BTreeMap<String, Described>);

impl ParameterMetadata {
    /// The parameters of a file, packed or not.
    ///
    /// # Errors
    /// It does not unpack, is not of this form, or has more than a vehicle has.
    pub fn read(file: &[u8]) -> Result<Self, MetadataError> {
        let File { parameters } = serde_json::from_slice(&unpack(file)?)?;
        if parameters.len() > MAX_PARAMETERS {
            return Err(MetadataError::TooManyParameters(
                parameters.len(),
                MAX_PARAMETERS,
            ));
        }
        let all = parameters.into_iter().filter_map(Entry::described);
        Ok(Self(all.collect()))
    }

    /// How many parameters it describes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether it describes none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// One of them.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Described> {
        self.0.get(name)
    }

    /// Their names, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

/// The most parameters of a file: PX4 v1.18 has 1,679.
const MAX_PARAMETERS: usize = 8_000;

#[derive(Deserialize)]
struct File {
    parameters: Vec<Entry>,
}

/// As PX4's build writes it; long descriptions and categories are passed over.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Entry {
    #[serde(deserialize_with = "cut")]
    name: String,
    #[serde(rename = "type", deserialize_with = "cut")]
    kind: String,
    #[serde(default, deserialize_with = "cut")]
    group: String,
    #[serde(default, deserialize_with = "cut")]
    short_desc: String,
    #[serde(default, deserialize_with = "cut")]
    units: String,
    #[serde(default)]
    min: Option<f64>,
    #[serde(default)]
    max: Option<f64>,
    #[serde(default)]
    default: Option<f64>,
    #[serde(default)]
    decimal_places: Option<u8>,
    #[serde(default)]
    values: Vec<Choice>,
    #[serde(default)]
    reboot_required: bool,
}

#[derive(Deserialize)]
struct Choice {
    value: f64,
}

/// Cuts a text to what a help text shows: the sender of the file must not fill the memory.
fn cut<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    let text = String::deserialize(from)?;
    Ok(one_line(&text).chars().take(MAX_TEXT).collect())
}

impl Entry {
    /// `None` where the type is unknown, or the entry contradicts itself.
    fn described(self) -> Option<(String, Described)> {
        let kind = match self.kind.as_str() {
            "Float" => ParameterKind::Float,
            "Int32" => ParameterKind::Integer,
            _ => return None,
        };
        let within = |low: Option<f64>, high: Option<f64>| {
            low.zip(high).is_none_or(|(low, high)| low <= high)
        };
        let whole = |value: &f64| {
            value.fract() == 0.0 && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(value)
        };
        let mut values: Vec<i32> = self
            .values
            .iter()
            .map(|choice| whole(&choice.value).then_some(choice.value as i32))
            .collect::<Option<_>>()?;
        values.sort_unstable();
        if kind == ParameterKind::Float || self.min.or(self.max).is_some() {
            // Named values within a range that is taken as a whole, such as -1 for "off".
            values.clear();
        }
        (within(self.min, self.max) && values.len() <= MAX_VALUES).then_some((
            self.name,
            Described {
                range: Range {
                    kind,
                    low: self.min,
                    high: self.max,
                    values,
                },
                default: self.default,
                unit: self.units,
                short: self.short_desc,
                group: self.group,
                decimals: self.decimal_places.filter(|places| *places <= MAX_DECIMALS),
                restart: self.reboot_required,
            },
        ))
    }
}

/// A help text of 41000 has 79 characters.
const MAX_TEXT: usize = 79;
const MAX_VALUES: usize = 256;
/// A float of 32 bits has no more significant decimals.
const MAX_DECIMALS: u8 = 9;

#[cfg(test)]
mod tests {
    use super::*;

    fn read(entries: &str) -> Result<ParameterMetadata, MetadataError> {
        ParameterMetadata::read(format!(r#"{{"version":1,"parameters":[{entries}]}}"#).as_bytes())
    }

    const CRUISE: &str = r#"{"name":"MPC_XY_CRUISE","type":"Float","group":"Multicopter Position Control",
        "category":"Standard","shortDesc":"Default horizontal velocity","longDesc":"long","units":"m/s",
        "min":3,"max":20,"default":5,"decimalPlaces":0,"increment":1}"#;

    #[test]
    fn a_parameter_has_its_unit_range_and_words() {
        let all = read(CRUISE).expect("the form of PX4");
        let cruise = all.get("MPC_XY_CRUISE").expect("it is there");
        assert_eq!(
            (cruise.range.low, cruise.range.high),
            (Some(3.0), Some(20.0))
        );
        assert_eq!(
            (cruise.unit.as_str(), cruise.default, cruise.decimals),
            ("m/s", Some(5.0), Some(0))
        );
        assert_eq!(cruise.group, "Multicopter Position Control");
        assert!(!cruise.restart);
        let restart = CRUISE.replace("\"min\":3", "\"rebootRequired\":true");
        let restart = read(&restart).expect("the form of PX4");
        assert!(restart.get("MPC_XY_CRUISE").is_some_and(|of| of.restart));
        assert_eq!(all.names().collect::<Vec<_>>(), ["MPC_XY_CRUISE"]);
    }

    #[test]
    fn what_cannot_be_is_left_out_and_not_mended() {
        let turned = CRUISE.replace("\"min\":3", "\"min\":30");
        let odd = CRUISE.replace("Float", "Text");
        let half = r#"{"name":"A","type":"Int32","values":[{"value":0.5,"description":"half"}]}"#;
        let all = read(&[&turned, &odd, half].join(",")).expect("the form of PX4");
        assert!(all.is_empty());
        let plain = read(r#"{"name":"A","type":"Int32"}"#).expect("the form of PX4");
        let plain = &plain.get("A").expect("it is there").range;
        assert_eq!((plain.low, plain.high), (None, None));
        assert!(matches!(
            ParameterMetadata::read(b"{\"parameters\": 7}"),
            Err(MetadataError::Json(_))
        ));
    }

    #[test]
    fn a_file_that_would_fill_the_memory_is_cut_or_refused() {
        let long = CRUISE.replace("Default horizontal velocity", &"x".repeat(1_000_000));
        let long = read(&long).expect("the form of PX4");
        let short = &long.get("MPC_XY_CRUISE").expect("it is there").short;
        assert_eq!(short.len(), MAX_TEXT);
        let one = r#"{"name":"A","type":"Float"}"#;
        let all = vec![one; MAX_PARAMETERS + 1].join(",");
        assert!(matches!(
            read(&all),
            Err(MetadataError::TooManyParameters(count, _)) if count == MAX_PARAMETERS + 1
        ));
        assert!(read(&vec![one; MAX_PARAMETERS].join(",")).is_ok());
    }
}
