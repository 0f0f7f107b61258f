//! Flight modes as PX4 names and numbers them.

use mavlink::dialects::development::{MavModeFlag, MavStandardMode};

macro_rules! modes {
    ($($(#[$doc:meta])* $Mode:ident = $main:literal, $sub:literal, $standard:ident, $title:literal;)*) => {
        /// A flight mode (PX4's navigation state).
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
        pub enum Mode { $($(#[$doc])* $Mode,)* }

        impl Mode {
            /// Every mode.
            pub(crate) const ALL: &[Self] = &[$(Self::$Mode),*];

            /// Main and sub mode.
            pub fn main_sub(self) -> (u8, u8) {
                match self { $(Self::$Mode => ($main, $sub),)* }
            }

            /// CURRENT_MODE.standard_mode.
            pub fn standard_mode(self) -> MavStandardMode {
                match self { $(Self::$Mode => MavStandardMode::$standard,)* }
            }

            /// The name in "Switching to ... is currently not available" and AVAILABLE_MODES.
            pub fn title(self) -> &'static str {
                match self { $(Self::$Mode => $title,)* }
            }
        }
    };
}

// Main mode, sub mode, standard mode, title; in the order of AVAILABLE_MODES.mode_index, the last is not in it.
modes! {
    /// Sticks to attitude; a name only, see `docs/guide/simulator.md`.
    Manual = 1, 0, MAV_STANDARD_MODE_NON_STANDARD, "Manual";
    /// Sticks to attitude and climb.
    AltCtl = 2, 0, MAV_STANDARD_MODE_ALTITUDE_HOLD, "Altitude";
    /// Sticks to velocity.
    PosCtl = 3, 0, MAV_STANDARD_MODE_POSITION_HOLD, "Position";
    /// Flying the mission.
    Mission = 4, 4, MAV_STANDARD_MODE_MISSION, "Mission";
    /// Holding: the mode in which PX4 boots.
    #[default]
    Loiter = 4, 3, MAV_STANDARD_MODE_NON_STANDARD, "Hold";
    /// Going home.
    Rtl = 4, 5, MAV_STANDARD_MODE_SAFE_RECOVERY, "Return";
    /// A name only.
    Acro = 5, 0, MAV_STANDARD_MODE_NON_STANDARD, "Acro";
    /// Setpoints from outside.
    Offboard = 6, 0, MAV_STANDARD_MODE_NON_STANDARD, "Offboard";
    /// A name only.
    Stabilized = 7, 0, MAV_STANDARD_MODE_NON_STANDARD, "Stabilized";
    /// Climbing from the ground.
    Takeoff = 4, 2, MAV_STANDARD_MODE_TAKEOFF, "Takeoff";
    /// Hovering up, transitioning, loitering (VTOL only).
    VtolTakeoff = 4, 10, MAV_STANDARD_MODE_NON_STANDARD, "VTOL Takeoff";
    /// Keeping a course over ground, an altitude and an air speed.
    Course = 4, 19, MAV_STANDARD_MODE_NON_STANDARD, "Course";
    /// Landing at the present place.
    Land = 4, 6, MAV_STANDARD_MODE_LAND, "Land";
    /// Circling a point (multicopter only).
    Orbit = 3, 1, MAV_STANDARD_MODE_ORBIT, "Orbit";
    /// Motors off for good.
    Termination = 10, 0, MAV_STANDARD_MODE_NON_STANDARD, "Termination";
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

    /// What DO_SET_MODE's param2 and param3 mean; auto without a sub mode is the mission.
    pub fn from_main_sub(main: u8, sub: u8) -> Result<Self, UnknownMode> {
        let find = |wanted| {
            Self::ALL
                .iter()
                .copied()
                .find(|mode| mode.main_sub() == wanted)
        };
        match (main, sub) {
            (4, 0) => Ok(Self::Mission),
            (4, _) => find((4, sub)).ok_or(UnknownMode::Auto),
            // PX4 ignores the sub mode of the other main modes.
            (1..=7, _) => find((main, 0)).ok_or(UnknownMode::Main),
            _ => Err(UnknownMode::Main),
        }
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
            // Stabilised only in flight: the attitude controller has no setpoint before.
            Self::Offboard | Self::Orbit => {
                if armed {
                    bits |= MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
                }
            }
            Self::Takeoff
            | Self::VtolTakeoff
            | Self::Course
            | Self::Loiter
            | Self::Mission
            | Self::Rtl
            | Self::Land => {
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

    /// The mode for DO_SET_STANDARD_MODE param1, where there is one.
    pub fn from_standard(standard: u32) -> Option<Self> {
        let mut named = Self::ALL.iter().copied().filter(|_| standard != 0);
        named.find(|mode| mode.standard_mode() as u32 == standard)
    }

    /// True where the pilot's sticks steer.
    pub fn needs_sticks(self) -> bool {
        matches!(
            self,
            Self::Manual | Self::AltCtl | Self::PosCtl | Self::Acro | Self::Stabilized
        )
    }

    /// True where a pilot who moves the sticks takes the vehicle: the modes with PX4's flags auto and offboard, which a circle
    /// is not.
    pub(crate) fn gives_way_to_sticks(self) -> bool {
        matches!(
            self,
            Self::Mission
                | Self::Loiter
                | Self::Takeoff
                | Self::VtolTakeoff
                | Self::Course
                | Self::Rtl
                | Self::Land
                | Self::Offboard
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
