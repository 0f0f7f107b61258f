//! Zeroize (50024).

use kit::bridge::{Rig, Setup};
use stanag_msgs::enums::FtState;
use stanag_msgs::messages::ZeroizeCommand;

use super::scenes::{control, then_5_s};
use crate::scene::Trial;

pub(super) fn zeroize() -> Vec<Trial> {
    vec![trial!(
        allowed,
        on_the_ground,
        then_5_s,
        ZeroizeCommand {
            commanded_zeroize_state: Some(FtState::Arm),
            ..ZeroizeCommand::default()
        },
        ["Commanded Zeroize State" = "0"]
    )]
}

fn allowed() -> Setup {
    Setup {
        tables: "[zeroize]\nby_message = true\n",
        ..Setup::default()
    }
}

/// By a station whose clock is measured.
fn on_the_ground(rig: &mut Rig) {
    control(rig);
    rig.stations[0].heartbeats = true;
    rig.run(5.0);
}
