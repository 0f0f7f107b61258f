//! Status in detail, only when asked for by 17001 or 17002: 3000, 3004 to 3007, 3009 to 3011, 12101, 16001.
//!
//! What the vehicle must stream for it is asked of the vehicle then, not before: a radio has no room for the rest.

use mapping::status;
use stanag_msgs::Message;
use stanag_msgs::enums::CommandedEngineState;

use super::aircraft::Aircraft;
use super::desk::Desk;

/// The messages that this module composes.
pub(super) const DETAILS: &[u16] = &[3000, 3004, 3005, 3006, 3007, 3009, 3010, 3011, 12101, 16001];

impl Aircraft {
    /// Asks the vehicle for what a report is made of, beyond what it streams anyway.
    pub(super) fn want_sources_of(&mut self, report: u16) {
        match report {
            3009 => self.mav.want(WIND_COV, 1.0),
            3010 => self.mav.want(HIGHRES_IMU, 5.0),
            16001 => self.mav.want(ESTIMATOR_STATUS, 1.0),
            _ => {}
        }
    }

    /// The messages of a report; none of a silent vehicle but what the VSM itself knows.
    pub(super) fn details(&mut self, desk: &mut Desk<'_>, report: u16) -> Vec<Message> {
        let (vehicle, live) = (&self.mav.telemetry, self.mav.live());
        match report {
            3000 => vec![status::configuration(vehicle, desk.stamp()).into()],
            3004 => {
                let stamp = desk.stamp();
                let report =
                    status::loiter_configuration(vehicle, &self.loiter, &self.commanded, stamp);
                vec![report.into()]
            }
            3005 => vec![status::termination(desk.stamp()).into()],
            3006 => vec![status::lights(desk.stamp()).into()],
            3007 if live => {
                // A command that the vehicle refused is not one that its engines follow.
                let followed = self.engine_command.filter(|command| {
                    vehicle.armed == Some(*command != CommandedEngineState::Stop)
                });
                (1..=status::engines(vehicle))
                    .map(|number| status::engine(vehicle, number, followed, desk.stamp()).into())
                    .collect()
            }
            3009 if live => {
                let (altimeter, agl) = (self.bounds.altimeter, self.bounds.agl);
                vec![status::air_and_ground(vehicle, altimeter, agl, desk.stamp()).into()]
            }
            3010 if live => vec![status::body_sensed(vehicle, desk.stamp()).into()],
            3011 => self
                .sticks
                .report(desk.stamp())
                .map(Message::from)
                .into_iter()
                .collect(),
            12101 if live => vec![status::battery(vehicle, desk.stamp()).into()],
            16001 => status::subsystems(vehicle, self.configured_parameters(), live)
                .into_iter()
                .map(|state| {
                    let reference = self.detail_reference(state.0);
                    status::subsystem_report(state, reference, desk.stamp()).into()
                })
                .collect(),
            _ => Vec::new(),
        }
    }
}

const WIND_COV: u32 = 231;
const HIGHRES_IMU: u32 = 105;
const ESTIMATOR_STATUS: u32 = 230;
