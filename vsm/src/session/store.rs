//! What must survive a restart, and when it is written: before it is answered.

use stanag_msgs::Id;

/// Named records on disk. Writing one replaces it whole: after a crash it holds the old bytes or the new.
pub trait Store {
    /// Writes a record.
    ///
    /// # Errors
    /// Nothing of the record has changed.
    fn save(&mut self, name: &str, bytes: &[u8], durability: Durability) -> Result<(), StoreError>;

    /// Reads a record; `None` where it was never written.
    ///
    /// # Errors
    /// It is there and cannot be read.
    fn load(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError>;

    /// Adds to the end of a log.
    ///
    /// # Errors
    /// Nothing, or a part, has been added.
    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let mut whole = self.load_whole(name)?.unwrap_or_default();
        whole.extend_from_slice(bytes);
        self.save(name, &whole, durability)
    }

    /// Puts a log aside, so that the next line is the first of a new one: `name` becomes `name.1`, that `name.2`, up
    /// to `keep`; the one before is gone.
    ///
    /// # Errors
    /// Not all of it has been done; no line has been lost.
    fn rotate(&mut self, name: &str, keep: u32) -> Result<(), StoreError> {
        for number in (0..keep).rev() {
            if let Some(bytes) = self.load_whole(&log_name(name, number))? {
                self.save(&log_name(name, number + 1), &bytes, Durability::Power)?;
            }
        }
        self.save(name, b"", Durability::Power)
    }

    /// Reads a log, of whatever length; `None` where there is none.
    ///
    /// # Errors
    /// It is there and cannot be read.
    fn load_whole(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.load(name)
    }
}

/// What a record must survive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Durability {
    /// The end of this process, `kill -9` too.
    Process,
    /// A power cut as well: synchronised to the disk before the call returns.
    Power,
}

/// A record that could not be written or read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("record {name}: {cause}")]
pub struct StoreError {
    /// The record.
    pub name: String,
    /// The system's reason.
    pub cause: String,
}

/// The name of a log that was put aside so many times.
pub(crate) fn log_name(name: &str, number: u32) -> String {
    if number == 0 {
        name.to_owned()
    } else {
        format!("{name}.{number}")
    }
}

/// The name of a vehicle's record of a kind.
pub(crate) fn record_name(kind: &str, vehicle: Id) -> String {
    format!("{kind}-{:08x}.json", vehicle.0)
}
