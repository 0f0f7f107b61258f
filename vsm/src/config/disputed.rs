//! `[dli.disputed]`: a peer's reading of what the sources leave open, where it differs from this project's; `disputed` of a
//! `[[cucs]]` is the same for one station, and overrides `[dli.disputed]`.

use std::fmt;

use mapping::mode::{MODES, UNKNOWN_MODE};
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use stanag_msgs::Profile;
use stanag_msgs::disputed::DISPUTED;

use super::key::{Key, WhenAbsent};

/// The readings in force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Readings {
    /// What translates between the wire and this project's values.
    pub profile: Profile,
    set: Vec<(String, String)>,
}

impl Readings {
    pub(super) const KEYS: &'static [Key] = &[Key {
        name: "NAME",
        absent: WhenAbsent::Nothing("this project's"),
        meaning: &[
            "How peers read what the sources leave open: names and choices in [dli/disputed.md](dli/disputed.md), listed by \
             `vsm check-config`",
        ],
    }];

    pub(super) const OF_STATION: &'static [Key] = &[Key {
        name: "NAME",
        absent: WhenAbsent::Nothing("`dli.disputed.NAME`"),
        meaning: &["How this station reads it: names and choices as in `dli.disputed`"],
    }];

    /// The readings of one station, where it sets `own` and these are for all.
    #[must_use]
    pub fn with(&self, own: &Readings) -> Readings {
        let mut readings = self.clone();
        for (name, reading) in &own.set {
            // They were checked when they were parsed.
            let _ = readings.profile.set(name, reading);
            readings.set.retain(|(known, _)| known != name);
            readings.set.push((name.clone(), reading.clone()));
        }
        readings
    }

    /// What the file sets, by name.
    pub fn set(&self) -> impl Iterator<Item = (&str, &str)> {
        let pairs = self.set.iter();
        pairs.map(|(name, reading)| (name.as_str(), reading.as_str()))
    }

    /// Every open question, the reading in force, and whether the file has set it.
    pub fn all(&self) -> impl Iterator<Item = (&'static str, &str, bool)> {
        DISPUTED.iter().map(|disputed| {
            let set = self.set.iter().find(|(name, _)| name == disputed.name);
            match set {
                Some((_, reading)) => (disputed.name, reading.as_str(), true),
                None => (disputed.name, disputed.default, false),
            }
        })
    }
}

impl<'de> Deserialize<'de> for Readings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Table;
        impl<'de> Visitor<'de> for Table {
            type Value = Readings;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table of readings, each a text, such as checksum_1 = \"sum\"")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Readings, A::Error> {
                let mut readings = Readings::default();
                while let Some((name, reading)) = map.next_entry::<String, String>()? {
                    readings
                        .profile
                        .set(&name, &reading)
                        .map_err(A::Error::custom)?;
                    check_modes(&name, &reading).map_err(A::Error::custom)?;
                    readings.set.push((name, reading));
                }
                Ok(readings)
            }
        }
        deserializer.deserialize_map(Table)
    }
}

/// Refuses numbers of modes under which 3001 and 41002 report modes of PX4: a CUCS would take one for the other.
fn check_modes(name: &str, reading: &str) -> Result<(), String> {
    if name != "contingency_modes" {
        return Ok(());
    }
    let values = reading
        .split(',')
        .filter_map(|one| one.trim().parse::<u8>().ok());
    for value in values {
        let reported = MODES.iter().find(|(_, mode, _)| *mode == value);
        let meaning = match reported {
            Some((_, _, px4)) => *px4,
            None if value == UNKNOWN_MODE => "an unknown mode",
            None => continue,
        };
        return Err(format!(
            "{name}: found {value}, under which this VSM reports {meaning} (3001), expected numbers from 23 up that it does not \
             report, such as 26,27,28"
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::config::Config;

    fn parse(disputed: &str) -> Result<Config, String> {
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:4586\"\n\
             [dli.disputed]\n{disputed}\n[store]\ndir = \"state\"\n"
        );
        Config::parse(&text, Path::new("")).map_err(|fault| fault.to_string())
    }

    #[test]
    fn readings_are_kept_and_the_rest_is_the_default() {
        let config = parse("turn_rate_step = \"0.005\"\nack_type = \"0,1,2\"").unwrap();
        let all: Vec<_> = config.dli.disputed.all().collect();
        assert!(all.contains(&("turn_rate_step", "0.005", true)));
        assert!(all.contains(&("ack_type", "0,1,2", true)));
        assert!(all.contains(&("checksum_1", "sum", false)));
        assert_ne!(config.dli.disputed.profile, stanag_msgs::Profile::default());
        let none = parse("").unwrap();
        assert_eq!(none.dli.disputed.profile, stanag_msgs::Profile::default());
    }

    #[test]
    fn what_is_no_reading_is_refused_with_what_was_expected() {
        let fault = parse("checksum_1 = \"x\"").unwrap_err();
        assert!(
            fault.contains("checksum_1") && fault.contains("sum or crc16"),
            "{fault}"
        );
        // Settled by Edition 2.5: a file that names the value that applies anyway is accepted.
        assert!(parse("loi_bits = \"ed2\"").is_ok());
        let fault = parse("loi_bits = \"m\"").unwrap_err();
        assert!(fault.contains("settled"), "{fault}");
        let fault = parse("loi = \"m\"").unwrap_err();
        assert!(fault.contains("no such entry"), "{fault}");
        assert!(parse("checksum_1 = 3").is_err());
        let fault = parse("contingency_modes = \"11,12,13\"").unwrap_err();
        for part in ["contingency_modes", "11,12,13", "values 23 to 255"] {
            assert!(fault.contains(part), "{part}: {fault}");
        }
        // Modes of PX4 that 3001 reports.
        for (reading, part) in [
            (
                "30,31,32",
                "found 32, under which this VSM reports AUTO.RTL",
            ),
            (
                "41, 42, 43",
                "found 42, under which this VSM reports TERMINATION",
            ),
            (
                "255,26,27",
                "found 255, under which this VSM reports an unknown",
            ),
        ] {
            let fault = parse(&format!("contingency_modes = \"{reading}\"")).unwrap_err();
            assert!(fault.contains(part), "{fault}");
        }
        for reading in ["23,24,25", "26, 27, 28", "41,60,254"] {
            assert!(parse(&format!("contingency_modes = \"{reading}\"")).is_ok());
        }
        assert!(parse("ack_type = \"1,1,2\"").is_err());
    }
}
