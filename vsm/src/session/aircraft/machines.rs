//! The eight machines: each input borrows what the machine reads and the effects that it may have.

use stanag_msgs::enums::AckType;

use super::{Aircraft, Context, Effects};
use crate::session::effects::DliEffects;
use crate::session::{authority, flight, held, mission, payload, reports, termination};

impl Aircraft {
    /// Requests operator control of the vehicle while a CUCS controls it through this VSM, and releases it afterwards.
    pub(super) fn hold_operator_control(&mut self, dli: &mut DliEffects<'_>) {
        let wanted = self.authority.controller().is_some()
            || self.flight.view().commands_by_itself
            || self.termination.view(true).holds;
        self.link
            .operator_control
            .hold(wanted, &self.vehicle, effects!(self, dli));
    }

    pub(super) fn authority(
        &mut self,
        dli: &mut DliEffects<'_>,
        input: authority::Input<'_>,
    ) -> AckType {
        let (vehicle, on_loss) = (&self.vehicle, self.settings.authority.on_loss);
        let mission = self.mission.view(vehicle, &self.services);
        let steering = self.flight.steers(&vehicle.telemetry);
        let controller = self.authority.controller();
        let context = authority::Context {
            common: context!(self, dli),
            mission,
            steering,
            other: self.flight.other(vehicle, dli.now.mono),
            contingency_first: self.flight.contingency_first(on_loss, vehicle),
            shows_loss_action: self.flight.shows_loss_action(on_loss, vehicle, &mission),
            held_for_loss: controller.and_then(|id| self.held.flown_for_loss_of(id, steering)),
        };
        self.authority.handle(&context, input, effects!(self, dli))
    }

    pub(super) fn mission(&mut self, dli: &mut DliEffects<'_>, input: mission::Input<'_>) {
        let context = mission::Context {
            common: context!(self, dli),
            flight: self.flight.view(),
            parameters: self.reports.parameters(),
            rights: self.authority.rights(),
        };
        self.mission.handle(&context, input, effects!(self, dli));
    }

    pub(super) fn flight(&mut self, dli: &mut DliEffects<'_>, input: flight::Input<'_>) {
        let context = flight::Context {
            common: context!(self, dli),
            mission: self.mission.view(&self.vehicle, &self.services),
            parameters: self.reports.parameters(),
        };
        self.flight.handle(&context, input, effects!(self, dli));
    }

    pub(super) fn held(&mut self, dli: &mut DliEffects<'_>, input: held::Input<'_>) {
        let context = held::Context {
            common: context!(self, dli),
            mission: self.mission.view(&self.vehicle, &self.services),
            flight: self.flight.view(),
            other: self.flight.shown_other(&self.vehicle, dli.now.mono),
            only_holds: self.flight.only_holds(dli.now.mono),
            rights: self.authority.rights(),
        };
        self.held.handle(&context, input, effects!(self, dli));
    }

    pub(super) fn payload(&mut self, dli: &mut DliEffects<'_>, input: payload::Input<'_>) {
        let context = payload::Context {
            common: context!(self, dli),
            rights: self.authority.rights(),
            altimeter: self.flight.view().altimeter,
        };
        self.payload.handle(&context, input, effects!(self, dli));
    }

    pub(super) fn terminate(&mut self, dli: &mut DliEffects<'_>, input: termination::Input<'_>) {
        let context = context!(self, dli);
        self.termination
            .handle(&context, input, effects!(self, dli));
    }

    pub(super) fn reports(
        &mut self,
        dli: &mut DliEffects<'_>,
        input: reports::Input<'_>,
    ) -> Result<(), String> {
        let context = reports::Context {
            common: context!(self, dli),
            mission: self.mission.view(&self.vehicle, &self.services),
            flight: self.flight.view(),
            payload: self.payload.view(self.authority.rights()),
            link: self
                .link
                .data_link(dli.now.mono, &self.vehicle, &self.services.clock),
        };
        self.reports.handle(&context, input, effects!(self, dli))
    }

    /// An input of the reports machine that needs no answer of the caller.
    pub(super) fn observe(&mut self, dli: &mut DliEffects<'_>, input: reports::Input<'_>) {
        let answered = self.reports(dli, input);
        debug_assert!(
            answered.is_ok(),
            "only 17001 and 17002 are answered by the caller"
        );
    }
}
