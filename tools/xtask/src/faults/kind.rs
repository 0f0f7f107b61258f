//! The faults of `cargo xtask faults`: how each is made, and healed.

use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use rustix::process::Signal;

use super::draw::Dice;
use super::network::{Host, NODES, Net};
use super::process::Running;
use super::world::World;

/// A kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    KillOwner,
    KillStandby,
    PauseOwner,
    Move,
    KillMember,
    KillMajority,
    CutMember,
    CutStore,
    CutVehicles,
    CutVehiclesAndMove,
    CutBoth,
    Isolate,
    StepClock,
    SlowDiskOfOwner,
    SlowDiskOfMember,
    SlowNetwork,
}

impl Kind {
    pub(super) const ALL: [Kind; 16] = [
        Kind::KillOwner,
        Kind::KillStandby,
        Kind::PauseOwner,
        Kind::Move,
        Kind::KillMember,
        Kind::KillMajority,
        Kind::CutMember,
        Kind::CutStore,
        Kind::CutVehicles,
        Kind::CutVehiclesAndMove,
        Kind::CutBoth,
        Kind::Isolate,
        Kind::StepClock,
        Kind::SlowDiskOfOwner,
        Kind::SlowDiskOfMember,
        Kind::SlowNetwork,
    ];

    pub(super) fn in_words(self) -> &'static str {
        match self {
            Kind::KillOwner => "`kill -9` of the node that serves",
            Kind::KillStandby => "`kill -9` of a node that stands by",
            Kind::PauseOwner => "the node that serves stands still (SIGSTOP) for 1 to 6 s",
            Kind::Move => "`vsm fleet move`",
            Kind::KillMember => "`kill -9` of a member of etcd",
            Kind::KillMajority => "`kill -9` of two members of etcd for 1 to 6 s",
            Kind::CutMember => "a member of etcd cut off for 1 to 8 s",
            Kind::CutStore => "the node that serves cut off from etcd for 1 to 8 s",
            Kind::CutVehicles => "the node that serves cut off from the vehicles for 1 to 8 s",
            Kind::CutVehiclesAndMove => "the same, and `vsm fleet move`",
            Kind::CutBoth => "the node that serves cut off from etcd and the vehicles for 1 to 8 s",
            Kind::Isolate => "the same, and from the stations",
            Kind::StepClock => {
                "the clock of a node steps by up to a day, and the node that serves is killed"
            }
            Kind::SlowDiskOfOwner => {
                "each fsync of the node that serves lasts 100 to 900 ms longer"
            }
            Kind::SlowDiskOfMember => "each fsync of a member of etcd lasts 100 to 900 ms longer",
            Kind::SlowNetwork => "128 kbit/s between the node that serves and etcd",
        }
    }

    /// The program without which it cannot be made.
    pub(super) fn needs(self) -> Option<&'static str> {
        match self {
            Kind::StepClock => Some("libfaketime"),
            Kind::SlowDiskOfOwner | Kind::SlowDiskOfMember => Some("strace"),
            Kind::SlowNetwork => Some("tc"),
            _ => None,
        }
    }

    /// Whether a vehicle's answer may not reach the node that commanded it, or not be accepted there: nothing is while the clock of the link
    /// cannot be stored.
    pub(super) fn loses_answers(self) -> bool {
        matches!(self, Kind::PauseOwner | Kind::SlowDiskOfOwner) || self.cuts().contains(&Net::Air)
    }

    fn cuts(self) -> &'static [Net] {
        match self {
            Kind::CutStore => &[Net::Store],
            Kind::CutVehicles | Kind::CutVehiclesAndMove => &[Net::Air],
            Kind::CutBoth => &[Net::Air, Net::Store],
            Kind::Isolate => &Net::ALL,
            _ => &[],
        }
    }
}

/// A fault that was drawn.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) kind: Kind,
    owner: usize,
    /// A node that stands by, or a member of etcd, and another one.
    other: usize,
    another: usize,
    /// How long it lasts.
    lasts: Duration,
    /// Of the clock.
    step_s: i64,
    /// Of each fsync, ms.
    delay_ms: u64,
    /// When it was made.
    pub(super) at: Instant,
    /// Slows a disk while it runs.
    tracer: Option<Running>,
}

impl Fault {
    pub(super) fn draw(dice: &mut Dice, kinds: &[Kind], owner: usize) -> Fault {
        let kind = kinds[dice.below(kinds.len())];
        let longest = match kind {
            Kind::KillOwner | Kind::KillStandby | Kind::KillMember | Kind::StepClock => 3_000,
            Kind::PauseOwner | Kind::KillMajority => 6_000,
            _ => 8_000,
        };
        let step_s = [2, 90, 600, 7_200, 86_400][dice.below(5)];
        let other = dice.below(NODES);
        let of_standby = matches!(kind, Kind::KillStandby);
        Fault {
            kind,
            owner,
            other: if of_standby && other == owner {
                (other + 1) % NODES
            } else {
                other
            },
            another: (other + 1 + dice.below(NODES - 1)) % NODES,
            lasts: Duration::from_millis(1_000 + dice.below(longest - 1_000) as u64),
            step_s: if dice.below(2) == 0 { step_s } else { -step_s },
            delay_ms: 100 + dice.below(800) as u64,
            at: Instant::now(),
            tracer: None,
        }
    }

    /// What it does to whom, for the line that is printed.
    pub(super) fn in_words(&self) -> String {
        let Fault {
            kind,
            owner,
            other,
            another,
            lasts,
            step_s,
            delay_ms,
            ..
        } = self;
        let lasts = format!("{:.1} s", lasts.as_secs_f64());
        match kind {
            Kind::KillStandby => format!("kill n{other}"),
            Kind::KillMember => format!("kill e{other} for {lasts}"),
            Kind::KillMajority => format!("kill e{other} and e{another} for {lasts}"),
            Kind::CutMember => format!("cut e{other} off for {lasts}"),
            Kind::StepClock => format!("clock of n{other} at {step_s:+} s, kill n{owner}"),
            Kind::SlowDiskOfOwner => format!("fsync of n{owner} +{delay_ms} ms for {lasts}"),
            Kind::SlowDiskOfMember => format!("fsync of e{other} +{delay_ms} ms for {lasts}"),
            _ => format!("{kind:?} of n{owner} for {lasts}"),
        }
    }

    /// Makes it.
    pub(super) fn inject(&mut self, world: &mut World) -> Result<()> {
        let computers = &world.computers;
        self.at = Instant::now();
        match self.kind {
            Kind::KillOwner => computers.kill(self.owner),
            Kind::KillStandby => computers.kill(self.other),
            Kind::PauseOwner => computers.signal(self.owner, Signal::STOP),
            Kind::Move => {
                let (done, printed) = computers.order(&["move"])?;
                if !done {
                    bail!("`vsm fleet move`: {printed}");
                }
            }
            Kind::KillMember => world.kill_member(self.other),
            Kind::KillMajority => {
                world.kill_member(self.other);
                world.kill_member(self.another);
            }
            Kind::CutMember => world.network().cut(Host::Member(self.other), Net::Store)?,
            Kind::CutStore | Kind::CutVehicles | Kind::CutBoth | Kind::Isolate => {
                self.cut(world)?
            }
            Kind::CutVehiclesAndMove => {
                self.cut(world)?;
                let (done, printed) = world.computers.order(&["move"])?;
                if !done {
                    bail!("`vsm fleet move`: {printed}");
                }
            }
            Kind::StepClock => {
                computers.set_clock(self.other, self.step_s)?;
                // Until the library looks again.
                thread::sleep(Duration::from_millis(1_100));
                self.at = Instant::now();
                computers.kill(self.owner);
            }
            Kind::SlowDiskOfOwner => {
                self.tracer = Some(slow_disk(
                    world,
                    computers.node_id(self.owner)?,
                    self.delay_ms,
                )?);
            }
            Kind::SlowDiskOfMember => {
                self.tracer = Some(slow_disk(
                    world,
                    world.member_id(self.other)?,
                    self.delay_ms,
                )?);
            }
            Kind::SlowNetwork => world
                .network()
                .slow(Host::Node(self.owner), Net::Store, true)?,
        }
        Ok(())
    }

    fn cut(&self, world: &World) -> Result<()> {
        let mut cuts = self.kind.cuts().iter();
        cuts.try_for_each(|net| world.network().cut(Host::Node(self.owner), *net))
    }

    /// Lets it last, and heals it.
    pub(super) fn heal(&mut self, world: &mut World) -> Result<()> {
        thread::sleep(self.lasts);
        let computers = &world.computers;
        match self.kind {
            Kind::KillOwner | Kind::StepClock => computers.release(self.owner),
            Kind::KillStandby => computers.release(self.other),
            Kind::PauseOwner => computers.signal(self.owner, Signal::CONT),
            Kind::Move => {}
            Kind::KillMember => world.start_member(self.other)?,
            Kind::KillMajority => {
                world.start_member(self.other)?;
                world.start_member(self.another)?;
            }
            Kind::CutMember => world.network().join(Host::Member(self.other), Net::Store)?,
            Kind::CutStore
            | Kind::CutVehicles
            | Kind::CutVehiclesAndMove
            | Kind::CutBoth
            | Kind::Isolate => {
                for net in self.kind.cuts() {
                    world.network().join(Host::Node(self.owner), *net)?;
                }
            }
            Kind::SlowDiskOfOwner | Kind::SlowDiskOfMember => {
                if let Some(mut tracer) = self.tracer.take() {
                    // It lets go of the process; killed, it might leave a thread of it stopped.
                    tracer.signal(Signal::TERM);
                    tracer.wait(Duration::from_secs(5));
                }
            }
            Kind::SlowNetwork => world
                .network()
                .slow(Host::Node(self.owner), Net::Store, false)?,
        }
        Ok(())
    }
}

/// Delays each fsync of a process.
fn slow_disk(world: &World, process: u32, delay_ms: u64) -> Result<Running> {
    let mut strace = Command::new("strace");
    strace.args(["-f", "-q", "-o", "/dev/null", "-p", &process.to_string()]);
    strace.args(["-e", "trace=fsync,fdatasync"]);
    strace.args([
        "-e",
        &format!("inject=fsync,fdatasync:delay_exit={}ms", delay_ms),
    ]);
    Running::start(&mut strace, &world.computers.folder.join("strace.log"))
}
