//! What CUCSs have set by 50023, beside the configuration: never less than that promises.

use mavlink_link::store::StoreError;

use super::priority::Urgency;
use super::{Contingencies, Outlet, Provision, Setting};
use crate::config::{Contingency, ContingencyAction as Action};
use crate::session::trigger::Trigger;

impl Contingencies {
    /// The configuration, with what CUCSs have set where that is not less: it may have been set before the configuration was
    /// changed.
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
                // Where nothing is configured its level promises nothing.
                let least = least.map_or(0, |_| configured.battery_percent);
                config.battery_percent = percent.max(least);
            }
        }
        config
    }

    /// The configuration promises more than a CUCS wants to set: what that is.
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

    /// Sets what is flown for a cause, or forgets what was set.
    ///
    /// # Errors
    /// It cannot be stored: what was set before stays.
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

impl Trigger {
    /// Its key in `vehicle.contingency`, and what is set there.
    fn key(self, config: &mut Provision) -> (&'static str, &mut Option<Action>) {
        match self {
            Trigger::Engine => ("engine", &mut config.engine),
            Trigger::Position => ("position", &mut config.position),
            Trigger::Fence => ("fence", &mut config.fence),
            Trigger::Battery => ("battery", &mut config.battery),
            Trigger::Link => ("link", &mut config.link),
        }
    }
}

/// Whether an action is less than another.
fn is_less(action: Action, least: Action) -> bool {
    Urgency::of_contingency(action) < Urgency::of_contingency(least)
}
