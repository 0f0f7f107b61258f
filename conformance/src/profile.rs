//! What the subject claims: the profile, one TOML file, the counterpart of a PICS and PIXIT (ISO/IEC 9646).
//!
//! Everything has a default, so that a run without a profile judges what a discovery shows. What a profile does not
//! claim is not applicable; what it claims and is missing is a fail. A profile never releases hazards on a real
//! vehicle: it can only state that the vehicle is simulated.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

/// A profile.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Profile {
    /// Who is judged.
    pub subject: SubjectClaims,
    /// CUCS ids that the subject knows, with what it lets them have.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cucs: Vec<CucsClaims>,
    /// Vehicles behind the subject.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub vehicle: Vec<VehicleClaims>,
    /// Shell commands that change the subject's surroundings.
    pub means: Means,
    /// Timers in seconds, by their names in the catalogue, and `factor` for all of them.
    pub timers: BTreeMap<String, f64>,
    /// Readings of disputed points, by the keys of the support table.
    pub readings: BTreeMap<String, String>,
    /// Figures of the subject.
    pub figures: Figures,
    /// Shell commands for the steps of a CUCS under test, by the id of the step; `start` plays the CUCS in the background.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub on: BTreeMap<String, String>,
}

/// Who is judged, and how it is reached.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct SubjectClaims {
    /// Its name, for the report.
    pub name: String,
    /// Its version, for the report.
    pub version: String,
    /// Where it listens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub address: Option<String>,
    /// Edition of the interface: "2.5", "3" or "4".
    pub edition: String,
    /// Checksum style of what the suite sends, 0 to 3.
    pub checksum: u8,
    /// Whether the subject may send without a checksum even to a CUCS that sends one.
    pub unsummed: bool,
    /// Its VSM id, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vsm_id: Option<String>,
    /// Sets of rules that are claimed; empty claims all but `project`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sets: Vec<String>,
    /// Whether this project's own contract is judged, the set `project`.
    pub project: bool,
}

impl Default for SubjectClaims {
    fn default() -> Self {
        Self {
            name: String::new(),
            version: String::new(),
            address: None,
            edition: "4".into(),
            checksum: 1,
            unsummed: true,
            vsm_id: None,
            sets: Vec::new(),
            project: true,
        }
    }
}

/// A CUCS id that the subject knows.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CucsClaims {
    /// `1b:00:00:a0`.
    pub id: String,
    /// Levels that it may have; absent where a discovery will show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loi: Option<Vec<u8>>,
    /// Whether it may take control from another.
    #[serde(default, rename = "override")]
    pub overrides: bool,
}

/// A vehicle behind the subject.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleClaims {
    /// `1b:00:01:01`.
    pub id: String,
    /// Whether the vehicle is simulated, so that nothing real can move.
    pub simulated: bool,
    /// Latitude and longitude in degrees of where it stands, to judge angles by.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    /// Height of that place above mean sea level in metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amsl_m: Option<f64>,
    /// Height of the geoid above the ellipsoid there, in metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geoid_m: Option<f64>,
    /// Its tail number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tail_number: Option<String>,
    /// Payload stations, 1 to 32; absent where 21000 will show them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stations: Option<Vec<u8>>,
}

/// Shell commands by which the suite changes the surroundings of the subject.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Means {
    /// Kills the subject and starts it again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restart: Option<String>,
    /// Cuts the link between subject and vehicle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_vehicle_link: Option<String>,
    /// Restores it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restore_vehicle_link: Option<String>,
    /// Drives the vehicle's energy level below the caution limit that the configuration declares.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lower_energy: Option<String>,
    /// Restores it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restore_energy: Option<String>,
}

/// Figures of the subject.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Figures {
    /// The largest rate of 17001 that it keeps, in Hz.
    pub largest_rate_hz: u16,
    /// How much faster than real time the simulated vehicle is.
    pub speed_factor: f64,
    /// Messages a second of the load rules.
    pub load_per_s: u32,
    /// Seconds without heartbeats after which control is offered.
    pub offer_s: f64,
    /// Seconds without heartbeats after which control is taken.
    pub act_s: f64,
    /// Seconds after which a handover fails to which nobody consents.
    pub handover_s: f64,
    /// What a vehicle in flight does when its controlling CUCS is lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_loss: Option<OnLoss>,
}

/// What is provisioned for the loss of the controlling CUCS.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OnLoss {
    /// It continues what it does.
    Continue,
    /// It loiters where it is.
    Hold,
    /// It flies a contingency route.
    Contingency,
    /// It returns to where it was launched.
    Return,
}

impl Default for Figures {
    fn default() -> Self {
        Self {
            largest_rate_hz: 10,
            speed_factor: 1.0,
            load_per_s: 100,
            offer_s: 5.0,
            act_s: 10.0,
            handover_s: 20.0,
            on_loss: None,
        }
    }
}

/// Why a profile cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// It cannot be read.
    #[error("profile {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// It is not a profile.
    #[error("profile {path}: {source}")]
    Form {
        /// The file.
        path: String,
        /// Where and why.
        source: Box<toml::de::Error>,
    },
    /// A value cannot be used.
    #[error("profile: {key} is {found:?}, expected {expected}")]
    Value {
        /// The key.
        key: String,
        /// Its value.
        found: String,
        /// What was expected.
        expected: String,
    },
}

impl Profile {
    /// Reads and checks a profile.
    ///
    /// # Errors
    /// It cannot be read, has unknown keys, or a value that cannot be used.
    pub fn read(path: &Path) -> Result<Self, ProfileError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| ProfileError::Read {
            path: name.clone(),
            source,
        })?;
        let profile: Self = toml::from_str(&text).map_err(|source| ProfileError::Form {
            path: name,
            source: Box::new(source),
        })?;
        profile.check()?;
        Ok(profile)
    }

    /// Checks what the types of the file cannot.
    ///
    /// # Errors
    /// The first value that cannot be used.
    pub fn check(&self) -> Result<(), ProfileError> {
        let value = |key: &str, found: &str, expected: &str| ProfileError::Value {
            key: key.to_owned(),
            found: found.to_owned(),
            expected: expected.to_owned(),
        };
        if !["2.5", "3", "4"].contains(&self.subject.edition.as_str()) {
            let expected = "\"2.5\", \"3\" or \"4\"";
            return Err(value("subject.edition", &self.subject.edition, expected));
        }
        if self.subject.checksum > 3 {
            return Err(value(
                "subject.checksum",
                &self.subject.checksum.to_string(),
                "0 to 3",
            ));
        }
        let ids = self.cucs.iter().map(|cucs| ("cucs.id", &cucs.id));
        let vehicles = self
            .vehicle
            .iter()
            .map(|vehicle| ("vehicle.id", &vehicle.id));
        for (key, id) in ids.chain(vehicles) {
            id.parse::<Id>()
                .map_err(|error| value(key, id, &error.to_string()))?;
        }
        let names = [
            "answer", "ack", "quiet", "status", "move", "flight", "load", "config", "factor",
        ];
        for (name, &seconds) in &self.timers {
            if !names.contains(&name.as_str()) || !seconds.is_finite() || seconds <= 0.0 {
                let expected = format!("one of {} with a positive number", names.join(", "));
                return Err(value(
                    &format!("timers.{name}"),
                    &seconds.to_string(),
                    &expected,
                ));
            }
        }
        for (name, reading) in &self.readings {
            stanag_msgs::Profile::default()
                .set(name, reading)
                .map_err(|error| value(&format!("readings.{name}"), reading, &error.to_string()))?;
        }
        Ok(())
    }

    /// The version of the interface in headers.
    #[must_use]
    pub fn idd(&self) -> u8 {
        if self.subject.edition == "3" { 30 } else { 32 }
    }

    /// Whether the profile claims that all vehicles are simulated.
    #[must_use]
    pub fn simulated(&self) -> bool {
        !self.vehicle.is_empty() && self.vehicle.iter().all(|vehicle| vehicle.simulated)
    }

    /// The commented profile that `dli-check init` begins with.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_profile_is_a_profile() {
        let profile: Profile = toml::from_str("").unwrap();
        profile.check().unwrap();
        assert_eq!(profile.idd(), 32);
        assert!(!profile.simulated());
    }

    #[test]
    fn what_it_writes_it_reads() {
        let mut profile = Profile::default();
        profile.vehicle.push(VehicleClaims {
            id: "1b:00:01:01".into(),
            simulated: true,
            ..Default::default()
        });
        let again: Profile = toml::from_str(&profile.to_toml()).unwrap();
        assert!(again.simulated());
    }

    #[test]
    fn unknown_keys_and_values_are_refused() {
        assert!(toml::from_str::<Profile>("[subject]\nspeed = 3").is_err());
        let profile: Profile = toml::from_str("[timers]\nanswr = 3.0").unwrap();
        assert!(
            profile
                .check()
                .unwrap_err()
                .to_string()
                .contains("timers.answr")
        );
        let profile: Profile = toml::from_str("[subject]\nedition = \"2\"").unwrap();
        assert!(profile.check().unwrap_err().to_string().contains("edition"));
    }
}
