//! A VSM for a CUCS, built on the codec alone, and an exchange of the two over the simulated network.

use std::collections::BTreeMap;
use std::time::Duration;

use cucs::{Now, Session};
use kit::network::{Faults, Network};
use stanag_msgs::enums::{
    AccessGranted, AckType, AlertPriority, LoiBitmap, MissionTransferStatus, RequestedAccess,
};
use stanag_msgs::messages::{
    MessageAcknowledgement, MissionUploadDownloadStatus, SubsystemStatusAlert,
    VsmAuthorisationResponse,
};
use stanag_msgs::wrapper::frames;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};

pub(crate) const VSM: Id = Id(0x1b00_0001);
pub(crate) const VEHICLE: Id = Id(0x1b00_0101);
pub(crate) const CUCS: Id = Id(0x1b00_00a0);
pub(crate) const UNIX_MS: u64 = 1_750_000_000_000;

pub(crate) fn now(ms: u64) -> Now {
    Now {
        mono: Duration::from_millis(ms),
        unix_ms: UNIX_MS + ms,
    }
}

/// A message as the VSM would send it.
pub(crate) fn datagram(from: Id, to: Id, message: impl Into<Message>) -> Vec<u8> {
    enveloped(&Envelope::new(from, to), message)
}

pub(crate) fn enveloped(envelope: &Envelope, message: impl Into<Message>) -> Vec<u8> {
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message.into().encode(envelope, &mut bytes).unwrap();
    bytes[..length].to_vec()
}

/// Everything that a session has to send now.
pub(crate) fn drain(session: &mut Session) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| session.poll_transmit()).collect()
}

/// The messages of a datagram: (whether it requests an acknowledgement, destination, bytes, message).
pub(crate) fn messages(datagram: &[u8]) -> Vec<(bool, Id, Vec<u8>, Message)> {
    frames(datagram)
        .map(|frame| {
            let frame = frame.expect("a sound wrapper");
            let message = Message::decode(frame.header.message_type, frame.data).unwrap();
            (
                frame.header.ack_requested,
                frame.header.destination,
                frame.bytes.to_vec(),
                message,
            )
        })
        .collect()
}

/// The Time Stamp of a message of this CUCS.
pub(crate) fn stamp_of(bytes: &[u8]) -> TimeStamp {
    let header_type = u16::from_be_bytes([bytes[12], bytes[13]]);
    let info = stanag_msgs::table::message(header_type).unwrap();
    let at = 16 + usize::from(info.presence_bytes);
    assert_eq!(bytes[at - 1] & 1, 1, "{header_type} without a stamp");
    let wide = info.fields[0].wire.bytes().unwrap();
    if wide == 8 {
        let double = f64::from_be_bytes(bytes[at..at + 8].try_into().unwrap());
        return TimeStamp(double as u64);
    }
    let stamp = bytes[at..at + wide]
        .iter()
        .fold(0, |stamp, byte| stamp << 8 | u64::from(*byte));
    TimeStamp(stamp)
}

/// A VSM that grants, stores and carries out what is requested, and refuses what it is set to refuse.
#[derive(Debug, Default)]
pub(crate) struct FakeVsm {
    /// The answer to each message by its bytes.
    seen: BTreeMap<Vec<u8>, Vec<Vec<u8>>>,
    /// The bytes of every received message, in order, duplicates too.
    pub(crate) received: Vec<Vec<u8>>,
    /// Each message once, in order of arrival.
    pub(crate) carried_out: Vec<Message>,
    /// The levels that this CUCS may have.
    pub(crate) authorised: LoiBitmap,
    /// The levels that it holds.
    pub(crate) granted: LoiBitmap,
    /// The stored 13002s.
    pub(crate) waypoints: BTreeMap<u16, Message>,
    pub(crate) routes: Vec<Message>,
    /// Actions at waypoints (13004, 13006), which a download gives back.
    pub(crate) actions: Vec<Message>,
    /// Refuses a load, with this waypoint and reason.
    pub(crate) refuse_load: Option<(u16, String)>,
    /// Refuses mode commands with this reason.
    pub(crate) refuse_mode: Option<String>,
    /// Cannot store a release: the rights stay.
    pub(crate) keeps_rights: bool,
    /// Sends no 17000 at all.
    pub(crate) mute: bool,
    /// Downloads leave these waypoints out the first time.
    pub(crate) forgets: Vec<u16>,
    /// A download is received (17000 type 1), and its 17000 type 2 and 14000 are lost the first time.
    pub(crate) loses_the_end: bool,
    /// Requests for rights are only received (17000 type 1), this many times, before they are decided.
    pub(crate) decides_after: u32,
    last_stamp: u64,
}

impl FakeVsm {
    pub(crate) fn new() -> FakeVsm {
        FakeVsm {
            authorised: LoiBitmap::from_raw(0x0d),
            last_stamp: 800_000_000_000,
            ..FakeVsm::default()
        }
    }

    fn stamp(&mut self) -> Option<TimeStamp> {
        self.last_stamp += 1;
        Some(TimeStamp(self.last_stamp))
    }

    pub(crate) fn status(&mut self, message: Message) -> Vec<u8> {
        datagram(VEHICLE, CUCS, message)
    }

    /// Handles a datagram of the CUCS; returns the answers.
    pub(crate) fn handle(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut answers = Vec::new();
        for (wants_ack, destination, bytes, message) in messages(bytes) {
            self.received.push(bytes.clone());
            if let (true, Message::CucsAuthorisationRequest(_), Some(left)) =
                (wants_ack, &message, self.decides_after.checked_sub(1))
            {
                self.decides_after = left;
                answers.push(self.acknowledge(destination, &bytes, &message, AckType::Received));
                continue;
            }
            let answer = match self.seen.get(&bytes) {
                Some(answer) => answer.clone(),
                None => {
                    self.carried_out.push(message.clone());
                    let mut answer = self.answer(&message);
                    if wants_ack && !self.mute {
                        let kinds = self.kinds(&message);
                        if matches!(message, Message::MissionTransferCommand(_)) {
                            self.loses_the_end = false;
                        }
                        let source = if destination == Id::BROADCAST {
                            VSM
                        } else {
                            destination
                        };
                        for kind in kinds {
                            answer.push(self.acknowledge(source, &bytes, &message, kind));
                        }
                    }
                    self.seen.insert(bytes, answer.clone());
                    answer
                }
            };
            answers.extend(answer);
        }
        answers
    }

    fn acknowledge(
        &mut self,
        source: Id,
        bytes: &[u8],
        message: &Message,
        kind: AckType,
    ) -> Vec<u8> {
        let answer = MessageAcknowledgement {
            time_stamp: self.stamp(),
            original_message_time_stamp: Some(stamp_of(bytes)),
            original_message_type: Some(message.id()),
            acknowledgement_type: Some(kind),
        };
        datagram(source, CUCS, answer)
    }

    fn kinds(&self, message: &Message) -> Vec<AckType> {
        match message {
            Message::MissionTransferCommand(_) if self.loses_the_end => vec![AckType::Received],
            Message::VehicleOperatingModeCommand(_) if self.refuse_mode.is_some() => {
                vec![AckType::Received, AckType::Refused]
            }
            Message::MissionTransferCommand(_) if self.refuse_load.is_some() => {
                vec![AckType::Received, AckType::Refused]
            }
            Message::VehicleOperatingModeCommand(_) | Message::MissionTransferCommand(_) => {
                vec![AckType::Received, AckType::CarriedOut]
            }
            _ => vec![AckType::CarriedOut],
        }
    }

    fn answer(&mut self, message: &Message) -> Vec<Vec<u8>> {
        use stanag_msgs::enums::MissionPlanMode as Mode;
        match message {
            Message::CucsAuthorisationRequest(request) => {
                let requested = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
                match request.requested_handover_access {
                    Some(RequestedAccess::Relinquish)
                        if request.vsm_id != Some(Id::BROADCAST) && !self.keeps_rights =>
                    {
                        self.granted = LoiBitmap::NONE;
                    }
                    Some(RequestedAccess::Request) => {
                        self.granted = self.granted | (requested & self.authorised);
                    }
                    _ => {}
                }
                let response = VsmAuthorisationResponse {
                    time_stamp: self.stamp(),
                    vsm_id: Some(VSM),
                    access_granted: Some(AccessGranted::NotInControl),
                    loi_authorized: Some(self.authorised),
                    loi_granted: Some(self.granted),
                    vehicle_type: Some(2),
                    ..VsmAuthorisationResponse::default()
                };
                vec![datagram(VEHICLE, CUCS, response)]
            }
            Message::UaRoute(_) => {
                self.routes.push(message.clone());
                Vec::new()
            }
            Message::UaPositionWaypoint(point) => {
                self.waypoints
                    .insert(point.waypoint_number.unwrap(), message.clone());
                Vec::new()
            }
            Message::VehicleOperatingModeCommand(_) => match self.refuse_mode.clone() {
                Some(why) => self.alert(&format!("2016 refused: {why}")),
                None => Vec::new(),
            },
            Message::MissionTransferCommand(command) => {
                let mode = command.mission_plan_mode.unwrap();
                let mut out = match mode {
                    Mode::Download => {
                        let mut all = self.routes.clone();
                        let forgets = std::mem::take(&mut self.forgets);
                        all.extend(
                            self.waypoints
                                .iter()
                                .filter(|(number, _)| !forgets.contains(number))
                                .map(|(_, message)| message.clone()),
                        );
                        all.extend(self.actions.iter().cloned());
                        all.into_iter()
                            .map(|message| datagram(VEHICLE, CUCS, message))
                            .collect()
                    }
                    Mode::DownloadWaypoint => {
                        let requested = self.waypoints.get(&command.waypoint_number.unwrap());
                        let requested = requested.cloned().into_iter();
                        requested
                            .map(|message| datagram(VEHICLE, CUCS, message))
                            .collect()
                    }
                    _ => Vec::new(),
                };
                let refusal = self.refuse_load.clone();
                let report = MissionUploadDownloadStatus {
                    time_stamp: self.stamp(),
                    status: Some(match refusal {
                        None => MissionTransferStatus::Complete,
                        Some(_) => MissionTransferStatus::Aborted,
                    }),
                    waypoint_request: refusal.as_ref().map(|(number, _)| *number),
                    mission_plan_mode: Some(mode),
                    ..MissionUploadDownloadStatus::default()
                };
                if !self.loses_the_end {
                    out.push(datagram(VEHICLE, CUCS, report));
                }
                if let Some((_, why)) = refusal {
                    out.extend(self.alert(&format!("13000 refused: {why}")));
                }
                out
            }
            _ => Vec::new(),
        }
    }

    /// A 16000, in parts of at most 30 characters.
    pub(crate) fn alert(&mut self, text: &str) -> Vec<Vec<u8>> {
        let parts: Vec<&[u8]> = text.as_bytes().chunks(30).collect();
        let total = parts.len() as u8;
        let mut out = Vec::new();
        for (part, order) in parts.into_iter().zip(1..) {
            let alert = SubsystemStatusAlert {
                time_stamp: self.stamp(),
                priority: Some(AlertPriority::Caution),
                alert_warning_id: Some(-5),
                text: Some(std::str::from_utf8(part).unwrap().into()),
                append_order: (total > 1).then_some(order),
                append_total_number: (total > 1).then_some(total),
                ..SubsystemStatusAlert::default()
            };
            out.push(datagram(VEHICLE, CUCS, alert));
        }
        out
    }
}

/// The two ends of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum End {
    Cucs,
    Vsm,
}

/// A network that loses a quarter of the datagrams, delivers a fifth of them twice, and lets them overtake each other.
pub(crate) fn bad_network(seed: u64) -> Network<End, Vec<u8>> {
    let faults = Faults {
        loss: 0.25,
        duplicate: 0.2,
        overtaking: true,
        ..Faults::NONE.delayed_ms(0, 300)
    };
    Network::new(seed, faults)
}

/// Lets session and VSM exchange datagrams until `done`, in steps of 5 ms; returns the time at the end.
pub(crate) fn converse(
    session: &mut Session,
    vsm: &mut FakeVsm,
    network: &mut Network<End, Vec<u8>>,
    until_ms: u64,
    mut done: impl FnMut(&Session) -> bool,
) -> u64 {
    let mut ms = 0;
    while ms < until_ms && !done(session) {
        let time = now(ms).mono;
        session.handle_timeout(now(ms));
        for datagram in drain(session) {
            assert!(datagram.len() <= MAX_DATAGRAM);
            network.send(time, End::Cucs, End::Vsm, datagram);
        }
        while let Some(packet) = network.receive(time) {
            if packet.to == End::Cucs {
                session.handle_datagram(now(ms), &packet.payload);
                continue;
            }
            for answer in vsm.handle(&packet.payload) {
                network.send(time, End::Vsm, End::Cucs, answer);
            }
        }
        ms += 5;
    }
    ms
}
