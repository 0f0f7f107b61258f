//! The guard of a CUCS on a disk that takes 300 ms to synchronise: every datagram of the CUCS passes as if it took none, while the
//! guard raises the ceilings of its stamps, and agrees on another key with the VSM. Real sockets, real time.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use kit::clock::wall;
use kit::process::write_key;
use mavlink_link::Now;
use mavlink_link::exchange::{
    Agreed, Identity, PinnedPeer, PublicKey, ResponderMemory, ResponderStore, StoreError,
};
use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::MemoryDisk;
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, ExchangeDatagram, Guarded, MAX_GUARDED};
use vsm::guard_exchange::{VsmEnd, VsmNews};
use vsm::key_exchange::{ExchangeRecord, identity};
use vsm::session::GuardEnd;
use vsm::shell::disk::FileDisk;
use vsm::shell::guard_link::GuardSide;
use vsm::shell::guard_proxy::{GuardConfig, GuardProxy};
use vsm::shell::key_file::system_random;

use crate::under_attack::Slow;

const VSM: Id = Id(0x1b00_0001);
const CUCS: Id = Id(0x1b00_00a0);
const SYNC: Duration = Duration::from_millis(300);
/// Less than the file and its folder take.
const LONGEST: Duration = Duration::from_millis(500);
const FIRST_KEY: [u8; 32] = [0x41; 32];

fn first_key() -> SigningKey {
    SigningKey::new(FIRST_KEY).expect("not all zero")
}

/// The VSM's end of the guarded path and of the exchange, on a disk that takes no time.
struct Vsm {
    socket: UdpSocket,
    began: Instant,
    end: VsmEnd,
    agreed: AgreedKey,
    guard: GuardEnd,
    stamps: MemoryDisk,
    guard_at: Option<SocketAddr>,
    /// What the CUCS has numbered, when it arrived, and the key that it was sealed under.
    arrived: Vec<(u32, Instant, KeyId)>,
}

#[derive(Default)]
struct AgreedKey(Option<SigningKey>);

impl ResponderStore for AgreedKey {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn store_agreed(&mut self, _: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
        self.0 = Some(agreed.key.duplicate());
        Ok(())
    }
}

impl Vsm {
    /// Paired with this guard.
    fn new(own: Identity, guard: PublicKey) -> Vsm {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        socket.set_nonblocking(true).expect("it need not block");
        let mut end = VsmEnd::new(VSM, own);
        let memory = ResponderMemory {
            peer: Some(PinnedPeer {
                key: guard,
                counter: 0,
            }),
            current: Some(first_key().id()),
            ..ResponderMemory::default()
        };
        end.set(CUCS, memory, Duration::ZERO);
        let (began, mut stamps) = (Instant::now(), MemoryDisk::default());
        let now = Now {
            mono: Duration::ZERO,
            wall: wall(),
        };
        let keys = vec![(first_key(), None)];
        let (ids, sends) = ((VSM, CUCS), Direction::ToCucs);
        let guard = GuardEnd::new(ids, sends, keys, Duration::ZERO, now, &mut stamps);
        Vsm {
            socket,
            began,
            end,
            agreed: AgreedKey::default(),
            guard: guard.expect("its clock can be read"),
            stamps,
            guard_at: None,
            arrived: Vec::new(),
        }
    }

    fn now(&self) -> Now {
        Now {
            mono: self.began.elapsed(),
            wall: wall(),
        }
    }

    /// Since the first datagram of the CUCS.
    fn served(&self) -> Option<Duration> {
        self.arrived.first().map(|(_, at, _)| at.elapsed())
    }

    /// Requests another key, as `vsm guard rotate --cucs` does.
    fn request_key(&mut self) {
        let now = self.now();
        let please = self.end.please(now.mono, CUCS).expect("it is paired");
        let mut out = [0; MAX_GUARDED];
        let sealed = self.guard.seal(now, &please, &mut out, &mut self.stamps);
        let sealed = &out[..sealed.expect("it has a key")];
        let to = self.guard_at.expect("it has sent something");
        self.socket.send_to(sealed, to).expect("it is sent");
    }

    /// Takes what is there, and answers it.
    fn take_all(&mut self) {
        let mut bytes = [0; MAX_GUARDED + 1];
        while let Ok((length, from)) = self.socket.recv_from(&mut bytes) {
            self.guard_at = Some(from);
            self.take(from, &bytes[..length]);
        }
        let now = self.now();
        self.end.handle_timeout(now.mono);
        while let Some((_, news)) = self.end.poll_news() {
            if let (VsmNews::Agreed(_), Some(new)) = (news, &self.agreed.0) {
                let until = Some(now.mono + Duration::from_secs(60));
                let keys = vec![(new.duplicate(), None), (first_key(), until)];
                let set = self
                    .guard
                    .set_keys(keys, Duration::ZERO, now, &mut self.stamps);
                set.expect("its clock can be read");
            }
        }
        while let Some((to, bytes)) = self.end.poll_transmit() {
            self.socket.send_to(&bytes, to).expect("it is sent");
        }
    }

    fn take(&mut self, from: SocketAddr, bytes: &[u8]) {
        let now = self.now();
        let Some(guarded) = Guarded::parse(bytes) else {
            let step = ExchangeDatagram::parse(bytes).expect("a guard sends nothing else");
            let (random, store) = (&mut system_random, &mut self.agreed);
            let _ = self.end.handle(now.mono, from, &step, random, store);
            return;
        };
        let opened = self
            .guard
            .open_from(now, &guarded, (from, None), &mut self.stamps);
        if let Ok((inside, key)) = opened
            && let Ok(number) = inside.try_into()
        {
            let number = u32::from_le_bytes(number);
            self.arrived.push((number, Instant::now(), key));
        }
    }
}

#[test]
fn a_slow_disk_of_a_guard_holds_up_no_datagram_of_its_cucs() {
    let folder = tempfile::tempdir().expect("a folder");
    let (key_file, store) = (folder.path().join("a0.key"), folder.path().join("state"));
    write_key(&key_file, &FIRST_KEY);
    let of_vsm = Identity::new([3; 32]);
    let mut disk = FileDisk::open(&store).expect("a store");
    let record = ExchangeRecord {
        peer: Some(*of_vsm.public().bytes()),
        ..ExchangeRecord::default()
    };
    record.save(&mut disk, CUCS).expect("it is kept");
    let of_guard = identity(&mut disk, &mut system_random).expect("made");
    drop(disk);
    let mut vsm = Vsm::new(of_vsm, of_guard.public());
    let config = GuardConfig {
        side: GuardSide {
            cucs: CUCS,
            vsm: VSM,
            to: vsm.socket.local_addr().expect("bound"),
            key_file,
            store,
        },
        listen: ([127, 0, 0, 1], 0).into(),
        group: None,
        users: Vec::new(),
    };
    let (ready, started) = mpsc::channel();
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let guard = thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async {
            let slow = |dir: &Path| FileDisk::open_on(dir, Box::new(Slow::new(SYNC)));
            let proxy = GuardProxy::open_on(config, slow).await.expect("it starts");
            let near = proxy.address().expect("bound");
            ready.send(near).expect("the test waits");
            let stop = async {
                let _ = stopped.await;
            };
            proxy.serve(stop).await;
        });
    });
    let near = started.recv().expect("it starts");
    let cucs = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let (mut number, mut requested) = (0_u32, false);
    let begun = Instant::now();
    // A ceiling is raised every six seconds or ten.
    while vsm
        .served()
        .is_none_or(|served| served < Duration::from_secs(14))
    {
        assert!(begun.elapsed() < Duration::from_secs(40), "nothing passes");
        number += 1;
        cucs.send_to(&number.to_le_bytes(), near)
            .expect("it is sent");
        thread::sleep(Duration::from_millis(10));
        vsm.take_all();
        if !requested && vsm.served() > Some(Duration::from_secs(2)) {
            requested = true;
            vsm.request_key();
        }
    }
    drop(stop);
    guard.join().expect("it ends");
    let agreed = vsm.agreed.0.as_ref().map(SigningKey::id);
    let last = vsm.arrived.last().map(|(.., key)| *key);
    assert!(agreed.is_some(), "another key is agreed on");
    assert_eq!(last, agreed, "it is in force at both ends");
    let gaps = vsm.arrived.windows(2).map(|two| two[1].1 - two[0].1);
    let longest = gaps.max().expect("datagrams passed");
    assert!(longest < LONGEST, "{longest:?} without a datagram");
    let lost = vsm.arrived.windows(2).find(|two| two[1].0 != two[0].0 + 1);
    assert_eq!(lost, None, "each has arrived, in its order");
}
