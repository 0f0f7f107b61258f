//! The order of effects of one aircraft: what is written to disk, then what is sent to the ground stations, then what
//! is sent to the vehicle, call by call.
//!
//! Two promises are held here. A right, a plan or a command is on disk before it is answered: each record in turn
//! cannot be written, and the answer is another one. And one `handle_timeout` has its sixteen steps in one order: the
//! scenes bring each of them to act, and the whole sequence is compared. Alerts are named by priority, subsystem and
//! number, since their wording is no part of the order.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Station, VSM, cucs, key, orders, station_address, vehicle_address, vehicle_id};
use mavlink::Message as _;
use mavlink_link::Now;
use mavlink_link::dialect::{COMMAND_LONG_DATA, MavCmd, MavMessage};
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

/// A disk that writes down the order of its operations, and can refuse those on some records.
mod disk {
    use std::collections::BTreeMap;

    use mavlink_link::store::{Disk, Durability, StoreError};
    use zeroize::Zeroizing;

    #[derive(Debug, Default)]
    pub(crate) struct RecordingDisk {
        pub(crate) records: BTreeMap<String, Vec<u8>>,
        pub(crate) operations: Vec<String>,
        /// Records whose names start so cannot be written.
        pub(crate) full: Option<&'static str>,
    }

    impl RecordingDisk {
        fn note(&mut self, what: &str, name: &str, to: Durability) -> Result<(), StoreError> {
            let refused = self.full.is_some_and(|prefix| name.starts_with(prefix));
            let end = if refused { " FAILS" } else { "" };
            self.operations
                .push(format!("disk {what} {name} {to:?}{end}"));
            if !refused {
                return Ok(());
            }
            Err(StoreError {
                name: name.to_owned(),
                cause: "no space left".to_owned(),
            })
        }
    }

    impl Disk for RecordingDisk {
        fn read(&self, name: &str, _: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
            Ok(self.records.get(name).cloned().map(Zeroizing::new))
        }

        fn replace(&mut self, name: &str, bytes: &[u8], to: Durability) -> Result<(), StoreError> {
            self.note("save", name, to)?;
            self.records.insert(name.to_owned(), bytes.to_vec());
            Ok(())
        }

        fn append(&mut self, name: &str, bytes: &[u8], to: Durability) -> Result<(), StoreError> {
            self.note("append", name, to)?;
            let record = self.records.entry(name.to_owned()).or_default();
            record.extend_from_slice(bytes);
            Ok(())
        }

        fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
            self.note("rename", from, Durability::Power)?;
            if let Some(bytes) = self.records.remove(from) {
                self.records.insert(to.to_owned(), bytes);
            }
            Ok(())
        }

        fn remove(&mut self, name: &str) -> Result<(), StoreError> {
            self.note("remove", name, Durability::Power)?;
            self.records.remove(name);
            Ok(())
        }
    }
}

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

    /// One `handle_timeout` after the clock has jumped.
    fn jump(&mut self, seconds: f64) -> Trace {
        self.clock += Duration::from_secs_f64(seconds);
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

#[test]
fn a_grant_is_audited_and_stored_before_it_is_answered() {
    let mut scene = Scene::new(px4_sim::Config::default());
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            // The answer to the command, before it is sent.
            "disk append commands-1b0000a0.log Process",
            // What a new listener needs, then what it holds.
            "A 3",
            "A 16000 Nominal Comms 4 new",
            "A 2 granted 0x0d",
            "A 17000 1 CarriedOut",
        ],
    );
}

#[test]
fn levels_that_command_nothing_need_not_outlive_a_power_cut() {
    let mut scene = Scene::new(px4_sim::Config::default());
    let trace = scene.give(A, request(0x01));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append audit-monitors-1b000101.log Process",
            "disk save authority-1b000101.json Process",
            "disk append commands-1b0000a0.log Process",
            "A 3",
            "A 16000 Nominal Comms 4 new",
            "A 2 granted 0x01",
            "A 17000 1 CarriedOut",
        ],
    );
}

#[test]
fn a_grant_that_cannot_be_audited_is_refused() {
    let mut scene = Scene::new(px4_sim::Config::default());
    scene.disk.full = Some("audit");
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            // Its record is not tried.
            "disk append audit-1b000101.log Power FAILS",
            "disk append commands-1b0000a0.log Process",
            "A 2 granted 0x00",
            "A 16000 Caution VsmStatus 7 new",
            "A 17000 1 Refused",
        ],
    );
}

#[test]
fn a_grant_that_is_audited_and_not_stored_is_taken_back_in_the_audit_log() {
    let mut scene = Scene::new(px4_sim::Config::default());
    scene.disk.full = Some("authority");
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power FAILS",
            "disk append audit-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            "A 2 granted 0x00",
            "A 16000 Caution VsmStatus 7 new",
            "A 17000 1 Refused",
        ],
    );
    let audit = String::from_utf8_lossy(&scene.disk.records["audit-1b000101.log"]);
    let last = audit.lines().last().expect("a line");
    assert!(last.contains("not kept"), "{last}");
}

#[test]
fn a_command_log_that_cannot_be_written_is_reported_and_stops_nothing() {
    let mut scene = Scene::new(px4_sim::Config::default());
    scene.disk.full = Some("commands");
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process FAILS",
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            "disk append commands-1b0000a0.log Process FAILS",
            "A 3",
            "A 16000 Nominal Comms 4 new",
            "A 16000 Warning VsmStatus 6 new",
            "A 2 granted 0x0d",
            "A 17000 1 CarriedOut",
        ],
    );
    // The warning is raised once, and cleared before the next command is answered.
    let command = scene.give(A, orders::mode(Mode::Loiter));
    assert_trace(
        &command,
        &[
            "disk append commands-1b0000a0.log Process FAILS",
            "A 17000 2016 Received",
            "mav MAV_CMD_DO_SET_MODE 4 3",
        ],
    );
    scene.disk.full = None;
    let corner = scene.give(A, corner());
    assert_trace(
        &corner,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save areas-1b000101.json Process",
            "disk append commands-1b0000a0.log Process",
            "A 16000 Cleared VsmStatus 6",
            "A 17000 50016 CarriedOut",
        ],
    );
}

#[test]
fn a_plan_and_a_command_are_on_disk_before_they_are_answered() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for (number, message) in line(2, 20.0).into_iter().enumerate() {
        let answer = format!("A 17000 {} CarriedOut", message.id());
        let trace = scene.give(A, message);
        // The first message of a plan begins its log, the others are appended.
        let stored = match number {
            0 => "disk save plan-1b000101.log Process",
            _ => "disk append plan-1b000101.log Process",
        };
        assert_trace(
            &trace,
            &[
                "disk append commands-1b0000a0.log Process",
                stored,
                "disk append commands-1b0000a0.log Process",
                &answer,
            ],
        );
    }
    let area = scene.give(A, corner());
    assert_trace(
        &area,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save areas-1b000101.json Process",
            "disk append commands-1b0000a0.log Process",
            "A 17000 50016 CarriedOut",
        ],
    );
    let load = scene.give(A, orders::load());
    assert_trace(
        &load,
        &[
            "disk append commands-1b0000a0.log Process",
            // That the upload has ended here.
            "disk append plan-1b000101.log Process",
            "A 17000 13000 Received",
            "A 14000 InProgress",
            "A 14000 InProgress",
            "mav MISSION_COUNT",
        ],
    );
    let loaded = scene.ended("A 17000 13000 CarriedOut");
    assert_trace(
        &loaded,
        &[
            "disk save chosen-1b000101.json Power",
            "disk save aboard-1b000101.json Power",
            // What is loaded is a good moment to fold the plan's log into its record.
            "disk save plan-1b000101.json Process",
            "disk remove plan-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            // That AGL is flown above home, once.
            "A 16000 Nominal VsmStatus 6 new",
            "A 17000 13000 CarriedOut",
            "A 14000 Complete",
        ],
    );
    let hold = scene.give(A, orders::mode(Mode::Loiter));
    assert_trace(
        &hold,
        &[
            "disk append commands-1b0000a0.log Process",
            "A 17000 2016 Received",
            "mav MAV_CMD_DO_SET_MODE 4 3",
        ],
    );
    let held = scene.ended("A 17000 2016 CarriedOut");
    assert_trace(
        &held,
        &[
            "disk append commands-1b0000a0.log Process",
            "A 17000 2016 CarriedOut",
        ],
    );
}

#[test]
fn a_plan_that_cannot_be_stored_is_refused_and_unknown() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for message in line(2, 20.0) {
        scene.carry_out(message);
    }
    scene.disk.full = Some("plan");
    let waypoint = scene.give(A, orders::waypoint(103, 0, 60.0, 0.0, 30.0));
    assert_trace(
        &waypoint,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append plan-1b000101.log Process FAILS",
            "disk append commands-1b0000a0.log Process",
            "A 17000 13002 Refused",
            "A 16000 Caution VsmStatus 6 new",
        ],
    );
    let mut one = orders::transfer(MissionPlanMode::DownloadWaypoint);
    one.waypoint_number = Some(103);
    let download = scene.give(A, one);
    assert!(
        download.contains(&"A 17000 13000 Refused".to_owned()),
        "{download:#?}"
    );
    scene.disk.full = Some("areas");
    let area = scene.give(A, corner());
    assert_trace(
        &area,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save areas-1b000101.json Process FAILS",
            "disk append commands-1b0000a0.log Process",
            "A 17000 50016 Refused",
            "A 16000 Caution VsmStatus 8 new",
        ],
    );
    scene.disk.full = Some("aboard");
    scene.give(A, orders::load());
    let load = scene.ended("A 17000 13000 Refused");
    assert_trace(
        &load,
        &[
            "disk save chosen-1b000101.json Power",
            "disk save aboard-1b000101.json Power FAILS",
            // The upload stays for another 13000, and gives way to another upload.
            "disk save plan-1b000101.json Process",
            "disk remove plan-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            // That AGL is flown above home, once.
            "A 16000 Nominal VsmStatus 9 new",
            "A 14000 Aborted",
            "A 17000 13000 Refused",
            "A 16000 Caution VsmStatus 10 new",
        ],
    );
}

/// Steps 1, 2, 4, 8, 9, 11, 12, 13 and 15: the controller is lost while much else is under way.
#[test]
fn one_timeout_after_the_controller_is_lost() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    scene.give(B, request(0x01));
    scene.carry_out(configuration());
    for message in line(10, 20.0) {
        scene.carry_out(message);
    }
    scene.carry_out(orders::launch(20.0));
    // Refused, since nothing is loaded: the reason stands for 15 s.
    scene.give(A, orders::mode(Mode::Waypoint));
    scene.run(12.0);
    // Seen by one timeout, and not for long enough to be raised.
    scene.vehicle.vehicle_mut().set_health_faults(HealthFaults {
        battery: Some(5),
        ..HealthFaults::default()
    });
    scene.run(1.4);
    // The end of the load is seen by the vehicle's datagrams, the mode that it makes available by the next timeout.
    scene.timeouts = false;
    scene.give(A, orders::load());
    scene.ended("A 14000 Complete");
    scene.cut = true;
    scene.give(A, orders::transfer(MissionPlanMode::Download));
    scene.give(A, ping());
    let trace = scene.jump(3.2);
    assert_trace(
        &trace,
        &[
            // 2: the controller is lost.
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            // 13: the answer to the download.
            "disk append commands-1b0000a0.log Process",
            // 2: what it still holds, that it is lost, and how the handover ended.
            "A 2 granted 0x01",
            "A 16000 Emergency Comms 10 new",
            "B 16000 Emergency Comms 10 new",
            "A 35000 Failed",
            "B 35000 Failed",
            // 4 and 8: a mode can be commanded now.
            "A 44003",
            // 4: the Mission ID is another since the load.
            "A 3",
            "B 3",
            // 9: the ping was in vain.
            "A 17000 50014 Refused",
            "A 16000 Caution VsmStatus 11 new",
            // 11: the battery.
            "A 16000 Emergency PropulsionEnergy 12 new",
            "B 16000 Emergency PropulsionEnergy 12 new",
            // 12: the refusal of mode 11 has stood for 15 s.
            "A 16000 Cleared VsmStatus 9",
            // 13: the rest of the download.
            "A 13002",
            "A 13002",
            "A 13002",
            "A 17000 13000 CarriedOut",
            "A 14000 Complete",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            "B 3001",
            "B 3002",
            "B 4000",
            "B 4001",
            "B 16002",
            // 1: the link.
            "mav HEARTBEAT",
            "mav TIMESYNC",
            // 2: the action after the loss.
            "mav MAV_CMD_DO_SET_MODE 4 5",
        ],
    );
}

/// Step 9: what was requested of the vehicle ends in vain, the software before the pings.
#[test]
fn one_timeout_after_requests_that_nothing_answered() {
    let mut scene = Scene::new(px4_sim::Config::default());
    // Without heartbeats its silence does not count.
    scene.give(A, request(0x01));
    scene.run(0.3);
    scene.cut = true;
    scene.give(A, ping());
    scene.give(A, software());
    let trace = scene.jump(3.05);
    assert_trace(
        &trace,
        &[
            // 9: what is known of the software, then that the ping was in vain.
            "A 50013",
            "A 17000 50014 Refused",
            "A 16000 Caution VsmStatus 6 new",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            // 1: the link, and the request for the software once more.
            "mav HEARTBEAT",
            "mav MAV_CMD_REQUEST_MESSAGE 148",
        ],
    );
}

/// Steps 2, 5, 6, 10, 15 and 16: the VSM was restarted in the middle of a launch, with a new fence in its
/// configuration, and the vehicle holds another mission than the one that was loaded last.
#[test]
fn one_timeout_after_a_restart_in_the_middle_of_a_launch() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for message in line(2, 20.0) {
        scene.carry_out(message);
    }
    scene.carry_out(orders::load());
    let of_first = scene.disk.records.clone();
    for message in line(3, 30.0) {
        scene.carry_out(message);
    }
    scene.carry_out(orders::load());
    let loaded = |name: &str| name.starts_with("aboard") || name.starts_with("chosen");
    let of_first = of_first.into_iter().filter(|(name, _)| loaded(name));
    scene.disk.records.extend(of_first);
    let unlearnt = |name: &str| name.starts_with("link-id");
    scene.disk.records.retain(|name, _| !unlearnt(name));
    scene.give(A, orders::launch(20.0));
    let up = scene.until(20.0, |scene, _| !scene.vehicle.vehicle().truth().landed);
    assert!(up.is_some(), "it takes off");
    scene.timeouts = false;
    let fence =
        "[[vehicle.area]]\nkeep = \"in\"\ncentre = [47.3977434, 8.5455939]\nradius_m = 900.0\n";
    scene.bridge = start(scene.clock, fence, &mut scene.disk);
    scene.run(4.5);
    let trace = scene.jump(0.0);
    assert_trace(
        &trace,
        &[
            // 2: that the holder sends heartbeats is stored again.
            "disk save authority-1b000101.json Power",
            // 16: the vehicle's link id.
            "disk save link-id-1b000101.json Process",
            // 5: the vehicle holds another mission.
            "A 16000 Warning Comms 5 new",
            // 6: the launch that was cut off has taken it up.
            "A 16000 Warning Comms 6 new",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            // 1: the link, and the first rate.
            "mav HEARTBEAT",
            "mav TIMESYNC",
            "mav MAV_CMD_SET_MESSAGE_INTERVAL 436",
            // 10: the fence.
            "mav MISSION_COUNT",
        ],
    );
}

/// Steps 1, 3, 7, 8 and 15: another station owns the vehicle, a configuration is being sent, and then the vehicle falls
/// silent.
#[test]
fn timeouts_while_another_station_owns_the_vehicle() {
    let mut scene = Scene::new(operator_control());
    // The ceiling is stored 10 s ahead: until some time before it is stored again.
    let stores_clock = |_: &Scene, trace: &Trace| trace.iter().any(|line| line.starts_with(CLOCK));
    scene.until(11.0, stores_clock).expect("once in 10 s");
    scene.run(7.0);
    let ask = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL,
        target_system: 1,
        target_component: 1,
        param1: 1.0,
        param3: 10.0,
        param4: 255.0,
        ..COMMAND_LONG_DATA::default()
    });
    scene.vehicle.vehicle_mut().handle_message(GROUND, &ask);
    scene.run(1.5);
    scene.give(A, orders::request_control());
    scene.run(0.2);
    scene.cut = true;
    scene.give(A, configuration());
    let trace = scene.jump(2.1);
    // 1: the signing clock is stored before anything is signed beyond it.
    assert!(trace[0].starts_with(CLOCK), "{trace:#?}");
    assert_trace(
        &shortened(&trace),
        &[
            // 8: the next burst.
            "A 16 configuration answers",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            // 1: the link.
            "mav HEARTBEAT",
            // 7: what a step submits is sent by the same call.
            "mav MAV_CMD_REQUEST_OPERATOR_CONTROL 1",
        ],
    );
    let trace = scene.jump(2.1);
    assert_trace(
        &shortened(&trace),
        &[
            // 3: the vehicle is silent, and its state is reported on change.
            "A 16000 Warning Comms 8 new",
            "A 3001",
            "A 3002",
            // 8: the next burst.
            "A 16 configuration answers",
            // 15: what is pushed, of a silent vehicle less.
            "A 3001",
            "A 3002",
            "A 16002",
            // 1: the link.
            "mav HEARTBEAT",
            // 1: the repetition of what 7 sent in the timeout before.
            "mav MAV_CMD_REQUEST_OPERATOR_CONTROL 1",
        ],
    );
}

/// Steps 1, 3, 14 and 15: a load fails, and the handover that waited for its end is completed by the same timeout.
#[test]
fn one_timeout_that_ends_a_load_and_completes_a_handover() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for message in line(2, 20.0) {
        scene.carry_out(message);
    }
    scene.cut = true;
    scene.give(A, orders::load());
    let offer = scene.give(A, hand_over(B));
    assert_trace(
        &offer,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save authority-1b000101.json Power",
            "A 35000 InProgress",
            "A 16000 Caution VsmStatus 6 new",
            "A 17000 4 Received",
        ],
    );
    let acceptance = scene.give(B, hand_over(B));
    assert_trace(
        &acceptance,
        &[
            "disk append commands-1b0000a1.log Process",
            "disk save authority-1b000101.json Power",
            "A 35000 InProgress",
            "B 35000 InProgress",
            "A 16000 Caution VsmStatus 7 new",
            "B 16000 Caution VsmStatus 7 new",
            "B 17000 4 Received",
        ],
    );
    let trace = scene.ended("A 14000 Aborted");
    assert_trace(
        &trace,
        &[
            // 3: how the upload ended, and the answer to the load.
            "disk save plan-1b000101.json Process",
            "disk remove plan-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            // 14: the handover, and the answers to both parties.
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            "disk append commands-1b0000a0.log Process",
            "disk append commands-1b0000a1.log Process",
            // Control has changed: what A had sent is dropped.
            "disk save plan-1b000101.json Process",
            // 3: the load has failed.
            "A 14000 Aborted",
            "A 17000 13000 Refused",
            "A 16000 Caution VsmStatus 9 new",
            // 14: the rights of both, the end of the handover, and the answers that waited for it.
            "A 2 granted 0x03",
            "B 2 granted 0x0d",
            "B 5",
            "A 35000 Successful",
            "B 35000 Successful",
            "A 16000 Caution VsmStatus 10 new",
            "B 16000 Caution VsmStatus 10 new",
            "A 2 granted 0x03",
            "A 17000 4 CarriedOut",
            "B 2 granted 0x0d",
            "B 17000 4 CarriedOut",
            // 14: what a new listener needs.
            "B 3",
            "B 16000 Nominal Comms 4 new",
            "B 16000 Warning Comms 8 new",
            // 15: what is pushed.
            "A 16002",
            "B 3001",
            "B 3002",
            "B 16002",
            // 14: what A had sent is dropped.
            "A 16000 Nominal VsmStatus 11 new",
            "B 16000 Nominal VsmStatus 11 new",
            // 1: the link, and the end of the transfer.
            "mav HEARTBEAT",
            "mav MISSION_ACK",
        ],
    );
}
