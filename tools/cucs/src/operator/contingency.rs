//! What the VSM flies by itself while something is wrong with the vehicle: `contingency` (50023).

use std::io::Write;

use serde_json::json;
use stanag_msgs::Message;
use stanag_msgs::enums::{ContingencyAction as Action, ContingencyCause as Cause};
use stanag_msgs::messages::{Contingency, GenericInformationRequestMessage};

use super::console::{Done, Operator};
use super::verb::{ContingencyAction, ContingencyCause};

impl<W: Write> Operator<W> {
    /// Sets a contingency (50023).
    pub(super) async fn set_contingency(
        &mut self,
        cause: ContingencyCause,
        action: ContingencyAction,
        percent: Option<u8>,
    ) -> Done {
        let vehicle = self.find_vehicle().await?;
        let message = Contingency {
            contingency_cause: Some(match cause {
                ContingencyCause::Battery => Cause::Battery,
                ContingencyCause::Position => Cause::Position,
                ContingencyCause::Fence => Cause::Fence,
                ContingencyCause::Engine => Cause::Engine,
            }),
            contingency_action: Some(match action {
                ContingencyAction::AsConfigured => Action::AsConfigured,
                ContingencyAction::Hold => Action::Hold,
                ContingencyAction::Return => Action::Return,
                ContingencyAction::Land => Action::Landing,
                ContingencyAction::ContingencyA => Action::ContingencyA,
                ContingencyAction::ContingencyB => Action::ContingencyB,
            }),
            contingency_percent: percent,
            ..Contingency::default()
        };
        let outcome = self.station.set_contingency(vehicle, message).await?;
        self.finish(vehicle, "contingency set", outcome)
    }

    /// Requests the contingencies (17002 for 50023).
    pub(super) async fn contingencies(&mut self) -> Done {
        let vehicle = self.find_vehicle().await?;
        let request = GenericInformationRequestMessage {
            message_type: Some(Contingency::ID),
            ..GenericInformationRequestMessage::default()
        };
        let answers = self
            .query(vehicle, request, "contingencies (50023)")
            .await?;
        let reported: Vec<&Contingency> = answers
            .iter()
            .filter_map(|answer| match answer {
                Message::Contingency(one) => Some(one),
                _ => None,
            })
            .collect();
        if reported.is_empty() {
            let value = json!({"contingencies": []});
            self.print(&format!("{vehicle}: no contingencies"), value)?;
        }
        for one in reported {
            self.print_contingency(one)?;
        }
        Ok(())
    }

    fn print_contingency(&mut self, one: &Contingency) -> Done {
        let shown = |value: Option<String>| value.unwrap_or_else(|| "not reported".to_owned());
        let cause = shown(one.contingency_cause.map(|one| one.to_string()));
        let state = shown(one.contingency_state.map(|one| one.to_string()));
        let action = match one.contingency_action {
            Some(Action::AsConfigured) => "none".to_owned(),
            other => shown(other.map(|one| one.to_string())),
        };
        let below = one.contingency_percent;
        let percent = below.map_or_else(String::new, |percent| format!(" (below {percent} %)"));
        self.print(
            &format!("{cause}{percent}: {action}; {state}"),
            json!({"cause": cause, "action": action, "percent": below, "state": state}),
        )
    }
}
