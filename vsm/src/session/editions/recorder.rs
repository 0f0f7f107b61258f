//! Recorders (#205, #306, #307), for which no layout of Edition 4 is known: here they are the video recorder of a station's
//! camera.
//!
//! A recording camera is a part of its station, so the Recording Device Number is the station's number. #205 becomes a
//! 19100 that begins or ends a recording and is treated like every 19100: LOI 3 of the station, refused with the reason,
//! carried out once CAMERA_CAPTURE_STATUS shows it. #306 and #307 are answered from the 21101 of each station, which a
//! #1403 for them requests.

use std::collections::{BTreeMap, BTreeSet};

use mapping::payload::report::{END_RECORDING, RECORDING};
use stanag_msgs::ed25::Record;
use stanag_msgs::enums::{EoirSystemMode, StationBitmap1To16};
use stanag_msgs::messages::EoIrLaserPayloadCommand;
use stanag_msgs::{Id, Message};

use super::form::{Refusal, new};

/// Requests for the recorders of each vehicle that are not answered for every station yet.
#[derive(Debug, Default)]
pub(super) struct Recorders {
    requested: BTreeMap<(Id, u16), BTreeSet<u16>>,
}

impl Recorders {
    /// #1403 for #306 or #307: the next 21101 of each station answers it.
    pub(super) fn request(&mut self, vehicle: Id, number: u16) {
        self.requested.insert((vehicle, number), BTreeSet::new());
    }

    /// The answers made from a 21101. Once a station reports a second time, all stations have been answered for.
    pub(super) fn answers(&mut self, vehicle: Id, state: &Record) -> Vec<Record> {
        let station = state.whole(STATION) as u16;
        let mut answers = Vec::new();
        for number in [STATUS, CONNECTION] {
            let Some(answered) = self.requested.get_mut(&(vehicle, number)) else {
                continue;
            };
            if !answered.insert(station) {
                self.requested.remove(&(vehicle, number));
                continue;
            }
            answers.extend(answer(number, station, state));
        }
        answers
    }
}

/// #306 or #307 of a station; `None` if it has no camera that reports whether it records.
fn answer(number: u16, station: u16, state: &Record) -> Option<Record> {
    let device = station.trailing_zeros() + 1;
    let mode = state.number(SYSTEM_MODE)? as u8;
    // A camera also reports its stream or a field of view; a gimbal alone is active too, but records nothing.
    let has_camera = [IMAGE_OUTPUT, WIDTH]
        .iter()
        .any(|field| state.number(*field).is_some());
    let mode = EoirSystemMode::from_raw(mode);
    // For a stowed camera it is not known.
    let status = if mode == RECORDING {
        RECORDS
    } else if mode == EoirSystemMode::Active && has_camera {
        READY
    } else {
        return None;
    };
    let mut record = new(number);
    record.set(1, state.number(1)?);
    if number == CONNECTION {
        record.set(4, station);
        record.set(5, device);
    } else {
        // No index, replay or rate: a camera reports none, and 0 means none in each of these fields.
        record.set(4, device);
        record.set(6, status);
    }
    Some(record)
}

/// Converts #205 to a 19100; also returns what of it is ignored.
///
/// # Errors
/// A mode, a replay or a device that no camera has.
pub(super) fn command(record: &Record) -> Result<(Message, Option<String>), Refusal> {
    let refuse = |why: String| Err(Refusal::new("not supported", why));
    let device = record.whole(4);
    if !(1..=16).contains(&device) {
        return refuse(format!(
            "Recording Device Number {device}, expected 1 to 16: the number of the station whose camera records"
        ));
    }
    let mode = match record.whole(6) {
        STOP => END_RECORDING,
        RECORD => RECORDING,
        other => {
            return refuse(format!(
                "Set Recording Mode {other}, expected 0 (stop) or 2 (recording): a camera makes nothing ready, plays and seeks \
                 nothing"
            ));
        }
    };
    let replay = record.whole(9);
    if replay != STOP {
        return refuse(format!(
            "Set Replay Mode {replay}, expected 0 (stop): no camera replays over MAVLink"
        ));
    }
    let unused = [
        (7, "Set Recording Rate"),
        (8, "Initial Recording Index"),
        (11, "Seek Replay Index"),
    ];
    let set = |field: u8| record.number(field).is_some_and(|value| value != 0.0);
    let unused: Vec<&str> = (unused.iter().filter(|(field, _)| set(*field)))
        .map(|(_, name)| *name)
        .collect();
    let notice = format!(
        "#205: ignored, since the camera decides: {}",
        unused.join(", ")
    );
    let command = EoIrLaserPayloadCommand {
        time_stamp: record.stamp(),
        station_number_1_16: Some(StationBitmap1To16::from_raw(1 << (device - 1))),
        system_operating_mode: Some(mode),
        ..EoIrLaserPayloadCommand::default()
    };
    Ok((command.into(), (!unused.is_empty()).then_some(notice)))
}

/// Whether a #1403 requests a report that is made here from 21101.
pub(super) fn is_of_recorder(number: u32) -> bool {
    [STATUS, CONNECTION].map(u32::from).contains(&number)
}

const STATUS: u16 = 306;
const CONNECTION: u16 = 307;
/// #302, from which both reports are made.
pub(super) const SENSOR_STATE: u32 = 302;
/// Fields of 21101.
const STATION: u8 = 2;
const SYSTEM_MODE: u8 = 4;
const IMAGE_OUTPUT: u8 = 7;
const WIDTH: u8 = 11;
/// Set Recording Mode and Set Replay Mode.
const STOP: u32 = 0;
const RECORD: u32 = 2;
/// Recording Status.
const READY: u32 = 2;
const RECORDS: u32 = 3;
