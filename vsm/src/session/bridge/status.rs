//! What the bridge is doing, for `vsm status` and /status.json. Keys are named by their id only.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::payload::report::{Ground, Station};
use mapping::payload::{Equipment, Payloads};
use mapping::route::Curved;
use mapping::telemetry::Telemetry;
use serde::{Deserialize, Serialize};
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
use crate::session::payload;
use crate::session::web::WebStatus;

/// The whole bridge.
#[derive(Debug, Clone, Serialize)]
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
    pub vehicles: Vec<VehicleStatus>,
    /// Other ground stations.
    pub forwards: Vec<ForwardStatus>,
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
    /// Vehicle ID.
    pub id: String,
    /// Tail Number.
    pub tail_number: String,
    /// Whether its data are recent.
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

/// The motion of a vehicle, as reported.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
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
#[derive(Debug, Clone, Serialize)]
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
    /// Its state: "waiting" (nothing accepted yet), "live", "unanswered" (accepted, but for over 5 s nothing has shown that
    /// the vehicle receives us), "behind" (verified, but its stamps have fallen back), "ahead" (verified, but stamped over
    /// an hour ahead) or "settling" (it is being determined which of two keys the vehicle has).
    pub state: &'static str,
    /// Since when it has been live, s.
    pub live_s: Option<f64>,
    /// The age of our newest frame that a verified frame of the vehicle has answered, or of the first one if none has been
    /// answered, s; `None` on an unsigned link.
    pub unanswered_s: Option<f64>,
    /// Frames that verified under the key but were refused, by reason.
    pub refused_though_verified: BTreeMap<&'static str, u64>,
    /// The shortest recent round trip, s (TIMESYNC); `None` if the vehicle does not answer.
    pub round_trip_s: Option<f64>,
    /// The part of the vehicle's recent frames that did not arrive, 0 to 1, by gaps in their numbers.
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
    /// For a recording: signatures are not recorded, nor is anything else about the link.
    pub(crate) fn recorded(live: bool) -> LinkStatus {
        LinkStatus {
            address: String::new(),
            peer: None,
            signed: false,
            key_id: None,
            verified_s: None,
            verified_key_id: None,
            arrives: None,
            stale_at_start: 0,
            state: if live { "live" } else { "waiting" },
            live_s: None,
            unanswered_s: None,
            refused_though_verified: BTreeMap::new(),
            round_trip_s: None,
            lost: None,
            clock_known: false,
            exchange: None,
            encryption: None,
            refused: BTreeMap::new(),
            strangers: 0,
            other_systems: BTreeMap::new(),
            frames: BTreeMap::new(),
            received: ByType::default(),
            sent: ByType::default(),
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
                    live_s: link
                        .live_since
                        .map(|at| now.saturating_sub(at).as_secs_f64()),
                    round_trip_s: aircraft.clock().round_trip().map(|trip| trip.as_secs_f64()),
                    lost: link.lost(),
                    clock_known: aircraft.clock().offset().is_some(),
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
            uptime_s: now.saturating_sub(self.started).as_secs_f64(),
            warnings: self.warnings.clone(),
            refused: self.counters.clone(),
            set_aside: set_aside(&self.counters),
            recordings: Counters::default(),
            received: self.received.clone(),
            sent: self.outbox.sent.clone(),
            message_names: message_names(&[&self.received, &self.outbox.sent]),
            held: self.outbox.waiting(),
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
        let at = station.footprint(telemetry, ground)?;
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
