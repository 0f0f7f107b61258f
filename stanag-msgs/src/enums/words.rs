//! Levels of interoperability (LOI) and flight modes by number and name, as people read them.
//!
//! On the wire levels are bits ([`LoiBitmap`]); a status, a log or a command line shows
//! `2, 4, 5 (monitor, control, launch)`. A mode is a number, and its name in the tables is sometimes a sentence: an alert
//! shows `12 (loiter)`.

use super::{FlightPathControlMode, LoiBitmap};

impl LoiBitmap {
    /// Each level: its bit, its number, what it permits.
    const LEVELS: [(LoiBitmap, u8, &'static str); 4] = [
        (LoiBitmap::LOI2, 2, "monitor"),
        (LoiBitmap::LOI3, 3, "payload"),
        (LoiBitmap::LOI4, 4, "control"),
        (LoiBitmap::LOI5, 5, "launch"),
    ];

    /// Number and name of each level, by rising number. Bits that are not a level are skipped.
    pub fn levels(self) -> impl Iterator<Item = (u8, &'static str)> {
        let within = Self::LEVELS
            .into_iter()
            .filter(move |(bit, _, _)| self.contains(*bit));
        within.map(|(_, number, name)| (number, name))
    }

    /// `2, 4, 5 (monitor, control, launch)`; `none` without a level.
    #[must_use]
    pub fn in_words(self) -> String {
        let numbers: Vec<String> = self
            .levels()
            .map(|(number, _)| number.to_string())
            .collect();
        let names: Vec<&str> = self.levels().map(|(_, name)| name).collect();
        if numbers.is_empty() {
            return "none".to_owned();
        }
        format!("{} ({})", numbers.join(", "), names.join(", "))
    }
}

impl FlightPathControlMode {
    /// `12 (loiter)`: the number, and the name that operators and `cucs mode` use.
    #[must_use]
    pub fn in_words(self) -> String {
        let name = match self {
            Self::FlightDirector => "manual".to_owned(),
            Self::Autopilot => "autopilot".to_owned(),
            Self::AutolandEngage => "land".to_owned(),
            Self::AutolandWaveOff => "wave-off".to_owned(),
            Self::ContingencyA => "contingency A".to_owned(),
            Self::ContingencyB => "contingency B".to_owned(),
            Self::SlaveToLocation => "slave to location".to_owned(),
            // A number of the range that a VSM may define; this project's bridge uses it for the return (AUTO.RTL).
            Self::Unknown(32) => "return".to_owned(),
            Self::Unknown(33..) => "the VSM's own".to_owned(),
            mode => mode.to_string(),
        };
        format!("{} ({name})", self.raw())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_have_numbers_and_names() {
        let words = |bits| LoiBitmap::from_raw(bits).in_words();
        assert_eq!(words(0x0d), "2, 4, 5 (monitor, control, launch)");
        assert_eq!(words(0x02), "3 (payload)");
        assert_eq!(words(0), "none");
        // Bits that are not a level.
        assert_eq!(words(0xf0), "none");
    }

    #[test]
    fn modes_have_numbers_and_names() {
        let words = |raw| FlightPathControlMode::from_raw(raw).in_words();
        assert_eq!(words(12), "12 (loiter)");
        assert_eq!(words(15), "15 (autopilot)");
        assert_eq!(words(32), "32 (return)");
        assert_eq!(words(40), "40 (the VSM's own)");
        // No name is longer than a word or two: an alert has room for 80 characters.
        for raw in 0..=255 {
            assert!(words(raw).len() < 40, "{}", words(raw));
        }
    }
}
