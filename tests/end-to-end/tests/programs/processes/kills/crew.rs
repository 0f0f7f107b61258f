//! One vehicle with its bridge and its agent, and two stations that work it without a pause while processes are killed.
//!
//! Stations are sessions of the `cucs` crate on sockets of their own; each order is repeated until its end is known, over
//! any number of kills. [`Crew::pump`] is where time passes: whatever waits, waits there, and there the kill comes.

use std::net::UdpSocket;
use std::time::{Duration, Instant};

use kit::Random;
use kit::bridge::{Faults, Station, Ticket, cucs, orders, vehicle_id};
use kit::process::Running;
use kit::relay::Relay;
use mavlink_link::Now;
use serde_json::Value;
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, LoiBitmap, MissionPlanMode, RequestedAccess,
};
use stanag_msgs::messages::{CucsAuthorisationRequest, PositiveHandoverAuthorisationRequest};
use stanag_msgs::{Id, Message};

use super::super::field::Field;
use super::model::{OneOf, Orders, Place, Plan, place_of};
use super::tap::Tap;
use super::{Kill, Victim};

/// A ground station on a socket.
struct Ground {
    station: Station,
    socket: UdpSocket,
}

pub(super) struct Crew {
    field: Field,
    bridge: Option<Running>,
    agent: Option<Running>,
    _aircraft: Running,
    _relay: Relay,
    tap: Tap,
    grounds: [Ground; 2],
    /// Waits, at times, until a key is on its way: some seconds each.
    waits_for_keys: bool,
    random: Random,
    began: Instant,
    kill_at: Option<Instant>,
    doing: &'static str,
    /// Who has LOI 4 and 5.
    owner: OneOf<Option<usize>>,
    /// What the next load loads: what was sent since the last, to what that stored.
    plan: Plan,
    /// What a load has stored.
    stored: Plan,
    /// The vehicle has a mission that was acknowledged as loaded.
    loaded: bool,
    orders: Orders,
    /// What was killed and when.
    pub(super) kills: Vec<Kill>,
    /// What must not be.
    pub(super) faults: Vec<String>,
    /// What happened, for whoever looks for the cause of a fault.
    pub(super) history: Vec<String>,
    /// Orders and requests by how they ended.
    pub(super) carried_out: usize,
    pub(super) refused: usize,
    /// The longest time until link and keys were in order again.
    pub(super) longest: Duration,
    /// Key ids that both ends had in force after a kill.
    pub(super) keys: Vec<Value>,
}

impl Crew {
    /// Starts everything: paired, with a key agreed, the vehicle on the ground.
    pub(super) fn start(seed: u64, waits_for_keys: bool) -> Crew {
        // A key is old after some seconds: on the ground another is agreed on all the time, in flight one waits.
        let field = Field::with_tables(r#", exchange = "on", rotate_days = 0.0001"#, TABLES);
        let tap = Tap::default();
        let px4 = format!("127.0.0.1:{}", field.px4);
        let relay = Relay::observed(&px4, Faults::NONE, seed, tap.observer());
        let aircraft = field.aircraft_behind(&relay.address(), "10");
        let agent = Some(field.agent());
        field.pair();
        let bridge = Some(field.bridge());
        field.wait_until_signed();
        let grounds = [cucs(0), OTHER].map(|id| {
            let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
            socket.set_nonblocking(true).expect("it need not block");
            let own = socket.local_addr().expect("its address");
            let station = Station::new(id, own);
            Ground { station, socket }
        });
        let mut orders = Orders::default();
        orders.run_begins();
        Crew {
            field,
            bridge,
            agent,
            _aircraft: aircraft,
            _relay: relay,
            tap,
            grounds,
            waits_for_keys,
            random: Random::with_seed(seed),
            began: Instant::now(),
            kill_at: None,
            doing: "",
            owner: OneOf::just(None),
            plan: Plan::new(),
            stored: Plan::new(),
            loaded: false,
            orders,
            kills: Vec::new(),
            faults: Vec::new(),
            history: Vec::new(),
            carried_out: 0,
            refused: 0,
            longest: Duration::ZERO,
            keys: Vec::new(),
        }
    }

    /// One kill, at a random moment of something random, and all that must be so afterwards.
    pub(super) fn survive_one(&mut self) {
        // Most things take milliseconds: without the short ones it would nearly always be between two of them.
        let longest = [6, 60, 600, 2_000][self.random.usize(0..4)];
        if self.waits_for_keys && self.random.u8(0..4) == 0 && !self.airborne() {
            self.wait(Duration::from_secs(10), |crew| crew.is_between_keys());
        }
        let new_key = self.is_between_keys() && !self.airborne();
        let after = Duration::from_millis(self.random.u64(0..longest));
        self.kill_at = Some(Instant::now() + after);
        if new_key {
            self.doing = "on the ground, a new key on its way";
            self.wait(after * 2, |crew| crew.kill_at.is_none());
        }
        while self.kill_at.is_some() {
            self.act();
        }
        self.check();
    }

    /// A key is agreed on at one end or both, and not in force yet.
    fn is_between_keys(&self) -> bool {
        let next = |side: &str| self.field.path(&format!("{side}/uav1.key.next")).exists();
        next("ground") || next("air")
    }

    /// SETUP_SIGNINGs that the vehicle was sent.
    pub(super) fn setups(&self) -> usize {
        self.orders.keys
    }

    fn now(&self) -> Now {
        Now {
            mono: self.began.elapsed(),
            wall: kit::clock::wall(),
        }
    }

    fn pump(&mut self) {
        if self.kill_at.is_some_and(|at| at <= Instant::now()) {
            self.kill();
        }
        let now = self.now();
        let bridge = ("127.0.0.1", self.field.dli);
        for Ground { station, socket } in &mut self.grounds {
            for bytes in station.advance(now) {
                // A bridge that is down makes it fail once.
                let _ = socket.send_to(&bytes, bridge);
            }
            let mut buffer = [0; 2_048];
            for _ in 0..100 {
                match socket.recv_from(&mut buffer) {
                    Ok((length, _)) => station.receive(now, &buffer[..length]),
                    Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => break,
                    Err(_) => {}
                }
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }

    fn wait(&mut self, limit: Duration, mut holds: impl FnMut(&mut Crew) -> bool) -> bool {
        let end = Instant::now() + limit;
        while !holds(self) {
            if Instant::now() >= end {
                return false;
            }
            self.pump();
        }
        true
    }

    fn kill(&mut self) {
        let victim = match self.random.u8(0..10) {
            0..6 => Victim::Bridge,
            6..8 => Victim::Agent,
            _ => Victim::Both,
        };
        if victim != Victim::Agent {
            self.bridge.take().expect("it runs").kill();
        }
        if victim != Victim::Bridge {
            self.agent.take().expect("it runs").kill();
        }
        self.note(format!("kill {victim:?} during {}", self.doing));
        self.kills.push(Kill {
            doing: self.doing,
            victim,
            between_keys: self.is_between_keys(),
        });
        let pause = self.random.u64(30..300);
        std::thread::sleep(Duration::from_millis(pause));
        if self.agent.is_none() {
            self.agent = self.restarted(&["airside"]);
        }
        if self.bridge.is_none() {
            self.orders.run_begins();
            self.bridge = self.restarted(&["run"]);
        }
        // One of four is killed again while what it was doing is taken up.
        let again = self.random.u64(0..4_000);
        let again = (again < 1_000).then(|| Instant::now() + Duration::from_millis(again));
        self.kill_at = again;
    }

    fn restarted(&mut self, program: &[&str]) -> Option<Running> {
        let mut started = self.field.vsm(program);
        if let Err(why) = started.try_wait_for("ready", START) {
            self.faults.push(why);
        }
        Some(started)
    }

    fn airborne(&self) -> bool {
        self.tap.look(|vehicle| vehicle.armed)
    }

    fn send(&mut self, by: usize, message: impl Into<Message>) -> Ticket {
        let now = self.now();
        let message = message.into();
        self.note(format!(
            "{by} sends {}",
            crate::processes::kills::short(&message)
        ));
        self.grounds[by].station.send(now, vehicle_id(0), message)
    }

    fn note(&mut self, what: String) {
        let at = self.began.elapsed().as_secs_f64();
        self.history.push(format!("{at:.3} {what}"));
    }

    /// Waits for the end of a message.
    fn ended(&mut self, by: usize, ticket: Ticket) -> Option<AckType> {
        self.wait(ANSWER, |crew| {
            crew.grounds[by].station.end(ticket).is_some()
        });
        let station = &mut self.grounds[by].station;
        let end = station.end(ticket);
        self.note(format!("{by}: {} ended with {end:?}", self.doing));
        let station = &mut self.grounds[by].station;
        match end {
            Some(AckType::CarriedOut) => self.carried_out += 1,
            Some(_) => self.refused += 1,
            None => {
                station.give_up(ticket);
                let doing = self.doing;
                self.faults
                    .push(format!("{doing}: no answer within {ANSWER:?}"));
            }
        }
        end
    }

    /// Does something that fits.
    fn act(&mut self) {
        let Some(owner) = *self.owner.first() else {
            return self.take_what_is_free();
        };
        match (self.airborne(), self.random.u8(0..10)) {
            (_, 0..3) => self.change_owner(owner),
            (_, 3..5) => self.upload(owner),
            (false, 5..8) | (true, 5..7) => {
                if self.airborne() {
                    self.climb(owner);
                } else {
                    self.launch(owner);
                }
            }
            (true, 7..8) if self.loaded => {
                self.doing = "route begun";
                let ticket = self.send(owner, orders::mode(Mode::Waypoint));
                self.ended(owner, ticket);
            }
            (true, 8..) => self.land(owner),
            // What the programs do by themselves: on the ground, another key.
            _ => {
                self.doing = if self.airborne() { FLIES } else { STANDS };
                let pause = Duration::from_millis(300);
                self.wait(pause, |crew| crew.kill_at.is_none());
            }
        }
    }

    fn launch(&mut self, owner: usize) {
        self.doing = "launch";
        let height_m = self.orders.next_height_m();
        let ticket = self.send(owner, orders::launch(height_m));
        self.fly(owner, ticket, height_m);
    }

    fn climb(&mut self, owner: usize) {
        self.doing = "altitude";
        let height_m = self.orders.next_height_m();
        let ticket = self.send(owner, kit::bridge::flight::hold_at(height_m));
        self.fly(owner, ticket, height_m);
    }

    fn fly(&mut self, by: usize, ticket: Ticket, height_m: f64) {
        self.orders.give(by, ticket, height_m, false);
        let end = self.ended(by, ticket);
        let given = self.orders.given.last_mut().expect("just given");
        given.ended = end.map(|end| (end, Instant::now()));
    }

    fn land(&mut self, owner: usize) {
        self.doing = "landing";
        let ticket = self.send(owner, orders::mode(Mode::AutolandEngage));
        if self.ended(owner, ticket) == Some(AckType::CarriedOut) {
            let down = self.wait(Duration::from_secs(60), |crew| !crew.airborne());
            if !down {
                self.faults
                    .push("a landing was carried out, and nothing landed".to_owned());
            }
        }
    }

    /// Other places for all waypoints, or their load, or both. The load alone shows what became of waypoints that were
    /// sent before a kill.
    fn upload(&mut self, owner: usize) {
        let which = self.random.u8(0..3);
        if which < 2 || self.plan.is_empty() {
            self.send_waypoints(owner);
        }
        if which > 0 {
            self.load(owner);
        }
    }

    fn send_waypoints(&mut self, owner: usize) {
        self.doing = "waypoints sent";
        // With its 13001: what was sent before may have been dropped with the control of its station.
        let ticket = self.send(owner, orders::route(FIRST));
        self.ended(owner, ticket);
        let run = self.orders.run();
        let mut sent = Vec::new();
        for number in (FIRST..=LAST).chain(SPARE) {
            let last = number == LAST || SPARE.contains(&number);
            let next = if last { 0 } else { number + 1 };
            let [north, east] = [(); 2].map(|()| self.random.f64() * 120.0 - 60.0);
            let waypoint = orders::waypoint(number, next, north, east, 20.0);
            let place = place_of(&waypoint);
            let known = self.plan.entry(number);
            let known = known.or_insert_with(|| OneOf::just(NOWHERE));
            let before = known.clone();
            known.or(place);
            sent.push((number, before, place, self.send(owner, waypoint)));
        }
        for (number, before, place, ticket) in sent {
            let answer = self.ended(owner, ticket);
            let cut_off = run != self.orders.run();
            if let Some(known) = self.plan.get_mut(&number) {
                match answer {
                    Some(AckType::CarriedOut) => *known = OneOf::just(place),
                    Some(AckType::Refused) if !cut_off => *known = before,
                    _ => {}
                }
            }
        }
    }

    fn load(&mut self, owner: usize) {
        self.doing = "load";
        self.loaded = false;
        let run = self.orders.run();
        self.judge_commands();
        self.orders.load_begins();
        let ticket = self.send(owner, orders::load());
        let answer = self.ended(owner, ticket);
        self.orders.load_ends();
        self.loaded = answer == Some(AckType::CarriedOut);
        if self.loaded {
            self.check_mission();
            self.stored.clone_from(&self.plan);
        } else if answer != Some(AckType::Refused) || run != self.orders.run() {
            join(&mut self.stored, &self.plan);
        } else {
            // Refused for what is in it, it is dropped.
            join(&mut self.plan, &self.stored);
        }
    }

    /// What was sent and not loaded goes with the control of its station.
    fn drop_sent(&mut self, before: Option<usize>) {
        if !self.owner.clone().is(before) {
            for (number, known) in &mut self.plan {
                let stored = self.stored.get(number).cloned();
                *known = stored.unwrap_or_else(|| OneOf::just(NOWHERE));
            }
        } else if self.owner.is_one_of_several() {
            join(&mut self.plan, &self.stored);
        }
    }

    fn take_what_is_free(&mut self) {
        self.doing = "request of free control";
        let by = self.random.usize(0..2);
        self.request(by, RequestedAccess::Request, None, Some(by));
    }

    fn change_owner(&mut self, owner: usize) {
        let other = 1 - owner;
        match self.random.u8(0..4) {
            0 if other == B => {
                self.doing = "override";
                self.request(other, RequestedAccess::Override, Some(owner), Some(other));
            }
            1 => {
                self.doing = "release";
                self.request(owner, RequestedAccess::Relinquish, Some(owner), None);
            }
            _ => self.hand_over(owner, other),
        }
    }

    /// Message 1, after which `after` is in control if it is carried out.
    fn request(
        &mut self,
        by: usize,
        access: RequestedAccess,
        before: Option<usize>,
        after: Option<usize>,
    ) {
        let run = self.orders.run();
        self.owner.or(after);
        let message = CucsAuthorisationRequest {
            requested_handover_loi: Some(CONTROL),
            requested_handover_access: Some(access),
            ..CucsAuthorisationRequest::default()
        };
        let ticket = self.send(by, message);
        let answer = self.ended(by, ticket);
        let cut_off = run != self.orders.run();
        self.owner.answered(answer, cut_off, before, after);
        self.drop_sent(before);
    }

    /// Requested with message 4, and consented to.
    fn hand_over(&mut self, owner: usize, other: usize) {
        self.doing = "handover";
        let run = self.orders.run();
        self.owner.or(Some(other));
        let acquirer = self.grounds[other].station.id;
        let message = PositiveHandoverAuthorisationRequest {
            requested_handover_loi: Some(CONTROL),
            requesting_cucs_id: Some(acquirer),
            ..PositiveHandoverAuthorisationRequest::default()
        };
        let mark = self.grounds[owner].station.received.len();
        let wish = self.send(other, message.clone());
        self.wait(ANSWER, |crew| {
            let forwarded = crew.grounds[owner].station.received[mark..].iter();
            let mut forwarded = forwarded.filter_map(|(_, _, message)| match message {
                Message::PositiveHandoverAuthorisationRequest(wish) => wish.requesting_cucs_id,
                _ => None,
            });
            forwarded.any(|id| id == acquirer) || crew.grounds[other].station.end(wish).is_some()
        });
        let consent = self.send(owner, message);
        let answer = self.ended(other, wish);
        self.ended(owner, consent);
        let cut_off = run != self.orders.run();
        self.owner
            .answered(answer, cut_off, Some(owner), Some(other));
        self.drop_sent(Some(owner));
    }
}

/// What must be so once the dust has settled.
impl Crew {
    fn check(&mut self) {
        self.doing = "check";
        self.check_keys();
        self.check_owner();
        self.check_plan();
        self.repeat_old_orders();
        if self.random.u8(0..4) == 0 {
            self.command_without_the_right();
        }
        if self.random.u8(0..10) == 0 {
            let mut verify = self.field.vsm(&["audit", "verify"]);
            let status = verify.wait(START);
            if !status.is_some_and(|status| status.success()) {
                self.faults.push(format!("audit: {}", verify.output()));
            }
        }
        self.judge_commands();
        let lost: Vec<_> = self.orders.lost().cloned().collect();
        for order in lost {
            self.faults
                .push(format!("carried out by its answer, never flown: {order:?}"));
        }
    }

    fn judge_commands(&mut self) {
        let commands = self.tap.commands();
        self.faults.extend(self.orders.judge(commands));
    }

    /// One key at both ends, by which the vehicle's frames verify, and of a next one the same at both.
    fn check_keys(&mut self) {
        let from = Instant::now();
        let (mut vehicle, mut air) = (Value::Null, Value::Null);
        let mut look_at = from;
        let agreed = self.wait(LINK, |crew| {
            if Instant::now() < look_at {
                return false;
            }
            (vehicle, air) = (crew.field.vehicle(), crew.field.air());
            look_at = Instant::now() + Duration::from_millis(100);
            let next_keys = [
                &vehicle["link"]["exchange"]["next_key_id"],
                &air["next_key_id"],
            ];
            let next =
                next_keys[0].is_null() || next_keys[1].is_null() || next_keys[0] == next_keys[1];
            let live = vehicle["live"] == true && vehicle["link"]["state"] == "live";
            let link = &vehicle["link"];
            // While the agent waits with another key it names that alone.
            let waits = air["state"] == "waits for disarmed" && !next_keys[1].is_null();
            let same = link["key_id"] == air["key_id"] || waits;
            live && next && link["signed"] == true && same
        });
        self.longest = self.longest.max(from.elapsed());
        if agreed {
            let key = vehicle["link"]["key_id"].clone();
            if self.keys.last() != Some(&key) {
                self.keys.push(key);
            }
        } else {
            self.faults.push(format!(
                "no link with one key within {LINK:?}\n{vehicle:#}\n{air:#}"
            ));
        }
        let loaded = vehicle["mission_items"].is_number();
        if agreed && self.loaded && !loaded {
            self.faults
                .push(format!("the loaded mission is not known: {vehicle:#}"));
        }
    }

    /// Exactly one owner, or nobody, as was acknowledged; by both stations and by the status.
    fn check_owner(&mut self) {
        let held = [A, B].map(|station| {
            self.held(station)
                .is_some_and(|loi| loi.intersects(CONTROL))
        });
        let owner = match held {
            [false, false] => None,
            [true, false] => Some(A),
            [false, true] => Some(B),
            [true, true] => {
                self.faults.push("two have control".to_owned());
                return;
            }
        };
        let expected = self.owner.clone();
        if !self.owner.is(owner) {
            self.faults
                .push(format!("{owner:?} is in control, expected {expected:?}"));
        }
        let status = self.field.vehicle();
        let name = owner.map(|owner| self.grounds[owner].station.id.to_string());
        if status["controller"].as_str() != name.as_deref() {
            self.faults
                .push(format!("the status has another controller: {status:#}"));
        }
    }

    /// What message 2 says that a station has.
    fn held(&mut self, by: usize) -> Option<LoiBitmap> {
        for _ in 0..10 {
            let (now, key) = (self.now(), (vehicle_id(0), 2));
            let station = &mut self.grounds[by].station;
            station.latest.remove(&key);
            let question = CucsAuthorisationRequest::default();
            station.send_once(now, vehicle_id(0), question.into());
            self.wait(Duration::from_secs(1), |crew| {
                crew.grounds[by].station.latest.contains_key(&key)
            });
            let held = self.grounds[by]
                .station
                .last(key.0, 2, |message| match message {
                    Message::VsmAuthorisationResponse(response) => response.loi_granted,
                    _ => None,
                });
            if held.is_some() {
                return held;
            }
        }
        self.faults.push(format!("station {by} is not answered"));
        None
    }

    /// Waypoints as they were loaded, though no route leads to them. What was acknowledged since is seen at the next load,
    /// as the others are.
    fn check_plan(&mut self) {
        let Some(owner) = *self.owner.first() else {
            return;
        };
        let known = |number: &u16| self.stored.contains_key(number);
        let numbers: Vec<u16> = SPARE.filter(known).collect();
        for number in numbers {
            let mark = self.grounds[owner].station.received.len();
            let mut request = orders::transfer(MissionPlanMode::DownloadWaypoint);
            request.waypoint_number = Some(number);
            let ticket = self.send(owner, request);
            let answer = self.ended(owner, ticket);
            let reported = |crew: &Crew| {
                let received = crew.grounds[owner].station.received[mark..].iter();
                let mut places = received.filter_map(|(_, _, message)| match message {
                    Message::UaPositionWaypoint(one) if one.waypoint_number == Some(number) => {
                        Some(place_of(one))
                    }
                    _ => None,
                });
                places.next()
            };
            if answer == Some(AckType::CarriedOut) {
                self.wait(Duration::from_secs(5), |crew| reported(crew).is_some());
            }
            let place = reported(self).unwrap_or(NOWHERE);
            let known = self.stored.get_mut(&number).expect("one of them");
            let expected = known.clone();
            if !known.is(place) {
                self.faults.push(format!(
                    "waypoint {number} is {place:?}, acknowledged {expected:?}"
                ));
            }
        }
    }

    /// The vehicle has the places of the plan.
    fn check_mission(&mut self) {
        let mission = self.tap.look(|vehicle| vehicle.mission.clone());
        for (number, known) in self.plan.range_mut(FIRST..=LAST) {
            let expected = known.clone();
            let near = |place: &Place| {
                let (Some(latitude), Some(longitude)) = *place else {
                    return false;
                };
                mission.iter().any(|(north, east)| {
                    (north - latitude.degrees()).abs() < 3e-7
                        && (east - longitude.degrees()).abs() < 3e-7
                })
            };
            if !known.is_one_that(near) {
                self.faults.push(format!(
                    "waypoint {number} at {expected:?} was loaded, the vehicle has {mission:?}"
                ));
            }
        }
    }

    /// Recorded orders, byte for byte: answered as before. That they move nothing is seen by [`Orders::judge`].
    fn repeat_old_orders(&mut self) {
        for _ in 0..2 {
            let ended = self.orders.given.iter().rev().take(20);
            let ended: Vec<_> = ended
                .filter(|order| order.ended.is_some())
                .cloned()
                .collect();
            let Some(order) = self.random.choice(&ended) else {
                return;
            };
            let (by, ticket) = (order.station, order.ticket);
            let before = self.grounds[by].station.answers(ticket).len();
            self.grounds[by].station.repeat(ticket);
            self.wait(Duration::from_secs(5), |crew| {
                crew.grounds[by].station.answers(ticket).len() > before
            });
            let answers = self.grounds[by].station.answers(ticket);
            let first = order.ended.map(|(end, _)| end);
            if let Some(later) = answers.get(before..).and_then(<[_]>::last)
                && Some(*later) != first
            {
                let answers = answers.to_vec();
                self.faults
                    .push(format!("answered otherwise: {order:?}, {answers:?}"));
            }
        }
    }

    fn command_without_the_right(&mut self) {
        let Some(owner) = *self.owner.first() else {
            return;
        };
        let other = 1 - owner;
        let height_m = self.orders.next_height_m();
        let ticket = self.send(other, kit::bridge::flight::hold_at(height_m));
        self.orders.give(other, ticket, height_m, true);
        let end = self.ended(other, ticket);
        let given = self.orders.given.last_mut().expect("just given");
        given.ended = end.map(|end| (end, Instant::now()));
        if end == Some(AckType::CarriedOut) {
            self.faults
                .push("a command without the right to was carried out".to_owned());
        }
    }
}

const A: usize = 0;
/// May override, of a higher rank.
const B: usize = 1;
const OTHER: Id = Id(0x1b00_00b0);
const TABLES: &str = r#"
[[cucs]]
id = "1b:00:00:b0"
loi = [2, 3, 4, 5]
override = true
rank = 1
"#;
const CONTROL: LoiBitmap = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
const NOWHERE: Place = (None, None);
/// Each may be what it may be in another plan.
fn join(plan: &mut Plan, other: &Plan) {
    for (number, known) in other {
        let mine = plan.entry(*number);
        mine.or_insert_with(|| OneOf::just(NOWHERE)).or_all(known);
    }
}

/// Waypoints of the plan.
const FIRST: u16 = 101;
const LAST: u16 = 105;
/// Waypoints that no route leads to.
const SPARE: core::ops::RangeInclusive<u16> = 201..=203;
const FLIES: &str = "in flight, nothing under way";
const STANDS: &str = "on the ground, nothing under way";
/// A command is answered within 40 s, and a kill or two may come between.
const ANSWER: Duration = Duration::from_secs(90);
const START: Duration = Duration::from_secs(30);
/// Within which link and keys are in order again, on a machine that does other things beside.
const LINK: Duration = Duration::from_secs(60);
