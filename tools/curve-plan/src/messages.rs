//! The messages with which a ground station loads a route: as hex, one datagram a line, as `vsm decode` reads it; or
//! as a pcapng for Wireshark.

use std::fmt::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::{SystemTime, UNIX_EPOCH};

use clap::Args;
use stanag_msgs::{Id, pcapng};

use crate::failure::Failure;

/// Sender and destination.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct Addresses {
    /// The ground station's id, for .hex and .pcapng.
    #[arg(long, value_name = "ID", default_value = "1b:00:00:a0")]
    cucs: Id,
    /// The vehicle's id, for .hex and .pcapng.
    #[arg(long, value_name = "ID", default_value = "1b:00:01:01")]
    vehicle: Id,
    /// Where the VSM listens, for .pcapng.
    #[arg(long, value_name = "IP:PORT", default_value_t = SocketAddr::new(Ipv4Addr::LOCALHOST.into(), PORT))]
    vsm: SocketAddr,
}

impl Addresses {
    /// A datagram a line.
    pub(crate) fn hex(&self, route: &cucs::Route) -> Result<String, Failure> {
        let mut out = String::new();
        for datagram in self.datagrams(route)? {
            for byte in datagram {
                let _ = write!(out, "{byte:02x}");
            }
            out.push('\n');
        }
        Ok(out)
    }

    /// The datagrams as a capture, a millisecond apart.
    pub(crate) fn pcapng(&self, route: &cucs::Route) -> Result<Vec<u8>, Failure> {
        let from: IpAddr = match self.vsm {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
        };
        let mut out = pcapng::header();
        let mut wall = now();
        for datagram in self.datagrams(route)? {
            let from = SocketAddr::new(from, PORT);
            pcapng::datagram(&mut out, wall, from, self.vsm, &datagram);
            wall += std::time::Duration::from_millis(1);
        }
        Ok(out)
    }

    fn datagrams(&self, route: &cucs::Route) -> Result<Vec<Vec<u8>>, Failure> {
        let unix_ms = u64::try_from(now().as_millis()).unwrap_or(u64::MAX);
        Ok(route
            .datagrams(self.vehicle, self.cucs, unix_ms)
            .map_err(cucs::StationError::from)?)
    }
}

fn now() -> std::time::Duration {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default()
}

/// The port that the bridge listens on by default.
const PORT: u16 = 4586;
