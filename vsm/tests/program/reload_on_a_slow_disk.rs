//! A reload that adds ten vehicles on a disk of which each reading takes 100 ms, and asks a name server that takes a second:
//! the vehicle that flies gets its heartbeats as if nothing were read. Real sockets, real time.

use std::fs;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use kit::process::{free_udp_port, write_key};
use vsm::config::Config;
use vsm::shell::disk::FileDisk;
use vsm::shell::server::Server;
use vsm::shell::status_socket::{RELOAD, ask};

use crate::under_attack::{BRIDGE, Slow};

/// Of a synchronisation, and of a reading.
const SLOW: Duration = Duration::from_millis(100);
/// Of the name server.
const NAMES: Duration = Duration::from_secs(1);
/// Between two heartbeats of the bridge.
const PERIOD: Duration = Duration::from_secs(1);

/// A name server that is asked for one name.
fn slow_names(host: &str) -> io::Result<Option<SocketAddr>> {
    thread::sleep(NAMES);
    let known = host.starts_with("uav.example:");
    Ok(known.then(|| SocketAddr::from((Ipv4Addr::LOCALHOST, 14_550))))
}

#[test]
#[allow(clippy::print_stderr, reason = "a figure is printed")]
fn a_reload_that_adds_ten_vehicles_delays_no_heartbeat_of_another() {
    let folder = tempfile::tempdir().expect("a folder");
    let vehicle = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\n\
         [store]\ndir = \"state\"\n[record]\ndir = \"recordings\"\n[[vehicle]]\nid = \"1b:00:01:00\"\n\
         link = \"udpout:{}\"\nsystem_id = 1\nsigning = \"off\"\n",
        free_udp_port(),
        vehicle.local_addr().expect("bound"),
    );
    let path = folder.path().join("vsm.toml");
    fs::write(&path, &text).expect("written");
    let config = Config::load(&path).expect("a good configuration");
    let store = config.store.dir.clone();

    let disk = Slow::new(SLOW);
    let (reading, waited) = (disk.read.clone(), disk.waited.clone());
    let (ready, started) = std::sync::mpsc::channel();
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let file = path.clone();
    let bridge = thread::Builder::new().name(BRIDGE.to_owned());
    let server = bridge.spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async {
            let disk = FileDisk::open_on(&config.store.dir, Box::new(disk)).expect("a store");
            let mut server = Server::open_on(&config, disk).expect("it starts");
            server.reload_from(&file).expect("its socket");
            server.resolve_by(slow_names);
            ready.send(()).expect("the test waits");
            let stop = async {
                let _ = stopped.await;
            };
            server.serve(stop).await.expect("it serves until the end")
        })
    });
    let server = server.expect("a thread");
    started.recv().expect("the bridge starts");

    reading.store(SLOW.as_millis() as u64, Ordering::Relaxed);
    for index in 1..=10_u8 {
        write_key(&folder.path().join(format!("uav{index}.key")), &[index; 32]);
        let link = match index {
            10 => "udpout:uav.example:14550".to_owned(),
            _ => format!("udpin:127.0.0.1:{}", free_udp_port()),
        };
        text += &format!(
            "[[vehicle]]\nid = \"1b:00:01:{index:02x}\"\nlink = \"{link}\"\nsystem_id = {}\n\
             signing = {{ key_file = \"uav{index}.key\" }}\n",
            index + 1
        );
    }
    // A station with a log of its commands, too.
    text += "[[cucs]]\nid = \"1b:00:00:a1\"\nloi = [2]\n";
    fs::write(&path, &text).expect("written");
    let began = Instant::now();
    let reload = thread::spawn(move || {
        (
            ask(&store, RELOAD, Duration::from_secs(60)),
            began.elapsed(),
        )
    });

    vehicle
        .set_read_timeout(Some(Duration::from_secs(10)))
        .expect("set");
    let (mut bytes, mut at, mut longest) = ([0; 512], None::<Instant>, Duration::ZERO);
    // Until the new ones have been sent something, too.
    let mut after = 0;
    while after < 3 {
        vehicle.recv(&mut bytes).expect("heartbeats go on");
        if let Some(before) = at.replace(Instant::now()) {
            longest = longest.max(before.elapsed());
        }
        after += u32::from(reload.is_finished());
    }
    let (report, took) = reload.join().expect("it ends");
    let report = report.expect("an answer");
    let late = longest.saturating_sub(PERIOD);
    eprintln!("a reload of {took:?}: a heartbeat {late:?} late at most");
    assert_eq!(report.matches(" added").count(), 11, "{report}");
    assert!(took > NAMES, "the name server was asked: {took:?}");
    let read = waited.lock().expect("no panic").clone();
    assert!(read.is_empty(), "read on the bridge's thread: {read:?}");
    // 1 ms on a machine with nothing else to do.
    assert!(late < Duration::from_millis(400), "{late:?}");
    drop(stop);
    server.join().expect("it ends");
}
