//! What the machine of held commands reads, and its inputs.

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
    /// Who else flies the vehicle, as last reported.
    pub(crate) other: Option<Other>,
    /// Its failsafe has held it for so long that it will do nothing else.
    pub(crate) only_holds: bool,
    /// The rights held now.
    pub(crate) rights: &'a Authority,
}

context::deref_to_common!(Context);

/// An input.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 50020 or 50021 of a CUCS that holds the right.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// 17002 for 50022.
    List { station: usize },
    /// Time has passed, data of the vehicle has arrived, or a right has changed.
    Watch,
    /// The answer of the machine that carried out the command.
    Ended {
        serial: u32,
        answer: AckType,
        why: Option<String>,
    },
}
