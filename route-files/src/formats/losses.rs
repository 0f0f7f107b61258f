//! What of a file was not taken: one list for every format, both ways, so that nothing is lost in silence.
//!
//! A reader adds what it cannot represent, a writer what its format cannot hold. Whoever reads for somebody prints
//! [`Losses::summary`] on standard error and [`Losses::to_json`] where JSON was requested, and with `--strict` makes an
//! error of it before anything is written or sent.

use std::collections::BTreeSet;
use std::fmt;
use std::io::Write as _;

use serde_json::{Value, json};

use super::fault::FormatError;

/// Something that was not taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loss {
    /// What, with its value and its unit: `speed 6 m/s`.
    pub what: String,
    /// The item of the file that it belongs to; `None` for the file as a whole.
    pub item: Option<usize>,
}

/// How many items a file has, and what of it was not taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Losses {
    /// What the file calls an item: item, waypoint, point.
    pub unit: &'static str,
    /// Items of the file.
    pub items: usize,
    /// What was lost, in the order in which it was found.
    pub lost: Vec<Loss>,
    /// What was not taken and is no loss: what a program writes into every file, and nothing is flown by.
    pub notes: Vec<String>,
}

impl Default for Losses {
    fn default() -> Self {
        Self::of("point")
    }
}

impl Losses {
    /// None yet, of a file whose items have this name.
    #[must_use]
    pub const fn of(unit: &'static str) -> Self {
        Self {
            unit,
            items: 0,
            lost: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Something of an item was lost.
    pub fn add(&mut self, item: usize, what: impl Into<String>) {
        self.lost.push(Loss {
            what: what.into(),
            item: Some(item),
        });
    }

    /// Something of the file was lost that is not an item of the route.
    pub fn add_whole(&mut self, what: impl Into<String>) {
        self.lost.push(Loss {
            what: what.into(),
            item: None,
        });
    }

    /// Something was not taken that nobody misses.
    pub fn note(&mut self, what: impl Into<String>) {
        self.notes.push(what.into());
    }

    /// Items of which nothing was lost.
    #[must_use]
    pub fn taken(&self) -> usize {
        let touched: BTreeSet<usize> = self.lost.iter().filter_map(|loss| loss.item).collect();
        self.items.saturating_sub(touched.len())
    }

    /// `5 of 7 items taken; lost: speed 6 m/s at item 3`; `None` where nothing was lost.
    #[must_use]
    pub fn summary(&self) -> Option<String> {
        (!self.lost.is_empty()).then(|| self.to_string())
    }

    /// Prints what was lost of a file on standard error, and the notes.
    ///
    /// # Errors
    /// Something was lost, and nothing may be.
    pub fn report(&self, file: &str, strict: bool) -> Result<(), FormatError> {
        let summary = self.summary();
        if let (Some(summary), true) = (&summary, strict) {
            return Err(FormatError::Lost(format!("{file}: {summary}")));
        }
        for line in summary.iter().chain(&self.notes) {
            // Nothing is left to do when standard error is closed.
            let _ = writeln!(std::io::stderr(), "{file}: {line}");
        }
        Ok(())
    }

    /// `{"items": 7, "taken": 5, "lost": [{"what": "speed 6 m/s", "item": 3}], "notes": []}`.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let lost = self.lost.iter();
        let lost: Vec<Value> = lost
            .map(|loss| json!({ "what": loss.what, "item": loss.item }))
            .collect();
        json!({ "items": self.items, "taken": self.taken(), "lost": lost, "notes": self.notes })
    }
}

impl fmt::Display for Losses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.items == 1 { "" } else { "s" };
        let (taken, items, unit) = (self.taken(), self.items, self.unit);
        write!(f, "{taken} of {items} {unit}{plural} taken; lost: ")?;
        for (k, loss) in self.lost.iter().take(MAX_NAMED).enumerate() {
            f.write_str(if k == 0 { "" } else { ", " })?;
            f.write_str(&loss.what)?;
            if let Some(item) = loss.item {
                write!(f, " at {unit} {item}")?;
            }
        }
        match self.lost.len().saturating_sub(MAX_NAMED) {
            0 => Ok(()),
            more => write!(f, ", and {more} more (--json lists all)"),
        }
    }
}

/// `1 area`, `2 areas`.
pub(super) fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// How many points.
pub(super) fn points(count: usize) -> String {
    counted(count, "point", "points")
}

/// A text names so many: a survey has hundreds of camera triggers.
const MAX_NAMED: usize = 20;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_item_that_lost_two_things_is_one_item_not_taken() {
        let mut losses = Losses::of("item");
        losses.items = 7;
        assert_eq!((losses.taken(), losses.summary()), (7, None));
        losses.add(3, "speed 6 m/s");
        losses.add(3, "heading 90 degrees");
        losses.add(7, "return to launch");
        losses.add_whole("1 rally point");
        assert_eq!(
            losses.to_string(),
            "5 of 7 items taken; lost: speed 6 m/s at item 3, heading 90 degrees at item 3, \
             return to launch at item 7, 1 rally point"
        );
        let json = losses.to_json();
        assert_eq!((&json["items"], &json["taken"]), (&json!(7), &json!(5)));
        assert_eq!(
            json["lost"][2],
            json!({ "what": "return to launch", "item": 7 })
        );
        assert_eq!(json["lost"][3]["item"], Value::Null);
    }
}
