//! Landings of a wing that a hold has broken off.

use mapping::plan::Plan;
use mapping::telemetry::Place;
use mavlink_link::service::mission::Item;

use super::*;

/// A wing on its final approach, 20 m above home, with a mission of a touch-down alone.
fn on_final() -> (World, Flight) {
    const NAV_LAND: u16 = 21;
    let mut world = World::airborne(Px4Mode::MISSION);
    world.vehicle.telemetry.vehicle_type = Some(MavType::MAV_TYPE_FIXED_WING);
    let touch_down = Item {
        command: NAV_LAND,
        ..Item::default()
    };
    world.uploaded = Some(UploadedMission {
        compiled: CompiledMission {
            items: vec![touch_down],
            waypoint_of: vec![0],
            ..CompiledMission::default()
        },
        mission_id: 0,
        route_type: RouteType::Flight,
        mission_name: String::new(),
        plan: Plan::default(),
    });
    world.vehicle.telemetry.mission = Some(MissionProgress {
        seq: 0,
        total: Some(1),
        state: MissionState::MISSION_STATE_ACTIVE,
        mission_id: 0,
        fence_id: 0,
        rally_points_id: 0,
    });
    (world, Flight::default())
}

/// The alert that station 0 was sent of a landing that was broken off.
fn broken_off(world: &mut World) -> Option<String> {
    let texts = world.sent_to(0).into_iter().filter_map(|message| {
        let Message::SubsystemStatusAlert(alert) = message else {
            return None;
        };
        Some(alert.text?.as_str().to_owned())
    });
    // A long text comes in several parts.
    let all: String = texts.collect();
    all.find("the landing is broken off")
        .map(|from| all[from..].to_owned())
}

#[test]
fn a_landing_is_broken_off_once_the_vehicle_reports_it_and_not_where_it_refuses() {
    for (result, warns) in [(ACCEPTED, true), (DENIED, false)] {
        let (mut world, mut flight) = on_final();
        handle(&mut world, &mut flight, Input::Hold);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(world.commanded_modes(), [Px4Mode::LOITER]);
        world.command_was_sent();
        for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, result) {
            handle(&mut world, &mut flight, Input::CommandEnded(&event));
        }
        // It sinks until the mode is reported.
        let place = &mut world.vehicle.telemetry.position;
        *place = place.map(|place| Place {
            amsl_m: place.amsl_m - 2.0,
            ..place
        });
        world.show_mode(Px4Mode::MISSION);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(broken_off(&mut world), None, "{result:?}");
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::ModeChanged);
        handle(&mut world, &mut flight, Input::Advance);
        let text = broken_off(&mut world);
        assert_eq!(text.is_some(), warns, "{result:?} {text:?}");
        let names = |text: String| {
            text.contains("18 m above home") && text.contains("AUTO.LOITER; it keeps")
        };
        assert_eq!(text.is_some_and(names), warns);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(broken_off(&mut world), None, "once");
    }
}

/// EXTENDED_SYS_STATE comes once a second: what it has not reported yet is not on the ground.
#[test]
fn just_after_a_start_a_landing_is_broken_off_too_and_none_begins_where_the_wing_is() {
    for (landed, armed, warns) in [
        (None, true, true),
        (None, false, false),
        (Some(LandedState::OnGround), true, false),
    ] {
        let begun = || {
            let (mut world, flight) = on_final();
            let telemetry = &mut world.vehicle.telemetry;
            (telemetry.landed, telemetry.armed) = (landed, Some(armed));
            (world, flight)
        };
        let (mut world, mut flight) = begun();
        handle(&mut world, &mut flight, Input::Hold);
        handle(&mut world, &mut flight, Input::Advance);
        world.show_mode(Px4Mode::LOITER);
        handle(&mut world, &mut flight, Input::ModeChanged);
        handle(&mut world, &mut flight, Input::Advance);
        let text = broken_off(&mut world);
        assert_eq!(text.is_some(), warns, "{landed:?} {armed} {text:?}");
        // A hold may be in the air, too.
        let (mut world, mut flight) = begun();
        world.show_mode(Px4Mode::LOITER);
        command(&mut world, &mut flight, select(Mode::AutolandEngage));
        let modes = world.commanded_modes();
        let expected = landed.map(|_| Px4Mode::LAND);
        assert_eq!(modes, Vec::from_iter(expected), "{landed:?}");
    }
}

#[test]
fn a_landing_that_another_has_taken_or_that_ends_is_not_broken_off() {
    let shown: [fn(&mut World); 4] = [
        |world| world.show_mode(Px4Mode::POSCTL),
        |world| world.vehicle.telemetry.landed = Some(LandedState::OnGround),
        |world| world.vehicle.telemetry.armed = Some(false),
        // Of a silent vehicle the item is not known for a second.
        |world| world.vehicle.telemetry.mission = None,
    ];
    for show in shown {
        let (mut world, mut flight) = on_final();
        handle(&mut world, &mut flight, Input::Hold);
        handle(&mut world, &mut flight, Input::Advance);
        show(&mut world);
        handle(&mut world, &mut flight, Input::Advance);
        assert_eq!(broken_off(&mut world), None);
    }
}
