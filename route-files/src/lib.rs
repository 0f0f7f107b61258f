//! The files that routes, geofences and rally points are kept in, and the messages of the DLI that a route becomes.
//!
//! One reader for whoever takes such a file: a ground station that uploads it (`cucs`), the planning program (`curve-plan`), and the
//! bridge, for a web client that has only the file.
//!
//! - [`formats`]: the kinds of file, distinguished by their ending, and what of each is not taken;
//! - [`route`]: a route, its own file, and the messages that carry it;
//! - [`fence`]: the areas of a geofence;
//! - [`download`]: a plan as a vehicle sends it, back into a route.
//!
//! Nothing here speaks MAVLink or knows a socket. Whatever a file holds, reading it ends in a route or an error that names the line.

#![forbid(unsafe_code)]

pub mod download;
pub mod fence;
pub mod formats;
pub mod route;

pub use download::Download;
pub use route::model::{
    Curve, CurveForm, FurtherRoute, Loiter, LoiterSpan, Loop, Place, Route, RouteError, Waypoint,
};
pub use route::read::RouteFileError;
