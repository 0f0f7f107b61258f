//! How one ground station is spoken to: edition, checksum, readings of disputed values, and where answers go.
//!
//! Each `[[cucs]]` has one ([`StationProfile::of`]), so that stations of several makes are served at once; the machines
//! know nothing of it. What the configuration leaves to `auto` is as the station speaks: it follows the latest message that
//! was taken of it, from where it is, so that nobody changes it who only writes its id into a datagram.

use stanag_msgs::wrapper::Header;
use stanag_msgs::{ChecksumStyle, EncodeError, Envelope, Id, Message, Profile};

use crate::config::{Checksum, Cucs, Delivery, Dli, Edition, Provisional};

/// How a station is spoken to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StationProfile {
    /// `None`: as it speaks.
    edition: Option<Edition>,
    /// `None`: as it sums.
    checksum: Option<ChecksumStyle>,
    /// The version and the checksum of the latest message that was taken of it.
    spoken: Option<(u8, ChecksumStyle)>,
    /// How it reads what the sources leave open.
    pub(crate) readings: Profile,
    pub(crate) delivery: Delivery,
    /// Which messages with a derived layout are used with it.
    pub(crate) provisional: Provisional,
}

impl StationProfile {
    /// What the configuration says of a station.
    pub(crate) fn of(cucs: &Cucs, dli: &Dli) -> StationProfile {
        StationProfile {
            edition: cucs.edition,
            checksum: cucs.checksum.map(|Checksum(style)| style),
            spoken: None,
            readings: dli.disputed.with(&cucs.disputed).profile,
            delivery: cucs.delivery,
            provisional: cucs.provisional.unwrap_or(dli.provisional),
        }
    }

    /// The configuration says something else; what the station has shown of itself stays.
    pub(crate) fn reconfigure(&mut self, cucs: &Cucs, dli: &Dli) {
        *self = StationProfile {
            spoken: self.spoken,
            ..StationProfile::of(cucs, dli)
        };
    }

    /// Whether it may send in this edition: in any, unless the configuration names one.
    pub(crate) fn may_speak(&self, edition: Edition) -> bool {
        self.edition.is_none_or(|configured| configured == edition)
    }

    /// The edition that it is answered in.
    pub(crate) fn edition(&self) -> Edition {
        let spoken = || self.spoken.map(|(idd, _)| Edition::of_idd(idd));
        self.edition.or_else(spoken).unwrap_or(Edition::Ed4)
    }

    /// Nothing has been received of it yet that shows how it speaks.
    pub(crate) fn is_unknown(&self) -> bool {
        self.spoken.is_none()
    }

    /// It has sent a message with this header.
    pub(crate) fn note(&mut self, header: &Header) {
        self.spoken = Some((header.idd, header.checksum));
    }

    /// The version that it is answered in: its own, where that is of the edition.
    fn idd(&self) -> u8 {
        let edition = self.edition();
        let own = self.spoken.map(|(idd, _)| idd);
        let own = own.filter(|idd| Edition::of_idd(*idd) == edition);
        own.unwrap_or(match edition {
            Edition::Ed3 => Header::IDD_ED3,
            Edition::Ed25 | Edition::Ed4 => Header::IDD_ED4,
        })
    }

    /// The checksum that it is answered with.
    pub(crate) fn checksum(&self) -> ChecksumStyle {
        let own = self.spoken.map(|(_, style)| style);
        let style = self.checksum.or(own).unwrap_or_default();
        match (self.edition(), style) {
            // Edition 3 knows sums alone (3.2.6 of its wrapper).
            (Edition::Ed3, ChecksumStyle::Crc32) => ChecksumStyle::Sum32,
            (_, style) => style,
        }
    }

    /// What goes around a message for it.
    pub(crate) fn envelope(&self, source: Id, destination: Id) -> Envelope {
        let idd = self.idd();
        Envelope {
            idd,
            ..Envelope::new(source, destination).summed(self.checksum())
        }
    }

    /// Writes a message for it; returns how many bytes.
    ///
    /// # Errors
    /// The message does not fit a datagram.
    pub(crate) fn encode(
        &self,
        message: &Message,
        envelope: &Envelope,
        out: &mut [u8],
    ) -> Result<usize, EncodeError> {
        self.readings.encode(message, envelope, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use std::path::Path;

    const VSM: Id = Id(0x1b00_0001);
    const CUCS: Id = Id(0x1b00_00a0);

    fn profile(keys: &str) -> StationProfile {
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:0\"\ndisputed = {{ loi_bits = \"m\", ack_type = \"0,1,2\" }}\n\
             [[cucs]]\nid = \"{CUCS}\"\nloi = [2]\n{keys}\n[store]\ndir = \"s\"\n"
        );
        let config = Config::parse(&text, Path::new("")).expect("a configuration");
        let cucs = config.stations().next().expect("a station");
        StationProfile::of(cucs, &config.dli)
    }

    fn header(idd: u8, checksum: ChecksumStyle) -> Header {
        let envelope = Envelope {
            idd,
            ..Envelope::new(CUCS, VSM).summed(checksum)
        };
        envelope.header(1)
    }

    #[test]
    fn a_station_is_answered_as_it_speaks() {
        let mut auto = profile("");
        assert!(auto.is_unknown());
        assert_eq!(auto.envelope(VSM, CUCS), Envelope::new(VSM, CUCS));
        auto.note(&header(30, ChecksumStyle::Sum16));
        assert_eq!(auto.edition(), Edition::Ed3);
        let of_3 = auto.envelope(VSM, CUCS);
        assert_eq!((of_3.idd, of_3.checksum), (30, ChecksumStyle::Sum16));
        auto.note(&header(31, ChecksumStyle::Crc32));
        let of_4 = auto.envelope(VSM, CUCS);
        assert_eq!((of_4.idd, of_4.checksum), (31, ChecksumStyle::Crc32));
    }

    #[test]
    fn what_the_configuration_names_is_kept() {
        let mut fixed = profile("edition = \"3\"\nchecksum = \"sum32\"");
        assert!(fixed.may_speak(Edition::Ed3) && !fixed.may_speak(Edition::Ed4));
        assert_eq!(fixed.envelope(VSM, CUCS).idd, 30);
        fixed.note(&header(30, ChecksumStyle::None));
        assert_eq!(fixed.envelope(VSM, CUCS).checksum, ChecksumStyle::Sum32);
    }

    #[test]
    fn a_station_reads_what_all_read_but_for_what_it_sets() {
        let of_all = profile("");
        let own = profile("disputed = { ack_type = \"1,2,3\" }");
        let mut expected = Profile::default();
        expected.set("loi_bits", "m").expect("a reading");
        assert_eq!(own.readings, expected);
        assert_ne!(of_all.readings, own.readings);
    }

    #[test]
    fn a_reload_keeps_what_the_station_has_shown() {
        let mut auto = profile("");
        auto.note(&header(30, ChecksumStyle::Sum16));
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:0\"\n[[cucs]]\nid = \"{CUCS}\"\nloi = [2]\n\
             provisional = \"off\"\n[store]\ndir = \"s\"\n"
        );
        let config = Config::parse(&text, Path::new("")).expect("a configuration");
        auto.reconfigure(config.stations().next().expect("one"), &config.dli);
        assert_eq!(auto.edition(), Edition::Ed3);
        assert_eq!(auto.provisional, Provisional::Off);
        assert_eq!(auto.readings, Profile::default());
    }
}
