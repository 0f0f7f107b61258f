//! One ground station beside the bridge (`[[forward]]`), such as QGroundControl: verified frames of vehicles go to it, and what it
//! commands goes to them as far as the configuration allows.
//!
//! Promised:
//!
//! - Only frames pass to it that the bridge believes itself. They keep their sender and sequence; the signature of the
//!   vehicle's key is taken off, and the one of this ground station's own key put on, where it has one.
//! - From it only frames pass that verify under its own key with a stamp never accepted before ([`Link`]), over restarts
//!   too (or, with `unsigned`, that a program of a permitted user of this computer has sent, which the shell looks up), that are on the list ([`RelayPolicy`]), and that name a vehicle of its own. They keep their sender too, so that the
//!   vehicle answers it, and are signed with the vehicle's key.
//! - While a CUCS holds LOI 4 or 5, or the VSM flies for a lost one, it can only ask, unless `while_controlled` is set. A
//!   command that is refused is answered with COMMAND_ACK, result DENIED.
//! - What it asks has a rate for each vehicle, so that the answers leave room for what a CUCS commands. A command beyond it is answered
//!   with result TEMPORARILY_REJECTED.
//! - Nobody but who proves to have the key learns or moves where it is. What it is sent waits in a bounded queue.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::Message as _;
use mavlink_link::Now;
use mavlink_link::dialect::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, SETUP_SIGNING_ID, encode,
    encode_raw,
};
use mavlink_link::link::{Auth, Event, Link};
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::signing::{KeyId, sign};
use mavlink_link::store::Disk;
use serde::Serialize;
use stanag_msgs::Id;

use super::allowance::Allowance;
use super::counters::Counters;
use super::limits::{FORWARDED_QUESTIONS, PARAMETER_LISTS};
use super::link::frame::{OutFrame, Peer};
use super::link::{link_state_name, needed_every_us};
use crate::config;
use crate::relay_policy::{Denied, FILE_TRANSFER, Px4Now, RelayPolicy, reads_files};

/// One ground station.
#[derive(Debug)]
pub(crate) struct Forward {
    /// Its place, by which the shell knows it.
    pub(crate) number: usize,
    pub(crate) config: config::Forward,
    link: Link<Peer>,
    key: Option<KeyState>,
    policy: Option<RelayPolicy>,
    /// By the system id of a vehicle.
    asked: BTreeMap<u8, Asked>,
    out: VecDeque<OutFrame>,
    counters: Counters,
    sent: u64,
    taken: u64,
}

/// Rate limits of what one vehicle is asked.
#[derive(Debug, Default)]
struct Asked {
    /// PARAM_REQUEST_LIST.
    lists: Allowance,
    others: Allowance,
}

/// A verified frame of the ground station, and whom it is for: a system, or all.
#[derive(Debug)]
pub(crate) struct Request {
    frame: Vec<u8>,
    target: Option<u8>,
}

/// How the vehicle of a request stands.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Situation {
    /// What the lists are applied to.
    pub(crate) px4: Px4Now,
    /// Its link has little room: the bridge alone says what is sent how often.
    pub(crate) limited: bool,
    /// A CUCS holds LOI 4 or 5, or the VSM flies for one that was lost.
    pub(crate) controlled: bool,
}

/// One ground station beside the bridge, for the status.
#[derive(Debug, Clone, Serialize)]
pub struct ForwardStatus {
    /// Its name.
    pub name: String,
    /// As configured.
    pub link: String,
    /// Where it is.
    pub peer: Option<String>,
    /// How its link stands, as that of a vehicle.
    pub state: &'static str,
    /// The id of its key.
    pub key_id: Option<String>,
    /// Whether it may command.
    pub commands: bool,
    /// Frames passed on to it.
    pub sent: u64,
    /// Frames of it that were passed on to a vehicle.
    pub taken: u64,
    /// What was not passed on, by the reason, in both directions.
    pub refused: Counters,
}

impl Forward {
    pub(crate) fn new(
        number: usize,
        config: config::Forward,
        link: Link<Peer>,
        key: Option<KeyState>,
    ) -> Forward {
        Forward {
            number,
            policy: config.policy(),
            config,
            link,
            key,
            asked: BTreeMap::new(),
            out: VecDeque::new(),
            counters: Counters::default(),
            sent: 0,
            taken: 0,
        }
    }

    /// Continues with another configuration, of which key, link and ids are the same.
    pub(crate) fn reconfigure(&mut self, config: config::Forward) {
        self.policy = config.policy();
        self.config = config;
    }

    /// Which key it has.
    pub(crate) fn key_id(&self) -> Option<KeyId> {
        self.key.as_ref().map(KeyState::id)
    }

    /// Where the ground station is, once it was received.
    pub(crate) fn peer(&self) -> Option<Peer> {
        self.link.peer()
    }

    /// Whether it is for this vehicle.
    pub(crate) fn covers(&self, vehicle: Id) -> bool {
        self.config.vehicles.is_empty() || self.config.vehicles.contains(&vehicle)
    }

    /// The system id under which it commands; `None` where it may not.
    pub(crate) fn commander(&self) -> Option<u8> {
        self.policy.as_ref().map(|_| self.config.system_id)
    }

    /// Passes a frame of a vehicle on.
    pub(crate) fn pass(&mut self, now: Now, frame: &FrameView<'_>, disk: &mut dyn Disk) {
        let header = frame.header();
        if [SETUP_SIGNING_ID, KEY_EXCHANGE_ID].contains(&header.message_id) || !self.is_there(now) {
            return;
        }
        let mut bytes = [0; MAX_FRAME];
        let header = self.header(header);
        match encode_raw(header, frame.payload(), &mut bytes) {
            Ok(length) => self.push(now, bytes, length, disk),
            Err(_) => self.counters.count("message without a known checksum"),
        }
    }

    /// Whether somebody is there to be sent something. Who waits to be called is, until it has been silent for a while.
    fn is_there(&self, now: Now) -> bool {
        let calls = self.config.link.waits_at().is_some();
        let accepted = self.link.accepted_at();
        !calls || accepted.is_some_and(|at| now.mono.saturating_sub(at) < CLIENT_LEASE)
    }

    fn header(&self, header: Header) -> Header {
        let incompat = if self.key.is_some() {
            INCOMPAT_SIGNED
        } else {
            0
        };
        Header { incompat, ..header }
    }

    /// Signs a frame, where this ground station has a key, and queues it.
    fn push(&mut self, now: Now, mut bytes: [u8; MAX_FRAME], length: usize, disk: &mut dyn Disk) {
        let Some(to) = self.link.peer() else {
            return;
        };
        if self.out.len() >= MAX_WAITING {
            return self.counters.count("too much at once");
        }
        let mut length = length;
        if let Some(key) = &mut self.key {
            let stamp = key.take_stamp(now, disk).ok();
            let link_id = self.config.link_id;
            let signed = stamp.map(|stamp| sign(key.key(), link_id, stamp, &mut bytes, length));
            let Some(Ok(signed)) = signed else {
                return self.counters.count("signing clock not stored");
            };
            length = signed;
        }
        self.sent += 1;
        self.out.push_back(OutFrame::new(to, length, bytes));
    }

    /// Takes what arrived; returns what is for vehicles.
    pub(crate) fn receive(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        disk: &mut dyn Disk,
    ) -> Vec<Request> {
        let mut requests = Vec::new();
        let (mut unlisted, commands) = (0, self.policy.is_some());
        let unsigned = self.config.unsigned;
        let auth = auth(self.key.as_mut(), disk);
        self.link
            .handle_datagram(now, from, bytes, auth, &mut |delivery| {
                match delivery.header.message_id {
                    // It shows that the ground station is there, and concerns no vehicle: these have the heartbeats of the VSM.
                    HEARTBEAT => {}
                    _ if (delivery.verified || unsigned) && commands => requests.push(Request {
                        frame: delivery.frame.as_bytes().to_vec(),
                        target: delivery
                            .message
                            .ok()
                            .and_then(|message| message.target_system_id()),
                    }),
                    _ => unlisted += 1,
                }
            });
        self.counters
            .add("this ground station may not command", unlisted);
        self.flush(now, disk);
        requests
    }

    /// Whether a request is for this MAVLink system.
    pub(crate) fn is_for(request: &Request, system: u8) -> bool {
        request
            .target
            .is_none_or(|target| target == 0 || target == system)
    }

    /// The frame of a request, where it may be passed on to a vehicle of this system id. What is refused is counted, and
    /// a command answered.
    pub(crate) fn judge<'r>(
        &mut self,
        now: Now,
        request: &'r Request,
        (system, situation): (u8, Situation),
        disk: &mut dyn Disk,
    ) -> Option<FrameView<'r>> {
        let frame = FrameView::parse(&request.frame).ok()?;
        let writes = self.config.unsigned
            && frame.header().message_id == FILE_TRANSFER
            && !reads_files(frame.payload());
        let (asks, mut result) = (only_asks(&frame), MavResult::MAV_RESULT_DENIED);
        let why = match self.policy.as_ref()?.check(&frame, situation.px4) {
            Ok(()) if writes => "file transfer that writes",
            Ok(()) if situation.limited && sets_rates(&frame) => {
                "rates are the bridge's (rate_bps)"
            }
            Ok(()) if situation.controlled && !self.config.while_controlled && !asks => {
                "a CUCS controls the vehicle"
            }
            Ok(()) if asks && !self.may_ask(now, system, &frame) => {
                result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
                "too many questions at once"
            }
            Ok(()) => {
                self.taken += 1;
                return Some(frame);
            }
            Err(Denied::Message(_)) => "message not allowed",
            Err(Denied::Command(_)) => "command not allowed",
            Err(denied) => denied.name(),
        };
        self.counters.count(why);
        let command = match frame.message() {
            Ok(MavMessage::COMMAND_LONG(of)) => of.command,
            Ok(MavMessage::COMMAND_INT(of)) => of.command,
            _ => return None,
        };
        self.deny(now, frame.header(), (command, result), system, disk);
        None
    }

    /// Whether the rate of what a vehicle is asked has room for another question.
    fn may_ask(&mut self, now: Now, system: u8, frame: &FrameView<'_>) -> bool {
        let asked = self.asked.entry(system).or_default();
        match frame.header().message_id {
            PARAM_REQUEST_LIST => asked.lists.take(now.mono, PARAMETER_LISTS),
            _ => asked.others.take(now.mono, FORWARDED_QUESTIONS),
        }
    }

    /// The signing link id of what is passed on to a vehicle, where it is another than the bridge's own.
    pub(crate) fn vehicle_link_id(&self) -> Option<u8> {
        self.config.unsigned.then_some(self.config.link_id)
    }

    /// What its link has not let in.
    pub(crate) fn count(&mut self, why: &'static str) {
        self.counters.count(why);
    }

    /// Nothing is there that it could go to.
    pub(crate) fn count_lost(&mut self) {
        self.counters
            .count("no vehicle of this system id, or no link to it");
    }

    /// COMMAND_ACK in the vehicle's place: who commands must not wait for an answer that never comes.
    fn deny(
        &mut self,
        now: Now,
        of: Header,
        (command, result): (MavCmd, MavResult),
        system: u8,
        disk: &mut dyn Disk,
    ) {
        let answer = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            target_system: of.system_id,
            target_component: of.component_id,
            ..COMMAND_ACK_DATA::default()
        });
        let header = self.header(Header {
            system_id: system,
            component_id: AUTOPILOT,
            seq: of.seq,
            ..Header::default()
        });
        let mut bytes = [0; MAX_FRAME];
        let length = encode(&answer, header, &mut bytes);
        self.push(now, bytes, length, disk);
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, now: Now, disk: &mut dyn Disk) {
        self.link.handle_timeout(now);
        self.flush(now, disk);
    }

    pub(crate) fn poll_timeout(&self) -> Duration {
        self.link.poll_timeout()
    }

    /// Sends what the link itself has to send: heartbeats, and answers about clocks.
    fn flush(&mut self, now: Now, disk: &mut dyn Disk) {
        let mut bytes = [0; MAX_FRAME];
        while let Some(sent) =
            self.link
                .poll_transmit(now, auth(self.key.as_mut(), disk), &mut bytes)
        {
            if self.out.len() < MAX_WAITING {
                self.out.push_back(OutFrame::new(sent.to, sent.len, bytes));
            } else {
                self.counters.count("too much at once");
            }
        }
    }

    /// Where it is now, where that has changed.
    pub(crate) fn poll_moved(&mut self) -> Option<Peer> {
        let mut moved = None;
        while let Some(event) = self.link.poll_event() {
            if let Event::PeerChanged { to, .. } = event {
                moved = Some(to);
            }
        }
        moved
    }

    pub(crate) fn poll_transmit(&mut self) -> Option<OutFrame> {
        self.out.pop_front()
    }

    pub(crate) fn has_frame(&self) -> bool {
        !self.out.is_empty()
    }

    pub(crate) fn status(&self, mono: Duration) -> ForwardStatus {
        let mut refused = self.counters.clone();
        let stats = self.link.stats();
        for (name, count) in [
            ("not signed", stats.unsigned_vehicle),
            ("signature does not fit the key", stats.bad_signature),
            ("stale timestamp", stats.stale),
            ("stamp over an hour ahead", stats.future),
            ("another system id", stats.unexpected_system),
        ] {
            refused.add(name, count);
        }
        ForwardStatus {
            name: self.config.name.clone(),
            link: self.config.link.to_string(),
            peer: self.link.peer().map(|peer| peer.to_string()),
            state: link_state_name(&self.link, mono),
            key_id: self.key_id().map(|id| id.to_string()),
            commands: self.policy.is_some(),
            sent: self.sent,
            taken: self.taken,
            refused,
        }
    }
}

fn auth<'a>(key: Option<&'a mut KeyState>, store: &'a mut dyn Disk) -> Auth<'a> {
    match key {
        Some(key) => Auth::Signed { key, store },
        None => Auth::Off,
    }
}

/// The command of a COMMAND_LONG or COMMAND_INT; zeros at the end of a payload are cut off on the wire.
fn command_of(frame: &FrameView<'_>) -> Option<u16> {
    let payload = frame.payload();
    let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
    let carries = [COMMAND_INT, COMMAND_LONG].contains(&frame.header().message_id);
    carries.then(|| u16::from_le_bytes([byte(28), byte(29)]))
}

/// Whether a message asks the vehicle for something, and neither moves it nor changes what it will fly, nor takes away what
/// the bridge flies by. What is not listed here is taken to.
pub(crate) fn only_asks(frame: &FrameView<'_>) -> bool {
    match command_of(frame) {
        Some(command) if command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16 => {
            let payload = frame.payload();
            let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
            let float = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|n| byte(at + n)));
            leaves_the_bridge_its_own(float(0), float(4))
        }
        Some(command) => ASKING_COMMANDS.contains(&command),
        None => ASKING_MESSAGES.contains(&frame.header().message_id),
    }
}

/// Whether a message changes how often the vehicle sends others.
fn sets_rates(frame: &FrameView<'_>) -> bool {
    frame.header().message_id == REQUEST_DATA_STREAM
        || command_of(frame) == Some(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16)
}

/// Whether a message may be sent at this interval, us: what the bridge needs no slower than it has asked for, and nothing so often that it fills
/// the link. 0 is the vehicle's own rate, which may be none.
fn leaves_the_bridge_its_own(message: f32, interval_us: f32) -> bool {
    let is_known = |id: u32| f64::from(message) == f64::from(id);
    let needed = needed_every_us().find(|(id, _)| is_known(*id));
    let not_too_often = interval_us <= 0.0 || interval_us >= FASTEST_US;
    match needed {
        Some((_, longest_us)) => interval_us >= FASTEST_US && interval_us <= longest_us,
        None => not_too_often,
    }
}

/// 100 Hz.
const FASTEST_US: f32 = 10_000.0;
const HEARTBEAT: u32 = 0;
const PARAM_REQUEST_LIST: u32 = 21;
const REQUEST_DATA_STREAM: u32 = 66;
const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;
/// PING; PARAM_REQUEST_READ, _LIST; MISSION_REQUEST, _REQUEST_LIST, _ACK, _REQUEST_INT; COMMAND_ACK.
const ASKING_MESSAGES: [u32; 8] = [4, 20, 21, 40, 43, 47, 51, 77];
const ASKING_COMMANDS: [u16; 2] = [
    MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16,
    MavCmd::MAV_CMD_REQUEST_MESSAGE as u16,
];

/// How long a ground station that calls may be silent before it is sent nothing more: it sends heartbeats each second.
const CLIENT_LEASE: Duration = Duration::from_secs(10);
/// Frames that wait for the socket: a second of a vehicle's, and more is lost as on any link.
const MAX_WAITING: usize = 512;
