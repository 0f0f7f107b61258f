//! The altimeter setting (2016, field 0043.16): what pressure altitudes are flown by and reported with.
//!
//! The setting stays until another is commanded, over restarts too; 1013.25 hPa until one was.

use mapping::altitude::Altimeter;
use mapping::configuration::changes;
use serde::{Deserialize, Serialize};
use stanag_msgs::Message;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};
use super::store::{record_fault, vehicle_record};
use mavlink_link::store::{Store as _, StoreError};

#[derive(Serialize, Deserialize)]
struct Record {
    pascal: f64,
}

vehicle_record!(Record, "altimeter", Process);

impl Aircraft {
    /// The setting that a command is judged by: its own where it has one, else the present one. 0 is what a full
    /// presence vector carries for none.
    ///
    /// # Errors
    /// No weather has it.
    pub(super) fn altimeter_of(
        &self,
        command: &VehicleOperatingModeCommand,
    ) -> Result<Altimeter, String> {
        let Some(pascal) = command
            .altimeter_setting
            .map(|setting| setting.si())
            .filter(|pascal| *pascal > 0.0)
        else {
            return Ok(self.bounds.altimeter);
        };
        Altimeter::new(pascal).map_err(|fault| fault.to_string())
    }

    /// Keeps the setting of a command that is taken; the other stations are told.
    ///
    /// # Errors
    /// It cannot be stored: the setting is as before.
    pub(super) fn set_altimeter(
        &mut self,
        desk: &mut Desk<'_>,
        by: Option<Origin>,
        altimeter: Altimeter,
    ) -> Result<(), String> {
        if altimeter == self.bounds.altimeter {
            return Ok(());
        }
        let pascal = altimeter.pascal();
        desk.store
            .save(&self.id(), &Record { pascal })
            .map_err(|fault| format!("the altimeter setting cannot be stored: {fault}"))?;
        self.bounds.altimeter = altimeter;
        let changed: Vec<Message> = changes::altimeter(altimeter).into_iter().collect();
        self.tell_the_configured(desk, &changed, by.map(|origin| origin.station));
        Ok(())
    }

    /// The setting of before a restart.
    ///
    /// # Errors
    /// Its record is there and cannot be read.
    pub(super) fn restore_altimeter(&mut self, desk: &Desk<'_>) -> Result<(), StoreError> {
        let Some(Record { pascal }) = desk.store.load(&self.id())? else {
            return Ok(());
        };
        self.bounds.altimeter =
            Altimeter::new(pascal).map_err(|cause| record_fault("altimeter", self.id(), cause))?;
        Ok(())
    }
}
