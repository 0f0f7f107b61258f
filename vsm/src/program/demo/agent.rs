//! The air-side agent of a demo, on a thread of its own and paired with the bridge before either starts, and the radio
//! between the two, which is recorded.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, anyhow};
use stanag_msgs::Id;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;

use super::wire::Wire;
use crate::config::airside::AirsideConfig;
use crate::key_exchange::{ExchangeRecord, identity};
use crate::shell::airside::AirsideServer;
use crate::shell::disk::FileDisk;
use crate::shell::key_file::{self, system_random};
use crate::shell::tasks::TaskFault;

/// A running agent.
pub(super) struct AgentBeside {
    /// Where PX4 reaches it.
    pub(super) px4: SocketAddr,
    /// The radio: the bridge sends to its near end.
    pub(super) wire: Wire,
    pub(super) encrypt: bool,
    stop: oneshot::Sender<()>,
    thread: JoinHandle<Result<(), TaskFault>>,
}

impl AgentBeside {
    /// Pairs both stores in this folder, in which `demo.key` is the vehicle's, and starts the agent.
    pub(super) fn start(
        folder: &Path,
        encrypt: bool,
        background: &Runtime,
    ) -> anyhow::Result<AgentBeside> {
        let air = folder.join("air");
        std::fs::create_dir(&air)?;
        std::fs::copy(folder.join("demo.key"), air.join("demo.key"))?;
        pair(folder, &air)?;
        let text = AIRSIDE.replace("ENCRYPT", if encrypt { "true" } else { "false" });
        let config = AirsideConfig::parse(&text, &air)?;
        let (sender, opened) = mpsc::channel();
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name("agent".to_owned())
            .spawn(move || serve(&config, &sender, stopped))?;
        let (radio, px4) = opened.recv().context("the agent's thread has ended")??;
        let wire = background.block_on(Wire::to(radio))?;
        Ok(AgentBeside {
            px4,
            wire,
            encrypt,
            stop,
            thread,
        })
    }

    /// Stops it, and gives what was on the radio.
    pub(super) fn stop(self) -> anyhow::Result<Vec<Vec<u8>>> {
        // A thread that has already ended needs no stop.
        let _ = self.stop.send(());
        let ended = self.thread.join();
        ended.map_err(|_| anyhow!("the agent's thread has panicked"))??;
        Ok(self.wire.all())
    }
}

/// What a pairing by a code leaves in both stores: each has the other's static key, and both have the signing key.
fn pair(ground: &Path, air: &Path) -> anyhow::Result<()> {
    let key = key_file::read(&ground.join("demo.key"))?.id();
    let wall = SystemTime::now().duration_since(UNIX_EPOCH)?;
    let mut ground = FileDisk::open(&ground.join("state"))?;
    let mut air = FileDisk::open(&air.join("state"))?;
    let known = [
        identity(&mut ground, &mut system_random)?.public(),
        identity(&mut air, &mut system_random)?.public(),
    ];
    let record = |of: usize| ExchangeRecord {
        peer: known.get(of).map(|key| *key.bytes()),
        agreed: Some(*key.bytes()),
        key: Some(*key.bytes()),
        since: wall.as_secs(),
        ..ExchangeRecord::default()
    };
    record(1).save(&mut ground, VEHICLE)?;
    record(0).save(&mut air, VEHICLE)?;
    Ok(())
}

type AddressSender = mpsc::Sender<anyhow::Result<(SocketAddr, SocketAddr)>>;

fn serve(
    config: &AirsideConfig,
    sender: &AddressSender,
    stopped: oneshot::Receiver<()>,
) -> Result<(), TaskFault> {
    let open = || {
        let runtime = tokio::runtime::Builder::new_current_thread();
        let runtime = { runtime }.enable_all().build()?;
        let server = {
            let _inside = runtime.enter();
            AirsideServer::open(config)?
        };
        let addresses = server.addresses().context("its links are UDP")?;
        anyhow::Ok((runtime, server, addresses))
    };
    match open() {
        Ok((runtime, server, addresses)) => {
            let _ = sender.send(Ok(addresses));
            let stopped = async {
                // A closed channel means stop too.
                let _ = stopped.await;
            };
            runtime.block_on(server.serve(stopped)).map(drop)
        }
        Err(cause) => {
            let _ = sender.send(Err(cause));
            Ok(())
        }
    }
}

const VEHICLE: Id = Id(0x1b00_0101);
/// The configuration that a user would write, on ports that the system chooses; two links have two addresses.
const AIRSIDE: &str = r#"
[agent]
vehicle_id = "1b:00:01:01"
vsm_id = "1b:00:00:01"
key_file = "demo.key"
[radio]
link = "udpin:127.0.0.1:0"
encrypt = ENCRYPT
[px4]
link = "udpin:127.0.0.2:0"
system_id = 1
[store]
dir = "state"
"#;
