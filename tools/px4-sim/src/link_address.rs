//! Names of links on the command line: `udpin:HOST:PORT` and `udpout:HOST:PORT`.

use std::net::{SocketAddr, ToSocketAddrs};
use std::str::FromStr;

use thiserror::Error;

/// The address of a link of the simulated vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkAddress {
    /// Bind here and send nothing until something is received.
    UdpIn(SocketAddr),
    /// Bind any port and send first, to this address.
    UdpOut(SocketAddr),
}

/// Why a text is not a link.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum LinkAddressError {
    /// Neither of the two kinds.
    #[error("link {0:?}: expected udpin:HOST:PORT or udpout:HOST:PORT")]
    Kind(String),
    /// Not a host and a port that can be found.
    #[error("link {text:?}: {reason}, expected HOST:PORT like 127.0.0.1:14550")]
    Address {
        /// The text.
        text: String,
        /// The resolver's error.
        reason: String,
    },
}

impl FromStr for LinkAddress {
    type Err = LinkAddressError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (kind, address) = text
            .split_once(':')
            .ok_or_else(|| LinkAddressError::Kind(text.to_owned()))?;
        let make = match kind {
            "udpin" => Self::UdpIn,
            "udpout" => Self::UdpOut,
            _ => return Err(LinkAddressError::Kind(text.to_owned())),
        };
        let error = |reason: String| LinkAddressError::Address {
            text: text.to_owned(),
            reason,
        };
        let mut found = address
            .to_socket_addrs()
            .map_err(|e| error(e.to_string()))?;
        found
            .next()
            .map(make)
            .ok_or_else(|| error("no address".to_owned()))
    }
}

impl std::fmt::Display for LinkAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::UdpIn(at) => write!(f, "udpin:{at}"),
            Self::UdpOut(at) => write!(f, "udpout:{at}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_named_by_kind_host_and_port() {
        let link: LinkAddress = "udpin:127.0.0.1:14550".parse().unwrap();
        assert_eq!(link.to_string(), "udpin:127.0.0.1:14550");
        assert!("serial:/dev/ttyACM0:57600".parse::<LinkAddress>().is_err());
        assert!("udpout:127.0.0.1".parse::<LinkAddress>().is_err());
        assert!("udpout:127.0.0.1:99999".parse::<LinkAddress>().is_err());
    }
}
