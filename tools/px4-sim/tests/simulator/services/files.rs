//! Files, both ends: over a lossy network, against a vehicle that restarts, and against peers that send false
//! answers.

use std::time::Duration;

use kit::network::Faults;
use mavlink::dialects::development::MavMessage;
use mavlink_link::service::ftp::payload::{FtpError, Opcode, Payload};
use mavlink_link::service::ftp::{
    Client, Done, Event, Failure, FilePath, Kind, Lie, MAX_HELD, MAX_UNREAD, Operation, Resume,
    StartError, Timing, crc32,
};
use proptest::prelude::*;
use px4_sim::Files;
use px4_sim::services::ftp::Server;

use super::{PX4, US};
use crate::services::network::{DEAD, End, FAIR, Network, RADIO, WILD};

const START: Duration = Duration::from_secs(5);
const LOG: &str = "/fs/microsd/log/a.ulg";

fn path(text: &str) -> FilePath {
    FilePath::new(text).unwrap()
}

fn read(text: &str) -> Operation {
    let resume = None;
    Operation::Read {
        path: path(text),
        resume,
    }
}

fn content(length: usize) -> Vec<u8> {
    (0..length).map(|at| (at * 7 + at / 251) as u8).collect()
}

fn with_log(length: usize) -> Files {
    let mut files = Files::default();
    files.insert(LOG, content(length));
    files
}

/// Both ends, the network between them, and what the client has delivered.
struct Run {
    client: Client,
    server: Server,
    network: Network,
    now: Duration,
    delivered: Vec<u8>,
    /// Requests that reached the vehicle.
    requests: usize,
}

impl Run {
    fn new(files: Files, faults: Faults, seed: u64) -> Run {
        Run {
            client: Client::new(US, PX4, Timing::default()),
            server: Server::new(PX4, files),
            network: Network::new(seed, faults),
            now: START,
            delivered: Vec::new(),
            requests: 0,
        }
    }

    /// One step of time; the result of the operation, once it has ended.
    fn step(&mut self) -> Option<Result<Done, Failure>> {
        while let Some(message) = self.client.poll_transmit() {
            self.network
                .send_intact(self.now, End::Ground, End::Vehicle, message);
        }
        while let Some(message) = self.server.poll_transmit() {
            self.network
                .send_intact(self.now, End::Vehicle, End::Ground, message);
        }
        while let Some(event) = self.client.poll_event() {
            match event {
                Event::Data(bytes) => self.delivered.extend(bytes),
                Event::Ended(result) => return Some(result),
                Event::Opened { .. } | Event::Written { .. } => {}
            }
        }
        let due = [
            self.client.poll_timeout(),
            self.server.poll_timeout(),
            self.network.next_arrival(),
        ];
        self.now = self.now.max(due.into_iter().flatten().min().unwrap());
        assert!(
            self.now < START + Duration::from_secs(3_000),
            "it does not end"
        );
        while let Some(packet) = self.network.receive(self.now) {
            let message = &packet.payload;
            match packet.to {
                End::Vehicle => {
                    self.requests += 1;
                    self.server.handle_message(self.now, US, message);
                }
                End::Ground => {
                    self.client.handle_message(self.now, PX4, message, true);
                }
            }
        }
        self.client.handle_timeout(self.now);
        self.server.handle_timeout(self.now);
        None
    }

    fn end(&mut self) -> Result<Done, Failure> {
        loop {
            if let Some(result) = self.step() {
                return result;
            }
        }
    }

    fn run(&mut self, operation: Operation) -> Result<Done, Failure> {
        self.delivered.clear();
        self.client.start(self.now, operation).unwrap();
        self.end()
    }

    /// The vehicle restarts: its card keeps its contents.
    fn restart(&mut self) {
        self.server = Server::new(PX4, self.server.files().clone());
    }
}

#[test]
fn a_file_arrives_whole_however_bad_the_network() {
    let bytes = content(150_000);
    let crc = crc32(0, &bytes);
    let reordered = Faults {
        reorder: 0.1,
        ..WILD
    };
    for (faults, seeds) in [(FAIR, 1), (RADIO, 4), (WILD, 4), (reordered, 4)] {
        for seed in 0..seeds {
            let mut run = Run::new(with_log(bytes.len()), faults, seed);
            let ended = run.run(read("@MAV_LOG/a.ulg"));
            let size = bytes.len() as u32;
            assert_eq!(ended, Ok(Done::Read { size, crc }), "{faults:?} {seed}");
            assert!(run.delivered == bytes, "{faults:?} {seed}");
        }
    }
}

#[test]
fn a_good_network_costs_one_request_a_burst() {
    let mut run = Run::new(with_log(500_000), FAIR, 1);
    run.run(read(LOG)).unwrap();
    // 500 000 bytes are 14 bursts of 37 000; opening, closing, the checksum and the first exchange add the rest.
    assert!(run.requests < 40, "{} requests", run.requests);
    assert!(
        run.now - START < Duration::from_secs(3),
        "{:?}",
        run.now - START
    );
}

#[test]
fn what_is_paced_stays_below_its_rate_and_leaves_no_burst() {
    let mut run = Run::new(with_log(40_000), FAIR, 1);
    run.client.limit(Some(8_000));
    run.run(read(LOG)).unwrap();
    let took = (run.now - START).as_secs_f64();
    assert!(
        took > 5.0,
        "40 000 bytes in {took} s are over 8 000 a second"
    );
    assert!(took < 9.0, "{took}");
    assert!(run.delivered == content(40_000));
}

#[test]
fn a_broken_transfer_continues_where_it_broke_off() {
    let mut run = Run::new(with_log(90_000), FAIR, 3);
    run.client.start(run.now, read(LOG)).unwrap();
    while run.delivered.len() < 30_000 {
        assert_eq!(run.step(), None);
    }
    run.client.withdraw();
    assert_eq!(run.end(), Err(Failure::Withdrawn));
    let had = std::mem::take(&mut run.delivered);
    let resume = Some(Resume {
        offset: had.len() as u32,
        crc: crc32(0, &had),
    });
    let path = path(LOG);
    let ended = run.run(Operation::Read {
        path: path.clone(),
        resume,
    });
    assert!(
        matches!(ended, Ok(Done::Read { size: 90_000, .. })),
        "{ended:?}"
    );
    assert_eq!(run.delivered.len(), 90_000 - had.len());
    assert!([had, run.delivered.clone()].concat() == content(90_000));
    // Another file of that name is not resumed.
    let mut other = content(90_000);
    other[0] ^= 1;
    run.server.files_mut().insert(LOG, other);
    let ended = run.run(Operation::Read {
        path: path.clone(),
        resume,
    });
    assert!(matches!(ended, Err(Failure::Checksum { .. })), "{ended:?}");
    run.server.files_mut().insert(LOG, content(20_000));
    let ended = run.run(Operation::Read { path, resume });
    assert!(
        matches!(ended, Err(Failure::Changed { is: 20_000, .. })),
        "{ended:?}"
    );
}

#[test]
fn a_vehicle_that_restarts_in_the_middle_is_read_and_written_to_the_end() {
    for seed in 0..4 {
        let mut run = Run::new(with_log(120_000), WILD, seed);
        run.client.start(run.now, read(LOG)).unwrap();
        while run.delivered.len() < 40_000 {
            assert_eq!(run.step(), None);
        }
        run.restart();
        let ended = run.end();
        assert!(
            matches!(ended, Ok(Done::Read { size: 120_000, .. })),
            "{seed}: {ended:?}"
        );
        assert!(run.delivered == content(120_000));

        let to = "/fs/microsd/etc/extras.txt";
        run.run(Operation::CreateDirectory(path("/fs/microsd/etc")))
            .unwrap();
        let write = Operation::Write {
            path: path(to),
            content: content(20_000),
        };
        run.client.start(run.now, write).unwrap();
        while run
            .server
            .files()
            .get(to)
            .is_none_or(|bytes| bytes.len() < 5_000)
        {
            assert_eq!(run.step(), None);
        }
        run.restart();
        let ended = run.end();
        assert!(
            matches!(ended, Ok(Done::Written { size: 20_000, .. })),
            "{seed}: {ended:?}"
        );
        assert_eq!(run.server.files().get(to), Some(&content(20_000)[..]));
    }
}

#[test]
fn folders_are_listed_made_and_removed() {
    let mut run = Run::new(with_log(10), RADIO, 5);
    for number in 0..60 {
        run.server
            .files_mut()
            .insert(&format!("/fs/microsd/log/{number:03}.ulg"), vec![0; number]);
    }
    let Ok(Done::Listing(entries)) = run.run(Operation::List(path("@MAV_LOG"))) else {
        panic!("no listing");
    };
    let names: Vec<_> = entries
        .iter()
        .map(|entry| (&*entry.name, entry.kind))
        .collect();
    assert_eq!(names.len(), 61);
    assert_eq!(names[59], ("059.ulg", Kind::File(59)));
    let made = "/fs/microsd/made";
    assert_eq!(
        run.run(Operation::CreateDirectory(path(made))),
        Ok(Done::Created)
    );
    let again = run.run(Operation::CreateDirectory(path(made)));
    assert!(again.unwrap_err().to_string().contains("exists already"));
    let write = Operation::Write {
        path: path("/fs/microsd/made/x"),
        content: Vec::new(),
    };
    assert!(matches!(run.run(write), Ok(Done::Written { size: 0, .. })));
    let full = run.run(Operation::RemoveDirectory(path(made))).unwrap_err();
    // The error before it, 17, is kept: as PX4 v1.18 does.
    assert!(full.to_string().contains("not empty"), "{full}");
    assert_eq!(
        run.run(Operation::Remove(path("/fs/microsd/made/x"))),
        Ok(Done::Removed)
    );
    assert_eq!(
        run.run(Operation::RemoveDirectory(path(made))),
        Ok(Done::Removed)
    );
    assert!(run.run(Operation::List(path(made))).is_err());
}

#[test]
fn outside_the_card_nothing_is_written() {
    let mut run = Run::new(Files::default(), FAIR, 1);
    for to in ["/etc/init.d/rcS", "/fs/microsdX"] {
        let write = Operation::Write {
            path: path(to),
            content: vec![1],
        };
        let refused = run.run(write);
        assert!(refused.is_err(), "{to}: {refused:?}");
    }
}

#[test]
fn a_silent_vehicle_ends_it_within_the_bound() {
    let mut run = Run::new(with_log(10), DEAD, 1);
    let ended = run.run(read(LOG)).unwrap_err();
    assert!(
        ended.to_string().contains("no answer to None for 30 s"),
        "{ended}"
    );
    assert_eq!(run.now - START, Duration::from_secs(30));
}

#[test]
fn a_session_of_another_station_is_waited_for_and_not_reset() {
    let mut run = Run::new(with_log(300_000), FAIR, 1);
    let other = mavlink_link::service::Node::new(200, 190);
    let open = Payload::request(9, Opcode::MAV_FTP_OPCODE_OPENFILERO).with_data(LOG.as_bytes());
    run.server
        .handle_message(run.now, other, &open.message(PX4));
    while run.server.poll_transmit().is_some() {}
    run.run(read(LOG)).unwrap();
    // PX4 closes it 10 s after the last request by anybody.
    assert!(
        run.now - START > Duration::from_secs(10),
        "{:?}",
        run.now - START
    );
    assert!(
        run.now - START < Duration::from_secs(20),
        "{:?}",
        run.now - START
    );
}

#[test]
fn an_answer_of_a_former_life_of_this_station_is_not_taken() {
    let mut files = with_log(1_000);
    files.insert("/fs/microsd/log/b.ulg", content(500));
    let mut run = Run::new(files, FAIR, 1);
    let first = Client::new(US, PX4, Timing::default());
    // The numbers that the new client will use, answered for another file.
    let mut probe = first;
    probe.start(run.now, read(LOG)).unwrap();
    let Some(MavMessage::FILE_TRANSFER_PROTOCOL(request)) = probe.poll_transmit() else {
        panic!("nothing sent");
    };
    let seq = Payload::decode(&request.payload).unwrap().seq;
    let open = Payload::request(seq, Opcode::MAV_FTP_OPCODE_OPENFILERO)
        .with_data(b"/fs/microsd/log/b.ulg");
    run.server.handle_message(run.now, US, &open.message(PX4));
    while run.server.poll_transmit().is_some() {}
    assert!(matches!(
        run.run(read(LOG)),
        Ok(Done::Read { size: 1_000, .. })
    ));
    assert!(run.delivered == content(1_000));
}

#[test]
fn a_file_that_changes_meanwhile_is_refused() {
    let mut run = Run::new(with_log(100_000), FAIR, 1);
    run.client.start(run.now, read(LOG)).unwrap();
    while run.delivered.len() < 10_000 {
        assert_eq!(run.step(), None);
    }
    let mut other = content(100_000);
    other[5] ^= 1;
    run.server.files_mut().insert(LOG, other);
    let ended = run.end();
    assert!(matches!(ended, Err(Failure::Checksum { .. })), "{ended:?}");
}

/// Answers requests as a test decides.
fn against(
    operation: Operation,
    mut answer: impl FnMut(&Payload) -> Vec<Payload>,
) -> (Result<Done, Failure>, usize) {
    let mut client = Client::new(US, PX4, Timing::default());
    let mut now = START;
    client.start(now, operation).unwrap();
    let mut delivered = 0;
    loop {
        let mut answers = Vec::new();
        while let Some(message) = client.poll_transmit() {
            let MavMessage::FILE_TRANSFER_PROTOCOL(data) = &message else {
                panic!("{message:?}");
            };
            answers.extend(answer(&Payload::decode(&data.payload).unwrap()));
        }
        for reply in answers {
            client.handle_message(now, PX4, &reply.message(US), true);
        }
        while let Some(event) = client.poll_event() {
            match event {
                Event::Data(bytes) => delivered += bytes.len(),
                Event::Ended(result) => return (result, delivered),
                _ => {}
            }
        }
        now = (now + Duration::from_millis(1)).max(client.poll_timeout().unwrap());
        assert!(now < START + Duration::from_secs(4_000), "it does not end");
        client.handle_timeout(now);
    }
}

fn ack(request: &Payload, data: &[u8]) -> Payload {
    Payload {
        seq: request.seq.wrapping_add(1),
        opcode: Opcode::MAV_FTP_OPCODE_ACK as u8,
        requested: request.opcode,
        ..request.clone().with_data(data)
    }
}

fn nak(request: &Payload, error: FtpError) -> Payload {
    let opcode = Opcode::MAV_FTP_OPCODE_NAK as u8;
    Payload {
        opcode,
        ..ack(request, &[error as u8])
    }
}

/// Opens as if the file had 1 000 bytes; the later answers are those of `lie`.
fn liar(mut lie: impl FnMut(&Payload) -> Vec<Payload>) -> Result<Done, Failure> {
    let (ended, delivered) = against(read(LOG), |request| match request.opcode() {
        Some(Opcode::MAV_FTP_OPCODE_BURSTREADFILE | Opcode::MAV_FTP_OPCODE_READFILE) => {
            lie(request)
        }
        Some(Opcode::MAV_FTP_OPCODE_CALCFILECRC) => vec![ack(request, &[1, 2, 3, 4])],
        _ => vec![ack(request, &1_000_u32.to_le_bytes())],
    });
    assert!(delivered <= 1_000);
    ended
}

#[test]
fn a_peer_that_lies_is_refused_by_name() {
    let at = |offset, data: &[u8]| {
        let data = data.to_vec();
        move |request: &Payload| {
            vec![Payload {
                offset,
                ..ack(request, &data)
            }]
        }
    };
    let lies = [
        (
            liar(at(990, &[0; 11])),
            Lie::BeyondEnd {
                offset: 990,
                length: 11,
                size: 1_000,
            },
        ),
        (
            liar(at(u32::MAX, &[0; 2])),
            Lie::BeyondEnd {
                offset: u32::MAX,
                length: 2,
                size: 1_000,
            },
        ),
        (
            liar(at(0, &[])),
            Lie::BeyondEnd {
                offset: 0,
                length: 0,
                size: 1_000,
            },
        ),
        (
            liar(|request| vec![nak(request, FtpError::MAV_FTP_ERR_EOF)]),
            Lie::EarlyEnd { at: 0, size: 1_000 },
        ),
        (
            liar(|request| {
                let one = Payload {
                    offset: 500,
                    ..ack(request, &[1; 9])
                };
                vec![
                    one.clone(),
                    Payload {
                        seq: one.seq + 1,
                        ..one.with_data(&[2; 9])
                    },
                ]
            }),
            Lie::TwoContents(500),
        ),
        (
            liar(|request| {
                vec![Payload {
                    size: 240,
                    ..ack(request, &[0; 9])
                }]
            }),
            Lie::Size(240),
        ),
    ];
    for (ended, lie) in lies {
        assert_eq!(ended, Err(Failure::Lie(lie)));
    }
    // Complete, but not what the vehicle has.
    let ended = liar(|request| {
        let length = (1_000 - request.offset).min(239) as usize;
        vec![ack(request, &vec![7; length])]
    });
    assert!(
        matches!(
            ended,
            Err(Failure::Checksum {
                vehicle: 0x0403_0201,
                ..
            })
        ),
        "{ended:?}"
    );
    // The same bytes for ever count as no answer.
    let ended = liar(|request| match request.opcode() {
        Some(Opcode::MAV_FTP_OPCODE_BURSTREADFILE) => {
            vec![
                Payload {
                    offset: 300,
                    ..ack(request, &[1; 9])
                };
                3
            ]
        }
        _ => vec![],
    });
    assert!(matches!(ended, Err(Failure::NoAnswer { .. })), "{ended:?}");
    // A session that ends with every request.
    let ended = liar(|request| vec![nak(request, FtpError::MAV_FTP_ERR_INVALIDSESSION)]);
    assert!(matches!(ended, Err(Failure::Unstable(_))), "{ended:?}");
}

#[test]
fn a_listing_that_never_ends_is_refused() {
    let endless = |request: &Payload| match request.opcode() {
        Some(Opcode::MAV_FTP_OPCODE_LISTDIRECTORY) => vec![ack(request, b"Fa\t1\0Db\0")],
        _ => vec![ack(request, &[])],
    };
    let (ended, _) = against(Operation::List(path("/")), endless);
    assert_eq!(ended, Err(Failure::Lie(Lie::Endless(10_000))));
    let (ended, _) = against(Operation::List(path("/")), |request| {
        vec![ack(request, &[])]
    });
    assert_eq!(ended, Err(Failure::Lie(Lie::EmptyListing(0))));
}

#[test]
fn only_one_operation_runs_and_strangers_are_not_believed() {
    let mut client = Client::new(US, PX4, Timing::default());
    client.start(START, read(LOG)).unwrap();
    assert_eq!(client.start(START, read(LOG)), Err(StartError::Busy));
    let Some(message) = client.poll_transmit() else {
        panic!("nothing sent");
    };
    let MavMessage::FILE_TRANSFER_PROTOCOL(data) = &message else {
        panic!("{message:?}");
    };
    let answer = ack(&Payload::decode(&data.payload).unwrap(), &[]);
    let other = mavlink_link::service::Node::new(1, 2);
    assert!(!client.handle_message(START, other, &answer.message(US), true));
    assert!(!client.handle_message(START, PX4, &answer.message(other), true));
    assert!(!client.handle_message(START, PX4, &answer.message(US), false));
    assert_eq!(client.poll_transmit(), None);
    assert!(client.handle_message(START, PX4, &answer.message(US), true));
    assert!(client.poll_transmit().is_some());
}

#[test]
fn a_reader_that_does_not_read_stops_the_requests() {
    let mut run = Run::new(with_log(2_000_000), FAIR, 1);
    run.client.start(run.now, read(LOG)).unwrap();
    // Nothing is read from the client for ten seconds.
    while run.now < START + Duration::from_secs(10) {
        while let Some(message) = run.client.poll_transmit() {
            run.network
                .send_intact(run.now, End::Ground, End::Vehicle, message);
        }
        while let Some(message) = run.server.poll_transmit() {
            run.network
                .send_intact(run.now, End::Vehicle, End::Ground, message);
        }
        run.now += Duration::from_millis(5);
        while let Some(packet) = run.network.receive(run.now) {
            match packet.to {
                End::Vehicle => run.server.handle_message(run.now, US, &packet.payload),
                End::Ground => run
                    .client
                    .handle_message(run.now, PX4, &packet.payload, true),
            };
        }
        run.client.handle_timeout(run.now);
        run.server.handle_timeout(run.now);
    }
    let ended = run.step();
    assert_eq!(ended, None);
    assert!(run.delivered.len() > MAX_UNREAD / 2);
    assert!(
        run.delivered.len() <= MAX_UNREAD + MAX_HELD,
        "{}",
        run.delivered.len()
    );
    assert!(matches!(
        run.end(),
        Ok(Done::Read {
            size: 2_000_000,
            ..
        })
    ));
    assert!(run.delivered == content(2_000_000));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any size, any network with up to a fifth lost: what is reported as read is what the vehicle has, and what is
    /// reported as written is there.
    #[test]
    fn what_is_reported_as_done_is_done(
        seed: u64,
        size in 0_usize..20_000,
        loss in 0.0..0.2_f64,
        duplicate in 0.0..0.2_f64,
        reorder in 0.0..0.2_f64,
        slowest in 1_u64..150,
        rate in prop::option::of(4_000_u32..60_000),
        restart_after in prop::option::of(0_usize..10_000),
    ) {
        let faults = Faults { loss, duplicate, reorder, overtaking: true, ..Faults::NONE }.delayed_ms(1, slowest);
        let mut run = Run::new(with_log(size), faults, seed);
        run.client.limit(rate);
        run.client.start(run.now, read(LOG)).unwrap();
        let mut restart_after = restart_after;
        let ended = loop {
            if let Some(ended) = run.step() {
                break ended;
            }
            if restart_after.is_some_and(|at| run.delivered.len() >= at) {
                restart_after = None;
                run.restart();
            }
        };
        let crc = crc32(0, &content(size));
        prop_assert_eq!(ended, Ok(Done::Read { size: size as u32, crc }));
        prop_assert!(run.delivered == content(size));
        let to = "/fs/microsd/put";
        let ended = run.run(Operation::Write { path: path(to), content: content(size) });
        prop_assert_eq!(ended, Ok(Done::Written { size: size as u32, crc }));
        prop_assert_eq!(run.server.files().get(to), Some(&content(size)[..]));
    }

    /// Whatever a peer sends: no panic, no more data than was announced, and an end.
    #[test]
    fn any_peer_is_survived(
        answers in prop::collection::vec((any::<u8>(), any::<u8>(), any::<u32>(), any::<u8>(), 0_u16..4), 0..200),
        size in 0_u32..5_000,
    ) {
        let mut answers = answers.into_iter();
        let (_, delivered) = against(read(LOG), |request| match request.opcode() {
            Some(Opcode::MAV_FTP_OPCODE_OPENFILERO) => vec![ack(request, &size.to_le_bytes())],
            Some(Opcode::MAV_FTP_OPCODE_NONE) => vec![ack(request, &[])],
            _ => answers
                .next()
                .map(|(kind, length, offset, requested, seq)| Payload {
                    seq: request.seq.wrapping_add(seq),
                    opcode: if kind % 3 == 0 { 129 } else { 128 },
                    requested: if kind % 2 == 0 { request.opcode } else { requested },
                    offset: if kind % 5 == 0 { offset } else { offset % 6_000 },
                    size: length,
                    ..request.clone()
                })
                .into_iter()
                .filter(|answer| answer.size <= 239)
                .collect(),
        });
        prop_assert!(delivered <= size as usize);
    }
}
