//! Shared by the parts of the translator: refusals, and messages made from records.

use mapping::support::{In25, in_edition_25};
use stanag_msgs::ed25::{self, Fault, Record, Version};
use stanag_msgs::messages::Heartbeat;
use stanag_msgs::{Id, Message, TimeStamp};

/// What the bridge knows about the sender of a message.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing<'a> {
    /// The identification number of this VSM.
    pub(crate) vsm: Id,
    /// The id under which the addressed vehicle answers: its own, or its logical id.
    pub(crate) named: Id,
    /// The stamp of an answer.
    pub(crate) stamp: TimeStamp,
    /// The address of the status page.
    pub(crate) web_page: Option<&'a str>,
}

/// A message of Edition 2.5 that is not passed on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Refusal {
    /// The counter.
    pub(crate) counter: &'static str,
    /// Why, for the operator.
    pub(crate) why: String,
}

impl Refusal {
    pub(super) fn new(counter: &'static str, why: impl Into<String>) -> Refusal {
        let why = why.into();
        Refusal { counter, why }
    }
}

impl From<Fault> for Refusal {
    fn from(fault: Fault) -> Refusal {
        Refusal::new(fault.counter(), fault.to_string())
    }
}

/// A message whose fields each have a place in Edition 4, or none.
pub(super) fn generic(record: &Record) -> Result<Message, Refusal> {
    let info = ed25::message(record.id().into(), Version::Ed25);
    let Some(target) = info.and_then(|info| info.ed4_messages.first()) else {
        return Err(Refusal::new(
            "not supported",
            match info.map(in_edition_25) {
                Some(In25::Refused(why)) => {
                    format!("message #{} is not supported: {why}", record.id())
                }
                _ => format!("message #{} is not supported by this VSM", record.id()),
            },
        ));
    };
    to(record, *target)
}

/// Clears fields that a loiter of this type does not have: all fields are always sent, and unused ones hold the ends of
/// their ranges. `radius`: its field, which length and bearing follow in #41 and #803 alike.
pub(super) fn clear_unused_of_loiter(record: &mut Record, of_type: u8, radius: u8) {
    match record.whole(of_type) {
        CIRCULAR => {}
        HOVER => record.clear(radius),
        _ => return,
    }
    record.clear(radius + 1);
    record.clear(radius + 2);
}

const CIRCULAR: u32 = 1;
const HOVER: u32 = 4;

/// Converts a record to the message of Edition 4 with this number.
pub(super) fn to(record: &Record, target: u16) -> Result<Message, Refusal> {
    Ok(record.become_ed4(target)?)
}

/// An empty message of Edition 2.5; the number is one that the translator itself sends.
pub(super) fn new(number: u16) -> Record {
    Record::ed25(number).unwrap_or_else(|| Record::new(&Heartbeat::INFO))
}
