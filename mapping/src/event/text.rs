//! A message of the definitions with its arguments: `{2:.1m_v}` is the second one with one decimal and a unit, `\{` a brace,
//! `<param>` and other marks are left out.

use mavlink_link::service::text::one_line;

/// A value of an event.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Argument {
    Whole(i128),
    Real(f64),
    /// What an enumeration names it.
    Named(String),
}

/// The packed arguments, taken one after the other.
pub(super) struct Values<'a>(&'a [u8]);

impl<'a> Values<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// The next one, of this basic type; `None` for another type, or beyond the end.
    pub(super) fn take(&mut self, kind: &str) -> Option<Argument> {
        let whole = |value: i128| Some(Argument::Whole(value));
        match kind {
            "uint8_t" => whole(u8::from_le_bytes(self.bytes()?).into()),
            "int8_t" => whole(i8::from_le_bytes(self.bytes()?).into()),
            "uint16_t" => whole(u16::from_le_bytes(self.bytes()?).into()),
            "int16_t" => whole(i16::from_le_bytes(self.bytes()?).into()),
            "uint32_t" => whole(u32::from_le_bytes(self.bytes()?).into()),
            "int32_t" => whole(i32::from_le_bytes(self.bytes()?).into()),
            "uint64_t" => whole(u64::from_le_bytes(self.bytes()?).into()),
            "int64_t" => whole(i64::from_le_bytes(self.bytes()?).into()),
            "float" => Some(Argument::Real(f32::from_le_bytes(self.bytes()?).into())),
            _ => None,
        }
    }

    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }
}

/// The message as one line for operators, at most [`MAX_TEXT`] characters.
pub(super) fn sentence(message: &str, arguments: &[Argument]) -> String {
    let mut out = String::new();
    let mut rest = message.chars();
    // Bounded while it grows: a message of nothing but arguments is as long as all their texts.
    while out.len() < MAX_BYTES
        && let Some(c) = rest.next()
    {
        match c {
            '\\' => out.extend(rest.next()),
            '{' => {
                let inside: String = rest.by_ref().take_while(|c| *c != '}').collect();
                out.push_str(&argument(&inside, arguments));
            }
            '<' => rest.by_ref().take_while(|c| *c != '>').for_each(drop),
            c => out.push(c),
        }
    }
    // The names of an enumeration are the vehicle's own texts too.
    let out = one_line(&out);
    out.trim().chars().take(MAX_TEXT).collect()
}

/// `INDEX[:.DIGITS][UNIT]`.
fn argument(form: &str, arguments: &[Argument]) -> String {
    let digits = |c: char| c.is_ascii_digit();
    let (index, form) = form.split_at(form.find(|c| !digits(c)).unwrap_or(form.len()));
    let known = index
        .parse::<usize>()
        .ok()
        .and_then(|index| index.checked_sub(1));
    let Some(value) = known.and_then(|index| arguments.get(index)) else {
        return "?".to_owned();
    };
    let form = form.strip_prefix(':').unwrap_or(form);
    let (decimals, unit) = match form.strip_prefix('.') {
        Some(form) => form.split_at(form.find(|c| !digits(c)).unwrap_or(form.len())),
        None => ("", form),
    };
    let value = match value {
        Argument::Whole(value) => value.to_string(),
        Argument::Named(text) => text.clone(),
        Argument::Real(value) => match decimals.parse::<usize>() {
            Ok(decimals) => format!("{value:.*}", decimals.min(9)),
            // As short as the float that it was.
            Err(_) => (*value as f32).to_string(),
        },
    };
    match unit {
        "" => value,
        "m_v" => format!("{value} m"),
        unit => format!("{value} {unit}"),
    }
}

/// PX4's longest has 111 characters without arguments.
pub(super) const MAX_TEXT: usize = crate::alert::MAX_TEXT;
/// As many characters, of four bytes each.
const MAX_BYTES: usize = 4 * MAX_TEXT;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_message_and_no_argument_is_too_odd_for_a_text() {
        let arguments = [Argument::Real(f64::NAN), Argument::Whole(-7)];
        for (message, text) in [
            ("{1:.1m} {2}", "NaN m -7"),
            ("{3} {0} {} {x", "? ? ? ?"),
            ("100 {2}% \\\\ \\<a\\>", "100 -7% \\ <a>"),
            ("open <a href=\"x", "open"),
            ("tab\there\\", "tab here"),
            ("{2:.99999999999999999999C}", "-7 C"),
        ] {
            assert_eq!(sentence(message, &arguments), text);
        }
        assert_eq!(sentence(&"ä".repeat(10_000), &[]).chars().count(), MAX_TEXT);
        // All of it would have 100 GB.
        let long = [Argument::Named("x".repeat(1_000_000))];
        assert_eq!(sentence(&"{1}".repeat(100_000), &long).len(), MAX_TEXT);
        let named = [Argument::Named("a\nERROR \u{202e}b".to_owned())];
        assert_eq!(
            sentence("is {1}\r\u{2028}now", &named),
            "is a ERROR  b  now"
        );
        let mut values = Values::new(&[1, 2, 3]);
        assert_eq!(values.take("uint16_t"), Some(Argument::Whole(513)));
        assert_eq!(values.take("uint32_t"), None);
        assert_eq!(values.take("double"), None);
    }
}
