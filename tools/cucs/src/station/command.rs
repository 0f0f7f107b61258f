//! Commands of flight: modes (2016: launch, fly a route, loiter, land) and flight termination (2005).

use stanag_msgs::enums::{
    AltitudeCommandType, AltitudeType, FlightPathControlMode as Mode, FtMode, FtState, SpeedType,
};
use stanag_msgs::messages::{
    FlightTerminationCommand, VehicleOperatingModeCommand, ZeroizeCommand,
};
use stanag_msgs::{Bam32, Id, Scaled};

use super::endpoint::Station;
use super::outcome::{Outcome, StationError};

/// Where to loiter; an absent value stays unchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoiterAt {
    /// Degrees north and east.
    pub position_deg: Option<(f64, f64)>,
    /// Metres, and their datum.
    pub altitude: Option<(f64, AltitudeType)>,
    /// Metres a second over ground.
    pub speed_m_s: Option<f64>,
}

impl Station {
    /// Sends a 2016 and waits until it is carried out or refused.
    ///
    /// # Errors
    /// There is no final answer within [`Timeouts::command`](crate::Timeouts).
    pub async fn operate(
        &mut self,
        vehicle: Id,
        command: VehicleOperatingModeCommand,
    ) -> Result<Outcome, StationError> {
        let what = command.select_flight_path_control_mode.map_or_else(
            || "mode command (2016)".to_owned(),
            |mode| format!("2016 mode {}", mode.in_words()),
        );
        let within = self.timeouts.command;
        self.command(vehicle, command, what, within).await
    }

    /// Mode 21: arms and takes off to an altitude.
    ///
    /// # Errors
    /// As [`Station::operate`]; an altitude that cannot be expressed.
    pub async fn launch(
        &mut self,
        vehicle: Id,
        altitude_m: f64,
        altitude_type: AltitudeType,
    ) -> Result<Outcome, StationError> {
        let command = launch_command(altitude_m, altitude_type)?;
        self.operate(vehicle, command).await
    }

    /// Mode 11: flies the route that is loaded, from a waypoint where one is given.
    ///
    /// # Errors
    /// As [`Station::operate`]; a speed that cannot be expressed.
    pub async fn fly_route(
        &mut self,
        vehicle: Id,
        from: Option<u16>,
        speed_m_s: Option<f64>,
    ) -> Result<Outcome, StationError> {
        let mut command = mode_command(Mode::Waypoint);
        command.commanded_waypoint_number = from;
        set_speed(&mut command, speed_m_s)?;
        self.operate(vehicle, command).await
    }

    /// Mode 12: loiters, at the present or the given place.
    ///
    /// # Errors
    /// As [`Station::operate`]; values that cannot be expressed.
    pub async fn loiter(&mut self, vehicle: Id, at: LoiterAt) -> Result<Outcome, StationError> {
        let mut command = mode_command(Mode::Loiter);
        if let Some((latitude, longitude)) = at.position_deg {
            command.loiter_position_latitude = Some(Bam32::from_degrees(latitude));
            command.loiter_position_longitude = Some(Bam32::from_degrees(longitude));
        }
        if let Some((altitude_m, altitude_type)) = at.altitude {
            set_altitude(&mut command, altitude_m, altitude_type)?;
        }
        set_speed(&mut command, at.speed_m_s)?;
        self.operate(vehicle, command).await
    }

    /// Mode 19: lands here. It counts as carried out once the vehicle descends;
    /// [`Vehicle::landed`](crate::Vehicle::landed) reports the touchdown.
    ///
    /// # Errors
    /// As [`Station::operate`].
    pub async fn land(&mut self, vehicle: Id) -> Result<Outcome, StationError> {
        self.operate(vehicle, mode_command(Mode::AutolandEngage))
            .await
    }

    /// 2005: resets, arms or executes a flight termination. It counts as executed once the vehicle has shown it.
    ///
    /// # Errors
    /// As [`Station::operate`].
    pub async fn terminate(
        &mut self,
        vehicle: Id,
        state: FtState,
    ) -> Result<Outcome, StationError> {
        let command = FlightTerminationCommand {
            commanded_flight_termination_state: Some(state),
            flight_termination_mode: Some(FtMode::NotSpecified),
            ..FlightTerminationCommand::default()
        };
        let what = format!("flight termination state {} ({state}; 2005)", state.raw());
        let within = self.timeouts.command;
        self.command(vehicle, command, what, within).await
    }

    /// 50024: resets, arms or executes a zeroize of the vehicle's whole VSM. It counts as executed once the VSM has
    /// stored the order.
    ///
    /// # Errors
    /// As [`Station::operate`].
    pub async fn zeroize(&mut self, vehicle: Id, state: FtState) -> Result<Outcome, StationError> {
        let command = ZeroizeCommand {
            commanded_zeroize_state: Some(state),
            ..ZeroizeCommand::default()
        };
        let what = format!("zeroize state {} ({state}; 50024)", state.raw());
        let within = self.timeouts.command;
        self.command(vehicle, command, what, within).await
    }

    /// Changes the speed over ground in the present mode.
    ///
    /// # Errors
    /// As [`Station::operate`]; a speed that cannot be expressed.
    pub async fn change_speed(
        &mut self,
        vehicle: Id,
        speed_m_s: f64,
    ) -> Result<Outcome, StationError> {
        // A 2016 without a mode commands the speed only: with mode 11 it would restart a finished route.
        let mut command = VehicleOperatingModeCommand::default();
        set_speed(&mut command, Some(speed_m_s))?;
        self.operate(vehicle, command).await
    }
}

/// A 2016 that commands a mode and nothing else, for [`Station::post`].
#[must_use]
pub fn mode_command(mode: Mode) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(mode),
        ..VehicleOperatingModeCommand::default()
    }
}

/// The 2016 of [`Station::launch`], for [`Station::post`].
///
/// # Errors
/// An altitude that cannot be expressed.
pub fn launch_command(
    altitude_m: f64,
    altitude_type: AltitudeType,
) -> Result<VehicleOperatingModeCommand, StationError> {
    let mut command = mode_command(Mode::Launch);
    set_altitude(&mut command, altitude_m, altitude_type)?;
    Ok(command)
}

pub(crate) fn set_altitude(
    command: &mut VehicleOperatingModeCommand,
    altitude_m: f64,
    altitude_type: AltitudeType,
) -> Result<(), StationError> {
    command.altitude_command_type = Some(AltitudeCommandType::Altitude);
    command.commanded_altitude = Some(Scaled::from_si(altitude_m)?);
    command.altitude_type = Some(altitude_type);
    Ok(())
}

pub(crate) fn set_speed(
    command: &mut VehicleOperatingModeCommand,
    speed_m_s: Option<f64>,
) -> Result<(), StationError> {
    if let Some(speed_m_s) = speed_m_s {
        command.commanded_speed = Some(Scaled::from_si(speed_m_s)?);
        command.speed_type = Some(SpeedType::Ground);
    }
    Ok(())
}
