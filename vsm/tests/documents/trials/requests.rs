//! Rights, and what is asked of the VSM: reports, configuration, transitions.

use stanag_msgs::enums::{ConfigRequestType, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, DataLinkControlRequest, FieldConfigurationRequest,
    GenericInformationRequestMessage, Heartbeat, PositiveHandoverAuthorisationRequest,
    ScheduleMessageUpdateCommand, SubsystemStatusDetailRequest, SubsystemStatusRequest,
    VehicleDataLinkTransitionCoordination,
};

use super::scenes::{
    control, control_with_stations, nothing, one, other_controls, request_control_of, then_5_s,
    transitions, two_stations, with_a_failing_compass,
};
use crate::scene::Trial;
use kit::bridge::{VSM, cucs, orders};

pub(super) fn rights() -> Vec<Trial> {
    vec![
        trial!(
            two_stations,
            nothing,
            then_5_s,
            orders::request_control(),
            [
                "VSM ID" = "5" refused "refused unless this VSM's",
                "Requested/Handover LOI" = "1",
                "Requested/Handover Access" = "0",
                "Controlled Station 1-16" = "1",
                "Controlled Station 17-32" = "1",
                "CUCS Type" = "3",
                "CUCS Subtype" = "3",
            ]
        ),
        trial!(
            two_stations,
            other_controls,
            request_control_of,
            CucsAuthorisationRequest {
                requested_handover_access: Some(RequestedAccess::Request),
                ..orders::request_control()
            },
            ["Wait for Vehicle Data Link Transition Coordination Message" = "1"]
        ),
        trial!(
            two_stations,
            control_with_stations,
            then_5_s,
            PositiveHandoverAuthorisationRequest {
                requested_handover_loi: orders::request_control().requested_handover_loi,
                requesting_cucs_id: Some(cucs(1)),
                ..PositiveHandoverAuthorisationRequest::default()
            },
            [
                "Requested/Handover LOI" = "2",
                "Controlled Station 1-16" = "1",
                "Controlled Station 17-32" = "1",
                "Requesting CUCS ID" = "null",
            ]
        ),
    ]
}

pub(super) fn requests() -> Vec<Trial> {
    vec![
        trial!(
            one,
            control,
            then_5_s,
            SubsystemStatusRequest::default(),
            ["Subsystem ID" = "8"]
        ),
        trial!(
            one,
            with_a_failing_compass,
            then_5_s,
            SubsystemStatusDetailRequest {
                subsystem_state_report_reference: Some(6),
                ..SubsystemStatusDetailRequest::default()
            },
            ["Subsystem State Report Reference" = "1" refused "others are refused"]
        ),
        trial!(one, control, then_5_s, Heartbeat::default(), []),
        trial!(
            one,
            control,
            then_5_s,
            ScheduleMessageUpdateCommand {
                requested_message_type: Some(3009),
                frequency: Some(4),
                ..ScheduleMessageUpdateCommand::default()
            },
            ["Requested Message Type" = "12101", "Frequency" = "2"]
        ),
        trial!(
            one,
            control,
            then_5_s,
            GenericInformationRequestMessage {
                message_type: Some(3009),
                ..GenericInformationRequestMessage::default()
            },
            [
                "Message Type" = "12101",
                "Requested Field Presence Vector" = "64"
            ]
        ),
        trial!(
            transitions,
            control,
            then_5_s,
            VehicleDataLinkTransitionCoordination {
                acquiring_cucs_id: Some(cucs(1)),
                ..VehicleDataLinkTransitionCoordination::default()
            },
            [
                "Acquiring CUCS ID" = "null" refused "needed",
                "Set Forward Link Carrier Frequency (ADT)" = "1" refused "others are refused",
                "Set Return Link Carrier Frequency (ADT)" = "1" refused "others are refused",
                "Set PN Code (ADT)" = "1" refused "others are refused",
            ]
        ),
        trial!(
            one,
            control,
            then_5_s,
            DataLinkControlRequest {
                control_assignment_request: Some(1),
                ..DataLinkControlRequest::default()
            },
            ["Control Assignment Request" = "0" refused "others are refused"]
        ),
        trial!(
            one,
            nothing,
            then_5_s,
            FieldConfigurationRequest {
                vsm_id: Some(VSM),
                request_type: Some(ConfigRequestType::SingleParameter),
                requested_message: Some(2016),
                requested_field: Some(13),
                ..FieldConfigurationRequest::default()
            },
            [
                "VSM ID" = "5" refused "refused unless this VSM's",
                "Request Type" = "4",
                "Requested Message" = "13002",
                "Requested Field" = "15",
            ]
        ),
    ]
}
