//! The support table: for each message and field what is sent, honoured, ignored and refused, and with what confidence.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use mapping::support::{self, In25, MessageSupport, Received};
use mavlink::Message as _;
use mavlink_link::dialect::MavMessage;
use stanag_msgs::ed25;
use stanag_msgs::table::{self, Direction, FieldInfo, MESSAGES, MessageInfo};

/// `docs/reference/support.md`; `place` is the file and heading of a message's description.
pub(super) fn markdown(place: impl Fn(&MessageInfo) -> String) -> String {
    let mut page = String::from(HEAD);
    let _ = writeln!(
        page,
        "## Messages\n\n| id | name | direction | from a CUCS | sent | Edition 3 | Edition 2.5 | layout | confidence |\n|---|---|---|---|---|---|---|---|---|"
    );
    for message in MESSAGES {
        let row = support::message(message.id);
        let (taken, sends) = summary(message, row);
        let _ = writeln!(
            page,
            "| [{0}](dli/{1}) | {2} | {3} | {taken} | {sends} | {6} | {7} | {4} | {5} |",
            message.id,
            place(message),
            message.name,
            message.direction.text(),
            message.layout.text(),
            message.confidence.letter(),
            edition_3(message.id),
            numbers(message),
        );
    }
    codec_only(&mut page);
    no_layout(&mut page);
    edition_25(&mut page);
    mavlink(&mut page);
    page.push_str("\n## Fields\n");
    for message in MESSAGES {
        let row = support::message(message.id);
        let _ = writeln!(page, "\n### {} {}\n", message.id, message.name);
        if row.is_none_or(|row| row.honoured.is_empty() && row.sent.is_empty()) {
            let (taken, sends) = summary(message, row);
            let _ = writeln!(page, "Every field: from a CUCS {taken}; sent {sends}.");
            continue;
        }
        page.push_str(
            "| field | name | from a CUCS | sent | Edition 2.5 | confidence |\n|---|---|---|---|---|---|\n",
        );
        for field in message.fields {
            let does = support::field(message, field);
            let _ = writeln!(
                page,
                "| {} | {} | {} | {} | {} | {} |",
                field.bit + 1,
                field.name,
                received(does.received),
                does.sent
                    .map_or_else(|| "no".to_owned(), |from| format!("yes: {from}")),
                place_of(message, field),
                confidence(message, field),
            );
        }
    }
    page
}

/// The messages that nothing is done with, and why.
fn codec_only(page: &mut String) {
    page.push_str(CODEC_ONLY);
    for message in MESSAGES {
        if let Some(why) = support::why_codec_only(message) {
            let _ = writeln!(page, "| {} | {} | {why} |", message.id, message.name);
        }
    }
}

/// The messages that are known by their names alone.
fn no_layout(page: &mut String) {
    page.push_str(NO_LAYOUT);
    for one in support::NO_LAYOUT {
        let ids = one.ids.as_ref();
        let ids = ids.map_or_else(
            || "not known".to_owned(),
            |ids| format!("{} to {}", ids.start(), ids.end()),
        );
        let _ = writeln!(page, "| {ids} | {} | {} |", one.name, one.why);
    }
}

/// Whether a station of Edition 3 has the message.
fn edition_3(id: u16) -> String {
    match (id, table::edition_3_fields(id)) {
        (4, _) => "none: taken and sent all the same; 16000 informs the holder too".to_owned(),
        (5, _) => "none: sent all the same; 35000 reports the same".to_owned(),
        (_, Some(count)) => format!("fields 1 to {count}"),
        (_, None) => "the same".to_owned(),
    }
}

/// The messages of Edition 2.5 that hold the same.
fn numbers(message: &MessageInfo) -> String {
    let of = ed25::messages().filter(|info| info.ed4_messages.contains(&message.id));
    let numbers: Vec<_> = of.map(|info| format!("#{}", info.id)).collect();
    if numbers.is_empty() {
        return "none".to_owned();
    }
    numbers.join(", ")
}

/// Where Edition 2.5 has a field: `#43.05`.
fn place_of(message: &MessageInfo, field: &FieldInfo) -> String {
    let here = Some((message.id, field.bit + 1));
    let places = ed25::messages().flat_map(|info| {
        let fields = info.fields.iter().filter(move |field| field.ed4 == here);
        fields.map(move |field| format!("#{}.{:02}", info.id, field.bit + 1))
    });
    let places: Vec<_> = places.collect();
    if places.is_empty() {
        return "no".to_owned();
    }
    places.join(", ")
}

/// Every message of Edition 2.5, and what becomes of it.
fn edition_25(page: &mut String) {
    page.push_str(EDITION_25);
    for info in ed25::messages() {
        let numbers: Vec<_> = info.ed4_messages.iter().map(u16::to_string).collect();
        let becomes = support::in_edition_25(info);
        let (does, own) = match becomes {
            In25::ByHand(row) => (row.does.to_owned(), row.honoured),
            In25::FieldByField => (format!("{}, field by field", numbers.join(", ")), &[][..]),
            In25::Refused(why) => (format!("refused: {why}"), &[][..]),
            In25::Never(why) => (format!("never: {why}"), &[][..]),
        };
        let left = info.fields.iter().skip(3).filter(|field| {
            field.ed4.is_none()
                && !own.contains(&(field.bit + 1))
                && !matches!(becomes, In25::Never(_) | In25::Refused(_))
        });
        let left: Vec<_> = left
            .map(|field| format!("{} ({})", field.bit + 1, field.name))
            .collect();
        let _ = writeln!(
            page,
            "| #{} | {} | {} | {does} | {} |",
            info.id,
            info.name,
            info.direction.text(),
            if left.is_empty() {
                "none".to_owned()
            } else {
                left.join(", ")
            },
        );
    }
}

/// For each message of MAVLink the messages of the DLI whose row names it, by the texts of the row.
fn mavlink(page: &mut String) {
    let mut by_name: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for row in support::rows() {
        let fields = row.honoured.iter().chain(row.sent).map(|(_, text)| *text);
        let texts = fields.chain([row.taken, row.sends]);
        let names: BTreeSet<&str> = texts
            .flat_map(|text| text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')))
            .filter(|word| MavMessage::message_id_from_name(word).is_some())
            .collect();
        for name in names {
            by_name.entry(name).or_default().push(row.id.to_string());
        }
    }
    page.push_str("\n## By message of MAVLink\n\n| MAVLink | DLI |\n|---|---|\n");
    for (name, ids) in by_name {
        let _ = writeln!(page, "| {name} | {} |", ids.join(", "));
    }
}

/// What is done with a whole message: on receipt, and whether it is sent.
pub(super) fn summary(message: &MessageInfo, row: Option<&MessageSupport>) -> (String, String) {
    let taken = match row {
        _ if message.direction == Direction::ToCucs => "never",
        Some(row) if !row.taken.is_empty() => row.taken,
        _ => "refused",
    };
    let why = support::why_refused(message.id).filter(|_| taken == "refused");
    let taken = why.map_or_else(|| taken.to_owned(), |why| format!("{taken}: {why}"));
    let sends = match row {
        Some(row) if !row.sends.is_empty() => row.sends,
        _ => "never",
    };
    (taken, sends.to_owned())
}

/// What is done with a field on receipt, in a cell.
pub(super) fn received(received: Received) -> String {
    match received {
        Received::Honoured(how) => format!("honoured: {how}"),
        Received::Ignored => "ignored".to_owned(),
        Received::Refused => "refused".to_owned(),
        Received::Never => "never".to_owned(),
    }
}

/// The letter of a field: its own, or its message's.
pub(super) fn confidence(message: &MessageInfo, field: &FieldInfo) -> &'static str {
    field.confidence.unwrap_or(message.confidence).letter()
}

const CODEC_ONLY: &str = "
## Codec only

Messages that are encoded and decoded, and that nothing else is done with: neither honoured, nor sent, nor refused with a reason of
their own. A test counts them: at most 15.

| id | name | why |
|---|---|---|
";

const NO_LAYOUT: &str = "
## No known layout

What STANAG 4586 has and no public source describes: it is not decoded. A station that sends it and requests an answer is refused with this reason
(17000 type 3, 16000).

| id | name | why |
|---|---|---|
";

const EDITION_25: &str = "
## Edition 2.5

Each of its 79 messages and of the private ones, and what it is inside: a number without # is of Edition 4, whose row says what is done. The last column has
the fields with no place in Edition 4: ignored from a CUCS, and sent as 0 or as an empty text, since every field is always sent. A
field that the vehicle has not reported for a while keeps its last value.

| id | name | direction | what is done | fields without a place |
|---|---|---|---|---|
";

const HEAD: &str = "# What is supported

Generated by `cargo xtask gen` from the message table and the facts in `mapping/src/support`; changes here are lost.
The layouts: [dli/](dli/README.md).

- **honoured**: the field has the effect that is given beside it.
- **ignored**: accepted with its message, without effect. If 2010, 2016, 2017, 13002 or 13003 request something with it, an
  alert (16000) reports that it is ignored.
- **refused**: the message is answered by 17000 type 3 if an acknowledgement was requested, and by 16000 with the reason.
- **never**: a CUCS does not send that message, or this VSM does not.
- **ed2-derived**: the layout is derived from Edition 2 and provisional: `dli.provisional` selects whether it is used.
- **Edition 3**: it has the layouts of Edition 4, answered with IDD version 30.
- **Edition 2.5**: the message, or the field, that holds the same; [below](#edition-25) what is done with each of its messages.
- **confidence**: A an Edition 4 definition whose author claims to have checked it against the text, B one Edition 4 source or the text of
  Edition 3, C inferred from Edition 2.5, ? found in no source.

";
