//! Contingencies by message (50023): set by the CUCS in control before the flight, and read back.
//!
//! A setting of a CUCS overrides the configuration and stays in effect for the vehicle, over restarts and handovers, until
//! the next 50023 for that cause. It can only be stricter than the configuration: no less urgent action and no lower
//! threshold. It cannot be changed in the air: a CUCS that takes control there can read the settings (17002), and can
//! command another mode if needed.

use stanag_msgs::enums::{AckType, ContingencyAction, ContingencyCause, ContingencyState};
use stanag_msgs::messages::Contingency;

use super::{Context, Flight};
use crate::config;
use crate::session::context::Origin;
use crate::session::contingency::{Contingencies, Setting, Standing};
use crate::session::effects::Effects;
use crate::session::trigger::Trigger;

impl Flight {
    /// 50023.
    pub(super) fn provision_contingency(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Contingency,
        effects: &mut Effects<'_>,
    ) {
        let (trigger, setting) = match checked(message, context) {
            Ok(checked) => checked,
            Err(why) => return effects.refuse(Some(origin), why),
        };
        let configured = &context.config.contingency;
        if let Some(why) = setting.and_then(|one| Contingencies::promised_more(&one, configured)) {
            return effects.refuse(Some(origin), why);
        }
        // Store before the 17000: an acknowledged setting must apply in the flight, whatever happens to the VSM before it.
        if let Err(fault) = self.contingencies.provision(trigger, setting, effects) {
            return effects.refuse(Some(origin), format!("it cannot be stored: {fault}"));
        }
        effects.acknowledge(&origin, AckType::CarriedOut);
        let report = self.report_contingency(context, trigger, effects);
        effects.publish_to_listeners(&report.into());
    }

    /// 17002 for 50023.
    pub(super) fn list_contingencies(
        &self,
        context: &Context<'_>,
        station: usize,
        effects: &mut Effects<'_>,
    ) {
        for trigger in Trigger::OF_VEHICLE {
            let report = self.report_contingency(context, trigger, effects);
            effects.send(station, &report.into());
        }
    }

    fn report_contingency(
        &self,
        context: &Context<'_>,
        trigger: Trigger,
        effects: &mut Effects<'_>,
    ) -> Contingency {
        let situation = self.situation_of_contingencies(context);
        let action = trigger.action(&situation.config);
        let seen = situation.seen.get(trigger.index()).copied().flatten();
        let state = match self.contingencies.standing(trigger) {
            _ if action.is_none() => ContingencyState::None,
            Standing::Commanded => ContingencyState::Commanded,
            Standing::Flown => ContingencyState::Flown,
            Standing::Ended => ContingencyState::Ended,
            // The last report of a silent vehicle may no longer hold.
            Standing::Absent if situation.live && seen.is_some() => ContingencyState::Watched,
            Standing::Absent => ContingencyState::Unreported,
        };
        let percent = situation.config.battery_percent;
        Contingency {
            time_stamp: Some(effects.stamp()),
            contingency_cause: Some(cause(trigger)),
            contingency_action: Some(action.map_or(ContingencyAction::AsConfigured, reported)),
            contingency_percent: (trigger == Trigger::Battery).then_some(percent),
            contingency_state: Some(state),
        }
    }
}

/// The setting in a 50023; `None` for the configured one.
fn checked(
    message: &Contingency,
    context: &Context<'_>,
) -> Result<(Trigger, Option<Setting>), String> {
    let trigger = match message.contingency_cause {
        None => return Err("Contingency Cause is missing".to_owned()),
        Some(ContingencyCause::Unknown(value)) => {
            return Err(format!("Contingency Cause {value}, expected 1 to 4"));
        }
        Some(ContingencyCause::Battery) => Trigger::Battery,
        Some(ContingencyCause::Position) => Trigger::Position,
        Some(ContingencyCause::Fence) => Trigger::Fence,
        Some(ContingencyCause::Engine) => Trigger::Engine,
    };
    use config::ContingencyAction as Action;
    let action = match message.contingency_action {
        None => return Err("Contingency Action is missing".to_owned()),
        Some(ContingencyAction::Unknown(value)) => {
            return Err(format!("Contingency Action {value}, expected 0 to 5"));
        }
        Some(ContingencyAction::AsConfigured) => None,
        Some(ContingencyAction::Hold) => Some(Action::Hold),
        Some(ContingencyAction::Return) => Some(Action::Rtl),
        Some(ContingencyAction::Landing) => Some(Action::Land),
        Some(ContingencyAction::ContingencyA) => Some(Action::ContingencyA),
        Some(ContingencyAction::ContingencyB) => Some(Action::ContingencyB),
    };
    if trigger == Trigger::Position && action.is_some_and(|action| action != Action::Land) {
        return Err(
            "a lost position: expected Contingency Action 3 (landing), every other needs one"
                .to_owned(),
        );
    }
    let percent = message.contingency_percent;
    match percent {
        Some(_) if trigger != Trigger::Battery || action.is_none() => {
            return Err("Contingency Percent is of cause 1 (battery) with an action".to_owned());
        }
        Some(value) if !(1..=90).contains(&value) => {
            return Err(format!("Contingency Percent {value} %, expected 1 to 90"));
        }
        _ => {}
    }
    let telemetry = &context.vehicle.telemetry;
    if !(context.vehicle.live() && telemetry.stands()) {
        return Err(
            "a contingency is set before the flight: the vehicle does not report that it is on the ground"
                .to_owned(),
        );
    }
    let setting = action.map(|action| Setting {
        trigger,
        action,
        percent,
    });
    Ok((trigger, setting))
}

fn cause(trigger: Trigger) -> ContingencyCause {
    match trigger {
        Trigger::Battery => ContingencyCause::Battery,
        Trigger::Position => ContingencyCause::Position,
        Trigger::Fence => ContingencyCause::Fence,
        Trigger::Engine => ContingencyCause::Engine,
        // Exists on an agent only, and is never listed.
        Trigger::Link => ContingencyCause::Unknown(0),
    }
}

fn reported(action: config::ContingencyAction) -> ContingencyAction {
    match action {
        config::ContingencyAction::Hold => ContingencyAction::Hold,
        config::ContingencyAction::Rtl => ContingencyAction::Return,
        config::ContingencyAction::Land => ContingencyAction::Landing,
        config::ContingencyAction::ContingencyA => ContingencyAction::ContingencyA,
        config::ContingencyAction::ContingencyB => ContingencyAction::ContingencyB,
    }
}
