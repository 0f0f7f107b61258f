//! The support table: message by field, what is sent, honoured, ignored and refused, and how well each is known.

use std::fmt::Write;

use mapping::support::{self, FieldSupport, MessageSupport, Received};
use serde_json::{Map, Value, json};
use stanag_msgs::table::{FieldInfo, MESSAGES, MessageInfo};

/// `docs/support.md`.
pub(super) fn markdown() -> String {
    let mut page = String::from(HEAD);
    let _ = writeln!(
        page,
        "## Messages\n\n| id | name | direction | from a CUCS | sent | layout | confidence |\n|---|---|---|---|---|---|---|"
    );
    for message in MESSAGES {
        let row = support::message(message.id);
        let (taken, sends) = summary(message, row);
        let _ = writeln!(
            page,
            "| [{0}](dli/{1}) | {2} | {3} | {taken} | {sends} | {4} | {5} |",
            message.id,
            super::reference::place(message),
            message.name,
            message.direction.text(),
            message.layout.text(),
            message.confidence.letter(),
        );
    }
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
            "| field | name | from a CUCS | sent | confidence |\n|---|---|---|---|---|\n",
        );
        for field in message.fields {
            let does = support::field(message, field);
            let _ = writeln!(
                page,
                "| {} | {} | {} | {} | {} |",
                field.bit + 1,
                field.name,
                received(does.received),
                does.sent
                    .map_or_else(|| "no".to_owned(), |from| format!("yes: {from}")),
                confidence(message, field),
            );
        }
    }
    page
}

/// `docs/support.json`.
pub(super) fn json() -> String {
    let messages: Vec<Value> = MESSAGES.iter().map(message_json).collect();
    let mut text = serde_json::to_string_pretty(&json!({ "messages": messages }))
        .expect("a value without maps of other keys than strings");
    text.push('\n');
    text
}

fn message_json(message: &MessageInfo) -> Value {
    let row = support::message(message.id);
    let text = |text: Option<&'static str>| text.filter(|text| !text.is_empty());
    json!({
        "id": message.id,
        "name": message.name,
        "direction": message.direction.text(),
        "layout": message.layout.text(),
        "provisional": support::provisional(message),
        "confidence": message.confidence.letter(),
        "source": message.source,
        "taken": text(row.map(|row| row.taken)),
        "sends": text(row.map(|row| row.sends)),
        "fields": message.fields.iter().map(|field| field_json(message, field)).collect::<Vec<_>>(),
    })
}

fn field_json(message: &MessageInfo, field: &FieldInfo) -> Value {
    let FieldSupport { sent, received } = support::field(message, field);
    let mut object = Map::new();
    object.insert("field".to_owned(), json!(field.bit + 1));
    object.insert("name".to_owned(), json!(field.name));
    object.insert("uid".to_owned(), json!(field.uid));
    object.insert("confidence".to_owned(), json!(confidence(message, field)));
    object.insert("sent".to_owned(), json!(sent.is_some()));
    object.insert("sent_from".to_owned(), json!(sent));
    let (word, how) = match received {
        Received::Honoured(how) => ("honoured", Some(how)),
        Received::Ignored => ("ignored", None),
        Received::Refused => ("refused", None),
        Received::Never => ("never", None),
    };
    object.insert("received".to_owned(), json!(word));
    object.insert("honoured_as".to_owned(), json!(how));
    Value::Object(object)
}

/// What is done with a whole message: on receipt, and whether it is sent.
pub(super) fn summary(message: &MessageInfo, row: Option<&MessageSupport>) -> (String, String) {
    use stanag_msgs::table::Direction;
    let taken = match row {
        _ if message.direction == Direction::ToCucs => "never",
        Some(row) if !row.taken.is_empty() => row.taken,
        _ => "refused",
    };
    let sends = match row {
        Some(row) if !row.sends.is_empty() => row.sends,
        _ => "never",
    };
    (taken.to_owned(), sends.to_owned())
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

const HEAD: &str = "# What is supported

Generated by `cargo xtask gen` from the message table and the facts in `mapping/src/support`; changes here are lost.
The same as data: [support.json](support.json). The layouts: [dli/](dli/README.md).

- **honoured**: it changes what is done, in the way that is said.
- **ignored**: taken with its message and without effect. Where 2010, 2016, 2017, 13002 or 13003 ask for something by it,
  16000 says that it is not heeded.
- **refused**: the message is answered by 17000 type 3 where an acknowledgement was asked for, and by 16000 with the reason.
- **never**: that message does not come from a CUCS, or is not sent by this VSM.
- **ed2-derived**: the layout is derived from Edition 2 and provisional: `dli.provisional` says whether it is used.
- **confidence**: A an Edition 4 definition said to be checked against the text, B one Edition 4 source or the text of
  Edition 3, C inferred from Edition 2.5, ? found in no source.

";
