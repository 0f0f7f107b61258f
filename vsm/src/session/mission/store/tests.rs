//! What is on disk at any moment of an upload, and what it costs.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use mavlink_link::store::MemoryDisk;
use stanag_msgs::enums::AltitudeType;
use stanag_msgs::messages::{CurveSegment, UaPositionWaypoint, UaRoute};
use stanag_msgs::scalar::{Bam32, Scaled};
use stanag_msgs::{Text, TimeStamp};
use zeroize::Zeroizing;

use super::super::plan_files::FOLD_LINES;
use super::*;
use crate::session::testing::{CUCS, VEHICLE, World};

/// A disk that counts the bytes written to it, and after which change the process ends.
#[derive(Debug, Default, Clone)]
struct Counted {
    disk: MemoryDisk,
    written: usize,
    /// So many changes are still made.
    left: Option<u32>,
    /// Of the first that is not made, so many bytes of an appended line are.
    torn: usize,
    /// No file can be removed.
    stuck: bool,
}

#[derive(Debug, Default, Clone)]
struct Shared(Rc<RefCell<Counted>>);

impl Shared {
    fn admit(&self, bytes: usize) -> Result<(), StoreError> {
        let mut counted = self.0.borrow_mut();
        counted.written += bytes;
        match &mut counted.left {
            Some(0) => Err(StoreError::new("any", "killed")),
            Some(left) => {
                *left -= 1;
                Ok(())
            }
            None => Ok(()),
        }
    }
}

impl Disk for Shared {
    fn read(&self, name: &str, max: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        self.0.borrow().disk.read(name, max)
    }

    fn replace(&mut self, name: &str, bytes: &[u8], to: Durability) -> Result<(), StoreError> {
        self.admit(bytes.len())?;
        self.0.borrow_mut().disk.replace(name, bytes, to)
    }

    fn append(&mut self, name: &str, bytes: &[u8], to: Durability) -> Result<(), StoreError> {
        let admitted = self.admit(bytes.len());
        let mut counted = self.0.borrow_mut();
        let whole = admitted.is_ok();
        let some = if whole {
            bytes.len()
        } else {
            counted.torn.min(bytes.len())
        };
        counted.disk.append(name, &bytes[..some], to)?;
        admitted
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.admit(0)?;
        self.0.borrow_mut().disk.rename(from, to)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.admit(0)?;
        if self.0.borrow().stuck {
            return Err(StoreError::new(name, "cannot be removed"));
        }
        self.0.borrow_mut().disk.remove(name)
    }
}

fn world() -> (World, Shared) {
    let disk = Shared::default();
    let mut world = World::new();
    world.disk = Box::new(disk.clone());
    (world, disk)
}

fn waypoint(number: u16, next: u16) -> Message {
    let degrees = f64::from(number) * 1e-3;
    UaPositionWaypoint {
        time_stamp: Some(TimeStamp(u64::from(number))),
        waypoint_number: Some(number),
        waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(degrees)),
        waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(degrees)),
        waypoint_to_altitude: Some(Scaled::saturating_from_si(50.0)),
        waypoint_altitude_type: Some(AltitudeType::Agl),
        waypoint_to_speed: Some(Scaled::saturating_from_si(5.0)),
        next_waypoint: Some(next),
        ..UaPositionWaypoint::default()
    }
    .into()
}

fn curve(p1: u16, p4: u16) -> Message {
    CurveSegment {
        p1_waypoint_no: Some(p1),
        p4_waypoint_no: Some(p4),
        ..CurveSegment::default()
    }
    .into()
}

fn route(name: &str, initial: u16) -> Message {
    UaRoute {
        route_id: Some(Text::new(name)),
        initial_waypoint_number: Some(initial),
        ..UaRoute::default()
    }
    .into()
}

fn store(world: &mut World, store: &mut MissionStore, message: &Message) -> Result<(), String> {
    world.act(|_, _, effects| store.store(message, CUCS, effects))
}

fn restored(world: &mut World) -> MissionStore {
    let mut store = MissionStore::default();
    let restored = world.act(|_, _, effects| store.restore(effects));
    restored.expect("the records are read");
    store
}

#[test]
fn ten_thousand_waypoints_are_stored_in_seconds_and_megabytes() {
    let (mut world, disk) = world();
    let mut plan = MissionStore::default();
    let started = Instant::now();
    store(&mut world, &mut plan, &route("R", 1)).expect("stored");
    for number in 1..=10_000 {
        let next = if number == 10_000 { 0 } else { number + 1 };
        store(&mut world, &mut plan, &waypoint(number, next)).expect("stored");
    }
    let took = started.elapsed();
    let written = disk.0.borrow().written;
    assert!(written < 20_000_000, "{written} bytes written");
    assert!(took < Duration::from_secs(5), "{took:?}");
    assert_eq!(restored(&mut world).offered(CUCS), plan.offered(CUCS));
    world
        .act(|_, _, effects| plan.fold_log(CUCS, effects))
        .expect("folded");
    assert!(
        !disk
            .0
            .borrow()
            .disk
            .records
            .contains_key("plan-1b000101.log")
    );
    assert_eq!(restored(&mut world).offered(CUCS), plan.offered(CUCS));
}

#[test]
fn the_log_of_a_short_plan_that_is_sent_again_and_again_stays_short() {
    let (mut world, disk) = world();
    let mut plan = MissionStore::default();
    for round in 0..5_000_u16 {
        let message = waypoint(1 + round % 3, 2 + round % 5);
        store(&mut world, &mut plan, &message).expect("stored");
    }
    let lines = |disk: &Shared| {
        let counted = disk.0.borrow();
        let log = &counted.disk.records["plan-1b000101.log"];
        log.iter().filter(|byte| **byte == b'\n').count()
    };
    assert!(lines(&disk) <= FOLD_LINES + 2 * 3 + 1, "{}", lines(&disk));
    assert_eq!(restored(&mut world).offered(CUCS), plan.offered(CUCS));
}

/// Messages with a clearing among them; whatever change of the disk is the last that is made, and wherever it tears
/// a line, a restart finds what was answered, with or without what was not.
#[test]
fn a_process_that_ends_at_any_moment_loses_nothing_that_was_answered() {
    enum Step {
        Store(Box<Message>),
        Fold,
        Clear,
    }
    let steps = || {
        let plan = [route("R", 1), waypoint(1, 2), waypoint(2, 0)]
            .map(|message| Step::Store(Box::new(message)));
        let again = [route("R", 1), waypoint(1, 3)].map(|message| Step::Store(Box::new(message)));
        let last = [waypoint(3, 0), waypoint(4, 0)].map(|message| Step::Store(Box::new(message)));
        // The record of a plan that is cleared twice is the same both times.
        (plan.into_iter().chain([Step::Clear]))
            .chain(again)
            .chain([
                Step::Clear,
                Step::Store(Box::new(waypoint(1, 2))),
                Step::Fold,
            ])
            .chain(last)
            // Here the log, read once more over the record that holds it, would remove the curve.
            .chain([waypoint(1, 5), curve(1, 3)].map(|message| Step::Store(Box::new(message))))
            .chain([Step::Fold])
            .chain([waypoint(1, 2), waypoint(1, 3)].map(|message| Step::Store(Box::new(message))))
            .chain([Step::Fold])
    };
    let mut cut_off = 0;
    for left in 0..60 {
        for torn in [0, 1, 40, usize::MAX] {
            let (mut world, disk) = world();
            let mut plan = MissionStore::default();
            disk.0.borrow_mut().left = Some(left);
            disk.0.borrow_mut().torn = torn;
            let (mut before, mut after) = (Plan::default(), Plan::default());
            for step in steps() {
                let done = match &step {
                    Step::Store(message) => {
                        after.store(message, CUCS, VEHICLE).expect("it fits");
                        store(&mut world, &mut plan, message).is_ok()
                    }
                    Step::Fold => world
                        .act(|_, _, effects| plan.fold_log(CUCS, effects))
                        .is_ok(),
                    Step::Clear => {
                        after.clear();
                        plan.begin_clear();
                        world
                            .act(|_, _, effects| plan.cleared(None, CUCS, effects))
                            .is_ok()
                    }
                };
                if !done {
                    cut_off += 1;
                    break;
                }
                before.clone_from(&after);
            }
            disk.0.borrow_mut().left = None;
            let mut found = restored(&mut world);
            let case = format!("{left} changes, {torn} bytes");
            assert!([&before, &after].contains(&found.offered(CUCS)), "{case}");
            // What comes next is stored behind it, whatever is on the disk.
            let next = waypoint(9, 0);
            store(&mut world, &mut found, &next).expect("stored");
            store(&mut world, &mut found, &waypoint(10, 0)).expect("stored");
            assert_eq!(
                restored(&mut world).offered(CUCS),
                found.offered(CUCS),
                "{case}"
            );
        }
    }
    assert!(cut_off > 80, "{cut_off}");
}

#[test]
fn a_message_that_the_disk_refuses_is_not_in_the_plan_and_the_next_one_is() {
    let (mut world, disk) = world();
    let mut plan = MissionStore::default();
    store(&mut world, &mut plan, &waypoint(1, 0)).expect("stored");
    disk.0.borrow_mut().left = Some(0);
    disk.0.borrow_mut().torn = 30;
    let refused = store(&mut world, &mut plan, &waypoint(2, 0));
    assert!(refused.is_err_and(|why| why.starts_with("it cannot be stored: ")));
    disk.0.borrow_mut().left = None;
    store(&mut world, &mut plan, &waypoint(3, 0)).expect("stored");
    assert!(plan.offered(CUCS).waypoint(2).is_none() && plan.offered(CUCS).waypoint(3).is_some());
    assert_eq!(restored(&mut world).offered(CUCS), plan.offered(CUCS));
}

#[test]
fn a_record_of_before_the_log_is_read_and_a_log_of_another_record_is_not() {
    let (mut world, disk) = world();
    let mut plan = MissionStore::default();
    for message in [route("R", 1), waypoint(1, 0)] {
        store(&mut world, &mut plan, &message).expect("stored");
    }
    // An earlier version knows the record alone.
    let mut old = Plan::default();
    old.store(&waypoint(7, 0), CUCS, VEHICLE).expect("it fits");
    let record = record::encode_plan(&ReceivedPlan::settled(old.clone()), CUCS, VEHICLE)
        .expect("it is encoded");
    let text = String::from_utf8_lossy(&record);
    assert!(!text.contains("staged") && !text.contains("dropped"));
    let mut disk = disk;
    disk.replace("plan-1b000101.json", &record, Durability::Process)
        .expect("written");
    let mut found = restored(&mut world);
    assert_eq!(*found.plan(), old);
    store(&mut world, &mut found, &waypoint(8, 0)).expect("stored");
    assert_eq!(*found.plan(), old);
    assert_eq!(restored(&mut world).offered(CUCS), found.offered(CUCS));
}

/// That version kept the upload in the plan, and what was before it beside it.
#[test]
fn an_upload_in_a_record_of_before_it_was_staged_is_its_senders_and_not_stored() {
    let (mut world, mut disk) = world();
    let line = |message: &Message| record::encode_message(message, CUCS, VEHICLE);
    let line = |message| line(&message).expect("it is encoded");
    let (first, second) = (line(waypoint(1, 0)), line(waypoint(2, 0)));
    let record = format!(
        r#"{{"messages":["{first}","{second}"],"upload":{{"base":["{first}"],"sent":["{second}"],"failed":false}}}}"#
    );
    disk.replace("plan-1b000101.json", record.as_bytes(), Durability::Process)
        .expect("written");
    let mut found = restored(&mut world);
    let numbers = |plan: &Plan| plan.numbers().collect::<Vec<_>>();
    assert_eq!(numbers(found.plan()), [1]);
    assert_eq!(numbers(found.offered(CUCS)), [1, 2]);
    assert_eq!(numbers(found.offered(Id(CUCS.0 + 1))), [1]);
    world.act(|_, _, effects| found.watch_upload(Duration::ZERO, None, effects));
    assert_eq!(numbers(restored(&mut world).offered(CUCS)), [1]);
}

#[test]
fn an_upload_is_dropped_with_its_owners_control_or_when_it_is_left_and_so_it_is_on_disk() {
    let minutes = |minutes: u64| Duration::from_secs(60 * minutes);
    for (controller, at, kept) in [
        (Some(CUCS), minutes(4), true),
        (Some(CUCS), minutes(6), false),
        (Some(Id(CUCS.0 + 1)), Duration::ZERO, false),
        (None, Duration::ZERO, false),
    ] {
        let (mut world, _) = world();
        let mut plan = MissionStore::default();
        for message in [route("R", 1), waypoint(1, 0)] {
            store(&mut world, &mut plan, &message).expect("stored");
        }
        let begun = world.now.mono;
        assert!(plan.poll_timeout() > Some(begun));
        world.act(|_, _, effects| plan.watch_upload(begun + at, controller, effects));
        assert_eq!(plan.poll_timeout().is_some(), kept, "{controller:?} {at:?}");
        let mut found = restored(&mut world);
        assert_eq!(found.offered(CUCS), plan.offered(CUCS));
        assert_eq!(found.offered(CUCS).is_empty(), !kept);
        let admitted = found.admit_load(CUCS, None);
        assert_eq!(admitted.is_ok(), kept, "{admitted:?}");
    }
}

#[test]
fn what_is_sent_after_a_load_that_a_restart_cut_off_is_of_another_upload() {
    let (mut world, _) = world();
    let mut plan = MissionStore::default();
    for message in [route("R", 1), waypoint(1, 2), waypoint(2, 0), curve(1, 2)] {
        store(&mut world, &mut plan, &message).expect("stored");
    }
    world
        .act(|_, _, effects| plan.begin_load(&MissionTransferCommand::default(), CUCS, effects))
        .expect("begun");
    let mut found = restored(&mut world);
    assert_eq!(
        found.offered(CUCS),
        plan.offered(CUCS),
        "it can be repeated"
    );
    for message in [route("S", 1), waypoint(1, 2), waypoint(2, 0)] {
        store(&mut world, &mut found, &message).expect("stored");
    }
    for found in [restored(&mut world), found] {
        let plan = found.offered(CUCS);
        assert!(plan.curves_from(1).count() == 0 && plan.route_named("R").is_none());
    }
}

#[test]
fn a_log_that_cannot_be_removed_does_not_bring_a_cleared_plan_back() {
    let (mut world, disk) = world();
    let mut plan = MissionStore::default();
    let clear = |world: &mut World, plan: &mut MissionStore| {
        plan.begin_clear();
        world.act(|_, _, effects| plan.cleared(None, CUCS, effects))
    };
    store(&mut world, &mut plan, &waypoint(1, 0)).expect("stored");
    disk.0.borrow_mut().stuck = true;
    // The log continues a record that is not there any more.
    clear(&mut world, &mut plan).expect("cleared");
    assert!(restored(&mut world).offered(CUCS).is_empty());
    store(&mut world, &mut plan, &waypoint(2, 0)).expect("stored");
    // Now it continues the record of a cleared plan: another such record would not outdate it.
    assert!(clear(&mut world, &mut plan).is_err());
}

#[test]
fn a_whole_line_that_is_no_message_stops_the_start() {
    let (mut world, mut disk) = world();
    let mut plan = MissionStore::default();
    store(&mut world, &mut plan, &waypoint(1, 0)).expect("stored");
    disk.append("plan-1b000101.log", b"not hex\n", Durability::Process)
        .expect("written");
    let mut found = MissionStore::default();
    let restored = world.act(|_, _, effects| found.restore(effects));
    assert_eq!(
        restored.expect_err("it is refused").name,
        "plan-1b000101.log"
    );
}
