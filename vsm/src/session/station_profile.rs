//! How one ground station is spoken to: edition, checksum, readings of disputed values, and where answers go.
//!
//! Each `[[cucs]]` has one ([`StationProfile::of`]), so that stations of several makes are served at once; the machines
//! know nothing of it. What the configuration leaves to `auto` is as the station speaks: it follows the latest message that
//! was taken of it, from where it is, so that nobody changes it who only writes its id into a datagram.
//!
//! **Full presence vectors.** A station that has not said that it supports partial ones, and has sent none, is sent every
//! field; one that is not known is zero there. What a zero would put on a map or show as a state is not sent before it is
//! known, and a route is never filled: it might come back, and be flown.

use serde::{Deserialize, Serialize};
use stanag_msgs::enums::PresenceVectorSupport;
use stanag_msgs::table;
use stanag_msgs::wrapper::Header;
use stanag_msgs::{ChecksumStyle, EncodeError, Envelope, Id, Message, Profile};

use crate::config::{Checksum, Cucs, Delivery, Dli, Edition, Presence, Provisional};

/// How a station is spoken to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StationProfile {
    /// `None`: as it speaks.
    edition: Option<Edition>,
    /// `None`: as it sums.
    checksum: Option<ChecksumStyle>,
    /// The version and the checksum of the latest message that was taken of it.
    spoken: Option<(u8, ChecksumStyle)>,
    /// `None`: as far as it supports them.
    presence: Option<Presence>,
    vectors: Vectors,
    /// How it reads what the sources leave open.
    pub(crate) readings: Profile,
    pub(crate) delivery: Delivery,
    /// It reads several messages of one datagram.
    packs: bool,
    /// Which messages with a derived layout are used with it.
    pub(crate) provisional: Provisional,
}

/// What a station has shown of the presence vectors that it supports.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Vectors {
    #[default]
    Nothing,
    /// It has sent a partial one.
    Sent,
    /// It has said whether it supports partial ones.
    Said(bool),
}

impl StationProfile {
    /// What the configuration says of a station.
    pub(crate) fn of(cucs: &Cucs, dli: &Dli) -> StationProfile {
        if cucs.web {
            // Its messages are written as JSON from what is encoded here: as the tables have them, with what is known alone.
            return StationProfile {
                edition: Some(Edition::Ed4),
                checksum: Some(ChecksumStyle::None),
                spoken: None,
                presence: Some(Presence::Partial),
                vectors: Vectors::Nothing,
                readings: Profile::default(),
                delivery: Delivery::Unicast,
                packs: false,
                provisional: cucs.provisional.unwrap_or(dli.provisional),
            };
        }
        StationProfile {
            edition: cucs.edition,
            checksum: cucs.checksum.map(|Checksum(style)| style),
            spoken: None,
            presence: cucs.presence,
            vectors: Vectors::Nothing,
            readings: dli.disputed.with(&cucs.disputed).profile,
            delivery: cucs.delivery,
            packs: cucs.pack,
            provisional: cucs.provisional.unwrap_or(dli.provisional),
        }
    }

    /// The configuration says something else; what the station has shown of itself stays.
    pub(crate) fn reconfigure(&mut self, cucs: &Cucs, dli: &Dli) {
        *self = StationProfile {
            spoken: self.spoken,
            vectors: self.vectors,
            ..StationProfile::of(cucs, dli)
        };
    }

    /// The edition that it is answered in.
    pub(crate) fn edition(&self) -> Edition {
        let spoken = || self.spoken.map(|(idd, _)| Edition::of_idd(idd));
        self.edition.or_else(spoken).unwrap_or(Edition::Ed4)
    }

    /// Whether messages for it may share a datagram.
    pub(crate) fn packs(&self) -> bool {
        self.packs && self.edition() != Edition::Ed25
    }

    /// Nothing has been received of it yet that shows how it speaks.
    pub(crate) fn is_unknown(&self) -> bool {
        self.spoken.is_none()
    }

    /// It has sent a message with this header.
    pub(crate) fn note(&mut self, header: &Header) {
        self.spoken = Some((header.idd, header.checksum));
    }

    /// It has sent this message. `partial`: with fields left out.
    pub(crate) fn note_message(&mut self, message: &Message, partial: bool) {
        let said = match message {
            Message::CucsAuthorisationRequest(request) => request.presence_vector_support,
            Message::PositiveHandoverAuthorisationRequest(request) => {
                request.presence_vector_support
            }
            _ => None,
        };
        self.vectors = match (said, self.vectors) {
            (Some(PresenceVectorSupport::FullOnly), _) => Vectors::Said(false),
            (Some(PresenceVectorSupport::Partial), _) => Vectors::Said(true),
            (_, Vectors::Nothing) if partial => Vectors::Sent,
            (_, known) => known,
        };
    }

    /// The lines of its `[[cucs]]` that would fix how it speaks; none before anything was received of it. They are not needed:
    /// they keep a station that is replaced, or pretended, from being answered in another way.
    pub(crate) fn lines(&self) -> Vec<String> {
        if self.is_unknown() {
            return Vec::new();
        }
        let presence = if self.takes_full_vectors() {
            "full"
        } else {
            "partial"
        };
        let mut lines = vec![format!("edition = \"{}\"", self.edition().text())];
        if self.edition() != Edition::Ed25 {
            let checksum = Checksum(self.checksum()).text();
            lines.push(format!("checksum = \"{checksum}\""));
            lines.push(format!("presence = \"{presence}\""));
        }
        lines
    }

    /// What a restart has to know of how it speaks.
    pub(crate) fn shown(&self) -> Shown {
        Shown {
            spoken: self.spoken.map(|(idd, style)| (idd, style.code())),
            ed25: None,
            partial: !matches!(self.vectors, Vectors::Nothing | Vectors::Said(false)),
        }
    }

    /// What was known of it before a restart.
    pub(crate) fn restore(&mut self, shown: &Shown) {
        let spoken = shown.spoken;
        self.spoken = spoken.map(|(idd, style)| (idd, ChecksumStyle::from_code(style)));
        if shown.partial {
            self.vectors = Vectors::Sent;
        }
    }

    /// Whether it is sent every field of a message.
    pub(crate) fn takes_full_vectors(&self) -> bool {
        match self.presence {
            Some(presence) => presence == Presence::Full,
            None => matches!(self.vectors, Vectors::Nothing | Vectors::Said(false)),
        }
    }

    /// Whether a message can be sent to it as it is known now.
    pub(crate) fn may_be_sent(&self, message: &Message) -> bool {
        !self.takes_full_vectors() || !claims_by_zeros(message)
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
        // A decoder that knows the fields of Edition 3 alone drops a message with a bit beyond them, and the whole state with
        // it.
        let cut = (self.edition() == Edition::Ed3).then(|| table::in_edition_3(message));
        let cut = cut.flatten();
        let message = cut.as_ref().unwrap_or(message);
        // Edition 2.5 has no vectors: its border fills in by rules of its own.
        let full = self.edition() != Edition::Ed25 && self.takes_full_vectors();
        if full && !is_of_route(message) {
            return self.readings.encode_full(message, envelope, out);
        }
        self.readings.encode(message, envelope, out)
    }
}

/// What a restart has to know of how a station speaks.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Shown {
    /// IDD version and checksum code of its latest message.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) spoken: Option<(u8, u8)>,
    /// It spoke Edition 2.5 last, which it calls this.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) ed25: Option<String>,
    /// It takes partial presence vectors.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) partial: bool,
}

/// Whether zeros in place of what is absent would state a position, an altitude or a mode.
fn claims_by_zeros(message: &Message) -> bool {
    match message {
        Message::InertialStates(m) => {
            m.latitude.is_none() || m.longitude.is_none() || m.altitude.is_none()
        }
        Message::VehicleOperatingModeReport(m) => m.select_flight_path_control_mode.is_none(),
        _ => false,
    }
}

/// Whether it is a part of a plan, which a station may send back to be flown.
fn is_of_route(message: &Message) -> bool {
    matches!(message.id(), 13_001..=13_006 | 50_001 | 50_002)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use stanag_msgs::messages::{
        CucsAuthorisationRequest, InertialStates, UaPositionWaypoint, VehicleOperatingStates,
    };
    use std::path::Path;

    const VSM: Id = Id(0x1b00_0001);
    const CUCS: Id = Id(0x1b00_00a0);

    fn profile(keys: &str) -> StationProfile {
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:0\"\ndisputed = {{ turn_rate_step = \"0.005\", ack_type = \"0,1,2\" }}\n\
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
        assert_eq!(fixed.envelope(VSM, CUCS).idd, 30);
        fixed.note(&header(30, ChecksumStyle::None));
        assert_eq!(fixed.envelope(VSM, CUCS).checksum, ChecksumStyle::Sum32);
    }

    #[test]
    fn a_station_reads_what_all_read_but_for_what_it_sets() {
        let of_all = profile("");
        let own = profile("disputed = { ack_type = \"1,2,3\" }");
        let mut expected = Profile::default();
        expected.set("turn_rate_step", "0.005").expect("a reading");
        assert_eq!(own.readings, expected);
        assert_ne!(of_all.readings, own.readings);
    }

    /// A station that has asked for LOI 2 with these fields.
    fn sent(
        profile: &mut StationProfile,
        support: Option<PresenceVectorSupport>,
        partial: bool,
    ) -> bool {
        let request = CucsAuthorisationRequest {
            presence_vector_support: support,
            ..Default::default()
        };
        profile.note_message(&request.into(), partial);
        profile.takes_full_vectors()
    }

    #[test]
    fn vectors_are_full_until_the_station_supports_partial_ones() {
        let mut one = profile("");
        assert!(one.takes_full_vectors());
        assert!(sent(&mut one, None, false), "it has said nothing");
        assert!(!sent(&mut one, Some(PresenceVectorSupport::Partial), false));
        assert!(sent(&mut one, Some(PresenceVectorSupport::FullOnly), false));
        assert!(sent(&mut one, None, true), "what it says counts");
        let mut other = profile("");
        assert!(!sent(&mut other, None, true), "it has sent one");
        let mut again = profile("");
        again.restore(&other.shown());
        assert!(!again.takes_full_vectors());
        assert!(!profile("presence = \"partial\"").takes_full_vectors());
        let mut fixed = profile("presence = \"full\"");
        assert!(sent(&mut fixed, Some(PresenceVectorSupport::Partial), true));
    }

    #[test]
    fn no_position_is_made_of_zeros_and_no_route_is_filled() {
        let full = profile("presence = \"full\"");
        let nowhere = Message::from(InertialStates::default());
        assert!(!full.may_be_sent(&nowhere));
        assert!(profile("presence = \"partial\"").may_be_sent(&nowhere));
        let bytes = |message: &Message| {
            let mut out = [0; stanag_msgs::MAX_DATAGRAM];
            let envelope = full.envelope(VSM, CUCS);
            full.encode(message, &envelope, &mut out).expect("it fits")
        };
        let waypoint = Message::from(UaPositionWaypoint::default());
        assert_eq!(
            bytes(&waypoint),
            16 + usize::from(waypoint.info().presence_bytes)
        );
        let states = Message::from(VehicleOperatingStates::default());
        assert_eq!(bytes(&states), 16 + states.info().full_bytes());
    }

    /// A 3002 with every field, and one with those of a mission alone.
    #[test]
    fn edition_3_is_sent_no_field_that_it_does_not_have() {
        let mission = VehicleOperatingStates {
            thrust: Some(40),
            commanded_loiter_position_latitude: Some(stanag_msgs::Bam32::from_degrees(47.0)),
            commanded_waypoint_number: Some(7),
            ..VehicleOperatingStates::default()
        };
        for presence in ["full", "partial"] {
            for (edition, fields) in [("3", 19), ("4", 24)] {
                let keys = format!("presence = \"{presence}\"\nedition = \"{edition}\"");
                let to = profile(&keys);
                let mut out = [0; stanag_msgs::MAX_DATAGRAM];
                let envelope = to.envelope(VSM, CUCS);
                let length = to
                    .encode(&mission.clone().into(), &envelope, &mut out)
                    .expect("it fits");
                let data = &out[16..length];
                let vector = u32::from_be_bytes([0, data[0], data[1], data[2]]);
                let last = 32 - vector.leading_zeros();
                assert_eq!(last, fields, "{presence} {edition}");
                assert_eq!(vector.count_ones() == fields, presence == "full");
                let read = to.readings.decode(3002, data).expect("a message");
                let Message::VehicleOperatingStates(read) = read else {
                    panic!("{read:?}")
                };
                assert_eq!(read.thrust, Some(40));
                let number = (edition == "4").then_some(7);
                assert_eq!(read.commanded_waypoint_number, number);
            }
        }
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
