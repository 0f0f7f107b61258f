//! The guard keys of the CUCSs, and the access list: read at the start, and when the configuration is read again.

use std::io::Read as _;
use std::path::Path;

use mavlink_link::Now;
use mavlink_link::signing::{KeyId, SigningKey};
use stanag_msgs::Id;

use super::StartError;
use crate::config::{Access, Config, open_file};
use crate::session::{GuardKeyUntil, MAX_LIST_BYTES};
use crate::shell::{guard_file, key_file, ownership};

/// The keys of each CUCS with a guard. None may be the key of another CUCS, or one of `others`.
pub(super) fn keys(
    config: &Config,
    others: impl Iterator<Item = (String, KeyId)>,
    now: Now,
) -> Result<Vec<(Id, Vec<GuardKeyUntil>)>, StartError> {
    let all = each(config, others, now).into_iter();
    all.map(|(id, keys)| Ok((id, keys?))).collect()
}

/// The same of each by itself, whatever is wrong with another.
pub(super) fn each(
    config: &Config,
    others: impl Iterator<Item = (String, KeyId)>,
    now: Now,
) -> Vec<(Id, Result<Vec<GuardKeyUntil>, StartError>)> {
    let mut known: Vec<(String, KeyId)> = others.collect();
    let guarded = config
        .stations()
        .filter_map(|one| Some((one.id, one.guard.as_ref()?)));
    let each = guarded.map(|(station, guard)| {
        let keys = own_keys(station, &guard.key_file, &known, now);
        let name = format!("CUCS {station}");
        let held = keys.iter().flatten().map(|(key, _)| key.id());
        known.extend(held.map(|key| (name.clone(), key)));
        (station, keys)
    });
    each.collect()
}

fn own_keys(
    station: Id,
    file: &Path,
    known: &[(String, KeyId)],
    now: Now,
) -> Result<Vec<GuardKeyUntil>, StartError> {
    let keys = guard_file::read(file, now)?;
    for id in keys.iter().map(|(key, _)| key.id()) {
        // Someone with it could send in the name of both.
        if let Some((other, _)) = known.iter().find(|(_, known)| *known == id) {
            return Err(StartError::GuardKey {
                station,
                other: other.clone(),
                key: id,
            });
        }
    }
    Ok(keys)
}

/// The owner of each key.
pub(super) fn owners(keys: &[(Id, Vec<GuardKeyUntil>)]) -> Vec<(String, KeyId)> {
    let of = |(station, keys): &(Id, Vec<GuardKeyUntil>)| {
        let name = format!("CUCS {station}");
        let each = keys.iter().map(|(key, _)| (name.clone(), key.id()));
        each.collect::<Vec<_>>()
    };
    keys.iter().flat_map(of).collect()
}

/// The key of the access list, which may be none of `others`.
pub(super) fn access_key(
    access: &Access,
    mut others: impl Iterator<Item = (String, KeyId)>,
) -> Result<SigningKey, StartError> {
    let key = key_file::read(&access.key_file)?;
    // A CUCS with this key could sign a list for itself.
    match others.find(|(_, other)| *other == key.id()) {
        None => Ok(key),
        Some((other, key)) => Err(StartError::AccessKey { other, key }),
    }
}

/// The content of the access list's file. It needs no protection of its own, since it is signed.
pub(super) fn access_list(path: &Path) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    // One byte more, to detect a file longer than any list.
    let opened = open_file(path).map_err(|cause| ownership::explain(path, cause));
    let read = opened.and_then(|file| {
        ownership::check_readable(&file.metadata()?, path)?;
        let most = MAX_LIST_BYTES as u64 + 1;
        file.take(most).read_to_end(&mut bytes)
    });
    match read {
        Ok(_) => Ok(bytes),
        Err(cause) => Err(format!("access.list {}: {cause}", path.display())),
    }
}
