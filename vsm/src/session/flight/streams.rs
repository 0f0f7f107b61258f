//! Streams that must not starve while the vehicle is flown by them, and what becomes of them where PX4's failsafe has it.

use mapping::mode::Px4Mode;
use mavlink_link::dialect::MavMessage;

use super::steering::Taken;
use super::sticks::{Due, lost_within};
use super::{Context, Flight};
use crate::session::effects::Effects;
use crate::session::link::state::VehicleState;
use crate::session::maneuver::Maneuver;
use crate::session::other::Other;

/// Streams.
impl Flight {
    pub(super) fn stream_sticks(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let (now, mode) = (context.mono(), context.vehicle.telemetry.mode);
        if let Some(mode) = context.vehicle.settled_mode() {
            self.sticks.note_first_mode(now, mode);
        }
        if context.vehicle.telemetry.armed == Some(false) {
            let within = lost_within(context.parameters.values);
            self.sticks.note_disarmed(now, within);
        }
        let by_hand = mode == Some(Px4Mode::POSCTL);
        let leaves = |(_, maneuver): &(_, Maneuver)| maneuver.is_leaving(Px4Mode::POSCTL);
        let leaves = by_hand && self.maneuver.as_ref().is_some_and(leaves);
        if context.vehicle.awaits_mode() {
            return self.sticks.withhold(now);
        }
        if leaves {
            if self.sticks.are_apart(now) {
                self.still_sticks(context, effects);
            }
            return self.sticks.withhold(now);
        }
        let ends = self.maneuver.as_ref();
        let ends = ends.is_some_and(|(_, maneuver)| maneuver.ends_sticks());
        if ends && self.sticks.are_aside() {
            return self.sticks.withhold(now);
        }
        self.stand_aside(context, !ends, effects);
        let system = context.config.system_id;
        let newer = context.vehicle.state_is_newer_than_command();
        match self.sticks.advance(now, (mode, newer), system) {
            Due::None => {}
            Due::Send(sticks) => effects.vehicle.post(MavMessage::MANUAL_CONTROL(sticks)),
            Due::Stopped => effects.warn_of_link(
                "the sticks (2010) have stopped: the vehicle acts by its own parameters",
            ),
        }
    }

    /// `uncommanded`: no other mode than that of the sticks is commanded.
    fn stand_aside(&mut self, context: &Context<'_>, uncommanded: bool, effects: &mut Effects<'_>) {
        let telemetry = &context.vehicle.telemetry;
        let failsafe = flies_failsafe(context.vehicle).filter(|_| uncommanded);
        let were_aside = self.sticks.are_aside();
        let cease = self.sticks.stand_aside(context.mono(), failsafe.is_some());
        let by_hand = telemetry.mode == Some(Px4Mode::POSCTL) && telemetry.armed != Some(false);
        match failsafe {
            Some(mode) if cease => advise_centred(mode, effects),
            None if were_aside && by_hand => effects.warn_of_link(format!(
                "the vehicle is in {} again, by itself or by a pilot: the sticks (2010) end, which would keep out a pilot's, and without \
                 any it acts by its own parameters; command mode 2 (manual) to steer by them",
                Px4Mode::POSCTL.name()
            )),
            _ => {}
        }
    }

    pub(super) fn still_sticks(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let still = (self.sticks).stand_still(context.mono(), context.config.system_id);
        if let Some(still) = still {
            effects.vehicle.post(MavMessage::MANUAL_CONTROL(still));
        }
    }

    pub(super) fn stream_set_points(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let limits = &context.parameters.limits(context);
        let system = context.config.system_id;
        // PX4 holds in between, for want of the sticks that this maneuver has ended.
        let again = |(_, one): &(_, Maneuver)| one.ends_sticks() && one.enters(Px4Mode::OFFBOARD);
        if self.maneuver.as_ref().is_some_and(again) {
            self.steering.enter_once_more();
        }
        let holds = holds_for_set_points(context);
        match (self.steering).note_mode(context.mono(), context.vehicle, holds) {
            Some(Taken::ByFailsafe) => effects.warn_of_link(STANDS_STILL),
            Some(Taken::Back) => effects.warn_of_link(
                "the vehicle is in OFFBOARD again, by itself or by a pilot: it hovers by set points that stand still; command mode 15 \
                 (autopilot) to steer it, or another mode",
            ),
            None => {}
        }
        let due = self
            .steering
            .advance(context.mono(), context.vehicle, limits, system);
        if let Some(message) = due {
            effects.vehicle.post(message);
        }
    }
}

/// The mode in which the vehicle flies by itself as a failsafe of PX4. What it steers by sticks alone, as without a position, is left to
/// their loss. A vehicle that is disarmed misses none.
pub(super) fn flies_failsafe(vehicle: &VehicleState) -> Option<Px4Mode> {
    let by_itself = |mode: Px4Mode| mode.main() == Px4Mode::LOITER.main();
    match Other::of(&vehicle.telemetry)? {
        Other::Failsafe(mode) if by_itself(mode) && vehicle.may_fly() => Some(mode),
        _ => None,
    }
}

/// Whether PX4 holds the vehicle as its failsafe, and would act for want of set points. A PX4 that holds for that (COM_OBL_RC_ACT 5) may do so
/// already, and would leave its hold for new ones.
pub(super) fn holds_for_set_points(context: &Context<'_>) -> bool {
    let acts = context.parameters.get("COM_OBL_RC_ACT");
    flies_failsafe(context.vehicle) == Some(Px4Mode::LOITER)
        && acts.is_some_and(|action| action != HOLD)
}

/// Reports that centred sticks are sent in place of those that come.
pub(super) fn advise_centred(failsafe: Px4Mode, effects: &mut Effects<'_>) {
    effects.advise(format!(
        "the sticks (2010) do not steer: the vehicle flies {} as its failsafe, and stays in it while they come; command mode 2 (manual) to \
         steer by them",
        failsafe.name()
    ));
}

pub(super) const STANDS_STILL: &str = "the vehicle holds as its failsafe, and is not steered: set points stand still as long as it does, since it \
                            would act for want of them too; command mode 15 (autopilot) again to steer it, or another mode";
/// COM_OBL_RC_ACT.
const HOLD: f64 = 5.0;
