//! Why a message is refused before anybody has looked at what it orders, as its station is sent it.

use std::time::Duration;

use super::stamps::{Late, MAX_LATE, SETTLE};

/// Its sender has ordered something else since.
pub(super) const OVERTAKEN: &str = "overtaken by a later command, which applies instead";
pub(super) const USED: &str = "its Time Stamp lies where this CUCS has commanded before: it is a repetition, or the clock of the CUCS was \
     set back";
pub(super) const TOO_MANY_AHEAD: &str = "its Time Stamp is ahead of the clock of its CUCS, as those of many commands before it were: set the clock \
     of the CUCS, and send it again";

pub(super) const REPEATED: &str = "it was received before: it is a repetition";
pub(super) const FLOWN: &str = "its Time Stamp lies where this CUCS has sent sticks before, of which each is no longer known: the VSM has restarted \
     within 10 s, or the clock of the CUCS was set back; sticks count again once it has passed that time: set the clock \
     of the CUCS";
pub(super) const OLDER: &str = "it is older, by its Time Stamp, than sticks that have come before: the clock of the CUCS was set back; sticks count \
     again after 5 s in which they come in order";

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
            "{}; send it again (once its clock was set, it is followed within {settle_s} s)",
            behind(by)
        ),
        Late::Contested(by) => format!(
            "{}, as other messages of that CUCS show it: stamp all messages by one clock; send it again (once its clock \
             was set, it is followed within {settle_s} s)",
            behind(by)
        ),
        Late::Standing(newest, since) => format!(
            "the Time Stamps of its CUCS do not rise: none was newer than {} ms for {} s, so that nobody can know how old a \
             command is; let the CUCS count them on with its clock, and it is followed within {settle_s} s",
            newest.0,
            since.as_secs()
        ),
    }
}
