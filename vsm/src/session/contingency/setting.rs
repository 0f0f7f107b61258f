//! Settings of CUCSs by 50023, in addition to the configuration: never less than that promises.

use mavlink_link::store::StoreError;

use super::priority::Urgency;
use super::{Contingencies, Outlet, Provision, Setting};
use crate::config::{Contingency, ContingencyAction as Action};
use crate::session::trigger::Trigger;

impl Contingencies {
    /// The configuration with the settings of CUCSs, as far as these are not less: they may be older than a change of the
    /// configuration.
    pub(crate) fn config(&self, configured: &Contingency) -> Provision {
        let configured = &Provision::from(*configured);
        let mut config = *configured;
        for one in &self.set {
            let least = one.trigger.action(configured);
            let (_, action) = one.trigger.key(&mut config);
            if !least.is_some_and(|least| is_less(one.action, least)) {
                *action = Some(one.action);
            }
            if let Some(percent) = one.percent {
                // If no action is configured, the configured level promises nothing.
                let least = least.map_or(0, |_| configured.battery_percent);
                config.battery_percent = percent.max(least);
            }
        }
        config
    }

    /// What the configuration promises, if that is more than a CUCS wants to set.
    pub(crate) fn promised_more(setting: &Setting, configured: &Contingency) -> Option<String> {
        let configured = &Provision::from(*configured);
        let least = setting.trigger.action(configured)?;
        if is_less(setting.action, least) {
            let mut copy = *configured;
            let (key, _) = setting.trigger.key(&mut copy);
            return Some(format!(
                "a {} is less than the {} that vehicle.contingency.{key} promises: expected that or what is more urgent (hold, \
                 route, return, landing)",
                setting.action.name(),
                least.name()
            ));
        }
        let (percent, promised) = (setting.percent?, configured.battery_percent);
        (percent < promised).then(|| {
            format!(
                "Contingency Percent {percent} % is later than the {promised} % of vehicle.contingency.battery_percent: expected \
                 {promised} to 90"
            )
        })
    }

    /// Sets the action for a cause, or removes the setting.
    ///
    /// # Errors
    /// It cannot be stored: the earlier setting stays.
    pub(crate) fn provision(
        &mut self,
        trigger: Trigger,
        setting: Option<Setting>,
        effects: &mut dyn Outlet,
    ) -> Result<(), StoreError> {
        let before = self.set.clone();
        self.set.retain(|one| one.trigger != trigger);
        self.set.extend(setting);
        self.store(effects).inspect_err(|_| self.set = before)
    }
}

/// Whether an action is less than another.
fn is_less(action: Action, least: Action) -> bool {
    Urgency::of_contingency(action) < Urgency::of_contingency(least)
}
