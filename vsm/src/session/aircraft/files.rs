//! Files of the vehicle, for an operator of this computer: one operation at a time over the link that the bridge holds.
//!
//! The link's commands and heartbeats come first. File messages are sent after everything else. In flight and on serial
//! lines, files are read piece by piece at a fixed rate. PX4 receives nothing while it computes the checksum of a large
//! file, so that is done on the ground only. Nothing is written or removed while the vehicle may be armed.

use mapping::event::{Catalogue, Definitions};
use mapping::parameter_metadata::ParameterMetadata;
use mavlink_link::service::ftp::{Event, Operation};

use super::Aircraft;
use crate::config::LinkAddress;
use crate::relay_policy::reaches_key;
use crate::session::effects::{DliEffects, Effects};
use crate::session::files::{FileAccess, FileEvent, FileRefusal, MAX_IN_FLIGHT};
use crate::session::limits::FILES_IN_FLIGHT_BYTES_S;
use crate::session::log::LogLevel;
use crate::session::metadata::{Defined, MetadataReader};
use crate::session::reports;

impl Aircraft {
    /// Begins an operation.
    ///
    /// # Errors
    /// The operation is not possible now, or not possible at all.
    pub(in crate::session) fn start_file(
        &mut self,
        dli: &mut DliEffects<'_>,
        operation: Operation,
    ) -> Result<(), FileRefusal> {
        if !self.vehicle.live() {
            return Err(FileRefusal::Silent);
        }
        let (verb, path, writes) = match &operation {
            Operation::List(path) => ("list", path, false),
            Operation::Read { path, .. } => ("read", path, false),
            Operation::Write { path, .. } => ("write", path, true),
            Operation::Remove(path) | Operation::RemoveDirectory(path) => ("remove", path, true),
            Operation::CreateDirectory(path) => ("create", path, true),
        };
        let path = path.to_string();
        // A list has names alone.
        let lists = matches!(operation, Operation::List(_));
        if !lists && reaches_key(path.as_bytes()) {
            return Err(FileRefusal::KeyFile(path));
        }
        if let Some(state) = self.may_fly().filter(|_| writes) {
            return Err(FileRefusal::InFlight(state));
        }
        for reader in &mut self.metadata {
            reader.give_way(dli.now.mono, &mut self.services);
        }
        self.set_file_rate();
        self.services.files.start(dli.now.mono, operation)?;
        let stopped = None;
        self.files = FileAccess {
            writes,
            reads: 0,
            stopped,
        };
        let effects = effects!(self, dli);
        effects.note(
            LogLevel::Info,
            format!("an operator of this computer requests to {verb} {path}"),
        );
        self.run_until_idle(dli);
        Ok(())
    }

    /// The next event of the operation.
    pub(in crate::session) fn poll_file(&mut self) -> Option<FileEvent> {
        if self.reads_metadata() {
            return None;
        }
        Some(match self.services.files.poll_event()? {
            Event::Opened { size } => {
                self.files.reads = size;
                self.watch_file();
                FileEvent::Opened(size)
            }
            Event::Data(bytes) => FileEvent::Data(bytes),
            Event::Written { bytes, of } => FileEvent::Written(bytes, of),
            Event::Ended(result) => {
                let stopped = self.files.stopped.take();
                FileEvent::Ended(result.map_err(|failure| stopped.unwrap_or(failure.into())))
            }
        })
    }

    /// Whether the file client is reading metadata.
    fn reads_metadata(&self) -> bool {
        self.metadata.iter().any(MetadataReader::is_reading)
    }

    /// Reads the vehicle's metadata: the texts of its events and, if parameters are offered as controls, their descriptions.
    pub(super) fn read_metadata(&mut self, dli: &mut DliEffects<'_>) {
        if !self.vehicle.live() {
            return;
        }
        let now = dli.now.mono;
        let on_the_ground = self.may_fly().is_none();
        let mut all = Vec::new();
        for reader in &mut self.metadata {
            match reader.kind() {
                Definitions::Events if self.services.events.is_in_use() => reader.begin(now),
                Definitions::Parameters if self.config.controls.is_some() && on_the_ground => {
                    reader.begin(now);
                }
                Definitions::Parameters => reader.pause(&mut self.services),
                Definitions::Events => {}
            }
            let ended = reader.advance(now, &mut self.services);
            let outdated = reader.take_outdated();
            // This runs for each datagram and almost always has nothing to do, so it must not allocate.
            if outdated || ended.is_some() {
                all.push((reader.kind(), outdated, ended));
            }
        }
        for (kind, outdated, ended) in all {
            if outdated {
                // Event numbers are better than the texts of another firmware, and no range is better than a wrong one.
                let nothing = match kind {
                    Definitions::Events => Defined::Events(Catalogue::default()),
                    Definitions::Parameters => Defined::Parameters(ParameterMetadata::default()),
                };
                self.define(dli, nothing);
            }
            let (level, text) = match (&ended, kind) {
                (None, _) => continue,
                (Some(Ok(Defined::Events(all))), _) => (
                    LogLevel::Info,
                    format!(
                        "{} events of the vehicle are defined by its metadata",
                        all.len()
                    ),
                ),
                (Some(Ok(Defined::Parameters(all))), _) => (
                    LogLevel::Info,
                    format!(
                        "{} parameters of the vehicle are described by its metadata",
                        all.len()
                    ),
                ),
                (Some(Err(why)), Definitions::Events) => (
                    LogLevel::Warning,
                    format!("the vehicle's events are alerted by their numbers: {why}"),
                ),
                (Some(Err(why)), Definitions::Parameters) => (
                    LogLevel::Warning,
                    format!("the vehicle's controls have no ranges: {why}"),
                ),
            };
            effects!(self, dli).note(level, text);
            if let Some(Ok(defined)) = ended {
                self.define(dli, defined);
            }
        }
    }

    fn define(&mut self, dli: &mut DliEffects<'_>, defined: Defined) {
        let input = match defined {
            Defined::Events(catalogue) => reports::Input::DefineEvents(catalogue),
            Defined::Parameters(metadata) => reports::Input::DefineParameters(metadata),
        };
        self.observe(dli, input);
    }

    /// Cancels the operation: the requesting program is gone.
    pub(in crate::session) fn withdraw_file(&mut self, dli: &mut DliEffects<'_>) {
        if self.reads_metadata() {
            return;
        }
        self.services.files.withdraw();
        self.run_until_idle(dli);
    }

    /// Arming ends an operation that writes files or reads a large one, and slows down other reads. This must be checked
    /// before anything is sent, since the checksum of a large file may be next.
    pub(super) fn watch_file(&mut self) {
        if !self.services.files.is_active() {
            return;
        }
        self.set_file_rate();
        // The size of the operator's last file says nothing about the metadata, which is never large.
        if self.reads_metadata() {
            return;
        }
        let Some(state) = self.may_fly() else {
            return;
        };
        let size = self.files.reads;
        if self.files.writes {
            self.stop_file(FileRefusal::InFlight(state));
        } else if size > MAX_IN_FLIGHT {
            self.stop_file(FileRefusal::TooLargeInFlight(size, state));
        }
    }

    fn stop_file(&mut self, why: FileRefusal) {
        self.files.stopped = Some(why);
        self.services.files.withdraw();
    }

    fn set_file_rate(&mut self) {
        let rate = match (self.config.rate_bps, &self.config.link) {
            // A fifth: the rest is for what flies the vehicle.
            (Some(rate_bps), _) => Some(rate_bps / 50),
            // Half of the line, ten bits a byte.
            (None, LinkAddress::Serial { baud, .. }) => Some(baud / 20),
            _ => self.may_fly().map(|_| FILES_IN_FLIGHT_BYTES_S),
        };
        self.services.files.limit(rate);
    }

    /// Why the vehicle counts as flying, as worded in an error; `None` if it has reported that it is disarmed.
    fn may_fly(&self) -> Option<&'static str> {
        match self.vehicle.telemetry.armed {
            Some(false) => None,
            Some(true) => Some("is armed"),
            None => Some("has not reported whether it is armed"),
        }
    }
}
