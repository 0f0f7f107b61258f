//! Requests to the vehicle for a single answer: its software versions (50013), and the round trip of a ping (50015).

use std::collections::BTreeMap;
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

use crate::session::allowance::Allowance;
use crate::session::context::{Context, Origin};
use crate::session::effects::Effects;
use crate::session::limits::PINGS;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct Requests {
    pings: Vec<Ping>,
    next_ping: u32,
    /// How many each station may send yet: with as many as are answered a monitor would fill a radio's uplink.
    allowances: BTreeMap<usize, Allowance>,
    /// Stations that wait for the software, with the fields that they requested.
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

impl Requests {
    /// When [`Requests::watch`] is next needed.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let pings = self.pings.iter().map(|ping| ping.sent + PING_WITHIN);
        pings.chain(self.software_by).min()
    }

    /// 50014.
    pub(super) fn ping(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        request: &PingRequest,
        effects: &mut Effects<'_>,
    ) {
        let number = request.ping_number;
        match request.ping_target.unwrap_or(PingTarget::Vsm) {
            PingTarget::Vsm => answer_ping(&origin, number, None, effects),
            PingTarget::Vehicle if !context.vehicle.live() => {
                effects.refuse(Some(origin), "no data from the vehicle");
            }
            PingTarget::Vehicle if self.pending(origin.station) >= MAX_PINGS => {
                let why = format!("{MAX_PINGS} pings of this station are pending");
                effects.refuse(Some(origin), why);
            }
            PingTarget::Vehicle if !self.may_ping(context.mono(), origin.station) => {
                let why = format!(
                    "this station pings the vehicle too often: more than {} times within {} s",
                    PINGS.at_once,
                    PINGS.burst().as_secs()
                );
                effects.refuse(Some(origin), why);
            }
            PingTarget::Vehicle => {
                effects.acknowledge(&origin, AckType::Received);
                // PING.seq is not the number of the CUCS: two stations may use the same.
                self.next_ping = self.next_ping.wrapping_add(1);
                let seq = self.next_ping;
                self.pings.push(Ping {
                    seq,
                    origin,
                    number,
                    sent: context.mono(),
                });
                effects.vehicle.post(ping_request(context.now.wall, seq));
            }
            PingTarget::Unknown(value) => {
                let why = format!("Ping Target {value}, expected 0 or 1");
                effects.refuse(Some(origin), why);
            }
        }
    }

    fn may_ping(&mut self, now: Duration, station: usize) -> bool {
        self.allowances.entry(station).or_default().take(now, PINGS)
    }

    /// Outstanding pings of a station.
    fn pending(&self, station: usize) -> usize {
        let of_it = |ping: &&Ping| ping.origin.station == station;
        self.pings.iter().filter(of_it).count()
    }

    /// The vehicle has answered a ping.
    pub(super) fn ping_returned(&mut self, seq: u32, effects: &mut Effects<'_>) {
        if let Some(place) = self.pings.iter().position(|ping| ping.seq == seq) {
            let ping = self.pings.swap_remove(place);
            let took = effects.dli.now.mono.saturating_sub(ping.sent);
            answer_ping(&ping.origin, ping.number, Some(took), effects);
        }
    }

    /// 17002 for 50013: answered at once if the vehicle has reported its software, otherwise as soon as it does.
    pub(super) fn software(
        &mut self,
        context: &Context<'_>,
        station: usize,
        fields: Option<u64>,
        effects: &mut Effects<'_>,
    ) {
        // A repeated request replaces the earlier one: a station is answered once.
        self.software.retain(|(waiting, _)| *waiting != station);
        self.software.push((station, fields));
        if context.vehicle.telemetry.software.is_some() || !context.vehicle.live() {
            return self.report_software(context, effects);
        }
        if self.software_by.is_none() {
            self.software_by = Some(context.mono() + SOFTWARE_WITHIN);
            // If it cannot be requested now, the VSM's own version is reported after the timeout.
            let request = request_message(AUTOPILOT_VERSION);
            let _ = effects.vehicle.commands.submit(context.mono(), request);
        }
    }

    /// Sends the known versions to the waiting stations.
    fn report_software(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        self.software_by = None;
        for (station, fields) in std::mem::take(&mut self.software) {
            let known = context.vehicle.telemetry.software.as_ref();
            let report = status::software(VERSION, known, effects.stamp());
            let mut report = Message::from(report);
            if let Some(fields) = fields.filter(|fields| *fields != 0) {
                report = table::select(&report, fields);
            }
            effects.send(station, &report);
        }
    }

    /// Ends answered requests and those that have timed out.
    pub(super) fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let now = context.mono();
        let known = context.vehicle.telemetry.software.is_some();
        if self.software_by.is_some_and(|by| known || by <= now) {
            self.report_software(context, effects);
        }
        let late = |ping: &Ping| ping.sent + PING_WITHIN <= now;
        while let Some(place) = self.pings.iter().position(late) {
            let ping = self.pings.swap_remove(place);
            effects.refuse(Some(ping.origin), "the vehicle does not answer the ping");
        }
    }
}

fn answer_ping(
    origin: &Origin,
    number: Option<u32>,
    took: Option<Duration>,
    effects: &mut Effects<'_>,
) {
    let target = match took {
        Some(_) => PingTarget::Vehicle,
        None => PingTarget::Vsm,
    };
    let answer = PingResponse {
        time_stamp: Some(effects.stamp()),
        ping_number: number,
        ping_target: Some(target),
        request_time_stamp: origin.stamp,
        vehicle_round_trip: took.map(|took| took.as_secs_f32()),
    };
    effects.send(origin.station, &answer.into());
    effects.acknowledge(origin, AckType::CarriedOut);
}

/// PING to system 0: PX4 returns it to its sender.
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
/// Enough for the round trip of a slow radio and one lost frame.
const PING_WITHIN: Duration = Duration::from_secs(3);
const SOFTWARE_WITHIN: Duration = Duration::from_secs(3);
/// Maximum number of outstanding pings of one station.
const MAX_PINGS: usize = 16;
