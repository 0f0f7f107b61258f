//! Rally points of the configuration.

use mapping::rally::{self, Height};

use super::*;

#[test]
fn rally_points_that_change_during_their_upload_are_replaced_and_cleared() {
    let mut world = World::new();
    let at = |latitude: f64| {
        let height = Height::AboveHome(0.0);
        let place = (latitude, 8.0);
        vec![RallyPoint { place, height }]
    };
    let mut mission = Mission::new(Vec::new(), Vec::new());
    mission.set_rally(at(47.001), world.now.mono);
    handle(&mut world, &mut mission, Input::WatchFence);
    for (sent, next) in [(at(47.001), at(47.002)), (at(47.002), Vec::new())] {
        assert_eq!(world.services.missions.busy(), Some(Operation::Upload));
        mission.set_rally(next, world.now.mono);
        // What is read back is compared with what was sent, not with what is configured by now.
        let items = rally::items(&sent);
        let id = transferred(&mut world, &mut mission, RALLY, &items);
        world.vehicle.telemetry.mission = named(0, 0).map(|shown| MissionProgress {
            rally_points_id: id,
            ..shown
        });
        // The upload is finished, then the change is due.
        handle(&mut world, &mut mission, Input::WatchFence);
        handle(&mut world, &mut mission, Input::WatchFence);
    }
    let cleared = Event::Cleared { kind: RALLY };
    ended(&mut world, &mut mission, Operation::Clear, cleared);
    world.vehicle.telemetry.mission = named(0, 0);
    handle(&mut world, &mut mission, Input::WatchFence);
    assert_eq!(world.services.missions.busy(), None);
    assert_eq!(mission.poll_timeout(), None);
}

/// PX4 names none by 0, and a vehicle without ids whatever it holds.
#[test]
fn rally_points_that_the_configuration_has_lost_are_cleared_also_where_the_vehicle_names_none() {
    let mut world = World::new();
    world.vehicle.telemetry.mission = named(0, 0);
    let point = RallyPoint {
        place: (47.0, 8.0),
        height: mapping::rally::Height::AboveHome(2.0),
    };
    let mut before = Mission::new(Vec::new(), vec![point]);
    let busy = looked(&mut world, &mut before);
    assert_eq!(busy, Some(Operation::Upload));
    // Killed in the midst of it.
    let mut after = restarted(&mut world);
    let busy = looked(&mut world, &mut after);
    assert_eq!(busy, Some(Operation::Clear));
    let cleared = Event::Cleared { kind: RALLY };
    ended(&mut world, &mut after, Operation::Clear, cleared);
    let mut once = restarted(&mut world);
    assert_eq!(looked(&mut world, &mut once), None);
}

#[test]
fn rally_points_that_nobody_configured_are_left_alone_with_an_alert() {
    let mut world = World::new();
    let mut mission = Mission::new(Vec::new(), Vec::new());
    world.vehicle.telemetry.mission = named(0, 0).map(|named| MissionProgress {
        rally_points_id: 5,
        ..named
    });
    world.sent_to(0);
    let unknown = |world: &mut World, mission: &mut Mission| {
        handle(world, mission, Input::WatchFence);
        assert_eq!(world.services.missions.busy(), None);
        let (_, texts) = reports(world);
        texts.contains("rally points that the configuration does not have")
    };
    assert!(
        !unknown(&mut world, &mut mission),
        "perhaps cleared just now"
    );
    world.advance(6 * SECOND);
    assert!(unknown(&mut world, &mut mission));
}
