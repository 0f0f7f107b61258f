//! What the VSM flies without a current command: the loss action, contingencies, and the end of an interrupted launch.
//!
//! A pilot or a failsafe that has the vehicle ([`Other`]) keeps it.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use stanag_msgs::enums::{FlightPathControlMode as Mode, RouteType};

use super::loss_action::{Action, LossContext};
use super::{Context, Flight, select};
use crate::config::{ContingencyAction, OnLoss};
use crate::session::context::{MissionView, Origin};
use crate::session::contingency::priority::{Turn, Urgency, turn};
use crate::session::contingency::{self, ContingencyContext, reported};
use crate::session::effects::{Effects, Request};
use crate::session::link::state::VehicleState;
use crate::session::maneuver::{self, Maneuver};
use crate::session::other::Other;

impl Flight {
    /// Who else flies the vehicle, as last reported. POSCTL with the sticks (2010) of a CUCS counts as commanded by this
    /// VSM.
    pub(crate) fn shown_other(&self, vehicle: &VehicleState, now: Duration) -> Option<Other> {
        let telemetry = &vehicle.telemetry;
        let by_sticks = telemetry.mode == Some(Px4Mode::POSCTL) && self.sticks.steer(now);
        Other::of(telemetry).filter(|other| !(by_sticks && matches!(other, Other::Pilot(_))))
    }

    /// The same, by a report that is newer than the last command, and without a failsafe that has only held for a long time:
    /// by then a PX4 hold that leads to a return or landing has done so; any other hold lasts until a mode is commanded.
    pub(crate) fn other(&self, vehicle: &VehicleState, now: Duration) -> Option<Other> {
        vehicle.settled_mode()?;
        let other = self.shown_other(vehicle, now);
        other.filter(|other| !(other.may_stay() && self.only_holds(now)))
    }

    /// Whether a PX4 failsafe has held the vehicle for so long that it will do nothing else.
    pub(crate) fn only_holds(&self, now: Duration) -> bool {
        self.watched.holding.leads_nowhere(now)
    }

    /// Whether the vehicle already flies what would be commanded for a lost controller, so that no command is needed.
    pub(crate) fn shows_loss_action(
        &self,
        on_loss: OnLoss,
        vehicle: &VehicleState,
        mission: &MissionView<'_>,
    ) -> bool {
        let steered = self.steers(&vehicle.telemetry);
        let carries = mission.carries(RouteType::ContingencyA);
        let completed = self.completed_seen(vehicle, mission);
        let flown = self.flown_contingency(vehicle, mission);
        Action::of(on_loss, steered).is_some_and(|action| {
            action.is_shown(vehicle.settled_mode(), carries, completed)
                || flown >= Some(action.urgency())
        })
    }

    /// The urgency of the contingency action that the vehicle flies, if it reports that action and the cause persists.
    fn flown_contingency(
        &self,
        vehicle: &VehicleState,
        mission: &MissionView<'_>,
    ) -> Option<Urgency> {
        let flies = mission.flies(&vehicle.telemetry);
        let lands = mission.lands(&vehicle.telemetry);
        self.contingencies
            .flown(vehicle.settled_mode(), flies, lands)
    }

    /// The route that the vehicle has flown to its end, if it holds there without a hold commanded by this VSM.
    fn completed(&self, vehicle: &VehicleState, mission: &MissionView<'_>) -> Option<RouteType> {
        let holds = vehicle.settled_mode() == Some(Px4Mode::LOITER);
        let entered = self.watched.entered == Some(Px4Mode::LOITER) || self.maneuver.is_some();
        let (reported, uploaded) = (vehicle.telemetry.mission?, mission.uploaded?);
        let (progress, compiled) = (mission.progress, &uploaded.compiled);
        let ended = progress.stays_at_end(compiled, &vehicle.telemetry)
            && uploaded.is_aboard(reported.mission_id);
        (holds && ended && !entered).then_some(uploaded.route_type)
    }

    /// Whether this process has seen the route of contingency A flown to its end. After a restart, earlier commands of a
    /// CUCS are unknown.
    fn completed_seen(&self, vehicle: &VehicleState, mission: &MissionView<'_>) -> bool {
        self.watched.flew && self.completed(vehicle, mission) == Some(RouteType::ContingencyA)
    }

    /// Whether a contingency takes precedence over the loss action.
    pub(crate) fn contingency_first(&self, on_loss: OnLoss, vehicle: &VehicleState) -> bool {
        let loss = Action::of(on_loss, self.steers(&vehicle.telemetry)).map(Action::urgency);
        turn(false, loss, self.contingencies.urgency()) == Turn::Contingency
    }

    /// The priority of what is flown now: [`priority`](super::priority).
    pub(super) fn turn(&self) -> Turn {
        let loss = self.loss_action.urgency();
        turn(self.held, loss, self.contingencies.urgency())
    }

    /// Control was lost while a flight termination was in effect, and the termination has ended: the vehicle did not carry
    /// it out, or has left it.
    pub(super) fn take_up_loss(
        &mut self,
        context: &Context<'_>,
        on_loss: OnLoss,
        effects: &mut Effects<'_>,
    ) {
        let telemetry = &context.vehicle.telemetry;
        let gone = telemetry.mode == Some(Px4Mode::TERMINATION) || telemetry.armed == Some(false);
        if context.controller.is_some() || gone || telemetry.stands() {
            return;
        }
        // The termination has ended the set points, even if the vehicle still reports their mode.
        let steered = self.steers(telemetry) || telemetry.mode == Some(Px4Mode::OFFBOARD);
        self.contingencies.controller_lost(effects);
        self.loss_action.begin(on_loss, steered, context.mono());
        self.fly_by_itself(context, effects);
    }

    /// A vehicle that makes no progress is not put on hold if nothing would end the hold: nobody controls it, or a
    /// contingency has sent it there. It returns or lands instead.
    pub(super) fn returns_instead(&mut self, context: &Context<'_>) -> bool {
        if !context.returns_instead(self.contingencies.stands()) {
            return false;
        }
        let again = self.contingencies.begin_again(context.mono());
        if !again {
            self.loss_action.begin(OnLoss::Rtl, false, context.mono());
        }
        true
    }

    /// Flies the loss action or a contingency.
    pub(super) fn fly_by_itself(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let situation = self.situation_of_contingencies(context);
        self.contingencies.watch(&situation, effects);
        let flown = self.flown_contingency(context.vehicle, &context.mission);
        let loss = self.loss_action.urgency();
        if loss.is_some() && flown >= loss {
            self.loss_action
                .end("the vehicle flies a contingency", effects);
        }
        match self.turn() {
            Turn::Nobody => {}
            Turn::Loss => self.fly_loss_action(context, effects),
            Turn::Contingency => self.fly_contingency(context, &situation, effects),
        }
    }

    pub(super) fn situation_of_contingencies(&self, context: &Context<'_>) -> ContingencyContext {
        let config = self.contingencies.config(&context.config.contingency);
        let (vehicle, mission) = (context.vehicle, &context.mission);
        let telemetry = &vehicle.telemetry;
        let outside = |at| mission.is_outside_fence(at);
        let outside = mission
            .has_fence()
            .then_some(&outside as &dyn Fn((f64, f64)) -> bool);
        let [engine, position, fence, battery] = reported(telemetry, &config, outside);
        let waiting = mission.waiting_command();
        let by_itself = self.maneuver.as_ref().map(|(origin, _)| origin.is_none());
        // A return or landing that this VSM commanded belongs to nobody else.
        let other = self.other(vehicle, context.mono());
        let theirs = |other: &Other| !matches!(other, Other::Ending(mode) if self.watched.entered == Some(*mode));
        ContingencyContext {
            now: context.mono(),
            config,
            live: vehicle.live(),
            airborne: telemetry.airborne(),
            down: telemetry.armed == Some(false),
            mode: vehicle.settled_mode(),
            other: other.filter(theirs),
            seen: [engine, position, fence, battery, None],
            carries: mission.uploaded.map(|uploaded| uploaded.route_type),
            flies: mission.flies(telemetry),
            completed: self.completed(vehicle, mission),
            controlled: context.controller.is_some(),
            lands: mission.lands(telemetry),
            busy: by_itself == Some(true) || waiting == Some(None),
            operator_waits: waiting.flatten().is_some(),
            on_final: mission.is_on_final(telemetry) || self.item_is_unknown(context),
            stored: [RouteType::ContingencyA, RouteType::ContingencyB]
                .map(|route| mission.has_route(route)),
            may_change_mission: mission.may_change.is_ok(),
        }
    }

    fn fly_contingency(
        &mut self,
        context: &Context<'_>,
        situation: &ContingencyContext,
        effects: &mut Effects<'_>,
    ) {
        let Some(action) = self.contingencies.poll(situation, effects) else {
            return;
        };
        let telemetry = &context.vehicle.telemetry;
        let has_position = telemetry.evidence.located.is_none_or(|one| one.value);
        let mode = match action {
            ContingencyAction::ContingencyA => Some(Mode::ContingencyA),
            ContingencyAction::ContingencyB => Some(Mode::ContingencyB),
            // Wings land by their pattern.
            ContingencyAction::Land if !telemetry.hovers() && has_position => {
                Some(Mode::AutolandEngage)
            }
            _ => None,
        };
        match mode {
            Some(mode) => self.operate(context, None, &select(mode), false, effects),
            None => {
                let steps = maneuver::enter(contingency::modes(action));
                let maneuver = Maneuver::new(steps, Commanded::default());
                self.begin(context, None, maneuver, effects);
            }
        }
        self.contingencies.announce(&situation.config, effects);
    }

    /// Whether a wing may be on its final approach: no MISSION_CURRENT since a silence has named its item.
    fn item_is_unknown(&self, context: &Context<'_>) -> bool {
        self.item_unknown_until()
            .is_some_and(|until| context.mono() < until)
    }

    /// How long it counts as that.
    pub(super) fn item_unknown_until(&self) -> Option<Duration> {
        self.watched
            .item_unknown_since
            .map(|since| since + ITEM_WITHIN)
    }

    fn loss_context(&self, context: &Context<'_>) -> LossContext {
        let telemetry = &context.vehicle.telemetry;
        LossContext {
            now: context.mono(),
            live: context.vehicle.live(),
            on_ground: telemetry.stands(),
            controlled: context.controller.is_some(),
            // A command that was dropped when control was lost may still take effect: an older report ends no action.
            mode: context.vehicle.settled_mode(),
            awaits_mode: context.vehicle.awaits_mode(),
            carries_contingency: context.mission.carries(RouteType::ContingencyA),
            completed: self.completed_seen(context.vehicle, &context.mission),
            // A command of the VSM itself that waits for its route belongs to this action.
            busy: self.maneuver.is_some() || context.mission.waiting_command() == Some(None),
            on_final: context.mission.is_on_final(telemetry) || self.item_is_unknown(context),
            may_change_mission: context.mission.may_fly(RouteType::ContingencyA).is_ok(),
            other: self.other(context.vehicle, context.mono()),
        }
    }

    /// Decides on a loss action that a restart has cut off.
    pub(super) fn watch_cut_off_loss(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if !self.loss_action.is_cut_off() {
            return;
        }
        let mut loss = self.loss_context(context);
        // On the ground PX4 may be in AUTO.LOITER too.
        loss.live &= context.vehicle.telemetry.landed.is_some();
        self.loss_action.watch_cut_off(&loss, effects);
    }

    fn fly_loss_action(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let loss = self.loss_context(context);
        match self.loss_action.poll(&loss, effects) {
            None => {}
            Some(Action::Hold) => {
                self.operate(context, None, &select(Mode::Loiter), false, effects);
            }
            Some(Action::Contingency) => {
                self.operate(context, None, &select(Mode::ContingencyA), false, effects);
            }
            Some(Action::Return) => {
                // No mode of 2016 means a plain return: mode 23 flies the contingency route if there is one.
                let steps = maneuver::enter(&[Px4Mode::RTL]);
                let maneuver = Maneuver::new(steps, Commanded::default());
                self.begin(context, None, maneuver, effects);
            }
        }
    }

    /// An interrupted launch must not leave motors running, and neither must a failed one. A vehicle that is still on the
    /// ground is disarmed; if it is flying, operators are warned.
    pub(super) fn end_cut_off_launch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let telemetry = &context.vehicle.telemetry;
        let flies = telemetry.airborne();
        // Until both are known, a disarm command might stop a vehicle in the air.
        let known = context.vehicle.live() && telemetry.landed.is_some();
        let (true, true, Some(armed)) = (self.launch_cut_off, known, telemetry.armed) else {
            return;
        };
        self.launch_cut_off = false;
        // A command sent since the restart takes precedence.
        if self.maneuver.is_some() || !(armed || flies) {
            return;
        }
        // A launch puts the vehicle on hold before arming it.
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

    /// Drops a command that waits for its route if a pilot or a failsafe has taken the vehicle meanwhile. An upload takes
    /// many seconds on a slow radio, and the command would then take the vehicle from them. This needs a report that is
    /// newer than the last command: an older one may show POSCTL by sticks that this command has released.
    pub(super) fn give_way(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if !self.watched.mode_changed || context.vehicle.settled_mode().is_none() {
            return;
        }
        self.watched.mode_changed = false;
        let Some(other) = self.other(context.vehicle, context.mono()) else {
            return;
        };
        // Also, do not keep retrying a mode that was not entered at once when no CUCS is commanding it now.
        let enters = |(origin, maneuver): &(Option<Origin>, Maneuver)| {
            origin.is_none() && maneuver.enters_a_mode()
        };
        if matches!(other, Other::Pilot(_)) && self.maneuver.as_ref().is_some_and(enters) {
            let own = |origin: Option<Origin>| origin.is_none();
            self.end_running(context, &other.to_string(), own, effects);
        }
        if context.mission.waiting_command().is_some() {
            effects.request(Request::DropWaitingCommand {
                why: other.to_string(),
                without_right: false,
            });
        }
    }
}

/// MISSION_CURRENT comes once a second, and may be lost.
const ITEM_WITHIN: Duration = Duration::from_secs(5);

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{MavCmd, MavResult};

    use super::super::tests::{handle, lose, watch};
    use super::super::{Flight, Input};
    use super::*;
    use crate::session::testing::World;

    /// A temporarily rejected command is retried, but not if a pilot has taken the vehicle since.
    #[test]
    fn a_mode_of_its_own_is_not_commanded_again_over_a_pilot() {
        for taken in [false, true] {
            let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
            lose(&mut world, &mut flight);
            handle(&mut world, &mut flight, Input::Advance);
            assert_eq!(world.commanded_modes(), [Px4Mode::RTL]);
            let later = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
            for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, later) {
                handle(&mut world, &mut flight, Input::CommandEnded(&event));
            }
            if taken {
                world.show_mode(Px4Mode::POSCTL);
                handle(&mut world, &mut flight, Input::ModeChanged);
            }
            let again = watch(&mut world, &mut flight, 8);
            assert_eq!(again.is_empty(), taken, "{again:?}");
        }
    }

    /// Nothing would end a hold that no operator sees.
    #[test]
    fn a_vehicle_that_is_stopped_returns_where_nobody_controls_it() {
        for (controlled, on_loss, expected) in [
            (true, OnLoss::Rtl, Px4Mode::LOITER),
            (false, OnLoss::Continue, Px4Mode::LOITER),
            (false, OnLoss::Hold, Px4Mode::RTL),
            (false, OnLoss::Contingency, Px4Mode::RTL),
        ] {
            let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
            world.settings.authority.on_loss = on_loss;
            if !controlled {
                world.controller = None;
            }
            handle(&mut world, &mut flight, Input::Hold);
            handle(&mut world, &mut flight, Input::Advance);
            assert_eq!(world.commanded_modes(), [expected], "{on_loss:?}");
        }
    }
}
