//! The settings of one link.

use super::peer::Endpoint;
use super::receiver::AllowedStreams;
use crate::dialect::{HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavState, MavType};

/// Whether frames must be signed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Security {
    /// Everything is signed, and only what verifies is accepted.
    Signed,
    /// Nothing is signed, and everything under the vehicle's system id is delivered, marked unverified;
    /// so are signed frames, since there is no key to verify them.
    Off,
}

/// What we are to the vehicle; sent in our heartbeats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// MAV_TYPE_GCS.
    GroundStation,
    /// MAV_TYPE_ONBOARD_CONTROLLER.
    OnboardComputer,
}

/// The settings of one link; fixed for its life: PX4 keeps 16 streams until it restarts, so a changed id would use up
/// another place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkConfig<A> {
    /// Our system id, 1 to 255; 245 by default.
    pub own_system: u8,
    /// Our component id, 1 to 255; 190 by default.
    pub own_component: u8,
    /// Our link id in signatures; 0 by default.
    pub link_id: u8,
    /// The vehicle's system id, 1 to 255.
    pub vehicle_system: u8,
    /// The link id of the vehicle's component 1 on this link. Where `None` it is learned from a frame that
    /// the vehicle can only have made just now, and may be changed later by another such frame.
    pub vehicle_link_id: Option<u8>,
    /// The link id that was learned in an earlier run, see [`Link::learned_link_id`](super::Link::learned_link_id).
    pub known_link_id: Option<u8>,
    /// Whether frames must be signed.
    pub security: Security,
    /// How the peer is found.
    pub endpoint: Endpoint<A>,
    /// Sent in our heartbeats.
    pub role: Role,
    /// Messages accepted unsigned from the peer's address; RADIO_STATUS (109) by default.
    pub accept_unsigned: &'static [u32],
    /// The streams that are accepted; by default every one of the vehicle's system.
    pub only: AllowedStreams,
}

impl<A> LinkConfig<A> {
    /// The default settings towards a vehicle.
    #[must_use]
    pub const fn new(vehicle_system: u8, security: Security, endpoint: Endpoint<A>) -> Self {
        Self {
            own_system: 245,
            own_component: 190,
            link_id: 0,
            vehicle_system,
            vehicle_link_id: None,
            known_link_id: None,
            security,
            endpoint,
            role: Role::GroundStation,
            accept_unsigned: &[RADIO_STATUS_ID],
            only: AllowedStreams::ANY,
        }
    }

    pub(crate) fn heartbeat(&self) -> HEARTBEAT_DATA {
        HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: match self.role {
                Role::GroundStation => MavType::MAV_TYPE_GCS,
                Role::OnboardComputer => MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            },
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        }
    }
}

const RADIO_STATUS_ID: u32 = 109;
