//! Clocks that are dragged ahead, and what a new key makes of them.

use std::time::Duration;

use mavlink_link::clock::Ceiling;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::provisioning::{Event, Outcome};
use mavlink_link::signing::Stamp;
use mavlink_link::store::Store as _;

use super::world::{World, start};
use crate::support::{VEHICLE, at, key, ms, other_key};

#[test]
fn a_clock_that_was_dragged_years_ahead_is_mended_by_a_new_key() {
    let mut world = World::new(Some(key()));
    // Somebody with the key has pushed the vehicle's clock where no honest receiver follows.
    world.px4.clock = Stamp::from_unix(at(0).wall + Duration::from_secs(86_400));
    world.px4.streams.insert((245, 190, 0), Stamp::new(1));
    // It takes the new stamp, below its own clock: that is what sets the clock back.
    let mut out = [0; MAX_FRAME];
    for _ in 0..200 {
        world.tick += 1;
        world.now = world.now.after(ms(100));
        for frame in world.px4.speak(world.tick) {
            world
                .ours
                .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
        }
        world.ours.handle_timeout(world.now);
        while let Some(sent) = world
            .ours
            .poll_transmit(world.now, &mut world.disk, &mut out)
        {
            if sent.secret {
                world.px4.clock = Stamp::new(1);
            }
            world.px4.receive(&out[..sent.len]);
        }
    }
    assert_eq!(world.ours.outcome(), Some(Outcome::Committed));
}
#[test]
fn a_dragged_clock_and_a_lost_datagram_are_mended_over_a_restart_too() {
    for killed_at in [None, Some(50), Some(600)] {
        let mut world = World::new(Some(key()));
        world.px4.clock = Stamp::from_unix(at(0).wall + Duration::from_secs(86_400));
        let mut out = [0; MAX_FRAME];
        let mut sent_keys = 0;
        for tick in 0..3_000 {
            if killed_at == Some(tick) {
                world.kill();
            }
            world.tick += 1;
            world.now = world.now.after(ms(100));
            for frame in world.px4.speak(world.tick) {
                let (now, disk) = (world.now, &mut world.disk);
                world.ours.handle_datagram(now, VEHICLE, &frame, disk);
            }
            world.ours.handle_timeout(world.now);
            while let Some(sent) = world
                .ours
                .poll_transmit(world.now, &mut world.disk, &mut out)
            {
                sent_keys += usize::from(sent.secret);
                let lost = sent.secret && sent_keys == 1;
                if sent.secret && !lost {
                    // PX4 sets its clock to the key's first stamp, whatever it was before.
                    world.px4.clock = Stamp::new(1);
                }
                if !lost {
                    world.px4.receive(&out[..sent.len]);
                }
            }
            while let Some(event) = world.ours.poll_event() {
                assert_ne!(event, Event::Ended(Outcome::RolledBack));
                if event == Event::Commit {
                    world.keys.commit();
                }
            }
        }
        let state = world.ours.state();
        let end = world.ours.outcome();
        assert_eq!(
            end,
            Some(Outcome::Committed),
            "{killed_at:?}: {state:?}, {sent_keys}"
        );
    }
}

#[test]
fn a_wall_clock_ten_years_ahead_is_not_believed_by_way_of_a_new_key() {
    let mut world = World::new(Some(key()));
    let ceiling = Stamp::from_unix(at(0).wall);
    world.disk.save(&key().id(), &Ceiling(ceiling)).unwrap();
    world.now.wall += Duration::from_secs(3_652 * 86_400);
    world.ours = start(&world.keys, &mut world.disk, world.now);
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    for id in [key().id(), other_key().id()] {
        let Ceiling(stored) = world.disk.load(&id).unwrap().unwrap();
        let ahead = stored.since(ceiling);
        assert!(ahead < Duration::from_secs(120), "{ahead:?}");
    }
}
