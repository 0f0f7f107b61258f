//! An MPEG transport stream (ISO/IEC 13818-1) of one program: H.264 video, and local sets as private data.
//!
//! The metadata is carried asynchronously as MISB ST 1402 has it: stream type 6, the registration descriptor `KLVA`, stream id 0xBD; its
//! presentation time is that of the set, so that a player shows a picture and where the sensor looked at the same moment. Clock and
//! presentation times count the same microseconds, those of Unix time; the clock is that of the pictures' arrival and what is presented
//! is [`DELAY_US`] later, time for the metadata of a picture to arrive.

use mpeg2ts::es::{StreamId, StreamType};
use mpeg2ts::pes::PesHeader;
use mpeg2ts::time::{ClockReference, Timestamp};
use mpeg2ts::ts::payload::{Bytes, Pat, Pes, Pmt};
use mpeg2ts::ts::{
    AdaptationField, ContinuityCounter, Descriptor, EsInfo, Pid, ProgramAssociation,
    TransportScramblingControl, TsHeader, TsPacket, TsPacketWriter, TsPayload, VersionNumber,
    WriteTsPacket as _,
};

use super::h264::AccessUnit;

/// Why packets cannot be written: a value that the format has no room for.
pub type TransportError = mpeg2ts::Error;

/// What is presented later than it arrives, in microseconds.
pub const DELAY_US: u64 = 300_000;

const PROGRAM: u16 = 1;
const TABLE_PID: u16 = 0x1000;
const VIDEO_PID: u16 = 0x100;
const METADATA_PID: u16 = 0x101;
/// registration_descriptor, and what it registers.
const REGISTRATION: (u8, &[u8; 4]) = (5, b"KLVA");
/// A receiver that joins waits at most this long for the tables.
const TABLES_US: u64 = 250_000;
/// Bytes of payload of a packet.
const ROOM: usize = TsPacket::SIZE - 4;
/// An adaptation field with a clock reference.
const CLOCK_BYTES: usize = 8;
/// A PES header with a presentation time, and what of it counts for the length of a PES packet.
const PES_HEADER: usize = 14;
const PES_COUNTED: usize = 8;

/// Makes the packets.
#[derive(Debug, Default)]
pub struct Multiplexer {
    tables_us: Option<u64>,
    table: Counter,
    program: Counter,
    video: Counter,
    metadata: Counter,
}

/// The number of the next packet of a stream.
#[derive(Debug, Default)]
struct Counter(ContinuityCounter);

impl Counter {
    fn next(&mut self) -> ContinuityCounter {
        let number = self.0;
        self.0.increment();
        number
    }
}

impl Multiplexer {
    /// The packets of a picture, with the clock, and the tables where they are due.
    ///
    /// # Errors
    /// A value does not fit the format.
    pub fn video(&mut self, unit: &AccessUnit) -> Result<Vec<u8>, TransportError> {
        let mut out =
            Vec::with_capacity(unit.bytes.len() / ROOM * TsPacket::SIZE + 4 * TsPacket::SIZE);
        let due = |before: u64| unit.at_us.abs_diff(before) >= TABLES_US;
        if unit.key || self.tables_us.is_none_or(due) {
            self.tables_us = Some(unit.at_us);
            self.tables(&mut out)?;
        }
        let clock = AdaptationField {
            discontinuity_indicator: false,
            random_access_indicator: unit.key,
            es_priority_indicator: false,
            pcr: Some(clock(unit.at_us)?),
            opcr: None,
            splice_countdown: None,
            transport_private_data: Vec::new(),
            extension: None,
        };
        let header = pes_header(StreamId::new_video(StreamId::VIDEO_MIN)?, unit.at_us)?;
        stream(
            &mut out,
            (VIDEO_PID, &mut self.video),
            header,
            &unit.bytes,
            Some(clock),
        )?;
        Ok(out)
    }

    /// The packets of a local set of this time, after the tables where there were none.
    ///
    /// # Errors
    /// A value does not fit the format.
    pub fn metadata(&mut self, set: &[u8], time_us: u64) -> Result<Vec<u8>, TransportError> {
        let mut out = Vec::with_capacity(5 * TsPacket::SIZE);
        // Before the first picture nothing says what this is.
        if self.tables_us.is_none() {
            self.tables_us = Some(time_us);
            self.tables(&mut out)?;
        }
        let header = pes_header(StreamId::new(StreamId::PRIVATE_STREAM_1), time_us)?;
        stream(
            &mut out,
            (METADATA_PID, &mut self.metadata),
            header,
            set,
            None,
        )?;
        Ok(out)
    }

    fn tables(&mut self, out: &mut Vec<u8>) -> Result<(), TransportError> {
        let association = ProgramAssociation {
            program_num: PROGRAM,
            program_map_pid: Pid::new(TABLE_PID)?,
        };
        let programs = Pat {
            transport_stream_id: 1,
            version_number: VersionNumber::new(),
            table: vec![association],
        };
        put(
            out,
            (Pid::PAT, &mut self.program),
            None,
            TsPayload::Pat(programs),
        )?;
        let (tag, registered) = REGISTRATION;
        let video = EsInfo {
            stream_type: StreamType::H264,
            elementary_pid: Pid::new(VIDEO_PID)?,
            descriptors: vec![],
        };
        let metadata = EsInfo {
            stream_type: StreamType::Mpeg2PacketizedData,
            elementary_pid: Pid::new(METADATA_PID)?,
            descriptors: vec![Descriptor {
                tag,
                data: registered.to_vec(),
            }],
        };
        let streams = Pmt {
            program_num: PROGRAM,
            pcr_pid: Some(Pid::new(VIDEO_PID)?),
            version_number: VersionNumber::new(),
            program_info: vec![],
            es_info: vec![video, metadata],
        };
        put(
            out,
            (TABLE_PID, &mut self.table),
            None,
            TsPayload::Pmt(streams),
        )
    }
}

fn pes_header(stream_id: StreamId, time_us: u64) -> Result<PesHeader, TransportError> {
    let ticks = (time_us + DELAY_US) / 100 * 9 % (Timestamp::MAX + 1);
    Ok(PesHeader {
        stream_id,
        priority: false,
        data_alignment_indicator: true,
        copyright: false,
        original_or_copy: false,
        pts: Some(Timestamp::new(ticks)?),
        dts: None,
        escr: None,
    })
}

fn clock(time_us: u64) -> Result<ClockReference, TransportError> {
    ClockReference::new(time_us * 27 % ((Timestamp::MAX + 1) * 300))
}

/// One PES packet in as many transport packets as it needs.
fn stream(
    out: &mut Vec<u8>,
    (pid, counter): (u16, &mut Counter),
    header: PesHeader,
    data: &[u8],
    clock: Option<AdaptationField>,
) -> Result<(), TransportError> {
    let room = ROOM - PES_HEADER - if clock.is_some() { CLOCK_BYTES } else { 0 };
    let (first, rest) = data.split_at(room.min(data.len()));
    // 0, only lawful of video: as long as it takes.
    let pes_packet_len = u16::try_from(data.len() + PES_COUNTED).unwrap_or(0);
    let first = TsPayload::PesStart(Pes {
        header,
        pes_packet_len,
        data: Bytes::new(first)?,
    });
    put(out, (pid, &mut *counter), clock, first)?;
    for piece in rest.chunks(ROOM) {
        put(
            out,
            (pid, &mut *counter),
            None,
            TsPayload::PesContinuation(Bytes::new(piece)?),
        )?;
    }
    Ok(())
}

fn put(
    out: &mut Vec<u8>,
    (pid, counter): (u16, &mut Counter),
    adaptation_field: Option<AdaptationField>,
    payload: TsPayload,
) -> Result<(), TransportError> {
    let header = TsHeader {
        transport_error_indicator: false,
        transport_priority: false,
        pid: Pid::new(pid)?,
        transport_scrambling_control: TransportScramblingControl::NotScrambled,
        continuity_counter: counter.next(),
    };
    let packet = TsPacket {
        header,
        adaptation_field,
        payload: Some(payload),
    };
    TsPacketWriter::new(out).write_ts_packet(&packet)
}
