//! Engines and lights: 2008 as arming and disarming by PX4's own rules, 2007 as far as PX4 has lights.
//!
//! PX4 arms all motors together: an Engine Number says nothing but that the vehicle must have that engine. It is never
//! forced: PX4 refuses to disarm in the air and to arm what is not ready, and its reason is passed on. It is put in
//! AUTO.LOITER before it is armed on the ground: armed in AUTO.MISSION it would take off at once.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::status;
use stanag_msgs::enums::{AckType, CommandedEngineState as Wanted, OffOnNotspec, ReverseThrust};
use stanag_msgs::messages::{EngineCommand, UnmannedAircraftLights};

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};
use super::maneuver::{self, Confirmation, Maneuver, Step};

impl Aircraft {
    /// 2008.
    pub(super) fn command_engine(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        command: &EngineCommand,
    ) {
        desk.acknowledge(self.id(), &origin, AckType::Received);
        if !self.mav.live() {
            let why = "the vehicle is silent: no command can be confirmed".to_owned();
            return self.refuse(desk, Some(origin), why);
        }
        match self.engine_steps(command) {
            Ok((wanted, steps)) => {
                self.engine_command = Some(wanted);
                self.begin(desk, Some(origin), Maneuver::new(steps, self.commanded));
            }
            Err(why) => self.refuse(desk, Some(origin), why),
        }
    }

    fn engine_steps(&self, command: &EngineCommand) -> Result<(Wanted, Vec<Step>), String> {
        let vehicle = &self.mav.telemetry;
        let engines = status::engines(vehicle);
        if let Some(number) = command.engine_number
            && engines > 0
            && number > engines
        {
            return Err(format!("Engine Number {number}, it has {engines}"));
        }
        if matches!(
            command.reverse_thrust,
            Some(ReverseThrust::On | ReverseThrust::Auto)
        ) || command.reverse_thrust_power == Some(OffOnNotspec::On)
        {
            return Err("PX4 has no command for reverse thrust".to_owned());
        }
        if command.ignition_switch_power == Some(OffOnNotspec::On)
            || command.ignition_switch_activation == Some(OffOnNotspec::On)
        {
            return Err("PX4 has no command for an ignition".to_owned());
        }
        let wanted = command.engine_command.ok_or("Engine Command is missing")?;
        let arm = |armed: bool| {
            let (what, confirmation) = if armed {
                ("arming", Confirmation::Armed)
            } else {
                ("disarming", Confirmation::Disarmed)
            };
            let command = Step::Command {
                command: maneuver::arm(armed),
                what,
                patience: if armed { ARM_PATIENCE } else { Duration::ZERO },
            };
            let confirm = Step::Confirm {
                confirmation,
                within: STATE_WITHIN,
            };
            [command, confirm]
        };
        match wanted {
            Wanted::Stop => Ok((wanted, arm(false).into())),
            Wanted::Start | Wanted::Enable if vehicle.armed == Some(true) => {
                Ok((wanted, Vec::new()))
            }
            Wanted::Start | Wanted::Enable => {
                let mut steps: Vec<Step> = maneuver::enter(&[Px4Mode::LOITER]).into();
                steps.extend(arm(true));
                Ok((wanted, steps))
            }
            other => Err(format!("Engine Command {} is not known", other.raw())),
        }
    }

    /// 2007.
    pub(super) fn command_lights(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        _lights: &UnmannedAircraftLights,
    ) {
        let why = "PX4 takes no command for lights: they show its state".to_owned();
        self.refuse(desk, Some(origin), why);
    }
}

/// After its start PX4 refuses to arm for some seconds.
const ARM_PATIENCE: Duration = Duration::from_secs(8);
/// HEARTBEAT comes at 1 Hz, and some of them are lost.
const STATE_WITHIN: Duration = Duration::from_secs(6);
