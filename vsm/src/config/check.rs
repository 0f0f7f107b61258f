//! What a single value cannot tell: relations between keys, and ranges.

use super::error::{Fault, fault};
use super::{Authority, Config, Curve, Limits, LinkAddress, Signing, Vehicle, area};

impl Config {
    /// The first key, in the order of the file's tables, that does not fit.
    pub(super) fn check(&self) -> Result<(), Fault> {
        let mut ids = vec![self.dli.vsm_id];
        for station in &self.cucs {
            let id = station.get_ref().id;
            if ids.contains(&id) {
                return fault(station.span().start, "cucs.id", id, OWN_ID);
            }
            ids.push(id);
        }
        let mut links: Vec<&LinkAddress> = Vec::new();
        for spanned in &self.vehicle {
            let (vehicle, at) = (spanned.get_ref(), spanned.span().start);
            if ids.contains(&vehicle.id) {
                return fault(at, "vehicle.id", vehicle.id, OWN_ID);
            }
            ids.push(vehicle.id);
            if links.contains(&&vehicle.link) {
                let expected = "a link of its own for each vehicle";
                return fault(at, "vehicle.link", &vehicle.link, expected);
            }
            links.push(&vehicle.link);
            if vehicle.system_id == 0 || vehicle.system_id == self.mavlink.system_id {
                let expected = "1 to 255, and not the VSM's own (mavlink.system_id)";
                return fault(at, "vehicle.system_id", vehicle.system_id, expected);
            }
            vehicle.check(at)?;
        }
        let Authority {
            warn_s,
            offer_s,
            act_s,
            ..
        } = *self.authority.get_ref();
        if !(warn_s <= offer_s && offer_s <= act_s) {
            let at = self.authority.span().start;
            let found = format!("warn_s {warn_s}, offer_s {offer_s}, act_s {act_s}");
            return fault(at, "authority", found, "warn_s <= offer_s <= act_s");
        }
        if self.mavlink.system_id == 0 {
            return fault(0, "mavlink.system_id", 0, "1 to 255");
        }
        Ok(())
    }
}

impl Vehicle {
    /// What can be told of it alone. `at` is where its table begins.
    fn check(&self, at: usize) -> Result<(), Fault> {
        if self.tail_number.len() > 15 || !self.tail_number.is_ascii() {
            let expected = "at most 15 ASCII characters";
            return fault(at, "vehicle.tail_number", &self.tail_number, expected);
        }
        if let Signing::KeyFile(_, exchange) = &self.signing {
            if exchange.agent < 2 {
                let expected = "a component id of 2 to 255: 1 is the autopilot";
                return fault(at, "vehicle.signing.agent", exchange.agent, expected);
            }
            let days = exchange.rotate_days;
            if !(0.0001..=3650.0).contains(&days) {
                let expected = "0.0001 to 3650 (days)";
                return fault(at, "vehicle.signing.rotate_days", days, expected);
            }
        }
        self.curve.check(at)?;
        if let Err(found) = area::check(&self.area) {
            return fault(at, "vehicle.area", found, "areas that make a fence");
        }
        self.limits.check(at)
    }
}

impl Curve {
    fn check(self, at: usize) -> Result<(), Fault> {
        if !(0.1..=100.0).contains(&self.tolerance_m) {
            let expected = "0.1 to 100 (metres)";
            return fault(at, "vehicle.curve.tolerance_m", self.tolerance_m, expected);
        }
        if !(2..=10_000).contains(&self.max_items) {
            return fault(at, "vehicle.curve.max_items", self.max_items, "2 to 10000");
        }
        Ok(())
    }
}

impl Limits {
    fn check(self, at: usize) -> Result<(), Fault> {
        for (key, value) in [
            ("vehicle.limits.first_m", self.first_m),
            ("vehicle.limits.leg_m", self.leg_m),
            ("vehicle.limits.speed_m_s", self.speed_m_s),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return fault(at, key, value, "a number above 0");
            }
        }
        let (lowest_m, highest_m) = (self.lowest_m, self.highest_m);
        if !(lowest_m.is_finite() && highest_m.is_finite() && lowest_m < highest_m) {
            let found = format!("lowest_m {lowest_m} and highest_m {highest_m}");
            return fault(at, "vehicle.limits", found, "lowest_m below highest_m");
        }
        Ok(())
    }
}

const OWN_ID: &str = "an id that nothing else in this file has";
