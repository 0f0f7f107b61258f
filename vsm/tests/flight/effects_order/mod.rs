//! The order of effects of one aircraft: what is written to disk, then what is sent to the ground stations, then what
//! is sent to the vehicle, call by call.
//!
//! Two promises are held here. A right, a plan or a command is on disk before it is answered: each record in turn
//! cannot be written, and the answer is another one. And one `handle_timeout` has its sixteen steps in one order: the
//! scenes bring each of them to act, and the whole sequence is compared. Alerts are named by priority, subsystem and
//! number, since their wording is no part of the order.
//!
//! `answers`: disk before answer; `timeouts`: the steps. Here: the bridge, its vehicle and its stations as one scene.

mod answers;
mod disk;
mod timeouts;

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Station, VSM, cucs, key, orders, station_address, vehicle_address, vehicle_id};
use mavlink::Message as _;
use mavlink_link::Now;
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::frame::{FrameView, MAX_FRAME};
use mavlink_link::service::Node;
use px4_sim::{Autopilot, HealthFaults, Signing};
use stanag_msgs::enums::{
    AreaType, ConfigRequestType, FlightPathControlMode as Mode, LoiBitmap, MissionPlanMode,
    PingTarget, RequestedAccess,
};
use stanag_msgs::messages::{
    AreaVertex, CucsAuthorisationRequest, FieldConfigurationRequest,
    GenericInformationRequestMessage, PingRequest, PositiveHandoverAuthorisationRequest,
};
use stanag_msgs::{Bam32, Message};
use vsm::config::Config;
use vsm::session::{Bridge, Datagram, Destination, LinkEnd, Peer};

use self::disk::RecordingDisk;

/// The effects of one call of the bridge, in order: "disk ...", "A ..." and "B ..." to the stations, "mav ...".
type Trace = Vec<String>;

const A: usize = 0;
const B: usize = 1;

/// One bridge, one simulated vehicle, two stations, and a clock that can jump.
struct Scene {
    clock: Duration,
    bridge: Bridge,
    vehicle: Autopilot<SocketAddr>,
    stations: [Station; 2],
    disk: RecordingDisk,
    /// Nothing passes between bridge and vehicle.
    cut: bool,
    /// `handle_timeout` is called when it is due.
    timeouts: bool,
}

impl Scene {
    fn new(vehicle: px4_sim::Config) -> Scene {
        let mut disk = RecordingDisk::default();
        let bridge = start(Duration::ZERO, "", &mut disk);
        let signing = Signing::with_key(key(0), 0);
        let vehicle = Autopilot::new(vehicle, signing, vec![Some(bridge_mav())]);
        let mut scene = Scene {
            clock: Duration::ZERO,
            bridge,
            vehicle,
            stations: [A, B].map(|n| Station::new(cucs(n), station_address(n))),
            disk,
            cut: false,
            timeouts: true,
        };
        scene.run(9.0);
        scene
    }

    /// The same, where station A holds LOI 2 to 5 and sends heartbeats.
    fn controlled(vehicle: px4_sim::Config) -> Scene {
        let mut scene = Scene::new(vehicle);
        scene.give(A, orders::request_control());
        scene.stations[A].heartbeats = true;
        scene.run(2.0);
        scene
    }

    /// One call of the bridge, and its effects.
    fn call(&mut self, work: impl FnOnce(&mut Bridge, Now, &mut RecordingDisk)) -> Trace {
        self.disk.operations.clear();
        work(&mut self.bridge, now(self.clock), &mut self.disk);
        let mut trace = std::mem::take(&mut self.disk.operations);
        while let Some(datagram) = self.bridge.poll_dli() {
            trace.extend(dli_line(&datagram));
        }
        while let Some((_, frame)) = self.bridge.poll_vehicle() {
            trace.push(mav_line(frame.bytes()));
            if !self.cut {
                self.vehicle.handle_datagram(0, bridge_mav(), frame.bytes());
            }
        }
        while self.bridge.poll_log().is_some() {}
        trace
    }

    /// A message of a station to the vehicle, sent once, that wants an acknowledgement.
    fn give(&mut self, station: usize, message: impl Into<Message>) -> Trace {
        let now = now(self.clock);
        let from = &mut self.stations[station];
        let ticket = from.send(now, vehicle_id(0), message.into());
        let datagrams = from.advance(now);
        from.give_up(ticket);
        let address = from.address;
        self.call(|bridge, now, disk| {
            for bytes in datagrams {
                bridge.handle_dli(now, address, &bytes, disk);
            }
        })
    }

    /// One `handle_timeout` after the clock has jumped. The bridge runs meanwhile, without a timeout: one that did not would count
    /// nobody as silent for that time.
    fn jump(&mut self, seconds: f64) -> Trace {
        let end = self.clock + Duration::from_secs_f64(seconds);
        while end.saturating_sub(self.clock) > Duration::from_secs(1) {
            self.clock += Duration::from_secs(1);
            let trace = self.call(|bridge, now, disk| bridge.handle_durable(now, disk));
            assert_eq!(trace, Trace::default());
        }
        self.clock = end;
        self.call(|bridge, now, disk| bridge.handle_timeout(now, disk))
    }

    fn run(&mut self, seconds: f64) {
        self.until(seconds, |_, _| false);
    }

    /// Lets time pass until a call has these effects, and returns them; none where that is never so.
    fn until(&mut self, limit_s: f64, so: impl Fn(&Scene, &Trace) -> bool) -> Option<Trace> {
        let end = self.clock + Duration::from_secs_f64(limit_s);
        let mut frame = [0; MAX_FRAME];
        while self.clock < end {
            self.clock += STEP;
            let now = now(self.clock);
            self.vehicle.step(STEP);
            let mut traces = Vec::new();
            while let Some(sent) = self.vehicle.poll_transmit(&mut frame) {
                if self.cut {
                    continue;
                }
                let bytes = &frame[..sent.len];
                traces.push(self.call(|bridge, now, disk| {
                    let from = Peer::Udp(vehicle_address(0));
                    bridge.handle_vehicle(now, 0, from, bytes, disk, &mut |_, _| {});
                }));
            }
            for station in [A, B] {
                for bytes in self.stations[station].advance(now) {
                    let from = self.stations[station].address;
                    traces.push(self.call(|bridge, now, disk| {
                        bridge.handle_dli(now, from, &bytes, disk);
                    }));
                }
            }
            if self.timeouts && self.bridge.poll_timeout(self.clock) <= self.clock {
                traces.push(self.call(|bridge, now, disk| bridge.handle_timeout(now, disk)));
            }
            let found = traces.into_iter().find(|trace| so(self, trace));
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Gives an order and lets time pass until it is carried out.
    fn carry_out(&mut self, message: impl Into<Message>) -> Trace {
        let message = message.into();
        let done = format!("A 17000 {} CarriedOut", message.id());
        let first = self.give(A, message);
        if first.contains(&done) {
            return first;
        }
        self.ended(&done)
    }

    /// Lets time pass until a call has this effect.
    #[track_caller]
    fn ended(&mut self, end: &str) -> Trace {
        let ended = self.until(60.0, |_, trace| trace.iter().any(|line| line == end));
        ended.unwrap_or_else(|| panic!("not seen: {end}"))
    }
}

fn now(clock: Duration) -> Now {
    Now {
        mono: clock,
        wall: EPOCH + clock,
    }
}

fn start(clock: Duration, tables: &str, disk: &mut RecordingDisk) -> Bridge {
    let text = format!(
        "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:4586\"\nprovisional = \"all\"\n\
         [authority]\nwarn_s = 1.0\noffer_s = 2.0\nact_s = 3.0\non_loss = \"rtl\"\n\
         [[cucs]]\nid = \"{}\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.1\"\n[[cucs]]\nid = \"{}\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.1\"\n\
         [store]\ndir = \"state\"\n\
         [[vehicle]]\nid = \"{}\"\nlink = \"udpin:{}\"\nsystem_id = 1\n\
         signing = {{ key_file = \"uav.key\" }}\n{tables}",
        cucs(A),
        cucs(B),
        vehicle_id(0),
        bridge_mav(),
    );
    let config = Config::parse(&text, Path::new("/nowhere")).expect("a good configuration");
    let ends = vec![LinkEnd {
        key: Some(key(0)),
        peer: None,
    }];
    Bridge::new(&config, ends, now(clock), EPOCH, disk).expect("the bridge starts")
}

/// "A 17000 2016 Received", "B 16000 Warning Comms 5 new", "A 4000"; none for the later parts of a long alert.
fn dli_line(datagram: &Datagram) -> Option<String> {
    let to = [A, B].map(|n| Destination::Unicast(station_address(n)));
    let name = if datagram.to == to[A] { "A" } else { "B" };
    let frame = stanag_msgs::frames(datagram.bytes())
        .next()
        .expect("a frame")
        .expect("a good frame");
    let message = Message::decode(frame.header.message_type, frame.data).expect("our own message");
    let detail = match &message {
        Message::MessageAcknowledgement(m) => {
            let (of, answer) = (m.original_message_type, m.acknowledgement_type);
            format!(" {} {:?}", of.expect("a type"), answer.expect("an answer"))
        }
        Message::SubsystemStatusAlert(m) => {
            if m.append_order.is_some_and(|order| order > 1) {
                return None;
            }
            let id = m.alert_warning_id.expect("an id");
            let first = if id < 0 { " new" } else { "" };
            let (priority, subsystem) = (m.priority.expect("one"), m.subsystem_id.expect("one"));
            let id = id.unsigned_abs();
            format!(" {priority:?} {subsystem:?} {id}{first}")
        }
        Message::VsmAuthorisationResponse(m) => {
            format!(" granted {:#04x}", m.loi_granted.expect("levels").raw())
        }
        Message::MissionUploadDownloadStatus(m) => format!(" {:?}", m.status.expect("a status")),
        Message::HandoverStatusReport(m) => format!(" {:?}", m.status.expect("a status")),
        _ => String::new(),
    };
    Some(format!("{name} {}{detail}", message.id()))
}

/// "mav HEARTBEAT", "mav MAV_CMD_DO_SET_MODE 4 5": of a mode its main and sub mode.
fn mav_line(bytes: &[u8]) -> String {
    let frame = FrameView::parse(bytes).expect("our own frame");
    let message = frame.message().expect("our own message");
    match &message {
        MavMessage::COMMAND_LONG(m) => match m.command {
            MavCmd::MAV_CMD_DO_SET_MODE => {
                format!("mav {:?} {} {}", m.command, m.param2, m.param3)
            }
            _ => format!("mav {:?} {}", m.command, m.param1),
        },
        _ => format!("mav {}", message.message_name()),
    }
}

/// Compares all effects but the records of the signing clock, which are written as time passes, whatever the call.
#[track_caller]
fn assert_trace(trace: &Trace, expected: &[&str]) {
    let mut trace = trace.clone();
    trace.retain(|line| !line.starts_with(CLOCK));
    assert_eq!(trace, expected, "it was:\n{trace:#?}");
}

fn bridge_mav() -> SocketAddr {
    kit::bridge::bridge_mav(0)
}

/// Message 1 for LOI 2, 4 and 5.
fn request(levels: u8) -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(levels)),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    }
}

/// A straight route of so many waypoints from 101.
fn line(count: u16, up: f64) -> Vec<Message> {
    let waypoints = (0..count).map(|n| {
        let next = if n + 1 < count { 102 + n } else { 0 };
        orders::waypoint(101 + n, next, 30.0 * f64::from(n + 1), 0.0, up).into()
    });
    std::iter::once(orders::route(101).into())
        .chain(waypoints)
        .collect()
}

fn corner() -> AreaVertex {
    let (latitude, longitude) = orders::place(300.0, 300.0);
    AreaVertex {
        area_id: Some(1),
        area_type: Some(AreaType::KeepInPolygon),
        vertex_count: Some(4),
        vertex_number: Some(1),
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        ..AreaVertex::default()
    }
}

fn configuration() -> FieldConfigurationRequest {
    FieldConfigurationRequest {
        vsm_id: Some(VSM),
        request_type: Some(ConfigRequestType::Loi4),
        ..FieldConfigurationRequest::default()
    }
}

fn ping() -> PingRequest {
    PingRequest {
        ping_target: Some(PingTarget::Vehicle),
        ..PingRequest::default()
    }
}

/// 17002 for 50013, the software of the vehicle.
fn software() -> GenericInformationRequestMessage {
    GenericInformationRequestMessage {
        message_type: Some(50_013),
        ..GenericInformationRequestMessage::default()
    }
}

/// Message 4 for LOI 4 and 5.
fn hand_over(to: usize) -> PositiveHandoverAuthorisationRequest {
    PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0c)),
        requesting_cucs_id: Some(cucs(to)),
        ..PositiveHandoverAuthorisationRequest::default()
    }
}

fn operator_control() -> px4_sim::Config {
    px4_sim::Config {
        operator_control: true,
        ..px4_sim::Config::default()
    }
}

/// Runs of answers of the configuration phase, as one line.
fn shortened(trace: &Trace) -> Trace {
    let answers = ["A 41", "A 44"];
    let mut short = Trace::new();
    let mut run = 0;
    for line in trace.iter().map(String::as_str).chain([""]) {
        if answers.iter().any(|start| line.starts_with(start)) {
            run += 1;
            continue;
        }
        if run > 0 {
            short.push(format!("A {run} configuration answers"));
            run = 0;
        }
        short.push(line.to_owned());
    }
    short.pop();
    short
}

/// Another ground station on the same vehicle.
const GROUND: Node = Node {
    system: 255,
    component: 190,
};
const CLOCK: &str = "disk save clock-";
const STEP: Duration = Duration::from_millis(10);
/// 2026-01-01.
const EPOCH: Duration = Duration::from_secs(1_767_225_600);
