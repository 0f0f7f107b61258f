//! What the vehicle's events and parameters mean, read from the vehicle: COMPONENT_METADATA names its general metadata, this
//! names the definitions of each, and all are files that MAVLink FTP reads.
//!
//! Nothing is requested of a vehicle that sends no events, and nothing of parameters where none is offered as a control
//! (`vehicle.controls`). The files are read like those of an operator, who comes first: what is under way here gives way and is
//! tried again. The definitions of parameters, 64 kB of PX4's, are read on the ground only: arming ends it, and it begins
//! again once the vehicle is disarmed. Without definitions events are alerted by their numbers, and controls have no range.

use std::time::Duration;

use mapping::event::{Catalogue, Definitions, MetadataError, find, path_of};
use mapping::parameter_metadata::ParameterMetadata;
use mavlink_link::dialect::{COMPONENT_METADATA_DATA, MavCmd};
use mavlink_link::service::command::{Command, Payload, Repetition};
use mavlink_link::service::ftp::{Event, FilePath, Operation};

use super::link::services::Services;
use crate::relay_policy::reaches_key;

/// The machine, one for each kind of definitions.
#[derive(Debug)]
pub(crate) struct MetadataReader {
    kind: Definitions,
    stage: Stage,
    tries: u32,
    /// COMPONENT_METADATA.file_crc of what was read: the same firmware, the same definitions.
    known: Option<u32>,
    /// Of what is being read.
    crc: u32,
    /// What was read is not, or may not be, of the firmware that runs now.
    outdated: bool,
}

/// What was read.
#[derive(Debug)]
pub(crate) enum Defined {
    Events(Catalogue),
    Parameters(ParameterMetadata),
}

#[derive(Debug)]
enum Stage {
    /// Nothing has shown yet that it is of use.
    Unused,
    /// Tried again then.
    Waiting(Duration),
    /// COMPONENT_METADATA is requested.
    Asking(Duration),
    /// To be read as soon as no other file is.
    Next(File, FilePath),
    Reading(File, Vec<u8>),
    /// What the vehicle names cannot be read.
    Refused(String),
    /// Read, or not to be had.
    Done,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum File {
    General,
    Definitions,
}

impl MetadataReader {
    pub(crate) fn new(kind: Definitions) -> Self {
        Self {
            kind,
            stage: Stage::Unused,
            tries: 0,
            known: None,
            crc: 0,
            outdated: false,
        }
    }

    pub(crate) fn kind(&self) -> Definitions {
        self.kind
    }

    /// They are of use: what is not read yet is begun.
    pub(crate) fn begin(&mut self, now: Duration) {
        if matches!(self.stage, Stage::Unused) {
            self.stage = Stage::Waiting(now);
        }
    }

    /// They are not to be read now: what is under way ends, and [`MetadataReader::begin`] begins it again.
    pub(crate) fn pause(&mut self, services: &mut Services) {
        if !matches!(self.stage, Stage::Unused | Stage::Refused(_) | Stage::Done) {
            self.stop(services, Stage::Unused);
            self.tries = 0;
        }
    }

    /// Whether it reads a file: what the file client reports is for this machine.
    pub(crate) fn is_reading(&self) -> bool {
        matches!(self.stage, Stage::Reading(..))
    }

    /// The vehicle has restarted, perhaps with another firmware.
    pub(crate) fn restart(&mut self, services: &mut Services) {
        self.stop(services, Stage::Unused);
        self.tries = 0;
    }

    /// Leaves the file client to an operator.
    pub(crate) fn give_way(&mut self, now: Duration, services: &mut Services) {
        if self.is_reading() {
            self.stop(services, Stage::Waiting(now + AFTER_AN_OPERATOR));
        }
    }

    /// The vehicle names its general metadata.
    pub(crate) fn named(&mut self, named: &COMPONENT_METADATA_DATA) {
        if !matches!(self.stage, Stage::Asking(_)) {
            return;
        }
        if self.known == Some(named.file_crc) {
            self.stage = Stage::Done;
            return;
        }
        self.outdated |= self.known.take().is_some();
        let uri = named.uri.to_str().unwrap_or_default();
        self.stage = match readable(path_of(uri)) {
            Ok(path) => Stage::Next(File::General, path),
            Err(why) => Stage::Refused(why),
        };
        self.crc = named.file_crc;
    }

    /// Whether what was read before is over, once.
    pub(crate) fn take_outdated(&mut self) -> bool {
        std::mem::take(&mut self.outdated)
    }

    /// Does what is due. What it returns is the end: the definitions, or why there are none.
    pub(crate) fn advance(
        &mut self,
        now: Duration,
        services: &mut Services,
    ) -> Option<Result<Defined, String>> {
        let ended = self.step(now, services);
        if let Some(Err(_)) = ended {
            self.outdated |= self.known.take().is_some();
        }
        ended
    }

    fn step(&mut self, now: Duration, services: &mut Services) -> Option<Result<Defined, String>> {
        match &mut self.stage {
            Stage::Refused(why) => {
                let why = std::mem::take(why);
                return Some(Err(self.end(services, why)));
            }
            Stage::Waiting(at) if *at <= now => {
                self.tries += 1;
                // Where it cannot be requested now, the next try does.
                let _ = services.commands.submit(now, request());
                self.stage = Stage::Asking(now + ANSWER_WITHIN);
            }
            Stage::Asking(until) if *until <= now => {
                return self.try_again(now, "it does not answer a request for COMPONENT_METADATA");
            }
            Stage::Next(file, path) => {
                let (file, path) = (*file, path.clone());
                let resume = None;
                if services
                    .files
                    .start(now, Operation::Read { path, resume })
                    .is_ok()
                {
                    self.stage = Stage::Reading(file, Vec::new());
                }
            }
            Stage::Reading(..) => return self.read(now, services),
            _ => {}
        }
        None
    }

    /// When [`MetadataReader::advance`] is next needed; files have times of their own.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match self.stage {
            Stage::Waiting(at) | Stage::Asking(at) => Some(at),
            _ => None,
        }
    }

    fn read(&mut self, now: Duration, services: &mut Services) -> Option<Result<Defined, String>> {
        let Stage::Reading(file, content) = &mut self.stage else {
            return None;
        };
        let ended = loop {
            match services.files.poll_event()? {
                Event::Opened { size } if size > MAX_FILE => {
                    let why = format!("a file of {size} bytes: expected at most {MAX_FILE}");
                    return Some(Err(self.end(services, why)));
                }
                Event::Data(bytes) if content.len() + bytes.len() > MAX_FILE as usize => {
                    let why = format!("more than {MAX_FILE} bytes of a file");
                    return Some(Err(self.end(services, why)));
                }
                Event::Data(bytes) => content.extend(bytes),
                Event::Opened { .. } | Event::Written { .. } => {}
                Event::Ended(result) => break result,
            }
        };
        let (file, content) = (*file, std::mem::take(content));
        if let Err(failure) = ended {
            return self.try_again(now, &failure.to_string());
        }
        match file {
            File::General => match readable(find(&content, self.kind)) {
                Ok(path) => {
                    self.stage = Stage::Next(File::Definitions, path);
                    None
                }
                Err(why) => Some(Err(self.end(services, why))),
            },
            File::Definitions => {
                self.stage = Stage::Done;
                let read = match self.kind {
                    Definitions::Events => Catalogue::read(&content).map(Defined::Events),
                    Definitions::Parameters => {
                        ParameterMetadata::read(&content).map(Defined::Parameters)
                    }
                };
                self.known = read.is_ok().then_some(self.crc);
                Some(read.map_err(|why: MetadataError| why.to_string()))
            }
        }
    }

    fn try_again(&mut self, now: Duration, why: &str) -> Option<Result<Defined, String>> {
        if self.tries >= TRIES {
            self.stage = Stage::Done;
            return Some(Err(why.to_owned()));
        }
        self.stage = Stage::Waiting(now + AGAIN * 2_u32.pow(self.tries));
        None
    }

    fn end(&mut self, services: &mut Services, why: String) -> String {
        self.stop(services, Stage::Done);
        why
    }

    fn stop(&mut self, services: &mut Services, then: Stage) {
        if self.is_reading() {
            services.files.withdraw();
            while services.files.poll_event().is_some() {}
        }
        self.stage = then;
    }
}

/// A path that the vehicle names, as one to read; the link is not encrypted, and a key is not for it.
fn readable(named: Result<String, MetadataError>) -> Result<FilePath, String> {
    let path = named.map_err(|why| why.to_string())?;
    if reaches_key(path.as_bytes()) {
        return Err(format!(
            "the vehicle names {path:?}: expected a file of metadata, not its key"
        ));
    }
    FilePath::new(&path).map_err(|why| why.to_string())
}

fn request() -> Command {
    Command {
        command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
        payload: Payload::Long([COMPONENT_METADATA, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        repetition: Repetition::Safe,
    }
}

const COMPONENT_METADATA: f32 = 397.0;
/// PX4's definitions of events have 18 kB packed, those of parameters 64; the first are read in flight, too.
const MAX_FILE: u32 = super::files::MAX_IN_FLIGHT;
const TRIES: u32 = 5;
const AGAIN: Duration = Duration::from_secs(2);
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
const AFTER_AN_OPERATOR: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink_link::frame::Node;

    fn named(known: Option<u32>, crc: u32, uri: &str) -> (MetadataReader, Services) {
        let mut machine = MetadataReader {
            stage: Stage::Asking(Duration::from_secs(5)),
            known,
            ..MetadataReader::new(Definitions::Events)
        };
        machine.named(&COMPONENT_METADATA_DATA {
            time_boot_ms: 0,
            file_crc: crc,
            uri: uri.into(),
        });
        let services = Services::new(Node::new(245, 190), Node::new(1, 1), None);
        (machine, services)
    }

    #[test]
    fn what_was_read_is_over_where_the_firmware_is_another_or_cannot_be_asked() {
        let now = Duration::ZERO;
        let (mut same, mut services) = named(Some(1), 1, "mftp://a.json");
        assert!(same.advance(now, &mut services).is_none() && !same.take_outdated());
        let (mut other, _) = named(Some(1), 2, "mftp://a.json");
        assert!(other.take_outdated() && other.known.is_none());
        let (mut silent, mut services) = (
            MetadataReader {
                stage: Stage::Asking(now),
                tries: TRIES,
                known: Some(1),
                ..MetadataReader::new(Definitions::Events)
            },
            services,
        );
        assert!(matches!(silent.advance(now, &mut services), Some(Err(_))));
        assert!(silent.take_outdated() && silent.known.is_none());
    }

    #[test]
    fn neither_the_key_of_the_vehicle_nor_an_address_elsewhere_is_read() {
        for uri in [
            "mftp://fs/microsd/mavlink/MAVLINK-signing-key.bin",
            "mftp://fs/microsd/MAVLINK/MAVLIN~1.BIN",
            "mftp://dev/mmcsd0",
            "https://example.org/a.json",
        ] {
            let (mut machine, mut services) = named(None, 1, uri);
            let ended = machine.advance(Duration::ZERO, &mut services);
            assert!(matches!(ended, Some(Err(_))), "{uri}");
            assert!(!services.files.is_active());
        }
        let key = Ok("/fs/microsd/mavlink/mavlink-signing-key.bin".to_owned());
        assert!(readable(key).is_err());
    }
}
