//! A route as the files have it: waypoints, curves between them, and what to call it.

use std::path::Path;

use curve_paths::fit::Fitted;
use curve_paths::{BezierLeg, Control, Leg, Position};

use crate::failure::Failure;

/// A waypoint and, where the leg to the next one is curved, its control points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Waypoint {
    pub(crate) position: Position,
    /// The line of the file that it stood on, where there is one to name.
    pub(crate) line: Option<u64>,
    /// P2 and P3 of the leg that starts here.
    pub(crate) curve: Option<[Control; 2]>,
}

impl Waypoint {
    pub(crate) const fn straight(position: Position, line: Option<u64>) -> Self {
        Self {
            position,
            line,
            curve: None,
        }
    }
}

/// A route.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Route {
    pub(crate) name: String,
    /// Whether the last waypoint's leg leads back to the first.
    pub(crate) closed: bool,
    pub(crate) waypoints: Vec<Waypoint>,
    /// Items of the file that say nothing about the path, and were left out.
    pub(crate) skipped: usize,
}

impl Route {
    /// The legs, each checked.
    pub(crate) fn legs(&self, file: &Path) -> Result<Vec<Leg>, Failure> {
        let n = self.waypoints.len();
        if n < 2 {
            return Err(Failure::file(
                file,
                format!("{n} waypoints, expected at least 2"),
            ));
        }
        for (k, w) in self.waypoints.iter().enumerate() {
            w.position
                .checked()
                .map_err(|e| Failure::at(file, w.line, format!("waypoint {}", k + 1), e))?;
        }
        let last = if self.closed { n } else { n - 1 };
        (0..last)
            .map(|k| {
                let (from, to) = (&self.waypoints[k], &self.waypoints[(k + 1) % n]);
                match from.curve {
                    Some([p2, p3]) => {
                        BezierLeg::new(from.position, p2, p3, to.position).map(Leg::from)
                    }
                    None => Leg::straight(from.position, to.position),
                }
                .map_err(|e| {
                    Failure::at(file, from.line, format!("leg from waypoint {}", k + 1), e)
                })
            })
            .collect()
    }

    /// A route of cubic legs, as a fit yields them.
    pub(crate) fn of_fit(name: &str, fitted: &Fitted, closed: bool) -> Self {
        let mut waypoints: Vec<Waypoint> = fitted
            .legs
            .iter()
            .map(|leg| Waypoint {
                position: leg.p1(),
                line: None,
                curve: Some([leg.p2(), leg.p3()]),
            })
            .collect();
        if let (false, Some(leg)) = (closed, fitted.legs.last()) {
            waypoints.push(Waypoint::straight(leg.p4(), None));
        }
        Self {
            name: name.to_owned(),
            closed,
            waypoints,
            skipped: 0,
        }
    }

    /// Whether any leg is curved.
    pub(crate) fn is_curved(&self) -> bool {
        self.waypoints.iter().any(|w| w.curve.is_some())
    }
}
