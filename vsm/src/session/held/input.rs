//! What the machine of held commands reads, and what happens to it.

use stanag_msgs::Message;
use stanag_msgs::enums::AckType;

use crate::session::authority::rules::Authority;
use crate::session::context::{self, FlightView, MissionView, Origin};
use crate::session::other::Other;

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) mission: MissionView<'a>,
    pub(crate) flight: FlightView<'a>,
    /// Who else has the vehicle, as it showed that last.
    pub(crate) other: Option<Other>,
    /// Its failsafe has held it for so long that nothing follows from it.
    pub(crate) only_holds: bool,
    /// Who holds which right now.
    pub(crate) rights: &'a Authority,
}

context::deref_to_common!(Context);

/// What happens to it.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 50020 or 50021 of a CUCS that holds the right.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// 17002 for 50022.
    List { station: usize },
    /// Time has passed, the vehicle has reported something, or a right has changed.
    Watch,
    /// What the machine that it was for has answered.
    Ended {
        serial: u32,
        answer: AckType,
        why: Option<String>,
    },
}
