//! The link to the vehicle as stations see it: 28001 to 32400 on request, and 28000, which requests control of the link.

use mapping::data_link::{self, DataLink, LostLinkTimer};
use stanag_msgs::Message;
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::DataLinkControlRequest;

use super::health::edition_2;
use crate::session::context::{Context, FlightView, Origin};
use crate::session::effects::Effects;

/// One of the reports; `None` for any other message.
pub(super) fn report(
    context: &Context<'_>,
    flight: &FlightView<'_>,
    link: &DataLink,
    message: u16,
    effects: &mut Effects<'_>,
) -> Option<Message> {
    let (vehicle, stamp) = (effects.id, effects.stamp());
    Some(match message {
        28001 => {
            let vehicle_type = context.vehicle.vehicle_type();
            data_link::assignment(vehicle, vehicle_type, None, stamp).into()
        }
        32000 => data_link::to_vehicle(link, vehicle, stamp).into(),
        32003 => data_link::control_status(link, stamp).into(),
        32005 => data_link::status(link, stamp).into(),
        32006 => data_link::demanded(stamp).into(),
        32200 => data_link::health(link, stamp).into(),
        32302 => data_link::in_control(context.controller, stamp).into(),
        32400 => data_link::lost_link(timer(context, flight), stamp).into(),
        _ => return None,
    })
}

/// How long the controlling CUCS may stay silent before the loss action.
fn timer(context: &Context<'_>, flight: &FlightView<'_>) -> LostLinkTimer {
    let limits = &context.settings.authority;
    if flight.loss_action {
        return LostLinkTimer::Expired;
    }
    let controller = context.controller;
    let station = controller.and_then(|id| context.stations.iter().find(|one| one.id() == id));
    match station.and_then(|one| one.silent_s(context.mono())) {
        Some(silent_s) if silent_s >= limits.act_s => LostLinkTimer::Expired,
        Some(silent_s) if silent_s >= limits.warn_s => {
            LostLinkTimer::Running(limits.act_s - silent_s)
        }
        _ => LostLinkTimer::Stopped(limits.act_s),
    }
}

/// 28000. There is one link, and it carries the commands of the controlling CUCS: stations cannot be given control of it.
pub(super) fn control_request(
    context: &Context<'_>,
    origin: Origin,
    request: &DataLinkControlRequest,
    effects: &mut Effects<'_>,
) {
    if let Err(why) = edition_2(context, origin.station) {
        return effects.refuse(Some(origin), why);
    }
    let requested = request.control_assignment_request;
    let (vehicle, vehicle_type) = (effects.id, context.vehicle.vehicle_type());
    let answer = data_link::assignment(vehicle, vehicle_type, requested, effects.stamp());
    effects.send(origin.station, &answer.into());
    if requested == Some(RELEASE) {
        return effects.acknowledge(&origin, AckType::CarriedOut);
    }
    let asked = requested.map_or_else(|| "none".to_owned(), |value| value.to_string());
    effects.refuse(
        Some(origin),
        format!(
            "Control Assignment Request {asked}, expected 1 (which link is there): the data link is the vehicle's only one, \
             and the configuration gives no station control of it"
        ),
    );
}

/// 404.06: a release of nothing is a query.
const RELEASE: u8 = 1;
