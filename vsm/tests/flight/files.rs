//! Files of the vehicle through the bridge: what is refused in flight, and that nothing that flies it waits for them.

use kit::bridge::{Faults, Rig, Setup, orders, vehicle_id};
use mavlink_link::service::ftp::{Done, FilePath, Operation, crc32};
use stanag_msgs::enums::FlightPathControlMode as Mode;
use vsm::session::{FileEvent, FileRefusal};

fn path(text: &str) -> FilePath {
    FilePath::new(text).expect("a path")
}

fn read(text: &str) -> Operation {
    let resume = None;
    Operation::Read {
        path: path(text),
        resume,
    }
}

fn write(text: &str, length: usize) -> Operation {
    let content = vec![7; length];
    Operation::Write {
        path: path(text),
        content,
    }
}

fn start(rig: &mut Rig, operation: Operation) -> Result<(), FileRefusal> {
    let now = rig.now();
    let bridge = rig.bridge.as_mut().expect("a bridge");
    bridge.start_file(now, vehicle_id(0), operation, &mut rig.store)
}

/// Runs until the operation has ended, and returns what was read.
fn finish(rig: &mut Rig) -> (Result<Done, FileRefusal>, Vec<u8>) {
    let mut delivered = Vec::new();
    for _ in 0..6_000 {
        rig.run(0.02);
        let bridge = rig.bridge.as_mut().expect("a bridge");
        while let Some(event) = bridge.poll_file(vehicle_id(0)) {
            match event {
                FileEvent::Data(bytes) => delivered.extend(bytes),
                FileEvent::Ended(result) => return (result, delivered),
                FileEvent::Opened(_) | FileEvent::Written(..) => {}
            }
        }
    }
    panic!("it does not end");
}

fn with_log(rig: &mut Rig, length: usize) -> Vec<u8> {
    let bytes: Vec<u8> = (0..length).map(|at| (at * 13) as u8).collect();
    let vehicle = rig.vehicles[0].vehicle_mut();
    vehicle.files_mut().insert(LOG, bytes.clone());
    bytes
}

#[test]
fn on_the_ground_files_are_read_written_and_removed_over_a_signed_link_that_loses() {
    let mav = Faults {
        loss: 0.1,
        ..Faults::NONE
    };
    let mut rig = Rig::ready_with(Setup {
        mav,
        ..Setup::default()
    });
    let bytes = with_log(&mut rig, 60_000);
    start(&mut rig, read(LOG)).expect("begun");
    assert!(matches!(
        start(&mut rig, read(LOG)),
        Err(FileRefusal::NotStarted(_))
    ));
    let (ended, delivered) = finish(&mut rig);
    let (size, crc) = (60_000, crc32(0, &bytes));
    assert_eq!(ended, Ok(Done::Read { size, crc }));
    assert!(delivered == bytes);
    start(&mut rig, write("/fs/microsd/a.txt", 5_000)).expect("begun");
    assert!(matches!(
        finish(&mut rig).0,
        Ok(Done::Written { size: 5_000, .. })
    ));
    assert_eq!(
        rig.vehicles[0].vehicle().files().get("/fs/microsd/a.txt"),
        Some(&[7; 5_000][..])
    );
    start(&mut rig, Operation::Remove(path("/fs/microsd/a.txt"))).expect("begun");
    assert_eq!(finish(&mut rig).0, Ok(Done::Removed));
    assert_eq!(
        rig.vehicles[0].vehicle().files().get("/fs/microsd/a.txt"),
        None
    );
    let logged = |text: &str| rig.log.iter().any(|entry| entry.text.contains(text));
    assert!(logged("requests to write /fs/microsd/a.txt") && logged("requests to remove"));
}

#[test]
fn in_flight_nothing_is_written_or_removed_and_no_large_file_is_read() {
    let mut rig = Rig::ready();
    with_log(&mut rig, 300_000);
    rig.take_off(30.0);
    let changes = [
        write("/fs/microsd/a.txt", 1),
        Operation::Remove(path(LOG)),
        Operation::RemoveDirectory(path("/fs/microsd/log")),
        Operation::CreateDirectory(path("/fs/microsd/x")),
    ];
    for operation in changes {
        let refused = start(&mut rig, operation);
        assert_eq!(refused, Err(FileRefusal::InFlight("is armed")));
    }
    start(&mut rig, read(LOG)).expect("begun");
    let (ended, _) = finish(&mut rig);
    assert_eq!(
        ended,
        Err(FileRefusal::TooLargeInFlight(300_000, "is armed"))
    );
    let bytes = with_log(&mut rig, 30_000);
    start(&mut rig, read(LOG)).expect("begun");
    let begun = rig.now().mono;
    let (ended, delivered) = finish(&mut rig);
    assert!(
        matches!(ended, Ok(Done::Read { size: 30_000, .. })),
        "{ended:?}"
    );
    assert!(delivered == bytes);
    // 8 000 bytes a second on the wire, at which a radio still carries telemetry.
    let took = (rig.now().mono - begun).as_secs_f64();
    assert!((4.0..8.0).contains(&took), "{took} s");
}

#[test]
fn a_vehicle_that_is_armed_meanwhile_ends_what_changes_its_files() {
    let mut rig = Rig::ready();
    start(&mut rig, write("/fs/microsd/a.bin", 4_000_000)).expect("begun");
    rig.run(0.5);
    rig.take_off(20.0);
    assert_eq!(finish(&mut rig).0, Err(FileRefusal::InFlight("is armed")));
    let written = rig.vehicles[0].vehicle().files().get("/fs/microsd/a.bin");
    assert!(
        written.is_some_and(|bytes| bytes.len() < 4_000_000),
        "it was ended too late to be seen"
    );
}

#[test]
fn a_vehicle_that_is_armed_meanwhile_ends_the_reading_of_a_large_file() {
    let mut rig = Rig::ready();
    with_log(&mut rig, 2_000_000);
    start(&mut rig, read(LOG)).expect("begun");
    rig.run(0.5);
    let bridge = rig.bridge.as_mut().expect("a bridge");
    let opened = bridge.poll_file(vehicle_id(0));
    assert_eq!(opened, Some(FileEvent::Opened(2_000_000)));
    rig.take_off(20.0);
    let (ended, delivered) = finish(&mut rig);
    assert_eq!(
        ended,
        Err(FileRefusal::TooLargeInFlight(2_000_000, "is armed"))
    );
    assert!(delivered.len() < 2_000_000, "it was read in flight");
}

/// The heartbeats that reach the vehicle in 10 s, and the time of 20 commands, with and without a file on its way.
#[test]
fn heartbeats_and_commands_do_not_wait_for_a_file() {
    let measure = |file: bool| {
        let mut rig = Rig::ready();
        with_log(&mut rig, 250_000);
        rig.take_off(30.0);
        if file {
            start(&mut rig, read(LOG)).expect("begun");
        }
        let before = rig.arrived.get(&0).copied().unwrap_or_default();
        let begun = rig.now().mono;
        for _ in 0..20 {
            rig.carry_out(orders::mode(Mode::Loiter));
        }
        let took = rig.now().mono - begun;
        rig.run(10.0);
        let transferred = rig.arrived.get(&110).copied().unwrap_or_default();
        assert_eq!(transferred > 100, file, "{transferred} requests");
        let beats = rig.arrived.get(&0).copied().unwrap_or_default() - before;
        (took, beats as f64 / (rig.now().mono - begun).as_secs_f64())
    };
    let (alone, beats_alone) = measure(false);
    let (beside, beats_beside) = measure(true);
    assert!(
        beside <= alone + alone / 10,
        "{beside:?} beside a file, {alone:?} alone"
    );
    assert!(
        (beats_alone - beats_beside).abs() < 0.15,
        "{beats_alone}, {beats_beside} heartbeats a second"
    );
}

#[test]
fn the_key_and_what_leads_upwards_are_not_reached() {
    let mut rig = Rig::ready();
    let key = "/fs/microsd/mavlink/mavlink-signing-key.bin";
    assert_eq!(
        start(&mut rig, read(key)),
        Err(FileRefusal::KeyFile(key.into()))
    );
    assert!(matches!(
        start(&mut rig, write(key, 40)),
        Err(FileRefusal::KeyFile(_))
    ));
    for another in [
        "/fs/microsd/mavlink/MAVLIN~1.BIN",
        "/fs/microsd/MAVLINK./x",
        "/dev/mmcsd0",
        "dev/mmcsd0",
        "/proc/self/mem",
    ] {
        for operation in [
            read(another),
            write(another, 40),
            Operation::Remove(path(another)),
        ] {
            let refused = Err(FileRefusal::KeyFile(another.into()));
            assert_eq!(start(&mut rig, operation), refused);
        }
    }
    assert!(FilePath::new("/fs/microsd/../etc").is_err());
    let bridge = rig.bridge.as_ref().expect("a bridge");
    assert!(matches!(
        bridge.file_vehicle(Some(stanag_msgs::Id(9))),
        Err(FileRefusal::NoVehicle(..))
    ));
    assert_eq!(bridge.file_vehicle(None), Ok(vehicle_id(0)));
    // A list has names alone.
    let folder = path("/fs/microsd/mavlink");
    assert_eq!(start(&mut rig, Operation::List(folder)), Ok(()));
}

#[test]
fn a_vehicle_that_is_silent_is_not_asked() {
    let mut rig = Rig::new(Setup::default());
    assert_eq!(start(&mut rig, read(LOG)), Err(FileRefusal::Silent));
}

const LOG: &str = "/fs/microsd/log/a.ulg";
