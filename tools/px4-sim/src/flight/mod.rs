//! PX4's flight stack: which mode is flown, and where the vehicle goes in it.
//!
//! - [`mode`]: PX4's modes with their names and numbers.
//! - [`view`]: what the navigator knows of the vehicle, and the notes that it returns.
//! - [`commander`]: arming, the flown mode beside the requested mode, failsafes.
//! - [`items`]: what the items of an uploaded plan mean in the local frame; the geofence.
//! - [`mission`]: which item is current, where it leads, when it is done.
//! - [`navigator`]: the automatic modes.
//! - [`steering`]: sticks and OFFBOARD setpoints.
//!
//! Nothing here sends a message: texts and mode changes are returned as notes, which the vehicle sends.

pub(crate) mod commander;
pub(crate) mod feasibility;
pub(crate) mod items;
pub(crate) mod mission;
pub(crate) mod mode;
pub(crate) mod navigator;
pub(crate) mod steering;
pub(crate) mod view;
