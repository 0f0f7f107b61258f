//! Flight path control modes (2016.01, 3001.01) and the modes of PX4 (HEARTBEAT.custom_mode).

use stanag_msgs::enums::FlightPathControlMode;

/// A mode of PX4 as HEARTBEAT.custom_mode carries it: main mode in byte 2, sub mode in byte 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Px4Mode(pub u32);

impl Px4Mode {
    /// POSCTL: sticks command velocities.
    pub const POSCTL: Px4Mode = Px4Mode::new(3, 0);
    /// POSCTL, sub mode orbit (entered by DO_ORBIT).
    pub const ORBIT: Px4Mode = Px4Mode::new(3, 1);
    /// AUTO.TAKEOFF.
    pub const TAKEOFF: Px4Mode = Px4Mode::new(4, 2);
    /// AUTO.LOITER.
    pub const LOITER: Px4Mode = Px4Mode::new(4, 3);
    /// AUTO.MISSION.
    pub const MISSION: Px4Mode = Px4Mode::new(4, 4);
    /// AUTO.RTL.
    pub const RTL: Px4Mode = Px4Mode::new(4, 5);
    /// AUTO.LAND.
    pub const LAND: Px4Mode = Px4Mode::new(4, 6);
    /// AUTO.VTOL_TAKEOFF: hover, transition, loiter.
    pub const VTOL_TAKEOFF: Px4Mode = Px4Mode::new(4, 10);
    /// GUIDED_COURSE: a fixed wing keeps a course over ground, an altitude and an air speed.
    pub const COURSE: Px4Mode = Px4Mode::new(4, 19);
    /// TERMINATION: failsafe values at all outputs, until PX4 restarts.
    pub const TERMINATION: Px4Mode = Px4Mode::new(10, 0);
    /// OFFBOARD: set points arrive over the link.
    pub const OFFBOARD: Px4Mode = Px4Mode::new(6, 0);

    /// The mode of a main and a sub mode, as MAV_CMD_DO_SET_MODE takes them in param2 and param3.
    #[must_use]
    pub const fn new(main: u8, sub: u8) -> Px4Mode {
        Px4Mode((main as u32) << 16 | (sub as u32) << 24)
    }

    /// PX4's main mode.
    #[must_use]
    pub const fn main(self) -> u8 {
        (self.0 >> 16) as u8
    }

    /// PX4's sub mode, 0 where the main mode has none.
    #[must_use]
    pub const fn sub(self) -> u8 {
        (self.0 >> 24) as u8
    }

    /// PX4's own name of the mode.
    #[must_use]
    pub fn name(self) -> &'static str {
        row(self).map_or("an unknown mode", |(_, _, name)| name)
    }

    /// What 3001 reports for it: the standard's mode if there is one, otherwise a vehicle specific one from 32 up.
    #[must_use]
    pub fn reported(self) -> FlightPathControlMode {
        FlightPathControlMode::from_raw(row(self).map_or(UNKNOWN_MODE, |(_, dli, _)| *dli))
    }
}

/// What 3001 reports for a PX4 mode that is not in this table.
pub const UNKNOWN_MODE: u8 = 255;

/// PX4's modes, what 3001 reports for each, and their names; 41002 describes the values above 31 to a CUCS.
pub const MODES: &[(Px4Mode, u8, &str)] = &[
    (Px4Mode::POSCTL, 2, "POSCTL"),
    (Px4Mode::MISSION, 11, "AUTO.MISSION"),
    (Px4Mode::LOITER, 12, "AUTO.LOITER"),
    (Px4Mode::ORBIT, 12, "ORBIT"),
    (Px4Mode::OFFBOARD, 15, "OFFBOARD"),
    (Px4Mode::COURSE, 15, "GUIDED_COURSE"),
    (Px4Mode::LAND, 19, "AUTO.LAND"),
    (Px4Mode::TAKEOFF, 21, "AUTO.TAKEOFF"),
    (Px4Mode::VTOL_TAKEOFF, 21, "AUTO.VTOL_TAKEOFF"),
    (Px4Mode::RTL, 32, "AUTO.RTL"),
    (Px4Mode::new(1, 0), 33, "MANUAL"),
    (Px4Mode::new(2, 0), 34, "ALTCTL"),
    (Px4Mode::new(5, 0), 35, "ACRO"),
    (Px4Mode::new(7, 0), 36, "STABILIZED"),
    (Px4Mode::new(3, 2), 37, "POSCTL slow"),
    (Px4Mode::new(4, 1), 38, "AUTO.READY"),
    (Px4Mode::new(4, 8), 39, "AUTO.FOLLOW_TARGET"),
    (Px4Mode::new(4, 9), 40, "AUTO.PRECLAND"),
    (Px4Mode::TERMINATION, 42, "TERMINATION"),
    (Px4Mode::new(11, 0), 43, "ALTITUDE_CRUISE"),
    (Px4Mode::new(4, 11), 44, "EXTERNAL1"),
    (Px4Mode::new(4, 12), 45, "EXTERNAL2"),
    (Px4Mode::new(4, 13), 46, "EXTERNAL3"),
    (Px4Mode::new(4, 14), 47, "EXTERNAL4"),
    (Px4Mode::new(4, 15), 48, "EXTERNAL5"),
    (Px4Mode::new(4, 16), 49, "EXTERNAL6"),
    (Px4Mode::new(4, 17), 50, "EXTERNAL7"),
    (Px4Mode::new(4, 18), 51, "EXTERNAL8"),
];

fn row(mode: Px4Mode) -> Option<&'static (Px4Mode, u8, &'static str)> {
    MODES.iter().find(|(px4, _, _)| *px4 == mode)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn custom_modes_are_those_seen_on_the_wire() {
        assert_eq!(Px4Mode::MISSION.0, 0x0404_0000);
        assert_eq!(Px4Mode::LOITER.0, 0x0304_0000);
        assert_eq!(Px4Mode::RTL.0, 0x0504_0000);
        assert_eq!(Px4Mode::LAND.0, 0x0604_0000);
        assert_eq!(Px4Mode::TAKEOFF.0, 0x0204_0000);
        assert_eq!(Px4Mode::POSCTL.0, 0x0003_0000);
        assert_eq!(Px4Mode::OFFBOARD.0, 0x0006_0000);
        assert_eq!(Px4Mode::ORBIT.0, 0x0103_0000);
    }

    #[test]
    fn reported_modes_are_the_contract_and_distinct_beyond_it() {
        assert_eq!(Px4Mode::ORBIT.reported().raw(), 12);
        assert_eq!(Px4Mode::RTL.reported().raw(), 32);
        assert_eq!(Px4Mode(0xdead_beef).reported().raw(), UNKNOWN_MODE);
        let mut beyond: Vec<u8> = MODES
            .iter()
            .map(|(_, dli, _)| *dli)
            .filter(|dli| *dli > 31)
            .collect();
        let count = beyond.len();
        beyond.dedup();
        assert_eq!(beyond.len(), count);
    }
}
