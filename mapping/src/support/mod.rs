//! What this VSM does with each field of each message. It is the only source of the support table
//! (`docs/reference/support.md`), of the answers of the configuration phase about what is not supported, and of the
//! tests that compare both with the code.
//!
//! A message that is not listed is neither sent nor honoured: one for the VSM is refused, and 16000 gives the reason.
//! A message that is not even refused with a reason of its own is codec only, and [`why_codec_only`] gives the reason
//! for that. Messages known by name alone are in [`NO_LAYOUT`].

mod codec_only;
mod edition_25;
mod facts;
mod lookup;
mod no_layout;
mod refusals;
mod row;

pub use codec_only::{is_codec_only, why_codec_only};
pub use edition_25::{Edition25, In25, edition_25, edition_25_rows, in_edition_25};
pub use lookup::{FieldSupport, Received, field, message, provisional, rows, values};
pub use no_layout::{NO_LAYOUT, NoLayout, why_no_layout};
pub use refusals::why_refused;
pub use row::MessageSupport;
