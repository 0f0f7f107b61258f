//! Messages 2, 4, 5 and 35000, composed from the rights held and handed over.

use stanag_msgs::enums::{
    AccessGranted, HandoverStatus, LoiBitmap, PresenceVectorSupport, RequestedAccess,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, HandoverStatusReport, PositiveHandoverAuthorisationGranted,
    PositiveHandoverAuthorisationRequest, VehicleDataLinkTransitionCoordination,
    VsmAuthorisationResponse,
};
use stanag_msgs::{Id, Message, TimeStamp};

use super::rules::{Asker, CONTROL, Handover, Rights};
use crate::session::context::Context;

/// Message 2: the rights that a station may have, and those it holds.
pub(super) fn response(
    context: &Context<'_>,
    asker: &Asker,
    held: Rights,
    request: Option<&CucsAuthorisationRequest>,
    stamp: TimeStamp,
) -> Message {
    // An absent payload station is in no bitmap: if it was held before a restart, it returns with its device.
    let present = context.payload_stations();
    let gone = Rights::of_stations(held.stations()).without(Rights::of_stations(present));
    let named = held.without(gone);
    // Ground stations request LOI 2 to 5 together and wait for all of them: without a payload, LOI 3 is granted for no
    // station.
    let granted = if present.is_empty() {
        held.levels()
    } else {
        named.levels()
    };
    let in_control = granted.intersects(LoiBitmap::LOI3.union(CONTROL));
    Message::from(VsmAuthorisationResponse {
        time_stamp: Some(stamp),
        vsm_id: Some(context.vsm),
        data_link_id: Some(Id::NULL),
        access_authorized: Some(u8::from(!asker.authorised.is_empty())),
        access_granted: Some(if in_control {
            AccessGranted::InControl
        } else {
            AccessGranted::NotInControl
        }),
        loi_authorized: Some(asker.authorised),
        loi_granted: Some(granted),
        controlled_station_1_16: Some(named.stations().low()),
        controlled_station_17_32: Some(named.stations().high()),
        access_requested: request
            .and_then(|request| request.requested_handover_access)
            .map(RequestedAccess::raw),
        vehicle_type: Some(context.vehicle.vehicle_type()),
        vehicle_subtype: Some(0),
        cucs_type: request.and_then(|request| request.cucs_type),
        cucs_subtype: request.and_then(|request| request.cucs_subtype),
        presence_vector_support: Some(PresenceVectorSupport::Partial),
        ..VsmAuthorisationResponse::default()
    })
}

/// Message 4 to a holder: the acquirer's request.
pub(super) fn wish(context: &Context<'_>, handover: &Handover, stamp: TimeStamp) -> Message {
    let Handover { to, rights, .. } = *handover;
    Message::from(PositiveHandoverAuthorisationRequest {
        time_stamp: Some(stamp),
        vsm_id: Some(context.vsm),
        data_link_id: Some(Id::NULL),
        vehicle_type: Some(context.vehicle.vehicle_type()),
        vehicle_subtype: Some(0),
        requested_handover_loi: Some(rights.levels_by_themselves()),
        controlled_station_1_16: Some(rights.stations().low()),
        controlled_station_17_32: Some(rights.stations().high()),
        requesting_cucs_id: Some(to),
        presence_vector_support: Some(PresenceVectorSupport::Partial),
        ..PositiveHandoverAuthorisationRequest::default()
    })
}

/// Message 5 to an acquirer: the rights that it is offered or was given.
pub(super) fn authorised(
    context: &Context<'_>,
    acquirer: Id,
    rights: Rights,
    stamp: TimeStamp,
) -> Message {
    Message::from(PositiveHandoverAuthorisationGranted {
        time_stamp: Some(stamp),
        vsm_id: Some(context.vsm),
        data_link_id: Some(Id::NULL),
        loi_authorized: Some(rights.levels_by_themselves()),
        controlled_station_1_16_authorized: Some(rights.stations().low()),
        controlled_station_17_32_authorized: Some(rights.stations().high()),
        vehicle_type: Some(context.vehicle.vehicle_type()),
        vehicle_subtype: Some(0),
        requesting_cucs_id: Some(acquirer),
        presence_vector_support: Some(PresenceVectorSupport::Partial),
        ..PositiveHandoverAuthorisationGranted::default()
    })
}

/// Message 35000. The null id means nobody.
pub(super) fn handover_status(
    from: Option<Id>,
    to: Option<Id>,
    status: HandoverStatus,
    stamp: TimeStamp,
) -> Message {
    Message::from(HandoverStatusReport {
        time_stamp: Some(stamp),
        cucs_id_relinquishing_control: Some(from.unwrap_or(Id::NULL)),
        cucs_id_acquiring_control: Some(to.unwrap_or(Id::NULL)),
        status: Some(status),
        air_data_link_id: Some(Id::NULL),
    })
}

/// Whether a 34000 would set something on a radio.
pub(super) fn sets_radio(message: &VehicleDataLinkTransitionCoordination) -> bool {
    let frequencies = [
        message.set_forward_link_carrier_frequency_adt,
        message.set_return_link_carrier_frequency_adt,
    ];
    frequencies.into_iter().flatten().any(|hertz| hertz != 0.0)
        || message.set_pn_code_adt.is_some_and(|code| code != 0)
}
