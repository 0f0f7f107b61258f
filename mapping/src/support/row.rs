//! The form of a fact: one row a message, and the words that many of them share.

/// What is done with one message.
#[derive(Debug, Clone, Copy)]
pub struct MessageSupport {
    /// Its Message Type.
    pub id: u16,
    /// What it leads to when it comes from a CUCS; empty where it is not taken.
    pub taken: &'static str,
    /// When it is sent; empty where it never is.
    pub sends: &'static str,
    /// The fields that change what is done, and how. The others are looked at by nobody.
    pub honoured: &'static [(&'static str, &'static str)],
    /// The fields that are filled, and from what. The others are absent.
    pub sent: &'static [(&'static str, &'static str)],
}

impl MessageSupport {
    /// A message that is neither taken nor sent.
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

/// Rows of the table: `id taken "to what it leads" { "field": how; } sends "when" { "field": from what; }`, without the
/// part that there is not.
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
/// Of what the vehicle measures.
pub(super) const MEASURED: &str = "when it was measured, by the vehicle's clock (time_boot_ms, TIMESYNC); when it arrived where the vehicle does not \
     answer TIMESYNC; rises strictly from one of this message to the next";
pub(super) const RECEIVED_STAMP: &str = "identifies a duplicate, and is returned in 17000";
pub(super) const NULL_LINK: &str = "the null id: data links are the link's own matter";
pub(super) const ECHO: &str = "returned in 2";
pub(super) const AS_RECEIVED: &str = "as it was received";
