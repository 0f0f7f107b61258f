//! An administrator's commands, run as root, on the store of a service that has a user of its own: they act as that user, so
//! that what they write is the service's, and a key that they revoke is out of force.
//!
//! Only root can give files away: without it these tests have nothing to show, and the rules are tested in `shell::ownership`.

use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use kit::process::{Running, free_udp_port, program, write_key};
use tempfile::TempDir;

/// The user of the service.
const SERVICE: u32 = 12_345;

/// As the package lays it out: the configuration is root's, state and keys are the service's.
struct Service(TempDir);

impl Service {
    /// `None` where this is not root.
    fn new() -> Option<Service> {
        let service = Service(tempfile::tempdir().expect("a folder"));
        service.open_folder("");
        for (folder, user) in [("etc", 0), ("var", SERVICE), ("var/state", SERVICE)] {
            fs::create_dir(service.path(folder)).expect("a folder");
            chown(service.path(folder), Some(user), Some(user)).ok()?;
        }
        service.open_folder("etc");
        service.open_folder("var");
        let private = fs::Permissions::from_mode(0o700);
        fs::set_permissions(service.path("var/state"), private).expect("a mode");
        for (name, byte) in [("uav1.key", 1), ("a0.key", 2)] {
            let key = service.path("var").join(name);
            write_key(&key, &[byte; 32]);
            service.give(&key);
        }
        let var = service.path("var");
        let var = var.display();
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2]\n\
             guard = {{ key_file = \"{var}/a0.key\" }}\n[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:0\"\n\
             system_id = 1\nsigning = {{ key_file = \"{var}/uav1.key\" }}\n[store]\ndir = \"{var}/state\"\n",
            free_udp_port()
        );
        fs::write(service.path("etc/vsm.toml"), text).expect("the configuration");
        Some(service)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Lets everybody enter a folder, and its owner alone write it.
    fn open_folder(&self, name: &str) {
        let mode = fs::Permissions::from_mode(0o755);
        fs::set_permissions(self.path(name), mode).expect("a mode");
    }

    fn give(&self, path: &Path) {
        chown(path, Some(SERVICE), Some(SERVICE)).expect("given");
    }

    /// Whether it succeeds, and what it prints.
    fn vsm(&self, words: &[&str]) -> (bool, String) {
        let output = Command::new(program("vsm"))
            .args(words)
            .current_dir(self.path("etc"))
            .output()
            .expect("it runs");
        let both = [output.stdout, output.stderr].concat();
        (
            output.status.success(),
            String::from_utf8_lossy(&both).into_owned(),
        )
    }

    fn done(&self, words: &[&str]) -> String {
        let (done, printed) = self.vsm(words);
        assert!(done, "{words:?}: {printed}");
        printed
    }

    /// That the service owns all that is in its folder.
    fn owns_all(&self, folder: &Path) {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let about = fs::symlink_metadata(&path).expect("it is there");
            assert_eq!(about.uid(), SERVICE, "{}", path.display());
            if about.is_dir() {
                self.owns_all(&path);
            }
        }
    }
}

#[test]
fn what_root_does_with_the_store_of_a_service_is_done_as_the_service() {
    let Some(service) = Service::new() else {
        return;
    };
    let var = service.path("var");
    let key = var.join("a0.key").display().to_string();
    assert!(
        service
            .done(&["check-config", "vsm.toml"])
            .contains("guarded with key id")
    );
    assert!(
        service
            .done(&["key", "list", "vsm.toml"])
            .contains("in force")
    );
    assert!(
        service
            .done(&["audit", "verify", "vsm.toml"])
            .contains("no line")
    );
    let printed = service.done(&["doctor", "vsm.toml"]);
    assert!(
        printed.contains("nothing found") && printed.contains(&format!("acting as user {SERVICE}")),
        "{printed}"
    );
    service.done(&["guard", "rotate", &key]);
    service.done(&["guard", "revoke", &key]);
    service.done(&["keygen", &var.join("new.key").display().to_string()]);
    service.owns_all(&var);
    service.done(&["zeroize", "--yes", "vsm.toml"]);
    assert!(!var.join("uav1.key").exists() && !var.join("a0.key").exists());
    service.owns_all(&var);
}

/// Below /var/lib/private, to which the folder of a dynamic user is a link, only root gets.
#[test]
fn a_store_below_a_folder_that_only_root_may_enter_is_reached() {
    let Some(service) = Service::new().filter(|_| may_read_all()) else {
        return;
    };
    let private = fs::Permissions::from_mode(0o700);
    fs::set_permissions(service.path(""), private).expect("a mode");
    let var = service.path("var");
    // As a start that failed early leaves it: root would make the folder.
    fs::remove_dir(var.join("state")).expect("it is empty");
    service.done(&["key", "list", "vsm.toml"]);
    service.done(&["guard", "revoke", &var.join("a0.key").display().to_string()]);
    service.owns_all(&var);
    service.done(&["zeroize", "--yes", "vsm.toml"]);
    assert!(!var.join("uav1.key").exists() && !var.join("a0.key").exists());
    service.owns_all(&var);
}

/// Root of a container may lack this right, by which systemd's folder is reached.
fn may_read_all() -> bool {
    const DAC_READ_SEARCH: u64 = 1 << 2;
    let status = fs::read_to_string("/proc/self/status").expect("what this process may do");
    let mut lines = status.lines();
    let rights = lines.find_map(|line| line.strip_prefix("CapEff:"));
    let rights = u64::from_str_radix(rights.expect("its rights").trim(), 16);
    rights.expect("a number") & DAC_READ_SEARCH != 0
}

/// A bridge that root starts on that store is the service, too.
#[test]
fn a_key_that_root_revokes_is_out_of_force_after_a_reload() {
    let Some(service) = Service::new() else {
        return;
    };
    let key = service.path("var/a0.key");
    let name = key.display().to_string();
    let config = service.path("etc/vsm.toml");
    let mut bridge = Running::start(&program("vsm"), ["run".as_ref(), config.as_os_str()]);
    bridge.wait_for("ready", Duration::from_secs(30));
    service.owns_all(&service.path("var"));
    service.done(&["guard", "revoke", &name]);
    let printed = service.done(&["reload", "vsm.toml"]);
    assert!(
        printed.contains("applied: cucs 1b:00:00:a0 guard key"),
        "{printed}"
    );

    // Another hand has made it root's: nobody is left in doubt about what is in force, and what to do.
    chown(&key, Some(0), Some(0)).expect("given");
    let (done, printed) = service.vsm(&["reload", "vsm.toml"]);
    assert!(!done, "{printed}");
    for words in [
        "NOT APPLIED: cucs 1b:00:00:a0 guard key",
        "belongs to user 0",
        "chown 12345 it",
    ] {
        assert!(printed.contains(words), "{words}: {printed}");
    }
    let (found, printed) = service.vsm(&["doctor", "vsm.toml"]);
    assert!(!found && printed.contains("chown 12345 it"), "{printed}");
    service.give(&key);
    service.done(&["reload", "vsm.toml"]);
}

/// Where only root may write, as /etc, a key of the service stays the service's.
#[test]
fn a_guard_key_in_a_folder_of_roots_stays_its_owners() {
    let Some(service) = Service::new() else {
        return;
    };
    let key = service.path("etc/a0.key");
    write_key(&key, &[3; 32]);
    service.give(&key);
    let before = fs::read(&key).expect("a key");
    service.done(&["guard", "rotate", "a0.key"]);
    service.done(&["guard", "revoke", "a0.key"]);
    assert_ne!(fs::read(&key).expect("a key"), before);
    assert_eq!(fs::metadata(&key).expect("a key").uid(), SERVICE);
    // An access list is written for the service, too.
    service.done(&["keygen", "access.key"]);
    let list = service.path("var/access.list").display().to_string();
    let grant = format!(
        "access grant {list} --vsm-id 1b:00:00:01 --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --groups fly \
         --guard-key 0011223344556677 --until never"
    );
    service.done(&grant.split_whitespace().collect::<Vec<_>>());
    service.done(&["access", "sign", &list, "--key-file", "access.key"]);
    service.owns_all(&service.path("var"));
}

/// The service owns its folder, and so decides where each name in it leads: root must not follow.
#[test]
fn a_link_of_the_service_does_not_lead_root_to_files_of_its_own() {
    let Some(service) = Service::new() else {
        return;
    };
    let own = service.path("roots");
    fs::create_dir(&own).expect("a folder");
    let private = fs::Permissions::from_mode(0o700);
    fs::set_permissions(&own, private).expect("a mode");
    fs::write(own.join("file"), "root's").expect("a file");
    let state = service.path("var/state");
    fs::remove_dir(&state).expect("it is empty");
    symlink(&own, &state).expect("a link");
    std::os::unix::fs::lchown(&state, Some(SERVICE), Some(SERVICE)).expect("given");
    let (done, printed) = service.vsm(&["zeroize", "--yes", "vsm.toml"]);
    assert!(!done, "{printed}");
    assert_eq!(fs::read(own.join("file")).expect("a file"), b"root's");
}

/// Nor by way of an access list: its folder's owner decides where its name leads.
#[test]
fn an_access_list_behind_a_link_of_the_service_is_not_read_or_written_as_root() {
    let Some(service) = Service::new().filter(|_| may_read_all()) else {
        return;
    };
    let own = service.path("roots");
    fs::create_dir(&own).expect("a folder");
    let private = fs::Permissions::from_mode(0o700);
    fs::set_permissions(&own, private).expect("a mode");
    let secret = own.join("secret");
    fs::write(&secret, "root's\n").expect("a file");
    for (link, target) in [("var/acl", &own), ("var/l.list", &secret)] {
        let link = service.path(link);
        symlink(target, &link).expect("a link");
        std::os::unix::fs::lchown(&link, Some(SERVICE), Some(SERVICE)).expect("given");
    }
    let grant = |list: &str| {
        let list = service.path(list).display().to_string();
        let words = format!(
            "access grant {list} --vsm-id 1b:00:00:01 --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --groups fly \
             --guard-key 0011223344556677 --until never"
        );
        service.vsm(&words.split_whitespace().collect::<Vec<_>>())
    };
    let (done, printed) = grant("var/acl/new.list");
    assert!(!done && !own.join("new.list").exists(), "{printed}");
    let list = service.path("var/l.list").display().to_string();
    for mode in [0o600, 0o640] {
        fs::set_permissions(&secret, fs::Permissions::from_mode(mode)).expect("a mode");
        for (done, printed) in [grant("var/l.list"), service.vsm(&["access", "list", &list])] {
            assert!(!done && printed.contains("belongs to user 0"), "{printed}");
            assert!(!printed.contains("root's"), "{printed}");
        }
    }
    assert_eq!(fs::read(&secret).expect("a file"), b"root's\n");
}

/// Nor where the store is root's, and the folder around it is not: its owner may put anything beside it.
#[test]
fn root_erases_nothing_in_a_folder_of_another_user_or_of_everybody() {
    let Some(service) = Service::new() else {
        return;
    };
    let own = service.path("roots");
    fs::create_dir(&own).expect("a folder");
    let victim = own.join("file");
    fs::write(&victim, "root's").expect("a file");
    let var = service.path("var");
    chown(var.join("state"), Some(0), Some(0)).expect("given");
    let key = var.join("uav1.key");
    fs::remove_file(&key).expect("the key");
    symlink(&victim, &key).expect("a link");
    std::os::unix::fs::lchown(&key, Some(SERVICE), Some(SERVICE)).expect("given");
    let (done, printed) = service.vsm(&["zeroize", "--yes", "vsm.toml"]);
    assert!(
        !done && printed.contains(&format!("acting as user {SERVICE}")),
        "{printed}"
    );
    assert_eq!(fs::read(&victim).expect("a file"), b"root's");

    // Nothing is there yet, and anybody may put it there.
    let open = service.path("open");
    fs::create_dir(&open).expect("a folder");
    fs::set_permissions(&open, fs::Permissions::from_mode(0o1777)).expect("a mode");
    let config = fs::read_to_string(service.path("etc/vsm.toml")).expect("a file");
    let (before, after) = (var.display().to_string(), open.display().to_string());
    let config = config.replace(&before, &after);
    fs::write(service.path("etc/open.toml"), config).expect("a file");
    let (done, printed) = service.vsm(&["zeroize", "--yes", "open.toml"]);
    assert!(
        !done && printed.contains("as root, make it first"),
        "{printed}"
    );
    assert!(!open.join("state").exists());
}
