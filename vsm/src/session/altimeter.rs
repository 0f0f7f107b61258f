//! The altimeter setting (2016, field 0043.16): what pressure altitudes are flown by and reported with.
//!
//! The setting stays until another is commanded, over restarts too; 1013.25 hPa until one was.

use mapping::altitude::Altimeter;
use mapping::configuration::forced;
use serde::{Deserialize, Serialize};
use stanag_msgs::Message;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};
use super::store::{Durability, StoreError, record_name};

#[derive(Serialize, Deserialize)]
struct Record {
    pascal: f64,
}

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
        let bytes = serde_json::to_vec(&Record { pascal }).unwrap_or_default();
        desk.store
            .save(
                &record_name("altimeter", self.id()),
                &bytes,
                Durability::Process,
            )
            .map_err(|fault| format!("the altimeter setting cannot be stored: {fault}"))?;
        self.bounds.altimeter = altimeter;
        let changed: Vec<Message> = forced::altimeter(altimeter).into_iter().collect();
        self.tell_the_configured(desk, &changed, by.map(|origin| origin.station));
        Ok(())
    }

    /// The setting of before a restart.
    ///
    /// # Errors
    /// Its record is there and cannot be read.
    pub(super) fn restore_altimeter(&mut self, desk: &Desk<'_>) -> Result<(), StoreError> {
        let name = record_name("altimeter", self.id());
        let Some(bytes) = desk.store.load(&name)? else {
            return Ok(());
        };
        let unreadable = |cause: String| StoreError {
            name: name.clone(),
            cause,
        };
        let record: Record =
            serde_json::from_slice(&bytes).map_err(|cause| unreadable(cause.to_string()))?;
        self.bounds.altimeter =
            Altimeter::new(record.pascal).map_err(|cause| unreadable(cause.to_string()))?;
        Ok(())
    }
}
