//! The reference of the DLI: one page for each group of messages, the enumerations, and what sources leave open.

use std::collections::BTreeMap;
use std::fmt::Write;

use mapping::support;
use stanag_msgs::disputed::{Choices, DISPUTED, SETTLED};
use stanag_msgs::ed25;
use stanag_msgs::enums::{EnumInfo, EnumKind};
use stanag_msgs::table::{FieldInfo, MESSAGES, MessageInfo};

use super::support::{confidence, received, summary};

/// A group of messages: its first and last type, the file of its page, its title.
struct Group {
    first: u16,
    last: u16,
    file: &'static str,
    title: &'static str,
}

const fn group(first: u16, last: u16, file: &'static str, title: &'static str) -> Group {
    Group {
        first,
        last,
        file,
        title,
    }
}

/// The groups that have messages with a known layout.
const GROUPS: &[Group] = &[
    group(0, 1999, "system-id.md", "System identification"),
    group(2000, 2999, "flight-command.md", "Flight vehicle command"),
    group(3000, 3999, "flight-status.md", "Flight vehicle status"),
    group(4000, 4999, "inertial.md", "Payload-relevant vehicle status"),
    group(5000, 6999, "iff.md", "Identification friend or foe"),
    group(7000, 12999, "auxiliary.md", "Vehicle auxiliary status"),
    group(13000, 14999, "mission.md", "Mission"),
    group(15000, 16999, "subsystem.md", "Subsystem status"),
    group(17000, 18999, "miscellaneous.md", "Miscellaneous"),
    group(19000, 25999, "payload.md", "Payload"),
    group(26000, 39999, "data-link.md", "Data link"),
    group(
        40000,
        41999,
        "configuration.md",
        "Configuration before connection",
    ),
    group(
        42000,
        49999,
        "services.md",
        "Configuration after connection, forced commands",
    ),
    group(
        50000,
        65000,
        "private.md",
        "Private messages of this project",
    ),
];

/// The file and heading of a message's description, for a link.
pub(super) fn place(message: &MessageInfo) -> String {
    let file = GROUPS
        .iter()
        .find(|group| (group.first..=group.last).contains(&message.id))
        .map_or("README.md", |group| group.file);
    format!("{file}#{}", anchor(&heading(message)))
}

/// All pages: file name and text.
pub(super) fn pages() -> Vec<(String, String)> {
    let mut pages = vec![
        ("README.md".to_owned(), index()),
        (
            "enumerations.md".to_owned(),
            enumerations_page(Edition::Later),
        ),
        ("edition-2.5.md".to_owned(), ed25_page()),
        (
            "edition-2.5-values.md".to_owned(),
            enumerations_page(Edition::Ed25),
        ),
        ("disputed.md".to_owned(), disputed()),
    ];
    pages.extend(
        GROUPS
            .iter()
            .map(|group| (group.file.to_owned(), page(group))),
    );
    pages
}

fn index() -> String {
    let mut page = format!(
        "# The DLI messages\n\n{GENERATED}\n\n\
         Layouts of STANAG 4586 Edition 4 (AEP-84 Vol II) as far as public secondary sources give them, and the private\n\
         messages of this project. [What this VSM does with them](../support.md), [the values](enumerations.md),\n\
         [what sources leave open](disputed.md). [Edition 2.5](edition-2.5.md) is apart, from its public text.\n\n| types | group | messages |\n|---|---|---|\n"
    );
    for group in GROUPS {
        let names: Vec<String> = messages(group)
            .map(|message| format!("[{}]({})", message.id, place(message)))
            .collect();
        let _ = writeln!(
            page,
            "| {} to {} | [{}]({}) | {} |",
            group.first,
            group.last,
            group.title,
            group.file,
            names.join(" ")
        );
    }
    page
}

fn messages(group: &Group) -> impl Iterator<Item = &'static MessageInfo> {
    let types = group.first..=group.last;
    MESSAGES
        .iter()
        .filter(move |message| types.contains(&message.id))
}

fn page(group: &Group) -> String {
    let mut page = format!("# {}\n\n{GENERATED}\n", group.title);
    for message in messages(group) {
        page.push_str(&self::message(message));
    }
    page
}

fn message(message: &MessageInfo) -> String {
    let mut text = format!("\n## {}\n\n", heading(message));
    let _ = write!(
        text,
        "{}, {}. Presence vector of {} bytes, {} fields, {} bytes in full.",
        message.direction.text(),
        message.traffic.text(),
        message.presence_bytes,
        message.fields.len(),
        message.full_bytes(),
    );
    if let Some(latency_ms) = message.latency_ms {
        let _ = write!(text, " Latency at most {latency_ms} ms (advisory).");
    }
    if support::provisional(message) {
        text.push_str(" **Layout derived from Edition 2: provisional.**");
    }
    let _ = write!(
        text,
        "\n\nSource: {}; confidence {}; corroboration: {}.",
        escaped(message.source),
        message.confidence.letter(),
        escaped(message.corroboration),
    );
    if let Some(ed2) = message.ed2_message {
        let _ = write!(text, " Edition 2: message {ed2}.");
    }
    if let Some(note) = message.note {
        let _ = write!(text, " Note: {}.", escaped(note));
    }
    let (taken, sends) = summary(message, support::message(message.id));
    let _ = writeln!(text, "\n\nThis VSM: from a CUCS {taken}; sent {sends}.\n");
    text.push_str("| field | id | name | type | step, unit | values | confidence | from a CUCS | sent |\n|---|---|---|---|---|---|---|---|---|\n");
    for field in message.fields {
        let does = support::field(message, field);
        let _ = writeln!(
            text,
            "| {}.{:02} | {} | {}{} | {} | {} | {} | {} | {} | {} |",
            message.id,
            field.bit + 1,
            field.uid.unwrap_or(""),
            escaped(field.name),
            field
                .note
                .map_or_else(String::new, |note| format!(" ({})", escaped(note))),
            wire(field),
            scale(field),
            values(field, "enumerations.md"),
            confidence(message, field),
            received(does.received),
            if does.sent.is_some() { "yes" } else { "" },
        );
    }
    text
}

fn ed25_page() -> String {
    let mut page = format!(
        "# Edition 2.5\n\n{GENERATED}\n\n\
         All messages of Edition 2.5 (February 2007), from its public text: clause and table are those of its Appendix B1.\n\
         Every field is always sent, in the order of its number. `vsm decode` and `vsm encode` read and write them\n\
         (`\"idd\": \"2.5\"`), the Wireshark dissector shows them; [how the bridge serves such a CUCS](../../guide/connecting-a-cucs.md#stations-of-edition-25-and-edition-3).\n\
         The last column has the field of Edition 4 that holds the same, where one is known.\n\n\
         | type | message | from | LOI | bytes | Edition 4 |\n|---|---|---|---|---|---|\n"
    );
    for message in ed25::messages() {
        let heading = heading(message);
        let _ = writeln!(
            page,
            "| {} | [{}](#{}) | {} | {} | {} | {} |",
            message.id,
            message.name,
            anchor(&heading),
            message.direction.text(),
            list(message.loi),
            message.full_bytes(),
            list(message.ed4_messages),
        );
    }
    for message in ed25::messages() {
        page.push_str(&ed25_message(message));
    }
    page
}

fn ed25_message(message: &MessageInfo) -> String {
    let mut text = format!(
        "\n## {}\n\n{}, {}; clause {}, table {}; {} bytes.",
        heading(message),
        message.direction.text(),
        message.traffic.text(),
        message.source,
        message.table.unwrap_or("-"),
        message.full_bytes(),
    );
    if let Some(latency_ms) = message.latency_ms {
        let _ = write!(text, " Latency at most {latency_ms} ms.");
    }
    if let Some(note) = message.note {
        let _ = write!(text, " Note: {}.", escaped(note));
    }
    text.push_str("\n\n| field | id | name | type | step, unit | values | Edition 4 |\n|---|---|---|---|---|---|---|\n");
    for field in message.fields {
        let notes = [
            field.note,
            field.confidence.map(|_| "not clear in the text"),
        ];
        let notes: Vec<_> = notes.into_iter().flatten().map(escaped).collect();
        let _ = writeln!(
            text,
            "| {} | {} | {}{} | {} | {} | {} | {} |",
            field.bit + 1,
            field.uid.unwrap_or(""),
            escaped(field.name),
            if notes.is_empty() {
                String::new()
            } else {
                format!(" ({})", notes.join("; "))
            },
            wire(field),
            scale(field),
            values(field, "edition-2.5-values.md"),
            field
                .ed4
                .map_or_else(String::new, |(message, number)| format!(
                    "{message}.{number:02}"
                )),
        );
    }
    text
}

fn list<T: ToString>(items: &[T]) -> String {
    let items: Vec<_> = items.iter().map(T::to_string).collect();
    items.join(", ")
}

fn heading(message: &MessageInfo) -> String {
    format!("{} {}", message.id, message.name)
}

/// The anchor that a heading has on the usual hosts: letters in lower case, digits and hyphens; spaces are hyphens.
fn anchor(heading: &str) -> String {
    heading
        .chars()
        .filter_map(|character| match character {
            ' ' => Some('-'),
            '-' | '_' => Some(character),
            _ if character.is_alphanumeric() => Some(character.to_ascii_lowercase()),
            _ => None,
        })
        .collect()
}

fn wire(field: &FieldInfo) -> String {
    let inferred = if field.width_inferred {
        " (width inferred)"
    } else {
        ""
    };
    format!("{}{inferred}", field.wire)
}

fn scale(field: &FieldInfo) -> String {
    let unit = field.unit.unwrap_or("");
    match (field.identification, field.step()) {
        (true, _) => "identification number".to_owned(),
        (_, 1.0) => unit.to_owned(),
        (_, step) => format!("{step:.6e} {unit}").trim().to_owned(),
    }
}

fn values(field: &FieldInfo, page: &str) -> String {
    let mut cell = field
        .enumeration
        .map_or_else(String::new, |info| format!("[{0}]({page}#{0})", info.name));
    if let Some((low, high)) = field.range {
        if !cell.is_empty() {
            cell.push_str(", ");
        }
        let _ = write!(cell, "{low} to {high}");
    }
    cell
}

/// A table of messages: each has enumerations of its own.
#[derive(Clone, Copy)]
pub(super) enum Edition {
    /// Editions 3 and 4.
    Later,
    /// Edition 2.5.
    Ed25,
}

impl Edition {
    /// The messages, in the order of their types.
    pub(super) fn messages(self) -> Vec<&'static MessageInfo> {
        match self {
            Self::Later => MESSAGES.iter().collect(),
            Self::Ed25 => ed25::messages().collect(),
        }
    }
}

/// The enumerations and bitmaps that fields of the table have, by name.
pub(super) fn enumerations(edition: Edition) -> BTreeMap<&'static str, &'static EnumInfo> {
    edition
        .messages()
        .into_iter()
        .flat_map(|message| message.fields)
        .filter_map(|field| field.enumeration)
        .map(|info| (info.name, info))
        .collect()
}

fn enumerations_page(edition: Edition) -> String {
    let title = match edition {
        Edition::Later => "The values of fields",
        Edition::Ed25 => "The values of fields in Edition 2.5",
    };
    let mut page = format!("# {title}\n\n{GENERATED}\n");
    for info in enumerations(edition).values() {
        let _ = write!(page, "\n## {}\n\n", info.name);
        if !info.description.is_empty() {
            let _ = write!(page, "{}. ", escaped(info.description));
        }
        let _ = writeln!(
            page,
            "{}; confidence {}; source: {}.\n",
            match info.kind {
                EnumKind::Enumeration => "One value at a time",
                EnumKind::Bitmap => "Bits, any number at a time",
            },
            info.confidence.letter(),
            escaped(info.source),
        );
        if info.values.is_empty() && info.ranges.is_empty() {
            page.push_str("No source gives a value.\n");
            continue;
        }
        page.push_str("| value | meaning |\n|---|---|\n");
        for (value, _, text) in info.values {
            let value = match info.kind {
                EnumKind::Enumeration => value.to_string(),
                EnumKind::Bitmap => format!("{value:#x}"),
            };
            let _ = writeln!(page, "| {value} | {} |", escaped(text));
        }
        for (range, text) in info.ranges {
            let _ = writeln!(page, "| {range} | {} |", escaped(text));
        }
    }
    page
}

fn disputed() -> String {
    let mut page = format!(
        "# What sources leave open\n\n{GENERATED}\n\n\
         Where sources do not answer or disagree, this is the reading chosen, and the configuration key that changes it.\n\n\
         | key | what is open | default | choices | sources | confidence |\n|---|---|---|---|---|---|\n"
    );
    for entry in DISPUTED {
        let choices = match entry.choices {
            Choices::OneOf(choices) => choices.join(", "),
            Choices::Values(meanings) => {
                let meanings = meanings.join(", ");
                match entry.lowest {
                    0 => format!("the values of: {meanings}"),
                    lowest => format!("the values of: {meanings}; from {lowest} up"),
                }
            }
        };
        let _ = writeln!(
            page,
            "| `{}` | {} | `{}` | {} | {} | {} |",
            entry.key(),
            escaped(entry.question),
            entry.default,
            escaped(&choices),
            escaped(entry.sources),
            entry.confidence.letter(),
        );
    }
    page.push_str(
        "\n## What is settled\n\nThese have one reading. A configuration may name it, and no other.\n\n\
         | name | what is settled | reading | by |\n|---|---|---|---|\n",
    );
    for entry in SETTLED {
        let _ = writeln!(
            page,
            "| `{}` | {} | `{}`: {} | {} |",
            entry.name,
            escaped(entry.question),
            entry.reading,
            escaped(entry.meaning),
            escaped(entry.by),
        );
    }
    page
}

/// A text that cannot end its cell.
fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;")
}

const GENERATED: &str =
    "Generated by `cargo xtask gen` from the message table; changes here are lost.";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_is_on_one_page() {
        let described: usize = GROUPS.iter().map(|group| messages(group).count()).sum();
        assert_eq!(described, MESSAGES.len());
        for group in GROUPS {
            assert!(messages(group).next().is_some(), "{} is empty", group.file);
        }
        assert!(
            GROUPS
                .windows(2)
                .all(|pair| pair[0].last + 1 == pair[1].first)
        );
    }

    #[test]
    fn links_point_to_headings() {
        let message = stanag_msgs::table::message(14000).unwrap();
        assert_eq!(
            place(message),
            "mission.md#14000-mission-upload--download-status"
        );
    }
}
