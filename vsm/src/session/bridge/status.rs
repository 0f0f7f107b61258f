//! What the bridge is doing, for `vsm status` and /status.json. Keys are named by their id only.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::payload::report::{Ground, Station};
use mapping::payload::{Equipment, Payloads};
use mapping::route::Curved;
use mapping::telemetry::Telemetry;
use serde::{Deserialize, Serialize, Serializer};
use stanag_msgs::table;

use super::Bridge;
use super::access::RightsStatus;
use crate::session::access::AccessStatus;
use crate::session::aircraft::Aircraft;
use crate::session::alerts::Acknowledged;
use crate::session::authority::rules::Stage;
use crate::session::counters::{ByType, Counters};
use crate::session::findings::Finding;
use crate::session::forward::ForwardStatus;
use crate::session::guard::GuardStatus;
use crate::session::link::encryption_status::EncryptionStatus;
use crate::session::link::key_agreement::ExchangeStatus;
use crate::session::link::state::SILENCE;
use crate::session::payload;
use crate::session::vehicle_pattern::VehiclePattern;
use crate::session::web::WebStatus;

/// The whole bridge.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Status {
    /// VSM ID.
    pub vsm: String,
    /// Since the start, s.
    pub uptime_s: f64,
    /// What the operator should change, or know about.
    pub warnings: Vec<String>,
    /// Drops and refusals of the DLI side, by name.
    pub refused: Counters,
    /// Those that are no fault: repetitions, messages for others of the group, messages that wait for the proof of an
    /// address.
    pub set_aside: Counters,
    /// What recordings have left out or removed, by reason.
    pub recordings: Counters,
    /// DLI messages taken, by type.
    pub received: ByType,
    /// DLI messages sent, by type.
    pub sent: ByType,
    /// The names of these types.
    pub message_names: BTreeMap<u32, &'static str>,
    /// Messages that are held until the disk has stored what they promise.
    pub held: usize,
    /// Whether the memory of the process, and every key in it, is kept out of swap.
    pub memory_locked: bool,
    /// What does not work, and why.
    pub findings: Vec<Finding>,
    /// Warnings and errors of the log of the last [`LATELY`], the oldest first.
    pub logged: Vec<Logged>,
    /// The ground stations.
    pub stations: Vec<StationStatus>,
    /// The rights of each of them over each vehicle.
    pub rights: Vec<RightsStatus>,
    /// The access list; `None` if none is configured.
    pub access: Option<AccessStatus>,
    /// The vehicles.
    #[serde(serialize_with = "serialize_vehicles")]
    pub vehicles: Vec<VehicleStatus>,
    /// Other ground stations.
    pub forwards: Vec<ForwardStatus>,
}

impl Status {
    /// Leaves the details of the vehicles that one of these patterns chooses, and the rights over them. Of each other vehicle the
    /// document has what a list shows.
    pub fn keep_details(&mut self, of: &[VehiclePattern]) {
        for one in &mut self.vehicles {
            one.whole = (of.iter()).any(|pattern| pattern.matches(&one.id, &one.tail_number));
        }
        let whole = self.vehicles.iter().filter(|one| one.whole);
        let whole: BTreeSet<&str> = whole.map(|one| one.id.as_str()).collect();
        self.rights.retain(|row| whole.contains(&*row.vehicle));
    }
}

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Logged {
    /// How long ago, s.
    pub ago_s: u64,
    /// "warning" or "error".
    pub level: String,
    /// The vehicle, CUCS or VSM that it is about.
    pub about: String,
    /// What happened.
    pub text: String,
}

/// Maximum age of a log line in the status: as long as received data stays in evidence.
pub const LATELY: Duration = Duration::from_secs(300);

/// One ground station.
#[derive(Debug, Clone, Serialize)]
pub struct StationStatus {
    /// CUCS ID.
    pub id: String,
    /// The address that it is sent to.
    pub address: Option<String>,
    /// Whether its address is proven: "answered", "configured" (the operator vouches for the address), "none", or
    /// "recorded".
    pub proof: &'static str,
    /// Time since a message of it was last accepted, s.
    pub silent_s: Option<f64>,
    /// The state of its guard; `None` if it has none, so that anybody can send in its name.
    pub guard: Option<GuardStatus>,
    /// Its connection, if it is a web client.
    pub web: Option<WebStatus>,
    /// Lines for its `[[cucs]]` that would fix its dialect, by what was received.
    pub profile: Vec<String>,
}

/// One vehicle.
#[derive(Debug, Clone, Serialize)]
pub struct VehicleStatus {
    /// Whether the document has all of it, or the row that a list shows.
    #[serde(skip)]
    pub whole: bool,
    /// Vehicle ID.
    pub id: String,
    /// Tail Number.
    pub tail_number: String,
    /// Whether its data are recent. What the vehicle reports of itself (mode, position, ..) is otherwise the last that was received.
    pub live: bool,
    /// PX4's name of its mode.
    pub mode: Option<&'static str>,
    /// Armed.
    pub armed: Option<bool>,
    /// Degrees north, degrees east, metres above mean sea level.
    pub position: Option<[f64; 3]>,
    /// Its motion.
    pub motion: MotionStatus,
    /// Energy left, 0 to 100 %.
    pub battery_percent: Option<u8>,
    /// Whether it is on the ground.
    pub on_ground: Option<bool>,
    /// The waypoint that it flies to, by the CUCS's number.
    pub flies_to: Option<u16>,
    /// Active alerts, the most urgent first.
    pub alerts: Vec<AlertStatus>,
    /// Where its sensors look.
    pub looks_at: Vec<FootprintStatus>,
    /// The CUCS that holds LOI 4 or 5.
    pub controller: Option<String>,
    /// The MAVLink system that may command it, 0 for nobody; `None` if the vehicle does not report it.
    pub operator_control: Option<u8>,
    /// LOI bits by CUCS.
    pub rights: BTreeMap<String, u8>,
    /// The holders of rights, and since when.
    pub holders: Vec<HolderStatus>,
    /// Undecided handovers.
    pub handovers: Vec<HandoverStatus>,
    /// Items of the mission aboard, as loaded and read back.
    pub mission_items: Option<usize>,
    /// How its curved legs were compiled.
    pub mission_curves: Option<Curved>,
    /// The altitudes that it must stay within.
    pub altitude_band: BandStatus,
    /// The rally points of the configuration; `None` if it has none.
    pub rally_points: Option<RallyStatus>,
    /// Its MAVLink.
    pub link: LinkStatus,
}

/// What a list and a map of very many vehicles show of one: under 250 bytes of JSON.
#[derive(Debug, Serialize)]
struct VehicleRow<'a> {
    id: &'a str,
    tail_number: &'a str,
    live: bool,
    on_ground: Option<bool>,
    /// To the centimetre: more digits would be a third of the row.
    position: Option<[f64; 3]>,
    battery_percent: Option<u8>,
    controller: Option<&'a str>,
    alert_count: usize,
    link: LinkRow,
}

/// Whether what arrives is signed.
#[derive(Debug, Serialize)]
struct LinkRow {
    signed: bool,
    arrives: Option<&'static str>,
}

impl VehicleRow<'_> {
    fn of(vehicle: &VehicleStatus) -> VehicleRow<'_> {
        let rounded = |value: f64, parts: f64| (value * parts).round() / parts;
        let place = |[north, east, amsl_m]: [f64; 3]| {
            [
                rounded(north, 1e7),
                rounded(east, 1e7),
                rounded(amsl_m, 1e2),
            ]
        };
        VehicleRow {
            id: &vehicle.id,
            tail_number: &vehicle.tail_number,
            live: vehicle.live,
            on_ground: vehicle.on_ground,
            position: vehicle.position.map(place),
            battery_percent: vehicle.battery_percent,
            controller: vehicle.controller.as_deref(),
            alert_count: vehicle.alerts.len(),
            link: LinkRow {
                signed: vehicle.link.signed,
                arrives: vehicle.link.arrives,
            },
        }
    }
}

fn serialize_vehicles<S: Serializer>(
    vehicles: &[VehicleStatus],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    #[serde(untagged)]
    enum Shown<'a> {
        Whole(&'a VehicleStatus),
        Row(VehicleRow<'a>),
    }
    serializer.collect_seq(vehicles.iter().map(|one| match one.whole {
        true => Shown::Whole(one),
        false => Shown::Row(VehicleRow::of(one)),
    }))
}

/// The motion of a vehicle, as reported.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct MotionStatus {
    /// Heading, 0 to 360 degrees from true north.
    pub heading_deg: Option<f64>,
    /// m/s.
    pub ground_speed_m_s: Option<f64>,
    /// m/s.
    pub air_speed_m_s: Option<f64>,
    /// Upwards, m/s.
    pub climb_m_s: Option<f64>,
    /// Metres above home.
    pub above_home_m: Option<f64>,
}

/// An active alert.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlertStatus {
    /// Warning ID of its 16000.
    pub id: i32,
    /// Its priority, by name: "emergency", "warning", "caution", ..
    pub priority: String,
    /// Its text.
    pub text: String,
    /// The ground stations that have acknowledged its present text.
    pub acknowledged: Vec<AcknowledgedStatus>,
}

/// A ground station that has acknowledged an alert.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AcknowledgedStatus {
    /// CUCS ID.
    pub cucs: String,
    /// When, ms since 1970.
    pub at_ms: u64,
}

/// The point that a sensor of a vehicle looks at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FootprintStatus {
    /// The payload station, 1 to 32.
    pub station: u8,
    /// The centre of its image on the ground: degrees north and east, metres above mean sea level.
    pub centre: [f64; 3],
    /// Distance from the vehicle to it, m.
    pub range_m: f64,
}

/// The altitudes that a vehicle must stay within.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct BandStatus {
    /// Metres above home, by `vehicle.limits` and GF_MAX_VER_DIST; `None` in a replay.
    pub lowest_m: Option<f64>,
    /// Metres above home.
    pub highest_m: Option<f64>,
    /// Whether the vehicle is outside them.
    pub outside: bool,
}

/// The rally points of the configuration.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct RallyStatus {
    /// Their number.
    pub count: usize,
    /// Whether the vehicle holds them: read back, and reported by it now.
    pub aboard: bool,
}

/// One holder of rights.
#[derive(Debug, Clone, Serialize)]
pub struct HolderStatus {
    /// CUCS ID.
    pub id: String,
    /// LOI bits, including implied ones.
    pub loi: u8,
    /// The same by number and name.
    pub levels: String,
    /// Payload stations, 1 to 32.
    pub stations: Vec<u8>,
    /// When it last gained one, ms since 1970.
    pub since_ms: Option<u64>,
}

/// An undecided handover.
#[derive(Debug, Clone, Serialize)]
pub struct HandoverStatus {
    /// The holder.
    pub from: Option<String>,
    /// The acquiring CUCS.
    pub to: String,
    /// The rights.
    pub rights: String,
    /// What it waits for.
    pub waits_for: &'static str,
}

/// One MAVLink link.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LinkStatus {
    /// As configured.
    pub address: String,
    /// The address of the vehicle.
    pub peer: Option<String>,
    /// Whether frames must be signed, by the configuration; `verified_s` shows whether they are.
    pub signed: bool,
    /// The id of the key in force.
    pub key_id: Option<String>,
    /// Time since a frame last verified under a key and was accepted, s; `None` if none has.
    pub verified_s: Option<f64>,
    /// The id of the key under which it verified.
    pub verified_key_id: Option<String>,
    /// What arrives: "verified", on an unsigned link "not verified"; otherwise why it is refused ("not signed", "signed
    /// with another key", "stale timestamps", ..); `None` if nothing has arrived for some seconds.
    pub arrives: Option<&'static str>,
    /// Frames that verified but have timestamps from before a restart of the vehicle, until our heartbeat has raised them.
    pub stale_at_start: u64,
    /// Its state: "waiting" (nothing accepted yet), "live", "silent" (accepted, but nothing for over 4 s), "unanswered" (accepted,
    /// but for over 5 s nothing has shown that the vehicle receives us), "behind" (verified, but its stamps have fallen back),
    /// "ahead" (verified, but stamped over an hour ahead) or "settling" (it is being determined which of two keys the vehicle has).
    pub state: &'static str,
    /// Time since a frame was last accepted, signed or not, s; `None` if none has been.
    pub accepted_s: Option<f64>,
    /// For how long frames have been accepted without interruption, s; `None` if none is accepted now.
    pub live_s: Option<f64>,
    /// The age of our newest frame that a verified frame of the vehicle has answered, or of the first one if none has been
    /// answered, s; `None` on an unsigned link.
    pub unanswered_s: Option<f64>,
    /// Frames that verified under the key but were refused, by reason.
    pub refused_though_verified: BTreeMap<&'static str, u64>,
    /// The shortest recent round trip, s (TIMESYNC); `None` if the vehicle does not answer, or is not `live`.
    pub round_trip_s: Option<f64>,
    /// The part of the vehicle's recent frames that did not arrive, 0 to 1, by gaps in their numbers; `None` if none is accepted
    /// now.
    pub lost: Option<f64>,
    /// Whether measurements of the vehicle are dated by its own clock; otherwise by their arrival.
    pub clock_known: bool,
    /// The key exchange over the air, if there is one.
    pub exchange: Option<ExchangeStatus>,
    /// The state of the encrypted link, if the vehicle has one (`encrypt`).
    pub encryption: Option<EncryptionStatus>,
    /// Refused frames in the vehicle's name, by reason.
    pub refused: BTreeMap<&'static str, u64>,
    /// Frames of systems that are no vehicle of this link, such as those that a vehicle forwards.
    pub strangers: u64,
    /// The same, by system id.
    pub other_systems: BTreeMap<u8, u32>,
    /// Frames by result.
    pub frames: BTreeMap<&'static str, u64>,
    /// Accepted, by message id.
    pub received: ByType,
    /// Sent, by message id.
    pub sent: ByType,
}

impl LinkStatus {
    /// For a recording, by how long ago the vehicle reported its mode: signatures are not recorded, nor is anything else about the
    /// link.
    pub(crate) fn recorded(age: Option<Duration>) -> LinkStatus {
        LinkStatus {
            state: match age {
                None => "waiting",
                Some(age) if age < SILENCE => "live",
                Some(_) => "silent",
            },
            ..LinkStatus::default()
        }
    }
}

impl Bridge {
    /// The present status.
    #[must_use]
    pub fn status(&self, vsm: String, now: Duration) -> Status {
        let each = self.stations.iter().enumerate();
        let listed = each.filter(|(_, station)| !station.removed);
        let stations = listed.map(|(index, station)| StationStatus {
            guard: self.guard_status(index, now),
            web: self.web_status(index, now),
            id: station.id().to_string(),
            address: station.peer.map(|peer| peer.to_string()),
            proof: match (station.proven, station.config.address) {
                (true, Some(_)) => "configured",
                (true, None) => "answered",
                (false, _) => "none",
            },
            silent_s: station
                .received
                .map(|at| now.saturating_sub(at).as_secs_f64()),
            profile: match station.spoken {
                Some((true, _)) if station.config.edition.is_none() => {
                    vec!["edition = \"2.5\"".to_owned()]
                }
                _ => station.profile.lines(),
            },
        });
        let vehicles = self.aircraft.iter().map(|aircraft| {
            let telemetry = &aircraft.vehicle.telemetry;
            let (link, rights) = (&aircraft.link, aircraft.authority.rights());
            let uploaded = aircraft.mission.uploaded();
            VehicleStatus {
                whole: true,
                id: aircraft.id().to_string(),
                tail_number: aircraft.config.tail_number.clone(),
                live: aircraft.vehicle.live(),
                mode: telemetry.mode.map(Px4Mode::name),
                armed: telemetry.armed,
                position: telemetry
                    .position
                    .map(|at| [at.latitude, at.longitude, at.amsl_m]),
                motion: motion(telemetry),
                battery_percent: telemetry.battery,
                on_ground: telemetry.landed.map(|_| telemetry.stands()),
                flies_to: (telemetry.mode == Some(Px4Mode::MISSION))
                    .then(|| aircraft.mission.flies_to(telemetry))
                    .flatten(),
                alerts: alerts(aircraft),
                looks_at: looks_at(aircraft, now),
                controller: rights.controller().map(|id| id.to_string()),
                operator_control: link.operator_control.owner(now),
                rights: rights
                    .holders()
                    .map(|(id, _)| (id.to_string(), rights.granted(id).raw()))
                    .collect(),
                holders: holders(aircraft),
                handovers: handovers(aircraft),
                mission_items: uploaded.map(|mission| mission.compiled.items.len()),
                mission_curves: curves(aircraft),
                altitude_band: altitude_band(aircraft),
                rally_points: rally_points(aircraft),
                link: LinkStatus {
                    address: aircraft.config.link.to_string(),
                    peer: link.peer().map(|peer| peer.to_string()),
                    signed: aircraft.config.signing != crate::config::Signing::Off,
                    key_id: link.key().map(|key| key.id().to_string()),
                    verified_s: link
                        .verified()
                        .map(|(at, _)| now.saturating_sub(at).as_secs_f64()),
                    verified_key_id: link.verified().map(|(_, key)| key.to_string()),
                    arrives: link.arrives(now),
                    stale_at_start: link.stale_at_start(now),
                    state: link.link_state_name(now),
                    unanswered_s: link.last_answer(now).map(|age| age.as_secs_f64()),
                    refused_though_verified: link.refused_though_verified(now),
                    accepted_s: link.accepted_for(now).map(|age| age.as_secs_f64()),
                    live_s: link.live_for(now).map(|age| age.as_secs_f64()),
                    // Measured while it was received: it may have moved away, or restarted, since.
                    round_trip_s: (aircraft.clock().round_trip())
                        .filter(|_| aircraft.vehicle.live())
                        .map(|trip| trip.as_secs_f64()),
                    lost: link.lost(now),
                    clock_known: aircraft.vehicle.live() && aircraft.clock().offset().is_some(),
                    exchange: None,
                    encryption: None,
                    refused: link.refused_frames(now),
                    strangers: self
                        .others_on_link(aircraft)
                        .map(|(_, n)| u64::from(n))
                        .sum(),
                    other_systems: self.others_on_link(aircraft).collect(),
                    frames: link.stats().iter().collect(),
                    received: link.received.clone(),
                    sent: link.sent.clone(),
                },
            }
        });
        Status {
            vsm,
            uptime_s: now.saturating_sub(self.records.started).as_secs_f64(),
            warnings: self.setup.warnings.clone(),
            refused: self.counters.clone(),
            set_aside: set_aside(&self.counters),
            recordings: Counters::default(),
            received: self.records.received.clone(),
            sent: self.outbox.sent.clone(),
            message_names: message_names(&[&self.records.received, &self.outbox.sent]),
            held: self.outbox.waiting(),
            memory_locked: false,
            findings: self.findings(now),
            logged: Vec::new(),
            stations: stations.collect(),
            rights: self.rights_status(),
            access: self.access_status(now),
            vehicles: vehicles.collect(),
            forwards: self.forwards.iter().map(|one| one.status(now)).collect(),
        }
    }
}

/// Types are counted as received: one that is in no table has no name.
fn message_names(counted: &[&ByType]) -> BTreeMap<u32, &'static str> {
    let types = counted.iter().flat_map(|types| types.iter());
    let named = types.filter_map(|(id, _)| {
        let message = u16::try_from(id).ok().and_then(table::message)?;
        Some((id, message.name))
    });
    named.collect()
}

fn set_aside(refused: &Counters) -> Counters {
    let mut set_aside = Counters::default();
    for name in [
        "our own",
        "another VSM's",
        "duplicate",
        "held back until the address is proven",
    ] {
        set_aside.add(name, refused.get(name));
    }
    set_aside
}

/// The motion of a vehicle, by its reports.
pub(crate) fn motion(telemetry: &Telemetry) -> MotionStatus {
    let yaw = telemetry.attitude.map(|attitude| attitude.yaw);
    MotionStatus {
        heading_deg: yaw.map(|yaw| yaw.to_degrees().rem_euclid(360.0)),
        ground_speed_m_s: telemetry.groundspeed,
        air_speed_m_s: telemetry.airspeed,
        climb_m_s: telemetry.velocity_ned.map(|[_, _, down]| -down),
        above_home_m: telemetry.above_home_m,
    }
}

fn alerts(aircraft: &Aircraft) -> Vec<AlertStatus> {
    let seen = |one: &Acknowledged| AcknowledgedStatus {
        cucs: one.cucs.to_string(),
        at_ms: u64::try_from(one.at.as_millis()).unwrap_or(u64::MAX),
    };
    let mut standing: Vec<_> = aircraft.alerts.standing().collect();
    standing.sort_by_key(|alert| Reverse(alert.priority.raw()));
    let shown = standing.into_iter().map(|alert| AlertStatus {
        id: alert.id,
        priority: alert.priority.to_string(),
        text: alert.text.clone(),
        acknowledged: aircraft.alerts.acknowledged(alert).map(seen).collect(),
    });
    shown.collect()
}

/// The points that its sensors look at, by recent reports of gimbals and cameras; empty for a vehicle that is not received.
fn looks_at(aircraft: &Aircraft, now: Duration) -> Vec<FootprintStatus> {
    let vehicle = &aircraft.vehicle;
    let ground = payload::ground(&aircraft.bounds, &vehicle.telemetry);
    let Some(ground) = ground.filter(|_| vehicle.live()) else {
        return Vec::new();
    };
    let configured: Vec<_> = (aircraft.config.payload.iter())
        .map(|one| one.equipment())
        .collect();
    footprints(
        &vehicle.payloads,
        &configured,
        &vehicle.telemetry,
        &ground,
        now,
    )
}

/// The points that sensors of this equipment look at; of the equipment that reports itself, if none is configured.
pub(crate) fn footprints(
    payloads: &Payloads,
    configured: &[Equipment],
    telemetry: &Telemetry,
    ground: &Ground<'_>,
    now: Duration,
) -> Vec<FootprintStatus> {
    let seen = payloads.stations(configured).into_iter();
    let seen = seen.filter_map(|one| {
        let station = Station::of(one, payloads, now);
        let at = station.image_centre(telemetry, ground)?;
        Some(FootprintStatus {
            station: one.number,
            centre: [at.place.latitude, at.place.longitude, at.place.amsl_m],
            range_m: at.range_m,
        })
    });
    seen.collect()
}

fn altitude_band(aircraft: &Aircraft) -> BandStatus {
    let parameters = aircraft.reports.parameters().values;
    let limits = aircraft.bounds.limits.of(parameters);
    BandStatus {
        lowest_m: Some(limits.floor_m()),
        highest_m: Some(limits.highest_m),
        outside: aircraft.mission.outside_band(),
    }
}

fn rally_points(aircraft: &Aircraft) -> Option<RallyStatus> {
    let (points, id) = aircraft.mission.rally();
    let count = points.len();
    let shown = aircraft.vehicle.telemetry.mission;
    let named = shown.map(|mission| mission.rally_points_id);
    (count > 0).then(|| RallyStatus {
        count,
        aboard: aircraft.vehicle.live() && id.is_some() && id == named,
    })
}

fn curves(aircraft: &Aircraft) -> Option<Curved> {
    aircraft.mission.uploaded()?.compiled.curved
}

fn holders(aircraft: &Aircraft) -> Vec<HolderStatus> {
    let holders = aircraft.authority.rights().holders().map(|(id, rights)| {
        let since = aircraft.authority.since(id);
        HolderStatus {
            id: id.to_string(),
            loi: rights.levels().raw(),
            levels: rights.levels().in_words(),
            stations: rights.stations().iter().collect(),
            since_ms: since.and_then(|since| u64::try_from(since.as_millis()).ok()),
        }
    });
    holders.collect()
}

fn handovers(aircraft: &Aircraft) -> Vec<HandoverStatus> {
    let pending = aircraft.authority.rights().pending().iter();
    let pending = pending.map(|handover| HandoverStatus {
        from: handover.from.map(|id| id.to_string()),
        to: handover.to.to_string(),
        rights: handover.rights.in_words(),
        waits_for: match handover.stage {
            Stage::Consent(_) => "consent of the holder",
            Stage::Acceptance(_) => "acceptance of the successor",
            Stage::Load(_) => "end of the load",
        },
    });
    pending.collect()
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn vehicle(n: u16) -> VehicleStatus {
        let [high, low] = n.to_be_bytes();
        let alert = AlertStatus {
            id: 7,
            priority: "warning".to_owned(),
            text: "no data from the vehicle: state unknown".to_owned(),
            acknowledged: Vec::new(),
        };
        VehicleStatus {
            whole: true,
            id: format!("1b:00:{high:02x}:{low:02x}"),
            tail_number: format!("UAV-{n:04}"),
            live: true,
            mode: Some("AUTO.LOITER"),
            armed: Some(true),
            position: Some([
                -47.397_742_123_456_7 + f64::from(n) * 1e-4,
                -122.545_593_812_345_6,
                1_488.123_456_7,
            ]),
            motion: motion(&Telemetry::default()),
            battery_percent: Some(100),
            on_ground: Some(false),
            flies_to: Some(25),
            alerts: vec![alert; 2],
            looks_at: Vec::new(),
            controller: Some("1b:00:00:a0".to_owned()),
            operator_control: None,
            rights: BTreeMap::new(),
            holders: Vec::new(),
            handovers: Vec::new(),
            mission_items: Some(30),
            mission_curves: None,
            altitude_band: BandStatus {
                lowest_m: Some(2.0),
                highest_m: Some(120.0),
                outside: false,
            },
            rally_points: None,
            link: LinkStatus {
                signed: true,
                arrives: Some("verified"),
                ..LinkStatus::recorded(Some(Duration::ZERO))
            },
        }
    }

    fn rights(vehicle: &VehicleStatus) -> RightsStatus {
        RightsStatus {
            cucs: "1b:00:00:a0".to_owned(),
            vehicle: vehicle.id.clone(),
            may_hold: 30,
            holds: 30,
            entries: Vec::new(),
        }
    }

    fn of(vehicles: Vec<VehicleStatus>) -> Status {
        Status {
            vsm: "1b:00:00:01".to_owned(),
            uptime_s: 1.0,
            warnings: Vec::new(),
            refused: Counters::default(),
            set_aside: Counters::default(),
            recordings: Counters::default(),
            received: ByType::default(),
            sent: ByType::default(),
            message_names: BTreeMap::new(),
            held: 0,
            memory_locked: false,
            findings: Vec::new(),
            logged: Vec::new(),
            stations: Vec::new(),
            rights: vehicles.iter().map(rights).collect(),
            access: None,
            vehicles,
            forwards: Vec::new(),
        }
    }

    #[test]
    fn of_a_thousand_vehicles_all_but_the_chosen_are_short_rows() {
        let mut status = of((0..1_000).map(vehicle).collect());
        let parsed = |text: &str| serde_json::from_str::<Value>(text).unwrap();
        let all = parsed(&serde_json::to_string(&status).unwrap());
        let chosen: VehiclePattern = "1b:00:00:02".parse().unwrap();
        status.keep_details(&[chosen]);
        let text = serde_json::to_string(&status).unwrap();
        let whole = all["vehicles"][2].to_string().len();
        assert!(text.len() < 250 * 1_000 + whole, "{}", text.len());

        let short = parsed(&text);
        assert_eq!(short["vehicles"][2], all["vehicles"][2]);
        assert_eq!(short["rights"].as_array().unwrap().len(), 1);
        assert_eq!(short["rights"][0]["vehicle"], "1b:00:00:02");
        let (row, of) = (&short["vehicles"][3], &all["vehicles"][3]);
        for key in ["id", "tail_number", "live", "on_ground", "controller"] {
            assert_eq!(row[key], of[key], "{key}");
        }
        assert!(text.contains(",-122.5455938,1488.12]"), "{row}");
        assert_eq!(row["alert_count"], 2);
        assert_eq!(row["link"]["arrives"], "verified");
        assert_eq!(row.get("motion"), None);

        status.keep_details(&[]);
        assert!(status.rights.is_empty());
        assert!(status.vehicles.iter().all(|one| !one.whole));
    }
}
