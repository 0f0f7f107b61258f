//! Levels of interoperability (LOI) by number and name, as people read them.
//!
//! On the wire they are bits ([`LoiBitmap`]); a status, a log or a command line shows `2, 4, 5 (monitor, control, launch)`.

use super::LoiBitmap;

impl LoiBitmap {
    /// Each level: its bit, its number, what it allows.
    const LEVELS: [(LoiBitmap, u8, &'static str); 4] = [
        (LoiBitmap::LOI2, 2, "monitor"),
        (LoiBitmap::LOI3, 3, "payload"),
        (LoiBitmap::LOI4, 4, "control"),
        (LoiBitmap::LOI5, 5, "launch"),
    ];

    /// Number and name of each level in it, by rising number. Other bits have none.
    pub fn levels(self) -> impl Iterator<Item = (u8, &'static str)> {
        let within = Self::LEVELS
            .into_iter()
            .filter(move |(bit, _, _)| self.contains(*bit));
        within.map(|(_, number, name)| (number, name))
    }

    /// `2, 4, 5 (monitor, control, launch)`; `none`.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_have_numbers_and_names() {
        let words = |bits| LoiBitmap::from_raw(bits).in_words();
        assert_eq!(words(0x0d), "2, 4, 5 (monitor, control, launch)");
        assert_eq!(words(0x02), "3 (payload)");
        assert_eq!(words(0), "none");
        // Bits that are no level.
        assert_eq!(words(0xf0), "none");
    }
}
