//! A scriptable CUCS: the ground station's side of the Data Link Interface (DLI).
//!
//! Two layers. [`Session`] is a state machine without socket or clock: datagrams and the time go in, datagrams and
//! events come out. It stamps, packs, retransmits and matches acknowledgements, and keeps what each vehicle last
//! reported. [`Station`] runs it on a UDP socket and has a method for each thing that an operator does: discover,
//! take control, send a route, launch, fly, land, release. [`Operator`] offers the same as text commands, for the
//! program `cucs` and for scripts.
//!
//! The folders, each built on those before it: `session` (without I/O), `station` (UDP), `operator` (subcommands and
//! scripts). Routes and their files are the crate `route-files`. Nothing here uses MAVLink: whatever a CUCS may need
//! has to be in the DLI.
//!
//! Nothing that is received can make any of them panic, block or grow without bound.

mod operator;
pub mod program;
mod session;
mod station;

pub use operator::configuration::ConfigurationTable;
pub use operator::console::{Operator, Style};
pub use operator::error::OperatorError;
pub use operator::payload::{FocusTo, PayloadAction, PayloadArguments, Sensor, Switch, ZoomTo};
pub use operator::script::{Line, ScriptError, parse_line};
pub use operator::verb::{Condition, HandoverVerb, LoiList, ModeArguments, Verb};
pub use route_files::{
    Curve, CurveForm, Download, FurtherRoute, Loiter, LoiterSpan, Loop, Place, Route, RouteError,
    RouteFileError, Waypoint, fence, formats,
};
pub use session::alert::Alert;
pub use session::edition_25::NoCounterpart;
pub use session::machine::{Event, Session};
pub use session::sender::{Delivery, Edition, Now, SendError, SessionConfig, Ticket};
pub use session::traffic::{ByType, Traffic};
pub use session::vehicle::{Position, Vehicle};
pub use station::command::{LoiterAt, launch_command, mode_command};
pub use station::endpoint::Station;
pub use station::outcome::{Outcome, Refused, StationError, Timeouts};
pub use station::rights::Discovered;
