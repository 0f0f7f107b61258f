//! Flight termination (2005) and zeroize (50024): the steps, each answered by the VSM.

use std::io::Write;
use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::FtState;
use stanag_msgs::messages::{FlightTerminationModeReport, GenericInformationRequestMessage};

use super::console::{Done, Operator};
use super::verb::TwoSteps;
use crate::station::outcome::{Outcome, StationError};

/// What needs two steps.
#[derive(Debug, Clone, Copy)]
pub(super) enum Ordered {
    Termination,
    Zeroize,
}

impl<W: Write> Operator<W> {
    /// Sends 2005 or 50024.
    pub(super) async fn two_steps(&mut self, step: TwoSteps, what: Ordered) -> Done {
        let vehicle = self.find_vehicle().await?;
        let (state, done) = match step {
            TwoSteps::Arm => (FtState::Arm, "armed"),
            TwoSteps::Execute => (FtState::Execute, "executed"),
            TwoSteps::Cancel => (FtState::Reset, "reset"),
        };
        let mut outcome = self.order(vehicle, state, what).await?;
        if outcome_is_unmeasured(&outcome) {
            // A VSM accepts orders that must be fresh only from a station whose clock it has measured for some
            // seconds. It measures by any message; a request for 3005 exists in every edition.
            for _ in 0..MEASURED_S {
                let request = GenericInformationRequestMessage {
                    message_type: Some(FlightTerminationModeReport::ID),
                    ..GenericInformationRequestMessage::default()
                };
                // A refused request is a message of this station too, so the result does not matter.
                let _ = self.query(vehicle, request, "3005").await;
                self.station.idle(Duration::from_secs(1)).await?;
            }
            outcome = self.order(vehicle, state, what).await?;
        }
        let name = match what {
            Ordered::Termination => "flight termination",
            Ordered::Zeroize => "zeroize",
        };
        self.finish(vehicle, &format!("{name} {done}"), outcome)
    }

    async fn order(
        &mut self,
        vehicle: Id,
        state: FtState,
        what: Ordered,
    ) -> Result<Outcome, StationError> {
        match what {
            Ordered::Termination => self.station.terminate(vehicle, state).await,
            Ordered::Zeroize => self.station.zeroize(vehicle, state).await,
        }
    }
}

fn outcome_is_unmeasured(outcome: &Outcome) -> bool {
    match outcome {
        Outcome::CarriedOut => false,
        Outcome::Refused(refused) => refused
            .reasons
            .iter()
            .any(|reason| reason.contains("not measured yet")),
    }
}

/// Seconds for which a VSM measures a station's clock, with one to spare.
const MEASURED_S: u32 = 4;
