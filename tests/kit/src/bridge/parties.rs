//! The parties of a [`Rig`](super::Rig): ids, addresses on the loopback address, keys.

use std::net::SocketAddr;

use mavlink_link::signing::SigningKey;
use stanag_msgs::Id;

/// The id of the VSM.
pub const VSM: Id = Id(0x1b00_0001);

/// The id of a vehicle.
pub fn vehicle_id(index: usize) -> Id {
    Id(0x1b00_0101 + index as u32)
}

/// The id of a station.
pub fn cucs(index: usize) -> Id {
    Id(0x1b00_00a0 + index as u32)
}

/// The signing key of a vehicle and the bridge.
pub fn key(index: usize) -> SigningKey {
    SigningKey::new([0x41 + index as u8; 32]).expect("not all zero")
}

/// Where the bridge receives the DLI.
pub fn bridge_dli() -> SocketAddr {
    loopback(4_586)
}

/// Where the bridge receives a vehicle.
pub fn bridge_mav(index: usize) -> SocketAddr {
    loopback(14_550 + index as u16)
}

/// Where a vehicle sends from.
pub fn vehicle_address(index: usize) -> SocketAddr {
    loopback(18_570 + index as u16)
}

/// Where a station sends from.
pub fn station_address(index: usize) -> SocketAddr {
    loopback(40_000 + index as u16)
}

fn loopback(port: u16) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], port))
}
