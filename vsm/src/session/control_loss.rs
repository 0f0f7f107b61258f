//! The silence of holders: warned of, offered to others, acted on. Each step goes out by 16000 and 35000.

use mavlink_link::dialect::MavLandedState;
use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, HandoverStatus, RouteType, SubsystemId};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::authority::Silence;
use super::desk::Desk;
use crate::config::OnLoss;

impl Aircraft {
    /// Looks how long each holder has been silent, and does what follows.
    pub(super) fn watch_controller(&mut self, desk: &mut Desk<'_>) {
        for index in 0..desk.stations.len() {
            let Some(station) = desk.stations.get(index) else {
                continue;
            };
            let id = station.id();
            if self.authority.held(id).is_empty() {
                continue;
            }
            let silence = station.silence(desk.now.mono, &desk.loss);
            let beats = station.sends_heartbeats;
            self.remember_heartbeats(desk, id, beats);
            let controls = self.authority.controller() == Some(id);
            let commands = controls || !self.authority.held(id).stations().is_empty();
            if silence != self.authority.silence(id) && commands {
                self.decide(desk, None, |authority, at| {
                    authority.silence_of(at, id, silence)
                });
                if controls {
                    self.say_silence(desk, id, silence);
                }
            }
        }
        self.settle_authority(desk);
        self.advance_recall(desk);
    }

    fn say_silence(&mut self, desk: &mut Desk<'_>, id: Id, silence: Silence) {
        let (priority, text, status) = match silence {
            Silence::None => {
                let raised = self
                    .alerts
                    .clear(Cause::CucsSilent, "the controlling CUCS is heard again");
                let listeners = desk.listeners(&self.authority, None);
                desk.alert(self.id(), &listeners, raised);
                return self.report_handover(desk, Some(id), None, HandoverStatus::NotRequested);
            }
            Silence::Warned => (
                AlertPriority::Caution,
                format!("the controlling CUCS {id} is silent"),
                HandoverStatus::NotRequested,
            ),
            Silence::Offered => (
                AlertPriority::Warning,
                format!("the controlling CUCS {id} is silent: another may take control"),
                HandoverStatus::InProgress,
            ),
            Silence::Lost => (
                AlertPriority::Emergency,
                format!(
                    "the controlling CUCS {id} is lost, nobody controls the vehicle: {}",
                    self.what_follows(desk.loss.on_loss)
                ),
                HandoverStatus::Failed,
            ),
        };
        // Who asked before has it already: nothing is offered, and nothing is flown.
        let taken = self
            .authority
            .controller()
            .is_some_and(|holder| holder != id);
        if taken {
            return;
        }
        let raised = self
            .alerts
            .raise(Cause::CucsSilent, priority, SubsystemId::Comms, text);
        let listeners = desk.listeners(&self.authority, desk.station_of(id));
        desk.alert(self.id(), &listeners, raised);
        self.report_handover(desk, Some(id), None, status);
        if silence == Silence::Lost {
            self.begin_recall(desk);
        }
    }

    /// What is flown now that nobody controls the vehicle, as far as it is known before the vehicle shows it.
    fn what_follows(&self, on_loss: OnLoss) -> &'static str {
        let telemetry = &self.mav.telemetry;
        if !self.mav.live() {
            return match on_loss {
                OnLoss::Continue => "the vehicle is silent too",
                _ => "the vehicle is silent too, it is commanded once it is heard",
            };
        }
        if telemetry.landed == Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND) {
            return "the vehicle stands, nothing is flown";
        }
        let loaded = self.plan.route_of_type(RouteType::ContingencyA).is_some();
        match on_loss {
            OnLoss::Continue if self.steering.engaged() => {
                "the vehicle is steered no more, it is to hold"
            }
            OnLoss::Continue => "the vehicle goes on",
            OnLoss::Hold => "the vehicle is to hold",
            OnLoss::Contingency if loaded && self.may_change_mission().is_err() => {
                "another transfer is under way, the vehicle is to return"
            }
            OnLoss::Contingency if loaded => "the vehicle is to fly contingency A",
            OnLoss::Contingency => "no contingency A is known, the vehicle is to return",
            OnLoss::Rtl => "the vehicle is to return",
        }
    }
}
