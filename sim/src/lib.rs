//! A simulated PX4 and a CUCS: what the demo, the tests and users without either stand on.
//!
//! ```
//! use sim::px4::{LinkAddress, Simulator, SimulatorConfig};
//!
//! # #[tokio::main(flavor = "current_thread")]
//! # async fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let link: LinkAddress = "udpin:127.0.0.1:0".parse()?;
//! let vehicle = Simulator::spawn(SimulatorConfig { speed: 10.0, ..SimulatorConfig::on(link) }).await?;
//! assert!(vehicle.address(0).is_some_and(|at| at.port() != 0));
//! assert_eq!(vehicle.counters().vehicle.commands_accepted, 0);
//! vehicle.stop().await;
//! # Ok(())
//! # }
//! ```

pub mod cucs;
pub mod px4;
