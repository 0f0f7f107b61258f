//! A byte stream of H.264 (ITU-T H.264 annex B) as access units: one picture each.
//!
//! The stream carries no times. A unit's time is therefore when its first byte arrived, or what a frame rate says; both need
//! pictures in the order in which they are shown, so a stream with B slices is refused.

/// The largest access unit: a picture of 4K that is hardly compressed.
pub const MAX_UNIT: usize = 8 << 20;

/// One picture, with a delimiter at its beginning as transport streams need it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AccessUnit {
    /// Annex B bytes.
    pub bytes: Vec<u8>,
    /// When its first byte arrived, as [`AccessUnits::push`] was given it.
    pub at_us: u64,
    /// Decoding can begin here.
    pub key: bool,
}

/// Why a stream is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum H264Error {
    /// There is no start code where the stream begins.
    #[error(
        "the video does not begin with a start code of H.264 (annex B): expected a bare H.264 stream, as of \"ffmpeg -f h264\""
    )]
    NoStartCode,
    /// A picture refers to later ones.
    #[error(
        "the video has B slices: its pictures are not in the order in which they are shown, and the stream has no times; encode it without (ffmpeg: -bf 0)"
    )]
    Reordered,
    /// A picture is too large.
    #[error("a picture of over {MAX_UNIT} bytes")]
    TooLarge,
}

/// Splits a stream into access units.
#[derive(Debug, Default)]
pub struct AccessUnits {
    /// From the start code of the first NAL unit that is not yet in `unit`.
    buffer: Vec<u8>,
    /// Bytes of `buffer` in which no start code begins.
    searched: usize,
    buffer_at_us: u64,
    unit: Vec<u8>,
    unit_at_us: u64,
    has_picture: bool,
    has_delimiter: bool,
    key: bool,
}

const SLICE: u8 = 1;
const PARTITION_A: u8 = 2;
const KEY_SLICE: u8 = 5;
const DELIMITER: u8 = 9;
/// A delimiter of a picture of any slices.
const ANY_DELIMITER: [u8; 6] = [0, 0, 0, 1, DELIMITER, 0xf0];

impl AccessUnits {
    /// Takes bytes that arrived at this time; returns the pictures that are complete, which the next picture's first bytes show.
    ///
    /// # Errors
    /// The stream is none of H.264, has B slices, or a picture is too large.
    pub fn push(&mut self, bytes: &[u8], at_us: u64) -> Result<Vec<AccessUnit>, H264Error> {
        let mut done = Vec::new();
        if self.buffer.is_empty() {
            self.buffer_at_us = at_us;
        }
        self.buffer.extend_from_slice(bytes);
        let zeros = self.buffer.iter().take_while(|byte| **byte == 0).count();
        let begins = |byte: &u8| *byte == 1 && zeros >= 2;
        if self.unit.is_empty() && !self.buffer.get(zeros).is_none_or(begins) {
            return Err(H264Error::NoStartCode);
        }
        while let Some(end) = self.next_start() {
            let rest = self.buffer.split_off(end);
            let nal = std::mem::replace(&mut self.buffer, rest);
            done.extend(self.take(&nal)?);
            self.buffer_at_us = at_us;
            self.searched = 0;
        }
        if self.buffer.len() + self.unit.len() > MAX_UNIT {
            return Err(H264Error::TooLarge);
        }
        Ok(done)
    }

    /// The stream has ended: the pictures that are left.
    ///
    /// # Errors
    /// As of [`AccessUnits::push`].
    pub fn finish(&mut self) -> Result<Vec<AccessUnit>, H264Error> {
        let nal = std::mem::take(&mut self.buffer);
        // The last NAL unit may be a picture of its own.
        let before = self.take(&nal)?;
        Ok(before.into_iter().chain(self.close()).collect())
    }

    /// Where the second start code of the buffer begins, its zeros included.
    fn next_start(&mut self) -> Option<usize> {
        let from = self.searched.max(first_byte(&self.buffer)?);
        let found = self
            .buffer
            .get(from..)?
            .windows(3)
            .position(|three| three == [0, 0, 1]);
        let Some(found) = found else {
            self.searched = from.max(self.buffer.len().saturating_sub(2));
            return None;
        };
        let mut at = from + found;
        while at > 0 && self.buffer.get(at - 1) == Some(&0) {
            at -= 1;
        }
        Some(at)
    }

    /// Takes a NAL unit with its start code; returns the picture that ended before it.
    fn take(&mut self, nal: &[u8]) -> Result<Option<AccessUnit>, H264Error> {
        let Some(header) = first_byte(nal) else {
            return Ok(None);
        };
        let Some(kind) = nal.get(header).map(|byte| byte & 0x1f) else {
            return Ok(None);
        };
        let mut begins = matches!(kind, 6..=9 | 14..=18);
        if matches!(kind, SLICE | PARTITION_A | KEY_SLICE) {
            let mut bits = Bits::of(nal.get(header + 1..).unwrap_or_default());
            let first_macroblock = bits.exp_golomb();
            begins = first_macroblock == Some(0);
            // slice_type 1 and 6 are B.
            if matches!(bits.exp_golomb(), Some(1 | 6)) {
                return Err(H264Error::Reordered);
            }
        }
        let before = if begins && self.has_picture {
            self.close()
        } else {
            None
        };
        if self.unit.is_empty() {
            self.unit_at_us = self.buffer_at_us;
        }
        self.has_delimiter |= kind == DELIMITER;
        self.has_picture |= matches!(kind, SLICE | PARTITION_A | KEY_SLICE);
        self.key |= kind == KEY_SLICE;
        self.unit.extend_from_slice(nal);
        Ok(before)
    }

    fn close(&mut self) -> Option<AccessUnit> {
        let unit = std::mem::take(&mut self.unit);
        let (picture, delimiter) = (
            std::mem::take(&mut self.has_picture),
            std::mem::take(&mut self.has_delimiter),
        );
        let key = std::mem::take(&mut self.key);
        let bytes = if delimiter {
            unit
        } else {
            [&ANY_DELIMITER[..], &unit].concat()
        };
        picture.then_some(AccessUnit {
            bytes,
            at_us: self.unit_at_us,
            key,
        })
    }
}

/// Where the byte after the first start code is.
fn first_byte(bytes: &[u8]) -> Option<usize> {
    let one = bytes.iter().position(|byte| *byte != 0)?;
    (one >= 2 && bytes.get(one) == Some(&1)).then_some(one + 1)
}

/// The first bits of a slice header, emulation prevention removed.
struct Bits {
    bits: u64,
    left: u32,
}

impl Bits {
    fn of(bytes: &[u8]) -> Bits {
        let (mut bits, mut left, mut zeros) = (0_u64, 0, 0);
        for byte in bytes {
            if left == 64 {
                break;
            }
            if zeros >= 2 && *byte == 3 {
                zeros = 0;
                continue;
            }
            zeros = if *byte == 0 { zeros + 1 } else { 0 };
            bits = bits << 8 | u64::from(*byte);
            left += 8;
        }
        Bits {
            bits: if left == 0 { 0 } else { bits << (64 - left) },
            left,
        }
    }

    fn exp_golomb(&mut self) -> Option<u64> {
        let zeros = self.bits.leading_zeros();
        let length = 2 * zeros + 1;
        if length > self.left {
            return None;
        }
        let value = (self.bits >> (64 - length)) - 1;
        self.bits = self.bits.checked_shl(length).unwrap_or(0);
        self.left -= length;
        Some(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern() -> Vec<u8> {
        std::fs::read(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/data/video/pattern.h264"
        ))
        .expect("the video")
    }

    fn split(video: &[u8], chunk: usize) -> Result<Vec<AccessUnit>, H264Error> {
        let (mut units, mut found) = (AccessUnits::default(), Vec::new());
        for (place, bytes) in video.chunks(chunk).enumerate() {
            found.extend(units.push(bytes, (place * chunk) as u64)?);
        }
        found.extend(units.finish()?);
        Ok(found)
    }

    #[test]
    fn pictures_are_the_same_however_the_bytes_arrive_and_nothing_is_lost() {
        let video = pattern();
        let whole = split(&video, video.len()).expect("a video");
        assert_eq!(whole.len(), 50);
        let keys: Vec<usize> = (0..50).filter(|at| whole[*at].key).collect();
        assert_eq!(keys, [0, 25]);
        let bytes: Vec<u8> = whole
            .iter()
            .flat_map(|unit| {
                unit.bytes
                    .strip_prefix(&ANY_DELIMITER)
                    .expect("a delimiter")
            })
            .copied()
            .collect();
        assert!(bytes == video);
        for chunk in [1, 2, 3, 7, 100] {
            let parts = split(&video, chunk).expect("a video");
            assert!(
                parts
                    .iter()
                    .map(|unit| &unit.bytes)
                    .eq(whole.iter().map(|unit| &unit.bytes)),
                "{chunk}"
            );
            // A picture is of the time at which its first byte arrived, within a chunk of zeros that may belong to it.
            let mut at = 0;
            for unit in parts {
                let off = unit.at_us.abs_diff(at);
                assert!(off <= 4 + chunk as u64, "{chunk}: {} {at}", unit.at_us);
                at += (unit.bytes.len() - ANY_DELIMITER.len()) as u64;
            }
        }
        // One that has delimiters keeps them.
        let delimited: Vec<u8> = whole.iter().flat_map(|unit| unit.bytes.clone()).collect();
        assert_eq!(split(&delimited, 5).expect("a video").len(), 50);
        assert_eq!(
            split(&delimited, 5).expect("a video")[7].bytes,
            whole[7].bytes
        );
    }

    #[test]
    fn a_stream_that_cannot_be_timed_or_is_none_is_refused() {
        // first_mb_in_slice 0, slice_type 6: 1, 00111.
        let b_slice = [0, 0, 0, 1, SLICE, 0b1001_1100, 0xff, 0, 0, 1, 9];
        assert_eq!(split(&b_slice, 20), Err(H264Error::Reordered));
        assert_eq!(
            split(b"\x00\x00\x00\x20ftypisom", 3),
            Err(H264Error::NoStartCode)
        );
        assert_eq!(split(b"G@\x00", 3), Err(H264Error::NoStartCode));
        assert_eq!(split(&[0; 5], 1), Ok(vec![]), "nothing yet");
        let mut units = AccessUnits::default();
        units
            .push(&[0, 0, 1, SLICE, 0x88], 0)
            .expect("a picture begins");
        let endless = (0..=9).find_map(|_| units.push(&[0xaa; 1 << 20], 0).err());
        assert_eq!(endless, Some(H264Error::TooLarge));
    }
}
