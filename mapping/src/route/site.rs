//! What a route is compiled for: the vehicle, its home, the limits, and how curves are flown.

pub use curve_paths::Vertices;
use curve_paths::flight::Airframe;
pub use curve_paths::flight::{FixedWing, Multicopter, Policy};
use curve_paths::terrain::Terrain;

use super::wings::Wings;
use crate::altitude::{Agl, Altimeter, Datum};
use crate::limits::{Limits, Performance};
use crate::parameter::Parameters;
use crate::telemetry::Place;

/// What must be known about the vehicle to compile a route.
#[derive(Debug, Clone, Copy)]
pub struct Site<'a> {
    /// Home.
    pub home: Place,
    /// Height of the geoid above the ellipsoid, m, once the vehicle has reported it.
    pub geoid_m: Option<f64>,
    /// How AGL is flown.
    pub agl: Agl,
    /// The reference of pressure altitudes.
    pub altimeter: Altimeter,
    /// The ground, if elevation files are configured: the reference of AGL if `agl` selects it, and what a route is compared
    /// with.
    pub terrain: Option<&'a Terrain>,
    /// Its wings; `None` for a multicopter. A VTOL flies its routes on them, except for the legs on which it was commanded
    /// to hover.
    pub wings: Option<Wings>,
    /// Bounds.
    pub limits: Limits,
    /// The vehicle's performance, and its defaults.
    pub performance: Performance,
    /// How curved legs are flown.
    pub curving: Curving,
}

impl<'a> Site<'a> {
    /// Whether the vehicle can stand still on its route.
    #[must_use]
    pub fn hovers(&self) -> bool {
        self.wings.is_none()
    }

    /// The references of altitudes.
    pub(super) fn datum(&self) -> Datum<'a> {
        Datum {
            geoid_m: self.geoid_m,
            agl: self.agl,
            altimeter: self.altimeter,
            terrain: self.terrain,
        }
    }

    /// How the vehicle flies its curves.
    pub(super) fn airframe(&self) -> Airframe {
        if self.hovers() {
            Airframe::Multicopter(self.curving.multicopter)
        } else {
            Airframe::FixedWing(self.curving.fixed_wing)
        }
    }

    /// A VTOL while it hovers: a multicopter with that performance; `None` for another airframe.
    pub(super) fn hovering(&self) -> Option<Site<'a>> {
        Some(Site {
            wings: None,
            performance: self.wings?.hover?,
            ..*self
        })
    }
}

/// How curved legs are flown: `vehicle.curve`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curving {
    /// Largest planned deviation, m.
    pub tolerance_m: f64,
    /// What to do where a curve is too tight for the speed.
    pub policy: Policy,
    /// Whether vertices may leave the curve by up to the tolerance.
    pub vertices: Vertices,
    /// Whether curves are streamed where they can be, in place of their chords.
    pub streamed: bool,
    /// What a vehicle that hovers can do.
    pub multicopter: Multicopter,
    /// What one that does not can do.
    pub fixed_wing: FixedWing,
}

impl Default for Curving {
    fn default() -> Self {
        Curving {
            tolerance_m: 1.0,
            policy: Policy::Slow,
            vertices: Vertices::OnCurve,
            streamed: false,
            multicopter: Multicopter::default(),
            fixed_wing: FixedWing::default(),
        }
    }
}

impl Curving {
    /// Applies the vehicle's own parameters; what it has not reported stays the default.
    pub fn know(&mut self, parameters: &Parameters) {
        let mut quad = Airframe::Multicopter(self.multicopter);
        let mut plane = Airframe::FixedWing(self.fixed_wing);
        for name in Airframe::NAMES {
            if let Some(value) = parameters.get(name) {
                // A value out of range counts as not reported.
                let _ = quad.set(name, value);
                let _ = plane.set(name, value);
            }
        }
        if let (Airframe::Multicopter(quad), Airframe::FixedWing(plane)) = (quad, plane) {
            (self.multicopter, self.fixed_wing) = (quad, plane);
        }
    }
}
