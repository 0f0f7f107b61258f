//! Pure functions between STANAG 4586 and MAVLink: no state, no clock, no I/O.
//!
//! - [`payload`]: payload stations, where they look, and messages 21000, 21100 and 21101.
//! - [`plan`]: the routes and waypoints that a CUCS has sent, as DLI messages, and what is wrong with one by itself.
//! - [`route`]: a route of a plan becomes mission items, or a refusal that names the waypoint.
//! - [`mode`]: flight path control modes and PX4's modes.
//! - [`area`]: areas to stay inside or outside, and PX4's geofence.
//! - [`rally`]: places to return to beside home.
//! - [`altitude`]: altitude types and MAVLink frames.
//! - [`telemetry`]: the latest values of the vehicle's messages, its sensors and software included.
//! - [`attitude`]: of the vehicle, and what it was at the moment of its position.
//! - [`evidence`]: what contingencies are judged by, report by report.
//! - [`report`]: messages 3001, 3002, 4000 and 4001 from that.
//! - [`status`]: messages 3000, 3004 to 3010, 12101, 16001 and 50013.
//! - [`alert`]: texts and faults to message 16000.
//! - [`configuration`]: the answers of the configuration phase, from what the vehicle is.
//! - [`hardening`]: PX4's settings that weaken the link, from parameter values to findings.
//! - [`event`]: the vehicle's events as texts, by its own metadata.
//! - [`health`]: what is wrong with a vehicle, by its own messages.
//! - [`limits`]: what a route must stay within, and how fast the vehicle can be commanded to fly.
//! - [`parameter`]: the vehicle's parameters, what may be written to each, and message 50012.
//! - [`parameter_metadata`]: the vehicle's own metadata of them.
//! - [`support`]: what this VSM does with each field of each message.
//!
//! A route of one waypoint, 30 m above home, becomes one mission item:
//!
//! ```
//! use mapping::altitude::{Agl, Altimeter};
//! use mapping::limits::{Limits, Performance};
//! use mapping::route::{Curving, Reason, Site, compile};
//! use mapping::{plan::Plan, telemetry::Place};
//! use stanag_msgs::enums::AltitudeType;
//! use stanag_msgs::messages::{UaPositionWaypoint, UaRoute};
//! use stanag_msgs::{Bam32, Id, Scaled};
//!
//! let route = UaRoute { initial_waypoint_number: Some(7), ..UaRoute::default() };
//! let waypoint = UaPositionWaypoint {
//!     waypoint_number: Some(7),
//!     waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(47.398)),
//!     waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(8.546)),
//!     waypoint_to_altitude: Some(Scaled::from_si(30.0)?),
//!     waypoint_altitude_type: Some(AltitudeType::Agl),
//!     ..UaPositionWaypoint::default()
//! };
//! let (cucs, vehicle) = (Id(0x1b00_00a0), Id(0x1b00_0101));
//! let mut plan = Plan::default();
//! plan.store(&route.into(), cucs, vehicle)?;
//! plan.store(&waypoint.into(), cucs, vehicle)?;
//!
//! let site = Site {
//!     home: Place { latitude: 47.3977, longitude: 8.5456, amsl_m: 488.0 },
//!     geoid_m: Some(47.4),
//!     agl: Agl::AboveHome,
//!     terrain: None,
//!     altimeter: Altimeter::STANDARD,
//!     wings: None,
//!     limits: Limits::default(),
//!     performance: Performance::default(),
//!     curving: Curving::default(),
//! };
//! let mission = compile(&plan, 7, &site)?;
//! assert_eq!(mission.first_item_of(7), Some(0));
//! assert_eq!((mission.items[0].x, mission.items[0].z), (473_980_000, 30.0));
//!
//! // What cannot be flown is refused with the waypoint and the reason.
//! let refused = compile(&plan, 9, &site).unwrap_err();
//! assert_eq!((refused.waypoint, refused.reason), (9, Reason::Unknown));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod action;
pub mod airframe;
pub mod alert;
pub mod altitude;
pub mod area;
pub mod attitude;
pub mod configuration;
pub mod data_link;
pub mod equipment;
pub mod equipment_reports;
pub mod event;
pub mod evidence;
pub mod hardening;
pub mod health;
pub mod limits;
pub mod mode;
pub mod parameter;
pub mod parameter_metadata;
pub mod payload;
pub mod plan;
pub mod rally;
pub mod report;
pub mod route;
pub mod status;
pub mod support;
pub mod telemetry;
