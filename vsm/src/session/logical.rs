//! The logical ids by which vehicles are offered until they are received.

use stanag_msgs::Id;

use crate::config::Config;

/// The vehicles that have one.
#[derive(Debug, Default)]
pub(crate) struct LogicalIds(Vec<LogicalId>);

#[derive(Debug)]
struct LogicalId {
    vehicle: Id,
    logical: Id,
    /// The vehicle was not received yet, and is shown by its logical id.
    waits: bool,
}

impl LogicalIds {
    /// Takes the ids of a configuration. A vehicle with an id that it did not have before waits, unless it is `known` by
    /// its own.
    pub(crate) fn reload(&mut self, config: &Config, known: impl Fn(Id) -> bool) {
        let before = std::mem::take(&mut self.0);
        let each = config.vehicles().filter_map(|one| {
            let (vehicle, logical) = (one.id, one.logical_id?);
            let same = |one: &&LogicalId| (one.vehicle, one.logical) == (vehicle, logical);
            let same = before.iter().find(same);
            Some(LogicalId {
                vehicle,
                logical,
                waits: same.map_or_else(|| !known(vehicle), |one| one.waits),
            })
        });
        self.0 = each.collect();
    }

    /// The vehicle id for an id: a logical id stands for its vehicle, also after that was received.
    pub(crate) fn meant_by(&self, id: Id) -> Id {
        let named = self.0.iter().find(|one| one.logical == id);
        named.map_or(id, |one| one.vehicle)
    }

    /// The id under which a vehicle is shown now.
    pub(crate) fn shown_as(&self, vehicle: Id) -> Id {
        let mut waiting = self.0.iter().filter(|one| one.waits);
        let named = waiting.find(|one| one.vehicle == vehicle);
        named.map_or(vehicle, |one| one.logical)
    }

    pub(crate) fn has(&self, id: Id) -> bool {
        self.0.iter().any(|one| one.logical == id)
    }

    /// The vehicles that were not received yet.
    pub(crate) fn waiting(&self) -> impl Iterator<Item = Id> + '_ {
        let waiting = self.0.iter().filter(|one| one.waits);
        waiting.map(|one| one.vehicle)
    }

    /// The vehicle is received: from now on it is shown by its own id.
    pub(crate) fn introduce(&mut self, vehicle: Id) {
        for one in self.0.iter_mut().filter(|one| one.vehicle == vehicle) {
            one.waits = false;
        }
    }
}
