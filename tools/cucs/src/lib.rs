//! A scriptable CUCS: the ground station's side of the Data Link Interface.
//!
//! Two layers. [`Session`] is a machine without socket or clock: datagrams and the time go in, datagrams and events
//! come out; it stamps, packs, retransmits and matches acknowledgements, and keeps what each vehicle last reported.
//! [`Station`] puts it on a UDP socket and offers what an operator does as methods: discover, take control, send a
//! route, launch, fly, land, release. [`Operator`] is the same in words, for the program `cucs` and for scripts.
//!
//! Nothing received can make any of them panic, block or grow without bound.

mod alert;
mod configuration;
mod download;
pub mod fence;
mod operator;
mod outcome;
pub mod program;
mod report;
mod route;
mod script;
mod sender;
mod session;
mod stamping;
mod station;
mod time;
mod traffic;
mod vehicle;
mod verb;

pub use alert::Alert;
pub use configuration::ConfigurationTable;
pub use download::Download;
pub use operator::{Operator, OperatorError, Style};
pub use outcome::{Outcome, Refused, StationError, Timeouts};
pub use route::{
    Curve, CurveForm, Loiter, LoiterSpan, Loop, Place, Route, RouteError, RouteFileError, Waypoint,
};
pub use script::{Line, ScriptError, parse_line};
pub use sender::{Delivery, Ticket};
pub use session::{Event, Session, SessionConfig};
pub use station::{Discovered, LoiterAt, Station};
pub use time::Now;
pub use traffic::{ByType, Traffic};
pub use vehicle::{Position, Vehicle};
pub use verb::{
    AltitudeName, Condition, Degrees, HandoverVerb, LoiList, ModeArguments, ModeName, Verb,
};
