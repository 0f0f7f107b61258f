//! What the parts of the border share: refusals, and messages made of records.

use stanag_msgs::ed25::{self, Version};
use stanag_msgs::messages::Heartbeat;
use stanag_msgs::{Id, Message, TimeStamp};

use super::record::{self, Fault, Record};

/// What the bridge knows of the sender of a message.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing<'a> {
    /// The identification number of this VSM.
    pub(crate) vsm: Id,
    /// The stamp of an answer.
    pub(crate) stamp: TimeStamp,
    /// Where the status page is.
    pub(crate) web_page: Option<&'a str>,
}

/// A message of Edition 2.5 that goes no further.
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

/// A message of which each field has a place in Edition 4, or none.
pub(super) fn generic(record: &Record) -> Result<Message, Refusal> {
    let info = ed25::message(record.id().into(), Version::Ed25);
    let Some(target) = info.and_then(|info| info.ed4_messages.first()) else {
        return Err(Refusal::new(
            "not supported",
            format!("message #{} is not supported by this VSM", record.id()),
        ));
    };
    to(record, *target)
}

/// A record as the message of Edition 4 with this number.
pub(super) fn to(record: &Record, target: u16) -> Result<Message, Refusal> {
    let Some(target) = record::ed4(target) else {
        return Err(Refusal::new("not supported", "no such message"));
    };
    Ok(record.to_ed4(target)?.message()?)
}

/// An empty message of Edition 2.5; the number is one of this border's own.
pub(super) fn new(number: u16) -> Record {
    Record::ed25(number).unwrap_or_else(|| Record::new(&Heartbeat::INFO))
}

pub(super) fn set_stamp(record: &mut Record, stamp: TimeStamp) {
    record.set(1, stamp.unix_ms() as f64 / 1e3);
}

pub(super) fn stamp_of(seconds: Option<f64>) -> Option<TimeStamp> {
    let ms = seconds.filter(|seconds| seconds.is_finite())? * 1e3;
    let first = TimeStamp(0).unix_ms() as f64;
    let fits = (first..first + TimeStamp::PERIOD_MS as f64).contains(&ms.round());
    fits.then(|| TimeStamp::from_unix_ms(ms.round() as u64))
}
