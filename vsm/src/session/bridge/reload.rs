//! A changed configuration while the bridge runs: applied as a whole, or not at all.
//!
//! What has not changed keeps its rights, its link and its state. A station keeps its index even after it is removed,
//! because machines identify it by that. If it is added again its messages are still remembered, so that nothing is carried
//! out a second time. [`Config::changes`](crate::config::Config::changes) decides what may change.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::store::{Disk, StoreError};
use stanag_msgs::Id;
use stanag_msgs::enums::AckType;

use super::{Bridge, BridgeError, LinkEnd, Setup};
use crate::config::{Config, Cucs, Dli};
use crate::session::aircraft::{Aircraft, may_come_again};
use crate::session::authority::Input;
use crate::session::duplicates::Remembered;
use crate::session::limits::Limits;
use crate::session::station::GroundStation;

impl Bridge {
    /// The vehicles, by their index.
    pub fn vehicles(&self) -> impl Iterator<Item = Id> + '_ {
        self.aircraft.iter().map(Aircraft::id)
    }

    /// Whether a vehicle is armed and received: it may not be removed.
    #[must_use]
    pub fn is_flying(&self, vehicle: Id) -> bool {
        let mut aircraft = self.aircraft.iter();
        aircraft.any(|one| {
            let armed = one.vehicle.telemetry.armed == Some(true);
            one.id() == vehicle && one.vehicle.live() && armed
        })
    }

    /// Continues with another configuration. Vehicles that are not served yet have their [`LinkEnd`] in `ends`, in the
    /// order of the configuration; they are appended to the present ones.
    ///
    /// # Errors
    /// A record of something added cannot be read; then nothing has changed.
    pub fn reload(
        &mut self,
        config: &Config,
        ends: Vec<LinkEnd>,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), BridgeError> {
        let listed = self.stations.iter().filter(|one| !one.removed);
        let before: Vec<Cucs> = listed.map(|one| one.config.clone()).collect();
        let profiles: Vec<_> = self
            .stations
            .iter()
            .map(|one| one.profile.clone())
            .collect();
        let served = self.aircraft.len();
        let added = self.set_stations(
            &config.stations().collect::<Vec<_>>(),
            &config.dli,
            now,
            disk,
        );
        let added = added.map_err(BridgeError::from).and_then(|()| {
            let is_new = |id: Id| !self.aircraft.has(id);
            let new: Vec<_> = config.vehicles().filter(|one| is_new(one.id)).collect();
            let mut each = new.into_iter().zip(ends);
            each.try_for_each(|(vehicle, end)| {
                self.add_vehicle(vehicle, end, now, not_before, disk)
            })
        });
        if let Err(fault) = added {
            self.aircraft.truncate(served);
            // Stations that were added hold no right yet and become removed ones.
            self.set_stations(&before.iter().collect::<Vec<_>>(), &config.dli, now, disk)?;
            for (station, profile) in self.stations.iter_mut().zip(profiles) {
                station.profile = profile;
            }
            return Err(fault);
        }
        let new_vehicles: Vec<_> = self
            .aircraft
            .iter()
            .skip(served)
            .map(Aircraft::id)
            .collect();
        self.restore_contingencies(disk);
        self.setup = Setup::of(config);
        self.paths.set_limits(Limits::of(&config.dli));
        self.logical.reload(config, |_| false);
        self.remove_vehicles(config, now, disk);
        self.give_permits(now);
        let settings = self.setup.settings.clone();
        let (mut dli, aircraft) = self.effects(now, disk);
        for id in new_vehicles {
            if let Some(one) = aircraft.find_mut(id) {
                one.show_standing(&mut dli);
            }
        }
        for one in aircraft.iter_mut() {
            if let Some(vehicle) = config.vehicles().find(|vehicle| vehicle.id == one.id()) {
                one.reconfigure(&mut dli, vehicle, &settings);
            }
            one.ask_authority(&mut dli, Input::Reconfigured);
        }
        aircraft.number();
        self.forget_heartbeats(now.mono);
        Ok(())
    }

    /// Sets the configured stations.
    fn set_stations(
        &mut self,
        listed: &[&Cucs],
        dli: &Dli,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        // Reading comes first, since it can fail.
        let mut new = Vec::new();
        for cucs in listed {
            if self.stations.iter().all(|one| one.id() != cucs.id) {
                let mut remembered = Remembered::default();
                // Commands that an earlier process left open are refused from now on: they may have been carried out.
                // Nothing else is done about them (a start ends an interrupted launch), since by now the vehicle obeys
                // others.
                for seen in remembered.restore(cucs.id, now.mono, disk)? {
                    if may_come_again(seen.message_type) {
                        remembered.forget(seen.digest);
                    } else {
                        let refused = AckType::Refused;
                        let (of, stamp) = (seen.message_type, seen.stamp);
                        remembered.answered(cucs.id, of, stamp, refused, disk);
                    }
                }
                new.push((cucs, remembered));
            }
        }
        for (index, station) in self.stations.iter_mut().enumerate() {
            let cucs = listed.iter().find(|cucs| cucs.id == station.id());
            station.removed = cucs.is_none();
            if let Some(cucs) = cucs {
                station.config = (*cucs).clone();
                let readings = station.profile.readings.clone();
                station.profile.reconfigure(cucs, dli);
                if station.profile.readings != readings {
                    // A waiting message is decoded again before it is stamped: with other readings a "carried out" might
                    // become a "refused". The station will request again what it misses.
                    self.paths.drop_waiting(index);
                    self.outbox.drop_written(cucs.id);
                }
                self.paths.set_trusted(now.mono, index, cucs.address);
            }
        }
        for (cucs, remembered) in new {
            let index = self.stations.len();
            self.paths.set_trusted(now.mono, index, cucs.address);
            self.stations.push(GroundStation::new((*cucs).clone(), dli));
            self.remembered.push(remembered);
        }
        Ok(())
    }

    /// Ends vehicles that were removed from the configuration. Their holders are notified that they no longer hold any
    /// right.
    fn remove_vehicles(&mut self, config: &Config, now: Now, disk: &mut dyn Disk) {
        let is_listed = |id: Id| config.vehicles().any(|vehicle| vehicle.id == id);
        let (mut dli, aircraft) = self.effects(now, disk);
        for one in aircraft.iter_mut().filter(|one| !is_listed(one.id())) {
            one.ask_authority(&mut dli, Input::Removed);
        }
        aircraft.retain(|one| is_listed(one.id()));
    }
}
