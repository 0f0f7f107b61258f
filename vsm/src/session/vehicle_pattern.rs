//! Chooses vehicles by their ids and tail numbers: for `vsm status --vehicle` and /status.json.

use std::str::FromStr;

/// A part of an id or tail number, or with `*`, which is any text, the whole of one. Of either case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VehiclePattern(String);

impl FromStr for VehiclePattern {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<VehiclePattern, Self::Err> {
        match text.trim() {
            "" => Err(
                "expected a part of an id or tail number, or the whole of it with * for any text",
            ),
            text => Ok(VehiclePattern(text.to_lowercase())),
        }
    }
}

impl VehiclePattern {
    /// Its text, in lower case.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether a vehicle of this id and tail number is one of those that it chooses.
    #[must_use]
    pub fn matches(&self, id: &str, tail_number: &str) -> bool {
        let mut names = [id, tail_number].into_iter();
        names.any(|name| self.matches_name(&name.to_lowercase()))
    }

    fn matches_name(&self, name: &str) -> bool {
        let Some((first, rest)) = self.0.split_once('*') else {
            return name.contains(&self.0);
        };
        // Whatever follows an asterisk is found as early as possible, but for the end, which is at the end.
        let (between, last) = rest.rsplit_once('*').unwrap_or(("", rest));
        let Some(mut left) = name.strip_prefix(first) else {
            return false;
        };
        for part in between.split('*') {
            match left.split_once(part) {
                Some((_, behind)) => left = behind,
                None => return false,
            }
        }
        left.ends_with(last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_is_a_part_of_a_name_or_with_asterisks_the_whole() {
        for (pattern, matches) in [
            ("uav", true),
            ("01:0a", true),
            ("UAV-10", true),
            ("UAV-1", true),
            ("UAV-2", false),
            ("uav-*", true),
            ("*10", true),
            ("*1*", true),
            ("U*V*0", true),
            ("*", true),
            ("uav", true),
            ("10*", false),
            ("*uav", false),
            ("uav-10*0", false),
            ("1b:*:0A", true),
        ] {
            let pattern: VehiclePattern = pattern.parse().expect("a pattern");
            assert_eq!(
                pattern.matches("1b:00:01:0a", "UAV-10"),
                matches,
                "{pattern:?}"
            );
        }
        for empty in ["", "  "] {
            assert!(empty.parse::<VehiclePattern>().is_err());
        }
    }
}
