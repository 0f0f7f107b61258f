//! The data link between this VSM and a vehicle, as a CUCS sees it: messages 28001, 32000, 32003, 32005, 32006, 32200,
//! 32302 and 32400.
//!
//! One MAVLink link is one data link of its own, without an id in the DLI, and it is the vehicle's only one: nothing of it is given
//! to a station to control.

use std::time::Duration;

use stanag_msgs::enums::{
    AccessGranted, DlComsecMode, DlComsecState, DlControlAvailability, DlPriority, DlState,
    DlTerminal, DlType,
};
use stanag_msgs::messages::{
    DataLinkConfigurationAssignmentMessage, DlControlStatusReport, DlInControlReport,
    DlToVehicleIdReport, LegacyDlControlCommandStatus, LegacyDlStatusReport, LinkHealthStatus,
    LostLinkDelayTimerReport,
};
use stanag_msgs::{Id, Text, TimeStamp};

use crate::equipment::Radio;

/// How it stands.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DataLink {
    /// Frames of the vehicle are received and believed.
    pub received: bool,
    /// They show that it receives us; `None` where nothing shows it either way.
    pub answered: Option<bool>,
    /// Frames must be signed, by the configuration.
    pub signed: bool,
    /// Frames verify under the key.
    pub verified: bool,
    /// The part of the vehicle's frames of late that did not arrive, 0 to 1, by gaps in their numbers.
    pub lost: Option<f64>,
    /// The shortest way there and back of late.
    pub round_trip: Option<Duration>,
    /// The radio, where it reports itself.
    pub radio: Option<Radio>,
}

/// BIT Mode Status (32200) as this VSM has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Health {
    /// Nothing is wrong.
    Good = 0,
    /// It carries data, and little more may break it: see [`DataLink::health`].
    Degraded = 1,
    /// It does not carry data both ways.
    Failed = 2,
}

/// How the timer of a lost link stands (32400), as this VSM has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LostLinkTimer {
    /// The controlling CUCS is received, or silence does not count; what it would run for, s.
    Stopped(f64),
    /// It is silent: so much is left until the loss action, s.
    Running(f64),
    /// The loss action has begun.
    Expired,
}

impl DataLink {
    /// The worst of what is known of it.
    #[must_use]
    pub fn health(&self) -> Health {
        let insecure = self.signed && !self.verified;
        if !self.received || self.answered == Some(false) || insecure {
            return Health::Failed;
        }
        let lossy = self.lost.is_some_and(|lost| lost > MAX_LOSS);
        let slow = self.round_trip.is_some_and(|trip| trip > MAX_ROUND_TRIP);
        let weak = self.radio.is_some_and(is_weak);
        if lossy || slow || weak {
            Health::Degraded
        } else {
            Health::Good
        }
    }

    fn uplink(&self) -> Option<u8> {
        let answered = if self.received {
            self.answered
        } else {
            Some(false)
        };
        answered.map(u8::from)
    }

    fn security(&self) -> DlComsecState {
        match (self.signed, self.verified) {
            (false, _) => DlComsecState::NotInstalled,
            (true, false) => DlComsecState::NotKeyed,
            (true, true) => DlComsecState::Keyed,
        }
    }
}

fn is_weak(radio: Radio) -> bool {
    let margin = |signal: Option<u8>, noise: Option<u8>| {
        signal
            .zip(noise)
            .is_some_and(|(signal, noise)| signal < noise.saturating_add(MIN_MARGIN))
    };
    radio.free < MIN_FREE
        || margin(radio.signal, radio.noise)
        || margin(radio.remote_signal, radio.remote_noise)
}

/// 28001: that there is this link, and that it is not to be controlled.
#[must_use]
pub fn assignment(
    vehicle: Id,
    vehicle_type: u16,
    requested: Option<u8>,
    stamp: TimeStamp,
) -> DataLinkConfigurationAssignmentMessage {
    DataLinkConfigurationAssignmentMessage {
        time_stamp: Some(stamp),
        vsm_vehicle_id: Some(vehicle),
        access_authorized: Some(0),
        access_granted: Some(AccessGranted::NotInControl),
        access_requested: requested,
        terminal_type: Some(DlTerminal::Gdt),
        data_link_type: Some(DlType::from_raw(MAVLINK)),
        data_link_name: Some(Text::new("MAVLink 2")),
        vehicle_type: Some(vehicle_type),
        vehicle_subtype: Some(0),
        data_link_control_availability: Some(DlControlAvailability::Unavailable),
        ..DataLinkConfigurationAssignmentMessage::default()
    }
}

/// 32000: whom it communicates with, and whether each way works. No source gives the values of the states: 1 works, 0 does not.
#[must_use]
pub fn to_vehicle(link: &DataLink, vehicle: Id, stamp: TimeStamp) -> DlToVehicleIdReport {
    DlToVehicleIdReport {
        time_stamp: Some(stamp),
        communication_vehicle_id_uplink: Some(vehicle),
        uplink_communication_state: link.uplink(),
        communication_vehicle_id_downlink: Some(vehicle),
        downlink_communication_state: Some(u8::from(link.received)),
    }
}

/// 32005: the same with security and loss.
#[must_use]
pub fn status(link: &DataLink, stamp: TimeStamp) -> LegacyDlStatusReport {
    let state = match (link.received, link.answered) {
        (false, _) => DlState::Off,
        (true, Some(false)) => DlState::RxOnly,
        (true, _) => DlState::TxRx,
    };
    let arrived = match (link.received, link.lost) {
        (false, _) => Some(0.0),
        (true, lost) => lost.map(|lost| 1.0 - lost),
    };
    LegacyDlStatusReport {
        time_stamp: Some(stamp),
        addressed_terminal: Some(DlTerminal::Gdt),
        data_link_state: Some(state),
        downlink_status: arrived.map(|part| (part * 100.0).round() as i16),
        communication_security_state: Some(link.security()),
        link_channel_priority_state: Some(DlPriority::Primary),
        ..LegacyDlStatusReport::default()
    }
}

/// 32003: whether what it carries is secured. A MAVLink link has no transmitter, attenuator or antenna of its own to report.
#[must_use]
pub fn control_status(link: &DataLink, stamp: TimeStamp) -> DlControlStatusReport {
    DlControlStatusReport {
        time_stamp: Some(stamp),
        communication_security_state: Some(link.security()),
        ..DlControlStatusReport::default()
    }
}

/// 32006: what is demanded of it, which is always to carry data both ways, with its keys.
#[must_use]
pub fn demanded(stamp: TimeStamp) -> LegacyDlControlCommandStatus {
    LegacyDlControlCommandStatus {
        time_stamp: Some(stamp),
        addressed_terminal: Some(DlTerminal::Gdt),
        reported_demanded_data_link_state: Some(DlState::TxRx),
        reported_demanded_antenna_mode: None,
        reported_demanded_communication_security_mode: Some(DlComsecMode::Normal),
    }
}

/// 32200. No source gives the values of its field: [`Health`] has those of this VSM.
#[must_use]
pub fn health(link: &DataLink, stamp: TimeStamp) -> LinkHealthStatus {
    LinkHealthStatus {
        time_stamp: Some(stamp),
        bit_mode_status: Some(link.health() as u8),
    }
}

/// 32302: who controls what is at the other end; the null id where nobody does.
#[must_use]
pub fn in_control(controller: Option<Id>, stamp: TimeStamp) -> DlInControlReport {
    DlInControlReport {
        time_stamp: Some(stamp),
        data_link_id: Some(Id::NULL),
        in_control_cucs_id: Some(controller.unwrap_or(Id::NULL)),
        ..DlInControlReport::default()
    }
}

/// 32400. No source gives the values of its status: 0 stopped, 1 running, 2 run out.
#[must_use]
pub fn lost_link(timer: LostLinkTimer, stamp: TimeStamp) -> LostLinkDelayTimerReport {
    let (status, left_s) = match timer {
        LostLinkTimer::Stopped(whole_s) => (0, whole_s),
        LostLinkTimer::Running(left_s) => (1, left_s),
        LostLinkTimer::Expired => (2, 0.0),
    };
    LostLinkDelayTimerReport {
        time_stamp: Some(stamp),
        lost_link_delay_timer_status: Some(status),
        // A second that has begun is left: 0 is the end.
        current_delay_time: Some(left_s.ceil().clamp(0.0, 255.0) as u8),
    }
}

/// Data Link Type: the first of those that are VSM specific.
const MAVLINK: u8 = 8;
/// A link that loses more is degraded.
const MAX_LOSS: f64 = 0.2;
/// Beyond this a pilot steers too late.
const MAX_ROUND_TRIP: Duration = Duration::from_secs(1);
/// Half decibels of signal above noise.
const MIN_MARGIN: u8 = 20;
/// A radio whose buffer is fuller than this delays what it sends.
const MIN_FREE: u8 = 20;

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> DataLink {
        DataLink {
            received: true,
            answered: Some(true),
            signed: true,
            verified: true,
            lost: Some(0.03),
            round_trip: Some(Duration::from_millis(90)),
            radio: None,
        }
    }

    #[test]
    fn a_link_is_as_good_as_the_worst_of_it() {
        let radio = Radio {
            signal: Some(190),
            noise: Some(40),
            remote_signal: Some(180),
            remote_noise: Some(42),
            free: 95,
        };
        for (link, health) in [
            (good(), Health::Good),
            (
                DataLink {
                    answered: None,
                    lost: None,
                    round_trip: None,
                    ..good()
                },
                Health::Good,
            ),
            (
                DataLink {
                    radio: Some(radio),
                    ..good()
                },
                Health::Good,
            ),
            (
                DataLink {
                    lost: Some(0.3),
                    ..good()
                },
                Health::Degraded,
            ),
            (
                DataLink {
                    round_trip: Some(Duration::from_secs(2)),
                    ..good()
                },
                Health::Degraded,
            ),
            (
                DataLink {
                    radio: Some(Radio { free: 5, ..radio }),
                    ..good()
                },
                Health::Degraded,
            ),
            (
                DataLink {
                    radio: Some(Radio {
                        remote_signal: Some(50),
                        ..radio
                    }),
                    ..good()
                },
                Health::Degraded,
            ),
            (
                DataLink {
                    answered: Some(false),
                    ..good()
                },
                Health::Failed,
            ),
            (
                DataLink {
                    verified: false,
                    ..good()
                },
                Health::Failed,
            ),
            (
                DataLink {
                    signed: false,
                    verified: false,
                    ..good()
                },
                Health::Good,
            ),
            (
                DataLink {
                    received: false,
                    ..good()
                },
                Health::Failed,
            ),
        ] {
            assert_eq!(link.health(), health, "{link:?}");
        }
    }

    #[test]
    fn each_way_has_its_state_and_what_is_not_known_is_absent() {
        let states = |link: DataLink| {
            let report = to_vehicle(&link, Id(7), TimeStamp(1));
            (
                report.uplink_communication_state,
                report.downlink_communication_state,
            )
        };
        assert_eq!(states(good()), (Some(1), Some(1)));
        assert_eq!(
            states(DataLink {
                answered: Some(false),
                ..good()
            }),
            (Some(0), Some(1))
        );
        assert_eq!(
            states(DataLink {
                answered: None,
                ..good()
            }),
            (None, Some(1))
        );
        assert_eq!(
            states(DataLink {
                received: false,
                ..good()
            }),
            (Some(0), Some(0))
        );
        let report = status(
            &DataLink {
                lost: None,
                ..good()
            },
            TimeStamp(1),
        );
        assert_eq!(
            (report.downlink_status, report.data_link_state),
            (None, Some(DlState::TxRx))
        );
        assert_eq!(status(&good(), TimeStamp(1)).downlink_status, Some(97));
        let secured = |link: DataLink| {
            let report = control_status(&link, TimeStamp(1));
            assert_eq!(report.transmitter_state, None);
            report.communication_security_state
        };
        assert_eq!(secured(good()), Some(DlComsecState::Keyed));
        assert_eq!(
            secured(DataLink {
                verified: false,
                ..good()
            }),
            Some(DlComsecState::NotKeyed)
        );
        assert_eq!(
            demanded(TimeStamp(1)).reported_demanded_data_link_state,
            Some(DlState::TxRx)
        );
        assert_eq!(
            status(
                &DataLink {
                    received: false,
                    ..good()
                },
                TimeStamp(1)
            )
            .downlink_status,
            Some(0)
        );
    }

    #[test]
    fn the_timer_counts_down_in_seconds_that_have_begun() {
        let fields = |timer| {
            let report = lost_link(timer, TimeStamp(1));
            (
                report.lost_link_delay_timer_status.unwrap(),
                report.current_delay_time.unwrap(),
            )
        };
        assert_eq!(fields(LostLinkTimer::Stopped(10.0)), (0, 10));
        assert_eq!(fields(LostLinkTimer::Running(3.2)), (1, 4));
        assert_eq!(fields(LostLinkTimer::Running(900.0)), (1, 255));
        assert_eq!(fields(LostLinkTimer::Expired), (2, 0));
    }
}
