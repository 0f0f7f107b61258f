//! A start that is only tried: it opens what a start opens, by the same code, on a disk in memory, so that whatever ends `vsm run` is
//! found by `vsm doctor`.

use std::path::Path;

use super::StartError;
use super::open::{How, Opened};
use super::vehicle::check_records;
use crate::config::Config;
use crate::shell::key_store::KeyStore;
use crate::shell::status_socket::{self, FILES, RELOAD, SETTINGS, STATUS, ZEROIZE};
use crate::shell::trial_disk::{TrialDisk, TrialFiles};

/// Opens all that a start opens before it takes the store, and closes it again. Nothing is sent, and nothing stays on the disk
/// but the locks beside the keys. Must be called within a tokio runtime.
///
/// # Errors
/// A start would end with this.
pub fn try_start(config: &Config) -> Result<(), StartError> {
    check_records(config)?;
    for name in [STATUS, RELOAD, FILES, SETTINGS, ZEROIZE] {
        status_socket::check(&config.store.dir, name).map_err(StartError::Status)?;
    }
    let files = TrialFiles::default();
    let mut store = TrialDisk::new(&config.store.dir, files.clone());
    let keys = |path: &Path| KeyStore::open_on(path, Box::new(files.clone()));
    let how = How {
        keys: &keys,
        records: false,
    };
    Opened::of(config, &mut store, &how).map(drop)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[tokio::test]
    async fn a_start_that_is_tried_leaves_nothing_behind_and_ends_as_a_start_does() {
        let folder = tempfile::tempdir().unwrap();
        let text = "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[store]\ndir = \"state\"\n\
            [record]\ndir = \"records\"\n";
        let config = Config::parse(text, folder.path()).unwrap();
        try_start(&config).unwrap();
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert!(left.is_empty(), "{left:?}");

        // A record that a start cannot read.
        fs::create_dir(&config.store.dir).unwrap();
        let private = fs::Permissions::from_mode(0o700);
        fs::set_permissions(&config.store.dir, private).unwrap();
        let (key, socket) = ("audit.key", "status.sock");
        fs::write(config.store.dir.join(key), "no key").unwrap();
        let both_end = || {
            let tried = try_start(&config).unwrap_err().to_string();
            let started = super::super::Server::open(&config).unwrap_err();
            assert_eq!(tried, started.to_string());
            tried
        };
        both_end();
        fs::remove_file(config.store.dir.join(key)).unwrap();
        // A folder in the place of a socket.
        fs::create_dir(config.store.dir.join(socket)).unwrap();
        let ended = both_end();
        assert!(ended.contains("status.sock is a folder"), "{ended}");
    }
}
