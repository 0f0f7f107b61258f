//! A route becomes mission items for PX4, or a refusal that names the waypoint.
//!
//! Everything is validated here, since PX4 is no check: it takes latitude 200, a NaN altitude and a jump to item 99.
//!
//! | DLI | PX4 |
//! |---|---|
//! | waypoint (13002) | NAV_WAYPOINT, the altitude in the frame of its type |
//! | Waypoint to Speed (0802.10) | DO_CHANGE_SPEED before it: the speed of the leg to it |
//! | Turn Type (0802.16) 0 or absent | acceptance radius 0: the vehicle's own, NAV_ACC_RAD |
//! | Turn Type 1, fly over | acceptance radius 3 m: PX4 misses smaller ones for good |
//! | loiter (13003) | NAV_LOITER_TIME or NAV_LOITER_UNLIM: `loiter` |
//! | Waypoint Type (0802.17) 1, end of a loop | DO_JUMP after it: `loops` |

mod bounds;
mod compiled;
mod curved_leg;
mod draft;
mod fault;
pub(crate) mod item;
mod waypoint;

pub use bounds::{Limits, height, metres};
pub use compiled::{CompiledMission, Leg};
pub use fault::{Reason, RouteError};

use self::draft::Draft;
use crate::altitude::{Agl, Altimeter};
use crate::budget;
use crate::curve::Curving;
use crate::performance::Performance;
use crate::plan::Plan;
use crate::telemetry::Place;

/// What must be known of the vehicle to fly a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Home.
    pub home: Place,
    /// Height of the geoid above the ellipsoid, m, once the vehicle has told it.
    pub geoid_m: Option<f64>,
    /// How AGL is flown.
    pub agl: Agl,
    /// What pressure altitudes are flown by.
    pub altimeter: Altimeter,
    /// Whether it can stand still.
    pub hovers: bool,
    /// Bounds.
    pub limits: Limits,
    /// What it can, and does by itself.
    pub performance: Performance,
    /// How curved legs are flown.
    pub curving: Curving,
}

/// Makes the mission of the route that starts at `initial`. Where its curves become too many items, they are flown
/// within the smallest tolerance that the items allow, and the notes say so.
///
/// # Errors
/// The first waypoint, in flying order, that cannot be flown, and why. Nothing is half done.
pub fn compile(plan: &Plan, initial: u16, site: &Site) -> Result<CompiledMission, RouteError> {
    let mut compiled = match compile_within(plan, initial, site) {
        Err(RouteError {
            waypoint,
            reason: Reason::TooManyItems(items),
        }) => budget::compile(plan, initial, site)?.ok_or(RouteError {
            waypoint,
            reason: Reason::TooManyItems(items),
        })?,
        other => other?,
    };
    if let Some(curved) = compiled.curved {
        let note = curved.note(site.curving.tolerance_m, site.limits.items);
        compiled.notes.push(note);
    }
    Ok(compiled)
}

/// The mission, its curves within the tolerance of the site.
pub(crate) fn compile_within(
    plan: &Plan,
    initial: u16,
    site: &Site,
) -> Result<CompiledMission, RouteError> {
    if let Some((p1, p4)) = plan.curve_without_end() {
        let (waypoint, reason) = match plan.waypoint(p1) {
            None => (p1, Reason::CurveWithoutEnd(p4)),
            Some(start) if start.next_waypoint == Some(p4) => (p4, Reason::CurveWithoutP4(p1)),
            Some(_) => (p4, Reason::CurveWithoutEnd(p1)),
        };
        return Err(RouteError { waypoint, reason });
    }
    let mut draft = Draft::new(plan, site);
    let mut next = initial;
    while next != 0 {
        next = draft.add(next)?;
    }
    draft.finish().ok_or(RouteError {
        waypoint: initial,
        reason: Reason::Unknown,
    })
}
