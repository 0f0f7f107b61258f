//! MISB ST 0601 UAS Datalink Local Set: metadata of a video as key, length, value.
//!
//! The second form, beside the DLI's messages, in which a ground station receives where an aircraft is and where its
//! sensor points. One table of items yields the struct and both directions of the codec. An item that is `None` is
//! left out of the set, since no item here has a value for "not known". A decoder reads such values ("out of range"
//! of ST 0601, the lowest integer of a signed item) as absent too.
//!
//! The items and their scales are those of ST 0601.8; later versions keep them. All have tags below 128, which public
//! decoders need.
//!
//! ```
//! use stanag_msgs::klv::LocalSet;
//!
//! let set = LocalSet { sensor_latitude_deg: Some(47.4), ..LocalSet::at(1_700_000_000_000_000) };
//! let bytes = set.encode().unwrap();
//! let (decoded, length) = LocalSet::decode(&bytes).unwrap();
//! assert_eq!(length, bytes.len());
//! assert!((decoded.sensor_latitude_deg.unwrap() - 47.4).abs() < 1e-6);
//! ```

/// The universal key of the local set.
pub const KEY: [u8; 16] = [
    0x06, 0x0e, 0x2b, 0x34, 0x02, 0x0b, 0x01, 0x01, 0x0e, 0x01, 0x03, 0x01, 0x01, 0x00, 0x00, 0x00,
];
/// Item 65: the version of ST 0601 whose items these are.
pub const VERSION: u8 = 8;
/// Bytes of the longest text of an item.
pub const MAX_TEXT: usize = 127;

/// Item 1: the checksum.
const CHECKSUM: u8 = 1;
/// Item 2: the time.
const TIME_STAMP: u8 = 2;
/// Item 65: the version.
const LS_VERSION: u8 = 65;

/// The layout of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Scale {
    /// This many bytes; 0 is the low end of the range and all ones the high end.
    Unsigned(u32, f64, f64),
    /// This many bytes of two's complement, symmetric about 0; the lowest integer means "out of range".
    Signed(u32, f64),
}

/// An item with a number as its value: its name, tag and range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// Its name in ST 0601.
    pub name: &'static str,
    /// Its tag.
    pub tag: u8,
    scale: Scale,
}

impl Number {
    /// The lowest and the highest value, in the unit that the field's name ends with.
    #[must_use]
    pub const fn range(&self) -> (f64, f64) {
        match self.scale {
            Scale::Unsigned(_, low, high) => (low, high),
            Scale::Signed(_, high) => (-high, high),
        }
    }

    /// Half the step between two values: the largest error of encoding.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        let (low, high) = self.range();
        (high - low) / self.steps() / 2.0
    }

    const fn bytes(&self) -> u32 {
        match self.scale {
            Scale::Unsigned(bytes, ..) | Scale::Signed(bytes, _) => bytes,
        }
    }

    /// Steps from the low to the high end.
    fn steps(&self) -> f64 {
        let codes = 2_f64.powi(8 * self.bytes() as i32);
        match self.scale {
            Scale::Unsigned(..) => codes - 1.0,
            Scale::Signed(..) => codes - 2.0,
        }
    }

    fn holds(&self, value: f64) -> bool {
        let (low, high) = self.range();
        (low..=high).contains(&value)
    }

    fn raw(&self, value: f64) -> i64 {
        let (low, high) = self.range();
        match self.scale {
            Scale::Unsigned(..) => ((value - low) / (high - low) * self.steps()).round() as i64,
            Scale::Signed(..) => (value / high * self.steps() / 2.0).round() as i64,
        }
    }

    /// The value of these bytes; `None` where the sender marked it as out of range.
    fn value(&self, bytes: &[u8]) -> Option<f64> {
        let unsigned = bytes
            .iter()
            .fold(0_i64, |sum, byte| sum << 8 | i64::from(*byte));
        let (low, high) = self.range();
        match self.scale {
            Scale::Unsigned(..) => Some(low + (high - low) * unsigned as f64 / self.steps()),
            Scale::Signed(width, _) => {
                let unused = 64 - 8 * width;
                let signed = unsigned << unused >> unused;
                let lowest = -1_i64 << (8 * width - 1);
                (signed != lowest).then(|| high * signed as f64 * 2.0 / self.steps())
            }
        }
    }
}

/// Why a set cannot be written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KlvEncodeError {
    /// A number that its item cannot hold.
    #[error("item {tag} {name}: {value} is out of range: expected {low} to {high}")]
    OutOfRange {
        /// The item.
        name: &'static str,
        /// Its tag.
        tag: u8,
        /// The value.
        value: f64,
        /// The lowest.
        low: f64,
        /// The highest.
        high: f64,
    },
    /// A text that is too long.
    #[error("item {tag}: a text of {length} bytes: expected at most {MAX_TEXT}")]
    TooLong {
        /// The item's tag.
        tag: u8,
        /// Bytes.
        length: usize,
    },
}

/// Why bytes are not a local set.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KlvDecodeError {
    /// Another key, or the bytes end in it.
    #[error("the bytes do not begin with the key of ST 0601")]
    Key,
    /// They end too early, or a length is invalid.
    #[error("byte {at}: the set ends within an item, or its length cannot be read")]
    Truncated {
        /// Where.
        at: usize,
    },
    /// An item with another length than in the table.
    #[error("item {tag}: {found} bytes, expected {expected}")]
    Length {
        /// The item's tag.
        tag: u8,
        /// Bytes it has.
        found: usize,
        /// Bytes it should have.
        expected: usize,
    },
    /// A text that is not UTF-8.
    #[error("item {tag}: its text is not UTF-8")]
    Text {
        /// The item's tag.
        tag: u8,
    },
    /// The checksum is wrong, or is not the last item.
    #[error("checksum {found:?}, expected {expected:#06x} as the last item")]
    Checksum {
        /// The checksum in the set.
        found: Option<u16>,
        /// The computed checksum.
        expected: u16,
    },
    /// Item 2 is missing.
    #[error("item 2, the Precision Time Stamp, is missing")]
    NoTime,
}

macro_rules! local_set {
    (
        texts { $( $(#[$text_doc:meta])* $text:ident = $text_tag:literal; )* }
        numbers { $( $(#[$doc:meta])* $field:ident = $tag:literal, $name:literal, $scale:expr; )* }
    ) => {
        /// A local set: the state at one moment. Each field is an item of ST 0601; see [`LocalSet::NUMBERS`] for ranges.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct LocalSet {
            /// Precision Time Stamp (2): microseconds since 1970, without leap seconds. When the values were valid.
            pub time_us: u64,
            $( $(#[$text_doc])* pub $text: Option<String>, )*
            $( $(#[$doc])* pub $field: Option<f64>, )*
        }

        impl LocalSet {
            /// The items that are numbers, in the order in which they are written.
            pub const NUMBERS: &[Number] = &[
                $( Number { name: $name, tag: $tag, scale: $scale }, )*
            ];
            const TEXTS: &[u8] = &[$( $text_tag, )*];

            fn texts(&mut self) -> [&mut Option<String>; Self::TEXTS.len()] {
                [$( &mut self.$text, )*]
            }

            /// The values of [`LocalSet::NUMBERS`], in their order.
            pub fn numbers(&mut self) -> [&mut Option<f64>; Self::NUMBERS.len()] {
                [$( &mut self.$field, )*]
            }
        }
    };
}

local_set! {
    texts {
        /// Mission ID (3).
        mission_id = 3;
        /// Platform Tail Number (4).
        platform_tail_number = 4;
        /// Platform Designation (10): the model of the aircraft.
        platform_designation = 10;
        /// Image Source Sensor (11): the sensor of the picture, such as EO or IR.
        image_source_sensor = 11;
        /// Image Coordinate System (12).
        image_coordinate_system = 12;
        /// Platform Call Sign (59).
        platform_call_sign = 59;
    }
    numbers {
        /// Platform Heading Angle (5), true, degrees.
        platform_heading_deg = 5, "Platform Heading Angle", Scale::Unsigned(2, 0.0, 360.0);
        /// Platform Pitch Angle (6), degrees, up positive; steeper ones are item 90.
        platform_pitch_deg = 6, "Platform Pitch Angle", Scale::Signed(2, 20.0);
        /// Platform Roll Angle (7), degrees, right wing down positive; steeper ones are item 91.
        platform_roll_deg = 7, "Platform Roll Angle", Scale::Signed(2, 50.0);
        /// Sensor Latitude (13), degrees north.
        sensor_latitude_deg = 13, "Sensor Latitude", Scale::Signed(4, 90.0);
        /// Sensor Longitude (14), degrees east.
        sensor_longitude_deg = 14, "Sensor Longitude", Scale::Signed(4, 180.0);
        /// Sensor True Altitude (15), metres above mean sea level.
        sensor_true_altitude_m = 15, "Sensor True Altitude", Scale::Unsigned(2, -900.0, 19_000.0);
        /// Sensor Horizontal Field of View (16), degrees.
        sensor_horizontal_fov_deg = 16, "Sensor Horizontal Field of View", Scale::Unsigned(2, 0.0, 180.0);
        /// Sensor Vertical Field of View (17), degrees.
        sensor_vertical_fov_deg = 17, "Sensor Vertical Field of View", Scale::Unsigned(2, 0.0, 180.0);
        /// Sensor Relative Azimuth Angle (18), degrees right of the platform's nose.
        sensor_relative_azimuth_deg = 18, "Sensor Relative Azimuth Angle", Scale::Unsigned(4, 0.0, 360.0);
        /// Sensor Relative Elevation Angle (19), degrees above the platform's longitudinal and transverse axes.
        sensor_relative_elevation_deg = 19, "Sensor Relative Elevation Angle", Scale::Signed(4, 180.0);
        /// Sensor Relative Roll Angle (20), degrees clockwise.
        sensor_relative_roll_deg = 20, "Sensor Relative Roll Angle", Scale::Unsigned(4, 0.0, 360.0);
        /// Slant Range (21), metres.
        slant_range_m = 21, "Slant Range", Scale::Unsigned(4, 0.0, 5_000_000.0);
        /// Frame Center Latitude (23), degrees north.
        frame_center_latitude_deg = 23, "Frame Center Latitude", Scale::Signed(4, 90.0);
        /// Frame Center Longitude (24), degrees east.
        frame_center_longitude_deg = 24, "Frame Center Longitude", Scale::Signed(4, 180.0);
        /// Frame Center Elevation (25), metres above mean sea level.
        frame_center_elevation_m = 25, "Frame Center Elevation", Scale::Unsigned(2, -900.0, 19_000.0);
        /// Platform Ground Speed (56), m/s.
        platform_ground_speed_m_s = 56, "Platform Ground Speed", Scale::Unsigned(1, 0.0, 255.0);
        /// Sensor Ellipsoid Height (75), metres above the WGS-84 ellipsoid.
        sensor_ellipsoid_height_m = 75, "Sensor Ellipsoid Height", Scale::Unsigned(2, -900.0, 19_000.0);
        /// Frame Center Height Above Ellipsoid (78), metres.
        frame_center_ellipsoid_height_m = 78, "Frame Center Height Above Ellipsoid", Scale::Unsigned(2, -900.0, 19_000.0);
        /// Sensor North Velocity (79), m/s.
        sensor_north_velocity_m_s = 79, "Sensor North Velocity", Scale::Signed(2, 327.0);
        /// Sensor East Velocity (80), m/s.
        sensor_east_velocity_m_s = 80, "Sensor East Velocity", Scale::Signed(2, 327.0);
        /// Platform Pitch Angle (Full) (90), degrees.
        platform_pitch_full_deg = 90, "Platform Pitch Angle (Full)", Scale::Signed(4, 90.0);
        /// Platform Roll Angle (Full) (91), degrees.
        platform_roll_full_deg = 91, "Platform Roll Angle (Full)", Scale::Signed(4, 90.0);
    }
}

impl LocalSet {
    /// A set with this time and nothing else. `time_us`: microseconds since 1970, without leap seconds.
    #[must_use]
    pub fn at(time_us: u64) -> LocalSet {
        LocalSet {
            time_us,
            ..LocalSet::default()
        }
    }

    /// Leaves out numbers that their items cannot hold, such as a roll beyond 90 degrees.
    pub fn clear_out_of_range(&mut self) {
        for (item, value) in Self::NUMBERS.iter().zip(self.numbers()) {
            *value = value.filter(|value| item.holds(*value));
        }
    }

    /// The set with its key: the time comes first, the version and the checksum last.
    ///
    /// # Errors
    /// A number is out of the range of its item, or a text is too long.
    pub fn encode(&self) -> Result<Vec<u8>, KlvEncodeError> {
        let mut set = self.clone();
        let mut body = Vec::with_capacity(256);
        put(&mut body, TIME_STAMP, &set.time_us.to_be_bytes());
        for (tag, text) in Self::TEXTS.iter().zip(set.texts()) {
            let Some(text) = text else { continue };
            let length = text.len();
            if length > MAX_TEXT {
                return Err(KlvEncodeError::TooLong { tag: *tag, length });
            }
            put(&mut body, *tag, text.as_bytes());
        }
        for (item, value) in Self::NUMBERS.iter().zip(set.numbers()) {
            let Some(value) = *value else { continue };
            if !item.holds(value) {
                let (low, high) = item.range();
                let Number { name, tag, .. } = *item;
                return Err(KlvEncodeError::OutOfRange {
                    name,
                    tag,
                    value,
                    low,
                    high,
                });
            }
            let raw = item.raw(value).to_be_bytes();
            put(
                &mut body,
                item.tag,
                raw.get(8 - item.bytes() as usize..).unwrap_or_default(),
            );
        }
        put(&mut body, LS_VERSION, &[VERSION]);
        let mut bytes = KEY.to_vec();
        // The length includes the checksum's item.
        put_length(&mut bytes, body.len() + 4);
        bytes.append(&mut body);
        bytes.extend([CHECKSUM, 2]);
        let sum = checksum(&bytes);
        bytes.extend(sum.to_be_bytes());
        Ok(bytes)
    }

    /// Reads the set at the beginning of `bytes`, and returns its length too. Items that are not in the table are
    /// skipped.
    ///
    /// # Errors
    /// The bytes are not a set, or are damaged.
    pub fn decode(bytes: &[u8]) -> Result<(LocalSet, usize), KlvDecodeError> {
        if !bytes.starts_with(&KEY) {
            return Err(KlvDecodeError::Key);
        }
        let mut at = KEY.len();
        let length = take_length(bytes, &mut at)?;
        let end = at.checked_add(length).filter(|end| *end <= bytes.len());
        let end = end.ok_or(KlvDecodeError::Truncated { at })?;
        // The checksum is verified before anything in the set is believed.
        let sum_at = end.checked_sub(2).filter(|sum_at| *sum_at >= at);
        let sum_at = sum_at.ok_or(KlvDecodeError::Truncated { at })?;
        let (whole, sum) = bytes.get(..end).unwrap_or_default().split_at(sum_at);
        let expected = checksum(whole);
        let found = whole
            .ends_with(&[CHECKSUM, 2])
            .then(|| sum.iter().fold(0, |sum, byte| sum << 8 | u16::from(*byte)));
        if found != Some(expected) {
            return Err(KlvDecodeError::Checksum { found, expected });
        }
        let (mut set, mut time) = (LocalSet::default(), None);
        while at < sum_at - 2 {
            let tag = take_tag(whole, &mut at)?;
            let length = take_length(whole, &mut at)?;
            let value = at.checked_add(length).and_then(|end| whole.get(at..end));
            let value = value.ok_or(KlvDecodeError::Truncated { at })?;
            at += length;
            if tag == TIME_STAMP {
                let wide = <[u8; 8]>::try_from(value);
                let wide = wide.map_err(|_| KlvDecodeError::Length {
                    tag,
                    found: length,
                    expected: 8,
                })?;
                time = Some(u64::from_be_bytes(wide));
            } else {
                set.take(tag, value)?;
            }
        }
        set.time_us = time.ok_or(KlvDecodeError::NoTime)?;
        Ok((set, end))
    }

    fn take(&mut self, tag: u8, value: &[u8]) -> Result<(), KlvDecodeError> {
        if let Some(place) = Self::TEXTS.iter().position(|known| *known == tag) {
            let text = std::str::from_utf8(value).map_err(|_| KlvDecodeError::Text { tag })?;
            if let Some(slot) = self.texts().into_iter().nth(place) {
                *slot = Some(text.to_owned());
            }
        }
        let mut numbers = Self::NUMBERS.iter().zip(self.numbers());
        if let Some((item, slot)) = numbers.find(|(item, _)| item.tag == tag) {
            let (found, expected) = (value.len(), item.bytes() as usize);
            if found != expected {
                return Err(KlvDecodeError::Length {
                    tag,
                    found,
                    expected,
                });
            }
            *slot = item.value(value);
        }
        Ok(())
    }
}

/// The sum of the 16-bit words of everything before it, including the key, and the checksum's own tag and length.
fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().enumerate().fold(0, |sum: u16, (place, byte)| {
        let shift = if place % 2 == 0 { 8 } else { 0 };
        sum.wrapping_add(u16::from(*byte) << shift)
    })
}

fn put(bytes: &mut Vec<u8>, tag: u8, value: &[u8]) {
    bytes.push(tag);
    put_length(bytes, value.len());
    bytes.extend_from_slice(value);
}

/// BER: a length below 128 in one byte, otherwise preceded by the number of its bytes.
fn put_length(bytes: &mut Vec<u8>, length: usize) {
    match u8::try_from(length) {
        Ok(short) if short < 0x80 => bytes.push(short),
        _ => {
            let long = length.to_be_bytes();
            let used = long
                .iter()
                .position(|byte| *byte != 0)
                .unwrap_or(long.len());
            let long = long.get(used..).unwrap_or_default();
            bytes.push(0x80 | long.len() as u8);
            bytes.extend_from_slice(long);
        }
    }
}

fn take_byte(bytes: &[u8], at: &mut usize) -> Result<u8, KlvDecodeError> {
    let byte = bytes
        .get(*at)
        .ok_or(KlvDecodeError::Truncated { at: *at })?;
    *at += 1;
    Ok(*byte)
}

fn take_length(bytes: &[u8], at: &mut usize) -> Result<usize, KlvDecodeError> {
    let first = take_byte(bytes, at)?;
    if first < 0x80 {
        return Ok(first.into());
    }
    // No set needs more than four bytes of length; 0 would mean an indefinite length.
    if !(1..=4).contains(&(first & 0x7f)) {
        return Err(KlvDecodeError::Truncated { at: *at });
    }
    (0..first & 0x7f).try_fold(0, |sum: usize, _| {
        Ok(sum << 8 | usize::from(take_byte(bytes, at)?))
    })
}

/// A tag in BER-OID form; tags above 127, which no table here has, are all read as 0.
fn take_tag(bytes: &[u8], at: &mut usize) -> Result<u8, KlvDecodeError> {
    let first = take_byte(bytes, at)?;
    if first < 0x80 {
        return Ok(first);
    }
    while take_byte(bytes, at)? >= 0x80 {}
    Ok(0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Any set: each text and number may be absent, numbers anywhere in their range.
    fn any_set() -> impl Strategy<Value = LocalSet> {
        let texts =
            proptest::collection::vec(proptest::option::of("[ -~]{0,127}"), LocalSet::TEXTS.len());
        let numbers =
            proptest::collection::vec(proptest::option::of(0.0..=1.0_f64), LocalSet::NUMBERS.len());
        (any::<u64>(), texts, numbers).prop_map(|(time_us, texts, numbers)| {
            let mut set = LocalSet::at(time_us);
            for (slot, text) in set.texts().into_iter().zip(texts) {
                *slot = text;
            }
            for ((item, slot), part) in LocalSet::NUMBERS.iter().zip(set.numbers()).zip(numbers) {
                let (low, high) = item.range();
                *slot = part.map(|part| (low + (high - low) * part).clamp(low, high));
            }
            set
        })
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_decoded_within_half_a_step(mut set in any_set()) {
            let bytes = set.encode().expect("in range");
            let (mut decoded, length) = LocalSet::decode(&bytes).expect("a set");
            prop_assert_eq!(length, bytes.len());
            prop_assert_eq!(decoded.time_us, set.time_us);
            prop_assert_eq!(decoded.texts(), set.texts());
            for ((item, was), is) in LocalSet::NUMBERS.iter().zip(set.numbers()).zip(decoded.numbers()) {
                prop_assert_eq!(was.is_some(), is.is_some(), "{}", item.name);
                if let (Some(was), Some(is)) = (*was, *is) {
                    prop_assert!((was - is).abs() <= item.rounding() * 1.000_001, "{} {was} {is}", item.name);
                }
            }
            // And what was decoded encodes to the same bytes.
            prop_assert_eq!(decoded.encode().expect("in range"), bytes);
        }

        #[test]
        fn damaged_and_random_bytes_are_refused_and_never_panic(set in any_set(), at in any::<prop::sample::Index>(), bit in 0_u32..8, more in any::<Vec<u8>>()) {
            let mut bytes = set.encode().expect("in range");
            let place = at.index(bytes.len());
            bytes[place] ^= 1_u8 << bit;
            prop_assert!(LocalSet::decode(&bytes).is_err());
            bytes.truncate(place);
            prop_assert!(LocalSet::decode(&bytes).is_err());
            let _ = LocalSet::decode(&[&KEY[..], &more].concat());
        }
    }

    #[test]
    fn a_number_beyond_its_item_is_refused_by_name_or_left_out() {
        let mut set = LocalSet {
            platform_pitch_deg: Some(20.1),
            ..LocalSet::at(1)
        };
        let refused = set.encode().expect_err("too steep").to_string();
        assert_eq!(
            refused,
            "item 6 Platform Pitch Angle: 20.1 is out of range: expected -20 to 20"
        );
        set.slant_range_m = Some(f64::NAN);
        set.platform_roll_deg = Some(-50.0);
        set.clear_out_of_range();
        assert_eq!(
            (
                set.platform_pitch_deg,
                set.slant_range_m,
                set.platform_roll_deg
            ),
            (None, None, Some(-50.0))
        );
    }

    #[test]
    fn an_out_of_range_mark_and_items_of_later_versions_are_absent() {
        let bytes = LocalSet {
            platform_pitch_deg: Some(5.0),
            ..LocalSet::at(7)
        }
        .encode()
        .expect("in range");
        let mut body = bytes[17..bytes.len() - 4].to_vec();
        let pitch = body
            .windows(2)
            .position(|item| item == [6, 2])
            .expect("the item");
        body[pitch + 2..pitch + 4].copy_from_slice(&[0x80, 0x00]);
        // Items 129 and 92.
        body.extend([0x81, 0x01, 1, 0xff, 92, 2, 1, 2]);
        let mut changed = KEY.to_vec();
        put_length(&mut changed, body.len() + 4);
        changed.extend(body);
        changed.extend([CHECKSUM, 2]);
        let sum = checksum(&changed);
        changed.extend(sum.to_be_bytes());
        assert_eq!(
            LocalSet::decode(&changed),
            Ok((LocalSet::at(7), changed.len()))
        );
    }

    /// Values of the standard's own examples, item by item, with which other people's decoders are tested.
    #[test]
    fn the_scales_are_those_of_published_examples() {
        for (tag, bytes, value) in [
            (5, &[0x71, 0xC2][..], 159.974_365),
            (6, &[0xFD, 0x3D], -0.431_531),
            (7, &[0x08, 0xB8], 3.405_814),
            (13, &[0x55, 0x95, 0xB6, 0x6D], 60.176_822_966_978_335),
            (14, &[0x5B, 0x53, 0x60, 0xC4], 128.426_759_042_045_75),
            (15, &[0xC2, 0x21], 14_190.719_5),
            (16, &[0xCD, 0x9C], 144.571_298),
            (18, &[0x72, 0x4A, 0x0A, 0x20], 160.719_211_474_396_8),
            (19, &[0x87, 0xF8, 0x4B, 0x86], -168.792_324_833_941_33),
            (21, &[0x03, 0x83, 0x09, 0x26], 68_590.983_298_744_52),
            (56, &[0x8C], 140.0),
        ] {
            let item = LocalSet::NUMBERS
                .iter()
                .find(|item| item.tag == tag)
                .expect("in the table");
            let read = item.value(bytes).expect("in range");
            assert!(
                (read - value).abs() <= item.rounding(),
                "{} {read}",
                item.name
            );
            let raw = item.raw(value).to_be_bytes();
            assert_eq!(&raw[8 - bytes.len()..], bytes, "{}", item.name);
        }
    }
}
