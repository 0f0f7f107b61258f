//! The vehicle's attitude, and what it was at the moment of its position.
//!
//! PX4 sends attitude (ATTITUDE) and position (GLOBAL_POSITION_INT) as separate streams, each 5 times a second, but 4000 has
//! both under one Time Stamp, that of the position. In a fast turn, a heading of a tenth of a second before is 8 degrees off.
//! So the attitude is brought to the moment of the position, and not the position to that of the attitude: a position is
//! reported as it was measured, and 4001 and 3009, which are of the same position, have its stamp too.

/// Attitude and rates (ATTITUDE), rad and rad/s, aerospace axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude {
    /// Right wing down is positive.
    pub roll: f64,
    /// Nose up is positive.
    pub pitch: f64,
    /// Clockwise from true north.
    pub yaw: f64,
    /// About the body's x axis.
    pub roll_rate: f64,
    /// About the body's y axis.
    pub pitch_rate: f64,
    /// About the body's z axis.
    pub yaw_rate: f64,
}

impl Attitude {
    /// The rates of roll, pitch and yaw, rad/s. `None` near the vertical, where roll and yaw are not defined.
    ///
    /// The measured rates are those of the body: in a banked turn the nose goes round and the body pitches up, while the pitch
    /// stays.
    pub(crate) fn angle_rates(&self) -> Option<[f64; 3]> {
        if self.pitch.abs() > MAX_PITCH {
            return None;
        }
        let (sin_roll, cos_roll) = self.roll.sin_cos();
        let sideways = self.pitch_rate * sin_roll + self.yaw_rate * cos_roll;
        let upwards = self.pitch_rate * cos_roll - self.yaw_rate * sin_roll;
        Some([
            self.roll_rate + sideways * self.pitch.tan(),
            upwards,
            sideways / self.pitch.cos(),
        ])
    }

    /// The attitude so many seconds later, or earlier where negative, at its present rates. `None` near the vertical.
    fn turned(self, seconds: f64) -> Option<Attitude> {
        let [roll_rate, pitch_rate, yaw_rate] = self.angle_rates()?;
        let turned = Attitude {
            roll: self.roll + roll_rate * seconds,
            pitch: self.pitch + pitch_rate * seconds,
            yaw: self.yaw + yaw_rate * seconds,
            ..self
        };
        (turned.pitch.abs() <= MAX_PITCH).then_some(turned)
    }
}

/// The attitude that was measured nearest to the latest position.
///
/// By the vehicle's own clock (time_boot_ms), which both messages carry: neither the delay of the link counts, nor whether the
/// offset to our clock is known.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AttitudeTrack {
    position_ms: Option<u32>,
    latest: Option<Sample>,
    nearest: Option<Sample>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    boot_ms: u32,
    attitude: Attitude,
}

impl AttitudeTrack {
    /// A position that was measured then.
    pub(crate) fn note_position(&mut self, boot_ms: u32) {
        self.position_ms = Some(boot_ms);
        self.choose();
    }

    /// An attitude that was measured then; `None` where its values are none.
    pub(crate) fn note_attitude(&mut self, boot_ms: u32, attitude: Option<Attitude>) {
        self.latest = attitude.map(|attitude| Sample { boot_ms, attitude });
        self.choose();
    }

    fn choose(&mut self) {
        let Some(position_ms) = self.position_ms else {
            return;
        };
        let gap_ms = |sample: &Sample| span_ms(sample.boot_ms, position_ms).unsigned_abs();
        let both = [self.nearest, self.latest].into_iter().flatten();
        self.nearest = both.min_by_key(gap_ms);
    }

    /// The attitude at the moment of the latest position; `None` where too much time is between them.
    pub(crate) fn at_position(&self) -> Option<Attitude> {
        let (position_ms, nearest) = (self.position_ms?, self.nearest?);
        // Where no position comes any more, or the position is of before a restart, what the vehicle does now matters more than
        // one moment for all.
        let behind_ms = span_ms(position_ms, self.latest?.boot_ms).unsigned_abs();
        let gap_ms = span_ms(nearest.boot_ms, position_ms);
        if behind_ms > MAX_BEHIND_MS || gap_ms.unsigned_abs() > MAX_GAP_MS {
            return None;
        }
        nearest.attitude.turned(f64::from(gap_ms) / 1e3)
    }

    /// The same for what is derived from both: where the nearest is too far from the position, the latest, if the vehicle has hardly
    /// turned in between.
    pub(crate) fn with_position(&self) -> Option<Attitude> {
        self.at_position().or_else(|| {
            let (position_ms, latest) = (self.position_ms?, self.latest?);
            let gap_ms = span_ms(latest.boot_ms, position_ms).unsigned_abs();
            let Attitude {
                roll_rate,
                pitch_rate,
                yaw_rate,
                ..
            } = latest.attitude;
            let rate = roll_rate.hypot(pitch_rate).hypot(yaw_rate);
            let still = rate * f64::from(gap_ms) / 1e3 <= STILL_RAD;
            (gap_ms <= MAX_BEHIND_MS && still).then_some(latest.attitude)
        })
    }

    /// When the latest position was measured.
    pub(crate) fn position_ms(&self) -> Option<u32> {
        self.position_ms
    }

    /// The vehicle's time, as the later of the two has shown it.
    pub(crate) fn boot_ms(&self) -> Option<u32> {
        let attitude_ms = self.latest.map(|latest| latest.boot_ms);
        match (self.position_ms, attitude_ms) {
            (Some(position), Some(attitude)) if span_ms(position, attitude) > 0 => Some(attitude),
            (position, attitude) => position.or(attitude),
        }
    }
}

/// The time between two stamps, ms. time_boot_ms rolls over after 49.7 days.
pub(crate) fn span_ms(from: u32, to: u32) -> i32 {
    to.wrapping_sub(from) as i32
}

/// How far an attitude is brought along by its rates: the period of its stream, and a quarter. In a longer time a multicopter
/// tilts and comes back.
const MAX_GAP_MS: u32 = 250;
/// How far the latest position may be behind the latest attitude: some reports of it are lost on a bad link.
const MAX_BEHIND_MS: u32 = 1_000;
/// A turn up to this leaves a line of sight what it was: 3 degrees, the accuracy of a gimbal's drive.
pub(crate) const STILL_RAD: f64 = 0.0524;
/// 80 degrees.
const MAX_PITCH: f64 = 1.396;

#[cfg(test)]
mod tests {
    use super::*;

    const LEVEL: Attitude = Attitude {
        roll: 0.0,
        pitch: 0.0,
        yaw: 0.0,
        roll_rate: 0.0,
        pitch_rate: 0.0,
        yaw_rate: 0.0,
    };

    /// Banked by 30 degrees, in a level turn of 1 rad/s.
    fn banked() -> Attitude {
        let roll = 30_f64.to_radians();
        Attitude {
            roll,
            yaw: 3.0,
            pitch_rate: roll.sin(),
            yaw_rate: roll.cos(),
            ..LEVEL
        }
    }

    fn assert_near(turned: Option<Attitude>, [roll, pitch, yaw]: [f64; 3]) {
        let turned = turned.expect("an attitude");
        for (found, expected) in [
            (turned.roll, roll),
            (turned.pitch, pitch),
            (turned.yaw, yaw),
        ] {
            assert!((found - expected).abs() < 1e-9, "{turned:?}");
        }
    }

    #[test]
    fn body_rates_turn_the_heading_of_a_banked_vehicle_and_not_its_pitch() {
        let roll = banked().roll;
        assert_near(banked().turned(0.1), [roll, 0.0, 3.1]);
        assert_near(banked().turned(-0.2), [roll, 0.0, 2.8]);
        let rolls = Attitude {
            roll_rate: 2.0,
            ..LEVEL
        };
        assert_near(rolls.turned(0.1), [0.2, 0.0, 0.0]);
        // The nose up: a turn of the body about its own axis is one of the heading too, and less of it.
        let pitch = 60_f64.to_radians();
        let climbs = Attitude {
            pitch,
            yaw_rate: 0.5,
            ..LEVEL
        };
        let roll = 0.05 * pitch.tan();
        assert_near(climbs.turned(0.1), [roll, pitch, 0.1]);
    }

    #[test]
    fn near_the_vertical_nothing_is_turned() {
        for (pitch_deg, pitch_rate) in [(85.0_f64, 0.0), (-90.0, 0.0), (75.0, 2.0)] {
            let steep = Attitude {
                pitch: pitch_deg.to_radians(),
                pitch_rate,
                yaw_rate: 1.0,
                ..LEVEL
            };
            assert_eq!(steep.turned(0.1), None, "{pitch_deg}");
        }
    }

    #[test]
    fn the_nearest_attitude_counts_and_only_a_near_one() {
        let turning = |yaw: f64| Attitude {
            yaw,
            yaw_rate: 1.0,
            ..LEVEL
        };
        let mut track = AttitudeTrack::default();
        assert_eq!(track.at_position(), None);
        // Just before time_boot_ms rolls over.
        track.note_attitude(u32::MAX - 99, Some(turning(0.0)));
        track.note_position(50);
        assert_near(track.at_position(), [0.0, 0.0, 0.15]);
        // The next one is nearer, the one after it is not; each has its own rates.
        track.note_attitude(100, Some(turning(5.0)));
        assert_near(track.at_position(), [0.0, 0.0, 4.95]);
        track.note_attitude(300, Some(turning(7.0)));
        assert_near(track.at_position(), [0.0, 0.0, 4.95]);
        track.note_position(540);
        assert_near(track.at_position(), [0.0, 0.0, 7.24]);
        track.note_position(551);
        assert_eq!(track.at_position(), None, "251 ms");
        // No position comes any more.
        track.note_position(350);
        track.note_attitude(1_350, Some(turning(0.0)));
        assert_near(track.at_position(), [0.0, 0.0, 7.05]);
        track.note_attitude(1_351, Some(turning(0.0)));
        assert_eq!(track.at_position(), None);
        track.note_attitude(1_360, None);
        assert_eq!(track.at_position(), None);
        // The vehicle's clock begins again: what was nearest is of before.
        track.note_position(60_000);
        track.note_attitude(60_000, Some(turning(0.0)));
        assert_near(track.at_position(), [0.0, 0.0, 0.0]);
        track.note_attitude(2_000, Some(turning(1.0)));
        assert_eq!(track.at_position(), None);
    }

    #[test]
    fn an_attitude_of_another_moment_stands_for_that_of_the_position_only_where_nothing_turned() {
        let mut track = AttitudeTrack::default();
        let at = |boot_ms: u32, yaw_rate: f64, track: &mut AttitudeTrack| {
            let turning = Attitude { yaw_rate, ..LEVEL };
            track.note_attitude(boot_ms, Some(turning));
            track.with_position().is_some()
        };
        assert!(!at(4_700, 0.0, &mut track), "no position");
        assert_eq!(track.boot_ms(), Some(4_700));
        track.note_position(5_000);
        assert_eq!(track.boot_ms(), Some(5_000));
        // 6 degrees a second: 2.4 degrees in 0.4 s, 6 in 1 s.
        assert!(at(5_400, 0.105, &mut track));
        assert_eq!(track.boot_ms(), Some(5_400));
        let mut track = AttitudeTrack::default();
        track.note_position(5_000);
        assert!(!at(6_000, 0.105, &mut track));
        assert!(at(6_000, 0.01, &mut track));
        assert!(!at(6_001, 0.0, &mut track));
    }
}
