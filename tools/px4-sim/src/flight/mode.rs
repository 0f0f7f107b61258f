//! Flight modes as PX4 names and numbers them.

use mavlink::dialects::development::{MavModeFlag, MavStandardMode};

/// A flight mode (PX4's navigation state).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Sticks to attitude; named only, see `docs/guide/simulator.md`.
    Manual,
    /// Sticks to attitude and climb.
    AltCtl,
    /// Sticks to velocity.
    PosCtl,
    /// Named only.
    Acro,
    /// Named only.
    Stabilized,
    /// Setpoints from outside.
    Offboard,
    /// Circling a point (multicopter only).
    Orbit,
    /// Climbing from the ground.
    Takeoff,
    /// Holding.
    Loiter,
    /// Flying the mission.
    Mission,
    /// Going home.
    Rtl,
    /// Coming down here.
    Land,
    /// Motors off for good.
    Termination,
}

/// Why a main or sub mode was not understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnknownMode {
    /// DO_SET_MODE param2.
    Main,
    /// DO_SET_MODE param3 under main mode 4.
    Auto,
}

impl Mode {
    /// HEARTBEAT.custom_mode: main mode in byte 2, sub mode in byte 3.
    pub fn custom_mode(self) -> u32 {
        let (main, sub) = self.main_sub();
        u32::from(main) << 16 | u32::from(sub) << 24
    }

    /// Main and sub mode.
    pub fn main_sub(self) -> (u8, u8) {
        match self {
            Self::Manual => (1, 0),
            Self::AltCtl => (2, 0),
            Self::PosCtl => (3, 0),
            Self::Orbit => (3, 1),
            Self::Takeoff => (4, 2),
            Self::Loiter => (4, 3),
            Self::Mission => (4, 4),
            Self::Rtl => (4, 5),
            Self::Land => (4, 6),
            Self::Acro => (5, 0),
            Self::Offboard => (6, 0),
            Self::Stabilized => (7, 0),
            Self::Termination => (10, 0),
        }
    }

    /// What DO_SET_MODE's param2 and param3 mean; auto without a sub mode is the mission.
    pub fn from_main_sub(main: u8, sub: u8) -> Result<Self, UnknownMode> {
        Ok(match (main, sub) {
            (1, _) => Self::Manual,
            (2, _) => Self::AltCtl,
            (3, _) => Self::PosCtl,
            (4, 0 | 4) => Self::Mission,
            (4, 2) => Self::Takeoff,
            (4, 3) => Self::Loiter,
            (4, 5) => Self::Rtl,
            (4, 6) => Self::Land,
            (4, _) => return Err(UnknownMode::Auto),
            (5, _) => Self::Acro,
            (6, _) => Self::Offboard,
            (7, _) => Self::Stabilized,
            _ => return Err(UnknownMode::Main),
        })
    }

    /// HEARTBEAT.base_mode.
    pub fn base_mode(self, armed: bool) -> MavModeFlag {
        let mut bits = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        match self {
            Self::Manual | Self::Acro => bits |= MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
            Self::AltCtl | Self::PosCtl | Self::Stabilized => {
                bits |= MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
                    | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
            }
            // Stabilised only while it flies: the attitude controller has no setpoint before.
            Self::Offboard | Self::Orbit => {
                if armed {
                    bits |= MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
                }
            }
            Self::Takeoff | Self::Loiter | Self::Mission | Self::Rtl | Self::Land => {
                bits |= MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED
                    | MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED
                    | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
            }
            Self::Termination => {}
        }
        if armed {
            bits |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        bits
    }

    /// CURRENT_MODE.standard_mode.
    pub fn standard_mode(self) -> MavStandardMode {
        match self {
            Self::PosCtl => MavStandardMode::MAV_STANDARD_MODE_POSITION_HOLD,
            Self::Orbit => MavStandardMode::MAV_STANDARD_MODE_ORBIT,
            Self::AltCtl => MavStandardMode::MAV_STANDARD_MODE_ALTITUDE_HOLD,
            Self::Rtl => MavStandardMode::MAV_STANDARD_MODE_SAFE_RECOVERY,
            Self::Mission => MavStandardMode::MAV_STANDARD_MODE_MISSION,
            Self::Land => MavStandardMode::MAV_STANDARD_MODE_LAND,
            Self::Takeoff => MavStandardMode::MAV_STANDARD_MODE_TAKEOFF,
            _ => MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD,
        }
    }

    /// The mode of DO_SET_STANDARD_MODE param1, where there is one.
    pub fn from_standard(standard: u32) -> Option<Self> {
        Some(match standard {
            1 => Self::PosCtl,
            2 => Self::Orbit,
            4 => Self::AltCtl,
            5 => Self::Rtl,
            6 => Self::Mission,
            7 => Self::Land,
            8 => Self::Takeoff,
            _ => return None,
        })
    }

    /// The name in "Switching to ... is currently not available" and AVAILABLE_MODES.
    pub fn title(self) -> &'static str {
        match self {
            Self::Manual => "Manual",
            Self::AltCtl => "Altitude",
            Self::PosCtl => "Position",
            Self::Acro => "Acro",
            Self::Stabilized => "Stabilized",
            Self::Offboard => "Offboard",
            Self::Orbit => "Orbit",
            Self::Takeoff => "Takeoff",
            Self::Loiter => "Hold",
            Self::Mission => "Mission",
            Self::Rtl => "Return",
            Self::Land => "Land",
            Self::Termination => "Termination",
        }
    }

    /// True where the pilot's sticks steer.
    pub fn needs_sticks(self) -> bool {
        matches!(
            self,
            Self::Manual | Self::AltCtl | Self::PosCtl | Self::Acro | Self::Stabilized
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn custom_modes_are_those_seen_on_the_wire() {
        for (mode, custom) in [
            (Mode::Mission, 0x0404_0000),
            (Mode::Loiter, 0x0304_0000),
            (Mode::Rtl, 0x0504_0000),
            (Mode::Land, 0x0604_0000),
            (Mode::Takeoff, 0x0204_0000),
            (Mode::PosCtl, 0x0003_0000),
            (Mode::Offboard, 0x0006_0000),
            (Mode::Orbit, 0x0103_0000),
        ] {
            assert_eq!(mode.custom_mode(), custom, "{mode:?}");
        }
    }

    #[test]
    fn base_modes_are_those_seen_on_the_wire() {
        assert_eq!(Mode::Loiter.base_mode(false).bits(), 0x1d);
        assert_eq!(Mode::Mission.base_mode(true).bits(), 157);
        assert_eq!(Mode::PosCtl.base_mode(false).bits(), 81);
        assert_eq!(Mode::PosCtl.base_mode(true).bits(), 209);
        assert_eq!(Mode::Offboard.base_mode(false).bits(), 1);
        assert_eq!(Mode::Offboard.base_mode(true).bits(), 145);
    }
}
