//! Whether a message of Edition 4 has its places in messages of Edition 2.5.

use stanag_msgs::ed25::{self, Record};

/// A message that Edition 2.5 cannot express.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("Edition 2.5 cannot say it: {0}")]
pub struct NoCounterpart(pub(super) String);

/// Whether each field with a value has a place in one of these messages.
pub(super) fn all_placed(numbers: &[u16], ed4: &Record) -> Result<(), NoCounterpart> {
    let Some(info) = ed25::record::ed4(ed4.id()) else {
        return Ok(());
    };
    for field in info.fields {
        let number = field.bit + 1;
        let has_value = ed4.number(number).is_some_and(|value| value != 0.0);
        let mut places = ed25::places(ed4.id(), number);
        // Payload stations 17 to 32 share a field with stations 1 to 16.
        let has_place =
            field.name.contains("17-32") || places.any(|(info, _)| numbers.contains(&info.id));
        if (has_value || !ed4.text(number).is_empty()) && !has_place {
            return Err(NoCounterpart(format!("{} of {}", field.name, info.id)));
        }
    }
    Ok(())
}

/// A message without values.
pub(super) fn empty(number: u16) -> Result<Record, NoCounterpart> {
    Record::ed25(number).ok_or_else(|| NoCounterpart(format!("#{number}")))
}
