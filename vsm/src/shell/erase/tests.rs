//! Whatever step fails, a power cut included, either nothing is ordered and all is as it was, or the next start leaves nothing.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use zeroize::Zeroizing;

use super::*;

const SECRET: &[u8] = b"a secret";

/// A disk whose power fails at the nth step, that one half done. What was deleted comes back where its folder had not been
/// synchronised, as after a real power cut.
#[derive(Debug, Default)]
struct Power {
    left: AtomicUsize,
    /// It fails for that step alone.
    returns: bool,
    deleted: Mutex<Vec<(PathBuf, Vec<u8>)>>,
}

impl Power {
    fn fails_at(step: usize) -> Power {
        Power {
            left: AtomicUsize::new(step),
            ..Power::default()
        }
    }

    fn flickers_at(step: usize) -> Power {
        Power {
            returns: true,
            ..Power::fails_at(step)
        }
    }

    /// Once power has failed, nothing happens any more.
    fn step(&self) -> io::Result<()> {
        let left = self.left.load(Ordering::Relaxed);
        if left == 0 && self.returns {
            return Ok(());
        }
        let cut = || io::Error::other("no power");
        self.left
            .store(left.checked_sub(1).ok_or_else(cut)?, Ordering::Relaxed);
        if left > 1 {
            return Ok(());
        }
        for (path, content) in self.deleted.lock().unwrap().drain(..) {
            fs::write(path, content).unwrap();
        }
        Err(cut())
    }
}

impl FileSystem for Power {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        if self.left.load(Ordering::Relaxed) == 1 {
            fs::write(path, &bytes[..bytes.len() / 2])?;
        }
        self.step()?;
        NativeFileSystem.write(path, bytes)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        self.step()?;
        let mut deleted = self.deleted.lock().unwrap();
        deleted.retain(|(gone, _)| folder_of(gone) != path);
        NativeFileSystem.sync(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step()?;
        NativeFileSystem.rename(from, to)
    }

    fn overwrite(&self, path: &Path) -> io::Result<()> {
        self.step()?;
        NativeFileSystem.overwrite(path)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.step()?;
        if let Ok(content) = fs::read(path) {
            self.deleted
                .lock()
                .unwrap()
                .push((path.to_owned(), content));
        }
        NativeFileSystem.remove(path)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, most)
    }
}

struct Scene {
    folder: tempfile::TempDir,
    order: Order,
}

impl Scene {
    fn new() -> Scene {
        // Hundreds of synchronisations: in memory, where the system has a folder for that.
        let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir());
        let folder = folder.unwrap();
        drop(FileDisk::open(&folder.path().join("state")).unwrap());
        fs::create_dir(folder.path().join("record")).unwrap();
        let scene = Scene {
            order: Order {
                keys: vec![folder.path().join("uav1.key")],
                lists: vec![folder.path().join("access.list")],
                recordings: Some(folder.path().join("record")),
                keep_audit: false,
                beyond: Beyond::Due,
                in_flight: true,
            },
            folder,
        };
        for name in SECRETS {
            fs::write(scene.path(name), SECRET).unwrap();
        }
        for name in OTHERS {
            fs::write(scene.path(name), "not ours").unwrap();
        }
        scene
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The secrets that are there, whole or in part.
    fn secrets(&self) -> Vec<&'static str> {
        let there = |name: &&&str| fs::symlink_metadata(self.path(name)).is_ok();
        SECRETS.iter().filter(there).copied().collect()
    }

    fn begin(&self, system: Box<dyn FileSystem>) -> Result<Option<String>, EraseError> {
        let mut disk = FileDisk::open_on(&self.path("state"), system).unwrap();
        begin(&mut disk, &self.order)
    }

    /// Claims what is ordered beyond this computer.
    fn claim(&self, system: Box<dyn FileSystem>) -> Option<bool> {
        let mut disk = FileDisk::open_to_erase(&self.path("state"), system).unwrap();
        claim(&mut disk)
    }

    fn finish(&self, system: Box<dyn FileSystem>) -> Result<Option<Erased>, EraseError> {
        finish_on(&self.path("state"), system)
    }

    fn start(&self) -> Result<Option<Erased>, EraseError> {
        self.finish(Box::new(NativeFileSystem))
    }
}

const SECRETS: [&str; 16] = [
    "uav1.key",
    "uav1.key.new",
    "uav1.key.next",
    "uav1.key.next.new",
    "uav1.key.previous",
    "uav1.key.dead",
    "access.list",
    "state/exchange-identity",
    "state/exchange-1b000101.json",
    "state/clock-0011223344556677.json",
    "state/plan-1b000101.log",
    "state/authority-1b000101.json",
    "state/audit.key",
    "state/audit-1b000101.log",
    "record/1b000101-1795219200.tlog",
    "record/dli-1795219200-1.pcapng",
];
const OTHERS: [&str; 4] = [
    "uav2.key",
    "uav1.key.lock",
    "record/notes.tlog",
    "record/dli-notes.txt",
];

#[test]
fn a_power_cut_at_any_step_leaves_all_or_an_order_that_the_next_start_finishes() {
    let (mut before, mut after) = (0, 0);
    for step in 1.. {
        for power in [Power::fails_at(step), Power::flickers_at(step)] {
            let (scene, returns) = (Scene::new(), power.returns);
            let begun = scene.begin(Box::new(power));
            if matches!(begun, Ok(None)) {
                continue;
            }
            before += 1;
            assert_eq!(scene.secrets().len(), SECRETS.len(), "{step}");
            // One that is reported as not taken is never carried out.
            let ordered = begun.is_ok();
            assert!(!(ordered && returns), "it can be withdrawn: {step}");
            assert_eq!(is_to_be_erased(&scene.path("state")), ordered, "{step}");
            assert_eq!(scene.start().unwrap().is_some(), ordered, "{step}");
            assert_eq!(scene.secrets().is_empty(), ordered, "{step}");
        }
        let scene = Scene::new();
        scene.begin(Box::new(NativeFileSystem)).unwrap();
        let cut = scene.finish(Box::new(Power::fails_at(step)));
        if let Ok(Some(done)) = cut {
            assert_eq!(done.files.len(), SECRETS.len());
            assert_eq!(scene.secrets(), [""; 0]);
            break;
        }
        after += 1;
        // Nothing is served from it meanwhile, and the next power cut, at the same step, changes nothing.
        let store = scene.path("state");
        if is_to_be_erased(&store) {
            let refused = FileDisk::open(&store).unwrap_err();
            assert!(matches!(refused, OpenError::Zeroizing { .. }), "{refused}");
        }
        let _ = scene.finish(Box::new(Power::fails_at(step)));
        scene.start().unwrap();
        assert_eq!(scene.secrets(), [""; 0], "{step}");
        assert!(!is_to_be_erased(&store) && is_zeroized(&store));
        let others = OTHERS.map(|name| fs::read(scene.path(name)).unwrap());
        assert_eq!(others, OTHERS.map(|_| b"not ours".to_vec()), "{step}");
    }
    // What lies beyond this computer is tried by one start at the most, whatever step of claiming it is cut off.
    let mut cut = 0;
    for step in 1.. {
        let scene = Scene::new();
        scene.begin(Box::new(NativeFileSystem)).unwrap();
        let first = scene.claim(Box::new(Power::fails_at(step)));
        let second = scene.claim(Box::new(NativeFileSystem));
        assert!(first.is_none() || second.is_none(), "{step}");
        assert_eq!(scene.claim(Box::new(NativeFileSystem)), None, "{step}");
        assert!(scene.start().unwrap().is_some() && scene.secrets().is_empty());
        if first.is_some() {
            // It is meant in flight as it was ordered.
            assert_eq!(first, Some(true));
            break;
        }
        cut += 1;
    }
    assert!(cut == 4, "{cut}");
    // Each secret is overwritten and deleted, three folders and the order follow.
    assert!(before == 8, "{before}");
    assert!(after >= 2 * SECRETS.len() + 4, "{after}");
}

#[test]
fn keys_go_first_links_are_not_followed_and_the_audit_log_stays_where_it_is_to() {
    let mut scene = Scene::new();
    scene.order.keep_audit = true;
    let link = scene.path("state/plan-link");
    std::os::unix::fs::symlink(scene.path("uav2.key"), &link).unwrap();
    fs::create_dir(scene.path("state/folder")).unwrap();
    scene.begin(Box::new(NativeFileSystem)).unwrap();
    let done = scene.start().unwrap().unwrap();
    let (keys, rest) = done.files.split_at(6);
    assert!(keys.iter().all(|path| path.starts_with(scene.folder.path())
        && path.display().to_string().contains("uav1.key")));
    assert!(rest[0].ends_with("exchange-1b000101.json"));
    assert_eq!(
        scene.secrets(),
        ["state/audit.key", "state/audit-1b000101.log"]
    );
    assert!(fs::symlink_metadata(&link).is_err());
    assert_eq!(fs::read(scene.path("uav2.key")).unwrap(), b"not ours");
    let why = |name: &str| {
        let of = done.left.iter().find(|(path, _)| path.ends_with(name));
        of.map(|(_, why)| why.clone()).unwrap_or_default()
    };
    assert!(why("plan-link").contains("uav2.key is not erased"));
    assert!(why("audit.key").contains("keep_audit"));
    assert!(why("folder").contains("a folder"));
}

#[test]
fn what_is_overwritten_holds_nothing_of_before_in_its_place() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let (path, other) = (folder.path().join("key"), folder.path().join("other"));
    fs::write(&path, vec![7; 10_000]).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o400)).unwrap();
    // Opened before, it shows what is in its place.
    let mut before = fs::File::open(&path).unwrap();
    NativeFileSystem.overwrite(&path).unwrap();
    let mut found = Vec::new();
    io::Read::read_to_end(&mut before, &mut found).unwrap();
    assert_eq!(found, vec![0; 10_000]);
    let link = folder.path().join("link");
    std::os::unix::fs::symlink(&other, &link).unwrap();
    fs::write(&other, SECRET).unwrap();
    assert!(NativeFileSystem.overwrite(&link).is_err());
    assert_eq!(fs::read(&other).unwrap(), SECRET);
}

#[test]
fn an_order_that_cannot_be_read_or_finished_lets_nothing_be_served() {
    let scene = Scene::new();
    let order = scene.path("state").join(ERASE_ORDER);
    fs::write(&order, "{").unwrap();
    let refused = scene.start().unwrap_err().to_string();
    assert!(refused.contains("nothing is served"), "{refused}");
    assert!(FileDisk::open(&scene.path("state")).is_err());
    fs::remove_file(&order).unwrap();
    scene.begin(Box::new(NativeFileSystem)).unwrap();
    // Only root can give files away.
    let foreign = scene.path("uav1.key");
    if std::os::unix::fs::chown(&foreign, Some(12_345), None).is_ok() {
        let refused = scene.start().unwrap_err().to_string();
        assert!(refused.contains("belongs to user 12345"), "{refused}");
        assert!(
            refused.contains(&foreign.display().to_string()),
            "{refused}"
        );
        assert_eq!(scene.secrets(), ["uav1.key"]);
        assert!(is_to_be_erased(&scene.path("state")));
        std::os::unix::fs::chown(&foreign, Some(0), None).unwrap();
    }
    // A recording of somebody else's is reported, and keeps nothing from being finished.
    let recording = scene.path("record/1b000101-1.tlog");
    fs::write(&recording, "theirs").unwrap();
    let given = std::os::unix::fs::chown(&recording, Some(12_345), None).is_ok();
    let done = scene.start().unwrap().unwrap();
    assert_eq!(given, done.left.iter().any(|(path, _)| *path == recording));
    assert_eq!(scene.start().unwrap(), None);
}

#[test]
fn root_erases_nothing_that_somebody_else_may_have_led_it_to() {
    use std::os::unix::fs::{chown, symlink};
    if !geteuid().is_root() {
        // Another user can erase no file but its own.
        return;
    }
    let scene = Scene::new();
    let again = scene.path("again");
    fs::hard_link(scene.path("uav1.key"), &again).unwrap();
    // The second name that a creation leaves which is cut off is no obstacle.
    fs::remove_file(scene.path("uav1.key.next.new")).unwrap();
    fs::hard_link(scene.path("uav1.key.next"), scene.path("uav1.key.next.new")).unwrap();
    scene.begin(Box::new(NativeFileSystem)).unwrap();
    let refused = scene.start().unwrap_err().to_string();
    assert!(refused.contains("it has 2 names"), "{refused}");
    assert_eq!(fs::read(&again).unwrap(), SECRET);
    assert_eq!(scene.secrets(), ["uav1.key"]);
    fs::remove_file(&again).unwrap();
    assert!(scene.start().unwrap().is_some() && scene.secrets().is_empty());

    // The folder above all is another user's, who may put any file of root's under these names.
    let scene = Scene::new();
    scene.begin(Box::new(NativeFileSystem)).unwrap();
    if chown(scene.folder.path(), Some(12_345), None).is_err() {
        // A container may lack the right.
        return;
    }
    let refused = scene.start().unwrap_err().to_string();
    assert!(refused.contains("belongs to user 12345"), "{refused}");
    assert_eq!(scene.secrets().len(), SECRETS.len());
    // A key behind a link there is not looked for where it leads; behind one of root's it is.
    let folder = tempfile::tempdir().unwrap();
    let (target, own) = (folder.path().join("target"), folder.path().join("own.key"));
    fs::write(&target, SECRET).unwrap();
    symlink(&target, &own).unwrap();
    assert_eq!(real(&own), fs::canonicalize(&target).unwrap());
    let planted = scene.path("uav9.key");
    symlink(&target, &planted).unwrap();
    assert_eq!(real(&planted), planted);
}
