//! Commands that are held until a condition is met: `hold`, `held` and `cancel --held` (50020 to 50022).

use std::io::Write;

use serde_json::json;
use stanag_msgs::Message;
use stanag_msgs::enums::HoldKind;
use stanag_msgs::messages::{
    GenericInformationRequestMessage, HeldCommandCancel, HeldCommandState, HoldCommand,
};

use super::console::{Done, Operator};
use super::until::Until;
use super::verb::HoldArguments;
use crate::station::held::Holding;

impl<W: Write> Operator<W> {
    /// Sends 50020.
    pub(super) async fn hold(&mut self, arguments: &HoldArguments) -> Done {
        let vehicle = self.find_vehicle().await?;
        let mut hold = HoldCommand {
            held_command_number: Some(arguments.number),
            hold_kind: Some(if arguments.contingency {
                HoldKind::Contingency
            } else {
                HoldKind::Command
            }),
            valid_for: Some(arguments.valid_s),
            ..HoldCommand::default()
        };
        arguments.until.apply(&mut hold);
        let after_s = match arguments.until {
            Until::Time(seconds) => Some(seconds),
            _ => None,
        };
        let command = super::run::mode_command(&arguments.command)?;
        let holding = Holding {
            hold,
            after_s,
            command: command.into(),
        };
        let outcome = self.station.hold(vehicle, holding).await?;
        let what = format!(
            "held command {} waits; `cucs held` shows what becomes of it",
            arguments.number
        );
        self.finish(vehicle, &what, outcome)
    }

    /// Sends 50021; number 0 cancels all of this CUCS.
    pub(super) async fn cancel_held(&mut self, number: u16) -> Done {
        let vehicle = self.find_vehicle().await?;
        let cancel = HeldCommandCancel {
            held_command_number: Some(number),
            ..HeldCommandCancel::default()
        };
        let outcome = self.station.cancel_held(vehicle, cancel).await?;
        self.finish(vehicle, "held commands cancelled", outcome)
    }

    /// Requests the held commands (17002 for 50022).
    pub(super) async fn held(&mut self) -> Done {
        let vehicle = self.find_vehicle().await?;
        let request = GenericInformationRequestMessage {
            message_type: Some(HeldCommandState::ID),
            ..GenericInformationRequestMessage::default()
        };
        let answers = self
            .query(vehicle, request, "held commands (50022)")
            .await?;
        let mut any = false;
        for answer in &answers {
            let Message::HeldCommandState(state) = answer else {
                continue;
            };
            any = true;
            self.print_held(state)?;
        }
        if !any {
            self.print(&format!("{vehicle}: no held commands"), json!({"held": []}))?;
        }
        Ok(())
    }

    fn print_held(&mut self, state: &HeldCommandState) -> Done {
        let number = state.held_command_number.unwrap_or_default();
        let kind = state.held_message_type.unwrap_or_default();
        let owner = state.owner_id.map(|id| id.to_string()).unwrap_or_default();
        let shown = |value: Option<String>| value.unwrap_or_else(|| "not reported".to_owned());
        let condition = shown(state.hold_condition.map(|one| one.to_string()));
        let became = shown(state.held_state.map(|one| one.to_string()));
        let reason = state.reason.as_ref().map(|text| text.as_str().to_owned());
        let because = reason
            .as_ref()
            .map_or_else(String::new, |text| format!(": {text}"));
        let kept = if state.hold_kind == Some(HoldKind::Contingency) {
            " (contingency)"
        } else {
            ""
        };
        self.print(
            &format!("{owner} {number}{kept}: message {kind}, until {condition}: {became}{because}"),
            json!({
                "owner": owner, "held": number, "message": kind, "condition": condition, "state": became,
                "contingency": state.hold_kind == Some(HoldKind::Contingency), "reason": reason,
            }),
        )
    }
}
