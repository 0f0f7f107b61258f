//! Flight termination (2005): the steps, each answered by the VSM, and what 3005 reports after it.

use std::io::Write;
use std::time::Duration;

use stanag_msgs::enums::FtState;
use stanag_msgs::messages::{FlightTerminationModeReport, GenericInformationRequestMessage};

use super::console::{Done, Operator};
use super::verb::TerminationStep;
use crate::station::outcome::Outcome;

impl<W: Write> Operator<W> {
    /// 2005.
    pub(super) async fn terminate(&mut self, step: TerminationStep) -> Done {
        let vehicle = self.find_vehicle().await?;
        let (state, what) = match step {
            TerminationStep::Arm => (FtState::Arm, "flight termination armed"),
            TerminationStep::Execute => (FtState::Execute, "flight termination executed"),
            TerminationStep::Cancel => (FtState::Reset, "flight termination reset"),
        };
        let mut outcome = self.station.terminate(vehicle, state).await?;
        if outcome_is_unmeasured(&outcome) {
            // A VSM takes what must be fresh only from a station whose clock it has seen run for some seconds. Any message
            // shows it; a request for 3005 is one in every edition.
            for _ in 0..MEASURED_S {
                let request = GenericInformationRequestMessage {
                    message_type: Some(FlightTerminationModeReport::ID),
                    ..GenericInformationRequestMessage::default()
                };
                // Also refused it is a message of this station.
                let _ = self.query(vehicle, request, "3005").await;
                self.station.idle(Duration::from_secs(1)).await?;
            }
            outcome = self.station.terminate(vehicle, state).await?;
        }
        self.finish(vehicle, what, outcome)
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

/// Seconds for which a VSM must have seen a station's clock run, with one to spare.
const MEASURED_S: u32 = 4;
