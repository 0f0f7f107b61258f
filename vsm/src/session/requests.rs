//! What is asked of the vehicle for one answer: its software (50013), and how long a ping takes to it and back (50015).

use std::time::Duration;

use mapping::status;
#[allow(
    deprecated,
    reason = "PX4 answers PING; TIMESYNC, which replaces it, sets its clock"
)]
use mavlink_link::dialect::PING_DATA;
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::service::command::{Command, Payload, Repetition};
use stanag_msgs::enums::{AckType, PingTarget};
use stanag_msgs::messages::{PingRequest, PingResponse};
use stanag_msgs::{Message, table};

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Inquiries {
    pings: Vec<Ping>,
    next_ping: u32,
    /// Stations that wait for the software, with the fields that they asked for.
    software: Vec<(usize, Option<u64>)>,
    software_by: Option<Duration>,
}

#[derive(Debug)]
struct Ping {
    /// PING.seq.
    seq: u32,
    origin: Origin,
    number: Option<u32>,
    sent: Duration,
}

impl Inquiries {
    /// When [`Aircraft::watch_inquiries`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let pings = self.pings.iter().map(|ping| ping.sent + PING_WITHIN);
        pings.chain(self.software_by).min()
    }
}

impl Aircraft {
    /// 50014.
    pub(super) fn ping(&mut self, desk: &mut Desk<'_>, origin: Origin, request: &PingRequest) {
        let number = request.ping_number;
        match request.ping_target.unwrap_or(PingTarget::Vsm) {
            PingTarget::Vsm => {
                self.answer_ping(desk, &origin, number, None);
            }
            PingTarget::Vehicle => {
                if !self.mav.live() {
                    let why = "the vehicle is silent".to_owned();
                    return self.refuse(desk, Some(origin), why);
                }
                if self.inquiries.pings.len() >= MAX_PINGS {
                    let why = format!("{MAX_PINGS} pings are on their way");
                    return self.refuse(desk, Some(origin), why);
                }
                desk.acknowledge(self.id(), &origin, AckType::Received);
                self.inquiries.next_ping = self.inquiries.next_ping.wrapping_add(1);
                let seq = self.inquiries.next_ping;
                self.inquiries.pings.push(Ping {
                    seq,
                    origin,
                    number,
                    sent: desk.now.mono,
                });
                self.mav.post(ping_request(desk.now.wall, seq));
                self.run_until_idle(desk);
            }
            PingTarget::Unknown(value) => {
                let why = format!("Ping Target {value}, expected 0 or 1");
                self.refuse(desk, Some(origin), why);
            }
        }
    }

    /// The vehicle has returned a ping.
    pub(super) fn ping_returned(&mut self, desk: &mut Desk<'_>, seq: u32) {
        let pings = &mut self.inquiries.pings;
        let Some(place) = pings.iter().position(|ping| ping.seq == seq) else {
            return;
        };
        let ping = pings.swap_remove(place);
        let took = desk.now.mono.saturating_sub(ping.sent);
        self.answer_ping(desk, &ping.origin, ping.number, Some(took));
    }

    fn answer_ping(
        &mut self,
        desk: &mut Desk<'_>,
        origin: &Origin,
        number: Option<u32>,
        took: Option<Duration>,
    ) {
        let target = match took {
            Some(_) => PingTarget::Vehicle,
            None => PingTarget::Vsm,
        };
        let answer = PingResponse {
            time_stamp: Some(desk.stamp()),
            ping_number: number,
            ping_target: Some(target),
            request_time_stamp: origin.stamp,
            vehicle_round_trip: took.map(|took| took.as_secs_f32()),
        };
        desk.send(origin.station, self.id(), &answer.into());
        desk.acknowledge(self.id(), origin, AckType::CarriedOut);
    }

    /// 17002 for 50013: at once where the vehicle has told its software, else as soon as it has.
    pub(super) fn request_software(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        fields: Option<u64>,
    ) {
        let inquiries = &mut self.inquiries;
        inquiries
            .software
            .retain(|(waiting, _)| *waiting != station);
        inquiries.software.push((station, fields));
        if self.mav.telemetry.software.is_some() || !self.mav.live() {
            return self.tell_software(desk);
        }
        if self.inquiries.software_by.is_none() {
            self.inquiries.software_by = Some(desk.now.mono + SOFTWARE_WITHIN);
            // Where it cannot be asked now, the VSM's own version is told when the time is over.
            let _ = self
                .mav
                .commands
                .submit(desk.now.mono, request_message(AUTOPILOT_VERSION));
            self.run_until_idle(desk);
        }
    }

    /// Tells those that wait: what is known.
    fn tell_software(&mut self, desk: &mut Desk<'_>) {
        self.inquiries.software_by = None;
        for (station, fields) in std::mem::take(&mut self.inquiries.software) {
            let known = self.mav.telemetry.software.as_ref();
            let report = status::software(VERSION, known, desk.stamp());
            let mut report = Message::from(report);
            if let Some(fields) = fields.filter(|fields| *fields != 0) {
                report = table::select(&report, fields);
            }
            desk.send(station, self.id(), &report);
        }
    }

    /// Ends what was asked in vain.
    pub(super) fn watch_inquiries(&mut self, desk: &mut Desk<'_>) {
        let now = desk.now.mono;
        let told = self.mav.telemetry.software.is_some();
        if self
            .inquiries
            .software_by
            .is_some_and(|by| told || by <= now)
        {
            self.tell_software(desk);
        }
        let late = |ping: &Ping| ping.sent + PING_WITHIN <= now;
        while let Some(place) = self.inquiries.pings.iter().position(late) {
            let ping = self.inquiries.pings.swap_remove(place);
            let why = "the vehicle does not answer the ping".to_owned();
            self.refuse(desk, Some(ping.origin), why);
        }
    }
}

/// PING to everybody: PX4 returns it to its sender.
#[allow(
    deprecated,
    reason = "PX4 answers PING; TIMESYNC, which replaces it, sets its clock"
)]
fn ping_request(wall: Duration, seq: u32) -> MavMessage {
    MavMessage::PING(PING_DATA {
        time_usec: u64::try_from(wall.as_micros()).unwrap_or(u64::MAX),
        seq,
        target_system: 0,
        target_component: 0,
    })
}

fn request_message(id: u16) -> Command {
    Command {
        command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
        payload: Payload::Long([f32::from(id), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        repetition: Repetition::Safe,
    }
}

const AUTOPILOT_VERSION: u16 = 148;
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// A radio's round trip, and a loss.
const PING_WITHIN: Duration = Duration::from_secs(3);
const SOFTWARE_WITHIN: Duration = Duration::from_secs(3);
const MAX_PINGS: usize = 16;
