//! What is flown by the VSM once the controlling CUCS is lost (`authority.on_loss`): tried until the vehicle shows it.
//!
//! A vehicle that refuses, or a contingency route that turns out not to be flyable, must not leave the aircraft to
//! nobody: each way is tried some times, then the next. The last one, AUTO.RTL, is tried for as long as the vehicle is
//! in the air and nobody has taken control. Over a vehicle that is silent nothing can be tried: it does what it is set
//! to do without a link, and is tried again when it is heard.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mavlink_link::dialect::MavLandedState;
use stanag_msgs::enums::{AlertPriority, FlightPathControlMode as Mode, RouteType, SubsystemId};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::Desk;
use super::maneuver::{self, Maneuver};
use crate::config::OnLoss;

/// A way out, as far as it has been tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LossAction {
    way: Way,
    tries: u32,
    next_at: Duration,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Hold,
    Contingency,
    Return,
}

impl LossAction {
    /// The first way; `None` where the vehicle is to go on as it is.
    pub(super) fn begun(on_loss: OnLoss, steered: bool, now: Duration) -> Option<LossAction> {
        let way = match on_loss {
            // Steered by nobody it would fly straight on for ever.
            OnLoss::Continue if !steered => return None,
            OnLoss::Continue | OnLoss::Hold => Way::Hold,
            OnLoss::Contingency => Way::Contingency,
            OnLoss::Rtl => Way::Return,
        };
        Some(LossAction {
            way,
            tries: 0,
            next_at: now,
        })
    }

    /// When it is looked at next.
    pub(super) fn poll_timeout(&self) -> Duration {
        self.next_at
    }

    /// The way to try now, one more time or the next one.
    fn next(&mut self, now: Duration) -> Way {
        if self.tries >= TRIES && self.way != Way::Return {
            self.way = Way::Return;
            self.tries = 0;
        }
        self.tries += 1;
        self.next_at = now + BETWEEN;
        self.way
    }
}

impl Aircraft {
    /// Control is with nobody after a loss: the VSM flies what is configured for that.
    pub(super) fn begin_recall(&mut self, desk: &mut Desk<'_>) {
        let steered = self.steering.engaged();
        self.loss_action = LossAction::begun(desk.loss.on_loss, steered, desk.now.mono);
        self.advance_recall(desk);
    }

    /// Tries again what the vehicle does not show yet.
    pub(super) fn advance_recall(&mut self, desk: &mut Desk<'_>) {
        let Some(mut loss_action) = self.loss_action else {
            return;
        };
        if self.authority.controller().is_some() {
            return self.end_recall(desk, "another CUCS controls the vehicle");
        }
        let stands = self.mav.telemetry.landed == Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND);
        if self.mav.live() && stands {
            return self.end_recall(desk, "the vehicle stands");
        }
        if self.mav.live() && self.shows(loss_action.way) {
            return self.end_recall(desk, "the vehicle does what is to be done after the loss");
        }
        let waits_for_route = self
            .load
            .as_ref()
            .is_some_and(|load| load.waiting_command() == Some(None));
        if loss_action.next_at > desk.now.mono {
            return;
        }
        if !self.mav.live() || self.maneuver.is_some() || waits_for_route {
            loss_action.next_at = desk.now.mono + BETWEEN;
            self.loss_action = Some(loss_action);
            return;
        }
        let before = loss_action;
        let mut way = loss_action.next(desk.now.mono);
        // A transfer that its owner left behind must not keep the aircraft from coming home.
        if way == Way::Contingency && self.may_change_mission().is_err() {
            loss_action.way = Way::Return;
            way = Way::Return;
        }
        self.loss_action = Some(loss_action);
        if before.tries > 0 {
            self.say_recall(desk, before.way, loss_action);
        }
        match way {
            Way::Hold => self.operate(desk, None, &mode(Mode::Loiter)),
            Way::Contingency => self.operate(desk, None, &mode(Mode::ContingencyA)),
            Way::Return => {
                let steps = maneuver::enter(&[Px4Mode::RTL]);
                self.begin(desk, None, Maneuver::new(steps, Commanded::default()));
            }
        }
    }

    /// Whether the vehicle is on this way, or brings itself down by its own failsafe.
    fn shows(&self, way: Way) -> bool {
        let flies_contingency = || {
            self.aboard
                .as_ref()
                .is_some_and(|aboard| aboard.route_type == RouteType::ContingencyA)
        };
        match self.mav.telemetry.mode {
            Some(Px4Mode::RTL | Px4Mode::LAND) => true,
            Some(Px4Mode::LOITER | Px4Mode::ORBIT) => way == Way::Hold,
            Some(Px4Mode::MISSION) => way == Way::Contingency && flies_contingency(),
            _ => false,
        }
    }

    fn say_recall(&mut self, desk: &mut Desk<'_>, before: Way, loss_action: LossAction) {
        let name = |way| match way {
            Way::Hold => "hold",
            Way::Contingency => "fly contingency A",
            Way::Return => "return",
        };
        let text = if before == loss_action.way {
            format!(
                "the controlling CUCS is lost and the vehicle does not {}: try {}",
                name(before),
                loss_action.tries
            )
        } else {
            format!(
                "the controlling CUCS is lost and the vehicle does not {}: it is to {}",
                name(before),
                name(loss_action.way)
            )
        };
        let raised = self.alerts.raise(
            Cause::LossAction,
            AlertPriority::Emergency,
            SubsystemId::Comms,
            text,
        );
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
    }

    fn end_recall(&mut self, desk: &mut Desk<'_>, why: &str) {
        self.loss_action = None;
        let raised = self.alerts.clear(Cause::LossAction, why);
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
    }
}

fn mode(mode: Mode) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(mode),
        ..VehicleOperatingModeCommand::default()
    }
}

/// Tries of a way before the next.
const TRIES: u32 = 2;
/// From one try, or look, to the next.
const BETWEEN: Duration = Duration::from_secs(2);
