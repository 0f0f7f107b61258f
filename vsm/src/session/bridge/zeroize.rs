//! Zeroize (50024): an order of a CUCS with LOI 5, or of an operator of this computer, for the whole VSM.
//!
//! [`rules`](crate::session::zeroize) decides. This module converts an order to the input of the rules, and their decision
//! to answers, alerts to every listening station, and entries of every vehicle's audit log. The bridge itself erases
//! nothing. The shell asks it whether an order has to be stored ([`Bridge::zeroize_to_store`]), stores it, reports the
//! result ([`Bridge::zeroize_stored`]), ends, and erases the files on disk.

use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::Id;
use stanag_msgs::enums::{AckType, AlertPriority, SubsystemId};
use stanag_msgs::messages::ZeroizeCommand;

use super::Bridge;
use crate::session::alerts::Cause;
use crate::session::authority;
use crate::session::context::Origin;
use crate::session::two_steps::{self, Order};
use crate::session::zeroize::{Circumstances, Fleet, Outcome, Refusal, Stage, text};

impl Bridge {
    /// 50024 of a CUCS that holds the right, to this vehicle.
    pub(super) fn order_zeroize(
        &mut self,
        now: Now,
        origin: Origin,
        vehicle: Id,
        command: &ZeroizeCommand,
        disk: &mut dyn Disk,
    ) {
        let state = command.commanded_zeroize_state;
        let done = two_steps::order(state, "Commanded Zeroize State").and_then(|order| {
            let at = self.circumstances(now, &origin, vehicle);
            let at = at.ok_or("it needs its Time Stamp (field 0)")?;
            let armed_s = self.zeroize.settings.armed_s;
            let done = self.zeroize.rules.order(order, &at);
            done.map(|outcome| (order, outcome)).map_err(|refusal| {
                let why = text::refusal(refusal, armed_s);
                if refusal != Refusal::Steps(two_steps::Refusal::NotPlanned) {
                    // All stations are notified of an attempt to erase the VSM.
                    let text = format!("zeroize of {} refused: {why}", at.by);
                    self.alert_of_zeroize(now, None, text, disk);
                }
                why
            })
        });
        let (mut dli, aircraft) = self.effects(now, disk);
        match done {
            Err(why) => {
                if let Some(one) = aircraft.find_mut(vehicle) {
                    one.effects(&mut dli).refuse(Some(origin), why);
                }
            }
            Ok((order, outcome)) => {
                match order {
                    Order::Execute => {
                        // 17000 type 2 follows once the order is stored.
                        dli.acknowledge(vehicle, &origin, AckType::Received);
                        self.zeroize.waiting = Some(Some((vehicle, origin)));
                        self.zeroize.in_flight = self.zeroize.settings.in_flight;
                    }
                    Order::Arm | Order::Reset => {
                        dli.acknowledge(vehicle, &origin, AckType::CarriedOut);
                        self.zeroize.vehicle = Some(vehicle);
                    }
                }
                self.conclude_zeroize(now, outcome, disk);
            }
        }
    }

    /// An operator of this computer orders it. It needs no second step: the operator has confirmed it.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn zeroize_here(
        &mut self,
        now: Now,
        in_flight: bool,
        disk: &mut dyn Disk,
    ) -> Result<(), String> {
        let (fleet, armed_s) = (self.fleet(None), self.zeroize.settings.armed_s);
        let outcome = self.zeroize.rules.order_here(in_flight, fleet);
        let outcome = outcome.map_err(|refusal| text::refusal(refusal, armed_s))?;
        (self.zeroize.waiting, self.zeroize.in_flight) = (Some(None), in_flight);
        self.conclude_zeroize(now, outcome, disk);
        Ok(())
    }

    /// Whether an order has to be stored now.
    #[must_use]
    pub fn zeroize_to_store(&self) -> bool {
        self.zeroize.waiting.is_some()
    }

    /// The order is stored and will be carried out whatever happens; or it is uncertain (why) whether it is, and it is
    /// carried out; or it could not be stored, and nothing is erased.
    pub fn zeroize_stored(
        &mut self,
        now: Now,
        stored: Result<Option<String>, String>,
        disk: &mut dyn Disk,
    ) {
        let waiting = self.zeroize.waiting.take().flatten();
        let text = match &stored {
            Ok(None) => None,
            Ok(Some(why)) => Some(format!("ZEROIZE ORDERED, BUT NOT SURELY STORED: {why}")),
            Err(why) => {
                self.zeroize.rules.not_stored();
                self.mark_zeroizing();
                Some(format!("ZEROIZE NOT DONE: {why}"))
            }
        };
        if let Some(text) = text {
            self.alert_of_zeroize(now, Some(AlertPriority::Emergency), text, disk);
        }
        let (mut dli, aircraft) = self.effects(now, disk);
        let Some((vehicle, origin)) = waiting else {
            return;
        };
        match stored {
            Ok(None) => dli.acknowledge(vehicle, &origin, AckType::CarriedOut),
            // Neither answer of 17000 would be true: the alert describes the state.
            Ok(Some(_)) => {}
            Err(why) => {
                if let Some(one) = aircraft.find_mut(vehicle) {
                    one.effects(&mut dli).refuse(Some(origin), why);
                }
            }
        }
    }

    /// Whether the order is meant for vehicles in flight too: agents get the same order.
    #[must_use]
    pub fn zeroizes_in_flight(&self) -> bool {
        self.zeroize.in_flight
    }

    /// The result beyond this computer: at the agent of a vehicle, or for its autopilot's key.
    pub fn zeroized_beyond(&mut self, now: Now, vehicle: Id, what: &str, disk: &mut dyn Disk) {
        let why = &format!("ZEROIZE of vehicle {vehicle}: {what}");
        let (mut dli, aircraft) = self.effects(now, disk);
        if let Some(one) = aircraft.find_mut(vehicle) {
            let (what, by) = ("zeroize beyond this computer", None);
            one.ask_authority(&mut dli, authority::Input::Audit { what, by, why });
        }
        let listeners = self.all_listeners();
        let (mut dli, _) = self.effects(now, disk);
        let (priority, subsystem) = (AlertPriority::Emergency, SubsystemId::VsmStatus);
        let raised = dli
            .alerts
            .notice(now.mono, priority, subsystem, why.clone());
        dli.alert_each(&listeners, raised);
    }

    pub(super) fn watch_zeroize(&mut self, now: Now, disk: &mut dyn Disk) {
        let vehicle = self.zeroize.vehicle;
        let armed_by = vehicle.and_then(|id| self.aircraft.find(id));
        let controller = armed_by.and_then(|one| one.authority.controller());
        let controls = |by| controller == Some(by);
        if let Some(outcome) = self.zeroize.rules.watch(now.mono, controls) {
            self.conclude_zeroize(now, outcome, disk);
        }
    }

    fn mark_zeroizing(&mut self) {
        let ordered = self.zeroize.rules.stage() == Stage::Ordered;
        for one in self.aircraft.iter_mut() {
            one.zeroizing = ordered;
        }
    }

    fn conclude_zeroize(&mut self, now: Now, outcome: Outcome, disk: &mut dyn Disk) {
        let words = text::outcome(outcome, self.zeroize.settings.armed_s);
        self.mark_zeroizing();
        if !matches!(outcome, Outcome::Reset(_, false)) {
            self.audit_each(text::audit(outcome), &words, now, disk);
        }
        let priority = match self.zeroize.rules.stage() {
            Stage::Safe => None,
            Stage::Armed { .. } => Some(AlertPriority::Warning),
            Stage::Ordered => Some(AlertPriority::Emergency),
        };
        self.alert_of_zeroize(now, priority, words, disk);
    }

    /// Sends an alert to every station that listens to any vehicle; without a priority it is a single event.
    fn alert_of_zeroize(
        &mut self,
        now: Now,
        priority: Option<AlertPriority>,
        text: String,
        disk: &mut dyn Disk,
    ) {
        let listeners = self.all_listeners();
        let safe = self.zeroize.rules.stage() == Stage::Safe;
        let (mut dli, _) = self.effects(now, disk);
        let subsystem = SubsystemId::VsmStatus;
        if safe {
            let raised = dli.alerts.clear(Cause::Zeroize, "zeroize is not armed");
            dli.alert_each(&listeners, raised);
        }
        let raised = match priority {
            Some(priority) if !safe => dli.alerts.raise(Cause::Zeroize, priority, subsystem, text),
            _ => dli
                .alerts
                .notice(now.mono, AlertPriority::Warning, subsystem, text),
        };
        dli.alert_each(&listeners, raised);
    }

    fn circumstances(&self, now: Now, origin: &Origin, vehicle: Id) -> Option<Circumstances> {
        let station = self.stations.get(origin.station)?;
        let one = self.aircraft.find(vehicle)?;
        Some(Circumstances {
            now: now.mono,
            by: station.id(),
            stamp: origin.stamp?,
            controls: one.authority.controller() == Some(station.id()),
            handover: one.authority.is_handed_over(),
            proven: station.proven,
            delay: station.delay,
            // Its layout is defined by this project.
            layout: true,
            plan: self
                .zeroize
                .plan(self.handled.guarded == Some(origin.station)),
            vehicle: self.fleet(Some(station.id())),
        })
    }

    fn fleet(&self, own: Option<Id>) -> Fleet {
        let flying = self.aircraft.iter().find(|one| one.vehicle.may_fly());
        let mut others = self.aircraft.iter().filter_map(|one| {
            let by = one.authority.controller().filter(|by| Some(*by) != own)?;
            Some((one.id(), by))
        });
        Fleet {
            flying: flying.map(super::Aircraft::id),
            of_another: others.next(),
        }
    }
}
