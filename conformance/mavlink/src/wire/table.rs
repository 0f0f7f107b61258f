//! The messages that the suite knows: `messages.txt`, embedded.

use std::collections::BTreeMap;
use std::sync::OnceLock;

/// A message of the dialect.
#[derive(Clone, Debug)]
pub struct Message {
    /// Its id.
    pub id: u32,
    /// Its name, as the dialect has it.
    pub name: &'static str,
    /// What the checksum ends with.
    pub crc_extra: u8,
    /// Its fields, in the order of the wire.
    pub fields: Vec<Field>,
    /// Bytes with extensions.
    pub length: usize,
    /// Bytes without extensions.
    pub base_length: usize,
}

/// A field.
#[derive(Clone, Debug)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Where it begins.
    pub offset: usize,
    /// Bytes of one element.
    pub size: usize,
    /// Elements; 1 for a plain field.
    pub count: usize,
    /// How an element reads.
    pub kind: Kind,
}

/// How an element reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Without a sign.
    Unsigned,
    /// With a sign.
    Signed,
    /// IEEE 754.
    Float,
    /// A byte of a text.
    Text,
}

/// The message of this id.
#[must_use]
pub fn by_id(id: u32) -> Option<&'static Message> {
    table().get(&id)
}

/// The message of this name.
#[must_use]
pub fn by_name(name: &str) -> Option<&'static Message> {
    table().values().find(|message| message.name == name)
}

impl Message {
    /// The field of this name.
    #[must_use]
    pub fn field(&self, name: &str) -> Option<&Field> {
        self.fields.iter().find(|field| field.name == name)
    }
}

fn table() -> &'static BTreeMap<u32, Message> {
    static TABLE: OnceLock<BTreeMap<u32, Message>> = OnceLock::new();
    TABLE.get_or_init(|| {
        include_str!("../../messages.txt")
            .lines()
            .filter_map(parse)
            .map(|message| (message.id, message))
            .collect()
    })
}

fn parse(line: &'static str) -> Option<Message> {
    let mut words = line.split(' ');
    let id = words.next()?.parse().ok()?;
    let name = words.next()?;
    let crc_extra = words.next()?.parse().ok()?;
    let (mut fields, mut length, mut base) = (Vec::new(), 0, None);
    for word in words {
        if word == "|" {
            base = Some(length);
            continue;
        }
        let (name, of) = word.split_once(':')?;
        let (of, count) = match of.split_once('[') {
            Some((of, count)) => (of, count.trim_end_matches(']').parse().ok()?),
            None => (of, 1),
        };
        let (kind, size) = match of {
            "char" => (Kind::Text, 1),
            _ => (
                match of.as_bytes().first()? {
                    b'u' => Kind::Unsigned,
                    b'i' => Kind::Signed,
                    _ => Kind::Float,
                },
                of[1..].parse::<usize>().ok()? / 8,
            ),
        };
        fields.push(Field {
            name,
            offset: length,
            size,
            count,
            kind,
        });
        length += size * count;
    }
    Some(Message {
        id,
        name,
        crc_extra,
        fields,
        length,
        base_length: base.unwrap_or(length),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_a_message_and_lengths_are_the_dialects() {
        let lines = include_str!("../../messages.txt").lines().count() - 1;
        assert_eq!(table().len(), lines);
        // Lengths as the dialect's generated headers have them.
        for (name, length, base) in [
            ("HEARTBEAT", 9, 9),
            ("COMMAND_LONG", 33, 33),
            ("COMMAND_ACK", 10, 3),
            ("MISSION_ITEM_INT", 38, 37),
            ("PARAM_VALUE", 25, 25),
            ("STATUSTEXT", 54, 51),
            ("SETUP_SIGNING", 42, 42),
            ("TIMESYNC", 18, 16),
        ] {
            let message = by_name(name).expect(name);
            assert_eq!(
                (message.length, message.base_length),
                (length, base),
                "{name}"
            );
        }
    }
}
