//! One leg of a curved route: what a curve message means.
//!
//! P1..P4, taken at height 0 on WGS-84, go to earth-centred coordinates; the cubic Bezier curve is evaluated there;
//! the geodetic latitude and longitude of the result are the ground track. The altitude is the Bernstein cubic of the
//! four altitudes at the same t where P2 and P3 carry one, else an even climb along the curve's length. There is no
//! origin to agree on, and no special case at a pole or the date line; a leg reads the same in both directions and
//! splits exactly. A value of this type is legal: every number finite, every point within reach.

use thiserror::Error;

use crate::cubic::Cubic;
use crate::vector::Vec3;
use crate::wgs84::{Ground, Position};

/// A control point, P2 or P3: a place that shapes the curve, and an altitude where the message carries one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// Latitude, degrees (50002.04 P2 Latitude, 50002.07 P3 Latitude).
    pub lat_deg: f64,
    /// Longitude, degrees (50002.05 P2 Longitude, 50002.08 P3 Longitude).
    pub lon_deg: f64,
    /// Altitude, m, in the reference of P1 and P4 (50002.06, 50002.09); none in 50001.
    pub alt_m: Option<f64>,
}

impl Control {
    /// A control point without an altitude.
    #[must_use]
    pub const fn level(lat_deg: f64, lon_deg: f64) -> Self {
        Self {
            lat_deg,
            lon_deg,
            alt_m: None,
        }
    }

    /// A control point with an altitude, m.
    #[must_use]
    pub const fn with_altitude(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Self {
        Self {
            lat_deg,
            lon_deg,
            alt_m: Some(alt_m),
        }
    }

    /// Its place on the ground.
    #[must_use]
    pub const fn ground(self) -> Ground {
        Ground::new(self.lat_deg, self.lon_deg)
    }
}

/// How far the points of a leg may be from one another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Greatest distance from P1 to P4, m.
    pub leg_m: f64,
    /// Greatest distance from P2 to P1, and from P3 to P4, m.
    pub control_m: f64,
}

impl Default for Reach {
    /// 50 km each.
    fn default() -> Self {
        Self {
            leg_m: 50_000.0,
            control_m: 50_000.0,
        }
    }
}

/// A legal cubic Bezier leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BezierLeg {
    p1: Position,
    p2: Control,
    p3: Control,
    p4: Position,
    /// Control points, earth-centred, relative to P1.
    offsets: Cubic,
    origin: Vec3,
    climb: Climb,
}

/// How the altitude follows the curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Climb {
    /// A Bernstein cubic in t of four altitudes, m.
    Cubic([f64; 4]),
    /// Even along the length: m at P1, m climbed, length of the curve in m.
    Even {
        from_m: f64,
        rise_m: f64,
        length_m: f64,
    },
}

/// Why four points are not a legal leg: the place in it, the value, what was expected.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum LegError {
    /// A coordinate or altitude is NaN or infinite.
    #[error("{point}: {field} is {value}, expected a finite number")]
    NotFinite {
        /// The point of the leg, "P1" to "P4".
        point: &'static str,
        /// The field: "latitude", "longitude" or "altitude".
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A coordinate or altitude is beyond its range.
    #[error("{point}: {field} is {value}, expected {min} to {max}")]
    OutOfRange {
        /// The point of the leg.
        point: &'static str,
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Smallest legal value.
        min: f64,
        /// Greatest legal value.
        max: f64,
    },
    /// A control point is too far from its end, or P4 from P1.
    #[error("{point} is {distance_m:.0} m from {from}, expected at most {max_m:.0} m")]
    TooFar {
        /// The point of the leg.
        point: &'static str,
        /// The point it is measured from.
        from: &'static str,
        /// Their distance, m.
        distance_m: f64,
        /// Greatest legal distance, m.
        max_m: f64,
    },
    /// Only one of P2 and P3 carries an altitude.
    #[error(
        "{missing} carries no altitude while the other control point does, expected both or none"
    )]
    OneAltitude {
        /// The control point without one.
        missing: &'static str,
    },
    /// All four points are one place.
    #[error("P1 to P4 lie within {extent_m} m, expected a leg of some length")]
    ZeroLength {
        /// Greatest distance of a point from P1, m.
        extent_m: f64,
    },
}

impl BezierLeg {
    /// A leg from its four points, within the default reach of 50 km.
    ///
    /// # Errors
    /// A number is not finite or out of range, a point is too far away, or the leg has no length.
    pub fn new(p1: Position, p2: Control, p3: Control, p4: Position) -> Result<Self, LegError> {
        Self::within(p1, p2, p3, p4, Reach::default())
    }

    /// A leg from its four points, within the caller's own limits of distance.
    ///
    /// # Errors
    /// As [`BezierLeg::new`].
    pub fn within(
        p1: Position,
        p2: Control,
        p3: Control,
        p4: Position,
        reach: Reach,
    ) -> Result<Self, LegError> {
        check_ground("P1", p1.ground())?;
        check_ground("P2", p2.ground())?;
        check_ground("P3", p3.ground())?;
        check_ground("P4", p4.ground())?;
        check_altitude("P1", p1.alt_m)?;
        check_altitude("P4", p4.alt_m)?;
        for (point, control) in [("P2", p2), ("P3", p3)] {
            if let Some(alt) = control.alt_m {
                check_altitude(point, alt)?;
            }
        }
        let origin = p1.ground().to_ecef();
        let offsets = Cubic([
            Vec3::ZERO,
            p2.ground().to_ecef() - origin,
            p3.ground().to_ecef() - origin,
            p4.ground().to_ecef() - origin,
        ]);
        check_reach("P4", "P1", offsets.0[3].norm(), reach.leg_m)?;
        check_reach("P2", "P1", offsets.0[1].norm(), reach.control_m)?;
        check_reach(
            "P3",
            "P4",
            (offsets.0[2] - offsets.0[3]).norm(),
            reach.control_m,
        )?;
        let extent_m = offsets.0.iter().map(|o| o.norm()).fold(0.0, f64::max);
        if extent_m < SHORTEST_EXTENT_M {
            return Err(LegError::ZeroLength { extent_m });
        }
        let climb = match (p2.alt_m, p3.alt_m) {
            (Some(a2), Some(a3)) => Climb::Cubic([p1.alt_m, a2, a3, p4.alt_m]),
            // A level leg needs no length, which would have to be integrated.
            (None, None) if p1.alt_m == p4.alt_m => Climb::Cubic([p1.alt_m; 4]),
            (None, None) => Climb::Even {
                from_m: p1.alt_m,
                rise_m: p4.alt_m - p1.alt_m,
                length_m: offsets.length(),
            },
            (Some(_), None) => return Err(LegError::OneAltitude { missing: "P3" }),
            (None, Some(_)) => return Err(LegError::OneAltitude { missing: "P2" }),
        };
        Ok(Self {
            p1,
            p2,
            p3,
            p4,
            offsets,
            origin,
            climb,
        })
    }

    /// Its start.
    #[must_use]
    pub const fn p1(&self) -> Position {
        self.p1
    }

    /// Its first control point.
    #[must_use]
    pub const fn p2(&self) -> Control {
        self.p2
    }

    /// Its second control point.
    #[must_use]
    pub const fn p3(&self) -> Control {
        self.p3
    }

    /// Its end.
    #[must_use]
    pub const fn p4(&self) -> Position {
        self.p4
    }

    /// The position at parameter `t`, 0 to 1, exactly by the definition; P1 and P4 come back bit for bit.
    #[must_use]
    pub fn at(&self, t: f64) -> Position {
        if t <= 0.0 {
            return self.p1;
        }
        if t >= 1.0 {
            return self.p4;
        }
        let ground = Ground::from_ecef(self.origin + self.offsets.at(t));
        Position::new(ground.lat_deg, ground.lon_deg, self.altitude_at(t))
    }

    /// The altitude at parameter `t`, m.
    #[must_use]
    pub fn altitude_at(&self, t: f64) -> f64 {
        match self.climb {
            Climb::Cubic([a1, a2, a3, a4]) => {
                let s = 1.0 - t;
                s * s * (s * a1 + 3.0 * t * a2) + t * t * (3.0 * s * a3 + t * a4)
            }
            Climb::Even {
                from_m,
                rise_m,
                length_m,
            } => from_m + rise_m * (self.offsets.part(0.0, t).length() / length_m).min(1.0),
        }
    }

    /// The length of the ground track, m (of the earth-centred cubic, which is what an even climb is spread over).
    #[must_use]
    pub fn length_m(&self) -> f64 {
        match self.climb {
            Climb::Even { length_m, .. } => length_m,
            Climb::Cubic(_) => self.offsets.length(),
        }
    }

    /// The control points in earth-centred coordinates, m.
    #[must_use]
    pub fn ecef(&self) -> Cubic {
        Cubic(self.offsets.0.map(|o| self.origin + o))
    }

    /// The same leg flown from P4 to P1.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let origin = self.p4.ground().to_ecef();
        let shift = self.origin - origin;
        let mut offsets = Cubic(self.offsets.reversed().0.map(|o| o + shift));
        offsets.0[0] = Vec3::ZERO;
        let climb = match self.climb {
            Climb::Cubic([a1, a2, a3, a4]) => Climb::Cubic([a4, a3, a2, a1]),
            Climb::Even {
                from_m,
                rise_m,
                length_m,
            } => Climb::Even {
                from_m: from_m + rise_m,
                rise_m: -rise_m,
                length_m,
            },
        };
        Self {
            p1: self.p4,
            p2: self.p3,
            p3: self.p2,
            p4: self.p1,
            offsets,
            origin,
            climb,
        }
    }

    /// De Casteljau's split at `t`, 0 to 1: both halves trace this leg exactly, and meet at [`BezierLeg::at`]`(t)`.
    ///
    /// A half keeps the earth-centred curve that it was cut from. Written as a message and read again, its control
    /// points are taken at height 0 again: less than a micrometre for legs of 1 km, 0.1 m at 50 km.
    #[must_use]
    pub fn split(&self, t: f64) -> (Self, Self) {
        let t = t.clamp(0.0, 1.0);
        let (a, b) = self.offsets.split(t);
        let meet = self.at(t);
        let (climb_a, climb_b) = match self.climb {
            Climb::Cubic(alt) => {
                let (a, b) = Cubic(alt.map(|z| Vec3::new(z, 0.0, 0.0))).split(t);
                (
                    Climb::Cubic(a.0.map(|v| v.x)),
                    Climb::Cubic(b.0.map(|v| v.x)),
                )
            }
            Climb::Even {
                from_m,
                rise_m,
                length_m,
            } => {
                let (first_m, whole_m) = (meet.alt_m - from_m, length_m);
                // Both lengths are integrated: by rounding, that of a part could exceed the whole.
                let cut_m = a.length().min(whole_m);
                (
                    Climb::Even {
                        from_m,
                        rise_m: first_m,
                        length_m: cut_m,
                    },
                    Climb::Even {
                        from_m: meet.alt_m,
                        rise_m: rise_m - first_m,
                        length_m: whole_m - cut_m,
                    },
                )
            }
        };
        let half = |p1, p4, offsets: Cubic, climb| {
            let alt = |i: usize| {
                if let Climb::Cubic(a) = climb {
                    Some(a[i])
                } else {
                    None
                }
            };
            let control = |i: usize| {
                let g = Ground::from_ecef(self.origin + offsets.0[i]);
                Control {
                    lat_deg: g.lat_deg,
                    lon_deg: g.lon_deg,
                    alt_m: alt(i),
                }
            };
            Self {
                p1,
                p2: control(1),
                p3: control(2),
                p4,
                offsets,
                origin: self.origin,
                climb,
            }
        };
        (
            half(self.p1, meet, a, climb_a),
            half(meet, self.p4, b, climb_b),
        )
    }

    pub(crate) const fn offsets(&self) -> &Cubic {
        &self.offsets
    }

    pub(crate) const fn origin(&self) -> Vec3 {
        self.origin
    }

    pub(crate) const fn climb(&self) -> Climb {
        self.climb
    }
}

impl Position {
    /// The same position, once its numbers are known to be finite and in range.
    ///
    /// # Errors
    /// Names the field, the value and what was expected.
    pub fn checked(self) -> Result<Self, LegError> {
        check_ground("position", self.ground())?;
        check_altitude("position", self.alt_m)?;
        Ok(self)
    }
}

/// Under this extent a leg has no length: a tenth of what 1e-7 degree resolves, m.
const SHORTEST_EXTENT_M: f64 = 1e-3;
/// Altitudes that a route may name, m: the lowest ground to above any aircraft of the kind.
const ALTITUDES_M: (f64, f64) = (-1_000.0, 100_000.0);

pub(crate) fn check_ground(point: &'static str, g: Ground) -> Result<(), LegError> {
    check_number(point, "latitude", g.lat_deg, -90.0, 90.0)?;
    check_number(point, "longitude", g.lon_deg, -180.0, 180.0)
}

pub(crate) fn check_altitude(point: &'static str, alt_m: f64) -> Result<(), LegError> {
    check_number(point, "altitude", alt_m, ALTITUDES_M.0, ALTITUDES_M.1)
}

pub(crate) fn check_reach(
    point: &'static str,
    from: &'static str,
    distance_m: f64,
    max_m: f64,
) -> Result<(), LegError> {
    if distance_m > max_m {
        Err(LegError::TooFar {
            point,
            from,
            distance_m,
            max_m,
        })
    } else {
        Ok(())
    }
}

fn check_number(
    point: &'static str,
    field: &'static str,
    value: f64,
    min: f64,
    max: f64,
) -> Result<(), LegError> {
    if !value.is_finite() {
        return Err(LegError::NotFinite {
            point,
            field,
            value,
        });
    }
    if !(min..=max).contains(&value) {
        return Err(LegError::OutOfRange {
            point,
            field,
            value,
            min,
            max,
        });
    }
    Ok(())
}
