//! What the table records about a message.

use crate::field::{Confidence, FieldInfo, facts};

/// Who sends a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// CUCS to VSM.
    ToVsm,
    /// VSM to CUCS.
    ToCucs,
    /// Either way.
    Both,
}

impl Direction {
    /// The text of the fact table.
    pub const fn text(self) -> &'static str {
        match self {
            Direction::ToVsm => "CUCS->VSM",
            Direction::ToCucs => "VSM->CUCS",
            Direction::Both => "both",
        }
    }
}

/// Whether a message is sent unsolicited (push), or as an answer to a request (pull).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Traffic {
    /// Unsolicited.
    Push,
    /// As an answer.
    Pull,
    /// Either.
    PushPull,
}

impl Traffic {
    /// The text of the fact table.
    pub const fn text(self) -> &'static str {
        match self {
            Traffic::Push => "push",
            Traffic::Pull => "pull",
            Traffic::PushPull => "push/pull",
        }
    }
}

/// Where the layout comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layout {
    /// The order of the fields is known for Edition 4.
    Ed4,
    /// The order of Edition 2.5 with the id fields dropped and the types guessed.
    Ed2Derived,
    /// The text of Edition 2.5.
    Ed25,
}

impl Layout {
    /// The text of the fact table.
    pub const fn text(self) -> &'static str {
        match self {
            Layout::Ed4 => "ed4",
            Layout::Ed2Derived => "ed2-derived",
            Layout::Ed25 => "ed2.5",
        }
    }

    /// The independent source that confirms it, unless the row names another; nothing confirms a guess.
    const fn corroboration(self) -> &'static str {
        match self {
            Layout::Ed4 => "none",
            Layout::Ed2Derived => "not applicable",
            Layout::Ed25 => "Edition 2 Amendment 1",
        }
    }
}

/// A message.
#[derive(Clone, Copy, Debug)]
pub struct MessageInfo {
    /// Its Message Type.
    pub id: u16,
    /// Its name.
    pub name: &'static str,
    /// The name of its struct.
    pub rust: &'static str,
    /// Bytes of its presence vector; 0 in Edition 2.5, where every field is always present.
    pub presence_bytes: u8,
    /// Its fields in order.
    pub fields: &'static [FieldInfo],
    /// Who sends it.
    pub direction: Direction,
    /// Whether it is sent unsolicited, or as an answer.
    pub traffic: Traffic,
    /// The maximum latency in ms; advisory, sources disagree.
    pub latency_ms: Option<u16>,
    /// How far the layout can be trusted.
    pub confidence: Confidence,
    /// Where the layout comes from.
    pub layout: Layout,
    /// The sources, by the tags of the fact table; the clause of the text in a row of Edition 2.5.
    pub source: &'static str,
    /// Which independent source confirms it.
    pub corroboration: &'static str,
    /// Its table in the standard.
    pub table: Option<&'static str>,
    /// The message of Edition 2 that it comes from.
    pub ed2_message: Option<&'static str>,
    /// The messages of Edition 4 that hold the same, in a row of Edition 2.5.
    pub ed4_messages: &'static [u16],
    /// The levels of interoperability that must support it, where the text gives them; 4 stands for 4 and 5.
    pub loi: &'static [u8],
    /// What else sources give.
    pub note: Option<&'static str>,
}

impl MessageInfo {
    pub(crate) const fn new(
        id: u16,
        name: &'static str,
        rust: &'static str,
        presence_bytes: u8,
        fields: &'static [FieldInfo],
    ) -> Self {
        Self {
            id,
            name,
            rust,
            presence_bytes,
            fields,
            direction: Direction::Both,
            traffic: Traffic::Push,
            latency_ms: None,
            confidence: Confidence::NotFound,
            layout: Layout::Ed4,
            source: "",
            corroboration: "none",
            table: None,
            ed2_message: None,
            ed4_messages: &[],
            loi: &[],
            note: None,
        }
    }

    facts! {
        sent(direction: Direction, traffic: Traffic) => direction = direction, traffic = traffic;
        latency_ms(latency_ms: u16) => latency_ms = Some(latency_ms);
        layout(layout: Layout, confidence: Confidence) =>
            layout = layout, confidence = confidence, corroboration = layout.corroboration();
        own_definition() =>
            confidence = Confidence::A, source = "this project", corroboration = "own definition";
        source(source: &'static str) => source = source;
        corroboration(corroboration: &'static str) => corroboration = corroboration;
        table(table: &'static str) => table = Some(table);
        ed2_message(ed2_message: &'static str) => ed2_message = Some(ed2_message);
        text(clause: &'static str, table: &'static str) =>
            source = clause, table = Some(table), layout = Layout::Ed25, confidence = Confidence::A,
            corroboration = Layout::Ed25.corroboration();
        ed4(messages: &'static [u16]) => ed4_messages = messages;
        loi(levels: &'static [u8]) => loi = levels;
        note(note: &'static str) => note = Some(note);
    }

    /// The field of this name, exactly as the table writes it.
    pub fn field(&self, name: &str) -> Option<&'static FieldInfo> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// Bytes of message data with every field of known length present.
    pub fn full_bytes(&self) -> usize {
        let fields = self.fields.iter().filter_map(|field| field.wire.bytes());
        usize::from(self.presence_bytes) + fields.sum::<usize>()
    }
}
