//! Operations on files of the vehicles, requested by the shell.

use mavlink_link::Now;
use mavlink_link::service::ftp::Operation;
use mavlink_link::store::Disk;
use stanag_msgs::Id;

use super::Bridge;
use crate::session::files::{FileEvent, FileRefusal};

impl Bridge {
    /// The vehicle with this id, or the only one.
    ///
    /// # Errors
    /// No vehicle has this id, or there are several.
    pub fn file_vehicle(&self, id: Option<Id>) -> Result<Id, FileRefusal> {
        let all: Vec<String> = self
            .aircraft
            .iter()
            .map(|one| one.id().to_string())
            .collect();
        match (id, self.aircraft.get(0)) {
            (None, Some(only)) if all.len() == 1 => Ok(only.id()),
            (None, _) => Err(FileRefusal::WhichVehicle(all.join(", "))),
            (Some(id), _) if self.aircraft.has(id) => Ok(id),
            (Some(id), _) => Err(FileRefusal::NoVehicle(id.to_string(), all.join(", "))),
        }
    }

    /// Begins an operation on a vehicle's files.
    ///
    /// # Errors
    /// It cannot be done now, or not at all.
    pub fn start_file(
        &mut self,
        now: Now,
        vehicle: Id,
        operation: Operation,
        disk: &mut dyn Disk,
    ) -> Result<(), FileRefusal> {
        let (mut dli, aircraft) = self.effects(now, disk);
        let one = aircraft.find_mut(vehicle);
        one.ok_or(FileRefusal::Silent)?
            .start_file(&mut dli, operation)
    }

    /// The next event of the operation.
    pub fn poll_file(&mut self, vehicle: Id) -> Option<FileEvent> {
        let one = self.aircraft.find_mut(vehicle);
        one?.poll_file()
    }

    /// Whether a vehicle with this id still exists: a reload may have removed it.
    #[must_use]
    pub fn has_vehicle(&self, vehicle: Id) -> bool {
        self.aircraft.has(vehicle)
    }

    /// Withdraws the operation in progress.
    pub fn withdraw_file(&mut self, now: Now, vehicle: Id, disk: &mut dyn Disk) {
        let (mut dli, aircraft) = self.effects(now, disk);
        if let Some(one) = aircraft.find_mut(vehicle) {
            one.withdraw_file(&mut dli);
        }
    }
}
