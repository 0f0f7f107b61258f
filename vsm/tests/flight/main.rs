//! The bridge between simulated vehicles and ground stations, in one process under a virtual clock (`kit::bridge`).
//!
//! One file for each behaviour:
//!
//! - whole flights: `whole_route`, `lossy_links`, `restarts`, `full_disk`, `faults`, `many_at_once`, `shared_link`,
//!   `captures_as_vehicles`
//! - routes: `routes_by_type`, `route_refusals`, `above_terrain`, `plan_actions`, `refused_uploads`, `route_progress`, `left_out_speeds`, `curves`, `streamed_curves`, `climbs`, `after_a_return`,
//!   `mission_watchdog`, `fence`, `altitude_band`, `rally`, `wings`
//! - commands: `by_hand`, `holds`, `commands_without_a_mode`, `mode_retries`, `overtaken_commands`, `refusals_have_reasons`,
//!   `commands_survive_a_restart`, `replayed_commands`, `repeated_commands`, `forged_time_stamps`
//! - commands that wait, and what is flown by itself: `held_commands`, `contingencies`
//! - the order of effects: `effects_order`; another configuration while it runs: `reload`
//! - how stations are spoken to: `station_profiles`
//! - who may command: `guarded`, `web_clients`, `false_data`, `forward`, `forged_addresses`, `operator_control`, `loss_of_authority`, `loss_action`, `paused`
//! - payload stations: `payload`, `payload_at_waypoints`
//! - a station of Edition 2.5: `edition_25`
//! - reports: `status`, `equipment`, `time_of_validity`, `commanded_values`, `reports_in_time`, `health_alerts`, `configuration_phase`,
//!   `vehicle_services`

mod above_terrain;
mod access_list;
mod after_a_return;
mod altitude_band;
mod by_hand;
mod captures_as_vehicles;
mod climbs;
mod commanded_values;
mod commands_survive_a_restart;
mod commands_without_a_mode;
mod configuration_phase;
mod contingencies;
mod controls;
mod curves;
mod edition_25;
mod effects_order;
mod equipment;
mod events;
mod false_data;
mod faults;
mod fence;
mod files;
mod findings;

mod forged_addresses;
mod forged_time_stamps;
mod forward;
mod full_disk;
mod guarded;
mod guarded_group;
mod health_alerts;
mod held_commands;
mod holds;
mod left_out_speeds;
mod loss_action;
mod loss_of_authority;
mod lossy_links;
mod many_at_once;
mod mission_watchdog;
mod mode_retries;
mod operator_control;
mod overtaken_commands;
mod paused;
mod payload;
mod payload_at_waypoints;
mod plan_actions;
mod rally;
mod refusals_have_reasons;
mod refused_uploads;
mod reload;
mod repeated_commands;
mod replayed_commands;
mod reports_in_time;
mod restarts;
mod route_progress;
mod route_refusals;
mod routes_by_type;
mod shared_link;
mod slow_radio;
mod station_profiles;
mod status;
mod streamed_curves;
mod termination;
mod time_of_validity;
mod unanswered;
mod vehicle_services;
mod web_clients;
mod whole_route;
mod wings;
mod zeroize;
