//! The guard keys of the CUCSs: read at the start, and when the configuration is read again.

use mavlink_link::Now;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;

use super::StartError;
use crate::config::Config;
use crate::session::GuardKeyUntil;
use crate::shell::guard_file;

/// The keys of each CUCS with a guard; none has the key of another, or of `others`.
pub(super) fn keys(
    config: &Config,
    others: impl Iterator<Item = (String, KeyId)>,
    now: Now,
) -> Result<Vec<(Id, Vec<GuardKeyUntil>)>, StartError> {
    let mut known: Vec<(String, KeyId)> = others.collect();
    let mut all = vec![];
    for station in config.stations() {
        let Some(guard) = &station.guard else {
            continue;
        };
        let keys = guard_file::read(&guard.key_file, now)?;
        for (key, _) in &keys {
            let id = key.id();
            // Whoever has it could send in the name of both.
            if let Some((other, _)) = known.iter().find(|(_, known)| *known == id) {
                return Err(StartError::GuardKey {
                    station: station.id,
                    other: other.clone(),
                    key: id,
                });
            }
        }
        let name = format!("CUCS {}", station.id);
        known.extend(keys.iter().map(|(key, _)| (name.clone(), key.id())));
        all.push((station.id, keys));
    }
    Ok(all)
}
