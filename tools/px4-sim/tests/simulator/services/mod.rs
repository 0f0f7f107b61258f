//! Both ends of the services over a network that loses, duplicates, delays and reorders.
//!
//! Every run is a function of its seed. Time is virtual.

mod any_message;
mod files;
mod missions;
mod network;
mod parameters;
mod recorded_missions;

use mavlink_link::service::Node;

const US: Node = Node::new(255, 190);
const PX4: Node = Node::new(1, 1);
