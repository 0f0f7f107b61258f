//! A driver that sends a vehicle's frames faster than a bridge takes them.

use std::net::UdpSocket;
use std::time::{Duration, Instant};

use kit::measure::pace;

use crate::vehicle::Autopilot;

/// Frames that are ready to be sent: encoding and signing take the driver about as long as the bridge needs to take them, so
/// that a driver which does it meanwhile is no faster than what it drives.
pub(crate) struct Frames(Vec<Vec<u8>>);

impl Frames {
    /// ATTITUDE at this rate, the most frequent of PX4's messages, with a HEARTBEAT each second for the first of it.
    pub(crate) fn telemetry(autopilot: &Autopilot, rate: u32, seconds: u32) -> Frames {
        let frame = |number: u32| match number.is_multiple_of(rate) {
            true => autopilot.heartbeat(false),
            false => autopilot.attitude(),
        };
        Frames((0..rate * seconds).map(frame).collect())
    }

    pub(crate) fn count(&self) -> u64 {
        self.0.len() as u64
    }

    /// Sends them at this rate and reads away what comes back; how long it took.
    pub(crate) fn drive(&self, socket: &UdpSocket, rate: u32) -> Duration {
        let begun = Instant::now();
        for (number, frame) in (0..).zip(&self.0) {
            pace(begun, number, rate);
            socket.send(frame).expect("it is sent");
            if number % 64 == 63 {
                discard(socket);
            }
        }
        begun.elapsed()
    }
}

/// Throws away what has come.
pub(crate) fn discard(socket: &UdpSocket) {
    socket.set_nonblocking(true).expect("a socket");
    while socket.recv_from(&mut [0; 2_048]).is_ok() {}
    socket.set_nonblocking(false).expect("a socket");
}
