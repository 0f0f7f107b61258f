//! A station that sends one message and then only answers, on a network that loses one datagram.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use mavlink_link::Now;

use super::*;

const FROM: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 40_000);

/// How often it has to send until it has proved its address, each time 4 s later, where the datagram of this number is lost:
/// questions and answers are counted in their order.
fn sends(ed25: bool, bytes: usize, lost: usize) -> usize {
    let mut paths = Paths::new(Limits::default(), [None].into_iter());
    paths.set_edition(0, ed25);
    // 17000, and #1400.
    let answer = if ed25 { 78 } else { 34 };
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    let mut passed = 0;
    let mut arrives = || {
        passed += 1;
        passed != lost + 1
    };
    for sent in 1..=3 {
        paths.arrived(now.mono, 0, FROM, bytes, || false);
        let mut question = paths.ask(now, 0, FROM, false);
        // What it has asked for waits behind the proof.
        let verdict = paths.admit(now.mono, 0, 60, Kind::Acknowledgement);
        assert!(sent > 1 || verdict == Verdict::Wait);
        for _ in 0..40 {
            while let Some(stamp) = question.take() {
                if !arrives() || !arrives() {
                    break;
                }
                paths.arrived(now.mono, 0, FROM, answer, || false);
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

/// Forged addresses in a station's name, and the station itself: how many datagrams go to them in three seconds, and when the
/// station has proved its own address.
fn beside_forgeries(addresses: u8, a_second: u32) -> (usize, Option<Duration>) {
    let mut paths = Paths::new(Limits::default(), [None].into_iter());
    let own = SocketAddr::from(([10, 9, 1, 1], 40_000));
    let mut now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };
    let (begun, mut sent, mut most) = (now.mono, VecDeque::new(), 0);
    for number in 0..60 * a_second {
        let host = (number % u32::from(addresses)) as u8;
        let forged = SocketAddr::from(([10, 9, 0, host], 5_000 + (number % 8) as u16));
        // The station sends five times a second.
        let arrived = [
            Some(forged),
            number.is_multiple_of(a_second / 5).then_some(own),
        ];
        for from in arrived.into_iter().flatten() {
            paths.arrived(now.mono, 0, from, 40, || false);
            let mut question = paths.ask(now, 0, from, false);
            let answer = paths.admit(now.mono, 0, 34, Kind::Acknowledgement) == Verdict::Send;
            sent.extend([question.is_some(), answer].map(|one| one.then_some(now.mono)));
            while from == own
                && let Some(stamp) = question
            {
                question = match paths.answered(now, 0, own, stamp) {
                    Proof::Proven { .. } => return (most, Some(now.mono - begun)),
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
        let (most, proven) = beside_forgeries(addresses, 3_000);
        assert!(most < 500, "{most} datagrams to {addresses} addresses");
        let proven = proven.expect("the station proves its address");
        assert!(proven < Duration::from_secs(20), "{proven:?}");
    }
}

/// How long the system keeps a datagram to a computer that does not answer ARP.
const ARP: Duration = Duration::from_secs(3);
