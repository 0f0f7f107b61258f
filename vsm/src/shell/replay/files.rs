//! Recordings as files: finds them, and reads their content.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use mavlink_link::frame::FrameError;
use mavlink_link::tlog;
use stanag_msgs::{Id, pcapng};

use crate::config::open_file;
use crate::session::replay::Timeline;

/// Why recordings cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The system's.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        cause: io::Error,
    },
    /// There is nothing to show.
    #[error("{}: not a recording, expected a file .tlog or .pcapng of [record], or a folder with some", path.display())]
    None {
        /// The folder, or the file.
        path: PathBuf,
    },
    /// Nothing was recorded in them.
    #[error("the recordings are empty: nothing was received or sent while they were made")]
    Empty,
    /// A file is damaged.
    #[error(
        "{}: damaged at byte {at}: {what}; what is before it can be shown: head -c {at} {} > part.{extension}",
        path.display(), path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        at: u64,
        /// What was found there, and what was expected.
        what: String,
        /// Its ending.
        extension: &'static str,
    },
    /// A MAVLink recording does not belong to a vehicle.
    #[error(
        "{}: the name begins with no vehicle id, expected one such as 1b000101-1767225600.tlog",
        path.display()
    )]
    Name {
        /// The file.
        path: PathBuf,
    },
}

/// Reads recordings: files, and all those of folders.
///
/// # Errors
/// There are none, or one cannot be read.
pub fn read(given: &[PathBuf]) -> Result<Timeline, ReplayError> {
    let mut timeline = Timeline::default();
    let mut of_vehicles: BTreeMap<Id, Vec<PathBuf>> = BTreeMap::new();
    let mut of_dli = Vec::new();
    for path in given
        .iter()
        .map(|path| listed(path))
        .collect::<Result<Vec<_>, _>>()?
        .concat()
    {
        match extension(&path) {
            Some(MAVLINK) => {
                let id = vehicle(&path).ok_or_else(|| ReplayError::Name { path: path.clone() })?;
                of_vehicles.entry(id).or_default().push(path);
            }
            _ => of_dli.push(path),
        }
    }
    for (id, paths) in of_vehicles {
        for path in in_order(paths)? {
            read_frames(&path, id, &mut timeline)?;
        }
    }
    for path in in_order(of_dli)? {
        read_datagrams(&path, &mut timeline)?;
    }
    timeline.end();
    match timeline.span() {
        Some(_) => Ok(timeline),
        None => Err(ReplayError::Empty),
    }
}

/// The recordings that a path names.
fn listed(path: &Path) -> Result<Vec<PathBuf>, ReplayError> {
    let io = |cause| ReplayError::Io {
        path: path.to_owned(),
        cause,
    };
    let none = || ReplayError::None {
        path: path.to_owned(),
    };
    if !fs::metadata(path).map_err(io)?.is_dir() {
        return match extension(path) {
            Some(_) => Ok(vec![path.to_owned()]),
            None => Err(none()),
        };
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(path).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if extension(&path).is_some() && path.is_file() {
            found.push(path);
        }
    }
    if found.is_empty() {
        return Err(none());
    }
    found.sort();
    Ok(found)
}

fn extension(path: &Path) -> Option<&'static str> {
    let extension = path.extension()?.to_str()?;
    [MAVLINK, DLI].into_iter().find(|known| *known == extension)
}

/// `1b000101` of `1b000101-1767225600-1.tlog`.
fn vehicle(path: &Path) -> Option<Id> {
    let name = path.file_stem()?.to_str()?;
    let digits = name
        .get(..8)
        .filter(|digits| digits.bytes().all(|b| b.is_ascii_hexdigit()))?;
    u32::from_str_radix(digits, 16).ok().map(Id)
}

/// Files of a series by the time of their first record: names sort `-10` before `-2`.
fn in_order(paths: Vec<PathBuf>) -> Result<Vec<PathBuf>, ReplayError> {
    let mut dated = Vec::new();
    for path in paths {
        let mut pieces = Pieces::open(&path)?;
        let first = match extension(&path) {
            Some(MAVLINK) => {
                pieces.next(|bytes| frame(bytes).map(|(length, (at, _))| (length, Some(at))))
            }
            _ => pieces.next(datagram_time),
        };
        // Faults of the file are reported when it is read.
        let first = first.ok().flatten().flatten();
        dated.push((first.unwrap_or(Duration::MAX), path));
    }
    dated.sort();
    Ok(dated.into_iter().map(|(_, path)| path).collect())
}

fn read_frames(path: &Path, id: Id, timeline: &mut Timeline) -> Result<(), ReplayError> {
    let mut pieces = Pieces::open(path)?;
    loop {
        let taken = pieces.next(|bytes| {
            let (length, (wall, frame)) = frame(bytes)?;
            if let Some(frame) = frame {
                timeline.frame(id, wall, &frame);
            }
            Ok((length, ()))
        })?;
        if taken.is_none() {
            break;
        }
    }
    timeline_note(pieces, timeline);
    Ok(())
}

fn read_datagrams(path: &Path, timeline: &mut Timeline) -> Result<(), ReplayError> {
    let mut pieces = Pieces::open(path)?;
    loop {
        let taken = pieces.next(|bytes| {
            let (length, captured) = block(bytes)?;
            if let Some(captured) = captured {
                timeline.datagram(captured.wall, captured.from, captured.bytes);
            }
            Ok((length, ()))
        })?;
        if taken.is_none() {
            break;
        }
    }
    timeline_note(pieces, timeline);
    Ok(())
}

fn timeline_note(pieces: Pieces, timeline: &mut Timeline) {
    if let Some(at) = pieces.cut {
        timeline.note(format!(
            "{} was cut off within the record at byte {at}, as after a power cut: it is shown up to there",
            pieces.path.display()
        ));
    }
}

/// Why there is no record: more bytes are needed, or it is damaged.
enum NoRecord {
    Cut,
    Damaged(String),
}

type Dated<'a> = (Duration, Option<mavlink_link::frame::FrameView<'a>>);

fn frame(bytes: &[u8]) -> Result<(usize, Dated<'_>), NoRecord> {
    match tlog::first(bytes) {
        Ok((_, wall, _)) if wall > LATEST => Err(NoRecord::Damaged(format!(
            "a time {} years after 1970, expected one of a recording",
            wall.as_secs() / (365 * 86_400)
        ))),
        Ok((length, wall, frame)) => Ok((length, (wall, frame))),
        Err(FrameError::Truncated) => Err(NoRecord::Cut),
        Err(cause) => Err(NoRecord::Damaged(format!(
            "{cause}, expected a time and a MAVLink 2 frame"
        ))),
    }
}

fn block(bytes: &[u8]) -> Result<(usize, Option<pcapng::Captured<'_>>), NoRecord> {
    match pcapng::first(bytes) {
        Ok((_, Some(captured))) if captured.wall > LATEST => Err(NoRecord::Damaged(format!(
            "a time {} years after 1970, expected one of a recording",
            captured.wall.as_secs() / (365 * 86_400)
        ))),
        Ok(read) => Ok(read),
        Err(pcapng::ReadError::Cut) => Err(NoRecord::Cut),
        Err(pcapng::ReadError::Damaged(what)) => Err(NoRecord::Damaged(what)),
    }
}

/// The time of the first block with a datagram; the blocks before it are skipped.
fn datagram_time(mut bytes: &[u8]) -> Result<(usize, Option<Duration>), NoRecord> {
    loop {
        let (length, captured) = block(bytes)?;
        if let Some(captured) = captured {
            return Ok((length, Some(captured.wall)));
        }
        bytes = bytes.get(length..).unwrap_or_default();
    }
}

/// A file, piece by piece: a recording may be larger than the memory.
struct Pieces {
    path: PathBuf,
    extension: &'static str,
    file: File,
    bytes: Vec<u8>,
    start: usize,
    /// The offset of `start` in the file.
    at: u64,
    ended: bool,
    /// The offset at which the file ends within a record.
    cut: Option<u64>,
}

impl Pieces {
    fn open(path: &Path) -> Result<Pieces, ReplayError> {
        let file = open_file(path).map_err(|cause| ReplayError::Io {
            path: path.to_owned(),
            cause,
        })?;
        Ok(Pieces {
            path: path.to_owned(),
            extension: extension(path).unwrap_or(DLI),
            file,
            bytes: Vec::new(),
            start: 0,
            at: 0,
            ended: false,
            cut: None,
        })
    }

    /// The next record, as `first` reads it, together with its length; `None` at the end.
    fn next<T>(
        &mut self,
        mut first: impl FnMut(&[u8]) -> Result<(usize, T), NoRecord>,
    ) -> Result<Option<T>, ReplayError> {
        loop {
            let rest = self.bytes.get(self.start..).unwrap_or_default();
            match first(rest) {
                Ok((length, value)) => {
                    self.start += length;
                    self.at += length as u64;
                    return Ok(Some(value));
                }
                Err(NoRecord::Cut) if !self.ended => self.fill()?,
                Err(NoRecord::Cut) => {
                    self.cut = (!rest.is_empty()).then_some(self.at);
                    return Ok(None);
                }
                Err(NoRecord::Damaged(what)) => {
                    return Err(ReplayError::Damaged {
                        path: self.path.clone(),
                        at: self.at,
                        what,
                        extension: self.extension,
                    });
                }
            }
        }
    }

    fn fill(&mut self) -> Result<(), ReplayError> {
        self.bytes.drain(..self.start);
        self.start = 0;
        let before = self.bytes.len();
        let read = (&self.file).take(PIECE).read_to_end(&mut self.bytes);
        read.map_err(|cause| ReplayError::Io {
            path: self.path.clone(),
            cause,
        })?;
        self.ended = self.bytes.len() == before;
        Ok(())
    }
}

const MAVLINK: &str = "tlog";
const DLI: &str = "pcapng";
/// Longer than any record, so that a record is parsed twice at most.
const PIECE: u64 = 1 << 21;
/// 2100: a damaged time is far beyond.
const LATEST: Duration = Duration::from_secs(4_102_444_800);

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use mavlink_link::dialect::{
        GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage,
    };
    use mavlink_link::frame::{FrameView, Header, MAX_FRAME, encode};

    use super::*;

    const BEGUN: Duration = Duration::from_secs(1_767_225_600);

    fn position(lat: i32) -> MavMessage {
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            lat,
            lon: 85_455_939,
            alt: 488_000,
            ..GLOBAL_POSITION_INT_DATA::default()
        })
    }

    fn heartbeat() -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::default()
        })
    }

    /// A message of system 1 each second.
    fn recorded(from_s: u64, messages: &[MavMessage]) -> Vec<u8> {
        let mut file = Vec::new();
        for (second, message) in (from_s..).zip(messages) {
            let header = Header {
                system_id: 1,
                component_id: 1,
                ..Header::default()
            };
            let mut frame = [0; MAX_FRAME];
            let length = encode(message, header, &mut frame);
            let view = FrameView::parse(&frame[..length]).unwrap();
            let mut out = [0; tlog::MAX_RECORD];
            let length = tlog::record(BEGUN + Duration::from_secs(second), &view, &mut out);
            file.extend(&out[..length]);
        }
        file
    }

    fn write(folder: &Path, name: &str, bytes: &[u8]) {
        fs::write(folder.join(name), bytes).unwrap();
    }

    #[test]
    fn a_moment_shows_what_was_recorded_until_then_over_all_files_of_a_series() {
        let folder = tempfile::tempdir().unwrap();
        let first = recorded(0, &[heartbeat(), position(473_977_434)]);
        let second = recorded(4, &[heartbeat(), position(473_977_500)]);
        // By name -10 would be read before -2.
        write(folder.path(), "1b000101-1767225600-2.tlog", &first);
        write(folder.path(), "1b000101-1767225600-10.tlog", &second);
        write(folder.path(), "notes.txt", b"a person's");
        let timeline = read(&[folder.path().to_owned()]).unwrap();
        let span = (BEGUN, BEGUN + Duration::from_secs(5));
        assert_eq!(timeline.span(), Some(span));
        let at = |ms| {
            let status = timeline.status(BEGUN + Duration::from_millis(ms));
            let vehicle = &status.vehicles[0];
            (
                vehicle.id.clone(),
                vehicle.live,
                vehicle.position.map(|at| at[0]),
            )
        };
        let id = "1b:00:01:01".to_owned();
        assert_eq!(at(500), (id.clone(), true, None));
        assert_eq!(at(1_500), (id.clone(), true, Some(47.397_743_4)));
        // Four seconds without a heartbeat.
        assert_eq!(at(3_900), (id.clone(), false, Some(47.397_743_4)));
        assert_eq!(at(5_000), (id, true, Some(47.397_75)));
        assert!(timeline.status(span.0).warnings.is_empty());
        assert_eq!(timeline.tracks(100)[0].1.len(), 2);
    }

    #[test]
    fn a_file_that_is_cut_off_is_shown_up_to_there_and_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let whole = recorded(0, &[heartbeat(), position(473_977_434), heartbeat()]);
        write(folder.path(), "1b000101-1.tlog", &whole[..whole.len() - 3]);
        let timeline = read(&[folder.path().to_owned()]).unwrap();
        let (_, last) = timeline.span().unwrap();
        assert_eq!(last, BEGUN + Duration::from_secs(1));
        let warnings = timeline.status(last).warnings;
        assert!(
            warnings[0].contains("was cut off within the record at byte"),
            "{warnings:?}"
        );
    }

    #[test]
    fn damage_is_an_error_with_its_place_and_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let one = recorded(0, &[heartbeat()]).len();
        let mut damaged = recorded(0, &[heartbeat(), heartbeat(), heartbeat()]);
        damaged[one + 20] ^= 1;
        let fails = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            let fault = read(std::slice::from_ref(&path)).unwrap_err().to_string();
            fs::remove_file(path).unwrap();
            fault
        };
        let fault = fails("1b000101-1.tlog", &damaged);
        assert!(
            fault.contains(&format!("damaged at byte {one}: message 0: checksum")),
            "{fault}"
        );
        assert!(fault.contains(&format!("head -c {one} ")), "{fault}");
        let mut late = recorded(0, &[heartbeat()]);
        late[0] = 0x7f;
        assert!(fails("1b000101-1.tlog", &late).contains("years after 1970"));
        assert!(fails("1b000101-1.tlog", b"").contains("the recordings are empty"));
        assert!(fails("flight.tlog", b"").contains("begins with no vehicle id"));
        assert!(
            fails("notes.txt", b"").contains("not a recording, expected a file .tlog or .pcapng")
        );
        let mut capture = pcapng::header();
        capture[36] = 1;
        assert!(fails("dli-1.pcapng", &capture).contains("link type 1, expected 101"));
        let fault = read(&[folder.path().to_owned()]).unwrap_err().to_string();
        assert!(fault.contains("not a recording"), "{fault}");
        assert!(
            read(&[folder.path().join("none")])
                .unwrap_err()
                .to_string()
                .contains("none")
        );
    }

    #[test]
    fn a_recording_of_the_dli_alone_is_shown_too() {
        let folder = tempfile::tempdir().unwrap();
        let from = SocketAddr::from(([127, 0, 0, 1], 4_586));
        let mut file = pcapng::header();
        pcapng::datagram(&mut file, BEGUN, from, from, b"no message");
        write(folder.path(), "dli-1767225600.pcapng", &file);
        let timeline = read(&[folder.path().to_owned()]).unwrap();
        assert_eq!(timeline.span(), Some((BEGUN, BEGUN)));
        assert!(timeline.status(BEGUN).vehicles.is_empty());
    }
}
