//! A route becomes mission items for PX4, or a refusal that names the waypoint.
//!
//! Everything is validated here, since PX4 does not: it accepts latitude 200, a NaN altitude and a jump to item 99.
//!
//! | DLI | PX4 |
//! |---|---|
//! | waypoint (13002) | NAV_WAYPOINT, the altitude in the frame of its type |
//! | Waypoint to Speed (0802.10) | DO_CHANGE_SPEED before it: the speed of the leg to it; where a route has too many items, a repeated one is left out: `repeated_speeds` |
//! | Turn Type (0802.16) 0 or absent | acceptance radius 0: the vehicle's own, NAV_ACC_RAD |
//! | Turn Type 1, fly over | acceptance radius 3 m: PX4 misses smaller ones for good |
//! | loiter (13003) | NAV_LOITER_TIME or NAV_LOITER_UNLIM: `loiter` |
//! | Waypoint Type (0802.17) 1, end of a loop | DO_JUMP after it: `waypoint`; DO_CHANGE_SPEED before the jump where the loop's start names no speed and would not have that of the first lap |
//!
//! In reading order: `site` (what a route is compiled for), `compile` (waypoint by waypoint), `waypoint`, `loiter` and
//! `curve` (the items of each), `stream` (curves by set points), `brake` (where PX4 must stop), `clearance` (heights above the ground between waypoints),
//! `wings` (the limits of a wing), `landing` (how a route ends), `mission` (the result), `repeated_speeds` (what is left out of
//! one with too many items), `terrain` (the result compared with the ground), `error` (each refusal).

mod brake;
mod clearance;
mod compile;
mod curve;
#[cfg(test)]
mod curves_become_chords;
mod error;
mod item;
mod landing;
mod loiter;
mod mission;
mod repeated_speeds;
mod site;
mod stream;
mod terrain;
mod waypoint;
mod wings;

pub use compile::compile;
pub use error::{CurveError, Reason, RouteError, TerrainError};
pub(crate) use item::{DO_JUMP, degrees_e7};
pub use landing::complete;
pub use mission::{CompiledMission, Curved, Leg, StreamedLeg, StreamedRun};
pub use site::{Curving, FixedWing, Multicopter, Policy, Site, Vertices};
pub use stream::permitted as stream_permitted;
pub use terrain::check_way;
pub use wings::{Pattern, Wings};
