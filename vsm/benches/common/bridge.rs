//! `vsm run` between sockets of the bench: one vehicle, and one CUCS that holds LOI 2.

use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use kit::clock::wall;
use kit::process::{Running, write_key};
use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};

use crate::common::{free, socket};
use crate::driver::discard;
use crate::vehicle::{Autopilot, KEY};

pub(crate) struct World {
    program: PathBuf,
    pub(crate) autopilot: Autopilot,
    pub(crate) vehicle: UdpSocket,
    vsm: Running,
    pub(crate) station: UdpSocket,
    dli: SocketAddr,
    folder: tempfile::TempDir,
}

impl World {
    /// A bridge that nobody has sent anything yet; `more` is added to its configuration.
    pub(crate) fn silent(program: &Path, signed: bool, more: &str) -> World {
        let folder = tempfile::tempdir().expect("a folder");
        let (dli, mavlink) = (free(), free());
        write_key(&folder.path().join("uav.key"), &KEY);
        let config = folder.path().join("vsm.toml");
        let signing = match signed {
            true => "{ key_file = \"uav.key\" }",
            false => "\"off\"",
        };
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"{dli}\"\nlease_s = 3600\nmax_bytes_s = 10000000\nmax_messages_s = 100000\n\
             [[cucs]]\nid = \"{CUCS}\"\nloi = [2]\naddress = \"127.0.0.1\"\n[[vehicle]]\n\
             id = \"{VEHICLE}\"\nlink = \"udpin:{mavlink}\"\nsystem_id = 1\nsigning = {signing}\n\
             [store]\ndir = \"state\"\n{more}"
        );
        fs::write(&config, text).expect("the configuration");
        let mut command = Command::new(program);
        command.args(["run", "--config"]).arg(&config);
        let mut vsm = Running::spawn(command.env("RUST_LOG", "off"));
        vsm.wait_for("ready", Duration::from_secs(20));
        let vehicle = socket();
        vehicle.connect(mavlink).expect("its address");
        World {
            program: program.to_owned(),
            autopilot: Autopilot::new(signed),
            vehicle,
            vsm,
            station: socket(),
            dli,
            folder,
        }
    }

    /// A bridge whose vehicle is live, and whose CUCS gets its reports.
    pub(crate) fn start(program: &Path, signed: bool, more: &str) -> World {
        let world = World::silent(program, signed, more);
        world.send(&Message::from(CucsAuthorisationRequest {
            time_stamp: Some(stamp()),
            requested_handover_loi: Some(LoiBitmap::LOI2),
            requested_handover_access: Some(RequestedAccess::Request),
            ..CucsAuthorisationRequest::default()
        }));
        for _ in 0..50 {
            world.report(&world.autopilot.heartbeat(false));
            std::thread::sleep(Duration::from_millis(20));
        }
        world.discard();
        world
    }

    /// The bridge's process.
    pub(crate) fn process(&self) -> u32 {
        self.vsm.id()
    }

    /// What the vehicle sends.
    pub(crate) fn report(&self, frame: &[u8]) {
        self.vehicle.send(frame).expect("it is sent");
    }

    pub(crate) fn send(&self, message: &Message) {
        let mut out = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(CUCS, VEHICLE);
        let length = message.encode(&envelope, &mut out).expect("it fits");
        let sent = self.station.send_to(&out[..length], self.dli);
        sent.expect("it is sent");
    }

    /// Throws away what has come.
    pub(crate) fn discard(&self) {
        for socket in [&self.station, &self.vehicle] {
            discard(socket);
        }
    }

    /// How many messages the bridge has believed of the vehicle.
    pub(crate) fn taken(&self) -> u64 {
        let status = Command::new(&self.program)
            .args(["status", "--json", "--config"])
            .arg(self.folder.path().join("vsm.toml"))
            .output()
            .expect("vsm status");
        let status: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
        let counts = status["vehicles"][0]["link"]["received"].as_object();
        let counts = counts.unwrap_or_else(|| panic!("no counts in {status:#}"));
        counts.values().filter_map(serde_json::Value::as_u64).sum()
    }
}

pub(crate) fn stamp() -> TimeStamp {
    TimeStamp::from_unix_ms(wall().as_millis() as u64)
}

const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
