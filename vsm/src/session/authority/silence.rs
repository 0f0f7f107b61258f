//! Silent holders: a warning, then their rights are offered to others, then they are lost. Each step is reported by 16000
//! and 35000.

use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, HandoverStatus, RouteType, SubsystemId};

use super::rules::{Handover, Silence};
use super::{AuthorityMachine, Context, Of, Unstored};
use crate::config::OnLoss;
use crate::session::alerts::Cause;
use crate::session::context::may_be_on_final;
use crate::session::effects::{Effects, Request};
use crate::session::other::Other;

impl AuthorityMachine {
    pub(super) fn watch_silence(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        self.record.write_repetitions(context, effects);
        self.record.store_owed(&self.decided, context, effects);
        for station in context.stations {
            let id = station.id();
            let takes_part = |one: &Handover| one.to == id || one.from == Some(id);
            let holds = !self.decided.held(id).is_empty();
            if holds || self.decided.pending().iter().any(takes_part) {
                self.record
                    .store_station(&self.decided, station, context, effects);
            }
            if !holds {
                continue;
            }
            let silence = station.silence(context.mono(), &context.settings.authority);
            if silence != self.decided.silence(id) && self.decided.commands(id) {
                self.decide(
                    context,
                    Of::Silence(id, silence),
                    effects,
                    |authority, at| authority.silence_of(at, id, silence),
                );
            }
        }
        // A slow or hanging disk must not delay the loss action either.
        let overdue = |one: &Unstored| {
            let waited = context.mono().saturating_sub(one.since);
            waited > DISK_WITHIN && one.of.cannot_wait()
        };
        while self.unstored.iter().any(overdue)
            && let Some(one) = self.unstored.pop_front()
        {
            self.take_effect(context, one, effects);
        }
        self.settle(context, effects);
    }

    pub(super) fn report_silence(
        &self,
        context: &Context<'_>,
        id: Id,
        silence: Silence,
        effects: &mut Effects<'_>,
    ) {
        let (priority, text, status) = match silence {
            Silence::None => {
                effects.clear(Cause::CucsSilent, "link to the controlling CUCS restored");
                let status = HandoverStatus::NotRequested;
                return self.report_handover(context, Some(id), None, status, effects);
            }
            Silence::Warned => (
                AlertPriority::Caution,
                format!("no data from the controlling CUCS {id}"),
                HandoverStatus::NotRequested,
            ),
            Silence::Offered => (
                AlertPriority::Warning,
                format!("no data from the controlling CUCS {id}: another may take control"),
                HandoverStatus::InProgress,
            ),
            Silence::Lost => (
                AlertPriority::Emergency,
                format!(
                    "the controlling CUCS {id} is lost, nobody controls the vehicle: {}",
                    what_follows(context)
                ),
                HandoverStatus::Failed,
            ),
        };
        // An earlier requester already has control: nothing is offered, and no loss action is flown.
        let taken = self.rights.controller().is_some_and(|holder| holder != id);
        if taken {
            return;
        }
        // Send it to the silent CUCS too: it may still receive.
        let mut to = effects.listeners.clone();
        to.extend(context.station_of(id));
        to.sort_unstable();
        to.dedup();
        let raised = effects
            .alerts
            .raise(Cause::CucsSilent, priority, SubsystemId::Comms, text);
        effects.dli.alert(context.id(), &to, raised);
        self.report_handover(context, Some(id), None, status, effects);
        if silence == Silence::Lost {
            // After `ControlChanged`, which the decision has requested: it puts a steered vehicle on hold, and would
            // supersede the loss action if it came second.
            effects.request(Request::ControllerLost);
        }
    }
}

/// The text for what is flown while nobody controls the vehicle, as far as known before the vehicle reports it.
fn what_follows(context: &Context<'_>) -> String {
    let on_loss = context.settings.authority.on_loss;
    let telemetry = &context.vehicle.telemetry;
    let interrupts = on_loss != OnLoss::Continue;
    // Every other loss action goes before a held command.
    let held = context.held_for_loss.filter(|_| !interrupts);
    if context.termination.holds {
        return "a flight termination is commanded: no other command is sent".to_owned();
    }
    if !context.vehicle.live() {
        return match on_loss {
            OnLoss::Continue if held.is_none() => "no data from the vehicle either",
            _ => "no data from the vehicle either, it is commanded once its link is restored",
        }
        .to_owned();
    }
    if telemetry.stands() && held.is_none() {
        return "vehicle is on the ground, nothing is commanded".to_owned();
    }
    let mission = &context.mission;
    let stored = mission
        .plan
        .route_of_type(RouteType::ContingencyA)
        .is_some();
    if interrupts && mission.is_on_final(telemetry) {
        return "vehicle is on its final approach, which it completes".to_owned();
    }
    if interrupts && may_be_on_final(telemetry) {
        return "nothing is commanded before it is known whether the vehicle is on its final approach"
            .to_owned();
    }
    if let (true, Some(mode), None) = (context.shows_loss_action, telemetry.mode, held) {
        return format!(
            "vehicle is in {} already, nothing is commanded",
            mode.name()
        );
    }
    if interrupts || context.steering || held.is_some() {
        match context.other {
            Some(other @ Other::Pilot(_)) => return format!("{other}; nothing is commanded"),
            Some(other) if other.may_stay() => {
                return format!("{other}; nothing is commanded before it ends, for 30 s at most");
            }
            // A held command does not wait for its end: it is refused.
            Some(other) if !(interrupts || context.steering) => {
                return format!("{other}; nothing is commanded");
            }
            Some(other) => return format!("{other}; nothing is commanded before it ends"),
            None => {}
        }
    }
    if context.contingency_first {
        return "a contingency of the vehicle goes first, see its alert".to_owned();
    }
    if let Some(number) = held {
        return if context.steering {
            format!("steering stopped; commanding hold, then held command {number}")
        } else {
            format!("held command {number} is carried out")
        };
    }
    match on_loss {
        // A vehicle that was steered (mode 15) would fly straight on: it is put on hold even if no loss action is
        // configured.
        OnLoss::Continue if context.steering => "steering stopped; commanding hold",
        OnLoss::Continue => "vehicle continues in its current mode",
        OnLoss::Hold => "commanding hold",
        OnLoss::Contingency if stored => match mission.may_fly(RouteType::ContingencyA) {
            Ok(()) => "commanding contingency A",
            Err(why) => return format!("{why}; commanding return"),
        },
        OnLoss::Contingency => "no contingency A is stored; commanding return",
        OnLoss::Rtl => "commanding return",
    }
    .to_owned()
}

/// How long the loss action waits for the disk.
const DISK_WITHIN: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use mapping::mode::Px4Mode;
    use mavlink_link::dialect::MavType;

    use super::*;
    use crate::session::testing::World;

    fn announced(world: &mut World, other: Option<Other>) -> String {
        world.settings.authority.on_loss = OnLoss::Rtl;
        follows(world, other, None)
    }

    fn follows(world: &mut World, other: Option<Other>, held_for_loss: Option<u16>) -> String {
        let shown = world.vehicle.telemetry.mode == Some(Px4Mode::RTL);
        world.act(|common, views, _| {
            what_follows(&Context {
                common,
                mission: views.mission,
                steering: false,
                other,
                contingency_first: false,
                shows_loss_action: shown,
                held_for_loss,
            })
        })
    }

    #[test]
    fn a_held_command_is_announced_where_nothing_else_is_flown() {
        let mut world = World::airborne(Px4Mode::MISSION);
        let text = follows(&mut world, None, None);
        assert_eq!(text, "vehicle continues in its current mode");
        let text = follows(&mut world, None, Some(3));
        assert_eq!(text, "held command 3 is carried out");
        let pilot = Some(Other::Pilot(Px4Mode::POSCTL));
        assert!(follows(&mut world, pilot, Some(3)).ends_with("nothing is commanded"));
        world.settings.authority.on_loss = OnLoss::Rtl;
        let text = follows(&mut world, None, Some(3));
        assert_eq!(text, "commanding return");
    }

    #[test]
    fn nothing_is_announced_that_is_not_commanded() {
        let mut world = World::airborne(Px4Mode::MISSION);
        assert_eq!(announced(&mut world, None), "commanding return");
        world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_FIXED_WING);
        assert!(announced(&mut world, None).starts_with("nothing is commanded before"));
        world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_QUADROTOR);
        let pilot = Some(Other::Pilot(Px4Mode::POSCTL));
        assert!(announced(&mut world, pilot).ends_with("nothing is commanded"));
        let failsafe = Some(Other::Failsafe(Px4Mode::LOITER));
        assert!(announced(&mut world, failsafe).ends_with("before it ends, for 30 s at most"));
        world.show_mode(Px4Mode::RTL);
        let text = announced(&mut world, None);
        assert_eq!(text, "vehicle is in AUTO.RTL already, nothing is commanded");
        world.termination.holds = true;
        let text = announced(&mut world, None);
        assert_eq!(
            text,
            "a flight termination is commanded: no other command is sent"
        );
    }
}
