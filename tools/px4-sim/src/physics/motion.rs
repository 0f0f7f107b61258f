//! Position, motion and attitude of the vehicle: on the globe and in the local frame.
//!
//! The local frame is PX4's: north, east, down in metres, azimuthal equidistant on a sphere of 6,371,000 m around the
//! place of boot. Everything above this file computes in it; degrees occur only where messages are read and written.

/// Mean earth radius of PX4's projection, metres.
pub(crate) const EARTH_RADIUS_M: f64 = 6_371_000.0;

/// A place: WGS-84 degrees, altitude AMSL in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Geodetic {
    /// Degrees, north positive.
    pub latitude_deg: f64,
    /// Degrees, east positive.
    pub longitude_deg: f64,
    /// Metres above mean sea level.
    pub altitude_m: f64,
}

impl Geodetic {
    pub(crate) const fn new(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Self {
        Self {
            latitude_deg,
            longitude_deg,
            altitude_m,
        }
    }

    /// From MAVLink's latitude and longitude, degrees times 1e7.
    pub(crate) fn from_e7(latitude: i32, longitude: i32, altitude_m: f64) -> Self {
        let degrees = |e7: i32| f64::from(e7) * 1e-7;
        Self::new(degrees(latitude), degrees(longitude), altitude_m)
    }
}

/// North, east, down in metres (or metres a second, and so on).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ned {
    /// North.
    pub n: f64,
    /// East.
    pub e: f64,
    /// Down.
    pub d: f64,
}

impl Ned {
    /// From its three components.
    pub const fn new(n: f64, e: f64, d: f64) -> Self {
        Self { n, e, d }
    }

    /// Length of the horizontal part.
    pub fn horizontal(self) -> f64 {
        self.n.hypot(self.e)
    }

    /// Direction of the horizontal part, radians clockwise from north.
    pub fn bearing(self) -> f64 {
        self.e.atan2(self.n)
    }

    /// Length.
    pub fn norm(self) -> f64 {
        self.horizontal().hypot(self.d)
    }

    /// Each component where it is finite, elsewhere that of `other`.
    pub(crate) fn or(self, other: Self) -> Self {
        let or = |own: f64, other: f64| if own.is_finite() { own } else { other };
        Self::new(
            or(self.n, other.n),
            or(self.e, other.e),
            or(self.d, other.d),
        )
    }

    /// True when no component is infinite or NaN.
    pub fn is_finite(self) -> bool {
        self.n.is_finite() && self.e.is_finite() && self.d.is_finite()
    }
}

impl std::ops::Add for Ned {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self::new(self.n + o.n, self.e + o.e, self.d + o.d)
    }
}

impl std::ops::Sub for Ned {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self::new(self.n - o.n, self.e - o.e, self.d - o.d)
    }
}

impl std::ops::Mul<f64> for Ned {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Self::new(self.n * k, self.e * k, self.d * k)
    }
}

/// The tangent frame at an origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    origin: Geodetic,
    sin_lat: f64,
    cos_lat: f64,
}

impl LocalFrame {
    /// The frame whose zero is `origin`.
    pub fn new(origin: Geodetic) -> Self {
        let (sin_lat, cos_lat) = origin.latitude_deg.to_radians().sin_cos();
        Self {
            origin,
            sin_lat,
            cos_lat,
        }
    }

    /// The zero of this frame.
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// Degrees and metres to north, east, down.
    pub fn to_local(&self, at: Geodetic) -> Ned {
        let (sin_lat, cos_lat) = at.latitude_deg.to_radians().sin_cos();
        let d_lon = (at.longitude_deg - self.origin.longitude_deg).to_radians();
        let cos_c =
            (self.sin_lat * sin_lat + self.cos_lat * cos_lat * d_lon.cos()).clamp(-1.0, 1.0);
        let c = cos_c.acos();
        // At the origin c / sin(c) is 0 / 0; its limit is 1.
        let k = if c > 1e-12 { c / c.sin() } else { 1.0 };
        Ned {
            n: k * (self.cos_lat * sin_lat - self.sin_lat * cos_lat * d_lon.cos()) * EARTH_RADIUS_M,
            e: k * cos_lat * d_lon.sin() * EARTH_RADIUS_M,
            d: self.origin.altitude_m - at.altitude_m,
        }
    }

    /// North, east, down to degrees and metres.
    pub fn to_global(&self, at: Ned) -> Geodetic {
        let (x, y) = (at.n / EARTH_RADIUS_M, at.e / EARTH_RADIUS_M);
        let c = x.hypot(y);
        let altitude_m = self.origin.altitude_m - at.d;
        if c < 1e-12 {
            return Geodetic {
                altitude_m,
                ..self.origin
            };
        }
        let (sin_c, cos_c) = c.sin_cos();
        let lat = (cos_c * self.sin_lat + x * sin_c * self.cos_lat / c)
            .clamp(-1.0, 1.0)
            .asin();
        let lon = self.origin.longitude_deg.to_radians()
            + (y * sin_c).atan2(c * self.cos_lat * cos_c - x * self.sin_lat * sin_c);
        Geodetic {
            latitude_deg: lat.to_degrees(),
            longitude_deg: wrap_deg(lon.to_degrees()),
            altitude_m,
        }
    }
}

/// An angle to (-pi, pi].
pub(crate) fn wrap_pi(rad: f64) -> f64 {
    let r = rad.rem_euclid(std::f64::consts::TAU);
    if r > std::f64::consts::PI {
        r - std::f64::consts::TAU
    } else {
        r
    }
}

fn wrap_deg(deg: f64) -> f64 {
    let r = (deg + 180.0).rem_euclid(360.0) - 180.0;
    if r == -180.0 { 180.0 } else { r }
}

/// Standard gravity, m/s2.
pub(crate) const GRAVITY: f64 = 9.806_65;

/// True motion of the vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Motion {
    /// Position in the local frame of the place of boot, m.
    pub position: Ned,
    /// Velocity over ground, m/s.
    pub velocity: Ned,
    /// Acceleration, m/s2.
    pub acceleration: Ned,
    /// Roll, pitch, yaw, radians.
    pub attitude: [f64; 3],
    /// The rates of these angles, rad/s; those of the body are [`Motion::body_rates`].
    pub rates: [f64; 3],
}

impl Motion {
    /// Sets a new attitude, and the rates from the change over `dt`.
    pub(crate) fn turn_to(&mut self, attitude: [f64; 3], dt: f64) {
        for (i, new) in attitude.into_iter().enumerate() {
            let rate = wrap_pi(new - self.attitude[i]) / dt;
            // Filtered, as a gyro is: a discrete step of the model is not a jump of the vehicle.
            self.rates[i] += (rate - self.rates[i]) * (dt / 0.05).min(1.0);
            self.attitude[i] = if i == 2 { wrap_pi(new) } else { new };
        }
    }

    /// What a gyro measures, and PX4 reports: the rates about the body's axes. A banked turn pitches the body up.
    pub(crate) fn body_rates(&self) -> [f64; 3] {
        let ([roll, pitch, _], [roll_rate, pitch_rate, turn]) = (self.attitude, self.rates);
        let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) = (roll.sin_cos(), pitch.sin_cos());
        [
            roll_rate - turn * sin_pitch,
            pitch_rate * cos_roll + turn * cos_pitch * sin_roll,
            turn * cos_pitch * cos_roll - pitch_rate * sin_roll,
        ]
    }
}

/// Roll and pitch that point a multicopter's thrust along the specific force `f` (NED, gravity
/// taken out) at a heading.
pub(crate) fn tilt_for(f: Ned, yaw: f64) -> (f64, f64) {
    let (sin, cos) = yaw.sin_cos();
    let forward = f.n * cos + f.e * sin;
    let right = -f.n * sin + f.e * cos;
    // In free fall there is no force to point upward: without a lower limit the tilt would jump.
    let up = (-f.d).max(0.1);
    (right.atan2(forward.hypot(up)), (-forward).atan2(up))
}

/// Roll, pitch, yaw as a quaternion w, x, y, z.
pub(crate) fn quaternion([roll, pitch, yaw]: [f64; 3]) -> [f32; 4] {
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
    fn a_banked_turn_is_one_about_two_axes_of_the_body() {
        let mut motion = Motion {
            attitude: [30_f64.to_radians(), 0.0, 1.0],
            ..Motion::default()
        };
        motion.rates = [0.0, 0.0, 0.5];
        let [p, q, r] = motion.body_rates();
        let expected = [0.0, 0.25, 0.5 * 30_f64.to_radians().cos()];
        for (found, expected) in [p, q, r].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{p} {q} {r}");
        }
    }

    #[test]
    fn a_place_survives_the_projection_and_back() {
        let frame = LocalFrame::new(Geodetic {
            latitude_deg: 47.4,
            longitude_deg: 8.5,
            altitude_m: 488.0,
        });
        for (n, e, d) in [
            (0.0, 0.0, 0.0),
            (100.0, -250.0, -30.0),
            (-40_000.0, 9_000.0, 5.0),
        ] {
            let back = frame.to_local(frame.to_global(Ned::new(n, e, d)));
            assert!((back - Ned::new(n, e, d)).norm() < 1e-3, "{back:?}");
        }
    }

    #[test]
    fn angles_wrap_to_half_a_turn() {
        assert!((wrap_pi(3.5 * std::f64::consts::PI) + 0.5 * std::f64::consts::PI).abs() < 1e-12);
        assert!((wrap_pi(-0.25) + 0.25).abs() < 1e-12);
    }

    #[test]
    fn forward_force_is_nose_down_and_rightward_force_is_right_wing_down() {
        let (roll, pitch) = tilt_for(Ned::new(2.0, 0.0, -GRAVITY), 0.0);
        assert!(roll.abs() < 1e-9 && pitch < -0.15, "{roll} {pitch}");
        let (roll, pitch) = tilt_for(Ned::new(2.0, 0.0, -GRAVITY), -std::f64::consts::FRAC_PI_2);
        assert!(roll > 0.15 && pitch.abs() < 1e-9, "{roll} {pitch}");
    }
}
