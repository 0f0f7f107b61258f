//! What is flown without a command of the moment: the loss action, and the end of a launch that was cut off.
//!
//! Who else has the vehicle ([`Other`]) keeps it.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mavlink_link::dialect::MavLandedState;
use stanag_msgs::enums::{FlightPathControlMode as Mode, RouteType};

use super::loss_action::{Action, LossContext};
use super::{Context, Flight, select};
use crate::config::OnLoss;
use crate::session::context::MissionView;
use crate::session::effects::{Effects, Request};
use crate::session::link::state::VehicleState;
use crate::session::maneuver::{self, Maneuver};
use crate::session::other::{FAILSAFE_HOLD, Other};

impl Flight {
    /// Who else has the vehicle, as it showed that last. POSCTL with the sticks (2010) of a CUCS is commanded from here.
    pub(crate) fn shown_other(&self, vehicle: &VehicleState, now: Duration) -> Option<Other> {
        let telemetry = &vehicle.telemetry;
        let by_sticks = telemetry.mode == Some(Px4Mode::POSCTL) && self.sticks.steer(now);
        Other::of(telemetry).filter(|other| !(by_sticks && matches!(other, Other::Pilot(_))))
    }

    /// The same by a report that is newer than the last command, and no more where a failsafe only holds: a hold of PX4 that
    /// was to lead to a return or a landing has done so by then, any other lasts until somebody commands a mode.
    pub(crate) fn other(&self, vehicle: &VehicleState, now: Duration) -> Option<Other> {
        vehicle.settled_mode()?;
        let other = self.shown_other(vehicle, now);
        other.filter(|other| !(*other == FAILSAFE_HOLD && self.only_holds(now)))
    }

    /// Whether a failsafe of PX4 has held the vehicle for so long that nothing follows from it.
    pub(crate) fn only_holds(&self, now: Duration) -> bool {
        let since = self.watched.holds_since;
        since.is_some_and(|since| now.saturating_sub(since) >= FAILSAFE_ACTS_WITHIN)
    }

    /// Whether the vehicle flies already what would be commanded for a lost controller, so that nothing is.
    pub(crate) fn shows_loss_action(
        &self,
        on_loss: OnLoss,
        vehicle: &VehicleState,
        mission: &MissionView<'_>,
    ) -> bool {
        let steered = self.steers(&vehicle.telemetry);
        let carries = mission.carries(RouteType::ContingencyA);
        Action::of(on_loss, steered)
            .is_some_and(|action| action.is_shown(vehicle.settled_mode(), carries))
    }

    /// Control went to nobody while a flight termination held, and it holds no more: the vehicle did not do what was
    /// commanded, or has left it.
    pub(super) fn take_up_loss(
        &mut self,
        context: &Context<'_>,
        on_loss: OnLoss,
        effects: &mut Effects<'_>,
    ) {
        let telemetry = &context.vehicle.telemetry;
        let gone = telemetry.mode == Some(Px4Mode::TERMINATION) || telemetry.armed == Some(false);
        if context.controller.is_some() || gone || !telemetry.airborne() {
            return;
        }
        // Set points have ended with the termination, whatever mode they are for is still shown.
        let steered = self.steers(telemetry) || telemetry.mode == Some(Px4Mode::OFFBOARD);
        self.loss_action.begin(on_loss, steered, context.mono());
        self.fly_loss_action(context, effects);
    }

    pub(super) fn fly_loss_action(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let telemetry = &context.vehicle.telemetry;
        let item_unknown = self
            .watched
            .item_unknown_since
            .is_some_and(|since| context.mono().saturating_sub(since) < ITEM_WITHIN);
        let loss = LossContext {
            now: context.mono(),
            live: context.vehicle.live(),
            on_ground: telemetry.landed == Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND),
            controlled: context.controller.is_some(),
            // What was given up when control was lost may still be entered: an older report ends no action.
            mode: context.vehicle.settled_mode(),
            carries_contingency: context.mission.carries(RouteType::ContingencyA),
            // A command of the VSM itself that waits for its route is the action's own.
            busy: self.maneuver.is_some() || context.mission.waiting_command() == Some(None),
            on_final: context.mission.is_on_final(telemetry) || item_unknown,
            may_change_mission: context.mission.may_change.is_ok(),
            other: self.other(context.vehicle, context.mono()),
        };
        match self.loss_action.poll(&loss, effects) {
            None => {}
            Some(Action::Hold) => {
                self.operate(context, None, &select(Mode::Loiter), false, effects);
            }
            Some(Action::Contingency) => {
                self.operate(context, None, &select(Mode::ContingencyA), false, effects);
            }
            Some(Action::Return) => {
                // No mode of 2016 stands for a plain return: mode 23 flies the contingency route where there is one.
                let steps = maneuver::enter(&[Px4Mode::RTL]);
                let maneuver = Maneuver::new(steps, Commanded::default());
                self.begin(context, None, maneuver, effects);
            }
        }
    }

    /// A launch that a restart cut off leaves no running motors behind, as one that fails leaves none: a vehicle that is
    /// still on the ground is disarmed; of one that flies operators are warned.
    pub(super) fn end_cut_off_launch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let telemetry = &context.vehicle.telemetry;
        let known = (telemetry.armed, telemetry.landed);
        let (true, true, (Some(armed), Some(_))) =
            (self.launch_cut_off, context.vehicle.live(), known)
        else {
            return;
        };
        self.launch_cut_off = false;
        let flies = telemetry.airborne();
        // A command that was given since the restart takes precedence.
        if self.maneuver.is_some() || !(armed || flies) {
            return;
        }
        // A launch puts it on hold before it arms it.
        if let (false, Some(Other::Pilot(mode))) =
            (flies, self.shown_other(context.vehicle, context.mono()))
        {
            return effects.warn_of_link(format!(
                "the launch that a restart of the VSM interrupted: the vehicle is armed on the ground in {}, and left to its \
                 pilot",
                mode.name()
            ));
        }
        effects.warn_of_link(if flies {
            "the launch that a restart of the VSM interrupted has taken the vehicle up: command a mode"
        } else {
            "the launch that a restart of the VSM interrupted left the vehicle armed on the ground: disarming it"
        });
        if !flies {
            let maneuver = Maneuver::new(maneuver::disarm(), self.commanded);
            self.begin(context, None, maneuver, effects);
        }
    }

    /// Drops a command that waits for its route where a pilot or a failsafe has taken the vehicle meanwhile: an upload takes many
    /// seconds on a slow radio, and the command would then take the vehicle from them. By a report since the last command: an
    /// earlier one may show POSCTL by sticks that this command has released.
    pub(super) fn give_way(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if !self.watched.mode_changed || context.vehicle.settled_mode().is_none() {
            return;
        }
        self.watched.mode_changed = false;
        if let (true, Some(other)) = (
            context.mission.waiting_command().is_some(),
            self.other(context.vehicle, context.mono()),
        ) {
            effects.request(Request::DropWaitingCommand {
                why: other.to_string(),
                without_right: false,
            });
        }
    }
}

/// PX4 holds for COM_FAIL_ACT_T, 25 s at most, before it does what a failsafe is to do.
const FAILSAFE_ACTS_WITHIN: Duration = Duration::from_secs(30);
/// MISSION_CURRENT comes once a second, and may be lost.
const ITEM_WITHIN: Duration = Duration::from_secs(5);
