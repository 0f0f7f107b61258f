//! A station that sends one message and then only answers, on a network that loses one datagram.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use mavlink_link::Now;
use stanag_msgs::{Id, TimeStamp};

use super::*;
use crate::session::outbox::Destination;

/// Those of the configuration's defaults.
const LIMITS: Limits = Limits {
    lease: Duration::from_secs(60),
    bytes_s: 65_536,
    messages_s: 1_000,
    burst: Duration::from_secs(4),
};
const FROM: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 40_000);

/// How often it has to send until it has proved its address, each time 4 s later, where the datagram of this number is lost:
/// questions and answers are counted in their order.
fn sends(ed25: bool, bytes: usize, lost: usize) -> usize {
    sends_at(Duration::from_secs(1_795_219_200), ed25, bytes, lost)
}

/// The same while the time of stamps is this.
fn sends_at(wall: Duration, ed25: bool, bytes: usize, lost: usize) -> usize {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    // 17000, and #1400.
    let answer = if ed25 { 78 } else { 34 };
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall,
    };
    let mut passed = 0;
    let mut arrives = || {
        passed += 1;
        passed != lost + 1
    };
    for sent in 1..=3 {
        paths.arrived(now.mono, 0, FROM, (bytes, ed25), || false);
        let mut question = paths.ask(now, 0, FROM, false);
        // What it has asked for waits behind the proof.
        let verdict = paths.admit(now.mono, 0, 60, Kind::Acknowledgement);
        assert!(sent > 1 || verdict == Verdict::Wait);
        for _ in 0..40 {
            while let Some(stamp) = question.take() {
                if !arrives() || !arrives() {
                    break;
                }
                paths.arrived(now.mono, 0, FROM, (answer, ed25), || false);
                match paths.answered(now, 0, FROM, stamp) {
                    Proof::Proven { .. } => return sent,
                    Proof::Round => question = paths.ask(now, 0, FROM, true),
                    Proof::None => {}
                }
            }
            let step = Duration::from_millis(100);
            (now.mono, now.wall) = (now.mono + step, now.wall + step);
            if paths.due_to_ask(now.mono, 0).is_some() {
                question = paths.ask(now, 0, FROM, false);
            }
        }
    }
    usize::MAX
}

/// At the moment in which stamps begin again at 0, on 2034-11-03, and while they stand still there, as the stamps of 1970 do.
#[test]
fn an_address_is_proven_at_any_time() {
    let roll_over = Duration::from_millis(TimeStamp::EPOCH_UNIX_MS + TimeStamp::PERIOD_MS);
    for wall in [
        Duration::from_secs(100),
        roll_over.saturating_sub(Duration::from_millis(300)),
        roll_over,
    ] {
        for lost in 0..7 {
            let sends = sends_at(wall, false, 23, lost);
            assert_eq!(sends, 1, "at {wall:?}, the {lost}th is lost");
        }
    }
}

#[test]
fn a_station_that_sends_its_shortest_message_once_is_not_stranded_by_one_lost_datagram() {
    for lost in 0..7 {
        assert_eq!(sends(false, 23, lost), 1, "the {lost}th is lost");
    }
}

#[test]
fn a_question_of_edition_25_is_asked_again_for_a_long_message_and_for_the_next_short_one() {
    for lost in 0..7 {
        assert_eq!(sends(true, 86, lost), 1, "the {lost}th is lost");
        // Two questions of 128 bytes are more than three times what came: it is asked again with its next message.
        let again = if lost < 2 { 2 } else { 1 };
        assert_eq!(sends(true, 62, lost), again, "the {lost}th is lost");
    }
}

/// A station of Edition 4 that is proven, and datagrams of Edition 2.5 in its name from elsewhere.
#[test]
fn each_address_is_asked_and_charged_in_the_edition_of_what_came_from_there() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let other = SocketAddr::new(FROM.ip(), FROM.port() + 1);
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    paths.arrived(now.mono, 0, FROM, (300, false), || true);
    let mut question = paths.ask(now, 0, FROM, false);
    while let Some(stamp) = question.take() {
        if paths.answered(now, 0, FROM, stamp) == Proof::Round {
            question = paths.ask(now, 0, FROM, true);
        }
    }
    paths.arrived(now.mono, 0, other, (300, true), || true);
    let answer = Datagram::of_ed25(Destination::Unicast(FROM), Id(0x1b00_00a0), &[0; 34]);
    assert_eq!(paths.bytes_of(0, &answer.expect("it fits")), 34);
    now.mono += LIMITS.lease / 2;
    assert_eq!(paths.due_to_ask(now.mono, 0), Some((FROM, false)));
    let left = |paths: &mut Paths| paths.stations[0].find(other).map(|path| path.credit);
    let before = left(&mut paths).expect("it is remembered");
    assert!(paths.ask(now, 0, other, false).is_some());
    assert_eq!(left(&mut paths), Some(before - 128));
}

#[test]
fn what_grows_is_not_sent_to_an_address_that_was_displaced_meanwhile() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let answer = Datagram::of_ed25(Destination::Unicast(FROM), Id(0x1b00_00a0), &[0; 34]);
    let mut answer = answer.expect("it fits");
    answer.charged = 34;
    assert!(paths.settle(0, &answer, 34));
    assert!(!paths.settle(0, &answer, 78));
}

/// Forged addresses in a station's name, and the station itself: how many datagrams go to them in three seconds, and when the
/// station has proved its own address.
fn beside_forgeries(
    forged: impl Fn(u32) -> SocketAddr,
    a_second: u32,
) -> (usize, Option<Duration>) {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let own = OWN;
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    let begins = now.mono + Duration::from_secs(LATER_S.into());
    let (mut sent, mut most) = (VecDeque::new(), 0);
    for number in 0..60 * a_second {
        let forged = forged(number);
        // The station sends about five times a second, out of step, once nothing is left of the bursts.
        let arrived = [
            Some(forged),
            (number >= LATER_S * a_second
                && number.wrapping_mul(0x9e37_79b1) < u32::MAX / (a_second / 5))
                .then_some(own),
        ];
        for from in arrived.into_iter().flatten() {
            paths.arrived(now.mono, 0, from, (40, false), || false);
            let mut question = paths.ask(now, 0, from, false);
            let answer = paths.admit(now.mono, 0, 34, Kind::Acknowledgement) == Verdict::Send;
            sent.extend([question.is_some(), answer].map(|one| one.then_some(now.mono)));
            while from == own
                && let Some(stamp) = question
            {
                question = match paths.answered(now, 0, own, stamp) {
                    Proof::Proven { .. } => return (most, Some(now.mono.saturating_sub(begins))),
                    Proof::Round => paths.ask(now, 0, own, true),
                    Proof::None => None,
                };
            }
        }
        let step = Duration::from_secs(1) / a_second;
        (now.mono, now.wall) = (now.mono + step, now.wall + step);
        sent.retain(Option::is_some);
        while sent
            .front()
            .copied()
            .flatten()
            .is_some_and(|at| at + ARP < now.mono)
        {
            sent.pop_front();
        }
        most = most.max(sent.len());
    }
    (most, None)
}

#[test]
fn absent_addresses_do_not_fill_the_socket_nor_keep_their_station_out() {
    for addresses in [1, 40, 250] {
        let forged = |number: u32| {
            let host = (number % addresses) as u8;
            SocketAddr::from(([10, 9, 0, host], 5_000 + (number % 8) as u16))
        };
        let (most, proven) = beside_forgeries(forged, 3_000);
        assert!(most < 500, "{most} datagrams to {addresses} addresses");
        let proven = proven.expect("the station proves its address");
        assert!(proven < Duration::from_secs(40), "{proven:?}");
    }
}

#[test]
fn other_ports_of_its_own_computer_do_not_keep_a_station_out() {
    let forged = |number: u32| SocketAddr::new(OWN.ip(), 10_000 + (number * 7 % 25_000) as u16);
    let (_, proven) = beside_forgeries(forged, 3_000);
    let proven = proven.expect("the station proves its address");
    assert!(proven < Duration::from_secs(40), "{proven:?}");
}

#[test]
fn a_station_that_steers_and_acknowledges_nothing_keeps_its_answers_and_the_position() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    let (mut answers, mut reports) = (0, 0);
    for _ in 0..200 {
        paths.arrived(now.mono, 0, OWN, (90, false), || false);
        paths.ask(now, 0, OWN, false);
        let mut sends = |bytes, kind| paths.admit(now.mono, 0, bytes, kind) == Verdict::Send;
        answers += (0..2).filter(|_| sends(34, Kind::Acknowledgement)).count();
        let each = [4000, 3001, 3002, 4001, 16002].into_iter();
        reports += each.filter(|one| sends(60, Kind::Report(*one))).count();
        let step = Duration::from_millis(100);
        (now.mono, now.wall) = (now.mono + step, now.wall + step);
    }
    assert_eq!(answers, 400);
    assert!(reports > 100, "{reports} in 20 s");
}

#[test]
fn an_answer_that_waits_for_the_shared_rate_is_sent_without_another_message() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    let begun = now.mono;
    paths.arrived(now.mono, 0, OWN, (30_000, false), || false);
    paths.ask(now, 0, OWN, false);
    while paths.admit(now.mono, 0, 34, Kind::Answer) == Verdict::Send {}
    let answer = Datagram::of_ed25(Destination::Unicast(OWN), Id(0x1b00_00a0), &[0; 34]);
    paths.wait(now.mono, 0, answer.expect("it fits"));
    while paths.next_waiting(now.mono, 0).is_none() {
        let due = paths.poll_timeout(now.mono).expect("it still waits");
        assert!(due > now.mono, "the timer would be due for ever");
        let step = due - now.mono;
        (now.mono, now.wall) = (now.mono + step, now.wall + step);
        if paths.due_to_ask(now.mono, 0).is_some() {
            paths.ask(now, 0, OWN, false);
        }
    }
    let waited = now.mono - begun;
    assert!(waited < Duration::from_millis(200), "{waited:?}");
}

/// Alerts come in hundreds, and an acknowledgement once.
#[test]
fn alerts_that_wait_take_the_place_of_no_acknowledgement() {
    let of_type = |message_type| {
        let datagram = Datagram::of_ed25(Destination::Unicast(OWN), Id(0x1b00_00a0), &[0; 34]);
        datagram.expect("it fits").with_type(message_type)
    };
    let (alert, acknowledgement) = (16_000, 17_000);
    let types = |paths: &Paths| -> Vec<u16> {
        let waiting = paths.stations[0].waiting.iter();
        waiting.map(|(_, one)| one.message_type()).collect()
    };
    let now = Duration::from_secs(100);
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    for round in 1..=3 {
        paths.wait(now, 0, of_type(acknowledgement));
        for _ in 0..400 {
            paths.wait(now, 0, of_type(alert));
        }
        let types = types(&paths);
        assert_eq!(types.len(), 256);
        assert_eq!(types[..round], vec![acknowledgement; round]);
        assert!(types[round..].iter().all(|one| *one == alert));
    }
    assert!(paths.take_missed(0));
    // Where nothing else waits, the oldest of them is dropped for a later one, and none for an alert.
    for _ in 0..400 {
        paths.wait(now, 0, of_type(acknowledgement));
    }
    paths.wait(now, 0, of_type(alert));
    assert_eq!(types(&paths), vec![acknowledgement; 256]);
}

/// When the station begins to send.
const LATER_S: u32 = 10;
const OWN: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::new(10, 9, 1, 1)), 40_000);

/// How long the system keeps a datagram to a computer that does not answer ARP.
const ARP: Duration = Duration::from_secs(3);

/// While a bridge is paused nobody can answer it, so no proof ends by that.
#[test]
fn a_proof_lasts_as_much_longer_as_nothing_could_be_asked() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    paths.arrived(now.mono, 0, FROM, (300, false), || false);
    let mut question = paths.ask(now, 0, FROM, false);
    while let Some(stamp) = question.take() {
        paths.arrived(now.mono, 0, FROM, (34, false), || false);
        if paths.answered(now, 0, FROM, stamp) == Proof::Round {
            question = paths.ask(now, 0, FROM, true);
        }
    }
    assert!(paths.is_proven(0));
    let paused = Duration::from_secs(500);
    now.mono += paused;
    paths.extend_proofs(now.mono, paused);
    paths.handle_timeout(now.mono, 0);
    assert!(paths.is_proven(0));
    // What it is answered at once, before anything has come from it again, is not dropped.
    let verdict = paths.admit(now.mono, 0, 100, Kind::Answer);
    assert_eq!(verdict, Verdict::Send);
    now.mono += 2 * LIMITS.lease;
    paths.handle_timeout(now.mono, 0);
    assert!(!paths.is_proven(0), "asked again, it did not answer");
}

/// The station has been sending for 2 s when the bridge is stopped, and answers what it is asked after that.
#[test]
fn a_station_that_could_not_be_asked_is_not_called_unproven() {
    for (stopped_s, accused) in [(0, false), (30, false), (30, true)] {
        let mut paths = Paths::new(LIMITS, [None].into_iter());
        let mut now = Duration::from_secs(100);
        paths.arrived(now, 0, FROM, (300, false), || false);
        now += Duration::from_secs(2 + stopped_s);
        paths.extend_proofs(now, Duration::from_secs(stopped_s));
        if accused {
            now += UNPROVEN_FOR;
        }
        paths.arrived(now, 0, FROM, (300, false), || false);
        let unproven = paths.unproven(now, 0).map(|(at, _)| at);
        assert_eq!(unproven, accused.then_some(FROM), "{stopped_s} s");
    }
}

#[test]
fn what_waits_for_a_proof_as_a_pause_begins_is_not_carried_out_behind_it() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let other = SocketAddr::new(FROM.ip(), FROM.port() + 1);
    paths.arrived(Duration::from_secs(100), 0, FROM, (300, false), || false);
    paths.arrived(Duration::from_secs(101), 0, other, (300, false), || true);
    assert!(paths.hold(0, other, b"land", None));
    paths.drop_held();
    paths.stations[0].adopt(0);
    assert!(paths.take_held(0).is_empty());
}

#[test]
fn all_ports_of_one_computer_displace_no_address_of_another() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let newcomer = SocketAddr::from(([10, 9, 0, 8], 40_000));
    let now = Duration::from_secs(100);
    paths.arrived(now, 0, FROM, (300, false), || true);
    paths.arrived(now, 0, newcomer, (300, false), || true);
    assert!(paths.hold(0, newcomer, b"land", None));
    for port in 1..2_000 {
        let now = now + Duration::from_millis(u64::from(port));
        let flood = SocketAddr::from(([10, 9, 0, 9], port));
        paths.arrived(now, 0, flood, (40, false), || true);
    }
    let kept = paths.stations[0].find(newcomer).map(|path| path.held.len());
    assert_eq!(kept, Some(1));
    assert_eq!(paths.stations[0].candidates.len(), MAX_CANDIDATES);
}

/// Between each question and its answer somebody else, who has no less of a claim, is taken for the station.
#[test]
fn a_station_is_proven_though_others_use_its_name_faster_than_it_answers() {
    let mut paths = Paths::new(LIMITS, [None].into_iter());
    let now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    paths.arrived(now.mono, 0, FROM, (300, false), || false);
    let mut question = paths.ask(now, 0, FROM, false);
    for port in 1.. {
        let other = SocketAddr::from(([10, 9, 0, 9], port));
        let arrival = paths.arrived(now.mono, 0, other, (40, false), || false);
        assert_eq!(arrival, Arrival::Moved);
        paths.arrived(now.mono, 0, FROM, (34, false), || false);
        let stamp = question.take().expect("it is asked");
        match paths.answered(now, 0, FROM, stamp) {
            Proof::Round => question = paths.ask(now, 0, FROM, true),
            proof => {
                assert!(
                    matches!(proof, Proof::Proven { .. }),
                    "answer {port}: {proof:?}"
                );
                break;
            }
        }
    }
    let arrival = paths.arrived(now.mono, 0, OWN, (40, false), || false);
    assert_eq!(arrival, Arrival::Unproven);
}
