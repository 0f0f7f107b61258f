//! Where the vehicle is and how it lies: the state that physics keeps, and attitude from forces.

use super::geo::{Ned, wrap_pi};

/// Standard gravity, m/s2.
pub(super) const GRAVITY: f64 = 9.806_65;

/// True motion of the vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Motion {
    /// Position in the local frame of the place of boot, m.
    pub position: Ned,
    /// Velocity over ground, m/s.
    pub velocity: Ned,
    /// Acceleration, m/s2.
    pub acceleration: Ned,
    /// Roll, pitch, yaw, radians.
    pub attitude: [f64; 3],
    /// Their rates, rad/s.
    pub rates: [f64; 3],
}

impl Motion {
    /// Takes a new attitude, and the rates from the change over `dt`.
    pub(super) fn turn_to(&mut self, attitude: [f64; 3], dt: f64) {
        for (i, new) in attitude.into_iter().enumerate() {
            let rate = wrap_pi(new - self.attitude[i]) / dt;
            // A gyro is filtered as well: a step of the model is no step of the vehicle.
            self.rates[i] += (rate - self.rates[i]) * (dt / 0.05).min(1.0);
            self.attitude[i] = if i == 2 { wrap_pi(new) } else { new };
        }
    }
}

/// Roll and pitch that point a multicopter's thrust along the specific force `f` (NED, gravity
/// taken out) at a heading.
pub(super) fn tilt_for(f: Ned, yaw: f64) -> (f64, f64) {
    let (sin, cos) = yaw.sin_cos();
    let forward = f.n * cos + f.e * sin;
    let right = -f.n * sin + f.e * cos;
    let up = (-f.d).max(0.1);
    (right.atan2(forward.hypot(up)), (-forward).atan2(up))
}

/// Roll, pitch, yaw as a quaternion w, x, y, z.
pub(super) fn quaternion([roll, pitch, yaw]: [f64; 3]) -> [f32; 4] {
    let (sr, cr) = (roll / 2.0).sin_cos();
    let (sp, cp) = (pitch / 2.0).sin_cos();
    let (sy, cy) = (yaw / 2.0).sin_cos();
    [
        (cr * cp * cy + sr * sp * sy) as f32,
        (sr * cp * cy - cr * sp * sy) as f32,
        (cr * sp * cy + sr * cp * sy) as f32,
        (cr * cp * sy - sr * sp * cy) as f32,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forward_force_is_nose_down_and_rightward_force_is_right_wing_down() {
        let (roll, pitch) = tilt_for(Ned::new(2.0, 0.0, -GRAVITY), 0.0);
        assert!(roll.abs() < 1e-9 && pitch < -0.15, "{roll} {pitch}");
        let (roll, pitch) = tilt_for(Ned::new(2.0, 0.0, -GRAVITY), -std::f64::consts::FRAC_PI_2);
        assert!(roll > 0.15 && pitch.abs() < 1e-9, "{roll} {pitch}");
    }
}
