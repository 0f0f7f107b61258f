//! What kind of aircraft a vehicle is, and which autopilot flies it (HEARTBEAT.type, HEARTBEAT.autopilot).
//!
//! A VTOL is one vehicle with two sets of limits: it hovers, or it flies on its wings, as
//! EXTENDED_SYS_STATE.vtol_state reports. As in PX4, one in a transition counts as a multicopter until it flies on
//! its wings.

use mavlink_link::dialect::{MavAutopilot, MavType};

/// The kinds that are flown differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Airframe {
    /// Stands still in the air; so does every type that is not named here.
    Multicopter,
    /// Never stands still.
    FixedWing,
    /// Either.
    Vtol,
}

impl Airframe {
    /// Of HEARTBEAT.type.
    #[must_use]
    pub fn of(kind: MavType) -> Airframe {
        use MavType as T;
        match kind {
            T::MAV_TYPE_FIXED_WING => Airframe::FixedWing,
            T::MAV_TYPE_VTOL_TAILSITTER_DUOROTOR
            | T::MAV_TYPE_VTOL_TAILSITTER_QUADROTOR
            | T::MAV_TYPE_VTOL_TILTROTOR
            | T::MAV_TYPE_VTOL_FIXEDROTOR
            | T::MAV_TYPE_VTOL_TAILSITTER
            | T::MAV_TYPE_VTOL_TILTWING
            | T::MAV_TYPE_VTOL_RESERVED5 => Airframe::Vtol,
            _ => Airframe::Multicopter,
        }
    }

    /// Whether its routes are flown on wings: they need a landing, and no waypoint is hovered at.
    #[must_use]
    pub fn has_wings(self) -> bool {
        self != Airframe::Multicopter
    }
}

/// Why an autopilot is not flown by this VSM; `None` for PX4. Its modes, missions and parameters mean something else: flown
/// half, a command would do what nobody has commanded.
#[must_use]
pub fn refused_autopilot(autopilot: MavAutopilot) -> Option<&'static str> {
    (autopilot == MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA).then_some(
        "the vehicle's autopilot is ArduPilot (HEARTBEAT.autopilot 3): only PX4 is flown",
    )
}

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{
        EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, MavLandedState, MavMessage, MavVtolState,
    };

    use super::*;
    use crate::health::{HealthFault, findings};
    use crate::parameter::Parameters;
    use crate::telemetry::Telemetry;

    fn state(vtol_state: MavVtolState) -> MavMessage {
        MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            vtol_state,
            landed_state: MavLandedState::MAV_LANDED_STATE_IN_AIR,
        })
    }

    #[test]
    fn a_vtol_hovers_until_it_flies_on_its_wings_and_a_quad_chute_is_seen() {
        use MavVtolState as V;
        let mut vehicle = Telemetry {
            vehicle_type: Some(MavType::MAV_TYPE_VTOL_FIXEDROTOR),
            ..Telemetry::default()
        };
        assert_eq!(vehicle.airframe(), Airframe::Vtol);
        for (state_now, hovers, failed) in [
            (V::MAV_VTOL_STATE_MC, true, false),
            (V::MAV_VTOL_STATE_TRANSITION_TO_FW, true, false),
            (V::MAV_VTOL_STATE_FW, false, false),
            (V::MAV_VTOL_STATE_TRANSITION_TO_MC, true, false),
            (V::MAV_VTOL_STATE_MC, true, false),
            (V::MAV_VTOL_STATE_TRANSITION_TO_FW, true, false),
            // Without a transition back.
            (V::MAV_VTOL_STATE_MC, true, true),
            (V::MAV_VTOL_STATE_MC, true, true),
            (V::MAV_VTOL_STATE_TRANSITION_TO_FW, true, false),
        ] {
            vehicle.update(&state(state_now));
            let found = (vehicle.hovers(), vehicle.transition_failed);
            assert_eq!(found, (hovers, failed), "{state_now:?}");
        }
        // A landed state that is undefined is not the ground.
        vehicle.update(&MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            vtol_state: V::MAV_VTOL_STATE_MC,
            landed_state: MavLandedState::MAV_LANDED_STATE_UNDEFINED,
        }));
        assert!(vehicle.transition_failed);
    }

    #[test]
    fn ardupilot_is_refused_by_name() {
        let mut vehicle = Telemetry::default();
        vehicle.update(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            ..HEARTBEAT_DATA::default()
        }));
        let found = findings(&vehicle, &Parameters::default());
        let named = found
            .iter()
            .find(|finding| finding.fault == HealthFault::Autopilot);
        assert!(
            named.is_some_and(|finding| finding.text.contains("ArduPilot")),
            "{found:?}"
        );
        assert_eq!(refused_autopilot(MavAutopilot::MAV_AUTOPILOT_PX4), None);
    }
}
