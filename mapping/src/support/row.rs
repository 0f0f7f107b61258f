//! The form of a fact: one row for each message, and texts that many rows share.

/// What this VSM does with one message.
#[derive(Debug, Clone, Copy)]
pub struct MessageSupport {
    /// Its Message Type.
    pub id: u16,
    /// Its effect when it comes from a CUCS; empty where it is not accepted.
    pub taken: &'static str,
    /// When it is sent; empty where it never is.
    pub sends: &'static str,
    /// The fields that change the effect, and how. All others are ignored.
    pub honoured: &'static [(&'static str, &'static str)],
    /// The fields that are filled, and with what. All others are absent.
    pub sent: &'static [(&'static str, &'static str)],
}

impl MessageSupport {
    /// A message that is neither accepted nor sent.
    pub(super) const fn unused(id: u16) -> Self {
        Self {
            id,
            taken: "",
            sends: "",
            honoured: &[],
            sent: &[],
        }
    }
}

/// Rows of the table: `id taken "its effect" { "field": how; } sends "when" { "field": from what; }`; a part that
/// does not apply is left out.
macro_rules! facts {
    ($(
        $id:literal
        $(taken $taken:literal { $($honoured:literal: $how:expr;)* })?
        $(sends $sends:literal { $($sent:literal: $source:expr;)* })?
    )*) => {
        pub(super) static ROWS: &[$crate::support::row::MessageSupport] = &[$(
            $crate::support::row::MessageSupport {
                $(taken: $taken, honoured: &[$(($honoured, $how)),*],)?
                $(sends: $sends, sent: &[$(($sent, $source)),*],)?
                ..$crate::support::row::MessageSupport::unused($id)
            },
        )*];
    };
}

pub(super) use facts;

pub(super) const STAMP: &str = "rises strictly";
/// For measured values.
pub(super) const MEASURED: &str = "when it was measured, by the vehicle's clock (time_boot_ms, TIMESYNC); when it arrived where the vehicle does not \
     answer TIMESYNC; rises strictly from one of this message to the next";
pub(super) const RECEIVED_STAMP: &str = "identifies a duplicate, and is returned in 17000";
pub(super) const NULL_LINK: &str = "the null id: data links are the link's own matter";
pub(super) const ECHO: &str = "returned in 2";
pub(super) const AS_RECEIVED: &str = "as it was received";
