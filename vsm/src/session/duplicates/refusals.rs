//! The reasons, as sent to the station, for refusing a message before its content is examined.

use std::time::Duration;

use super::stamps::{Late, MAX_LATE, SETTLE};

/// Its sender has sent a different command since.
pub(super) const OVERTAKEN: &str = "overtaken by a later command, which applies instead";
pub(super) const USED: &str = "Time Stamp already used by this CUCS: the message is a repetition, or the clock of the CUCS was set back";
pub(super) const TOO_MANY_AHEAD: &str = "its Time Stamp is ahead of the clock of its CUCS, as were those of many earlier commands: set the clock \
     of the CUCS and send it again";

pub(super) const REPEATED: &str = "already received: this is a repetition";
pub(super) const FLOWN: &str = "stick Time Stamp already used: the VSM restarted within the last 10 s, or the CUCS's clock was set back. Correct the \
     clock; sticks are accepted once it passes the last used time";
pub(super) const OLDER: &str = "its Time Stamp is older than that of earlier sticks: the clock of the CUCS was set back; sticks are accepted again \
     after 5 s with rising Time Stamps";

pub(super) fn late_text(late: Late) -> String {
    let (expected_s, settle_s) = (MAX_LATE.as_secs(), SETTLE.as_secs());
    let behind = |by: Duration| {
        let by_s = by.as_secs();
        format!(
            "its Time Stamp is {by_s} s behind the clock of its CUCS, expected at most {expected_s} s"
        )
    };
    match late {
        Late::Behind(by) => format!(
            "{}; send it again (a changed clock is accepted within {settle_s} s)",
            behind(by)
        ),
        Late::Contested(by) => format!(
            "{}, as shown by other messages of that CUCS: stamp all messages by one clock; send it again (a changed clock \
             is accepted within {settle_s} s)",
            behind(by)
        ),
        Late::Standing(newest, since) => format!(
            "the Time Stamps of this CUCS have not increased: none was newer than {} ms for {} s, so the age of a command is \
             unknown; stamp with the current time (accepted again within {settle_s} s)",
            newest.0,
            since.as_secs()
        ),
    }
}
