//! What happened to each datagram, in words, for a log that is detailed enough (`RUST_LOG=debug`).
//!
//! Composed only where [`Bridge::set_trace`](super::Bridge::set_trace) asks for it, and apart from the machines: each drop
//! of theirs is counted under a name, so what was counted between two looks is what became of a datagram. Messages are
//! named and never shown whole, so that no key can get into a log.

use std::fmt::Write as _;
use std::net::SocketAddr;

use mavlink::Message as _;
use mavlink_link::dialect::MavMessage;
use mavlink_link::frame::{FrameView, KEY_EXCHANGE_ID, Parser};
use mavlink_link::link::LinkStats;
use stanag_msgs::wrapper::{Frame, WrapperError};
use stanag_msgs::{Message, Profile, ed25, table};

use super::counters::Counters;
use super::link::frame::{OutFrame, Peer};

/// The counters of the DLI side before a datagram was handled.
#[derive(Debug)]
pub(crate) struct DliTrace(Counters);

impl DliTrace {
    pub(crate) fn begin(counters: &Counters) -> DliTrace {
        DliTrace(counters.clone())
    }

    /// What became of the datagram.
    pub(crate) fn end(
        self,
        after: &Counters,
        profile: &Profile,
        from: SocketAddr,
        bytes: &[u8],
    ) -> String {
        let mut text = format!("DLI received from {from}, {} bytes:", bytes.len());
        let mut separator = " ";
        for message in messages(profile, bytes) {
            let _ = write!(text, "{separator}{message}");
            separator = ", ";
        }
        let counted = after
            .iter()
            .filter(|&(name, count)| count > self.0.get(name));
        let counted: Vec<_> = counted.map(|(name, _)| name).collect();
        text += "; ";
        if counted.is_empty() {
            return text + "taken";
        }
        text + &counted.join(", ")
    }
}

/// The counters of a vehicle's link before a datagram was handled.
#[derive(Debug)]
pub(crate) struct LinkTrace(LinkStats);

impl LinkTrace {
    pub(crate) fn begin(stats: LinkStats) -> LinkTrace {
        LinkTrace(stats)
    }

    /// How many datagrams had been read.
    pub(crate) fn datagrams(&self) -> u64 {
        self.0.datagrams
    }

    /// What became of the datagram.
    pub(crate) fn end(self, after: LinkStats, from: Peer, bytes: &[u8]) -> String {
        let mut text = format!("MAVLink received from {from}, {} bytes:", bytes.len());
        let mut parser = Parser::new();
        let mut frames = parser.feed(bytes);
        let mut separator = " ";
        while let Some(frame) = frames.next() {
            // What cannot be parsed is among the counters.
            let Ok(frame) = frame else { continue };
            let header = frame.header();
            let (system, component) = (header.system_id, header.component_id);
            let _ = write!(
                text,
                "{separator}{} of {system}/{component}",
                mavlink_name(&frame)
            );
            separator = ", ";
        }
        let mut taken = 0;
        let mut dropped = String::new();
        for ((name, before), (_, after)) in self.0.iter().zip(after.iter()) {
            let count = after - before;
            match name {
                _ if count == 0 => {}
                "delivered_verified" | "delivered_unverified" | "key_exchange" | "clock_pings" => {
                    taken += count;
                }
                name if PASSED.contains(&name) => {}
                name => {
                    let _ = write!(dropped, " {} {count}", name.replace('_', " "));
                }
            }
        }
        if taken > 0 {
            let _ = write!(text, "; taken {taken}");
        }
        if !dropped.is_empty() {
            let _ = write!(text, "; dropped:{dropped}");
        }
        text
    }
}

/// Counters that are no outcome of a received frame.
const PASSED: &[&str] = &[
    "datagrams",
    "bytes",
    "good_frames",
    "late",
    "undecoded_id",
    "undecoded_value",
    "clock_answers",
    "clock_challenges",
    "receipt_pings",
    "clock_met",
    "copied",
    "sent",
    "sent_bytes",
    "sent_heartbeats",
];

/// A datagram for a station.
pub(crate) fn dli_sent(profile: &Profile, to: SocketAddr, bytes: &[u8]) -> String {
    let mut text = format!("DLI sent to {to}, {} bytes:", bytes.len());
    for message in messages(profile, bytes) {
        let _ = write!(text, " {message}");
    }
    text
}

/// The messages of a datagram of any edition.
fn messages(profile: &Profile, bytes: &[u8]) -> Vec<String> {
    if !ed25::is_ed25(bytes) {
        return profile
            .frames(bytes)
            .map(|frame| received(profile, frame))
            .collect();
    }
    let name = |frame: Result<ed25::Frame<'_>, WrapperError>| match frame {
        Ok(frame) => {
            let ed25::Header {
                message_type,
                version,
                instance,
            } = frame.header;
            let info = ed25::message(message_type, version);
            let name = info.map_or("unknown message", |info| info.name);
            format!("#{message_type} {name}, instance {instance}")
        }
        Err(fault) => fault.to_string(),
    };
    ed25::frames(bytes).map(name).collect()
}

/// A frame for a vehicle.
pub(crate) fn mavlink_sent(frame: &OutFrame) -> String {
    sent(frame.to, frame.bytes())
}

/// The bytes of a frame that goes to a peer.
pub(crate) fn sent(to: Peer, bytes: &[u8]) -> String {
    let name = FrameView::parse(bytes).map_or_else(
        |_| "no frame".to_owned(),
        |view| {
            let signed = if view.is_signed() {
                "signed"
            } else {
                "unsigned"
            };
            format!("{}, {signed}", mavlink_name(&view))
        },
    );
    format!("MAVLink sent to {to}, {} bytes: {name}", bytes.len())
}

fn received(profile: &Profile, frame: Result<Frame<'_>, WrapperError>) -> String {
    let frame = match frame {
        Ok(frame) => frame,
        Err(fault) => return fault.to_string(),
    };
    let header = frame.header;
    let mut text = dli_name(header.message_type);
    match profile.decode(header.message_type, frame.data) {
        Ok(Message::MessageAcknowledgement(answer)) => {
            let kind = answer.acknowledgement_type;
            let kind = kind.map_or_else(|| "no type".to_owned(), |kind| format!("{kind:?}"));
            let of = answer.original_message_type.map(dli_name);
            let _ = write!(text, " ({kind}, of {})", of.unwrap_or_default());
        }
        Ok(_) => {}
        Err(fault) => {
            let _ = write!(text, " (not decoded: {fault})");
        }
    }
    let _ = write!(text, " of {} to {}", header.source, header.destination);
    if header.ack_requested {
        text += ", acknowledgement requested";
    }
    text
}

fn dli_name(message_type: u16) -> String {
    let name = table::message(message_type).map_or("unknown message", |info| info.name);
    format!("{message_type} {name}")
}

fn mavlink_name(frame: &FrameView<'_>) -> String {
    let id = frame.header().message_id;
    match frame.message() {
        Ok(MavMessage::COMMAND_LONG(command)) => format!("COMMAND_LONG {:?}", command.command),
        Ok(MavMessage::COMMAND_INT(command)) => format!("COMMAND_INT {:?}", command.command),
        Ok(MavMessage::COMMAND_ACK(ack)) => {
            format!("COMMAND_ACK {:?} {:?}", ack.command, ack.result)
        }
        Ok(message) => message.message_name().to_owned(),
        Err(_) if id == KEY_EXCHANGE_ID => "KEY_EXCHANGE".to_owned(),
        Err(_) => format!("message {id}"),
    }
}
