//! What the stream of a curve reads of the flight, and the modes that it commands.

use mapping::mode::Px4Mode;
use stanag_msgs::enums::RouteType;

use super::curve_stream::{Input, Order, StreamContext};
use super::streams::{STANDS_STILL, holds_for_set_points};
use super::{Context, Flight};
use crate::session::context::Origin;
use crate::session::effects::Effects;
use crate::session::maneuver::{self, Maneuver};

impl Flight {
    /// Lets the stream take an input, and commands the mode that it needs.
    pub(super) fn stream_curve(
        &mut self,
        context: &Context<'_>,
        input: Input,
        effects: &mut Effects<'_>,
    ) {
        if !context.bounds.curving.streamed && !self.curve_stream.is_flown() {
            return;
        }
        // Steering (mode 15) is in OFFBOARD too: there is one stream.
        let input = match self.steering.engaged() {
            true => Input::Release,
            false => input,
        };
        let (vehicle, mission) = (context.vehicle, &context.mission);
        let telemetry = &vehicle.telemetry;
        // Only what 13000 has loaded for mode 11: the loss action and contingencies know their routes by AUTO.MISSION.
        let runs = mission.uploaded.filter(|uploaded| {
            uploaded.route_type == RouteType::Flight && uploaded.mission_id != 0
        });
        let by_itself = self.loss_action.is_active() || self.contingencies.stands();
        let other = self.other(vehicle, context.mono()).is_some();
        let stream = StreamContext {
            now: context.mono(),
            system: context.config.system_id,
            mode: vehicle.settled_mode(),
            // What it showed before a stop of the bridge may be over.
            mode_at: vehicle.mode_at().filter(|_| !vehicle.awaits_mode()),
            position: telemetry.position.zip(vehicle.measured.position()),
            velocity: telemetry.velocity_ned,
            home: telemetry.home,
            mission: telemetry.mission,
            runs: runs.map(|uploaded| (uploaded.compiled.streamed.as_slice(), uploaded.mission_id)),
            maneuver: self.maneuver.is_some(),
            transferring: mission.is_transferring(),
            busy: mission.fence_busy || by_itself || other,
            parameters: context.parameters.values,
            curving: context.parameters.curving(context),
            commanded_mps: self.commanded.speed_m_s,
        };
        let streamed = self.curve_stream.is_streaming();
        let order = self.curve_stream.handle(&stream, input, effects);
        let ended = input == Input::Advance && !self.curve_stream.is_flown();
        if streamed && ended && holds_for_set_points(context) {
            self.steering.stand_aside(context.mono(), telemetry);
            effects.warn_of_link(STANDS_STILL);
        }
        let Some(order) = order else {
            return;
        };
        let modes: &'static [Px4Mode] = match order {
            Order::Enter => &[Px4Mode::OFFBOARD],
            // A mission whose last waypoint the vehicle has reached ends in a hold before it is seen. PX4 must not be
            // commanded into it once more then: it would fly the route again.
            Order::HandBack => &[Px4Mode::MISSION, Px4Mode::LOITER],
            Order::Hold => &[Px4Mode::LOITER],
        };
        if order == Order::Hold {
            let own = |origin: Option<Origin>| origin.is_none();
            self.end_running(context, "the curve is no longer streamed", own, effects);
        }
        // Not by `begin`: the stream is not superseded by what it commands, nor is a command that waits for its route. What
        // was commanded for this one, its speed, stays.
        if self.maneuver.is_none() {
            let maneuver = Maneuver::new(maneuver::enter(modes), self.commanded);
            self.run(context, None, maneuver, effects);
        }
    }
}
