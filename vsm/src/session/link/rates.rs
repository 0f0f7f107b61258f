//! Which messages are requested from a vehicle, and how often.

use mavlink_link::service::interval::Rate;

use super::budget::Capacity;

/// The requests of one vehicle.
#[derive(Debug)]
pub(super) struct Rates {
    /// The link; `None`: no limit.
    capacity: Option<Capacity>,
    /// Message, rate in Hz, and the bytes of a frame.
    wanted: Vec<(u32, f32, u16)>,
}

impl Rates {
    /// The messages that the DLI needs. `capacity`: that of a slow link.
    pub(super) fn new(capacity: Option<Capacity>) -> Rates {
        Rates {
            capacity,
            wanted: match capacity {
                Some(_) => [NEEDED, SENT_ANYWAY].concat(),
                None => NEEDED.to_vec(),
            },
        }
    }

    /// Adds a message, or changes the rate of one.
    pub(super) fn add(&mut self, message: u32, hertz: f32) {
        match self.wanted.iter_mut().find(|(id, ..)| *id == message) {
            Some((_, known, _)) => *known = hertz,
            None => self.wanted.push((message, hertz, FURTHER_BYTES)),
        }
    }

    /// The rates to request. If they do not fit into the link, all are lowered by one factor. Messages that PX4 streams by
    /// default and that are not needed are switched off; on a slow link there are more of these, and they come first,
    /// because until then answers do not get through.
    pub(super) fn requested(&self) -> impl Iterator<Item = (u32, Rate)> {
        let factor = self.factor();
        let wanted = self.wanted.iter();
        let wanted = wanted.map(move |(id, hertz, _)| (*id, Rate::Hz(hertz * factor)));
        let (first, little): (&[u32], &[u32]) = match self.capacity {
            Some(_) => (UNUSED, ONLY_WITH_ROOM),
            None => (&[], &[]),
        };
        let last = if first.is_empty() { UNUSED } else { &[] };
        let off = |ids: &'static [u32]| {
            let ids = ids.iter().filter(|id| !self.is_wanted(**id));
            ids.map(|id| (*id, Rate::Off))
        };
        off(first).chain(off(little)).chain(wanted).chain(off(last))
    }

    fn is_wanted(&self, message: u32) -> bool {
        self.wanted.iter().any(|(id, ..)| *id == message)
    }

    fn factor(&self) -> f32 {
        let Some(capacity) = self.capacity else {
            return 1.0;
        };
        let room = capacity.reported_bytes_s() as f32;
        let wanted = self.wanted.iter();
        let needed: f32 = wanted
            .map(|(_, hertz, bytes)| hertz * self.carried(*bytes))
            .sum();
        let mut factor = ((room - self.fixed_bytes_s()) / needed).min(1.0);
        // What fits on average may still all come within one second, in which a radio has to carry the bridge's frames too.
        let most = room * MAX_IN_A_SECOND;
        while self.bytes_in_a_second(factor) > most {
            let once_less = self.wanted.iter().map(|(_, hertz, _)| {
                let fewer = times_in_a_second(hertz * factor) - 1.0;
                fewer / hertz
            });
            let lower = once_less.fold(0.0, f32::max);
            // Each comes once at most: a lower rate would only make that rarer.
            if lower <= 0.0 {
                break;
            }
            factor = lower;
        }
        factor
    }

    /// Bytes of the vehicle's reports within the busiest second, in which each message comes as often as it can.
    fn bytes_in_a_second(&self, factor: f32) -> f32 {
        let wanted = self.wanted.iter();
        let bytes = wanted
            .map(|(_, hertz, bytes)| times_in_a_second(hertz * factor) * self.carried(*bytes));
        bytes.sum::<f32>() + self.fixed_bytes_s()
    }

    /// What comes once a second whatever is requested.
    fn fixed_bytes_s(&self) -> f32 {
        let agent = self.capacity.is_some_and(Capacity::has_agent);
        let agent = agent.then_some(HEARTBEAT_BYTES);
        let fixed = [HEARTBEAT_BYTES, MISSION_CURRENT_BYTES];
        fixed
            .into_iter()
            .chain(agent)
            .map(|bytes| self.carried(bytes))
            .sum()
    }

    /// Bytes on the radio for a frame.
    fn carried(&self, bytes: u16) -> f32 {
        let bytes = usize::from(bytes);
        self.capacity.map_or(bytes, |one| one.on_radio(bytes)) as f32
    }
}

/// How often a message of this rate comes within a second at most. A rate that was divided down to a whole number may be a little more.
fn times_in_a_second(hertz: f32) -> f32 {
    (hertz - 1e-3).ceil().max(1.0)
}

/// Messages that the bridge cannot work without, and the longest interval of each, us. HEARTBEAT is part of the protocol
/// itself.
pub(crate) fn needed_every_us() -> impl Iterator<Item = (u32, f32)> {
    let requested = NEEDED.iter().map(|(id, hertz, _)| (*id, 1e6 / hertz));
    requested.chain([(0, 1e6)])
}

/// Message, Hz, and the bytes of a whole frame with its signature.
const NEEDED: &[(u32, f32, u16)] = &[
    // First, because it prevents a lossy link from being mistaken for a silent vehicle (the other source of the mode,
    // HEARTBEAT, is sent at 1 Hz).
    (436, 5.0, 34), // CURRENT_MODE
    (30, 5.0, 53),  // ATTITUDE
    (33, 5.0, 53),  // GLOBAL_POSITION_INT
    (32, 5.0, 53),  // LOCAL_POSITION_NED
    (245, 2.0, 27), // EXTENDED_SYS_STATE
    // PX4 sends it every 2 s by default.
    (242, 1.0, 85), // HOME_POSITION
    (24, 1.0, 77),  // GPS_RAW_INT
    (74, 2.0, 45),  // VFR_HUD
    (87, 2.0, 76),  // POSITION_TARGET_GLOBAL_INT
    (1, 1.0, 68),   // SYS_STATUS
    (147, 0.5, 79), // BATTERY_STATUS
];
/// PX4 streams them without a request, while they have something to report.
const SENT_ANYWAY: &[(u32, f32, u16)] = &[
    (360, 2.0, 62), // ORBIT_EXECUTION_STATUS
];
/// PX4 streams them at up to 50 Hz.
const UNUSED: &[u32] = &[
    31, // ATTITUDE_QUATERNION
    83, // ATTITUDE_TARGET
    85, // POSITION_TARGET_LOCAL_NED
    36, // SERVO_OUTPUT_RAW
];
/// PX4 streams these more slowly. The bridge requests some of them later, when a CUCS asks for what they carry.
const ONLY_WITH_ROOM: &[u32] = &[
    62,  // NAV_CONTROLLER_OUTPUT
    65,  // RC_CHANNELS
    132, // DISTANCE_SENSOR
    141, // ALTITUDE
    230, // ESTIMATOR_STATUS
    231, // WIND_COV
    241, // VIBRATION
    246, // ADSB_VEHICLE
    290, // ESC_INFO
    291, // ESC_STATUS
    330, // OBSTACLE_DISTANCE
    340, // UTM_GLOBAL_POSITION
];
/// Assumed for a message that is requested later: few are longer.
const FURTHER_BYTES: u16 = 80;
/// The busiest second of the reports, in shares of their average: three quarters of the link, so that what the bridge sends beside them
/// leaves a tenth of it free.
const MAX_IN_A_SECOND: f32 = 0.75 / 0.55;
/// These come once a second: their rates cannot be requested.
const HEARTBEAT_BYTES: u16 = 34;
const MISSION_CURRENT_BYTES: u16 = 43;

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes_s(rates: &Rates) -> f32 {
        let sizes = |id: u32| rates.wanted.iter().find(|(wanted, ..)| *wanted == id);
        let each = rates.requested().filter_map(|(id, rate)| match rate {
            Rate::Hz(hertz) => Some(hertz * rates.carried(sizes(id)?.2)),
            _ => None,
        });
        each.sum::<f32>() + rates.fixed_bytes_s()
    }

    #[test]
    fn what_does_not_fit_is_lowered_together_and_what_is_added_has_room() {
        for (rate_bps, encrypted, whole) in [
            (9_600, false, false),
            (19_200, false, false),
            (57_600, false, true),
            (9_600, true, false),
            (19_200, true, false),
            (57_600, true, false),
            (115_200, true, true),
        ] {
            let mut rates = Rates::new(Some(Capacity::new(rate_bps, encrypted)));
            for added in [None, Some(105), Some(230)] {
                added.into_iter().for_each(|id| rates.add(id, 5.0));
                let line = rate_bps as f32 / 10.0;
                let bytes = bytes_s(&rates);
                assert!(
                    bytes <= 0.55 * line + 0.1,
                    "{rate_bps} {encrypted} {added:?}: {bytes}"
                );
                assert_eq!(
                    rates.factor() == 1.0,
                    whole,
                    "{rate_bps} {encrypted} {added:?}"
                );
            }
            // Nor does a second in which all of them come fill the link, as far as lower rates can help.
            let once_at_most = rates.factor() * 5.0 <= 1.001;
            let line = rate_bps as f32 / 10.0;
            let busiest = rates.bytes_in_a_second(rates.factor());
            assert!(
                busiest <= 0.76 * line || once_at_most,
                "{rate_bps} {encrypted}: {busiest}"
            );
            // In whole packets the least radio has room for few: HEARTBEAT reports the mode there.
            if encrypted && rate_bps == 9_600 {
                continue;
            }
            // The mode is reported before the vehicle counts as silent, 3.5 s.
            let mode = rates.requested().find(|(id, _)| *id == 436);
            let is_often = matches!(mode, Some((_, Rate::Hz(hertz))) if hertz > 0.5);
            assert!(is_often, "{mode:?}");
            assert!(!rates.requested().any(|one| one == (230, Rate::Off)));
        }
    }

    #[test]
    fn without_a_budget_all_is_requested_as_needed() {
        let rates = Rates::new(None);
        let requested: Vec<_> = rates.requested().collect();
        assert_eq!(requested.len(), NEEDED.len() + UNUSED.len());
        assert_eq!(requested[0], (436, Rate::Hz(5.0)));
        assert!(requested.contains(&(36, Rate::Off)));
    }
}
