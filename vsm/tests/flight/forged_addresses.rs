//! Anyone can write any address as the source of a datagram. Nobody is flooded by what is sent there, and no CUCS loses its
//! status, its control or its aircraft to it. The attackers here send what they like and receive nothing.
#![allow(
    clippy::print_stdout,
    reason = "the figures of docs/guide/security-design.md, shown by --no-capture"
)]

use std::net::SocketAddr;

use kit::bridge::{Rig, Setup, Station, VSM, cucs, orders, station_address, vehicle_id};
use kit::clock::START;
use stanag_msgs::enums::{
    AckType, ConfigRequestType, FlightPathControlMode as Mode, LoiBitmap, MissionPlanMode,
    MissionTransferStatus, RequestedAccess,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, FieldConfigurationRequest, GenericInformationRequestMessage,
    Heartbeat, MessageAcknowledgement, ParameterRequest, PingRequest,
    PositiveHandoverAuthorisationRequest, ScheduleMessageUpdateCommand, VsmAuthorisationResponse,
};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};

/// Who has not asked for any of it.
const VICTIM: SocketAddr = SocketAddr::new(
    std::net::IpAddr::V4(std::net::Ipv4Addr::new(192, 0, 2, 7)),
    7,
);

/// A datagram in the name of a CUCS.
fn forged(rig: &Rig, from: Id, to: Id, message: impl Into<Message>) -> Vec<u8> {
    let mut message = message.into();
    let stamp = TimeStamp::from_unix_ms(rig.station_now().wall.as_millis() as u64);
    stamp_message(&mut message, stamp);
    let mut bytes = [0; MAX_DATAGRAM];
    let envelope = Envelope::new(from, to).requesting_ack();
    let length = message.encode(&envelope, &mut bytes).expect("it fits");
    bytes[..length].to_vec()
}

fn stamp_message(message: &mut Message, stamp: TimeStamp) {
    match message {
        Message::Heartbeat(m) => m.time_stamp = Some(stamp),
        Message::CucsAuthorisationRequest(m) => m.time_stamp = Some(stamp),
        Message::ScheduleMessageUpdateCommand(m) => m.time_stamp = Some(stamp),
        Message::GenericInformationRequestMessage(m) => m.time_stamp = Some(stamp),
        Message::VehicleOperatingModeCommand(m) => m.time_stamp = Some(stamp),
        Message::PingRequest(m) => m.time_stamp = Some(stamp),
        Message::MissionTransferCommand(m) => m.time_stamp = Some(stamp),
        // Without a stamp: the shortest.
        _ => {}
    }
}

fn request(levels: LoiBitmap, access: RequestedAccess) -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_loi: Some(levels),
        requested_handover_access: Some(access),
        ..CucsAuthorisationRequest::default()
    }
}

fn monitor() -> CucsAuthorisationRequest {
    request(LoiBitmap::LOI2, RequestedAccess::Request)
}

fn everything() -> CucsAuthorisationRequest {
    let all = LoiBitmap::LOI2
        .union(LoiBitmap::LOI4)
        .union(LoiBitmap::LOI5);
    request(all, RequestedAccess::Request)
}

fn discovery() -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        vsm_id: Some(Id::BROADCAST),
        ..CucsAuthorisationRequest::default()
    }
}

fn configure() -> FieldConfigurationRequest {
    FieldConfigurationRequest {
        request_type: Some(ConfigRequestType::Loi4),
        ..FieldConfigurationRequest::default()
    }
}

fn schedule(message: u16, hertz: u16) -> ScheduleMessageUpdateCommand {
    ScheduleMessageUpdateCommand {
        requested_message_type: Some(message),
        frequency: Some(hertz),
        ..ScheduleMessageUpdateCommand::default()
    }
}

/// Lets these arrive from an address, 20 ms apart; how many bytes they are.
fn attack(rig: &mut Rig, from: SocketAddr, datagrams: &[Vec<u8>]) -> u64 {
    for bytes in datagrams {
        rig.deliver_from(from, bytes);
        rig.run(0.02);
    }
    datagrams.iter().map(|bytes| bytes.len() as u64).sum()
}

/// One forged message; how many bytes it has.
fn strike(rig: &mut Rig, from: SocketAddr, id: Id, to: Id, message: impl Into<Message>) -> u64 {
    let bytes = forged(rig, id, to, message);
    attack(rig, from, &[bytes])
}

fn sent_to(rig: &Rig, address: SocketAddr) -> u64 {
    rig.sent_to.get(&address).map_or(0, |(_, bytes)| *bytes)
}

/// A vehicle with its parameters read, and stations that have not sent anything yet.
fn idle(stations: u8) -> Rig {
    let mut rig = Rig::new(Setup {
        stations,
        ..Setup::default()
    });
    rig.run(9.0);
    rig
}

/// What a stranger can have sent to others, message by message: each sequence is sent once, in the name of a CUCS of the
/// configuration that is not there, and what goes to the victim within a minute is counted.
#[test]
fn an_address_that_has_not_answered_is_sent_three_times_what_it_sent_at_most() {
    let vehicle = vehicle_id(0);
    let schedules = || [3001, 3002, 4000, 4001, 16002, 101].map(|report| schedule(report, 100));
    type Sequence = fn(&Rig) -> Vec<Vec<u8>>;
    let sequences: Vec<(&str, Sequence)> = vec![
        ("40000 to the vehicle", |rig| {
            vec![forged(rig, cucs(0), vehicle_id(0), configure())]
        }),
        ("40000 to everybody", |rig| {
            vec![forged(rig, cucs(0), Id::BROADCAST, configure())]
        }),
        ("40000 to the VSM", |rig| {
            vec![forged(rig, cucs(0), VSM, configure())]
        }),
        ("discovery", |rig| {
            vec![forged(rig, cucs(0), Id::BROADCAST, discovery())]
        }),
        ("1 for LOI 2", |rig| {
            vec![forged(rig, cucs(0), vehicle_id(0), monitor())]
        }),
        ("16002", |rig| {
            vec![forged(rig, cucs(0), VSM, Heartbeat::default())]
        }),
        ("something of a vehicle only", |rig| {
            let alert = stanag_msgs::messages::SubsystemStatusAlert::default();
            vec![forged(rig, cucs(0), vehicle_id(0), alert)]
        }),
        ("4 that offers nothing", |rig| {
            let offer = PositiveHandoverAuthorisationRequest::default();
            vec![forged(rig, cucs(0), vehicle_id(0), offer)]
        }),
    ];
    let with_rights: Vec<(&str, Vec<Message>)> = vec![
        ("17001", schedules().map(Message::from).to_vec()),
        (
            "17002",
            [101, 3001, 4000, 21001, 41003, 44000, 50013]
                .map(|message_type| {
                    Message::from(GenericInformationRequestMessage {
                        message_type: Some(message_type),
                        ..GenericInformationRequestMessage::default()
                    })
                })
                .to_vec(),
        ),
        ("50010", vec![ParameterRequest::default().into()]),
        ("50014", vec![PingRequest::default().into()]),
        (
            "13000 download",
            vec![orders::transfer(MissionPlanMode::from_raw(3)).into()],
        ),
        ("40000", vec![configure().into()]),
    ];
    let mut table = Vec::new();
    for (name, sequence) in sequences {
        let mut rig = idle(1);
        let datagrams = sequence(&rig);
        let paid = attack(&mut rig, VICTIM, &datagrams);
        rig.run(60.0);
        table.push((name, paid, sent_to(&rig, VICTIM)));
    }
    for (name, messages) in with_rights {
        let mut rig = idle(1);
        // A plan that can be downloaded was stored by another.
        let mut paid = strike(&mut rig, VICTIM, cucs(0), vehicle, everything());
        for message in messages {
            let datagram = forged(&rig, cucs(0), vehicle, message);
            paid += attack(&mut rig, VICTIM, &[datagram]);
        }
        rig.run(60.0);
        table.push((name, paid, sent_to(&rig, VICTIM)));
    }
    for (name, paid, sent) in &table {
        let factor = *sent as f64 / *paid as f64;
        println!("{name:30} {paid:6} bytes in, {sent:8} out: {factor:8.1} times");
    }
    for (name, paid, sent) in table {
        assert!(sent <= 3 * paid, "{name}: {sent} bytes for {paid}");
    }
}

/// The same over a long time: neither heartbeats in its name, nor acknowledgements that guess, prove an address.
#[test]
fn neither_heartbeats_nor_guesses_prove_an_address() {
    let mut rig = idle(1);
    let vehicle = vehicle_id(0);
    let mut paid = strike(&mut rig, VICTIM, cucs(0), vehicle, everything());
    for round in 0..300_u64 {
        let mut datagrams = vec![forged(&rig, cucs(0), VSM, Heartbeat::default())];
        let now = TimeStamp::from_unix_ms(rig.station_now().wall.as_millis() as u64);
        datagrams.extend((0..20).map(|guess| {
            let answer = MessageAcknowledgement {
                time_stamp: Some(now),
                original_message_time_stamp: Some(TimeStamp(now.0 - (guess * 37 + round) % 4096)),
                original_message_type: Some(Heartbeat::ID),
                acknowledgement_type: Some(AckType::CarriedOut),
            };
            forged(&rig, cucs(0), VSM, answer)
        }));
        paid += attack(&mut rig, VICTIM, &datagrams);
    }
    let sent = sent_to(&rig, VICTIM);
    assert!(sent <= 3 * paid, "{sent} bytes for {paid}");
    let status = rig
        .bridge
        .as_ref()
        .expect("it runs")
        .status(String::new(), rig.now().mono);
    let json = serde_json::to_value(&status).expect("it serialises");
    assert_eq!(json["stations"][0]["proof"], "none", "{json}");
    // Once the station itself comes, it is there within its first round trips.
    rig.done(orders::request_control());
    let before = sent_to(&rig, rig.station().address);
    rig.run(5.0);
    assert!(sent_to(&rig, rig.station().address) > before + 1_500);
}

/// A restart of the bridge does not believe what it did not believe before.
#[test]
fn a_restart_sends_no_status_to_an_address_that_was_never_proven() {
    let mut rig = idle(1);
    let mut paid = strike(&mut rig, VICTIM, cucs(0), vehicle_id(0), everything());
    paid += strike(&mut rig, VICTIM, cucs(0), VSM, Heartbeat::default());
    for _ in 0..3 {
        rig.restart_bridge();
        rig.run(20.0);
    }
    let sent = sent_to(&rig, VICTIM);
    assert!(sent <= 3 * paid, "{sent} bytes for {paid}");
    // Nor did its heartbeat make silence count.
    assert_eq!(
        rig.log
            .iter()
            .filter(|line| line.text.contains("is lost"))
            .count(),
        0
    );
}

/// Ten thousand invented addresses and all ids, beside a station in control.
#[test]
fn invented_addresses_drive_no_honest_station_out() {
    let mut rig = Rig::ready_with(Setup {
        stations: 3,
        ..Setup::default()
    });
    rig.stations[0].heartbeats = true;
    rig.take_off(20.0);
    let honest = rig.station().address;
    let mut paid = 0;
    let mut invented = Vec::new();
    for number in 0..10_000_u32 {
        let [_, a, b, c] = number.to_be_bytes();
        let from = SocketAddr::from(([10, a, b, c], 4_000));
        invented.push(from);
        let id = cucs(number as usize % 3);
        let datagram = match number % 3 {
            0 => forged(&rig, id, vehicle_id(0), configure()),
            1 => forged(&rig, id, vehicle_id(0), everything()),
            _ => forged(&rig, id, Id::BROADCAST, discovery()),
        };
        paid += datagram.len() as u64;
        rig.deliver_from(from, &datagram);
        if number % 10 == 0 {
            rig.run(0.01);
        }
        if number == 5_000 {
            // A station that begins in the middle of it is served.
            let now = rig.station_now();
            let mut late = Station::new(cucs(1), station_address(1));
            late.heartbeats = true;
            late.send(now, vehicle_id(0), monitor().into());
            rig.stations[1] = late;
        }
    }
    rig.run(5.0);
    let sent: u64 = invented.iter().map(|from| sent_to(&rig, *from)).sum();
    assert!(sent <= 3 * paid, "{sent} bytes for {paid}");
    for from in &invented {
        assert!(sent_to(&rig, *from) <= 3 * 64, "{from}");
    }
    for index in [0, 1] {
        let last = rig.stations[index].received.last().expect("something").0;
        assert!(
            rig.clock.elapsed() - last < std::time::Duration::from_secs(1),
            "{index}"
        );
    }
    assert!(sent_to(&rig, honest) > 0);
    rig.done(orders::mode(Mode::Loiter));
}

/// One machine that speaks for every id gets no more than three times what it sends for all of them.
#[test]
fn many_ids_from_one_address_share_its_allowance() {
    let mut rig = idle(8);
    let datagrams: Vec<_> = (0..8)
        .map(|index| forged(&rig, cucs(index), vehicle_id(0), configure()))
        .collect();
    let paid = attack(&mut rig, VICTIM, &datagrams);
    // Several messages in one datagram too.
    let paid = paid + attack(&mut rig, VICTIM, &[datagrams.concat()[..].to_vec()]);
    rig.run(10.0);
    assert!(sent_to(&rig, VICTIM) <= 3 * paid);
}

/// One datagram in the controller's name: its status stays where it is, and nothing is commanded.
#[test]
fn what_comes_in_the_controllers_name_from_elsewhere_moves_and_commands_nothing() {
    for acknowledges in [true, false] {
        let mut rig = Rig::new(Setup::default());
        rig.stations[0].acknowledges = acknowledges;
        rig.stations[0].heartbeats = true;
        rig.run(9.0);
        rig.done(orders::request_control());
        rig.take_off(20.0);
        let flown = rig.vehicles[0].vehicle().truth();
        let mut paid = 0;
        for _ in 0..30 {
            let release = request(LoiBitmap::LOI4, RequestedAccess::Relinquish);
            let datagrams = [
                forged(&rig, cucs(0), VSM, Heartbeat::default()),
                forged(
                    &rig,
                    cucs(0),
                    vehicle_id(0),
                    orders::mode(Mode::AutolandEngage),
                ),
                forged(&rig, cucs(0), vehicle_id(0), release),
                forged(&rig, cucs(0), vehicle_id(0), configure()),
            ];
            paid += attack(&mut rig, VICTIM, &datagrams);
            rig.run(0.4);
        }
        assert!(sent_to(&rig, VICTIM) <= 3 * paid, "{acknowledges}");
        let now = rig.vehicles[0].vehicle().truth();
        assert!(
            (now.position.d - flown.position.d).abs() < 2.0,
            "it landed: {acknowledges}"
        );
        let last = rig.station().received.last().expect("something").0;
        let silent = rig.clock.elapsed() - last;
        assert!(
            silent.as_secs_f64() < 1.5,
            "{acknowledges}: no status for {silent:?}"
        );
        rig.done(orders::mode(Mode::Loiter));
    }
}

/// An honest controller that restarts on another port is back within seconds, whether it acknowledges or not.
#[test]
fn a_controller_that_restarts_on_another_port_is_back_within_seconds() {
    for (acknowledges, within) in [(true, 1.0), (false, 5.0)] {
        let mut rig = Rig::new(Setup::default());
        rig.stations[0].acknowledges = acknowledges;
        rig.stations[0].heartbeats = true;
        rig.run(9.0);
        rig.done(orders::request_control());
        rig.take_off(20.0);
        let elsewhere = SocketAddr::from(([127, 0, 0, 1], 41_234));
        let mut again = Station::new(cucs(0), elsewhere);
        again.acknowledges = acknowledges;
        again.heartbeats = true;
        rig.stations[0] = again;
        let ticket = rig.send(orders::mode(Mode::Loiter));
        let answered = rig.until(within, |rig| rig.station().end(ticket).is_some());
        assert!(
            answered,
            "{acknowledges}: {:?}",
            rig.station().answers(ticket)
        );
        assert_eq!(rig.station().end(ticket), Some(AckType::CarriedOut));
        assert!(rig.until(2.0, |rig| {
            rig.station().latest.contains_key(&(vehicle_id(0), 4000))
        }));
    }
}

/// Lets one computer send a thousand heartbeats a second in the name of a CUCS, each from another port, until `so` is true; returns
/// false after `limit` seconds.
fn flood_until(rig: &mut Rig, id: Id, limit: f64, so: impl Fn(&Rig) -> bool) -> bool {
    let beat = forged(rig, id, VSM, Heartbeat::default());
    for tick in 0..(limit * 100.0) as u16 {
        if so(rig) {
            return true;
        }
        for port in 0..10 {
            let from = SocketAddr::from(([127, 0, 0, 9], 2_000 + 10 * tick + port));
            rig.deliver_from(from, &beat);
        }
        rig.run(0.01);
    }
    so(rig)
}

/// The same beside somebody on another computer who uses its name.
#[test]
fn a_flood_from_ever_other_ports_keeps_no_controller_out_that_restarts_on_another_port() {
    for acknowledges in [true, false] {
        let mut rig = Rig::new(Setup::default());
        rig.stations[0].acknowledges = acknowledges;
        rig.stations[0].heartbeats = true;
        rig.run(9.0);
        rig.done(orders::request_control());
        rig.take_off(20.0);
        flood_until(&mut rig, cucs(0), 2.0, |_| false);
        let elsewhere = SocketAddr::from(([127, 0, 0, 1], 41_234));
        let mut again = Station::new(cucs(0), elsewhere);
        again.acknowledges = acknowledges;
        again.heartbeats = true;
        rig.stations[0] = again;
        let ticket = rig.send(orders::mode(Mode::Loiter));
        flood_until(&mut rig, cucs(0), 5.0, |rig| {
            rig.station().end(ticket).is_some()
        });
        let end = rig.station().end(ticket);
        assert_eq!(end, Some(AckType::CarriedOut), "{acknowledges}");
    }
}

#[test]
fn a_flood_from_ever_other_ports_keeps_no_station_out_that_comes_for_the_first_time() {
    let mut rig = idle(1);
    flood_until(&mut rig, cucs(0), 2.0, |_| false);
    let ticket = rig.send(orders::request_control());
    let is_there = |rig: &Rig| rig.station().end(ticket).is_some() && proof(rig) == "answered";
    assert!(
        flood_until(&mut rig, cucs(0), 5.0, is_there),
        "{:?}, proof: {}",
        rig.station().answers(ticket),
        proof(&rig)
    );
    assert_eq!(rig.station().end(ticket), Some(AckType::CarriedOut));
}

/// A second program with the id of a CUCS, such as one that only discovers, takes its address for a moment: the first one is
/// asked again with its next message, not half a lease later.
#[test]
fn a_controller_that_returns_to_its_address_is_back_within_seconds() {
    let mut rig = Rig::new(Setup::default());
    rig.stations[0].heartbeats = true;
    rig.run(9.0);
    rig.done(orders::request_control());
    let here = rig.stations[0].address;
    for port in [41_234, here.port()] {
        let mut again = Station::new(cucs(0), SocketAddr::from(([127, 0, 0, 1], port)));
        again.heartbeats = true;
        rig.stations[0] = again;
        let ticket = rig.send(orders::request_control());
        let answered = rig.until(2.0, |rig| rig.station().end(ticket).is_some());
        assert!(answered, "{port}: {:?}", rig.station().answers(ticket));
    }
}

/// The programs of one computer have a port each, and `cucs` another one at each call.
#[test]
fn a_move_to_another_computer_is_logged_and_one_to_another_port_is_not() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    rig.done(orders::request_control());
    let moves = |rig: &Rig| {
        let texts = rig.log.iter().map(|entry| entry.text.as_str());
        texts.filter(|text| text.contains("has moved")).count()
    };
    for (ip, logged) in [([127, 0, 0, 1], 0), ([127, 0, 0, 2], 1)] {
        rig.stations[0] = Station::new(cucs(0), SocketAddr::from((ip, 41_234)));
        let ticket = rig.send(orders::request_control());
        assert!(rig.until(5.0, |rig| rig.station().end(ticket).is_some()));
        assert_eq!(moves(&rig), logged, "{ip:?}");
    }
}

/// A station that acknowledges nothing: everything that it commands is answered, and it sees the aircraft move.
#[test]
fn a_station_that_never_acknowledges_flies() {
    let mut rig = Rig::new(Setup::default());
    rig.stations[0].acknowledges = false;
    rig.stations[0].heartbeats = true;
    rig.run(9.0);
    rig.done(orders::request_control());
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    let count = |rig: &Rig, of: u16| {
        let received = rig.station().received.iter();
        received
            .filter(|(_, _, message)| message.id() == of)
            .count()
    };
    let before = (count(&rig, 4000), count(&rig, 3001));
    rig.run(30.0);
    let (positions, states) = (count(&rig, 4000) - before.0, count(&rig, 3001) - before.1);
    println!("{positions} of 4000 and {states} of 3001 in 30 s");
    assert!(positions >= 10 && states >= 5, "{positions} {states}");
}

/// How a load ended reaches such a station too: its steps leave the allowance for it.
#[test]
fn a_station_that_never_acknowledges_is_sent_how_each_load_ended() {
    let mut rig = Rig::new(Setup::default());
    rig.stations[0].acknowledges = false;
    rig.stations[0].heartbeats = true;
    rig.run(9.0);
    rig.done(orders::request_control());
    rig.send_plan(orders::square());
    for load in 1..=5 {
        let before = rig.station().received.len();
        rig.done(orders::load());
        rig.run(2.5);
        let received = rig.station().received[before..].iter();
        let ended = received.filter(|(_, _, message)| match message {
            Message::MissionUploadDownloadStatus(one) => {
                one.status == Some(MissionTransferStatus::Complete)
            }
            _ => false,
        });
        assert_eq!(ended.count(), 1, "load {load}");
    }
}

/// A CUCS that acknowledges nothing, with or without heartbeats: a single request, with the fewest fields, gets its answer.
#[test]
fn a_single_request_is_answered_though_its_station_never_acknowledges() {
    for heartbeats in [false, true] {
        let mut rig = idle(1);
        rig.stations[0].acknowledges = false;
        rig.stations[0].heartbeats = heartbeats;
        rig.send_once(monitor());
        rig.run(2.0);
        let answers = rig.station().received.iter();
        let answers =
            answers.filter(|(_, _, message)| message.id() == VsmAuthorisationResponse::ID);
        assert!(
            answers.count() > 0,
            "{heartbeats}: {:?}",
            rig.station().received
        );
    }
}

/// A station that sends a heartbeat, finds the vehicle, requests control, and sends nothing more while its answers to the first questions are
/// lost: it is asked again, of what is left of its allowance, and has status. A single short message pays for one question
/// and one answer.
#[test]
fn a_station_whose_first_answers_are_lost_is_asked_again() {
    for lost_s in [0.0, 1.2, 3.0] {
        let mut rig = idle(1);
        rig.stations[0].acknowledges = false;
        rig.send_once(Heartbeat::default());
        rig.send_once(discovery());
        rig.send_once(orders::request_control());
        rig.run(lost_s);
        rig.stations[0].acknowledges = true;
        rig.run(9.0);
        let received = rig.station().received.iter();
        let positions = received.filter(|(_, _, message)| message.id() == 4000);
        assert!(
            positions.count() > 0,
            "{lost_s} s: {:?}",
            rig.station().received
        );
    }
}

/// The operator vouches for the address: no answer is needed, and no other address is taken.
#[test]
fn a_configured_address_counts_as_proven() {
    let mut rig = Rig::new(Setup {
        stations: 0,
        tables: "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.1\"\n",
        ..Setup::default()
    });
    rig.stations.push(Station::new(cucs(0), station_address(0)));
    rig.stations[0].acknowledges = false;
    rig.stations[0].heartbeats = true;
    rig.run(9.0);
    rig.done(orders::request_control());
    let before = sent_to(&rig, station_address(0));
    rig.run(10.0);
    assert!(sent_to(&rig, station_address(0)) > before + 4_000);
    // From another port of it, as after a restart of the station.
    let elsewhere = SocketAddr::from(([127, 0, 0, 1], 41_234));
    rig.stations[0] = Station::new(cucs(0), elsewhere);
    rig.stations[0].acknowledges = false;
    let ticket = rig.send(orders::launch(20.0));
    assert!(rig.until(5.0, |rig| !rig.station().answers(ticket).is_empty()));
}

/// The address of a controller is taken out of its configuration in flight: it stays where it is, and one datagram in its
/// name from elsewhere neither moves it nor commands.
#[test]
fn a_controller_whose_address_nobody_vouches_for_any_more_stays_where_it_is() {
    let vouched = "address = \"127.0.0.1\"\n";
    for acknowledges in [true, false] {
        let mut rig = Rig::new(Setup {
            stations: 0,
            tables: "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.1\"\n",
            ..Setup::default()
        });
        rig.stations.push(Station::new(cucs(0), station_address(0)));
        rig.stations[0].acknowledges = acknowledges;
        rig.stations[0].heartbeats = true;
        rig.run(9.0);
        rig.done(orders::request_control());
        rig.take_off(20.0);
        let text = rig.text.replacen(vouched, "", 1);
        assert_ne!(text, rig.text);
        rig.reload(&text).expect("applied");
        let land = forged(
            &rig,
            cucs(0),
            vehicle_id(0),
            orders::mode(Mode::AutolandEngage),
        );
        let paid = attack(&mut rig, VICTIM, &[land]);
        rig.run(5.0);
        assert!(sent_to(&rig, VICTIM) <= 3 * paid, "{acknowledges}");
        let mode = rig.truth().mode;
        assert_ne!(mode, px4_sim::Mode::Land, "{acknowledges}");
        let last = rig.station().received.last().expect("something").0;
        let silent = rig.clock.elapsed() - last;
        assert!(
            silent.as_secs_f64() < 1.5,
            "{acknowledges}: no status for {silent:?}"
        );
        rig.done(orders::mode(Mode::Loiter));
    }
}

/// Status is a lease: an address from which nothing comes any more is sent nothing, and a CUCS that only listens keeps it.
#[test]
fn status_ends_with_the_lease_and_who_only_listens_keeps_it() {
    let mut rig = Rig::ready();
    let address = rig.station().address;
    rig.run(300.0);
    let last = rig.station().received.last().expect("status").0;
    assert!(
        (rig.clock.elapsed() - last).as_secs_f64() < 1.0,
        "it only listens, and is there"
    );
    // It is gone.
    let gone = rig.stations.remove(0);
    rig.run(100.0);
    let before = sent_to(&rig, address);
    rig.run(300.0);
    assert_eq!(sent_to(&rig, address), before);
    // It is back, with the next thing that it sends, and sees what stands.
    rig.stations.push(gone);
    rig.send_once(Heartbeat::default());
    rig.run(2.0);
    assert!(sent_to(&rig, address) > before + 500);
}

/// What the status says of how station 0 has proved its address.
fn proof(rig: &Rig) -> &'static str {
    let bridge = rig.bridge.as_ref().expect("it runs");
    bridge.status(String::new(), rig.now().mono).stations[0].proof
}

/// This computer starts in 1970, or its clock is set back by ten years three times in flight: stations prove where they are all the
/// same, and none loses what it has proved.
#[test]
fn a_wall_clock_before_2000_keeps_nobody_from_a_proof() {
    const TEN_YEARS_S: f64 = 10.0 * 365.25 * 86_400.0;
    let mut rig = Rig::new(Setup::default());
    rig.clock.set_wall_step(100.0 - START.as_secs_f64());
    rig.restart_bridge();
    rig.stations[0].heartbeats = true;
    rig.run(5.0);
    assert_eq!(proof(&rig), "answered");

    let mut rig = Rig::ready();
    for steps in 1..=3 {
        rig.clock.set_wall_step(-TEN_YEARS_S * f64::from(steps));
        // A proof that is not renewed lasts for two leases.
        rig.run(130.0);
        assert_eq!(proof(&rig), "answered", "{steps} steps back");
    }
    let last = rig.station().received.last().expect("status").0;
    assert!((rig.clock.elapsed() - last).as_secs_f64() < 1.0);
}

/// Heartbeats in the name of a station that left keep nothing going to where it was.
#[test]
fn forged_heartbeats_do_not_renew_the_proof_of_a_station_that_left() {
    let mut rig = Rig::ready();
    let address = rig.station().address;
    rig.run(10.0);
    rig.stations.remove(0);
    for _ in 0..150 {
        let beat = forged(&rig, cucs(0), VSM, Heartbeat::default());
        attack(&mut rig, address, &[beat]);
        rig.run(0.98);
    }
    let before = sent_to(&rig, address);
    let mut paid = 0;
    for _ in 0..30 {
        let beat = forged(&rig, cucs(0), VSM, Heartbeat::default());
        paid += attack(&mut rig, address, &[beat]);
        rig.run(0.98);
    }
    let sent = sent_to(&rig, address) - before;
    // And what was left of the heartbeats before.
    assert!(sent <= 3 * paid + 100, "{sent} for {paid}");
}

/// Who has proved its address is sent no more than the rate either, and its commands are answered all the same.
#[test]
fn a_station_is_sent_no_more_than_its_rate() {
    let mut rig = Rig::ready_with(Setup {
        dli_keys: "max_bytes_s = 10000\n",
        ..Setup::default()
    });
    let address = rig.station().address;
    for report in [3001, 3002, 4000, 4001, 16002, 101, 3004, 3005, 3010, 15000] {
        rig.send(schedule(report, 100));
    }
    rig.run(20.0);
    let before = sent_to(&rig, address);
    rig.run(30.0);
    let a_second = (sent_to(&rig, address) - before) / 30;
    println!("{a_second} bytes a second");
    assert!((5_000..=10_500).contains(&a_second), "{a_second}");
    let ticket = rig.send(orders::launch(20.0));
    assert!(rig.until(2.0, |rig| !rig.station().answers(ticket).is_empty()));
}

/// A forged 16002 neither makes the silence of a CUCS count that sends none, nor hides the silence of one that did.
#[test]
fn forged_heartbeats_neither_arm_nor_feed_the_rule_of_silence() {
    // It never sends heartbeats: it keeps control, however long it is silent.
    let mut rig = Rig::ready();
    let beat = forged(&rig, cucs(0), VSM, Heartbeat::default());
    attack(&mut rig, VICTIM, &[beat]);
    rig.run(30.0);
    assert!(
        !rig.station().has_alert("is lost"),
        "{:?}",
        rig.station().alerts()
    );
    rig.done(orders::launch(20.0));

    // It does, and falls silent: it is lost after 10 s, whatever is sent in its name from elsewhere.
    let mut rig = Rig::ready();
    rig.stations[0].heartbeats = true;
    rig.run(5.0);
    rig.stations[0].heartbeats = false;
    for _ in 0..13 {
        let beat = forged(&rig, cucs(0), VSM, Heartbeat::default());
        attack(&mut rig, VICTIM, &[beat]);
        rig.run(0.98);
    }
    assert!(
        rig.station().has_alert("is lost"),
        "{:?}",
        rig.station().alerts()
    );
}
